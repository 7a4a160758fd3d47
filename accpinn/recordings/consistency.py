"""Consistency of a space-gap with the two speeds, and the cause where they disagree.

    dp/dt = Δv = v_ahead - v_behind

It is compared as increments over a window W, so that noise of single samples does not count:

    p(t + W) - p(t) = b ∫ [v_ahead(s + δ_ahead) - v_behind(s + δ_behind)] ds + c

    sign     b < 0: the two speeds are exchanged, or the gap has the other sign
    offset   c: one of the speeds is in another unit than the other
    clocks   the shifts δ for which both sides correlate best, where one channel alone is shifted
    units    b, by least squares and by the reverse regression: the slope lies between the two
             whatever the noise of either side (Frisch, Statistical Confluence Analysis, 1934)
    jumps    steps of p - b ∫Δv within a second: another vehicle is ahead
    origin   the noise of Δv that reappears in the increments of p: p was computed from the speeds

The errors of b and δ are those of clusters: residuals are summed over blocks of time first, so that
their autocorrelation counts (Liang and Zeger, Biometrika 73, 1986).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, permutations, product
from typing import ClassVar, Literal

import msgspec
import numpy as np

from accpinn.channels import GAP, SPEED
from accpinn.findings import Finding, Labelled, Words, joined
from accpinn.units import GAP_UNITS as LENGTHS
from accpinn.units import (
    SPEED_UNITS,
    FloatArray,
    Mask,
    Metres,
    MetresPerSecond,
    Seconds,
    stretches,
)

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
"""Longest block whose residuals count as one."""
LONGEST_HOLE: Seconds = 1.0
"""Longest hole that increments may bridge by a straight line."""
AGREEMENT_MINIMUM = 30
"""Least increments of a correlation."""
AGREEMENT_LIMIT = 0.5
"""Least correlation between both sides that counts as sound; the sound recordings of the OpenACC
database reach 0.8 and more."""
RELATIVE_MOTION: MetresPerSecond = 0.2
"""Least deviation of the speed difference at which noise does not dominate the correlation."""
OUTLIER = 8.0
"""Residuals of an increment, in robust standard deviations, above which it does not count."""
SURE = 3.0
"""Standard errors by which a cause must be determined."""
SLOPES = 0.75, 1.33
"""Slopes that count as sound; the sound recordings of the OpenACC database have 0.82 to 1.11."""
SLOPE_TOLERANCE = 0.04
"""Relative difference of a slope from that of a unit which explains it."""
UNIT_TOLERANCE = 0.08
"""Relative difference from a unit of one speed that explains an offset."""
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
JUMP: Metres = 3.0
"""Least jump of a gap that is reported."""
JUMP_NOISE = 8.0
"""Least jump in robust standard deviations of what a sound gap changes in the same time."""
JUMP_TIME: Seconds = 1.0
"""Longest time of a jump."""
JUMP_SAMPLES = 5
"""Samples on either side of a jump whose medians are compared."""
JUMP_FLANK = 0.25
"""Largest change before and after a jump, as a share of it; a receiver's error wanders instead."""
JUMP_SHARP = 0.75
"""Least share of a jump that happens within `JUMP_TIME`."""
JUMP_HOLE: Seconds = 5.0
"""Longest hole across which a jump is sought."""
JUMP_DRIFT: MetresPerSecond = 1.0
"""What the integral of interpolated speeds may be wrong by in a hole."""
STALE = 6.0
"""Acceleration in m/s² above which the sample before was a repetition of an older one."""
VAGUE = 0.15
"""Relative error of a slope from which on it supports no unit."""
JUMPS_LISTED = 3
"""Jumps that a sentence names."""
NOISE_REAPPEARS = 0.9
"""Least correlation of second differences of both sides where a gap was computed from speeds."""
NOISE_IS_WHITE = -0.5
"""Largest correlation of neighbouring second differences of Δv that tells noise (-0.67) from
motion."""
NO_DRIFT = 0.1
"""Largest deviation of a computed gap from the integral, as a share of the gap's own."""
UNITS_LISTED = 3
"""Units that a sentence names."""
VARYING = 0.05
"""Least standard deviation of a channel, in its unit, that can be a copy of another."""
SAME = 1e-4
"""Largest relative difference of a copy, which may be in another unit and rounded."""
AHEAD, BEHIND, THE_GAP = range(3)
SHIFTED = {AHEAD: (1.0, 0.0), BEHIND: (0.0, 1.0), THE_GAP: (1.0, 1.0)}
"""Which of δ_ahead and δ_behind vary where the clock of one channel differs."""
GAP_UNITS = {unit: LENGTHS[unit] for unit in ("m", "ft", "cm")}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
"""Units of each quantity that a table may be in, in the package's own."""


# Cures: what to change in how a file is read


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
    """The vehicle whose speed it is, or behind which the space-gap is."""
    seconds: Seconds


