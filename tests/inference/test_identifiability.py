"""Profiles against brute force, and findings where the data determine the parameters weakly."""

import numpy as np
import pytest
from scipy.optimize import nnls

from accpinn import Case, Parameters, Segment, assess_quality, intervals, profiles
from accpinn.inference.identifiability import (
    INCREASE,
    WIDE,
    NarrowerIntervals,
    Profile,
    WeakIdentification,
    identifiability,
)
from accpinn.methods import least_squares
from accpinn.methods.regression import Regression
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW, MIXED, driven, segment_of, standing_still

TRUTH = Parameters.of([LAW])


def by_brute_force(segment: Segment, profile: Profile) -> list[float]:
    """The first follower's increase of S, by another solver on all rows."""
    regression = Regression.of(segment)
    theta = regression.solve("II").theta[0]
    least = float(((regression.rates[0] - regression.terms[0] @ theta) ** 2).sum())
    rates, (alpha, alpha_tau, beta) = regression.rates[0], regression.terms[0].T

    def squares(value: float) -> float:
        if profile.parameter == "α":
            rows, rest = (alpha_tau, beta), rates - value * alpha
        elif profile.parameter == "β":
            rows, rest = (alpha, alpha_tau), rates - value * beta
        else:
            rows, rest = (alpha + value * alpha_tau, beta), rates
        return float(nnls(np.column_stack(rows), rest)[1] ** 2)

    return [squares(value) / least - 1.0 for value in profile.values]


class TestProfiles:
    @pytest.mark.parametrize("beta", [LAW[1], 0.0])
    def test_every_point_is_the_minimum_over_the_others(self, beta: float) -> None:
        segment = driven(((LAW[0], beta, LAW[2]),), noise=0.1)
        for profile in profiles(segment)[0]:
            expected = by_brute_force(segment, profile)
            np.testing.assert_allclose(profile.increase, expected, rtol=1e-6, atol=1e-8)
        assert len(profiles(driven((LAW, LAW), noise=0.1), "I")) == 1

    def test_is_least_at_the_estimate_and_rises_to_the_named_increase_at_its_ends(self) -> None:
        segment = driven(MIXED, noise=0.1)
        estimate = least_squares.fit(segment).parameters.values
        for k, row in enumerate(profiles(segment)):
            for p, one in enumerate(row):
                assert one.best == pytest.approx(estimate[k, p], rel=1e-6)
                assert one.lower < one.best < one.upper
                assert (np.diff(one.values) > 0).all()
                ends = np.interp([one.lower, one.upper], one.values, one.increase)
                np.testing.assert_allclose(ends, INCREASE, rtol=0.03)

    def test_is_flat_where_nothing_moves(self) -> None:
        alpha, beta, tau = profiles(standing_still())[0]
        assert np.isinf(beta.upper)
        assert max(beta.increase.max(), 0.0) < INCREASE
        assert alpha.lower == 0.0
        assert tau.lower == 0.0

    def test_without_gap_control_no_headway_is_excluded(self) -> None:
        tau = profiles(driven(((-0.02, 0.5, 1.0),), noise=0.02))[0][2]
        assert np.isnan(tau.best), "α = 0 is the estimate"
        assert (tau.lower, tau.upper) == (0.0, np.inf)


class TestWarnings:
    def test_none_where_the_data_determine_the_parameters(self) -> None:
        segment = disturbed(TRUTH, 1, Disturbance(0.05, 4.0), duration=600.0)
        uncertainty = intervals(segment, least_squares.fit(segment))
        assert (uncertainty.upper.values < WIDE * uncertainty.lower.values).all(), (
            "the case needs narrow intervals"
        )
        quality = assess_quality(segment)
        assert identifiability(segment.info, quality, uncertainty, "II", 1e4) == ()

    def test_a_leader_at_constant_speed(self) -> None:
        rng = np.random.default_rng(0)
        time = 0.1 * np.arange(1201)
        speeds = 20 + 0.05 * rng.standard_normal((1201, 2))
        segment = segment_of(time, speeds, 30 + 0.05 * rng.standard_normal((1201, 1)))
        uncertainty = intervals(segment, least_squares.fit(segment))
        found, cure = identifiability(segment.info, assess_quality(segment), uncertainty)
        assert isinstance(found, WeakIdentification)
        assert found.wide
        assert found.leader_deviation == pytest.approx(0.05, abs=0.003)
        assert found.relative_deviation == pytest.approx(0.07, abs=0.005)
        assert cure == NarrowerIntervals((2,), 120.0, None, is_excited=False)

    @pytest.mark.usefixtures("all_draws")
    @pytest.mark.parametrize("case", ["I", "II"])
    def test_where_there_is_motion_a_longer_window_is_advised(self, case: Case) -> None:
        """Case I has one finding for all."""
        segment = disturbed(Parameters.of([LAW, LAW]), 1, Disturbance(0.6, 4.0), duration=30.0)
        assert segment.speeds[:, 0].std() > 0.5
        uncertainty = intervals(segment, least_squares.fit(segment, case))
        about = (segment.info, assess_quality(segment), uncertainty, case)
        *found, cure = identifiability(*about, 1523.0)
        assert [one.vehicle for one in found] == ([0] if case == "I" else [2, 3])
        assert all(one.is_excited and one.wide for one in found)
        assert cure == NarrowerIntervals((2, 3), 30.0, 1523.0, is_excited=True)
        *_, whole = identifiability(*about, 30.0)
        assert whole.recording is None, "a recording no longer than the window is no cure"
