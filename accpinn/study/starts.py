"""Multistart: the PiNN from several initial values and seeds, as in the paper's Table I.

The paper trains one recording from five initial values of (α, β, τ) and prints where each ends.
The preset `fast` solves for α, β and τ, so its initial values have no effect after the first
iteration and only the seed matters; the preset `paper` moves them step by step, so both matter.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.findings import Finding, Labelled, Words
from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import STARTS, PinnConfig
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import SegmentInfo
from accpinn.study.analysis import Analysis
from accpinn.study.result import Result
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


SpreadFinding = TrainingSpread | SpreadUndetermined


@dataclass(frozen=True, eq=False)
class Spread:
    """How far apart several trainings of one segment end."""

    percent: FloatArray
    """(M, 3) spread of α, β, τ in percent: largest minus smallest, over the mean.

    It is nan for one training, and where a training leaves the parameter undetermined.
    """
    findings: tuple[SpreadFinding, ...]


def starts(
    analysis: Analysis,
    *,
    initials: Sequence[Parameters] = STARTS,
    seeds: Sequence[int] | None = None,
) -> Iterator[Analysis]:
    """The same question from every initial value, with every seed.

    Args:
        analysis: whose settings serve all trainings, but for initial values and seed.
        initials: of α, β, τ.
        seeds: by default that of the analysis alone.
    """
    config: PinnConfig = analysis.config
    for seed in (config.seed,) if seeds is None else seeds:
        for initial in initials:
            yield analysis.with_method(analysis.method, replace(config, initial=initial, seed=seed))


def spread_of(results: Sequence[Result]) -> Spread:
    """How far apart trainings of one segment end that differ in initial values and seed."""
    info, case = results[0].info, results[0].fit.case
    if len(results) < 2:
        return Spread(np.full((info.followers, 3), np.nan), ())
    tables = np.array([result.parameters.values for result in results])
    mean = tables.mean(axis=0)
    spread = 100.0 * np.divide(
        np.ptp(tables, axis=0), mean, out=np.full_like(mean, np.nan), where=mean != 0
    )
    findings: list[SpreadFinding] = []
    known = spread[np.isfinite(spread)]
    if known.size:
        unconverged = sum(result.fit.outcome is Outcome.FINISHED for result in results)
        every = known.size == spread.size
        findings.append(TrainingSpread(len(results), float(known.max()), every, unconverged))
    findings += _undetermined(info, case, tables)
    return Spread(spread, tuple(findings))


def _undetermined(info: SegmentInfo, case: Case, tables: FloatArray) -> list[SpreadUndetermined]:
    """Which parameter is nan in how many of the trials' tables (T, M, 3)."""
    vehicles = (0,) if info.shares(case) else info.vehicles[1:]
    counts = np.isnan(tables).sum(axis=0).tolist()
    return [
        SpreadUndetermined(vehicle, one.symbol, count, len(tables))
        for vehicle, row in zip(vehicles, counts, strict=False)
        for one, count in zip(PARAMETERS, row, strict=True)
        if count
    ]
