"""What the columns of a table hold: a mapping, proposed with a reason for each choice.

A choice is supported where the column's name, its unit or the published layout of a data set says
it, or where the data do: units by the equation

    dp/dt = v_ahead - v_behind

which holds in one combination of units only. What nothing supports is proposed, if at all, to be
confirmed by a person, and never read unasked.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise, permutations

import numpy as np
from msgspec.structs import replace

from accpinn.channels import MAX_VEHICLES
from accpinn.findings import joined
from accpinn.recordings import MOVING, clocks, consistency
from accpinn.recordings.layouts import published_layout
from accpinn.recordings.mapping import (
    ByVehicle,
    CsvMapping,
    GapColumn,
    ModeColumn,
    SpeedColumn,
    TimeColumn,
)
from accpinn.recordings.names import FOLLOWER, LEADER, ColumnName
from accpinn.recordings.source import SourceFile
from accpinn.recordings.tables import MINIMUM_SAMPLES, Layout, first_cells, numbers_of
from accpinn.units import GAP_UNITS, SPEED_UNITS, FloatArray, Mask, Seconds

ROWS = 20_000
"""Rows that a proposal looks at."""
FEW_WORDS = 12
"""Most different words of a column that says who drives."""
MOST_TRIED = 8
"""Columns among which speeds and gap are sought by their values alone."""
NO_TIMES = frozenset(("ignored", "speed", "gap", "relative", "acceleration", "position", "length"))
"""Quantities that columns of time do not hold."""
USUAL_TIME_GAP: tuple[Seconds, Seconds] = (0.75, 3.0)
"""Time gaps in following that support units which nothing else tells."""
SURE = 0.9
"""Least correlation of a gap's changes with those that two speeds demand, to tell all three."""
UNNAMED_SPEEDS = {False: ("m/s", "km/h", "mph"), True: ("ft/s", "mph")}
"""Units of speeds that nobody names, beside gaps in m, and beside gaps in ft."""
FITS = 0.12
"""Largest relative deviation of the slope from 1 in units that the data support."""
TURNED_ON = frozenset(("1", "true", "acc", "on", "auto", "automated", "engaged", "active", "yes"))
TURNED_OFF = frozenset(("0", "false", "human", "off", "manual", "driver", "inactive", "no"))
"""Words, in small letters, for driving under ACC and by hand."""


@dataclass(frozen=True)
class Choice:
    """What one column is taken for."""

    column: str
    cells: tuple[str, ...]
    """Its first cells."""
    role: str = ""
    """As "time" or "gap of vehicle 2"; empty for a column that is not used."""
    unit: str = ""
    reason: str = ""
    """Why, in a few words."""
    is_supported: bool = True
    """Whether name, unit, layout or data say so."""
    is_by_values: bool = False
    """Whether nothing but the column's values tells the role, so that this is to be confirmed."""


@dataclass(frozen=True)
class Proposal:
    """What the columns of a table are taken for."""

    choices: tuple[Choice, ...]
    """One a column, in the table's order."""
    mapping: CsvMapping
    """The mapping; a column that could not be found has an empty name in it."""
    undecided: tuple[str, ...] = ()
    """What a person has to decide, a sentence each."""

    @property
    def is_supported(self) -> bool:
        """Whether something supports every choice, so that the table may be read unasked."""
        return not self.undecided

    @property
    def summary(self) -> str:
        """The choices as one sentence has them."""
        used = [choice for choice in self.choices if choice.role]
        return ", ".join(
            f'"{choice.column}" {choice.role}' + (f" [{choice.unit}]" if choice.unit else "")
            for choice in used
        )


