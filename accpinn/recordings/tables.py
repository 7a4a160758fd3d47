"""The one reader of tables: their layout, and their columns by name.

Cells are split by Python's `csv` and numbers read by `float`, which rounds correctly. A cell that
is neither empty nor a number is refused with its place, and so is a row of another width.
"""

import csv
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import Quantity
from accpinn.errors import RecordingError
from accpinn.findings import Finding, joined
from accpinn.recordings import Mode, Recording
from accpinn.recordings.source import SourceFile, excerpt
from accpinn.units import FloatArray, Seconds

SEPARATORS = (",", ";", "\t", "|")
HEADER_ROWS = 50
"""Number of rows among which the column names are looked for."""
HEADER_BYTES = 100_000
"""Beginning of a file in which the column names stand."""
PREVIEWED = 5
"""Rows of a preview."""
LONGEST_NAME = 60
"""Characters of a column's name in a sentence."""
MINIMUM_SAMPLES = 10
"""Least number of rows of a recording."""
SHORTEST_STEP: Seconds = 1e-3
LONGEST_STEP: Seconds = 5.0
"""Shortest and longest step of a recording; others suggest that the time is not in seconds."""
GAP_STEPS = 10
"""Longest step without a hole in the recording, in typical steps."""
LISTED = 12
"""Runs that a sentence names."""
MISSING = frozenset(("", "NaN", "nan", "NA", "N/A", "null"))
"""Words of a cell that holds no value."""
_BLOCK = 5_000
"""Cells that are split at a time; larger blocks fit no processor's cache."""


@dataclass(frozen=True)
class Layout:
    """The way in which a table is written, and its first rows."""

    names: tuple[str, ...]
    """Names of all columns, in their order; empty where a column has none."""
    rows: tuple[tuple[str, ...], ...]
    """The first rows of cells, as they are written."""
    separator: str
    decimal: str
    """Sign before the fraction of a number: a point or a comma."""
    header_row: int
    """Number of the row with the column names, 1 = first."""


def layout_of(source_file: SourceFile) -> Layout:
    """The layout of a table.

    Raises:
        RecordingError: where no row of column names is found.
    """
    lines = list(source_file.lines(HEADER_BYTES))
    for number, line in enumerate(lines[:HEADER_ROWS]):
        for separator in sorted(SEPARATORS, key=line.count, reverse=True):
            names = cells_of(line, separator)
            if len(names) < 2 or not any(names) or any(map(_is_number, names)):
                continue
            below = [row for row in lines[number + 1 :] if row.strip()]
            if below and len(cells_of(below[0], separator)) == len(names):
                return _layout(names, below, separator, number + 1)
    fault = "no row of column names above rows of numbers is found"
    raise source_file.refusal(fault, "give each column a name in the first row")


def _layout(names: tuple[str, ...], rows: Sequence[str], separator: str, header_row: int) -> Layout:
    decimal = "."
    if separator != ",":  # a column may begin with whole numbers
        cells = {cell for row in rows for cell in cells_of(row, separator)}
        points = sum("." in cell and _is_number(cell) for cell in cells)
        commas = sum("," in cell and _is_number(cell.replace(",", ".")) for cell in cells)
        decimal = "," if commas > points else "."
    shown = [map(excerpt, cells_of(row, separator)) for row in rows[:PREVIEWED]]
    return Layout(names, tuple(map(tuple, shown)), separator, decimal, header_row)


