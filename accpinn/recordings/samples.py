"""From a path or an upload to the samples in it; anything else is refused in one sentence.

The rows of numbers are read by NumPy; what it does not take, pandas reads or diagnoses cell by
cell.
"""

import io
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import GAP, MODE_NAMES, SPEED, TIME, Quantity
from accpinn.errors import RecordingError
from accpinn.recordings.recording import LineEndMissing, Mode, ModesUnknown
from accpinn.units import FloatArray, Seconds

if TYPE_CHECKING:
    import pandas as pd  # takes most of a second to import, which few files need

LIMIT_BYTES = 100_000_000
"""Larger files are refused; the largest of the database is well below."""

Source = str | os.PathLike[str] | bytes | bytearray | memoryview

_NAME_LENGTH = 100
_CHOOSE_CSV = "choose an OpenACC CSV file"
_SIGNATURES = (
    (b"PK\x03\x04", "a zip archive or an Excel workbook", "unpack it, or save the sheet as CSV"),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook", "save the sheet as CSV"),
    (b"\x1f\x8b", "a gzip archive", "unpack it first"),
    (b"7z\xbc\xaf", "a 7z archive", "unpack it first"),
    (b"\x89PNG", "a PNG image", _CHOOSE_CSV),
    (b"\xff\xd8\xff", "a JPEG image", _CHOOSE_CSV),
    (b"%PDF", "a PDF document", _CHOOSE_CSV),
    (b"\xff\xfe", "UTF-16 text", "save it as plain CSV (UTF-8)"),
    (b"\xfe\xff", "UTF-16 text", "save it as plain CSV (UTF-8)"),
)
_CONTROL = bytes(code for code in range(32) if code not in b"\t\n\r")
_BOM = b"\xef\xbb\xbf"

LOOKED_AT_FIRST = 10_000
"""Rows in which a cell that is no number is looked for before all are read as texts."""
MINIMUM_SAMPLES = 10
"""A file with fewer rows is not a recording."""
SHORTEST_STEP: Seconds = 1e-3
LONGEST_STEP: Seconds = 5.0
"""Rows closer or further apart suggest that the time is not in seconds."""
GAP_STEPS = 10
"""A time step longer than this many typical ones is a hole in the recording."""

MISSING = ["", "NaN", "nan", "NA", "N/A", "null"]
"""How files write that there is no number."""
AS_WRITTEN: dict[str, Any] = {
    "engine": "c",
    "keep_default_na": False,
    "na_values": MISSING,
    "skip_blank_lines": False,
    "skipinitialspace": True,
    "low_memory": False,
}
"""How pandas reads the cells of any table: nothing else is missing, and no row is passed over."""
_EMPTY = re.compile(rb"(?<=,)(?=[,\r\n]|\Z)")
"""Where an empty cell stands, but in the first column."""


@dataclass(frozen=True)
class SourceFile:
    """The bytes of a file and where they came from."""

    name: str
    folder: str | None
    """The folder's name; None for an upload."""
    raw: bytes

    @property
    def text(self) -> bytes:
        """The bytes without a byte-order mark."""
        return self.raw.removeprefix(_BOM)

    def refusal(self, fault: str, cure: str, place: str = "") -> RecordingError:
        """The error for this file: place, fault and cure in one sentence."""
        return _refusal(f"{self.name}, {place}" if place else self.name, fault, cure)


def _refusal(where: str, fault: str, cure: str) -> RecordingError:
    return RecordingError(f"{where}: {fault}; {cure}.")


