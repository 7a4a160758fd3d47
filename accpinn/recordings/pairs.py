"""Tables of leader-follower pairs: those of ULTra-AV, which OpenPAV continues.

A row is one instant of one pair; `Trajectory_ID` names the pair over one stretch of time, whose
`Time_Index` begins at zero. Two pairs belong to one platoon where the follower of one is the leader
of the other at the same time: the identifiers are equal, and so are the speeds at the same instants
(identifiers alone come again in other runs). Where the stretches begin at different times, the
shift between them is the one at which the speeds agree.

Sources: Zhou, Ma, Liang et al., "A unified longitudinal trajectory dataset for automated vehicle",
Scientific Data 11, 1123, 2024 (ULTra-AV).
"""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import GAP, SPEED
from accpinn.errors import RecordingError
from accpinn.recordings.recording import Mode, Recording, completed
from accpinn.recordings.samples import (
    MINIMUM_SAMPLES,
    SourceFile,
    excerpt,
    require_possible,
    require_time,
)
from accpinn.recordings.tables import Layout, read_columns
from accpinn.units import FloatArray, MetresPerSecond

TRAJECTORY, TIME_INDEX = "Trajectory_ID", "Time_Index"
LEADER, LEADER_TYPE, LEADER_SPEED = "ID_LV", "Type_LV", "Speed_LV"
FOLLOWER, FOLLOWER_SPEED, PAIR_GAP = "ID_FAV", "Speed_FAV", "Spatial_Gap"
NUMBERS = (TIME_INDEX, LEADER_SPEED, FOLLOWER_SPEED, PAIR_GAP)
WORDS = (TRAJECTORY, LEADER, FOLLOWER)
HUMAN_LEADER = "1"
"""Of `Type_LV`; 0 stands for automated or unknown."""

SAME: MetresPerSecond = 0.01
"""Root mean square difference up to which two records of a vehicle's speed are the same."""
VARIES: MetresPerSecond = 0.1
"""Least standard deviation of a speed by which a shift in time can be recognised."""
OVERLAP = 100
"""Samples that two pairs of one platoon share at least."""
SEVERAL = 1000
"""Stretches of rows that a table may have in any case; more are to have as many samples as a
recording each."""
MOST_COMPARED = 10_000
"""Speeds of two trajectories that may be the same vehicle's, in one table; each takes half a
millisecond."""
LISTED = 12
DATA_SETS = (
    "AstaZero", "Casale", "Cherasco", "JRC low speed", "Vicolungo", "ZalaZone", "Vanderbilt",
    "CATS", "MicroSimACC", "Ohio", "Waymo", "Argoverse",
)  # fmt: skip
"""Campaigns and data sets that a file's name may begin with, behind "step1_" or the like."""


@dataclass(frozen=True, eq=False)
class Pair:
    """A leader and a follower over one stretch of N samples."""

    trajectory: str
    leader: str
    follower: str
    human_leader: bool
    rows: FloatArray
    """(N, 4) time in s, speeds of leader and follower in m/s, space-gap in m."""
    first_row: int
    """Of the file's rows of numbers, 0 = first."""


@dataclass(frozen=True, eq=False)
class PairPlatoon:
    """Pairs in which each one's follower is the next one's leader."""

    pairs: tuple[Pair, ...]
    shifts: tuple[int, ...]
    """At which sample of the first pair's time each begins."""

    @property
    def trajectories(self) -> tuple[str, ...]:
        """The names of its pairs, first vehicle first."""
        return tuple(pair.trajectory for pair in self.pairs)


def is_pair_table(layout: Layout) -> bool:
    """Whether a table has the columns of leader-follower pairs."""
    return {*NUMBERS, *WORDS} <= {*layout.names}


def platoons(source_file: SourceFile, layout: Layout) -> tuple[PairPlatoon, ...]:
    """All platoons of a table of pairs, in the order of their first rows.

    Raises:
        RecordingError: when a cell is wrong.
    """
    pairs = _pairs(source_file, layout)
    links = _links(source_file, pairs)
    behind = {ahead: (follower, shift) for ahead, follower, shift in links}
    followers = {follower for _, follower, _ in links}
    found = []
    for k in range(len(pairs)):
        if k in followers:
            continue
        chain, shifts, at = [k], [0], k
        while at in behind:
            at, shift = behind[at]
            chain.append(at)
            shifts.append(shifts[-1] + shift)
        found.append(PairPlatoon(tuple(pairs[i] for i in chain), tuple(shifts)))
    return tuple(found)


