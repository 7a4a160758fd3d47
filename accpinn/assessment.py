"""What a fit is worth: errors of two kinds, never mixed.

*Surrogate fit*: the method's own trajectories (the network's, the spline's) against the data.
This is what the paper's tables report; it says how well a curve was drawn, not how well the law
drives. *Closed-loop simulation*: only the leader's measured speed goes in, the law integrates its
own state from the first measured instant.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from accpinn.cthp import Trajectories, simulate
from accpinn.fit import Fit
from accpinn.segment import Segment
from accpinn.units import FloatArray


@dataclass(frozen=True, eq=False)
class TrackingErrors:
    """How far trajectories are from the data, per vehicle."""

    speed_mae: FloatArray
    """(M+1,) in m/s, leader first."""
    gap_mae: FloatArray
    """(M,) in m."""
    speed_rmse: FloatArray
    """(M+1,) in m/s."""
    gap_rmse: FloatArray
    """(M,) in m."""


def tracking_errors(segment: Segment, trajectories: Trajectories) -> TrackingErrors:
    """Errors of trajectories given on the segment's instants."""
    speed = trajectories.speeds - segment.speeds
    gap = trajectories.gaps - segment.gaps
    return TrackingErrors(
        np.abs(speed).mean(0),
        np.abs(gap).mean(0),
        np.sqrt((speed**2).mean(0)),
        np.sqrt((gap**2).mean(0)),
    )


def surrogate_errors(segment: Segment, fit: Fit) -> TrackingErrors | None:
    """Surrogate fit; None for a method that has no trajectories of its own."""
    return tracking_errors(segment, fit.surrogate) if fit.surrogate else None


def closed_loop(segment: Segment, fit: Fit) -> Trajectories | None:
    """The learned law driving behind the measured leader; None where τ is undetermined."""
    if not np.isfinite(fit.table()).all():
        return None
    return simulate(
        fit.parameters,
        segment.time,
        segment.speeds[:, 0],
        segment.speeds[0, 1:],
        segment.gaps[0],
    )


def closed_loop_errors(segment: Segment, fit: Fit) -> TrackingErrors | None:
    """Closed-loop simulation; None where τ is undetermined."""
    driven = closed_loop(segment, fit)
    return tracking_errors(segment, driven) if driven else None


HELD_OUT = 1 / 3
"""Share of the window, its end, that is kept for the test."""


def held_out_errors(
    segment: Segment, estimate: Callable[[Segment], Fit], share: float = HELD_OUT
) -> TrackingErrors | None:
    """Closed-loop errors on the end of a window, by a law learned from the part before it.

    A block of time is held out, as random instants of a smooth series tell nothing new. The
    simulation starts from the first measured instant of the part held out.

    Args:
        segment: the data.
        estimate: any method, from a segment to a fit.
        share: of the window that is held out, above 0 and below 1.

    Returns:
        None where the part before leaves τ undetermined.
    """
    border = round((1 - share) * segment.samples)
    before, after = part(segment, 0, border), part(segment, border, segment.samples)
    return closed_loop_errors(after, estimate(before))


def part(segment: Segment, first: int, end: int) -> Segment:
    """Samples ``first`` to ``end`` - 1 of a segment, as a segment of its own."""
    rows = slice(first, end)
    return replace(
        segment,
        time=segment.time[rows] - segment.time[first],
        speeds=segment.speeds[rows],
        gaps=segment.gaps[rows],
        start=segment.start + float(segment.time[first]),
    )
