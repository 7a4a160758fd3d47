"""The one reader of tables: how a table is written, and its columns by name.

A table is rows of cells, one below the other, all as wide as its data. Above them may stand
metadata, a row of column names and a row of units; comments and repeated column names between the
data are left out. Where no row of names is found the columns are called "column 1", "column 2", ..

Cells are split by Python's `csv` and numbers read by `float`, which rounds correctly. A cell that
is neither missing nor a number is refused with its place, and so is a row of another width.
"""

import csv
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from sys import getsizeof

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import Quantity
from accpinn.errors import RecordingError
from accpinn.findings import Finding, joined
from accpinn.recordings import Mode, Recording
from accpinn.recordings.clocks import LONGEST_STEP, MISSING, SHORTEST_STEP
from accpinn.recordings.source import SourceFile, excerpt
from accpinn.units import FloatArray

SEPARATORS = ("\t", ";", "|", ",", " ")
"""Separators in the order in which they are tried; the last stands for any white space."""
HEADER_ROWS = 60
"""Rows at the beginning of a file among which the data are to begin."""
HEADER_BYTES = 100_000
"""Beginning of a file in which the column names stand."""
PREVIEWED = 5
"""Rows of a preview."""
ALIKE = 10
"""Rows that follow each other and hold the same kinds of cells where data begin."""
LONGEST_NAME = 60
"""Characters of a column's name in a sentence."""
MINIMUM_SAMPLES = 10
"""Least number of rows of a recording."""
MOST_RUNS = 10_000
"""Runs that a table may hold; a column that tells more apart tells something else."""
LISTED = 12
"""Runs that a sentence names."""
UNIT_WORDS = frozenset((
    "s", "sec", "secs", "second", "seconds", "ms", "us", "µs", "ns", "min", "h", "hh:mm:ss",
    "m", "ft", "feet", "cm", "mm", "km", "m/s", "mps", "km/h", "kmh", "kph", "kmph", "mph", "mi/h",
    "ft/s", "fps", "kn", "kt", "knots", "m/s2", "m/s^2", "m/s²", "g", "deg", "°", "rad", "1", "-",
    "%", "rpm", "bool", "iso 8601", "utc", "datetime", "id", "n/a",
))  # fmt: skip
"""What may stand in a row of units, in small letters and without brackets."""
COMMENTS = ("#", "%", "//")
"""Beginnings of a comment, which may be the row of column names."""
DOUBLED = 0.4
"""Least share of blank rows where a program has doubled all line ends."""
_DOUBLED = (b"\n\n", b"\n\r\n", b"\r\r\n")
_LONGEST_MISSING = max(map(len, MISSING))
_BLOCK = 5_000
"""Cells that are split at a time; larger blocks fit no processor's cache."""
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_INSTANT = re.compile(r"[\dT:.,/+\-Z ]*\d[:/\-.]\d[\dT:.,/+\-Z ]*( ?[AaPp][Mm])?")


@dataclass(frozen=True)
class Layout:
    """How a table is written, and its first rows."""

    names: tuple[str, ...]
    """Names of all columns, in their order, all different; "column 3" where there is none, and
    "speed (column 3)" where another column has the same."""
    rows: tuple[tuple[str, ...], ...]
    """The first rows of cells, as they are written."""
    separator: str
    """A space stands for any white space."""
    decimal: str
    """Sign before the fraction of a number: a point or a comma."""
    header_row: int
    """Number of the row with the column names, 1 = first; 0 where there is none."""
    data_row: int
    """Number of the first row of data, 1 = first."""
    units: tuple[str, ...] = ()
    """The cells of a row of units below the names; empty without one."""
    skipped: tuple[int, ...] = ()
    """Numbers of the rows below the first of data that are none: comments and repeated names."""

    def row_number(self, row: int) -> int:
        """The number in the file of a row of data, 0 = first."""
        number = self.data_row + row
        for _ in self.skipped:  # each one that is passed may bring the next one nearer
            moved = self.data_row + row + bisect_right(self.skipped, number)
            if moved == number:
                break
            number = moved
        return number


