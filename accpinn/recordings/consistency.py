"""Consistency of a space-gap with the two speeds, and the cause where they disagree.

    dp/dt = Δv = v_ahead - v_behind

It is compared as increments over a window W, so that noise of single samples does not count:

    p(t + W) - p(t) = b ∫ [v_ahead(s + δ_ahead) - v_behind(s + δ_behind)] ds + c

    sign     b < 0: the two speeds are exchanged, or the gap has the other sign
    offset   c: one of the speeds is in another unit than the other
    clocks   the shifts δ for which both sides correlate best, where one channel alone is shifted
             (lags.py)
    units    b, by least squares and by the reverse regression (increments.py)
    jumps    steps of p - b ∫Δv within a second: another vehicle is ahead (jumps.py)
    origin   the noise of Δv that reappears in the increments of p: p was computed from the speeds

The findings are those of inconsistency.py, and what would remove them those of cures.py.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from accpinn.channels import GAP, SPEED
from accpinn.recordings.cures import GAP_UNITS
from accpinn.recordings.inconsistency import (
    ClocksDiffer,
    ColumnsCopied,
    GapComputed,
    GapContradictsSpeeds,
    GapJumps,
    Inconsistency,
    SignReversed,
    SpeedsApart,
    UnitsDiffer,
)
from accpinn.recordings.increments import (
    AGREEMENT_MINIMUM,
    Grid,
    Pair,
    Regression,
    agreement_of,
    block_steps,
    correlation_of,
    inliers,
    regression,
    slope_regression,
)
from accpinn.recordings.jumps import jumps_of
from accpinn.recordings.lags import clear_lags, lags_of
from accpinn.units import SPEED_UNITS, FloatArray, MetresPerSecond, Seconds

AGREEMENT_LIMIT = 0.5
"""Least correlation between both sides that counts as sound; the sound recordings of the OpenACC
database reach 0.8 and more."""
SLOPES = 0.75, 1.33
"""Slopes that count as sound; the sound recordings of the OpenACC database have 0.82 to 1.11."""
OFFSET: MetresPerSecond = 1.5
"""Least mean of dp/dt - Δv that is reported; wheel speeds are wrong by up to 3 %."""
OFFSET_SHARE = 0.05
"""The least one as a share of the larger speed."""
SAME_MOTION = 0.9
"""Least correlation where an offset that no unit of one speed explains has another cause."""
MOVING_GAP: MetresPerSecond = 0.15
"""Least median of |dp/dt| that contradicts speeds which are equal throughout."""
STEADY_GAP = 0.3
"""Largest median of dp/dt as a share of the larger speed; a position changes by more."""
VAGUE = 0.15
"""Relative error of a slope from which on it supports no unit."""
NOISE_REAPPEARS = 0.9
"""Least correlation of second differences of both sides where a gap was computed from speeds."""
NOISE_IS_WHITE = -0.5
"""Largest correlation of neighbouring second differences of Δv in noise, where it is -0.67; motion
has more."""
NO_DRIFT = 0.1
"""Largest deviation of a computed gap from the integral, as a share of the gap's own."""
VARYING = 0.05
"""Least standard deviation of a channel, in its unit, that can be a copy of another."""
SAME = 1e-4
"""Largest relative difference of a copy, which may be in another unit and rounded."""


def _copied(pair: Pair) -> ColumnsCopied | None:
    """Find two channels that hold the same numbers, whatever unit they were read in.

    Both must vary, and so must the gap, as equal speeds agree with a constant one.
    """
    gap = pair.gap[np.isfinite(pair.gap)]
    if len(gap) < AGREEMENT_MINIMUM or gap.std() < VARYING:
        return None
    channels = (
        (SPEED.of(pair.vehicle), pair.ahead),
        (SPEED.of(pair.vehicle + 1), pair.behind),
        (GAP.of(pair.vehicle), pair.gap),
    )
    factors = {a / b for a, b in product([*SPEED_UNITS.values(), *GAP_UNITS.values()], repeat=2)}
    for (first, values), (second, others) in combinations(channels, 2):
        is_known = np.isfinite(values) & np.isfinite(others)
        if is_known.sum() < AGREEMENT_MINIMUM or values[is_known].std() < VARYING:
            continue
        values, others = values[is_known], others[is_known]
        middle = float(np.median(others))
        ratio = float(np.median(values)) / middle if middle else 0.0
        is_of_unit = any(abs(ratio / factor - 1) < SAME for factor in factors)
        if is_of_unit and np.abs(values - ratio * others).max() < SAME * np.abs(values).max():
            return ColumnsCopied(pair.vehicle, first, second)
    return None


