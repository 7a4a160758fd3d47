"""Layout of a table: separator, decimal mark, and the rows of names, units and data.

A table is rows of cells, one below the other, all as wide as its data. Above them may stand
metadata, a row of column names and a row of units; comments and repeated column names between the
data are left out. Where no row of names is found the columns are called "column 1", "column 2", ..
"""

import csv
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from accpinn.errors import RecordingError
from accpinn.recordings.clocks import MISSING
from accpinn.recordings.source import SourceFile, excerpt

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
UNIT_WORDS = frozenset((
    "s", "sec", "secs", "second", "seconds", "ms", "us", "µs", "ns", "min", "h", "hh:mm:ss",
    "m", "ft", "feet", "cm", "mm", "km", "m/s", "mps", "km/h", "kmh", "kph", "kmph", "mph", "mi/h",
    "ft/s", "fps", "kn", "kt", "knots", "m/s2", "m/s^2", "m/s²", "g", "deg", "°", "rad", "1", "-",
    "%", "rpm", "bool", "iso 8601", "utc", "datetime", "id", "n/a",
))  # fmt: skip
"""Words of a row of units, in small letters and without brackets."""
COMMENTS = ("#", "%", "//")
"""Beginnings of a comment, which may be the row of column names."""
DOUBLED = 0.4
"""Least share of blank rows where a program has doubled all line ends."""
_DOUBLED = (b"\n\n", b"\n\r\n", b"\r\r\n")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_INSTANT = re.compile(r"[\dT:.,/+\-Z ]*\d[:/\-.]\d[\dT:.,/+\-Z ]*( ?[AaPp][Mm])?")


@dataclass(frozen=True)
class Layout:
    """Layout of a table, and its first rows."""

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
    """Find how a table is written.

    Raises:
        RecordingError: where no rows of data are found, or their names are more or fewer.
    """
    lines = list(source_file.lines(HEADER_BYTES))
    if len(source_file.text) > HEADER_BYTES:
        lines = lines[:-1]  # cut off anywhere
    beginning = lines[: HEADER_ROWS + 2 * ALIKE]
    beginnings = [(separator, _first_data(beginning, separator)) for separator in SEPARATORS]
    candidates = [(separator, at) for separator, at in beginnings if at is not None]
    if not candidates:
        fault = "no rows of numbers below each other are found"
        raise source_file.refusal(fault, "choose a table with a column for each quantity")
    separator, (first, width, _) = max(candidates, key=lambda candidate: candidate[1][2])
    return _layout(source_file, lines, separator, first, width)


def _first_data(lines: Sequence[str], separator: str) -> tuple[int, int, float] | None:
    """Find where rows of equal kinds begin if ``separator`` stands between cells.

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
    """Kind of a cell: "number", "instant" (of a day), "word", or "" where a value is missing."""
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
    if header is None and first and not _is_comment(lines[first - 1]):
        cells = _stripped(above[first - 1])
        if len(cells) > 1 and _is_names(cells):
            raise _other_names(source_file, len(cells), width, first - 1)
    named = () if header is None else _names_in(lines[header], separator)
    below = lines[data:]
    full = [row for row in below if row.strip() and not _is_comment(row)]
    if separator == " " or any('"' in line for line in full):
        rows = [cells_of(line, separator) for line in full]
    else:  # faster
        rows = [tuple(cell.strip() for cell in line.split(separator)) for line in full]
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
        words = [cell.strip(" []()").casefold() for cell in cells]
        is_units = any(words) and all(word in UNIT_WORDS or not word for word in words)
        if is_wide and not units and is_units and at:
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