def layout_of(source_file: SourceFile) -> Layout:
    """How a table is written.

    Raises:
        RecordingError: where no rows of data are found, or their names are more or fewer.
    """
    lines = list(source_file.lines(HEADER_BYTES))
    if len(source_file.text) > HEADER_BYTES:
        lines = lines[:-1]  # cut off anywhere
    beginning = lines[: HEADER_ROWS + 2 * ALIKE]
    found = [(separator, _first_data(beginning, separator)) for separator in SEPARATORS]
    candidates = [(separator, at) for separator, at in found if at is not None]
    if not candidates:
        fault = "no rows of numbers below each other are found"
        raise source_file.refusal(fault, "choose a table with a column for each quantity")
    separator, (first, width, _) = max(candidates, key=lambda candidate: candidate[1][2])
    return _layout(source_file, lines, separator, first, width)


def _first_data(lines: Sequence[str], separator: str) -> tuple[int, int, float] | None:
    """Where rows of equal kinds begin if cells are separated so.

    Returns:
        Position of the first one, the rows' width, and the share of their cells that are numbers,
        instants or missing; None where no rows are alike.
    """
    rows = [None if _is_comment(line) else cells_of(line, separator) for line in lines]
    for first in range(min(len(rows), HEADER_ROWS)):
        block = [row for row in rows[first : first + 2 * ALIKE] if row][:ALIKE]
        if rows[first] is None or len(block) < min(ALIKE, 2):
            continue
        widths = Counter(map(len, block))
        width, often = widths.most_common(1)[0]
        kinds = [[_kind(cell) for cell in row] for row in block if len(row) == width]
        columns = [{kind for kind in column if kind} for column in zip(*kinds, strict=True)]
        if width < 2 or often < 0.6 * len(block) or len(rows[first] or ()) != width:
            continue
        if sum(bool(column) and column <= {"number", "instant"} for column in columns) < 2:
            continue
        below = [{kind for kind in column[1:] if kind} for column in zip(*kinds, strict=True)]
        if any(
            kind == "word" and others == {"number"}
            for kind, others in zip(kinds[0], below, strict=True)
        ):
            continue  # a row of units or names, some of which are empty
        share = float(np.mean([kind != "word" for row in kinds for kind in row]))
        return first, width, share
    return None


def _kind(cell: str) -> str:
    """What a cell holds: "number", "instant" (of a day), "word", or "" where a value is missing."""
    if cell.casefold() in MISSING:
        return ""
    if _NUMBER.fullmatch(cell):
        return "number"
    return "instant" if _INSTANT.fullmatch(cell) else "word"


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _layout(
    source_file: SourceFile, lines: Sequence[str], separator: str, first: int, width: int
) -> Layout:
    """The layout of a table whose rows of equal kinds begin at position ``first``."""
    above = [cells_of(line, separator) for line in lines[:first]]
    header, units = _header(above, lines, separator, width)
    data = first if header is None else header + 1 + bool(units)
    while data < first and (_is_comment(lines[data]) or not lines[data].strip()):
        data += 1
    if header is None:
        _require_no_other_names(source_file, above, lines, first, width)
    named = () if header is None else _names_in(lines[header], separator)
    below = lines[data:]
    rows = _cells([row for row in below if row.strip() and not _is_comment(row)], separator)
    if header is not None and len(named) < width and any(any(row[width - 1 :]) for row in rows):
        raise _other_names(source_file, len(named), width, header)
    skipped = _skipped(source_file, data, lines[header] if header is not None else None)
    shown = [tuple(map(excerpt, row)) for row in rows[:PREVIEWED]]
    return Layout(
        _distinct(named, width), tuple(shown), separator, _decimal(rows, separator),
        0 if header is None else header + 1, data + 1, units, skipped,
    )  # fmt: skip


def _header(
    above: Sequence[Sequence[str]], lines: Sequence[str], separator: str, width: int
) -> tuple[int | None, tuple[str, ...]]:
    """Position of the row of names nearest above the data, and the row of units below it."""
    units: tuple[str, ...] = ()
    for at in range(len(above) - 1, -1, -1):
        cells = _names_in(lines[at], separator) if _is_comment(lines[at]) else tuple(above[at])
        if not any(cells):
            continue
        is_wide = width / 2 <= len(_stripped(cells)) <= width <= len(cells) + 1
        if is_wide and not units and _is_units(cells) and at:
            units = cells
        elif is_wide and _is_names(cells):
            return at, units
        elif units:
            break
    if units:  # names such as "s" alone
        return next(at for at in range(len(above) - 1, -1, -1) if tuple(above[at]) == units), ()
    return None, ()


