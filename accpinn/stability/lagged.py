"""String stability of vehicles with a lag λ or a delay d, from the polynomials of their response.

    H(s) = e^(-ds) (βs + α) q(s) / D(s),   D(s) = s² (1 + λs) q(s) + q(-s) ((ατ+β)s + α)
    q(s) = 1 + ds/2 + d²s²/12

q(-s)/q(s) is the Padé approximant of the delay inside the loop (see `model.following`). The factor
e^(-ds) shifts the response in time and changes neither |H| nor ‖h‖₁, so it needs no approximation.
s₀ shifts gaps alone and does not appear.

L₂: with x = ω², both |N|² and |D|² are polynomials in x whose constant terms are equal, so

    |H(jω)| ≤ 1 for all ω   ⇔   R(x) = (|D|² - |N|²)/x ≥ 0 for all x ≥ 0, and D has no unstable root

and the largest gain lies at a root of d|H|²/dx. L∞: with the poles p_i and residues r_i of N/D the
step response is u(t) = Σ r_i (e^(p_i t) - 1)/p_i; ‖h‖₁ is its total variation.

Without lag and delay peak, crossover and gain are the closed forms of `criteria`, to which tests
compare them, as to numerical integration of |h|. H(jω) and its attenuation have no other form.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray

from accpinn.model.cthp import Parameters
from accpinn.units import FloatArray, Mask

STAGES, STRETCH = 7, 4.0
"""The step response is taken in stages, each longer than the one before by this ratio: a fast
oscillation may stand beside a slow pole."""
INSTANTS = 144
"""Instants of each stage."""
STRIDE = 12
"""Instants whose exponentials are computed together."""
TIME_CONSTANTS = 15.0
"""Length of the step response, in time constants of the slowest pole."""
RINGING, MOST = 6.0, 256.0
"""Ratio of a pole's frequency to its decay above which more instants are taken, and how many times
as many at most."""
AT_ONCE = 200
"""Vehicles whose step responses are held at once."""
ROUNDING = 1e-9
"""Share of the largest coefficient below which R(x) counts as zero."""


def is_lagged(parameters: Parameters) -> bool:
    """Whether any vehicle has a lag or a delay."""
    return bool((parameters.complete[..., 4:] > 0).any())


def polynomials(parameters: Parameters) -> tuple[FloatArray, FloatArray]:
    """Coefficients (V, 6) of N(s) and D(s), constant term first, without a common factor s."""
    alpha, alpha_tau, beta = parameters.theta.T
    lag, delay = parameters.complete[:, 4:].T
    zeros, ones = np.zeros_like(alpha), np.ones_like(alpha)
    pade = np.stack([ones, delay / 2.0, delay**2 / 12.0], axis=1)
    mirrored = pade * [1.0, -1.0, 1.0]
    upper = _product(np.stack([alpha, beta], axis=1), pade)
    inertia = _product(np.stack([zeros, zeros, ones, lag], axis=1), pade)
    control = _product(mirrored, np.stack([alpha, alpha_tau + beta], axis=1))
    upper, inertia, control = (_padded(part) for part in (upper, inertia, control))
    lower = inertia + control
    bare = (alpha == 0)[:, None]  # without α both have a root at zero
    upper, lower = (np.where(bare, np.roll(part, -1, axis=1), part) for part in (upper, lower))
    return upper, lower


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    """(V, a+b-1) coefficients of the products of polynomials (V, a) and (V, b)."""
    result = np.zeros((len(left), left.shape[1] + right.shape[1] - 1))
    for power, coefficients in enumerate(left.T):
        result[:, power : power + right.shape[1]] += coefficients[:, None] * right
    return result


def _padded(coefficients: FloatArray) -> FloatArray:
    padded = np.zeros((len(coefficients), 6))  # np.pad takes ten times as long
    padded[:, : coefficients.shape[1]] = coefficients
    return padded


def _squared(coefficients: FloatArray) -> FloatArray:
    """(V, 6) |P(jω)|² as a polynomial in x = ω²: even powers squared plus x times odd ones."""
    signs = np.array([1.0, -1.0, 1.0])
    even, odd = coefficients[:, 0::2] * signs, coefficients[:, 1::2] * signs
    result = _product(even, even)
    return np.pad(result, ((0, 0), (0, 1))) + np.pad(_product(odd, odd), ((0, 0), (1, 0)))


def roots_of(coefficients: FloatArray) -> NDArray[np.complex128]:
    """(V, n) the roots of polynomials (V, n+1), constant term first; nan beyond their degree.

    A polynomial with coefficients that are not known has none.
    """
    count, size = coefficients.shape
    finite = np.isfinite(coefficients).all(axis=1, keepdims=True)
    degrees = np.where(finite & (coefficients != 0.0), np.arange(size), 0).max(axis=1)
    roots = np.full((count, size - 1), np.nan + 0j)
    for degree in set(degrees.tolist()) - {0}:
        rows = np.flatnonzero(degrees == degree)
        companion = np.zeros((len(rows), degree, degree))
        companion[:, range(1, degree), range(degree - 1)] = 1.0
        companion[:, :, -1] = -coefficients[rows, :degree] / coefficients[rows, degree, None]
        roots[rows[:, None], np.arange(degree)] = np.linalg.eigvals(companion)
    return roots


@dataclass(frozen=True, eq=False)
class LaggedStability:
    """Stability of V vehicles with a lag, by their polynomials."""

    peak: FloatArray
    """(V,) max |H|, at least 1; infinite for an unstable vehicle."""
    omega: FloatArray
    """(V,) ω of the peak in rad/s; 0 where nothing is amplified."""
    margin: FloatArray
    """(V,) the least R(x) relative to R's size; negative where a frequency is amplified."""
    crossover: FloatArray
    """(V,) the highest ω in rad/s below which a frequency is amplified; nan where none is."""
    onset: FloatArray
    """(V,) the lowest ω in rad/s above which one is; 0 from zero on; nan where none is."""


