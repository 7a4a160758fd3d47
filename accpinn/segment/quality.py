"""Quality of a segment: how well it determines the parameters, and where the model should hold.

    mean time gap      mean of p/v over the instants in motion              [s]
    excitation         standard deviations of v_0, of Δv_i and of dv_i/dt
    condition number   of the regressors (p, -v, Δv), each scaled to unit length, over the instants
                       that the segment's mask does not exclude; all else is of all instants
    car-following      share of instants in car-following (see `segment`)

Samples that are missing are left out of all of these.

Near equilibrium p is close to τv and Δv to zero: the regressors are then nearly collinear, and
many (α, β, τ) explain the data equally well.

Regimes say what a follower does at each instant:

    manual          a driver, not ACC, controls the vehicle (where the file has modes)
    standstill      speed at most 1 m/s
    catching up     larger time gap than in car-following: it catches up or drives freely
    car-following   all else: where the model is meant to hold

Each instant has one regime, the first of these that applies. A file that gives no driver modes
has no manual instants here; `Regimes.mode_known` is False then.

Five questions grade a window before anything is estimated from it, by the limits of the findings:

    complete      is every sample measured, none missing, bridged or frozen?
    excited       do leader and followers move enough to identify α, β and τ?
    following     are the followers in car-following, for which the model is meant?
    driver        does ACC, not a driver, control the followers?
    consistent    is each gap measured, and does it change as the two speeds demand?

Nothing is excluded unless the user asks. Excluded instants keep their data: the motion there is
measured as well as elsewhere, and dp/dt = Δv holds; only the equation of dv/dt does not count.
A choice of instants by the time gap depends on what the model is to explain, so it biases too.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from itertools import compress
from math import nan
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from accpinn.errors import SegmentError
from accpinn.findings import Finding
from accpinn.model.cthp import regressors
from accpinn.recordings import (
    LITTLE_LEADER_MOTION,
    MOVING,
    LittleLeaderMotion,
    Mode,
    Recording,
    frozen_values,
)
from accpinn.recordings.inconsistency import Inconsistency
from accpinn.recordings.increments import agreement
from accpinn.segment import (
    BlocksMissing,
    Bridged,
    DrivenByHand,
    NothingToExclude,
    RegimesExcluded,
    Segment,
)
from accpinn.segment.cut import MINIMUM_DURATION
from accpinn.units import (
    FloatArray,
    Mask,
    MetresPerSecond,
    Seconds,
    frozen,
    nanmean,
    nanstd,
)

LITTLE_RELATIVE_MOTION: MetresPerSecond = 0.15
"""Least standard deviation of Δv beyond that of the receivers' noise alone."""
LARGE_CONDITION = 100.0
"""Largest good condition number; windows with motion reach 5 to 25, near equilibrium hundreds."""
LITTLE_CAR_FOLLOWING = 0.5
"""Least share of a window in car-following that is not reported."""
MOST_FROZEN = 0.05
"""Largest share of a window's instants with frozen samples that is no more than a flaw."""
MOST_CAR_FOLLOWING = 0.9
"""Least share of each follower in a window that is rated as one of car-following."""

FOLLOWING, CATCHING_UP, MANUAL, STANDSTILL = range(4)
REGIMES = ("car-following", "catching up", "manual", "standstill")
"""Names of the regimes by code."""
EXCLUDABLE = REGIMES[CATCHING_UP:]
"""Regimes that can be excluded: all but the first, for which the model is meant."""


class NearEquilibrium(Finding, frozen=True):
    """Followers whose regressors are nearly collinear, so that α, β and τ are poorly identified."""

    text = "Near equilibrium, where α, β and τ are poorly identified: {listed}."
    item_text = "{vehicle} (Δv varies by {deviations:.2f} m/s, condition number {conditions:.0f})"

    vehicles: tuple[int, ...]
    deviations: tuple[MetresPerSecond, ...]
    """Standard deviation of each one's Δv."""
    conditions: tuple[float, ...]
    """Condition number of each one's regressors."""


class LittleCarFollowing(Finding, frozen=True):
    """Followers that are in car-following for a small part of the window."""

    text = (
        f"In car-following for less than {100 * LITTLE_CAR_FOLLOWING:.0f} % of the time, and"
        " elsewhere the model does not hold: {listed}."
    )
    item_text = "{vehicle} ({shares:.1%})"

    vehicles: tuple[int, ...]
    shares: tuple[float, ...]
    """The share of instants in car-following of each, 0 to 1."""


