"""The description of a result, of which list entries, rows, cards, documents and tables are views.

It has each follower's numbers with their intervals, and what is to be known of each. All of it is
computed when it is first asked for; how it is put in words and cells is with the views.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, wraps
from math import isnan, nan
from typing import Concatenate, ParamSpec, TypeVar

from accpinn.findings import Finding
from accpinn.inference.trust import Trust
from accpinn.methods.estimate import SPEEDS, Estimate, Span
from accpinn.methods.joint_likelihood import disturbance_sizes
from accpinn.methods.state_space import EXTRA
from accpinn.model.registry import FOLLOWING, time_gap, value_of
from accpinn.segment import SegmentInfo
from accpinn.stability.margin import NormMargin
from accpinn.study.result import Result
from accpinn.study.vehicles import (
    AssessedVehicle,
    AssessedVehicles,
    PeakGrowth,
    assessed_vehicles,
)
from accpinn.units import MetresPerSecond, Quantity

P = ParamSpec("P")
T = TypeVar("T")
FIXED, UNDETERMINED = "fixed", "not determined"
LEAST = "the least value that is sought: it may be less"
EXTRAPOLATED = "extrapolated: no window holds this speed"


@dataclass(frozen=True)
class Value:
    """A number with its interval, whose ends are nan where there is none."""

    span: Span
    note: str = ""
    """What changes how it is read: one of the above; empty for nothing."""


@dataclass(frozen=True)
class Values:
    """The estimate of one follower from one window, or from all."""

    time_gap: Value
    """In s, at the estimate's stated speed."""
    parameters: Mapping[str, Value]
    """The model's own parameters by name."""


@dataclass(frozen=True, eq=False)
class FollowerDescription:
    """One follower, or all that share their parameters: then values are of the first of them."""

    result: Result
    vehicles: AssessedVehicles
    """All followers of the result, where their string stability is assessed."""
    number: int
    """In the file; 0 for all."""
    places: Sequence[int]
    """Places of these followers, 0 for the first."""

    @property
    def place(self) -> int:
        """The place of the follower, or of the first."""
        return self.places[0]

    @cached_property
    def values(self) -> Values:
        """The estimate from all windows."""
        estimate = self.result.estimate
        spans = {name: estimate.span(name, self.place) for name in estimate.names}
        return Values(self.time_gaps[estimate.stated_speed], self._noted(spans))

    @cached_property
    def windows(self) -> tuple[Values, ...]:
        """(K,) the estimate from each window alone; empty where the method has none."""
        estimate = self.result.estimate
        sets, posterior, model = estimate.windows, estimate.posterior, estimate.model
        if sets is None:
            return ()
        parts = (sets, posterior.windows_lower, posterior.windows_upper) if posterior else (sets,)
        columns = [[value_of(model, part, name) for part in parts] for name in estimate.names]
        gaps = time_gap(model, sets, estimate.stated_speed)
        columns.append([gaps, *(posterior.windows_gap if posterior else ())])
        windows = []
        for k in range(len(gaps)):
            *spans, gap = (
                Span(*[*(float(part[k, self.place]) for part in column), nan, nan, nan, nan][:5])
                for column in columns
            )
            named = dict(zip(estimate.names, spans, strict=True))
            windows.append(Values(Value(gap), self._noted(named)))
        return tuple(windows)

    def _noted(self, spans: Mapping[str, Span]) -> dict[str, Value]:
        """Parameters that are fixed, not determined or at their least value are marked so."""
        estimate = self.result.estimate
        notes = {name: FIXED for name, _ in estimate.spec.fixed}
        for name in estimate.names:
            if not estimate.is_determined(name, self.place):
                notes[name] = UNDETERMINED
        return {
            name: Value(span, notes.get(name, LEAST * is_least(estimate.model, name, span)))
            for name, span in spans.items()
        }

    @cached_property
    def time_gaps(self) -> Mapping[MetresPerSecond, Value]:
        """The time gap in s at each of `SPEEDS`."""
        estimate, place = self.result.estimate, self.place
        return {
            speed: Value(
                estimate.time_gap(speed, place),
                EXTRAPOLATED * (not estimate.is_driven(speed, place)),
            )
            for speed in SPEEDS
        }

    @property
    def at_median(self) -> tuple[tuple[Span, Span, Span], ...]:
        """α, β and the time gap of each of these followers at its median speed."""
        return tuple(self.result.estimate.gains_and_gap(place) for place in self.places)

    @property
    def is_determined(self) -> bool:
        """Whether the data determine the time gap."""
        gap = self.values.time_gap.span
        return not isnan(gap.lower if self.result.posterior else gap.value)

    @property
    def trust(self) -> Trust:
        """How far its windows support the estimate."""
        return self.result.trust[self.place]

    @property
    def stability(self) -> AssessedVehicle:
        """Largest gains and verdicts by either norm."""
        return self.vehicles.assessed[self.place]

    @property
    def growth(self) -> PeakGrowth:
        """The largest growth behind it: measured, or the model's."""
        return self.vehicles.growths[self.place]

    @property
    def margin(self) -> NormMargin:
        """The time gap that separates it from L₂ string stability."""
        return self.vehicles.l2_margins[self.place]

    @property
    def disturbance(self) -> Finding | None:
        """How large the disturbances are that the estimate assumes; None where it assumes none."""
        sizes = disturbance_sizes(self.result.info.vehicles, self.result.estimate)
        return next((size for size in sizes if size.vehicle == self.number), None)


@dataclass(frozen=True, eq=False)
class Description:
    """A result by its followers."""

    result: Result

    @property
    def estimate(self) -> Estimate:
        """The estimate, for its model, settings, outcome and effort."""
        return self.result.estimate

    @property
    def infos(self) -> tuple[SegmentInfo, ...]:
        """(K,) the windows."""
        return self.result.infos

    @property
    def info(self) -> SegmentInfo:
        """The first window, and the vehicles."""
        return self.result.info

    @cached_property
    def vehicles(self) -> AssessedVehicles:
        """The followers where their string stability is assessed."""
        return assessed_vehicles(self.result)

    @cached_property
    def followers(self) -> tuple[FollowerDescription, ...]:
        """One for each follower, or one for all that share their parameters."""
        every = range(self.info.followers)
        if self.info.shares(self.estimate.case):
            return (FollowerDescription(self.result, self.vehicles, 0, every),)
        numbers = self.info.vehicles[1:]
        return tuple(
            FollowerDescription(self.result, self.vehicles, numbers[place], (place,))
            for place in every
        )

    def follower(self, place: int) -> FollowerDescription:
        """That of a follower by its place, 0 for the first."""
        return self.followers[min(place, len(self.followers) - 1)]


def describe(result: Result) -> Description:
    """The description of a result."""
    return Description(result)


def view(
    of: Callable[Concatenate[Description, P], T],
) -> Callable[Concatenate[Description | Result, P], T]:
    """A function of a description that describes a result where it is given one."""

    @wraps(of)
    def viewed(what: Description | Result, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return of(describe(what) if isinstance(what, Result) else what, *args, **kwargs)

    viewed.__annotations__ = {**of.__annotations__, "description": Description | Result}
    return viewed


def is_least(model: str, name: str, span: Quantity) -> bool:
    """Whether a lag or delay that has an interval is the least value that is sought."""
    if name not in ("lag", "delay") or not span.lower < span.upper:
        return False
    lowest = {p.name: p.lower for p in FOLLOWING[model].parameters}
    if FOLLOWING[model].is_linear:
        lowest |= {term: of.lower for term, of in EXTRA.items()}
    return span.value <= lowest[name] + 1e-9
