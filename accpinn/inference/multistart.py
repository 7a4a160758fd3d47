"""Multistart: the PiNN from several initial values and seeds, as in the paper's Table I.

The paper trains one recording from five initial values of (α, β, τ) and prints where each ends.
The preset `fast` solves for α, β and τ, so its initial values have no effect after the first
iteration and only seeds make a difference; the preset `paper` moves them step by step and depends
on both.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.errors import Finding
from accpinn.evaluation.closed_loop import TrackingErrors, closed_loop_errors, surrogate_errors
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.method import TaskContext
from accpinn.methods.pinn.config import FAST, STARTS, PinnConfig
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray

NOTICED = 1.0
"""In percent: trainings with a larger spread of any parameter disagree."""


class TrainingSpread(Finding, frozen=True):
    """How far the trainings end apart."""

    trainings: int
    largest: float
    """Of any parameter's spread, in percent."""
    every: bool
    """Whether every parameter has a spread."""
    unconverged: int
    """Trainings that had not converged when their iterations were over."""


class SpreadUndetermined(Finding, frozen=True):
    """A parameter has no spread, as some trainings leave it undetermined."""

    vehicle: int
    """0 for all followers together."""
    symbol: str
    count: int
    trainings: int


MultistartFinding = TrainingSpread | SpreadUndetermined


@dataclass(frozen=True, eq=False)
class Trial:
    """One training."""

    initial: Parameters
    """α [1/s²], β [1/s], τ [s] before the first iteration."""
    seed: int
    fit: Fit
    surrogate: TrackingErrors | None
    closed_loop: TrackingErrors | None


@dataclass(frozen=True, eq=False)
class MultistartResult:
    """Several trainings of one segment, and how far apart they end."""

    trials: tuple[Trial, ...]
    spread: FloatArray
    """(M, 3) of α, β, τ in percent: largest minus smallest, over the mean.

    It is nan for one trial, and where a trial leaves the parameter undetermined.
    """
    findings: tuple[MultistartFinding, ...]


def multistart(
    segment: Segment,
    case: Case = "II",
    config: PinnConfig = FAST,
    *,
    initials: Sequence[Parameters] = STARTS,
    seeds: Sequence[int] | None = None,
    context: TaskContext | None = None,
) -> Iterator[Trial]:
    """Train from every initial value with every seed; each trial comes when it is finished.

    Args:
        segment: the data.
        case: "I" or "II".
        config: of all trainings, but for initial values and seed.
        initials: of α, β, τ.
        seeds: by default that of ``config`` alone.
        context: store, threads, progress and stop; a stop ends the series.
    """
    context = context or TaskContext()
    for seed in (config.seed,) if seeds is None else seeds:
        for initial in initials:
            if context.is_stopped:
                return
            settings = replace(config, initial=initial, seed=seed)
            fit = METHODS["pinn"].fit(segment, case, settings, context)
            if fit.outcome is Outcome.STOPPED:
                return
            errors = surrogate_errors(segment, fit), closed_loop_errors(segment, fit)
            yield Trial(initial, seed, fit, *errors)


def summarise(segment: Segment, trials: Sequence[Trial]) -> MultistartResult:
    """Trainings of one segment side by side."""
    if len(trials) < 2:
        return MultistartResult(tuple(trials), np.full((segment.followers, 3), np.nan), ())
    tables = np.array([trial.fit.parameters.values for trial in trials])
    mean = tables.mean(axis=0)
    spread = 100.0 * np.divide(
        np.ptp(tables, axis=0), mean, out=np.full_like(mean, np.nan), where=mean != 0
    )
    found: list[MultistartFinding] = []
    known = spread[np.isfinite(spread)]
    if known.size:
        unconverged = sum(trial.fit.outcome is Outcome.FINISHED for trial in trials)
        every = known.size == spread.size
        found.append(TrainingSpread(len(trials), float(known.max()), every, unconverged))
    found += _undetermined(segment, trials[0].fit.case, tables)
    return MultistartResult(tuple(trials), spread, tuple(found))


def _undetermined(segment: Segment, case: Case, tables: FloatArray) -> list[SpreadUndetermined]:
    """Which parameter is nan in how many of the trials' tables (T, M, 3)."""
    vehicles = (0,) if segment.shares(case) else segment.vehicles[1:]
    counts = np.isnan(tables).sum(axis=0).tolist()
    return [
        SpreadUndetermined(vehicle, one.symbol, count, len(tables))
        for vehicle, row in zip(vehicles, counts, strict=False)
        for one, count in zip(PARAMETERS, row, strict=True)
        if count
    ]