@dataclass(frozen=True, eq=False)
class _Column:
    """A column and its first cells."""

    name: ColumnName
    cells: Sequence[str]
    decimal: str

    @property
    def text(self) -> str:
        return self.name.name

    @cached_property
    def numbers(self) -> FloatArray | None:
        """(N,) the numbers, nan where a cell is missing; None where there is none or a word."""
        return numbers_of(self.cells, self.decimal)

    @cached_property
    def words(self) -> frozenset[str]:
        return frozenset(cell for cell in self.cells if cell)

    @cached_property
    def varies(self) -> bool:
        first = next((cell for cell in self.cells if cell), "")
        return any(cell and cell != first for cell in self.cells)

    def is_copy(self, other: "_Column") -> bool:
        """Whether both hold the same cells."""
        return list(self.cells) == list(other.cells)


@dataclass
class _Draft:
    """The choices made so far."""

    columns: Sequence[_Column]
    choices: dict[str, Choice] = field(default_factory=dict)
    undecided: list[str] = field(default_factory=list)

    def choose(
        self, column: _Column, role: str, unit: str, reason: str, is_supported: bool = True,
        is_by_values: bool = False,
    ) -> None:  # fmt: skip
        self.choices[column.text] = Choice(
            column.text, tuple(column.cells[:3]), role, unit, reason, is_supported, is_by_values
        )

    def pass_over(self, column: _Column, reason: str) -> None:
        self.choose(column, "", "", reason)

    def of(self, quantity: str) -> list[_Column]:
        """Columns of numbers without a choice whose names say the quantity.

        One that is the same in every row counts only where fewer than two others are there.
        """
        columns = [
            column
            for column in self.columns
            if column.text not in self.choices
            and column.name.quantity == quantity
            and column.numbers is not None
        ]
        varying = [column for column in columns if column.varies]
        return varying if len(varying) > 1 or len(columns) > 2 else columns

    def finished(self, mapping: CsvMapping) -> Proposal:
        rest = [column for column in self.columns if column.text not in self.choices]
        for column in rest:
            quantity = column.name.quantity
            reason = f"{quantity}, not needed" if quantity not in ("", "ignored") else "not needed"
            self.pass_over(column, reason if column.varies else "the same in every row")
        choices = tuple(self.choices[column.text] for column in self.columns)
        return Proposal(choices, mapping, tuple(dict.fromkeys(self.undecided)))


def proposed(source_file: SourceFile, layout: Layout) -> Proposal:
    """What the columns of a table hold.

    Raises:
        RecordingError: when its rows cannot be split into cells.
    """
    units = (*layout.units, *[""] * len(layout.names))
    cells = first_cells(source_file, layout, ROWS)
    columns = [
        _Column(ColumnName(name, unit), column, layout.decimal)
        for name, unit, column in zip(layout.names, units, cells, strict=False)
    ]
    draft = _Draft(columns)
    if known := published_layout(layout.names):
        return _published(draft, *known)
    for k, column in enumerate(columns):
        twin = next((c for c in columns[:k] if column.varies and column.is_copy(c)), None)
        if twin:
            draft.pass_over(column, f'a copy of "{twin.text}"')
    by = _by_vehicle(draft)
    return _long(draft, by) if by else _wide(draft)


def _published(draft: _Draft, title: str, mapping: CsvMapping) -> Proposal:
    """The mapping of a published data set, whose column names are the table's."""
    columns = {column.text: column for column in draft.columns}
    for name, role, unit in roles_of(mapping):
        draft.choose(columns[name], role, unit, f"{title}, as published")
    return draft.finished(mapping)


