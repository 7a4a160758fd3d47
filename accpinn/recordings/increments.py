"""Increments of a space-gap and of the integrated speed difference, compared by regression.

    p(t + W) - p(t) = b ∫ [v_ahead(s + δ_ahead) - v_behind(s + δ_behind)] ds + c

Both sides are sampled on a regular grid of W / 4, so that channels with different time stamps, and
shifted ones, compare. Increments over a hole are NaN. The slope b lies between the one of least
squares and that of the reverse regression, whatever the noise of either side (Frisch, Statistical
Confluence Analysis, 1934). Its error is that of clusters: residuals are summed over blocks of time
first, so that their autocorrelation counts (Liang and Zeger, Biometrika 73, 1986).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from accpinn.recordings.cures import SURE
from accpinn.units import FloatArray, Mask, Metres, MetresPerSecond, Seconds, stretches

WINDOW: Seconds = 1.0
"""Time W of increments for correlations and shifts."""
SLOPE_WINDOW: Seconds = 5.0
"""Time W of increments for the slope; the noise of speeds averages out over it."""
COARSE = 2
"""Fewest steps of a window."""
FINE = 100
"""Most steps of a window, as where minutes were taken as seconds."""
SHARE = 10
"""Fewest windows of the slope, and fewest blocks, that a recording is divided into."""
BLOCK: Seconds = 30.0
"""Longest block of time whose residuals are summed before they are squared."""
LONGEST_HOLE: Seconds = 1.0
"""Longest hole that increments may bridge by a straight line."""
AGREEMENT_MINIMUM = 30
"""Least increments of a correlation."""
RELATIVE_MOTION: MetresPerSecond = 0.2
"""Least deviation of the speed difference at which noise does not dominate the correlation."""
OUTLIER = 8.0
"""Residuals of an increment, in robust standard deviations, above which it does not count."""
JUMP: Metres = 3.0
"""Least jump of a gap that is reported."""
STALE = 6.0
"""Acceleration in m/s² above which the sample before was a repetition of an older one."""
AHEAD, BEHIND, THE_GAP = range(3)
SHIFTED = {AHEAD: (1.0, 0.0), BEHIND: (0.0, 1.0), THE_GAP: (1.0, 1.0)}
"""Factors of δ_ahead and δ_behind where the clock of one channel differs."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Speeds and gap of a vehicle and the next one over N samples; NaN where missing."""

    vehicle: int
    """The vehicle ahead."""
    time: FloatArray
    """(N,) in s, increasing."""
    ahead: FloatArray
    """(N,) speed of the vehicle ahead in m/s."""
    behind: FloatArray
    """(N,) speed of the next vehicle in m/s."""
    gap: FloatArray
    """(N,) in m."""

    @cached_property
    def step(self) -> Seconds:
        """The typical step between samples."""
        return float(np.median(np.diff(self.time)))

    @cached_property
    def fresh(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Times and values of each channel's samples, without missing and frozen ones."""
        return (
            _without_repetitions(self.time, self.ahead, is_speed=True),
            _without_repetitions(self.time, self.behind, is_speed=True),
            _without_repetitions(self.time, self.gap, is_speed=False),
        )

    @cached_property
    def grid(self) -> "Grid | None":
        """The channels on a regular grid; None where a channel has too few samples."""
        counts = [np.isfinite(values).sum() for values in (self.ahead, self.behind, self.gap)]
        return None if min(counts) < AGREEMENT_MINIMUM else Grid.of(self)


@dataclass(frozen=True, eq=False)
class GridChannel:
    """A channel on a regular grid."""

    values: FloatArray
    """(n,) the integral of a speed in m, or the gap in m; NaN before the first sample and after the
    last."""
    rates: FloatArray
    """(n,) the speed in m/s; the gap's is not used."""
    holes: FloatArray
    """(n,) time in holes so far."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Both sides of the equation on a regular grid."""

    step: Seconds
    window: int
    """Steps of the window W."""
    ahead: GridChannel
    behind: GridChannel
    gap: GridChannel

    @classmethod
    def of(cls, pair: Pair) -> "Grid":
        """Sample a pair's channels every W / 4."""
        window = min(max(WINDOW, COARSE * pair.step), FINE * pair.step)
        step = window / 4
        count = int((pair.time[-1] - pair.time[0]) / step) + 1
        instants = pair.time[0] + step * np.arange(count)
        longest = max(LONGEST_HOLE, 1.5 * pair.step) + 1e-6

        def channel(time: FloatArray, values: FloatArray, is_speed: bool) -> GridChannel:
            summed = integrated(time, values) if is_speed else values
            outside = (instants < time[0] - 1e-9) | (instants > time[-1] + 1e-9)
            parts = summed, values, time_in_holes(time, longest)
            drawn = [np.interp(instants, time, part) for part in parts]
            drawn[0][outside] = np.nan
            return GridChannel(*drawn)

        kinds = zip(pair.fresh, (True, True, False), strict=True)
        return cls(step, 4, *(channel(*samples, is_speed) for samples, is_speed in kinds))

    def sides(
        self, ahead: Seconds = 0.0, behind: Seconds = 0.0, window: int = 0
    ) -> tuple[FloatArray, FloatArray]:
        """(n - W,) increments of the gap and of the integral, the speeds shifted; NaN in holes."""
        window = window or self.window
        gap = self.increment(self.gap, 0.0, window)
        return gap, (
            self.increment(self.ahead, ahead, window) - self.increment(self.behind, behind, window)
        )

    def sensitivity(self, clock: int, lag: Seconds) -> FloatArray:
        """(n - W,) derivative of the integral's increments by the lag of a clock."""
        parts = []
        for channel, factor in zip((self.ahead, self.behind), SHIFTED[clock], strict=True):
            rates = self._at(channel.rates, factor * lag)
            parts.append(factor * (rates[self.window :] - rates[: -self.window]))
        return np.asarray(parts[0] - parts[1])

    def _at(self, values: FloatArray, lag: Seconds) -> FloatArray:
        """(n,) values a time ``lag`` later; NaN beyond the end."""
        if not lag:
            return values
        whole, part = divmod(lag / self.step, 1.0)
        first, count = int(whole), len(values)
        between = values[:-1] * (1 - part) + values[1:] * part
        shifted = np.full(count, np.nan)
        start, end = max(0, -first), min(count, count - 1 - first)
        if start < end:
            shifted[start:end] = between[start + first : end + first]
        return shifted

    def increment(self, channel: GridChannel, lag: Seconds, window: int) -> FloatArray:
        """(n - W,) increments of a channel that is taken later by a lag; NaN in holes."""
        values = self._at(channel.values, lag)
        change = values[window:] - values[:-window]
        if not channel.holes[-1]:
            return np.asarray(change)
        holes = self._at(channel.holes, lag)
        return np.where(holes[window:] - holes[:-window] > 1e-9, np.nan, change)


def _without_repetitions(
    time: FloatArray, values: FloatArray, is_speed: bool
) -> tuple[FloatArray, FloatArray]:
    """Times and values of the samples that are present and do not repeat an older one.

    A frozen sensor repeats its last value: the next one then differs by more than a vehicle can
    accelerate, or than the gap usually changes in a step.
    """
    is_known = np.isfinite(values)
    time, values = time[is_known], values[is_known]
    change = np.abs(np.diff(values))
    if len(change) < 2:
        return time, values
    repeats = change == 0.0
    if not repeats.any():
        return time, values
    limit = STALE * np.diff(time) if is_speed else np.full(len(change), np.inf)
    if not is_speed:
        moved = change[~repeats]
        limit[:] = 4.0 * np.median(moved) if len(moved) else np.inf
    stale = np.zeros(len(values), bool)
    for stretch in stretches(repeats):
        after = stretch.last + 1
        if len(stretch) > 1 and after < len(change) and change[after] > limit[after]:
            stale[stretch.first + 1 : after + 1] = True
    return time[~stale], values[~stale]


def integrated(time: FloatArray, values: FloatArray) -> FloatArray:
    """(N,) the integral of values over time by the trapezoidal rule, from 0."""
    pieces = (values[1:] + values[:-1]) / 2 * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(pieces)])


