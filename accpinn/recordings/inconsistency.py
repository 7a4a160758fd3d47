"""Inconsistencies of a space-gap with the two speeds: one finding for each cause."""

from itertools import permutations
from typing import ClassVar

import msgspec
import numpy as np

from accpinn.channels import GAP, SPEED
from accpinn.findings import Finding, Labelled, Words, capital, joined
from accpinn.recordings.cures import (
    GAP_UNITS,
    SI,
    SLOPE_TOLERANCE,
    TIME_UNITS,
    Cure,
    Exchange,
    ReadAs,
    ReadSpeedAs,
    Reverse,
    Shift,
    slope_tolerance,
    units_for,
)
from accpinn.units import SPEED_UNITS, Metres, MetresPerSecond, Seconds

UNIT_TOLERANCE = 0.08
"""Relative difference from a unit of one speed that explains an offset."""
UNITS_LISTED = 3
"""Units that a sentence names."""
JUMPS_LISTED = 3
"""Jumps that a sentence names."""


def gap_of(vehicle: int) -> str:
    """The gap behind a vehicle in a sentence, which also serves where columns have other names."""
    return f"the gap of vehicle {vehicle + 1}"


def speed_of(vehicle: int) -> str:
    """The speed of a vehicle in a sentence."""
    return f"the speed of vehicle {vehicle}"


def channel_in_words(column: str) -> str:
    """A channel by its column's name: "IVS1" as "the gap of vehicle 2"."""
    for quantity, words in ((GAP, gap_of), (SPEED, speed_of)):
        number = column.removeprefix(quantity.column)
        if number != column and number.isdecimal():
            return words(int(number))
    return column


class Inconsistency(Finding, frozen=True):
    """The base of findings that the space-gap behind a vehicle contradicts the two speeds."""

    vehicle: int
    """Number of the vehicle ahead; the gap is the column IVS<vehicle>."""

    is_of_file: ClassVar[bool] = True
    """Whether the cause affects the whole file, not only some of its time."""
    is_contradiction: ClassVar[bool] = True
    """Whether results from such data are wrong."""

    @property
    def follower(self) -> int:
        """Number of the vehicle behind the gap."""
        return self.vehicle + 1

    @property
    def cures(self) -> tuple[Cure, ...]:
        """Changes that make gap and speeds agree, likeliest first; empty where none does."""
        return ()

    @property
    def cause(self) -> str:
        """The cause, as the sentence names it; empty where no cause is known."""
        return ""

    def sentence(self, about: Labelled) -> str:
        """The finding as a sentence; it may begin with the gap."""
        return capital(super().sentence(about))

    def _words(self, about: Labelled) -> Words:
        channels = {"gap": gap_of(self.vehicle), "ahead": self.vehicle, "behind": self.follower}
        return {**channels, "cause": self.cause}


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
        """Reverse the sign where most gaps are negative; exchange the speeds elsewhere."""
        return (Reverse(self.vehicle) if self.is_negative else Exchange(self.vehicle),)

    @property
    def cause(self) -> str:
        """The sign of most gaps, or the exchange of the speeds."""
        if self.is_negative:
            return "most of it is negative; reverse its sign"
        return f"exchange {joined((speed_of(self.vehicle), speed_of(self.follower)))}"


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
        """Units that explain the slope of columns that were read as ``taken``."""
        return units_for(self.slope, slope_tolerance(self.error / self.slope), taken)

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

    @property
    def cause(self) -> str:
        """The units that fit, or those that were taken for others."""
        fitting = [
            joined([f"{name}s in {unit}" for name, unit in units.changes(SI)])
            for units in self.units()
        ]
        misread = [f"{name}s in {unit} read as {taken}" for name, taken, unit in self.misread]
        listed = (fitting or misread)[:UNITS_LISTED]
        return f" ({joined(listed, 'or')} would fit)" if listed else ""


