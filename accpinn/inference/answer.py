"""The answer: one complete parameter set a vehicle, with its interval as the car's typical value.

The windows of a recording are estimated one by one under the exact likelihood (see
`methods.maximum_likelihood`). Their posteriors, and what many cars taught about how windows differ,
give the typical value of the car and its interval, and the interval that a further window's
parameters have (see `inference.population`). Everything that shows, simulates, judges or exports
"the answer" takes it from here.

The headline is the time gap in equilibrium, τ + s₀/v, at a stated speed: the data determine it,
while τ and s₀ may trade off against each other.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple, Self

import numpy as np
from scipy.special import chdtrc

from accpinn.errors import ConfigError
from accpinn.findings import Finding
from accpinn.inference.intervals import LEVEL, Uncertainty, from_draws, interval_ends
from accpinn.inference.population import CHAINS, KEPT, POPULATIONS, WITHIN, sampled_population
from accpinn.inference.posterior import AT_SPEED, features, log_prior_of_features, sample
from accpinn.inference.trust import Trust, trust
from accpinn.methods.likelihood import Held, Maximum
from accpinn.methods.maximum_likelihood import further_maxima, joint_maxima
from accpinn.methods.method import one_thread
from accpinn.methods.series import determined_followers, series_of
from accpinn.methods.state_space import EXTRA, complete
from accpinn.model.cthp import Case, Parameters
from accpinn.model.models import BEST, TERMS, Model, terms_of
from accpinn.segment.segment import Segment
from accpinn.stability.criteria import exact_margin, l2_margin
from accpinn.units import FloatArray, MetresPerSecond, Seconds

STAGES = (150, 150, 500)
"""Draws in each stage of a window's posterior."""
DRAWS = 400
"""Draws of equal weight that stand for a window's posterior."""
EVERY = 2
"""Draws of the typical value of which one is kept."""
JUDGED = 200
"""Draws that string stability is judged by."""
SPEEDS: tuple[MetresPerSecond, ...] = (50 / 3.6, 100 / 3.6)
"""Speeds at which the time gap is stated, beside the median speed."""
SIGNIFICANCE = 0.05
"""Below this probability under equal parameters, windows are said to differ."""


class HeterogeneousWindows(Finding, frozen=True):
    """A follower's windows differ by more than sampling error explains."""

    text = (
        "{vehicle}: its {windows} windows differ by more than sampling error explains (p ="
        " {probability:.2g}), so a further window may differ as much: use the interval for one."
    )

    vehicle: int
    """0 for all followers together."""
    windows: int
    probability: float


@dataclass(frozen=True)
class Span:
    """A value with its interval as the car's typical one, and the interval in a further window."""

    value: float
    lower: float
    upper: float
    further_lower: float
    further_upper: float


@dataclass(frozen=True, eq=False)
class Answer:
    """The parameters of M followers over K windows; nan for a follower that is not determined."""

    model: Model
    level: float
    speeds: FloatArray
    """(M,) each follower's median speed in m/s over the windows."""
    parameters: Parameters
    """(M,) the complete parameter set of each follower."""
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
    """(M,) probability that windows differ as much by sampling error alone; nan for one window."""
    trust: tuple[Trust, ...]
    """What its own windows say of each follower's answer; one where all share it."""
    findings: tuple[HeterogeneousWindows, ...]
    seconds: Seconds

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the model's parameters, as `Parameters` has them."""
        return ("alpha", "beta", "tau", *terms_of(self.model))

    @property
    def stated_speed(self) -> MetresPerSecond:
        """The highest of `SPEEDS`; the lowest where the followers' median speed is below it."""
        return _stated(self.speeds)

    def span(self, name: str, follower: int) -> Span:
        """One parameter of one follower, by its name in `Parameters`."""
        return self._span([getattr(part, name) for part in self._parts], follower)

    def time_gap(self, speed: MetresPerSecond, follower: int) -> Span:
        """The time gap of one follower in equilibrium at a speed, in s."""
        return self._span([part.time_gap(speed) for part in self._parts], follower)

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """What follows from the typical value: probabilities of string stability, gains, bands."""
        count = len(self.typical.alpha)
        some = self.typical[np.linspace(0, count - 1, min(count, JUDGED)).astype(int)]
        drawn = from_draws(self.parameters, some, self.level)
        ends = interval_ends(self.typical.complete, self.level)
        return replace(drawn, lower=Parameters.of(ends[0]), upper=Parameters.of(ends[1]))

    def without_draws(self) -> Self:
        """The same with the ends of its intervals in place of draws, as for a comparison."""
        ends = (
            Parameters.of(np.array(interval_ends(drawn.complete, self.level)))
            for drawn in (self.typical, self.further)
        )
        typical, further = ends
        return replace(self, typical=typical, further=further)

    @property
    def _parts(self) -> tuple[Parameters, Parameters, Parameters]:
        return self.parameters, self.typical, self.further

    def _span(self, parts: Sequence[FloatArray], follower: int) -> Span:
        value, typical, further = parts
        ends = [interval_ends(drawn[:, follower], self.level) for drawn in (typical, further)]
        return Span(float(value[follower]), *(float(end) for pair in ends for end in pair))


