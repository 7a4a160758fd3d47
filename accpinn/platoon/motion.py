"""The exact motion of a platoon behind a planned leader, without a step-size error.

The deviations x from the equilibrium (v = speed, p = τ·speed) and the leader's own state
e = (level, slope, a sin ωt, a cos ωt) obey one linear equation on each piece of its drive,

    d/dt (x, e) = G (x, e),   so   (x, e)(t + h) = exp(Gh) (x, e)(t)

whatever h is. An equilibrium stays one to the last bit, as its deviations are zero.
"""

from itertools import pairwise

import numpy as np
from scipy.linalg import expm

from accpinn.model.cthp import Parameters, motion_matrix, orbit
from accpinn.platoon.leader import Phase
from accpinn.units import FloatArray

SLACK = 1e-9
"""Seconds within which an instant belongs to the piece that starts there."""


def deviations(parameters: Parameters, phases: tuple[Phase, ...], time: FloatArray) -> FloatArray:
    """How far the platoon is from its equilibrium.

    Args:
        parameters: M of them.
        phases: of the leader; the first starts at the first instant, in equilibrium.
        time: (N,) in s, evenly spaced.

    Returns:
        (N, 2M+1): p_1, v_1, .., p_M, v_M and the leader's speed.
    """
    size = 2 * len(parameters)
    step = (time[-1] - time[0]) / (len(time) - 1)
    result = np.zeros((len(time), size + 1))
    followers = np.zeros(size)
    starts = [phase.start for phase in phases] + [np.inf]
    edges = np.searchsorted(time, np.array(starts) - SLACK)
    for phase, (start, end), (first, last) in zip(
        phases, pairwise(starts), pairwise(edges), strict=True
    ):
        generator = _generator(parameters, phase.frequency)
        state = np.concatenate([followers, [phase.level, phase.slope, 0.0, phase.amplitude]])
        if last > first:
            offset = max(time[first] - start, 0.0)
            begin = expm(generator * offset) @ state if offset else state
            states = orbit(expm(generator * step), begin, int(last - first))
            result[first:last, :size] = states[:, :size]
            result[first:last, size] = states[:, size] + states[:, size + 2]
        if np.isfinite(end):
            followers = (expm(generator * (end - start)) @ state)[:size]
    return result


def _generator(parameters: Parameters, frequency: float) -> FloatArray:
    """(2M+4, 2M+4): G."""
    size = 2 * len(parameters)
    level, slope, sine, cosine = range(size, size + 4)
    matrix = motion_matrix(parameters)
    generator = np.zeros((size + 4, size + 4))
    generator[:size, :size] = matrix[:, :size]
    generator[:size, level] = generator[:size, sine] = matrix[:, size]
    generator[level, slope] = 1.0
    generator[sine, cosine], generator[cosine, sine] = frequency, -frequency
    return generator