class ReadAs(msgspec.Struct, frozen=True, tag=True):
    """Read columns in other units."""

    speed: str = "m/s"
    gap: str = "m"
    time: str = "s"

    @property
    def slope(self) -> float:
        """How fast gaps in these units change as compared with the speeds, if taken as SI."""
        return SPEED_UNITS[self.speed] * TIME_UNITS[self.time] / GAP_UNITS[self.gap]

    def changes(self, taken: "ReadAs") -> tuple[tuple[str, str], ...]:
        """Channel and unit of what differs from how the columns were taken."""
        units = msgspec.structs.asdict(self)
        return tuple((name, unit) for name, unit in units.items() if unit != getattr(taken, name))


class ReadSpeedAs(msgspec.Struct, frozen=True, tag=True):
    """Read the speed of one vehicle in another unit."""

    vehicle: int
    unit: str


SI = ReadAs()
Cure = Exchange | Reverse | Shift | ReadAs | ReadSpeedAs


def units_for(
    slope: float, tolerance: float = SLOPE_TOLERANCE, taken: ReadAs = SI
) -> tuple[ReadAs, ...]:
    """The units that would explain a slope if columns were read as ``taken``.

    Those come first that differ in the fewest channels, then those that fit best. Time alone, or
    speed and gap, may differ.
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


# Findings


class Inconsistency(Finding, frozen=True):
    """The base of what the space-gap behind a vehicle has against the speeds."""

    vehicle: int
    """The vehicle ahead, as IVS<vehicle> is named."""

    is_of_file: ClassVar[bool] = True
    """Whether its cause lies in how the whole file was made or read, not in some of its time."""
    is_contradiction: ClassVar[bool] = True
    """Whether results from such data are wrong."""

    @property
    def follower(self) -> int:
        """The vehicle whose gap to the one ahead it is."""
        return self.vehicle + 1

    @property
    def cures(self) -> tuple[Cure, ...]:
        """What would make gap and speeds agree, likeliest first; empty where nothing does."""
        return ()

    def _words(self, about: Labelled) -> Words:
        return {"gap": GAP.of(self.vehicle), "ahead": self.vehicle, "behind": self.follower}


class GapContradictsSpeeds(Inconsistency, frozen=True):
    """The space-gap behind a vehicle contradicts the two speeds for a cause that is not known."""

    text = (
        "{gap} contradicts the speeds of vehicles {ahead} and {behind}: its rate of change"
        " correlates with their difference by {correlation:.2f} (sound data: 0.8 and more); do not"
        " trust results for vehicle {behind}."
    )
    is_of_file = False

    correlation: float
    """Correlation of the gap's rate of change with the speeds' difference."""


class SignReversed(Inconsistency, frozen=True):
    """The space-gap behind a vehicle grows where the speeds demand that it shrinks."""

    text = (
        "{gap} shrinks where the speeds of vehicles {ahead} and {behind} demand that it grows"
        " (correlation {correlation:.2f}): {cause}."
    )

    correlation: float
    is_negative: bool
    """Whether most space-gaps are negative, so that it is their sign."""

    @property
    def cures(self) -> tuple[Cure, ...]:
        """The sign of negative gaps; else the speeds."""
        return (Reverse(self.vehicle) if self.is_negative else Exchange(self.vehicle),)

    def _words(self, about: Labelled) -> Words:
        speeds = SPEED.of(self.vehicle), SPEED.of(self.follower)
        cause = f"exchange {joined(speeds)}"
        if self.is_negative:
            cause = f"most of {GAP.of(self.vehicle)} is negative; reverse its sign"
        return {**super()._words(about), "cause": cause}


class UnitsDiffer(Inconsistency, frozen=True):
    """The space-gap behind a vehicle changes faster or slower than the speeds demand."""

    text = (
        "{gap} changes {slope:.3g} ± {error:.1g} times as fast as the speeds of vehicles {ahead}"
        " and {behind} demand: check the units{cause}."
    )

    slope: float
    error: float
    """Its standard error, and half the difference of the two regressions if that is more."""

    def units(self, taken: ReadAs = SI) -> tuple[ReadAs, ...]:
        """Units that would explain the slope, where columns were read as ``taken``."""
        return units_for(self.slope, max(SLOPE_TOLERANCE, SURE * self.error / self.slope), taken)

    @property
    def cures(self) -> tuple[Cure, ...]:
        """The units that fit, where all columns were taken as SI."""
        return self.units()

    @property
    def misread(self) -> tuple[tuple[str, str, str], ...]:
        """Quantity, unit it was read in, and unit that fits in its place; the best fit first."""
        fitting: list[tuple[float, tuple[str, str, str]]] = []
        for name, units in (("speed", SPEED_UNITS), ("gap", GAP_UNITS), ("time", TIME_UNITS)):
            for taken, unit in permutations(units, 2):
                now, then = (msgspec.structs.replace(SI, **{name: u}) for u in (taken, unit))
                misfit = abs(float(np.log(then.slope / now.slope / self.slope)))
                if misfit < np.log1p(SLOPE_TOLERANCE):
                    fitting.append((misfit, (name, taken, unit)))
        return tuple(misread for _, misread in sorted(fitting))

    def _words(self, about: Labelled) -> Words:
        fitting = [
            joined([f"{name}s in {unit}" for name, unit in units.changes(SI)])
            for units in self.units()
        ]
        misread = [f"{name}s in {unit} read as {taken}" for name, taken, unit in self.misread]
        listed = (fitting or misread)[:UNITS_LISTED]
        cause = f" ({joined(listed, 'or')} would fit)" if listed else ""
        return {**super()._words(about), "cause": cause}


class SpeedsApart(Inconsistency, frozen=True):
    """The mean difference of two speeds is far from what the space-gap between them changes by."""

    text = (
        "The speeds of vehicles {ahead} and {behind} differ by {offset:+.1f} m/s on average beyond"
        " what {gap} changes by: {cause}."
    )

    offset: MetresPerSecond
    """The mean of Δv - dp/dt."""
    ratios: tuple[float, float]
    """What the speed ahead, or that behind, has to be multiplied by so that they agree."""

    def units(self, taken: tuple[str, str] = ("m/s", "m/s")) -> tuple[ReadSpeedAs, ...]:
        """Units of one speed that would do, where both were read as ``taken``; best fit first."""
        fitting = []
        for vehicle, ratio, now in zip(
            (self.vehicle, self.follower), self.ratios, taken, strict=True
        ):
            for unit, size in SPEED_UNITS.items():
                misfit = abs(size / SPEED_UNITS[now] / ratio - 1) if ratio > 0 else np.inf
                if unit != now and misfit < UNIT_TOLERANCE:
                    fitting.append((misfit, ReadSpeedAs(vehicle, unit)))
        return tuple(cure for _, cure in sorted(fitting, key=lambda fit: fit[0]))

    @property
    def cures(self) -> tuple[Cure, ...]:
        """The units that would do, where both were taken as m/s."""
        return self.units()

    def _words(self, about: Labelled) -> Words:
        fitting = [f"{SPEED.of(cure.vehicle)} in {cure.unit}" for cure in self.units()]
        cause = f"{joined(fitting, 'or')} would fit" if fitting else "check both columns"
        return {**super()._words(about), "cause": cause}


class ClocksDiffer(Inconsistency, frozen=True):
    """The clocks of the channels differ: shifted in time, gap and speeds agree."""

    text = (
        "{gap} and the speeds of vehicles {ahead} and {behind} agree best after a shift of one"
        " channel: {cause} (± {error:.1g} s)."
    )

    shifts: tuple[Shift, ...]
    """Shift of the channel whose clock differs; of each possible one where that is undetermined,
    the likeliest first."""
    error: Seconds
    """Standard error of the first."""

    @property
    def seconds(self) -> Seconds:
        """Time by which the first channel is late, in s; negative where it is early."""
        return -self.shifts[0].seconds

    @property
    def is_determined(self) -> bool:
        """Whether it is known which channel's clock differs."""
        return len(self.shifts) == 1

    @property
    def cures(self) -> tuple[Cure, ...]:
        """The shifts."""
        return self.shifts

    def _words(self, about: Labelled) -> Words:
        said = []
        for shift in self.shifts:
            side = "late" if shift.seconds < 0 else "early"
            column = f"{shift.channel}{shift.vehicle}"
            said.append(f"{column} is {abs(shift.seconds):.1f} s {side}")
        cause = joined(said, "or") + (
            f"; add {self.shifts[0].seconds:+.1f} s to its times" if self.is_determined else ""
        )
        return {**super()._words(about), "cause": cause}


