"""Disturbances from a platoon's leader to each of its followers.

The speed of follower k answers the leader's by G_k = H_1 H_2 .. H_k.

max |G_k(jω)| lies below the largest crossover frequency. It is looked for there on a grid that
holds every vehicle's own peak, then found as the root of

    d log|G_k|² / dx = -Σ g_i' / (1 + g_i),   g_i = x(x + κ_i) / (α_i² + β_i²x),   x = ω²

The exact L∞ gain ‖h_1 * .. * h_k‖₁ is the total variation of the platoon's step response, and has
no closed form for k > 1. The variation is summed over exact states of the linear system, in stages
with longer and longer steps, and each turning point is located by the cubic through its
neighbours. The error is estimated by leaving out every second state.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.linalg import expm
from scipy.special import gammainccinv

from accpinn.model.cthp import Parameters, orbit
from accpinn.stability.criteria import (
    RESOLVED,
    Peak,
    checked,
    crossovers,
    peaks,
    poles,
    slowest_rate,
    step_metrics,
)
from accpinn.stability.lagged import Attenuation, is_lagged, polynomials
from accpinn.units import FloatArray, Seconds, frozen

GRID = 600
"""Number of frequencies among which the peak is first looked for."""
LOWEST = 1e-3
"""Lowest of these frequencies, relative to the smallest crossover."""
HALVINGS = 60
"""Largest number of halvings of an interval; more would not change a double."""
RESOLUTION = 1e-12
"""Relative change of a peak's x at which it is found: the next, as convergence is quadratic, would
be below a double's, and rounding of the slope moves x by as much as some 1e-14."""
SAMPLES = 4096
"""Number of states in each stage of the step response."""
STRETCH = 4
"""Ratio of a stage's end to that of the stage before."""
MOST_STAGES = 13
"""Largest number of stages; time scales that differ by ten million would need more."""
FINE = 0.05
"""Longest step of the first stage, in units of the fastest pole's time constant."""
COARSE = 0.5
"""Longest step for poles that are still felt in a stage; a period has 2π / COARSE steps."""
NEGLIGIBLE = 1e-40
"""Product of two slopes whose turning point adds nothing to a double."""
FADED = 1e-10
"""Share that a cascade of equal poles has left when it is no longer felt."""


@dataclass(frozen=True, eq=False)
class Gains:
    """L∞ gains from the leader to each of the M followers."""

    gain: FloatArray
    """(M,): ‖h_1 * .. * h_k‖₁; nan where the vehicles' time scales differ too much."""
    error: FloatArray
    """(M,): estimated error, the change of the sum when every second state is left out."""


@lru_cache(maxsize=64)  # pages ask for the same again and again
def head_to_tail_peaks(parameters: Parameters) -> Peak:
    """The largest |H_1 .. H_k| over all frequencies, for k = 1 .. M."""
    parameters = checked(parameters)
    limits = _limits(parameters)
    ordinary = int(np.isnan(limits).sum())
    with np.errstate(divide="ignore"):
        log_gain, omega = np.log(limits), np.zeros(len(parameters))
    if ordinary < len(parameters):
        omega[np.isinf(limits)] = peaks(parameters).omega[ordinary]
    if ordinary:
        log_gain[:ordinary], omega[:ordinary] = _ordinary_peaks(parameters[:ordinary])
    return Peak.of(log_gain, omega)


def _limits(parameters: Parameters) -> FloatArray:
    """(M,): 0 from the first vehicle on that does not react, inf behind an unstable one, else nan.

    Unstable is also one that is not damped.

    Where it is nan, which are the first vehicles, the gains are to be computed.
    """
    silent = np.logical_or.accumulate((parameters.alpha == 0) & (parameters.beta == 0))
    undamped = np.logical_or.accumulate(np.isinf(peaks(parameters).gain))
    return np.where(silent, 0.0, np.where(undamped, np.inf, np.nan))


def _ordinary_peaks(parameters: Parameters) -> tuple[FloatArray, FloatArray]:
    """Natural logarithm of the peaks of damped vehicles that react, and ω in rad/s; both (M,)."""
    edges = crossovers(parameters)
    if np.isnan(edges).all():
        return np.zeros(len(edges)), np.zeros(len(edges))
    attenuation, reach = Attenuation(parameters), np.tri(len(edges))
    span = np.geomspace(LOWEST * np.nanmin(edges), np.nanmax(edges), GRID)
    single = peaks(parameters).omega  # of each vehicle alone
    x = np.unique(np.concatenate([span, single[single > 0]])) ** 2
    best = np.argmin(np.cumsum(attenuation.lost(x[:, None]), axis=1), axis=0)
    low = np.concatenate([[0.0], x])[best]
    high = np.concatenate([x, x[-1:]])[best + 1]
    top = _turning(lambda at: (reach * attenuation.slope(at[:, None])).sum(axis=1), low, high)
    log_gain = -0.5 * (reach * attenuation.lost(top[:, None])).sum(axis=1)
    amplified = log_gain > 0
    return np.where(amplified, log_gain, 0.0), np.where(amplified, np.sqrt(top), 0.0)


