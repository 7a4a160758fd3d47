"""How far trajectories are from the data."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from accpinn.methods.fit import Fit
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Trajectories
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray


@dataclass(frozen=True, eq=False)
class TrackingErrors:
    """How far trajectories are from the data, per vehicle; nan where that means nothing."""

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
    """Surrogate fit; None for a method whose trajectories are none or are its law's simulation."""
    if fit.surrogate is None or METHODS[fit.method].is_closed_loop:
        return None
    return tracking_errors(segment, fit.surrogate)


def pooled(parts: Sequence[tuple[float, TrackingErrors]]) -> TrackingErrors | None:
    """The errors of several stretches together, each with its weight (its duration)."""
    if not parts:
        return None
    weights = np.array([weight for weight, _ in parts]) / sum(weight for weight, _ in parts)

    def mean(name: str, power: int) -> FloatArray:
        values = np.array([getattr(errors, name) for _, errors in parts])
        return np.asarray((weights @ values**power) ** (1 / power))

    return TrackingErrors(
        mean("speed_mae", 1), mean("gap_mae", 1), mean("speed_rmse", 2), mean("gap_rmse", 2)
    )