def time_in_holes(time: FloatArray, longest: Seconds) -> FloatArray:
    """(N,) time so far in holes, which are steps between samples beyond the longest allowed."""
    steps = np.diff(time)
    return np.concatenate([[0.0], np.cumsum(np.where(steps > longest, steps, 0.0))])


def agreement(pair: Pair) -> float | None:
    """Correlation of the increments of gap and integral over `WINDOW`.

    It is 1 for a sound recording; None where the two vehicles hardly move against each other.
    """
    grid = pair.grid
    return None if grid is None else agreement_of(grid, *grid.sides())


def agreement_of(grid: Grid, gap: FloatArray, integral: FloatArray) -> float | None:
    """Correlation of both sides' increments; None where the integral hardly varies."""
    is_known = np.isfinite(gap) & np.isfinite(integral)
    if is_known.sum() < AGREEMENT_MINIMUM:
        return None
    if integral[is_known].std() < RELATIVE_MOTION * grid.window * grid.step:
        return None
    return correlation_of(gap[is_known], integral[is_known])


def correlation_of(first: FloatArray, second: FloatArray) -> float:
    """Correlation of two series (n,) without missing values; 0 where one is constant."""
    first, second = first - first.mean(), second - second.mean()
    size = float(np.sqrt((first @ first) * (second @ second)))
    return float(first @ second) / size if size > 1e-12 else 0.0


