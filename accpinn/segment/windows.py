"""Windows of a recording: complete ones, those in car-following, and the most informative one.

`complete_windows` are those in which `cut` finds nothing missing. In a window in car-following a
follower qualifies at every instant, where

    its speed, the speed ahead and the space-gap are known (short blocks bridged, as `cut` does);
    no driver controls it: by its driver mode, or by the file's flag where there are no modes;
    it is in car-following by its time gap (see `segment`).

Departures of up to 10 s from the last of these, as behind a car that cuts in, do not interrupt a
stretch. Stretches in which all followers of a chain qualify are taken together; where only one
follower qualifies, its window holds it and the vehicle ahead. Stretches are cut into windows of the
asked length from their start on; the rest of a stretch is a window where it lasts for a minute.

The information that a window holds about the parameters of follower i is that of the regression of
its acceleration (Fedorov, Theory of Optimal Experiments, 1972):

    I_i = Σ_t x_t x_tᵀ,   x = (p, -v, Δv),   over the instants in car-following

Of all windows, those are kept whose share of car-following is close to the largest; among them the
one with the largest Σ_i log det I_i is D-optimal. Two windows compare by their relative
D-efficiency, exp((Σ_i log det I_i - Σ_i log det I'_i)/3M): the first is as informative as the
second if that lasted longer by this factor. Instants driven by hand do not count (see the regimes
of `segment.quality`); where the file has no driver modes, it is not known who drove.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from accpinn.channels import GAP, SPEED
from accpinn.errors import SegmentError
from accpinn.findings import Finding
from accpinn.model.cthp import regressors
from accpinn.recordings import (
    HUMAN_FLAG,
    MOVING,
    Mode,
    Recording,
    ValuesOutOfRange,
    Window,
)
from accpinn.recordings.consistency import AGREEMENT_LIMIT
from accpinn.recordings.inconsistency import GapContradictsSpeeds, Inconsistency
from accpinn.recordings.increments import agreement
from accpinn.segment import Segment, time_gaps
from accpinn.segment.cut import (
    DURATION,
    MAX_FOLLOWERS,
    MINIMUM_DURATION,
    SLACK,
    chains,
    check_vehicles,
    default_vehicles,
    longest_in,
    platoon_of,
)
from accpinn.segment.quality import FOLLOWING, MANUAL, Regimes
from accpinn.units import FloatArray, Mask, Seconds, stretches

DEPARTURE: Seconds = 10.0
"""Longest departure from car-following that does not interrupt a stretch."""
LEAST: Seconds = 60.0
"""Shorter stretches say little about three parameters."""
AUTO = "auto"
"""The value of ``windows`` that asks for all windows in car-following."""
ACC_FLAG = 1
GRID: Seconds = 5.0
"""Step between the starts of windows."""
NEARLY = 0.05
"""Difference of shares of car-following up to which they count as the same."""


def complete_windows(
    recording: Recording, vehicles: Sequence[int], outside: Sequence[Window] = ()
) -> tuple[Window, ...]:
    """The windows of at least `MINIMUM_DURATION` in which nothing is missing once bridged.

    They end where the gap of a follower jumps, and do not overlap the windows ``outside``. The
    vehicles are consecutive numbers, leader first.

    Raises:
        SegmentError: when the vehicles are no platoon.
    """
    pieces = platoon_of(recording, check_vehicles(recording, vehicles)).complete()
    for taken in outside:
        pieces = tuple(
            part
            for piece in pieces
            for part in (Window(piece.start, min(piece.end, taken.start)),
                         Window(max(piece.start, taken.end), piece.end))
            if part.duration >= MINIMUM_DURATION
        )  # fmt: skip
    return pieces


def first_window(
    recording: Recording, stretches: Sequence[Window], length: Seconds = DURATION
) -> Window:
    """The first complete stretch that is long enough, else the longest one."""
    length = min(length, recording.duration)
    usual = Window(0.0, min(length, DURATION))
    best = max(stretches, key=lambda window: min(window.duration, length), default=usual)
    return Window(best.start, min(best.end, best.start + length))


def disjoint_windows(
    recording: Recording, duration: Seconds, vehicles: Sequence[int] | None = None
) -> tuple[Window, ...]:
    """The complete stretches of a recording, cut into windows of equal length.

    A window ends where the next one begins; the remainder of a stretch is left out. The vehicles
    are consecutive numbers, leader first; by default see `default_vehicles`.

    Raises:
        SegmentError: when the vehicles are no platoon, or the duration is too short.
    """
    chosen = default_vehicles(recording) if vehicles is None else vehicles
    if not duration >= MINIMUM_DURATION:
        raise SegmentError(
            f"{recording.source}: windows of {duration:g} s are too short to estimate parameters"
            f" from; take at least {MINIMUM_DURATION:g} s."
        )
    return tuple(
        Window(round(stretch.start + k * duration, 9), round(stretch.start + (k + 1) * duration, 9))
        for stretch in complete_windows(recording, chosen)
        for k in range(math.floor((stretch.duration + SLACK) / duration))
    )


# In car-following


@dataclass(frozen=True)
class PlannedWindow:
    """One task's share of a recording."""

    vehicles: tuple[int, ...]
    """(M+1,) leader first."""
    window: Window
    mode_sources: tuple[str, ...]
    """(M,) what says that ACC drives: "driver" mode or the file's "flag"; else empty."""


