"""Reading a table by its mapping: each run of it as a `Recording`.

In a wide table a row is one instant of all vehicles. In a long one a row is one vehicle at one
instant: the vehicle ahead is named by a column, or is the next one in the same lane, and the
space-gap is its position minus the follower's, minus its length. Stretches of time in which a
vehicle has the same one ahead become a platoon where the vehicle ahead is itself a follower.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import GAP, SPEED, Quantity
from accpinn.findings import Finding, Labelled, Words
from accpinn.recordings import Mode, Recording, clocks
from accpinn.recordings.mapping import (
    ByVehicle,
    CsvMapping,
    GapColumn,
    SpeedColumn,
    check_mapping,
)
from accpinn.recordings.names import ColumnName
from accpinn.recordings.sampling import merged, recording_of, shifted, without_lost_targets
from accpinn.recordings.source import SourceFile, excerpt
from accpinn.recordings.tables import (
    MINIMUM_SAMPLES,
    MOST_RUNS,
    Columns,
    Layout,
    TableRun,
    layout_of,
    read_columns,
)
from accpinn.units import GAP_UNITS, SPEED_UNITS, FloatArray, Seconds

if TYPE_CHECKING:
    import pandas as pd

MOST_VEHICLES = 20_000
"""Vehicles of all runs of a table of one row a vehicle and instant."""
MOST_STRETCHES = 20_000
"""Stretches of time in which they follow another."""
MOST_MET = 1_000_000
"""Pairs of such stretches that have a vehicle in common."""
SHARED: Seconds = 10.0
"""Least time that a vehicle and the two ahead of it and behind it have in common in a platoon."""
BACKWARD = -0.5
"""Mean speed, in m/s, below which a vehicle drives against the direction of the positions."""


class UnitContradictsHeader(Finding, frozen=True):
    """A column is read in another unit than its name, or the row of units, says."""

    text = 'Column "{shown}" is read in {taken}, and the table says {named}; check the mapping.'

    column: str
    taken: str
    """The mapping's unit."""
    named: str
    """The table's."""

    def _words(self, about: Labelled) -> Words:
        return {"shown": excerpt(self.column, 60)}


def unit_contradictions(mapping: CsvMapping, layout: Layout) -> tuple[UnitContradictsHeader, ...]:
    """The columns of speeds and gaps whose units the table and its mapping say differently."""
    units = dict(zip(layout.names, layout.units, strict=False))
    read_in = [(speed.column, speed.unit, True) for speed in mapping.speeds]
    for gap in mapping.gaps:
        read_in += [(name, gap.unit, False) for name in (gap.column, gap.minus) if name]
    findings = []
    for column, taken, is_speed in dict.fromkeys(read_in):
        name = ColumnName(column, units.get(column, ""))
        named = name.speed_unit if is_speed else name.length_unit
        if named and named != taken:
            findings.append(UnitContradictsHeader(column, taken, named))
    return tuple(findings)


def runs_of(
    source_file: SourceFile,
    mapping: CsvMapping,
    layout: Layout | None = None,
    notes: tuple[Finding, ...] = (),
) -> tuple[TableRun, ...]:
    """The runs of a table, in the order of their first rows.

    Args:
        source_file: the table.
        mapping: which columns hold what.
        layout: how it is written, where that is known already.
        notes: findings about how the mapping came about, which each recording gets.

    Raises:
        RecordingError: one sentence of file, place, fault and cure.
    """
    check_mapping(mapping)
    layout = layout or layout_of(source_file)
    notes = (*notes, *unit_contradictions(mapping, layout))
    columns = _columns(source_file, mapping, layout)
    if mapping.by:
        return _platoons(columns, mapping, mapping.by, notes)
    runs: dict[str | None, NDArray[np.int64]] = {None: columns.rows}
    if mapping.trajectory:
        words = columns.words[mapping.trajectory]
        numbers = {name: k for k, name in enumerate(dict.fromkeys(words))}
        if len(numbers) > min(MOST_RUNS, len(words) / 2):
            fault = f"it tells {len(numbers):,} runs apart in {len(words):,} rows"
            raise columns.refusal(fault, "choose the column that names runs", mapping.trajectory)
        codes = np.array([numbers[word] for word in words])
        order = np.argsort(codes, kind="stable")
        parts = np.split(order, np.cumsum(np.bincount(codes))[:-1])
        runs = dict(zip(numbers, parts, strict=True))
    return tuple(
        TableRun(
            () if trajectory is None else (trajectory,),
            len(mapping.speeds),
            columns,
            partial(_wide, columns, mapping, rows, trajectory, notes),
        )
        for trajectory, rows in runs.items()
    )