def roles_of(mapping: CsvMapping) -> list[tuple[str, str, str]]:
    """Column, role and unit of all that a mapping names."""
    roles = []
    time, by = mapping.time, mapping.by
    if time:
        roles.append((time.column, "time", time.unit))
        roles += [(time.date, "date", "")] if time.date else []
        roles += [(time.nanoseconds, "nanoseconds", "ns")] if time.nanoseconds else []
    if by:
        roles.append((by.vehicle, "vehicle", ""))
        roles += [(by.leader, "vehicle ahead", "")] if by.leader else []
        roles += [(by.lane, "lane", "")] if by.lane else []
        roles += [(by.position, "position", "m")] if by.position else []
    roles += [(mapping.trajectory, "run", "")] if mapping.trajectory else []
    for k, speed in enumerate(mapping.speeds, 1):
        role = "speed" if by else f"speed of vehicle {k}"
        if speed.relative_to:
            role = f"speed of vehicle {k} less that of vehicle {speed.relative_to}"
        roles.append((speed.column, role, speed.unit))
    for k, gap in enumerate(mapping.gaps, 2):
        if not gap.minus:
            roles.append((gap.column, "gap" if by else f"gap of vehicle {k}", gap.unit))
        else:
            roles.append(
                (gap.column, "position" if by else f"position of vehicle {k - 1}", gap.unit)
            )
            roles.append((gap.minus, "position" if by else f"position of vehicle {k}", gap.unit))
        if isinstance(gap.subtract, str):
            roles.append((gap.subtract, "length", gap.unit))
    roles += [(m.column, f"driver mode of vehicle {m.vehicle}", "") for m in mapping.modes]
    return list(dict.fromkeys(roles))


# Time


def _time(draft: _Draft, rows: Mask | None = None) -> tuple[TimeColumn | None, float | None]:
    """The column of time, and its step where it counts frames; of some rows alone if given."""
    candidates = []
    for column in draft.columns:
        if column.text in draft.choices or not column.varies or column.name.quantity in NO_TIMES:
            continue
        cells = column.cells
        if rows is not None:
            cells = [cell for cell, is_of in zip(cells, rows, strict=True) if is_of]
        name = column.text if not column.name.unit_cell else f"{column.text} [{column.name.unit}]"
        recognised = clocks.recognised(name, cells, column.decimal)
        if recognised:
            candidates.append((column, recognised))
    if not candidates:
        draft.undecided.append("Choose the column of time, or even steps.")
        return None, None
    candidates.sort(key=lambda candidate: (
        not candidate[1].supported, candidate[1].form == clocks.FRAME, not candidate[1].by_name,
    ))  # fmt: skip
    column, recognised = candidates[0]
    nanoseconds = _nanoseconds(draft, column) if recognised.form == "s" else ""
    for other, _ in candidates[1:]:
        if other.text == nanoseconds:
            continue
        draft.pass_over(other, f'"{column.text}" is the time')
    step = None
    if recognised.form == clocks.FRAME:
        draft.undecided.append(f'Give the time between two frames of "{column.text}".')
        step = 0.1
    draft.choose(column, "time", recognised.form, recognised.reason, recognised.supported)
    if not recognised.supported:
        draft.undecided.append(f'Confirm the unit of time "{column.text}": {recognised.reason}.')
    date = ""
    if recognised.form == "clock":
        dates = (c for c in draft.columns if c.text not in draft.choices and _is_date(c))
        if day := next(dates, None):
            draft.choose(day, "date", "", "dates beside a clock")
            date = day.text
    return TimeColumn(column.text, recognised.form, date, nanoseconds), step


def _nanoseconds(draft: _Draft, seconds: _Column) -> str:
    """The column of nanoseconds beside whole seconds; empty where there is none."""
    values = seconds.numbers
    if values is None or not (values == np.rint(values)).all():
        return ""
    for column in draft.columns:
        numbers = column.numbers
        if column is seconds or column.text in draft.choices or numbers is None:
            continue
        if clocks.is_fraction(column.text, numbers):
            draft.choose(column, "nanoseconds", "ns", "nanoseconds beside whole seconds")
            return column.text
    return ""


def _is_date(column: _Column) -> bool:
    return column.name.quantity == "date" and all(":" not in cell for cell in column.words)


# One row an instant of all vehicles


