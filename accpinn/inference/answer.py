"""The answer: one complete parameter set a vehicle, with its interval as the car's typical value.

The windows of a recording are estimated one by one under the exact likelihood (see
`methods.maximum_likelihood`). Their posteriors, and what many cars taught about how windows differ,
give the typical value of the car and its interval, and the interval that a further window's
parameters have (see `inference.population`). Everything that shows, simulates, judges or exports
"the answer" takes it from here.

The headline is the time gap in equilibrium, τ + s₀/v, at a stated speed: the data determine it,
while τ and s₀ may trade off against each other.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Self

import numpy as np
from scipy.special import chdtrc

from accpinn.errors import ConfigError
from accpinn.findings import Finding, Labelled, Words, joined, p_value
from accpinn.inference.intervals import LEVEL, Uncertainty, from_draws, interval_ends
from accpinn.inference.population import CHAINS, KEPT, Car, population_of, sampled_population
from accpinn.inference.trust import Trust, trust
from accpinn.inference.window_posterior import (
    count_of,
    free_of,
    log_prior_of_likely,
    parameters_of,
    possible,
    window_posterior,
)
from accpinn.methods import one_thread
from accpinn.model.cthp import Case, Parameters
from accpinn.model.registry import BEST, CTHPS, FOLLOWING, time_gap, value_of
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment, median_speeds
from accpinn.units import Quantity, FloatArray, MetresPerSecond, Seconds

LEFT_OUT, MOST_LEFT_OUT = 5, 150
"""Rounds of a chain that are left out for each window, and at most: many weak ones move it slowly.
Of 22 windows s₀ was still half a deviation away after 20 rounds."""
SPEEDS: tuple[MetresPerSecond, ...] = (50 / 3.6, 100 / 3.6)
"""Speeds at which the time gap is stated, beside the median speed."""
SIGNIFICANCE = 0.05
"""Below this probability under equal parameters, windows are said to differ."""


class HeterogeneousWindows(Finding, frozen=True):
    """Windows of some followers differ by more than sampling error explains."""

    text = (
        "The {windows} windows of {named} differ by more than sampling error explains"
        " ({probability}){gaps}. A further window may differ as much: use the interval for one."
    )

    vehicles: tuple[int, ...]
    windows: int
    probability: float
    """The largest of these followers."""
    spread: Seconds | None
    """Largest difference between a follower's windows' own time gaps, at the answer's
    `stated_speed`; None where fewer than two have one."""

    def _words(self, about: Labelled) -> Words:
        known = self.spread is not None
        gaps = f", their time gaps by up to {self.spread:.2f} s" if known else ""
        named = _named(self.vehicles, about)
        return {"probability": p_value(self.probability), "gaps": gaps, "named": named}


class HeterogeneousFollowers(Finding, frozen=True):
    """Followers that share their parameters differ by more than sampling error explains."""

    text = (
        "The {followers} followers differ by more than sampling error explains ({probability}, in"
        " the first window); Case II gives each its own parameters."
    )

    followers: int
    probability: float
    """In the first window."""

    def _words(self, about: Labelled) -> Words:
        return {"probability": p_value(self.probability)}


class DrawnToOthers(Finding, frozen=True):
    """Parameters of some followers' answer lie beyond the intervals of all their windows."""

    text = "Drawn towards other cars, beyond what each window alone says: {which}."

    away: tuple[tuple[str, tuple[int, ...]], ...]
    """Parameters, as "β and d", and the vehicles."""

    def _words(self, about: Labelled) -> Words:
        said = (f"{name} of {_named(who, about)}" for name, who in self.away)
        return {"which": "; ".join(said)}


def _named(vehicles: Sequence[int], about: Labelled) -> str:
    return joined([about.label(number) if number else "all followers" for number in vehicles])


AnswerFinding = HeterogeneousWindows | HeterogeneousFollowers | DrawnToOthers


@dataclass(frozen=True)
class Span(Quantity):
    """A value with its interval as the car's typical one, and the interval in a further window."""

    further_lower: float
    further_upper: float

    @classmethod
    def of(cls, parts: Sequence[FloatArray], level: float) -> Self:
        """From the value (), draws (n,) of the typical one and draws (n,) in a further window."""
        value, typical, further = parts
        ends = [end for drawn in (typical, further) for end in interval_ends(drawn, level)]
        return cls(float(value), *map(float, ends))