class GapJumps(Inconsistency, frozen=True):
    """The space-gap behind a vehicle jumps: another vehicle cut in or out."""

    text = (
        "{gap} jumps by more than the speeds of vehicles {ahead} and {behind} explain: {listed}."
        " Another vehicle cut in or out, or a sensor lost its target; windows end there."
    )
    is_of_file = False

    times: tuple[Seconds, ...]
    """In s from the recording's first sample."""
    sizes: tuple[Metres, ...]
    """What the space-gap changes by beyond the integral of the speeds' difference."""

    def within(self, start: Seconds, end: Seconds) -> "GapJumps | None":
        """The jumps inside of an interval; None without any."""
        inside = [k for k, time in enumerate(self.times) if start < time <= end]
        chosen = [tuple(values[k] for k in inside) for values in (self.times, self.sizes)]
        return GapJumps(self.vehicle, *chosen) if inside else None

    def _words(self, about: Labelled) -> Words:
        jumps = list(zip(self.times, self.sizes, strict=True))
        largest = sorted(jumps, key=lambda jump: -abs(jump[1]))[:JUMPS_LISTED]
        said = [f"{size:+.1f} m at {time:.1f} s" for time, size in sorted(largest)]
        more = len(jumps) - len(said)
        listed = joined(said) if not more else f"{', '.join(said)} and {more} smaller"
        return {**super()._words(about), "listed": listed}


