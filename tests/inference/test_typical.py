"""Estimates with a posterior: the truth from simulated windows, fixed terms, Case I and II."""

from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from accpinn import Parameters, Segment, cut
from accpinn.errors import ConfigError
from accpinn.inference.coordinates import (
    AT_SPEED,
    coordinates_of,
    log_prior_of_likely,
    of_others,
    time_gap_coordinates,
)
from accpinn.inference.intervals import effective_draws
from accpinn.inference.population import sampled_population
from accpinn.inference.posterior import log_prior_of_theta, sample
from accpinn.inference.typical import (
    HeterogeneousFollowers,
    HeterogeneousWindows,
    NotDetermined,
    OutsideInterval,
    interval_ends_of,
    posterior_findings,
    with_posterior,
)
from accpinn.inference.window_posterior import window_posterior
from accpinn.methods.estimate import Estimate
from accpinn.methods.findings import WeaklyDetermined
from accpinn.methods.joint_likelihood import joint_maxima
from accpinn.methods.likelihood import Criterion
from accpinn.methods.registry import METHODS
from accpinn.methods.series import series_of
from accpinn.model.registry import BEST, FOLLOWING, time_gap
from accpinn.model.spec import ModelSpec
from accpinn.recordings.openacc import read
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import standing_still
from tests.support.estimates import estimated

pytestmark = pytest.mark.usefixtures("all_draws")

ALPHA, BETA, TAU, S0 = 0.07, 0.3, 0.95, 7.0
"""A car near the middle of those that were learned from: an interval is nominal for a population
of cars, and a car far from its middle is pulled towards it."""

CONTRARY = [
    ("Cherasco/Cher-JRC_240918_rec1_part2.csv", 60.0, (1, 2)),
    ("Cherasco/Cher-JRC_240918_rec2_part1.csv", 296.3, (1, 2)),
    ("ZalaZone/dynamic_part10.csv", 120.0, (3, 4)),
]
"""Windows of real cars, and vehicles."""
ENDS = 0.05, 0.5, 0.95


@cache
def window(seed: int, tau: float, duration: float, **departure: float) -> Segment:
    """A recording of a car with s₀, disturbed as on real roads."""
    disturbance = Disturbance(standstill=S0, **departure)
    return disturbed(Parameters([ALPHA], BETA, tau), seed, disturbance, duration=duration)


def windows(
    seeds: range, tau: float = TAU, duration: float = 120.0, **departure: float
) -> list[Segment]:
    """Several of them; what is known of one is found again."""
    return [window(seed, tau, duration, **departure) for seed in seeds]


@cache
def usual() -> Estimate:
    return estimated(windows(range(3)), model="cthp-s0")


def findings_of(estimate: Estimate) -> tuple[object, ...]:
    """Findings about its posterior."""
    return posterior_findings(estimate, (1, *estimate.numbers))


def different_windows(estimate: Estimate) -> list[object]:
    return [f for f in findings_of(estimate) if isinstance(f, HeterogeneousWindows)]


@pytest.mark.parametrize(
    ("model", "departure"),
    [("cthp-s0", {}), ("cthp-s0-lag", {"lag": 0.5}), ("cthp-s0-delay", {"delay": 0.7})],
)
def test_the_truth_lies_in_the_intervals(model: str, departure: dict[str, float]) -> None:
    """Four windows of 120 s; 90 % intervals, and seeds with which all hold."""
    given = estimated(windows(range(20, 24), **departure), model=model)
    assert given.names == ("alpha", "beta", "tau", *FOLLOWING[model].terms)
    gap = given.time_gap(28.0, 0)
    spans = given.span("alpha", 0), given.span("beta", 0), gap
    for span, true in zip(spans, (ALPHA, BETA, TAU + S0 / 28.0), strict=True):
        assert span.lower <= true <= span.upper
    for term, true in {"s0": S0, **departure}.items():
        assert given.span(term, 0).further_lower <= true <= given.span(term, 0).further_upper
    assert gap.value == pytest.approx(TAU + S0 / 28.0, abs=0.08)
    assert 0.1 < gap.upper - gap.lower < 0.45


def test_an_estimate_lies_in_its_interval_and_a_further_window_varies_more() -> None:
    given = usual()
    for span in [given.span(name, 0) for name in given.names] + [given.time_gap(28.0, 0)]:
        assert span.lower < span.upper
        assert span.further_upper - span.further_lower > 1.1 * (span.upper - span.lower)
    ends = given.posterior.windows_lower.values, given.posterior.windows_upper.values
    assert ((ends[0] < given.windows.values) & (given.windows.values < ends[1])).mean() > 0.85


def test_where_s0_is_more_than_the_time_gap_the_gap_stays() -> None:
    phi = np.array([[np.log(0.1), np.log(0.4), np.log(gap), 20.0, 0.3] for gap in (0.5, 1.5)])
    parameters = coordinates_of("cthp-s0-delay").parameters(phi, 20.0)
    np.testing.assert_allclose(time_gap("cthp-s0-delay", parameters, AT_SPEED), [0.5, 1.5])
    np.testing.assert_allclose(parameters.tau, [0.0, 1.5 - 20.0 / AT_SPEED], atol=1e-12)


