"""Intervals and probabilities, and the cases in which the data determine little."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.errors import ConfigError
from accpinn.inference.intervals import (
    Cause,
    NegativeEstimate,
    NotDetermined,
    OutsideInterval,
    ShortWindow,
    gain_band,
    intervals,
    parameter_intervals,
    within,
)
from accpinn.methods import least_squares
from accpinn.methods.fit import Outcome
from accpinn.model.cthp import Parameters
from accpinn.results.messages import messages
from accpinn.segment.segment import Segment
from accpinn.stability.criteria import l2_criterion
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW, driven, standing_still


@pytest.fixture(scope="module")
def segment() -> Segment:
    return disturbed(Parameters.of([LAW, LAW]), 3, Disturbance(0.25, 4.0))


def test_are_the_same_every_time_and_wider_for_a_higher_level(segment: Segment) -> None:
    fit = least_squares.fit(segment)
    one, two = intervals(segment, fit), intervals(segment, fit)
    assert one.draws == two.draws
    wide = intervals(segment, fit, 0.99)
    assert (wide.lower.values <= one.lower.values).all()
    assert (wide.upper.values >= one.upper.values).all()
    assert (wide.upper.values[:, :2] > one.upper.values[:, :2]).all()


def test_obey_the_rational_driving_constraints(segment: Segment) -> None:
    uncertainty = intervals(segment, least_squares.fit(segment))
    assert (uncertainty.lower.values >= 0).all()
    assert not (uncertainty.draws.values < 0).any()
    assert (uncertainty.peak_gain.lower >= 1.0).all()
    assert (uncertainty.linf_gain.lower >= uncertainty.peak_gain.lower - 1e-9).all()
    assert (uncertainty.crossover.lower >= 0.0).all()


def test_followers_of_case_i_share_narrower_ones(segment: Segment) -> None:
    both = intervals(segment, least_squares.fit(segment, "I"))
    assert both.lower[0] == both.lower[1]
    each = intervals(segment, least_squares.fit(segment))
    width, usual = both.upper.beta - both.lower.beta, each.upper.beta - each.lower.beta
    assert width[0] < usual.max()


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
    beside = Parameters.of([[LAW[0], 9.0, 9.0], LAW])
    fit = replace(least_squares.fit(segment), parameters=beside, outcome=outcome)
    uncertainty = intervals(segment, fit)
    assert uncertainty.inside[0].tolist() == [True, False, False]
    (found,) = uncertainty.findings
    _, beta, tau = parameter_intervals(uncertainty, 0, beside)
    assert found == OutsideInterval(2, (beta, tau), cause)
    assert (beta.symbol, beta.estimate) == ("β", 9.0)
    (sentence,) = messages([found], segment)
    assert sentence.startswith(f"{segment.labels[1]}: ")
    assert "β = 9.0000" in sentence


def test_an_end_is_no_sharper_than_the_draws() -> None:
    lower, upper = np.array([0.44, 1.0]), np.array([0.4441, np.inf])
    width = 0.0041
    just = within(np.array([0.4441 + 0.03 * width, 0.99]), lower - [width, 0.0], upper)
    assert just.tolist() == [True, False]
    assert not within(np.array([0.4441 + 0.1 * width]), lower[:1] - width, upper[:1]).any()


def test_draws_without_gap_control_are_counted_apart() -> None:
    weak = disturbed(Parameters.of([[0.002, 0.3, 1.5]]), 3, Disturbance(0.25, 4.0))
    uncertainty = intervals(weak, least_squares.fit(weak))
    alpha = uncertainty.draws.alpha[:, 0]
    assert 0.05 < uncertainty.no_gap_control[0] < 0.95
    assert uncertainty.no_gap_control[0] == (alpha == 0).mean()
    assert uncertainty.probability_linf[0] <= uncertainty.probability_l2[0]
    stable = ((l2_criterion(uncertainty.draws[:, 0]) >= 0) & (alpha > 0)).mean()
    assert uncertainty.probability_l2[0] == pytest.approx(stable, abs=0.01), "of ten times as many"


def test_the_band_of_the_gain_is_that_of_the_draws(segment: Segment) -> None:
    uncertainty, omega = intervals(segment, least_squares.fit(segment)), np.array([0.01, 0.3, 2.0])
    band = gain_band(uncertainty, 0, omega)
    low = np.abs([_gain(one, 0.3) for one in uncertainty.draws[:, 0]])
    assert (low < band.lower[1]).mean() == pytest.approx(0.05, abs=0.001)
    assert (low > band.upper[1]).mean() == pytest.approx(0.05, abs=0.001)


def _gain(one: Parameters, omega: float) -> complex:
    s = 1j * omega
    return (one.beta * s + one.alpha) / (s * s + (one.theta[1] + one.beta) * s + one.alpha)


def test_where_nothing_moves_nothing_is_claimed() -> None:
    still = standing_still(samples=1201)
    uncertainty = intervals(still, least_squares.fit(still))
    for share in (uncertainty.probability_l2, uncertainty.no_gap_control):
        assert np.isnan(share).all()
    assert np.isnan(uncertainty.centre.values).all()
    assert np.isinf(uncertainty.upper.values).all()
    assert (uncertainty.lower.values == 0).all()
    assert np.isnan(gain_band(uncertainty, 0, np.array([0.1, 1.0])).upper).all()
    assert NotDetermined(2) in uncertainty.findings
    assert "brakes and accelerates" in " ".join(messages(uncertainty.findings, still))


def test_an_interval_that_is_zero_alone_is_found() -> None:
    """Driven by β < 0, which the constraints exclude."""
    segment = driven(((0.08, -0.05, 1.5),), duration=300.0, noise=0.02)
    uncertainty = intervals(segment, least_squares.fit(segment))
    assert uncertainty.upper[0].beta == 0.0
    assert NegativeEstimate(2, "β") in uncertainty.findings
    assert any("β < 0" in sentence for sentence in messages(uncertainty.findings, segment))


def test_a_short_window_is_called_rough() -> None:
    short = driven(noise=0.05)
    found = intervals(short, least_squares.fit(short)).findings[0]
    assert found == ShortWindow(60.0, 15.0)
    assert "60 s long" in messages([found], short)[0]


@pytest.mark.parametrize("wrong", [{"level": 0.0}, {"level": 1.0}, {"draws": 3}])
def test_nonsense_is_refused(segment: Segment, wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        intervals(segment, least_squares.fit(segment), **wrong)  # type: ignore[arg-type]


def test_one_segments_methods_share_the_draws() -> None:
    """What does not depend on the fit is computed once, and judged for each."""
    segment = disturbed(Parameters.of([[0.08, 0.2, 1.4]]), 1, Disturbance())
    one = intervals(segment, least_squares.fit(segment))
    far = replace(least_squares.fit(segment), parameters=Parameters.of([[1.0, 1.0, 3.0]]))
    other = intervals(segment, far)
    assert other.draws is one.draws
    assert not other.inside.any()
    assert one.inside[0, 2]
