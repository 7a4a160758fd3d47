"""A table as text, CSV, Markdown, LaTeX and HTML.

The modules beside this one fill tables with results.

Names come from files and may hold anything: each format escapes what it would interpret.
"""

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import compress, groupby
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from markupsafe import Markup, escape

from accpinn import channels
from accpinn.findings import probability
from accpinn.results.glossary import MEANINGS
from accpinn.results.marks import OUTSIDE
from accpinn.storage import csv_cell
from accpinn.units import FloatArray, Quantity

if TYPE_CHECKING:
    from jinja2 import Template
    from pandas import DataFrame


class Range(NamedTuple):
    """An interval as one cell; an end may be infinite, both are nan where nothing is known."""

    lower: float
    upper: float


@dataclass(frozen=True)
class Marked:
    """A cell with a mark, and the sentence that changes how it is read."""

    cell: "str | float | Quantity"
    why: str
    mark: str


Cell = str | float | Range | Quantity | Marked | None
Values = Sequence[float] | FloatArray

ABSENT = "–"
"""Stands where a quantity has no meaning, as the leader's α."""

_SYMBOLS = {
    "α": "alpha", "β": "beta", "γ": "gamma", "κ": "kappa", "λ": "lambda", "τ": "tau", "ω": "omega",
    "Δ": "Delta", "∞": "infty", "‖": "|", "≤": "le",
}  # fmt: skip
_CHARACTERS = {
    "\\": "backslash", "~": "asciitilde", "^": "asciicircum", "<": "less", ">": "greater",
    "|": "bar", '"': "quotedbl",
}  # fmt: skip
_LATEX = {
    **{letter: f"\\{letter}" for letter in "{}$&#%_"},
    **{letter: rf"\text{name}{{}}" for letter, name in _CHARACTERS.items()},
    **{letter: rf"$\{name}$" for letter, name in _SYMBOLS.items()},
    **{digit: f"$_{k}$" for k, digit in enumerate("₀₁₂")},
    **{"○": r"$^\circ$", "□": r"\fbox{}", "†": r"$\dagger$", "▲": r"$\triangle$"},
    **{"²": "$^2$", "−": "$-$", "–": "--", "…": r"\dots{}", "\n": " ", "\t": " "},
}
_LATIN = "\u024f"
"""Letters up to here LaTeX knows; of others it shows the number."""
_SPELT = str.maketrans(
    {"α": "alpha", "β": "beta", "τ": "tau", "Δ": "delta ", "ω": "omega", "∞": "inf",
     "₁": "1", "₂": "2", "²": "2", "%": "percent", "/": " per "}
)  # fmt: skip
_HERE = Path(__file__).parent
STYLE = f"<style>\n{(_HERE / 'table.css').read_text(encoding='utf-8')}</style>"
"""What `Table.to_html` needs once on a page."""
ENDINGS = {1: ("",), 2: ("_low", "_high"), 3: ("", "_low", "_high")}
"""What is added to a column's name in a CSV file, by the number of columns that it takes there."""
OUTSIDE_WORDS = "outside its interval"
FIXED = "fixed"
MANY = 12
"""Number of columns beyond which they stand closer."""
LONG = 16
"""Characters of a row's name beyond which a narrow window may cut it."""


