"""The rows of numbers: read at the speed of pandas' C parser, diagnosed cell by cell on failure."""

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accpinn.channels import DRIVER, GAP, MODE_NAMES, SPEED, TIME
from accpinn.errors import RecordingError
from accpinn.recordings.header import Header
from accpinn.recordings.recording import Mode
from accpinn.recordings.source import SourceFile, excerpt, refusal
from accpinn.units import FloatArray, Metres, MetresPerSecond, Seconds

MINIMUM_SAMPLES = 10
"""Fewer rows are no recording."""
LARGEST_TIME: Seconds = 1e12
LARGEST_SPEED: MetresPerSecond = 200.0
LARGEST_GAP: Metres = 10_000.0
"""Of either sign; beyond it a number is a fault, while `checks` only warns of implausible ones."""
SHORTEST_STEP: Seconds = 1e-3
LONGEST_STEP: Seconds = 5.0
"""Rows closer or further apart suggest that the time is not in seconds."""
GAP_STEPS = 10
"""A time step longer than this many typical ones is a hole in the recording."""

_MISSING = ["", "NaN", "nan", "NA", "N/A", "null"]


@dataclass(frozen=True, eq=False)
class Body:
    """The needed columns, by vehicle number; N samples."""

    time: FloatArray
    """(N,) in s, as in the file."""
    speed: dict[int, FloatArray]
    gap: dict[int, FloatArray]
    mode: dict[int, NDArray[np.int8]]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class _Table:
    """The text below the header, and what is known of it."""

    name: str
    text: bytes
    header: Header

    def read(self, positions: list[int], **options: Any) -> pd.DataFrame:
        """Some columns as a frame, labelled by position."""
        frame: pd.DataFrame = pd.read_csv(
            io.BytesIO(self.text),
            header=None,
            usecols=positions,
            encoding="latin-1",
            engine="c",
            keep_default_na=False,
            na_values=_MISSING,
            skip_blank_lines=False,
            skipinitialspace=True,
            low_memory=False,
            **options,
        )
        return frame

    def column(self, position: int) -> str:
        """The name of a column."""
        return self.header.columns.names[position]

    def refusal(self, fault: str, cure: str, row: int, column: str = "") -> RecordingError:
        """The sentence about a cell; ``row`` counts samples from 0."""
        place = f"row {self.header.rows + row + 1}" + (f", column {column}" if column else "")
        return refusal(self.name, fault, cure, place)


def read_body(source_file: SourceFile, header: Header) -> Body:
    """The samples, or the sentence which cell is wrong."""
    text = source_file.text[header.size :]
    table = _Table(source_file.name, text.rstrip(), header)
    is_complete = text.endswith((b"\n", b"\r"))
    rows = _count_rows(table, is_complete)
    frame = _parse(table)
    if len(frame) != rows:
        raise _unreadable(table)
    columns = header.columns
    _require_numbers(table, frame)
    _require_time(table, frame[columns.time].to_numpy())
    warnings: list[str] = []
    if not is_complete and columns.count - 1 not in columns.driver.values():
        warnings.append(
            "The last row lacks its line end; if the file was cut short, its last number is wrong."
        )
    return Body(
        time=frame[columns.time].to_numpy(),
        speed={number: frame[at].to_numpy() for number, at in columns.speed.items()},
        gap={number: frame[at].to_numpy() for number, at in columns.gap.items()},
        mode={
            number: _modes(DRIVER.of(number), frame[at], warnings)
            for number, at in columns.driver.items()
        },
        warnings=tuple(warnings),
    )


def _count_rows(table: _Table, is_complete: bool) -> int:
    """How many rows there are, all of the header's width."""
    lines = table.text.splitlines()
    if len(lines) < MINIMUM_SAMPLES:
        fault = f"only {len(lines)} rows of numbers follow the column names"
        cure = f"a recording needs at least {MINIMUM_SAMPLES}, download it again"
        raise refusal(table.name, fault, cure)
    expected = table.header.columns.count
    ragged = next((i for i, line in enumerate(lines) if line.count(b",") != expected - 1), None)
    if ragged is None:
        return len(lines)
    cells = lines[ragged].count(b",") + 1
    if ragged == len(lines) - 1 and not is_complete and cells < expected:
        fault = f"the file is cut short, its last row has {cells} of {expected} cells"
        raise table.refusal(fault, "download it again, or delete that row", ragged)
    found = f"has {cells} cells" if lines[ragged].strip() else "is empty"
    fault = f"the row {found} where the column names ask for {expected} cells"
    raise table.refusal(fault, "correct or delete it, or download the file again", ragged)


