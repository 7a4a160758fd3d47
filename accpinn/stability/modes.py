"""Poles, zeros, step and impulse response of single vehicles.

    H(s) = e^(-ds) (βs + α) / Δ(s),   Δ(s) = s² (1 + λs) + e^(-ds) ((ατ+β)s + α)

Poles are the roots of Δ. With a delay there are infinitely many, of which the rightmost decide. The
infinitesimal generator of the delay equation is discretised on Chebyshev's points of [-d, 0]
(pseudospectral collocation); its eigenvalues start Newton's method on Δ itself, and what leaves no
residual is a pole. So they are those of the delay, while the verdict and the responses in time
have its approximant inside the loop (see `lagged`); the poles that decide are the same within what
estimates can resolve.

The step response is the exact motion of the linear system with that approximant, shifted by the
delay of the command. Its slope is the impulse response h, and ∫|h| the exact L∞ gain of the
verdict; as ∫h = H(0) = 1, the area below zero is (‖h‖₁ - 1) / 2.

Source: Breda, Maset and Vermiglio, SIAM Journal on Scientific Computing 27 (2005) 482-495.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import inf, isfinite, nan

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from accpinn.model.cthp import Parameters, orbit
from accpinn.stability.criteria import checked, poles
from accpinn.stability.head_to_tail import cascade
from accpinn.stability.lagged import polynomials, roots_of
from accpinn.units import FloatArray, RadiansPerSecond, Seconds

Complex = NDArray[np.complex128]
COLLOCATION = 32
"""Degree of the polynomials that stand for the motion within one delay."""
NEWTON = 12
"""Newton's steps from an eigenvalue to the pole."""
RESIDUAL = 1e-10
"""Residual of Δ, relative to the size of its terms, up to which a root is one."""
APART = 1e-6
"""Relative distance below which two roots are the same."""
MOST_POLES = 12
"""Poles of a vehicle with a delay that are given, rightmost first."""
BAND = 0.02
"""Share of the step within which it is settled."""
SAMPLES = 1600
"""Instants of a response."""
SETTLING: tuple[Seconds, Seconds] = (12.0, 600.0)
"""Least and greatest length of the response in which settling is looked for."""
TIME_CONSTANTS = 8.0
"""Time constants of the slowest pole after which a vehicle has settled."""


@dataclass(frozen=True, eq=False)
class Responses:
    """Response of a vehicle's speed to a unit step, and a unit impulse, of the speed ahead."""

    time: FloatArray
    """(N,) in s."""
    step: FloatArray
    """(N,)"""
    impulse: FloatArray
    """(N,) h in 1/s."""


@dataclass(frozen=True, eq=False)
class Modes:
    """The motion of one vehicle."""

    poles: Complex
    """(K,) in rad/s, the rightmost first; with a delay the rightmost `MOST_POLES`."""
    zeros: Complex
    """(1,) or none, in rad/s."""
    damping_ratio: float
    """ζ of the rightmost pole or pair; negative where it grows, nan without poles."""
    natural_frequency: RadiansPerSecond
    """|p| of it."""
    settling: Seconds
    """After which the step response stays within `BAND`; infinite where it does not settle."""


@lru_cache(maxsize=256)
def modes(parameters: Parameters) -> Modes:
    """Poles, zeros, damping and settling of one vehicle."""
    vehicle = checked(parameters)
    roots = exact_poles(vehicle)
    zeros = np.array([-vehicle.alpha / vehicle.beta + 0j] if vehicle.alpha and vehicle.beta else [])
    if not len(roots):
        return Modes(roots, zeros, nan, nan, inf)
    first = roots[0]
    size = float(abs(first))
    ratio = float(-first.real) / size if size else nan
    return Modes(roots, zeros, ratio, size, _settling(vehicle, roots))


def exact_poles(parameters: Parameters) -> Complex:
    """(K,) the poles of one vehicle in rad/s, the rightmost first, exact for a delay, too.

    Without α one of Δ's roots is the zero of H at the origin and no pole; one that does not react
    has none.
    """
    alpha, beta, _, _, lag, delay = parameters.complete.tolist()
    if not alpha and not beta:
        return np.empty(0, complex)
    if not delay:
        roots = np.array(poles(parameters), complex)
        return _sorted(roots if alpha else roots[np.abs(roots) > 1e-12])
    total = float(parameters.theta[1:].sum())
    starts = np.linalg.eigvals(_generator(alpha, total, lag, delay)).astype(complex)
    return _refined(starts, alpha, total, lag, delay)[:MOST_POLES]


def _sorted(roots: Complex) -> Complex:
    return roots[np.lexsort((-roots.imag, -roots.real.round(12)))]