class SpeedsApart(Inconsistency, frozen=True):
    """The mean difference of two speeds is far from the mean change of the gap between them."""

    text = (
        "The speeds of vehicles {ahead} and {behind} differ by {offset:+.1f} m/s on average beyond"
        " what {gap} changes by: {cause}."
    )

    offset: MetresPerSecond
    """Median of Δv - dp/dt, in m/s."""
    ratios: tuple[float, float]
    """Factors of the speed ahead and of that behind, either of which alone removes the offset."""

    def units(self, taken: tuple[str, str] = ("m/s", "m/s")) -> tuple[ReadSpeedAs, ...]:
        """Units of one speed that remove the offset of two read as ``taken``; best fit first."""
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
        """Units that remove the offset of speeds that were taken as m/s."""
        return self.units()

    @property
    def cause(self) -> str:
        """The unit of one speed that fits."""
        fitting = [f"{speed_of(cure.vehicle)} in {cure.unit}" for cure in self.units()]
        return f"{joined(fitting, 'or')} would fit" if fitting else "check both columns"


class ClocksDiffer(Inconsistency, frozen=True):
    """The clocks of the channels differ: shifted in time, gap and speeds agree."""

    text = (
        "{gap} and the speeds of vehicles {ahead} and {behind} agree best after a shift of one"
        " channel: {cause} (± {error:.1g} s)."
    )

    shifts: tuple[Shift, ...]
    """Shift of the channel whose clock differs; several, likeliest first, where the data do not
    determine which channel it is."""
    error: Seconds
    """Standard error of the first."""

    @property
    def seconds(self) -> Seconds:
        """Time by which the first channel is late, in s; negative where it is early."""
        return -self.shifts[0].seconds

    @property
    def is_determined(self) -> bool:
        """Whether the data determine which channel's clock differs."""
        return len(self.shifts) == 1

    @property
    def cures(self) -> tuple[Cure, ...]:
        """The shifts."""
        return self.shifts

    @property
    def cause(self) -> str:
        """The channels that may be late or early."""
        channels = []
        for shift in self.shifts:
            side = "late" if shift.seconds < 0 else "early"
            channel = channel_in_words(f"{shift.channel}{shift.vehicle}")
            channels.append(f"{channel} is {abs(shift.seconds):.1f} s {side}")
        cure = f"; add {self.shifts[0].seconds:+.1f} s to its times" if self.is_determined else ""
        return joined(channels, "or") + cure


class GapJumps(Inconsistency, frozen=True):
    """The space-gap behind a vehicle jumps: another vehicle cut in or out."""

    text = (
        "{gap} jumps by more than the speeds of vehicles {ahead} and {behind} explain: {listed}."
        " Another vehicle cut in or out, or a sensor lost its target; windows end there."
    )
    is_of_file = False

    times: tuple[Seconds, ...]
    """Times of the jumps, in s from the recording's first sample."""
    sizes: tuple[Metres, ...]
    """Changes of the space-gap beyond the integral of the speed difference, in m."""

    def within(self, start: Seconds, end: Seconds) -> "GapJumps | None":
        """The jumps within an interval; None where it has none."""
        inside = [k for k, time in enumerate(self.times) if start < time <= end]
        chosen = [tuple(values[k] for k in inside) for values in (self.times, self.sizes)]
        return GapJumps(self.vehicle, *chosen) if inside else None

    def _words(self, about: Labelled) -> Words:
        jumps = list(zip(self.times, self.sizes, strict=True))
        largest = sorted(jumps, key=lambda jump: -abs(jump[1]))[:JUMPS_LISTED]
        sizes = [f"{size:+.1f} m at {time:.1f} s" for time, size in sorted(largest)]
        more = len(jumps) - len(sizes)
        listed = joined(sizes) if not more else f"{', '.join(sizes)} and {more} smaller"
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
    """Name of a column, as "Speed1"."""
    second: str

    def _words(self, about: Labelled) -> Words:
        return {"first": channel_in_words(self.first), "second": channel_in_words(self.second)}
