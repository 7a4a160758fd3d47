"""The learned law driving by itself behind the measured leader, and what goes wrong with it.

A follower that is lost, and those behind it, get no errors: a mean over what comes after means
nothing. One that collides or drives backwards keeps its errors, as the simulation goes on through
the vehicle ahead; its incident belongs wherever such an error is shown.
"""

import numpy as np
from numpy.typing import NDArray

from accpinn.evaluation.errors import TrackingErrors, tracking_errors
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Trajectories, simulate
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Metres, MetresPerSecond

LOST: Metres = 1000.0
"""A follower this far behind follows no longer; measured gaps stay below 200 m."""
BACKWARDS: MetresPerSecond = -0.5
"""The law knows no standstill; a slower creep backwards is its way to stop."""
ALONE = " when its law drives by itself"
"""Stands in every sentence about an incident; a heading that says so can do without."""


def closed_loop(segment: Segment, fit: Fit) -> Trajectories | None:
    """The learned law driving behind the measured leader; None where τ is undetermined."""
    if not np.isfinite(fit.parameters.values).all():
        return None
    with np.errstate(over="ignore", invalid="ignore"):  # a law that diverges is found below
        return simulate(
            fit.parameters,
            segment.time,
            segment.speeds[:, 0],
            segment.speeds[0, 1:],
            segment.gaps[0],
        )


def closed_loop_errors(segment: Segment, fit: Fit) -> TrackingErrors | None:
    """Closed-loop simulation; None where τ is undetermined, nan from a lost follower on."""
    driven = closed_loop(segment, fit)
    if driven is None:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        errors = tracking_errors(segment, driven)
    lost = _lost(driven).any(axis=0)
    if not lost.any():
        return errors
    first = int(lost.argmax())
    return TrackingErrors(
        _void(errors.speed_mae, first + 1),
        _void(errors.gap_mae, first),
        _void(errors.speed_rmse, first + 1),
        _void(errors.gap_rmse, first),
    )


def collisions(segment: Segment, driven: Trajectories | None) -> FloatArray:
    """When each follower first touches the vehicle ahead.

    Args:
        segment: the data; where they touch themselves, the law is not to blame.
        driven: the closed loop on the segment's instants.

    Returns:
        (M,) in s from the recording's first sample; nan for never.
    """
    if driven is None:
        return np.full(segment.followers, np.nan)
    touching = (driven.gaps <= 0) & (segment.gaps > 0)
    return np.where(touching.any(axis=0), _first(segment, touching), np.nan)


def incidents(segment: Segment, driven: Trajectories | None) -> tuple[str, ...]:
    """What goes wrong in the closed loop on the segment's instants, a sentence each."""
    if driven is None:
        return ()
    touched = collisions(segment, driven)
    lost = _lost(driven)
    floor = np.minimum(BACKWARDS, segment.speeds[:, 1:].min(axis=0))
    backwards = (driven.speeds[:, 1:] < floor) & ~lost
    said = []
    for k, label in enumerate(segment.labels[1:]):
        if np.isfinite(touched[k]):
            said.append(
                f"{label} runs into the vehicle ahead at {touched[k]:.1f} s{ALONE}; its gap then"
                f" falls to {np.nanmin(driven.gaps[:, k]):z.1f} m."
            )
        if backwards[:, k].any():
            said.append(
                f"{label} drives backwards at {_first(segment, backwards)[k]:.1f} s{ALONE}, at up"
                f" to {-driven.speeds[backwards[:, k], k + 1].min():.1f} m/s."
            )
        if lost[:, k].any():
            said.append(
                f"{label} diverges{ALONE}: its gap leaves ±{LOST:.0f} m at"
                f" {_first(segment, lost)[k]:.1f} s, so it and those behind it have no closed-loop"
                " errors."
            )
    return tuple(said)


def _lost(driven: Trajectories) -> NDArray[np.bool_]:
    """(N, M) where a follower is no longer anywhere near, from the first such instant on."""
    return np.asarray(np.logical_or.accumulate(~(np.abs(driven.gaps) <= LOST), axis=0))


def _first(segment: Segment, when: NDArray[np.bool_]) -> FloatArray:
    """(M,) the first instant at which each column of ``when`` (N, M) holds."""
    return np.asarray(segment.start + segment.time[when.argmax(axis=0)])


def _void(values: FloatArray, first: int) -> FloatArray:
    return np.where(np.arange(len(values)) >= first, np.nan, values)