def _names_in(line: str, separator: str) -> tuple[str, ...]:
    """The cells of a row of names, which may be a comment."""
    return cells_of(line.lstrip().lstrip("#%/").lstrip() if _is_comment(line) else line, separator)


def _stripped(cells: Sequence[str]) -> Sequence[str]:
    """Cells without empty ones at the end."""
    width = len(cells)
    while width and not cells[width - 1]:
        width -= 1
    return cells[:width]


def _is_names(cells: Sequence[str]) -> bool:
    """Whether cells are names: no numbers, unless these count the columns from 0 on."""
    if [*cells] == [str(k) for k in range(len(cells))]:
        return len(cells) > 1
    return sum(map(bool, cells)) > 1 and not any(_kind(cell) == "number" for cell in cells if cell)


def _is_units(cells: Sequence[str]) -> bool:
    words = [cell.strip(" []()").casefold() for cell in cells]
    return any(words) and all(word in UNIT_WORDS or not word for word in words)


def _require_no_other_names(
    source_file: SourceFile,
    above: Sequence[Sequence[str]],
    lines: Sequence[str],
    first: int,
    width: int,
) -> None:
    """Refuse rows of data right below names that are fewer or more than their cells."""
    at = first - 1
    if at < 0 or _is_comment(lines[at]):
        return
    cells = _stripped(above[at])
    if len(cells) > 1 and _is_names(cells):
        raise _other_names(source_file, len(cells), width, at)


def _other_names(source_file: SourceFile, named: int, width: int, at: int) -> RecordingError:
    fault = f"the row names {named} columns and the rows below have {width} cells"
    cure = "name each column once"
    if width == 2 * named:
        cure = 'if commas stand before fractions, separate cells by ";"'
    return source_file.refusal(fault, cure, f"row {at + 1}")


def _distinct(cells: Sequence[str], width: int) -> tuple[str, ...]:
    """Names of ``width`` columns, all different."""
    padded = [*cells, *[""] * width][:width]
    names = []
    for k, name in enumerate(padded, 1):
        again = padded.count(name) > 1
        names.append(f"{name} (column {k})" if name and again else name or f"column {k}")
    return tuple(names)


def _decimal(rows: Sequence[Sequence[str]], separator: str) -> str:
    """Sign before fractions; a column may begin with whole numbers, so all rows at hand count."""
    cells = {cell for row in rows for cell in row}
    if not any("," in cell for cell in cells):
        return "."
    points = sum("." in cell and _kind(cell) == "number" for cell in cells)
    commas = sum("," in cell and _kind(cell) == "number" for cell in cells)
    return "," if commas > points else "."


def _skipped(source_file: SourceFile, data: int, header: str | None) -> tuple[int, ...]:
    """Numbers of the rows after the first of data that are comments, or repeat the names.

    Blank ones are left out, too, where every line end is doubled; a single one is a fault.
    """
    text, names = source_file.text, (header or "").strip()
    comments = any(b"\n" + mark.encode() in text for mark in COMMENTS)
    repeated = bool(names) and text.count(names.encode(source_file.encoding, "replace")) > 1
    start = text[:HEADER_BYTES]
    blank = sum(map(start.count, _DOUBLED)) > DOUBLED * start.count(b"\n")
    if not comments and not repeated and not blank:
        return ()
    numbered = islice(enumerate(source_file.lines(), 1), data, None)
    return tuple(
        number for number, line in numbered
        if (repeated and line.strip() == names)
        or (comments and _is_comment(line))
        or (blank and not line.strip())
    )  # fmt: skip


def cells_of(line: str, separator: str = ",") -> tuple[str, ...]:
    """The cells of a row, without white space around them."""
    if separator == " ":
        return tuple(line.split())
    try:
        row = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # a cell beyond the largest that is read
        return ()
    return tuple(cell.strip() for cell in row)


def _cells(lines: Sequence[str], separator: str) -> list[tuple[str, ...]]:
    """The cells of rows, as `cells_of` has them."""
    if separator == " " or any('"' in line for line in lines):
        return [cells_of(line, separator) for line in lines]
    return [tuple(cell.strip() for cell in line.split(separator)) for line in lines]


