"""How disturbances grow: measured where a recording holds them, and by the model beyond.

With Ĝ_k the measured gain of follower k (see `stability.measured_gain`), ε its standard error and
|H_k| the model's gain, what the model misses is a smooth function of frequency:

    δ_k(ω) = ln |G_k(jω)| - ln |H_k(jω)| ~ a Gaussian process of deviation `ERROR` whose values are
             correlated by exp(-½ [(x - x') / WIDTH]²), x = asinh(ω / BEND), with δ_k(0) = 0
    ln |Ĝ_k/H_k|(ω_i) = δ_k(ω_i) + noise of deviation ε_i, correlated by ρ between neighbours

as G(0) = H(0) = 1. So its mean is the measured ratio where the recording is coherent and 0, the
model, where it is not, and its band says which. Along a platoon means add, and variances, too.
Gains are measured pair by pair, each behind a car that moves on its own account as well, so that
their product is known better than the gain from the leader to the last car. `ERROR` is about what
models miss in windows left out (`bench.platoon`). ρ is (∫w² cos / ∫w²)² under the taper w.

The cars' models explain a platoon where their product agrees with its growth: it does not where
both differ, by more than their bands together allow, at more than `DIFFERENT` of the frequencies.

Source: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, chapter 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import ndtri

from accpinn.inference.intervals import Uncertainty, platoon_band
from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import response
from accpinn.stability.measured_gain import LEVEL, MeasuredGain, is_reference
from accpinn.units import FloatArray, Mask, Quantity, RadiansPerSecond, frozen

ERROR = 0.3
"""Deviation of the logarithm of the gain from that of a model; 2.6 dB, about what
`bench.platoon` finds in windows left out."""
WIDTH = 0.2
"""Range in x within which it changes."""
BEND: RadiansPerSecond = 0.2
"""Frequency below which x is about linear in ω, and above which about linear in ln ω."""
NEIGHBOURS = 0.25
"""ρ, the correlation of the noise at neighbouring frequencies."""
ROUNDING = 1e-9
"""Least variance of a measurement."""
SURE = 1 / 3
"""Share of `ERROR` below which the deviation of a gain counts as a measurement's; a choice."""
DIFFERENT = 1 / 3
"""Share of the frequencies beyond which cars and platoon differ; chance has a tenth."""
COMPARED: tuple[RadiansPerSecond, RadiansPerSecond] = (0.06, 0.8)
"""Frequencies at which they are compared."""
LEAST_MEASURED = 1 / 2
"""Share of them that has to be measured."""
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
    """(K,) where the measurement, not the model, says what the gain is."""
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

    def at(self, omega: RadiansPerSecond) -> Quantity | None:
        """The measured gain at a frequency; None where there is none."""
        if not self.omega[0] <= omega <= self.omega[-1]:
            return None
        if not self.is_measured[np.abs(self.omega - omega).argmin()]:
            return None
        parts = (self.gain, self.lower, self.upper)
        return Quantity(*(float(np.interp(omega, self.omega, part)) for part in parts))

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
    whole, deviation = np.exp(mean.sum(axis=0)), np.sqrt(variance.sum(axis=0))
    factor = np.exp(ndtri(0.5 + level / 2.0) * deviation)
    return Growth(
        omega=frozen(omega),
        gain=frozen(whole),
        lower=frozen(whole / factor),
        upper=frozen(whole * factor),
        model=frozen(np.abs(response(parameters, omega)).prod(axis=0)),
        is_measured=deviation < SURE * ERROR * np.sqrt(len(parameters)),
        level=level,
    )


def different(growth: Growth, uncertainty: Uncertainty, order: Sequence[int]) -> float:
    """The share of the frequencies at which a platoon's growth differs from its cars' models.

    The order is the place of each of its vehicles. It is nan where a vehicle is not determined, or
    too little was measured.
    """
    low, high = COMPARED
    inside = (growth.omega >= low) & (growth.omega <= high)
    used = growth.is_measured & inside
    band = platoon_band(uncertainty, order, growth.omega[used])
    if used.sum() < LEAST_MEASURED * inside.sum() or np.isnan(band.lower).any():
        return np.nan
    widths = [
        np.log(growth.upper / growth.lower)[used],
        np.log(band.upper / band.lower)
        * ndtri(0.5 + growth.level / 2.0)
        / ndtri(0.5 + uncertainty.level / 2.0),
    ]
    away = np.log(growth.gain[used] ** 2 / (band.lower * band.upper))
    return float((np.abs(away) > np.hypot(*widths)).mean())


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
        apart = (np.arcsinh(left / BEND)[:, None] - np.arcsinh(right / BEND)) / width
        return np.asarray(error**2 * np.exp(-0.5 * apart**2))

    for k, pair in enumerate(pairs):
        # Every car passes on what does not oscillate: the model is right at ω = 0.
        at, ratio, noise, spacing = np.zeros(1), np.zeros(1), np.zeros(1), 1.0
        if pair:
            errors, spacing = _noise(pair), float(pair.omega[0])
            used = np.isfinite(errors) & (pair.gain > 0)
            at, noise = np.append(at, pair.omega[used]), np.append(noise, errors[used])
            model = np.abs(response(parameters[[k]], at[1:]))[0]
            ratio = np.append(ratio, np.log(pair.gain[used] / model))
        distance = np.abs(at[:, None] - at) / spacing
        shared = np.where(distance < 0.5, 1.0, np.where(distance < 1.5, NEIGHBOURS, 0.0))
        of_data = covariance(at, at) + shared * np.outer(noise, noise)
        factor = cho_factor(of_data + ROUNDING * np.eye(len(at)))
        across = covariance(omega, at)
        mean[k] += across @ cho_solve(factor, ratio)
        variance[k] -= (across * cho_solve(factor, across.T).T).sum(axis=1)
    return mean, variance


def _noise(measured: MeasuredGain) -> FloatArray:
    """(K,) the standard error ε of ln |Ĝ|, by a coherence without its bias of 1/n."""
    n = measured.averages
    coherence = np.maximum((n * measured.coherence - 1.0) / (n - 1.0), 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.sqrt((1.0 - coherence) / coherence / (2.0 * (n - 1.0))))