def test_the_end_of_the_ridge_is_sampled(openacc_dir: Path) -> None:
    """The likelihood is largest at τ = 0 and a short delay; before, 10 of 500 draws counted."""
    recording = read(openacc_dir / "ZalaZone" / "dynamic_part10.csv")
    segment = cut(recording, 300.0, 300.0, (1, 2))
    series, model = series_of((segment,), "II"), "cthp-s0-delay"
    maxima = joint_maxima((segment,), "II", ModelSpec(model))
    for seed in (0, 1):
        (posterior,) = sample(series, maxima, ModelSpec(model), (seed,))
        assert posterior.effective > 80


@pytest.mark.parametrize(("file", "start", "pair"), CONTRARY)
def test_draws_count_where_a_minute_contradicts_other_cars(
    openacc_dir: Path, file: str, start: float, pair: tuple[int, int]
) -> None:
    """At most 4,500 draws gave 6 to 474 effective ones here, by the seed."""
    segment = cut(read(openacc_dir / file), start, 60.0, pair)
    series, others = series_of((segment,), "II"), partial(of_others, ModelSpec(BEST))
    maxima = joint_maxima((segment,), "II", ModelSpec(BEST))
    for seed in (0, 1):
        (posterior,) = sample(series, maxima, ModelSpec(BEST), (seed,), others=others)
        pooled = posterior.under(others(posterior.coordinates))
        assert min(posterior.effective, pooled.effective) > 240
    # Of 400 draws of an IDM's window alone 19 to 66 counted in most.
    assert (
        effective_draws(
            window_posterior(segment, "II", ModelSpec("idm"), "simulation").likely[0, :, 0]
        )
        > 250
    )


def test_the_prior_under_which_windows_are_drawn_cancels() -> None:
    """Draws of a window alone and those beside other cars lead to the same answer."""
    window = window_posterior(windows(range(1))[0], "II", ModelSpec(BEST))
    alone, likely = window.drawn[0], window.likely[0]
    space = coordinates_of(BEST)
    priors = space.log_prior(alone), log_prior_of_likely(ModelSpec(BEST), likely)
    population = space.population
    ends = [
        np.quantile(sampled_population(drawn[None], prior[None], population).value, ENDS, axis=0)
        for drawn, prior in zip((alone, likely), priors, strict=True)
    ]
    assert (np.abs(ends[0] - ends[1]) < 0.3 * np.ptp(ends[0], axis=0)).all()


def test_one_window_has_an_interval_as_wide_as_windows_of_a_car_vary() -> None:
    """Σ₀'s deviation of ln α is .49, so 90 % of windows lie within 1.6 in ln α."""
    single, several = estimated(windows(range(1)), model="cthp-s0"), usual()
    widths = [
        np.log(a.span("alpha", 0).upper / a.span("alpha", 0).lower) for a in (single, several)
    ]
    assert 0.9 < widths[0] < 2.2
    assert widths[1] < 0.85 * widths[0]
    assert np.isnan(single.posterior.differ[0])


def test_a_fixed_parameter_of_an_idm_is_fixed_in_every_draw() -> None:
    posterior = window_posterior(
        windows(range(1), duration=60.0)[0], "II", ModelSpec("idm", (("v0", 100.0),)), "simulation"
    )
    scores = posterior.likely[0, :, FOLLOWING["idm"].names.index("v0")]
    assert np.unique(scores).size == 1
    assert effective_draws(posterior.likely[0, :, 0]) > 250


@pytest.mark.parametrize("fixed", [{"delay": 0.5}, {"s0": -3.0, "delay": 1.3}])
def test_a_fixed_term_keeps_its_value_exactly(fixed: dict[str, float]) -> None:
    given = estimated(windows(range(2), duration=60.0), model="cthp-s0-delay", fixed=fixed)
    drawn = given.posterior
    for name in FOLLOWING["cthp-s0-delay"].terms:
        for part in (given.parameters, drawn.typical, drawn.further, given.windows):
            assert (getattr(part, name) == fixed.get(name)).all() == (name in fixed)
    (name, value), *_ = fixed.items()
    span = given.span(name, 0)
    assert (span.lower, span.upper) == (value, value)
    assert drawn.typical.tau.std() > 0.01


def test_case_i_has_one_set_and_case_ii_one_for_each() -> None:
    car = Parameters([ALPHA] * 2, BETA, TAU)
    pair = [disturbed(car, 1, Disturbance(standstill=S0), duration=60.0)]
    shared, apart = estimated(pair, "I", "cthp-s0"), estimated(pair, "II", "cthp-s0")
    assert shared.parameters[0] == shared.parameters[1]
    assert shared.windows[0][0] == shared.windows[0][1]
    assert (apart.parameters.values[0] != apart.parameters.values[1]).all()
    assert not findings_of(shared)
    unlike = Parameters([ALPHA] * 2, BETA, [TAU, TAU + 0.5])
    other = estimated([disturbed(unlike, 1, Disturbance(standstill=S0))], "I", "cthp-s0")
    (finding,) = (f for f in findings_of(other) if isinstance(f, HeterogeneousFollowers))
    assert (finding.followers, finding.probability < 1e-3) == (2, True)
    with pytest.raises(ConfigError, match=r"^follower: 2 is not there"):
        shared.time_gap(25.0, 2)
    with pytest.raises(ConfigError, match=r"^span: lag is not known"):
        shared.span("lag", 0)


