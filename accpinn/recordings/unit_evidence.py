"""Evidence of a table's data for its units, and for which columns are speeds and gap.

In the right units, and for the right three columns,

    dp/dt = v_ahead - v_behind

and along the road dx/dt = v. Where the vehicles hardly move against each other, a usual time gap
supports the package's own units.
"""

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from msgspec.structs import replace

from accpinn.findings import joined
from accpinn.recordings import MOVING, clocks
from accpinn.recordings.consistency import Slope, slope_of
from accpinn.recordings.cures import slope_tolerance
from accpinn.recordings.draft import Column, Draft, Proposal, roles_of, seconds_of
from accpinn.recordings.mapping import (
    CsvMapping,
    GapColumn,
    SpeedColumn,
    TimeColumn,
)
from accpinn.recordings.tables import MINIMUM_SAMPLES
from accpinn.units import GAP_UNITS, SPEED_UNITS, FloatArray, Mask, Seconds

MOST_TRIED = 8
"""Columns among which speeds and gap are sought by their values alone."""
USUAL_TIME_GAP: tuple[Seconds, Seconds] = (0.75, 3.0)
"""Usual time gaps in following, in s, which support units without other evidence."""
SURE = 0.9
"""Least correlation of a gap's changes with those that two speeds demand, to take all three."""
UNNAMED_SPEEDS = {False: ("m/s", "km/h", "mph"), True: ("ft/s", "mph")}
"""Units tried for speeds without one, beside gaps in m and beside gaps in ft."""
FITS = 0.12
"""Largest relative deviation of the slope from 1 in units that the data support."""


def with_units(draft: Draft, mapping: CsvMapping, is_complete: bool) -> CsvMapping:
    """The mapping with the units that names or data support, and the choices with their reasons."""
    columns = {column.text: column for column in draft.columns}
    speeds = [s.column for s in mapping.speeds if s.column]
    lengths = [name for g in mapping.gaps for name in (g.column, g.minus) if name]
    unnamed = [name for name in speeds if not columns[name].name.speed_unit]
    unnamed += [name for name in lengths if not columns[name].name.length_unit]
    reason, is_supported = "no unit is named", False
    if is_complete and mapping.time and unnamed:
        mapping, reason, is_supported = _units_of_data(draft, mapping, unnamed)
    for name, role, unit in roles_of(mapping):
        if not name or name in draft.choices:
            continue
        column = columns[name]
        by_name = "the row of units says so" if column.name.unit_cell else "the name says so"
        whose = f" of the {column.name.whose}" if column.name.whose else ""
        named = f"named {column.name.quantity or 'so'}{whose}"
        why = f"{named}; {unit}: {reason if name in unnamed else by_name}"
        draft.choose(column, role, unit, why, is_supported or name not in unnamed)
    if unnamed and is_complete and not is_supported:
        listed = joined([f'"{name}"' for name in unnamed])
        draft.undecided.append(f"Confirm the units of {listed}: {reason}.")
    return mapping


def _units_of_data(
    draft: Draft, mapping: CsvMapping, unnamed: Sequence[str]
) -> tuple[CsvMapping, str, bool]:
    """The mapping in the units in which the gaps change as the speeds demand.

    Only the units of ``unnamed`` columns may change. Returns the reason as well, and whether the
    data determine the units.
    """
    speeds = [s.column for s in mapping.speeds if s.column in unnamed]
    gaps = [g.column for g in mapping.gaps if g.column in unnamed]
    slopes = _slopes(draft, mapping)
    if not slopes or slopes[0].is_vague:
        if mapping.gaps[0].minus:
            return _units_of_positions(draft, mapping, speeds)
        return mapping, *_usual_time_gap(draft, mapping)
    slope = abs(slopes[0].middle)
    candidates = []
    named = {g.unit for g in mapping.gaps if g.column not in gaps} or {"m"}
    for speed_unit in UNNAMED_SPEEDS[named == {"ft"}] if speeds else ("",):
        for gap_unit in GAP_UNITS if gaps and not speeds else ("m",) if gaps else ("",):
            factor = GAP_UNITS.get(gap_unit, 1.0) / SPEED_UNITS.get(speed_unit, 1.0)
            candidates.append((float(abs(np.log(slope * factor))), speed_unit, gap_unit))
    distance, speed_unit, gap_unit = min(candidates)
    # Speeds whose header is wrong make gaps in m look like some in ft, but never quite.
    close = slope_tolerance(slopes[0].error / slope)
    if distance > np.log1p(FITS if gap_unit in ("", "m") else min(FITS, close)):
        return mapping, f"the gap changes {slope:.2f} times as fast as the speeds demand", False
    others = [
        speed or gap
        for misfit, speed, gap in candidates
        if misfit < np.log1p(FITS) and (speed, gap) != (speed_unit, gap_unit)
    ]
    mapping = replace(
        mapping,
        speeds=tuple(
            replace(s, unit=speed_unit) if s.column in speeds else s for s in mapping.speeds
        ),
        gaps=tuple(replace(g, unit=gap_unit) if g.column in gaps else g for g in mapping.gaps),
    )
    reason = "the gap changes as fast as the speeds demand"
    if others:
        reason = f"{joined([speed_unit or gap_unit, *others])} fit the gap's changes"
    return mapping, reason, not others


