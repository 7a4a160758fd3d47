"""Lags between the clocks of a space-gap and of the two speeds.

For each channel whose clock may differ, the lag is the one for which the increments of the gap and
of the integrated speed difference correlate best; it is refined by Newton's method on the sum of
squared residuals.
"""

from dataclasses import dataclass

import numpy as np

from accpinn.recordings.cures import SURE, Shift
from accpinn.recordings.increments import (
    AGREEMENT_MINIMUM,
    BEHIND,
    SHIFTED,
    THE_GAP,
    Grid,
    Regression,
    block_steps,
    block_sums,
    inliers,
    regression,
)
from accpinn.units import FloatArray, Mask, Seconds

LONGEST_LAG: Seconds = 5.0
"""Largest shift of a clock that is sought."""
LEAST_LAG: Seconds = 0.3
"""Least shift of a clock that is reported; filters of sensors delay by up to 0.2 s."""
LAG_STEP: Seconds = 0.5
"""Step of shifts that are tried before the best is refined."""
LAG_ERROR: Seconds = 0.35
"""Largest standard error of a shift that is reported."""
LAG_GAIN = 2.5
"""Least factor by which a shift reduces the variance of residuals, in which receivers' wandering
errors count more than in the standard error."""
SHARP_LAG = 15.0
"""Standard errors of a shift from which on a smaller factor is enough; the sound recordings of the
OpenACC database have up to 12."""
SHARP_LAG_GAIN = 1.2
"""The least factor then."""
CHANNEL_GAIN = 1.2
"""Least factor by which the residuals of the next channel exceed those of the one that is named."""


@dataclass(frozen=True)
class Lag:
    """The lag of a channel's clock for which both sides agree best."""

    clock: int
    """Key of `SHIFTED`."""
    seconds: Seconds
    """Time by which the speeds come late."""
    error: Seconds
    line: Regression

    @property
    def squares(self) -> float:
        """The sum of squared residuals."""
        return float(self.line.residuals @ self.line.residuals)

    @property
    def of_speeds(self) -> tuple[Seconds, Seconds]:
        """Seconds by which the speeds ahead and behind are to be taken later."""
        ahead, behind = SHIFTED[self.clock]
        return ahead * self.seconds, behind * self.seconds

    def shift(self, vehicle: int) -> Shift:
        """The shift of the channel that removes the lag."""
        if self.clock == THE_GAP:  # the speeds are late as against the gap
            return Shift("IVS", vehicle, round(self.seconds, 2))
        return Shift("Speed", vehicle + (self.clock == BEHIND), -round(self.seconds, 2))


