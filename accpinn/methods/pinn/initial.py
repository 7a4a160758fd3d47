"""The parameters at which a training begins, for every preset and model."""

import numpy as np

from accpinn.errors import ConfigError
from accpinn.methods import Segments
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.simulation import bounds_of
from accpinn.model.cthp import Parameters
from accpinn.model.following import FollowingModel
from accpinn.model.registry import PAPER
from accpinn.model.spec import ModelSpec
from accpinn.segment import median_speeds
from accpinn.units import FloatArray


def initial_parameters(
    segments: Segments, settings: PinnConfig | None, spec: ModelSpec
) -> tuple[str, Parameters]:
    """The parameters (M,) at which a training begins, and the key of the model that they are of.

    The preset `calibrated` begins with the paper's model, whichever is asked for.

    Raises:
        ConfigError: where the initial values are not the model's.
    """
    config, followers = settings or PinnConfig.default(), segments[0].followers
    if config.preset == "calibrated" or spec.model == PAPER:
        return PAPER, Parameters.of([config.initial.values] * followers)
    model = spec.following
    scores = initial_scores(model, config, bounds_of(model, spec.fixed))
    theta = values_of(model, scores[None], followers)
    return spec.model, model.linearisations(theta, median_speeds(segments))


def initial_scores(model: FollowingModel, config: PinnConfig, bounds: FloatArray) -> FloatArray:
    """(n,) z of the user's initial values, or of typical ones for what has none.

    Raises:
        ConfigError: where these are not the model's.
    """
    values, named = config.initial.nonlinear, model.parameters
    if model.is_linear:
        ends = np.array([(p.lower, p.upper) for p in named])
        values = np.clip([*config.initial.values, *model.typical[3:]], *ends.T)
    elif not values.size:
        return np.clip(np.zeros(len(named)), *bounds)
    if len(values) != len(named) or any(
        not p.lower <= value <= p.upper for p, value in zip(named, values, strict=True)
    ):
        allowed = ", ".join(f"{p.name} {p.lower:g} to {p.upper:g}" for p in named)
        raise ConfigError(f"initial: {model.title} begins with {len(named)} numbers: {allowed}.")
    scores = np.array([p.score(value) for p, value in zip(named, values, strict=True)])
    return np.asarray(np.clip(scores, *bounds))


def values_of(model: FollowingModel, z: FloatArray, followers: int) -> FloatArray:
    """(n, M) parameters at z (S, n), one row a follower or one for all."""
    return model.values_at(np.broadcast_to(z, (followers, z.shape[1])))