def answer(
    segments: Sequence[Segment],
    case: Case = "II",
    model: Model = BEST,
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
    return _answer(tuple(segments), case, model, checked_held(model, held or {}))


def checked_held(model: Model, held: Mapping[str, float]) -> Held:
    """The terms that keep their values, in the order of their names.

    Raises:
        ConfigError: for a term that the model does not have, or a value outside its range.
    """
    for name, value in held.items():
        if name not in terms_of(model):
            known = ", ".join(terms_of(model)) or "no term"
            raise ConfigError(f"hold: {name[:20]} cannot be held; {model} has {known} to hold.")
        least, most = next(EXTRA[term] for term in TERMS if term == name).bounds
        if not least <= value <= most:
            allowed = f"{least:g} to {most:g}"
            raise ConfigError(f"hold: {name} = {value:g} is not allowed; choose {allowed}.")
    return tuple(sorted((name, float(value)) for name, value in held.items()))


@dataclass(frozen=True, eq=False)
class WindowPosterior:
    """What one window alone says of its M followers; nan for one that it does not determine."""

    estimates: FloatArray
    """(M, 6) complete parameters of greatest likelihood."""
    drawn: FloatArray
    """(M, n, p) draws of `features` of equal weight from the posterior."""
    log_likelihood: FloatArray
    """(M, n) of the window's data at each draw; shared by all followers in Case I."""
    model: Model

    @cached_property
    def stable(self) -> tuple[FloatArray, FloatArray]:
        """(M,) the probabilities of L₂ and of L∞ string stability."""
        some = Parameters.of(from_features(self.model, self.drawn[:, :: DRAWS // JUDGED]))
        unknown = np.isnan(self.estimates[:, 0])
        l2, linf = ((margin(some) >= 0).mean(axis=1) for margin in (l2_margin, exact_margin))
        return np.where(unknown, np.nan, l2), np.where(unknown, np.nan, linf)


@lru_cache(maxsize=256)
@one_thread
def window_posterior(
    segment: Segment, case: Case, model: Model, held: Held = ()
) -> WindowPosterior:
    """The posterior of each follower of one window under a model, with some terms held."""
    followers = segment.followers
    estimates = np.full((followers, 6), np.nan)
    drawn = np.full((followers, DRAWS, 3 + len(terms_of(model))), np.nan)
    log_likelihood = np.full((followers, DRAWS), np.nan)
    known = determined_followers((segment,), case)
    if known:
        series = series_of([segment], case, known)
        cthp = joint_maxima((segment,), case, followers=known)
        maxima = further_maxima(series, model, cthp, held)
        posteriors = sample(series, maxima, model, held=held, stages=STAGES)
        rows = [np.array(known)] if case == "I" else [np.array([k]) for k in known]
        for row, maximum, posterior in zip(rows, maxima, posteriors, strict=True):
            estimates[row] = _own(model, maximum)
            drawn[row] = features(model, posterior.all_evenly(DRAWS))
            log_likelihood[row] = posterior.log_likelihood_evenly(DRAWS)
    return WindowPosterior(estimates, drawn, log_likelihood, model)


@lru_cache(maxsize=64)
@one_thread
def _answer(segments: tuple[Segment, ...], case: Case, model: Model, held: Held) -> Answer:
    started = time.perf_counter()
    windows = [window_posterior(segment, case, model, held) for segment in segments]
    own = np.array([window.estimates for window in windows])
    drawn = np.array([window.drawn for window in windows])
    alone = np.moveaxis(from_features(model, drawn), 2, 0)
    lower, upper = interval_ends(alone, LEVEL)
    speeds = np.median(np.concatenate([s.speeds[:, 1:] for s in segments]), axis=0)
    followers = range(segments[0].followers)
    cars = [car_of(drawn[:, k], model, held) for k in followers]
    differ = np.array([_heterogeneity(drawn[:, k]) for k in followers])
    vehicles = (0,) if case == "I" else segments[0].vehicles[1:]
    parameters, estimates = _parameters(model, [car.middle for car in cars]), Parameters.of(own)
    rows = [list(followers)] if case == "I" else [[k] for k in followers]
    return Answer(
        model=model,
        level=LEVEL,
        speeds=speeds,
        parameters=parameters,
        typical=_parameters(model, [car.value for car in cars]),
        further=_parameters(model, [car.further for car in cars]),
        windows=estimates,
        windows_lower=Parameters.of(np.where(own == 0.0, 0.0, lower)),
        windows_upper=Parameters.of(upper),
        windows_gap=np.array(interval_ends(Parameters.of(alone).time_gap(_stated(speeds)), LEVEL)),
        differ=differ,
        trust=tuple(
            trust(segments, vehicle, row, parameters[row[0]], estimates[:, row[0]])
            for vehicle, row in zip(vehicles, rows, strict=True)
        ),
        findings=tuple(
            HeterogeneousWindows(vehicle, len(segments), float(p))
            for vehicle, p in zip(vehicles, differ, strict=False)
            if p < SIGNIFICANCE
        ),
        seconds=time.perf_counter() - started,
    )


def _parameters(model: Model, phi: Sequence[FloatArray]) -> Parameters:
    """(.., M) from `features` (.., p) of each of M followers."""
    return Parameters.of(from_features(model, np.stack(phi, axis=-2)))


def _stated(speeds: FloatArray) -> MetresPerSecond:
    return SPEEDS[0] if np.median(speeds) < SPEEDS[0] else SPEEDS[-1]


class Car(NamedTuple):
    """What the windows of one follower say together, in the p coordinates of `features`."""

    middle: FloatArray
    """(p,) its typical value: the mean of the draws."""
    value: FloatArray
    """(n, p) draws of the typical value."""
    further: FloatArray
    """(n, p) draws of what a further window has."""
    covariance: FloatArray
    """(n, p, p) draws of how windows differ: of their scale matrix, such that 68 % of windows lie
    within the root of its diagonal; zero for what is held."""


def car_of(drawn: FloatArray, model: Model, held: Held = ()) -> Car:
    """Sample the typical value of one follower, and how its windows differ.

    Args:
        drawn: (K, n, p) draws of its windows; nan for a window that does not determine it.
        model: whose `features` they are.
        held: terms that keep their values.
    """
    # In one order in memory, so that sums round alike wherever the draws come from.
    drawn = np.array(drawn[np.isfinite(drawn).all(axis=(1, 2))], order="C")
    size, count = CHAINS * KEPT // EVERY, 3 + len(terms_of(model))
    if not len(drawn):
        nothing = np.full((size, count), np.nan)
        return Car(nothing[0], nothing, nothing, np.full((size, count, count), np.nan))
    fixed = [name for name, _ in held]
    free = np.array([True] * 3 + [term not in fixed for term in terms_of(model)])
    prior = log_prior_of_features(model, drawn)
    sampled = sampled_population(drawn[..., free], prior, POPULATIONS[model].of(free))
    value, further = np.tile(drawn[0, 0], (2, size, 1))
    value[:, free], further[:, free] = sampled.value[::EVERY], sampled.further[::EVERY]
    covariance = np.zeros((size, count, count))
    covariance[:, np.outer(free, free)] = WITHIN**2 * sampled.covariance[::EVERY].reshape(size, -1)
    return Car(middle_of(value), value, further, covariance)


def middle_of(drawn: FloatArray) -> FloatArray:
    """(p,) the mean of draws (n, p); a mean of equal values may round, so it lies among them."""
    return np.asarray(np.clip(drawn.mean(axis=0), drawn.min(axis=0), drawn.max(axis=0)))


def from_features(model: Model, phi: FloatArray) -> FloatArray:
    """(.., 6) complete parameters from `features` (.., p)."""
    complete = np.zeros((*phi.shape[:-1], 6))
    complete[..., 0], complete[..., 1] = np.exp(phi[..., 0]), np.exp(phi[..., 1])
    for at, term in enumerate(terms_of(model), 3):
        least = -np.inf if term == "s0" else 0.0
        complete[..., 3 + TERMS.index(term)] = np.maximum(phi[..., at], least)
    complete[..., 2] = np.maximum(np.exp(phi[..., 2]) - complete[..., 3] / AT_SPEED, 0.0)
    return complete


def _own(model: Model, maximum: Maximum) -> FloatArray:
    """(6,) the complete parameters of a maximum; those at their least value are 0."""
    return complete(model, np.append(maximum.theta, maximum.values[3:]))


def _heterogeneity(drawn: FloatArray) -> float:
    """Probability of windows that differ as much by sampling error alone; nan for one window.

    It is that of Cochran's Q in p coordinates, from draws (K, n, p), which are taken as normal in
    each window.
    """
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
