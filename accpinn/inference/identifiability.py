"""Identifiability: which parameters the data determine, by intervals, excitation and profiles.

The profile of a parameter is the least-squares criterion with that parameter held:

    S(α, β, τ) = Σ_t (dv/dt - α(p - τv) - βΔv)²,      profile of x:  min over the other two of S

within the rational driving constraints. With one parameter held the model is linear in the other
two, so every point is the exact minimum of a quadratic. A flat profile means that these equations
do not determine the parameter. A steep profile proves less: S takes the instants as independent and
the model as true, so its minimum may be sharp and yet biased (see `methods.state_space`).

Source: Raue et al., Bioinformatics 25 (2009) 1923-1929, for the use of profiles.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.findings import Finding, Labelled, Words, joined
from accpinn.inference.intervals import SYMBOLS, Uncertainty
from accpinn.methods.regression import Regression, solve_bounded
from accpinn.model.cthp import LARGEST, Case, Parameters
from accpinn.recordings import LITTLE_LEADER_MOTION
from accpinn.segment import Segment, SegmentInfo
from accpinn.segment.quality import LARGE_CONDITION, LITTLE_RELATIVE_MOTION, Quality
from accpinn.units import FloatArray, Mask, MetresPerSecond, Seconds, frozen

WIDE = 5.0
"""Ratio of an interval's ends above which it gives little more than the order of magnitude."""
LONGER = 1.2
"""Ratio of recording to window above which the whole recording would narrow intervals by a tenth or
more."""
INCREASE = 0.01
"""Increase of S at a profile's ends: 1 %, hardly visible in any plot."""
POINTS = 61
"""Number of values of a profile."""
FURTHER = 1.5
"""Reach of a profile's values on either side, as a multiple of the distance to its ends."""


class WeakIdentification(Finding, frozen=True):
    """A follower's intervals are wide, or its data have little excitation."""

    text = "{vehicle}: {spans} more than a factor of {limit:g}{reasons}."
    text_if_narrow = "{vehicle}: treat the intervals with caution{reasons}."

    vehicle: int
    wide: tuple[str, ...] = ()
    """Symbols of the parameters; empty if only the excitation is too small."""
    leader_deviation: MetresPerSecond | None = None
    """Standard deviation of the leader's speed, if it is too small."""
    relative_deviation: MetresPerSecond | None = None
    """Standard deviation of Δv, if it is too small."""
    condition: float | None = None
    """Condition number of the regressors, if it is too large."""

    @property
    def is_excited(self) -> bool:
        """Whether the excitation is sufficient."""
        return self.leader_deviation is self.relative_deviation is self.condition is None

    def sentence(self, about: Labelled) -> str:
        """The finding as a sentence, which depends on whether an interval is wide."""
        return self.filled(self.text if self.wide else self.text_if_narrow, about)

    def _words(self, about: Labelled) -> Words:
        reasons = []
        if self.leader_deviation is not None:
            reasons.append(f"the leader's speed varies by only {self.leader_deviation:.2f} m/s")
        if self.relative_deviation is not None:
            reasons.append(f"Δv varies by only {self.relative_deviation:.2f} m/s")
        if self.condition is not None:
            number = f"condition number {self.condition:.0f}"
            reasons.append(f"the model's terms are nearly proportional ({number})")
        spans = "interval of {} spans" if len(self.wide) == 1 else "intervals of {} span"
        return {
            "spans": f"the {spans.format(joined(self.wide))}",
            "limit": WIDE,
            "reasons": f", as {joined(reasons)}" if reasons else "",
        }


class NarrowerIntervals(Finding, frozen=True):
    """What would narrow the wide intervals of a segment."""

    text = "These would narrow the intervals of {vehicles}: {ways}."

    vehicles: tuple[int, ...]
    """The followers with wide intervals or without any."""
    window: Seconds
    """Duration of the window."""
    recording: Seconds | None
    """Duration of the recording, if it is known and longer than the window."""
    is_excited: bool
    """Whether the excitation is sufficient, so that a longer window alone would narrow them."""

    def _words(self, about: Labelled) -> Words:
        ways = [
            "several windows or runs estimated together (fit --windows, or fit_windows in Python)"
        ]
        if not self.is_excited:
            ways.insert(0, "a window in which the vehicle ahead brakes and accelerates more")
        if self.recording is not None:
            durations = f"{self.recording:,.0f} s; this window has {self.window:,.0f} s"
            ways.insert(0, f"the whole recording ({durations})")
        elif self.is_excited:
            ways.insert(0, "a longer recording")
        return {"ways": ", or ".join(ways)}


def identifiability(
    info: SegmentInfo,
    quality: Quality,
    uncertainty: Uncertainty,
    case: Case = "II",
    recording: Seconds | None = None,
) -> tuple[WeakIdentification | NarrowerIntervals, ...]:
    """The followers that the data determine only weakly, and what would narrow their intervals.

    In Case I all followers share one finding. The duration of the ``recording`` that the window was
    cut from need not be known.
    """
    every = [
        _identification(uncertainty, quality, k, vehicle)
        for k, vehicle in enumerate((0,) if case == "I" else info.vehicles[1:])
    ]
    weak = [finding for finding in every if finding.wide or not finding.is_excited]
    return (*weak, *_narrower(info, uncertainty, weak, recording))


