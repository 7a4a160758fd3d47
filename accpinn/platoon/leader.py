"""The motion of the lead vehicle: a sinusoid, a step, a brake manoeuvre, or a recorded speed.

The first three consist of phases, in each of which the leader's speed is

    v_0(t) = speed + level + slope (t - start) + amplitude sin(frequency (t - start))

so that the whole platoon is a linear system left to itself, and is integrated exactly.
"""

from dataclasses import dataclass
from math import isfinite
from numbers import Real

import numpy as np

from accpinn.errors import ParameterError, shown
from accpinn.units import FloatArray, MetresPerSecond, RadiansPerSecond, Seconds, frozen

POSITIVE = ("frequency", "deceleration", "acceleration", "duration")
"""Settings that are above zero."""
UNEVEN = 1e-3
"""Steps of a recorded leader that differ by more than this share of them are uneven."""
ANY_SIGN = ("change",)
"""Settings that may be negative; all others are zero or more."""


@dataclass(frozen=True)
class Phase:
    """One phase of the leader's drive, until the next one starts."""

    start: Seconds
    level: MetresPerSecond = 0.0
    """Deviation from the speed of the equilibrium when the phase starts."""
    slope: float = 0.0
    """Acceleration in m/s²."""
    amplitude: MetresPerSecond = 0.0
    frequency: RadiansPerSecond = 0.0


class _Settings:
    """The base of all planned leaders, which checks their settings."""

    def __post_init__(self) -> None:
        """Refuse numbers that no leader can drive."""
        for name, value in vars(self).items():
            if isinstance(value, bool) or not isinstance(value, Real) or not isfinite(value):
                raise ParameterError(
                    f"Leader: {name} = {shown(value)} is no number; give a finite one."
                )
            if name in POSITIVE and value <= 0:
                raise ParameterError(f"Leader: {name} = {value:g}, but it must be above zero.")
            if name not in ANY_SIGN and value < 0:
                raise ParameterError(f"Leader: {name} = {value:g}, but it must be zero or more.")


@dataclass(frozen=True)
class Sinusoid(_Settings):
    """The paper's leader: steady, then a sinusoid about the same speed."""

    frequency: RadiansPerSecond = 0.25
    amplitude: MetresPerSecond = 1.0
    speed: MetresPerSecond = 20.0
    settle: Seconds = 20.0
    """Time of steady driving at first."""
    duration: Seconds = 500.0

    @property
    def period(self) -> Seconds:
        """The period of the sinusoid."""
        return float(2.0 * np.pi / self.frequency)

    def phases(self) -> tuple[Phase, ...]:
        """The phases of the drive."""
        wave = Phase(self.settle, amplitude=self.amplitude, frequency=self.frequency)
        return Phase(0.0), wave


@dataclass(frozen=True)
class SpeedStep(_Settings):
    """Steady, then at once another speed."""

    change: MetresPerSecond = -2.0
    speed: MetresPerSecond = 20.0
    settle: Seconds = 20.0
    duration: Seconds = 300.0

    def phases(self) -> tuple[Phase, ...]:
        """The phases of the drive."""
        return Phase(0.0), Phase(self.settle, level=self.change)


@dataclass(frozen=True)
class Brake(_Settings):
    """Steady, then down to a lower speed, held for a while, and back."""

    drop: MetresPerSecond = 5.0
    deceleration: float = 1.0
    """Deceleration in m/s², positive."""
    hold: Seconds = 20.0
    acceleration: float = 0.5
    """Acceleration of the recovery in m/s², positive."""
    speed: MetresPerSecond = 20.0
    settle: Seconds = 20.0
    duration: Seconds = 300.0

    def phases(self) -> tuple[Phase, ...]:
        """The phases of the drive."""
        low = self.settle + self.drop / self.deceleration
        up = low + self.hold
        back = up + self.drop / self.acceleration
        return (
            Phase(0.0),
            Phase(self.settle, slope=-self.deceleration),
            Phase(low, level=-self.drop),
            Phase(up, level=-self.drop, slope=self.acceleration),
            Phase(back),
        )


@dataclass(frozen=True, eq=False)
class Recorded:
    """A measured leader, straight between its samples; the platoon starts in equilibrium.

    Uneven instants are resampled to their most typical step, along straight lines between them.

    Raises:
        ParameterError: for arrays of other shapes, or with values that are missing; for instants
            that do not rise.

    Examples:
        >>> import accpinn, numpy as np
        >>> time = np.arange(0, 60, 0.1)
        >>> leader = accpinn.Recorded(time, 20 - 2 * np.sin(0.3 * time))
        >>> run = accpinn.simulate_platoon(accpinn.Parameters(0.08, 0.3, 1.2), leader, followers=8)
        >>> run.trajectories.speeds.shape
        (600, 9)
    """

    time: FloatArray
    """(N,) in s, evenly spaced; the run keeps its clock."""
    speeds: FloatArray
    """(N,) in m/s."""

    def __post_init__(self) -> None:
        """Check, copy and lock the arrays."""
        time, speeds = (self._numbers(name) for name in ("time", "speeds"))
        if len(time) != len(speeds):
            raise ParameterError(
                f"Leader: {len(time)} instants and {len(speeds)} speeds; give one speed an instant."
            )
        steps = np.diff(time)
        if (steps <= 0).any():
            at = int(np.argmax(steps <= 0))
            raise ParameterError(
                f"Leader: time {time[at + 1]:g} s follows {time[at]:g} s; give instants that rise."
            )
        step = float(np.median(steps))
        if np.ptp(steps) > UNEVEN * step:
            even = np.linspace(time[0], time[-1], round((time[-1] - time[0]) / step) + 1)
            time, speeds = even, np.interp(even, time, speeds)
        object.__setattr__(self, "time", frozen(time))
        object.__setattr__(self, "speeds", frozen(speeds))

    def _numbers(self, name: str) -> FloatArray:
        try:
            values = np.asarray(getattr(self, name), float)
        except (TypeError, ValueError):
            values = np.empty(0)
        if values.ndim != 1 or len(values) < 2:
            raise ParameterError(
                f"Leader: {name} is no list of numbers; give two or more along one axis."
            )
        if not np.isfinite(values).all():
            at = int(np.argmax(~np.isfinite(values)))
            raise ParameterError(
                f"Leader: {name}[{at}] is {values[at]:g}; leave instants without a value out."
            )
        return values

    @property
    def speed(self) -> MetresPerSecond:
        """Speed at the first instant, which is that of the equilibrium."""
        return float(self.speeds[0])

    @property
    def duration(self) -> Seconds:
        """Time from the first to the last instant."""
        return float(self.time[-1] - self.time[0])


Planned = Sinusoid | SpeedStep | Brake
Leader = Planned | Recorded
