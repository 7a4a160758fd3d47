"""Correlations of a model's residual: where they lie by chance, and what a missing term leaves."""

from dataclasses import replace

import numpy as np

from accpinn.evaluation.residuals import FEWEST, LONGEST_LAG, residual_correlations, residuals_of
from accpinn.methods import least_squares
from accpinn.methods.estimate import Estimate
from accpinn.model.cthp import Parameters
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW, MIXED, driven
from tests.support.following import driven as followed
from tests.support.methods import RIVALS

TRUE = Parameters.of([LAW])


def with_parameters(segment: Segment, parameters: Parameters) -> Estimate:
    return replace(least_squares.METHOD.fit(segment), parameters=parameters)


def test_where_the_model_is_true_nothing_is_left() -> None:
    segment = driven(MIXED)
    residuals, counts, size = residuals_of(segment, with_parameters(segment, Parameters.of(MIXED)))
    assert (residuals.shape, size, counts.all()) == ((3, 60), 10, True)
    assert np.abs(residuals).max() < 1e-3
    (window,) = followed(FOLLOWING["idm"], np.array([[1.2, 1.6, 1.1, 3.0, 40.0]]), 1, 0.0, 60.0)
    estimate = RIVALS["simulation"](window, spec=ModelSpec("idm"))
    assert np.abs(residuals_of(window, estimate)[0]).max() < 0.02


def test_a_command_that_comes_late_is_taken_late() -> None:
    segment = disturbed(TRUE, 1, Disturbance(1e-6, lag=0.5, delay=0.6), duration=60.0, noise=None)
    late = Parameters(*LAW, lag=[0.5], delay=0.6)
    taken, not_taken = (
        np.abs(residuals_of(segment, with_parameters(segment, parameters))[0][0, 3:]).max()
        for parameters in (late, TRUE)
    )
    assert taken < 0.05 < not_taken


def test_of_disturbances_without_memory_nearly_all_lie_within_the_limits() -> None:
    within = []
    for seed in range(6):
        segment = disturbed(TRUE, seed, Disturbance(0.25, 0.05), duration=300.0, noise=None)
        for correlogram in residual_correlations(segment, with_parameters(segment, TRUE), 0):
            within.append(np.abs(correlogram.values) < correlogram.limit)
    assert 0.96 < np.concatenate(within).mean() <= 1.0


def test_a_disturbance_that_lasts_is_correlated_with_itself_alone() -> None:
    """A first-order process of 4 s, exp(-lag / 4 s) but for means over a second."""
    itself, ahead = [], []
    for seed in range(4):
        segment = disturbed(TRUE, seed, Disturbance(0.25, 4.0), duration=600.0, noise=None)
        with_itself, with_ahead = residual_correlations(segment, with_parameters(segment, TRUE), 0)
        assert (with_itself.values[:4] > with_itself.limit).all()
        itself.append(with_itself.values)
        ahead.append(np.abs(with_ahead.values) < with_ahead.limit)
    assert with_itself.lags.tolist() == [*range(1, LONGEST_LAG + 1)]
    assert with_ahead.lags.tolist() == [*range(-LONGEST_LAG, LONGEST_LAG + 1)]
    np.testing.assert_allclose(np.mean(itself, axis=0)[:4], np.exp(-np.arange(1, 5) / 4), atol=0.12)
    assert np.mean(ahead) > 0.9, "neighbouring lags go together"


def test_a_response_that_the_model_lacks_follows_the_acceleration_ahead() -> None:
    segment = disturbed(TRUE, 1, Disturbance(0.05, 0.05), duration=300.0, noise=None)
    weaker = with_parameters(segment, Parameters.of([[LAW[0], 0.5 * LAW[1], LAW[2]]]))
    _, lacking = residual_correlations(segment, weaker, 0)
    _, enough = residual_correlations(segment, with_parameters(segment, TRUE), 0)
    assert np.abs(lacking.values).max() > 2 * lacking.limit
    assert lacking.lags[np.abs(lacking.values).argmax()] in range(5), "after it"
    assert np.abs(enough.values).max() < 1.5 * enough.limit


def test_seconds_that_do_not_count_leave_no_trace_and_too_few_say_nothing() -> None:
    segment = disturbed(TRUE, 2, Disturbance(), duration=120.0)
    mask = np.ones(segment.gaps.shape, bool)
    mask[305:396] = False
    wild = replace(segment, mask=mask, gaps=np.where(mask, segment.gaps, 500.0))
    masked = replace(segment, mask=mask)
    estimate = with_parameters(segment, TRUE)
    pairs = [residual_correlations(part, estimate, 0) for part in (masked, wild)]
    for part, other in zip(*pairs, strict=True):
        np.testing.assert_allclose(part.values, other.values, atol=1e-12)
    assert residuals_of(masked, estimate)[1].sum() == 110
    short = segment.part(0, 10 * FEWEST)
    assert residual_correlations(short, estimate, 0) is None
    assert residual_correlations(segment.part(0, 10 * FEWEST + 1), estimate, 0)
