"""Online methods: recursive least squares, particle filter and dual unscented Kalman filter."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.methods import Method, Segments, dual_ukf, particle, recursive
from accpinn.methods.estimate import Outcome
from accpinn.methods.findings import BoundActive, BoundActiveAtTimes, FilterDiverged
from accpinn.methods.online import TRACK_EVERY, in_turn
from accpinn.model.cthp import regressors
from accpinn.recordings import Recording
from accpinn.segment.cut import cut
from tests.support.driving import LAW, MIXED, driven, segment_of
from tests.support.driving import in_turn as driven_in_turn

both_filters = pytest.mark.parametrize(
    "method", [particle.METHOD, dual_ukf.METHOD], ids=["particle", "dual-ukf"]
)


class TestBoth:
    @both_filters
    def test_follows_parameters_that_change(self, method: Method) -> None:
        segment = driven_in_turn(([LAW], 150.0), ([(0.08, 0.12, 1.2)], 200.0))
        path = method.fit(segment).track
        assert path.parameters.values[path.time < 150][-1, 0, 2] == pytest.approx(1.5, abs=0.02)
        assert path.parameters.values[-1, 0, 2] == pytest.approx(1.2, abs=0.12)

    @both_filters
    def test_ends_with_the_track_and_stays_with_the_recording(self, method: Method) -> None:
        segment = driven(MIXED, noise=0.05)
        fit = method.fit(segment)
        assert fit.outcome is Outcome.FILTERED
        assert fit.track.time[-1] == pytest.approx(60.0)
        np.testing.assert_allclose(
            fit.parameters.values, fit.track.parameters.values[-1], rtol=1e-12
        )
        assert (fit.track.deviation > 0).all()
        np.testing.assert_array_equal(fit.curves[0].speeds[:, 0], segment.speeds[:, 0])
        assert abs(fit.curves[0].gaps - segment.gaps).mean() < 0.05
        assert abs(fit.curves[0].speeds - segment.speeds).mean() < 0.05


class TestDualUnscented:
    def test_ends_at_the_most_likely_parameters_within_bounds(self) -> None:
        fit = dual_ukf.METHOD.fit(driven(((0.08, -0.03, 1.5), LAW), duration=100.0))
        assert fit.active_bounds == (("β",), ())
        assert fit.parameters[0].beta == 0
        assert fit.unconstrained[0].beta == pytest.approx(-0.03, abs=0.005)
        assert any(isinstance(finding, BoundActive) for finding in fit.findings)
        assert (fit.track.parameters.values >= 0).all()

    def test_agrees_with_another_implementation(self, astazero: Recording) -> None:
        """The same two filters, built from filterpy 2.0's UnscentedKalmanFilter, ended here."""
        fit = dual_ukf.METHOD.fit(cut(astazero, 320, 300, (1, 2)))
        expected = (0.06166485, 0.07337146, 0.11083167)
        np.testing.assert_allclose(fit.parameters[0].theta, expected, rtol=1e-5)


class TestParticles:
    def test_every_particle_stays_within_bounds(self) -> None:
        fit = particle.METHOD.fit(driven(((0.08, -0.03, 1.5), LAW), duration=100.0))
        assert (fit.track.parameters.values > 0).all()
        assert 0 < fit.parameters[0].beta < 0.04
        assert fit.active_bounds == ((), ())
        assert any((f.vehicle, f.name) == (2, "β") for f in fit.findings)


def test_jumps_that_no_vehicle_makes_end_in_a_diverged_fit() -> None:
    """Within what a file may hold, but a covariance of the filter turns indefinite."""
    rng = np.random.default_rng(0)
    speeds, gaps = rng.uniform(-200, 200, (801, 2)), rng.uniform(-9999, 9999, (801, 1))
    fit = dual_ukf.METHOD.fit(segment_of(0.1 * np.arange(801), speeds, gaps))
    assert fit.outcome is Outcome.DIVERGED
    assert np.isnan(fit.parameters.values).all()
    assert len(fit.unconstrained) == len(fit.active_bounds) == 1
    assert fit.findings == (FilterDiverged(),)


OTHER = (0.06, 0.2, 1.3)


def two_windows(first: float) -> Segments:
    """Windows of different laws, of which the first lasts so many seconds and the second 60 s."""
    return (
        replace(driven((LAW,), first, noise=0.05), start=50.0),
        replace(driven((OTHER,), noise=0.05), start=250.0),
    )


