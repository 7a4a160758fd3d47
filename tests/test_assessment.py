"""Errors of two kinds: of a curve against the data, and of the law driving by itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import closed_loop, closed_loop_errors, collisions, incidents
from accpinn.evaluation.cross_validation import Block, cross_validate, pooled_holdout_errors
from accpinn.evaluation.errors import TrackingErrors, surrogate_errors, tracking_errors
from accpinn.evaluation.evaluation import evaluate
from accpinn.evaluation.masking import part, without
from accpinn.evaluation.whiteness import whiteness
from accpinn.methods import least_squares, splines
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW, MIXED, driven, segment_of
from tests.support.methods import RIVALS as ESTIMATORS

SAMPLES = Path(__file__).parent.parent / "sample_data"
TRUTH = tuple(Parameters(*law) for law in MIXED)


def with_parameters(segment: Segment, *parameters: Parameters) -> Fit:
    return replace(least_squares.fit(segment), parameters=parameters)


def small() -> Segment:
    """Two instants of a leader and two followers."""
    return segment_of(
        np.array([0.0, 0.1]),
        np.array([[20.0, 19.0, 18.0], [21.0, 20.0, 19.0]]),
        np.array([[30.0, 40.0], [31.0, 41.0]]),
    )


class TestTracking:
    def test_errors_are_those_reckoned_by_hand(self) -> None:
        segment = small()
        drawn = Trajectories(
            segment.time,
            segment.speeds + np.array([[0.0, 1.0, -3.0], [0.0, 1.0, 4.0]]),
            segment.gaps + np.array([[0.0, -6.0], [2.0, 8.0]]),
        )
        errors = tracking_errors(segment, drawn)
        assert errors.speed_mae.tolist() == pytest.approx([0, 1, 3.5])
        assert errors.gap_mae.tolist() == pytest.approx([1, 7])
        assert errors.speed_rmse.tolist() == pytest.approx([0, 1, 12.5**0.5])
        assert errors.gap_rmse.tolist() == pytest.approx([2**0.5, 50**0.5])

    def test_surrogate_errors_are_those_of_the_methods_own_trajectories(self) -> None:
        segment = driven(MIXED, noise=0.05)
        fit = splines.fit(segment)
        errors = surrogate_errors(segment, fit)
        assert errors is not None
        assert fit.surrogate is not None
        for column in range(3):
            by_hand = np.mean(np.abs(fit.surrogate.gaps[:, column] - segment.gaps[:, column]))
            assert errors.gap_mae[column] == pytest.approx(by_hand)
        assert errors.speed_mae.shape == (4,)
        # White noise of 0.05 has a mean absolute value of 0.04.
        np.testing.assert_allclose(errors.gap_mae, 0.04, rtol=0.1)


class TestClosedLoop:
    def test_the_true_law_drives_as_the_data_do(self) -> None:
        segment = driven(MIXED)
        errors = closed_loop_errors(segment, with_parameters(segment, *TRUTH))
        assert errors is not None
        assert errors.gap_mae.max() < 1e-3
        assert errors.speed_mae.max() < 1e-3

    def test_only_the_leader_and_the_first_instant_go_in(self) -> None:
        segment = driven(MIXED)
        scrambled = segment.gaps.copy()
        scrambled[1:] += 100.0
        other = segment_of(segment.time, segment.speeds, scrambled)
        one = closed_loop(segment, with_parameters(segment, *TRUTH))
        two = closed_loop(other, with_parameters(segment, *TRUTH))
        assert one is not None
        assert two is not None
        np.testing.assert_array_equal(one.gaps, two.gaps)
        np.testing.assert_array_equal(one.speeds[:, 0], segment.speeds[:, 0])
        np.testing.assert_array_equal(one.gaps[0], segment.gaps[0])

    def test_a_wrong_headway_shows_in_the_gap(self) -> None:
        segment = driven((LAW,), duration=100.0)
        alpha, beta, tau = LAW
        errors = closed_loop_errors(segment, with_parameters(segment, Parameters(alpha, beta, 2.0)))
        assert errors is not None
        # In equilibrium the gap is τv, so half a second more is 11 m at 22 m/s.
        assert errors.gap_mae[0] == pytest.approx((2.0 - tau) * 22, rel=0.15)

    def test_without_a_headway_there_is_none(self) -> None:
        segment = driven()
        fit = with_parameters(segment, Parameters(0.0, 0.5, float("nan")))
        assert closed_loop(segment, fit) is None
        assert closed_loop_errors(segment, fit) is None

    def test_of_the_papers_casale_parameters(self, openacc_dir: Path) -> None:
        """Table I, experiment 1: 0.47 m for the network's curve, 13.6 m and a crash for the law."""
        segment = cut(read(openacc_dir / "Casale" / "part7.csv"), 0, 300)
        fit = with_parameters(segment, Parameters(0.0104, 0.0718, 1.52))
        errors = closed_loop_errors(segment, fit)
        assert errors is not None
        assert errors.gap_mae[0] == pytest.approx(13.6, abs=0.15)
        (sentence,) = evaluate(segment, fit).incidents
        assert "runs into the vehicle ahead at 22" in sentence