def _computed(pair: Pair) -> GapComputed | None:
    """Find the noise of the speeds in the gap's increments."""
    is_known = np.isfinite(pair.ahead) & np.isfinite(pair.behind) & np.isfinite(pair.gap)
    if is_known.sum() < AGREEMENT_MINIMUM:
        return None
    time, gap = pair.time[is_known], pair.gap[is_known]
    difference = (pair.ahead - pair.behind)[is_known]
    steps, increments = np.diff(time), np.diff(gap)
    # Curvatures from samples that follow each other at the usual step.
    usual = steps < 1.5 * pair.step
    usual = usual[2:] & usual[1:-1] & usual[:-2]
    noise = np.where(usual, _curvature(time[1:], difference[1:]), 0.0)
    size = float(noise @ noise)
    if size <= 1e-12 * len(noise) or noise[1:] @ noise[:-1] > NOISE_IS_WHITE * size:
        return None
    middles = (time[1:] + time[:-1]) / 2
    change = _curvature(middles, increments / steps)[usual]
    sums = difference[1:], difference[:-1], (difference[1:] + difference[:-1]) / 2
    for summed in sums:
        correlation = abs(correlation_of(_curvature(middles, summed)[usual], change))
        integral = np.concatenate([[0.0], np.cumsum(summed * steps)])
        if correlation > NOISE_REAPPEARS and 1 - correlation_of(integral, gap) ** 2 < NO_DRIFT**2:
            return GapComputed(pair.vehicle, correlation)
    return None


def _curvature(time: FloatArray, values: FloatArray) -> FloatArray:
    """(N - 2,) second differences, as those of even steps where steps are uneven.

    Without the division by steps the slope of smooth values would pass for noise there.
    """
    steps = np.diff(time)
    return np.asarray(np.diff(np.diff(values) / steps) * (steps[1:] + steps[:-1]) / 2)


def inconsistencies(pair: Pair) -> Iterator[Inconsistency]:
    """Inconsistencies of a pair's space-gap with its speeds, by their cause where it is known."""
    if copied := _copied(pair):
        yield copied
        return
    grid = pair.grid
    if grid is None or pair.time[-1] - pair.time[0] <= 2 * grid.window * grid.step:
        return
    if apart := _offset_of_means(pair.vehicle, grid):
        yield apart
        return
    lags = lags_of(grid)
    if clear := clear_lags(grid, lags):
        shifts = tuple(lag.shift(pair.vehicle) for lag in clear)
        yield ClocksDiffer(pair.vehicle, shifts, clear[0].error)
    ahead, behind = clear[0].of_speeds if clear else (0.0, 0.0)
    slope = slope_regression(grid, ahead, behind)
    is_off = slope is not None and is_unsound(slope)
    if is_off and lags and not clear:  # a lag that is not clear may be the cause
        shifted = slope_regression(grid, *lags[0].of_speeds)
        is_off = shifted is not None and is_unsound(shifted)
    factor = 1.0
    if slope:
        factor = slope.middle if is_off else float(np.sign(slope.slope))
    jumps = jumps_of(pair, factor, ahead, behind)
    is_reversed = slope is not None and max(slope.ends) < 0
    if is_reversed and lags and not clear:  # as with the slope
        is_reversed = lags[0].line.slope < 0
    correlation = agreement_of(grid, *_sides_without_jumps(grid, jumps, pair, ahead, behind))
    if correlation is not None and correlation < AGREEMENT_LIMIT and not is_reversed:
        yield GapContradictsSpeeds(pair.vehicle, correlation)
        return
    if slope and is_reversed:
        is_negative = bool(np.nanmedian(pair.gap) < 0)
        value = slope.correlation if correlation is None else correlation
        yield SignReversed(pair.vehicle, value, is_negative)
    if slope and is_off:
        yield UnitsDiffer(pair.vehicle, abs(slope.middle), slope.middle_error)
    if jumps:
        yield jumps
    if computed := _computed(pair):
        yield computed