def _wide(draft: _Draft) -> Proposal:
    time, step = _time(draft)
    trajectory = _runs(draft, time)
    speeds, relative = _speeds(draft)
    positions: list[_Column] = []
    gaps = _gaps(draft, len(speeds) + bool(relative) - 1)
    if not speeds and not relative:
        speeds, gaps = _in_order_of_gaps(draft)
    if not gaps and speeds:
        positions = _in_order(draft.of("position"), len(speeds) + bool(relative))
    found = bool(gaps or positions)
    if not found and not relative and time and time.unit != clocks.FRAME:
        triple = _by_values(draft, time, speeds)
        if triple:
            return _from_values(draft, time, *triple)
    if not speeds or len(speeds) + bool(relative) < 2:
        draft.undecided.append("Choose the columns with the speeds of leader and follower.")
    count = max(2, len(speeds) + bool(relative))
    if not found:
        followers = [str(k) for k in range(2, count + 1)]
        draft.undecided.append(f"Choose the column with the gap of vehicle {joined(followers)}.")
    mapping = _assembled(draft, count, speeds, relative, gaps, positions)
    mapping = replace(mapping, time=time, sample_time=step, trajectory=trajectory)
    mapping = _with_units(draft, mapping, found and bool(speeds))
    return draft.finished(replace(mapping, modes=_modes(draft, mapping, speeds)))


def _speeds(draft: _Draft) -> tuple[list[_Column], _Column | None]:
    """Speeds in the order of the vehicles, and a relative one where only one other is there."""
    speeds = draft.of("speed")
    relative = draft.of("relative")
    if len(speeds) == 1 and len(relative) == 1:
        return speeds, relative[0]
    return _in_order(speeds, positions=draft.of("position")), None


def _in_order(
    columns: Sequence[_Column], count: int | None = None, positions: Sequence[_Column] = ()
) -> list[_Column]:
    """Columns of one quantity in the order of the vehicles; none where nothing says it.

    Names say it, or of two vehicles the positions.
    """
    leaders = [c for c in columns if c.name.whose == LEADER]
    followers = [c for c in columns if c.name.whose == FOLLOWER]
    others = [c for c in columns if not c.name.whose]
    ordered: list[_Column] = []
    if len(leaders) == 1 and not others and len(followers) == 1:
        ordered = [*leaders, *followers]
    elif len(leaders) == 1 and not others and all(c.name.number is not None for c in followers):
        ordered = [*leaders, *sorted(followers, key=_number)]
    elif (
        len(leaders) == 1
        and not followers
        and (len(others) == 1 or all(c.name.number is not None for c in others))
    ):
        ordered = [*leaders, *sorted(others, key=_number)]
    elif len(followers) == 1 and len(others) == 1 and not leaders:
        ordered = [*others, *followers]
    elif not leaders and not followers and all(c.name.number is not None for c in others):
        ordered = sorted(others, key=_number)
    elif len(columns) == 2:
        ordered = _by_positions(columns, positions)
    if len({_number(c) for c in ordered[1:]}) < len(ordered) - 1:
        return []
    return ordered if count in (None, len(ordered)) and len(ordered) <= MAX_VEHICLES else []


def _in_order_of_gaps(draft: _Draft) -> tuple[list[_Column], list[_Column]]:
    """Speeds and gaps of a platoon in which each gap names the two vehicles, the one ahead first.

    As of "Audi speed", "BMW speed" and "gap Audi-BMW"; none where the names say anything else.
    """
    speeds, gaps = draft.of("speed"), draft.of("gap")
    if len(speeds) != len(gaps) + 1 or len(speeds) < 2:
        return [], []
    words = [{*speed.name.parts} for speed in speeds]
    own = [these.difference(*words[:k], *words[k + 1 :]) for k, these in enumerate(words)]
    behind: dict[int, tuple[int, _Column]] = {}
    for gap in gaps:
        named = [k for part in gap.name.parts for k, names in enumerate(own) if part in names]
        pair = list(dict.fromkeys(named))
        if len(pair) != 2 or pair[0] in behind:
            return [], []
        behind[pair[0]] = pair[1], gap
    first = {*behind} - {follower for follower, _ in behind.values()}
    if len(first) != 1:
        return [], []
    order, ordered = [first.pop()], list[_Column]()
    while order[-1] in behind:
        follower, gap = behind[order[-1]]
        order.append(follower)
        ordered.append(gap)
    complete = len(order) == len(speeds)
    return ([speeds[k] for k in order], ordered) if complete else ([], [])


