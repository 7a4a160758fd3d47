"""How large the sinusoid is along the platoon: measured in a simulation and predicted by H.

Once the transient is over, follower k's speed is a sinusoid of amplitude A |H_1(jω) .. H_k(jω)|.
The measured amplitude is the least-squares fit of a constant, a sine and a cosine over the last
whole periods. The transient itself is known exactly: it is the platoon left to itself, started
from what the sinusoids would need and the equilibrium does not have.
"""

from dataclasses import dataclass
from math import ceil, isinf

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from accpinn.errors import Finding
from accpinn.model.cthp import Parameters, Trajectories, motion_matrix, orbit
from accpinn.platoon.leader import Sinusoid
from accpinn.stability.frequency import response, slowest_rate
from accpinn.units import FloatArray, Seconds, frozen

SETTLED = 1e-3
"""A transient below this share of the sinusoid's amplitude is over."""
PERIODS = 5
"""The last whole periods to measure over; one, if the transient leaves no room for more."""
INSTANTS = 2000
"""Among which the end of the transient is looked for; the horizon doubles until it is early."""
FIRST_HORIZON = 10.0
"""The first horizon, in time constants of the slowest pole."""
HORIZONS = 20

Phasors = NDArray[np.complex128]


class NeverSettles(Finding, frozen=True):
    """A follower's transient never ends, so its amplitude never becomes constant."""

    follower: int


class TooShort(Finding, frozen=True):
    """The run holds no whole period after the transient."""

    period: Seconds
    duration: Seconds
    """That would be enough."""


class TransientLeft(Finding, frozen=True):
    """A transient is above `SETTLED` where the amplitude is measured."""

    follower: int
    duration: Seconds
    """That would be enough."""


MeasurementFinding = NeverSettles | TooShort | TransientLeft


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """Amplitudes of speed along the platoon, leader first."""

    measured: FloatArray
    """(M+1,) in m/s; nan where the run holds no whole period."""
    predicted: FloatArray
    """(M+1,) in m/s: A |H_1 .. H_k|."""
    settled: FloatArray
    """(M+1,) in s after the sinusoid's start, when the transient is over; inf where it never is."""
    periods: int
    """How many of the last whole periods were measured."""
    free: bool
    """Whether all transients were over before that."""
    findings: tuple[MeasurementFinding, ...]
    """Why the measured amplitudes may differ from those predicted: one reason, or none."""


def amplitudes(parameters: Parameters, leader: Sinusoid, run: Trajectories) -> Amplitudes:
    """Measured and predicted amplitudes, with the time until they can agree.

    Args:
        parameters: (M,) of the followers.
        leader: behind which they were simulated.
        run: the simulation.
    """
    single = response(parameters, np.array([leader.frequency]))[:, 0]
    settled = _settled(parameters, leader, single)
    driven = max(run.time[-1] - leader.settle, 0.0)
    free = (driven - np.max(settled)) / leader.period
    periods = min(int(driven / leader.period + 1e-9), int(np.clip(free, 1, PERIODS)))
    measured = _measured(leader, run, periods) if periods else np.full(len(settled), np.nan)
    return Amplitudes(
        frozen(measured),
        frozen(_predicted(leader, single)),
        frozen(settled),
        periods,
        free >= 1,
        _findings(leader, settled, periods),
    )


def _findings(
    leader: Sinusoid, settled: FloatArray, periods: int
) -> tuple[MeasurementFinding, ...]:
    last = int(np.argmax(settled))
    needed = leader.settle + float(settled[last]) + leader.period
    if isinf(needed):
        return (NeverSettles(last),)
    if not periods:
        return (TooShort(leader.period, ceil(needed)),)
    return (TransientLeft(last, ceil(needed)),) if needed > leader.duration + 1e-9 else ()


def _predicted(leader: Sinusoid, single: Phasors) -> FloatArray:
    """(M+1,) A |H_1 .. H_k|; also where an infinite response meets one of zero."""
    with np.errstate(invalid="ignore"):
        along = leader.amplitude * np.cumprod(np.concatenate([[1.0], np.abs(single)]))
    return np.where(np.isnan(along), 0.0, along)


def _measured(leader: Sinusoid, run: Trajectories, periods: int) -> FloatArray:
    """(M+1,) from the last whole periods."""
    last = run.time > run.time[-1] - periods * leader.period - 1e-9
    angle = leader.frequency * run.time[last]
    design = np.stack([np.ones_like(angle), np.sin(angle), np.cos(angle)], axis=1)
    moved = run.speeds[last] - leader.speed
    fitted = np.linalg.solve(design.T @ design, design.T @ moved)  # all but orthogonal columns
    return np.asarray(np.hypot(fitted[1], fitted[2]))


def _settled(parameters: Parameters, leader: Sinusoid, single: Phasors) -> FloatArray:
    """(M+1,) seconds until each speed's transient is, and stays, below `SETTLED`."""
    rates = [slowest_rate(vehicle) for vehicle in parameters]
    endless = [k for k, rate in enumerate(rates) if not rate and parameters[k].alpha > 0]
    count = min(endless, default=len(parameters))
    settled = np.full(len(parameters) + 1, np.inf)
    settled[: count + 1] = 0.0
    rates = [rate for rate in rates[:count] if rate]
    if not rates:
        return settled
    system = motion_matrix(parameters[:count])[:, :-1]
    own = np.cumprod(single[:count])
    ahead = np.concatenate([[1.0], own[:-1]])
    start = -np.stack([(ahead - own) / (1j * leader.frequency), own], axis=1).imag.ravel()
    horizon: Seconds = FIRST_HORIZON / min(rates)
    for _ in range(HORIZONS):
        step = horizon / INSTANTS
        speeds = orbit(expm(system * step), start, INSTANTS)[:, 1::2]
        above = np.abs(speeds) > SETTLED * np.abs(own)
        until = np.where(above.any(axis=0), INSTANTS - np.argmax(above[::-1], axis=0), 0)
        if until.max() <= INSTANTS / 2:
            break
        horizon *= 2.0
    settled[1 : count + 1] = until * step
    return settled
