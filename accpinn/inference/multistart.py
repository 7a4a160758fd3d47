"""Multistart: the PiNN from several initial values and seeds, as in the paper's Table I.

The paper trains one recording from five initial values of (α, β, τ) and prints where each ends.
The preset `fast` solves for α, β and τ, so its initial values have no effect after the first
iteration and only the seed matters; the preset `paper` moves them step by step, so both matter.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.evaluation.closed_loop import TrackingErrors, closed_loop_errors, surrogate_errors
from accpinn.findings import Finding, Labelled, Words
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.method import TaskContext
from accpinn.methods.pinn.config import FAST, STARTS, PinnConfig
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray

NOTICED = 1.0
"""Spread of a parameter, in percent, above which trainings disagree."""


class TrainingSpread(Finding, frozen=True):
    """How far apart the trainings end."""

    text = (
        "The {trainings} trainings end up to {largest:.0f} % apart{why}. Do not quote a single one"
        " of them."
    )
    text_if_close = "All {trainings} trainings end within {end:.2g} % of each other{where}."

    trainings: int
    """Number of trainings."""
    largest: float
    """Largest spread of any parameter, in percent."""
    every: bool
    """Whether every parameter has a spread."""
    unconverged: int
    """Number of trainings that had not converged when their iterations ended."""

    def sentence(self, about: Labelled) -> str:
        """The finding as a sentence, which depends on the spread."""
        return self.filled(self.text_if_close if self.largest <= NOTICED else self.text, about)

    def _words(self, about: Labelled) -> Words:
        why = (
            f"; {self.unconverged} of them had not converged when their iterations ended, so more"
            " iterations may bring them together"
        )
        return {
            "end": max(self.largest, 0.01),
            "where": "" if self.every else " in the parameters that all of them determine",
            "why": why if self.unconverged else "",
        }


class SpreadUndetermined(Finding, frozen=True):
    """A parameter has no spread, as some trainings leave it undetermined."""

    text = (
        "{vehicle}: {symbol} is undetermined in {count} of {trainings} trainings, so it has no"
        " spread."
    )

    vehicle: int
    """0 for all followers together."""
    symbol: str
    """Symbol of the parameter."""
    count: int
    """Number of trainings that leave it undetermined."""
    trainings: int
    """Number of all trainings."""


MultistartFinding = TrainingSpread | SpreadUndetermined


@dataclass(frozen=True, eq=False)
class Trial:
    """One training."""

    initial: Parameters
    """Values of α [1/s²], β [1/s] and τ [s] before the first iteration."""
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

    It is nan for a single trial, and where a trial leaves the parameter undetermined.
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
    """Train from every initial value with every seed, and yield each trial when it ends.

    Args:
        segment: the data.
        case: "I" or "II".
        config: settings of all trainings, except initial values and seed.
        initials: initial values of α, β and τ.
        seeds: by default the seed of ``config`` alone.
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
    """Compare the trainings of one segment."""
    if len(trials) < 2:
        return MultistartResult(tuple(trials), np.full((segment.followers, 3), np.nan), ())
    tables = np.array([trial.fit.parameters.values for trial in trials])
    mean = tables.mean(axis=0)
    spread = 100.0 * np.divide(
        np.ptp(tables, axis=0), mean, out=np.full_like(mean, np.nan), where=mean != 0
    )
    findings: list[MultistartFinding] = []
    known = spread[np.isfinite(spread)]
    if known.size:
        unconverged = sum(trial.fit.outcome is Outcome.FINISHED for trial in trials)
        every = known.size == spread.size
        findings.append(TrainingSpread(len(trials), float(known.max()), every, unconverged))
    findings += _undetermined(segment, trials[0].fit.case, tables)
    return MultistartResult(tuple(trials), spread, tuple(findings))


def _undetermined(segment: Segment, case: Case, tables: FloatArray) -> list[SpreadUndetermined]:
    """The parameters that are nan in some of the trials' tables (T, M, 3)."""
    vehicles = (0,) if segment.shares(case) else segment.vehicles[1:]
    counts = np.isnan(tables).sum(axis=0).tolist()
    return [
        SpreadUndetermined(vehicle, quantity.symbol, count, len(tables))
        for vehicle, row in zip(vehicles, counts, strict=False)
        for quantity, count in zip(PARAMETERS, row, strict=True)
        if count
    ]