def _pairs(source_file: SourceFile, layout: Layout) -> list[Pair]:
    words = (*WORDS, LEADER_TYPE) if LEADER_TYPE in layout.names else WORDS
    # Numbers first: words of millions of rows are not read for nothing.
    numbers = read_columns(source_file, layout, NUMBERS)
    for column in NUMBERS:
        if numbers[column].isna().all():
            raise source_file.refusal(
                "all cells are empty", "choose another table", f"column {column}"
            )
    frame = read_columns(source_file, layout, (), words)
    for name in words:
        frame[name] = frame[name].str.removesuffix(".0")
    # A name that comes again after other rows is another stretch of rows out of order.
    changes = np.zeros(len(frame), bool)
    for column in WORDS:
        changes |= (frame[column] != frame[column].shift()).to_numpy()
    starts = np.flatnonzero(changes)
    if len(starts) > max(SEVERAL, len(frame) / MINIMUM_SAMPLES):
        fault = f"its {len(frame):,} rows change between trajectories {len(starts):,} times"
        raise source_file.refusal(fault, "sort the rows by trajectory and time")
    heads = frame.iloc[starts][list(words)].astype(str).to_dict("records")
    rows_of = np.split(numbers.to_numpy(dtype=float), starts[1:])
    pairs: list[Pair] = []
    names: set[tuple[str, ...]] = set()
    for first, row, rows in zip(heads, starts.tolist(), rows_of, strict=True):
        name, leader, follower = (first[column] for column in WORDS)
        if (name, leader, follower) in names:
            fault = f"trajectory {excerpt(name)} continues here, behind rows of another"
            cure = "sort the rows by trajectory and time, one pair a trajectory"
            raise source_file.refusal(fault, cure, f"row {layout.header_row + row + 1}")
        names.add((name, leader, follower))
        human = first.get(LEADER_TYPE) == HUMAN_LEADER
        pairs.append(Pair(name, leader, follower, human, rows, row))
    return pairs


def _links(source_file: SourceFile, pairs: Sequence[Pair]) -> list[tuple[int, int, int]]:
    """Pair ahead, pair behind, and the sample of the first at which the second begins.

    A pair has one pair behind and one ahead at most: those with the longest time in common.
    """
    by_leader: dict[str, list[int]] = {}
    for k, pair in enumerate(pairs):
        by_leader.setdefault(pair.leader, []).append(k)
    met = sum(len(by_leader.get(pair.follower, ())) for pair in pairs)
    if met > MOST_COMPARED:
        fault = f"its {len(pairs):,} trajectories have so few vehicles that {met:,} may be one's"
        raise source_file.refusal(fault, "split the file, or name the vehicles of each run apart")
    found = []
    for k, pair in enumerate(pairs):
        for other in by_leader.get(pair.follower, ()):
            shared = _shared(pair.rows[:, 2], pairs[other].rows[:, 1]) if other != k else None
            if shared:
                found.append((shared[0], k, other, shared[1]))
    links: list[tuple[int, int, int]] = []
    ahead: set[int] = set()
    behind: dict[int, int] = {}
    for _, k, other, shift in sorted(found, key=lambda one: (-one[0], one[1], one[2])):
        if k in ahead or other in behind or _leads(behind, other, k):
            continue
        ahead.add(k)
        behind[other] = k
        links.append((k, other, shift))
    return links


def _leads(behind: dict[int, int], pair: int, other: int) -> bool:
    """Whether ``pair`` is ahead of ``other`` already, so that a link back would close a circle."""
    at: int | None = other
    while at is not None:
        if at == pair:
            return True
        at = behind.get(at)
    return False


def _shared(own: FloatArray, ahead: FloatArray) -> tuple[int, int] | None:
    """Samples in common, and the sample of ``own`` at which ``ahead`` begins; None where none.

    Args:
        own: (N,) speed of a vehicle as the follower of one pair.
        ahead: (K,) the same as the leader of another.
    """
    most = min(len(own), len(ahead))
    if most < OVERLAP or any((np.abs(speed) > SPEED.possible).any() for speed in (own, ahead)):
        return None
    if _differ(own[:most], ahead[:most]) <= SAME:
        return most, 0
    if np.isnan(own).any() or np.isnan(ahead).any():
        return None
    from scipy.signal import fftconvolve  # takes a second to import, which few need

    centre = own.mean()
    a, b = own - centre, ahead - centre
    shifts = np.arange(-(len(b) - 1), len(a))
    one = np.ones
    squares = (
        fftconvolve(a**2, one(len(b))) + fftconvolve(one(len(a)), b[::-1] ** 2)
        - 2.0 * fftconvolve(a, b[::-1])
    )  # fmt: skip
    counts = np.minimum(len(a), shifts + len(b)) - np.maximum(0, shifts)
    means = np.where(counts >= OVERLAP, squares / np.maximum(counts, 1), np.inf)
    at = int(means.argmin())
    shift, count = int(shifts[at]), int(counts[at])
    if count < OVERLAP:
        return None
    part = own[max(0, shift) : max(0, shift) + count]
    other = ahead[max(0, -shift) : max(0, -shift) + count]
    varies = float(part.std()) >= VARIES
    return (count, shift) if varies and _differ(part, other) <= SAME else None


