"""Probabilities of string stability, gains and bands from the draws of an estimate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import (
    crossovers,
    exact_margin,
    l2_margin,
    peaks,
    response,
    step_metrics,
)
from accpinn.units import FloatArray, Mask, RadiansPerSecond, interval_ends

LEVEL = 0.9
"""Level of the intervals."""
SLACK = 0.04
"""Share of an interval's width by which its sampled ends vary from seed to seed."""
FREQUENCIES = 200
"""Number of frequencies among which that of a platoon's largest growth is looked for."""
FEW = 50
"""Independent draws below which intervals are called rough."""


@dataclass(frozen=True, eq=False)
class Interval:
    """Ends of the intervals of M followers or at K frequencies."""

    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The uncertainty of the parameters of each of M followers, given a recording."""

    level: float
    """Share of such intervals that cover the truth, if the model holds."""
    centre: Parameters
    """(M,) the estimate; nan where nothing is determined."""
    lower: Parameters
    """(M,)"""
    upper: Parameters
    """(M,)"""
    draws: Parameters
    """(n, M) draws of equal weight of the typical value; nan where nothing is determined."""
    probability_l2: FloatArray
    """(M,) probability of L₂ string stability; nan where nothing is determined."""
    probability_linf: FloatArray
    """(M,) probability of L∞ string stability, by the exact criterion."""
    peak_gain: Interval
    """max |H|; 1 where no frequency is amplified."""
    linf_gain: Interval
    """‖h‖₁; 1 where no peak is amplified."""
    crossover: Interval
    """ω_c in rad/s, below which frequencies are amplified; 0 where none is."""


def within(estimate: FloatArray, lower: FloatArray, upper: FloatArray) -> Mask:
    """(..) whether estimates lie in their intervals, up to the `SLACK` of the drawn ends.

    An estimate of nan lies outside; everything lies inside where nothing is known, nan.
    """
    slack = SLACK * (upper - lower)
    inside = (estimate >= lower - slack) & (estimate <= upper + slack)
    return np.asarray(inside | np.isnan(lower))


def of_first(uncertainty: Uncertainty) -> Uncertainty:
    """The uncertainty of the first follower alone, who stands for all in Case I."""
    parts: dict[str, Any] = {"draws": uncertainty.draws[:, :1]}
    for name in ("centre", "lower", "upper", "probability_l2", "probability_linf"):
        parts[name] = getattr(uncertainty, name)[:1]
    for name in ("peak_gain", "linf_gain", "crossover"):
        ends: Interval = getattr(uncertainty, name)
        parts[name] = Interval(ends.lower[:1], ends.upper[:1])
    return replace(uncertainty, **parts)


def gain_band(uncertainty: Uncertainty, follower: int, omega: FloatArray) -> Interval:
    """The interval of a follower's |H(jω)|, 0 for the first, at (K,) ω in rad/s above zero.

    Its ends are nan where nothing is known.
    """
    draws = uncertainty.draws[:, follower]
    if np.isnan(draws.alpha).any():
        return Interval(*np.full((2, len(omega)), np.nan))
    return Interval(*interval_ends(np.abs(response(draws, omega)), uncertainty.level))


def platoon_band(uncertainty: Uncertainty, order: Sequence[int], omega: FloatArray) -> Interval:
    """The interval of Π |H(jω)| along a platoon at (K,) ω in rad/s above zero.

    The order is the place of each of its vehicles, from 0. The ends are nan where a vehicle is not
    determined.
    """
    if np.isnan(uncertainty.draws.alpha[:, [*order]]).any():
        return Interval(*np.full((2, len(omega)), np.nan))
    gains = _along(uncertainty.draws, order, omega)
    return Interval(*interval_ends(gains, uncertainty.level))


def growth(
    uncertainty: Uncertainty, order: tuple[int, ...], omega: RadiansPerSecond | None = None
) -> tuple[float, float]:
    """The interval of Π |H(jω)|, the growth of a disturbance from the leader to the last follower.

    The order is the place of each vehicle of the platoon, from 0; one may be repeated. ω is in
    rad/s and above zero; None is where the disturbance grows most. The ends are infinite behind a
    vehicle that is not damped, and nan where a vehicle is not determined.
    """
    draws = uncertainty.draws
    if np.isnan(draws.alpha[:, [*order]]).any():
        return np.nan, np.nan
    tops = peaks(draws).omega
    amplified = tops[tops > 0]
    if omega is None and not amplified.size:
        return 1.0, 1.0
    at = np.array([omega])
    if omega is None:
        at = np.geomspace(0.5 * amplified.min(), amplified.max(), FREQUENCIES)
    whole = _along(draws, order, at)
    largest = whole[:, 0] if omega else np.maximum(whole.max(axis=1), 1.0)
    lower, upper = interval_ends(largest, uncertainty.level)
    return float(lower), float(upper)


def _along(draws: Parameters, order: Sequence[int], omega: FloatArray) -> FloatArray:
    """(n, K) the product of the gains of vehicles, infinite behind one that is not damped.

    In Case I a draw is one of the platoon; otherwise the followers' draws are independent.
    """
    rng, tops = np.random.default_rng(0), peaks(draws).gain
    shared = bool((draws.everything == draws.everything[:, :1]).all())
    whole = np.ones((len(draws.alpha), len(omega)))
    for k in sorted({*order}):
        undamped = np.isinf(tops[:, k, None])
        gain = np.where(undamped, np.inf, np.abs(response(draws[:, k], omega)))
        whole = whole * (gain if shared else rng.permutation(gain)) ** [*order].count(k)
    return whole


def from_draws(centre: Parameters, draws: Parameters, level: float) -> Uncertainty:
    """The uncertainty of an estimate (M,), from (n, M) draws of equal weight.

    Both are nan for followers that are not determined.
    """
    determined = ~np.isnan(draws.alpha[0])
    lower, upper = ends_of(centre, draws, level)
    gains = step_metrics(draws).gain
    is_linf = exact_margin(draws, gains) >= 0
    return Uncertainty(
        level=level,
        centre=centre,
        lower=lower,
        upper=upper,
        draws=draws,
        probability_l2=np.where(determined, (l2_margin(draws) >= 0).mean(axis=0), np.nan),
        probability_linf=np.where(determined, is_linf.mean(axis=0), np.nan),
        peak_gain=Interval(*interval_ends(peaks(draws).gain, level)),
        linf_gain=Interval(*interval_ends(gains, level)),
        crossover=Interval(*interval_ends(np.nan_to_num(crossovers(draws)), level)),
    )


def ends_of(centre: Parameters, draws: Parameters, level: float) -> tuple[Parameters, Parameters]:
    """Lower and upper ends (M,), from the likeliest values (M,) and draws (n, M).

    A component that is likeliest to be zero has its lower end there; a lag or a delay at its least
    value is an end of its interval.
    """
    lower, upper = interval_ends(draws.everything, level)
    lower = np.where(centre.everything == 0.0, 0.0, lower)
    lower[..., 4:6] = np.fmin(lower[..., 4:6], centre.complete[..., 4:6])
    return Parameters.of(lower), Parameters.of(upper)


def effective_draws(drawn: FloatArray) -> float:
    """The effective number of independent draws among (n,) draws, some of them repeated."""
    counts = np.unique(drawn, return_counts=True)[1]
    return float(counts.sum() ** 2 / (counts**2).sum())