class GapComputed(Inconsistency, frozen=True):
    """The space-gap behind a vehicle is the running sum of the recorded speeds' difference."""

    text = (
        "{gap} was computed from the speeds of vehicles {ahead} and {behind}, whose noise reappears"
        " in it (correlation {correlation:.2f}): it is no measurement of its own and starts from an"
        " assumed distance; take a measured gap if there is one."
    )
    is_contradiction = False

    correlation: float
    """Correlation of second differences of the gap's increments and of Δv."""


class ColumnsCopied(Inconsistency, frozen=True):
    """Two of a pair's three channels hold the same numbers."""

    text = (
        "{first} and {second} hold the same numbers in all samples: one of them is a copy; name the"
        " column that holds the other quantity."
    )

    first: str
    """As "Speed1"."""
    second: str


# The data of one follower


@dataclass(frozen=True, eq=False)
class Pair:
    """Speeds and gap of a vehicle and the next one over N samples; NaN where missing."""

    vehicle: int
    """The vehicle ahead."""
    time: FloatArray
    """(N,) in s, increasing."""
    ahead: FloatArray
    """(N,) in m/s, as well as the next."""
    behind: FloatArray
    gap: FloatArray
    """(N,) in m."""

    @cached_property
    def step(self) -> Seconds:
        """The typical step between samples."""
        return float(np.median(np.diff(self.time)))

    @cached_property
    def fresh(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Times and values of the samples of speeds and gap that are known and not frozen."""
        return (
            _fresh(self.time, self.ahead, is_speed=True),
            _fresh(self.time, self.behind, is_speed=True),
            _fresh(self.time, self.gap, is_speed=False),
        )

    @cached_property
    def grid(self) -> "_Grid | None":
        """The channels on a regular grid; None where there is too little of them."""
        known = [np.isfinite(values) for values in (self.ahead, self.behind, self.gap)]
        if min(int(mask.sum()) for mask in known) < AGREEMENT_MINIMUM:
            return None
        return _Grid.of(self)


@dataclass(frozen=True, eq=False)
class _Channel:
    """A channel on a regular grid."""

    values: FloatArray
    """(n,) the integral of a speed in m, or the gap in m; NaN before the first sample and after the
    last."""
    rates: FloatArray
    """(n,) the speed in m/s; the gap's is not used."""
    holes: FloatArray
    """(n,) time in holes so far."""


@dataclass(frozen=True, eq=False)
class _Grid:
    """Both sides of the equation on a regular grid."""

    step: Seconds
    window: int
    """Steps of the window W."""
    ahead: _Channel
    behind: _Channel
    gap: _Channel

    @classmethod
    def of(cls, pair: Pair) -> "_Grid":
        window = min(max(WINDOW, COARSE * pair.step), FINE * pair.step)
        step = window / 4
        count = int((pair.time[-1] - pair.time[0]) / step) + 1
        instants = pair.time[0] + step * np.arange(count)
        longest = max(LONGEST_HOLE, 1.5 * pair.step) + 1e-6

        def channel(time: FloatArray, values: FloatArray, is_speed: bool) -> _Channel:
            summed = _integral(time, values) if is_speed else values
            outside = (instants < time[0] - 1e-9) | (instants > time[-1] + 1e-9)
            parts = summed, values, _lost(time, longest)
            drawn = [np.interp(instants, time, part) for part in parts]
            drawn[0][outside] = np.nan
            return _Channel(*drawn)

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

    def increment(self, channel: _Channel, lag: Seconds, window: int) -> FloatArray:
        """(n - W,) increments of a channel that is taken later by a lag; NaN in holes."""
        values = self._at(channel.values, lag)
        change = values[window:] - values[:-window]
        if not channel.holes[-1]:
            return np.asarray(change)
        holes = self._at(channel.holes, lag)
        return np.where(holes[window:] - holes[:-window] > 1e-9, np.nan, change)


def _fresh(time: FloatArray, values: FloatArray, is_speed: bool) -> tuple[FloatArray, FloatArray]:
    """Times and values of the samples that are known and no repetition of an older one.

    A repetition is what a frozen sensor sends: then the next value is further away than a vehicle
    can accelerate, or the gap changes by more than its usual step.
    """
    known = np.isfinite(values)
    time, values = time[known], values[known]
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


def _integral(time: FloatArray, values: FloatArray) -> FloatArray:
    """(N,) the integral of values over time by the trapezoidal rule, from 0."""
    pieces = (values[1:] + values[:-1]) / 2 * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(pieces)])


