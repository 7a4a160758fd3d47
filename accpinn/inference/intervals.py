"""The uncertainty of α, β, τ and of what follows from them; the probability of string stability.

The intervals are those of the posterior distribution (see `inference.posterior`). Its model has
disturbances that are correlated over time and to which the vehicle itself responds. The intervals
depend on the recording alone, so the same intervals serve every method: an estimate lies inside or
outside. Least squares, splines and the PiNN's presets `fast` and `paper` minimise the residual of
the model and are biased by disturbances, so their estimates may lie outside; a finding says so.

Draws are above zero, because the prior is one of logarithms. If the likelihood is largest at zero,
the interval begins there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import compress
from typing import Any, Literal

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.errors import ConfigError
from accpinn.findings import Finding, Labelled, Words, joined
from accpinn.inference.window_posterior import joint_posterior, parameters_of
from accpinn.methods import one_thread, simulation
from accpinn.methods.estimate import Fit, Outcome
from accpinn.methods.maximum_likelihood import KEY
from accpinn.model.cthp import Case, Parameters
from accpinn.model.registry import CTHPS, Fixed
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from accpinn.stability.criteria import (
    crossovers,
    exact_margin,
    l2_margin,
    peaks,
    response,
    step_metrics,
)
from accpinn.units import FloatArray, Mask, RadiansPerSecond

EXACT = "posterior of the exact likelihood, by importance sampling"
BY_SIMULATION = "normal approximation about the best closed-loop simulation"
"""How draws are made: of a CTHP, and of any other model."""
LEVEL = 0.9
"""Level of the intervals."""
SYMBOLS = tuple(parameter.symbol for parameter in PARAMETERS)
HUGE = 1e300
"""Stands for an infinite draw where quantiles are taken."""
DRAWS = 2000
"""Number of draws of equal weight, for ends of intervals, bands and clouds."""
SLACK = 0.04
"""Share of an interval's width by which its sampled ends vary from seed to seed."""
FREQUENCIES = 200
"""Number of frequencies among which that of a platoon's largest growth is looked for."""
FEW = 50
"""Independent draws below which intervals are called rough."""
ENDS = ("centre", "lower", "upper")
"""Fields of `Uncertainty` that hold parameters of the followers."""

Cause = Literal["disturbances", "apart", "closed loop", "unfinished", "stopped", "diverged"]
CAUSES: dict[Outcome, Cause] = {
    Outcome.STOPPED: "stopped",
    Outcome.DIVERGED: "diverged",
    Outcome.FINISHED: "unfinished",
}
"""Why the estimate of a training that did not converge may lie outside its interval."""
UNBIASED = "calibrated"
"""The PiNN's preset that disturbances do not bias."""


_BIAS = (
    "disturbances to which the vehicle itself responds bias what fits the accelerations best, so"
    " prefer the answer"
)
WHY: dict[Cause, str] = {
    "disturbances": _BIAS,
    "apart": "the likelihood has a long tail or several maxima here",
    "closed loop": "errors of a closed loop add up, so its best fit scatters more than the interval"
    " says; prefer the answer",
    "unfinished": f"more iterations may change it, or {_BIAS}",
    "stopped": "training was stopped before its end",
    "diverged": "training diverged",
}
"""Why an estimate lies outside its interval, as the sentence says it."""


class NotDetermined(Finding, frozen=True):
    """The window is too short for a follower's parameters, or nothing moves in it."""

    text = (
        "{vehicle}: these data determine none of α, β and τ; choose a longer window, or one in"
        " which the vehicle ahead brakes and accelerates."
    )

    vehicle: int


class OutsideInterval(Finding, frozen=True):
    """Some of a follower's estimates lie outside their intervals."""

    text = "{vehicle}: the estimate's {named} outside the interval; {why}."

    vehicle: int
    symbols: tuple[str, ...]
    """The symbols of the parameters: α, β or τ."""
    cause: Cause
    """Most probable cause; a key of `WHY`."""

    def _words(self, about: Labelled) -> Words:
        verb = "lies" if len(self.symbols) == 1 else "lie"
        return {"named": f"{joined(self.symbols)} {verb}", "why": WHY[self.cause]}


class FewDraws(Finding, frozen=True):
    """The draws of a follower's posterior are worth few independent ones."""

    text = (
        "{vehicle}: the draws of the posterior are worth only {draws} independent ones, as the"
        " likelihood has a long tail or several maxima here: intervals and probabilities are rough."
    )

    vehicle: int
    draws: int


UncertaintyFinding = NotDetermined | OutsideInterval | FewDraws