def _columns(source_file: SourceFile, mapping: CsvMapping, layout: Layout) -> Columns:
    """What a mapping names of a table."""
    words = [mode.column for mode in mapping.modes]
    words += [mapping.trajectory] if mapping.trajectory else []
    numbers = [speed.column for speed in mapping.speeds]
    for gap in mapping.gaps:
        named = (gap.column, gap.minus, gap.subtract)
        numbers += [name for name in named if isinstance(name, str) and name]
    if by := mapping.by:
        words += [name for name in (by.vehicle, by.leader, by.lane) if name]
        numbers += [by.position] if by.position else []
    if mapping.time:  # as texts, whose digits are all there
        parts = (mapping.time.column, mapping.time.date, mapping.time.nanoseconds)
        words += filter(None, parts)
    return read_columns(
        source_file, layout, tuple(dict.fromkeys(numbers)), tuple(dict.fromkeys(words))
    )


def _stamps(columns: Columns, mapping: CsvMapping) -> tuple[str, FloatArray]:
    """The column of time and what it says (N,), in s, wraps at midnight undone.

    Raises:
        RecordingError: about the first cell that says no time.
    """
    time = mapping.time
    if time is None:  # even steps
        step = mapping.sample_time or 0.0
        return mapping.speeds[0].column, step * np.arange(len(columns), dtype=np.float64)
    is_counter = time.unit == clocks.FRAME
    dates = columns.words[time.date] if time.date else None
    at = time.column
    try:
        seconds = clocks.seconds(
            columns.words[at], "s" if is_counter else time.unit, columns.layout.decimal, dates
        )
        if time.nanoseconds:
            at = time.nanoseconds
            seconds = seconds + clocks.seconds(columns.words[at], "ns", columns.layout.decimal)
    except clocks.TimeUnreadable as fault:
        message = f'"{excerpt(fault.cell)}" {fault.fault} as "{time.unit}"'
        cure = "correct it, or name the column's unit"
        at = time.date if fault.is_date else at
        raise columns.refusal(message, cure, at, fault.index) from None
    if is_counter:
        seconds = seconds * (mapping.sample_time or 0.0)
    return time.column, seconds


def _wide(
    columns: Columns,
    mapping: CsvMapping,
    rows: NDArray[np.int64],
    trajectory: str | None,
    notes: tuple[Finding, ...],
) -> Recording:
    """The recording of the rows of one run."""
    if len(rows) < MINIMUM_SAMPLES:
        many = f"the run has {len(rows)} row{'s' * (len(rows) != 1)}"
        cure = f"choose another one, as a recording has at least {MINIMUM_SAMPLES}"
        raise columns.source_file.refusal(many, cure)
    columns, findings = columns[rows], [*columns.source_file.contents.findings, *notes]
    at, stamps = _stamps(columns, mapping)
    stamps, _ = clocks.unwrapped(stamps)
    time = columns.time(at, stamps)
    speeds = _speeds(columns, mapping.speeds)
    gaps = [_gap(columns, gap) for gap in mapping.gaps]
    for k, speed in enumerate(speeds[1:]):
        gaps[k], lost = without_lost_targets(k + 1, time, speed, gaps[k])
        findings += [lost] if lost else []
    shifts = [speed.shift for speed in mapping.speeds] + [gap.shift for gap in mapping.gaps]
    names = [speed.column for speed in mapping.speeds] + [gap.column for gap in mapping.gaps]
    channels = np.column_stack(
        [shifted(time, s, shift) for s, shift in zip((*speeds, *gaps), shifts, strict=True)]
    )
    modes = np.full((len(columns), len(speeds)), Mode.UNKNOWN, np.int8)
    for mode in mapping.modes:
        modes[:, mode.vehicle - 1] = columns.modes(mode.column, mode.acc, mode.human, findings)
    if any(shifts):  # the ends, where a channel that was shifted has no value
        complete = np.flatnonzero(np.isfinite(channels).all(axis=1))
        if len(complete) < MINIMUM_SAMPLES:
            fault = "no instants are left at which all channels are known"
            raise columns.source_file.refusal(fault, "choose smaller shifts in the mapping")
        inside = slice(complete[0], complete[-1] + 1)
        time, channels, modes = time[inside] - time[inside][0], channels[inside], modes[inside]
    instants, channels, rates = merged(time, channels, names)
    if rates:
        findings.append(rates)
        modes = modes[np.searchsorted(time, np.clip(instants, 0, time[-1]))]
    return recording_of(
        instants, channels[:, : len(speeds)], channels[:, len(speeds) :], modes,
        refuse=lambda fault, cure, row: columns.refusal(fault, cure, at, row),
        source=columns.source_file.name + (f", trajectory {trajectory}" if trajectory else ""),
        sha256=columns.source_file.sha256(trajectory),
        trajectory=trajectory,
        names={k: excerpt(speed.name, 80) for k, speed in enumerate(mapping.speeds, 1)},
        findings=findings,
        mapping=mapping,
    )  # fmt: skip