def plan(recording: Recording, longest: Seconds) -> tuple[PlannedWindow, ...]:
    """The windows of a recording, in the order of chains and time, none longer than ``longest`` s.

    A follower whose gap contradicts the speeds there has none.
    """
    planned: list[PlannedWindow] = []
    # Chains with no more followers than a segment may have; the last of one leads the next.
    short_chains = (
        chain[first : first + MAX_FOLLOWERS + 1]
        for chain in chains(recording)
        for first in range(0, len(chain) - 1, MAX_FOLLOWERS)
    )
    for chain in short_chains:
        allowed = np.column_stack([_sound(recording, number, longest) for number in chain[1:]])
        together = _windows(recording, np.asarray(allowed.all(axis=1)), longest)
        planned += [_planned(recording, chain, window) for window in together]
        for column, pair in zip(allowed.T, pairwise(chain), strict=True):
            alone = column.copy()
            for window in together:
                alone[recording.rows(window)] = False
            windows = _windows(recording, alone, longest)
            planned += [_planned(recording, pair, window) for window in windows]
    return tuple(planned)


def contradictions(recording: Recording) -> list[Inconsistency]:
    """Contradictions between followers' gaps and speeds."""
    unlike = (finding for finding in recording.findings if isinstance(finding, Inconsistency))
    return [finding for finding in unlike if finding.is_contradiction]


def left_out(recording: Recording, planned: Sequence[PlannedWindow]) -> Iterator[Finding]:
    """Why followers have no window, where it is for their data."""
    followers = {number for place in planned for number in place.vehicles[1:]}
    unlike = contradictions(recording)
    yield from (finding for finding in unlike if finding.follower not in followers)
    if not planned:
        yield from (
            finding
            for finding in recording.findings
            if isinstance(finding, ValuesOutOfRange) and finding.is_above
        )


def _sound(recording: Recording, number: int, longest: Seconds) -> Mask:
    """(N,) where a follower qualifies, without windows in which its gap contradicts the speeds."""
    allowed = qualifies(recording, number)
    for contradiction in contradictions(recording):
        if contradiction.follower != number:
            continue
        if contradiction.is_of_file:
            return np.zeros_like(allowed)
        if isinstance(contradiction, GapContradictsSpeeds):
            for window in _windows(recording, allowed, longest):
                rows = recording.rows(window)
                value = agreement(recording.pair(number - 1, rows))
                allowed[rows] &= value is not None and value >= AGREEMENT_LIMIT
    return allowed


