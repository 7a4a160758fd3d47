"""Intervals and probabilities, bands of predicted gaps, and data that determine little."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from accpinn.errors import SegmentError
from accpinn.evaluation.closed_loop import closed_loop
from accpinn.inference import prediction
from accpinn.inference.coordinates import coordinates_of
from accpinn.inference.intervals import Uncertainty, from_draws, gain_band, growth, within
from accpinn.inference.prediction import SIMULATIONS, gap_band
from accpinn.inference.window_posterior import window_posterior
from accpinn.methods.estimate import Estimate
from accpinn.methods.series import stride_of
from accpinn.model.cthp import Case, Parameters
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment
from accpinn.stability.criteria import response
from accpinn.units import Stretch, interval_ends
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW, driven, standing_still
from tests.support.estimates import estimated
from tests.support.holes import with_holes

pytestmark = pytest.mark.usefixtures("all_draws")


@pytest.fixture(scope="module")
def segment() -> Segment:
    return disturbed(Parameters.of([LAW, LAW]), 3, Disturbance(0.25, 4.0))


def uncertainty_of(
    segment: Segment, case: Case = "II", level: float = 0.9, model: str = "cthp"
) -> Uncertainty:
    """The uncertainty of the estimate of one window, from its draws."""
    estimate = estimated(segment, case, model, level=level)
    return from_draws(estimate.parameters, estimate.posterior.typical, level)


def test_are_repeatable_wider_for_a_higher_level_and_narrower_in_case_i(segment: Segment) -> None:
    narrow = uncertainty_of(segment)
    window_posterior.cache_clear()
    assert uncertainty_of(segment).draws == narrow.draws
    wide = uncertainty_of(segment, level=0.99)
    assert (wide.lower.values <= narrow.lower.values).all()
    assert (wide.upper.values >= narrow.upper.values).all()
    assert (wide.upper.values[:, :2] > narrow.upper.values[:, :2]).all()
    shared = uncertainty_of(segment, "I")
    assert shared.lower[0] == shared.lower[1]
    assert (
        shared.upper.beta[0] - shared.lower.beta[0] < (narrow.upper.beta - narrow.lower.beta).max()
    )
    assert min(narrow.draws.values.min(), narrow.peak_gain.lower.min() - 1.0) >= 0.0
    assert (narrow.linf_gain.lower >= narrow.peak_gain.lower - 1e-9).all()


def test_an_end_is_no_sharper_than_the_draws() -> None:
    lower, upper = np.array([0.44]), np.array([0.45])
    width = upper - lower
    assert within(upper + 0.03 * width, lower, upper).all()
    assert not within(upper + 0.1 * width, lower, upper).any()
    assert not within(np.array([np.nan]), lower, upper).any()


def test_the_band_of_the_gain_is_that_of_the_draws(segment: Segment) -> None:
    uncertainty, omega = uncertainty_of(segment), np.array([0.01, 0.3, 2.0])
    band = gain_band(uncertainty, 0, omega)
    low = np.abs(response(uncertainty.draws[:, 0], omega)[:, 1])
    # Draws of large weight repeat: an end may be one of them, and so many are neither side of it.
    for beyond in (band.lower[1] - low, low - band.upper[1]):
        assert (beyond > 1e-9).mean() <= 0.05 <= (beyond > -1e-9).mean()


def test_the_growth_along_a_platoon_is_that_of_its_vehicles_draws(segment: Segment) -> None:
    uncertainty, omega = uncertainty_of(segment), 0.3
    once, band = growth(uncertainty, (1,), omega), gain_band(uncertainty, 1, np.array([omega]))
    assert once == pytest.approx((band.lower[0], band.upper[0]))
    # An end lies between two draws, so its fourth power is not quite that of the fourth powers.
    powers = [end**4 for end in once]
    assert growth(uncertainty, (1,) * 4, omega) == pytest.approx(powers, rel=1e-4)
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
    posterior = window_posterior(segment, "II", PAPER_SPEC)
    assert np.isnan(posterior.estimates).all()
    draws = coordinates_of("cthp").parameters(np.swapaxes(posterior.drawn, 0, 1), posterior.speeds)
    uncertainty = from_draws(Parameters.of(posterior.estimates), draws, 0.9)
    for values in (uncertainty.probability_l2, uncertainty.centre.values, uncertainty.lower.values):
        assert np.isnan(values).all()
    assert np.isnan(gain_band(uncertainty, 0, np.array([0.1, 1.0])).upper).all()


def test_a_follower_that_is_hardly_measured_is_refused_by_name(segment: Segment) -> None:
    gap_of_the_second = 4
    holed = with_holes(segment, {gap_of_the_second: [Stretch(0, segment.samples - 100)]})
    with pytest.raises(SegmentError, match=segment.labels[2]):
        estimated(holed, model="cthp")


def test_an_estimate_of_zero_lies_in_its_interval() -> None:
    """The prior of ln β excludes zero, which the likelihood prefers."""
    segment = disturbed(Parameters.of([[0.1, 0.0, 1.2]]), 1, Disturbance(), duration=120.0)
    estimate = estimated(segment, model="cthp")
    assert estimate.parameters.beta[0] == 0.0, "the case needs such an estimate"
    span = estimate.span("beta", 0)
    assert span.lower == span.value == 0.0 < span.upper
    assert estimate.span("alpha", 0).lower > 0.0
    assert (estimate.posterior.typical.beta > 0).all()


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
def estimate(platoon: Segment) -> Estimate:
    return estimated(platoon, model="cthp")


@pytest.fixture(scope="module")
def uncertainty(estimate: Estimate) -> Uncertainty:
    return from_draws(estimate.parameters, estimate.posterior.typical, 0.9)


def test_without_disturbance_and_doubt_it_is_the_closed_loop_simulation(
    platoon: Segment, estimate: Estimate, uncertainty: Uncertainty, monkeypatch: pytest.MonkeyPatch
) -> None:
    still = np.array([[1e-9, 4.0, 0.2], [1e-9, 4.0, 0.2]])
    monkeypatch.setattr(prediction, "_disturbances", lambda *_: still)
    certain = Parameters.of(np.tile(TRUE, (SIMULATIONS, 1, 1)))
    band = gap_band(platoon, estimate, replace(uncertainty, draws=certain))
    # The band takes the leader's speed as straight over half a second.
    stride = stride_of(platoon)
    coarse = replace(
        platoon, time=platoon.time[::stride], speeds=platoon.speeds[::stride],
        gaps=platoon.gaps[::stride],
    )  # fmt: skip
    expected = closed_loop(coarse, replace(estimate, parameters=certain[0]))
    for end in (band.lower, band.upper):
        np.testing.assert_allclose(end, expected.gaps, atol=1e-5)


def test_an_intercept_shifts_the_gaps_and_their_band(
    platoon: Segment, estimate: Estimate, uncertainty: Uncertainty
) -> None:
    band = gap_band(platoon, estimate, uncertainty)
    draws = uncertainty.draws.complete.copy()
    draws[..., 3] = 4.0
    with_intercept = replace(uncertainty, draws=Parameters.of(draws))
    shifted = gap_band(replace(platoon, gaps=platoon.gaps + 4.0), estimate, with_intercept)
    np.testing.assert_allclose(shifted.lower, band.lower + 4.0, atol=1e-6)
    np.testing.assert_allclose(shifted.upper, band.upper + 4.0, atol=1e-6)


@pytest.mark.parametrize(("term", "value"), [("lag", 0.6), ("delay", 0.8)])
def test_a_command_that_comes_late_is_part_of_the_band(term: str, value: float) -> None:
    """The followers oscillate, which without the term would pass for large disturbances."""
    spec, quick = ModelSpec(f"cthp-s0-{term}"), [Parameters(0.15, 0.5, 0.9)]
    segment = disturbed(quick, 5, Disturbance(standstill=5.0, **{term: value}), duration=120.0)
    with_term, without = (estimated(segment, model=model) for model in (spec.model, "cthp-s0"))
    bands = [
        gap_band(
            segment, estimate, from_draws(estimate.parameters, estimate.posterior.typical, 0.9)
        )
        for estimate in (with_term, without)
    ]
    assert 0.8 < bands[0].findings[0].share <= 1.0
    sizes = [estimate.arrays["unknowns"][0, 3] for estimate in (with_term, without)]
    assert sizes[0] < sizes[1], "what comes late is no disturbance"


def test_it_holds_most_of_what_is_measured_and_begins_there(
    platoon: Segment, estimate: Estimate, uncertainty: Uncertainty
) -> None:
    band = gap_band(platoon, estimate, uncertainty)
    np.testing.assert_allclose(band.lower[0], platoon.measured_gaps[0])
    assert (band.upper[40:] - band.lower[40:] > 0.5).all()
    assert [finding.vehicle for finding in band.findings] == [2, 3]
    assert all(0.75 < finding.share <= 1.0 for finding in band.findings)
    inside = (band.lower <= platoon.gaps[::5]) & (platoon.gaps[::5] <= band.upper)
    assert [finding.share for finding in band.findings] == pytest.approx(
        inside.mean(axis=0).tolist()
    )


def test_behind_a_follower_without_draws_there_is_no_band(
    platoon: Segment, estimate: Estimate, uncertainty: Uncertainty
) -> None:
    values = uncertainty.draws.values.copy()
    values[:, 1] = np.nan
    band = gap_band(platoon, estimate, replace(uncertainty, draws=Parameters.of(values)))
    assert np.isfinite(band.lower[:, 0]).all()
    assert np.isnan(band.lower[:, 1]).all()
    assert [finding.vehicle for finding in band.findings] == [2]
    values[:, 0] = np.nan
    assert gap_band(platoon, estimate, replace(uncertainty, draws=Parameters.of(values))) is None
