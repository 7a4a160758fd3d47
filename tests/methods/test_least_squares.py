"""Bounded least squares against scipy, on smoothed signals, and by splines."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import make_lsq_spline
from scipy.optimize import nnls

from accpinn.methods import least_squares, splines
from accpinn.methods.regression import solve_bounded
from accpinn.units import FloatArray
from tests.support.driving import LAW, MIXED, driven, segment_of


def test_smoothed_least_squares_leaves_cubics_as_they_are() -> None:
    """So the model holds exactly where the motion is a cubic, also at the window's ends."""
    time = 0.1 * np.arange(200)
    follower = 20 + 0.4 * time - 0.03 * time**2 + 0.0008 * time**3
    rate = 0.4 - 0.06 * time + 0.0024 * time**2
    ahead = 22 - 0.2 * time + 0.01 * time**2
    alpha, beta, tau = LAW
    gap = (rate - beta * (ahead - follower)) / alpha + tau * follower
    segment = segment_of(time, np.column_stack([ahead, follower]), gap[:, None])
    fit = least_squares.SMOOTHED.fit(segment)
    np.testing.assert_allclose(fit.parameters.values, [LAW], rtol=1e-6)
    np.testing.assert_allclose(fit.curves[0].speeds, segment.speeds, rtol=1e-9)


entries = st.floats(-10, 10).map(lambda value: round(value, 3))
problems = st.sampled_from([2, 3]).flatmap(
    lambda size: st.tuples(
        arrays(float, (12, size), elements=entries), arrays(float, 12, elements=entries)
    )
)


@given(problems)
def test_the_bounded_solution_is_the_optimum_that_scipy_finds_and_names_the_bounds_that_hold(
    problem: tuple[FloatArray, FloatArray],
) -> None:
    x, y = problem
    assume(np.linalg.cond(x) < 1e4)
    solution = solve_bounded(x.T @ x, x.T @ y)
    theta, held = solution.theta, solution.active
    assert (theta >= 0).all()
    reference = nnls(x, y)[1]
    assert np.linalg.norm(x @ theta - y) <= reference * (1 + 1e-8) + 1e-7
    assert (theta[held] == 0).all()
    # Where a bound holds, lowering the cost would take a step out of bounds.
    slope, scale = x.T @ (x @ theta - y), 1 + np.abs(x.T @ y)
    assert (slope[held] >= -1e-7 * scale[held]).all()
    assert (np.abs(slope[~held]) <= 1e-6 * scale[~held]).all()
    expected = np.linalg.lstsq(x, y)[0]
    np.testing.assert_allclose(solution.unconstrained, expected, rtol=1e-6, atol=1e-7)
    assert (solution.unconstrained >= 0).all() == (not held.any())


def test_the_loss_of_splines_is_that_of_their_trajectories() -> None:
    """A spline through the trajectories has their derivatives."""
    segment = driven(MIXED, noise=0.05)
    fit = splines.METHOD.fit(segment)
    time = segment.time
    knots = np.r_[[0.0] * 4, np.linspace(0, 60, 121), [60.0] * 4]
    speeds, gaps = fit.curves[0].speeds, fit.curves[0].gaps
    dv = make_lsq_spline(time, speeds, knots, 4).derivative()(time)
    dp = make_lsq_spline(time, gaps, knots, 4).derivative()(time)
    relative = speeds[:, :-1] - speeds[:, 1:]
    alpha, beta, tau = fit.parameters.values.T
    model = alpha * (gaps - tau * speeds[:, 1:]) + beta * relative
    physics = ((dp - relative) ** 2).sum() + ((dv[:, 1:] - model) ** 2).sum()
    assert fit.loss["physics"] == pytest.approx(physics / (segment.samples * 3), rel=1e-6)
    data = ((speeds - segment.speeds) ** 2).sum() + ((gaps - segment.gaps) ** 2).sum()
    assert fit.loss["data"] == pytest.approx(data / (segment.samples * 3), rel=1e-12)
    assert fit.loss["total"] == fit.loss["data"] + fit.loss["physics"]
