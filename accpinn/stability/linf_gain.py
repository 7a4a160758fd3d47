"""The exact L∞ gain ‖h‖₁ of a vehicle, in closed form, and the overshoot of its step response.

The largest ratio of the peaks of two consecutive speed deviations is ‖h‖₁ = ∫|h|, the total
variation of the step response u. In units of 1/√α, with

    ζ = (β + ατ)/2√α,   δ = (β - ατ)/2√α,   ρ² = 1 - βτ = 1 - ζ² + δ²

h changes sign first at t₁, where u overshoots by M = ρ exp(-ζt₁):

    complex poles, ν² = 1 - ζ² > 0    t₁ = [atan2(ν, ζ) + atan2(ν, δ)] / ν, then every π/ν
    real poles, μ² = ζ² - 1 ≥ 0       t₁ = [asinh μ + asinh(μ/ρ)] / μ where δ > 0 and ρ² > 0, once;
                                      1 + 1/ρ for a double pole; otherwise never

Each later swing is exp(-πζ/ν) of the one before, so the geometric series gives

    ‖h‖₁ = 1 + 2M / (1 - exp(-πζ/ν)) for complex poles,   1 + 2M for real ones

Nothing is subtracted from its like near a double pole or a zero that cancels a pole.
"""

from dataclasses import dataclass

import numpy as np

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import spacing_gain
from accpinn.units import FloatArray


@dataclass(frozen=True, eq=False)
class StepMetrics:
    """What follows from the step response; arrays of the parameters' shape."""

    overshoot: FloatArray
    """M, relative to a step of the speed ahead; 0 where h keeps its sign."""
    gain: FloatArray
    """‖h‖₁, the exact L∞ gain; infinite for an undamped vehicle, 0 for one that does not react."""


def step_metrics(parameters: Parameters) -> StepMetrics:
    """Overshoot and exact L∞ (peak-to-peak) gain."""
    root = np.sqrt(spacing_gain(parameters))
    zeta = (parameters.alpha * parameters.tau + parameters.beta) / root / 2.0
    delta = (parameters.beta - parameters.alpha * parameters.tau) / root / 2.0
    rho = np.sqrt(np.maximum(1.0 - parameters.beta * parameters.tau, 0.0))
    below = (1.0 - zeta) * (1.0 + zeta)
    complex_poles = (below > 0) & (parameters.alpha > 0)
    once = ~complex_poles & (delta > 0) & (rho > 0) & (parameters.alpha > 0)
    nu, mu = np.sqrt(np.maximum(below, 0.0)), np.sqrt(np.maximum(-below, 0.0))
    exponent = np.where(
        complex_poles, _complex_exponent(zeta, delta, nu), _real_exponent(zeta, rho, mu)
    )
    overshoot = np.where(complex_poles | once, rho * np.exp(-exponent), 0.0)
    lost = -np.expm1(-np.pi * zeta / np.where(complex_poles, nu, 1.0))
    with np.errstate(divide="ignore"):  # an undamped vehicle oscillates for ever
        gain = 1.0 + 2.0 * overshoot / np.where(complex_poles, lost, 1.0)
    return StepMetrics(
        overshoot, np.where((parameters.alpha == 0) & (parameters.beta == 0), 0.0, gain)
    )


def _complex_exponent(zeta: FloatArray, delta: FloatArray, nu: FloatArray) -> FloatArray:
    """ζt₁ for complex poles; anything elsewhere."""
    angle = np.arctan2(nu, zeta) + np.arctan2(nu, delta)
    return np.asarray(zeta * angle / np.where(nu > 0, nu, 1.0))


def _real_exponent(zeta: FloatArray, rho: FloatArray, mu: FloatArray) -> FloatArray:
    """ζt₁ for real poles with ρ > 0; anything elsewhere."""
    inverse = 1.0 / np.where(rho > 0, rho, 1.0)
    distinct = np.where(mu > 0, mu, 1.0)
    apart = (np.arcsinh(distinct) + np.arcsinh(distinct * inverse)) / distinct
    return np.asarray(zeta * np.where(mu > 0, apart, 1.0 + inverse))
