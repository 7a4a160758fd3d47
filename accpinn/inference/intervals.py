"""The uncertainty of α, β, τ and of what follows from them; the probability of string stability.

The intervals are those of the posterior distribution (see `inference.posterior`), whose model has
disturbances that last and to which the vehicle itself responds. They depend on the recording alone,
so one set of them serves every method: an estimate is judged by whether it lies inside. Least
squares, splines and the PiNN's presets `fast` and `paper` minimise the residual of the model and
are biased by disturbances, so their estimates may lie outside; a finding then says so.

Draws are above zero, as the prior is one of logarithms. Where the likelihood is largest at zero,
that is no reason to exclude it, and the interval begins there.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import msgspec
import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.errors import ConfigError, Finding
from accpinn.inference.posterior import sample
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.maximum_likelihood import KEY, joint_maxima
from accpinn.methods.method import one_thread
from accpinn.methods.series import determined_followers, series_of
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.stability.criteria import exact_margin, l2_margin, step_metrics
from accpinn.stability.frequency import crossovers, peaks, response
from accpinn.units import FloatArray, Mask, Seconds

METHOD = "posterior of the exact likelihood, by importance sampling"
LEVEL = 0.9
DRAWS = 2000
"""Of equal weight, for ends of intervals, bands and clouds."""
SLACK = 0.04
"""Of an interval's width: its ends are drawn, and move by up to as much from seed to seed."""
ENDS = ("centre", "lower", "upper")

Cause = Literal["disturbances", "apart", "unfinished", "stopped", "diverged"]
CAUSES: dict[Outcome, Cause] = {
    Outcome.STOPPED: "stopped",
    Outcome.DIVERGED: "diverged",
    Outcome.FINISHED: "unfinished",
}
"""Why an estimate may lie outside its interval, where it is not a converged one."""
UNBIASED = "calibrated"
"""The PiNN's preset that disturbances do not bias, either."""


class ParameterInterval(msgspec.Struct, frozen=True):
    """The interval of one parameter of one follower, and an estimate of it."""

    symbol: str
    """One of α, β, τ."""
    lower: float
    upper: float | None
    """None where nothing is known."""
    estimate: float | None = None
    likeliest: float | None = None
    """By maximum likelihood, which disturbances do not bias."""


class NotDetermined(Finding, frozen=True):
    """The window is too short for a follower's parameters, or nothing moves in it."""

    vehicle: int
    """0 for all followers together."""


class OutsideInterval(Finding, frozen=True):
    """Some of a follower's estimates lie outside their intervals."""

    vehicle: int
    """0 for all followers together."""
    parameters: tuple[ParameterInterval, ...]
    cause: Cause


UncertaintyFinding = NotDetermined | OutsideInterval


@dataclass(frozen=True, eq=False)
class Interval:
    """Ends of an interval, one for each of M followers or K frequencies."""

    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The uncertainty of the parameters of each of M followers, given a recording."""

    method: str
    level: float
    """How often such intervals cover the truth, if the model holds."""
    centre: Parameters
    """(M,) the maximum-likelihood estimate; nan where `NotDetermined`."""
    lower: Parameters
    """(M,)"""
    upper: Parameters
    """(M,)"""
    inside: Mask
    """(M, 3) whether the fit's own estimate lies within, or no further outside than `SLACK`."""
    draws: Parameters
    """(n, M) from the posterior, of equal weight; nan where `NotDetermined`."""
    probability_l2: FloatArray
    """(M,) of L₂ string stability; nan where `NotDetermined`."""
    probability_linf: FloatArray
    """(M,) of L∞ string stability, by the exact criterion."""
    peak_gain: Interval
    """max |H|; 1 where no frequency is amplified."""
    linf_gain: Interval
    """‖h‖₁; 1 where no peak is amplified."""
    crossover: Interval
    """ω_c in rad/s, below which frequencies are amplified; 0 where none is."""
    seconds: Seconds
    findings: tuple[UncertaintyFinding, ...]