class ModesUnknown(Finding, frozen=True):
    """Cells of a column say neither that ACC nor that a driver is in control."""

    text = '{column} holds neither {words} in {samples} samples (as "{example}").'

    column: str
    words: str
    samples: int
    example: str


@dataclass(frozen=True, eq=False)
class Columns:
    """Some columns of N rows of a table."""

    source_file: SourceFile
    layout: Layout
    rows: NDArray[np.int64]
    """(N,) which rows of the table they are, 0 = first."""
    numbers: dict[str, FloatArray]
    """(N,) numbers by column; nan where a cell is empty."""
    words: dict[str, list[str]]
    """N texts by column, without white space around them; "" where a cell is empty."""

    def __len__(self) -> int:
        """The number of rows, N."""
        return len(self.rows)

    @cached_property
    def nbytes(self) -> int:
        """Memory that the rows take, in bytes, each different text counted once."""
        texts = (text for column in self.words.values() for text in {*column})
        lists = sum(map(getsizeof, self.words.values())) + sum(map(getsizeof, texts))
        return self.rows.nbytes + sum(v.nbytes for v in self.numbers.values()) + lists

    def __getitem__(self, part: slice | NDArray[np.int64]) -> "Columns":
        """Some of the rows."""
        numbers = {name: values[part] for name, values in self.numbers.items()}
        at = range(len(self))[part] if isinstance(part, slice) else part
        words = {name: [texts[row] for row in at] for name, texts in self.words.items()}
        return Columns(self.source_file, self.layout, self.rows[part], numbers, words)

    def refusal(self, fault: str, cure: str, column: str, row: int | None = None) -> RecordingError:
        """The error about a column, or about its cell in one of the rows."""
        at = None if row is None else int(self.rows[row])
        return self.source_file.refusal(fault, cure, _place(self.layout, at, column))

    def modes(
        self, column: str, acc: Sequence[str], human: Sequence[str], findings: list[Finding]
    ) -> NDArray[np.int8]:
        """(N,) values of `Mode` by the words for each, in any case and as 1 or 1.0.

        Where a cell holds neither the mode is unknown, and a finding says so.
        """
        known = dict.fromkeys(map(_spelled, acc), Mode.ACC)
        known |= dict.fromkeys(map(_spelled, human), Mode.HUMAN)
        words = Counter(self.words[column])
        meanings = {word: known.get(_spelled(word), Mode.UNKNOWN) for word in words}
        strange = sorted(word for word, mode in meanings.items() if word and mode is Mode.UNKNOWN)
        if strange:
            samples, example = sum(words[word] for word in strange), excerpt(strange[0])
            both = " nor ".join(excerpt(word) for word in (*acc, *human))
            name = excerpt(column, LONGEST_NAME)
            findings.append(ModesUnknown(column=name, words=both, samples=samples, example=example))
        return np.array([meanings[word] for word in self.words[column]], dtype=np.int8)

    def require_some(self, column: str, cure: str) -> None:
        """Refuse a column whose cells are all empty."""
        if np.isnan(self.numbers[column]).all():
            raise self.refusal("all cells are empty", cure, column)

    def measured(
        self, quantity: Quantity, column: str, factor: float = 1.0, less: float = 0.0
    ) -> FloatArray:
        """Numbers of a size that measurements have, in the quantity's unit; missing ones are nan.

        Args:
            quantity: what they are.
            column: where they stand.
            factor: the column's unit in that of the quantity.
            less: what to subtract from each, in the quantity's unit.

        Raises:
            RecordingError: about the first that cannot be a measurement.
        """
        return self.sized(quantity, np.asarray(self.numbers[column] * factor - less), column)

    def sized(
        self, quantity: Quantity, values: FloatArray, column: str, row: int | None = None
    ) -> FloatArray:
        """The values (N,) of a column, all of a size that measurements have.

        Raises:
            RecordingError: about the first that has not; its row is ``row`` where that is given.
        """
        wrong = np.flatnonzero(np.abs(values) > quantity.possible)
        if len(wrong):
            first = int(wrong[0])
            fault = (
                f"{values[first]:g} cannot be a measurement, as at most"
                f" {quantity.possible:,.0f} {quantity.unit} is possible"
            )
            cure = "correct it, name its unit, or leave the cell empty"
            raise self.refusal(fault, cure, column, first if row is None else row)
        return values

    def time(self, column: str, stamps: FloatArray | None = None) -> FloatArray:
        """The time from the first row on, in s, increasing.

        Args:
            column: where it stands.
            stamps: (N,) in s; by default the column's numbers.

        Raises:
            RecordingError: about the first row that is wrong.
        """
        stamps = self.numbers[column] if stamps is None else stamps
        missing = np.flatnonzero(np.isnan(stamps))
        if len(missing):
            cure = "fill it in or delete the row"
            raise self.refusal("the time is missing", cure, column, int(missing[0]))
        if len(stamps) < 2:
            raise self.refusal("the trajectory has one row", "choose another trajectory", column, 0)
        # From the first sample on, so that a large origin costs no digits.
        time: FloatArray = stamps - stamps[0]
        steps = np.diff(time)
        backward = np.flatnonzero(steps <= 0)
        if len(backward):
            row = int(backward[0]) + 1
            late, early = (f"{stamps[k]:.10g} s" for k in (row, row - 1))
            fault = f"the time does not increase, {late} follows {early}"
            cure = "sort or delete the rows"
            if steps[row - 1] == 0 and (steps == 0).mean() > 0.3:
                fault = f"{(steps == 0).mean():.0%} of the rows have the time of the row before"
                cure = (
                    "name the column that tells vehicles or runs apart, or give time with fractions"
                )
            raise self.refusal(fault, cure, column, row)
        typical = float(np.median(steps))
        if not SHORTEST_STEP <= typical <= LONGEST_STEP:
            fault = f"the rows are {typical:g} s apart where 0.1 s is usual"
            raise self.refusal(fault, "give the time in seconds, or name its unit", column)
        return np.asarray(time)