def excerpt(text: str, length: int = 30) -> str:
    """A foreign text on one line, short enough to be part of a sentence."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return line if len(line) <= length else line[: length - 1] + "…"


def read_bytes(source: Source, name: str | None) -> SourceFile:
    """Read a file that holds text of a bearable size.

    Args:
        source: path of the file, or the bytes of an upload.
        name: file name to show; by default that of the path.

    Raises:
        RecordingError: when the file cannot be read, is too large or is no text.
    """
    if isinstance(source, bytes | bytearray | memoryview):
        source_file = SourceFile(excerpt(name or "upload", _NAME_LENGTH), None, bytes(source))
    elif not os.fspath(source):
        raise RecordingError("No file is named; name an OpenACC CSV file.")
    else:
        source_file = _load(Path(source), name)
    _require_size(source_file.name, len(source_file.raw))
    _require_text(source_file)
    return source_file


def _load(path: Path, name: str | None) -> SourceFile:
    shown = excerpt(name or path.name or str(path), _NAME_LENGTH)
    try:
        if path.is_dir():
            raise _refusal(shown, "this is a folder", "name one of the CSV files in it")
        if not path.exists():
            raise _refusal(shown, "there is no such file", "check its name and folder")
        if not path.is_file():
            raise _refusal(shown, "this is not an ordinary file", _CHOOSE_CSV)
        _require_size(shown, path.stat().st_size)
        return SourceFile(shown, path.resolve().parent.name, path.read_bytes())
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or "no valid path").lower()
        fault = f"the file cannot be opened ({reason})"
        raise _refusal(shown, fault, "check its name and permissions") from error


def _require_size(name: str, size: int) -> None:
    if size > LIMIT_BYTES:
        fault = f"the file has {size / 1e6:.1f} MB and the limit is {LIMIT_BYTES / 1e6:.1f} MB"
        raise _refusal(name, fault, "split it, or choose a single run")


def _require_text(source_file: SourceFile) -> None:
    text = source_file.text
    if not text.strip():
        raise source_file.refusal("the file is empty", "download or export it again")
    for signature, kind, cure in _SIGNATURES:
        if text.startswith(signature):
            raise source_file.refusal(f"this is {kind}, not a CSV file", cure)
    if text[:200].lstrip().startswith(b"<"):
        cure = "download the CSV file itself"
        raise source_file.refusal("this is a web page or XML, not a CSV file", cure)
    if b"\0" in text[:1000]:
        raise source_file.refusal("this is binary data", _CHOOSE_CSV)
    if len(text.translate(None, _CONTROL)) != len(text):
        position = next(i for i, code in enumerate(text) if code in _CONTROL)
        broken = "NUL bytes instead of text, as after a broken download"
        fault = "control characters, as in binary data" if text[position] else broken
        place = f"row {len(text[: position + 1].splitlines())}"
        raise source_file.refusal(fault, "download the file again", place)


@dataclass(frozen=True)
class Columns:
    """The row of column names: where the needed columns stand, 0 = leftmost."""

    names: tuple[str, ...]
    """Of all columns, also those that are not read."""
    row: int
    """Which row of the file it is, 1 = first."""
    end: int
    """Offset of the first byte behind it."""
    speed: Mapping[int, int]
    """Position by vehicle number; likewise below."""
    gap: Mapping[int, int]
    driver: Mapping[int, int]
    time: int = 0

    @property
    def numbers(self) -> list[int]:
        """Positions of the columns that hold numbers."""
        return sorted([self.time, *self.speed.values(), *self.gap.values()])


@dataclass(frozen=True, eq=False)
class Samples:
    """N samples of V vehicles; NaN, or an unknown mode, where the file has none."""

    time: FloatArray
    """(N,) in s, as in the file."""
    speed: FloatArray
    """(N, V) in m/s."""
    gap: FloatArray
    """(N, V-1) in m."""
    mode: NDArray[np.int8]
    """(N, V) values of `Mode`."""
    findings: tuple[LineEndMissing | ModesUnknown, ...]


def read_samples(source_file: SourceFile, columns: Columns, vehicles: int) -> Samples:
    """Read the rows below the column names.

    Args:
        source_file: the file.
        columns: the needed columns.
        vehicles: how many vehicles there are: V.

    Raises:
        RecordingError: which cell is wrong, and how to correct it.
    """
    text = source_file.text[columns.end :]
    is_complete = text.endswith((b"\n", b"\r"))
    table = _Table(source_file, text.rstrip(), columns)
    rows = _count_rows(table, is_complete)
    cells = _read_plain(table, rows) or _read_any(table, rows)
    numbers = cells.numbers
    _require_numbers(table, numbers)
    require_time(numbers[columns.time], partial(_at, table, columns.time))
    findings: list[LineEndMissing | ModesUnknown] = []
    if not is_complete and len(columns.names) - 1 not in columns.driver.values():
        findings.append(LineEndMissing())
    speed = {number: numbers[at] for number, at in columns.speed.items()}
    gap = {number: numbers[at] for number, at in columns.gap.items()}
    mode = {n: _modes(n, cells.words[at], findings) for n, at in columns.driver.items()}
    return Samples(
        time=numbers[columns.time],
        speed=_by_vehicle(speed, np.full((rows, vehicles), np.nan)),
        gap=_by_vehicle(gap, np.full((rows, vehicles - 1), np.nan)),
        mode=_by_vehicle(mode, np.full((rows, vehicles), Mode.UNKNOWN, np.int8)),
        findings=tuple(findings),
    )


def _by_vehicle(values: dict[int, NDArray[Any]], table: NDArray[Any]) -> NDArray[Any]:
    """The table (N, K) with vehicle i's values in column i - 1."""
    for number, series in values.items():
        if number <= table.shape[1]:
            table[:, number - 1] = series
    return table


