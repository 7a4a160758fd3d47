"""Identifiability: which parameters the data determine, by intervals, excitation and profiles.

The profile of a parameter is the least-squares criterion with that parameter held:

    S(α, β, τ) = Σ_t (dv/dt - α(p - τv) - βΔv)²,      profile of x:  min over the other two of S

within the rational driving constraints. With one parameter held the model is linear in what is
left, so every point is the exact minimum of a quadratic. A flat profile is a parameter that these
equations do not determine. A steep one proves less: S takes instants as independent and the model
as true, so its minimum may be sharp and yet biased (see `methods.state_space`).

Source: Raue et al., Bioinformatics 25 (2009) 1923-1929, for the use of profiles.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.errors import Finding
from accpinn.inference.intervals import ParameterInterval, Uncertainty, parameter_intervals
from accpinn.methods.regression import Regression, solve_bounded
from accpinn.model.cthp import LARGEST, Case, Parameters
from accpinn.recordings.recording import LITTLE_LEADER_MOTION
from accpinn.segment.quality import LARGE_CONDITION, LITTLE_RELATIVE_MOTION, Quality, assess_quality
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.units import FloatArray, MetresPerSecond, Seconds, frozen

WIDE = 5.0
"""An interval whose upper end is more than so many times its lower one gives little more than the
order of magnitude."""
LONGER = 1.2
"""A recording so many times as long as the window would narrow intervals by a tenth or more."""
INCREASE = 0.01
"""Increase of S that a profile's ends belong to: 1 %, hardly visible in any plot."""
POINTS = 61
FURTHER = 1.5
"""The values reach so many times as far as the ends on either side."""


class WeakIdentification(Finding, frozen=True):
    """A follower's intervals are wide, or its data have little excitation."""

    vehicle: int
    """0 for all followers together."""
    wide: tuple[ParameterInterval, ...] = ()
    leader_deviation: MetresPerSecond | None = None
    """Standard deviation of the leader's speed, if it is too small; so below."""
    relative_deviation: MetresPerSecond | None = None
    """Standard deviation of Δv."""
    condition: float | None = None
    """Condition number of the regressors, if it is too large."""

    @property
    def is_excited(self) -> bool:
        """Whether nothing is wrong with the excitation."""
        return self.leader_deviation is self.relative_deviation is self.condition is None


class NarrowerIntervals(Finding, frozen=True):
    """What would narrow the wide intervals of a segment."""

    vehicles: tuple[int, ...]
    """The followers that have some, those included of which nothing is determined."""
    window: Seconds
    """The window's duration."""
    recording: Seconds | None
    """The recording's, where it is known and longer."""
    is_excited: bool
    """Whether the vehicles move enough in the window, so that more of the same would do."""


def identifiability_warnings(
    segment: Segment, uncertainty: Uncertainty, case: Case = "II"
) -> tuple[WeakIdentification, ...]:
    """A finding for each follower whose parameters the data determine only weakly.

    Args:
        segment: the data.
        uncertainty: of its parameters.
        case: "II"; in Case I all followers share one finding.
    """
    return weakly_identified(segment.info, assess_quality(segment), uncertainty, case)


def weakly_identified(
    info: SegmentInfo, quality: Quality, uncertainty: Uncertainty, case: Case = "II"
) -> tuple[WeakIdentification, ...]:
    """The same where the data are not at hand, but their quality is."""
    found = [
        _identification(uncertainty, quality, k, vehicle)
        for k, vehicle in enumerate((0,) if case == "I" else info.vehicles[1:])
    ]
    return tuple(one for one in found if one.wide or not one.is_excited)


def narrower_intervals(
    info: SegmentInfo,
    uncertainty: Uncertainty,
    warnings: Sequence[WeakIdentification],
    recording: Seconds | None = None,
) -> tuple[NarrowerIntervals, ...]:
    """What would narrow the wide intervals; nothing where there is none.

    Args:
        info: of the segment.
        uncertainty: of its parameters.
        warnings: the segment's, by `identifiability_warnings`.
        recording: duration of the recording that the window is of, where it is known.
    """
    wide = {one.vehicle for one in warnings if one.wide}
    open_ones = np.isnan(uncertainty.centre.alpha)
    vehicles = tuple(
        vehicle
        for vehicle, is_open in zip(info.vehicles[1:], open_ones, strict=True)
        if is_open or vehicle in wide or 0 in wide
    )
    if not vehicles:
        return ()
    duration = info.window.duration
    longer = recording if recording and recording > LONGER * duration else None
    is_excited = all(one.is_excited for one in warnings if one.wide) and not open_ones.any()
    return (NarrowerIntervals(vehicles, duration, longer, is_excited),)


def wide_intervals(uncertainty: Uncertainty, follower: int) -> tuple[ParameterInterval, ...]:
    """Those of α, β, τ that give little more than the order of magnitude."""
    return tuple(filter(is_wide, parameter_intervals(uncertainty, follower)))


