"""The answer: the truth from simulated windows, held terms, Case I, and what is not determined."""

from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from accpinn import Parameters, Segment, cut
from accpinn.errors import ConfigError
from accpinn.inference.answer import (
    Answer,
    DrawnToOthers,
    HeterogeneousFollowers,
    HeterogeneousWindows,
    answer,
)
from accpinn.inference.intervals import effective_draws
from accpinn.inference.population import population_of, sampled_population
from accpinn.inference.posterior import (
    AT_SPEED,
    features,
    log_prior_of_features,
    log_prior_of_theta,
    sample,
)
from accpinn.inference.window_posterior import (
    log_prior,
    log_prior_of_likely,
    of_others,
    parameters_of,
    window_posterior,
)
from accpinn.methods.likelihood import Criterion
from accpinn.methods.maximum_likelihood import joint_maxima
from accpinn.methods.series import series_of
from accpinn.model.registry import BEST, FOLLOWING, time_gap
from accpinn.model.spec import ModelSpec
from accpinn.recordings.openacc import read
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import standing_still
from tests.support.samples import PLATOON
from tests.support.samples import sample as sample_of

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
def usual() -> Answer:
    return answer(windows(range(3)), model="cthp-s0")


@pytest.mark.parametrize(
    ("model", "departure"),
    [("cthp-s0", {}), ("cthp-s0-lag", {"lag": 0.5}), ("cthp-s0-delay", {"delay": 0.7})],
)
def test_the_truth_lies_in_the_intervals(model: str, departure: dict[str, float]) -> None:
    """Four windows of 120 s; 90 % intervals, and seeds with which all hold."""
    given = answer(windows(range(20, 24), **departure), model=model)
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
        assert span.lower < span.value < span.upper
        assert span.further_upper - span.further_lower > 1.1 * (span.upper - span.lower)
    ends = given.windows_lower.values, given.windows_upper.values
    assert ((ends[0] < given.windows.values) & (given.windows.values < ends[1])).mean() > 0.85


def test_where_s0_is_more_than_the_time_gap_the_gap_stays() -> None:
    phi = np.array([[np.log(0.1), np.log(0.4), np.log(gap), 20.0, 0.3] for gap in (0.5, 1.5)])
    found = parameters_of("cthp-s0-delay", phi, 20.0)
    np.testing.assert_allclose(time_gap("cthp-s0-delay", found, AT_SPEED), [0.5, 1.5])
    np.testing.assert_allclose(found.tau, [0.0, 1.5 - 20.0 / AT_SPEED], atol=1e-12)


def test_the_end_of_the_ridge_is_sampled(openacc_dir: Path) -> None:
    """The likelihood is largest at τ = 0 and a short delay; before, 10 of 500 draws counted."""
    recording = read(openacc_dir / "ZalaZone" / "dynamic_part10.csv")
    segment = cut(recording, 300.0, 300.0, (1, 2))
    series, model = series_of((segment,), "II"), "cthp-s0-delay"
    maxima = joint_maxima((segment,), "II", ModelSpec(model))
    for seed in (0, 1):
        (found,) = sample(series, maxima, ModelSpec(model), (seed,))
        assert found.effective > 80


@pytest.mark.parametrize(("file", "start", "pair"), CONTRARY)
def test_draws_count_where_a_minute_contradicts_other_cars(
    openacc_dir: Path, file: str, start: float, pair: tuple[int, int]
) -> None:
    """With at most 4,500 draws, 6 to 474 counted here, by the seed."""
    segment = cut(read(openacc_dir / file), start, 60.0, pair)
    series, others = series_of((segment,), "II"), partial(of_others, ModelSpec(BEST))
    for seed in range(4):
        maxima = joint_maxima((segment,), "II", ModelSpec(BEST))
        (found,) = sample(series, maxima, ModelSpec(BEST), (seed,), others=others)
        assert min(found.effective, found.under(others(found.coordinates)).effective) > 240
    # Of 400 draws of an IDM's window alone 19 to 66 counted in most.
    assert effective_draws(window_posterior(segment, "II", ModelSpec("idm")).likely[0, :, 0]) > 250


def test_the_prior_under_which_windows_are_drawn_cancels() -> None:
    """Draws of a window alone and those beside other cars lead to the same answer."""
    window = window_posterior(windows(range(1))[0], "II", ModelSpec(BEST))
    alone, told = window.drawn[0], window.likely[0]
    priors = log_prior(BEST, alone), log_prior_of_likely(ModelSpec(BEST), told)
    population = population_of(BEST, len(FOLLOWING[BEST].parameters))
    ends = [
        np.quantile(sampled_population(drawn[None], prior[None], population).value, ENDS, axis=0)
        for drawn, prior in zip((alone, told), priors, strict=True)
    ]
    assert (np.abs(ends[0] - ends[1]) < 0.3 * np.ptp(ends[0], axis=0)).all()


def test_one_window_has_an_interval_as_wide_as_windows_of_a_car_vary() -> None:
    """Σ₀'s deviation of ln α is .49, so 90 % of windows lie within 1.6 in ln α."""
    one, several = answer(windows(range(1)), model="cthp-s0"), usual()
    widths = [np.log(a.span("alpha", 0).upper / a.span("alpha", 0).lower) for a in (one, several)]
    assert 0.9 < widths[0] < 2.2
    assert widths[1] < 0.85 * widths[0]
    assert np.isnan(one.differ[0])


