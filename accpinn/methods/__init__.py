"""Estimation methods behind one signature: windows, a case and settings in, an `Estimate` out.

What a `Method` is to the rest of the package: a name, a function and its settings. Adding a method
is one module with a `METHOD` beside this one, its import and its entry in `registry`.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, ParamSpec, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from accpinn.errors import ConfigError, SegmentError
from accpinn.findings import joined
from accpinn.methods.estimate import Checkpoint, Estimate, OnProgress, ShouldStop
from accpinn.methods.forecast import Phase
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.model.registry import PAPER
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Seconds

P = ParamSpec("P")
R = TypeVar("R")

Segments = tuple[Segment, ...]
"""(K,) windows of the same vehicles."""
PosteriorKind = Literal["likelihood", "simulation"]
"""Source of an estimate's posterior: the exact likelihood, or the errors of the closed-loop
simulation."""
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
    """A place for a training's state, from which it continues after a stop."""

    def load(self, most: int) -> Checkpoint | None:
        """The latest state with at most so many iterations; None where there is none."""

    def save(self, state: Checkpoint) -> None:
        """Keep a state in place of the former one."""

    def reject(self, fault: Exception) -> None:
        """Report that no training can continue from the state."""


@dataclass(frozen=True)
class TaskContext:
    """Callbacks and resources that a caller gives to a running estimation; by default none."""

    checkpoints: Checkpoints | None = None
    """Storage for the state of a long training; None keeps nothing."""
    threads: int | None = None
    """Processor threads; None leaves the choice to the method."""
    on_progress: OnProgress | None = None
    """Called several times a second while an iterative method runs."""
    should_stop: ShouldStop | None = None
    """Asked several times a second; True ends an iterative method early."""
    on_estimate: Callable[[Estimate], object] | None = None
    """Called with the point as soon as it is known, before its intervals are."""
    with_checks: bool = False
    """Whether `study.run` also computes what a page shows beside the estimate, as a last phase."""

    @property
    def is_stopped(self) -> bool:
        """Whether the caller has asked for the estimation to end."""
        return bool(self.should_stop and self.should_stop())