@dataclass(frozen=True, eq=False)
class Answer:
    """The parameters of M followers over K windows; nan for a follower that is not determined."""

    model: str
    level: float
    speeds: FloatArray
    """(M,) each follower's median speed in m/s over the windows."""
    driven: FloatArray
    """(2, M) each follower's lowest and highest speed in m/s over the windows."""
    parameters: Parameters
    """(M,) the complete parameter set of each follower; of a model that is no CTHP beside its
    linearisation at the follower's median speed."""
    typical: Parameters
    """(n, M) draws of the typical value."""
    further: Parameters
    """(n, M) draws of what a further window has."""
    windows: Parameters
    """(K, M) the maximum-likelihood estimate of each window by itself."""
    windows_lower: Parameters
    """(K, M) lower ends of the windows' own intervals."""
    windows_upper: Parameters
    """(K, M) upper ends."""
    windows_gap: FloatArray
    """(2, K, M) ends of the windows' own intervals of the time gap at `stated_speed`."""
    differ: FloatArray
    """(M,) probability that windows differ as much by sampling error alone; nan for one window, and
    under a model that is no CTHP."""
    trust: tuple[Trust, ...]
    """What its own windows say of each follower's answer; one where all share it."""
    findings: tuple[AnswerFinding, ...]

    def __repr__(self) -> str:
        """Model, number of windows, and each follower's time gap."""
        speed, count = self.stated_speed, len(self.windows)
        gaps = [self.time_gap(speed, k) for k in range(len(self.speeds))]
        said = ", ".join(f"{gap.value:.2f} s ({gap.lower:.2f}–{gap.upper:.2f})" for gap in gaps)
        windows = "1 window" if count == 1 else f"{count} windows"
        return f"<Answer: {self.model}, {windows}; time gap at {3.6 * speed:.0f} km/h: {said}>"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the model's parameters, as `Parameters` or the model has them."""
        return FOLLOWING[self.model].names

    @property
    def stated_speed(self) -> MetresPerSecond:
        """The highest of `SPEEDS` up to the speed that every follower reached.

        It is the lowest where that is none, or where the followers' median speed is below it.
        """
        return _stated(self.speeds, self.driven)

    def is_driven(self, speed: MetresPerSecond, follower: int) -> bool:
        """Whether a follower's windows hold a speed; what is said of another is extrapolated."""
        low, high = self.driven[:, follower]
        return bool(low <= speed <= high)

    def span(self, name: str, follower: int) -> Span:
        """One parameter of one follower, by its name; see `names`.

        Raises:
            ConfigError: for another name or follower.
        """
        if name not in self.names:
            raise ConfigError(
                f"span: {name[:40]} is not known; choose from {', '.join(self.names)}."
            )
        return self._span((name,), follower, lambda sets: self.values(sets, name))

    def gain(self, name: str, follower: int) -> Span:
        """The α or β of one follower; of a model that is no CTHP at its median speed."""
        return self._span(("gain", name), follower, lambda sets: getattr(sets, name))

    def gains_and_gap(self, follower: int) -> tuple[Span, Span, Span]:
        """α, β and the time gap at the median speed of one follower (0 for the first)."""
        gap = self.time_gap(float(self.speeds[follower]), follower)
        return self.gain("alpha", follower), self.gain("beta", follower), gap

    def values(self, sets: Parameters, name: str) -> FloatArray:
        """(..) one parameter by its name, of some of the answer's sets (..)."""
        return value_of(self.model, sets, name)

    def time_gap(self, speed: MetresPerSecond, follower: int) -> Span:
        """The time gap of one follower in equilibrium at a speed, in s; nan where there is none."""
        return self._span((speed,), follower, lambda sets: time_gap(self.model, sets, speed))

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """What follows from the typical value: probabilities of string stability, gains, bands."""
        return from_draws(self.parameters, self.typical, self.level)

    def without_draws(self) -> Self:
        """The same with the ends of its intervals in place of draws, as for a comparison."""
        ends = (
            Parameters.of(np.array(interval_ends(drawn.everything, self.level)))
            for drawn in (self.typical, self.further)
        )
        typical, further = ends
        return replace(self, typical=typical, further=further)

    @cached_property
    def _spans(self) -> dict[tuple[object, ...], Span]:
        """Those asked for so far: pages ask for the same again and again."""
        return {}

    def _span(
        self, what: tuple[object, ...], follower: int, of: Callable[[Parameters], FloatArray]
    ) -> Span:
        key = (*what, follower)
        if not 0 <= follower < len(self.speeds):
            raise ConfigError(
                f"follower: {follower} is not there; choose 0 to {len(self.speeds) - 1}, the first"
                " is 0."
            )
        if key not in self._spans:
            parts = self.parameters, self.typical, self.further
            self._spans[key] = Span.of([of(sets)[..., follower] for sets in parts], self.level)
        return self._spans[key]


