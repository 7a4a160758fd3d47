"""The law: its parameters, its least squares within bounds, and its exact simulation."""

from dataclasses import FrozenInstanceError
from itertools import pairwise
from math import isnan

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import solve_ivp
from scipy.optimize import lsq_linear, nnls

from accpinn.model.cthp import (
    LINEAR_NAMES,
    LinearSolution,
    Parameters,
    motion_matrix,
    orbit,
    regressors,
    simulate,
    solve_linear,
)
from accpinn.units import FloatArray

rates = st.floats(0.001, 2.0)
laws = st.builds(Parameters, alpha=rates, beta=st.floats(0.0, 2.0), tau=st.floats(0.1, 4.0))
entries = st.floats(-10, 10).map(lambda value: round(value, 3))
problems = st.tuples(arrays(float, (12, 3), elements=entries), arrays(float, 12, elements=entries))


def solve(problem: tuple[FloatArray, FloatArray]) -> LinearSolution:
    x, y = problem
    return solve_linear(x.T @ x, x.T @ y)


class TestParameters:
    @given(laws)
    def test_survive_the_way_through_theta(self, law: Parameters) -> None:
        back = Parameters.from_theta(law.theta)
        assert (back.alpha, back.beta) == (law.alpha, law.beta)
        assert back.tau == pytest.approx(law.tau, rel=1e-14)

    def test_theta_is_alpha_alphatau_beta(self) -> None:
        np.testing.assert_allclose(Parameters(0.08, 0.12, 1.5).theta, [0.08, 0.12, 0.12])
        assert LINEAR_NAMES == ("α", "ατ", "β")

    def test_without_alpha_tau_is_unknown(self) -> None:
        law = Parameters.from_theta(np.array([0.0, 0.0, 0.3]))
        assert law.alpha == 0
        assert law.beta == 0.3
        assert isnan(law.tau)
        np.testing.assert_array_equal(law.theta, [0.0, 0.0, 0.3])

    def test_cannot_be_changed(self) -> None:
        with pytest.raises(FrozenInstanceError):
            Parameters(1.0, 1.0, 1.0).alpha = 2.0  # type: ignore[misc]


class TestRegressors:
    def test_have_one_block_a_follower_with_gap_minus_speed_and_relative_speed(self) -> None:
        speeds = np.array([[20.0, 19.0, 21.0], [22.0, 20.0, 20.5]])
        gaps = np.array([[30.0, 25.0], [31.0, 24.0]])
        found = regressors(speeds, gaps)
        assert found.shape == (2, 2, 3)
        np.testing.assert_array_equal(found[0], [[30.0, -19.0, 1.0], [31.0, -20.0, 2.0]])
        np.testing.assert_array_equal(found[1], [[25.0, -21.0, -2.0], [24.0, -20.5, -0.5]])

    @given(laws, st.floats(0, 40), st.floats(0, 40), st.floats(0, 200))
    def test_times_theta_are_the_acceleration(
        self, law: Parameters, ahead: float, speed: float, gap: float
    ) -> None:
        row = regressors(np.array([[ahead, speed]]), np.array([[gap]]))[0, 0]
        expected = law.alpha * (gap - law.tau * speed) + law.beta * (ahead - speed)
        assert row @ law.theta == pytest.approx(expected, abs=1e-9)


