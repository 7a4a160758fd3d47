"""Intervals for α, β, τ, for what follows from them, and the probability of string stability.

They say which laws the recording allows, so one set of them serves every method: an estimate is
judged by whether it lies inside. Least squares, splines and the PiNN minimise the law's residual
and are pulled by disturbances (see `uncertainty.instruments`), so they may lie outside; the notes
then say so.

A law with α = 0 follows the speed ahead and keeps no gap. It amplifies nothing, but to call it
stable would hide that it is no time-headway law at all, so such draws are counted apart: stable,
amplifying and gapless laws add up to one.

A draw with α = 0 has no τ: it stands for any headway, and counts as 0 at the lower and as infinite
at the upper end, so that an interval of τ is as wide as the data demand (Fieller 1954).
"""

import time
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from accpinn.errors import ConfigError
from accpinn.inference.instrumental_variables import solve_iv
from accpinn.inference.jackknife import FEWEST_BLOCKS, SHORTEST_BLOCK, block_length, spread
from accpinn.inference.sampling import (
    DRAWS,
    OVERSAMPLING,
    SEED,
    as_parameters,
    draw,
    project,
    quantile_interval,
)
from accpinn.methods.fit import Fit, Outcome
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.stability.criteria import exact_margin, l2_margin
from accpinn.stability.frequency import crossovers, peaks
from accpinn.stability.linf_gain import step_metrics
from accpinn.units import FloatArray, Seconds

METHOD = "instrumental variables, blocks of time left out, 20,000 draws"
LEVEL = 0.9
SYMBOLS = ("α", "β", "τ")
DIGITS = (4, 4, 3)
SLACK = 0.04
"""Of an interval's width: its ends are drawn, and move by up to as much from seed to seed."""
PULLED = "disturbances that the vehicle itself answers can pull such estimates"
CAUSES = {
    Outcome.STOPPED: "training was stopped before its end",
    Outcome.DIVERGED: "training diverged",
    Outcome.FINISHED: f"more iterations may change it, or {PULLED}",
}
"""Why an estimate may lie outside its interval, where it is no settled one."""


@dataclass(frozen=True, eq=False)
class Interval:
    """Ends of an interval for each of M followers."""

    lower: FloatArray
    """(M,)"""
    upper: FloatArray
    """(M,) may be infinite."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """What a recording leaves open about the law of each of M followers."""

    method: str
    level: float
    """How often such intervals cover the truth, if the law holds but for lasting disturbances."""
    centre: FloatArray
    """(M, 3) α, β, τ free of the disturbances' pull; nan where the data do not determine them."""
    lower: FloatArray
    """(M, 3) in 1/s², 1/s, s."""
    upper: FloatArray
    """(M, 3) infinite where the data set no limit."""
    inside: NDArray[np.bool_]
    """(M, 3) whether the fit's own estimate lies within, or no further outside than `SLACK`."""
    draws: FloatArray
    """(n, M, 3) α, β, τ; τ is nan where α = 0, all are nan where nothing is determined."""
    probability_l2: FloatArray
    """(M,) share of draws that keep a gap (α > 0) and amplify no frequency, 0 to 1; nan where
    nothing is determined."""
    probability_linf: FloatArray
    """(M,) share of draws that keep a gap and let no peak come out larger."""
    peak_gain: Interval
    """max |H|; 1 where nothing is amplified."""
    linf_gain: Interval
    """‖h‖₁; 1 where no peak comes out larger."""
    crossover: Interval
    """ω_c in rad/s, below which frequencies are amplified; 0 where none is."""
    seconds: Seconds
    notes: tuple[str, ...]

    @property
    def gapless(self) -> FloatArray:
        """(M,) share of draws that keep no gap (α = 0); nan where nothing is determined."""
        alpha = self.draws[..., 0]
        return _share(alpha == 0, ~np.isnan(alpha[0]))


def intervals(segment: Segment, fit: Fit, level: float = LEVEL, draws: int = DRAWS) -> Uncertainty:
    """What the segment leaves open about the law; takes well under a second.

    Args:
        segment: the data.
        fit: any method's estimate on them; its case counts, and its parameters are judged.
        level: how often the intervals are to cover the truth, above 0 and below 1.
        draws: how many are kept, an even number; `FINER` times as many set the ends.
    """
    if not 0.0 < level < 1.0:
        raise ConfigError(f"level: {level:g} is not allowed; choose above 0 and below 1, as 0.9.")
    if draws < 2 or draws % 2:
        raise ConfigError(f"draws: {draws} is not allowed; choose an even number, as {DRAWS}.")
    started = time.perf_counter()
    allows = _allows(segment, fit.case, level, draws)
    inside = within(fit.parameters.values, allows.lower, allows.upper)
    notes = _notes(segment, fit, allows.draws, allows.lower, allows.upper, inside)
    return replace(allows, inside=inside, notes=notes, seconds=time.perf_counter() - started)