def answer(
    segments: Sequence[Segment],
    case: Case = "II",
    model: str = BEST,
    held: Mapping[str, float] | None = None,
) -> Answer:
    """Find the answer of the vehicles in some windows; takes about a second for five minutes.

    Args:
        segments: (K,) the windows, of the same vehicles with the same step.
        case: "I" for one parameter set, "II" for one per follower.
        model: whose parameters.
        held: terms of the model that keep their values, as {"s0": 4.0}.

    Raises:
        ConfigError: for a term that the model does not have.
    """
    return _answer(tuple(segments), case, ModelSpec.of(model, held))


@lru_cache(maxsize=64)
@one_thread
def _answer(segments: tuple[Segment, ...], case: Case, spec: ModelSpec) -> Answer:
    model, windows = spec.model, [window_posterior(segment, case, spec) for segment in segments]
    speeds, followers = median_speeds(segments), range(segments[0].followers)
    drawn = np.array([window.drawn for window in windows])
    likely = np.array([window.likely for window in windows])
    for some in (drawn, likely):
        for row, k in np.ndindex(some.shape[:2]):
            some[row, k] = possible(model, some[row, k], float(speeds[k]))
    alone = parameters_of(model, np.moveaxis(drawn, 2, 0), speeds)
    lower, upper = interval_ends(alone.everything, LEVEL)
    estimates = Parameters.of(np.array([window.estimates for window in windows]))
    if model not in CTHPS:
        estimates = FOLLOWING[model].linearisations(np.moveaxis(estimates.own, -1, 0), speeds)
    cars = [car_of(likely[:, k], spec) for k in followers]
    differ = np.array([_heterogeneity(drawn[:, k], model) for k in followers])
    vehicles = (0,) if segments[0].shares(case) else segments[0].vehicles[1:]

    def at_speeds(phi: Sequence[FloatArray]) -> Parameters:
        """(.., M) from coordinates (.., p) of each of M followers."""
        usable = [
            possible(model, part, float(speed)) if part.ndim > 1 else part
            for part, speed in zip(phi, speeds, strict=True)
        ]
        return parameters_of(model, np.stack(usable, axis=-2), speeds)

    ends = [(s.speeds[:, 1:].min(axis=0), s.speeds[:, 1:].max(axis=0)) for s in segments]
    driven = np.array([np.min(ends, axis=0)[0], np.max(ends, axis=0)[1]])
    parameters, gap_at = at_speeds([car.middle for car in cars]), _stated(speeds, driven)
    rows = [list(followers)] if case == "I" else [[k] for k in followers]
    gaps = time_gap(model, estimates, gap_at)
    known = np.isfinite(gaps)  # a window without gap control has none
    # The ends are those of draws beside the estimates, which may be bounds.
    low = Parameters.of(np.fmin(estimates.everything, lower))
    high = Parameters.of(np.fmax(estimates.everything, upper))
    gap_low, gap_high = interval_ends(time_gap(model, alone, gap_at), LEVEL)
    spreads = [
        float(np.ptp(column[kept])) if kept.sum() > 1 else None
        for column, kept in zip(gaps.T, known.T, strict=True)
    ]
    drawn_away: dict[str, tuple[int, ...]] = {}
    for vehicle, row in zip(vehicles, rows, strict=True):
        if symbols := _drawn_away(model, parameters, low, high, row[0]):
            drawn_away[symbols] = (*drawn_away.get(symbols, ()), vehicle)
    return Answer(
        model=model,
        level=LEVEL,
        speeds=speeds,
        driven=driven,
        parameters=parameters,
        typical=at_speeds([car.value for car in cars]),
        further=at_speeds([car.further for car in cars]),
        windows=estimates,
        windows_lower=low,
        windows_upper=high,
        windows_gap=np.array([np.fmin(gaps, gap_low), np.fmax(gaps, gap_high)]),
        differ=differ,
        trust=tuple(
            trust(
                segments,
                vehicle,
                row,
                model,
                parameters[row[0]],
                estimates[:, row[0]],
                gap_at,
            )
            for vehicle, row in zip(vehicles, rows, strict=True)
        ),
        findings=(
            *_unlike_windows(vehicles, len(segments), differ, spreads),
            *((DrawnToOthers(tuple(drawn_away.items())),) if drawn_away else ()),
            *(_unlike_followers(segments[0], spec) if segments[0].shares(case) else ()),
        ),
    )


