"""Gains that are measured where a recording holds them, and the model's beyond.

With Ĝ_k the measured gain of follower k, ε its standard error and |H_k| the model's gain, what the
model misses is taken as a smooth function of frequency,

    δ_k(ω) = ln |G_k(jω)| - ln |H_k(jω)| ~ a Gaussian process of deviation `ERROR` whose values are
             correlated by exp(-½ [ln(ω/ω') / WIDTH]²),
    ln (Ĝ_k/|H_k|)(ω_i) = δ_k(ω_i) + noise of deviation ε_i

so that its mean is the measured ratio where a recording is coherent and 0, the model, where it is
not, with a band that says which. Along a platoon means add, and variances, too.

Source: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, chapter 2.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import response
from accpinn.stability.measured_gain import MeasuredGain
from accpinn.units import FloatArray

ERROR = 0.4
"""Deviation of the logarithm of a model's gain from the true one."""
WIDTH = 0.5
"""Range in ln ω over which it changes."""


def corrected_gains(
    pairs: Sequence[MeasuredGain | None],
    parameters: Parameters,
    omega: FloatArray,
    error: float = ERROR,
    width: float = WIDTH,
) -> tuple[FloatArray, FloatArray]:
    """(M, K) ln |G| of each follower and its variance, at frequencies (K,) in rad/s."""
    with np.errstate(divide="ignore"):
        mean = np.log(np.abs(response(parameters, omega)))
    variance = np.full_like(mean, error**2)
    for k, pair in enumerate(pairs):
        if pair is None:
            continue
        used = np.isfinite(pair.error) & (pair.gain > 0)
        at, noise = np.log(pair.omega[used]), pair.error[used]
        model = np.abs(response(parameters[[k]], pair.omega[used]))[0]
        ratio = np.log(pair.gain[used] / model)

        def covariance(left: FloatArray, right: FloatArray) -> FloatArray:
            apart = (left[:, None] - right) / width
            return np.asarray(error**2 * np.exp(-0.5 * apart**2))

        factor = cho_factor(covariance(at, at) + np.diag(noise**2 + 1e-12))
        across = covariance(np.log(omega), at)
        mean[k] += across @ cho_solve(factor, ratio)
        variance[k] -= (across * cho_solve(factor, across.T).T).sum(axis=1)
    return mean, variance
