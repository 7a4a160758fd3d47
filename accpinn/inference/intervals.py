"""The uncertainty of α, β, τ and of what follows from them; the probability of string stability.

The intervals depend on the recording alone, so one set of them serves every method: an estimate is
judged by whether it lies inside. Least squares, splines and the PiNN minimise the residual of the
model and are biased by disturbances (see `inference.instrumental_variables`), so their estimates
may lie outside; a finding then says so.

A vehicle with α = 0 has no gap control: it follows the speed ahead. It amplifies nothing, but to
call it string stable would hide that it keeps no time headway, so such draws are counted apart. The
shares of stable draws, amplifying draws and draws without gap control add up to one.

A draw with α = 0 has no τ and stands for any time headway: it counts as 0 at the lower and as
infinite at the upper end, so that an interval of τ is as wide as the data demand (Fieller 1954).
"""

import time
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from accpinn.channels import PARAMETERS
from accpinn.errors import ConfigError, Finding
from accpinn.inference.instrumental_variables import solve_iv
from accpinn.inference.sampling import (
    SHORTEST_BLOCK,
    block_length,
    draw,
    jackknife,
    project,
    quantile_interval,
)
from accpinn.methods.fit import Fit, Outcome
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.stability.criteria import exact_margin, l2_margin, step_metrics
from accpinn.stability.frequency import crossovers, peaks, response
from accpinn.units import FloatArray, Seconds

METHOD = "instrumental variables, blocks of time left out, 20,000 draws"
LEVEL = 0.9
DRAWS = 2000
"""Kept, for bands and clouds."""
OVERSAMPLING = 10
"""So many times more are drawn for the ends of intervals, which then move by at most 4 % of an
interval's width from seed to seed; with those kept alone a τ that is hardly determined moved by
39 %."""
SEED = 0
SLACK = 0.04
"""Of an interval's width: its ends are drawn, and move by up to as much from seed to seed."""

Cause = Literal["disturbances", "unfinished", "stopped", "diverged"]
CAUSES: dict[Outcome, Cause] = {
    Outcome.STOPPED: "stopped",
    Outcome.DIVERGED: "diverged",
    Outcome.FINISHED: "unfinished",
}
"""Why an estimate may lie outside its interval, where it is not a converged one."""


class ParameterInterval(msgspec.Struct, frozen=True):
    """The interval of one parameter of one follower, and an estimate of it."""

    symbol: str
    """One of α, β, τ."""
    lower: float
    upper: float | None
    """None where the data set no limit."""
    estimate: float | None = None


class ShortWindow(Finding, frozen=True):
    """The window is so short that its intervals are rough."""

    duration: Seconds
    block: Seconds
    """The length of the blocks that had to be used."""


class NotDetermined(Finding, frozen=True):
    """The data determine none of a follower's parameters."""

    vehicle: int
    """0 for all followers together."""


class NegativeEstimate(Finding, frozen=True):
    """The data ask for a negative parameter, so that its interval is 0 alone."""

    vehicle: int
    """0 for all followers together."""
    symbol: str


class OutsideInterval(Finding, frozen=True):
    """Some of a follower's estimates lie outside their intervals."""

    vehicle: int
    """0 for all followers together."""
    parameters: tuple[ParameterInterval, ...]
    cause: Cause


UncertaintyFinding = ShortWindow | NotDetermined | NegativeEstimate | OutsideInterval


@dataclass(frozen=True, eq=False)
class Interval:
    """Ends of an interval, one for each of M followers or K frequencies."""

    lower: FloatArray
    upper: FloatArray
    """May be infinite."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The uncertainty of the parameters of each of M followers, given a recording."""

    method: str
    level: float
    """How often such intervals cover the truth, if the model holds but for disturbances."""
    centre: Parameters
    """(M,) free of the disturbances' bias; nan where the data do not determine them."""
    lower: Parameters
    """(M,)"""
    upper: Parameters
    """(M,) infinite where the data set no limit."""
    inside: NDArray[np.bool_]
    """(M, 3) whether the fit's own estimate lies within, or no further outside than `SLACK`."""
    draws: Parameters
    """(n, M) τ is nan where α = 0, all are nan where nothing is determined."""
    probability_l2: FloatArray
    """(M,) of L₂ string stability with gap control (α > 0); nan where nothing is determined."""
    probability_linf: FloatArray
    """(M,) of L∞ string stability, by the exact criterion, with gap control."""
    peak_gain: Interval
    """max |H|; 1 where no frequency is amplified."""
    linf_gain: Interval
    """‖h‖₁; 1 where no peak is amplified."""
    crossover: Interval
    """ω_c in rad/s, below which frequencies are amplified; 0 where none is."""
    seconds: Seconds
    findings: tuple[UncertaintyFinding, ...]

    @property
    def no_gap_control(self) -> FloatArray:
        """(M,) share of draws without gap control (α = 0); nan where nothing is determined."""
        alpha = self.draws.alpha
        return _share(alpha == 0, ~np.isnan(alpha[0]))


