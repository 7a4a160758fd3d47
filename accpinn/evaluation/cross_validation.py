"""Errors on time that the law was not learned from, in closed loop.

Blocks of time are held out, as random instants of a smooth series tell nothing new. Each third of
the window is driven by the law of the other two (see `assessment.hidden`), from its own first
measured instant on. Nothing is left between a block and what the law is learned from, so what lasts
across a border for some seconds makes these errors a little too kind.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from accpinn.errors import SegmentError
from accpinn.evaluation.closed_loop import closed_loop, closed_loop_errors, incidents
from accpinn.evaluation.errors import TrackingErrors, pooled
from accpinn.evaluation.masking import part, without
from accpinn.methods.fit import Fit
from accpinn.recordings.recording import Recording, Window
from accpinn.segment.cut import MINIMUM_DURATION, complete_windows, cut
from accpinn.segment.segment import Segment
from accpinn.units import Seconds

BLOCKS = 3
"""So many, of the same length, make up the window."""


@dataclass(frozen=True, eq=False)
class Block:
    """A block held out, and how the law learned from the rest of the window does on it."""

    start: Seconds
    """In s from the recording's first sample."""
    duration: Seconds
    errors: TrackingErrors | None
    """Closed loop; None where the rest of the window is too little or leaves τ undetermined."""
    incidents: tuple[str, ...] = ()
    """Collisions and divergence in it, in plain sentences."""


def cross_validate(
    segment: Segment, estimate: Callable[[Segment], Fit], blocks: int = BLOCKS
) -> tuple[Block, ...]:
    """Each block of the window, driven by a law learned without it.

    Args:
        segment: the data.
        estimate: any method, from a segment to a fit.
        blocks: how many, 2 or more.
    """
    ends = [round(end) for end in np.linspace(0, segment.samples, blocks + 1)]
    return tuple(_block(segment, first, end, estimate) for first, end in pairwise(ends))


def pooled_holdout_errors(blocks: tuple[Block, ...]) -> TrackingErrors | None:
    """Those of all blocks together; None where one of them has none."""
    errors = [(block.duration, block.errors) for block in blocks]
    known = [(weight, one) for weight, one in errors if one is not None]
    return pooled(known) if len(known) == len(blocks) else None


@dataclass(frozen=True, eq=False)
class OutOfWindow:
    """How a law does on the rest of the recording."""

    errors: TrackingErrors | None = None
    """Closed loop; None where nothing is left or τ is undetermined."""
    seconds: Seconds = 0.0
    """How much of the recording the errors stand on."""
    incidents: tuple[str, ...] = ()
    """Collisions and divergence there."""


def evaluate_out_of_window(segment: Segment, fit: Fit, recording: Recording) -> OutOfWindow:
    """Closed loop on all that the recording has of these vehicles outside the window."""
    parts: list[tuple[float, TrackingErrors]] = []
    said: list[str] = []
    for window in _outside(segment, recording):
        piece = cut(recording, window.start, window.duration, segment.vehicles)
        errors = closed_loop_errors(piece, fit)
        if errors is not None:
            parts.append((piece.window.duration, errors))
            said.extend(incidents(piece, closed_loop(piece, fit)))
    return OutOfWindow(pooled(parts), float(sum(seconds for seconds, _ in parts)), tuple(said))


def _block(segment: Segment, first: int, end: int, estimate: Callable[[Segment], Fit]) -> Block:
    held = part(segment, first, end)
    try:
        fit = estimate(without(segment, first, end))
    except SegmentError:  # too little is left for this method
        return Block(held.start, held.window.duration, None)
    met = incidents(held, closed_loop(held, fit))
    return Block(held.start, held.window.duration, closed_loop_errors(held, fit), met)


def _outside(segment: Segment, recording: Recording) -> list[Window]:
    """Complete windows before and after the segment's, each long enough to stand alone."""
    end = segment.start + segment.window.duration
    pieces = []
    for window in complete_windows(recording, segment.vehicles):
        pieces.append(Window(window.start, min(window.end, segment.start)))
        pieces.append(Window(max(window.start, end), window.end))
    return [piece for piece in pieces if piece.end - piece.start >= MINIMUM_DURATION]
