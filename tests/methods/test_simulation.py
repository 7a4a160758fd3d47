"""Closed-loop simulation least squares: exact derivatives, the optimum of its own criterion."""

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import closed_loop_errors
from accpinn.methods import simulation, splines
from accpinn.methods.fit import Outcome, SimulatedSeparately
from accpinn.model.cthp import Parameters, simulate
from accpinn.recordings.recording import Recording
from accpinn.segment.cut import cut
from tests.support.driving import LAW, MIXED, driven, segment_of


class TestTruth:
    def test_recovers_a_first_state_that_was_measured_wrong(self) -> None:
        exact = driven((LAW,))
        gaps = exact.gaps.copy()
        gaps[0] += 0.3
        fit = simulation.fit(segment_of(exact.time, exact.speeds, gaps))
        # One sample of 0.3 m among 600 pulls hardly.
        assert fit.surrogate.gaps[0, 0] == pytest.approx(exact.gaps[0, 0], abs=0.02)
        np.testing.assert_allclose(fit.parameters.values, [LAW], rtol=2e-3)

    def test_first_state_stays_within_a_receivers_error(self) -> None:
        exact = driven((LAW,))
        gaps = exact.gaps.copy()
        gaps[0] += 10.0
        fit = simulation.fit(segment_of(exact.time, exact.speeds, gaps))
        assert fit.surrogate.gaps[0, 0] == pytest.approx(gaps[0, 0] - 0.5, abs=1e-3)


def test_no_neighbour_drives_better() -> None:
    segment = driven(MIXED, noise=0.1)
    fit = simulation.fit(segment, "I")
    assert SimulatedSeparately() not in fit.findings
    assert SimulatedSeparately() in simulation.fit(segment, "II").findings
    start, ahead = fit.surrogate, segment.speeds[:, 0]
    theta = fit.parameters[0].theta

    def cost(theta: np.ndarray) -> float:
        one = Parameters.from_theta(np.tile(theta, (3, 1)))
        run = simulate(one, segment.time, ahead, start.speeds[0, 1:], start.gaps[0])
        off = np.hstack([run.speeds - segment.speeds, run.gaps - segment.gaps])
        return float((off**2).sum())

    best = cost(theta)
    assert fit.loss["total"] == pytest.approx(best / (segment.samples * 3), rel=1e-9)
    for column in range(3):
        for factor in (0.98, 1.02):
            other = theta.copy()
            other[column] *= factor
            assert cost(other) > best


class TestBounds:
    @pytest.mark.parametrize(
        ("law", "bound"), [((0.08, 0.3, -0.2), "ατ"), ((-0.001, 0.3, -1.2), "α")]
    )
    def test_unconstrained_is_the_truth_where_that_is_out_of_bounds(
        self, law: tuple[float, float, float], bound: str
    ) -> None:
        fit = simulation.fit(driven((law,)))
        assert fit.active_bounds == ((bound,),)
        free, held = fit.unconstrained[0], fit.parameters[0]
        assert (free.alpha, free.beta, free.tau) == pytest.approx(law, rel=0.01)
        assert held.theta[1] == 0
        assert np.isnan(held.tau) == (bound == "α")


def test_casale_drives_better_than_with_the_limit_of_the_loss(casale: Recording) -> None:
    segment = cut(casale, 0, 300)
    fit, limit = simulation.fit(segment), splines.fit(segment)
    assert fit.outcome is Outcome.CONVERGED
    ours, theirs = closed_loop_errors(segment, fit), closed_loop_errors(segment, limit)
    assert ours.gap_mae[0] < 0.85 * theirs.gap_mae[0]
    assert ours.gap_rmse[0] < theirs.gap_rmse[0]