def _units_of_positions(
    draft: Draft, mapping: CsvMapping, unnamed: Sequence[str]
) -> tuple[CsvMapping, str, bool]:
    """The mapping in the units in which the position of the vehicle ahead changes as its speed."""
    columns = {column.text: column for column in draft.columns}
    time, speed, gap = seconds_of(draft, mapping.time), mapping.speeds[0], mapping.gaps[0]
    values, position = columns[speed.column].numbers, columns[gap.column].numbers
    if time is None or values is None or position is None:
        return mapping, "no unit is named", False
    unit, reason, is_supported = _unit_by_way(time, values, position * GAP_UNITS[gap.unit])
    if speed.column not in unnamed:
        return mapping, reason, unit == speed.unit
    speeds = tuple(replace(s, unit=unit) if s.column in unnamed else s for s in mapping.speeds)
    return replace(mapping, speeds=speeds), reason, is_supported


def _unit_by_way(
    time: FloatArray, speed: FloatArray, position: FloatArray
) -> tuple[str, str, bool]:
    """The unit of a speed by the way that was driven meanwhile, the reason, and if it fits."""
    driven = float(np.nansum((speed[1:] + speed[:-1]) / 2 * np.diff(time)))
    ratio = abs((position[-1] - position[0]) / driven) if driven else np.nan
    for unit, factor in SPEED_UNITS.items():
        if abs(np.log(ratio / factor)) < np.log1p(FITS):
            return unit, "the position changes as the speed says", True
    return "m/s", f"no unit is named; the position changes {ratio:.2f} times as fast", False


def _usual_time_gap(draft: Draft, mapping: CsvMapping) -> tuple[str, bool]:
    """The reason why units are supported by a usual time gap, and whether they are.

    The slope determines nothing here. Speeds in km/h, mph, ft/s or knots taken as m/s make the time
    gap a half or less.
    """
    columns = {column.text: column for column in draft.columns}
    speed = _speed(columns, mapping, len(mapping.speeds))
    gap = _gap(columns, mapping.gaps[-1])
    plain = "no unit is named, and the vehicles hardly move against each other"
    if speed is None or gap is None or isinstance(mapping.gaps[-1].subtract, str):
        return plain, False
    moving = speed > MOVING
    if not moving.any():
        return plain, False
    time_gap = float(np.nanmedian(gap[moving] / speed[moving]))
    least, most = USUAL_TIME_GAP
    reason = f"no unit is named; with it the time gap is {time_gap:.1f} s"
    return reason, least <= time_gap <= most


def _slopes(draft: Draft, mapping: CsvMapping) -> list[Slope]:
    """The slope of each gap in the mapping's units, the best determined first."""
    columns = {column.text: column for column in draft.columns}
    time = seconds_of(draft, mapping.time)
    if time is None:
        return []
    slopes = []
    for k, gap in enumerate(mapping.gaps, 1):
        ahead, behind = (_speed(columns, mapping, v) for v in (k, k + 1))
        values = _gap(columns, gap)
        if ahead is None or behind is None or values is None:
            continue
        slope = slope_of(time, ahead, behind, values)
        if slope:
            slopes.append(slope)
    return sorted(slopes, key=lambda slope: slope.error)


def _gap(columns: dict[str, Column], gap: GapColumn) -> FloatArray | None:
    """A gap, or difference of positions, in m; None where cells are no numbers."""
    values = columns[gap.column].numbers
    if gap.minus and values is not None:
        behind = columns[gap.minus].numbers
        values = None if behind is None else values - behind
    return None if values is None else values * GAP_UNITS[gap.unit]


def _speed(columns: dict[str, Column], mapping: CsvMapping, vehicle: int) -> FloatArray | None:
    speed = mapping.speeds[vehicle - 1]
    numbers = columns[speed.column].numbers
    if numbers is None:
        return None
    values = numbers * SPEED_UNITS[speed.unit] * (-1.0 if speed.reversed else 1.0)
    if speed.relative_to:
        other = _speed(columns, mapping, speed.relative_to)
        return None if other is None else values + other
    return values


