"""Pairs of simulated cars whose gap and speeds agree, as sensors of several kinds record them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from accpinn.recordings.increments import Pair
from accpinn.recordings.synthetic import (
    REPORT_TIME,
    SIMULATION_STEP,
    LeaderProfile,
    Noise,
    gauss_markov,
    leader_speed,
)
from accpinn.units import FloatArray

DRIVES = {
    "steady": LeaderProfile(27.0, 25.0, 31.0, (60.0, 200.0), (0.2, 0.6), 0.2),
    "motorway": LeaderProfile(30.0, 22.0, 34.0, (10.0, 40.0), (0.4, 1.2), 0.4),
    "urban": LeaderProfile(8.0, -2.0, 14.0, (3.0, 25.0), (0.8, 2.2), 0.2),
}
"""Drives of a leader; the urban one stands where its profile is below zero."""
RATES = (10.0, 2.0, 25.0)
"""Samples a second."""
SENSORS = ("receivers", "radar", "rounded")


@dataclass(frozen=True)
class Drive:
    """The true motion of a pair, every `SIMULATION_STEP`."""

    time: FloatArray
    ahead: FloatArray
    behind: FloatArray
    gap: FloatArray


def drives(kinds: Sequence[str], duration: float, rng: np.random.Generator) -> list[Drive]:
    """A pair for each kind of drive: the CTHP with s₀ behind a leader, on a road with grades."""
    time = np.linspace(0, duration, round(duration / SIMULATION_STEP) + 1)
    count = len(kinds)
    ahead = np.array([np.maximum(leader_speed(DRIVES[k], time, rng), 0.0) for k in kinds]).T
    alpha, beta = rng.uniform(0.04, 0.15, count), rng.uniform(0.1, 0.5, count)
    tau, distance = rng.uniform(0.8, 2.0, count), rng.uniform(3.0, 7.0, count)
    grade = 0.08 * gauss_markov(ahead.shape, SIMULATION_STEP, 15.0, rng)
    behind, gap = np.empty_like(ahead), np.empty_like(ahead)
    speed, space = ahead[0].copy(), distance + tau * ahead[0]
    for k in range(len(time)):
        behind[k], gap[k] = speed, space
        rate = alpha * (space - distance - tau * speed) + beta * (ahead[k] - speed) + grade[k]
        after = np.maximum(speed + SIMULATION_STEP * rate, 0.0)
        following = ahead[min(k + 1, len(time) - 1)]
        space = space + SIMULATION_STEP * (ahead[k] + following - speed - after) / 2
        speed = after
    return [Drive(time, *parts) for parts in zip(ahead.T, behind.T, gap.T, strict=True)]


def recorded(
    drive: Drive,
    rate: float,
    sensor: str,
    rng: np.random.Generator,
    late: Sequence[float] = (0, 0, 0),
) -> Pair:
    """A drive as sensors of a kind record it; the clocks of speeds and gap may be late."""
    time = np.arange(5.0, drive.time[-1] - 5.0, 1 / rate)
    channels = [drive.ahead, drive.behind, drive.gap]
    if sensor == "receivers":
        reports = np.arange(0.0, drive.time[-1], REPORT_TIME)
        noise, shape = Noise(), (len(reports), 2)
        error = noise.position * rng.standard_normal(shape)
        error += 2 * noise.drift * gauss_markov(shape, REPORT_TIME, noise.drift_time, rng)
        errors = [noise.speed * rng.standard_normal(len(reports)) for _ in range(2)]
        errors.append(error[:, 0] - error[:, 1])
        series = [
            CubicSpline(reports, np.interp(reports, drive.time, values) + added)(time - lag)
            for values, added, lag in zip(channels, errors, late, strict=True)
        ]
    else:
        ratio = np.exp(-SIMULATION_STEP / rng.uniform(0.02, 0.2))
        start = [channels[2][0] * ratio]
        channels[2] = lfilter([1 - ratio], [1, -ratio], channels[2], zi=start)[0]
        series = [
            np.interp(time - lag, drive.time, values)
            for values, lag in zip(channels, late, strict=True)
        ]
        for values, deviation in zip(series, (0.03, 0.03, 0.08), strict=True):
            values += deviation * rng.standard_normal(len(time))
        if sensor == "rounded":
            series = [np.round(3.6 * values, 1) / 3.6 for values in series[:2]] + [
                np.round(series[2], 1)
            ]
    return Pair(1, time - time[0], *series)
