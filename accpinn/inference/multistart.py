"""Dispersion of the PiNN over initial values and seeds: the paper's Table I, made anew.

The paper trains one recording from five initial values of (α, β, τ) and prints where each ends.
The recipe `fast` solves for α, β and τ, so its initial values are forgotten at once and only seeds
make a difference; the recipe `paper` moves them step by step and depends on both.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from accpinn.errors import ConfigError
from accpinn.evaluation.closed_loop import closed_loop_errors
from accpinn.evaluation.errors import TrackingErrors, surrogate_errors
from accpinn.methods.fit import Fit, OnProgress, Outcome, ShouldStop
from accpinn.methods.pinn.config import FAST, STARTS, PinnConfig
from accpinn.methods.store import Store
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray

NOTICED = 1.0
"""In percent: a larger spread of any parameter is worth a sentence."""


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
    notes: tuple[str, ...]
    """What to make of it, in plain sentences."""


def multistart(
    segment: Segment,
    case: Case = "II",
    config: PinnConfig = FAST,
    *,
    initials: Sequence[Parameters] = STARTS,
    seeds: Sequence[int] | None = None,
    store: Store | None = None,
    threads: int | None = None,
    on_progress: OnProgress | None = None,
    should_stop: ShouldStop | None = None,
) -> MultistartResult:
    """Train from every initial value with every seed.

    Args:
        segment: the data.
        case: "I" or "II".
        config: of all trainings, but for initial values and seed.
        initials: of α, β, τ.
        seeds: by default that of ``config`` alone.
        store: where results and checkpoints are kept.
        threads: for torch.
        on_progress: called several times a second while one trains.
        should_stop: True ends the series; trainings that are finished by then count.
    """
    trials = []
    for chosen in _configs(config, initials, seeds):
        if should_stop and should_stop():
            break
        fit = _train(segment, case, chosen, store, threads, on_progress, should_stop)
        if fit.outcome is Outcome.STOPPED:
            break
        errors = surrogate_errors(segment, fit), closed_loop_errors(segment, fit)
        trials.append(Trial(chosen.initial, chosen.seed, fit, *errors))
    return summarise(segment, tuple(trials))


def summarise(segment: Segment, trials: tuple[Trial, ...]) -> MultistartResult:
    """Trainings of one segment side by side."""
    if len(trials) < 2:
        return MultistartResult(trials, np.full((segment.followers, 3), np.nan), ())
    tables = np.array([trial.fit.parameters.values for trial in trials])
    mean = tables.mean(axis=0)
    spread = 100.0 * np.divide(
        np.ptp(tables, axis=0), mean, out=np.full_like(mean, np.nan), where=mean != 0
    )
    notes = (*_notes(trials, spread), *_undetermined(segment, trials[0].fit.case, tables))
    return MultistartResult(trials, spread, notes)


def _configs(
    config: PinnConfig,
    initials: Sequence[Parameters],
    seeds: Sequence[int] | None,
) -> Iterator[PinnConfig]:
    numbers = (config.seed,) if seeds is None else tuple(seeds)
    if not (initials and numbers):
        raise ConfigError("starts: nothing to train from; give initial values and a seed.")
    for seed in numbers:
        for initial in initials:
            yield replace(config, initial=initial, seed=seed)


def _notes(trials: tuple[Trial, ...], spread: FloatArray) -> tuple[str, ...]:
    known = spread[np.isfinite(spread)]
    if not known.size:
        return ()
    widest = float(known.max())
    if widest <= NOTICED:
        within = f"end within {max(widest, 0.01):.2g} % of each other"
        but = "" if known.size == spread.size else " in the parameters that all of them determine"
        return (f"All {len(trials)} trainings {within}{but}.",)
    unsettled = sum(trial.fit.outcome is Outcome.FINISHED for trial in trials)
    why = (
        f"; {unsettled} of them had not settled when their iterations were over, so more"
        " iterations may bring them together"
        if unsettled
        else ""
    )
    return (
        f"The {len(trials)} trainings end up to {widest:.0f} % apart{why}. No single one of them"
        " should be quoted alone.",
    )


def _undetermined(segment: Segment, case: Case, tables: FloatArray) -> list[str]:
    """Which parameter is nan in how many of the trials' tables (T, M, 3), a sentence each."""
    shared = case == "I" and segment.followers > 1
    labels = ["all followers"] if shared else segment.labels[1:]
    counts = np.isnan(tables).sum(axis=0)
    return [
        f"{symbol} of {label} is undetermined in {count} of {len(tables)} trainings, so there is no"
        " spread of it."
        for label, row in zip(labels, counts, strict=False)
        for symbol, count in zip("αβτ", row, strict=True)
        if count
    ]


def _train(
    segment: Segment,
    case: Case,
    config: PinnConfig,
    store: Store | None,
    threads: int | None,
    on_progress: OnProgress | None,
    should_stop: ShouldStop | None,
) -> Fit:
    from accpinn.methods.pinn.training import train  # torch takes a second to import

    return train(
        segment,
        case,
        config,
        store=store,
        threads=threads,
        on_progress=on_progress,
        should_stop=should_stop,
    )