def lags_of(grid: Grid) -> list[Lag]:
    """The best lag of each channel's clock, the one with the least residuals first.

    The search ends with the first channel where its lag is too small to be reported.
    """
    gap, integral = grid.sides()
    counts = inliers(gap, integral)
    rows = np.arange(len(gap)) * grid.step
    inside = counts & (rows >= LONGEST_LAG) & (rows <= rows[-1] - LONGEST_LAG)
    if inside.sum() < 2 * AGREEMENT_MINIMUM:
        return []
    most = round(LONGEST_LAG / LAG_STEP)
    whole = np.unique(np.round(LAG_STEP * np.arange(-most, most + 1) / grid.step).astype(int))
    place = np.flatnonzero(inside)[:: grid.window // 2]  # increments overlap by half
    rows = (place + whole[:, None]).clip(0, len(gap) - 1)
    speeds = [grid.increment(channel, 0.0, grid.window) for channel in (grid.ahead, grid.behind)]
    still, moved = (tuple(speed[index] for speed in speeds) for index in (place, rows))
    best = []
    for clock, factors in SHIFTED.items():
        ahead, behind = (
            m if factor else s for s, m, factor in zip(still, moved, factors, strict=True)
        )
        matches = _correlation_sizes(gap[place], ahead - behind)
        best.append((float(matches.max()), int(whole[matches.argmax()]), clock))
    lags = []
    for _, steps, clock in sorted(best, reverse=True):
        lag = _refined(grid, counts, clock, steps * grid.step)
        lags += [lag] if lag else []
        if len(lags) == 1 and abs(lags[0].seconds) < LEAST_LAG:
            break  # the usual case, in which nothing is gained by the others
    return sorted(lags, key=lambda lag: lag.squares)


def _correlation_sizes(values: FloatArray, others: FloatArray) -> FloatArray:
    """(L,) sizes of the correlations of values (n,) with others (L, n), where these are known."""
    is_known = np.isfinite(others)
    number = np.maximum(is_known.sum(axis=1), 1)
    values = values - values.mean()
    x, y = np.where(is_known, others, 0.0), np.where(is_known, values, 0.0)
    x = np.where(is_known, x - (x.sum(axis=1) / number)[:, None], 0.0)
    y = np.where(is_known, y - (y.sum(axis=1) / number)[:, None], 0.0)
    sizes = np.sqrt((x * x).sum(axis=1) * (y * y).sum(axis=1))
    shared = np.abs((x * y).sum(axis=1))
    is_enough = (number > AGREEMENT_MINIMUM) & (sizes > 1e-12)
    return np.where(is_enough, shared / np.where(is_enough, sizes, 1.0), 0.0)


def _refined(grid: Grid, counts: Mask, clock: int, start: Seconds) -> Lag | None:
    """The lag near ``start`` where the residuals' squares are least, by Newton's method."""
    ahead, behind = SHIFTED[clock]
    block = block_steps(grid, len(counts))
    rows = np.arange(len(counts)) * grid.step
    # The same increments at every lag that is tried, or the sums would not compare.
    reach = abs(start) + 2 * LAG_STEP
    counts = counts & (rows >= reach) & (rows <= rows[-1] - reach)
    for lag in (start - LAG_STEP, start, start + LAG_STEP):
        counts &= np.isfinite(grid.sides(ahead * lag, behind * lag)[1])

    def scores(lag: Seconds) -> tuple[FloatArray, Regression] | None:
        """(n,) derivatives of half the squares by the lag, and the regression."""
        gap, integral = grid.sides(ahead * lag, behind * lag)
        valid = counts & np.isfinite(integral)
        line = regression(gap, integral, valid, block)
        if line is None:
            return None
        change = grid.sensitivity(clock, lag)
        valid &= np.isfinite(change)
        change = np.where(valid, change, 0.0)
        return line.slope * change * line.residuals, line

    lag, small = start, 0.2 * grid.step
    for _ in range(6):
        here, before, after = (scores(lag + step) for step in (0.0, -small, small))
        if here is None or before is None or after is None:
            return None
        curvature = -(after[0].sum() - before[0].sum()) / (2 * small)
        if curvature <= 0:
            return None
        step = float(np.clip(here[0].sum() / curvature, -LAG_STEP / 2, LAG_STEP / 2))
        lag += step
        if abs(step) < 1e-3:
            break
    if abs(lag - start) > LAG_STEP:
        return None
    last = scores(lag)
    if last is None:
        return None
    error = float(np.sqrt((block_sums(last[0], block) ** 2).sum()) / curvature)
    return Lag(clock, lag, error, last[1])


def clear_lags(grid: Grid, lags: list[Lag]) -> list[Lag]:
    """The best lag and those that explain the residuals equally; none where no lag is clear.

    A lag is clear where it is large, sharply determined and explains much of the residuals, and
    where none that explains as much is so small that a sensor's filter may be the cause.
    """
    if not lags or not LEAST_LAG <= abs(lags[0].seconds) <= LONGEST_LAG - LAG_STEP:
        return []
    best = lags[0]
    if not best.error <= min(LAG_ERROR, abs(best.seconds) / (2 * SURE)):
        return []
    gap, integral = grid.sides()
    used = (best.line.residuals != 0) & np.isfinite(integral)
    line = regression(gap, integral, used, 1)
    is_sharp = best.error <= abs(best.seconds) / SHARP_LAG
    gain = SHARP_LAG_GAIN if is_sharp else LAG_GAIN
    if line is None or line.residuals @ line.residuals < gain * best.squares:
        return []
    block = block_steps(grid, len(gap))
    alike = [best, *(lag for lag in lags[1:] if _explains_as_well(best, lag, block))]
    return alike if min(abs(lag.seconds) for lag in alike) >= LEAST_LAG else []


def _explains_as_well(best: Lag, other: Lag, block: int) -> bool:
    """Whether the residuals of another clock are hardly larger than those of the best."""
    more = block_sums(other.line.residuals**2 - best.line.residuals**2, block)
    is_sure = more.sum() > SURE * more.std() * np.sqrt(len(more))
    return not (is_sure and other.squares > CHANNEL_GAIN * best.squares)
