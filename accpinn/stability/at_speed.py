"""String stability of a car-following model at a speed: that of the CTHP which it is there.

A nonlinear model answers small disturbances differently at every speed in equilibrium. Its
linearisation at a speed is a CTHP (see `model.following`), so verdict, Bode magnitude and gains are
those of the CTHP; they say nothing of disturbances so large that the linearisation does not hold.
"""

from collections.abc import Iterable

import numpy as np

from accpinn.errors import ParameterError
from accpinn.model.following import FollowingModel, Values
from accpinn.stability.criteria import peaks
from accpinn.stability.report import VehicleStability, stability_report
from accpinn.units import FloatArray, MetresPerSecond


def stability_at(
    model: FollowingModel, theta: Values, speed: MetresPerSecond
) -> VehicleStability | None:
    """The string stability of a vehicle (n,) at a speed; None where it has no equilibrium there."""
    try:
        return stability_report(model.linearised(theta, speed)[None]).vehicles[0]
    except ParameterError:
        return None


def peak_gains(
    model: FollowingModel, theta: Values, speeds: Iterable[MetresPerSecond]
) -> FloatArray:
    """(S,) the largest gain in dB at each speed; nan where there is no equilibrium.

    The parameters are (n,), or (n, S) of their own at each speed.
    """
    speeds, theta = np.fromiter(speeds, float), np.asarray(theta, float)
    near = model.linearisations(theta if theta.ndim > 1 else theta[:, None], speeds)
    known = np.isfinite(near.alpha)
    found = np.full(len(speeds), np.nan)
    if known.any():
        found[known] = peaks(near[known]).db
    return found
