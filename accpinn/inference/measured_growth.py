"""How disturbances grow: measured where a recording holds them, and by the model beyond.

With Ĝ_k the measured gain of follower k (see `stability.measured_gain`), ε its standard error and
|H_k| the model's gain, what the model misses is a smooth function of frequency:

    δ_k(ω) = ln |G_k(jω)| - ln |H_k(jω)| ~ a Gaussian process of deviation `ERROR` whose values are
             correlated by exp(-½ [ln(ω/ω') / WIDTH]²)
    ln |Ĝ_k/H_k|(ω_i) = δ_k(ω_i) + noise of deviation ε_i, correlated by ρ between neighbours

So its mean is the measured ratio where the recording is coherent and 0, the model, where it is not,
and its band says which. Along a platoon means add, and so do variances, with a correlation of
`COMMON`, as models miss the same of all cars. Gains are measured pair by pair, each behind a car
that moves on its own account as well, so that their product is known better than the gain from the
leader to the last car. `ERROR` is what models miss in windows left out (`bench.platoon`). ρ is
(∫w² cos / ∫w²)² under the taper w.

Whether the cars explain the platoon is asked the other way round: the band of Π|H_k|, from the
posterior, is held against the gain that is measured from the leader to the last car.

Source: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, chapter 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import ndtri

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import response
from accpinn.stability.measured_gain import LEVEL, MeasuredGain, is_reference
from accpinn.units import FloatArray, Mask, Quantity, RadiansPerSecond, frozen

ERROR = 0.25
"""Deviation of the logarithm of the gain from that of a model; 2.2 dB."""
WIDTH = 0.3
"""Range in ln ω within which it changes."""
NEIGHBOURS = 0.25
"""ρ, the correlation of the noise at neighbouring frequencies."""
COMMON = 0.2
"""Correlation of what is missed in two cars of a platoon."""
ROUNDING = 1e-9
"""Least variance of a measurement."""
HALF = 0.5
"""Share of the variance that a measurement has to take away, to count as one."""
SLOWEST: RadiansPerSecond = 0.03
FASTEST: RadiansPerSecond = 1.0
FREQUENCIES = 80
"""Frequencies of a growth, evenly spaced in their logarithm."""


@dataclass(frozen=True, eq=False)
class Growth:
    """The gain from the speed ahead of some cars in a row to that of the last of them."""

    omega: FloatArray
    """(K,) in rad/s."""
    gain: FloatArray
    """(K,) the measured gain where there is one, and the model's where not."""
    lower: FloatArray
    """(K,)"""
    upper: FloatArray
    """(K,)"""
    model: FloatArray
    """(K,) the product of the cars' |H|."""
    is_measured: Mask
    """(K,) where the measurement counts more than the model."""
    level: float
    """Probability with which the band covers the gain."""

    @property
    def _top(self) -> int:
        return int(self.gain.argmax())

    @property
    def peak(self) -> Quantity:
        """The largest gain with its interval, at least 1 each."""
        ends = (self.gain, self.lower, self.upper)
        return Quantity(*(max(1.0, float(part[self._top])) for part in ends))

    @property
    def peak_omega(self) -> RadiansPerSecond:
        """Frequency of the largest gain in rad/s; 0 where no frequency is amplified."""
        return float(self.omega[self._top]) if self.gain[self._top] > 1 else 0.0

    @property
    def is_peak_measured(self) -> bool:
        """Whether the largest gain is a measured one."""
        return bool(self.is_measured[self._top])

    @property
    def model_peak(self) -> float:
        """The model's largest gain, at least 1."""
        return max(1.0, float(self.model.max()))


def growth_along(
    pairs: Sequence[MeasuredGain | None], parameters: Parameters, level: float = LEVEL
) -> Growth | None:
    """The growth along cars in a row, from each one's measured gain and model.

    Args:
        pairs: (M,) the measured gain of each car; None where there is none.
        parameters: (M,) those of the cars.
        level: of the band.

    Returns:
        None where a car's model has no bounded gain.
    """
    if not is_reference(parameters):
        return None
    omega = np.geomspace(SLOWEST, FASTEST, FREQUENCIES)
    mean, variance = corrected_gains(pairs, parameters, omega)
    whole, deviation = np.exp(mean.sum(axis=0)), np.sqrt(_of_sum(variance))
    factor = np.exp(ndtri(0.5 + level / 2.0) * deviation)
    return Growth(
        omega=frozen(omega),
        gain=frozen(whole),
        lower=frozen(whole / factor),
        upper=frozen(whole * factor),
        model=frozen(np.abs(response(parameters, omega)).prod(axis=0)),
        is_measured=variance.sum(axis=0) < (1.0 - HALF) * len(parameters) * ERROR**2,
        level=level,
    )


def corrected_gains(
    pairs: Sequence[MeasuredGain | None],
    parameters: Parameters,
    omega: FloatArray,
    error: float = ERROR,
    width: float = WIDTH,
) -> tuple[FloatArray, FloatArray]:
    """(M, K) ln |G| of each car and its variance, at frequencies (K,) in rad/s.

    ``error`` and ``width`` are those of the models; see above.
    """
    mean = np.log(np.abs(response(parameters, omega)))
    variance = np.full_like(mean, error**2)

    def covariance(left: FloatArray, right: FloatArray) -> FloatArray:
        apart = (np.log(left)[:, None] - np.log(right)) / width
        return np.asarray(error**2 * np.exp(-0.5 * apart**2))

    for k, pair in enumerate(pairs):
        if pair is None:
            continue
        noise = _noise(pair)
        used = np.isfinite(noise) & (pair.gain > 0)
        at, noise = pair.omega[used], noise[used]
        ratio = np.log(pair.gain[used] / np.abs(response(parameters[[k]], at))[0])
        distance = np.abs(at[:, None] - at) / pair.omega[0]
        shared = np.where(distance < 0.5, 1.0, np.where(distance < 1.5, NEIGHBOURS, 0.0))
        of_data = covariance(at, at) + shared * np.outer(noise, noise)
        factor = cho_factor(of_data + ROUNDING * np.eye(len(at)))
        across = covariance(omega, at)
        mean[k] += across @ cho_solve(factor, ratio)
        variance[k] -= (across * cho_solve(factor, across.T).T).sum(axis=1)
    return mean, variance


def _of_sum(variance: FloatArray) -> FloatArray:
    """(K,) the variance of the sum over cars of values with variances (M, K)."""
    apart = (1.0 - COMMON) * variance.sum(axis=0)
    return np.asarray(apart + COMMON * np.sqrt(variance).sum(axis=0) ** 2)


def _noise(measured: MeasuredGain) -> FloatArray:
    """(K,) the standard error ε of ln |Ĝ|, by a coherence without its bias of 1/n."""
    n = measured.averages
    coherence = np.maximum((n * measured.coherence - 1.0) / (n - 1.0), 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.sqrt((1.0 - coherence) / coherence / (2.0 * (n - 1.0))))
