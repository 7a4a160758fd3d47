"""Errors on time that the law was not learned from, in closed loop.

Blocks of time are held out, as random instants of a smooth series tell nothing new. The window's
first third is driven by the law of the last two thirds, its last third by that of the first two.
The middle cannot be held out without splicing what lies around it. Each simulation starts from the
first measured instant of its block.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from accpinn.assessment.driving import closed_loop, closed_loop_errors, incidents
from accpinn.assessment.errors import TrackingErrors, pooled
from accpinn.fit import Fit
from accpinn.openacc import Recording
from accpinn.segment import MINIMUM_DURATION, Segment, Window, complete_windows, cut
from accpinn.units import Seconds

HELD_OUT = 1 / 3
"""Share of the window in each block held out."""


@dataclass(frozen=True, eq=False)
class Block:
    """A block held out, and how the law learned from the rest of the window does on it."""

    start: Seconds
    """In s from the recording's first sample."""
    duration: Seconds
    errors: TrackingErrors | None
    """Closed loop; None where the rest of the window leaves τ undetermined."""
    incidents: tuple[str, ...] = ()
    """Collisions and divergence in it, in plain sentences."""


def blocks_held_out(
    segment: Segment, estimate: Callable[[Segment], Fit], share: float = HELD_OUT
) -> tuple[Block, Block]:
    """The window's first and last part, each driven by a law learned without it.

    Args:
        segment: the data.
        estimate: any method, from a segment to a fit.
        share: of the window in each block, above 0 and below 1.
    """
    count = segment.samples
    length = round(share * count)
    first, after = part(segment, 0, length), part(segment, length, count)
    before, last = part(segment, 0, count - length), part(segment, count - length, count)
    return _block(first, estimate(after)), _block(last, estimate(before))


def held_out_errors(blocks: tuple[Block, ...]) -> TrackingErrors | None:
    """Those of all blocks together; None where one of them has none."""
    errors = [(block.duration, block.errors) for block in blocks]
    known = [(weight, one) for weight, one in errors if one is not None]
    return pooled(known) if len(known) == len(blocks) else None


@dataclass(frozen=True, eq=False)
class Unseen:
    """How a law does on the rest of the recording."""

    errors: TrackingErrors | None = None
    """Closed loop; None where nothing is left or τ is undetermined."""
    seconds: Seconds = 0.0
    """How much of the recording the errors stand on."""
    incidents: tuple[str, ...] = ()
    """Collisions and divergence there."""


def drive_unseen(segment: Segment, fit: Fit, recording: Recording) -> Unseen:
    """Closed loop on all that the recording has of these vehicles outside the window."""
    parts: list[tuple[float, TrackingErrors]] = []
    said: list[str] = []
    for window in _outside(segment, recording):
        piece = cut(recording, window.start, window.duration, segment.vehicles)
        errors = closed_loop_errors(piece, fit)
        if errors is not None:
            parts.append((piece.duration, errors))
            said.extend(incidents(piece, closed_loop(piece, fit)))
    return Unseen(pooled(parts), float(sum(seconds for seconds, _ in parts)), tuple(said))


def part(segment: Segment, first: int, end: int) -> Segment:
    """Samples ``first`` to ``end`` - 1 of a segment, as a segment of its own."""
    rows = slice(first, end)
    return replace(
        segment,
        time=segment.time[rows] - segment.time[first],
        speeds=segment.speeds[rows],
        gaps=segment.gaps[rows],
        left_out=None if segment.left_out is None else segment.left_out[rows],
        start=segment.start + float(segment.time[first]),
    )


def _block(held: Segment, fit: Fit) -> Block:
    met = incidents(held, closed_loop(held, fit))
    return Block(held.start, held.duration, closed_loop_errors(held, fit), met)


def _outside(segment: Segment, recording: Recording) -> list[Window]:
    """Complete windows before and after the segment's, each long enough to stand alone."""
    end = segment.start + segment.duration
    pieces = []
    for window in complete_windows(recording, segment.vehicles):
        pieces.append(Window(window.start, min(window.end, segment.start)))
        pieces.append(Window(max(window.start, end), window.end))
    return [piece for piece in pieces if piece.end - piece.start >= MINIMUM_DURATION]