def _lost(time: FloatArray, longest: Seconds) -> FloatArray:
    """(N,) the time so far in holes between samples that are longer than that."""
    steps = np.diff(time)
    return np.concatenate([[0.0], np.cumsum(np.where(steps > longest, steps, 0.0))])


# Correlation, shift and slope


def agreement(pair: Pair) -> float | None:
    """Correlation of the increments of gap and integral over `WINDOW`.

    It is 1 for a sound recording; None where the two vehicles hardly move against each other.
    """
    grid = pair.grid
    return None if grid is None else _agreement(grid, *grid.sides())


def _agreement(grid: _Grid, gap: FloatArray, integral: FloatArray) -> float | None:
    known = np.isfinite(gap) & np.isfinite(integral)
    if known.sum() < AGREEMENT_MINIMUM:
        return None
    if integral[known].std() < RELATIVE_MOTION * grid.window * grid.step:
        return None
    return _correlation(gap[known], integral[known])


def _correlation(first: FloatArray, second: FloatArray) -> float:
    first, second = first - first.mean(), second - second.mean()
    size = float(np.sqrt((first @ first) * (second @ second)))
    return float(first @ second) / size if size > 1e-12 else 0.0


def _correlations(values: FloatArray, others: FloatArray) -> FloatArray:
    """(L,) size of the correlation of values (n,) with others (L, n), where these are known."""
    known = np.isfinite(others)
    number = np.maximum(known.sum(axis=1), 1)
    values = values - values.mean()
    x, y = np.where(known, others, 0.0), np.where(known, values, 0.0)
    x = np.where(known, x - (x.sum(axis=1) / number)[:, None], 0.0)
    y = np.where(known, y - (y.sum(axis=1) / number)[:, None], 0.0)
    sizes = np.sqrt((x * x).sum(axis=1) * (y * y).sum(axis=1))
    shared = np.abs((x * y).sum(axis=1))
    is_enough = (number > AGREEMENT_MINIMUM) & (sizes > 1e-12)
    return np.where(is_enough, shared / np.where(is_enough, sizes, 1.0), 0.0)


def _counted(gap: FloatArray, integral: FloatArray) -> Mask:
    """(n,) where both are known and do not differ by an outlier."""
    rest = gap - integral
    known = np.isfinite(rest)
    if not known.any():
        return known
    rest = np.where(known, rest - np.median(rest[known]), 0.0)
    deviation = 1.4826 * float(np.median(np.abs(rest[known])))
    return np.asarray(known & (np.abs(rest) <= max(JUMP, OUTLIER * deviation)))


@dataclass(frozen=True)
class _Line:
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
        """Least and largest slope that the data allow."""
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


def _line(gap: FloatArray, integral: FloatArray, counts: Mask, block: int) -> _Line | None:
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
    error = float(np.sqrt((_by_block(x * residuals, block) ** 2).sum())) / xx
    return _Line(slope, error, yy / xy, residuals)


def _by_block(values: FloatArray, block: int) -> FloatArray:
    return np.asarray(np.add.reduceat(values, np.arange(0, len(values), block)))


def _block(grid: _Grid, count: int) -> int:
    """Grid steps of a block."""
    return max(1, round(min(BLOCK, count * grid.step / SHARE) / grid.step))


@dataclass(frozen=True)
class _Lag:
    """The lag of a channel's clock for which both sides agree best."""

    clock: int
    """Key of `SHIFTED`."""
    seconds: Seconds
    """Time by which the speeds come late."""
    error: Seconds
    line: _Line

    @property
    def squares(self) -> float:
        """The sum of squared residuals."""
        return float(self.line.residuals @ self.line.residuals)

    @property
    def of_speeds(self) -> tuple[Seconds, Seconds]:
        """By how much later the speeds ahead and behind are to be taken."""
        ahead, behind = SHIFTED[self.clock]
        return ahead * self.seconds, behind * self.seconds

    def shift(self, vehicle: int) -> Shift:
        """The cure."""
        if self.clock == THE_GAP:  # the speeds are late as against the gap
            return Shift("IVS", vehicle, round(self.seconds, 2))
        return Shift("Speed", vehicle + (self.clock == BEHIND), -round(self.seconds, 2))


def _lags(grid: _Grid) -> list[_Lag]:
    """The best lag of each clock, the one with the least residuals first.

    It is only the first one where that is too small to be reported.
    """
    gap, integral = grid.sides()
    counts = _counted(gap, integral)
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
        matches = _correlations(gap[place], ahead - behind)
        best.append((float(matches.max()), int(whole[matches.argmax()]), clock))
    lags = []
    for _, steps, clock in sorted(best, reverse=True):
        lag = _refined(grid, counts, clock, steps * grid.step)
        lags += [lag] if lag else []
        if len(lags) == 1 and abs(lags[0].seconds) < LEAST_LAG:
            break  # the usual case, in which nothing is gained by the others
    return sorted(lags, key=lambda lag: lag.squares)


