"""Errors of a curve and of the closed-loop simulation, its failures, and missing samples."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from accpinn.evaluation import cross_validate, evaluate
from accpinn.evaluation.closed_loop import (
    DIVERGED,
    ClosedLoop,
    SimulatedCollision,
    SimulatedDivergence,
    SimulatedReversing,
    closed_loop,
    closed_loop_findings,
    collision_times,
    simulated,
    surrogate_errors,
    tracking_errors,
)
from accpinn.evaluation.residuals import residual_correlations
from accpinn.methods import least_squares
from accpinn.methods.estimate import Estimate
from accpinn.methods.regression import Regression
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.recordings import Recording
from accpinn.segment import Segment
from accpinn.segment.cut import cut
from accpinn.segment.quality import assess_quality, label_regimes
from accpinn.units import Stretch
from tests.support.driving import LAW, MIXED, driven, segment_of
from tests.support.estimates import point
from tests.support.holes import with_holes
from tests.support.snapshots import bits

TRUTH = Parameters.of(MIXED)
SWAYING = Parameters.of([[0.05, 0.0, 1.0]])
BRAKING = (1e-6, 0.0, 1e6)
"""Brakes for ever."""


def fit_with(segment: Segment, parameters: Parameters) -> Estimate:
    return replace(least_squares.METHOD.fit(segment), parameters=parameters)


class TestTrackingErrors:
    def test_errors_are_those_computed_by_hand(self) -> None:
        time = np.array([0.0, 0.1])
        segment = segment_of(time, np.full((2, 3), 20.0), np.full((2, 2), 30.0))
        speeds = segment.speeds + np.array([[0.0, 1.0, -3.0], [0.0, 1.0, 4.0]])
        gaps = segment.gaps + np.array([[0.0, -6.0], [2.0, 8.0]])
        errors = tracking_errors(segment, Trajectories(time, speeds, gaps))
        assert errors.speed_mae.tolist() == pytest.approx([0, 1, 3.5])
        assert errors.gap_mae.tolist() == pytest.approx([1, 7])

    def test_a_simulated_curve_is_no_surrogate(self) -> None:
        segment = driven()
        fit = fit_with(segment, TRUTH[:1])
        assert surrogate_errors([segment], fit) == ()
        curve = replace(fit, curves=(simulated(segment, "cthp", TRUTH[:1]),))
        assert len(surrogate_errors([segment], curve)) == 1
        assert surrogate_errors([segment], replace(curve, method="simulation")) == ()


class TestClosedLoop:
    def test_the_true_parameters_reproduce_the_data_without_findings(self) -> None:
        segment = driven(MIXED)
        errors = ClosedLoop.of(segment, fit_with(segment, TRUTH)).errors
        assert max(errors.gap_mae.max(), errors.speed_mae.max()) < 1e-3
        findings = closed_loop_findings(segment, simulated(segment, "cthp", TRUTH))
        assert findings == ()
        assert np.isnan(collision_times(findings, segment.vehicles)).all()

    def test_only_the_leader_and_the_first_instant_go_in(self) -> None:
        segment = driven(MIXED)
        scrambled = segment.gaps.copy()
        scrambled[1:] += 100.0
        other = segment_of(segment.time, segment.speeds, scrambled)
        first, second = simulated(segment, "cthp", TRUTH), simulated(other, "cthp", TRUTH)
        np.testing.assert_array_equal(first.gaps, second.gaps)
        np.testing.assert_array_equal(first.speeds[:, 0], segment.speeds[:, 0])
        np.testing.assert_array_equal(first.gaps[0], segment.gaps[0])


class TestFindings:
    def test_a_collision_has_its_instant_and_the_errors_stay(self) -> None:
        segment = driven((LAW,), duration=100.0)
        trajectories = simulated(segment, "cthp", SWAYING)
        (finding,) = closed_loop_findings(segment, trajectories)
        assert isinstance(finding, SimulatedCollision)
        index = round(finding.time / segment.sample_time)
        assert trajectories.gaps[index, 0] <= 0.0
        assert (trajectories.gaps[:index, 0] > 0.0).all()
        assert finding.smallest_gap == trajectories.gaps.min()
        errors = ClosedLoop.of(segment, fit_with(segment, SWAYING)).errors
        assert np.isfinite(errors.gap_mae).all()
        later = closed_loop_findings(replace(segment, start=250.0), trajectories)
        times = collision_times(later, segment.vehicles)
        assert times - finding.time == pytest.approx(250.0), "from the recording's first sample"

    def test_where_the_measured_vehicles_touch_the_parameters_are_not_to_blame(self) -> None:
        segment = driven((LAW,), duration=100.0)
        touching = replace(segment, gaps=segment.gaps - 100.0)
        below = Trajectories(segment.time, segment.speeds, segment.gaps - 100.0)
        assert closed_loop_findings(touching, below) == ()

    def test_divergence_takes_the_errors_of_all_behind_it(self) -> None:
        segment = driven(MIXED)
        parameters = Parameters.of([MIXED[0], BRAKING, MIXED[2]])
        errors = ClosedLoop.of(segment, fit_with(segment, parameters)).errors
        assert np.isfinite(errors.gap_mae).tolist() == [True, False, False]
        assert np.isfinite(errors.speed_mae).tolist() == [True, True, False, False]
        trajectories = simulated(segment, "cthp", parameters)
        findings = closed_loop_findings(segment, trajectories)
        (first, *_) = (finding for finding in findings if isinstance(finding, SimulatedDivergence))
        assert first.vehicle == 3
        index = round(first.time / segment.sample_time)
        assert abs(trajectories.gaps[index - 1, 1]) <= DIVERGED < abs(trajectories.gaps[index, 1])

    def test_reversing_is_found_with_its_speed(self) -> None:
        segment = driven((LAW,), duration=100.0)
        trajectories = simulated(segment, "cthp", Parameters([1.0], [0.0], [0.01]))
        findings = closed_loop_findings(segment, trajectories)
        (finding,) = (finding for finding in findings if isinstance(finding, SimulatedReversing))
        assert finding.speed == -trajectories.speeds.min() > 1.0

    def test_of_the_papers_casale_parameters(self, casale: Recording) -> None:
        """Table I, experiment 1: 0.47 m for the network's curve; simulated 13.6 m and a crash."""
        segment = cut(casale, 0, 300)
        parameters = Parameters([0.0104], [0.0718], [1.52])
        errors = ClosedLoop.of(segment, fit_with(segment, parameters)).errors
        assert errors.gap_mae[0] == pytest.approx(13.6, abs=0.15)
        (finding,) = closed_loop_findings(segment, simulated(segment, "cthp", parameters))
        assert isinstance(finding, SimulatedCollision)
        assert finding.time == pytest.approx(222.6, abs=1.0)


