"""Where the criteria's boundaries run in the plane of two parameters, the third one kept.

Every criterion holds from some headway on, so each boundary is one curve τ(β) or τ(α): above it
the vehicle is stable.
"""

from dataclasses import dataclass

import numpy as np

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import (
    checked,
    smallest_headway_exact,
    smallest_headway_l2,
    smallest_headway_paper,
)
from accpinn.stability.frequency import peaks
from accpinn.stability.impulse import step_metrics
from accpinn.units import FloatArray, PerSecond, PerSecondSquared, frozen


@dataclass(frozen=True, eq=False)
class Boundaries:
    """The smallest τ of each criterion along a range of α or β; nan where there is none."""

    along: FloatArray
    """(K,): β in 1/s, or α in 1/s²."""
    l2: FloatArray
    """(K,) in s."""
    linf_paper: FloatArray
    """(K,) in s."""
    linf_exact: FloatArray
    """(K,) in s."""


@dataclass(frozen=True, eq=False)
class GainMap:
    """Gains over a plane, for shading: rows follow τ, columns α or β."""

    along: FloatArray
    """(K,): β in 1/s, or α in 1/s²."""
    tau: FloatArray
    """(T,) in s."""
    peak_db: FloatArray
    """(T, K): max |H| in dB, 0 where stable."""
    linf_gain: FloatArray
    """(T, K): ‖h‖₁, 1 where stable."""


def boundaries_over_beta(alpha: PerSecondSquared, beta: FloatArray) -> Boundaries:
    """In the (τ, β) plane at fixed α; ``beta`` (K,) in 1/s."""
    return _boundaries(beta, _plane(np.array(alpha), beta, np.array(0.0)))


def boundaries_over_alpha(beta: PerSecond, alpha: FloatArray) -> Boundaries:
    """In the (τ, α) plane at fixed β; ``alpha`` (K,) in 1/s²."""
    return _boundaries(alpha, _plane(alpha, np.array(beta), np.array(0.0)))


def gains_over_beta(alpha: PerSecondSquared, beta: FloatArray, tau: FloatArray) -> GainMap:
    """In the (τ, β) plane at fixed α; ``beta`` (K,) in 1/s, ``tau`` (T,) in s."""
    return _gains(beta, tau, _plane(np.array(alpha), beta, tau[:, None]))


def gains_over_alpha(beta: PerSecond, alpha: FloatArray, tau: FloatArray) -> GainMap:
    """In the (τ, α) plane at fixed β; ``alpha`` (K,) in 1/s², ``tau`` (T,) in s."""
    return _gains(alpha, tau, _plane(alpha, np.array(beta), tau[:, None]))


def _plane(alpha: FloatArray, beta: FloatArray, tau: FloatArray) -> Parameters:
    """Checked by their extremes, as all combinations follow from them."""
    checked(Parameters(*([values.min(), values.max()] for values in (alpha, beta, tau))))
    return Parameters(alpha, beta, tau)


def _boundaries(along: FloatArray, parameters: Parameters) -> Boundaries:
    shape = np.shape(along)
    return Boundaries(
        frozen(along),
        frozen(np.broadcast_to(smallest_headway_l2(parameters), shape)),
        frozen(np.broadcast_to(smallest_headway_paper(parameters), shape)),
        frozen(np.broadcast_to(smallest_headway_exact(parameters), shape)),
    )


def _gains(along: FloatArray, tau: FloatArray, parameters: Parameters) -> GainMap:
    return GainMap(
        frozen(along),
        frozen(tau),
        frozen(peaks(parameters).db),
        frozen(step_metrics(parameters).gain),
    )
