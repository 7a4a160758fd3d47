"""Intervals and probabilities, bands of predicted gaps, and data that determine little."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from accpinn import METHODS, Parameters, Segment, Uncertainty, gap_band, intervals
from accpinn.errors import ConfigError, SegmentError
from accpinn.evaluation.closed_loop import closed_loop
from accpinn.inference import intervals as module
from accpinn.inference import prediction
from accpinn.inference.intervals import (
    Cause,
    FewDraws,
    NotDetermined,
    OutsideInterval,
    gain_band,
    growth,
    interval_ends,
    within,
)
from accpinn.inference.prediction import SIMULATIONS
from accpinn.methods import least_squares, maximum_likelihood
from accpinn.methods.estimate import Outcome
from accpinn.methods.series import stride_of
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.stability.criteria import response
from accpinn.units import Stretch
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW, driven, standing_still
from tests.support.holes import with_holes

pytestmark = pytest.mark.usefixtures("all_draws")

ENDS = ("lower", "upper")


@pytest.fixture(scope="module")
def segment() -> Segment:
    return disturbed(Parameters.of([LAW, LAW]), 3, Disturbance(0.25, 4.0))


def test_are_repeatable_wider_for_a_higher_level_and_narrower_in_case_i(segment: Segment) -> None:
    fit = least_squares.fit(segment)
    one = intervals(segment, fit)
    module.shared.cache_clear()
    assert intervals(segment, fit).draws == one.draws
    far = replace(fit, parameters=Parameters.of([[1.0, 1.0, 3.0]] * 2))
    assert intervals(segment, far).draws is intervals(segment, fit).draws, "made once for all fits"
    wide = intervals(segment, fit, 0.99)
    assert (wide.lower.values <= one.lower.values).all()
    assert (wide.upper.values >= one.upper.values).all()
    assert (wide.upper.values[:, :2] > one.upper.values[:, :2]).all()
    shared = intervals(segment, least_squares.fit(segment, "I"))
    assert shared.lower[0] == shared.lower[1]
    assert shared.upper.beta[0] - shared.lower.beta[0] < (one.upper.beta - one.lower.beta).max()
    assert min(one.draws.values.min(), one.peak_gain.lower.min() - 1.0) >= 0.0
    assert (one.linf_gain.lower >= one.peak_gain.lower - 1e-9).all()


@pytest.mark.parametrize(
    ("outcome", "cause"),
    [
        (Outcome.SOLVED, "disturbances"),
        (Outcome.FINISHED, "unfinished"),
        (Outcome.STOPPED, "stopped"),
    ],
)
def test_estimates_outside_are_found_with_a_cause(
    segment: Segment, outcome: Outcome, cause: Cause
) -> None:
    beside = Parameters.of([[LAW[0], 9.0, 9.0], [0.08, 0.16, 1.5]])
    fit = replace(least_squares.fit(segment), parameters=beside, outcome=outcome)
    uncertainty = intervals(segment, fit)
    assert uncertainty.inside[0].tolist() == [True, False, False]
    (found,) = uncertainty.findings
    assert found == OutsideInterval(2, ("β", "τ"), cause)
    (found,) = intervals(segment, replace(fit, method="simulation")).findings
    assert found.cause == "closed loop", "which fits no accelerations"


def test_a_posterior_of_few_different_draws_is_reported(
    segment: Segment, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = least_squares.fit(segment)
    whole = intervals(segment, fit)
    assert not [one for one in whole.findings if isinstance(one, FewDraws)]
    few = np.resize(whole.draws.complete[::300], whole.draws.complete.shape)
    thin = replace(whole, draws=Parameters.of(few), findings=())
    monkeypatch.setattr("accpinn.inference.intervals.shared", lambda *_: thin)
    found = [one for one in intervals(segment, fit).findings if isinstance(one, FewDraws)]
    assert found == [FewDraws(vehicle, 7) for vehicle in segment.vehicles[1:]]


def test_an_end_is_no_sharper_than_the_draws() -> None:
    lower, upper = np.array([0.44]), np.array([0.45])
    width = upper - lower
    assert within(upper + 0.03 * width, lower, upper).all()
    assert not within(upper + 0.1 * width, lower, upper).any()
    assert not within(np.array([np.nan]), lower, upper).any()


def test_the_band_of_the_gain_is_that_of_the_draws(segment: Segment) -> None:
    uncertainty, omega = intervals(segment, least_squares.fit(segment)), np.array([0.01, 0.3, 2.0])
    band = gain_band(uncertainty, 0, omega)
    low = np.abs(response(uncertainty.draws[:, 0], omega)[:, 1])
    # Draws of large weight repeat: an end may be one of them, and so many are neither side of it.
    for beyond in (band.lower[1] - low, low - band.upper[1]):
        assert (beyond > 1e-9).mean() <= 0.05 <= (beyond > -1e-9).mean()


def test_the_growth_along_a_platoon_is_that_of_its_vehicles_draws(segment: Segment) -> None:
    uncertainty, omega = intervals(segment, least_squares.fit(segment)), 0.3
    once, band = growth(uncertainty, (1,), omega), gain_band(uncertainty, 1, np.array([omega]))
    assert once == pytest.approx((band.lower[0], band.upper[0]))
    assert growth(uncertainty, (1,) * 4, omega) == pytest.approx([end**4 for end in once])
    # Followers err independently, so the logarithm of both has the sum of their variances.
    widths = [
        np.log(high / low)
        for low, high in (growth(uncertainty, order, omega) for order in ((0,), (1,), (0, 1)))
    ]
    assert widths[2] == pytest.approx(np.hypot(*widths[:2]), rel=0.1)
    draws = uncertainty.draws
    platoon = replace(uncertainty, draws=draws[:, [0, 0]])
    assert growth(platoon, (0, 1), omega) == growth(platoon, (0, 0), omega), "Case I"
    top = uncertainty.peak_gain
    ends = np.array([top.lower[0], top.upper[0]])
    assert growth(platoon, (0, 1)) == pytest.approx(ends**2, rel=1e-3), "of the largest gain"
    undamped = draws.everything.copy()
    undamped[: len(undamped) // 5, :, 5] = 9.0  # a delay
    undamped = replace(uncertainty, draws=Parameters.of(undamped))
    assert np.isinf(growth(undamped, (0, 1))[1])
    assert np.isinf(growth(undamped, (0, 1), omega)[1])


@pytest.mark.parametrize(
    "segment_of", [lambda: standing_still(samples=1201), lambda: driven(duration=15.0)]
)
def test_where_nothing_moves_or_time_is_short_nothing_is_claimed(
    segment_of: Callable[[], Segment],
) -> None:
    segment = segment_of()
    uncertainty = intervals(segment, least_squares.fit(segment))
    for values in (uncertainty.probability_l2, uncertainty.centre.values, uncertainty.lower.values):
        assert np.isnan(values).all()
    assert np.isnan(gain_band(uncertainty, 0, np.array([0.1, 1.0])).upper).all()
    assert uncertainty.findings == (NotDetermined(2),)
    assert uncertainty.inside.all()


def test_a_follower_that_is_hardly_measured_is_left_open_alone(segment: Segment) -> None:
    fit, gap_of_the_second = least_squares.fit(segment), 4
    holed = with_holes(segment, {gap_of_the_second: [Stretch(0, segment.samples - 100)]})
    uncertainty = intervals(holed, fit)
    assert [one.vehicle for one in uncertainty.findings if isinstance(one, NotDetermined)] == [3]
    assert np.isfinite(uncertainty.upper[0].values).all()
    assert np.isnan(uncertainty.upper[1].values).all()
    with pytest.raises(SegmentError, match=segment.labels[2]):
        maximum_likelihood.fit(holed)


def test_an_estimate_of_zero_lies_in_its_interval() -> None:
    """The prior of ln β excludes zero, which the likelihood prefers."""
    segment = disturbed(Parameters.of([[0.1, 0.0, 1.2]]), 1, Disturbance(), duration=120.0)
    fit = maximum_likelihood.fit(segment)
    assert fit.parameters.beta[0] == 0.0, "the case needs such an estimate"
    uncertainty = intervals(segment, fit)
    assert uncertainty.lower.beta[0] == 0.0
    assert uncertainty.lower.alpha[0] > 0.0
    assert uncertainty.inside[0, 1]
    assert (uncertainty.draws.beta > 0).all()


def test_the_truth_lies_inside_and_biased_estimates_lie_outside() -> None:
    """Twelve recordings: a 90 % interval misses in more than four of them once in two hundred."""
    recordings = [
        disturbed(Parameters.of([LAW]), seed, Disturbance(), duration=120.0) for seed in range(12)
    ]
    fits = [least_squares.fit(one) for one in recordings]
    found = [intervals(one, fit) for one, fit in zip(recordings, fits, strict=True)]
    lower, upper = (np.array([getattr(u, end).values[0] for u in found]) for end in ENDS)
    covered = ((lower <= LAW) & (upper >= LAW)).sum(axis=0)
    assert (covered >= 8).all()
    estimates = np.array([fit.parameters.values[0] for fit in fits])
    assert (estimates[:, :2] < lower[:, :2]).any()


@pytest.mark.parametrize("wrong", [{"level": 0.0}, {"level": 1.0}, {"draws": 1}])
def test_nonsense_is_refused(segment: Segment, wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        intervals(segment, least_squares.fit(segment), **wrong)


def test_ends_are_those_of_the_known_draws_where_half_are_known() -> None:
    draws = np.tile(np.arange(101.0)[:, None], 4)
    draws[:50, 1] = draws[:51, 2] = draws[:, 3] = np.nan
    lower, upper = interval_ends(draws, 0.8)
    np.testing.assert_allclose(lower, [10.0, 55.0, np.nan, np.nan])
    np.testing.assert_allclose(upper, [90.0, 95.0, np.nan, np.nan])
    assert interval_ends(draws[:, 1], 0.8) == (lower[1], upper[1])
    assert interval_ends(np.r_[np.linspace(1, 2, 80), np.full(20, np.inf)], 0.9)[1] == np.inf


TRUE = ((0.1, 0.3, 1.2), (0.08, 0.2, 1.4))


@pytest.fixture(scope="module")
def platoon() -> Segment:
    return disturbed(Parameters.of(TRUE), 2, Disturbance(), duration=120.0)


@pytest.fixture(scope="module")
def uncertainty(platoon: Segment) -> Uncertainty:
    return intervals(platoon, least_squares.fit(platoon))


def test_without_disturbance_and_doubt_it_is_the_closed_loop_simulation(
    platoon: Segment, uncertainty: Uncertainty, monkeypatch: pytest.MonkeyPatch
) -> None:
    still = np.array([[1e-9, 4.0, 0.2], [1e-9, 4.0, 0.2]])
    monkeypatch.setattr(prediction, "_disturbances", lambda *_: still)
    certain = Parameters.of(np.tile(TRUE, (SIMULATIONS, 1, 1)))
    found = gap_band(platoon, replace(uncertainty, draws=certain), "II")
    # The band takes the leader's speed as straight over half a second.
    stride = stride_of(platoon)
    coarse = replace(
        platoon, time=platoon.time[::stride], speeds=platoon.speeds[::stride],
        gaps=platoon.gaps[::stride],
    )  # fmt: skip
    expected = closed_loop(coarse, replace(least_squares.fit(coarse), parameters=certain[0]))
    for end in (found.lower, found.upper):
        np.testing.assert_allclose(end, expected.gaps, atol=1e-5)


def test_an_intercept_shifts_the_gaps_and_their_band(
    platoon: Segment, uncertainty: Uncertainty
) -> None:
    found = gap_band(platoon, uncertainty, "II")
    draws = uncertainty.draws.complete.copy()
    draws[..., 3] = 4.0
    with_intercept = replace(uncertainty, draws=Parameters.of(draws))
    shifted = gap_band(replace(platoon, gaps=platoon.gaps + 4.0), with_intercept, "II")
    # The disturbances are estimated under a model without an intercept, so their sizes differ.
    np.testing.assert_allclose(shifted.lower[0], found.lower[0] + 4.0)
    middle = [(band.lower + band.upper).mean(axis=0) / 2 for band in (found, shifted)]
    np.testing.assert_allclose(middle[1], middle[0] + 4.0, atol=0.5)


@pytest.mark.parametrize(("term", "value"), [("lag", 0.6), ("delay", 0.8)])
def test_a_command_that_comes_late_is_part_of_the_band(term: str, value: float) -> None:
    """The followers oscillate, which without the term would pass for large disturbances."""
    spec, quick = ModelSpec(f"cthp-s0-{term}"), [Parameters(0.15, 0.5, 0.9)]
    segment = disturbed(quick, 5, Disturbance(standstill=5.0, **{term: value}), duration=120.0)
    fit = METHODS["maximum-likelihood"].fit(segment, spec=spec)
    known = intervals(segment, fit)
    found, without = (gap_band(segment, known, "II", asked) for asked in (spec, PAPER_SPEC))
    assert 0.8 < found.findings[0].share < 1.0
    width, wider = (np.median(band.upper - band.lower) for band in (found, without))
    assert width < 0.9 * wider


def test_it_holds_most_of_what_is_measured_and_begins_there(
    platoon: Segment, uncertainty: Uncertainty
) -> None:
    found = gap_band(platoon, uncertainty, "II")
    np.testing.assert_allclose(found.lower[0], platoon.measured_gaps[0])
    assert (found.upper[40:] - found.lower[40:] > 0.5).all()
    assert [one.vehicle for one in found.findings] == [2, 3]
    assert all(0.75 < one.share <= 1.0 for one in found.findings)
    inside = (found.lower <= platoon.gaps[::5]) & (platoon.gaps[::5] <= found.upper)
    assert [one.share for one in found.findings] == pytest.approx(inside.mean(axis=0).tolist())


def test_behind_a_follower_without_draws_there_is_no_band(
    platoon: Segment, uncertainty: Uncertainty
) -> None:
    values = uncertainty.draws.values.copy()
    values[:, 1] = np.nan
    found = gap_band(platoon, replace(uncertainty, draws=Parameters.of(values)), "II")
    assert np.isfinite(found.lower[:, 0]).all()
    assert np.isnan(found.lower[:, 1]).all()
    assert [one.vehicle for one in found.findings] == [2]
    values[:, 0] = np.nan
    assert gap_band(platoon, replace(uncertainty, draws=Parameters.of(values)), "II") is None