def sound_windows(recording: Recording, number: int, longest: Seconds) -> tuple[Window, ...]:
    """The windows of one follower in car-following under ACC in which its gap fits the speeds."""
    return tuple(_windows(recording, _sound(recording, number, longest), longest))


def car_following(
    recording: Recording, vehicles: Sequence[int] | None = None, longest: Seconds = DURATION
) -> tuple[Window, ...]:
    """The windows in which all chosen followers are in car-following under ACC, with all channels.

    Vehicles are consecutive numbers, leader first; by default see `default_vehicles`. No window is
    longer than ``longest`` s.

    Raises:
        SegmentError: where there is none.
    """
    _, *followers = default_vehicles(recording) if vehicles is None else vehicles
    allowed = np.column_stack([qualifies(recording, number) for number in followers])
    windows = _windows(recording, np.asarray(allowed.all(axis=1)), longest)
    if not windows:
        raise SegmentError(
            f"{recording.source}: no {LEAST:g} s are found in which all followers are in"
            " car-following under ACC; choose fewer vehicles, or a window by --start and"
            " --duration."
        )
    return tuple(windows)


def qualifies(recording: Recording, number: int) -> Mask:
    """(N,) where a follower is in car-following under ACC, with all channels known."""
    modes = recording.mode[:, number - 1]
    by_hand = modes == Mode.HUMAN
    if (modes == Mode.UNKNOWN).all() and recording.acc_flag == HUMAN_FLAG:
        return np.zeros(recording.samples, bool)
    complete = np.zeros(recording.samples, bool)
    for window in complete_windows(recording, (number - 1, number)):
        complete[recording.rows(window)] = True
    allowed: Mask = complete & ~by_hand
    speed, gap = recording.speed_of(number), recording.gap_behind(number - 1)
    # A bridged sample has no time gap of its own and counts as its neighbours do.
    away = allowed & (speed <= MOVING) | (time_gaps(speed, gap) > longest_in(recording, number))
    away |= (speed > SPEED.highest) | (gap > GAP.highest)
    for stretch in stretches(away):
        inside = stretch.first > 0 and stretch.last < recording.samples - 1
        if inside and recording.window(stretch).duration <= DEPARTURE:
            away[stretch.rows] = False
    return allowed & ~away


def _windows(recording: Recording, allowed: Mask, longest: Seconds) -> list[Window]:
    """The windows of all stretches that are long enough."""
    least, windows = max(MINIMUM_DURATION, min(LEAST, longest)), list[Window]()
    for stretch in stretches(allowed):
        whole = recording.window(stretch)
        start = whole.start
        while whole.end - start >= least - SLACK:
            end = min(start + longest, whole.end)
            windows.append(Window(start, round(end, 6)))
            start = round(start + longest, 6)
    return windows


def _planned(recording: Recording, vehicles: Sequence[int], window: Window) -> PlannedWindow:
    rows = recording.rows(window)
    by_flag = "flag" if recording.acc_flag == ACC_FLAG else ""
    followers = np.array(vehicles[1:]) - 1
    is_acc = (recording.mode[rows, followers] == Mode.ACC).any(axis=0)
    sources = tuple("driver" if by_driver else by_flag for by_driver in is_acc)
    return PlannedWindow(tuple(vehicles), window, sources)


# The most informative one


@dataclass(frozen=True)
class Suggestion:
    """The most informative window of a recording about the parameters of M followers."""

    window: Window
    car_following: float
    """The smallest share of the window's instants in car-following of any follower, 0 to 1."""
    manual: float | None
    """The largest share driven by hand of any follower; None where it is 0 as far as is known, but
    the file does not give every follower's modes."""
    candidates: int
    """Number of windows that were compared."""

    @property
    def shortened(self) -> bool:
        """Whether no complete stretch has the usual length."""
        return self.window.duration < DURATION - SLACK


