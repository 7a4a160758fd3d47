"""A mapping: which columns of a table hold what, in which units.

    {"time": {"column": "t", "unit": "ms"},
     "speeds": [{"column": "v1", "unit": "km/h", "name": "Leader"}, {"column": "v2"}],
     "gaps": [{"column": "range", "unit": "ft", "subtract": 4.5}],
     "modes": [{"vehicle": 2, "column": "engaged", "acc": ["1"], "human": ["0"]}]}

Speeds are listed leader first, and a gap for each follower. Further entries:

    "time": {"column": "clock", "unit": "clock", "date": "day"}   date and time in two columns
    "time": {"column": "secs", "nanoseconds": "nsecs"}            whole seconds and their fractions
    "time": {"column": "frame", "unit": "frame"}, "sample_time": 0.04     a counter of frames
    "sample_time": 0.1                            even steps, in place of "time"
    {"column": "dv", "relative_to": 2}            a speed relative to that of vehicle 2
    {.., "reversed": true}                        the sign is the other one, of speed or gap
    {.., "shift": -1.0}                           seconds to add to its times, to correct its clock
    {"column": "p1", "minus": "p2", "subtract": "length"}    a gap between two positions
    "by": {"vehicle": "id", "leader": "leader_id"}           one row a vehicle and instant
    "by": {"vehicle": "id", "lane": "lane", "position": "x"}
    "trajectory": "run"                           the column that tells several runs apart

With ``by`` one speed and one gap are named, which are those of the row's vehicle; of a gap between
positions ``column`` and ``minus`` are then the same column, and a length is that of the vehicle
ahead. A column that has no name is called "column 1", "column 2", ..
"""

import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from accpinn.channels import MAX_VEHICLES, SPEED
from accpinn.errors import RecordingError
from accpinn.findings import Finding
from accpinn.recordings import cures
from accpinn.recordings.clocks import FORMS, FRAME
from accpinn.recordings.cures import Cure, Exchange, ReadAs, ReadSpeedAs, Reverse, Shift
from accpinn.recordings.inconsistency import Inconsistency, SpeedsApart, UnitsDiffer
from accpinn.recordings.source import excerpt
from accpinn.storage import folder, reported, write_whole
from accpinn.units import GAP_UNITS, SPEED_UNITS, Metres, Seconds

TIME_UNITS = (*FORMS, FRAME)
"""Forms of time; frames are `CsvMapping.sample_time` apart."""
LONGEST_SHIFT: Seconds = 60.0


class TimeColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The column of time."""

    column: str
    unit: str = "s"
    """One of `TIME_UNITS`."""
    date: str = ""
    """The column of the date, where it is not in the same one."""
    nanoseconds: str = ""
    """The column of nanoseconds beside whole seconds, where these are apart."""


class SpeedColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The column of a vehicle's speed."""

    column: str
    unit: str = "m/s"
    """A key of `units.SPEED_UNITS`."""
    name: str = ""
    """Name of the vehicle, as make and model."""
    relative_to: int = 0
    """Number of the vehicle to whose speed the column is to be added; 0 for a speed of its own."""
    reversed: bool = False
    """Whether the column has the other sign."""
    shift: Seconds = 0.0
    """Seconds to add to the column's times, as its logger's clock was wrong by as much."""


class GapColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The column of the space-gap in front of a follower, or the columns of two positions."""

    column: str
    """The gap's, or where `minus` is given that of the position of the vehicle ahead."""
    unit: str = "m"
    """A key of `units.GAP_UNITS`, also of the positions and of a column of lengths."""
    subtract: Metres | str = 0.0
    """Length of the vehicle ahead in m, or its column, where the column holds a distance of
    positions."""
    minus: str = ""
    """The column of the follower's own position."""
    reversed: bool = False
    """Whether the difference has the other sign."""
    shift: Seconds = 0.0
    """Seconds to add to the column's times."""


class MappingRemembered(Finding, frozen=True):
    """The columns were read by the mapping of an earlier file with the same columns."""

    text = (
        "Columns and units were read as those of an earlier file with the same header; map the"
        " columns again if they are others."
    )


class ModeColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The column of a vehicle's driver mode."""

    vehicle: int
    """Number of the vehicle, 1 = first."""
    column: str
    acc: tuple[str, ...] = ("ACC",)
    """Words for driving under ACC."""
    human: tuple[str, ...] = ("Human",)
    """Words for manual driving."""


class ByVehicle(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The columns that identify vehicles in a table of one row a vehicle and instant."""

    vehicle: str
    """Identifier of the row's vehicle."""
    leader: str = ""
    """Identifier of the vehicle ahead; without it, lane and position find it."""
    lane: str = ""
    position: str = ""
    """Position along the lane."""


class CsvMapping(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The columns of a table by what they hold."""

    speeds: tuple[SpeedColumn, ...]
    """(V,) columns of speed, leader first; one where `by` is given."""
    gaps: tuple[GapColumn, ...]
    """(V-1,) columns of space-gap, first follower first; one where `by` is given."""
    time: TimeColumn | None = None
    sample_time: Seconds | None = None
    """The even step between rows, where no column holds the time, or between frames."""
    modes: tuple[ModeColumn, ...] = ()
    trajectory: str | None = None
    """The column that identifies the runs of a table."""
    by: ByVehicle | None = None
    """Columns that identify vehicles, for a table of one row a vehicle and instant."""


def parse_mapping(text: str | bytes, name: str = "mapping") -> CsvMapping:
    """The mapping of a JSON document, whose file the error names.

    Raises:
        RecordingError: naming the place that is wrong.
    """
    try:
        mapping = msgspec.json.decode(text, type=CsvMapping)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as fault:
        detail = str(fault).replace(" - at `$", " at `").replace("`.", "`")
        raise RecordingError(
            f"{name}: this is no mapping ({excerpt(detail, 150)}); give speeds, gaps and time or"
            " sample_time."
        ) from None
    check_mapping(mapping, name)
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
    """The JSON document of a mapping, without empty and zero entries."""
    return msgspec.json.format(msgspec.json.encode(_filled(msgspec.to_builtins(mapping))), indent=2)


def _filled(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _filled(part) for key, part in value.items() if part or key == "column"}
    return [_filled(part) for part in value] if isinstance(value, list | tuple) else value


def check_mapping(mapping: CsvMapping, name: str = "mapping") -> None:
    """Refuse a mapping that no file could serve.

    Raises:
        RecordingError: naming the entry that is wrong.
    """
    fault = next(_faults(mapping), None)
    if fault:
        raise RecordingError(f"{name}: {fault}.")


def _faults(mapping: CsvMapping) -> Iterator[str]:
    """The faults of a mapping, each with its cure."""
    speeds, gaps = len(mapping.speeds), len(mapping.gaps)
    if mapping.by:
        yield from _faults_by_vehicle(mapping, mapping.by)
    elif not 2 <= speeds <= MAX_VEHICLES:
        yield f"speeds lists {speeds} columns; list the leader's and followers'"
    elif gaps != speeds - 1:
        yield f"gaps lists {gaps} columns; list {speeds - 1}, one a follower"
    yield from _time_faults(mapping)
    units = [(s.unit, SPEED_UNITS, f"speeds[{k}]") for k, s in enumerate(mapping.speeds)]
    units += [(g.unit, GAP_UNITS, f"gaps[{k}]") for k, g in enumerate(mapping.gaps)]
    for unit, choices, place in units:
        if unit not in choices:
            yield f'{place}.unit: "{excerpt(unit)}" is not known; choose from {", ".join(choices)}'
    for k, speed in enumerate(mapping.speeds):
        other = speed.relative_to
        if other and (not 1 <= other <= speeds or mapping.speeds[other - 1].relative_to):
            yield (
                f"speeds[{k}].relative_to: vehicle {other} has no speed of its own; choose another"
            )
    for k, mode in enumerate(mapping.modes):
        if not 1 <= mode.vehicle <= speeds:
            yield f"modes[{k}].vehicle: there is no vehicle {mode.vehicle}"
    for k, gap in enumerate(mapping.gaps):
        if not isinstance(gap.subtract, str) and not np.isfinite(gap.subtract):
            yield f"gaps[{k}].subtract is no number; give the length of the vehicle ahead in m"
    shifts = [(f"speeds[{k}]", speed.shift) for k, speed in enumerate(mapping.speeds)]
    shifts += [(f"gaps[{k}]", gap.shift) for k, gap in enumerate(mapping.gaps)]
    for place, shift in shifts:
        if not abs(shift) <= LONGEST_SHIFT:
            yield f"{place}.shift: {shift:g} s is not allowed; choose at most {LONGEST_SHIFT:g} s"
    roles: dict[str, str] = {}
    for place, column in _roles(mapping):
        if not column.strip():
            yield f"{place}: name a column"
        if roles.setdefault(column, place) != place:
            yield (
                f'column "{excerpt(column, 60)}" is named twice, as {roles[column]} and as {place};'
                " a column holds one quantity, so name another one"
            )


def _faults_by_vehicle(mapping: CsvMapping, by: ByVehicle) -> Iterator[str]:
    if len(mapping.speeds) != 1 or len(mapping.gaps) != 1:
        yield "with by, give one speed and one gap: those of the row's vehicle"
        return
    if not by.leader and not (by.lane and by.position):
        yield "by: give leader, or lane and position, to find the vehicle ahead"
    gap = mapping.gaps[0]
    if gap.minus and gap.minus != gap.column:
        yield "gaps[0].minus: with by, name the column of positions that column names"
    if mapping.modes:
        yield "modes cannot be told with by; leave them out"
    if mapping.speeds[0].relative_to:
        yield "speeds[0].relative_to cannot be used with by; name the vehicle's own speed"
    if mapping.sample_time is not None and not mapping.time:
        yield "by needs a column of time; name it"


def _time_faults(mapping: CsvMapping) -> Iterator[str]:
    counts = mapping.time is not None and mapping.time.unit == FRAME
    if mapping.time and mapping.time.unit not in TIME_UNITS:
        unit, allowed = excerpt(mapping.time.unit), ", ".join(TIME_UNITS)
        yield f'time.unit: "{unit}" is not known; choose from {allowed}'
    if counts and mapping.sample_time is None:
        yield "sample_time: give the time between two frames in s"
    elif not counts and (mapping.time is None) == (mapping.sample_time is None):
        yield "time and sample_time: give one of the two"
    step = mapping.sample_time
    if step is not None and not 1e-3 <= step <= 5.0:
        yield f"sample_time: {step:g} s is not allowed; choose 0.001 to 5 s"


def _roles(mapping: CsvMapping) -> Iterator[tuple[str, str]]:
    """Places and columns that a mapping names, without those of driver modes."""
    if mapping.time:
        yield "time", mapping.time.column
        if mapping.time.date:
            yield "the date", mapping.time.date
        if mapping.time.nanoseconds:
            yield "nanoseconds", mapping.time.nanoseconds
    for k, speed in enumerate(mapping.speeds, 1):
        yield f"the speed of vehicle {k}", speed.column
    for k, gap in enumerate(mapping.gaps, 1):
        if gap.minus:
            row = bool(mapping.by)
            yield ("position" if row else f"the position of vehicle {k}"), gap.column
            yield ("position" if row else f"the position of vehicle {k + 1}"), gap.minus
        else:
            yield f"the gap of vehicle {k + 1}", gap.column
        if isinstance(gap.subtract, str):
            yield "the length of a vehicle", gap.subtract
    if mapping.trajectory is not None:
        yield "the name of the run", mapping.trajectory
    if mapping.by:
        yield "the identifier of the vehicle", mapping.by.vehicle
        if mapping.by.leader:
            yield "the identifier of the vehicle ahead", mapping.by.leader
        if mapping.by.lane:
            yield "the lane", mapping.by.lane
        if mapping.by.position:
            yield "position", mapping.by.position


def cured(mapping: CsvMapping, cure: Cure) -> CsvMapping:
    """The mapping changed as a finding about the data proposes.

    Args:
        mapping: which the data were read by.
        cure: of a finding about them; units are those of all columns of the quantity.
    """
    speeds, gaps = list(mapping.speeds), list(mapping.gaps)
    match cure:
        case Exchange(vehicle):
            pair = range(0, 1) if mapping.by else range(vehicle - 1, vehicle + 1)
            relative = [k for k in pair if speeds[k].relative_to]
            if mapping.by:  # who is ahead is named in the table
                gaps[0] = replace(gaps[0], reversed=not gaps[0].reversed)
            elif relative:
                at = relative[0]
                speeds[at] = replace(speeds[at], reversed=not speeds[at].reversed)
            else:
                speeds[vehicle - 1], speeds[vehicle] = speeds[vehicle], speeds[vehicle - 1]
        case Reverse(vehicle):
            at = 0 if mapping.by else vehicle - 1
            gaps[at] = replace(gaps[at], reversed=not gaps[at].reversed)
        case Shift(channel, vehicle, seconds):
            channels: list[Any] = speeds if channel == SPEED.column else gaps
            at = 0 if mapping.by else vehicle - 1
            shift = round(channels[at].shift + seconds, 3)
            channels[at] = replace(channels[at], shift=shift)
        case ReadAs():
            speeds = [replace(speed, unit=cure.speed) for speed in speeds]
            gaps = [replace(gap, unit=cure.gap) for gap in gaps]
            if mapping.time and mapping.time.unit in cures.TIME_UNITS:
                mapping = replace(mapping, time=replace(mapping.time, unit=cure.time))
        case ReadSpeedAs(vehicle, unit):
            at = 0 if mapping.by else vehicle - 1
            speeds[at] = replace(speeds[at], unit=unit)
    return replace(mapping, speeds=tuple(speeds), gaps=tuple(gaps))


def units_taken(mapping: CsvMapping, vehicle: int) -> ReadAs:
    """The units in which a mapping reads the speed of a vehicle and the gap behind it."""
    at = 0 if mapping.by else vehicle - 1
    is_counted = mapping.time is not None and mapping.time.unit in cures.TIME_UNITS
    time = mapping.time.unit if mapping.time and is_counted else cures.SI.time
    return ReadAs(mapping.speeds[at].unit, mapping.gaps[at].unit, time)


def cures_of(finding: Inconsistency, mapping: CsvMapping) -> tuple[Cure, ...]:
    """The cures of an inconsistency of data that were read by a mapping, likeliest first.

    Only what `cured` can change in that mapping is named.
    """
    if isinstance(finding, SpeedsApart):
        if mapping.by:
            return ()
        ahead, behind = (mapping.speeds[v - 1].unit for v in (finding.vehicle, finding.follower))
        return finding.units((ahead, behind))
    if not isinstance(finding, UnitsDiffer):
        return tuple(c for c in finding.cures if not (mapping.by and isinstance(c, Shift)))
    taken = units_taken(mapping, finding.vehicle)
    if taken.speed not in SPEED_UNITS or taken.gap not in cures.GAP_UNITS:
        return ()
    is_counted = mapping.time is not None and mapping.time.unit in cures.TIME_UNITS
    return tuple(c for c in finding.units(taken) if is_counted or c.time == taken.time)


def remember_mapping(mapping: CsvMapping, names: Sequence[str]) -> None:
    """Keep a mapping for the next file with these column names; a full disk is no fault."""
    place = _place(names)
    with suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        write_whole(place, write_mapping(mapping))


def remembered_mapping(names: Sequence[str]) -> CsvMapping | None:
    """The mapping kept for files with these column names; None where there is none."""
    try:
        return parse_mapping(_place(names).read_bytes())
    except (OSError, RecordingError):
        return None


def _place(names: Sequence[str]) -> Path:
    content = hashlib.sha256(repr(tuple(names)).encode())
    return folder("mappings") / f"{content.hexdigest()[:24]}.json"