@dataclass(frozen=True)
class Column:
    """What stands in a column, and how."""

    title: str
    unit: str = ""
    digits: int | None = None
    """After the point; None for text."""
    group: str = ""
    """A heading shared with the neighbouring columns of the same group."""
    least: bool = False
    """Whether a cell above zero that the digits would show as zero says "< 0.01" instead."""
    said: Callable[[float], str] | None = None
    """How its numbers are put, where not by their digits alone."""
    prose: bool = False
    """Whether its texts may go on in further lines."""
    key: str = ""
    """Its name in CSV files; by default from group, title and unit."""
    is_brief: bool = False
    """Whether of a value with an interval the value alone is shown, with the digits that the
    interval supports; the interval is in CSV files, and shown on hover on a web page."""
    may_be_fixed: bool = False
    """Whether an interval without width is that of a parameter that is fixed, not estimated."""

    @classmethod
    def of(cls, quantity: channels.Quantity, group: str = "", key: str = "") -> "Column":
        """The column of a quantity, under its symbol."""
        return cls(quantity.symbol, quantity.unit, quantity.digits, group, key=key)

    @classmethod
    def chance(cls, title: str, group: str = "") -> "Column":
        """The column of a probability or of a share of vehicles, in percent."""
        return cls(title, "%", 0, group, said=_chance)

    @property
    def heading(self) -> str:
        """Title and unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    @property
    def full_title(self) -> str:
        """Group (without brackets), title and unit, for a cell that stands alone."""
        return f"{self.group.partition(' (')[0]} {self.heading}".strip()

    @property
    def csv_name(self) -> str:
        """Lower-case words joined by underscores, as "surrogate_fit_mae_p_m"."""
        if self.key:
            return self.key
        words = f"{self.group} {self.title} {self.unit}".replace("1/s", "per s")
        return re.sub(r"\W+", "_", words.translate(_SPELT).lower()).strip("_")

    @property
    def html_class(self) -> str:
        """The class of its cells in HTML; empty for none."""
        name = "prose" if self.prose else "" if self.digits is None else "number"
        return name + " brief" * self.is_brief

    def shown(self, cell: Cell) -> str:
        """A cell as the reader sees it."""
        if isinstance(cell, Range):
            return self._range(cell)
        if isinstance(cell, Marked):
            return f"{self.shown(cell.cell)}{cell.mark}"
        if isinstance(cell, Quantity):
            value, ends = self._with_interval(cell)
            value += OUTSIDE.glyph * (self._why(cell) != "")
            return value if self.is_brief or not ends else f"{value} ({ends})"
        if cell is None or (isinstance(cell, float) and not math.isfinite(cell)):
            return ABSENT
        if isinstance(cell, str):
            return cell
        if self.said:
            return self.said(cell)
        digits = self.digits or 0
        shown = f"{cell:z.{digits}f}"  # z: nothing rounds to minus zero
        if self.least and cell > 0 and float(shown) == 0:
            return f"< {10.0**-digits:.{digits}f}"
        return shown

    def html(self, cell: Cell) -> Markup:
        """The same for a web page: where there is little room, an interval has its own line."""
        marks = [(self._why(cell), OUTSIDE.glyph)]
        if isinstance(cell, Marked):
            marks, cell = [(self._why(cell.cell), OUTSIDE.glyph), (cell.why, cell.mark)], cell.cell
        value, ends = (
            self._with_interval(cell) if isinstance(cell, Quantity) else (self.shown(cell), "")
        )
        if not isinstance(cell, str):
            value, ends = (part.replace("-", "−") for part in (value, ends))
        if self.is_brief and ends:
            return Markup(f'<abbr title="{escape(ends)}">{escape(value)}</abbr>')
        mark = "".join(
            f'<b class="mark" title="{escape(why)}">{escape(sign)}</b>'
            for why, sign in marks
            if why
        )
        interval = f" <span>({escape(ends)})</span>" if ends else ""
        return Markup(f"{escape(value)}{mark}{interval}")

    def _why(self, cell: Cell) -> str:
        """Why a value with an interval is marked: it lies outside; empty for every other cell."""
        is_marked = isinstance(cell, Quantity) and not (self.is_brief or cell.is_inside)
        return OUTSIDE_WORDS if is_marked else ""

    def _with_interval(self, cell: Quantity) -> tuple[str, str]:
        """As "0.0147" and "0.0095–0.0198", or "-0.7 to 6.5"; nothing is added to an unknown one."""
        if math.isnan(cell.value) and math.isnan(cell.lower):
            return ABSENT, ""
        if self.may_be_fixed and cell.lower == cell.value == cell.upper:
            return self.shown(cell.value), FIXED
        column = replace(self, digits=supported_digits(cell.lower, cell.upper, self.digits or 0))
        ends = replace(column, said=None)._range(Range(cell.lower, cell.upper))
        is_plain = math.isfinite(cell.upper - cell.lower) and not ends.startswith("-")
        return column.shown(cell.value), ends.replace(" to ", "–") if is_plain else ends

    def _range(self, cell: Range) -> str:
        low, high = (math.isfinite(end) for end in cell)
        if math.isnan(cell.lower) or math.isnan(cell.upper):
            return ABSENT
        if low and high:
            return f"{self.shown(cell.lower)} to {self.shown(cell.upper)}"
        if low:
            return f"{self.shown(cell.lower)} or more"
        return f"up to {self.shown(cell.upper)}" if high else "anything"


Filled = tuple[Column, Iterable[Cell]]
"""A column with its cells."""


def interval_cells(values: Values, low: Values, high: Values) -> list[Quantity]:
    """(K,) values with their intervals."""
    return [*map(Quantity, *(np.asarray(part, float).tolist() for part in (values, low, high)))]


def _chance(percent: float) -> str:
    """A probability in percent, without the sign."""
    return probability(percent / 100).removesuffix(" %")


def percent_cells(shares: Values) -> list[Cell]:
    """(K,) shares in percent."""
    return [100 * float(share) for share in shares]


def supported_digits(low: float, high: float, most: int) -> int:
    """Digits after the point such that the last one is the second of the interval's half-width."""
    half = (high - low) / 2
    if not math.isfinite(half):
        return max(0, most - 2)
    decade = math.floor(math.log10(half) + 1e-9) if half > 0 else -most
    return min(most, max(0, 1 - decade))