def test_a_follower_that_does_not_move_is_not_determined() -> None:
    still = estimated([standing_still()], "II", "cthp-s0")
    assert np.isnan(still.posterior.typical.values).all()
    assert still.findings == (WeaklyDetermined(2),)
    assert np.isnan(still.time_gap(25.0, 0).lower)
    assert findings_of(still) == (NotDetermined(2),)


def test_windows_that_differ_are_reported_and_equal_ones_mostly_are_not() -> None:
    """One of three windows has a headway .4 s longer; of three cars without that at most one."""
    changed = estimated([*windows(range(2)), *windows(range(2, 3), tau=TAU + 0.4)], model="cthp-s0")
    gaps = time_gap(changed.model, changed.windows, changed.stated_speed)[:, 0]
    finding = HeterogeneousWindows((2,), 3, float(changed.posterior.differ[0]), float(np.ptp(gaps)))
    assert findings_of(changed)[0] == finding
    assert changed.posterior.differ[0] < 1e-4
    spans = [given.time_gap(28.0, 0) for given in (changed, usual())]
    wide, narrow = (span.further_upper - span.further_lower for span in spans)
    assert wide > 1.3 * narrow
    others = (range(3, 6), range(20, 24))
    equal = [usual(), *(estimated(windows(seeds), model="cthp-s0") for seeds in others)]
    assert sum(len(different_windows(given)) for given in equal) <= 1
    assert np.median([given.posterior.differ[0] for given in equal]) > 0.1


@pytest.mark.parametrize("model", ["cthp", "cthp-s0", "cthp-s0-delay"])
def test_the_prior_of_a_window_is_the_density_over_features_that_is_divided_by(model: str) -> None:
    """It differs by the Jacobian's determinant, here from central differences; 1e-5."""
    criterion = Criterion(series_of([standing_still()], "II"), ModelSpec(model))
    free = [0, 1, 2, *range(9, criterion.size)]
    z = np.tile(criterion.start, (20, 1))
    z[:, free] += np.random.default_rng(2).normal(0, 0.3, (20, len(free)))
    steps = 1e-5 * np.eye(criterion.size)[free]
    space = time_gap_coordinates(model)
    slopes = [(space.of_unknowns(z + h) - space.of_unknowns(z - h)) / 2e-5 for h in steps]
    volume = np.log(np.abs(np.linalg.det(np.moveaxis(slopes, 0, -1))))
    of_z = criterion.log_prior(z) + log_prior_of_theta(model, z)
    over = of_z - volume - space.log_prior(space.of_unknowns(z))
    np.testing.assert_allclose(over, over[0], atol=1e-5)


def test_the_point_is_the_joint_maximum_and_draws_do_not_move_it() -> None:
    """The point is that of all windows together, also where draws are of another level."""
    given, segments = usual(), tuple(windows(range(3)))
    (maximum,) = joint_maxima(segments, "II", ModelSpec("cthp-s0"))
    np.testing.assert_allclose(given.parameters.complete[0], maximum.complete, rtol=1e-4)
    (alone,) = joint_maxima(segments[1:2], "II", ModelSpec("cthp-s0"))
    np.testing.assert_allclose(given.windows.complete[1, 0], alone.complete)
    wide = estimated(segments, model="cthp-s0", level=0.99)
    assert wide.parameters == given.parameters
    assert wide.span("alpha", 0).upper > given.span("alpha", 0).upper


def test_a_point_outside_its_interval_is_named() -> None:
    given = usual()
    values = given.parameters.everything.copy()
    values[0, 1] *= 3.0
    beside = replace(given, parameters=Parameters.of(values))
    assert findings_of(beside)[-1] == OutsideInterval(2, ("β",))
    assert beside.span("beta", 0).value > interval_ends_of(given.posterior)[1].beta[0]


@pytest.mark.parametrize("model", ["cthp", "cthp-s0-delay"])
def test_simulation_has_a_posterior_of_a_cthp_near_that_of_the_likelihood(model: str) -> None:
    """Both are of the same windows, by different criteria: their intervals overlap."""
    segments = tuple(windows(range(20, 22), duration=150.0))
    method = METHODS["simulation"]
    estimate = with_posterior(method.fit(segments, spec=ModelSpec(model)), segments, "simulation")
    likely = estimated(segments, model=model)
    for name in estimate.names:
        interval, other = estimate.span(name, 0), likely.span(name, 0)
        assert max(interval.lower, other.lower) < min(interval.upper, other.upper)
    gap = estimate.time_gap(28.0, 0)
    assert gap.lower < TAU + S0 / 28.0 < gap.upper or model == "cthp"
