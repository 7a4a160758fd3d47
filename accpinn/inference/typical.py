"""The posterior of an estimate: intervals of each vehicle's typical value, and of a further window.

The point of an estimate is the parameter set that all its windows support together. Windows of one
car differ, so its interval must count how much: each window is estimated by itself (see
`inference.window_posterior`), and these posteriors, with what many cars taught about how windows
differ, give draws of the typical value of the vehicle and of what a further window has (see
`inference.population`). The draws give intervals, probabilities and bands, and nothing else: their
mean along a curved ridge is no parameter set that anything supports.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import compress

import numpy as np
from scipy.special import chdtrc

from accpinn.findings import Finding, Labelled, Words, joined, p_value
from accpinn.inference.coordinates import coordinates_of, free_of, log_prior_of_likely
from accpinn.inference.intervals import FEW, LEVEL, effective_draws, within
from accpinn.inference.population import CHAINS, KEPT, Car, sampled_population
from accpinn.inference.window_posterior import WindowPosterior, window_posterior
from accpinn.methods import PosteriorKind, Segments, one_thread, simulation
from accpinn.methods.estimate import Estimate, Posterior
from accpinn.methods.forecast import INTERVALS, VARIATION, Phase
from accpinn.model.cthp import Parameters
from accpinn.model.registry import PAPER, time_gap, value_of
from accpinn.model.spec import ModelSpec
from accpinn.units import FloatArray, Seconds, interval_ends

LEFT_OUT, MOST_LEFT_OUT = 5, 150
"""Rounds of a chain that are left out for each window, and at most: many weak ones move it slowly.
Of 22 windows s₀ was still half a deviation away after 20 rounds."""
SHARES = np.linspace(0.0, 1.0, 11)
"""λ."""
SIGNIFICANCE = 0.05
"""Below this probability under equal parameters, windows are said to differ."""
EXACT = "posterior of the exact likelihood, and how windows of many cars differ"
BY_SIMULATION = "normal approximation in closed loop, and how windows of many cars differ"
"""The method of drawing, in words, by the source of a window's posterior."""


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
    """Largest difference between a follower's windows' own time gaps, at the estimate's
    `stated_speed`; None where fewer than two have one."""

    def _words(self, about: Labelled) -> Words:
        has_gaps = self.spread is not None
        gaps = f", their time gaps by up to {self.spread:.2f} s" if has_gaps else ""
        labels = [about.label(number) if number else "all followers" for number in self.vehicles]
        return {
            "probability": p_value(self.probability), "gaps": gaps, "named": joined(labels),
        }  # fmt: skip


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


class OutsideInterval(Finding, frozen=True):
    """The estimate of all windows together lies outside the interval of the typical value."""

    text = (
        "{vehicle}: the estimate's {named} outside the interval, as the windows differ or say"
        " little: the interval weighs each window, and what other cars have, where the estimate"
        " takes all windows as one."
    )

    vehicle: int
    symbols: tuple[str, ...]

    def _words(self, about: Labelled) -> Words:
        verb = "lies" if len(self.symbols) == 1 else "lie"
        return {"named": f"{joined(self.symbols)} {verb}"}


class NotDetermined(Finding, frozen=True):
    """The windows are too short for a follower's parameters, or nothing moves in them."""

    text = (
        "{vehicle}: these data do not determine the parameters; choose a longer window, or one in"
        " which the vehicle ahead brakes and accelerates."
    )

    vehicle: int


class FewDraws(Finding, frozen=True):
    """The draws of a window's posterior are worth few independent ones."""

    text = (
        "{vehicle}: the draws of a window's posterior are worth only {draws} independent ones, as"
        " the likelihood has a long tail or several maxima there: intervals and probabilities are"
        " rough."
    )

    vehicle: int
    draws: int


PosteriorFinding = (
    HeterogeneousWindows | HeterogeneousFollowers | OutsideInterval | NotDetermined | FewDraws
)