class TestSolveLinear:
    @given(problems)
    def test_reaches_the_optimum_that_scipy_finds(
        self, problem: tuple[FloatArray, FloatArray]
    ) -> None:
        x, y = problem
        assume(np.linalg.cond(x) < 1e4)
        found = solve(problem).theta
        assert (found >= 0).all()
        np.testing.assert_allclose(found, nnls(x, y)[0], rtol=1e-6, atol=1e-7)
        reference = lsq_linear(x, y, bounds=(0, np.inf), tol=1e-14)
        cost = 0.5 * float(np.sum((x @ found - y) ** 2))
        assert cost <= reference.cost * (1 + 1e-8) + 1e-9

    @given(problems)
    def test_names_exactly_the_bounds_that_hold_it(
        self, problem: tuple[FloatArray, FloatArray]
    ) -> None:
        x, y = problem
        assume(np.linalg.cond(x) < 1e4)
        solution = solve(problem)
        held = [name in solution.active for name in LINEAR_NAMES]
        assert (solution.theta[held] == 0).all()
        # Where a bound holds, lowering the cost would take a step out of bounds.
        slope = x.T @ (x @ solution.theta - y)
        scale = 1 + np.abs(x.T @ y)
        assert (slope[held] >= -1e-7 * scale[held]).all()
        free = np.logical_not(held)
        assert (np.abs(slope[free]) <= 1e-6 * scale[free]).all()

    @given(problems)
    def test_keeps_the_unconstrained_optimum(self, problem: tuple[FloatArray, FloatArray]) -> None:
        x, y = problem
        assume(np.linalg.cond(x) < 1e4)
        solution = solve(problem)
        np.testing.assert_allclose(
            solution.unconstrained, np.linalg.lstsq(x, y)[0], rtol=1e-6, atol=1e-7
        )
        inside = bool((solution.unconstrained >= 0).all())
        assert inside == (solution.active == ())

    def test_a_negative_beta_is_held_at_zero_and_said(self) -> None:
        x = np.eye(3)
        solution = solve((x, np.array([0.1, 0.15, -0.18])))
        np.testing.assert_allclose(solution.theta, [0.1, 0.15, 0.0])
        np.testing.assert_allclose(solution.unconstrained, [0.1, 0.15, -0.18])
        assert solution.active == ("β",)

    def test_all_bounds_can_hold(self) -> None:
        solution = solve((np.eye(3), -np.ones(3)))
        np.testing.assert_array_equal(solution.theta, np.zeros(3))
        assert solution.active == LINEAR_NAMES

    def test_survives_data_that_cannot_tell(self) -> None:
        # Constant speed: gap, speed and a zero relative speed leave α and ατ inseparable.
        x = np.tile([30.0, -20.0, 0.0], (50, 1))
        solution = solve((x, np.zeros(50)))
        assert np.isfinite(solution.theta).all()
        assert (solution.theta >= 0).all()


def integrate(
    platoon: Parameters, time: FloatArray, ahead: FloatArray, start: FloatArray
) -> FloatArray:
    """(N, 2M) p_1, v_1, p_2, v_2, ..: the law written out per vehicle, integrated tightly.

    One call a sample, as the leader's speed has a kink at each.
    """

    def derivative(instant: float, state: FloatArray) -> FloatArray:
        before = float(np.interp(instant, time, ahead))
        rates = np.empty_like(state)
        for i, law in enumerate(platoon):
            gap, speed = state[2 * i : 2 * i + 2]
            rates[2 * i] = before - speed
            rates[2 * i + 1] = law.alpha * (gap - law.tau * speed) + law.beta * (before - speed)
            before = speed
        return rates

    states = [start]
    for span in pairwise(time):
        step = solve_ivp(derivative, span, states[-1], method="DOP853", rtol=1e-12, atol=1e-12)
        states.append(step.y[:, -1])
    return np.array(states)


