"""Estimation methods behind one signature: a segment, a case and settings in, a `Fit` out.

What a `Method` is to the rest of the package: a name, a function and its settings. Adding a method
is one module with a `METHOD` beside this one, and one line in `registry`.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ParamSpec, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from accpinn.errors import SegmentError
from accpinn.methods.fit import Checkpoint, Fit, OnProgress, ShouldStop
from accpinn.model.cthp import Case, Trajectories
from accpinn.model.registry import BEST, PAPER
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Seconds

P = ParamSpec("P")
R = TypeVar("R")

TYPICAL_SAMPLES = 3001
"""Samples of a window of 300 s."""
FURTHER = 0.35
"""Share of a method's time that each further follower adds."""


def one_thread(work: Callable[P, R]) -> Callable[P, R]:
    """Decorate what computes with numpy and scipy, so that linear algebra takes one thread.

    On matrices as small as a platoon's, several threads mostly wait for one another.
    """
    limited: Callable[P, R] = threadpool_limits.wrap(limits=1, user_api="blas")(work)
    return limited


class Checkpoints(Protocol):
    """Where a training keeps its state, to go on from there after a stop."""

    def load(self, most: int) -> Checkpoint | None:
        """The latest state with at most so many iterations; None where there is none."""

    def save(self, state: Checkpoint) -> None:
        """Keep a state in place of the former one."""

    def reject(self, fault: Exception) -> None:
        """Say that no training can go on from the state."""


@dataclass(frozen=True)
class TaskContext:
    """What a caller lends to a running estimation; by default nothing."""

    checkpoints: Checkpoints | None = None
    """Where a long training keeps its state; None keeps nothing."""
    threads: int | None = None
    """Processor threads; None leaves the choice to the method."""
    on_progress: OnProgress | None = None
    """Called several times a second while an iterative method runs."""
    should_stop: ShouldStop | None = None
    """Asked several times a second; True ends an iterative method early."""

    @property
    def is_stopped(self) -> bool:
        """Whether whoever asked for the estimation wants it to end."""
        return bool(self.should_stop and self.should_stop())


def best_first(models: Sequence[str]) -> tuple[str, ...]:
    """The models with the answer's first, by which a method then fits unless told otherwise."""
    return BEST, *(model for model in models if model != BEST)


