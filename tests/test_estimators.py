"""All estimators: the truth recovered, bounds and bad data; least squares and splines in detail."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_lsq_spline
from scipy.optimize import minimize

from accpinn.errors import SegmentError
from accpinn.evaluation.closed_loop import surrogate_errors
from accpinn.methods import least_squares, simulation, splines
from accpinn.methods.fit import Fit, Outcome
from accpinn.model.cthp import Case
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from tests.driving import LAW, MIXED, driven, segment_of, standing_still
from tests.support.methods import RIVALS as ESTIMATORS

Estimator = Callable[[Segment, Case], Fit]

FILTERS = ("particle", "dual-ukf")
"""They take the law's shortfall to be large and have tolerances of their own, in their tests."""
PRECISE = {name: method for name, method in ESTIMATORS.items() if name not in FILTERS}

every_method = pytest.mark.parametrize("estimate", ESTIMATORS.values(), ids=list(ESTIMATORS))
precise_method = pytest.mark.parametrize("estimate", PRECISE.values(), ids=list(PRECISE))


@cache
def casale(folder: Path) -> Segment:
    return cut(read(folder / "Casale" / "part7.csv"), 0, 300)


@cache
def astazero(folder: Path) -> Segment:
    return cut(read(folder / "AstaZero" / "ASta_040719_platoon5.csv"), 320, 300)


class TestEvery:
    @precise_method
    def test_recovers_the_truth(self, estimate: Estimator) -> None:
        fit = estimate(driven(MIXED, duration=100.0), "II")
        # Central differences of sines at up to 0.4 rad/s are 3e-4 short.
        np.testing.assert_allclose(fit.parameters.values, MIXED, rtol=2e-3)

    @precise_method
    def test_recovers_it_from_noisy_data(self, estimate: Estimator) -> None:
        fit = estimate(driven(MIXED, duration=100.0, noise=0.02), "II")
        np.testing.assert_allclose(fit.parameters.values, MIXED, rtol=0.03)

    @precise_method
    def test_gives_one_law_in_case_i(self, estimate: Estimator) -> None:
        same = driven((LAW, LAW, LAW))
        fit = estimate(same, "I")
        assert len(set(fit.parameters)) == 1
        np.testing.assert_allclose(fit.parameters.values, [LAW] * 3, rtol=1e-3)

    @precise_method
    def test_holds_the_bounds_and_says_so(self, estimate: Estimator) -> None:
        fit = estimate(driven(((0.08, -0.03, 1.5), LAW)), "II")
        assert fit.active_bounds == (("β",), ())
        assert fit.parameters[0].beta == 0
        free = fit.unconstrained[0]
        assert (free.alpha, free.beta, free.tau) == pytest.approx((0.08, -0.03, 1.5), rel=0.1)
        assert any("hold β at zero" in note for note in fit.notes)

    @every_method
    def test_names_itself_and_its_end(self, estimate: Estimator) -> None:
        fit = estimate(driven(), "II")
        assert ESTIMATORS[fit.method] is estimate
        assert fit.outcome in (Outcome.SOLVED, Outcome.CONVERGED, Outcome.FILTERED)
        assert fit.case == "II"
        assert fit.seconds > 0

    @every_method
    @pytest.mark.parametrize("speed", [0.0, 20.0])
    def test_survives_data_without_motion(self, estimate: Estimator, speed: float) -> None:
        fit = estimate(standing_still(speed), "II")
        assert fit.outcome is not Outcome.DIVERGED
        assert (fit.parameters.values[:, :2] >= 0).all()

    @every_method
    @pytest.mark.parametrize("samples", [2, 3, 4, 5, 10])
    def test_survives_tiny_windows(self, estimate: Estimator, samples: int) -> None:
        whole = driven(MIXED)
        tiny = segment_of(whole.time[:samples], whole.speeds[:samples], whole.gaps[:samples])
        if samples < 5 and estimate in (splines.fit, simulation.fit):
            with pytest.raises(SegmentError, match="too few for a spline; take a window of"):
                estimate(tiny, "II")
        else:
            assert (estimate(tiny, "II").parameters.values[:, :2] >= 0).all()

    @every_method
    @pytest.mark.parametrize("case", ["I", "II"])
    def test_handles_ten_followers(self, estimate: Estimator, case: Case) -> None:
        fit = estimate(driven((LAW,) * 10, noise=0.02), case)
        assert fit.parameters.values.shape == (10, 3)
        assert len(fit.active_bounds) == 10
        np.testing.assert_allclose(fit.parameters.values, [LAW] * 10, rtol=0.2)
        assert len(set(fit.parameters)) == (1 if case == "I" else 10)

    @every_method
    def test_survives_a_recording_of_noise(self, estimate: Estimator) -> None:
        rng = np.random.default_rng(0)
        values = 100 * rng.standard_normal((301, 5))
        fit = estimate(segment_of(0.1 * np.arange(301), values[:, :3], values[:, 3:]), "II")
        assert (fit.parameters.values[:, :2] >= 0).all()
        assert not (fit.parameters.values[:, 2] < 0).any()

    @every_method
    def test_is_the_same_every_time(self, estimate: Estimator) -> None:
        first, second = (estimate(driven(MIXED, noise=0.05), "II") for _ in range(2))
        np.testing.assert_array_equal(first.parameters.values, second.parameters.values)
        if first.track is not None:
            assert second.track is not None
            np.testing.assert_array_equal(first.track.parameters, second.track.parameters)

    @every_method
    def test_settings_fit_into_json(self, estimate: Estimator) -> None:
        fit = estimate(driven(), "II")
        assert json.loads(json.dumps(fit.config)) == fit.config

    @precise_method
    def test_hardly_minds_followers_behind(self, estimate: Estimator) -> None:
        alone, behind = estimate(driven((LAW,)), "II"), estimate(driven(MIXED), "II")
        np.testing.assert_allclose(
            behind.parameters.values[0], alone.parameters.values[0], rtol=1e-3
        )