def _speeds(columns: Columns, speeds: Sequence[SpeedColumn]) -> list[FloatArray]:
    """(V,) speeds (N,) in m/s, relative ones added to those that they are relative to."""
    own = [
        _channel(columns, SPEED, speed.column, SPEED_UNITS[speed.unit], speed.reversed)
        for speed in speeds
    ]
    return [
        values + own[speed.relative_to - 1] if speed.relative_to else values
        for values, speed in zip(own, speeds, strict=True)
    ]


def _gap(columns: Columns, gap: GapColumn) -> FloatArray:
    """The space-gap (N,) in m."""
    factor = GAP_UNITS[gap.unit]
    if not gap.minus:
        values = _channel(columns, GAP, gap.column, factor, gap.reversed)
    else:
        columns.require_some(gap.column, "choose another column")
        columns.require_some(gap.minus, "choose another column")
        values = (columns.numbers[gap.column] - columns.numbers[gap.minus]) * factor
        values = columns.sized(GAP, -values if gap.reversed else values, gap.column)
    length = gap.subtract
    return values - (columns.numbers[length] * factor if isinstance(length, str) else length)


def _channel(
    columns: Columns, quantity: Quantity, column: str, factor: float, is_reversed: bool
) -> FloatArray:
    values = columns.measured(quantity, column, -factor if is_reversed else factor)
    columns.require_some(column, "choose another column")
    return values


@dataclass(frozen=True, eq=False)
class _Following:
    """A stretch of time in which one vehicle has the same one ahead, n instants."""

    run: str
    leader: str
    follower: str
    time: FloatArray
    """(n,) in s."""
    ahead: FloatArray
    """(n,) speed in m/s of the vehicle ahead."""
    behind: FloatArray
    gap: FloatArray
    """(n,) in m."""


def _platoons(
    columns: Columns, mapping: CsvMapping, by: ByVehicle, notes: tuple[Finding, ...]
) -> tuple[TableRun, ...]:
    """The platoons of a table of one row a vehicle and instant."""
    frame, names = _rows(columns, mapping, by)
    stretches = list(_stretches(columns, frame, *names))
    if not stretches:
        fault = f"no vehicle has another one ahead for {MINIMUM_SAMPLES} rows"
        cure = "check the columns of vehicle, vehicle ahead and time in the mapping"
        raise columns.source_file.refusal(fault, cure)
    behind = _linked(columns.source_file, stretches)
    followers = set(behind.values())
    chains: list[list[_Following]] = []
    for first in range(len(stretches)):
        if first not in followers:
            chain = [first]
            while chain[-1] in behind:
                chain.append(behind[chain[-1]])
            chains.append([stretches[k] for k in chain])
    if len(chains) > MOST_RUNS:
        fault = f"it holds {len(chains):,} platoons, and at most {MOST_RUNS:,} are read"
        raise columns.source_file.refusal(fault, "split the file")
    platoon_names = _platoon_names(chains)
    is_only = len(chains) == 1
    return tuple(
        TableRun(
            chain_names,
            len(chain) + 1,
            columns,
            partial(_long, columns, mapping, chain, None if is_only else chain_names[0], notes),
        )
        for chain, chain_names in zip(chains, platoon_names, strict=True)
    )


def _platoon_names(chains: Sequence[Sequence[_Following]]) -> list[tuple[str, ...]]:
    """Names of each platoon: those of its pairs, as "3-0", with run and start where needed."""
    runs = {stretch.run for chain in chains for stretch in chain}
    seen: dict[str, int] = {}
    names = []
    for chain in chains:
        pairs = []
        for pair in chain:
            name = f"{pair.leader}-{pair.follower}"
            name = f"{pair.run}/{name}" if len(runs) > 1 else name
            seen[name] = seen.get(name, 0) + 1
            pairs.append(name if seen[name] == 1 else f"{name}@{pair.time[0]:.10g}")
        names.append(tuple(pairs))
    return names