def _refined(grid: _Grid, counts: Mask, clock: int, start: Seconds) -> _Lag | None:
    """The lag near ``start`` where the residuals' squares are least, by Newton's method."""
    ahead, behind = SHIFTED[clock]
    block = _block(grid, len(counts))
    rows = np.arange(len(counts)) * grid.step
    # The same increments at every lag that is tried, or the sums would not compare.
    reach = abs(start) + 2 * LAG_STEP
    counts = counts & (rows >= reach) & (rows <= rows[-1] - reach)
    for lag in (start - LAG_STEP, start, start + LAG_STEP):
        counts &= np.isfinite(grid.sides(ahead * lag, behind * lag)[1])

    def scores(lag: Seconds) -> tuple[FloatArray, _Line] | None:
        """(n,) derivatives of half the squares by the lag, and the regression."""
        gap, integral = grid.sides(ahead * lag, behind * lag)
        valid = counts & np.isfinite(integral)
        line = _line(gap, integral, valid, block)
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
    error = float(np.sqrt((_by_block(last[0], block) ** 2).sum()) / curvature)
    return _Lag(clock, lag, error, last[1])


def _clear(grid: _Grid, lags: list[_Lag]) -> list[_Lag]:
    """Those of the lags, best first, that explain the residuals alike, if that is clear.

    Then the best one is large, sharply determined and explains much of the residuals, and none is
    so small that a sensor's filter may be the cause.
    """
    if not lags or not LEAST_LAG <= abs(lags[0].seconds) <= LONGEST_LAG - LAG_STEP:
        return []
    best = lags[0]
    if not best.error <= min(LAG_ERROR, abs(best.seconds) / (2 * SURE)):
        return []
    gap, integral = grid.sides()
    used = (best.line.residuals != 0) & np.isfinite(integral)
    line = _line(gap, integral, used, 1)
    is_sharp = best.error <= abs(best.seconds) / SHARP_LAG
    gain = SHARP_LAG_GAIN if is_sharp else LAG_GAIN
    if line is None or line.residuals @ line.residuals < gain * best.squares:
        return []
    block = _block(grid, len(gap))
    alike = [best, *(lag for lag in lags[1:] if _alike(best, lag, block))]
    return alike if min(abs(lag.seconds) for lag in alike) >= LEAST_LAG else []


def _alike(best: _Lag, other: _Lag, block: int) -> bool:
    """Whether the residuals of another clock are hardly larger than those of the best."""
    more = _by_block(other.line.residuals**2 - best.line.residuals**2, block)
    is_sure = more.sum() > SURE * more.std() * np.sqrt(len(more))
    return not (is_sure and other.squares > CHANNEL_GAIN * best.squares)


# Jumps


def _jumps(pair: Pair, slope: float, ahead: Seconds, behind: Seconds) -> GapJumps | None:
    """Steps of the gap that the speeds, aligned, do not explain."""
    *speeds, (time, gap) = pair.fresh
    if len(gap) < 4 * JUMP_SAMPLES:
        return None
    rest, unknown, inside = gap.copy(), np.zeros(len(time)), np.ones(len(time), bool)
    for (stamps, values), lag, sign in zip(speeds, (ahead, behind), (-slope, slope), strict=True):
        rest += sign * np.interp(time + lag, stamps, _integral(stamps, values))
        inside &= (time + lag >= stamps[0] - 1e-9) & (time + lag <= stamps[-1] + 1e-9)
        unknown += np.interp(time + lag, stamps, _lost(stamps, LONGEST_HOLE))
    time, rest, unknown = time[inside], rest[inside], unknown[inside]
    half = min(JUMP_SAMPLES, max(1, round(JUMP_TIME / 2 / pair.step)) | 1)
    middles = np.median(np.lib.stride_tricks.sliding_window_view(rest, half), axis=1)
    guard = max(1, round(JUMP_TIME / pair.step))
    span = half + guard  # from the first sample before to the first one after
    count = len(rest) - 2 * half - guard + 1
    if count < AGREEMENT_MINIMUM:
        return None
    before, after = middles[:count], middles[span : span + count]
    sizes = after - before
    first, last = np.arange(count), np.arange(count) + span + half - 1
    lasting = time[last] - time[first]
    hole = np.maximum(lasting - (span + half) * pair.step - LONGEST_HOLE, 0.0)
    hole = np.maximum(hole, unknown[last] - unknown[first])
    deviation = 1.4826 * float(np.median(np.abs(sizes - np.median(sizes))))
    limit = max(JUMP, JUMP_NOISE * deviation) + JUMP_DRIFT * hole
    large = (np.abs(sizes) > limit) & (hole <= JUMP_HOLE)
    jumps = []
    for stretch in stretches(large):
        k = stretch.first + int(np.abs(sizes[stretch.rows]).argmax())
        size = float(sizes[k])
        # Before and after, the rest hardly changes for as long again.
        far = max(k - span, 0), min(k + 2 * span, len(middles) - 1)
        calm = max(abs(middles[k] - middles[far[0]]), abs(middles[far[1]] - middles[k + span]))
        around = rest[far[0] : far[1] + half]
        sharpest = np.abs(around[guard:] - around[:-guard]).max()
        if calm > JUMP_FLANK * abs(size) or sharpest < JUMP_SHARP * abs(size):
            continue
        steps = np.diff(rest[k : k + span + half]) * np.sign(size)
        at = k + int(steps.argmax()) + 1
        jumps.append((round(float(time[at]), 6), round(size, 3)))
    if not jumps:
        return None
    return GapJumps(pair.vehicle, *(tuple(values) for values in zip(*sorted(jumps), strict=True)))


