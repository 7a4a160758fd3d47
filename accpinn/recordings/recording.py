"""What a file holds: metadata, vehicles, speeds, space-gaps and driver modes over time."""

from dataclasses import dataclass
from datetime import date
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from accpinn.units import FloatArray, Seconds, frozen

EVEN_TOLERANCE: Seconds = 1e-6
"""Time stamps this close to a regular grid count as even; float noise is below 1e-9 s."""


class Mode(IntEnum):
    """Who controls a vehicle's speed at one instant."""

    UNKNOWN = -1
    HUMAN = 0
    ACC = 1


@dataclass(frozen=True)
class Vehicle:
    """One vehicle of the platoon, numbered as in the file."""

    index: int
    """1 = first."""
    name: str
    present: bool
    """Whether the file has at least one speed of it."""
    missing: int
    """How many of its speed samples are missing."""
    missing_share: float
    """The same as a share of all samples, 0 to 1."""
    modes: dict[str, int] | None
    """Samples under "ACC" and under "Human"; None where the file does not say."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One OpenACC run; N samples, V vehicles. Arrays are read-only."""

    source: str
    """File name."""
    sha256: str
    """Of the file's bytes."""
    campaign: str | None
    """None where neither folder, file name nor date tells."""
    date: date | None
    acc_flag: int | None
    """As in the file: 0 human, 1 ACC, 2 mixed. It does not give a vehicle's mode."""
    distance_setting: str | None
    vehicles: tuple[Vehicle, ...]
    """(V,) also those the header names but the columns lack."""
    time: FloatArray
    """(N,) in s from the first sample."""
    first_time: Seconds
    """The first time stamp as it stands in the file."""
    speed: FloatArray
    """(N, V) in m/s; NaN where missing, column i - 1 is vehicle i."""
    gap: FloatArray
    """(N, V-1) in m; NaN where missing, column i - 1 is IVS<i>, between vehicles i and i+1."""
    mode: NDArray[np.int8]
    """(N, V) values of `Mode`."""
    warnings: tuple[str, ...] = ()
    """What the user should know about the data, in plain sentences."""

    def __post_init__(self) -> None:
        """Copy the arrays and lock them."""
        for name in ("time", "speed", "gap"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "mode", frozen(self.mode, dtype=np.int8))

    @property
    def samples(self) -> int:
        """N."""
        return len(self.time)

    @property
    def duration(self) -> Seconds:
        """From the first to the last sample."""
        return round(float(self.time[-1]), 6)

    @property
    def is_even(self) -> bool:
        """Whether the samples lie on a regular grid."""
        grid = np.arange(self.samples) * self._mean_step
        return bool(np.abs(self.time - grid).max() <= EVEN_TOLERANCE)

    @property
    def sample_time(self) -> Seconds:
        """The regular step, or the most typical one where steps are uneven."""
        step = self._mean_step if self.is_even else float(np.median(np.diff(self.time)))
        return round(step, 9)

    @property
    def _mean_step(self) -> Seconds:
        return float(self.time[-1]) / (self.samples - 1)

    @property
    def present(self) -> tuple[int, ...]:
        """Numbers of the vehicles that have data."""
        return tuple(vehicle.index for vehicle in self.vehicles if vehicle.present)

    def speed_of(self, number: int) -> FloatArray:
        """(N,) speed of vehicle ``number`` in m/s."""
        return self.speed[:, number - 1]

    def gap_behind(self, number: int) -> FloatArray:
        """(N,) IVS<number>: space-gap between vehicles ``number`` and ``number`` + 1, in m."""
        return self.gap[:, number - 1]
