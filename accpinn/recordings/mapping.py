"""Any table of a platoon: a mapping says which columns hold what, and in which units.

    {"time": {"column": "t", "unit": "ms"},
     "speeds": [{"column": "v1", "unit": "km/h", "name": "Leader"}, {"column": "v2"}],
     "gaps": [{"column": "range", "unit": "ft", "subtract": 4.5}],
     "modes": [{"vehicle": 2, "column": "engaged", "acc": ["1"], "human": ["0"]}]}

Speeds are listed leader first, and a gap for each follower. Instead of ``time`` a mapping may give
``sample_time`` in s. A mapping is remembered by the names of the columns, so that the next file
with the same ones is read alike.
"""

import hashlib
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from numpy.typing import NDArray
from platformdirs import user_data_path

from accpinn.channels import GAP, MAX_VEHICLES, SPEED, Quantity
from accpinn.errors import RecordingError
from accpinn.recordings.recording import MappingRemembered, Mode, Recording, completed
from accpinn.recordings.samples import (
    Refuse,
    Source,
    SourceFile,
    excerpt,
    read_bytes,
    require_possible,
    require_time,
)
from accpinn.recordings.tables import Layout, layout_of, read_columns
from accpinn.units import FloatArray, Metres, Seconds

if TYPE_CHECKING:
    import pandas as pd  # takes most of a second to import, which few files need

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "us": 1e-6, "ns": 1e-9, "min": 60.0}
SPEED_UNITS = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "ft/s": 0.3048, "kn": 1852 / 3600}
GAP_UNITS = {"m": 1.0, "cm": 0.01, "mm": 1e-3, "ft": 0.3048}
"""Each in the package's unit."""
FOLDER_VARIABLE = "ACCPINN_MAPPINGS"
"""Environment variable that names another folder than the one among the user's data."""


class TimeColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The column of time."""

    column: str
    unit: str = "s"
    """A key of `TIME_UNITS`."""


class SpeedColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The column of a vehicle's speed."""

    column: str
    unit: str = "m/s"
    """A key of `SPEED_UNITS`."""
    name: str = ""
    """The vehicle's, as make and model."""


class GapColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The column of the space-gap in front of a follower."""

    column: str
    unit: str = "m"
    """A key of `GAP_UNITS`."""
    subtract: Metres = 0.0
    """In m: the length of the vehicle ahead where the column holds a distance of positions."""


class ModeColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The column that says who controls a vehicle."""

    vehicle: int
    """1 = first."""
    column: str
    acc: tuple[str, ...] = ("ACC",)
    """What it says under ACC."""
    human: tuple[str, ...] = ("Human",)
    """What it says under manual driving."""