# Channels that are copies, and a gap that was computed


def _copied(pair: Pair) -> ColumnsCopied | None:
    """Whether two channels hold the same numbers, whatever unit they were read in.

    Both vary, and so does the gap: equal speeds agree with one that is constant.
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
        known = np.isfinite(values) & np.isfinite(others)
        if known.sum() < AGREEMENT_MINIMUM or values[known].std() < VARYING:
            continue
        values, others = values[known], others[known]
        middle = float(np.median(others))
        ratio = float(np.median(values)) / middle if middle else 0.0
        is_of_unit = any(abs(ratio / factor - 1) < SAME for factor in factors)
        if is_of_unit and np.abs(values - ratio * others).max() < SAME * np.abs(values).max():
            return ColumnsCopied(pair.vehicle, first, second)
    return None


def _computed(pair: Pair) -> GapComputed | None:
    """Whether the noise of the speeds reappears in the gap's increments."""
    known = np.isfinite(pair.ahead) & np.isfinite(pair.behind) & np.isfinite(pair.gap)
    if known.sum() < AGREEMENT_MINIMUM:
        return None
    time, gap = pair.time[known], pair.gap[known]
    difference = (pair.ahead - pair.behind)[known]
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
        correlation = abs(_correlation(_curvature(middles, summed)[usual], change))
        integral = np.concatenate([[0.0], np.cumsum(summed * steps)])
        if correlation > NOISE_REAPPEARS and 1 - _correlation(integral, gap) ** 2 < NO_DRIFT**2:
            return GapComputed(pair.vehicle, correlation)
    return None


def _curvature(time: FloatArray, values: FloatArray) -> FloatArray:
    """(N - 2,) second differences, as those of even steps where steps are uneven.

    Without the division by steps the slope of smooth values would pass for noise there.
    """
    steps = np.diff(time)
    return np.asarray(np.diff(np.diff(values) / steps) * (steps[1:] + steps[:-1]) / 2)


# All of them


def inconsistencies(pair: Pair) -> Iterator[Inconsistency]:
    """What the space-gap of a pair has against its speeds, with the cause where that is known."""
    if copied := _copied(pair):
        yield copied
        return
    grid = pair.grid
    if grid is None or pair.time[-1] - pair.time[0] <= 2 * grid.window * grid.step:
        return
    if apart := _apart(pair.vehicle, grid):
        yield apart
        return
    lags = _lags(grid)
    if clear := _clear(grid, lags):
        shifts = tuple(lag.shift(pair.vehicle) for lag in clear)
        yield ClocksDiffer(pair.vehicle, shifts, clear[0].error)
    ahead, behind = clear[0].of_speeds if clear else (0.0, 0.0)
    slope = _slope(grid, ahead, behind)
    is_off = slope is not None and _is_off(slope)
    if is_off and lags and not clear:  # a lag that is not clear may be the cause
        shifted = _slope(grid, *lags[0].of_speeds)
        is_off = shifted is not None and _is_off(shifted)
    factor = 1.0
    if slope:
        factor = slope.middle if is_off else float(np.sign(slope.slope))
    jumps = _jumps(pair, factor, ahead, behind)
    is_reversed = slope is not None and max(slope.ends) < 0
    if is_reversed and lags and not clear:  # as with the slope
        is_reversed = lags[0].line.slope < 0
    correlation = _agreement(grid, *_without(grid, jumps, pair, ahead, behind))
    if correlation is not None and correlation < AGREEMENT_LIMIT and not is_reversed:
        yield GapContradictsSpeeds(pair.vehicle, correlation)
        return
    if slope and is_reversed:
        is_negative = bool(np.nanmedian(pair.gap) < 0)
        value = slope.correlation if correlation is None else correlation
        yield SignReversed(pair.vehicle, value, is_negative)
    if slope and is_off:
        error = max(slope.error, abs(slope.reverse - slope.slope) / 2)
        yield UnitsDiffer(pair.vehicle, abs(slope.middle), error)
    if jumps:
        yield jumps
    if computed := _computed(pair):
        yield computed


