"""What a whole platoon does: from its leader to each follower, vehicles in any order.

The speed of follower k answers the leader's by G_k = H_1 H_2 .. H_k.

max |G_k(jω)| lies below the largest crossover frequency. It is looked for there on a grid that
holds every vehicle's own peak, then found by bisection of

    d log|G_k|² / dx = -Σ g_i' / (1 + g_i),   g_i = x(x + κ_i) / (α_i² + β_i²x),   x = ω²

The exact L∞ gain ‖h_1 * .. * h_k‖₁, the total variation of the platoon's step response, has no
closed form for k > 1. It is summed over exact states of the linear system, with each turning
point located by the cubic through its neighbours; the error is estimated by leaving out every
second state.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.special import gammainccinv

from accpinn.cthp import Parameters, motion_matrix, orbit
from accpinn.stability.criteria import Laws, l2_criterion
from accpinn.stability.frequency import Peaks, crossovers, peaks, poles
from accpinn.stability.impulse import swings
from accpinn.units import FloatArray, PerSecond, Seconds, frozen

GRID = 600
"""Frequencies on which the peak is first looked for."""
LOWEST = 1e-3
"""The lowest of them, relative to the smallest crossover."""
BISECTIONS = 60
"""More would not move a double any further."""

SAMPLES = 4096
"""States in each stage of the step response."""
STRETCH = 4
"""How much later each stage ends than the one before."""
MOST_STAGES = 13
"""More would be needed where time scales differ by ten million and beyond."""
FINE = 0.05
"""The first stage's step, in units of the fastest pole's time constant, at most."""
FADED = 1e-10
"""What a cascade of equal poles has left when the step response ends."""


@dataclass(frozen=True, eq=False)
class Gains:
    """L∞ gains from the leader to each of the M followers, summed numerically."""

    gain: FloatArray
    """(M,): ‖h_1 * .. * h_k‖₁; nan where the vehicles' time scales differ too much."""
    error: FloatArray
    """(M,): estimated error; how much the sum changes when every second state is left out."""


def head_to_tail_peaks(parameters: Sequence[Parameters]) -> Peaks:
    """The largest |H_1 .. H_k| over all frequencies; (M,) each."""
    laws = Laws.of(parameters)
    limits = _limits(laws)
    ordinary = int(np.isnan(limits).sum())
    with np.errstate(divide="ignore"):
        log_gain, omega = np.log(limits), np.zeros(len(parameters))
    omega[np.isinf(limits)] = np.sqrt(laws.alpha[ordinary]) if ordinary < len(parameters) else 0.0
    if ordinary:
        tame = Laws(laws.alpha[:ordinary], laws.beta[:ordinary], laws.tau[:ordinary])
        found = _ordinary_peaks(tame)
        log_gain[:ordinary], omega[:ordinary] = found.log_gain, found.omega
    return Peaks(frozen(log_gain), frozen(omega))


def head_to_tail_gains(parameters: Sequence[Parameters]) -> Gains:
    """The exact L∞ gain from the leader to each follower."""
    gain = _limits(Laws.of(parameters))
    error = np.zeros(len(parameters))
    ordinary = int(np.isnan(gain).sum())
    if ordinary > 1:
        fine, coarse = _step_variation(tuple(parameters[:ordinary]))
        gain[:ordinary] = np.maximum(fine, 1.0)
        error[:ordinary] = np.abs(fine - coarse) + FADED
    if ordinary:
        gain[0], error[0] = swings(Laws.of(parameters[:1])).gain[0], 0.0  # in closed form
    return Gains(frozen(gain), frozen(error))


def _limits(laws: Laws) -> FloatArray:
    """(M,): 0 from the first vehicle on that does not react, inf behind an undamped one, else nan.

    Where it is nan, which are the first vehicles, the gains are to be computed.
    """
    silent = np.logical_or.accumulate((laws.alpha == 0) & (laws.beta == 0))
    undamped = np.logical_or.accumulate((laws.alpha > 0) & (laws.alpha * laws.tau + laws.beta == 0))
    return np.where(silent, 0.0, np.where(undamped, np.inf, np.nan))