@one_thread
def with_posterior(
    estimate: Estimate,
    segments: Segments,
    kind: PosteriorKind,
    *,
    on_step: Callable[[str, int, int], object] | None = None,
    should_stop: Callable[[], bool] | None = None,
    level: float = LEVEL,
) -> Estimate:
    """The estimate with its posterior, and with each window's own parameters.

    Args:
        estimate: the point.
        segments: (K,) the windows that it is of.
        kind: what the posterior of a window comes from.
        on_step: called with the phase, and how many of its windows or followers are done.
        should_stop: asked before each window; True leaves the estimate without a posterior.
        level: share of the intervals that are to cover the truth.
    """
    spec, case, model = estimate.spec, estimate.case, estimate.model
    space = coordinates_of(model)
    step = on_step or (lambda *_: None)
    windows: list[WindowPosterior] = []
    for done, segment in enumerate(segments):
        step(INTERVALS, done, len(segments))
        if should_stop and should_stop():
            return estimate
        windows.append(window_posterior(segment, case, spec, kind))
    step(INTERVALS, len(segments), len(segments))
    speeds, followers = estimate.speeds, range(segments[0].followers)
    drawn = np.array([window.drawn for window in windows])
    likely = np.array([window.likely for window in windows])
    for some in (drawn, likely):
        for row, k in np.ndindex(some.shape[:2]):
            some[row, k] = space.possible(some[row, k], float(speeds[k]))
    alone = space.parameters(np.moveaxis(drawn, 2, 0), speeds)
    lower, upper = interval_ends(alone.everything, level)
    by_window = Parameters.of(np.array([window.estimates for window in windows]))
    if not estimate.following.is_linear:
        theta = np.moveaxis(by_window.nonlinear, -1, 0)
        by_window = estimate.following.linearisations(theta, speeds)
    cars: list[Car] = []
    for k in followers:
        step(VARIATION, k, len(followers))
        if should_stop and should_stop():
            return estimate
        cars.append(_around(car_of(likely[:, k], spec), estimate, k, level))

    def at_speeds(phi: Sequence[FloatArray]) -> Parameters:
        """(n, M) from coordinates (n, p) of each of M followers."""
        usable = [
            space.possible(part, float(speed)) for part, speed in zip(phi, speeds, strict=True)
        ]
        return space.parameters(np.stack(usable, axis=-2), speeds)

    # The ends are those of draws beside the estimates, which may be bounds.
    low = Parameters.of(np.fmin(by_window.everything, lower))
    high = Parameters.of(np.fmax(by_window.everything, upper))
    gaps = time_gap(model, by_window, estimate.stated_speed)
    gap_low, gap_high = interval_ends(time_gap(model, alone, estimate.stated_speed), level)
    is_shared = segments[0].shares(case)
    posterior = Posterior(
        method=EXACT if kind == "likelihood" else BY_SIMULATION,
        level=level,
        typical=at_speeds([car.value for car in cars]),
        further=at_speeds([car.further for car in cars]),
        windows_lower=low,
        windows_upper=high,
        windows_gap=np.array([np.fmin(gaps, gap_low), np.fmax(gaps, gap_high)]),
        differ=np.array([_heterogeneity(drawn[:, k], spec) for k in followers]),
        draws=np.min([[effective_draws(rows[:, 0]) for rows in some] for some in likely], axis=0),
        followers_differ=(
            _heterogeneity(window_posterior(segments[0], "II", spec, kind).drawn, spec)
            if is_shared
            else float("nan")
        ),
    )
    return replace(estimate, posterior=posterior, windows=by_window)


def posterior_phases(
    segments: Segments, spec: ModelSpec, kind: PosteriorKind
) -> Mapping[str, Phase]:
    """The phases of `with_posterior`."""
    windows, followers = len(segments), segments[0].followers
    each = (0.14 if spec.model != PAPER else 0.1) * followers
    if kind == "simulation":  # each window is searched by itself
        alone = [simulation.round_seconds((segment,)) for segment in segments]
        each += simulation.USUAL_ROUNDS * sum(alone) / windows
    return {
        INTERVALS: Phase(windows, each),
        VARIATION: Phase(followers, 0.06 + 0.02 * windows),
    }


def posterior_findings(estimate: Estimate, vehicles: Sequence[int]) -> tuple[PosteriorFinding, ...]:
    """Findings about the posterior of an estimate; none for a point.

    The vehicles (M+1,) are numbers in the file, leader first.
    """
    posterior = estimate.posterior
    if posterior is None or estimate.windows is None:
        return ()
    is_shared = estimate.case == "I" and len(vehicles) > 2
    numbers = (0,) if is_shared else tuple(vehicles[1:])
    findings: list[PosteriorFinding] = [*_unlike_windows(estimate, posterior, numbers)]
    if posterior.followers_differ < SIGNIFICANCE:  # by their separate estimates
        findings.append(HeterogeneousFollowers(len(vehicles) - 1, posterior.followers_differ))
    return (*findings, *_of_followers(estimate, posterior, numbers))