@lru_cache(maxsize=4)
def _allows(segment: Segment, case: Case, level: float, draws: int) -> Uncertainty:
    """What does not depend on the fit; many methods on one segment share it."""
    centre, drawn = _sample(segment, case, OVERSAMPLING * draws, np.random.default_rng(SEED))
    table = as_parameters(drawn)
    lower, upper = quantile_interval(table, level)
    laws = _laws(table)
    known = ~np.isnan(table[0, :, 0])
    spaced = laws.alpha > 0
    return Uncertainty(
        method=METHOD,
        level=level,
        centre=as_parameters(centre),
        lower=lower,
        upper=upper,
        inside=np.ones_like(lower, dtype=bool),
        draws=table[::OVERSAMPLING].copy(),
        probability_l2=_share((l2_margin(laws) >= 0) & spaced, known),
        probability_linf=_share((exact_margin(laws) >= 0) & spaced, known),
        peak_gain=_interval(peaks(laws).gain, level, known),
        linf_gain=_interval(step_metrics(laws).gain, level, known),
        crossover=_interval(np.nan_to_num(crossovers(laws)), level, known),
        seconds=0.0,
        notes=(),
    )


def within(estimate: FloatArray, lower: FloatArray, upper: FloatArray) -> NDArray[np.bool_]:
    """Whether estimates lie in their intervals, up to what the drawn ends leave open."""
    width = upper - lower
    slack = SLACK * np.where(np.isfinite(width), width, 0.0)
    inside = (estimate >= lower - slack) & (estimate <= upper + slack)
    return np.asarray(inside | np.isnan(estimate) & np.isinf(upper))


def _sample(
    segment: Segment, case: Case, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """The solution (M, 3) and draws (count, M, 3) as α, ατ, β; equal followers in Case I."""
    centre = np.full((segment.followers, 3), np.nan)
    drawn = np.full((count, segment.followers, 3), np.nan)
    equations = solve_iv(segment, case)
    for k, one in enumerate(equations):
        of = slice(None) if case == "I" else k
        scatter = spread(one, segment.sample_time)
        if scatter:
            centre[of] = project(one.theta[None], scatter.scale)[0]
            sample = draw(one.theta, scatter, count, rng)
            drawn[:, of] = sample[:, None] if case == "I" else sample
    return centre, drawn


def _laws(table: FloatArray) -> Parameters:
    """Draws as laws; τ has no effect where α = 0, and what is not determined is masked later."""
    return Parameters.of(np.nan_to_num(table))


def _share(holds: NDArray[np.bool_], known: NDArray[np.bool_]) -> FloatArray:
    return np.where(known, holds.mean(axis=0), np.nan)


def _interval(values: FloatArray, level: float, known: NDArray[np.bool_]) -> Interval:
    lower, upper = quantile_interval(np.where(known, values, np.nan), level)
    return Interval(lower, upper)


def _notes(
    segment: Segment,
    fit: Fit,
    table: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    inside: NDArray[np.bool_],
) -> tuple[str, ...]:
    notes = []
    length = block_length(segment.window.duration)
    if length < SHORTEST_BLOCK:
        notes.append(
            f"The window is only {segment.window.duration:.0f} s long, so the intervals rest on"
            f" {FEWEST_BLOCKS} blocks of {length:.0f} s and are rough; take"
            f" {FEWEST_BLOCKS * SHORTEST_BLOCK:.0f} s or more."
        )
    estimate = fit.parameters.values
    labels = ("All followers",) if fit.case == "I" else segment.labels[1:]
    for k, label in enumerate(labels):
        if np.isnan(table[0, k, 0]):
            notes.append(
                f"{label}: the vehicle ahead moves too evenly for these data to determine any of"
                " α, β and τ; choose a window in which it brakes and accelerates."
            )
        for p, symbol in enumerate(SYMBOLS):
            if upper[k, p] == 0.0:
                notes.append(
                    f"{label}: the data ask for {symbol} < 0, which the rational driving"
                    f" constraints rule out, so its interval is 0 alone; rather than {symbol} = 0"
                    " this says that the law does not fit here."
                )
        outside = [
            f"{symbol} = {estimate[k, p]:.{digits}f} (interval {lower[k, p]:.{digits}f} to"
            f" {_end(upper[k, p], digits)})"
            for p, (symbol, digits) in enumerate(zip(SYMBOLS, DIGITS, strict=True))
            if not inside[k, p]
        ]
        if outside:
            lies = "lies" if len(outside) == 1 else "lie"
            notes.append(
                f"{label}: the estimate's {' and '.join(outside)} {lies} outside what the data"
                f" support; {CAUSES.get(fit.outcome, PULLED)}."
            )
    return tuple(notes)


def _end(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "no limit"