def _differ(one: FloatArray, other: FloatArray) -> float:
    """Root mean square of the difference where both are known; nan where nowhere."""
    away = one - other
    away = away[np.isfinite(away)]
    return float(np.sqrt((away**2).mean())) if len(away) else float("nan")


def choose(
    source_file: SourceFile, found: Sequence[PairPlatoon], trajectory: str | None
) -> PairPlatoon:
    """The platoon that holds a trajectory, or the only one.

    Raises:
        RecordingError: for a name that is not there, or where a choice has to be made.
    """
    if trajectory is None:
        if len(found) == 1:
            return found[0]
        return _refuse_choice(source_file, found, f"the table holds {len(found)} platoons")
    for platoon in found:
        if trajectory.strip() in platoon.trajectories:
            return platoon
    fault = f'there is no trajectory "{excerpt(trajectory)}"'
    return _refuse_choice(source_file, found, fault)


def _refuse_choice(
    source_file: SourceFile, found: Sequence[PairPlatoon], fault: str
) -> PairPlatoon:
    names = [excerpt(platoon.trajectories[0]) for platoon in found]
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    listed = ", ".join(names[:LISTED])
    raise source_file.refusal(fault, f"choose a trajectory (--trajectory): {listed}{more}")


def recording_of(
    source_file: SourceFile, layout: Layout, platoon: PairPlatoon, only: bool
) -> Recording:
    """The recording of a platoon; V vehicles are one more than its pairs.

    Its time runs from the first sample of any pair to the last one; where a pair has none, the
    channels that only it knows are missing.

    Args:
        source_file: the file.
        layout: its own.
        platoon: one of the file's.
        only: whether the file holds no other.

    Raises:
        RecordingError: about the first row that is wrong.
    """
    for pair in platoon.pairs:
        _check(source_file, layout, pair)
    starts = np.array(platoon.shifts) - min(platoon.shifts)
    places = [slice(s, s + len(p.rows)) for s, p in zip(starts, platoon.pairs, strict=True)]
    samples, vehicles = max(place.stop for place in places), len(platoon.pairs) + 1
    time = np.full(samples, np.nan)
    speed = np.full((samples, vehicles), np.nan)
    gap = np.full((samples, vehicles - 1), np.nan)
    mode = np.full((samples, vehicles), Mode.UNKNOWN, np.int8)
    for k, (place, pair) in enumerate(zip(places, platoon.pairs, strict=True)):
        instants = pair.rows[:, 0]
        known = np.flatnonzero(np.isfinite(time[place]))
        # The first pair's clock serves for all.
        offset = time[place][known[0]] - instants[known[0]] if len(known) else 0.0
        _fill(time[place], instants + offset)
        _fill(speed[place, k], pair.rows[:, 1])
        speed[place, k + 1] = pair.rows[:, 2]
        gap[place, k] = pair.rows[:, 3]
        mode[place, k + 1] = Mode.ACC
        if k == 0 and pair.human_leader:
            mode[place, 0] = Mode.HUMAN
    name, content = platoon.trajectories[0], hashlib.sha256(source_file.raw)
    if not only:
        content.update(name.encode())
    ids = [platoon.pairs[0].leader, *(pair.follower for pair in platoon.pairs)]
    recording = Recording(
        source=source_file.name if only else f"{source_file.name}, trajectory {excerpt(name)}",
        sha256=content.hexdigest(),
        campaign=_data_set(source_file.name),
        time=time - time[0],
        speed=speed,
        gap=gap,
        mode=mode,
        trajectory=None if only else name,
    )
    names = {k: f"ID {excerpt(identifier)}" for k, identifier in enumerate(ids, 1)}
    return completed(recording, names, ())


def _fill(place: NDArray[np.float64], values: FloatArray) -> None:
    """Write values where there are none yet."""
    empty = np.isnan(place)
    place[empty] = values[empty]


def _check(source_file: SourceFile, layout: Layout, pair: Pair) -> None:
    def refuse(column: str, fault: str, cure: str, row: int | None) -> RecordingError:
        number = "" if row is None else f"row {layout.header_row + pair.first_row + row + 1}, "
        return source_file.refusal(fault, cure, f"{number}column {column}")

    for k, channel in ((1, SPEED), (2, SPEED), (3, GAP)):
        column = NUMBERS[k]
        require_possible(channel, pair.rows[:, k], lambda *of, c=column: refuse(c, *of))
        if np.isnan(pair.rows[:, k]).all():
            raise refuse(column, "all cells are empty", "choose another trajectory", None)
    if len(pair.rows) < 2:
        raise refuse(TIME_INDEX, "the trajectory has one row", "choose another trajectory", 0)
    require_time(pair.rows[:, 0], lambda *of: refuse(TIME_INDEX, *of))


def _data_set(name: str) -> str | None:
    """The data set that a file's name names."""
    words = re.sub(r"[_\-]+", " ", name).lower()
    return next((one for one in DATA_SETS if re.search(rf"\b{one.lower()}", words)), None)