def between(low: float, high: float, digits: int) -> str:
    """An interval in words; an end may be infinite."""
    return Column("", digits=digits).shown(Range(low, high))


@dataclass(frozen=True)
class Table:
    """Columns and rows, ready for any format."""

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    colours: tuple[str, ...] = ()
    """A mark before each row's first cell, in HTML."""

    @classmethod
    def of(cls, caption: str, filled: Iterable[Filled]) -> "Table":
        """A table from its columns with their cells, all of the same length."""
        columns, cells = zip(*filled, strict=True)
        # Without numpy's types.
        python = ((c.item() if isinstance(c, np.generic) else c for c in cs) for cs in cells)
        rows = zip(*python, strict=True)
        return cls(caption, tuple(columns), tuple(rows))

    def coloured(self, colours: Sequence[str]) -> "Table":
        """The same table with a mark for each row."""
        return replace(self, colours=tuple(colours))

    def only(self, wanted: Callable[[Column], bool]) -> "Table":
        """The first column and the ``wanted`` ones, without the rows that are empty in those."""
        places = [k for k, column in enumerate(self.columns) if k and wanted(column)]
        kept = [any(row[k] is not None for k in places) for row in self.rows]
        return replace(
            self,
            columns=tuple(self.columns[k] for k in (0, *places)),
            rows=tuple(tuple(row[k] for k in (0, *places)) for row in compress(self.rows, kept)),
            colours=tuple(compress(self.colours, kept)),
        )

    def to_text(self) -> str:
        """Columns as wide as they need to be; the first is set left, the others right."""
        body = [[column.heading for column in self.columns], *self._shown()]
        widths = [max(map(len, column)) for column in zip(*body, strict=True)]
        groups, at = [], 0
        for name, count in self._groups():
            room = sum(widths[at : at + count]) + 2 * (count - 1)
            widths[at + count - 1] += max(0, len(name) - room)
            groups.append(name.rjust(max(room, len(name))))
            at += count
        lines = [self.caption] if self.caption else []
        lines += ["  ".join(groups).rstrip()] if groups else []
        for row in body:
            cells = [row[0].ljust(widths[0])]
            cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
            lines.append("  ".join(cells).rstrip())
        return "\n".join([*lines, *self.legend])

    def to_csv(self) -> str:
        """Full precision, ends of an interval in columns of their own; empty where no value is.

        What changes how a value is read, as that it is extrapolated, has a column that ends in
        ``_note``. No text is such that a spreadsheet would evaluate it.
        """
        columns = self._flat()
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        rows = zip(*columns.values(), strict=True) if self.rows else ()
        writer.writerows([_csv_cell(cell) for cell in row] for row in rows)
        return text.getvalue()

    def to_frame(self) -> "DataFrame":
        """A pandas frame with the columns of `to_csv`: full precision, None and nan where empty."""
        from pandas import DataFrame  # takes a third of a second

        return DataFrame(self._flat())

    def _flat(self) -> dict[str, list[Cell]]:
        """Every column of the CSV file by its name: values, ends of intervals, notes."""
        flat: dict[str, list[Cell]] = {}
        for place, column in enumerate(self.columns):
            cells = [row[place] for row in self.rows]
            parts = [_parts(cell) for cell in cells]
            size = max(map(len, parts), default=1)
            for k, ending in enumerate(ENDINGS[size]):
                flat[column.csv_name + ending] = [
                    part[k] if k < len(part) else None for part in parts
                ]
            if any(isinstance(cell, Marked) for cell in cells):
                notes = [cell.why if isinstance(cell, Marked) else "" for cell in cells]
                flat[f"{column.csv_name}_note"] = [*notes]
        return flat

    @property
    def legend(self) -> tuple[str, ...]:
        """What each mark in it means, as "*: extrapolated: no window holds this speed"."""
        pairs = [pair for row in self.rows for pair in zip(self.columns, row, strict=True)]
        said = [f"{cell.mark}: {cell.why}" for _, cell in pairs if isinstance(cell, Marked)]
        bare = ((c, cell.cell if isinstance(cell, Marked) else cell) for c, cell in pairs)
        said += [f"{OUTSIDE.glyph}: {why}" for c, cell in bare if (why := c._why(cell))]
        return tuple(dict.fromkeys(said))

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        return f"{STYLE}\n{self.to_html()}"

    def __str__(self) -> str:
        """The table as text."""
        return self.to_text()

    def to_latex(self) -> str:
        """A table environment; its rules need the package booktabs."""
        shape = "".join("l" if column.digits is None else "r" for column in self.columns)
        heads, rules, at = [], [], 1
        for name, width in self._groups():
            heads.append(f"\\multicolumn{{{width}}}{{c}}{{{latex(name)}}}")
            rules += [f"\\cmidrule(lr){{{at}-{at + width - 1}}}"] if name else []
            at += width
        rows = [[column.heading for column in self.columns], *self._shown()]
        heading, *body = (f"    {' & '.join(map(latex, cells))} \\\\" for cells in rows)
        lines = [
            "% in the preamble: \\usepackage{booktabs}",
            "\\begin{table}[tbp]",
            "  \\centering",
            f"  \\caption{{{latex(self.caption)}}}",
            f"  \\begin{{tabular}}{{{shape}}}",
            "    \\toprule",
            *([f"    {' & '.join(heads)} \\\\", f"    {' '.join(rules)}"] if heads else ()),
            heading,
            "    \\midrule",
            *body,
            "    \\bottomrule",
            "  \\end{tabular}",
            *(f"  \\par {latex(line)}" for line in self.legend),
            "\\end{table}",
        ]
        return "\n".join(lines) + "\n"

    def to_markdown(self) -> str:
        """A table of GitHub's Markdown under its caption; numbers are set right."""
        rows = [[column.full_title for column in self.columns], *self._shown()]
        rule = " | ".join("---" if column.digits is None else "---:" for column in self.columns)
        heading, *body = (f"| {' | '.join(map(markdown, cells))} |" for cells in rows)
        lines = [f"{markdown(self.caption)}\n"] if self.caption else []
        lines += [heading, f"| {rule} |", *body]
        if self.legend:
            lines += ["", "  \n".join(map(markdown, self.legend))]
        return "\n".join(lines) + "\n"

    def to_html(self) -> str:
        """A figure with caption and table, both of class "figures"; `STYLE` belongs to it."""
        return template("tables/table.html").render(
            table=self, groups=self._groups(), rows=self._shown(Column.html), long=LONG, many=MANY,
            classes=[column.html_class for column in self.columns],
            titles=[column.full_title for column in self.columns],
        )  # fmt: skip

    def _shown(self, as_text: Callable[[Column, Cell], str] = Column.shown) -> list[list[str]]:
        columns = self.columns
        return [[as_text(c, v) for c, v in zip(columns, row, strict=True)] for row in self.rows]

    def _groups(self) -> list[tuple[str, int]]:
        """Each group's heading and how many columns it spans; empty where there is none."""
        spans = [(name, len(list(cs))) for name, cs in groupby(self.columns, lambda c: c.group)]
        return spans if any(name for name, _ in spans) else []