def _by_positions(columns: Sequence[_Column], positions: Sequence[_Column]) -> list[_Column]:
    """Two columns, that of the vehicle first whose position is ahead; none where none says it."""
    first, second = ({*column.name.parts} for column in columns)
    found = []
    for words in (first - second, second - first):
        of_vehicle = [p for p in positions if words & {*p.name.parts}]
        if len(of_vehicle) != 1 or of_vehicle[0].numbers is None:
            return []
        found.append(of_vehicle[0].numbers)
    ahead = found[0] - found[1]
    if (ahead > 0).all():
        return list(columns)
    return list(reversed(columns)) if (ahead < 0).all() else []


def _number(column: _Column) -> int:
    return column.name.number if column.name.number is not None else -1


def _gaps(draft: _Draft, count: int) -> list[_Column]:
    """Gaps in the order of the followers; none where the names do not single them out."""
    if count < 1:
        return []
    candidates = draft.of("gap")
    sure = [column for column in candidates if column.name.is_sure_gap]
    for gaps in (sure, candidates):
        if len(gaps) == count and (count == 1 or all(c.name.number is not None for c in gaps)):
            ordered = sorted(gaps, key=_number)
            if len(set(map(_number, ordered))) == count:
                return ordered
    return []


def _assembled(
    draft: _Draft,
    count: int,
    speeds: Sequence[_Column],
    relative: _Column | None,
    gaps: Sequence[_Column],
    positions: Sequence[_Column],
) -> CsvMapping:
    """The mapping of chosen columns, in the units that their names say or else the package's."""
    columns: list[SpeedColumn] = [SpeedColumn(c.text, c.name.speed_unit or "m/s") for c in speeds]
    if relative:
        columns = _with_relative(draft, speeds[0], relative)
    columns += [SpeedColumn("")] * (count - len(columns))
    gap_columns = [GapColumn(c.text, c.name.length_unit or "m") for c in gaps]
    if positions:
        length = _length(draft, count)
        gap_columns = [
            GapColumn(ahead.text, ahead.name.length_unit or "m", length, minus=behind.text)
            for ahead, behind in pairwise(positions)
        ]
    gap_columns += [GapColumn("")] * (count - 1 - len(gap_columns))
    return CsvMapping(tuple(columns), tuple(gap_columns))


def _length(draft: _Draft, vehicles: int) -> float | str:
    """The column of the length of the vehicle ahead; 0, and a question, without one."""
    lengths = [c for c in draft.columns if c.name.quantity == "length" and c.numbers is not None]
    of_leader = [c for c in lengths if c.name.whose == LEADER]
    lengths = of_leader or [c for c in lengths if not c.name.whose]
    if len(lengths) == 1 and vehicles == 2:
        draft.choose(lengths[0], "length", lengths[0].name.length_unit or "m", "named length")
        return lengths[0].text
    draft.undecided.append(
        "Give the length of the vehicle ahead: a difference of positions contains it."
    )
    return 0.0


def _with_relative(draft: _Draft, speed: _Column, relative: _Column) -> list[SpeedColumn]:
    """Speeds of leader and follower, one of which is relative to the other."""
    unit = speed.name.speed_unit or "m/s"
    difference_unit = relative.name.speed_unit or unit
    is_closing = "closing" in relative.name.words
    if speed.name.whose == LEADER:
        return [
            SpeedColumn(speed.text, unit),
            SpeedColumn(relative.text, difference_unit, relative_to=1, reversed=not is_closing),
        ]
    return [
        SpeedColumn(relative.text, difference_unit, relative_to=2, reversed=is_closing),
        SpeedColumn(speed.text, unit),
    ]


# Units


def _with_units(draft: _Draft, mapping: CsvMapping, is_complete: bool) -> CsvMapping:
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
        why = f"named {_named(column)}; {unit}: {reason if name in unnamed else by_name}"
        draft.choose(column, role, unit, why, is_supported or name not in unnamed)
    if unnamed and is_complete and not is_supported:
        listed = joined([f'"{name}"' for name in unnamed])
        draft.undecided.append(f"Confirm the units of {listed}: {reason}.")
    return mapping


