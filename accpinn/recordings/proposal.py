"""A mapping of a table's columns, proposed with a reason for each choice.

A choice is supported by the column's name, its unit or the published layout of a data set, or by
the data: units by the equation

    dp/dt = v_ahead - v_behind

which holds in one combination of units only. A choice without support is proposed, if at all, to be
confirmed by a person, and the table is not read before.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from accpinn.channels import MAX_VEHICLES
from accpinn.findings import joined
from accpinn.recordings import clocks
from accpinn.recordings.data_sets import published_layout
from accpinn.recordings.draft import Column, Draft, Proposal, roles_of, time_of
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
from accpinn.recordings.table_layout import Layout
from accpinn.recordings.tables import first_cells
from accpinn.recordings.unit_evidence import (
    find_by_values,
    proposal_of_values,
    units_by_vehicle,
    with_units,
)
from accpinn.units import Mask

ROWS = 20_000
"""Rows that a proposal looks at."""
FEW_WORDS = 12
"""Most different words of a column of driver modes."""
TURNED_ON = frozenset(("1", "true", "acc", "on", "auto", "automated", "engaged", "active", "yes"))
TURNED_OFF = frozenset(("0", "false", "human", "off", "manual", "driver", "inactive", "no"))
"""Words, in small letters, for driving under ACC and by hand."""


def proposed(source_file: SourceFile, layout: Layout) -> Proposal:
    """Propose a mapping of a table's columns.

    Raises:
        RecordingError: when its rows cannot be split into cells.
    """
    units = (*layout.units, *[""] * len(layout.names))
    cells = first_cells(source_file, layout, ROWS)
    columns = [
        Column(ColumnName(name, unit), column, layout.decimal)
        for name, unit, column in zip(layout.names, units, cells, strict=False)
    ]
    draft = Draft(columns)
    if data_set := published_layout(layout.names):
        title, mapping = data_set
        by_name = {column.text: column for column in columns}
        for name, role, unit in roles_of(mapping):
            draft.choose(by_name[name], role, unit, f"{title}, as published")
        return draft.finished(mapping)
    for k, column in enumerate(columns):
        twin = next((c for c in columns[:k] if column.varies and column.is_copy(c)), None)
        if twin:
            draft.pass_over(column, f'a copy of "{twin.text}"')
    by = _by_vehicle(draft)
    return _long(draft, by) if by else _wide(draft)


# One row an instant of all vehicles


def _wide(draft: Draft) -> Proposal:
    time, step = time_of(draft)
    trajectory = _runs(draft, time)
    speeds, relative = draft.of("speed"), None
    if len(speeds) == 1 and len(draft.of("relative")) == 1:
        [relative] = draft.of("relative")
    else:
        speeds = _in_order(speeds, positions=draft.of("position"))
    positions: list[Column] = []
    gaps = _gaps(draft, len(speeds) + bool(relative) - 1)
    if not speeds and not relative:
        speeds, gaps = _in_order_of_gaps(draft)
    if not gaps and speeds:
        positions = _in_order(draft.of("position"), len(speeds) + bool(relative))
    has_gaps = bool(gaps or positions)
    if not has_gaps and not relative and time and time.unit != clocks.FRAME:
        triple = find_by_values(draft, time, speeds)
        if triple:
            return proposal_of_values(draft, time, *triple)
    if not speeds or len(speeds) + bool(relative) < 2:
        draft.undecided.append("Choose the columns with the speeds of leader and follower.")
    count = max(2, len(speeds) + bool(relative))
    if not has_gaps:
        followers = [str(k) for k in range(2, count + 1)]
        draft.undecided.append(f"Choose the column with the gap of vehicle {joined(followers)}.")
    mapping = _assembled(draft, count, speeds, relative, gaps, positions)
    mapping = replace(mapping, time=time, sample_time=step, trajectory=trajectory)
    mapping = with_units(draft, mapping, has_gaps and bool(speeds))
    return draft.finished(replace(mapping, modes=_modes(draft, mapping, speeds)))


def _in_order(
    columns: Sequence[Column], count: int | None = None, positions: Sequence[Column] = ()
) -> list[Column]:
    """Columns of one quantity in the order of the vehicles; none where the order is open.

    Names give the order, or the positions where there are two vehicles.
    """
    leaders = [c for c in columns if c.name.whose == LEADER]
    followers = [c for c in columns if c.name.whose == FOLLOWER]
    others = [c for c in columns if not c.name.whose]
    ordered: list[Column] = []
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


def _in_order_of_gaps(draft: Draft) -> tuple[list[Column], list[Column]]:
    """Speeds and gaps of a platoon in which each gap names its two vehicles, the one ahead first.

    An example is "Audi speed", "BMW speed" and "gap Audi-BMW". Both are empty for other names.
    """
    speeds, gaps = draft.of("speed"), draft.of("gap")
    if len(speeds) != len(gaps) + 1 or len(speeds) < 2:
        return [], []
    words = [{*speed.name.parts} for speed in speeds]
    distinctive = [part.difference(*words[:k], *words[k + 1 :]) for k, part in enumerate(words)]
    behind: dict[int, tuple[int, Column]] = {}
    for gap in gaps:
        parts = gap.name.parts
        named = [k for part in parts for k, names in enumerate(distinctive) if part in names]
        pair = list(dict.fromkeys(named))
        if len(pair) != 2 or pair[0] in behind:
            return [], []
        behind[pair[0]] = pair[1], gap
    first = {*behind} - {follower for follower, _ in behind.values()}
    if len(first) != 1:
        return [], []
    order, ordered = [first.pop()], list[Column]()
    while order[-1] in behind:
        follower, gap = behind[order[-1]]
        order.append(follower)
        ordered.append(gap)
    complete = len(order) == len(speeds)
    return ([speeds[k] for k in order], ordered) if complete else ([], [])


def _by_positions(columns: Sequence[Column], positions: Sequence[Column]) -> list[Column]:
    """Two columns in the order of their vehicles' positions, the front one first; else none."""
    first, second = ({*column.name.parts} for column in columns)
    tracks = []
    for words in (first - second, second - first):
        of_vehicle = [p for p in positions if words & {*p.name.parts}]
        if len(of_vehicle) != 1 or of_vehicle[0].numbers is None:
            return []
        tracks.append(of_vehicle[0].numbers)
    ahead = tracks[0] - tracks[1]
    if (ahead > 0).all():
        return list(columns)
    return list(reversed(columns)) if (ahead < 0).all() else []


