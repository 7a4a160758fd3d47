"""String stability criteria, smallest headways, frequency response and L∞ gain, in closed form.

The speed of a vehicle answers that of the one ahead by

    H(s) = (βs + α) / (s² + (ατ+β)s + α),    H(0) = 1

    L₂          |H(jω)| < 1 for all ω > 0  ⇔  κ = α²τ² + 2αβτ - 2α ≥ 0   (the paper's form: > 0)
    L∞, paper   D = (ατ+β)² - 4α > 0, that is, real poles
    L∞, exact   ‖h‖₁ = 1  ⇔  h(t) ≥ 0 for all t  ⇔  βτ ≥ 1, or D ≥ 0 and β ≤ ατ

ατ ≥ β puts the zero -α/β beyond the slow pole, once the poles are real. With α and β kept, each
criterion holds from some headway on:

    L₂          τ = 2 / (β + √(β² + 2α))
    L∞, paper   τ = (2√α - β) / α, or 0
    L∞, exact   τ = (2√α - β) / α where β² < α, otherwise 1/β

and with α and τ kept, from some β on: 1/τ - ατ/2 or 0 (L₂); 2√α - ατ or 0 where ατ² > 1, otherwise
1/τ (L∞, exact).

The gain itself, ‖h‖₁, and the overshoot of the step response follow from the same expressions.
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

In the frequency response, with x = ω² and κ,

    |H(jω)|² = N / (N + x(x + κ)),   N = α² + β²x

so frequencies below ω_c = √-κ are amplified where κ < 0, and none elsewhere. d|H|²/dx = 0 is
β²x² + 2α²x + κα² = 0. With q = x/α, its positive root and the largest gain are

    q = -κ' / (1 + √(1 - κ'β²/α)),   κ' = κ/α,      |H|² = 1 / (1 - q²)

Source: Apostolakis and Ampountolas, IEEE TVT 2024, section III, for L₂ and the paper's L∞; the
exact condition is that of a second-order response without a change of sign.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isnan
from typing import TYPE_CHECKING, Any

import numpy as np

from accpinn.channels import COMPUTABLE, PARAMETERS
from accpinn.errors import ParameterError
from accpinn.model.cthp import TERMS, Parameters, motion_matrix
from accpinn.stability.lagged import (
    frequency_response,
    is_lagged,
    lagged_stability,
    polynomials,
    step_gain,
)
from accpinn.units import FloatArray, PerSecond

if TYPE_CHECKING:
    from control import TransferFunction
    from numpy.typing import NDArray

LARGEST_TERM = 1e3
"""Largest s₀ in m, λ and d in s; and largest α, β, τ of a vehicle that has a lag or a delay."""
RESOLVED = 2e-4
"""Excess of ‖h‖₁ over 1 that the sampled response of a vehicle with a lag or delay resolves."""
MARGINAL = 1e-9
"""A criterion this close to its boundary, relatively, or a gain this little above 1, is marginal.