def _named(column: _Column) -> str:
    """What the name says the column is."""
    whose = f" of the {column.name.whose}" if column.name.whose else ""
    return f"{column.name.quantity or 'so'}{whose}"


def _units_of_data(
    draft: _Draft, mapping: CsvMapping, unnamed: Sequence[str]
) -> tuple[CsvMapping, str, bool]:
    """The mapping in the units in which the gaps change as the speeds demand.

    Only the ``unnamed`` columns may change theirs. Returns the reason as well, and whether the data
    determine the units.
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
    error = slopes[0].error / slope
    close = max(consistency.SLOPE_TOLERANCE, consistency.SURE * error)
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
    reason = "the gap changes as the speeds demand"
    if others:
        reason = f"{joined([speed_unit or gap_unit, *others])} fit the gap's changes"
    return mapping, reason, not others


def _units_of_positions(
    draft: _Draft, mapping: CsvMapping, unnamed: Sequence[str]
) -> tuple[CsvMapping, str, bool]:
    """The mapping in the units in which the position of the vehicle ahead changes as its speed."""
    columns = {column.text: column for column in draft.columns}
    time, speed, gap = _seconds(draft, mapping.time), mapping.speeds[0], mapping.gaps[0]
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


def _usual_time_gap(draft: _Draft, mapping: CsvMapping) -> tuple[str, bool]:
    """Whether the time gap is a usual one in the mapping's units, where the slope says nothing.

    Speeds in km/h, mph, ft/s or knots taken as m/s make it a half or less.
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


def _slopes(draft: _Draft, mapping: CsvMapping) -> list[consistency.Slope]:
    """How fast each gap changes as compared with the speeds, as the mapping has them."""
    columns = {column.text: column for column in draft.columns}
    time = _seconds(draft, mapping.time)
    if time is None:
        return []
    slopes = []
    for k, gap in enumerate(mapping.gaps, 1):
        ahead, behind = (_speed(columns, mapping, v) for v in (k, k + 1))
        values = _gap(columns, gap)
        if ahead is None or behind is None or values is None:
            continue
        slope = consistency.slope_of(time, ahead, behind, values)
        if slope:
            slopes.append(slope)
    return sorted(slopes, key=lambda slope: slope.error)


def _gap(columns: dict[str, _Column], gap: GapColumn) -> FloatArray | None:
    """A gap, or difference of positions, in m; None where cells are no numbers."""
    values = columns[gap.column].numbers
    if gap.minus and values is not None:
        own = columns[gap.minus].numbers
        values = None if own is None else values - own
    return None if values is None else values * GAP_UNITS[gap.unit]


def _speed(columns: dict[str, _Column], mapping: CsvMapping, vehicle: int) -> FloatArray | None:
    speed = mapping.speeds[vehicle - 1]
    numbers = columns[speed.column].numbers
    if numbers is None:
        return None
    values = numbers * SPEED_UNITS[speed.unit] * (-1.0 if speed.reversed else 1.0)
    if speed.relative_to:
        other = _speed(columns, mapping, speed.relative_to)
        return None if other is None else values + other
    return values


def _seconds(draft: _Draft, time: TimeColumn | None) -> FloatArray | None:
    """The time of the first rows in s, as far as it increases; None where it does not."""
    if time is None or time.unit == clocks.FRAME:
        return None
    columns = {column.text: column for column in draft.columns}
    column = columns[time.column]
    dates = columns[time.date].cells if time.date else None
    try:
        seconds = clocks.seconds(column.cells, time.unit, column.decimal, dates)
        if time.nanoseconds:
            seconds += clocks.seconds(columns[time.nanoseconds].cells, "ns", column.decimal)
    except clocks.TimeUnreadable:
        return None
    seconds, _ = clocks.unwrapped(seconds)
    is_sound = len(seconds) > 2 and bool((np.diff(seconds) > 0).all())
    return seconds if is_sound else None


# Roles by values alone