@one_thread
def intervals(
    segment: Segment | Sequence[Segment], fit: Fit, level: float = LEVEL, draws: int = DRAWS
) -> Uncertainty:
    """The uncertainty of the parameters, given a segment; takes about a second.

    Args:
        segment: the data; several segments of the same vehicles are taken together.
        fit: any method's estimate on them; its case counts, and its parameters are judged.
        level: how often the intervals are to cover the truth, above 0 and below 1.
        draws: how many are kept.

    Raises:
        ConfigError: for a level or a number of draws that is not allowed.
    """
    if not 0.0 < level < 1.0:
        raise ConfigError(f"level: {level:g} is not allowed; choose above 0 and below 1, as 0.9.")
    if draws < 2:
        raise ConfigError(f"draws: {draws} is not allowed; choose at least 2, as {DRAWS}.")
    started = time.perf_counter()
    segments = (segment,) if isinstance(segment, Segment) else tuple(segment)
    found = judged(_shared(segments, fit.case, level, draws), segments[0], fit)
    return replace(found, seconds=time.perf_counter() - started)


def judged(uncertainty: Uncertainty, segment: Segment, fit: Fit) -> Uncertainty:
    """The same, with a fit's estimates held against the intervals.

    Args:
        uncertainty: of the segment's M followers.
        segment: the data.
        fit: any method's estimate on them.
    """
    inside = within(fit.parameters.values, uncertainty.lower.values, uncertainty.upper.values)
    found = replace(uncertainty, inside=inside)
    return replace(found, findings=tuple(_findings(segment, fit, found)))


def agree(one: Uncertainty, other: Uncertainty) -> bool:
    """Whether two may be of the same data: estimates, ends and probabilities differ by `SLACK`.

    Processors round differently, and a draw more or less beyond an end moves it.
    """
    if one.draws.values.shape != other.draws.values.shape or one.level != other.level:
        return False
    spread = SLACK * (other.upper.values - other.lower.values)
    pairs = [(getattr(one, n).values, getattr(other, n).values, spread) for n in ENDS]
    for name in ("peak_gain", "linf_gain", "crossover"):
        old, new = getattr(one, name), getattr(other, name)
        spread = SLACK * (new.upper - new.lower)
        pairs += [(old.lower, new.lower, spread), (old.upper, new.upper, spread)]
    for name in ("probability_l2", "probability_linf"):
        pairs.append((getattr(one, name), getattr(other, name), np.full(1, SLACK)))
    return all(
        np.shape(old) == np.shape(new)
        and bool(np.all((np.abs(old - new) <= spread) | (np.isnan(old) & np.isnan(new))))
        for old, new, spread in pairs
    )


def within(estimate: FloatArray, lower: FloatArray, upper: FloatArray) -> Mask:
    """Whether estimates lie in their intervals, up to the `SLACK` of the drawn ends.

    Args:
        estimate: (M, 3); nan lies outside.
        lower: (M, 3); nan where nothing is known, and everything lies inside.
        upper: (M, 3).
    """
    slack = SLACK * (upper - lower)
    inside = (estimate >= lower - slack) & (estimate <= upper + slack)
    return np.asarray(inside | np.isnan(lower))


def of_first(uncertainty: Uncertainty) -> Uncertainty:
    """That of the first follower alone, which stands for all where they share their parameters."""
    parts: dict[str, Any] = {"draws": uncertainty.draws[:, :1]}
    for name in ("centre", "lower", "upper", "inside", "probability_l2", "probability_linf"):
        parts[name] = getattr(uncertainty, name)[:1]
    for name in ("peak_gain", "linf_gain", "crossover"):
        ends: Interval = getattr(uncertainty, name)
        parts[name] = Interval(ends.lower[:1], ends.upper[:1])
    return replace(uncertainty, **parts)


def gain_band(uncertainty: Uncertainty, follower: int, omega: FloatArray) -> Interval:
    """The interval of |H(jω)| at each frequency.

    Args:
        uncertainty: of M followers.
        follower: 0 for the first one.
        omega: (K,) in rad/s, above zero.

    Returns:
        (K,); nan where nothing is known.
    """
    draws = uncertainty.draws[:, follower]
    if np.isnan(draws.alpha).any():
        return Interval(*np.full((2, len(omega)), np.nan))
    return Interval(*interval_ends(np.abs(response(draws, omega)), uncertainty.level))