class GapsNegative(Finding, frozen=True):
    """Followers with negative space-gaps."""

    text = "The space-gap is negative, which is impossible: {listed}."
    item_text = "{vehicle} (at {instants} instants)"

    vehicles: tuple[int, ...]
    instants: tuple[int, ...]
    """Number of instants of each."""


QualityFinding = LittleLeaderMotion | NearEquilibrium | LittleCarFollowing | GapsNegative


@dataclass(frozen=True)
class Quality:
    """Figures of a segment with M followers."""

    mean_time_gap: tuple[Seconds, ...]
    """(M,) nan for a follower that never moves."""
    leader_deviation: MetresPerSecond
    """Standard deviation of the leader's speed."""
    relative_deviation: tuple[MetresPerSecond, ...]
    """(M,) of Δv."""
    acceleration_deviation: tuple[float, ...]
    """(M,) of dv/dt, in m/s²."""
    condition: tuple[float, ...]
    """(M,) condition number of the scaled regressors; inf where they are dependent."""
    car_following: tuple[float, ...]
    """(M,) share of instants, 0 to 1."""
    findings: tuple[QualityFinding, ...] = ()
    """Findings that say why the parameters may be poorly identified."""


@lru_cache(maxsize=64)  # page Data asks for the same again and again
def assess_quality(segment: Segment) -> Quality:
    """Mean time gap, excitation, conditioning and share of car-following, with findings.

    Examples:
        >>> import accpinn
        >>> segment = accpinn.cut(accpinn.sample("motorway"), 0, 60, (1, 2))
        >>> bool(accpinn.assess_quality(segment).leader_deviation > 1)
        True
    """
    speeds = segment.measured_speeds
    unknown = np.isnan(segment.measured_gaps + speeds[:, 1:])
    acceleration = np.gradient(speeds[:, 1:], segment.time, axis=0)
    parts = regressors(segment.speeds, segment.gaps)
    figures = Quality(
        mean_time_gap=tuple(nanmean(segment.time_gaps).tolist()),
        leader_deviation=float(nanstd(speeds[:, 0])),
        relative_deviation=tuple(nanstd(speeds[:, :-1] - speeds[:, 1:]).tolist()),
        acceleration_deviation=tuple(nanstd(acceleration).tolist()),
        condition=tuple(map(_condition, parts, segment.counts.T)),
        car_following=tuple(nanmean(np.where(unknown, np.nan, segment.car_following)).tolist()),
    )
    return replace(figures, findings=tuple(_findings(segment, figures)))


def _condition(part: FloatArray, counts: Mask) -> float:
    """Condition number of regressors (N, 3) where they count; inf with too few of these."""
    part = part[counts]
    lengths = np.linalg.norm(part, axis=0)
    return float(np.linalg.cond(part / lengths)) if len(part) > 2 and lengths.all() else np.inf


def _findings(segment: Segment, figures: Quality) -> Iterator[QualityFinding]:
    def those(chosen: Mask, *parts: tuple[Any, ...]) -> Iterator[tuple[Any, ...]]:
        return (tuple(compress(part, chosen)) for part in (segment.vehicles[1:], *parts))

    if figures.leader_deviation < LITTLE_LEADER_MOTION:
        yield LittleLeaderMotion(segment.vehicles[0], figures.leader_deviation)
    deviations, conditions = figures.relative_deviation, figures.condition
    still = np.less(deviations, LITTLE_RELATIVE_MOTION) | np.greater(conditions, LARGE_CONDITION)
    still &= np.isfinite(deviations)  # of what was never measured nothing is said
    if still.any():
        yield NearEquilibrium(*those(still, deviations, conditions))
    elsewhere = np.less(figures.car_following, LITTLE_CAR_FOLLOWING)
    if elsewhere.any():
        yield LittleCarFollowing(*those(elsewhere, figures.car_following))
    negative = (segment.measured_gaps < 0).sum(axis=0)
    if negative.any():
        yield GapsNegative(*those(negative > 0, tuple(negative.tolist())))