Far below what any estimate can resolve and far above what rounding does.
"""


def checked(parameters: Parameters) -> Parameters:
    """The parameters (..) of any vehicles, without those that have no effect.

    That is τ where α = 0, and lag and delay where also β = 0.

    Raises:
        ParameterError: for values that are missing, negative or beyond all bounds.
    """
    complete = parameters.complete.reshape(-1, 6).copy()
    values = complete[:, :3]
    if not values.size:
        raise ParameterError("There is no vehicle; give at least one set of α, β and τ.")
    with np.errstate(over="ignore"):
        values[values[:, 0] * COMPUTABLE < 1.0, 2] = 0.0
    for row, column in np.argwhere(~((values >= 0) & (values <= COMPUTABLE)))[:1]:
        value = values[row, column]
        fault = f"= {value:g} is beyond any vehicle; give α in 1/s², β in 1/s, τ in s"
        if isnan(value):
            fault = "is missing; give α, β and τ as numbers"
        elif value < 0:
            fault = (
                f"= {value:g} is negative, which the rational driving constraints rule out; give"
                " zero or more"
            )
        symbol = PARAMETERS[column].symbol
        raise ParameterError(f"Parameter set {row + 1}: {symbol} {fault}.")
    values[values * COMPUTABLE < 1.0] = 0.0
    # Near its free speed a model's linearisation has a steep gap and an intercept far below zero.
    intercept = LARGEST_TERM if parameters.is_linear else COMPUTABLE
    terms, least = complete[:, 3:], np.array([-intercept, 0.0, 0.0])
    for row, column in np.argwhere(~((terms >= least) & (terms <= LARGEST_TERM)))[:1]:
        raise ParameterError(
            f"Parameter set {row + 1}: {TERMS[column]} = {terms[row, column]:g} is beyond any"
            " vehicle; give s0 in m, lag and delay in s, zero or more."
        )
    if is_lagged(parameters) and values.max() > LARGEST_TERM:
        raise ParameterError(
            f"A gain or headway of {values.max():g} with a lag or a delay is beyond any vehicle;"
            " give α in 1/s², β in 1/s, τ in s."
        )
    complete[(values[:, :2] == 0.0).all(axis=1), 4:] = 0.0
    return Parameters.of(complete.reshape(parameters.complete.shape))


def _each(parameters: Parameters, values: FloatArray) -> FloatArray:
    """Values of the `flat` vehicles in the shape of the parameters."""
    return np.asarray(values.reshape(parameters.complete.shape[:-1]))


def spacing_gain(parameters: Parameters) -> FloatArray:
    """(..) α where it is positive and 1 elsewhere, a divisor for use before masking α = 0."""
    return np.where(parameters.alpha > 0, parameters.alpha, 1.0)


def l2_criterion(parameters: Parameters) -> FloatArray:
    """κ in 1/s²; the paper calls the vehicle L₂ string stable where it is positive."""
    margin = l2_margin(parameters)
    finite = np.where(np.isinf(margin), 0.0, margin)  # where α = 0, too, a vehicle may be unstable
    criterion = parameters.alpha * finite * 2.0 + 0.0  # + 0 turns -0 into 0
    return np.asarray(np.where(np.isinf(margin), margin, criterion))


def l2_margin(parameters: Parameters) -> FloatArray:
    """κ / 2α, free of units; where α = 0 its limit. With a lag or a delay, see `lagged`."""
    if is_lagged(parameters):
        return _each(parameters, lagged_stability(parameters.flat).margin)
    at = parameters.alpha * parameters.tau
    return np.asarray(parameters.tau * (at / 2.0 + parameters.beta) - 1.0)


def paper_criterion(parameters: Parameters) -> FloatArray:
    """D in 1/s²; the paper calls the vehicle L∞ string stable where it is positive."""
    root = 2.0 * np.sqrt(parameters.alpha)
    total = parameters.alpha * parameters.tau + parameters.beta
    return np.asarray((total - root) * (total + root))


def paper_margin(parameters: Parameters) -> FloatArray:
    """D / 4α, free of units; infinite where α = 0 < β, and 0 where both are."""
    bare = np.where(parameters.beta > 0, np.inf, 0.0)
    return np.where(
        parameters.alpha > 0, paper_criterion(parameters) / (4.0 * spacing_gain(parameters)), bare
    )


def exact_margin(parameters: Parameters, gain: FloatArray | None = None) -> FloatArray:
    """Relative excess of τ over the smallest exactly L∞ stable one; inf where α = 0.

    With a lag or a delay: 1 - ‖h‖₁, which is never above zero, where that is more than can be
    resolved, else `RESOLVED`; ``gain`` is ‖h‖₁ where it is known already.
    """
    if is_lagged(parameters):
        excess = (step_metrics(parameters).gain if gain is None else gain) - 1.0
        return np.where(excess > RESOLVED, -excess, RESOLVED)
    beyond = parameters.tau / smallest_headway_exact(parameters) - 1.0
    return np.where(parameters.alpha > 0, beyond, np.inf)


def smallest_headway_l2(parameters: Parameters) -> FloatArray:
    """The smallest L₂ stable τ in s; where α = 0 the limit of small α."""
    total = parameters.beta + np.hypot(parameters.beta, np.sqrt(2.0 * parameters.alpha))
    return np.asarray(2.0 / np.where(total > 0, total, np.nan))


def smallest_headway_paper(parameters: Parameters) -> FloatArray:
    """The τ in s above which the paper's L∞ criterion holds; where α = 0 the limit of small α."""
    return np.where(parameters.alpha > 0, np.maximum(_critical_damping(parameters), 0.0), 0.0)


def smallest_headway_exact(parameters: Parameters) -> FloatArray:
    """The smallest τ in s with ‖h‖₁ = 1; where α = 0 the limit of small α."""
    stiff = parameters.beta >= np.sqrt(parameters.alpha)
    inverse = 1.0 / np.where(stiff & (parameters.beta > 0), parameters.beta, np.nan)
    return np.where(stiff, inverse, _critical_damping(parameters))


def smallest_beta_l2(alpha: FloatArray, tau: float) -> FloatArray:
    """The smallest β in 1/s that is L₂ stable with (..) α > 0 in 1/s² and a τ > 0 in s."""
    return np.maximum(1.0 / tau - alpha * tau / 2.0, 0.0)


def smallest_beta_exact(alpha: FloatArray, tau: float) -> FloatArray:
    """The smallest β in 1/s with ‖h‖₁ = 1 at (..) α > 0 in 1/s² and a τ > 0 in s."""
    damped = np.maximum(2.0 * np.sqrt(alpha) - alpha * tau, 0.0)
    return np.where(alpha * tau**2 > 1.0, damped, 1.0 / tau)


def _critical_damping(parameters: Parameters) -> FloatArray:
    """The τ at which D = 0."""
    root = 2.0 * np.sqrt(parameters.alpha)
    return np.asarray((root - parameters.beta) / spacing_gain(parameters))


@dataclass(frozen=True, eq=False)
class StepMetrics:
    """Overshoot and gain of the step response; arrays of the parameters' shape."""

    overshoot: FloatArray
    """M, relative to a step of the speed ahead; 0 where h keeps its sign."""
    gain: FloatArray
    """‖h‖₁, the exact L∞ gain; infinite for an undamped vehicle, 0 for one that does not react."""