def read_columns(
    source_file: SourceFile, layout: Layout, numbers: Sequence[str], words: Sequence[str] = ()
) -> Columns:
    """Read some columns of numbers and some of texts from a table, by name.

    Raises:
        RecordingError: which cell, row or column is wrong.
    """
    for name in set(numbers).intersection(words):
        fault = f'column "{excerpt(name, LONGEST_NAME)}" is asked for as numbers and as words'
        raise source_file.refusal(fault, "choose another column for one of them")
    positions = {name: _position(source_file, layout, name) for name in (*numbers, *words)}
    parts: dict[str, list[FloatArray]] = {name: [] for name in numbers}
    texts: dict[str, list[str]] = {name: [] for name in words}
    spelled: dict[str, dict[str, str]] = {name: {} for name in words}  # each text is held once
    for first, rows in _blocks(source_file, layout):
        cells = [*zip(*rows, strict=True)]  # by column
        values = {name: _numbers(cells[positions[name]], layout) for name in parts}
        if any(isinstance(column, int) for column in values.values()):
            raise _not_a_number(source_file, layout, first, rows, positions, values)
        for name in parts:
            block = np.array(values[name])
            block[np.isinf(block)] = np.nan  # "inf" is a word for a missing value
            parts[name].append(block)
        for name, column in texts.items():
            different = {*cells[positions[name]]}
            if len(different) > len(rows) / 2:  # as instants
                column.extend(_words(cells[positions[name]]))
                continue
            meanings = spelled[name]
            for word in different:
                if word not in meanings:
                    meanings[word] = _word(word)
            column.extend(map(meanings.__getitem__, cells[positions[name]]))
    columns = {name: np.concatenate(blocks) for name, blocks in parts.items()}
    return Columns(source_file, layout, np.arange(first + len(rows)), columns, texts)


def first_cells(source_file: SourceFile, layout: Layout, rows: int) -> list[list[str]]:
    """The first cells of each column, without white space; "" where a value is missing.

    Rows of another width than the names are passed over here; reading the columns refuses them.
    """
    reader = csv.reader(
        _data_lines(source_file, layout), delimiter=layout.separator, skipinitialspace=True
    )
    width = len(layout.names)
    try:
        kept = [row for row in islice(reader, rows) if len(row) == width]
    except csv.Error:
        raise _unreadable(source_file, layout) from None
    columns = zip(*kept, strict=True) if kept else ((),) * width
    return [_words(column) for column in columns]


