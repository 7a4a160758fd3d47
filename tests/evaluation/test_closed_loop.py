"""Errors of two kinds, of a curve and of the closed-loop simulation, and its failures."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import (
    DIVERGED,
    SimulatedCollision,
    SimulatedDivergence,
    SimulatedReversing,
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
    collision_times,
    surrogate_errors,
    tracking_errors,
)
from accpinn.methods import least_squares
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.recordings.recording import Recording
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from tests.support.driving import LAW, MIXED, driven, segment_of

TRUTH = Parameters.of(MIXED)
SWAYING = Parameters.of([[0.05, 0.0, 1.0]])
BRAKING = (1e-6, 0.0, 1e6)
"""Brakes for ever."""


def fit_with(segment: Segment, parameters: Parameters) -> Fit:
    return replace(least_squares.fit(segment), parameters=parameters)


def simulated(segment: Segment, parameters: Parameters) -> Trajectories:
    trajectories = closed_loop(segment, fit_with(segment, parameters))
    assert trajectories is not None
    return trajectories


class TestTrackingErrors:
    def test_errors_are_those_computed_by_hand(self) -> None:
        time = np.array([0.0, 0.1])
        segment = segment_of(time, np.full((2, 3), 20.0), np.full((2, 2), 30.0))
        speeds = segment.speeds + np.array([[0.0, 1.0, -3.0], [0.0, 1.0, 4.0]])
        gaps = segment.gaps + np.array([[0.0, -6.0], [2.0, 8.0]])
        errors = tracking_errors(segment, Trajectories(time, speeds, gaps))
        assert errors.speed_mae.tolist() == pytest.approx([0, 1, 3.5])
        assert errors.gap_mae.tolist() == pytest.approx([1, 7])
        assert errors.speed_rmse.tolist() == pytest.approx([0, 1, 12.5**0.5])
        assert errors.gap_rmse.tolist() == pytest.approx([2**0.5, 50**0.5])

    def test_a_simulated_curve_is_no_surrogate(self) -> None:
        segment = driven()
        fit = fit_with(segment, TRUTH[:1])
        assert surrogate_errors(segment, fit) is None
        curve = replace(fit, surrogate=simulated(segment, TRUTH[:1]))
        assert surrogate_errors(segment, curve) is not None
        assert surrogate_errors(segment, replace(curve, method="simulation")) is None


class TestClosedLoop:
    def test_the_true_parameters_reproduce_the_data_without_findings(self) -> None:
        segment = driven(MIXED)
        errors = closed_loop_errors(segment, fit_with(segment, TRUTH))
        assert max(errors.gap_mae.max(), errors.speed_mae.max()) < 1e-3
        found = closed_loop_findings(segment, simulated(segment, TRUTH))
        assert found == ()
        assert np.isnan(collision_times(found, segment.vehicles)).all()

    def test_only_the_leader_and_the_first_instant_go_in(self) -> None:
        segment = driven(MIXED)
        scrambled = segment.gaps.copy()
        scrambled[1:] += 100.0
        other = segment_of(segment.time, segment.speeds, scrambled)
        one, two = simulated(segment, TRUTH), simulated(other, TRUTH)
        np.testing.assert_array_equal(one.gaps, two.gaps)
        np.testing.assert_array_equal(one.speeds[:, 0], segment.speeds[:, 0])
        np.testing.assert_array_equal(one.gaps[0], segment.gaps[0])

    def test_without_a_headway_there_is_none(self) -> None:
        segment = driven()
        fit = fit_with(segment, Parameters([0.0], [0.5], [np.nan]))
        assert closed_loop(segment, fit) is None
        assert closed_loop_errors(segment, fit) is None
        assert closed_loop_findings(segment, None) == ()


class TestFindings:
    def test_a_collision_has_its_instant_and_the_errors_stay(self) -> None:
        segment = driven((LAW,), duration=100.0)
        trajectories = simulated(segment, SWAYING)
        (found,) = closed_loop_findings(segment, trajectories)
        assert isinstance(found, SimulatedCollision)
        index = round(found.time / segment.sample_time)
        assert trajectories.gaps[index, 0] <= 0.0
        assert (trajectories.gaps[:index, 0] > 0.0).all()
        assert found.smallest_gap == trajectories.gaps.min()
        errors = closed_loop_errors(segment, fit_with(segment, SWAYING))
        assert np.isfinite(errors.gap_mae).all()
        later = closed_loop_findings(replace(segment, start=250.0), trajectories)
        times = collision_times(later, segment.vehicles)
        assert times - found.time == pytest.approx(250.0), "from the recording's first sample"

    def test_where_the_measured_vehicles_touch_the_parameters_are_not_to_blame(self) -> None:
        segment = driven((LAW,), duration=100.0)
        touching = replace(segment, gaps=segment.gaps - 100.0)
        below = Trajectories(segment.time, segment.speeds, segment.gaps - 100.0)
        assert closed_loop_findings(touching, below) == ()

    def test_divergence_takes_the_errors_of_all_behind_it(self) -> None:
        segment = driven(MIXED)
        parameters = Parameters.of([MIXED[0], BRAKING, MIXED[2]])
        errors = closed_loop_errors(segment, fit_with(segment, parameters))
        assert np.isfinite(errors.gap_mae).tolist() == [True, False, False]
        assert np.isfinite(errors.speed_rmse).tolist() == [True, True, False, False]
        trajectories = simulated(segment, parameters)
        found = closed_loop_findings(segment, trajectories)
        (first, *_) = (one for one in found if isinstance(one, SimulatedDivergence))
        assert first.vehicle == 3
        index = round(first.time / segment.sample_time)
        assert abs(trajectories.gaps[index - 1, 1]) <= DIVERGED < abs(trajectories.gaps[index, 1])

    def test_reversing_is_found_with_its_speed(self) -> None:
        segment = driven((LAW,), duration=100.0)
        trajectories = simulated(segment, Parameters([1.0], [0.0], [0.01]))
        found = closed_loop_findings(segment, trajectories)
        (one,) = (one for one in found if isinstance(one, SimulatedReversing))
        assert one.speed == -trajectories.speeds.min() > 1.0

    def test_of_the_papers_casale_parameters(self, casale: Recording) -> None:
        """Table I, experiment 1: 0.47 m for the network's curve; simulated 13.6 m and a crash."""
        segment = cut(casale, 0, 300)
        parameters = Parameters([0.0104], [0.0718], [1.52])
        errors = closed_loop_errors(segment, fit_with(segment, parameters))
        assert errors.gap_mae[0] == pytest.approx(13.6, abs=0.15)
        (found,) = closed_loop_findings(segment, simulated(segment, parameters))
        assert isinstance(found, SimulatedCollision)
        assert found.time == pytest.approx(222.6, abs=1.0)