def is_wide(one: ParameterInterval) -> bool:
    """Whether an interval gives little more than the order of magnitude; one without ends does not.

    An interval that is 0 alone is narrow.
    """
    return np.isfinite(one.lower) and (one.upper is None or one.upper > WIDE * one.lower)


def _identification(
    uncertainty: Uncertainty, quality: Quality, k: int, vehicle: int
) -> WeakIdentification:
    leader, relative = quality.leader_deviation, quality.relative_deviation[k]
    condition, alone = quality.condition[k], vehicle > 0
    return WeakIdentification(
        vehicle,
        wide_intervals(uncertainty, k),
        leader if leader < LITTLE_LEADER_MOTION else None,
        relative if alone and relative < LITTLE_RELATIVE_MOTION else None,
        condition if alone and condition > LARGE_CONDITION else None,
    )


@dataclass(frozen=True, eq=False)
class Profile:
    """One parameter of one follower held at K values, all else optimal."""

    parameter: str
    """α, β or τ."""
    best: float
    """Where S is least; nan for τ where α = 0."""
    values: FloatArray
    """(K,) in the parameter's unit, ascending."""
    increase: FloatArray
    """(K,) S over its least value, minus one."""
    lower: float
    """The smallest value at which S is at most `INCREASE` above its least."""
    upper: float
    """The largest; infinite where the data set no limit within the plausible range."""


def profiles(segment: Segment, case: Case = "II") -> tuple[tuple[Profile, ...], ...]:
    """Those of α, β and τ of each follower; in Case I the one set that all share."""
    return tuple(
        tuple(_profile(criterion, which) for which in range(3))
        for criterion in _criteria(segment, case)
    )


@dataclass(frozen=True, eq=False)
class _Criterion:
    """S as a quadratic in θ = (α, ατ, β)."""

    gram: FloatArray
    """(3, 3) XᵀX."""
    moment: FloatArray
    """(3,) Xᵀ dv/dt."""
    power: float
    """Σ (dv/dt)²."""
    best: FloatArray
    """(3,) θ of the least S."""

    def at(self, theta: FloatArray) -> float:
        return float(self.power + theta @ self.gram @ theta - 2 * self.moment @ theta)

    def held(self, symbol: str, value: float) -> float:
        """The least S with one parameter at a value: θ = base + directions @ (two unknowns ≥ 0)."""
        base = np.zeros(3)
        if symbol == "τ":
            directions = np.array([[1.0, 0.0], [value, 0.0], [0.0, 1.0]])
        else:
            which = 0 if symbol == "α" else 2
            base[which] = value
            directions = np.delete(np.eye(3), which, axis=1)
        gram = directions.T @ self.gram @ directions
        moment = directions.T @ (self.moment - self.gram @ base)
        return self.at(base + directions @ solve_bounded(gram, moment).theta)


def _criteria(segment: Segment, case: Case) -> list[_Criterion]:
    regression = Regression.of(segment)
    grams, moments = regression.grams(), regression.moments()
    powers = (regression.rates**2).sum(axis=1)
    theta = regression.solve(case).theta
    if case == "I":
        return [_Criterion(grams.sum(axis=0), moments.sum(axis=0), float(powers.sum()), theta[0])]
    return list(map(_Criterion, grams, moments, powers.tolist(), theta))


def _profile(criterion: _Criterion, which: int) -> Profile:
    symbol, limit = PARAMETERS[which].symbol, float(LARGEST.values[which])
    best = float(Parameters.from_theta(criterion.best).values[which])
    least = max(criterion.at(criterion.best), np.finfo(float).tiny)

    def increase(value: float) -> float:
        return max(criterion.held(symbol, value) / least - 1.0, 0.0)

    lower, upper = _ends(increase, best, limit)
    values = _grid(best, lower, upper, limit)
    found = [increase(value) for value in values.tolist()]
    return Profile(symbol, best, frozen(values), frozen(found), lower, upper)


def _ends(increase: Callable[[float], float], best: float, limit: float) -> tuple[float, float]:
    """Where the profile crosses `INCREASE` on either side of the best value."""
    from scipy.optimize import brentq  # takes a quarter of a second, which few commands need

    if not np.isfinite(best):
        return 0.0, float("inf")

    def beyond(value: float) -> float:
        return increase(value) - INCREASE

    lower = float(brentq(beyond, 0.0, best)) if best > 0 and beyond(0.0) > 0 else 0.0
    far = max(2 * best, 1e-3)
    while beyond(far) < 0:
        if far >= limit:
            return lower, float("inf")
        far = min(2 * far, limit)
    return lower, float(brentq(beyond, best, far))


def _grid(best: float, lower: float, upper: float, limit: float) -> FloatArray:
    if not np.isfinite(best):
        return np.linspace(0.0, limit, POINTS)
    above = upper - best if np.isfinite(upper) else max(best, 1e-3) * 4
    first = max(0.0, best - FURTHER * (best - lower))
    return np.linspace(first, best + FURTHER * above, POINTS)