def _by_values(
    draft: _Draft, time: TimeColumn, speeds: Sequence[_Column]
) -> tuple[_Column, _Column, _Column, str, float] | None:
    """Two speeds and a gap whose rate of change is their difference, and its slope.

    Returns:
        Columns of the speed ahead, the speed behind and the gap, the unit of the speeds, and the
        slope in it.
    """
    seconds = _seconds(draft, time)
    if seconds is None:
        return None
    free = [c for c in draft.columns if c.text not in draft.choices and c.varies]
    free = [c for c in free if c.numbers is not None and _may_be_any(c)]
    best: tuple[float, _Column, _Column, _Column, str, float] | None = None
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


def _may_be_any(column: _Column) -> bool:
    """Whether a name leaves open what a column holds, or says a speed or gap; "v_p" is no more."""
    quantity = column.name.quantity
    return quantity in ("", "speed", "gap") or (quantity == "position" and column.name.is_symbol)


def _agreement(
    time: FloatArray, ahead: FloatArray, behind: FloatArray, gap: FloatArray
) -> tuple[float, float] | None:
    """How fast a gap changes as compared with two speeds, if in their sense, and correlation.

    Of a recording too short for a slope with an error the gap itself is compared with the integral.
    """
    slope = consistency.slope_of(time, ahead, behind, gap)
    if slope:
        return (slope.middle, slope.correlation) if slope.middle > 0 else None
    difference = ahead - behind
    driven = np.concatenate(
        ([0.0], np.cumsum((difference[1:] + difference[:-1]) / 2 * np.diff(time)))
    )
    known = np.isfinite(driven) & np.isfinite(gap)
    if known.sum() < MINIMUM_SAMPLES or not driven[known].std() or not gap[known].std():
        return None
    correlation = float(np.corrcoef(driven[known], gap[known])[0, 1])
    if correlation <= 0 or gap[known].min() <= 0:
        return None
    return float(gap[known].std() / driven[known].std()), correlation