def _apart(vehicle: int, grid: _Grid) -> SpeedsApart | GapContradictsSpeeds | None:
    """What the means of both sides, or a gap that moves without speeds, have against them."""
    gap, integral = grid.sides()
    known = np.isfinite(gap) & np.isfinite(integral)
    if known.sum() < AGREEMENT_MINIMUM:
        return None
    lasting = grid.window * grid.step
    # Medians, as a jump moves the mean of a short drive.
    offset = float(np.median((integral - gap)[known])) / lasting
    rate = float(np.median(gap[known])) / lasting
    speeds = [float(np.mean(channel.rates)) for channel in (grid.ahead, grid.behind)]
    if abs(offset) > max(OFFSET, OFFSET_SHARE * max(speeds)) and min(speeds) > 0:
        beyond = float(np.mean((integral - gap)[known])) / lasting
        ratios = (speeds[0] - beyond) / speeds[0], (speeds[1] + beyond) / speeds[1]
        finding = SpeedsApart(vehicle, offset, ratios)
        line = _line(gap, integral, _counted(gap, integral), _block(grid, len(gap)))
        correlation = line.correlation if line else 0.0
        # Both sides of a short drive may move alike, with another sign or in other units.
        is_scaled = line is not None and abs(correlation) > SAME_MOTION
        is_scaled &= line is not None and (line.slope < 0 or _is_off(line))
        if finding.cures or not is_scaled:
            is_steady = abs(rate) < STEADY_GAP * max(speeds)
            return finding if is_steady else GapContradictsSpeeds(vehicle, correlation)
    is_moving = np.median(np.abs(gap[known])) > MOVING_GAP * lasting
    if is_moving and not np.abs(integral[known]).max() > 1e-9:
        return GapContradictsSpeeds(vehicle, 0.0)
    return None


def _slope(grid: _Grid, ahead: Seconds, behind: Seconds) -> _Line | None:
    """The regression over `SLOPE_WINDOW`."""
    lasting = len(grid.ahead.values) * grid.step
    scale = grid.window * grid.step / WINDOW
    window = round(min(SLOPE_WINDOW * scale, lasting / SHARE) / grid.step)
    gap, integral = grid.sides(ahead, behind, max(grid.window, window))
    if not len(gap):
        return None
    return _line(gap, integral, _counted(gap, integral), _block(grid, len(gap)))


def _is_off(line: _Line) -> bool:
    """Whether the data determine that a slope is not sound, whatever its sign."""
    least, most = sorted(np.sign(line.slope) * end for end in line.ends)
    return bool(most < SLOPES[0] or least > SLOPES[1])


def _without(
    grid: _Grid, jumps: GapJumps | None, pair: Pair, ahead: Seconds, behind: Seconds
) -> tuple[FloatArray, FloatArray]:
    """Both sides, unknown where the gap jumps."""
    gap, integral = grid.sides(ahead, behind)
    for time in jumps.times if jumps else ():
        at = (time - pair.time[0]) / grid.step
        first = max(0, int(at - 2 * grid.window))
        gap[first : int(at + grid.window) + 1] = np.nan
    return gap, integral


@dataclass(frozen=True)
class Slope:
    """How fast a gap changes as compared with the speeds' difference."""

    middle: float
    """1 in the right units; negative where the sign is reversed."""
    error: float
    """Its standard error, and half the difference of the two regressions if that is more."""
    correlation: float

    @property
    def is_vague(self) -> bool:
        """Whether the data hardly determine it."""
        return self.error > VAGUE * abs(self.middle) or abs(self.correlation) < AGREEMENT_LIMIT


def slope_of(
    time: FloatArray, ahead: FloatArray, behind: FloatArray, gap: FloatArray
) -> Slope | None:
    """The slope of a gap's changes over those of the integrated speeds' difference, all (N,).

    A clock that clearly differs is put right before. None where the vehicles hardly move against
    each other.
    """
    grid = Pair(1, time, ahead, behind, gap).grid
    if grid is None or time[-1] - time[0] <= 2 * grid.window * grid.step:
        return None
    clear = _clear(grid, _lags(grid))
    shifts = clear[0].of_speeds if clear else (0.0, 0.0)
    line, correlation = _slope(grid, *shifts), _agreement(grid, *grid.sides(*shifts))
    if line is None or correlation is None:
        return None
    error = max(line.error, abs(line.reverse - line.slope) / 2)
    return Slope(line.middle, error, correlation)
