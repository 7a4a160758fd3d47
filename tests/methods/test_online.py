"""Particle filter and dual unscented Kalman filter, and what both are made of.

Tolerances: both filters assume a model error as large as on real roads, so on a synthetic drive of
300 s they are less certain than batch methods.
"""

from collections.abc import Callable

import numpy as np
import pytest

from accpinn.methods import dual_ukf, particle
from accpinn.methods.fit import BoundActive, FilterDiverged, Fit, Outcome
from accpinn.model.cthp import Case
from accpinn.recordings.recording import Recording
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from tests.support.driving import LAW, MIXED, driven, in_turn, segment_of

both_filters = pytest.mark.parametrize(
    "estimate", [particle.fit, dual_ukf.fit], ids=["particle", "dual-ukf"]
)
Estimator = Callable[[Segment, Case], Fit]


class TestBoth:
    @both_filters
    def test_follows_parameters_that_change(self, estimate: Estimator) -> None:
        segment = in_turn(([LAW], 300.0), ([(0.08, 0.12, 1.2)], 300.0))
        path = estimate(segment, "II").track
        assert path.parameters.values[path.time < 300][-1, 0, 2] == pytest.approx(1.5, abs=0.02)
        assert path.parameters.values[-1, 0, 2] == pytest.approx(1.2, abs=0.12)

    @both_filters
    def test_ends_with_the_track_and_stays_with_the_recording(self, estimate: Estimator) -> None:
        segment = driven(MIXED, noise=0.05)
        fit = estimate(segment, "II")
        assert fit.outcome is Outcome.FILTERED
        assert fit.track.time[-1] == pytest.approx(60.0)
        np.testing.assert_allclose(
            fit.parameters.values, fit.track.parameters.values[-1], rtol=1e-12
        )
        assert (fit.track.deviation > 0).all()
        np.testing.assert_array_equal(fit.surrogate.speeds[:, 0], segment.speeds[:, 0])
        assert abs(fit.surrogate.gaps - segment.gaps).mean() < 0.05
        assert abs(fit.surrogate.speeds - segment.speeds).mean() < 0.05

    @both_filters
    def test_is_uncertain_near_equilibrium(self, estimate: Estimator, astazero: Recording) -> None:
        """A minute of AstaZero in which the leader's speed varies by less than 0.1 m/s."""
        fit = estimate(cut(astazero, 520, 60, (1, 2)), "II")
        alpha, beta, _ = fit.track.deviation[-1, 0]
        assert alpha > 0.03
        assert beta > 0.2
        assert fit.findings != ()


class TestDualUnscented:
    def test_ends_at_the_most_likely_parameters_within_bounds(self) -> None:
        fit = dual_ukf.fit(driven(((0.08, -0.03, 1.5), LAW), duration=200.0))
        assert fit.active_bounds == (("β",), ())
        assert fit.parameters[0].beta == 0
        assert fit.unconstrained[0].beta == pytest.approx(-0.03, abs=0.005)
        assert any(isinstance(finding, BoundActive) for finding in fit.findings)
        assert (fit.track.parameters.values >= 0).all()

    def test_agrees_with_another_implementation(self, astazero: Recording) -> None:
        """The same two filters, built from filterpy 2.0's UnscentedKalmanFilter, ended here."""
        fit = dual_ukf.fit(cut(astazero, 320, 300, (1, 2)))
        expected = (0.06166485, 0.07337146, 0.11083167)
        np.testing.assert_allclose(fit.parameters[0].theta, expected, rtol=1e-5)


class TestParticles:
    def test_seed_decides(self) -> None:
        segment = driven((LAW,), noise=0.05)
        first, same, other = (
            particle.fit(segment, seed=seed).parameters.values for seed in (0, 0, 1)
        )
        np.testing.assert_array_equal(first, same)
        assert (first != other).all()
        np.testing.assert_allclose(first, other, rtol=0.15)

    def test_every_particle_stays_within_bounds(self) -> None:
        fit = particle.fit(driven(((0.08, -0.03, 1.5), LAW), duration=200.0))
        assert (fit.track.parameters.values > 0).all()
        assert 0 < fit.parameters[0].beta < 0.04
        assert fit.active_bounds == ((), ())
        assert any((f.vehicle, f.name) == (2, "β") for f in fit.findings)


def test_jumps_that_no_vehicle_makes_end_in_a_diverged_fit() -> None:
    """Within what a file may hold, but a covariance of the filter turns indefinite."""
    rng = np.random.default_rng(0)
    speeds, gaps = rng.uniform(-200, 200, (801, 2)), rng.uniform(-9999, 9999, (801, 1))
    fit = dual_ukf.fit(segment_of(0.1 * np.arange(801), speeds, gaps))
    assert fit.outcome is Outcome.DIVERGED
    assert np.isnan(fit.parameters.values).all()
    assert len(fit.unconstrained) == len(fit.active_bounds) == 1
    assert fit.findings == (FilterDiverged(),)