def _from_values(
    draft: _Draft,
    time: TimeColumn,
    ahead: _Column,
    behind: _Column,
    gap: _Column,
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


# One row a vehicle and instant


def _by_vehicle(draft: _Draft) -> ByVehicle | None:
    """The columns that tell vehicles apart, where several vehicles have rows of their own."""
    ids = [
        c for c in draft.columns
        if c.name.quantity == "id" and c.varies and c.text not in draft.choices
        and len(c.words) <= len(c.cells) / 2
    ]  # fmt: skip
    # The one ahead may be the same in all rows, as in a table of one pair.
    leaders = [c for c in draft.columns if c.name.quantity == "id" and c.name.whose == LEADER]
    vehicles = [c for c in ids if not c.name.whose and c not in leaders]
    lanes = [c for c in draft.columns if c.name.quantity == "lane"]
    positions = draft.of("position")
    if len(vehicles) != 1 or len(draft.of("speed")) != 1:
        return None
    [vehicle] = vehicles
    if not leaders and not positions:
        return None
    draft.choose(vehicle, "vehicle", "", "named vehicle; several share the instants")
    if len(leaders) == 1:
        draft.choose(leaders[0], "vehicle ahead", "", "named vehicle ahead")
        return ByVehicle(vehicle.text, leaders[0].text)
    if len(positions) == 1:
        lane = lanes[0].text if len(lanes) == 1 else ""
        if lane:
            draft.choose(lanes[0], "lane", "", "named lane")
        return ByVehicle(vehicle.text, lane=lane, position=positions[0].text)
    del draft.choices[vehicle.text]
    return None


def _long(draft: _Draft, by: ByVehicle) -> Proposal:
    columns = {column.text: column for column in draft.columns}
    run = next((c for c in draft.columns if c.name.quantity == "run" and c.varies), None)
    if run:
        draft.choose(run, "run", "", "named run")
    cells = np.array(columns[by.vehicle].cells, object)
    rows: Mask = cells == max(set(cells.tolist()), key=cells.tolist().count)
    if run:
        names = np.array(run.cells, object)
        rows &= names == names[np.flatnonzero(rows)[0]]
    time, step = _time(draft, rows)
    [speed] = draft.of("speed")
    gaps = [c for c in draft.of("gap") if c.name.is_sure_gap] or draft.of("gap")
    positions = draft.of("position")
    if by.position:
        positions = [columns[by.position]]
    if len(gaps) == 1:
        gap = GapColumn(gaps[0].text, gaps[0].name.length_unit or "m")
    elif len(positions) == 1:
        length = _length(draft, 2)
        unit = positions[0].name.length_unit or "m"
        gap = GapColumn(positions[0].text, unit, length, minus=positions[0].text)
    else:
        gap = GapColumn("")
        draft.undecided.append("Choose the column with the gap, or with the position.")
    mapping = CsvMapping(
        (SpeedColumn(speed.text, speed.name.speed_unit or "m/s"),), (gap,), time, step,
        trajectory=run.text if run else None, by=by,
    )  # fmt: skip
    mapping, reason, is_supported = _long_units(draft, mapping, columns, rows)
    for name, role, unit in roles_of(mapping):
        if name and name not in draft.choices:
            column = columns[name]
            has_unit = column.name.speed_unit if role == "speed" else column.name.length_unit
            why = f"named {column.name.quantity}; {unit}: " + (
                "the name says so" if has_unit else reason
            )
            draft.choose(column, role, unit, why, bool(has_unit) or is_supported)
    if not is_supported:
        draft.undecided.append(f"Confirm the units of speeds and gaps: {reason}.")
    return draft.finished(mapping)


def _long_units(
    draft: _Draft, mapping: CsvMapping, columns: dict[str, _Column], rows: Mask
) -> tuple[CsvMapping, str, bool]:
    """The mapping in the units in which a vehicle's position changes as its speed says."""
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


# Runs and drivers


def _runs(draft: _Draft, time: TimeColumn | None) -> str | None:
    """The column that tells runs apart, where each begins anew."""
    for column in draft.columns:
        if column.text in draft.choices or column.name.quantity not in ("run", "id"):
            continue
        changes = sum(a != b for a, b in pairwise(column.cells)) + 1
        if column.varies and changes == len(column.words) <= len(column.cells) / 10:
            draft.choose(column, "run", "", "named run; its rows lie together")
            return column.text
    return None


def _modes(draft: _Draft, mapping: CsvMapping, speeds: Sequence[_Column]) -> tuple[ModeColumn, ...]:
    """Columns that say who drives, by their names and words."""
    modes = list[ModeColumn]()
    for column in draft.columns:
        if column.text in draft.choices or column.name.quantity != "mode":
            continue
        words = {word.casefold().removesuffix(".0"): word for word in column.words}
        if len(words) > FEW_WORDS or not words or not set(words) <= TURNED_ON | TURNED_OFF:
            continue
        if set(words) == {"0"} and "acc" in column.name.parts:  # an acceleration of a steady drive
            continue
        vehicle = _vehicle_of(column, mapping, speeds)
        if vehicle is None or any(mode.vehicle == vehicle for mode in modes):
            continue
        acc = [word for low, word in words.items() if low in TURNED_ON] or ["1"]
        human = [word for low, word in words.items() if low in TURNED_OFF] or ["0"]
        modes.append(ModeColumn(vehicle, column.text, tuple(sorted(acc)), tuple(sorted(human))))
        draft.choose(column, f"driver mode of vehicle {vehicle}", "", "named so; holds two words")
    return tuple(modes)


def _vehicle_of(column: _Column, mapping: CsvMapping, speeds: Sequence[_Column]) -> int | None:
    """The vehicle that a column is about, by its name."""
    for vehicle, speed in enumerate(speeds, 1):
        if column.name.whose and column.name.whose == speed.name.whose:
            return vehicle
        if column.name.number is not None and column.name.number == speed.name.number:
            return vehicle
    if not column.name.whose and column.name.number is None and len(mapping.speeds) == 2:
        return 2
    return None
