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
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from accpinn.channels import GAP, MAX_VEHICLES, SPEED, Quantity
from accpinn.errors import RecordingError
from accpinn.findings import Finding
from accpinn.recordings import Mode, Recording
from accpinn.recordings.source import SourceFile, excerpt
from accpinn.recordings.tables import Columns, TableRun, layout_of, read_columns
from accpinn.storage import folder, reported, write_whole
from accpinn.units import FloatArray, Metres, Seconds

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "us": 1e-6, "ns": 1e-9, "min": 60.0}
SPEED_UNITS = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "ft/s": 0.3048, "kn": 1852 / 3600}
GAP_UNITS = {"m": 1.0, "cm": 0.01, "mm": 1e-3, "ft": 0.3048}
"""Units of each quantity, in the package's own."""


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
    """Name of the vehicle, as make and model."""


class GapColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The column of the space-gap in front of a follower."""

    column: str
    unit: str = "m"
    """A key of `GAP_UNITS`."""
    subtract: Metres = 0.0
    """Length of the vehicle ahead in m, where the column holds a distance of positions."""


class MappingRemembered(Finding, frozen=True):
    """The columns were read as a mapping says that an earlier file with the same columns had."""

    text = (
        "Columns and units were read as those of an earlier file with the same header; map the"
        " columns again if they are others."
    )


class ModeColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The column that says who controls a vehicle."""

    vehicle: int
    """Number of the vehicle, 1 = first."""
    column: str
    acc: tuple[str, ...] = ("ACC",)
    """Words for driving under ACC."""
    human: tuple[str, ...] = ("Human",)
    """Words for manual driving."""


class CsvMapping(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The columns of a table by what they hold."""

    speeds: tuple[SpeedColumn, ...]
    """(V,) columns of speed, leader first."""
    gaps: tuple[GapColumn, ...]
    """(V-1,) columns of space-gap, first follower first."""
    time: TimeColumn | None = None
    sample_time: Seconds | None = None
    """The even step between rows, where no column holds the time."""
    modes: tuple[ModeColumn, ...] = ()
    trajectory: str | None = None
    """The column that tells several runs in one table apart."""


def parse_mapping(text: str | bytes, name: str = "mapping") -> CsvMapping:
    """The mapping of a JSON document, whose file the error names.

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
    sentence = "{}: the mapping cannot be opened ({}); check its name."
    with reported(lambda reason: RecordingError(sentence.format(path, reason.lower()))):
        text = Path(path).read_bytes()
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
    units = [(speed.unit, SPEED_UNITS, f"speeds[{k}]") for k, speed in enumerate(mapping.speeds)]
    units += [(gap.unit, GAP_UNITS, f"gaps[{k}]") for k, gap in enumerate(mapping.gaps)]
    units += [(mapping.time.unit, TIME_UNITS, "time")] if mapping.time else []
    for unit, known, place in units:
        if unit not in known:
            listed = ", ".join(known)
            raise refuse(f'{place}.unit: "{excerpt(unit)}" is not known; choose from {listed}')
    for k, mode in enumerate(mapping.modes):
        if not 1 <= mode.vehicle <= len(mapping.speeds):
            raise refuse(f"modes[{k}].vehicle: there is no vehicle {mode.vehicle}")
    if not all(np.isfinite(gap.subtract) for gap in mapping.gaps):
        raise refuse("gaps: subtract is no number")


def runs_of(
    source_file: SourceFile, mapping: CsvMapping, remembered: bool = False
) -> tuple[TableRun, ...]:
    """The runs of a table, in the order of their first rows.

    A mapping that was not given but ``remembered`` is among the findings.

    Raises:
        RecordingError: one sentence of file, place, fault and cure.
    """
    _check(mapping, "mapping")
    words = [mode.column for mode in mapping.modes]
    words += [mapping.trajectory] if mapping.trajectory else []
    numbers = [mapping.time.column] if mapping.time else []
    numbers += [speed.column for speed in mapping.speeds] + [gap.column for gap in mapping.gaps]
    columns = read_columns(source_file, layout_of(source_file), numbers, words)
    rows_of: dict[str | None, list[int]] = {}
    for row in columns.rows.tolist():
        trajectory = columns.words[mapping.trajectory][row] if mapping.trajectory else None
        rows_of.setdefault(trajectory, []).append(row)
    findings = (MappingRemembered(),) if remembered else ()
    return tuple(
        TableRun(
            () if trajectory is None else (trajectory,),
            len(mapping.speeds),
            partial(_recording, columns, mapping, np.array(rows), trajectory, findings),
        )
        for trajectory, rows in rows_of.items()
    )


def _recording(
    columns: Columns,
    mapping: CsvMapping,
    rows: NDArray[np.int64],
    trajectory: str | None,
    remembered: tuple[MappingRemembered, ...],
) -> Recording:
    """The recording of the rows of one run, 0 = first below the column names."""
    columns, findings = columns[rows], list[Finding](remembered)

    def channel(column: str, factor: float, quantity: Quantity, less: Metres = 0.0) -> FloatArray:
        values = columns.measured(quantity, column, factor, less)
        columns.require_some(column, "choose another column")
        return values

    speeds = [channel(c.column, SPEED_UNITS[c.unit], SPEED) for c in mapping.speeds]
    gaps = [channel(c.column, GAP_UNITS[c.unit], GAP, c.subtract) for c in mapping.gaps]
    if mapping.time:
        time = columns.time(mapping.time.column, TIME_UNITS[mapping.time.unit])
    elif len(rows) > 1:
        time = np.arange(len(rows), dtype=np.float64) * (mapping.sample_time or 0.0)
    else:
        column = mapping.trajectory or mapping.speeds[0].column
        raise columns.refusal("the trajectory has one row", "choose another trajectory", column)
    modes = np.full((len(columns), len(speeds)), Mode.UNKNOWN, np.int8)
    for one in mapping.modes:
        modes[:, one.vehicle - 1] = columns.modes(one.column, one.acc, one.human, findings)
    source_file = columns.source_file
    return Recording(
        source=source_file.name + (f", trajectory {trajectory}" if mapping.trajectory else ""),
        sha256=source_file.sha256(trajectory),
        time=time,
        speed=np.column_stack(speeds),
        gap=np.column_stack(gaps),
        mode=modes,
        trajectory=trajectory,
        names={k: excerpt(speed.name, 80) for k, speed in enumerate(mapping.speeds, 1)},
        notes=tuple(findings),
    )


def remember(mapping: CsvMapping, names: Sequence[str]) -> None:
    """Keep a mapping for the next file with these column names; a full disk is no fault."""
    place = _place(names)
    with suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        write_whole(place, write_mapping(mapping))


def recall(names: Sequence[str]) -> CsvMapping | None:
    """The mapping kept for files with these column names; None where there is none."""
    try:
        return parse_mapping(_place(names).read_bytes())
    except (OSError, RecordingError):
        return None


def _place(names: Sequence[str]) -> Path:
    content = hashlib.sha256(repr(tuple(names)).encode())
    return folder("mappings") / f"{content.hexdigest()[:24]}.json"