def numbers_of(cells: Sequence[str], decimal: str) -> FloatArray | None:
    """The numbers (N,) in cells, nan where there is none; None where a tenth are other words."""
    if decimal == "." and (plain := _plain_numbers(cells)) is not None:
        return plain
    values = [_number(cell, decimal) for cell in cells]
    filled = [value for cell, value in zip(cells, values, strict=True) if cell]
    if not filled or sum(value is None for value in filled) > len(filled) / 10:
        return None
    numbers: FloatArray = np.array(values, np.float64)  # None becomes nan
    return numbers


def _position(source_file: SourceFile, layout: Layout, column: str) -> int:
    """Position of a column, 0 = leftmost; one that is missing or there twice is refused."""
    if layout.names.count(column) == 1:
        return layout.names.index(column)
    shown, place = excerpt(column, LONGEST_NAME), f"row {layout.header_row or layout.data_row}"
    alike = [name for name in layout.names if name.startswith(f"{column} (column ")]
    places = [str(k) for k, name in enumerate(layout.names, 1) if name == column or name in alike]
    if len(places) > 1:
        fault, cure = f'"{shown}" names columns {joined(places)}', "rename all but one"
        if alike:
            cure = f"choose {joined([excerpt(name, LONGEST_NAME) for name in alike], 'or')}"
        raise source_file.refusal(fault, cure, place)
    listed = excerpt(", ".join(filter(None, layout.names)), 150)
    raise source_file.refusal(f'there is no column "{shown}"', f"choose among {listed}", place)


def _place(layout: Layout, row: int | None = None, column: str | None = None) -> str:
    """A place in the file; rows of data are counted from 0."""
    parts = [] if row is None else [f"row {layout.row_number(row)}"]
    parts += [] if column is None else [f"column {excerpt(column, LONGEST_NAME)}"]
    return ", ".join(parts)