@dataclass(frozen=True)
class _Table:
    """The text below the column names."""

    source_file: SourceFile
    text: bytes
    columns: Columns

    def read(self, positions: list[int], **options: Any) -> "pd.DataFrame":
        """Some columns as a frame, labelled by position."""
        import pandas as pd

        frame: pd.DataFrame = pd.read_csv(
            io.BytesIO(self.text),
            header=None,
            usecols=positions,
            encoding="latin-1",
            **AS_WRITTEN,
            **options,
        )
        return frame

    def refusal(self, fault: str, cure: str, row: int, at: int | None = None) -> RecordingError:
        """The sentence about a row, counted from 0, or about its cell ``at`` a position."""
        column = "" if at is None else f", column {self.columns.names[at]}"
        place = f"row {self.columns.row + row + 1}{column}"
        return self.source_file.refusal(fault, cure, place)


def cells_per_row(text: bytes, separator: str) -> NDArray[np.int32]:
    """How many cells each row of a text has, quotation marks left aside.

    Args:
        text: rows that end with any of the usual line ends; of a file up to the limit of size.
        separator: one character between two cells.
    """
    letters = np.frombuffer(_with_plain_ends(text), np.uint8)
    ends = np.flatnonzero(letters == ord("\n"))
    starts = np.zeros(len(ends) + 1, ends.dtype)
    np.add(ends, 1, out=starts[1:])
    del ends  # a file may have tens of millions of rows
    if starts[-1] == len(letters):  # behind the last line end is no row
        starts = starts[:-1]
    if not len(starts):
        return np.zeros(0, np.int32)
    counts = np.add.reduceat(letters == ord(separator), starts, dtype=np.int32)
    counts += 1
    return np.asarray(counts)


def _row(text: bytes, row: int) -> bytes:
    return next(islice(io.BytesIO(_with_plain_ends(text)), row, None))


def _with_plain_ends(text: bytes) -> bytes:
    return text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def _count_rows(table: _Table, is_complete: bool) -> int:
    """How many rows there are, all as wide as the row of column names."""
    counts = cells_per_row(table.text, ",")
    if len(counts) < MINIMUM_SAMPLES:
        fault = f"only {len(counts)} rows of numbers follow the column names"
        cure = f"a recording needs at least {MINIMUM_SAMPLES}, download it again"
        raise table.source_file.refusal(fault, cure)
    expected = len(table.columns.names)
    differing = np.flatnonzero(counts != expected)
    if not len(differing):
        return len(counts)
    ragged = int(differing[0])
    cells = int(counts[ragged])
    if ragged == len(counts) - 1 and not is_complete and cells < expected:
        fault = f"the file is cut short, its last row has {cells} of {expected} cells"
        raise table.refusal(fault, "download it again, or delete that row", ragged)
    found = f"has {cells} cells" if _row(table.text, ragged).strip() else "is empty"
    fault = f"the row {found} where the column names ask for {expected} cells"
    raise table.refusal(fault, "correct or delete it, or download the file again", ragged)


@dataclass(frozen=True, eq=False)
class _Cells:
    """The columns of N rows, by position."""

    numbers: dict[int, FloatArray]
    """(N,) each; nan where a cell is empty."""
    words: dict[int, list[str]]
    """N each."""


def _read_plain(table: _Table, rows: int) -> _Cells | None:
    """The columns, correctly rounded; None where a cell is neither a plain number nor empty."""
    numbers, words = table.columns.numbers, list(table.columns.driver.values())
    if b'"' in table.text:
        return None
    lines = [row.decode("latin-1") for row in _EMPTY.sub(b"nan", table.text).splitlines()]
    try:
        values = np.loadtxt(lines, delimiter=",", usecols=numbers, comments=None, unpack=True)
    except ValueError:
        return None
    cells = [line.split(",") for line in lines] if words else []
    if values.shape[1] != rows:
        return None
    return _Cells(
        dict(zip(numbers, values, strict=True)), {at: [row[at] for row in cells] for at in words}
    )


def _read_any(table: _Table, rows: int) -> _Cells:
    """The columns by pandas, or the sentence why it cannot read them either."""
    numbers, words = table.columns.numbers, list(table.columns.driver.values())
    dtypes = dict.fromkeys(numbers, "float64") | dict.fromkeys(words, "str")
    try:
        frame = table.read(numbers + words, dtype=dtypes)
    except ValueError as error:
        if "Calling read" in str(error):  # memory always reads: pandas has hidden a Ctrl+C
            raise KeyboardInterrupt from None
        raise _not_numbers(table) from error
    if len(frame) != rows:
        raise _unreadable(table)
    return _Cells(
        {at: frame[at].to_numpy() for at in numbers},
        {at: frame[at].fillna("").tolist() for at in words},
    )


