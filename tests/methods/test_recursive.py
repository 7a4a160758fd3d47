"""Recursive least squares: the recursion as written, forgetting, and what it says of itself."""

import numpy as np
import pytest

from accpinn.methods import recursive
from accpinn.methods.fit import BoundActiveAtTimes, WeaklyDetermined
from accpinn.methods.online import TRACK_EVERY
from accpinn.model.cthp import regressors
from accpinn.segment.segment import Segment
from tests.support.driving import LAW, driven, in_turn, segment_of, standing_still

OTHER = (0.05, 0.3, 1.2)


def textbook(segment: Segment, memory: float) -> np.ndarray:
    """The last θ of the first follower by the covariance form, from a vague first guess."""
    terms = regressors(segment.speeds, segment.gaps)[0]
    rates = np.diff(segment.speeds[:, 1]) / segment.sample_time
    keep = np.exp(-segment.sample_time / memory)
    theta, covariance = np.zeros(3), 1e9 * np.eye(3)
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
        path = recursive.fit(segment, memory=memory).track
        np.testing.assert_allclose(np.diff(path.time), TRACK_EVERY)
        assert path.time[-1] == pytest.approx(60.0)
        assert path.parameters.values.shape == (len(path.time), 1, 3)
        alpha, alpha_tau, beta = textbook(segment, memory)
        np.testing.assert_allclose(
            path.parameters.values[-1, 0], (alpha, beta, alpha_tau / alpha), rtol=1e-5
        )

    def test_follows_parameters_that_change(self) -> None:
        path = recursive.fit(in_turn(([LAW], 120.0), ([OTHER], 180.0)), memory=20.0).track
        before = path.parameters.values[path.time < 120][-1, 0]
        np.testing.assert_allclose(before, LAW, rtol=1e-3)
        np.testing.assert_allclose(path.parameters.values[-1, 0], OTHER, rtol=0.02)

    def test_parameters_are_the_mean_after_one_memory(self) -> None:
        fit = recursive.fit(driven((LAW,), duration=100.0, noise=0.05), memory=30.0)
        settled = fit.track.parameters.values[fit.track.time >= 30.0, 0]
        alpha, beta, tau = settled.T
        expected = (alpha.mean(), beta.mean(), (alpha * tau).mean() / alpha.mean())
        np.testing.assert_allclose(fit.parameters.values[0], expected, rtol=1e-12)

    def test_midpoints_keep_white_noise_from_biasing_it(self) -> None:
        """A forward difference on (p, v) at its start would find β too large by a third."""
        segment = driven((LAW,), duration=300.0, noise=0.1)
        found = recursive.fit(segment).parameters.values[0]
        np.testing.assert_allclose(found, LAW, rtol=0.05)
        v, rows = segment.speeds[:, 1], regressors(segment.speeds, segment.gaps)[0, :-1]
        forward = np.linalg.lstsq(rows, np.diff(v) / 0.1, rcond=None)[0]
        assert forward[2] > 1.3 * LAW[1]


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
            path = recursive.fit(segment_of(base.time, speeds, gaps)).track
            misses.append((path.parameters.values[-1, 0] - LAW) / path.deviation[-1, 0])
        assert 0.5 < np.sqrt(np.mean(np.square(misses))) < 1.5

    def test_reports_what_is_never_determined(self) -> None:
        fit = recursive.fit(standing_still())
        assert np.isnan(fit.track.parameters.values).all()
        assert fit.findings == (WeaklyDetermined(2),)

    def test_reports_for_how_long_a_bound_was_active(self) -> None:
        fit = recursive.fit(driven((LAW,), duration=100.0, noise=0.5), memory=3.0)
        assert fit.active_bounds == ((),)
        found = [f for f in fit.findings if isinstance(f, BoundActiveAtTimes)]
        assert found
        assert all(0 < finding.share < 1 for finding in found)
        assert (fit.parameters.values >= 0).all()