def _generator(alpha: float, total: float, lag: float, delay: float) -> FloatArray:
    """The collocated generator of gap, speed and, with a lag, acceleration over one delay."""
    now, before = np.zeros((2, 2 + (lag > 0), 2 + (lag > 0)))
    now[0, 1] = -1.0
    if lag:
        now[1, 2], now[2, 2] = 1.0, -1.0 / lag
        before[2, :2] = alpha / lag, -total / lag
    else:
        before[1] = alpha, -total
    points = np.cos(np.pi * np.arange(COLLOCATION + 1) / COLLOCATION)
    weights = np.where((points == points[0]) | (points == points[-1]), 2.0, 1.0)
    weights *= (-1.0) ** np.arange(COLLOCATION + 1)
    apart = points[:, None] - points + np.eye(COLLOCATION + 1)
    slopes = np.outer(weights, 1.0 / weights) / apart
    slopes -= np.diag(slopes.sum(axis=1))
    size = len(now)
    matrix = np.kron(slopes * 2.0 / delay, np.eye(size))
    matrix[:size] = 0.0
    matrix[:size, :size], matrix[:size, -size:] = now, before
    return np.asarray(matrix, float)


def _refined(starts: Complex, alpha: float, total: float, lag: float, delay: float) -> Complex:
    """The roots of Δ that Newton's method finds from some starts, each once, rightmost first."""
    s = starts[np.abs(starts.real) * delay < 50.0]  # farther left nothing is left of a motion
    with np.errstate(all="ignore"):
        for _ in range(NEWTON):
            late = np.exp(-delay * s)
            value = s**2 * (1.0 + lag * s) + late * (total * s + alpha)
            slope = 2.0 * s + 3.0 * lag * s**2 + late * (total - delay * (total * s + alpha))
            s = s - value / slope
        late = np.exp(-delay * s)
        value = s**2 * (1.0 + lag * s) + late * (total * s + alpha)
        size = np.abs(s**2) * (1.0 + lag * np.abs(s)) + np.abs(late) * (total * np.abs(s) + alpha)
    s = s[np.isfinite(s) & (np.abs(value) <= RESIDUAL * size)]
    if not alpha:
        s = s[np.abs(s) > 1e-9]
    distinct: list[complex] = []
    for root in _sorted(s).tolist():
        if all(abs(root - other) > APART * (1.0 + abs(root)) for other in distinct):
            distinct.append(root)
    return np.array(distinct, complex)


def dominant_poles(draws: Parameters) -> Complex:
    """(n,) the rightmost pole with an imaginary part of zero or more, of each of n vehicles.

    It starts from the delay's approximant and is refined on Δ; nan where nothing is known.
    """
    roots = roots_of(polynomials(draws)[1])
    real = np.where(np.isnan(roots), -np.inf, roots.real)
    s = np.take_along_axis(roots, real.argmax(axis=1)[:, None], axis=1)[:, 0]
    s = s.real + 1j * np.abs(s.imag)
    lag, delay, total = draws.lag, draws.delay, draws.theta[:, 1:].sum(axis=1)
    with np.errstate(all="ignore"):
        for _ in range(3):
            late = np.exp(-delay * s)
            value = s**2 * (1.0 + lag * s) + late * (total * s + draws.alpha)
            slope = 2.0 * s + 3.0 * lag * s**2 + late * (total - delay * (total * s + draws.alpha))
            s = np.where((delay > 0) & (np.abs(slope) > 0), s - value / slope, s)
    return np.asarray(s)


def responses(parameters: Parameters, end: Seconds, samples: int = SAMPLES) -> Responses:
    """The step and the impulse response of one vehicle from 0 to ``end`` in s."""
    vehicle = checked(parameters)
    time = np.linspace(0.0, end, samples)
    if not vehicle.alpha and not vehicle.beta:
        return Responses(time, np.zeros(samples), np.zeros(samples))
    system, speed, state = cascade(vehicle[None])
    step = time[1] - time[0]
    with np.errstate(all="ignore"):  # what grows without limit
        states = orbit(expm(system * step), state, samples)
    moved = 1.0 - (states @ speed.T)[:, 0]
    slope = -(states @ (speed @ system).T)[:, 0]
    if vehicle.delay:
        before = time < vehicle.delay
        moved = np.where(before, 0.0, np.interp(time - vehicle.delay, time, moved))
        slope = np.where(before, 0.0, np.interp(time - vehicle.delay, time, slope))
    return Responses(time, moved, slope)


def _settling(vehicle: Parameters, roots: Complex) -> Seconds:
    """After which the step response stays within `BAND`."""
    rate = float(-roots[0].real)
    if rate <= 0 or not isfinite(1.0 / rate):
        return inf
    end = float(np.clip(TIME_CONSTANTS / rate + vehicle.delay, *SETTLING))
    answer = responses(vehicle, end)
    outside = np.flatnonzero(np.abs(answer.step - 1.0) > BAND)
    if not outside.size:
        return 0.0
    last = int(outside[-1])
    if last + 1 >= len(answer.time):
        return inf
    off = np.abs(answer.step[last : last + 2] - 1.0)
    share = (off[0] - BAND) / (off[0] - off[1])
    return float(answer.time[last] + share * (answer.time[1] - answer.time[0]))