def _number(column: Column) -> int:
    return column.name.number if column.name.number is not None else -1


def _gaps(draft: Draft, count: int) -> list[Column]:
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
    draft: Draft,
    count: int,
    speeds: Sequence[Column],
    relative: Column | None,
    gaps: Sequence[Column],
    positions: Sequence[Column],
) -> CsvMapping:
    """The mapping of chosen columns, in the units of their names or else in SI units."""
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


def _length(draft: Draft, vehicles: int) -> float | str:
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


def _with_relative(draft: Draft, speed: Column, relative: Column) -> list[SpeedColumn]:
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


# One row a vehicle and instant


def _by_vehicle(draft: Draft) -> ByVehicle | None:
    """The columns that identify vehicles, where a row is one vehicle at one instant."""
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


def _long(draft: Draft, by: ByVehicle) -> Proposal:
    columns = {column.text: column for column in draft.columns}
    run = next((c for c in draft.columns if c.name.quantity == "run" and c.varies), None)
    if run:
        draft.choose(run, "run", "", "named run")
    cells = np.array(columns[by.vehicle].cells, object)
    rows: Mask = cells == max(set(cells.tolist()), key=cells.tolist().count)
    if run:
        names = np.array(run.cells, object)
        rows &= names == names[np.flatnonzero(rows)[0]]
    time, step = time_of(draft, rows)
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
    mapping, reason, is_supported = units_by_vehicle(draft, mapping, columns, rows)
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


# Runs and drivers


def _runs(draft: Draft, time: TimeColumn | None) -> str | None:
    """The column that identifies runs, whose rows lie together."""
    for column in draft.columns:
        if column.text in draft.choices or column.name.quantity not in ("run", "id"):
            continue
        changes = sum(a != b for a, b in pairwise(column.cells)) + 1
        if column.varies and changes == len(column.words) <= len(column.cells) / 10:
            draft.choose(column, "run", "", "named run; its rows lie together")
            return column.text
    return None


def _modes(draft: Draft, mapping: CsvMapping, speeds: Sequence[Column]) -> tuple[ModeColumn, ...]:
    """Columns of driver modes, by their names and words."""
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


def _vehicle_of(column: Column, mapping: CsvMapping, speeds: Sequence[Column]) -> int | None:
    """The vehicle that a column is about, by its name."""
    for vehicle, speed in enumerate(speeds, 1):
        if column.name.whose and column.name.whose == speed.name.whose:
            return vehicle
        if column.name.number is not None and column.name.number == speed.name.number:
            return vehicle
    if not column.name.whose and column.name.number is None and len(mapping.speeds) == 2:
        return 2
    return None