@dataclass(frozen=True, eq=False)
class Regimes:
    """The regime of each of M followers at each of N instants."""

    codes: NDArray[np.uint8]
    """(N, M) indices into `REGIMES`."""
    mode_known: tuple[bool, ...]
    """(M,) whether driver modes were at hand, so that manual driving could be seen."""
    measured: Mask | None = None
    """(N, M) whether speed and gap were measured, so that they count in shares; None if all."""

    def __post_init__(self) -> None:
        """Lock the array."""
        object.__setattr__(self, "codes", frozen(self.codes, dtype=np.uint8))

    @property
    def shares(self) -> tuple[tuple[float, ...], ...]:
        """(M, 4) share of the measured instants in each regime, 0 to 1; nan without any."""
        measured = True if self.measured is None else self.measured
        holds = [np.where(measured, self.codes == k, np.nan) for k in range(len(REGIMES))]
        return tuple(map(tuple, nanmean(np.stack(holds, axis=-1)).tolist()))


def label_regimes(segment: Segment, recording: Recording | None = None) -> Regimes:
    """The regime of each follower at each instant.

    The recording that it was cut from gives the driver modes; without it none is manual.

    Raises:
        SegmentError: for another recording.

    Examples:
        >>> import accpinn
        >>> segment = accpinn.cut(accpinn.sample("motorway"), 0, 60, (1, 2))
        >>> accpinn.label_regimes(segment).codes.shape
        (601, 1)
    """
    codes = np.full(segment.gaps.shape, FOLLOWING, np.uint8)
    codes[segment.time_gaps > segment.longest_time_gaps] = CATCHING_UP
    codes[segment.measured_speeds[:, 1:] <= MOVING] = STANDSTILL
    measured: Mask = ~np.isnan(segment.measured_gaps + segment.measured_speeds[:, 1:])
    if recording is None:
        return Regimes(codes, (False,) * segment.followers, measured=measured)
    modes = _modes(segment, recording)
    codes[(modes == Mode.HUMAN).any(axis=0)] = MANUAL
    has_modes = (modes != Mode.UNKNOWN).any(axis=(0, 1))
    return Regimes(codes, tuple(has_modes.tolist()), measured=measured)


def parse_regimes(names: str | Sequence[str]) -> tuple[str, ...]:
    """Regimes that can be excluded, from "catching-up,standstill" or from their names.

    Raises:
        SegmentError: for a name that is not known.
    """
    spellings = {spelt: name for name in EXCLUDABLE for spelt in (name, as_typed(name))}
    chosen = [part.strip() for part in (names.split(",") if isinstance(names, str) else names)]
    for part in chosen:
        if part not in spellings:
            listed = ", ".join(map(as_typed, EXCLUDABLE))
            raise SegmentError(f'"{part[:40]}" cannot be excluded; choose from {listed}.')
    return tuple(spellings[part] for part in chosen)


def as_typed(name: str) -> str:
    """The name of a regime as it is typed, without spaces."""
    return name.replace(" ", "-")


def exclude_regimes(segment: Segment, regimes: Regimes, names: str | Sequence[str]) -> Segment:
    """The segment with a mask that excludes the instants of some of its regimes.

    Names are as `parse_regimes` takes them. What its own mask excludes stays excluded.

    Raises:
        SegmentError: when a name is not known, or too little of a follower's data remains.

    Examples:
        >>> import accpinn
        >>> segment = accpinn.cut(accpinn.sample("motorway"), 0, 60, (1, 2))
        >>> regimes = accpinn.label_regimes(segment)
        >>> accpinn.exclude_regimes(segment, regimes, "standstill").samples
        601
    """
    named = parse_regimes(names)
    chosen = tuple(name for name in EXCLUDABLE if name in named)
    if not chosen:
        return segment
    excluded = np.isin(regimes.codes, [REGIMES.index(name) for name in chosen])
    if not excluded.any():
        return replace(segment, findings=(*segment.findings, NothingToExclude(chosen)))
    mask = ~excluded if segment.mask is None else segment.mask & ~excluded
    shares = tuple((~mask).mean(axis=0).tolist())
    finding = RegimesExcluded(regimes=chosen, vehicles=segment.vehicles[1:], shares=shares)
    part = replace(
        segment,
        mask=mask,
        excluded_regimes=tuple(dict.fromkeys((*segment.excluded_regimes, *chosen))),
        findings=(*segment.findings, finding),
    )
    left = part.counts.sum(axis=0) * segment.sample_time
    worst = int(left.argmin())
    if left[worst] < MINIMUM_DURATION:
        raise SegmentError(
            f"{segment.source}: without {' and '.join(chosen)} only {left[worst]:.1f} s of"
            f" {segment.labels[worst + 1]} remain, where {MINIMUM_DURATION:g} s are needed; exclude"
            " less, or take other vehicles or another window."
        )
    return part


