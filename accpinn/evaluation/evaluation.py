"""All that can be said about what one fit is worth, in one object."""

from collections.abc import Callable
from dataclasses import dataclass

from accpinn.evaluation.closed_loop import closed_loop, closed_loop_errors, collisions, incidents
from accpinn.evaluation.cross_validation import (
    Block,
    OutOfWindow,
    cross_validate,
    evaluate_out_of_window,
    pooled_holdout_errors,
)
from accpinn.evaluation.errors import TrackingErrors, surrogate_errors
from accpinn.evaluation.whiteness import Whiteness, whiteness
from accpinn.methods.fit import Fit
from accpinn.recordings.recording import Recording
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What one fit is worth on its segment."""

    surrogate: TrackingErrors | None
    """Of the method's own trajectories against the data; None where it has none."""
    closed_loop: TrackingErrors | None
    """Of the law driving behind the measured leader; None where τ is not determined."""
    held_out: TrackingErrors | None
    """Closed loop on all blocks together, each by a law learned without it."""
    blocks: tuple[Block, ...]
    """The blocks one by one; empty where nothing was held out."""
    unseen: TrackingErrors | None
    """Closed loop on the rest of the recording; None without a recording or a rest."""
    out_of_window_seconds: Seconds
    """How much of the recording that is."""
    whiteness: Whiteness
    """Of what the law leaves unexplained."""
    collisions: FloatArray
    """(M,) when each follower first touches the one ahead in closed loop, in s; nan for never."""
    incidents: tuple[str, ...]
    """Collisions and divergence in closed loop, on the segment and beyond, in plain sentences."""


def evaluate(
    segment: Segment,
    fit: Fit,
    estimate: Callable[[Segment], Fit] | None = None,
    recording: Recording | None = None,
) -> Evaluation:
    """Errors of both kinds, on data seen and unseen, and the law's residual.

    Args:
        segment: the data that the fit was learned from.
        fit: any method's.
        estimate: the same method, from a segment to a fit; without it no block is held out.
        recording: the segment's; without it nothing outside the window is looked at.
    """
    blocks = cross_validate(segment, estimate) if estimate else ()
    rest = evaluate_out_of_window(segment, fit, recording) if recording else OutOfWindow()
    driven = closed_loop(segment, fit)
    return Evaluation(
        surrogate=surrogate_errors(segment, fit),
        closed_loop=closed_loop_errors(segment, fit),
        held_out=pooled_holdout_errors(blocks) if blocks else None,
        blocks=blocks,
        unseen=rest.errors,
        out_of_window_seconds=rest.seconds,
        whiteness=whiteness(segment, fit),
        collisions=collisions(segment, driven),
        incidents=(*incidents(segment, driven), *rest.incidents),
    )
