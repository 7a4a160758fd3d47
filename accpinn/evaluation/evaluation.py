"""Everything that measures how good one fit is, in one object."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from accpinn.evaluation.closed_loop import (
    ClosedLoopFinding,
    TrackingErrors,
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
    collision_times,
    surrogate_errors,
)
from accpinn.evaluation.cross_validation import (
    Block,
    OutOfWindow,
    cross_validate,
    evaluate_out_of_window,
    pooled_holdout_errors,
)
from accpinn.evaluation.whiteness import Whiteness, whiteness
from accpinn.methods.fit import Fit
from accpinn.recordings.recording import Recording
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds


@dataclass(frozen=True, eq=False)
class Evaluation:
    """How good one fit is on its segment and beyond."""

    surrogate: TrackingErrors | None
    """Of the method's own trajectories against the data; None where it has none."""
    closed_loop: TrackingErrors | None
    """Of the closed-loop simulation on the segment; None where τ is undetermined."""
    holdout: TrackingErrors | None
    """Closed loop on all blocks together, each with parameters fitted to the others."""
    blocks: tuple[Block, ...]
    """The blocks one by one; empty where nothing was held out."""
    out_of_window: TrackingErrors | None
    """Closed loop on the rest of the recording; None without a recording or a rest."""
    out_of_window_seconds: Seconds
    """How much of the recording that is."""
    whiteness: Whiteness
    """Of the residual."""
    findings: tuple[ClosedLoopFinding, ...]
    """Collisions, reversing and divergence in the closed-loop simulation on the segment."""
    out_of_window_findings: tuple[ClosedLoopFinding, ...]
    """The same on the rest of the recording."""

    @property
    def all_findings(self) -> tuple[ClosedLoopFinding, ...]:
        """On the segment, then on the rest of the recording."""
        return (*self.findings, *self.out_of_window_findings)

    def collision_times(self, vehicles: Sequence[int]) -> FloatArray:
        """(M,) when each follower first collides on the segment, as `closed_loop` has it."""
        return collision_times(self.findings, vehicles)


def evaluate(
    segment: Segment,
    fit: Fit,
    estimate: Callable[[Segment], Fit] | None = None,
    recording: Recording | None = None,
) -> Evaluation:
    """Errors of both kinds, in the window, held out and outside the window, and the residual.

    Args:
        segment: the data that the parameters were fitted to.
        fit: any method's.
        estimate: the same method, from a segment to a fit; without it no block is held out.
        recording: the segment's; without it nothing outside the window is simulated.
    """
    blocks = cross_validate(segment, estimate) if estimate else ()
    rest = evaluate_out_of_window(segment, fit, recording) if recording else OutOfWindow()
    return Evaluation(
        surrogate=surrogate_errors(segment, fit),
        closed_loop=closed_loop_errors(segment, fit),
        holdout=pooled_holdout_errors(blocks) if blocks else None,
        blocks=blocks,
        out_of_window=rest.errors,
        out_of_window_seconds=rest.seconds,
        whiteness=whiteness(segment, fit),
        findings=closed_loop_findings(segment, closed_loop(segment, fit)),
        out_of_window_findings=rest.findings,
    )
