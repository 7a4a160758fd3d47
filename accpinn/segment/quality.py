"""How well a segment determines the model's parameters, before anything is estimated from it.

    mean time gap      mean of p/v over the instants in motion              [s]
    excitation         standard deviations of v_0, of Δv_i and of dv_i/dt
    condition number   of the regressors (p, -v, Δv), each scaled to unit length, over the instants
                       that the segment's mask does not exclude; all else is of all instants
    car-following      share of instants in motion with p/v at most 2 s

Near equilibrium p is close to τv and Δv to zero: the regressors are then nearly collinear, and
many (α, β, τ) explain the data equally well.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any

import numpy as np

from accpinn.findings import Finding
from accpinn.mask import Mask
from accpinn.model.cthp import regressors
from accpinn.recordings.checks import LITTLE_LEADER_MOTION, MOVING
from accpinn.recordings.recording import LittleLeaderMotion
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, MetresPerSecond, Seconds

CAR_FOLLOWING: Seconds = 2.0
"""With a longer time gap a vehicle catches up or drives freely, and the model does not hold."""
LITTLE_RELATIVE_MOTION: MetresPerSecond = 0.15
"""Smaller standard deviations come with the receivers' noise alone, or nearly so."""
LARGE_CONDITION = 100.0
"""Windows with motion in them reach 5 to 25, windows near equilibrium several hundred."""
LITTLE_CAR_FOLLOWING = 0.5


class NearEquilibrium(Finding, frozen=True):
    """Followers whose regressors are nearly collinear, so that α, β and τ are poorly identified."""

    vehicles: tuple[int, ...]
    deviations: tuple[MetresPerSecond, ...]
    """Standard deviation of each one's Δv."""
    conditions: tuple[float, ...]
    """Condition number of each one's regressors."""


class LittleCarFollowing(Finding, frozen=True):
    """Followers that are in car-following for a small part of the window."""

    vehicles: tuple[int, ...]
    shares: tuple[float, ...]
    """The share of instants in car-following of each, 0 to 1."""


class GapsNegative(Finding, frozen=True):
    """Followers with negative space-gaps."""

    vehicles: tuple[int, ...]
    instants: tuple[int, ...]
    """How many instants of each."""


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
    """Why the parameters may be poorly identified."""


def time_gaps(segment: Segment) -> FloatArray:
    """(N, M): p/v in s, nan where the follower does not move."""
    follower = segment.speeds[:, 1:]
    gaps = np.full_like(segment.gaps, np.nan)
    np.divide(segment.gaps, follower, out=gaps, where=follower > MOVING)
    return gaps


def assess_quality(segment: Segment) -> Quality:
    """Mean time gap, excitation, conditioning and share of car-following, with findings."""
    gaps = time_gaps(segment)
    speeds = segment.speeds
    moving = np.isfinite(gaps)
    # A mean over no instants is nan without numpy's complaint about it.
    sums, counts = np.where(moving, gaps, 0.0).sum(axis=0), moving.sum(axis=0)
    mean = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    acceleration = np.gradient(speeds[:, 1:], segment.time, axis=0)
    figures = Quality(
        mean_time_gap=tuple(mean.tolist()),
        leader_deviation=float(speeds[:, 0].std()),
        relative_deviation=tuple((speeds[:, :-1] - speeds[:, 1:]).std(axis=0).tolist()),
        acceleration_deviation=tuple(acceleration.std(axis=0).tolist()),
        condition=_conditions(segment),
        car_following=tuple((moving & (gaps <= CAR_FOLLOWING)).mean(axis=0).tolist()),
    )
    return replace(figures, findings=tuple(_findings(segment, figures)))


def _conditions(segment: Segment) -> tuple[float, ...]:
    """Of each follower's regressors, where its equation counts."""
    parts = regressors(segment.speeds, segment.gaps)
    mask = np.ones(segment.gaps.shape, bool) if segment.mask is None else segment.mask
    return tuple(_condition(part[counts]) for part, counts in zip(parts, mask.T, strict=True))


def _condition(part: FloatArray) -> float:
    """Of regressors (N, 3); inf where there are fewer instants than parameters."""
    lengths = np.linalg.norm(part, axis=0)
    return float(np.linalg.cond(part / lengths)) if len(part) > 2 and lengths.all() else np.inf


def _findings(segment: Segment, figures: Quality) -> Iterator[QualityFinding]:
    def those(chosen: Mask, *parts: tuple[Any, ...]) -> Iterator[tuple[Any, ...]]:
        return (tuple(compress(part, chosen)) for part in (segment.vehicles[1:], *parts))

    if figures.leader_deviation < LITTLE_LEADER_MOTION:
        yield LittleLeaderMotion(segment.vehicles[0], figures.leader_deviation)
    deviations, conditions = figures.relative_deviation, figures.condition
    still = np.less(deviations, LITTLE_RELATIVE_MOTION) | np.greater(conditions, LARGE_CONDITION)
    if still.any():
        yield NearEquilibrium(*those(still, deviations, conditions))
    elsewhere = np.less(figures.car_following, LITTLE_CAR_FOLLOWING)
    if elsewhere.any():
        yield LittleCarFollowing(*those(elsewhere, figures.car_following))
    negative = (segment.gaps < 0).sum(axis=0)
    if negative.any():
        yield GapsNegative(*those(negative > 0, tuple(negative.tolist())))
