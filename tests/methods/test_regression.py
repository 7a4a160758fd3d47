"""Bounded least squares against scipy, and the rows of a regression."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import nnls

from accpinn.methods.regression import Solution, solve_bounded
from accpinn.units import FloatArray

entries = st.floats(-10, 10).map(lambda value: round(value, 3))
problems = st.sampled_from([2, 3]).flatmap(
    lambda size: st.tuples(
        arrays(float, (12, size), elements=entries), arrays(float, 12, elements=entries)
    )
)


def solve(problem: tuple[FloatArray, FloatArray]) -> Solution:
    x, y = problem
    return solve_bounded(x.T @ x, x.T @ y)


class TestSolveBounded:
    @given(problems)
    def test_reaches_the_optimum_that_scipy_finds_and_names_the_bounds_that_hold(
        self, problem: tuple[FloatArray, FloatArray]
    ) -> None:
        x, y = problem
        assume(np.linalg.cond(x) < 1e4)
        solution = solve(problem)
        found, held = solution.theta, solution.active
        assert (found >= 0).all()
        reference = nnls(x, y)[1]
        assert np.linalg.norm(x @ found - y) <= reference * (1 + 1e-8) + 1e-7
        assert (found[held] == 0).all()
        # Where a bound holds, lowering the cost would take a step out of bounds.
        slope, scale = x.T @ (x @ found - y), 1 + np.abs(x.T @ y)
        assert (slope[held] >= -1e-7 * scale[held]).all()
        assert (np.abs(slope[~held]) <= 1e-6 * scale[~held]).all()
        expected = np.linalg.lstsq(x, y)[0]
        np.testing.assert_allclose(solution.unconstrained, expected, rtol=1e-6, atol=1e-7)
        assert (solution.unconstrained >= 0).all() == (not held.any())

    def test_survives_collinear_data(self) -> None:
        # Constant speed: gap, speed and a zero relative speed leave α and ατ inseparable.
        x = np.tile([30.0, -20.0, 0.0], (50, 1))
        solution = solve((x, np.zeros(50)))
        assert np.isfinite(solution.theta).all()
        assert (solution.theta >= 0).all()
