"""The frequency response of a vehicle: H(jω), its peak, crossover and poles.

With x = ω² and κ, the L₂ criterion,

    |H(jω)|² = N / (N + x(x + κ)),   N = α² + β²x

so frequencies below ω_c = √-κ are amplified where κ < 0, and none elsewhere. d|H|²/dx = 0 is
β²x² + 2α²x + κα² = 0. With q = x/α, its positive root and the largest gain are

    q = -κ' / (1 + √(1 - κ'β²/α)),   κ' = κ/α,      |H|² = 1 / (1 - q²)
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import checked, l2_criterion, l2_margin, spacing_gain
from accpinn.units import FloatArray, PerSecond

if TYPE_CHECKING:
    from control import TransferFunction
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Peak:
    """The largest amplification of one vehicle, in floats, or of many, in arrays of their shape.

    The gain is 1 at ω = 0 where no frequency is amplified.
    """

    gain: Any
    """max |H|; infinite for an undamped vehicle, 0 for one that does not react."""
    db: Any
    """The gain in decibels, 20 log10 max |H|."""
    omega: Any
    """ω of the peak in rad/s."""

    @classmethod
    def of(cls, log_gain: FloatArray, omega: FloatArray) -> "Peak":
        """The peaks with (..) natural logarithms of their gains at (..) ω in rad/s."""
        return cls(np.exp(log_gain), log_gain * (20.0 / np.log(10.0)), omega)

    def __iter__(self) -> Iterator["Peak"]:
        """Iterate over the vehicles, where the arrays have the shape (V,)."""
        return map(Peak, self.gain.tolist(), self.db.tolist(), self.omega.tolist())


def peaks(parameters: Parameters) -> Peak:
    """The largest gain over all frequencies, and where it is."""
    beta_squared = parameters.beta**2 / spacing_gain(parameters)
    reduced = np.where(parameters.alpha > 0, np.minimum(2.0 * l2_margin(parameters), 0.0), 0.0)
    root = np.sqrt(1.0 - beta_squared * reduced)
    q = np.abs(reduced) / (1.0 + root)
    total = (parameters.alpha * parameters.tau + parameters.beta) ** 2 / spacing_gain(parameters)
    complement = total / (1.0 + root + beta_squared)  # 1 - q without cancellation
    with np.errstate(divide="ignore"):  # an undamped vehicle's gain is infinite
        near = np.log1p(-(np.minimum(q, 0.5) ** 2))  # log(1 - q²), and so is the next
        far = np.log(complement) + np.log1p(q)
    log_gain = -0.5 * np.where(q < 0.5, near, far)
    silent = (parameters.alpha == 0) & (parameters.beta == 0)
    return Peak.of(np.where(silent, -np.inf, log_gain), np.sqrt(parameters.alpha * q))


def crossovers(parameters: Parameters) -> FloatArray:
    """ω_c in rad/s, below which frequencies are amplified; nan where none is."""
    kappa = l2_criterion(parameters)
    return np.sqrt(np.where((kappa < 0) & (parameters.alpha > 0), -kappa, np.nan))


def response(parameters: Parameters, omega: FloatArray) -> "NDArray[np.complex128]":
    """H(jω) of each vehicle; the product over vehicles is the head-to-tail response.

    Args:
        parameters: V of them.
        omega: (K,) in rad/s, zero or more.

    Returns:
        (V, K), infinite where an undamped vehicle is in resonance.
    """
    parameters = checked(parameters)
    alpha, beta = parameters.alpha[:, None], parameters.beta[:, None]
    s = 1j * np.asarray(omega, float)[None, :]
    # Without α the pole and the zero at s = 0 cancel: H = β / (s + β).
    spaced = alpha > 0
    upper = np.where(spaced, beta * s + alpha, beta)
    lower = np.where(spaced, (s + alpha * parameters.tau[:, None] + beta) * s + alpha, s + beta)
    result = np.divide(upper, lower, out=np.full(lower.shape, np.inf + 0j), where=lower != 0)
    return np.where((alpha == 0) & (beta == 0), 0.0, result)


def poles(parameters: Parameters) -> tuple[complex, complex]:
    """A vehicle's slow and fast pole, or the pair with the positive imaginary part first."""
    alpha, alpha_tau, beta = (float(value) for value in parameters.theta)
    total, root = alpha_tau + beta, 2.0 * alpha**0.5
    spread = (total - root) * (total + root)
    if spread < 0:
        upper = complex(-total, (-spread) ** 0.5) / 2.0
        return upper, upper.conjugate()
    fast = (total + spread**0.5) / 2.0
    return complex(-alpha / fast if fast else 0.0), complex(-fast)


def slowest_rate(parameters: Parameters) -> PerSecond:
    """Decay rate of the slowest part of a vehicle's transient; 0 where it never decays."""
    return float(-poles(parameters)[0].real if parameters.alpha else parameters.beta)


def transfer_function(parameters: Parameters) -> "TransferFunction":
    """H(s) of one vehicle as an object of python-control, whose analyses and plots then apply."""
    from control import TransferFunction  # late: it takes two seconds and loads pyplot

    alpha, alpha_tau, beta = (float(value) for value in checked(parameters).theta)
    return TransferFunction([beta, alpha], [1.0, alpha_tau + beta, alpha])