@lru_cache(maxsize=4)  # margin, peak and crossover of the same vehicles are asked for in turn
def lagged_stability(parameters: Parameters) -> LaggedStability:
    """Peak, crossover and L₂ margin of V vehicles."""
    upper, lower = polynomials(parameters)
    above, below = _squared(upper), _squared(lower)
    rest = (below - above)[:, 1:]
    stable = _decays(roots_of(lower))
    slopes = _product(_derived(above), below) - _product(above, _derived(below))
    at = _positive(roots_of(slopes))
    gains = _value(above, at) / np.maximum(_value(below, at), 1e-300)
    best = gains.argmax(axis=1)[:, None]
    peak, omega = (np.take_along_axis(part, best, axis=1)[:, 0] for part in (gains, np.sqrt(at)))
    places = _positive(roots_of(_derived(rest)))
    size = np.abs(rest[:, 0]) + parameters.alpha + parameters.beta**2
    margin = _value(rest, places).min(axis=1) / np.maximum(size, 1e-300)
    ends = np.sqrt(_positive(roots_of(rest)))
    last = ends.max(axis=1)
    first = np.where(ends > 0, ends, np.inf).min(axis=1)
    amplifies = (margin < -ROUNDING) & (last > 0)
    return LaggedStability(
        peak=np.where(stable, np.sqrt(np.maximum(peak, 1.0)), np.inf),
        omega=np.where(stable & (peak > 1.0), omega, 0.0),
        margin=np.where(stable, margin, -np.inf),
        crossover=np.where(amplifies, last, np.nan),
        onset=np.where(amplifies, np.where(rest[:, 0] > 0, first, 0.0), np.nan),
    )


def _decays(poles: NDArray[np.complex128]) -> Mask:
    """(V,) whether all poles (V, n) decay."""
    return np.asarray(((poles.real < 0) | np.isnan(poles)).all(axis=1))


