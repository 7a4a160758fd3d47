"""Platoons driven for a test: the law integrated by another hand than the package's own."""

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

from accpinn.segment.segment import Segment
from accpinn.units import FloatArray

LAW = (0.08, 0.12, 1.5)
"""α [1/s²], β [1/s], τ [s] of the paper's synthetic study."""
MIXED = (LAW, (0.11, 0.30, 1.2), (0.05, 0.25, 1.0))


def leader_speed(time: FloatArray) -> FloatArray:
    """Sums of sines: rich enough to identify the law within a minute."""
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
    time = step * np.arange(round(duration / step) + 1)
    followers = len(laws)

    def rates(now: float, state: FloatArray) -> FloatArray:
        gaps, speeds = state[:followers], state[followers:]
        relative = np.r_[leader_speed(now), speeds[:-1]] - speeds
        alpha, beta, tau = np.array(laws).T
        return np.r_[relative, alpha * (gaps - tau * speeds) + beta * relative]

    start = np.r_[[abs(tau) * 22 - 5 for *_, tau in laws], [22.0] * followers]
    solved = solve_ivp(
        rates, (0, time[-1]), start, "DOP853", time, rtol=1e-10, atol=1e-10, max_step=1.0
    )
    speeds = np.column_stack([leader_speed(time), solved.y[followers:].T])
    gaps = solved.y[:followers].T
    rng = np.random.default_rng(0)
    return segment_of(
        time,
        speeds + noise * rng.standard_normal(speeds.shape),
        gaps + noise * rng.standard_normal(gaps.shape),
    )


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