def _offset_of_means(vehicle: int, grid: Grid) -> SpeedsApart | GapContradictsSpeeds | None:
    """Find speeds whose mean difference the gap contradicts, or a gap that moves without them."""
    gap, integral = grid.sides()
    is_known = np.isfinite(gap) & np.isfinite(integral)
    if is_known.sum() < AGREEMENT_MINIMUM:
        return None
    lasting = grid.window * grid.step
    # Medians, as a jump moves the mean of a short drive.
    offset = float(np.median((integral - gap)[is_known])) / lasting
    rate = float(np.median(gap[is_known])) / lasting
    speeds = [float(np.mean(channel.rates)) for channel in (grid.ahead, grid.behind)]
    if abs(offset) > max(OFFSET, OFFSET_SHARE * max(speeds)) and min(speeds) > 0:
        beyond = float(np.mean((integral - gap)[is_known])) / lasting
        ratios = (speeds[0] - beyond) / speeds[0], (speeds[1] + beyond) / speeds[1]
        finding = SpeedsApart(vehicle, offset, ratios)
        line = regression(gap, integral, inliers(gap, integral), block_steps(grid, len(gap)))
        correlation = line.correlation if line else 0.0
        # Both sides of a short drive may move alike, with another sign or in other units.
        is_scaled = line is not None and abs(correlation) > SAME_MOTION
        is_scaled &= line is not None and (line.slope < 0 or is_unsound(line))
        if finding.cures or not is_scaled:
            is_steady = abs(rate) < STEADY_GAP * max(speeds)
            return finding if is_steady else GapContradictsSpeeds(vehicle, correlation)
    is_moving = np.median(np.abs(gap[is_known])) > MOVING_GAP * lasting
    if is_moving and not np.abs(integral[is_known]).max() > 1e-9:
        return GapContradictsSpeeds(vehicle, 0.0)
    return None


def is_unsound(line: Regression) -> bool:
    """Whether the data determine that a slope is not sound, whatever its sign."""
    least, most = sorted(np.sign(line.slope) * end for end in line.ends)
    return bool(most < SLOPES[0] or least > SLOPES[1])


def _sides_without_jumps(
    grid: Grid, jumps: GapJumps | None, pair: Pair, ahead: Seconds, behind: Seconds
) -> tuple[FloatArray, FloatArray]:
    """Increments of gap and integral; NaN where the gap jumps."""
    gap, integral = grid.sides(ahead, behind)
    for time in jumps.times if jumps else ():
        at = (time - pair.time[0]) / grid.step
        first = max(0, int(at - 2 * grid.window))
        gap[first : int(at + grid.window) + 1] = np.nan
    return gap, integral


@dataclass(frozen=True)
class Slope:
    """Ratio of a gap's changes to those that the speed difference demands."""

    middle: float
    """1 in the right units; negative where the sign is reversed."""
    error: float
    """Standard error, or half the difference of the two regressions if that is more."""
    correlation: float

    @property
    def is_vague(self) -> bool:
        """Whether the data hardly determine the slope."""
        return self.error > VAGUE * abs(self.middle) or abs(self.correlation) < AGREEMENT_LIMIT


def slope_of(
    time: FloatArray, ahead: FloatArray, behind: FloatArray, gap: FloatArray
) -> Slope | None:
    """The slope of a gap's changes over those of the integrated speeds' difference, all (N,).

    A clock that clearly differs is corrected first. None where the vehicles hardly move against
    each other.
    """
    grid = Pair(1, time, ahead, behind, gap).grid
    if grid is None or time[-1] - time[0] <= 2 * grid.window * grid.step:
        return None
    clear = clear_lags(grid, lags_of(grid))
    shifts = clear[0].of_speeds if clear else (0.0, 0.0)
    line, correlation = slope_regression(grid, *shifts), agreement_of(grid, *grid.sides(*shifts))
    if line is None or correlation is None:
        return None
    return Slope(line.middle, line.middle_error, correlation)