class TestIncidents:
    def test_a_collision_is_named_with_its_instant_and_the_errors_stay(self) -> None:
        segment = driven((LAW,), duration=100.0)
        fit = with_parameters(segment, Parameters(0.05, 0.0, 1.0))  # sways more and more
        drive = closed_loop(segment, fit)
        assert drive is not None
        touched = float(collisions(segment, drive)[0])
        index = round(touched / segment.sample_time)
        assert drive.gaps[index, 0] <= 0.0
        assert (drive.gaps[:index, 0] > 0.0).all()
        (sentence,) = incidents(segment, drive)
        assert f"at {touched:.1f} s" in sentence
        assert f"{drive.gaps.min():.1f} m" in sentence
        errors = closed_loop_errors(segment, fit)
        assert errors is not None
        assert np.isfinite(errors.gap_mae).all()

    def test_the_instant_counts_from_the_recordings_first_sample(self) -> None:
        segment = driven((LAW,), duration=100.0)
        fit = with_parameters(segment, Parameters(0.05, 0.0, 1.0))
        later = replace(segment, start=250.0)
        one, two = (collisions(s, closed_loop(s, fit))[0] for s in (segment, later))
        assert two - one == pytest.approx(250.0)

    def test_a_law_that_loses_the_vehicle_ahead_diverges(self) -> None:
        segment = driven((LAW,), duration=100.0)
        fit = with_parameters(segment, Parameters(1e-6, 0.0, 1e6))  # brakes for ever
        said = incidents(segment, closed_loop(segment, fit))
        assert any("diverges" in sentence for sentence in said)

    def test_a_lost_vehicle_has_no_errors_nor_those_behind_it(self) -> None:
        segment = driven(MIXED)
        laws = (TRUTH[0], Parameters(1e-6, 0.0, 1e6), TRUTH[2])
        errors = closed_loop_errors(segment, with_parameters(segment, *laws))
        assert errors is not None
        assert np.isfinite(errors.gap_mae).tolist() == [True, False, False]
        assert np.isfinite(errors.speed_rmse).tolist() == [True, True, False, False]

    def test_driving_backwards_is_named(self) -> None:
        segment = driven((LAW,), duration=100.0)
        fit = with_parameters(segment, Parameters(1.0, 0.0, 0.01))  # sways about the leader
        drive = closed_loop(segment, fit)
        assert drive is not None
        assert drive.speeds.min() < -1.0
        assert any("drives backwards" in sentence for sentence in incidents(segment, drive))

    def test_the_true_law_has_none(self) -> None:
        segment = driven(MIXED)
        drive = closed_loop(segment, with_parameters(segment, *TRUTH))
        assert incidents(segment, drive) == ()
        assert np.isnan(collisions(segment, drive)).all()

    def test_without_a_headway_nothing_drives(self) -> None:
        assert incidents(driven(), None) == ()

    def test_the_papers_casale_law_collides(self, openacc_dir: Path) -> None:
        """Behind the measured leader it would be in the vehicle ahead after 222 s."""
        segment = cut(read(openacc_dir / "Casale" / "part7.csv"), 0, 300)
        fit = with_parameters(segment, Parameters(0.0104, 0.0718, 1.52))
        assert collisions(segment, closed_loop(segment, fit))[0] == pytest.approx(222.6, abs=1.0)


