"""The columns of a table by name, as numbers and as words, and the runs that it holds.

Cells are split by Python's `csv` and numbers read by `float`, which rounds correctly. A cell that
is neither missing nor a number is refused with its place, and so is a row of another width.
"""

import csv
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
from accpinn.recordings.table_layout import Layout
from accpinn.units import FloatArray

LONGEST_NAME = 60
"""Characters of a column's name in a sentence."""
MINIMUM_SAMPLES = 10
"""Least number of rows of a recording."""
MOST_RUNS = 10_000
"""Most runs of a table; a column with more different names does not identify runs."""
LISTED = 12
"""Runs that a sentence names."""
_LONGEST_MISSING = max(map(len, MISSING))
_BLOCK = 5_000
"""Cells that are split at a time; larger blocks fit no processor's cache."""


class ModesUnknown(Finding, frozen=True):
    """Cells of a column hold neither a word for ACC nor one for a driver."""

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

        The mode is unknown where a cell holds neither, which is reported as a finding.
        """
        by_word = dict.fromkeys(map(_spelled, acc), Mode.ACC)
        by_word |= dict.fromkeys(map(_spelled, human), Mode.HUMAN)
        words = Counter(self.words[column])
        meanings = {word: by_word.get(_spelled(word), Mode.UNKNOWN) for word in words}
        strange = sorted(word for word, mode in meanings.items() if word and mode is Mode.UNKNOWN)
        if strange:
            samples, example = sum(words[word] for word in strange), excerpt(strange[0])
            choices = " nor ".join(excerpt(word) for word in (*acc, *human))
            name = excerpt(column, LONGEST_NAME)
            findings.append(
                ModesUnknown(column=name, words=choices, samples=samples, example=example)
            )
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
            quantity: the quantity measured.
            column: the column with the numbers.
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
        wrong = [(at, positions[name], name) for name, at in values.items() if isinstance(at, int)]
        if wrong:  # told of the first one, row by row
            row, position, name = min(wrong)
            fault = f'"{excerpt(rows[row][position])}" is not a number'
            cure = "correct it, or leave the cell empty"
            raise source_file.refusal(fault, cure, _place(layout, first + row, name))
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
        complete = [row for row in islice(reader, rows) if len(row) == width]
    except csv.Error:
        raise _unreadable(source_file, layout) from None
    columns = zip(*complete, strict=True) if complete else ((),) * width
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
    """The error about the first row that is not as wide as the column names."""
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
    """The error of a row that spans lines, almost always by a quotation mark too many."""
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