def step_metrics(parameters: Parameters) -> StepMetrics:
    """Overshoot and exact L∞ (peak-to-peak) gain."""
    if is_lagged(parameters):
        return StepMetrics(*(_each(parameters, part) for part in step_gain(parameters.flat)))
    root = np.sqrt(spacing_gain(parameters))
    zeta = (parameters.alpha * parameters.tau + parameters.beta) / root / 2.0
    delta = (parameters.beta - parameters.alpha * parameters.tau) / root / 2.0
    rho = np.sqrt(np.maximum(1.0 - parameters.beta * parameters.tau, 0.0))
    below = (1.0 - zeta) * (1.0 + zeta)
    complex_poles = (below > 0) & (parameters.alpha > 0)
    once = ~complex_poles & (delta > 0) & (rho > 0) & (parameters.alpha > 0)
    nu, mu = np.sqrt(np.maximum(below, 0.0)), np.sqrt(np.maximum(-below, 0.0))
    # ζt₁ for complex poles, and for real ones with ρ > 0; anything elsewhere.
    angle = np.arctan2(nu, zeta) + np.arctan2(nu, delta)
    complex_exponent = zeta * angle / np.where(nu > 0, nu, 1.0)
    inverse, distinct = 1.0 / np.where(rho > 0, rho, 1.0), np.where(mu > 0, mu, 1.0)
    apart = (np.arcsinh(distinct) + np.arcsinh(distinct * inverse)) / distinct
    real_exponent = zeta * np.where(mu > 0, apart, 1.0 + inverse)
    exponent = np.where(complex_poles, complex_exponent, real_exponent)
    overshoot = np.where(complex_poles | once, rho * np.exp(-exponent), 0.0)
    lost = -np.expm1(-np.pi * zeta / np.where(complex_poles, nu, 1.0))
    with np.errstate(divide="ignore"):  # an undamped vehicle oscillates for ever
        gain = 1.0 + 2.0 * overshoot / np.where(complex_poles, lost, 1.0)
    silent = (parameters.alpha == 0) & (parameters.beta == 0)
    return StepMetrics(overshoot, np.where(silent, 0.0, gain))


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
    if is_lagged(parameters):
        of = lagged_stability(parameters.flat)
        return Peak.of(*(_each(parameters, part) for part in (np.log(of.peak), of.omega)))
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
    """ω_c in rad/s, the highest that is amplified; nan where none is."""
    if is_lagged(parameters):
        return _each(parameters, lagged_stability(parameters.flat).crossover)
    kappa = l2_criterion(parameters)
    return np.sqrt(np.where((kappa < 0) & (parameters.alpha > 0), -kappa, np.nan))


def onsets(parameters: Parameters) -> FloatArray:
    """ω in rad/s above which a vehicle amplifies; 0 from zero on, as without lag or delay."""
    if not is_lagged(parameters):
        return np.zeros(parameters.complete.shape[:-1])
    return _each(parameters, np.nan_to_num(lagged_stability(parameters.flat).onset))


def response(parameters: Parameters, omega: FloatArray) -> "NDArray[np.complex128]":
    """(V, K) H(jω) of V vehicles at (K,) ω in rad/s, zero or more.

    It is infinite where an undamped vehicle is in resonance. The product over vehicles is the
    head-to-tail response.
    """
    return frequency_response(checked(parameters), omega)


def poles(parameters: Parameters) -> tuple[complex, ...]:
    """A vehicle's slow and fast pole, or the pair with the positive imaginary part first.

    With a lag or a delay, all poles of its motion, the slowest first.
    """
    if is_lagged(parameters):
        values = np.linalg.eigvals(motion_matrix(parameters[None])[:, :-1]).tolist()
        return tuple(sorted(values, key=lambda pole: (-pole.real, -pole.imag)))
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
    """H(s) of one vehicle as an object of python-control, whose analyses and plots then apply.

    A delay d becomes its Padé approximant of second order, see `Result.transfer_functions`.

    Args:
        parameters: of one vehicle; of another model than a CTHP its linearisation.

    Raises:
        ParameterError: for several vehicles, or values that no vehicle has.

    Examples:
        >>> import accpinn
        >>> system = accpinn.transfer_function(accpinn.Parameters(0.08, 0.3, 1.2))
        >>> round(abs(complex(system(0.25j))), 3)
        1.091
    """
    if parameters.complete.ndim > 1 and len(parameters) == 1:
        parameters = parameters[0]
    if parameters.complete.ndim > 1:
        raise ParameterError(
            f"transfer_function: {len(parameters)} vehicles are given; give one, as parameters[0]."
        )
    from control import TransferFunction  # late: it takes two seconds and loads pyplot

    vehicle = checked(parameters)
    _, lower = polynomials(vehicle[None])
    direct = [vehicle.beta, vehicle.alpha] if vehicle.alpha else [vehicle.beta]
    late = [vehicle.delay**2 / 12.0, -vehicle.delay / 2.0, 1.0]  # over q(s), which is in `lower`
    return TransferFunction(np.polymul(direct, late), lower[0, ::-1])