class TestSimulate:
    def test_agrees_with_a_tight_numerical_integration(self) -> None:
        platoon = (Parameters(0.0612, 0.12, 1.19), Parameters(0.176, 0.3921, 1.0))
        time = np.arange(151) * 0.1
        rng = np.random.default_rng(3)
        ahead = 25 + np.cumsum(rng.normal(0, 0.1, len(time)))
        speeds, gaps = np.array([22.0, 27.0]), np.array([20.0, 45.0])
        found = simulate(platoon, time, ahead, speeds, gaps)
        reference = integrate(platoon, time, ahead, np.stack([gaps, speeds], axis=1).ravel())
        np.testing.assert_allclose(found.gaps, reference[:, 0::2], rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.speeds[:, 1:], reference[:, 1::2], rtol=0, atol=1e-9)

    @given(st.lists(laws, min_size=1, max_size=4), st.floats(0.5, 40))
    @settings(max_examples=25)
    def test_equilibrium_stays(self, platoon: list[Parameters], speed: float) -> None:
        time = np.arange(201) * 0.1
        gaps = np.array([law.tau * speed for law in platoon])
        found = simulate(
            tuple(platoon), time, np.full(201, speed), np.full(len(platoon), speed), gaps
        )
        np.testing.assert_allclose(found.speeds, speed, rtol=1e-9)
        np.testing.assert_allclose(found.gaps, np.broadcast_to(gaps, found.gaps.shape), rtol=1e-9)

    def test_half_the_step_is_the_same_motion(self) -> None:
        law = (Parameters(0.08, 0.12, 1.5),)
        coarse = np.arange(101) * 0.2
        fine = np.arange(201) * 0.1
        ahead = 20 + np.sin(coarse)
        start = np.array([20.0]), np.array([30.0])
        expected = simulate(law, coarse, ahead, *start)
        found = simulate(law, fine, np.interp(fine, coarse, ahead), *start)
        np.testing.assert_allclose(found.gaps[::2], expected.gaps, rtol=1e-12)

    def test_a_long_run_is_that_of_single_steps(self) -> None:
        platoon = (Parameters(0.0612, 0.12, 1.19), Parameters(0.176, 0.3921, 1.0))
        time = np.arange(1001) * 0.1
        ahead = 20 + 3 * np.sin(0.2 * time)
        found = simulate(platoon, time, ahead, np.array([18.0, 21.0]), np.array([20.0, 25.0]))
        speeds, gaps = found.speeds[0, 1:], found.gaps[0]
        for k in range(1000):
            step = simulate(platoon, time[:2], ahead[k : k + 2], speeds, gaps)
            speeds, gaps = step.speeds[1, 1:], step.gaps[1]
        np.testing.assert_allclose(found.speeds[-1, 1:], speeds, rtol=0, atol=1e-10)
        np.testing.assert_allclose(found.gaps[-1], gaps, rtol=0, atol=1e-10)

    def test_shapes_and_the_leader_are_kept(self) -> None:
        time = np.arange(11) * 0.5
        ahead = np.linspace(20, 25, 11)
        platoon = (Parameters(0.1, 0.1, 1.0),) * 3
        found = simulate(platoon, time, ahead, np.full(3, 20.0), np.full(3, 20.0))
        assert found.speeds.shape == (11, 4)
        assert found.gaps.shape == (11, 3)
        np.testing.assert_array_equal(found.speeds[:, 0], ahead)
        np.testing.assert_array_equal(found.time, time)

    def test_a_follower_too_few_is_refused(self) -> None:
        with pytest.raises(ValueError, match="broadcast"):
            simulate(
                (Parameters(0.1, 0.1, 1.0),) * 2,
                np.arange(3.0),
                np.full(3, 20.0),
                np.array([20.0]),
                np.array([20.0]),
            )


class TestOrbit:
    @pytest.mark.parametrize("count", [1, 2, 3, 255, 257, 700])
    def test_is_the_powers_of_the_step(self, count: int) -> None:
        transition = np.array([[0.99, 0.1, 0.0], [-0.1, 0.98, 0.02], [0.0, 0.05, 0.9]])
        start = np.array([1.0, -2.0, 0.5])
        found = orbit(transition, start, count)
        assert found.shape == (count, 3)
        np.testing.assert_array_equal(found[0], start)
        last = np.linalg.matrix_power(transition, count - 1) @ start
        np.testing.assert_allclose(found[-1], last, atol=1e-12)
        np.testing.assert_allclose(found[1:], found[:-1] @ transition.T, atol=1e-13)


class TestMotionMatrix:
    @given(st.lists(laws, min_size=1, max_size=4), st.integers(0, 1000))
    def test_is_the_law(self, platoon: list[Parameters], seed: int) -> None:
        rng = np.random.default_rng(seed)
        speeds, gaps = rng.uniform(0, 40, len(platoon) + 1), rng.uniform(0, 80, len(platoon))
        state = np.append(np.stack([gaps, speeds[1:]], axis=1).ravel(), speeds[0])
        rates = motion_matrix(tuple(platoon)) @ state
        rows = regressors(speeds[None], gaps[None])[:, 0]
        expected = [law.theta @ row for law, row in zip(platoon, rows, strict=True)]
        np.testing.assert_allclose(rates[0::2], -np.diff(speeds), atol=1e-12)
        np.testing.assert_allclose(rates[1::2], expected, rtol=1e-9, atol=1e-9)