class CsvMapping(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which columns of a table hold what."""

    speeds: tuple[SpeedColumn, ...]
    """(V,) leader first."""
    gaps: tuple[GapColumn, ...]
    """(V-1,) first follower first."""
    time: TimeColumn | None = None
    sample_time: Seconds | None = None
    """The even step between rows, where no column holds the time."""
    modes: tuple[ModeColumn, ...] = ()
    trajectory: str | None = None
    """The column that tells several runs in one table apart."""


@dataclass(frozen=True)
class Preview:
    """What a page shows while a mapping is made."""

    layout: Layout
    mapping: CsvMapping | None
    """Remembered from a file with the same columns."""


def preview(source: Source, name: str | None = None) -> Preview:
    """The columns and first rows of a table, and the mapping that is remembered for it.

    Args:
        source: path of the file, or the bytes of an upload.
        name: file name to show; needed for bytes only.

    Raises:
        RecordingError: when it is no table with column names.
    """
    layout = layout_of(read_bytes(source, name))
    return Preview(layout, recall(layout.names))


def parse_mapping(text: str | bytes, name: str = "mapping") -> CsvMapping:
    """The mapping of a JSON document.

    Args:
        text: the document.
        name: of its file, for the error.

    Raises:
        RecordingError: naming the place that is wrong.
    """
    try:
        mapping = msgspec.json.decode(text, type=CsvMapping)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as fault:
        said = str(fault).replace(" - at `$", " at `").replace("`.", "`")
        raise RecordingError(
            f"{name}: this is no mapping ({excerpt(said, 150)}); give speeds, gaps and time or"
            " sample_time."
        ) from None
    _check(mapping, name)
    return mapping


def load_mapping(path: str | os.PathLike[str]) -> CsvMapping:
    """The mapping in a JSON file.

    Raises:
        RecordingError: when it cannot be read.
    """
    try:
        text = Path(path).read_bytes()
    except (OSError, ValueError) as fault:
        reason = (getattr(fault, "strerror", None) or "no valid path").lower()
        raise RecordingError(f"{path}: the mapping cannot be opened ({reason}).") from None
    return parse_mapping(text, excerpt(Path(path).name, 100))


def write_mapping(mapping: CsvMapping) -> bytes:
    """The JSON document of a mapping."""
    return msgspec.json.format(msgspec.json.encode(mapping), indent=2)


def _check(mapping: CsvMapping, name: str) -> None:
    """Refuse a mapping that no file could serve."""

    def refuse(fault: str) -> RecordingError:
        return RecordingError(f"{name}: {fault}.")

    if not 2 <= len(mapping.speeds) <= MAX_VEHICLES:
        raise refuse(
            f"speeds lists {len(mapping.speeds)} columns; list the leader's and followers'"
        )
    if len(mapping.gaps) != len(mapping.speeds) - 1:
        wanted = len(mapping.speeds) - 1
        raise refuse(f"gaps lists {len(mapping.gaps)} columns; list {wanted}, one a follower")
    if (mapping.time is None) == (mapping.sample_time is None):
        raise refuse("time and sample_time: give one of the two")
    if mapping.sample_time is not None and not 1e-3 <= mapping.sample_time <= 5.0:
        raise refuse(f"sample_time: {mapping.sample_time:g} s is not allowed; choose 0.001 to 5 s")
    units = [(one.unit, SPEED_UNITS, f"speeds[{k}]") for k, one in enumerate(mapping.speeds)]
    units += [(one.unit, GAP_UNITS, f"gaps[{k}]") for k, one in enumerate(mapping.gaps)]
    units += [(mapping.time.unit, TIME_UNITS, "time")] if mapping.time else []
    for unit, known, place in units:
        if unit not in known:
            listed = ", ".join(known)
            raise refuse(f'{place}.unit: "{excerpt(unit)}" is not known; choose from {listed}')
    for k, one in enumerate(mapping.modes):
        if not 1 <= one.vehicle <= len(mapping.speeds):
            raise refuse(f"modes[{k}].vehicle: there is no vehicle {one.vehicle}")
    if not all(np.isfinite(one.subtract) for one in mapping.gaps):
        raise refuse("gaps: subtract is no number")


def read_mapped(
    source: Source | SourceFile,
    mapping: CsvMapping,
    name: str | None = None,
    trajectory: str | None = None,
    remembered: bool = False,
) -> Recording:
    """Read a table whose columns a mapping names.

    Args:
        source: path of the file, the bytes of an upload, or what was read of either.
        mapping: which columns hold what.
        name: file name to show; needed for bytes only.
        trajectory: which run, where the mapping names a column that tells them apart.
        remembered: whether the mapping was not given but remembered, which is among the findings.

    Raises:
        RecordingError: one sentence of file, place, fault and cure.
    """
    source_file = source if isinstance(source, SourceFile) else read_bytes(source, name)
    _check(mapping, "mapping")
    layout = layout_of(source_file)
    words = [mode.column for mode in mapping.modes]
    words += [mapping.trajectory] if mapping.trajectory else []
    numbers = [mapping.time.column] if mapping.time else []
    numbers += [speed.column for speed in mapping.speeds] + [gap.column for gap in mapping.gaps]
    frame = read_columns(source_file, layout, [*dict.fromkeys(numbers)], [*dict.fromkeys(words)])
    first_rows = np.arange(len(frame)) + layout.header_row + 1
    if mapping.trajectory:
        runs = frame[mapping.trajectory]
        chosen = _choose(source_file, tuple(runs.unique()), trajectory)
        keep = (runs == chosen).to_numpy()
        frame, first_rows = frame[keep], first_rows[keep]
    elif trajectory is not None:
        fault = "the mapping names no column that tells trajectories apart"
        raise source_file.refusal(fault, "name it in the mapping, or choose no trajectory")

    def channel(column: str, factor: float, quantity: Quantity, less: Metres = 0.0) -> FloatArray:
        values = frame[column].to_numpy(dtype=float) * factor - less
        refuse = _refusing(source_file, column, first_rows)
        require_possible(quantity, values, refuse)
        if np.isnan(values).all():
            raise refuse("all cells are empty", "choose another column", None)
        return values

    speeds = [channel(c.column, SPEED_UNITS[c.unit], SPEED) for c in mapping.speeds]
    gaps = [channel(c.column, GAP_UNITS[c.unit], GAP, c.subtract) for c in mapping.gaps]
    content = hashlib.sha256(source_file.raw)
    if mapping.trajectory:
        content.update(chosen.encode())
    recording = Recording(
        source=source_file.name + (f", trajectory {chosen}" if mapping.trajectory else ""),
        sha256=content.hexdigest(),
        time=_time(source_file, mapping, frame, first_rows),
        speed=np.column_stack(speeds),
        gap=np.column_stack(gaps),
        mode=_modes(mapping, frame),
        trajectory=chosen if mapping.trajectory else None,
    )
    names = {k: excerpt(one.name, 80) for k, one in enumerate(mapping.speeds, 1)}
    return completed(recording, names, (MappingRemembered(),) if remembered else ())


def _time(
    source_file: SourceFile, mapping: CsvMapping, frame: "pd.DataFrame", rows: NDArray[np.int64]
) -> FloatArray:
    """(N,) in s from the first sample."""
    if mapping.time is None:
        return np.arange(len(rows), dtype=np.float64) * (mapping.sample_time or 0.0)
    column = mapping.time.column
    # From the first sample on, so that a large origin costs no digits.
    stamps = frame[column].to_numpy(dtype=np.float64)
    time: FloatArray = (stamps - stamps[0]) * TIME_UNITS[mapping.time.unit]
    require_time(time, _refusing(source_file, column, rows))
    return time


def _refusing(source_file: SourceFile, column: str, rows: NDArray[np.int64]) -> Refuse:
    """Makes the errors about a column, whose samples stand in these rows of the file."""

    def refuse(fault: str, cure: str, row: int | None) -> RecordingError:
        where = "" if row is None else f"row {rows[row]}, "
        return source_file.refusal(fault, cure, f"{where}column {excerpt(column)}")

    return refuse


def _modes(mapping: CsvMapping, frame: "pd.DataFrame") -> NDArray[np.int8]:
    modes = np.full((len(frame), len(mapping.speeds)), Mode.UNKNOWN, np.int8)
    for one in mapping.modes:
        modes[frame[one.column].isin(one.acc), one.vehicle - 1] = Mode.ACC
        modes[frame[one.column].isin(one.human), one.vehicle - 1] = Mode.HUMAN
    return modes


def _choose(source_file: SourceFile, names: Sequence[str], trajectory: str | None) -> str:
    if trajectory is not None and trajectory.strip() in names:
        return trajectory.strip()
    if trajectory is None and len(names) == 1:
        return names[0]
    listed = excerpt(", ".join(names), 120)
    fault = f"the table holds {len(names)} trajectories"
    if trajectory is not None:
        fault = f'there is no trajectory "{excerpt(trajectory)}"'
    raise source_file.refusal(fault, f"choose a trajectory (--trajectory): {listed}")


def trajectories_of(source_file: SourceFile, mapping: CsvMapping) -> tuple[str, ...]:
    """The names of a table's runs; empty where the mapping tells none apart.

    Raises:
        RecordingError: when the column is missing.
    """
    if mapping.trajectory is None:
        return ()
    words = read_columns(source_file, layout_of(source_file), (), (mapping.trajectory,))
    return tuple(words[mapping.trajectory].unique())


def remember(mapping: CsvMapping, names: Sequence[str]) -> None:
    """Keep a mapping for the next file with these column names; a full disk is no fault."""
    place = _place(names)
    with suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        part = place.with_suffix(f".{os.getpid()}.part")
        part.write_bytes(write_mapping(mapping))
        os.replace(part, place)


def recall(names: Sequence[str]) -> CsvMapping | None:
    """The mapping kept for files with these column names; None where there is none."""
    try:
        return parse_mapping(_place(names).read_bytes())
    except (OSError, RecordingError):
        return None


def _place(names: Sequence[str]) -> Path:
    named = os.environ.get(FOLDER_VARIABLE)
    folder = Path(named) if named else user_data_path("accpinn") / "mappings"
    return folder / f"{hashlib.sha256(repr(tuple(names)).encode()).hexdigest()[:24]}.json"
