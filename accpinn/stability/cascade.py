"""The exact L∞ gain from a platoon's leader to each follower: ‖h_1 * .. * h_k‖₁, numerically.

It is the total variation of the platoon's step response, and has no closed form for k > 1. The
variation is summed over exact states of the linear system, in stages with longer and longer
steps, and each turning point is located by the cubic through its neighbours. The error is
estimated by leaving out every second state.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import expm
from scipy.special import gammainccinv

from accpinn.model.cthp import Parameters, in_blocks, motion_matrix, orbit
from accpinn.stability.criteria import checked
from accpinn.stability.frequency import poles, slowest_rate
from accpinn.stability.head_to_tail import limits
from accpinn.stability.impulse import step_metrics
from accpinn.units import FloatArray, Seconds, frozen

SAMPLES = 4096
"""States in each stage of the step response."""
STRETCH = 4
"""How much later each stage ends than the one before."""
MOST_STAGES = 13
"""More would be needed where time scales differ by ten million and beyond."""
FINE = 0.05
"""The first stage's step, in units of the fastest pole's time constant, at most."""
COARSE = 0.5
"""The same for all poles that are still felt in a stage; a period has 2π / COARSE steps."""
NEGLIGIBLE = 1e-40
"""Product of two slopes whose turning point adds nothing to a double."""
FADED = 1e-10
"""What a cascade of equal poles has left when it is no longer felt."""


@dataclass(frozen=True, eq=False)
class Gains:
    """L∞ gains from the leader to each of the M followers."""

    gain: FloatArray
    """(M,): ‖h_1 * .. * h_k‖₁; nan where the vehicles' time scales differ too much."""
    error: FloatArray
    """(M,): estimated error; how much the sum changes when every second state is left out."""


def head_to_tail_gains(parameters: Parameters) -> Gains:
    """The exact L∞ gain from the leader to each follower."""
    parameters = checked(parameters)
    gain = limits(checked(parameters))
    error = np.zeros(len(parameters))
    ordinary = int(np.isnan(gain).sum())
    if ordinary > 1:
        fine, coarse = _step_variation(parameters[:ordinary])
        gain[:ordinary] = np.maximum(fine, 1.0)
        error[:ordinary] = np.abs(fine - coarse) + FADED
    if ordinary:
        gain[0], error[0] = step_metrics(checked(parameters[:1])).gain[0], 0.0  # in closed form
    return Gains(frozen(gain), frozen(error))


def _step_variation(parameters: Parameters) -> tuple[FloatArray, FloatArray]:
    """(M,) total variation of each speed after a unit step of the leader's, finely and coarsely."""
    count = len(parameters)
    stages = _stages(parameters)
    if not stages:
        return np.full(count, np.nan), np.full(count, np.nan)
    system = motion_matrix(parameters)[:, :-1]
    state = np.ones(2 * count)  # the distance to the new equilibrium, negative
    state[0::2] = [law.tau for law in parameters]
    fine, coarse = np.zeros(count), np.zeros(count)
    for stage in stages:
        states = orbit(expm(system * stage.step), state, SAMPLES + 1)
        speeds, rates = states[:, 1::2], in_blocks(states, system[1::2].T)
        fine += _variation(speeds, rates * stage.step)
        coarse += _variation(speeds[::2], rates[::2] * (2.0 * stage.step))
        state = states[-1]
    return fine, coarse


@dataclass(frozen=True)
class _Stage:
    begin: Seconds
    step: Seconds


def _stages(parameters: Parameters) -> list[_Stage]:
    """From the fastest pole's time scale to the slowest's; none where they are too far apart."""
    felt = float(gammainccinv(len(parameters), FADED))
    ends = [felt / min(slowest_rate(law) for law in parameters)]
    fastest = max(abs(poles(law)[1]) for law in parameters)
    while ends[0] * fastest > FINE * SAMPLES:
        ends.insert(0, ends[0] / STRETCH)
        if len(ends) > MOST_STAGES:
            return []
    stages = [_Stage(begin, (end - begin) / SAMPLES) for begin, end in pairwise([0.0, *ends])]
    both = [pole for law in parameters for pole in poles(law)]
    resolved = all(
        abs(pole) * stage.step < COARSE or -pole.real * stage.begin > felt
        for stage in stages
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
