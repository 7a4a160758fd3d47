"""Results whose analyses differ in one thing: the method, the initial values, or the instants.

*Comparison*: all methods on identical data, with parts of it held out.

*Multistart*: the PiNN from several initial values and seeds. The paper trains one recording from
five initial values of (α, β, τ) and prints where each ends (Table I). The preset `fast` solves for
α, β and τ, so its initial values have no effect after the first iteration and only the seed
matters; the preset `paper` moves them step by step, so both matter.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from accpinn.errors import AccpinnError, ConfigError
from accpinn.findings import Finding, Labelled, Words
from accpinn.methods import TaskContext
from accpinn.methods.estimate import Outcome
from accpinn.methods.pinn.config import STARTS, PinnConfig
from accpinn.methods.registry import COMPARED, segment_for, variant_name, variant_of
from accpinn.model.cthp import Parameters
from accpinn.model.spec import PAPER_SPEC
from accpinn.recordings import Recording
from accpinn.segment import Segment
from accpinn.study import Analysis
from accpinn.study.result import Result, result_of
from accpinn.study.run import estimate
from accpinn.units import FloatArray

NOTICED = 1.0
"""Spread of a parameter, in percent, above which trainings disagree."""


# Methods


@dataclass(frozen=True)
class Refused:
    """A method that could not serve the data."""

    analysis: Analysis
    fault: AccpinnError

    @property
    def method(self) -> str:
        """Name of the method in `VARIANTS`."""
        return variant_name(self.analysis.method, self.analysis.settings)


def compare(
    analysis: Analysis,
    recording: Recording | None,
    methods: Sequence[str] = COMPARED,
    *,
    segments: tuple[Segment, ...] = (),
    context: TaskContext | None = None,
) -> Iterator[Result | Refused]:
    """Run methods on the same data, and yield each result once it and those before it are known.

    A method that cannot serve the data is `Refused`, and the others run on. One that cannot
    estimate the model estimates its usual one.

    Args:
        analysis: what is asked; its own method and settings do not count.
        recording: that it is asked of; None where only the data of its windows are at hand.
        methods: names in `VARIANTS`, with their default settings.
        segments: those data; by default they are cut from the recording.
        context: threads and stop; a method that was not finished has no result.

    Raises:
        ConfigError: for an unknown method.
        SegmentError: where samples are missing that one of the methods needs.
    """
    analyses = [analysis.with_method(*variant_of(name)) for name in methods]
    if recording and not segments:
        variants = [(variant.method, variant.settings) for variant in analyses]
        for window in analysis.windows:
            segment_for(variants, recording, window.start, window.duration, analysis.vehicles)
    segments = segments or analyses[0].segments(recording)
    context = context or TaskContext()
    for variant in analyses:
        try:
            point = estimate(variant, segments, context=context)
            result = result_of(variant, segments, point, recording)
            if not context.is_stopped:
                result = result.with_holdout(context)
        except AccpinnError as fault:  # the others may well serve
            yield Refused(variant, fault)
            continue
        if context.is_stopped:
            return
        yield result


# Initial values


class TrainingSpread(Finding, frozen=True):
    """Spread of the estimates of several trainings."""

    text = (
        "The {trainings} trainings end up to {largest:.0f} % apart{why}. Do not quote a single one"
        " of them."
    )
    text_if_close = (
        "All {trainings} trainings end within {end:.2g} % of each other{where}: they repeat, which"
        " says nothing of a bias."
    )

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


@dataclass(frozen=True, eq=False)
class Spread:
    """Spread of the estimates of several trainings of one segment."""

    percent: FloatArray
    """(M, 3) spread of α, β, τ in percent: largest minus smallest, over the mean.

    It is nan for one training, and where a training leaves the parameter undetermined.
    """
    findings: tuple[TrainingSpread, ...]


def starts(
    analysis: Analysis,
    *,
    initials: Sequence[Parameters] = STARTS,
    seeds: Sequence[int] | None = None,
) -> Iterator[Analysis]:
    """The analysis with every initial value and every seed.

    Args:
        analysis: whose settings serve all trainings, but for initial values and seed. In place of
            a model without α, β and τ the paper's is trained.
        initials: of α, β, τ.
        seeds: by default that of the analysis alone.

    Examples:
        >>> import accpinn
        >>> asked = accpinn.analyse(accpinn.sample("motorway"), vehicles="1-2", preset="fast")
        >>> len(list(accpinn.starts(asked, seeds=(0, 1))))
        10
    """
    config: PinnConfig = analysis.config
    if not analysis.spec.following.is_linear:
        analysis = replace(analysis, spec=PAPER_SPEC)
    for seed in (config.seed,) if seeds is None else seeds:
        for initial in initials:
            yield analysis.with_method(analysis.method, replace(config, initial=initial, seed=seed))


def spread_of(results: Sequence[Result]) -> Spread:
    """Spread of the estimates of trainings that differ in initial values and seed.

    Examples:
        >>> import accpinn
        >>> recording = accpinn.sample("motorway")
        >>> quick = {"iterations": 20}
        >>> asked = accpinn.analyse(recording, 0, 60, "1-2", preset="fast", settings=quick)
        >>> results = [accpinn.run(each, recording) for each in list(accpinn.starts(asked))[:2]]
        >>> accpinn.spread_of(results).percent.shape
        (1, 3)
    """
    if not results:
        raise ConfigError("results: none is given; choose those of trainings, in a list.")
    if len(results) < 2:
        return Spread(np.full((results[0].info.followers, 3), np.nan), ())
    tables = np.array([result.parameters.values for result in results])
    mean = tables.mean(axis=0)
    spread = 100.0 * np.divide(
        np.ptp(tables, axis=0), mean, out=np.full_like(mean, np.nan), where=mean != 0
    )
    finite = spread[np.isfinite(spread)]
    if not finite.size:
        return Spread(spread, ())
    unconverged = sum(result.estimate.outcome is Outcome.FINISHED for result in results)
    is_whole = finite.size == spread.size
    return Spread(
        spread, (TrainingSpread(len(results), float(finite.max()), is_whole, unconverged),)
    )