def test_a_held_parameter_of_an_idm_is_held_in_every_draw() -> None:
    found = window_posterior(
        windows(range(1), duration=60.0)[0], "II", ModelSpec("idm", (("v0", 100.0),))
    )
    scores = found.likely[0, :, FOLLOWING["idm"].names.index("v0")]
    assert np.unique(scores).size == 1
    assert effective_draws(found.likely[0, :, 0]) > 250


@pytest.mark.parametrize("held", [{"delay": 0.5}, {"s0": -3.0, "delay": 1.3}])
def test_a_held_term_keeps_its_value_exactly(held: dict[str, float]) -> None:
    given = answer(windows(range(2), duration=60.0), model="cthp-s0-delay", held=held)
    for name in FOLLOWING["cthp-s0-delay"].terms:
        for part in (given.parameters, given.typical, given.further, given.windows):
            assert (getattr(part, name) == held.get(name)).all() == (name in held)
    (name, value), *_ = held.items()
    span = given.span(name, 0)
    assert (span.lower, span.upper) == (value, value)
    assert given.typical.tau.std() > 0.01


def test_case_i_has_one_set_and_case_ii_one_for_each() -> None:
    car = Parameters([ALPHA] * 2, BETA, TAU)
    pair = [disturbed(car, 1, Disturbance(standstill=S0), duration=60.0)]
    shared, apart = answer(pair, "I", "cthp-s0"), answer(pair, "II", "cthp-s0")
    assert shared.parameters[0] == shared.parameters[1]
    assert shared.windows[0][0] == shared.windows[0][1]
    assert (apart.parameters.values[0] != apart.parameters.values[1]).all()
    assert not shared.findings
    unlike = Parameters([ALPHA] * 2, BETA, [TAU, TAU + 0.5])
    other = answer([disturbed(unlike, 1, Disturbance(standstill=S0))], "I", "cthp-s0")
    (finding,) = other.findings
    assert isinstance(finding, HeterogeneousFollowers)
    assert (finding.followers, finding.probability < 1e-3) == (2, True)
    with pytest.raises(ConfigError, match=r"^follower: 2 is not there"):
        shared.time_gap(25.0, 2)
    with pytest.raises(ConfigError, match=r"^span: lag is not known"):
        shared.span("lag", 0)


def test_one_follower_of_case_i_is_called_by_its_name() -> None:
    assert answer(windows(range(1)), "I", "cthp-s0").trust[0].vehicle == 2


def test_what_other_cars_draw_away_from_the_windows_is_named() -> None:
    """These cars obey the CTHP, so their window says that there is no delay; real cars have one."""
    segment = sample_of(PLATOON, 120.0).segment
    one = answer((segment,))
    (finding,) = (found for found in one.findings if isinstance(found, DrawnToOthers))
    drawn = {number: symbols for symbols, vehicles in finding.away for number in vehicles}
    assert drawn.keys() == set(segment.vehicles[1:])
    assert all(symbols.endswith("d") for symbols in drawn.values())
    assert one.windows_upper.delay[0, 0] < one.span("delay", 0).value
    assert not [found for found in usual().findings if isinstance(found, DrawnToOthers)]


def test_a_follower_that_does_not_move_is_not_determined() -> None:
    still = answer([standing_still()], "II", "cthp-s0")
    assert np.isnan(still.parameters.values).all()
    assert np.isnan(still.time_gap(25.0, 0).lower)
    assert not still.findings


def test_windows_that_differ_are_reported_and_equal_ones_mostly_are_not() -> None:
    """One of three windows has a headway .4 s longer; of three cars without that at most one."""
    changed = answer([*windows(range(2)), *windows(range(2, 3), tau=TAU + 0.4)], model="cthp-s0")
    gaps = time_gap(changed.model, changed.windows, changed.stated_speed)[:, 0]
    assert changed.findings == (
        HeterogeneousWindows((2,), 3, float(changed.differ[0]), float(np.ptp(gaps))),
    )
    assert changed.differ[0] < 1e-4
    spans = [given.time_gap(28.0, 0) for given in (changed, usual())]
    wide, narrow = (span.further_upper - span.further_lower for span in spans)
    assert wide > 1.3 * narrow
    others = (range(3, 6), range(20, 24))
    equal = [usual(), *(answer(windows(seeds), model="cthp-s0") for seeds in others)]
    assert sum(bool(given.findings) for given in equal) <= 1
    assert np.median([given.differ[0] for given in equal]) > 0.1


@pytest.mark.parametrize("model", ["cthp", "cthp-s0", "cthp-s0-delay"])
def test_the_prior_of_a_window_is_the_density_over_features_that_is_divided_by(model: str) -> None:
    """It differs by the Jacobian's determinant, here from central differences; 1e-5."""
    criterion = Criterion(series_of([standing_still()], "II"), ModelSpec(model))
    free = [0, 1, 2, *range(9, criterion.size)]
    z = np.tile(criterion.start, (20, 1))
    z[:, free] += np.random.default_rng(2).normal(0, 0.3, (20, len(free)))
    steps = 1e-5 * np.eye(criterion.size)[free]
    slopes = [(features(model, z + step) - features(model, z - step)) / 2e-5 for step in steps]
    volume = np.log(np.abs(np.linalg.det(np.moveaxis(slopes, 0, -1))))
    of_z = criterion.log_prior(z) + log_prior_of_theta(model, z)
    over = of_z - volume - log_prior_of_features(model, features(model, z))
    np.testing.assert_allclose(over, over[0], atol=1e-5)