def _derived(coefficients: FloatArray) -> FloatArray:
    return coefficients[:, 1:] * np.arange(1, coefficients.shape[1])


def _value(coefficients: FloatArray, x: NDArray[Any]) -> NDArray[Any]:
    """(V, K) the polynomials (V, n) at (V, K), real or complex."""
    return np.asarray(polyval(x, coefficients.T[:, :, None], tensor=False))


def _positive(roots: NDArray[np.complex128]) -> FloatArray:
    """(V, n+1) the roots that are real and above zero, 0 in place of the others and last."""
    real = np.abs(roots.imag) <= 1e-7 * np.maximum(np.abs(roots), 1e-12)
    positive = np.where(real & (roots.real > 0), roots.real, 0.0)
    return np.pad(positive, ((0, 0), (0, 1)))


def step_gain(parameters: Parameters) -> tuple[FloatArray, FloatArray]:
    """Overshoot of the step response (V,), and ‖h‖₁ (V,), the exact L∞ gain.

    The gain of a vehicle that is unstable, or not damped, is infinite.
    """
    upper, lower = polynomials(parameters)
    poles = roots_of(lower)
    overshoots, gains = np.full((2, len(upper)), np.inf)
    decaying = np.flatnonzero(_decays(poles) & np.isfinite(poles.real).any(axis=1))
    ringing = np.nanmax(np.abs(poles[decaying].imag / poles[decaying].real), axis=1, initial=0.0)
    finer = 2 ** np.ceil(np.log2(np.clip(ringing / RINGING, 1.0, MOST)))
    for factor in np.unique(finer).astype(int):
        alike, count = decaying[finer == factor], factor * INSTANTS
        pieces = min(len(alike), len(alike) * factor // AT_ONCE + 1)
        for rows in np.array_split(alike, pieces):
            none = np.isnan(poles[rows])
            p = np.where(none, -1.0, poles[rows])
            slopes = np.where(none, 1.0, _value(_derived(lower[rows]), p))
            weights = np.where(none, 0.0, _value(upper[rows], p) / slopes / p)
            overshoots[rows], gains[rows] = _overshoot_and_variation(p, weights, count)
    return overshoots, gains


def _overshoot_and_variation(
    poles: NDArray[np.complex128], weights: NDArray[np.complex128], count: int
) -> tuple[FloatArray, FloatArray]:
    """Overshoot and variation (V,) of the step responses Σ w_i (e^(p_i t) - 1) of V vehicles.

    Poles p and weights w are (V, n). ``count`` instants are taken in each of the stages. A turning
    point between them is that of the parabola through its neighbours.
    """
    level, highest, variation = np.zeros((3, len(poles)))
    final = -weights.sum(axis=1).real
    ends = TIME_CONSTANTS / -poles.real.max(axis=1) / STRETCH ** np.arange(STAGES)[:, None]
    begin = np.zeros(len(poles))
    for end in ends[::-1]:
        exponents = poles * ((end - begin) / count)[:, None]
        # e^(p t) at instant k = STRIDE i + j is a product of two factors, of i and of j.
        near = np.exp(exponents[:, :, None] * np.arange(STRIDE))
        far = np.exp(exponents[:, :, None] * np.arange(0, count, STRIDE))
        far *= (weights * np.exp(poles * begin[:, None]) * np.expm1(exponents))[:, :, None]
        factors = far.conj(), near
        parts = [np.concatenate([part.real, part.imag], axis=1) for part in factors]
        rises = (parts[0].swapaxes(1, 2) @ parts[1]).reshape(len(poles), -1)[:, :count]
        step = rises.cumsum(axis=1) + level[:, None]
        np.maximum(highest, step.max(axis=1), out=highest)
        variation += np.abs(rises).sum(axis=1)
        rising = rises > 0.0
        row, at = np.nonzero(rising[:, :-1] != rising[:, 1:])
        first, last = rises[row, at], rises[row, at + 1]
        beyond = (first + last) ** 2 / (8.0 * (first - last))
        np.add.at(variation, row, 2.0 * np.abs(beyond))
        np.maximum.at(highest, row, step[row, at] + beyond)
        level, begin = step[:, -1], end
    return np.maximum(highest - final, 0.0), variation + np.abs(final - level)


class Attenuation:
    """-log|H_i|² of M vehicles as a function of x = ω², exact near 0 and near a resonance."""

    def __init__(self, parameters: Parameters) -> None:
        """Take the polynomials of M vehicles."""
        upper, lower = polynomials(parameters)
        self._upper, self._lower = _in_phase(upper), _in_phase(lower)
        self._rest = _trimmed((_squared(lower) - _squared(upper))[:, 1:])

    def lost(self, x: FloatArray) -> FloatArray:
        """(K, M) -log|H_i|² at x (K, 1)."""
        n, m = (_magnitude(part, x) for part in (self._upper, self._lower))
        # The difference from 1 is exact where both are nearly equal.
        excess = _horner(self._rest, x) * x / n
        return np.where(excess < -0.5, np.log(m / n), np.log1p(np.maximum(excess, -0.5)))

    def slope(self, x: FloatArray) -> FloatArray:
        """(K, M) the derivative of -log|H_i|² by x, at x (K, 1)."""
        return _relative_slope(self._lower, x) - _relative_slope(self._upper, x)


def _in_phase(coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """P(jω) = E(x) + jω O(x) with x = ω²: the coefficients of E and of O of polynomials (V, 6)."""
    signs = np.array([1.0, -1.0, 1.0])
    even, odd = (_trimmed(coefficients[:, first::2] * signs) for first in (0, 1))
    return even, odd


def _trimmed(coefficients: FloatArray) -> FloatArray:
    """The coefficients (V, n) up to the last power, and at least one, that a polynomial has."""
    powers = np.flatnonzero(coefficients.any(axis=0))
    return coefficients[:, : powers[-1] + 1 if powers.size else 1]


def _horner(coefficients: FloatArray, x: FloatArray) -> FloatArray:
    """(K, V) the polynomials (V, n) at x (K, 1); (V,) where they are constants."""
    value = coefficients[:, -1]
    for column in coefficients.T[-2::-1]:
        value = value * x + column
    return value


def _magnitude(parts: tuple[FloatArray, FloatArray], x: FloatArray) -> FloatArray:
    """(K, V) |P(jω)|² of the polynomials `_in_phase` at x (K, 1)."""
    even, odd = (_horner(part, x) for part in parts)
    return even**2 + x * odd**2


def _relative_slope(parts: tuple[FloatArray, FloatArray], x: FloatArray) -> FloatArray:
    """(K, V) the derivative of log|P(jω)|² by x of the polynomials `_in_phase` at x (K, 1)."""
    even, odd = (_horner(part, x) for part in parts)
    slope, square = odd**2, even**2 + x * odd**2
    for value, factor, part in ((even, 2.0, parts[0]), (odd, 2.0 * x, parts[1])):
        if part.shape[1] > 1:
            slope = slope + factor * value * _horner(_derived(part), x)
    return np.asarray(slope / square)


def frequency_response(parameters: Parameters, omega: FloatArray) -> NDArray[np.complex128]:
    """(V, K) H(jω) of V vehicles at (K,) frequencies in rad/s; infinite in undamped resonance."""
    s = 1j * np.asarray(omega, float)
    upper, lower = (polyval(s, part.T) for part in polynomials(parameters))
    late = np.exp(-s * parameters.complete[:, 5:]) * upper
    ratio = np.divide(late, lower, out=np.full(lower.shape, np.inf + 0j), where=lower != 0)
    silent = (parameters.alpha == 0) & (parameters.beta == 0)
    return np.where(silent[:, None], 0.0, ratio)