class TestLeastSquares:
    @pytest.mark.parametrize("case", ["I", "II"])
    def test_is_numpys_solution_on_central_differences(self, case: Case) -> None:
        segment = driven(MIXED, noise=0.02)
        v, p = segment.speeds, segment.gaps
        blocks, goals = [], []
        for i in range(1, 4):
            acceleration = (v[2:, i] - v[:-2, i]) / 0.2
            gap, own, ahead = p[1:-1, i - 1], v[1:-1, i], v[1:-1, i - 1]
            blocks.append(np.column_stack([gap, -own, ahead - own]))
            goals.append(acceleration)
        if case == "I":
            blocks, goals = [np.vstack(blocks)] * 3, [np.concatenate(goals)] * 3
        fit = least_squares.fit(segment, case)
        for law, rows, goal in zip(fit.parameters, blocks, goals, strict=True):
            alpha, alpha_tau, beta = np.linalg.lstsq(rows, goal, rcond=None)[0]
            expected = (alpha, beta, alpha_tau / alpha)
            # Ours also has the two ends, where the difference is one-sided.
            assert (law.alpha, law.beta, law.tau) == pytest.approx(expected, rel=0.02)

    def test_has_no_trajectories_of_its_own(self) -> None:
        fit = least_squares.fit(driven())
        assert fit.surrogate is None
        assert surrogate_errors(driven(), fit) is None

    def test_on_casale(self, openacc_dir: Path) -> None:
        """A 3x3 solve on central differences is already near the network's numbers."""
        (law,) = least_squares.fit(casale(openacc_dir)).parameters
        v, p = casale(openacc_dir).speeds, casale(openacc_dir).gaps
        rows = np.column_stack([p, -v[:, 1], v[:, 0] - v[:, 1]])
        alpha, alpha_tau, beta = np.linalg.lstsq(rows, np.gradient(v[:, 1], 0.1), rcond=None)[0]
        assert (law.alpha, law.beta, law.tau) == pytest.approx(
            (alpha, beta, alpha_tau / alpha), rel=1e-6
        )
        assert (law.alpha, law.beta, law.tau) == pytest.approx((0.0105, 0.0708, 1.523), rel=5e-3)


