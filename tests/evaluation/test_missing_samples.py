"""Errors, quality and regimes where samples are missing: only what was measured counts."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import (
    SimulatedCollision,
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
    surrogate_errors,
)
from accpinn.evaluation.evaluation import cross_validate, evaluate, part
from accpinn.evaluation.whiteness import whiteness
from accpinn.methods import least_squares
from accpinn.methods.fit import Fit
from accpinn.methods.regression import Regression, one_second_means
from accpinn.model.cthp import Parameters
from accpinn.segment.quality import assess_quality, label_regimes
from accpinn.segment.segment import Segment
from accpinn.units import Stretch
from tests.support.driving import MIXED, driven
from tests.support.holes import with_holes

NOISE = 0.05
BLOCK = Stretch(200, 349)
LEFT = np.r_[0:200, 350:601]
OWN = {1: [BLOCK], 4: [BLOCK], 5: [BLOCK]}
"""Speed of the first follower, and the gaps before and behind it."""


def whole() -> Segment:
    return driven(MIXED, noise=NOISE)


def fit() -> Fit:
    return replace(least_squares.fit(whole()), parameters=Parameters.of(MIXED))


class TestClosedLoop:
    def test_errors_are_those_of_the_samples_that_are_left(self) -> None:
        simulated = closed_loop(whole(), fit())
        errors = closed_loop_errors(with_holes(whole(), OWN), fit())
        off = simulated.speeds[:, 1] - whole().speeds[:, 1]
        assert errors.speed_mae[1] == pytest.approx(np.abs(off[LEFT]).mean())
        assert errors.speed_rmse[1] == pytest.approx(np.sqrt((off[LEFT] ** 2).mean()))
        complete = closed_loop_errors(whole(), fit())
        np.testing.assert_allclose(errors.speed_mae[2:], complete.speed_mae[2:])
        np.testing.assert_allclose(errors.gap_mae[2:], complete.gap_mae[2:])

    def test_it_starts_anew_after_a_block_of_the_leader(self) -> None:
        segment = with_holes(whole(), {0: [BLOCK]})
        simulated = closed_loop(segment, fit())
        assert np.isnan(simulated.gaps[BLOCK.rows]).all()
        for piece in (part(whole(), 0, 200), part(whole(), 350, 601)):
            alone = closed_loop(piece, fit())
            first = round(piece.start / piece.sample_time)
            rows = slice(first, first + piece.samples)
            np.testing.assert_allclose(simulated.gaps[rows], alone.gaps)
        errors = closed_loop_errors(segment, fit())
        assert (errors.gap_mae < 0.2).all()
        assert closed_loop_findings(segment, simulated) == ()
        second = closed_loop(with_holes(whole(), {0: [Stretch(200, 209)]}), fit())
        assert np.isfinite(second.gaps).all(), "a second is bridged"
        late = closed_loop(with_holes(whole(), {2: [Stretch(0, 49)]}), fit())
        assert np.isnan(late.gaps[:50]).all()
        np.testing.assert_allclose(late.gaps[50], whole().gaps[50])

    def test_nowhere_without_an_instant_at_which_all_are_measured(self) -> None:
        segment = with_holes(whole(), {1: [Stretch(0, 299)], 2: [Stretch(300, 600)]})
        assert closed_loop(segment, fit()) is None
        found = evaluate(segment, fit())
        assert (found.closed_loop, found.findings) == (None, ())

    def test_no_collision_is_seen_where_the_gap_is_missing(self) -> None:
        crash = replace(fit(), parameters=Parameters.of([[0.05, 0.0, 0.3]]))
        segment = driven(MIXED[:1], noise=NOISE)
        simulated = closed_loop(segment, crash)
        found, *_ = closed_loop_findings(segment, simulated)
        assert isinstance(found, SimulatedCollision)
        hidden = with_holes(segment, {2: [Stretch(round(found.time / 0.1) - 1, 600)]})
        others = closed_loop_findings(hidden, closed_loop(hidden, crash))
        assert not any(isinstance(one, SimulatedCollision) for one in others)


def test_surrogate_errors_are_those_of_the_samples_that_are_left() -> None:
    curve = replace(fit(), method="splines", surrogate=closed_loop(whole(), fit()))
    errors = surrogate_errors(with_holes(whole(), OWN), curve)
    # White noise of 0.05 has a mean absolute value of 0.04; a false value would be 1000 off.
    np.testing.assert_allclose(errors.gap_mae, 0.04, rtol=0.5)
    nothing = surrogate_errors(with_holes(whole(), {4: [Stretch(0, 600)]}), curve)
    assert np.isnan(nothing.gap_mae).tolist() == [True, False, False]


def test_the_residual_is_that_of_the_seconds_that_are_left() -> None:
    steps = one_second_means(with_holes(whole(), OWN))
    assert (~steps.mask).sum(axis=1).tolist() == [16, 16, 0]
    found = whiteness(with_holes(whole(), OWN), fit())
    np.testing.assert_allclose(found.deviation, whiteness(whole(), fit()).deviation, rtol=0.25)


def test_no_difference_reaches_into_a_block() -> None:
    found = Regression.of(with_holes(whole(), OWN)).solve("II")
    np.testing.assert_allclose(found.theta, least_squares.fit(whole()).parameters.theta, rtol=0.25)


def test_blocks_without_measurements_are_not_held_out() -> None:
    segment = with_holes(whole(), {1: [Stretch(0, 250)]})
    blocks = cross_validate(segment, lambda rest: replace(fit(), findings=()))
    assert [block.window.start for block in blocks] == pytest.approx([20.0, 40.1])
    assert all(block.errors is not None for block in blocks)


def test_quality_leaves_them_out() -> None:
    one = driven(MIXED[:1], noise=0.0)
    found, alone = assess_quality(with_holes(one, {1: [BLOCK], 2: [BLOCK]})), assess_quality(one)
    gaps = (one.gaps[:, 0] / one.speeds[:, 1])[LEFT]
    assert found.mean_time_gap[0] == pytest.approx(gaps.mean())
    relative = (one.speeds[:, 0] - one.speeds[:, 1])[LEFT]
    assert found.relative_deviation[0] == pytest.approx(relative.std())
    assert found.leader_deviation == alone.leader_deviation
    assert found.acceleration_deviation[0] == pytest.approx(
        alone.acceleration_deviation[0], rel=0.2
    )
    assert found.condition[0] == pytest.approx(alone.condition[0], rel=0.3)
    assert found.car_following[0] == (gaps <= 2).mean()


def test_quality_of_a_vehicle_that_was_not_measured() -> None:
    found = assess_quality(with_holes(whole(), {1: [Stretch(0, 600)]}))
    assert np.isnan(found.mean_time_gap[0])
    assert np.isnan(found.car_following[0])
    assert found.condition[0] == np.inf


def test_regimes_have_the_shares_of_what_is_left() -> None:
    one = driven(MIXED[:1])
    slow = np.where(np.arange(601) < 300, 0.5, one.speeds[:, 1])
    still = replace(one, speeds=np.column_stack([one.speeds[:, 0], slow]))
    segment = with_holes(still, {1: [Stretch(0, 99)]})
    ((following, _, _, standstill),) = label_regimes(segment).shares
    assert standstill == pytest.approx(200 / 501)
    assert following == pytest.approx(301 / 501)