def _ordinary_peaks(laws: Laws) -> Peaks:
    """Peaks of damped vehicles that react."""
    edges = crossovers(laws)
    if np.isnan(edges).all():
        return Peaks(np.zeros(len(edges)), np.zeros(len(edges)))
    span = np.geomspace(LOWEST * np.nanmin(edges), np.nanmax(edges), GRID)
    own = peaks(laws).omega
    x = np.unique(np.concatenate([span, own[own > 0]])) ** 2
    best = np.argmin(np.cumsum(_attenuation(laws, x[:, None]), axis=1), axis=0)
    low = np.concatenate([[0.0], x])[best]
    high = np.concatenate([x, x[-1:]])[best + 1]
    reach = np.tri(len(edges))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        rising = (reach * _slope(laws, middle[:, None])).sum(axis=1) < 0
        low, high = np.where(rising, middle, low), np.where(rising, high, middle)
    log_gain = -0.5 * (reach * _attenuation(laws, high[:, None])).sum(axis=1)
    amplified = log_gain > 0
    return Peaks(np.where(amplified, log_gain, 0.0), np.where(amplified, np.sqrt(high), 0.0))


@dataclass(frozen=True, eq=False)
class _Parts:
    """|H_i|² = n / m, 1 + g = m / n, at x (K, 1); all (K, M)."""

    n: FloatArray
    m: FloatArray
    g: FloatArray


def _parts(laws: Laws, x: FloatArray) -> _Parts:
    n = laws.alpha**2 + laws.beta**2 * x
    m = (laws.alpha - x) ** 2 + (laws.alpha * laws.tau + laws.beta) ** 2 * x
    return _Parts(n, m, x * (x + l2_criterion(laws)) / n)


def _attenuation(laws: Laws, x: FloatArray) -> FloatArray:
    """(K, M): -log|H_i|² at x (K, 1), kept exact near 0 and near a resonance."""
    at = _parts(laws, x)
    return np.where(at.g < -0.5, np.log(at.m / at.n), np.log1p(np.maximum(at.g, -0.5)))


def _slope(laws: Laws, x: FloatArray) -> FloatArray:
    """(K, M): the derivative of `_attenuation` by x."""
    at = _parts(laws, x)
    return np.asarray((2.0 * x + l2_criterion(laws) - laws.beta**2 * at.g) / at.m)


def _step_variation(parameters: tuple[Parameters, ...]) -> tuple[FloatArray, FloatArray]:
    """(M,) total variation of each speed after a unit step of the leader's, finely and coarsely."""
    count = len(parameters)
    system = motion_matrix(parameters)[:, :-1]
    state = np.ones(2 * count)  # the distance to the new equilibrium, negative
    state[0::2] = [law.tau if law.alpha else 0.0 for law in parameters]
    ends = _stages(parameters)
    if len(ends) > MOST_STAGES:
        return np.full(count, np.nan), np.full(count, np.nan)
    fine, coarse = np.zeros(count), np.zeros(count)
    begin: Seconds = 0.0
    for until in ends:
        step = (until - begin) / SAMPLES
        states = orbit(expm(system * step), state, SAMPLES + 1)
        speeds, rates = states[:, 1::2], states @ system[1::2].T
        fine += _variation(speeds, rates * step)
        coarse += _variation(speeds[::2], rates[::2] * (2.0 * step))
        state, begin = states[-1], until
    return fine, coarse


def _stages(parameters: tuple[Parameters, ...]) -> list[Seconds]:
    """When the stages end: each STRETCH times as late, so that fast poles are resolved too."""
    slowest = min(slowest_rate(law) for law in parameters)
    fastest = max(abs(poles(law)[1]) for law in parameters)
    end = gammainccinv(len(parameters), FADED) / slowest
    more = int(np.ceil(np.log(end * fastest / (FINE * SAMPLES)) / np.log(STRETCH)))
    return [end / STRETCH**stage for stage in reversed(range(max(more, 0) + 1))]


def _variation(values: FloatArray, slopes: FloatArray) -> FloatArray:
    """(M,) total variation of the cubics through values and slopes per step, both (N, M).

    Between two samples whose slopes differ in sign, the turning point of a s + b s² + c s³ adds
    what the samples alone miss.
    """
    rise, first, last = np.diff(values, axis=0), slopes[:-1], slopes[1:]
    total: FloatArray = np.abs(rise).sum(axis=0)
    row, column = np.nonzero(np.sign(first) * np.sign(last) < 0)
    rise, a, last = rise[row, column], first[row, column], last[row, column]
    b, c = 3.0 * rise - 2.0 * a - last, a + last - 2.0 * rise
    s = a / (np.copysign(np.sqrt(b**2 - 3.0 * a * c), a) - b)
    turn = s * (a + s * (b + s * c))
    np.add.at(total, column, np.abs(turn) + np.abs(rise - turn) - np.abs(rise))
    return total


def slowest_rate(law: Parameters) -> PerSecond:
    """How fast the slowest part of a vehicle's transient fades; 0 where it never does."""
    return -poles(law)[0].real if law.alpha else law.beta