@dataclass(frozen=True)
class Method:
    """One entry of the registry."""

    key: str
    """Its name on the command line, in results and in files."""
    title: str
    """Its name on pages, in tables and in figures."""
    run: Callable[[Segments, Case, Any, TaskContext, ModelSpec], Estimate]
    """The windows (K,), the case, settings (None for the defaults), context and model to one
    estimate of all windows; one that iterates reports its progress and can be stopped several times
    a second."""
    summary: str
    """One line for the help of the command line."""
    typical_seconds: Seconds
    """Duration on one follower over 300 s on two cores; two thirds of it are cross-validation."""
    version: int = 1
    """Raised whenever a change of the method changes its numbers; results then expire."""
    tolerance: float = 1e-6
    """Relative difference of parameters between two machines that run it alike."""
    settings: type[Any] | None = None
    """Their type, with `to_json` and `from_json`; None for a method without settings."""
    variant: Callable[[Mapping[str, Any]], str] | None = None
    """A few words on `Estimate.settings` that distinguish two estimates of this method."""
    description: Callable[[Mapping[str, Any]], str] | None = None
    """One sentence on its estimates with settings as JSON; by default see `described`."""
    curve_title: str = ""
    """The name of its curves in figures; empty for its title."""
    minimises_papers_loss: Callable[[Mapping[str, Any]], bool] = lambda _: False
    """Whether, with settings as JSON, its point is the minimum of the paper's loss Ψ."""
    is_closed_loop: bool = False
    """Whether its curves are its closed-loop simulation and so no surrogate."""
    allows_missing: Callable[[Mapping[str, Any]], bool] = lambda _: False
    """Whether, with settings as JSON, blocks of samples may be missing for longer than a straight
    line may bridge."""
    duration: Callable[[Segments, Any], Seconds] | None = None
    """Typical time on windows with settings, where it depends on these."""
    phases: Callable[[Segments, Any, ModelSpec], Mapping[str, Phase]] | None = None
    """Its phases by name on windows with settings and a model, in their order; None where it tells
    no progress."""
    initial: Callable[[Segments, Any, ModelSpec], tuple[str, Parameters]] | None = None
    """The parameters (M,) at which its search begins on windows with settings and a model, and the
    key of the model that they are of; None where nothing is sought step by step."""
    resumable_settings: Callable[[dict[str, Any]], dict[str, Any] | None] | None = None
    """The settings that trainings with one checkpoint share; None where none is kept."""
    models: Callable[[Mapping[str, Any]], Sequence[str]] = lambda _: (PAPER,)
    """Keys of the models that it can estimate with settings as JSON, of which the first is its
    usual one."""
    posterior: Callable[[Mapping[str, Any]], PosteriorKind | None] = lambda _: None
    """The source of its estimates' posterior with settings as JSON; None for points."""
    redraw: Callable[[Estimate, int, FloatArray, Seconds], Trajectories] | None = None
    """The curves in a window (0 for the first) at instants (N,) in s, from `Estimate.arrays` alone,
    and the window's duration in s; None for a method whose curves cannot be drawn again."""

    def expected_seconds(self, segments: Segments, settings: Any = None) -> Seconds:
        """The duration of an estimation on two cores, to within a factor of about two."""
        if self.duration:
            return self.duration(segments, settings)
        return self.typical_seconds * sum(map(relative_size, segments))

    def described(self, settings: Mapping[str, Any]) -> str:
        """One sentence on its estimates with settings as JSON: method, and whether intervals."""
        if self.description:
            return self.description(settings)
        has_posterior = self.posterior(settings) is not None
        return f"{self.title}{', with intervals' if has_posterior else ': a point'}."

    def usual_spec(self, settings: Any = None) -> ModelSpec:
        """The model that is estimated unless another is named."""
        return ModelSpec(self.models(self._json(settings))[0])

    def check(self, spec: ModelSpec, settings: Any = None) -> None:
        """Refuse a model that the method cannot estimate with its settings.

        Raises:
            ConfigError: naming the models that it can estimate, and what can estimate this one.
        """
        able = self.models(self._json(settings))
        if spec.model not in able:
            preset = self._json(settings).get("preset")
            name = f"{self.key}, preset {preset}," if preset else self.key
            raise ConfigError(
                f"model: {name} cannot estimate {spec.model}; it can {joined(able, 'or')}. For"
                f" {spec.model} choose the method simulation or the PiNN's preset fast or paper."
            )

    @one_thread
    def fit(
        self,
        segments: Segment | Segments,
        case: Case = "II",
        settings: Any = None,
        context: TaskContext | None = None,
        spec: ModelSpec | None = None,
    ) -> Estimate:
        """Estimate the parameters of a window, or those that several have in common.

        Args:
            segments: one window or (K,): speeds (N, M+1) in m/s and space-gaps (N, M) in m of the
                same vehicles.
            case: "I" for one parameter set, "II" for one per follower.
            settings: of the method's own type; None for its defaults.
            context: checkpoints, threads, progress and stop.
            spec: the model; by default the method's usual one.

        Raises:
            AccpinnError: when the windows, the settings or the model cannot serve the method.
        """
        windows = (segments,) if isinstance(segments, Segment) else tuple(segments)
        spec = spec or self.usual_spec(settings)
        self.check(spec, settings)
        if not self.allows_missing(self._json(settings)):
            for segment in windows:
                if not segment.blocks_missing:
                    continue
                first = max(segment.blocks_missing, key=lambda block: block.share)
                where = max(first.windows, key=lambda window: window.duration)
                raise SegmentError(
                    f"{segment.source}: {first.columns[0]} is missing at {where}, and the method"
                    f' "{self.title}" needs all samples; take a window without it, or choose the'
                    " preset calibrated."
                )
        return self.run(windows, case, settings, context or TaskContext(), spec)

    def _json(self, settings: Any) -> Mapping[str, Any]:
        """Settings as JSON; those by default where None are given."""
        if self.settings is None:
            return {}
        document: Mapping[str, Any] = (settings or self.settings.default()).to_json()
        return document


def relative_size(segment: Segment) -> float:
    """The size of a segment in relation to one follower over 300 s."""
    return segment.samples / TYPICAL_SAMPLES * (1 + FURTHER * (segment.followers - 1))


def direct(
    key: str,
    title: str,
    fit: Callable[[Segments, Case, ModelSpec], Estimate],
    models: Sequence[str] = (PAPER,),
    **others: Any,
) -> Method:
    """A method without settings, so fast that neither progress nor stop is needed; see `Method`.

    ``fit`` estimates the parameters of windows (K,), given the case and one of the ``models``; how
    long it took is measured here.
    """

    def run(
        segments: Segments, case: Case, _settings: Any, _context: TaskContext, spec: ModelSpec
    ) -> Estimate:
        started = time.perf_counter()
        estimate = fit(segments, case, spec)
        return replace(estimate, seconds=time.perf_counter() - started)

    return Method(key, title, run, models=lambda _: models, **others)