BLOCK = Stretch(200, 349)
LEFT = np.r_[0:200, 350:601]
OWN = {1: [BLOCK], 4: [BLOCK], 5: [BLOCK]}
"""Speed of the first follower, and the gaps before and behind it."""


def whole() -> Segment:
    return driven(MIXED, noise=0.05)


def fit() -> Estimate:
    return fit_with(whole(), TRUTH)


READERS: dict[str, Callable[[Segment], object]] = {
    "closed loop": lambda segment: ClosedLoop.of(segment, fit()).errors,
    "surrogate": lambda segment: surrogate_errors(
        [segment], replace(fit(), method="splines", curves=(closed_loop(whole(), fit()),))
    ),
    "residual": lambda segment: [
        np.append(one.values, one.limit) for one in residual_correlations(segment, fit(), 0)
    ],
    "regression": lambda segment: Regression.of(segment).solve("II").theta,
    "hold-out": lambda segment: cross_validate([segment], lambda rest: fit()),
    "quality": assess_quality,
    "regimes": lambda segment: label_regimes(segment).shares,
    "likelihood": lambda segment: point(segment, model="cthp").parameters,
}


@pytest.mark.parametrize("reader", READERS)
def test_nothing_is_read_of_what_was_not_measured(reader: str) -> None:
    segment = with_holes(whole(), OWN)
    absent = np.split(segment.missing, [len(segment.vehicles)], axis=1)
    speeds, gaps = (
        np.where(missing, -7.0, values)
        for missing, values in zip(absent, (segment.speeds, segment.gaps), strict=True)
    )
    other = replace(segment, speeds=speeds, gaps=gaps)
    value, changed = (bits({"found": READERS[reader](part)}) for part in (segment, other))
    assert value == changed


class TestMissingSamples:
    def test_errors_are_those_of_the_samples_that_are_left(self) -> None:
        run = closed_loop(whole(), fit())
        errors = ClosedLoop.of(with_holes(whole(), OWN), fit()).errors
        off = run.speeds[:, 1] - whole().speeds[:, 1]
        assert errors.speed_mae[1] == pytest.approx(np.abs(off[LEFT]).mean())
        complete = ClosedLoop.of(whole(), fit()).errors
        np.testing.assert_allclose(errors.speed_mae[2:], complete.speed_mae[2:])
        np.testing.assert_allclose(errors.gap_mae[2:], complete.gap_mae[2:])

    def test_it_starts_anew_after_a_block_of_the_leader(self) -> None:
        segment = with_holes(whole(), {0: [BLOCK]})
        run = closed_loop(segment, fit())
        assert np.isnan(run.gaps[BLOCK.rows]).all()
        for piece in (whole().part(0, 200), whole().part(350, 601)):
            alone = closed_loop(piece, fit())
            first = round(piece.start / piece.sample_time)
            rows = slice(first, first + piece.samples)
            np.testing.assert_allclose(run.gaps[rows], alone.gaps)
        errors = ClosedLoop.of(segment, fit()).errors
        assert (errors.gap_mae < 0.2).all()
        assert closed_loop_findings(segment, run) == ()
        second = closed_loop(with_holes(whole(), {0: [Stretch(200, 209)]}), fit())
        assert np.isfinite(second.gaps).all(), "a second is bridged"
        late = closed_loop(with_holes(whole(), {2: [Stretch(0, 49)]}), fit())
        assert np.isnan(late.gaps[:50]).all()
        np.testing.assert_allclose(late.gaps[50], whole().gaps[50])

    def test_nowhere_without_an_instant_at_which_all_are_measured(self) -> None:
        segment = with_holes(whole(), {1: [Stretch(0, 299)], 2: [Stretch(300, 600)]})
        evaluation = evaluate(segment, fit())
        assert (evaluation.closed_loop, evaluation.findings) == (None, ())
        blocks = cross_validate([with_holes(whole(), {1: [Stretch(0, 250)]})], lambda _: fit())
        assert [block.window.start for block in blocks] == pytest.approx([20.0, 40.1])
        assert all(block.errors is not None for block in blocks)

    def test_no_collision_is_seen_where_the_gap_is_missing(self) -> None:
        crash = replace(fit(), parameters=Parameters.of([[0.05, 0.0, 0.3]]))
        segment = driven(MIXED[:1], noise=0.05)
        run = closed_loop(segment, crash)
        collision, *_ = closed_loop_findings(segment, run)
        assert isinstance(collision, SimulatedCollision)
        hidden = with_holes(segment, {2: [Stretch(round(collision.time / 0.1) - 1, 600)]})
        others = closed_loop_findings(hidden, closed_loop(hidden, crash))
        assert not any(isinstance(finding, SimulatedCollision) for finding in others)