class TestHeldOut:
    def test_each_block_is_driven_by_a_law_learned_without_it(self) -> None:
        """Truth but for the last third: only the law learned elsewhere may be right."""
        learned: list[Segment] = []

        def estimate(segment: Segment) -> Fit:
            learned.append(segment)
            return least_squares.fit(segment)

        segment = cut(read(SAMPLES / "synthetic_paper_study_noise_free.csv"), 0.0, 90.0)
        blocks = cross_validate(segment, estimate)
        starts = [pytest.approx(start, abs=0.2) for start in (0.0, 30.0, 60.0)]
        assert [block.start for block in blocks] == starts
        assert [piece.start for piece in learned] == [starts[1], 0.0, 0.0]
        durations = [pytest.approx(duration, abs=0.2) for duration in (60.0, 90.0, 60.0)]
        assert [piece.duration for piece in learned] == durations
        for block in blocks:
            assert block.errors is not None
            assert block.errors.gap_mae[0] < 0.02
        later = replace(segment, gaps=np.where(segment.time[:, None] > 62, 5.0, segment.gaps))
        spoilt = cross_validate(later, least_squares.fit)[2].errors
        assert spoilt is not None
        assert spoilt.gap_mae[0] > 1.0
        assert [block.incidents for block in blocks] == [()] * 3

    @pytest.mark.parametrize("method", ["least-squares", "savitzky-golay", "splines", "simulation"])
    def test_the_middle_third_leaves_no_trace_and_what_stands_for_it_none_either(
        self, method: str
    ) -> None:
        segment = driven(MIXED[:2], noise=0.05)
        spoilt = np.where(np.abs(segment.time[:, None] - 30.0) < 9.9, 77.0, segment.gaps)
        masked = np.zeros(segment.gaps.shape, dtype=bool)
        masked[200:400] = True
        estimate = ESTIMATORS[method]
        hidden = without(segment, 200, 400)
        assert hidden.digest() == without(replace(segment, gaps=spoilt), 200, 400).digest()
        np.testing.assert_array_equal(hidden.gaps[~masked], segment.gaps[~masked])
        merely_left_out = estimate(replace(segment, left_out=masked), "II").parameters.values
        np.testing.assert_allclose(
            estimate(hidden, "II").parameters.values, merely_left_out, rtol=0.02
        )

    def test_the_bridge_is_continuous_and_obeys_the_gap_s_equation(self) -> None:
        segment = driven(MIXED)
        hidden = without(segment, 200, 400)
        relative = hidden.speeds[:, :-1] - hidden.speeds[:, 1:]
        trapezoid = (relative[1:] + relative[:-1]) * segment.sample_time / 2
        np.testing.assert_allclose(np.diff(hidden.gaps, axis=0), trapezoid, atol=2e-3)
        assert np.abs(np.diff(hidden.speeds, axis=0)).max() < 0.5

    def test_too_little_for_a_method_is_no_error(self) -> None:
        short = driven(duration=12.0)
        blocks = cross_validate(short, lambda piece: ESTIMATORS["simulation"](piece, "II"))
        assert blocks[1].errors is None, "no stretch of 5 s is left beside the middle"
        assert pooled_holdout_errors(blocks) is None

    def test_blocks_are_pooled_by_duration(self) -> None:
        one, three = (TrackingErrors(*(np.full(n, x) for n in (2, 1, 2, 1))) for x in (1.0, 3.0))
        both = pooled_holdout_errors((Block(0.0, 10.0, one), Block(20.0, 30.0, three)))
        assert both is not None
        assert both.gap_mae[0] == pytest.approx(2.5)
        assert both.gap_rmse[0] == pytest.approx(((10 + 30 * 9) / 40) ** 0.5)
        assert pooled_holdout_errors((Block(0.0, 10.0, one), Block(20.0, 30.0, None))) is None

    def test_parts_keep_their_place_in_the_recording(self) -> None:
        segment = cut(read(SAMPLES / "synthetic_paper_study.csv"), 20.0, 60.0)
        piece = part(segment, 100, 300)
        assert piece.start == pytest.approx(30.0)
        assert piece.time[0] == 0.0
        assert piece.samples == 200
        np.testing.assert_array_equal(piece.gaps, segment.gaps[100:300])


