"""What a whole platoon does to a sinusoid: from its leader to each follower, in any order.

The speed of follower k answers the leader's by G_k = H_1 H_2 .. H_k.

max |G_k(jω)| lies below the largest crossover frequency. It is looked for there on a grid that
holds every vehicle's own peak, then found by bisection of

    d log|G_k|² / dx = -Σ g_i' / (1 + g_i),   g_i = x(x + κ_i) / (α_i² + β_i²x),   x = ω²
"""

from dataclasses import dataclass

import numpy as np

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import checked, l2_criterion
from accpinn.stability.frequency import Peaks, crossovers, peaks
from accpinn.units import FloatArray, frozen

GRID = 600
"""Frequencies on which the peak is first looked for."""
LOWEST = 1e-3
"""The lowest of them, relative to the smallest crossover."""
BISECTIONS = 60
"""More would not move a double any further."""


def head_to_tail_peaks(parameters: Parameters) -> Peaks:
    """The largest |H_1 .. H_k| over all frequencies; (M,) each."""
    parameters = checked(parameters)
    known = limits(parameters)
    ordinary = int(np.isnan(known).sum())
    with np.errstate(divide="ignore"):
        log_gain, omega = np.log(known), np.zeros(len(parameters))
    omega[np.isinf(known)] = (
        np.sqrt(parameters.alpha[ordinary]) if ordinary < len(parameters) else 0.0
    )
    if ordinary:
        tame = Parameters(
            parameters.alpha[:ordinary], parameters.beta[:ordinary], parameters.tau[:ordinary]
        )
        found = _ordinary_peaks(tame)
        log_gain[:ordinary], omega[:ordinary] = found.log_gain, found.omega
    return Peaks(frozen(log_gain), frozen(omega))


def limits(parameters: Parameters) -> FloatArray:
    """(M,): 0 from the first vehicle on that does not react, inf behind an undamped one, else nan.

    Where it is nan, which are the first vehicles, the gains are to be computed.
    """
    silent = np.logical_or.accumulate((parameters.alpha == 0) & (parameters.beta == 0))
    undamped = np.logical_or.accumulate(
        (parameters.alpha > 0) & (parameters.alpha * parameters.tau + parameters.beta == 0)
    )
    return np.where(silent, 0.0, np.where(undamped, np.inf, np.nan))


def _ordinary_peaks(parameters: Parameters) -> Peaks:
    """Peaks of damped vehicles that react."""
    edges = crossovers(parameters)
    if np.isnan(edges).all():
        return Peaks(np.zeros(len(edges)), np.zeros(len(edges)))
    span = np.geomspace(LOWEST * np.nanmin(edges), np.nanmax(edges), GRID)
    own = peaks(parameters).omega
    x = np.unique(np.concatenate([span, own[own > 0]])) ** 2
    best = np.argmin(np.cumsum(_attenuation(parameters, x[:, None]), axis=1), axis=0)
    low = np.concatenate([[0.0], x])[best]
    high = np.concatenate([x, x[-1:]])[best + 1]
    reach = np.tri(len(edges))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        rising = (reach * _slope(parameters, middle[:, None])).sum(axis=1) < 0
        low, high = np.where(rising, middle, low), np.where(rising, high, middle)
    log_gain = -0.5 * (reach * _attenuation(parameters, high[:, None])).sum(axis=1)
    amplified = log_gain > 0
    return Peaks(np.where(amplified, log_gain, 0.0), np.where(amplified, np.sqrt(high), 0.0))


@dataclass(frozen=True, eq=False)
class _Parts:
    """|H_i|² = n / m, 1 + g = m / n, at x (K, 1); all (K, M)."""

    n: FloatArray
    m: FloatArray
    g: FloatArray


def _parts(parameters: Parameters, x: FloatArray) -> _Parts:
    n = parameters.alpha**2 + parameters.beta**2 * x
    m = (parameters.alpha - x) ** 2 + (parameters.alpha * parameters.tau + parameters.beta) ** 2 * x
    return _Parts(n, m, x * (x + l2_criterion(parameters)) / n)


def _attenuation(parameters: Parameters, x: FloatArray) -> FloatArray:
    """(K, M): -log|H_i|² at x (K, 1), kept exact near 0 and near a resonance."""
    at = _parts(parameters, x)
    return np.where(at.g < -0.5, np.log(at.m / at.n), np.log1p(np.maximum(at.g, -0.5)))


def _slope(parameters: Parameters, x: FloatArray) -> FloatArray:
    """(K, M): the derivative of `_attenuation` by x."""
    at = _parts(parameters, x)
    return np.asarray((2.0 * x + l2_criterion(parameters) - parameters.beta**2 * at.g) / at.m)
