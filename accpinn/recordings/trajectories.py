"""Tables of one row a vehicle and instant: the platoons in them, each as a `Recording`.

The vehicle ahead is named by a column, or is the next one in the same lane. The space-gap is a
column, or the position of the vehicle ahead minus the follower's, minus its length. Stretches of
time in which a vehicle has the same one ahead become a platoon where the vehicle ahead is itself a
follower.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import GAP, SPEED
from accpinn.findings import Finding
from accpinn.recordings import Mode, Recording
from accpinn.recordings.mapped_columns import measured_channel, time_stamps
from accpinn.recordings.mapping import ByVehicle, CsvMapping
from accpinn.recordings.sampling import recording_of
from accpinn.recordings.source import SourceFile, excerpt
from accpinn.recordings.tables import MINIMUM_SAMPLES, MOST_RUNS, Columns, TableRun
from accpinn.units import GAP_UNITS, SPEED_UNITS, FloatArray, Seconds

if TYPE_CHECKING:
    import pandas as pd

MOST_VEHICLES = 20_000
"""Most vehicles of all runs of a table."""
MOST_STRETCHES = 20_000
"""Most stretches of time in which vehicles follow another."""
MOST_MET = 1_000_000
"""Most pairs of such stretches that have a vehicle in common."""
SHARED: Seconds = 10.0
"""Least time that a vehicle and the two ahead of it and behind it have in common in a platoon."""
BACKWARD = -0.5
"""Mean speed, in m/s, below which a vehicle drives against the direction of the positions."""


@dataclass(frozen=True, eq=False)
class _PairStretch:
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


def platoons_of(
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
    chains: list[list[_PairStretch]] = []
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


def _platoon_names(chains: Sequence[Sequence[_PairStretch]]) -> list[tuple[str, ...]]:
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

    Runs and vehicles are numbers in the frame; their names in this order are returned beside it.
    """
    import pandas as pd  # half a second, which wide tables do not need

    run_words = columns.words[mapping.trajectory] if mapping.trajectory else [""] * len(columns)
    # Too many vehicles are refused before time is spent on each of them.
    vehicle_words = columns.words[by.vehicle]
    count = max(len({*vehicle_words}), len({*run_words}))
    if count <= MOST_VEHICLES:
        count = len({*zip(run_words, vehicle_words, strict=True)})
    if count > MOST_VEHICLES:
        raise columns.source_file.refusal(
            f"its {len(columns):,} rows name {count:,} vehicles, and {MOST_VEHICLES:,} are read",
            "choose the column that names vehicles, or split the file",
        )
    run_names, id_names = (_plain_names(words) for words in (run_words, vehicle_words))
    runs, vehicles = _numbers(run_words, run_names), _numbers(vehicle_words, id_names)
    at, stamps = time_stamps(columns, mapping)
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
        "speed": measured_channel(
            columns, SPEED, speed.column, SPEED_UNITS[speed.unit], speed.reversed
        ),
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


def _stretches(
    columns: Columns, frame: "pd.DataFrame", runs: Sequence[str], ids: Sequence[str]
) -> Iterator[_PairStretch]:
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
        samples = (values[first:end].copy() for values in series)  # the rest of the table may go
        yield _PairStretch(runs[run], ids[leader], ids[vehicle], *samples)


def _linked(source_file: SourceFile, stretches: Sequence[_PairStretch]) -> dict[int, int]:
    """Index of the stretch behind by that ahead: its leader is the other's follower for longest."""
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
    chain: Sequence[_PairStretch],
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
