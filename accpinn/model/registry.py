"""All car-following models: a further one is an acceleration, and a line here.

A model's key names its terms: "cthp-s0-delay".
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from accpinn.channels import PARAMETER_KEYS
from accpinn.errors import ConfigError
from accpinn.model import cthp
from accpinn.model.accelerations import CTHP, CTHP_S0, FVDM, IDM
from accpinn.model.following import FollowingModel
from accpinn.units import FloatArray

BASES = (
    CTHP,
    CTHP_S0,
    IDM,
    FVDM,
)
FOLLOWING: Mapping[str, FollowingModel] = {
    model.key: model
    for base in BASES
    for model in (base, base.behind_a("lag"), base.behind_a("delay"))
}
"""Every model by its key, each also behind a lag or a delay."""
CTHPS = tuple(key for key, model in FOLLOWING.items() if model.is_cthp)
"""The paper's model, and those with terms beside it."""
PAPER = CTHP.key
"""The paper's model."""
BEST = "cthp-s0-delay"
"""The model of answers: none predicts the gap in other windows better in the mean over the cars of
the recordings at hand, and none is closer to the measured gain (docs/validation.md)."""
Held = tuple[tuple[str, float], ...]
"""Names of parameters that keep their values, with these."""
TITLES: Mapping[str, str] = {key: model.title for key, model in FOLLOWING.items()}
"""Their names for people."""
JUDGED = (PAPER, BEST, IDM.key, FVDM.key)
"""Models that are judged unless others are named: the paper's, the answer's, and the usual ones."""


def following_model(key: str) -> FollowingModel:
    """The model of that key.

    Raises:
        ConfigError: for an unknown key.
    """
    try:
        return FOLLOWING[key]
    except KeyError:
        known = ", ".join(FOLLOWING)
        raise ConfigError(f"model: {key[:40]} is not known; choose from {known}.") from None


def value_of(model: str, parameters: cthp.Parameters, name: str) -> FloatArray:
    """(..) one parameter of a model's sets (..), by its name; also α, β, τ of a linearisation."""
    if name in PARAMETER_KEYS or not parameters.own.shape[-1]:
        return np.asarray(getattr(parameters, name))
    return parameters.own[..., FOLLOWING[model].names.index(name)]


def has_terms_of(model: str, parameters: cthp.Parameters) -> bool:
    """Whether a model has all terms that parameters have, so that each has the same meaning."""
    own = int(parameters.own.shape[-1])
    if model not in CTHPS:
        return own == len(FOLLOWING[model].parameters)
    used = parameters.complete[..., 3:].reshape(-1, len(cthp.TERMS)).any(axis=0)
    known = [term in FOLLOWING[model].terms for term in cthp.TERMS]
    return own == 0 and not bool((used & ~np.array(known)).any())


def time_gap(model: str, parameters: cthp.Parameters, speed: ArrayLike) -> FloatArray:
    """(..) the time gap in equilibrium at a speed in m/s; nan where there is no equilibrium.

    Args:
        model: whose parameters.
        parameters: (..)
        speed: (..) above zero.
    """
    if not parameters.own.shape[-1]:
        return parameters.time_gap(speed)
    theta = np.moveaxis(parameters.own, -1, 0)
    speed = np.asarray(speed, float)
    return np.asarray(FOLLOWING[model].equilibrium_gaps(theta, speed) / speed)


def gains_and_gap(model: str, parameters: cthp.Parameters, speed: ArrayLike) -> FloatArray:
    """(.., 3) α, β and the time gap at a speed; arguments as for `time_gap`."""
    gap = time_gap(model, parameters, speed)
    return np.stack([parameters.alpha, parameters.beta, gap], axis=-1)


def simulate(
    model: str,
    parameters: cthp.Parameters,
    time: FloatArray,
    leader_speed: FloatArray,
    initial_speeds: FloatArray,
    initial_gaps: FloatArray,
) -> cthp.Trajectories:
    """The closed loop of any model; a CTHP's is exact. See `cthp.simulate` for the arguments."""
    if not parameters.own.shape[-1]:
        return cthp.simulate(parameters, time, leader_speed, initial_speeds, initial_gaps)
    return FOLLOWING[model].simulate(
        parameters.own.T, time, leader_speed, initial_speeds, initial_gaps
    )