def _not_numbers(table: _Table) -> RecordingError:
    """The sentence about the first cell that is not a number."""
    import pandas as pd

    for rows in (LOOKED_AT_FIRST, None):
        try:
            cells = table.read(table.columns.numbers, dtype="str", nrows=rows)
        except ValueError:
            return _unreadable(table)
        wrong = (cells.notna() & cells.apply(pd.to_numeric, errors="coerce").isna()).to_numpy()
        if wrong.any():
            break
    else:
        return _unreadable(table)
    row = int(wrong.any(axis=1).argmax())
    position = table.columns.numbers[int(wrong[row].argmax())]
    cell = str(cells.at[row, position]).encode("latin-1").decode("utf-8", "replace")
    fault = f'"{excerpt(cell)}" is not a number'
    return table.refusal(fault, "correct it, or leave the cell empty", row, position)


def _unreadable(table: _Table) -> RecordingError:
    """Why the parser finds other rows: almost always for one quotation mark too many."""
    odd = np.flatnonzero((cells_per_row(table.text, '"') - 1) % 2)
    if not len(odd):
        cure = "download the file again, or re-save it"
        return table.source_file.refusal("the rows cannot be read as numbers", cure)
    fault = "a quotation mark is opened and not closed"
    return table.refusal(fault, "delete it", int(odd[0]))


def _require_numbers(table: _Table, numbers: Mapping[int, FloatArray]) -> None:
    """All numbers finite and of a size that measurements have; missing ones are fine."""
    columns = table.columns
    for channel, positions in (
        (TIME, [columns.time]),
        (SPEED, columns.speed.values()),
        (GAP, columns.gap.values()),
    ):
        for position in positions:
            require_possible(channel, numbers[position], partial(_at, table, position))


def _at(table: _Table, at: int, fault: str, cure: str, row: int | None) -> RecordingError:
    """The sentence about a cell, or about the column where no row is named."""
    if row is None:
        return table.source_file.refusal(fault, cure, f"column {table.columns.names[at]}")
    return table.refusal(fault, cure, row, at)


Refuse = Callable[[str, str, int | None], RecordingError]
"""The error from fault, cure and the row counted from 0; without a row about a whole column."""


def require_possible(channel: Quantity, values: FloatArray, refuse: Refuse) -> None:
    """Numbers of a size that measurements have; missing ones are fine.

    Args:
        channel: what they are.
        values: (N,) in the channel's unit.
        refuse: makes the error.

    Raises:
        RecordingError: about the first that cannot be a measurement.
    """
    wrong = np.flatnonzero(np.abs(values) > channel.possible)
    if len(wrong):
        row = int(wrong[0])
        fault = (
            f"{values[row]:g} cannot be a measurement, as at most"
            f" {channel.possible:,.0f} {channel.unit} is possible"
        )
        cure = f"correct it, give it in {channel.unit}, or leave the cell empty"
        raise refuse(fault, cure, row)


def require_time(time: FloatArray, refuse: Refuse) -> None:
    """Time given everywhere, increasing, without holes.

    Args:
        time: (N,) in s.
        refuse: makes the error.

    Raises:
        RecordingError: about the first row that is wrong.
    """
    missing = np.flatnonzero(np.isnan(time))
    if len(missing):
        raise refuse("the time is missing", "fill it in or delete the row", int(missing[0]))
    require_possible(TIME, time, refuse)
    steps = np.diff(time)
    backward = np.flatnonzero(steps <= 0)
    if len(backward):
        row = int(backward[0]) + 1
        fault = f"the time does not increase, {time[row]:.10g} s follows {time[row - 1]:.10g} s"
        raise refuse(fault, "sort or delete the rows", row)
    typical = float(np.median(steps))
    if not SHORTEST_STEP <= typical <= LONGEST_STEP:
        fault = f"the rows are {typical:g} s apart where 0.1 s is usual"
        raise refuse(fault, "give the time in seconds", None)
    holes = np.flatnonzero(steps > GAP_STEPS * typical)
    if len(holes):
        row = int(holes[0]) + 1
        fault = f"the recording pauses for {steps[row - 1]:.1f} s before this row"
        raise refuse(fault, "split the file here into two recordings", row)


def _modes(
    number: int, words: list[str], findings: list[LineEndMissing | ModesUnknown]
) -> NDArray[np.int8]:
    """(N,) values of `Mode`; what is neither ACC nor Human is unknown, and a finding."""
    known = {name.lower(): Mode[name.upper()] for name in MODE_NAMES}
    meanings = {word: known.get(word.strip().lower(), Mode.UNKNOWN) for word in set(words)}
    modes = np.array([meanings[word] for word in words], dtype=np.int8)
    strange = sorted(
        word
        for word, meaning in meanings.items()
        if meaning is Mode.UNKNOWN and word.strip() not in MISSING
    )
    if strange:
        count = sum(map(words.count, strange))
        findings.append(ModesUnknown(vehicle=number, samples=count, example=excerpt(strange[0])))
    return modes