@dataclass(frozen=True, eq=False)
class Interval:
    """Ends of the intervals of M followers or at K frequencies."""

    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The uncertainty of the parameters of each of M followers, given a recording."""

    method: str
    """Name of the computation."""
    level: float
    """Share of such intervals that cover the truth, if the model holds."""
    centre: Parameters
    """(M,) the maximum-likelihood estimate; nan where `NotDetermined`."""
    lower: Parameters
    """(M,)"""
    upper: Parameters
    """(M,)"""
    inside: Mask
    """(M, 3) whether the fit's estimate lies in the interval, up to `SLACK`."""
    draws: Parameters
    """(n, M) draws of equal weight from the posterior; nan where `NotDetermined`."""
    probability_l2: FloatArray
    """(M,) probability of L₂ string stability; nan where `NotDetermined`."""
    probability_linf: FloatArray
    """(M,) probability of L∞ string stability, by the exact criterion."""
    peak_gain: Interval
    """max |H|; 1 where no frequency is amplified."""
    linf_gain: Interval
    """‖h‖₁; 1 where no peak is amplified."""
    crossover: Interval
    """ω_c in rad/s, below which frequencies are amplified; 0 where none is."""
    findings: tuple[UncertaintyFinding, ...]


@one_thread
def intervals(
    segment: Segment | Sequence[Segment],
    fit: Fit,
    level: float = LEVEL,
    draws: int = DRAWS,
    held: Fixed = (),
) -> Uncertainty:
    """Compute the uncertainty of the parameters, given a segment; takes about a second.

    It is that under the fit's own model.

    Args:
        segment: the data; several segments of the same vehicles are estimated together.
        fit: any method's estimate on them, which is compared with the intervals.
        level: share of intervals that are to cover the truth, above 0 and below 1.
        draws: number of draws.
        held: terms of the model that keep their values.

    Raises:
        ConfigError: for a level or a number of draws that is not allowed.
    """
    if not 0.0 < level < 1.0:
        raise ConfigError(f"level: {level:g} is not allowed; choose above 0 and below 1, as 0.9.")
    if draws < 2:
        raise ConfigError(f"draws: {draws} is not allowed; choose at least 2, as {DRAWS}.")
    segments = (segment,) if isinstance(segment, Segment) else tuple(segment)
    known = shared(segments, fit.case, level, draws, ModelSpec(fit.model, held))
    return with_estimates(known, segments[0], fit)


def with_estimates(uncertainty: Uncertainty, segment: Segment, fit: Fit) -> Uncertainty:
    """The same uncertainty, with a fit's estimates on a segment compared with the intervals."""
    inside = within(fit.parameters.values, uncertainty.lower.values, uncertainty.upper.values)
    compared = replace(uncertainty, inside=inside)
    return replace(compared, findings=tuple(_findings(segment, fit, compared)))


def agree(old: Uncertainty, new: Uncertainty) -> bool:
    """Whether estimates, ends and probabilities agree up to `SLACK`, as for the same data.

    Processors round differently, and one draw more or less beyond an end moves it.
    """
    if old.draws.everything.shape != new.draws.everything.shape or old.level != new.level:
        return False
    spread = SLACK * (new.upper.everything - new.lower.everything)
    pairs = [(getattr(old, n).everything, getattr(new, n).everything, spread) for n in ENDS]
    for name in ("peak_gain", "linf_gain", "crossover"):
        before, after = getattr(old, name), getattr(new, name)
        spread = SLACK * (after.upper - after.lower)
        pairs += [(before.lower, after.lower, spread), (before.upper, after.upper, spread)]
    for name in ("probability_l2", "probability_linf"):
        pairs.append((getattr(old, name), getattr(new, name), np.full(1, SLACK)))
    return all(
        np.shape(before) == np.shape(after)
        and bool(np.all((np.abs(before - after) <= spread) | (np.isnan(before) & np.isnan(after))))
        for before, after, spread in pairs
    )


def within(estimate: FloatArray, lower: FloatArray, upper: FloatArray) -> Mask:
    """(M, 3) whether estimates lie in their intervals, up to the `SLACK` of the drawn ends.

    An estimate of nan lies outside; everything lies inside where nothing is known, nan.
    """
    slack = SLACK * (upper - lower)
    inside = (estimate >= lower - slack) & (estimate <= upper + slack)
    return np.asarray(inside | np.isnan(lower))


def of_first(uncertainty: Uncertainty) -> Uncertainty:
    """The uncertainty of the first follower alone, who stands for all in Case I."""
    parts: dict[str, Any] = {"draws": uncertainty.draws[:, :1]}
    for name in ("centre", "lower", "upper", "inside", "probability_l2", "probability_linf"):
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