def _drawn_away(
    model: str, answer: Parameters, lower: Parameters, upper: Parameters, follower: int
) -> str:
    """Symbols of a follower's parameters (M,) beyond the known intervals (K, M) of its windows."""
    parts = []
    for parameter in FOLLOWING[model].parameters:
        value, low, high = (
            value_of(model, sets, parameter.name)[..., follower] for sets in (answer, lower, upper)
        )
        known = np.isfinite(low) & np.isfinite(high)
        if known.any() and ((value < low[known]).all() or (value > high[known]).all()):
            parts.append(parameter.symbol)
    return joined(parts)


def _stated(speeds: FloatArray, driven: FloatArray) -> MetresPerSecond:
    held = [speed for speed in SPEEDS if speed <= driven[1].min()]
    return SPEEDS[0] if np.median(speeds) < SPEEDS[0] or not held else held[-1]


def car_of(drawn: FloatArray, spec: ModelSpec) -> Car:
    """Sample the typical value of one follower, and how its windows differ.

    The draws (K, n, p) of its windows are φ under the prior that other cars give, as
    `WindowPosterior.likely`; nan for a window that does not determine it.
    """
    # In one order in memory, so that sums round alike wherever the draws come from.
    drawn = np.array(drawn[np.isfinite(drawn).all(axis=(1, 2))], order="C")
    size, count = CHAINS * KEPT, count_of(spec.model)
    if not len(drawn):
        nothing = np.full((size, count), np.nan)
        return Car(nothing, np.full((size, count, count), np.nan), nothing)
    free, prior = free_of(spec), log_prior_of_likely(spec, drawn)
    population = population_of(spec.model, count).of(free)
    left_out = min(LEFT_OUT * len(drawn), MOST_LEFT_OUT)
    sampled = sampled_population(drawn[..., free], prior, population, left_out=left_out)
    value, further = np.tile(drawn[0, 0], (2, size, 1))
    value[:, free], further[:, free] = sampled.value, sampled.further
    covariance = np.zeros((size, count, count))
    covariance[:, np.outer(free, free)] = sampled.covariance.reshape(size, -1)
    return Car(value, covariance, further)


def _unlike_windows(
    vehicles: Sequence[int], count: int, differ: FloatArray, spreads: Sequence[float | None]
) -> Iterator[HeterogeneousWindows]:
    """The followers whose windows differ, in one finding."""
    unlike = [k for k in range(len(vehicles)) if differ[k] < SIGNIFICANCE]
    if unlike:
        known = [spread for k in unlike if (spread := spreads[k]) is not None]
        numbers, most = tuple(vehicles[k] for k in unlike), float(differ[unlike].max())
        yield HeterogeneousWindows(numbers, count, most, max(known, default=None))


def _unlike_followers(segment: Segment, spec: ModelSpec) -> Iterator[AnswerFinding]:
    """Whether followers of Case I differ, from what each says by itself."""
    probability = _heterogeneity(window_posterior(segment, "II", spec).drawn, spec.model)
    if probability < SIGNIFICANCE:
        yield HeterogeneousFollowers(segment.followers, probability)


def _heterogeneity(drawn: FloatArray, model: str) -> float:
    """Probability of windows that differ as much by sampling error alone; nan for one window.

    It is that of Cochran's Q in p coordinates, from draws (K, n, p), which are taken as normal in
    each window. Followers in place of windows are compared in the same way. A window alone under a
    model that is no CTHP has too narrow a distribution for that (docs/validation.md), so of these
    nothing is said.
    """
    if model not in CTHPS:
        return float("nan")
    drawn = drawn[np.isfinite(drawn).all(axis=(1, 2))]
    free = np.ptp(drawn, axis=(0, 1)) > 0 if len(drawn) else np.zeros(drawn.shape[-1], bool)
    if len(drawn) < 2 or not free.any():
        return float("nan")
    means = drawn[..., free].mean(axis=1)
    precisions = np.array([np.linalg.inv(np.cov(rows[:, free].T)) for rows in drawn])
    pooled = np.linalg.solve(precisions.sum(axis=0), np.einsum("kij,kj->i", precisions, means))
    away = means - pooled
    q = float(np.einsum("ki,kij,kj->", away, precisions, away))
    return float(chdtrc((len(means) - 1) * int(free.sum()), q))