@lru_cache(maxsize=64)
def _shared(segments: tuple[Segment, ...], case: Case, level: float, draws: int) -> Uncertainty:
    """What does not depend on the fit; many methods on one segment share it."""
    centre, theta = _sample(segments, case, draws)
    return from_draws(centre, Parameters.from_theta(theta), level)


def from_draws(centre: Parameters, sampled: Parameters, level: float) -> Uncertainty:
    """All that follows from draws of the posterior.

    Args:
        centre: (M,) the maximum-likelihood estimate; nan for followers that are not determined.
        sampled: (n, M) of equal weight; nan for these.
        level: of the intervals.
    """
    known = ~np.isnan(sampled.alpha[0])
    lower, upper = interval_ends(sampled.values, level)
    lower = np.where(centre.values == 0.0, 0.0, lower)
    return Uncertainty(
        method=METHOD,
        level=level,
        centre=centre,
        lower=Parameters.of(lower),
        upper=Parameters.of(upper),
        inside=np.ones_like(lower, dtype=bool),
        draws=sampled,
        probability_l2=np.where(known, (l2_margin(sampled) >= 0).mean(axis=0), np.nan),
        probability_linf=np.where(known, (exact_margin(sampled) >= 0).mean(axis=0), np.nan),
        peak_gain=Interval(*interval_ends(peaks(sampled).gain, level)),
        linf_gain=Interval(*interval_ends(step_metrics(sampled).gain, level)),
        crossover=Interval(*interval_ends(np.nan_to_num(crossovers(sampled)), level)),
        seconds=0.0,
        findings=(),
    )


def _sample(segments: tuple[Segment, ...], case: Case, count: int) -> tuple[Parameters, FloatArray]:
    """The estimate (M,), and draws of θ (count, M, 3); equal followers in Case I."""
    known = determined_followers(segments, case)
    centre = np.full((segments[0].followers, 3), np.nan)
    theta = np.full((count, *centre.shape), np.nan)
    if known:
        maxima = joint_maxima(segments, case, followers=known)
        posteriors = sample(series_of(segments, case, known), maxima)
        centre[list(known)] = [one.theta for one in maxima]
        theta[:, list(known)] = np.stack([one.evenly(count) for one in posteriors], axis=1)
    return Parameters.from_theta(centre), theta


def interval_ends(values: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
    """Lower and upper quantiles over the first axis; nan where a value is."""
    tail = (1.0 - level) / 2.0
    lower, upper = np.quantile(values, (tail, 1.0 - tail), axis=0)
    return lower, upper


def _findings(segment: Segment, fit: Fit, judged: Uncertainty) -> list[UncertaintyFinding]:
    found: list[UncertaintyFinding] = []
    for k, vehicle in enumerate((0,) if fit.case == "I" else segment.vehicles[1:]):
        if np.isnan(judged.centre[k].alpha):
            found.append(NotDetermined(vehicle))
        rows = parameter_intervals(judged, k, fit.parameters)
        outside = [row for row, yes in zip(rows, judged.inside[k], strict=True) if not yes]
        if outside:
            found.append(OutsideInterval(vehicle, tuple(outside), _cause(fit)))
    return found


def _cause(fit: Fit) -> Cause:
    """Why an estimate may lie outside; one without bias does where the likelihood is odd."""
    unbiased = fit.method == KEY or fit.config.get("preset") == UNBIASED
    return "apart" if unbiased else CAUSES.get(fit.outcome, "disturbances")


def parameter_intervals(
    uncertainty: Uncertainty, follower: int, estimates: Parameters | None = None
) -> tuple[ParameterInterval, ...]:
    """The intervals of α, β and τ of one follower, one object each.

    Args:
        uncertainty: of M followers.
        follower: 0 for the first one.
        estimates: (M,) to be kept beside them.
    """
    lower, upper = (
        ends[follower].values.tolist() for ends in (uncertainty.lower, uncertainty.upper)
    )
    values = estimates[follower].values.tolist() if estimates else 3 * [float("nan")]
    likeliest = uncertainty.centre[follower].values.tolist()
    rows = zip(PARAMETERS, lower, upper, values, likeliest, strict=True)
    return tuple(
        ParameterInterval(one.symbol, low, _finite(high), _finite(value), _finite(best))
        for one, low, high, value, best in rows
    )


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
