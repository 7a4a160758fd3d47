"""What a segment can tell about the law's parameters, before anything is estimated from it.

    mean time gap      mean of p/v over the instants in motion              [s]
    excitation         standard deviations of v_0, of Δv_i and of dv_i/dt
    condition number   of the regressors (p, -v, Δv), each scaled to unit length, over the instants
                       that the segment does not leave out; all else is of all instants
    car-following      share of instants in motion with p/v at most 2 s

Near equilibrium p is close to τv and Δv to zero: the regressors are then nearly collinear, and
many (α, β, τ) explain the data equally well.
"""

from dataclasses import dataclass, replace

import numpy as np

from accpinn.model.cthp import regressors
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, MetresPerSecond, Seconds

MOVING: MetresPerSecond = 1.0
"""Slower vehicles have no meaningful time gap."""
CAR_FOLLOWING: Seconds = 2.0
"""With a longer time gap a vehicle catches up or drives freely, and the law does not hold."""
LITTLE_LEADER_MOTION: MetresPerSecond = 0.5
LITTLE_RELATIVE_MOTION: MetresPerSecond = 0.15
"""Smaller standard deviations come with the receivers' noise alone, or nearly so."""
LARGE_CONDITION = 100.0
"""Windows with motion in them reach 5 to 25, windows near equilibrium several hundred."""
LITTLE_CAR_FOLLOWING = 0.5


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
    warnings: tuple[str, ...]
    """What the data cannot tell, in plain sentences."""


def time_gaps(segment: Segment) -> FloatArray:
    """(N, M): p/v in s, nan where the follower does not move."""
    follower = segment.speeds[:, 1:]
    gaps = np.full_like(segment.gaps, np.nan)
    np.divide(segment.gaps, follower, out=gaps, where=follower > MOVING)
    return gaps


def assess_quality(segment: Segment) -> Quality:
    """Mean time gap, excitation, conditioning and share of car-following, with warnings."""
    gaps = time_gaps(segment)
    speeds = segment.speeds
    moving = np.isfinite(gaps)
    # A mean over no instants is nan without numpy's complaint about it.
    sums, counts = np.where(moving, gaps, 0.0).sum(axis=0), moving.sum(axis=0)
    mean = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    acceleration = np.gradient(speeds[:, 1:], segment.time, axis=0)
    figures = Quality(
        mean_time_gap=_floats(mean),
        leader_deviation=float(speeds[:, 0].std()),
        relative_deviation=_floats((speeds[:, :-1] - speeds[:, 1:]).std(axis=0)),
        acceleration_deviation=_floats(acceleration.std(axis=0)),
        condition=_conditions(segment),
        car_following=_floats((moving & (gaps <= CAR_FOLLOWING)).mean(axis=0)),
        warnings=(),
    )
    return replace(figures, warnings=_warnings(segment, figures))


def _floats(values: FloatArray) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def _conditions(segment: Segment) -> tuple[float, ...]:
    """Of each follower's regressors, where its equation counts."""
    parts = regressors(segment.speeds, segment.gaps)
    if segment.mask is None:
        return tuple(_condition(part) for part in parts)
    return tuple(
        _condition(part[counts]) for part, counts in zip(parts, segment.mask.T, strict=True)
    )


def _condition(part: FloatArray) -> float:
    """Of regressors (N, 3); inf where there are too few to tell."""
    lengths = np.linalg.norm(part, axis=0)
    return (
        float(np.linalg.cond(part / lengths)) if len(part) > 2 and lengths.all() else float("inf")
    )


def _warnings(segment: Segment, figures: Quality) -> tuple[str, ...]:
    warnings = []
    labels = segment.labels
    if figures.leader_deviation < LITTLE_LEADER_MOTION:
        warnings.append(
            f"The leader's speed varies by only {figures.leader_deviation:.2f} m/s (standard"
            " deviation); a window in which it brakes and accelerates tells more."
        )
    followers = range(segment.followers)
    still = [
        f"{labels[k + 1]} (Δv varies by {figures.relative_deviation[k]:.2f} m/s, condition number"
        f" {figures.condition[k]:.0f})"
        for k in followers
        if figures.relative_deviation[k] < LITTLE_RELATIVE_MOTION
        or figures.condition[k] > LARGE_CONDITION
    ]
    if still:
        warnings.append(
            f"Near equilibrium, where α, β and τ cannot be told apart well: {', '.join(still)}."
        )
    elsewhere = [
        f"{labels[k + 1]} ({100 * figures.car_following[k]:.0f} %)"
        for k in followers
        if figures.car_following[k] < LITTLE_CAR_FOLLOWING
    ]
    if elsewhere:
        warnings.append(
            f"In car-following (moving, time gap at most {CAR_FOLLOWING:g} s) for less than"
            f" {100 * LITTLE_CAR_FOLLOWING:.0f} % of the time, and elsewhere the law does not hold:"
            f" {', '.join(elsewhere)}."
        )
    negative = [
        f"{labels[k + 1]} (at {count} instants)"
        for k in followers
        if (count := int((segment.gaps[:, k] < 0).sum()))
    ]
    if negative:
        warnings.append(f"The space-gap is negative, which cannot be: {', '.join(negative)}.")
    return tuple(warnings)
