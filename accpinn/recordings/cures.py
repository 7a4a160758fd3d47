"""Cures of inconsistent channels: what to change in how a file is read.

A space-gap that changes b times as fast as the speeds demand is in other units than they are:

    b = (unit of speed · unit of time) / (unit of gap), each in SI units

An `Inconsistency` has the cures that would remove it, and a mapping takes them over.
"""

from itertools import product
from typing import Literal

import msgspec
import numpy as np

from accpinn.units import GAP_UNITS as LENGTHS
from accpinn.units import SPEED_UNITS, Seconds

SURE = 3.0
"""Standard errors by which a cause must be determined."""
SLOPE_TOLERANCE = 0.04
"""Relative difference of a slope from that of a unit which explains it."""
GAP_UNITS = {unit: LENGTHS[unit] for unit in ("m", "ft", "cm")}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
"""Units of each quantity that a table may be in, in the package's own."""


class Exchange(msgspec.Struct, frozen=True, tag=True):
    """Exchange the columns of the speeds of a vehicle and the next one."""

    vehicle: int
    """The vehicle ahead."""


class Reverse(msgspec.Struct, frozen=True, tag=True):
    """Reverse the sign of the space-gap behind a vehicle."""

    vehicle: int


class Shift(msgspec.Struct, frozen=True, tag=True):
    """Add some seconds to the times of one channel."""

    channel: Literal["Speed", "IVS"]
    """Stem of its column's name."""
    vehicle: int
    """The vehicle with the speed, or ahead of the space-gap."""
    seconds: Seconds


class ReadAs(msgspec.Struct, frozen=True, tag=True):
    """Read columns in other units."""

    speed: str = "m/s"
    gap: str = "m"
    time: str = "s"

    @property
    def slope(self) -> float:
        """Slope b of gaps against speeds in these units, where both are taken as SI."""
        return SPEED_UNITS[self.speed] * TIME_UNITS[self.time] / GAP_UNITS[self.gap]

    def changes(self, taken: "ReadAs") -> tuple[tuple[str, str], ...]:
        """Quantity and unit of each that differs from the units that were taken."""
        units = msgspec.structs.asdict(self)
        return tuple((name, unit) for name, unit in units.items() if unit != getattr(taken, name))


class ReadSpeedAs(msgspec.Struct, frozen=True, tag=True):
    """Read the speed of one vehicle in another unit."""

    vehicle: int
    unit: str


SI = ReadAs()
Cure = Exchange | Reverse | Shift | ReadAs | ReadSpeedAs


def slope_tolerance(relative_error: float) -> float:
    """Relative difference by which a slope of this relative standard error may miss a unit's."""
    return max(SLOPE_TOLERANCE, SURE * relative_error)


def units_for(
    slope: float, tolerance: float = SLOPE_TOLERANCE, taken: ReadAs = SI
) -> tuple[ReadAs, ...]:
    """Units that explain a slope of columns that were read as ``taken``, the best fit first.

    Only those that change the fewest quantities are returned; time changes alone, or speed and gap
    change.
    """

    def misfit(units: ReadAs) -> float:
        return abs(float(np.log(units.slope / taken.slope / slope)))

    possible = [ReadAs(*units) for units in product(SPEED_UNITS, GAP_UNITS, TIME_UNITS)]
    plain = (u for u in possible if u.time == taken.time or len(u.changes(taken)) == 1)
    fitting = [units for units in plain if misfit(units) < np.log1p(tolerance)]
    if not fitting:
        return ()
    fewest = min(len(units.changes(taken)) for units in fitting)
    simplest = [units for units in fitting if len(units.changes(taken)) == fewest]
    return tuple(sorted(simplest, key=misfit))
