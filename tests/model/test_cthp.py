"""The CTHP and the terms beside it: parameters, regressors, and the exact motion."""

import pickle
from itertools import pairwise
from math import isnan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from accpinn.model.cthp import (
    LINEAR_NAMES,
    Parameters,
    collides,
    orbit,
    regressors,
    respond,
    simulate,
)
from accpinn.serial import dump, restore
from accpinn.units import FloatArray

vehicles = st.builds(
    Parameters, alpha=st.floats(0.001, 2.0), beta=st.floats(0.0, 2.0), tau=st.floats(0.1, 4.0)
)


class TestParameters:
    @given(vehicles)
    def test_survive_the_way_through_theta(self, parameters: Parameters) -> None:
        back = Parameters.from_theta(parameters.theta)
        assert (back.alpha, back.beta) == (parameters.alpha, parameters.beta)
        assert back.tau == pytest.approx(parameters.tau, rel=1e-14)
        assert len(parameters.theta) == len(LINEAR_NAMES)

    def test_without_alpha_tau_is_unknown(self) -> None:
        parameters = Parameters.from_theta(np.array([0.0, 0.0, 0.3]))
        assert parameters.alpha == 0
        assert parameters.beta == 0.3
        assert isnan(parameters.tau)
        np.testing.assert_array_equal(parameters.theta, [0.0, 0.0, 0.3])


@given(vehicles, st.floats(0, 40), st.floats(0, 40), st.floats(0, 200))
def test_regressors_times_theta_are_the_acceleration(
    parameters: Parameters, ahead: float, speed: float, gap: float
) -> None:
    row = regressors(np.array([[ahead, speed]]), np.array([[gap]]))[0, 0]
    expected = parameters.alpha * (gap - parameters.tau * speed) + parameters.beta * (ahead - speed)
    assert row @ parameters.theta == pytest.approx(expected, abs=1e-9)


def test_a_gap_that_ends_at_zero_is_no_collision_and_one_below_it_is() -> None:
    gaps = np.array([2.0, 0.0, -1e-13, -0.05, -1e6, np.nan])
    assert collides(gaps).tolist() == [False, False, False, True, True, False]


ROWS = [
    [0.08, 0.3, 1.0, 6, 0, 0.7], [0.15, 0.2, 1.4, 3, 0.5, 0],
    [0.06, 0.4, 1.2, -2, 0.3, 0.6], [0.1, 0.25, 0.9, 0, 0, 0],
]  # fmt: skip
PLATOON = Parameters.of(ROWS)
BARE = Parameters(PLATOON.alpha, PLATOON.beta, PLATOON.tau)


@pytest.mark.parametrize("parameters", [PLATOON, PLATOON[1], BARE, PLATOON[[3, 3]]])
def test_parameters_survive_files_and_processes(parameters: Parameters) -> None:
    tree, arrays = dump(parameters)
    assert restore(Parameters, tree, arrays) == parameters
    again = pickle.loads(pickle.dumps(parameters))
    assert (again, hash(again)) == (parameters, hash(parameters))
    many = Parameters.of(np.tile(parameters.complete, (40, 1, 1)))
    assert restore(Parameters, *dump(many)) == many, "kept beside the tree"


def test_stacks_and_indices_keep_the_terms() -> None:
    assert Parameters.stack(list(PLATOON)) == PLATOON
    assert PLATOON[1] == Parameters(0.15, 0.2, 1.4, s0=3.0, lag=0.5)
    assert PLATOON[1:] == PLATOON[[1, 2, 3]] == Parameters.of(ROWS[1:])
    assert (PLATOON != BARE, PLATOON[3] == BARE[3]) == (True, True)


def test_the_time_gap_is_the_headway_and_the_intercept_over_the_speed_and_lasts() -> None:
    np.testing.assert_allclose(PLATOON.time_gap(20.0), [1.3, 1.55, 1.1, 0.9], rtol=1e-15)
    assert PLATOON[0].time_gap(10.0) == pytest.approx(1.6, rel=1e-15)
    assert np.isnan(PLATOON.time_gap(0.0)).all()
    time, steady = np.arange(301) * 0.1, np.full(301, 25.0)
    gaps = 25.0 * PLATOON.time_gap(25.0)
    motion = simulate(PLATOON, time, steady, steady[:4], gaps)
    np.testing.assert_allclose(motion.gaps, [gaps] * 301, rtol=1e-12)


@pytest.mark.parametrize("platoon", [PLATOON, BARE], ids=["with further terms", "without"])
def test_motion_is_that_of_the_equations_integrated_tightly(platoon: Parameters) -> None:
    """1e-8; the approximant as d²z"/12 + dz'/2 + z = c, c - dz', not as in `motion_matrix`."""
    time = np.arange(61) * 0.25
    ahead = 25 + np.cumsum(np.random.default_rng(3).normal(0, 0.3, len(time)))
    speeds, gaps = np.array([22.0, 27.0, 24.0, 25.0]), np.array([40.0, 45.0, 20.0, 30.0])
    alpha, beta, tau, s0, lag, d = platoon.complete.T

    def command(p: FloatArray, v: FloatArray, now: float) -> tuple[FloatArray, FloatArray]:
        u = np.r_[np.interp(now, time, ahead), v[:-1]]
        return u, alpha * (p - s0 - tau * v) + beta * (u - v)

    def rates(now: float, state: FloatArray) -> FloatArray:
        p, v, reached, z, slope = state.reshape(5, 4)
        u, c = command(p, v, now)
        late = c - d * slope
        acceleration = np.where(lag > 0, reached, late)
        rise = (late - reached) / np.where(lag > 0, lag, 1)
        bend = (12 * (c - z) - 6 * d * slope) / np.where(d > 0, d, 1) ** 2
        return np.concatenate([u - v, acceleration, rise, slope, bend])

    _, commanded = command(gaps, speeds, 0.0)
    states = [np.concatenate([gaps, speeds, commanded, commanded, np.zeros(4)])]
    for span in pairwise(time):
        step = solve_ivp(rates, span, states[-1], method="DOP853", rtol=1e-11, atol=1e-11)
        states.append(step.y[:, -1])
    motion = simulate(platoon, time, ahead, speeds, gaps)
    simulated = np.hstack([motion.gaps, motion.speeds[:, 1:]])
    np.testing.assert_allclose(simulated, np.array(states)[:, :8], rtol=0, atol=1e-8)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 7, 8, 9, 31, 32, 33, 100])
def test_states_of_a_linear_system_are_those_of_a_loop_over_its_steps(count: int) -> None:
    matrix = np.array([[-0.4, 1.0, 0.3], [-0.9, -0.2, 0.7]])
    system, drive, start, step = matrix[:, :2], np.sin(np.arange(count)), np.array([2.0, -1.0]), 0.5
    transition = expm(system * step)
    integral = np.linalg.solve(system, transition - np.eye(2))  # of a held drive, and of a ramp
    ramp = np.linalg.solve(system, integral - step * np.eye(2)) / step
    free, driven = [start], [start]
    for now, later in pairwise(drive):
        free.append(transition @ free[-1])
        forced = integral @ matrix[:, 2] * now + ramp @ matrix[:, 2] * (later - now)
        driven.append(transition @ driven[-1] + forced)
    np.testing.assert_allclose(orbit(transition, start, count), free, rtol=1e-12, atol=1e-13)
    responded = respond(matrix, drive, step, start)
    np.testing.assert_allclose(responded, driven, rtol=1e-12, atol=1e-13)