class TestWindows:
    @both_filters
    def test_the_next_one_begins_with_what_is_known(self, method: Method) -> None:
        first, second = two_windows(60.0)
        path, alone = method.fit((first, second)).track, method.fit(first).track
        assert path.time[[0, -1]] == pytest.approx([alone.time[0], 260.0])
        begun = path.time < 100
        np.testing.assert_array_equal(path.time[begun], alone.time)
        np.testing.assert_array_equal(path.parameters.values[begun], alone.parameters.values)
        assert path.time[~begun][0] == pytest.approx(200.5)
        change = path.parameters.values[~begun][0] - alone.parameters.values[-1]
        assert (abs(change) < 0.5 * alone.deviation[-1]).all()
        assert (path.deviation[~begun][0] < 1.1 * alone.deviation[-1]).all()

    @both_filters
    def test_the_motion_begins_with_each(self, method: Method) -> None:
        """The motion at the end of the window before it would be metres off."""
        segments = two_windows(60.0)
        for segment, curves in zip(segments, method.fit(segments).curves, strict=True):
            np.testing.assert_array_equal(curves.gaps[0], segment.gaps[0])
            assert abs(curves.gaps - segment.gaps)[:20].max() < 0.3

    def test_those_of_a_further_recording_follow_the_former_ones(self) -> None:
        first, second = two_windows(60.0)
        early = replace(driven((OTHER,), 30.0), source="another", start=10.0)
        turns = in_turn((second, early, first))
        assert [turn.index for turn in turns] == [2, 0, 1]
        assert [turn.begin for turn in turns] == [0.0, 200.0, 260.0]


def textbook(segments: Segments, memory: float) -> np.ndarray:
    """The last θ of the first follower by the covariance form, from a vague first guess."""
    theta, covariance = np.zeros(3), 1e9 * np.eye(3)
    for segment in segments:
        terms = regressors(segment.speeds, segment.gaps)[0]
        rates = np.diff(segment.speeds[:, 1]) / segment.sample_time
        keep = np.exp(-segment.sample_time / memory)
        for before, after, rate in zip(terms[:-1], terms[1:], rates, strict=True):
            row = (before + after) / 2
            gain = covariance @ row / (keep + row @ covariance @ row)
            theta = theta + gain * (rate - row @ theta)
            covariance = (covariance - np.outer(gain, row @ covariance)) / keep
    return theta


class TestRecursion:
    @pytest.mark.parametrize("memory", [20.0, 60.0])
    def test_last_estimate_is_the_textbooks(self, memory: float) -> None:
        segment = driven((LAW,), noise=0.05)
        path = recursive.fit((segment,), memory=memory).track
        np.testing.assert_allclose(np.diff(path.time), TRACK_EVERY)
        assert path.time[-1] == pytest.approx(60.0)
        assert path.parameters.values.shape == (len(path.time), 1, 3)
        alpha, alpha_tau, beta = textbook((segment,), memory)
        np.testing.assert_allclose(
            path.parameters.values[-1, 0], (alpha, beta, alpha_tau / alpha), rtol=1e-5
        )

    def test_several_windows_are_one_recursion(self) -> None:
        segments = two_windows(60.0)
        path = recursive.fit(segments, memory=100.0).track
        alpha, alpha_tau, beta = textbook(segments, 100.0)
        np.testing.assert_allclose(
            path.parameters.values[-1, 0], (alpha, beta, alpha_tau / alpha), rtol=1e-5
        )

    @pytest.mark.parametrize(
        ("segments", "settled_from"),
        [((driven((LAW,), 100.0, noise=0.05),), 30.0), (two_windows(20.0), 200.0 + 10.0)],
        ids=["one window", "two windows"],
    )
    def test_parameters_are_the_mean_after_a_memory_of_driving(
        self, segments: Segments, settled_from: float
    ) -> None:
        fit = recursive.fit(segments, memory=30.0)
        settled = fit.track.parameters.values[fit.track.time >= settled_from, 0]
        alpha, beta, tau = settled.T
        expected = (alpha.mean(), beta.mean(), (alpha * tau).mean() / alpha.mean())
        np.testing.assert_allclose(fit.parameters.values[0], expected, rtol=1e-12)


class TestUncertainty:
    def test_deviations_cover_independent_errors(self) -> None:
        """The acceleration has white errors and nothing else has: the textbook case."""
        base = driven((LAW,), duration=200.0)
        rng = np.random.default_rng(5)
        misses = []
        for _ in range(20):
            speeds = base.speeds.copy()
            gaps = base.gaps.copy()
            extra = 0.002 * rng.standard_normal(base.samples)
            speeds[:, 1] += np.cumsum(extra)
            # The model, taken at the noisy motion, explains all but the white part.
            alpha, beta, tau = LAW
            shift = speeds[:, 1] - base.speeds[:, 1]
            gaps[:, 0] += (beta + alpha * tau) * shift / alpha
            path = recursive.METHOD.fit(segment_of(base.time, speeds, gaps)).track
            misses.append((path.parameters.values[-1, 0] - LAW) / path.deviation[-1, 0])
        assert 0.5 < np.sqrt(np.mean(np.square(misses))) < 1.5

    def test_reports_for_how_long_a_bound_was_active(self) -> None:
        fit = recursive.fit((driven((LAW,), duration=100.0, noise=0.5),), memory=3.0)
        assert fit.active_bounds == ((),)
        findings = [f for f in fit.findings if isinstance(f, BoundActiveAtTimes)]
        assert findings
        assert all(0 < finding.share < 1 for finding in findings)
        assert (fit.parameters.values >= 0).all()