@lru_cache(maxsize=64)
def growth(
    uncertainty: Uncertainty, order: tuple[int, ...], omega: RadiansPerSecond | None = None
) -> tuple[float, float]:
    """The interval of Π |H(jω)|, the growth of a disturbance from the leader to the last follower.

    The order is the place of each vehicle of the platoon, from 0; one may be repeated. ω is in
    rad/s and above zero; None is where the disturbance grows most. In Case I a draw is one of the
    platoon; otherwise the followers' draws are independent. The ends are infinite behind a vehicle
    that is not damped, and nan where a vehicle is not determined.
    """
    draws, rng = uncertainty.draws, np.random.default_rng(0)
    shared = bool((draws.everything == draws.everything[:, :1]).all())
    if np.isnan(draws.alpha[:, [*order]]).any():
        return np.nan, np.nan
    tops = peaks(draws)
    amplified = tops.omega[tops.omega > 0]
    if omega is None and not amplified.size:
        return 1.0, 1.0
    at = np.array([omega])
    if omega is None:
        at = np.geomspace(0.5 * amplified.min(), amplified.max(), FREQUENCIES)
    whole = np.ones((len(draws.alpha), 1))
    for k in sorted({*order}):
        gain = np.where(np.isinf(tops.gain[:, k, None]), np.inf, np.abs(response(draws[:, k], at)))
        whole = whole * (gain if shared else rng.permutation(gain)) ** order.count(k)
    largest = whole[:, 0] if omega else np.maximum(whole.max(axis=1), 1.0)
    lower, upper = interval_ends(largest, uncertainty.level)
    return float(lower), float(upper)


@lru_cache(maxsize=64)
def shared(
    segments: tuple[Segment, ...], case: Case, level: float, draws: int, spec: ModelSpec
) -> Uncertainty:
    """The part that does not depend on the fit, which all methods on a segment share."""
    posterior = joint_posterior(segments, case, spec, draws)
    drawn = parameters_of(spec.model, np.swapaxes(posterior.drawn, 0, 1), posterior.speeds)
    method = EXACT if spec.model in CTHPS else BY_SIMULATION
    return from_draws(Parameters.of(posterior.estimates), drawn, level, method)


def from_draws(
    centre: Parameters, draws: Parameters, level: float, method: str = EXACT
) -> Uncertainty:
    """Compute the uncertainty from (n, M) draws of the posterior, of equal weight.

    The centre (M,) is the maximum-likelihood estimate; both are nan for followers that are not
    determined.
    """
    known = ~np.isnan(draws.alpha[0])
    lower, upper = ends_of(centre, draws, level)
    gains = step_metrics(draws).gain
    is_linf = exact_margin(draws, gains) >= 0
    return Uncertainty(
        method=method,
        level=level,
        centre=centre,
        lower=lower,
        upper=upper,
        inside=np.ones_like(lower.everything, dtype=bool),
        draws=draws,
        probability_l2=np.where(known, (l2_margin(draws) >= 0).mean(axis=0), np.nan),
        probability_linf=np.where(known, is_linf.mean(axis=0), np.nan),
        peak_gain=Interval(*interval_ends(peaks(draws).gain, level)),
        linf_gain=Interval(*interval_ends(gains, level)),
        crossover=Interval(*interval_ends(np.nan_to_num(crossovers(draws)), level)),
        findings=(),
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


def interval_ends(values: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
    """Lower and upper quantiles over the first axis of what is not nan; nan where most is.

    An end among infinite values is infinite.
    """
    tails = (1.0 - level) / 2.0, (1.0 + level) / 2.0
    values = np.clip(values, -HUGE, HUGE)  # the mean of two infinite ones is none
    ends = np.quantile(values, tails, axis=0)
    partly = np.isnan(ends[0]) & (np.isnan(values).mean(axis=0) <= 0.5)
    if partly.any():
        ends[:, partly] = np.nanquantile(values[:, partly], tails, axis=0)
    ends = np.where(np.abs(ends) > 1e-9 * HUGE, np.copysign(np.inf, ends), ends)
    return ends[0], ends[1]


def effective_draws(drawn: FloatArray) -> float:
    """How many independent draws are worth as much as (n,) draws, some of them repeated."""
    counts = np.unique(drawn, return_counts=True)[1]
    return float(counts.sum() ** 2 / (counts**2).sum())


def _findings(segment: Segment, fit: Fit, compared: Uncertainty) -> list[UncertaintyFinding]:
    findings: list[UncertaintyFinding] = []
    for k, vehicle in enumerate((0,) if fit.case == "I" else segment.vehicles[1:]):
        if np.isnan(compared.centre[k].alpha):
            findings.append(NotDetermined(vehicle))
        elif 1 < (effective := effective_draws(compared.draws.alpha[:, k])) < FEW:
            findings.append(FewDraws(vehicle, round(effective)))
        outside = ~compared.inside[k] & np.isfinite(fit.parameters[k].values)
        if outside.any():
            symbols = tuple(compress(SYMBOLS, outside))
            findings.append(OutsideInterval(vehicle, symbols, _cause(fit)))
    return findings


def _cause(fit: Fit) -> Cause:
    """Why an estimate may lie outside: bias, or an irregular likelihood for unbiased methods."""
    if fit.method == simulation.KEY:
        return "closed loop"
    unbiased = fit.method == KEY or fit.config.get("preset") == UNBIASED
    return "apart" if unbiased else CAUSES.get(fit.outcome, "disturbances")
