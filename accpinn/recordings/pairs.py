"""Tables of leader-follower pairs: those of ULTra-AV, which OpenPAV continues.

A row is one instant of one pair; `Trajectory_ID` names the pair over one stretch of time, whose
`Time_Index` begins at zero. Two pairs belong to one platoon where the follower of one is the leader
of the other at the same time: the identifiers are equal, and so are the speeds at the same instants
(identifiers alone come again in other runs). Where the stretches begin at different times, the
shift between them is the one at which the speeds agree.

Sources: Zhou, Ma, Liang et al., "A unified longitudinal trajectory dataset for automated vehicle",
Scientific Data 11, 1123, 2024 (ULTra-AV).
"""

import re
from collections.abc import Sequence
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import GAP, SPEED, TIME
from accpinn.recordings import Mode, Recording
from accpinn.recordings.sampling import recording_of
from accpinn.recordings.source import SourceFile, excerpt
from accpinn.recordings.table_layout import Layout
from accpinn.recordings.tables import MINIMUM_SAMPLES, MOST_RUNS, Columns, TableRun, read_columns
from accpinn.units import FloatArray, MetresPerSecond, nanmean

TRAJECTORY, TIME_INDEX = "Trajectory_ID", "Time_Index"
LEADER, LEADER_TYPE, LEADER_SPEED = "ID_LV", "Type_LV", "Speed_LV"
FOLLOWER, FOLLOWER_SPEED, PAIR_GAP = "ID_FAV", "Speed_FAV", "Spatial_Gap"
NUMBERS = (TIME_INDEX, LEADER_SPEED, FOLLOWER_SPEED, PAIR_GAP)
WORDS = (TRAJECTORY, LEADER, FOLLOWER)
LEADER_MODES = {"0": Mode.HUMAN, "1": Mode.ACC}
"""Values of `Type_LV`: a human driver, an automated vehicle."""
OPENACC_SETS = ("AstaZero", "Casale", "Cherasco", "JRC low speed", "Vicolungo", "ZalaZone")
"""Data sets of OpenACC, whose leaders have type 1 also where the driver is not recorded."""

SAME: MetresPerSecond = 0.01
"""Largest root mean square difference of two records of the same vehicle's speed."""
VARIES: MetresPerSecond = 0.1
"""Least standard deviation of a speed by which a shift in time can be recognised."""
OVERLAP = 100
"""Least number of samples that two pairs of a platoon share."""
SEVERAL = 1000
"""Stretches of rows that a table may have in any case; more are to have as many samples as a
recording each."""
MOST_COMPARED, MOST_SAMPLES_COMPARED = 10_000, 80_000_000
"""Speeds of two trajectories that may be the same vehicle's, in one table, and their samples; all
take some seconds."""
DATA_SETS = (*OPENACC_SETS, "Vanderbilt", "CATS", "MicroSimACC", "Ohio", "Waymo", "Argoverse")
"""Campaigns and data sets that a file's name may begin with, behind "step1_" or the like."""


def is_pair_table(layout: Layout) -> bool:
    """Whether a table has the columns of leader-follower pairs."""
    return {*NUMBERS, *WORDS} <= {*layout.names}


def runs_of(source_file: SourceFile, layout: Layout) -> tuple[TableRun, ...]:
    """The platoons of a table of pairs, in the order of their first rows.

    Raises:
        RecordingError: when a cell is wrong.
    """
    words = (*WORDS, LEADER_TYPE) if LEADER_TYPE in layout.names else WORDS
    columns = read_columns(source_file, layout, NUMBERS, words)
    pairs = _pairs(columns)
    links = _links(source_file, pairs)
    followers = {follower for follower, _ in links.values()}
    platoons = []
    for first in range(len(pairs)):
        if first in followers:
            continue
        chain, begins, at = [pairs[first]], [0], first
        while at in links:
            at, shift = links[at]
            chain.append(pairs[at])
            begins.append(begins[-1] + shift)
        platoons.append((chain, begins))
    is_only = len(platoons) == 1
    return tuple(
        TableRun(
            tuple(_identifier(pair, TRAJECTORY) for pair in chain),
            len(chain) + 1,
            chain[0],
            partial(_recording, chain, begins, is_only),
        )
        for chain, begins in platoons
    )


