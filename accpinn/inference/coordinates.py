"""The coordinates φ in which windows of a car, and cars, are compared; parameters from them.

Of a CTHP they are ln α, ln β, ln of the time gap at 100 km/h and its further terms (see `features`
in `inference.posterior`). Of any other model they are its parameters in standard deviations of
their priors, z of `model.following`; what follows from such a model is that of its linearisation at
the vehicle's median speed.
"""

import numpy as np

from accpinn.inference.posterior import AT_SPEED, log_prior_of_features
from accpinn.model.cthp import TERMS, Parameters
from accpinn.model.registry import CTHPS, FOLLOWING, Held
from accpinn.units import FloatArray, Mask


def count_of(model: str) -> int:
    """p, the number of coordinates."""
    return len(FOLLOWING[model].parameters)


def free_of(model: str, held: Held) -> Mask:
    """(p,) whether a coordinate is free: not one of a term that keeps its value."""
    fixed = [name for name, _ in held]
    return np.array([name not in fixed for name in FOLLOWING[model].names])


def log_prior(model: str, phi: FloatArray) -> FloatArray:
    """(..) log density of the prior of a window's own posterior at (.., p), up to a constant."""
    if model in CTHPS:
        return log_prior_of_features(model, phi)
    return np.asarray(-0.5 * (phi**2).sum(axis=-1))


def parameters_of(model: str, phi: FloatArray, speed: FloatArray | float) -> Parameters:
    """(..) parameters from coordinates (.., p).

    Args:
        model: whose coordinates.
        phi: (.., p)
        speed: (..) of the linearisation, in m/s; a CTHP is the same at every speed.
    """
    if model not in CTHPS:
        return FOLLOWING[model].linearisations(own_of(model, phi), speed)
    complete = np.zeros((*phi.shape[:-1], 6))
    complete[..., 0], complete[..., 1] = np.exp(phi[..., 0]), np.exp(phi[..., 1])
    for at, term in enumerate(FOLLOWING[model].terms, 3):
        least = -np.inf if term == "s0" else 0.0
        complete[..., 3 + TERMS.index(term)] = np.maximum(phi[..., at], least)
    complete[..., 2] = np.maximum(np.exp(phi[..., 2]) - complete[..., 3] / AT_SPEED, 0.0)
    return Parameters.of(complete)


def own_of(model: str, phi: FloatArray) -> FloatArray:
    """(p, ..) the parameters of a model that is no CTHP, from coordinates (.., p)."""
    kinds = FOLLOWING[model].parameters
    return np.array([kind.value(phi[..., k]) for k, kind in enumerate(kinds)])


def possible(model: str, phi: FloatArray, speed: float) -> FloatArray:
    """Draws (n, p) of equal weight that have an equilibrium at a speed; others in place of those.

    A vehicle kept that speed, so it had one. Where none has, all draws are returned.
    """
    if model in CTHPS or not np.isfinite(phi).all():
        return phi
    gaps = FOLLOWING[model].equilibrium_gaps(own_of(model, phi), speed)
    kept = np.flatnonzero(np.isfinite(gaps))
    if not len(kept):
        return phi
    chosen = np.arange(len(phi))
    lost = ~np.isfinite(gaps)
    chosen[lost] = np.resize(kept, lost.sum())
    return np.asarray(phi[chosen])
