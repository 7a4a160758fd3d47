"""Platoons driven for a test: the model integrated by another hand than the package's own."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

from accpinn.segment import Segment
from accpinn.units import FloatArray

LAW = (0.08, 0.12, 1.5)
"""α [1/s²], β [1/s], τ [s] of the paper's synthetic study."""
MIXED = (LAW, (0.11, 0.30, 1.2), (0.05, 0.25, 1.0))


def leader_speed(time: FloatArray) -> FloatArray:
    """Sums of sines: rich enough to identify the model within a minute."""
    slow = 2.5 * np.sin(0.21 * time) + 1.5 * np.sin(0.083 * time + 1.0)
    return 22 + slow + 0.8 * np.sin(0.4 * time)


@cache
def driven(
    laws: tuple[tuple[float, float, float], ...] = (LAW,),
    duration: float = 60.0,
    step: float = 0.1,
    noise: float = 0.0,
) -> Segment:
    """Followers of `leader_speed` that start at 22 m/s, 5 m closer than in equilibrium.

    Args:
        laws: α, β, τ of each follower; negative ones are integrated like any others.
        duration: in s.
        step: between instants, in s.
        noise: standard deviation of white errors, in m and m/s.
    """
    exact, rng = in_turn((laws, duration), step=step), np.random.default_rng(0)
    return segment_of(
        exact.time,
        exact.speeds + noise * rng.standard_normal(exact.speeds.shape),
        exact.gaps + noise * rng.standard_normal(exact.gaps.shape),
    )


def in_turn(*pieces: tuple[Sequence[Sequence[float]], float], step: float = 0.1) -> Segment:
    """Without errors: they obey some laws for so many seconds, then others, and so on."""
    laws, _ = pieces[0]
    state = np.r_[[abs(tau) * 22 - 5 for *_, tau in laws], [22.0] * len(laws)]
    states, now = [state], 0.0
    for laws, seconds in pieces:
        time = now + step * np.arange(round(seconds / step) + 1)
        solved = solve_ivp(
            motion(laws, leader_speed), time[[0, -1]], state, "DOP853", time,
            rtol=1e-10, atol=1e-10, max_step=1.0,
        )  # fmt: skip
        states += [*solved.y.T[1:]]
        state, now = states[-1], time[-1]
    time, (gaps, speeds) = step * np.arange(len(states)), np.hsplit(np.array(states), 2)
    return segment_of(time, np.column_stack([leader_speed(time), speeds]), gaps)


def motion(
    laws: Sequence[Sequence[float]], ahead: Callable[[float], float]
) -> Callable[[float, FloatArray], FloatArray]:
    """d/dt of p_1, p_2, .., v_1, v_2, ..: the model as written, behind a leader with that speed."""
    alpha, beta, tau = np.array(laws).T

    def rates(now: float, state: FloatArray) -> FloatArray:
        gaps, speeds = np.split(state, 2)
        relative = np.r_[ahead(now), speeds[:-1]] - speeds
        return np.r_[relative, alpha * (gaps - tau * speeds) + beta * relative]

    return rates


def segment_of(time: FloatArray, speeds: FloatArray, gaps: FloatArray) -> Segment:
    """A segment with plain names and no file behind it."""
    numbers = tuple(range(1, speeds.shape[1] + 1))
    return Segment(
        time=time,
        speeds=speeds,
        gaps=gaps,
        vehicles=numbers,
        names=tuple(f"Car {number}" for number in numbers),
        start=0.0,
        source="made for a test",
        sha256="",
    )


def standing_still(speed: float = 20.0, gap: float = 30.0, samples: int = 301) -> Segment:
    """Constant speeds and a constant gap: nothing to learn from."""
    time = 0.1 * np.arange(samples)
    return segment_of(time, np.full((samples, 2), speed), np.full((samples, 1), gap))