def _narrower(
    info: SegmentInfo,
    uncertainty: Uncertainty,
    warnings: Sequence[WeakIdentification],
    recording: Seconds | None,
) -> tuple[NarrowerIntervals, ...]:
    """What would narrow the wide intervals; empty if none is wide."""
    wide = {warning.vehicle for warning in warnings if warning.wide}
    unknown = np.isnan(uncertainty.centre.alpha)
    vehicles = tuple(
        vehicle
        for vehicle, is_unknown in zip(info.vehicles[1:], unknown, strict=True)
        if is_unknown or vehicle in wide or 0 in wide
    )
    if not vehicles:
        return ()
    duration = info.window.duration
    longer = recording if recording and recording > LONGER * duration else None
    is_excited = all(w.is_excited for w in warnings if w.wide) and not unknown.any()
    return (NarrowerIntervals(vehicles, duration, longer, is_excited),)


def wide_intervals(uncertainty: Uncertainty) -> Mask:
    """(M, 3) whether an interval of α, β or τ gives little more than the order of magnitude.

    One that is not known does not, nor does one that contains only 0. One whose ends are equal
    does: there all draws of the posterior collapsed on one, as where nothing but noise moves, and
    they say nothing.
    """
    lower, upper = uncertainty.lower.values, uncertainty.upper.values
    is_open, is_point = ~np.isfinite(upper), (upper == lower) & (lower > 0.0)
    return np.asarray(np.isfinite(lower) & (is_open | is_point | (upper > WIDE * lower)))


def _identification(
    uncertainty: Uncertainty, quality: Quality, k: int, vehicle: int
) -> WeakIdentification:
    leader, relative = quality.leader_deviation, quality.relative_deviation[k]
    condition, is_alone = quality.condition[k], vehicle > 0
    return WeakIdentification(
        vehicle,
        tuple(compress(SYMBOLS, wide_intervals(uncertainty)[k])),
        leader if leader < LITTLE_LEADER_MOTION else None,
        relative if is_alone and relative < LITTLE_RELATIVE_MOTION else None,
        condition if is_alone and condition > LARGE_CONDITION else None,
    )


@dataclass(frozen=True, eq=False)
class Profile:
    """S with one parameter of one follower held at K values and the others optimal."""

    parameter: str
    """Symbol of the parameter: α, β or τ."""
    best: float
    """Value at the minimum of S; nan for τ where α = 0."""
    values: FloatArray
    """(K,) values in the parameter's unit, ascending."""
    increase: FloatArray
    """(K,) S over its minimum, minus one."""
    lower: float
    """Smallest value at which S is at most `INCREASE` above its minimum."""
    upper: float
    """Largest such value; infinite where the data set no limit within the plausible range."""


def profiles(segment: Segment, case: Case = "II") -> tuple[tuple[Profile, ...], ...]:
    """The profiles of α, β and τ of each follower; in Case I one set, which all share."""
    regression = Regression.of(segment)
    parts = [regression.grams(), regression.moments(), (regression.rates**2).sum(axis=1)]
    if case == "I":
        parts = [part.sum(axis=0, keepdims=True) for part in parts]
    grams, moments, powers = parts
    rows = zip(grams, moments, powers.tolist(), regression.solve(case).theta, strict=False)
    return tuple(tuple(_profile(*row, which) for which in range(3)) for row in rows)


def _profile(
    gram: FloatArray, moment: FloatArray, power: float, theta: FloatArray, which: int
) -> Profile:
    """The profile of α, β or τ, from XᵀX, Xᵀ dv/dt, Σ (dv/dt)² and θ at the minimum of S."""
    symbol, limit = PARAMETERS[which].symbol, float(LARGEST.values[which])
    best = float(Parameters.from_theta(theta).values[which])

    def criterion(theta: FloatArray) -> float:
        return float(power + theta @ gram @ theta - 2 * moment @ theta)

    least = max(criterion(theta), np.finfo(float).tiny)

    def increase(value: float) -> float:
        """The minimum where one is held: θ = base + directions @ (two unknowns ≥ 0)."""
        base = np.zeros(3)
        if symbol == "τ":
            directions = np.array([[1.0, 0.0], [value, 0.0], [0.0, 1.0]])
        else:
            held = 0 if symbol == "α" else 2
            base[held] = value
            directions = np.delete(np.eye(3), held, axis=1)
        rest = directions.T @ (moment - gram @ base)
        part = solve_bounded(directions.T @ gram @ directions, rest)
        return max(criterion(base + directions @ part.theta) / least - 1.0, 0.0)

    lower, upper = _ends(increase, best, limit)
    values = _grid(best, lower, upper, limit)
    increases = [increase(value) for value in values.tolist()]
    return Profile(symbol, best, frozen(values), frozen(increases), lower, upper)


def _ends(increase: Callable[[float], float], best: float, limit: float) -> tuple[float, float]:
    """The values on either side of the best one at which the profile crosses `INCREASE`."""
    from scipy.optimize import brentq  # imported late: it takes a quarter of a second

    def beyond(value: float) -> float:
        return increase(value) - INCREASE

    if not np.isfinite(best):
        return 0.0, float("inf")
    lower, far = 0.0, max(limit, 2 * best)
    if beyond(0.0) > 0:
        lower = float(brentq(beyond, 0.0, best))
    return lower, float(brentq(beyond, best, far)) if beyond(far) > 0 else float("inf")


def _grid(best: float, lower: float, upper: float, limit: float) -> FloatArray:
    if not np.isfinite(best):
        return np.linspace(0.0, limit, POINTS)
    above = upper - best if np.isfinite(upper) else max(best, 1e-3) * 4
    first = max(0.0, best - FURTHER * (best - lower))
    return np.linspace(first, best + FURTHER * above, POINTS)