def intervals(segment: Segment, fit: Fit, level: float = LEVEL, draws: int = DRAWS) -> Uncertainty:
    """The uncertainty of the parameters, given a segment; takes well under a second.

    Args:
        segment: the data.
        fit: any method's estimate on them; its case counts, and its parameters are judged.
        level: how often the intervals are to cover the truth, above 0 and below 1.
        draws: how many are kept, an even number; `OVERSAMPLING` times as many set the ends.

    Raises:
        ConfigError: for a level or a number of draws that is not allowed.
    """
    if not 0.0 < level < 1.0:
        raise ConfigError(f"level: {level:g} is not allowed; choose above 0 and below 1, as 0.9.")
    if draws < 2 or draws % 2:
        raise ConfigError(f"draws: {draws} is not allowed; choose an even number, as {DRAWS}.")
    started = time.perf_counter()
    shared = _shared(segment, fit.case, level, draws)
    inside = within(fit.parameters.values, shared.lower.values, shared.upper.values)
    judged = replace(shared, inside=inside)
    return replace(
        judged,
        findings=tuple(_findings(segment, fit, judged)),
        seconds=time.perf_counter() - started,
    )


def within(estimate: FloatArray, lower: FloatArray, upper: FloatArray) -> NDArray[np.bool_]:
    """Whether estimates lie in their intervals, up to the `SLACK` of the drawn ends.

    Args:
        estimate: (M, 3); nan lies within an interval without an upper end.
        lower: (M, 3).
        upper: (M, 3).
    """
    width = upper - lower
    slack = SLACK * np.where(np.isfinite(width), width, 0.0)
    inside = (estimate >= lower - slack) & (estimate <= upper + slack)
    return np.asarray(inside | np.isnan(estimate) & np.isinf(upper))


def gain_band(uncertainty: Uncertainty, follower: int, omega: FloatArray) -> Interval:
    """The interval of |H(jω)| at each frequency.

    Args:
        uncertainty: of M followers.
        follower: 0 for the first one.
        omega: (K,) in rad/s, above zero.

    Returns:
        (K,); nan where nothing is determined.
    """
    draws = uncertainty.draws[:, follower]
    if np.isnan(draws.alpha).any():
        return Interval(*np.full((2, len(omega)), np.nan))
    return Interval(*quantile_interval(np.abs(response(draws, omega)), uncertainty.level))


@lru_cache(maxsize=4)
def _shared(segment: Segment, case: Case, level: float, draws: int) -> Uncertainty:
    """What does not depend on the fit; many methods on one segment share it."""
    centre, drawn = _sample(segment, case, OVERSAMPLING * draws, np.random.default_rng(SEED))
    sample = Parameters.from_theta(drawn)
    lower, upper = quantile_interval(sample.values, level)
    determined = ~np.isnan(sample.alpha[0])
    # τ has no effect where α = 0, and what is not determined is masked below.
    finite = Parameters.of(np.nan_to_num(sample.values))
    spaced = finite.alpha > 0
    return Uncertainty(
        method=METHOD,
        level=level,
        centre=Parameters.from_theta(centre),
        lower=Parameters.of(lower),
        upper=Parameters.of(upper),
        inside=np.ones_like(lower, dtype=bool),
        draws=sample[::OVERSAMPLING],
        probability_l2=_share((l2_margin(finite) >= 0) & spaced, determined),
        probability_linf=_share((exact_margin(finite) >= 0) & spaced, determined),
        peak_gain=_interval(peaks(finite).gain, level, determined),
        linf_gain=_interval(step_metrics(finite).gain, level, determined),
        crossover=_interval(np.nan_to_num(crossovers(finite)), level, determined),
        seconds=0.0,
        findings=(),
    )


def _sample(
    segment: Segment, case: Case, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """θ (M, 3) and its draws (count, M, 3); equal followers in Case I."""
    centre = np.full((segment.followers, 3), np.nan)
    drawn = np.full((count, segment.followers, 3), np.nan)
    for k, equations in enumerate(solve_iv(segment, case)):
        of = slice(None) if case == "I" else k
        scatter = jackknife(equations, segment.sample_time)
        if scatter:
            centre[of] = project(equations.theta[None], scatter.scale)[0]
            sample = draw(equations.theta, scatter, count, rng)
            drawn[:, of] = sample[:, None] if case == "I" else sample
    return centre, drawn


def _share(holds: NDArray[np.bool_], determined: NDArray[np.bool_]) -> FloatArray:
    return np.where(determined, holds.mean(axis=0), np.nan)


def _interval(values: FloatArray, level: float, determined: NDArray[np.bool_]) -> Interval:
    return Interval(*quantile_interval(np.where(determined, values, np.nan), level))


def _findings(segment: Segment, fit: Fit, judged: Uncertainty) -> list[UncertaintyFinding]:
    found: list[UncertaintyFinding] = []
    duration = segment.window.duration
    if block_length(duration) < SHORTEST_BLOCK:
        found.append(ShortWindow(duration, block_length(duration)))
    for k, vehicle in enumerate((0,) if fit.case == "I" else segment.vehicles[1:]):
        if np.isnan(judged.centre[k].alpha):
            found.append(NotDetermined(vehicle))
        rows = parameter_intervals(judged, k, fit.parameters)
        found += [NegativeEstimate(vehicle, row.symbol) for row in rows if row.upper == 0.0]
        outside = [row for row, yes in zip(rows, judged.inside[k], strict=True) if not yes]
        if outside:
            cause = CAUSES.get(fit.outcome, "disturbances")
            found.append(OutsideInterval(vehicle, tuple(outside), cause))
    return found


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
    return tuple(
        ParameterInterval(one.symbol, low, _finite(high), _finite(value))
        for one, low, high, value in zip(PARAMETERS, lower, upper, values, strict=True)
    )


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