@dataclass(frozen=True, eq=False)
class Information:
    """Information of a recording's windows about the parameters of M followers."""

    start: Seconds
    """First instant, in the recording's time."""
    step: Seconds
    following: Mask
    """(N, M) True where a follower is in car-following."""
    manual: Mask
    """(N, M) True where it is driven by hand."""
    terms: FloatArray
    """(M, N, 3) x in car-following, else zero."""
    mode_known: bool
    """Whether the file has driver modes of every follower."""

    @classmethod
    def of(cls, segment: Segment, regimes: Regimes) -> "Information":
        """The information of a segment, which may be a whole recording with samples missing."""
        counts = (regimes.codes == FOLLOWING) & segment.counts
        return cls(
            start=segment.start,
            step=segment.sample_time,
            following=counts,
            manual=regimes.codes == MANUAL,
            terms=np.where(counts.T[..., None], regressors(segment.speeds, segment.gaps), 0.0),
            mode_known=all(regimes.mode_known),
        )

    def _rows(self, window: Window) -> slice:
        first, last = (round((t - self.start) / self.step) for t in (window.start, window.end))
        return slice(max(first, 0), last + 1)

    def _share(self, holds: Mask, window: Window) -> FloatArray:
        share = holds[self._rows(window)].sum(axis=0) / (round(window.duration / self.step) + 1)
        return np.asarray(share)

    def car_following(self, window: Window) -> float:
        """The smallest share of any follower in car-following, 0 to 1."""
        return float(self._share(self.following, window).min())

    def by_hand(self, window: Window) -> float | None:
        """The largest share of any follower driven by hand; see `Suggestion.manual`."""
        share = float(self._share(self.manual, window).max())
        return share if share or self.mode_known else None

    def log_det(self, window: Window) -> float:
        """Σ_i log det I_i; minus infinity where some follower is never in car-following."""
        terms = self.terms[:, self._rows(window)]
        signs, logs = np.linalg.slogdet(terms.transpose(0, 2, 1) @ terms)
        return float(logs.sum()) if (signs > 0).all() else -np.inf

    def efficiency(self, window: Window, best: Window) -> float:
        """The relative D-efficiency of a window against another; 0 without any information."""
        followers = self.following.shape[1]
        return float(np.exp((self.log_det(window) - self.log_det(best)) / (3 * followers)))


def suggest_window(
    recording: Recording, vehicles: tuple[int, ...], information: Information
) -> Suggestion | None:
    """The most informative window of the usual length about the followers' parameters.

    It is None where no stretch is complete, or a follower never in car-following. The information
    is that of the whole recording's segment of these vehicles, leader first.

    Raises:
        SegmentError: when the vehicles are no platoon.
    """
    candidates = _candidates(complete_windows(recording, vehicles))
    if not candidates:
        return None
    shares = np.array([information.car_following(window) for window in candidates])
    nearly_best = [w for w, s in zip(candidates, shares, strict=True) if s > shares.max() - NEARLY]
    best = max(nearly_best, key=information.log_det)
    if not np.isfinite(information.log_det(best)):
        return None
    following, manual = information.car_following(best), information.by_hand(best)
    return Suggestion(best, following, manual, len(candidates))


def _candidates(complete: tuple[Window, ...]) -> list[Window]:
    """Windows of the usual length on a grid; the longest stretch where none is as long."""
    windows = []
    for stretch in complete:
        first = np.ceil((stretch.start - SLACK) / GRID) * GRID + 0.0
        latest = stretch.end - DURATION
        starts = [float(s) for s in np.arange(first, latest + SLACK, GRID)]
        if not starts and stretch.duration >= DURATION - SLACK:
            starts = [stretch.start]
        windows += [Window(start, round(start + DURATION, 9)) for start in starts]
    longest = max(complete, key=lambda stretch: stretch.duration, default=None)
    return windows or ([longest] if longest else [])