def find_by_values(
    draft: Draft, time: TimeColumn, speeds: Sequence[Column]
) -> tuple[Column, Column, Column, str, float] | None:
    """Find two speeds and a gap whose rate of change is their difference.

    Returns:
        Columns of the speed ahead, the speed behind and the gap, the unit of the speeds, and the
        slope in it.
    """
    seconds = seconds_of(draft, time)
    if seconds is None:
        return None
    free = []
    for column in draft.columns:
        quantity = column.name.quantity
        # A symbol as "v_p" excludes nothing.
        may_be_any = quantity in ("", "speed", "gap")
        may_be_any |= quantity == "position" and column.name.is_symbol
        is_free = column.text not in draft.choices and column.varies
        if is_free and column.numbers is not None and may_be_any:
            free.append(column)
    best: tuple[float, Column, Column, Column, str, float] | None = None
    for ahead, behind, gap in permutations(free[:MOST_TRIED], 3):
        if gap in speeds or (len(speeds) > 1 and not {ahead, behind} <= set(speeds)):
            continue
        a, b, p = ahead.numbers, behind.numbers, gap.numbers
        if a is None or b is None or p is None:
            continue
        agreement = _agreement(seconds, a, b, p)
        if agreement is None or agreement[1] < (best[0] if best else SURE):
            continue
        gap_factor = GAP_UNITS[gap.name.length_unit or "m"]
        named = {c.name.speed_unit for c in (ahead, behind)} - {""}
        ratio = agreement[0] * gap_factor
        units = named if len(named) == 1 else SPEED_UNITS
        unit = min(units, key=lambda unit: abs(np.log(ratio / SPEED_UNITS[unit])))
        if abs(np.log(ratio / SPEED_UNITS[unit])) < np.log1p(FITS):
            best = (agreement[1], ahead, behind, gap, unit, ratio / SPEED_UNITS[unit])
    return best[1:] if best else None


def _agreement(
    time: FloatArray, ahead: FloatArray, behind: FloatArray, gap: FloatArray
) -> tuple[float, float] | None:
    """The ratio of a gap's changes to those by two speeds, if of equal sign, and the correlation.

    Of a recording too short for a slope with an error the gap itself is compared with the integral.
    """
    slope = slope_of(time, ahead, behind, gap)
    if slope:
        return (slope.middle, slope.correlation) if slope.middle > 0 else None
    difference = ahead - behind
    driven = np.concatenate(
        ([0.0], np.cumsum((difference[1:] + difference[:-1]) / 2 * np.diff(time)))
    )
    is_known = np.isfinite(driven) & np.isfinite(gap)
    if is_known.sum() < MINIMUM_SAMPLES or not driven[is_known].std() or not gap[is_known].std():
        return None
    correlation = float(np.corrcoef(driven[is_known], gap[is_known])[0, 1])
    if correlation <= 0 or gap[is_known].min() <= 0:
        return None
    return float(gap[is_known].std() / driven[is_known].std()), correlation


def proposal_of_values(
    draft: Draft,
    time: TimeColumn,
    ahead: Column,
    behind: Column,
    gap: Column,
    unit: str,
    slope: float,
) -> Proposal:
    """The proposal of three columns that fit together."""
    mapping = CsvMapping(
        (SpeedColumn(ahead.text, unit), SpeedColumn(behind.text, unit)),
        (GapColumn(gap.text, gap.name.length_unit or "m"),), time,
    )  # fmt: skip
    why = f'"{gap.text}" changes {slope:.2f} times as fast as "{ahead.text}" - "{behind.text}"'
    for name, role, channel_unit in roles_of(mapping)[1:]:
        column = next(c for c in draft.columns if c.text == name)
        draft.choose(column, role, channel_unit, why, is_supported=False, is_by_values=True)
    draft.undecided.append(f"Confirm the columns of speeds and gap: {why}.")
    return draft.finished(mapping)


def units_by_vehicle(
    draft: Draft, mapping: CsvMapping, columns: dict[str, Column], rows: Mask
) -> tuple[CsvMapping, str, bool]:
    """The mapping in the units in which a vehicle's position changes by its speed."""
    speed, gap = mapping.speeds[0], mapping.gaps[0]
    is_named = columns[speed.column].name.speed_unit
    position = columns[gap.column].numbers if gap.minus else None
    values = columns[speed.column].numbers
    if is_named:
        return mapping, "as the speed's", True
    if (
        position is None
        or values is None
        or mapping.time is None
        or mapping.time.unit == clocks.FRAME
    ):
        return mapping, "no unit is named", False
    cells = [
        cell for cell, is_of in zip(columns[mapping.time.column].cells, rows, strict=True) if is_of
    ]
    try:
        seconds = clocks.seconds(cells, mapping.time.unit, columns[mapping.time.column].decimal)
    except clocks.TimeUnreadable:
        return mapping, "no unit is named", False
    unit, reason, is_supported = _unit_by_way(
        seconds, values[rows], position[rows] * GAP_UNITS[gap.unit]
    )
    return replace(mapping, speeds=(replace(speed, unit=unit),)), reason, is_supported