def _blocks(source_file: SourceFile, layout: Layout) -> Iterator[tuple[int, list[list[str]]]]:
    """The rows of data, all as wide as the column names, with the number of the first."""
    lines = _data_lines(source_file, layout)
    reader = csv.reader(lines, delimiter=layout.separator, skipinitialspace=True)
    first, width = 0, len(layout.names)
    while True:
        try:
            rows = list(islice(reader, max(MINIMUM_SAMPLES, _BLOCK // width)))
        except csv.Error:
            raise _unreadable(source_file, layout) from None
        if reader.line_num != first + len(rows):  # a row goes on behind a line end
            raise _unreadable(source_file, layout)
        if first + len(rows) < MINIMUM_SAMPLES:
            many = f"{len(rows)} row{'s' * (len(rows) != 1)}"
            fault = f"only {many} of numbers are there"
            cure = f"download it again, as a recording has at least {MINIMUM_SAMPLES}"
            raise source_file.refusal(fault, cure)
        if {*map(len, rows)} - {width}:
            raise _ragged(source_file, layout, first, rows, is_last=next(lines, None) is None)
        if not rows:
            return
        yield first, rows
        first += len(rows)


def _data_lines(source_file: SourceFile, layout: Layout) -> Iterator[str]:
    """The lines that are rows of data."""
    lines: Iterator[str] = islice(source_file.lines(), layout.data_row - 1, None)
    if layout.skipped:
        passed = {number - layout.data_row for number in layout.skipped}
        lines = (line for at, line in enumerate(lines) if at not in passed)
    if layout.separator == " ":  # one space between cells, as a row may end with several
        lines = (" ".join(line.split()) + "\n" for line in lines)
    return lines


def _ragged(
    source_file: SourceFile, layout: Layout, first: int, rows: list[list[str]], is_last: bool
) -> RecordingError:
    """The sentence about the first row of another width than the column names."""
    expected = len(layout.names)
    number, row = next((k, row) for k, row in enumerate(rows) if len(row) != expected)
    place = _place(layout, first + number)
    at_end = is_last and number == len(rows) - 1 and not source_file.is_complete
    if at_end and len(row) < expected:
        fault = f"the file is cut short, its last row has {len(row)} of {expected} cells"
        return source_file.refusal(fault, "download it again, or delete that row", place)
    width = f"has {len(row)} cells" if any(map(str.strip, row)) or len(row) > 1 else "is empty"
    fault = f"the row {width} where the column names ask for {expected} cells"
    cure = "correct or delete it, or download the file again"
    return source_file.refusal(fault, cure, place)


def _unreadable(source_file: SourceFile, layout: Layout) -> RecordingError:
    """Why rows and line ends differ: almost always for one quotation mark too many."""
    for row, line in enumerate(islice(source_file.lines(), layout.data_row - 1, None)):
        if line.count('"') % 2:
            fault = "a quotation mark is opened and not closed"
            return source_file.refusal(fault, "delete it", _place(layout, row))
    cure = "download the file again, or re-save it"
    return source_file.refusal("the rows cannot be read as numbers", cure)


def _numbers(cells: Sequence[str], layout: Layout) -> list[float] | int:
    """The numbers of a column, or which of its cells is the first that is none."""
    if layout.decimal == "." and "_" not in "".join(cells):  # float would take 1_0 for 10
        try:
            if "" not in cells:
                return [*map(float, cells)]
            return [float(cell) if cell else np.nan for cell in cells]
        except ValueError:
            pass
    values = []
    for k, cell in enumerate(cells):
        value = _number(cell.strip(), layout.decimal)
        if value is None:
            return k
        values.append(value)
    return values


def _number(cell: str, decimal: str) -> float | None:
    """The number in a cell, nan where it is empty, None where it is anything else."""
    if cell.casefold() in MISSING:
        return np.nan
    if "_" in cell or (decimal != "." and "." in cell):
        return None
    try:
        return float(cell.replace(decimal, "."))
    except ValueError:
        return None


def _word(cell: str) -> str:
    word = cell.strip()
    return "" if len(word) <= _LONGEST_MISSING and word.casefold() in MISSING else word


def _words(cells: Sequence[str]) -> list[str]:
    """The cells without white space, "" where a value is missing."""
    if _plain_numbers(cells) is not None:
        return [cell.strip() for cell in cells]
    return [_word(cell) for cell in cells]


def _plain_numbers(cells: Sequence[str]) -> FloatArray | None:
    """The numbers (N,) in cells, all of which are finite ones with a point; None otherwise."""
    try:
        values = np.array([*map(float, cells)], np.float64)
    except ValueError:
        return None
    is_plain = len(values) > 0 and bool(np.isfinite(values).all()) and "_" not in "".join(cells)
    return values if is_plain else None


def _not_a_number(
    source_file: SourceFile,
    layout: Layout,
    first: int,
    rows: list[list[str]],
    positions: dict[str, int],
    values: dict[str, list[float] | int],
) -> RecordingError:
    """The sentence about the first cell, row by row, that is not a number."""
    wrong = [(at, positions[name], name) for name, at in values.items() if isinstance(at, int)]
    row, position, name = min(wrong)
    fault = f'"{excerpt(rows[row][position])}" is not a number'
    cure = "correct it, or leave the cell empty"
    return source_file.refusal(fault, cure, _place(layout, first + row, name))


@dataclass(frozen=True, eq=False)
class TableRun:
    """A run of those that a table holds."""

    trajectories: tuple[str, ...]
    """The names that choose it; none where the table holds one run without a name."""
    vehicles: int
    columns: Columns
    """Rows of the table, from which it is made; all runs of a table may have the same."""
    read: Callable[[], Recording]
    """Makes the recording; raises a RecordingError about the first row that is wrong."""


def choose_run(
    source_file: SourceFile, runs: Sequence[TableRun], trajectory: str | None, kind: str
) -> TableRun:
    """The run that has a trajectory, or the only one; ``kind`` names runs in sentences.

    Raises:
        RecordingError: for a name that is not there, or where a choice has to be made.
    """
    if trajectory is None and len(runs) == 1:
        return runs[0]
    for run in runs:
        if trajectory is not None and trajectory.strip() in run.trajectories:
            return run
    if trajectory is not None and not runs[0].trajectories:
        fault = "the mapping names no column that tells trajectories apart"
        raise source_file.refusal(fault, "name it in the mapping, or choose no trajectory")
    fault = f"the table holds {len(runs)} {kind}"
    if trajectory is not None:
        fault = f'there is no trajectory "{excerpt(trajectory)}"'
    names = [excerpt(run.trajectories[0]) for run in runs]
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    listed = ", ".join(names[:LISTED])
    raise source_file.refusal(fault, f"choose a trajectory (--trajectory): {listed}{more}")


def _spelled(word: str) -> str:
    """A word for a mode, however it is written."""
    try:
        return f"{float(word):g}"
    except ValueError:
        return word.casefold()
