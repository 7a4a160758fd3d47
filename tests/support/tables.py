"""Tables of a simulated pair or platoon whose truth is known, written as other programs write."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import pandas as pd

from accpinn.recordings import Recording
from accpinn.units import FloatArray

STEP = 0.1
ALPHA, BETA, TAU, STANDSTILL = 0.08, 0.3, 0.8, 6.0
"""The model of all followers: gains in 1/s² and 1/s, time headway in s, standstill gap in m."""


@dataclass(frozen=True, eq=False)
class Truth:
    """V vehicles over N instants, noise of the sensors included."""

    time: FloatArray
    """(N,) in s from 0."""
    speeds: FloatArray
    """(N, V) in m/s, leader first."""
    gaps: FloatArray
    """(N, V-1) in m."""

    @property
    def lead(self) -> FloatArray:
        """(N,) the speed of the first vehicle."""
        return self.speeds[:, 0]

    @property
    def ego(self) -> FloatArray:
        """(N,) the speed of the second vehicle."""
        return self.speeds[:, 1]

    @property
    def gap(self) -> FloatArray:
        """(N,) the gap of the second vehicle."""
        return self.gaps[:, 0]

    def positions(self, length: float) -> FloatArray:
        """(N, V) positions in m of fronts of vehicles of a length, by the gaps."""
        first = 500 + np.concatenate(
            [[0.0], np.cumsum((self.lead[1:] + self.lead[:-1]) / 2 * np.diff(self.time))]
        )
        behind = first[:, None] - np.cumsum(self.gaps + length, axis=1)
        return np.column_stack([first, behind])

    def every(self, step: int) -> "Truth":
        """Each ``step``-th instant."""
        return Truth(self.time[::step], self.speeds[::step], self.gaps[::step])


@cache
def drive(
    seed: int = 0,
    seconds: float = 90.0,
    mean: float = 24.0,
    swing: float = 2.5,
    vehicles: int = 2,
    step: float = STEP,
    noise: float = 0.02,
) -> Truth:
    """A platoon behind a leader whose speed is a sum of waves, on a road with small grades.

    Args:
        seed: of waves, grades and noise.
        seconds: the duration.
        mean: the leader's mean speed in m/s.
        swing: the amplitude of its slowest wave in m/s; the grades are in proportion.
        vehicles: how many.
        step: between instants in s.
        noise: standard deviation in m/s of speeds, half of that in m of gaps.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds / step) + 1) * step
    waves = [(1.0, 0.08), (0.6, 0.25), (0.35, 0.6)]
    lead = mean + swing * sum(
        size * np.sin(omega * rng.uniform(0.8, 1.25) * time + rng.uniform(0, 6.28))
        for size, omega in waves
    )
    speeds, gaps = [np.maximum(lead, 0.0)], []
    for _ in range(vehicles - 1):
        ahead = speeds[-1]
        speed, gap = np.empty_like(time), np.empty_like(time)
        grade = 0.06 * swing * np.sin(0.15 * time + rng.uniform(0, 6.28))
        v, p = ahead[0], STANDSTILL + TAU * ahead[0] + swing * rng.uniform(-1, 1)
        for k in range(len(time)):
            speed[k], gap[k] = v, p
            rate = ALPHA * (p - STANDSTILL - TAU * v) + BETA * (ahead[k] - v) + grade[k]
            after = max(v + step * rate, 0.0)
            p += step * (ahead[k] + ahead[min(k + 1, len(time) - 1)] - v - after) / 2
            v = after
        speeds.append(speed)
        gaps.append(gap)
    both = np.column_stack(speeds), np.column_stack(gaps)
    measured = both[0] + noise * rng.standard_normal(both[0].shape)
    return Truth(
        np.round(time, 6),
        np.round(np.maximum(measured, 0.0), 4),
        np.round(both[1] + noise / 2 * rng.standard_normal(both[1].shape), 4),
    )


STEADY = {"swing": 0.06, "mean": 12.3}
"""Arguments of a drive at nearly constant speed."""


def frame(truth: Truth, names: Sequence[str] = ("t", "v1", "v2", "gap")) -> pd.DataFrame:
    """A plain table of a pair: time, speed ahead, speed behind and gap."""
    columns = (truth.time, truth.lead, truth.ego, truth.gap)
    return pd.DataFrame(dict(zip(names, columns, strict=True)))


def text(table: pd.DataFrame, **how: object) -> bytes:
    """The bytes of a table as pandas writes it."""
    return table.to_csv(index=False, **how).encode()


def misread(recording: Recording, truth: Truth, tolerance: float = 0.06) -> str:
    """What of a recording is not as in truth; empty where all is.

    Times count from their first instants, and instants that are missing in either are passed over.
    """
    if recording.speed.shape[1] != truth.speeds.shape[1]:
        return f"{recording.speed.shape[1]} vehicles"
    if abs(recording.duration - truth.time[-1]) > 1.0:
        return f"{recording.duration} s instead of {truth.time[-1]} s"
    channels = np.column_stack([recording.speed, recording.gap])
    best = ""
    for offset in (0.0, *np.arange(1, 6) * float(np.diff(truth.time[:2])[0])):
        instants = recording.time + offset  # rows at the beginning may have been left out
        inside = instants <= truth.time[-1] + 1e-6
        expected = np.column_stack(
            [np.interp(instants, truth.time, v) for v in (*truth.speeds.T, *truth.gaps.T)]
        )
        errors = np.abs(channels - expected)[inside]
        typical = np.nanmedian(errors, axis=0)
        if (typical < tolerance).all() and (np.nanmax(errors, axis=0) < 10 * tolerance).all():
            return ""
        best = best or f"errors of {np.round(typical, 3).tolist()}, at most {np.nanmax(errors):.2f}"
    return best