def cells_of(line: str, separator: str = ",") -> tuple[str, ...]:
    """The cells of a row, without white space around them."""
    return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=separator), []))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


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
    """(N,) which rows of the table they are, 0 = first below the column names."""
    numbers: dict[str, FloatArray]
    """(N,) numbers by column; nan where a cell is empty."""
    words: dict[str, list[str]]
    """N texts by column, without white space around them; "" where a cell is empty."""

    def __len__(self) -> int:
        """The number of rows, N."""
        return len(self.rows)

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
        values = self.numbers[column] * factor - less
        wrong = np.flatnonzero(np.abs(values) > quantity.possible)
        if len(wrong):
            row = int(wrong[0])
            fault = (
                f"{values[row]:g} cannot be a measurement, as at most"
                f" {quantity.possible:,.0f} {quantity.unit} is possible"
            )
            cure = f"correct it, give it in {quantity.unit}, or leave the cell empty"
            raise self.refusal(fault, cure, column, row)
        return values

    def time(self, column: str, unit: Seconds = 1.0) -> FloatArray:
        """The time from the first row on, in s: increasing and without holes.

        Raises:
            RecordingError: about the first row that is wrong.
        """
        refusal = partial(self.refusal, column=column)
        stamps = self.numbers[column]
        missing = np.flatnonzero(np.isnan(stamps))
        if len(missing):
            cure = "fill it in or delete the row"
            raise refusal("the time is missing", cure, row=int(missing[0]))
        if len(stamps) < 2:
            raise refusal("the trajectory has one row", "choose another trajectory", row=0)
        # From the first sample on, so that a large origin costs no digits.
        steps = np.diff((stamps - stamps[0]) * unit)
        backward = np.flatnonzero(steps <= 0)
        if len(backward):
            row = int(backward[0]) + 1
            late, early = (f"{stamps[k] * unit:.10g} s" for k in (row, row - 1))
            fault = f"the time does not increase, {late} follows {early}"
            raise refusal(fault, "sort or delete the rows", row=row)
        typical = float(np.median(steps))
        if not SHORTEST_STEP <= typical <= LONGEST_STEP:
            fault = f"the rows are {typical:g} s apart where 0.1 s is usual"
            raise refusal(fault, "give the time in seconds")
        holes = np.flatnonzero(steps > GAP_STEPS * typical)
        if len(holes):
            row = int(holes[0]) + 1
            fault = f"the recording pauses for {steps[row - 1]:.1f} s before this row"
            raise refusal(fault, "split the file here into two recordings", row=row)
        return np.asarray((stamps - stamps[0]) * unit)


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
    for first, rows in _blocks(source_file, layout):
        cells = [*zip(*rows, strict=True)]  # by column
        values = {name: _numbers(cells[positions[name]], layout) for name in parts}
        if any(isinstance(column, int) for column in values.values()):
            raise _not_a_number(source_file, layout, first, rows, positions, values)
        for name in parts:
            parts[name].append(np.array(values[name]))
        for name, column in texts.items():
            meanings = {word: _word(word) for word in set(cells[positions[name]])}
            column.extend(map(meanings.__getitem__, cells[positions[name]]))
    columns = {name: np.concatenate(blocks) for name, blocks in parts.items()}
    return Columns(source_file, layout, np.arange(first + len(rows)), columns, texts)


def _position(source_file: SourceFile, layout: Layout, column: str) -> int:
    """Position of a column, 0 = leftmost; one that is missing or there twice is refused."""
    places = [str(k) for k, name in enumerate(layout.names, 1) if name == column]
    if len(places) == 1:
        return layout.names.index(column)
    shown = excerpt(column, LONGEST_NAME)
    if places:
        fault = f'"{shown}" names columns {joined(places)}'
        raise source_file.refusal(fault, "rename all but one", f"row {layout.header_row}")
    listed = excerpt(", ".join(filter(None, layout.names)), 200)
    fault = f'there is no column "{shown}"'
    raise source_file.refusal(fault, f"choose among {listed}", f"row {layout.header_row}")


def _place(layout: Layout, row: int | None = None, column: str | None = None) -> str:
    """A place in the file; rows are counted from the first below the column names."""
    parts = [] if row is None else [f"row {layout.header_row + row + 1}"]
    parts += [] if column is None else [f"column {excerpt(column, LONGEST_NAME)}"]
    return ", ".join(parts)


def _blocks(source_file: SourceFile, layout: Layout) -> Iterator[tuple[int, list[list[str]]]]:
    """The rows below the column names, all as wide as these, with the number of the first."""
    lines = islice(source_file.lines(), layout.header_row, None)
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
            fault = f"only {many} of numbers follow the column names"
            cure = f"download it again, as a recording has at least {MINIMUM_SAMPLES}"
            raise source_file.refusal(fault, cure)
        if {*map(len, rows)} - {width}:
            raise _ragged(source_file, layout, first, rows, is_last=next(lines, None) is None)
        if not rows:
            return
        yield first, rows
        first += len(rows)


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
    for row, line in enumerate(islice(source_file.lines(), layout.header_row, None)):
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
    if cell in MISSING:
        return np.nan
    if "_" in cell or (decimal != "." and "." in cell):
        return None
    try:
        return float(cell.replace(decimal, "."))
    except ValueError:
        return None


def _word(cell: str) -> str:
    return "" if cell.strip() in MISSING else cell.strip()


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