def _modes(segment: Segment, recording: Recording) -> NDArray[np.int8]:
    """(2, N, M) modes at the recording's samples on either side of each instant.

    An instant on a sample has that sample on both sides; one that was interpolated draws on two.
    """
    if segment.sha256 != recording.sha256:
        raise SegmentError(
            f"{recording.source} is not the recording that this window was cut from; take the"
            f" modes from {segment.source}."
        )
    instants = segment.start + segment.time
    slack = 0.01 * segment.sample_time
    before = np.searchsorted(recording.time, instants + slack, side="right") - 1
    after = np.searchsorted(recording.time, instants - slack, side="left")
    rows = np.stack([before, after]).clip(0, recording.samples - 1)
    followers = np.array(segment.vehicles[1:]) - 1
    return np.asarray(recording.mode[rows][:, :, followers])


# Grades of a window, before anything is estimated from it


Question = Literal["complete", "excited", "following", "driver", "consistent"]


class Grade(Enum):
    """The grade of a window by one question."""

    GOOD = "good"
    FAIR = "fair"
    POOR = "poor"
    UNKNOWN = "not known"


@dataclass(frozen=True)
class Rating:
    """The answer to one question."""

    question: Question
    grade: Grade
    findings: tuple[Finding, ...] = ()
    """Findings that say why it is not good."""
    value: float = nan
    """The quantity behind the answer, of several followers that of the worst; nan where unknown:

        complete      share of instants at which every speed and gap was measured
        excited       condition number
        following     share of instants in car-following
        driver        share of samples under ACC
        consistent    correlation of the gap's changes with the difference of the speeds
    """


def rate(segment: Segment, recording: Recording, quality: Quality) -> tuple[Rating, ...]:
    """All ratings of a window of a recording, in the order of the questions."""
    columns, ahead = np.array(segment.vehicles) - 1, segment.vehicles[:-1]
    rows = recording.rows(segment.window)
    frozen, is_frozen = frozen_values(recording, segment.vehicles, rows)
    missing = (*_of(segment.findings, BlocksMissing | Bridged), *frozen)
    speeds, gaps = recording.speed[rows][:, columns], recording.gap[rows][:, columns[:-1]]
    is_missing = np.isnan(speeds).any(axis=1) | np.isnan(gaps).any(axis=1)
    measured = 1.0 - float((is_frozen | is_missing).mean())
    is_incomplete = bool(segment.blocks_missing) or float(is_frozen.mean()) > MOST_FROZEN
    still = _of(quality.findings, LittleLeaderMotion | NearEquilibrium)
    elsewhere = _of(quality.findings, LittleCarFollowing)
    by_hand = _of(segment.findings, DrivenByHand)
    unlike = [f for f in segment.findings if isinstance(f, Inconsistency)]
    wrong = (*unlike, *_of(quality.findings, GapsNegative))
    is_wrong = any(f.is_contradiction for f in unlike) or len(wrong) > len(unlike)
    modes = recording.mode[rows, columns[1:]]
    is_human, no_mode = (bool((modes == mode).any()) for mode in (Mode.HUMAN, Mode.UNKNOWN))
    share = nan if no_mode else float((modes == Mode.ACC).mean(axis=0).min())
    agreements = [agreement(recording.pair(number, rows)) for number in ahead]
    agreed = [value for value in agreements if value is not None]
    is_near = bool(_of(still, NearEquilibrium)) or np.isinf(max(quality.condition))
    following = min(quality.car_following)
    return (
        Rating("complete", _grade(is_incomplete, bool(missing)), missing, measured),
        Rating("excited", _grade(is_near, bool(still)), still, max(quality.condition)),
        Rating(
            "following",
            _grade(bool(elsewhere), not following >= MOST_CAR_FOLLOWING),
            elsewhere,
            following,
        ),
        Rating("driver", _grade(bool(by_hand), is_human, no_mode), by_hand, share),
        Rating(
            "consistent",
            _grade(is_wrong, bool(wrong), len(agreed) < len(agreements)),
            wrong,
            min(agreed, default=nan),
        ),
    )


def _grade(is_poor: bool, is_fair: bool = False, is_unknown: bool = False) -> Grade:
    """The grade by the first of these that holds."""
    worse = Grade.POOR if is_poor else Grade.FAIR if is_fair else Grade.UNKNOWN
    return worse if is_poor or is_fair or is_unknown else Grade.GOOD


def _of(findings: Iterable[Finding], kind: object) -> tuple[Finding, ...]:
    return tuple(f for f in findings if isinstance(f, kind))  # type: ignore[arg-type]