def _unlike_windows(
    estimate: Estimate, posterior: Posterior, vehicles: Sequence[int]
) -> Iterator[HeterogeneousWindows]:
    """The followers whose windows differ, in one finding."""
    unlike = [k for k in range(len(vehicles)) if posterior.differ[k] < SIGNIFICANCE]
    if not unlike or estimate.windows is None:
        return
    gaps = time_gap(estimate.model, estimate.windows, estimate.stated_speed)[:, unlike]
    determined = [column[np.isfinite(column)] for column in gaps.T]
    spreads = [float(np.ptp(column)) for column in determined if len(column) > 1]
    numbers, most = tuple(vehicles[k] for k in unlike), float(posterior.differ[unlike].max())
    yield HeterogeneousWindows(numbers, len(gaps), most, max(spreads, default=None))


def _of_followers(
    estimate: Estimate, posterior: Posterior, vehicles: Sequence[int]
) -> Iterator[PosteriorFinding]:
    """Findings about single followers."""
    kinds = estimate.following.parameters
    sets = estimate.parameters, *interval_ends_of(posterior)
    value, low, high = (
        np.stack([value_of(estimate.model, part, kind.name) for kind in kinds], axis=1)
        for part in sets
    )  # (M, p)
    inside = within(value, low, high)
    for k, vehicle in enumerate(vehicles):
        if np.isnan(posterior.typical.alpha[:, k]).all():
            yield NotDetermined(vehicle)
        elif 1 < (effective := posterior.draws[k]) < FEW:
            yield FewDraws(vehicle, round(effective))
        if symbols := tuple(compress((kind.symbol for kind in kinds), ~inside[k])):
            yield OutsideInterval(vehicle, symbols)


def interval_ends_of(posterior: Posterior) -> tuple[Parameters, Parameters]:
    """(M,) lower and upper ends of the intervals of the typical value."""
    lower, upper = interval_ends(posterior.typical.everything, posterior.level)
    return Parameters.of(lower), Parameters.of(upper)


def car_of(drawn: FloatArray, spec: ModelSpec) -> Car:
    """Sample the typical value of one follower, and how its windows differ.

    The draws (K, n, p) of its windows are φ under the prior that other cars give, as
    `WindowPosterior.likely`; nan for a window that does not determine it.
    """
    # In one order in memory, so that sums round alike wherever the draws come from.
    drawn = np.array(drawn[np.isfinite(drawn).all(axis=(1, 2))], order="C")
    space = coordinates_of(spec.model)
    size, count = CHAINS * KEPT, space.count
    if not len(drawn):
        nothing = np.full((size, count), np.nan)
        return Car(nothing, np.full((size, count, count), np.nan), nothing)
    free, prior = free_of(spec), log_prior_of_likely(spec, drawn)
    population = space.population.of(free)
    left_out = min(LEFT_OUT * len(drawn), MOST_LEFT_OUT)
    sampled = sampled_population(drawn[..., free], prior, population, left_out=left_out)
    value, further = np.tile(drawn[0, 0], (2, size, 1))
    value[:, free], further[:, free] = sampled.value, sampled.further
    covariance = np.zeros((size, count, count))
    covariance[:, np.outer(free, free)] = sampled.covariance.reshape(size, -1)
    return Car(value, covariance, further)


def _around(car: Car, estimate: Estimate, follower: int, level: float) -> Car:
    """The draws of a car, moved towards the estimate as far as its intervals need; see the head."""
    space = coordinates_of(estimate.model)
    values = np.array([estimate.values(estimate.parameters, n)[follower] for n in estimate.names])
    if not (np.isfinite(values).all() and np.isfinite(car.value).all()):
        return car
    away = space.of_values(values) - car.value.mean(axis=0)
    for share in SHARES:
        value = car.value + share * away
        drawn = space.values(value)
        lower, upper = interval_ends(drawn, level)
        lower = np.where(values == 0.0, 0.0, lower)
        if ((lower <= values) & (values <= upper)).all():
            break
    return car._replace(value=value, further=car.further + share * away)


def _heterogeneity(drawn: FloatArray, spec: ModelSpec) -> float:
    """Probability of windows that differ as much by sampling error alone; nan for one window.

    It is that of Cochran's Q in p coordinates, from draws (K, n, p), which are taken as normal in
    each window. Followers in place of windows are compared in the same way. A window alone under a
    model that is no CTHP has too narrow a distribution for that (docs/validation.md), so of these
    nothing is said.
    """
    if not spec.following.is_linear:
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
