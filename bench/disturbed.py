"""Recordings with known parameters and disturbances as large and as lasting as on real roads.

    dv/dt = α(p - τv) + βΔv + w,    w a first-order Gauss-Markov process

On the real recordings that this package was made for, the residual of the model after smoothing
has a standard deviation of 0.15 to 0.39 m/s² in car-following with ACC, and its correlation falls
to 1/e within three to six seconds. Effects that the model lacks can be added: an actuator lag, a
delay, a standstill distance (p - s₀ in place of p), a slope, limits of the acceleration that the
controller commands, and gains q times as large on a gap that is too short, k times on a car ahead
that is slower (see `accpinn.model.unequal_gains`). Leaders and the receivers' noise come from
`accpinn.recordings.synthetic`.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from accpinn.model.cthp import Parameters, Trajectories, add_command
from accpinn.recordings import synthetic
from accpinn.recordings.synthetic import SIMULATION_STEP, LeaderProfile, Noise
from accpinn.segment import Segment
from accpinn.units import FloatArray, Metres, Seconds
from tests.support.driving import segment_of

MOTORWAY = LeaderProfile(28.0, 20.0, 34.0, (8.0, 25.0), (0.4, 1.2), 0.15)


@dataclass(frozen=True)
class Disturbance:
    """The departure of vehicles from the model."""

    deviation: float = 0.25
    """Standard deviation of w in m/s²."""
    memory: Seconds = 4.0
    """Time in which the correlation of w falls to 1/e."""
    lag: Seconds = 0.0
    """Time constant of the actuator; 0 for none."""
    delay: Seconds = 0.0
    """Time between the command and what the actuator is given, in whole simulation steps."""
    standstill: Metres = 0.0
    """s₀: the gap in equilibrium is s₀ + τv."""
    slope: float = 0.0
    """Mean of w in m/s²; uphill is negative, 1 % are 0.1 m/s²."""
    limits: tuple[float, float] = (-np.inf, np.inf)
    """Least and largest command of the controller, in m/s²."""
    q: float = 1.0
    """Gain on a gap that is too short, by α."""
    k: float = 1.0
    """Gain on a car ahead that is slower, by β."""


def disturbed(
    parameters: Iterable[Parameters],
    seed: int,
    disturbance: Disturbance,
    driving: LeaderProfile | FloatArray = MOTORWAY,
    duration: Seconds = 300.0,
    noise: Noise | None = Noise(),  # noqa: B008 (a frozen value object)
) -> Segment:
    """Return a synthetic recording of a platoon as a segment.

    Args:
        parameters: one entry a follower, as `Parameters` of M vehicles are.
        seed: seed of the leader, the disturbances and the noise.
        disturbance: how all followers depart from the model.
        driving: how the leader drives, or its speed (N,) at every `SIMULATION_STEP`.
        duration: length in s.
        noise: errors of the receivers; None for none.
    """
    time = SIMULATION_STEP * np.arange(round(duration / SIMULATION_STEP) + 1)
    ahead = driving if isinstance(driving, np.ndarray) else (
        synthetic.leader_speed(driving, time, np.random.default_rng(seed))
    )  # fmt: skip
    rng = np.random.default_rng([seed, 2])
    speeds, gaps = [ahead], []
    for follower in parameters:
        wander = disturbance.deviation * synthetic.gauss_markov(
            time.shape, SIMULATION_STEP, disturbance.memory, rng
        )
        gap, ahead = _follow(follower, ahead, wander, disturbance)
        speeds.append(ahead)
        gaps.append(gap)
    true = Trajectories(time, np.column_stack(speeds), np.column_stack(gaps))
    recorded = synthetic.record(true, noise, seed)
    return segment_of(recorded.time, recorded.speeds, recorded.gaps)


def _follow(
    follower: Parameters, ahead: FloatArray, wander: FloatArray, disturbance: Disturbance
) -> tuple[FloatArray, FloatArray]:
    """Return gap and speed (N,) from equilibrium on, with inputs held over each small step.

    The linear system is stepped exactly. What limits, a delay and unequal gains change of the
    command is an input.
    """
    alpha, alpha_tau, beta = follower.theta
    short, closing = (disturbance.q - 1.0) * alpha, (disturbance.k - 1.0) * beta
    # States: gap above s₀, speed, acceleration by the actuator. Inputs: speed ahead, what limits
    # and the delay add to the command, and w.
    rates = np.zeros((6, 6))
    rates[0, [1, 3]] = -1.0, 1.0
    command = np.array([alpha, -alpha_tau - beta, 0.0, beta, 0.0, 0.0])
    add_command(rates, command + np.eye(6)[4], 1, 2, disturbance.lag, 0.0)
    rates[1, 5] = 1.0
    step = expm(rates * SIMULATION_STEP)[:3]
    middle = np.r_[(ahead[1:] + ahead[:-1]) / 2, ahead[-1]]
    least, most = disturbance.limits
    states = np.empty((len(ahead), 3))
    late = round(disturbance.delay / SIMULATION_STEP)
    limited = np.zeros(late + len(ahead))
    now = np.array([follower.tau * ahead[0], ahead[0], 0.0, 0.0, 0.0, 0.0])
    for k, speed_ahead in enumerate(middle):
        states[k] = now[:3]
        now[3] = speed_ahead
        linear, too_long = command @ now, now[0] - follower.tau * now[1]
        unlimited = linear + short * min(too_long, 0.0) + closing * min(speed_ahead - now[1], 0.0)
        limited[late + k] = min(max(unlimited, least), most)
        now[4] = limited[k] - linear
        now[5] = disturbance.slope + wander[k]
        now[:3] = step @ now
    return states[:, 0] + disturbance.standstill, states[:, 1]