def _rows(
    columns: Columns, mapping: CsvMapping, by: ByVehicle
) -> "tuple[pd.DataFrame, tuple[list[str], list[str]]]":
    """The rows in order of run, vehicle and time, each with speed and gap to the vehicle ahead.

    Runs and vehicles are numbers, in the order of their names; these are the other two.
    """
    import pandas as pd  # half a second, which wide tables do not need

    run_words = columns.words[mapping.trajectory] if mapping.trajectory else [""] * len(columns)
    _require_few(columns, run_words, columns.words[by.vehicle])
    run_names, id_names = (_plain_names(words) for words in (run_words, columns.words[by.vehicle]))
    runs, vehicles = _numbers(run_words, run_names), _numbers(columns.words[by.vehicle], id_names)
    at, stamps = _stamps(columns, mapping)
    speed, gap = mapping.speeds[0], mapping.gaps[0]
    missing = np.flatnonzero(np.isnan(stamps))
    if len(missing):
        raise columns.refusal("the time is missing", "fill it in", at, int(missing[0]))
    length = gap.subtract
    lengths = columns.numbers[length] if isinstance(length, str) else None
    factor = GAP_UNITS[gap.unit]
    position = by.position or (gap.column if gap.minus else "")
    frame = pd.DataFrame({
        "row": columns.rows,
        "run": runs,
        "vehicle": vehicles,
        "time": stamps,
        "speed": _channel(columns, SPEED, speed.column, SPEED_UNITS[speed.unit], speed.reversed),
        "position": columns.numbers[position] * factor if position else np.nan,
        "own_gap": np.nan if gap.minus else columns.numbers[gap.column] * factor,
        "length": lengths * factor if lengths is not None else length,
    })  # fmt: skip
    backward = frame.groupby(["run", "vehicle"])["speed"].transform("mean") < BACKWARD
    frame.loc[backward, ["speed", "position"]] *= -1.0
    if by.leader:
        frame["leader"] = _numbers(columns.words[by.leader], id_names)
    else:
        lanes = columns.words[by.lane]
        frame["lane"] = _numbers(lanes, _plain_names(lanes))
        frame = frame.sort_values(["run", "time", "lane", "position"], kind="stable")
        ahead = frame.shift(-1)
        together = (frame[["run", "time", "lane"]] == ahead[["run", "time", "lane"]]).all(axis=1)
        frame["leader"] = ahead["vehicle"].where(together, -1).astype(np.int64)
    keys = ["run", "vehicle", "time"]
    frame = frame.drop_duplicates(keys)
    others = frame[["run", "vehicle", "time", "speed", "position", "length"]]
    frame = frame.merge(
        others, how="left", left_on=["run", "leader", "time"], right_on=keys,
        suffixes=("", "_ahead"),
    )  # fmt: skip
    frame["has_leader"] = frame["speed_ahead"].notna() & (frame["leader"] != frame["vehicle"])
    between = frame["position_ahead"] - frame["position"]
    if gap.minus:
        values = -between if gap.reversed else between
    else:
        values = -frame["own_gap"] if gap.reversed else frame["own_gap"]
    subtracted = frame["length_ahead"] if lengths is not None else frame["length"]
    frame["gap"] = values - subtracted
    for quantity, column in ((SPEED, "speed"), (GAP, "gap")):
        wrong = frame[frame["has_leader"] & (frame[column].abs() > quantity.possible)]
        if len(wrong):
            name = speed.column if column == "speed" else gap.column
            columns.sized(quantity, wrong[column].to_numpy()[:1], name, wrong["row"].iloc[0])
    return frame.sort_values(keys, kind="stable"), (run_names, id_names)


def _plain_names(words: Sequence[str]) -> list[str]:
    """The different words in order, without the fraction that some programs write behind them."""
    return sorted({word.removesuffix(".0") for word in {*words}})


def _numbers(words: Sequence[str], names: Sequence[str]) -> NDArray[np.int64]:
    """(N,) places of words among names, by which they are quick to sort; -1 for another word."""
    place = {name: k for k, name in enumerate(names)}
    numbers = {word: place.get(word.removesuffix(".0"), -1) for word in {*words}}
    return np.fromiter((numbers[word] for word in words), np.int64, len(words))


def _require_few(columns: Columns, runs: Sequence[str], vehicles: Sequence[str]) -> None:
    """Refuse more vehicles of all runs than a table has, before much is done for each of them."""
    count = max(len({*vehicles}), len({*runs}))
    if count <= MOST_VEHICLES:
        count = len({*zip(runs, vehicles, strict=True)})
    if count > MOST_VEHICLES:
        fault = (
            f"its {len(vehicles):,} rows name {count:,} vehicles, and {MOST_VEHICLES:,} are read"
        )
        cure = "choose the column that names vehicles, or split the file"
        raise columns.source_file.refusal(fault, cure)