def inliers(gap: FloatArray, integral: FloatArray) -> Mask:
    """(n,) whether both increments are known and their difference is no outlier."""
    difference = gap - integral
    is_known = np.isfinite(difference)
    if not is_known.any():
        return is_known
    difference = np.where(is_known, difference - np.median(difference[is_known]), 0.0)
    deviation = 1.4826 * float(np.median(np.abs(difference[is_known])))
    return np.asarray(is_known & (np.abs(difference) <= max(JUMP, OUTLIER * deviation)))


@dataclass(frozen=True)
class Regression:
    """A regression of the gap's increments on those of the integral."""

    slope: float
    error: float
    """Standard error of the slope."""
    reverse: float
    """The slope of the reverse regression; the truth lies between the two."""
    residuals: FloatArray
    """(n,) zero where nothing counts."""

    @property
    def ends(self) -> tuple[float, float]:
        """Least and largest slope consistent with the data."""
        margin = SURE * self.error
        least, most = sorted((self.slope, self.reverse))
        return least - margin, most + margin

    @property
    def correlation(self) -> float:
        """The correlation of both sides."""
        return float(np.sign(self.slope) * np.sqrt(self.slope / self.reverse))

    @property
    def middle(self) -> float:
        """The geometric mean of both slopes."""
        return float(np.sign(self.slope) * np.sqrt(self.slope * self.reverse))

    @property
    def middle_error(self) -> float:
        """Standard error of the slope, or half the difference of both slopes if that is more."""
        return max(self.error, abs(self.reverse - self.slope) / 2)


def regression(
    gap: FloatArray, integral: FloatArray, counts: Mask, block: int
) -> Regression | None:
    """The regression where increments count, with errors by blocks of samples."""
    number = int(counts.sum())
    if number < AGREEMENT_MINIMUM:
        return None
    y, x = (np.where(counts, v - v[counts].mean(), 0.0) for v in (gap, integral))
    xx, xy, yy = float(x @ x), float(x @ y), float(y @ y)
    if xx < 1e-9 * number or abs(xy) < 1e-12 * number:
        return None
    slope = xy / xx
    residuals = y - slope * x
    error = float(np.sqrt((block_sums(x * residuals, block) ** 2).sum())) / xx
    return Regression(slope, error, yy / xy, residuals)


def block_sums(values: FloatArray, block: int) -> FloatArray:
    """Sums of values (n,) over blocks of ``block`` grid steps."""
    return np.asarray(np.add.reduceat(values, np.arange(0, len(values), block)))


def block_steps(grid: Grid, count: int) -> int:
    """Grid steps of a block of a series of ``count`` increments."""
    return max(1, round(min(BLOCK, count * grid.step / SHARE) / grid.step))


def slope_regression(grid: Grid, ahead: Seconds, behind: Seconds) -> Regression | None:
    """The regression over `SLOPE_WINDOW`."""
    lasting = len(grid.ahead.values) * grid.step
    scale = grid.window * grid.step / WINDOW
    window = round(min(SLOPE_WINDOW * scale, lasting / SHARE) / grid.step)
    gap, integral = grid.sides(ahead, behind, max(grid.window, window))
    if not len(gap):
        return None
    return regression(gap, integral, inliers(gap, integral), block_steps(grid, len(gap)))