@dataclass(frozen=True)
class Method:
    """One entry of the registry."""

    key: str
    """Its name on the command line, in results and in files."""
    title: str
    """Its name on pages, in tables and in figures."""
    run: Callable[[tuple[Segment, ...], Case, Any, TaskContext, ModelSpec], tuple[Fit, ...]]
    """Segments, case, settings (None for the defaults), context and model to a fit of each segment;
    one that iterates reports its progress and can be stopped several times a second."""
    summary: str
    """What it does, in one line, for the help of the command line."""
    typical_seconds: Seconds
    """One follower over 300 s on two cores; two thirds of it are cross-validation."""
    version: int = 1
    """Raised whenever a change of the method changes its numbers; results then expire."""
    tolerance: float = 1e-6
    """Relative difference of parameters between two machines that run it alike."""
    settings: type[Any] | None = None
    """Their type, with `to_json` and `from_json`; None for a method without settings."""
    variant: Callable[[Mapping[str, Any]], str] | None = None
    """A few words on `Fit.config` that distinguish two fits of this method."""
    is_closed_loop: bool = False
    """Whether its trajectories are its closed-loop simulation and so no surrogate."""
    allows_missing: bool = False
    """Whether blocks of samples may be missing for longer than a straight line may bridge."""
    duration: Callable[[Segment, Any], Seconds] | None = None
    """How long it takes on a segment with settings, where that depends on these."""
    resumable_settings: Callable[[dict[str, Any]], dict[str, Any] | None] | None = None
    """The settings that trainings with one checkpoint share; None where none is kept."""
    takes_windows: bool = False
    """Whether it estimates one parameter set from several windows; all others take one alone."""
    models: Callable[[Mapping[str, Any]], Sequence[str]] = lambda _: (PAPER,)
    """Keys of the models that it can estimate with settings as JSON: first the one that it does
    unless another is asked for; the paper's is among them."""
    redraw: Callable[[Fit, FloatArray, Seconds], Trajectories] | None = None
    """The surrogate's curves at instants (N,) in s, from `Fit.arrays` alone, and the window's
    duration in s; None for a method whose curves cannot be drawn again."""

    def expected_seconds(self, segment: Segment, settings: Any = None) -> Seconds:
        """How long it takes on two cores, to within a factor of two or so."""
        if self.duration:
            return self.duration(segment, settings)
        return self.typical_seconds * relative_size(segment)

    def fit(
        self,
        segment: Segment,
        case: Case = "II",
        settings: Any = None,
        context: TaskContext | None = None,
        spec: ModelSpec = PAPER_SPEC,
    ) -> Fit:
        """Estimate the parameters of a segment; the arguments are those of `fits`."""
        return self.fits((segment,), case, settings, context, spec)[0]

    @one_thread
    def fits(
        self,
        segments: tuple[Segment, ...],
        case: Case = "II",
        settings: Any = None,
        context: TaskContext | None = None,
        spec: ModelSpec = PAPER_SPEC,
    ) -> tuple[Fit, ...]:
        """Estimate the parameters of a segment, or those that several have in common.

        A method without `takes_windows` would estimate each by itself; `study.run` refuses that.

        Args:
            segments: (K,) speeds (N, M+1) in m/s and space-gaps (N, M) in m of the same vehicles.
            case: "I" for one parameter set, "II" for one per follower.
            settings: of the method's own type; None for its defaults.
            context: checkpoints, threads, progress and stop.
            spec: one of the method's models.

        Returns:
            (K,) the fit of each; fewer where it was stopped before.

        Raises:
            AccpinnError: when the segments or the settings cannot serve the method.
        """
        for segment in segments:
            if segment.blocks_missing and not self.allows_missing:
                raise _refusal(segment, self.title)
        fits = self.run(segments, case, settings, context or TaskContext(), spec)
        return tuple(replace(fit, model=spec.model) for fit in fits)


def relative_size(segment: Segment) -> float:
    """How much longer methods take than on one follower over 300 s."""
    return segment.samples / TYPICAL_SAMPLES * (1 + FURTHER * (segment.followers - 1))


def _refusal(segment: Segment, title: str) -> SegmentError:
    """The error for a method that cannot use a segment in which blocks of samples are missing."""
    first = max(segment.blocks_missing, key=lambda block: block.share)
    where = max(first.windows, key=lambda window: window.duration)
    return SegmentError(
        f"{segment.source}: {first.columns[0]} is missing at {where}, and the method"
        f' "{title}" needs all samples; take a window without it, or choose maximum-likelihood.'
    )


def direct(
    key: str,
    title: str,
    fit: Callable[..., Fit],
    models: Sequence[str] = (PAPER,),
    *,
    takes_windows: bool = False,
    **others: Any,
) -> Method:
    """A method without settings, so fast that neither progress nor stop is needed; see `Method`.

    ``fit`` estimates the parameters of a segment, given the case, the model where there are further
    ``models``, and all segments where it takes several; how long it took is measured here.
    """

    def run(
        segments: tuple[Segment, ...],
        case: Case,
        _settings: Any,
        context: TaskContext,
        spec: ModelSpec,
    ) -> tuple[Fit, ...]:
        started, fits = time.perf_counter(), list[Fit]()
        given = (*((spec,) if len(models) > 1 else ()), *((segments,) if takes_windows else ()))
        for segment in segments:
            if fits and context.is_stopped:
                break
            fits.append(fit(segment, case, *given))
        took = time.perf_counter() - started
        return tuple(replace(estimated, seconds=took) for estimated in fits)

    return Method(key, title, run, models=lambda _: models, takes_windows=takes_windows, **others)