class TestWhiteness:
    def test_a_law_that_holds_leaves_noise_without_memory(self) -> None:
        segment = disturbed((Parameters(*LAW),), 1, Disturbance(0.3, 0.02), noise=None)
        found = whiteness(segment, with_parameters(segment, Parameters(*LAW)))
        assert found.probability[0] > 0.01
        assert found.memory[0] < 2.0
        assert "no memory" in found.sentences[0]

    @pytest.mark.parametrize("noise", [0.02, 0.1])
    def test_receivers_noise_is_not_taken_for_a_disturbance(self, noise: float) -> None:
        """Differences of a noisy speed alternate: they are correlated, but nothing lasts."""
        clean = disturbed((Parameters(*LAW),), 1, Disturbance(1e-9, 4.0), noise=None)
        speeds = clean.speeds + noise * np.random.default_rng(1).standard_normal(clean.speeds.shape)
        segment = replace(clean, speeds=speeds)
        found = whiteness(segment, with_parameters(segment, Parameters(*LAW)))
        assert found.correlation[0] < -0.3
        assert found.probability[0] > 0.01
        assert "no memory" in found.sentences[0]
        exact = whiteness(clean, with_parameters(clean, Parameters(*LAW)))
        assert "noise and rounding" in exact.sentences[0]

    def test_a_lasting_disturbance_is_measured(self) -> None:
        """A first-order process with memory T has an integrated autocorrelation time of 2T."""
        times, deviations = [], []
        for seed in range(4):
            segment = disturbed((Parameters(*LAW),), seed, Disturbance(0.25, 4.0), duration=900.0)
            found = whiteness(segment, with_parameters(segment, Parameters(*LAW)))
            assert found.probability[0] < 1e-6
            assert found.independent[0] == pytest.approx(900.0 / found.memory[0], rel=0.01)
            times.append(found.memory[0])
            deviations.append(found.deviation[0])
        assert np.mean(times) == pytest.approx(8.0, rel=0.35)
        # A second's mean of the process: a little below its own 0.25 m/s².
        assert np.mean(deviations) == pytest.approx(0.24, rel=0.15)

    def test_seconds_left_out_do_not_count(self) -> None:
        segment = disturbed((Parameters(*LAW),), 1, Disturbance(0.25, 4.0))
        late = segment.time[:, None] >= 150.0
        fit = with_parameters(segment, Parameters(*LAW))
        spoilt = replace(segment, gaps=segment.gaps + np.where(late, 50.0, 0.0))
        masked = replace(spoilt, left_out=late, excluded_regimes=("catching up",))
        early = whiteness(part(segment, 0, 1501), fit)
        assert whiteness(spoilt, fit).deviation[0] > 5 * early.deviation[0]
        assert whiteness(masked, fit).deviation[0] == pytest.approx(early.deviation[0], rel=0.02)
        # Seconds on either side of what is left out are no neighbours.
        gaps = segment.time[:, None] % 15.0 >= 12.0
        sparse = whiteness(replace(masked, gaps=segment.gaps, left_out=gaps), fit)
        whole = whiteness(segment, fit)
        assert sparse.memory[0] == pytest.approx(whole.memory[0], rel=0.35)
        assert sparse.correlation[0] == pytest.approx(whole.correlation[0], abs=0.1)
        nothing = replace(masked, left_out=np.ones_like(late))
        assert np.isnan(whiteness(nothing, fit).deviation[0])

    def test_a_short_window_cannot_tell(self) -> None:
        segment = driven((LAW,), duration=20.0)
        found = whiteness(segment, with_parameters(segment, Parameters(*LAW)))
        assert np.isnan(found.probability[0])
        assert "too short" in found.sentences[0]


def test_an_appraisal_holds_all_of_it() -> None:
    recording = read(SAMPLES / "synthetic_paper_study.csv")
    segment = cut(recording, 0.0, 100.0)
    fit = splines.fit(segment)
    bare = evaluate(segment, fit)
    assert bare.blocks == ()
    assert bare.held_out is None
    assert bare.unseen is None
    full = evaluate(segment, fit, splines.fit, recording)
    assert full.surrogate is not None
    assert full.held_out is not None
    assert full.unseen is not None
    assert full.out_of_window_seconds > 100.0
    assert len(full.blocks) == 3
    assert full.incidents == ()
