"""Types in the signatures: units (SI throughout, converted when a file is read), arrays, values."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

Seconds = Annotated[float, "s"]
Metres = Annotated[float, "m"]
MetresPerSecond = Annotated[float, "m/s"]
PerSecond = Annotated[float, "1/s"]
RadiansPerSecond = Annotated[float, "rad/s"]

SPEED_UNITS = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "ft/s": 0.3048, "kn": 1852 / 3600}
GAP_UNITS = {"m": 1.0, "cm": 0.01, "mm": 1e-3, "km": 1e3, "ft": 0.3048}
"""Units of speeds and lengths in files, in the package's own."""

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]
"""A boolean array, true where something holds."""


def frozen(values: object, *, dtype: type = np.float64) -> FloatArray:
    """A read-only copy of ``values``, for objects that must not change."""
    array: FloatArray = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


@dataclass(frozen=True)
class Quantity:
    """A value with its interval; nan where it is unknown."""

    value: float
    lower: float
    upper: float

    @property
    def is_inside(self) -> bool:
        """Whether the value lies in its interval, or is unknown."""
        return not (self.value < self.lower or self.value > self.upper)


def nanmean(values: FloatArray) -> FloatArray:
    """Mean over the first axis ignoring nan; nan where all are."""
    is_known = ~np.isnan(values)
    counts = is_known.sum(axis=0)
    sums = np.where(is_known, values, 0.0).sum(axis=0)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def nanstd(values: FloatArray) -> FloatArray:
    """Standard deviation over the first axis ignoring nan; nan where all are."""
    return np.asarray(np.sqrt(nanmean((values - nanmean(values)) ** 2)))


@dataclass(frozen=True)
class Stretch:
    """Samples ``first`` to ``last``, both included."""

    first: int
    last: int

    def __len__(self) -> int:
        """The number of its samples."""
        return self.last - self.first + 1

    @property
    def rows(self) -> slice:
        """The slice of an array that it covers."""
        return slice(self.first, self.last + 1)


def stretches(mask: ArrayLike) -> tuple[Stretch, ...]:
    """The maximal stretches of true values in a boolean vector (N,), in order."""
    padded = np.concatenate(([False], np.asarray(mask, bool), [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return tuple(Stretch(int(first), int(after) - 1) for first, after in pairs)


HUGE = 1e300
"""Stands for an infinite value where quantiles are taken."""


def interval_ends(values: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
    """Lower and upper quantiles over the first axis ignoring nan; nan where most values are.

    An end among infinite values is infinite.
    """
    tails = (1.0 - level) / 2.0, (1.0 + level) / 2.0
    values = np.clip(values, -HUGE, HUGE)  # the mean of two infinite ones is none
    ends = np.quantile(values, tails, axis=0)
    partly = np.isnan(ends[0]) & (np.isnan(values).mean(axis=0) <= 0.5)
    if partly.any():
        ends[:, partly] = np.nanquantile(values[:, partly], tails, axis=0)
    ends = np.where(np.abs(ends) > 1e-9 * HUGE, np.copysign(np.inf, ends), ends)
    return ends[0], ends[1]
