"""What an estimation method is to the rest of the package: a name, a function and its settings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from accpinn.methods.fit import Fit, OnProgress, ShouldStop
from accpinn.methods.store import Store
from accpinn.model.cthp import Case, Trajectories
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds


@dataclass(frozen=True)
class TaskContext:
    """What a caller lends to a running estimation; by default nothing."""

    store: Store | None = None
    """Where results and checkpoints are kept."""
    threads: int | None = None
    """Processor threads; None leaves the choice to the method."""
    on_progress: OnProgress | None = None
    """Called several times a second while an iterative method runs."""
    should_stop: ShouldStop | None = None
    """Asked several times a second; True ends an iterative method early."""


@dataclass(frozen=True)
class Method:
    """One entry of the registry."""

    key: str
    """Its name on the command line, in results and in files."""
    title: str
    """Its name on pages, in tables and in figures."""
    estimate: Callable[[Segment, Case, Any, TaskContext], Fit]
    """Segment, case, settings (None for the defaults) and context to a fit."""
    typical_seconds: Seconds
    """Four followers over 300 s on two cores, cross-validation included."""
    tolerance: float = 1e-6
    """Relative difference of parameters between two machines that run it alike."""
    parse_settings: Callable[[Mapping[str, Any]], Any] | None = None
    """Settings from `Fit.config`; None for a method without settings."""
    variant: Callable[[Mapping[str, Any]], str] | None = None
    """A few words on `Fit.config` that distinguish two fits of this method."""
    redraw: Callable[[Fit, FloatArray, Seconds], Trajectories] | None = None
    """The surrogate's curves at instants (N,) in s, from `Fit.arrays` alone, and the window's
    duration in s; None for a method whose curves cannot be drawn again."""

    def fit(
        self,
        segment: Segment,
        case: Case = "II",
        settings: Any = None,
        context: TaskContext | None = None,
    ) -> Fit:
        """Estimate the parameters of a segment.

        Args:
            segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
            case: "I" for one parameter set, "II" for one per follower.
            settings: of the method's own type; None for its defaults.
            context: store, threads, progress and stop.

        Raises:
            AccpinnError: when the segment or the settings cannot serve the method.
        """
        return self.estimate(segment, case, settings, context or TaskContext())


def direct(
    key: str, title: str, fit: Callable[[Segment, Case], Fit], typical_seconds: Seconds
) -> Method:
    """A method without settings, so fast that neither progress nor stop is needed."""
    return Method(key, title, lambda segment, case, _settings, _context: fit(segment, case),
                  typical_seconds)  # fmt: skip