def _pairs(columns: Columns) -> list[Columns]:
    """The rows of each pair over one stretch of time, whose numbers are not checked yet."""
    source_file = columns.source_file
    for column in NUMBERS:
        columns.require_some(column, "choose another table")
    names = list(zip(*(map(_plain, columns.words[word]) for word in WORDS), strict=True))
    # A name that comes again after other rows is another stretch of rows out of order.
    starts = [0, *(row for row in range(1, len(names)) if names[row] != names[row - 1])]
    if len(starts) > min(MOST_RUNS, max(SEVERAL, len(names) / MINIMUM_SAMPLES)):
        fault = f"its {len(names):,} rows change between trajectories {len(starts):,} times"
        raise source_file.refusal(fault, "sort the rows by trajectory and time")
    pairs: dict[tuple[str, ...], Columns] = {}
    for start, end in pairwise((*starts, len(names))):
        if names[start] in pairs:
            fault = f"trajectory {excerpt(names[start][0])} continues here, behind rows of another"
            cure = "sort the rows by trajectory and time, one pair a trajectory"
            place = f"row {columns.layout.header_row + start + 1}"
            raise source_file.refusal(fault, cure, place)
        pairs[names[start]] = columns[start:end]
    return list(pairs.values())


def _plain(word: str) -> str:
    """An identifier without the fraction that some programs write behind whole numbers."""
    return word.removesuffix(".0")


def _identifier(pair: Columns, column: str) -> str:
    return _plain(pair.words[column][0]) if column in pair.words else ""


def _links(source_file: SourceFile, pairs: Sequence[Columns]) -> dict[int, tuple[int, int]]:
    """The pair behind each pair, and the sample of the pair ahead at which it begins.

    A pair has one pair behind and one ahead at most: those with the longest time in common.
    """
    by_leader: dict[str, list[int]] = {}
    for k, pair in enumerate(pairs):
        by_leader.setdefault(_identifier(pair, LEADER), []).append(k)
    behind_each = [by_leader.get(_identifier(pair, FOLLOWER), []) for pair in pairs]
    met = sum(map(len, behind_each))
    samples = sum(
        len(pair) * len(others) + sum(len(pairs[other]) for other in others)
        for pair, others in zip(pairs, behind_each, strict=True) if met <= MOST_COMPARED
    )  # fmt: skip
    if met > MOST_COMPARED or samples > MOST_SAMPLES_COMPARED:
        fault = f"its {len(pairs):,} trajectories have so few vehicles that {met:,} may be one's"
        raise source_file.refusal(fault, "split the file, or name the vehicles of each run apart")
    matches = []
    for k, others in enumerate(behind_each):
        speed = _FollowerSpeed(pairs[k].numbers[FOLLOWER_SPEED])
        for other in others:
            if other != k and (shared := speed.shared(pairs[other].numbers[LEADER_SPEED])):
                matches.append((-shared[0], k, other, shared[1]))
    links: dict[int, tuple[int, int]] = {}
    followers: set[int] = set()
    for _, k, other, shift in sorted(matches):
        last = other
        while last in links:
            last, _ = links[last]
        if k not in links and other not in followers and last != k:  # no circle
            links[k] = other, shift
            followers.add(other)
    return links


class _FollowerSpeed:
    """The speed of the follower of one pair, which may be the leader's of another pair."""

    def __init__(self, speed: FloatArray) -> None:
        """(N,) speed in m/s."""
        self._speed = speed
        self._is_whole = not np.isnan(speed).any()
        self._is_possible = not (np.abs(speed) > SPEED.possible).any()
        self._centre = float(speed.mean()) if self._is_whole else np.nan
        self._transforms: dict[int, NDArray[np.complex128]] = {}

    def shared(self, leading: FloatArray) -> tuple[int, int] | None:
        """Match it in time with another record of a vehicle's speed.

        Args:
            leading: (K,) speed in m/s of the leader of another pair.

        Returns:
            The number of samples in common, and the sample of this speed at which ``leading``
            begins; None where they are not the same vehicle's.
        """
        following = self._speed
        most = min(len(following), len(leading))
        if most < OVERLAP or not self._is_possible or (np.abs(leading) > SPEED.possible).any():
            return None
        if _difference(following[:most], leading[:most]) <= SAME:
            return most, 0
        if not self._is_whole or np.isnan(leading).any():
            return None
        shift, count = self._likely_shift(leading - self._centre)
        if count < OVERLAP:
            return None
        first = following[max(0, shift) : max(0, shift) + count]
        second = leading[max(0, -shift) : max(0, -shift) + count]
        is_same = float(first.std()) >= VARIES and _difference(first, second) <= SAME
        return (count, shift) if is_same else None

    def _likely_shift(self, b: FloatArray) -> tuple[int, int]:
        """The shift at which ``b`` (K,) differs least from this speed a, and the samples in common.

        Both are about the mean of a. Over the samples in common at each shift

            Σ (a - b)² = Σ a² + Σ b² - 2 Σ a b

        where the products are a convolution and the squares running sums.
        """
        from scipy import fft  # takes a while to import, which few need

        a = self._speed - self._centre
        shifts = np.arange(-(len(b) - 1), len(a))
        size = fft.next_fast_len(len(a) + len(b) - 1, real=True)
        if size not in self._transforms:
            self._transforms = {size: fft.rfft(a, size)}  # others have mostly the same length
        products = fft.irfft(self._transforms[size] * fft.rfft(b[::-1], size), size)[: len(shifts)]
        from_a, to_a = np.clip(shifts, 0, None), np.minimum(len(a), shifts + len(b))
        sums_a, sums_b = (np.append(0.0, np.cumsum(values**2)) for values in (a, b))
        squares = sums_a[to_a] - sums_a[from_a] - 2.0 * products
        squares += sums_b[to_a - shifts] - sums_b[from_a - shifts]
        counts = to_a - from_a
        means = np.where(counts >= OVERLAP, squares / np.maximum(counts, 1), np.inf)
        at = int(means.argmin())
        return int(shifts[at]), int(counts[at])