def _parse(table: _Table) -> pd.DataFrame:
    columns = table.header.columns
    numbers, words = columns.numbers, list(columns.driver.values())
    dtypes = dict.fromkeys(numbers, "float64") | dict.fromkeys(words, "category")
    try:
        return table.read(numbers + words, dtype=dtypes)
    except ValueError as error:
        if "Calling read" in str(error):  # memory always reads: pandas has hidden a Ctrl+C
            raise KeyboardInterrupt from None
        raise _diagnose(table, numbers) from error


def _diagnose(table: _Table, numbers: list[int]) -> RecordingError:
    """Why the numbers could not be parsed: the first cell that is none."""
    try:
        cells = table.read(numbers, dtype="str")
    except ValueError:
        return _unreadable(table)
    wrong = cells.notna() & cells.apply(pd.to_numeric, errors="coerce").isna()
    if not wrong.to_numpy().any():
        return _unreadable(table)
    row = int(wrong.any(axis=1).to_numpy().argmax())
    position = next(at for at in numbers if wrong.at[row, at])
    cell = str(cells.at[row, position]).encode("latin-1").decode("utf-8", "replace")
    fault = f'"{excerpt(cell)}" is not a number'
    cure = "correct it, or leave the cell empty"
    return table.refusal(fault, cure, row, table.column(position))


def _unreadable(table: _Table) -> RecordingError:
    """For rows that are no rows to the parser: almost always a quotation mark too many."""
    lines = table.text.splitlines()
    quoted = next((i for i, line in enumerate(lines) if line.count(b'"') % 2), None)
    if quoted is None:
        cure = "download the file again, or re-save it"
        return refusal(table.name, "the rows cannot be read as numbers", cure)
    fault = "a quotation mark is opened and not closed"
    return table.refusal(fault, "delete it", quoted)


def _require_numbers(table: _Table, frame: pd.DataFrame) -> None:
    """All numbers finite and of a size that measurements have; missing ones are fine."""
    columns = table.header.columns
    for channel, largest, positions in (
        (TIME, LARGEST_TIME, [columns.time]),
        (SPEED, LARGEST_SPEED, columns.speed.values()),
        (GAP, LARGEST_GAP, columns.gap.values()),
    ):
        for position in positions:
            values = frame[position].to_numpy()
            wrong = np.flatnonzero(np.abs(values) > largest)
            if len(wrong):
                row = int(wrong[0])
                fault = (
                    f"{values[row]:g} cannot be a measurement, as at most {largest:,.0f}"
                    f" {channel.unit} is possible"
                )
                cure = f"correct it, give it in {channel.unit}, or leave the cell empty"
                raise table.refusal(fault, cure, row, table.column(position))


def _require_time(table: _Table, time: FloatArray) -> None:
    """Time given everywhere, increasing, without holes."""
    missing = np.flatnonzero(np.isnan(time))
    if len(missing):
        raise table.refusal(
            "the time is missing", "fill it in or delete the row", int(missing[0]), TIME.column
        )
    steps = np.diff(time)
    backward = np.flatnonzero(steps <= 0)
    if len(backward):
        row = int(backward[0]) + 1
        fault = f"the time does not increase, {time[row]:.10g} s follows {time[row - 1]:.10g} s"
        raise table.refusal(fault, "sort or delete the rows", row, TIME.column)
    typical = float(np.median(steps))
    if not SHORTEST_STEP <= typical <= LONGEST_STEP:
        fault = f"the rows are {typical:g} s apart where 0.1 s is usual"
        raise refusal(table.name, fault, "give the time in seconds", f"column {TIME.column}")
    holes = np.flatnonzero(steps > GAP_STEPS * typical)
    if len(holes):
        row = int(holes[0]) + 1
        fault = f"the recording pauses for {steps[row - 1]:.1f} s before this row"
        raise table.refusal(fault, "split the file here into two recordings", row, TIME.column)


def _modes(column: str, words: pd.Series, warnings: list[str]) -> NDArray[np.int8]:
    """(N,) values of `Mode`; what is neither ACC nor Human is unknown, and said."""
    known = {name.lower(): Mode[name.upper()] for name in MODE_NAMES}
    meanings = [known.get(str(word).strip().lower(), Mode.UNKNOWN) for word in words.cat.categories]
    codes = words.cat.codes.to_numpy()
    modes = np.array([*meanings, Mode.UNKNOWN], dtype=np.int8)[codes]
    strange = int(((modes == Mode.UNKNOWN) & (codes >= 0)).sum())
    if strange:
        odd = next(
            str(word)
            for word, meaning in zip(words.cat.categories, meanings, strict=True)
            if meaning is Mode.UNKNOWN
        )
        warnings.append(
            f'{column} holds neither ACC nor Human in {strange} samples (as "{excerpt(odd)}").'
        )
    return modes
