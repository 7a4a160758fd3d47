"""Errors of two kinds: of a curve against the data, and of the law driving by itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.assessment import (
    closed_loop,
    closed_loop_errors,
    held_out_errors,
    part,
    surrogate_errors,
    tracking_errors,
)
from accpinn.cthp import Parameters, Trajectories
from accpinn.estimators import least_squares, splines
from accpinn.fit import Fit
from accpinn.openacc import read
from accpinn.segment import Segment, cut
from tests.driving import LAW, MIXED, driven, segment_of

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
        """Table I, experiment 1: 0.47 m for the network's curve, some 13.6 m for the law."""
        segment = cut(read(openacc_dir / "Casale" / "part7.csv"), 0, 300)
        fit = with_parameters(segment, Parameters(0.0104, 0.0718, 1.52))
        errors = closed_loop_errors(segment, fit)
        assert errors is not None
        assert errors.gap_mae[0] == pytest.approx(13.6, abs=0.15)


class TestHeldOut:
    def test_the_law_is_learned_before_and_tested_after(self) -> None:
        """Truth before a border, another vehicle after it: only the second part may show that."""
        learned: list[Segment] = []

        def estimate(segment: Segment) -> Fit:
            learned.append(segment)
            return least_squares.fit(segment)

        segment = cut(read(SAMPLES / "synthetic_paper_study_noise_free.csv"), 0.0, 90.0)
        errors = held_out_errors(segment, estimate)
        assert errors is not None
        assert errors.gap_mae[0] < 0.02
        assert [piece.duration for piece in learned] == [pytest.approx(60.0, abs=0.2)]
        assert learned[0].start == 0.0
        later = replace(segment, gaps=np.where(segment.time[:, None] > 62, 5.0, segment.gaps))
        spoilt = held_out_errors(later, least_squares.fit)
        assert spoilt is not None
        assert spoilt.gap_mae[0] > 1.0

    def test_parts_keep_their_place_in_the_recording(self) -> None:
        segment = cut(read(SAMPLES / "synthetic_paper_study.csv"), 20.0, 60.0)
        piece = part(segment, 100, 300)
        assert piece.start == pytest.approx(30.0)
        assert piece.time[0] == 0.0
        assert piece.samples == 200
        np.testing.assert_array_equal(piece.gaps, segment.gaps[100:300])