def _difference(first: FloatArray, second: FloatArray) -> float:
    """Root mean square of the difference where both are known; nan where nowhere."""
    return float(np.sqrt(nanmean((first - second) ** 2)))


def _recording(pairs: Sequence[Columns], begins: Sequence[int], is_only: bool) -> Recording:
    """The recording of a platoon; V vehicles are one more than its pairs.

    Its time runs from the first sample of any pair to the last one; where a pair has none, the
    channels that only it knows are missing. ``begins`` are the samples of the first pair's time at
    which each pair begins.

    Raises:
        RecordingError: about the first row that is wrong.
    """
    source_file = pairs[0].source_file
    words = re.sub(r"[_\-]+", " ", source_file.name).lower()
    data_set = next((name for name in DATA_SETS if re.search(rf"\b{name.lower()}", words)), None)
    for pair in pairs:
        for column, quantity in ((LEADER_SPEED, SPEED), (FOLLOWER_SPEED, SPEED), (PAIR_GAP, GAP)):
            pair.measured(quantity, column)
            pair.require_some(column, "choose another trajectory")
        pair.measured(TIME, TIME_INDEX)
    clocks = [pair.time(TIME_INDEX) for pair in pairs]
    starts = np.array(begins) - min(begins)
    places = [slice(s, s + len(pair)) for s, pair in zip(starts, pairs, strict=True)]
    samples, vehicles = max(place.stop for place in places), len(pairs) + 1
    time = np.full(samples, np.nan)
    speed = np.full((samples, vehicles), np.nan)
    gap = np.full((samples, vehicles - 1), np.nan)
    mode = np.full((samples, vehicles), Mode.UNKNOWN, np.int8)
    for k, (place, pair, instants) in enumerate(zip(places, pairs, clocks, strict=True)):
        filled = np.flatnonzero(np.isfinite(time[place]))
        # The first pair's clock serves for all.
        offset = time[place][filled[0]] - instants[filled[0]] if len(filled) else 0.0
        _fill(time[place], instants + offset)
        _fill(speed[place, k], pair.numbers[LEADER_SPEED])
        speed[place, k + 1] = pair.numbers[FOLLOWER_SPEED]
        gap[place, k] = pair.numbers[PAIR_GAP]
        mode[place, k + 1] = Mode.ACC
        if k == 0:
            leader = LEADER_MODES.get(_identifier(pair, LEADER_TYPE), Mode.UNKNOWN)
            is_open = leader is Mode.ACC and data_set in OPENACC_SETS
            mode[place, 0] = Mode.UNKNOWN if is_open else leader
    name = None if is_only else _identifier(pairs[0], TRAJECTORY)
    ids = [_identifier(pairs[0], LEADER), *(_identifier(pair, FOLLOWER) for pair in pairs)]
    return recording_of(
        time - time[0], speed, gap, mode,
        refuse=lambda fault, cure, row: pairs[0].refusal(fault, cure, TIME_INDEX),
        findings=(),
        source=source_file.name + (f", trajectory {excerpt(name)}" if name is not None else ""),
        sha256=source_file.sha256(name),
        campaign=data_set,
        trajectory=name,
        names={k: f"ID {excerpt(identifier)}" for k, identifier in enumerate(ids, 1)},
    )  # fmt: skip


def _fill(place: NDArray[np.float64], values: FloatArray) -> None:
    """Write values where there are none yet."""
    empty = np.isnan(place)
    place[empty] = values[empty]