def _stretches(
    columns: Columns, frame: "pd.DataFrame", runs: Sequence[str], ids: Sequence[str]
) -> Iterator[_Following]:
    """Each vehicle's stretches of time with one and the same vehicle ahead, without long pauses."""
    frame = frame[frame["has_leader"]]
    if not len(frame):
        return
    same = (frame[["run", "vehicle", "leader"]] == frame[["run", "vehicle", "leader"]].shift()).all(
        axis=1
    )
    steps = frame["time"].diff()
    typical = float(steps[same].median())
    begins = ~same | (steps > max(SHARED, 3 * typical))
    firsts = np.flatnonzero(begins.to_numpy())
    ends = np.append(firsts[1:], len(frame))
    long = ends - firsts >= MINIMUM_SAMPLES
    if long.sum() > MOST_STRETCHES:
        fault = f"its vehicles follow another one in {long.sum():,} stretches of time"
        cure = f"split the file, as at most {MOST_STRETCHES:,} are read"
        raise columns.source_file.refusal(fault, cure)
    names = {name: frame[name].to_numpy() for name in ("run", "leader", "vehicle")}
    series = [frame[name].to_numpy(float) for name in ("time", "speed_ahead", "speed", "gap")]
    for first, end in zip(firsts[long].tolist(), ends[long].tolist(), strict=True):
        run, leader, vehicle = (int(numbers[first]) for numbers in names.values())
        own = (values[first:end].copy() for values in series)  # the rest of the table may go
        yield _Following(runs[run], ids[leader], ids[vehicle], *own)


def _linked(source_file: SourceFile, stretches: Sequence[_Following]) -> dict[int, int]:
    """By stretch ahead the one behind, whose leader is its follower for the longest time."""
    by_leader: dict[tuple[str, str], list[int]] = {}
    for k, stretch in enumerate(stretches):
        by_leader.setdefault((stretch.run, stretch.leader), []).append(k)
    met = sum(len(by_leader.get((stretch.run, stretch.follower), ())) for stretch in stretches)
    if met > MOST_MET:
        fault = (
            f"its {len(stretches):,} stretches of time have few vehicles, which meet {met:,} times"
        )
        raise source_file.refusal(fault, "split the file, or name the column that tells runs apart")
    matches = []
    for k, stretch in enumerate(stretches):
        for other in by_leader.get((stretch.run, stretch.follower), []):
            a, b = stretch.time, stretches[other].time
            overlap = min(a[-1], b[-1]) - max(a[0], b[0])
            if overlap >= SHARED:
                matches.append((-overlap, k, other))
    behind: dict[int, int] = {}
    taken: set[int] = set()
    for _, k, other in sorted(matches):
        last = other
        while last in behind:
            last = behind[last]
        if k not in behind and other not in taken and last != k:  # no circle
            behind[k] = other
            taken.add(other)
    return behind


def _long(
    columns: Columns,
    mapping: CsvMapping,
    chain: Sequence[_Following],
    trajectory: str | None,
    notes: tuple[Finding, ...],
) -> Recording:
    """The recording of a platoon, from its first instant to its last."""
    instants = np.unique(np.concatenate([stretch.time for stretch in chain]))
    speed = np.full((len(instants), len(chain) + 1), np.nan)
    gap = np.full((len(instants), len(chain)), np.nan)
    for k, stretch in enumerate(chain):
        rows = np.searchsorted(instants, stretch.time)
        speed[rows, k], speed[rows, k + 1] = stretch.ahead, stretch.behind
        gap[rows, k] = stretch.gap
    at = mapping.time.column if mapping.time else ""
    ids = [chain[0].leader, *(stretch.follower for stretch in chain)]
    return recording_of(
        instants - instants[0], speed, gap, np.full(speed.shape, Mode.UNKNOWN, np.int8),
        refuse=lambda fault, cure, row: columns.refusal(fault, cure, at),
        source=columns.source_file.name + (f", trajectory {trajectory}" if trajectory else ""),
        sha256=columns.source_file.sha256(trajectory),
        trajectory=trajectory,
        names={k: f"ID {excerpt(identifier)}" for k, identifier in enumerate(ids, 1)},
        findings=[*columns.source_file.contents.findings, *notes],
        mapping=mapping,
    )  # fmt: skip