@cache
def template(name: str) -> "Template":
    """The HTML of tables and pages, by its path below `results`."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # few commands print HTML

    environment = Environment(
        loader=FileSystemLoader(_HERE.parent), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.globals["meanings"] = MEANINGS
    return environment.get_template(name)


def latex(text: str) -> str:
    """Text as LaTeX shows it, whatever it holds."""
    shown = "".join(
        _LATEX.get(c) or (c if c.isprintable() and c <= _LATIN else f"(U+{ord(c):04X})")
        for c in text
    )
    # After the end of a row a bracket would be read as its option.
    return f"{{}}{shown}" if shown.startswith("[") else shown


def markdown(text: str) -> str:
    """Text as Markdown shows it, whatever it holds."""
    return re.sub(r"([\\`*_\[\]<>|#~&])", r"\\\1", re.sub(r"\s+", " ", text))


def _parts(cell: Cell) -> tuple[Cell, ...]:
    """A cell as those that it takes in a CSV file."""
    bare = cell.cell if isinstance(cell, Marked) else cell
    if isinstance(bare, Quantity):
        return bare.value, bare.lower, bare.upper
    return tuple(bare) if isinstance(bare, Range) else (bare,)


def _csv_cell(cell: Cell) -> Cell:
    if cell is None or cell != cell:
        return ""
    guarded: Cell = csv_cell(cell)
    return guarded