def _turning(
    slope: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray
) -> FloatArray:
    """(M,) x between low and high (M,) where a slope (M,) turns from negative to positive.

    Where it does not turn, that is the end which the slope falls to. It is found by Ridders' method
    (IEEE Transactions on Circuits and Systems 26, 1979), which halves each interval at least.
    """
    first, last = slope(low), slope(high)
    low, high = np.where((first < 0) & (last < 0), high, low), np.where(first > 0, low, high)
    top = high
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        value = slope(middle)
        root = np.sqrt(np.maximum(value**2 - first * last, 0.0))
        share = np.divide(value, root, out=np.zeros_like(value), where=root > 0)
        before, top = top, np.clip(middle - (middle - low) * share, low, high)
        if (np.abs(top - before) <= RESOLUTION * top).all():
            break
        for at, of_at in ((middle, value), (top, slope(top))):
            inside, rising = (at > low) & (at < high), of_at < 0
            low, first = (np.where(inside & rising, *pair) for pair in ((at, low), (of_at, first)))
            high, last = (np.where(inside & ~rising, *pair) for pair in ((at, high), (of_at, last)))
    return top


def head_to_tail_gains(parameters: Parameters) -> Gains:
    """The exact L∞ gain from the leader to each follower."""
    parameters = checked(parameters)
    gain = _limits(parameters)
    error = np.zeros(len(parameters))
    ordinary = int(np.isnan(gain).sum())
    if ordinary > 1:
        fine, coarse = _step_variation(parameters[:ordinary])
        gain[:ordinary] = np.maximum(fine, 1.0)
        error[:ordinary] = np.abs(fine - coarse) + FADED
    if ordinary:
        gain[0] = step_metrics(parameters[:1]).gain[0]  # in closed form without a lag or a delay
        error[0] = RESOLVED if is_lagged(parameters[:1]) else 0.0
    return Gains(frozen(gain), frozen(error))


def _step_variation(parameters: Parameters) -> tuple[FloatArray, FloatArray]:
    """(M,) total variation of each speed after a unit step of the leader's, finely and coarsely."""
    count = len(parameters)
    stages = _stages(parameters)
    if not stages:
        return np.full(count, np.nan), np.full(count, np.nan)
    system, speed, state = cascade(parameters)
    fine, coarse = np.zeros(count), np.zeros(count)
    for _, step in stages:
        states = orbit(expm(system * step), state, SAMPLES + 1)
        speeds, rates = states @ speed.T, states @ (speed @ system).T
        fine += _variation(speeds, rates * step)
        coarse += _variation(speeds[::2], rates[::2] * (2.0 * step))
        state = states[-1]
    return fine, coarse


def cascade(parameters: Parameters) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The platoon as a linear system: its matrix (K, K), the speeds (M, K) in it, and the state.

    The state (K,) is the distance to the new equilibrium after a unit step of the leader's speed.
    Each vehicle is its polynomials' controllable form behind the speed of the one ahead. A delay
    shifts the response in time, so that only its part inside the loop is in them.
    """
    pairs = [
        (upper[: len(lower) - 1] / lower[-1], lower / lower[-1])
        for upper, lower in zip(*polynomials(parameters), strict=True)
        for lower in [np.trim_zeros(lower, "b")]
    ]
    orders = [len(lower) - 1 for _, lower in pairs]
    system, speed = np.zeros((sum(orders), sum(orders))), np.zeros((len(pairs), sum(orders)))
    state, begin, ahead = np.zeros(sum(orders)), 0, None
    for k, (upper, lower) in enumerate(pairs):
        end = begin + orders[k]
        system[range(begin, end - 1), range(begin + 1, end)] = 1.0
        system[end - 1, begin:end] = -lower[:-1]
        if ahead is not None:
            system[end - 1] += ahead
        speed[k, begin:end], state[begin] = upper, 1.0 / lower[0]
        begin, ahead = end, speed[k]
    return system, speed, state


def _stages(parameters: Parameters) -> list[tuple[Seconds, Seconds]]:
    """Begin and step of each, from the fastest pole's time scale to the slowest's.

    None where these are too far apart.
    """
    felt = float(gammainccinv(len(parameters), FADED))
    ends = [felt / min(map(slowest_rate, parameters))]
    both = [pole for vehicle in parameters for pole in poles(vehicle)]
    fastest = max(map(abs, both))
    while ends[0] * fastest > FINE * SAMPLES:
        ends.insert(0, ends[0] / STRETCH)
        if len(ends) > MOST_STAGES:
            return []
    stages = [(begin, (end - begin) / SAMPLES) for begin, end in pairwise([0.0, *ends])]
    resolved = all(
        abs(pole) * step < COARSE or -pole.real * begin > felt
        for begin, step in stages
        for pole in both
    )
    return stages if resolved else []


def _variation(values: FloatArray, slopes: FloatArray) -> FloatArray:
    """(M,) total variation of the cubics through values and slopes per step, both (N, M).

    Between two samples whose slopes differ in sign, the turning point of a s + b s² + c s³ adds
    what the samples alone miss.
    """
    rise, first, last = np.diff(values, axis=0), slopes[:-1], slopes[1:]
    total: FloatArray = np.abs(rise).sum(axis=0)
    row, column = np.nonzero(first * last < -NEGLIGIBLE)
    rise, a, last = rise[row, column], first[row, column], last[row, column]
    b, c = 3.0 * rise - 2.0 * a - last, a + last - 2.0 * rise
    s = a / (np.copysign(np.sqrt(b**2 - 3.0 * a * c), a) - b)
    turn = s * (a + s * (b + s * c))
    np.add.at(total, column, np.abs(turn) + np.abs(rise - turn) - np.abs(rise))
    return total