class TestSplines:
    def test_data_loss_is_that_of_its_trajectories(self) -> None:
        segment = driven(MIXED, noise=0.05)
        fit = splines.fit(segment)
        assert fit.surrogate is not None
        data = ((fit.surrogate.speeds - segment.speeds) ** 2).sum()
        data += ((fit.surrogate.gaps - segment.gaps) ** 2).sum()
        assert fit.loss["data"] == pytest.approx(data / (segment.samples * 3), rel=1e-12)
        assert fit.loss["total"] == fit.loss["data"] + fit.loss["physics"]

    def test_physics_loss_is_that_of_its_trajectories(self) -> None:
        """A spline through the trajectories has their derivatives."""
        segment = driven(MIXED, noise=0.05)
        fit = splines.fit(segment)
        assert fit.surrogate is not None
        time = segment.time
        knots = np.r_[[0.0] * 4, np.linspace(0, 60, 121), [60.0] * 4]
        speeds, gaps = fit.surrogate.speeds, fit.surrogate.gaps
        dv = make_lsq_spline(time, speeds, knots, 4).derivative()(time)
        dp = make_lsq_spline(time, gaps, knots, 4).derivative()(time)
        relative = speeds[:, :-1] - speeds[:, 1:]
        alpha, beta, tau = fit.parameters.values.T
        law = alpha * (gaps - tau * speeds[:, 1:]) + beta * relative
        physics = ((dp - relative) ** 2).sum() + ((dv[:, 1:] - law) ** 2).sum()
        assert fit.loss["physics"] == pytest.approx(physics / (segment.samples * 3), rel=1e-6)

    def test_no_other_law_has_a_lower_loss(self) -> None:
        """Ψ, minimised over the splines, as a function of the law alone."""
        segment = driven((LAW,), noise=0.05)
        fit = splines.fit(segment)
        basis = splines._Basis(segment.time, splines.KNOTS_EVERY)

        def lowest(theta: np.ndarray) -> float:
            basis.smooth(segment, theta[None] * scale)
            return 1e3 * basis.loss(segment, theta[None] * scale)["total"]

        scale = fit.parameters[0].theta
        found = minimize(lowest, [0.9, 1.1, 0.8], method="Nelder-Mead", options={"xatol": 1e-6})
        np.testing.assert_allclose(found.x, 1.0, atol=2e-4)
        assert 1e3 * fit.loss["total"] <= found.fun * (1 + 1e-9)

    def test_finer_knots_change_little(self) -> None:
        segment = driven(noise=0.05)
        coarse, fine = splines.fit(segment, knots_every=1.0), splines.fit(segment)
        np.testing.assert_allclose(fine.parameters.values, coarse.parameters.values, rtol=1e-3)
        assert fine.loss["total"] <= coarse.loss["total"] * (1 + 1e-6)

    @pytest.mark.parametrize("step", [0.05, 0.5, 1.0])
    def test_other_sampling_times_than_the_recordings(self, step: float) -> None:
        fit = splines.fit(driven(step=step, duration=100.0))
        np.testing.assert_allclose(fit.parameters.values, [LAW], rtol=0.02)
        assert fit.config["knots_every"] == max(0.5, 5 * step)

    def test_are_fast(self) -> None:
        assert splines.fit(driven(duration=300.0)).seconds < 1.0  # we see 0.02 s


def rows(fit: Fit) -> list[tuple[float, float, float]]:
    return [(law.alpha, law.beta, law.tau) for law in fit.parameters]


class TestLimitOnRealRecordings:
    """The limits of the loss published with the method, to one unit of their last digit."""

    @staticmethod
    def assert_limit(fit: Fit, expected: list[tuple[float, float, float]], *units: float) -> None:
        for (alpha, beta, tau), limit in zip(rows(fit), expected, strict=True):
            assert alpha == pytest.approx(limit[0], abs=units[0])
            assert beta == pytest.approx(limit[1], abs=units[1])
            assert tau == pytest.approx(limit[2], abs=units[2])

    def test_casale(self, openacc_dir: Path) -> None:
        fit = splines.fit(casale(openacc_dir))
        self.assert_limit(fit, [(0.01045, 0.07176, 1.5222)], 1e-5, 1e-5, 1.5e-4)

    def test_astazero_case_i(self, openacc_dir: Path) -> None:
        fit = splines.fit(astazero(openacc_dir), "I")
        self.assert_limit(fit, [(0.0638, 0.2604, 1.171)] * 4, 1e-4, 1e-4, 1e-3)

    def test_astazero_case_ii(self, openacc_dir: Path) -> None:
        fit = splines.fit(astazero(openacc_dir), "II")
        expected = [
            (0.0615, 0.1197, 1.197),
            (0.1058, 0.1291, 1.176),
            (0.0766, 0.2299, 1.152),
            (0.0410, 0.4327, 1.155),
        ]
        self.assert_limit(fit, expected, 1e-4, 1e-4, 1e-3)
