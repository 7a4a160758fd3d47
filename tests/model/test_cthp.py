"""The model: its parameters, its regressors, and its exact simulation."""

from math import isnan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.model.cthp import (
    LINEAR_NAMES,
    Parameters,
    collides,
    orbit,
    regressors,
    simulate,
)

vehicles = st.builds(
    Parameters, alpha=st.floats(0.001, 2.0), beta=st.floats(0.0, 2.0), tau=st.floats(0.1, 4.0)
)
platoons = st.lists(vehicles, min_size=1, max_size=4).map(Parameters.stack)


class TestParameters:
    @given(vehicles)
    def test_survive_the_way_through_theta(self, one: Parameters) -> None:
        back = Parameters.from_theta(one.theta)
        assert (back.alpha, back.beta) == (one.alpha, one.beta)
        assert back.tau == pytest.approx(one.tau, rel=1e-14)
        assert len(one.theta) == len(LINEAR_NAMES)

    def test_without_alpha_tau_is_unknown(self) -> None:
        one = Parameters.from_theta(np.array([0.0, 0.0, 0.3]))
        assert one.alpha == 0
        assert one.beta == 0.3
        assert isnan(one.tau)
        np.testing.assert_array_equal(one.theta, [0.0, 0.0, 0.3])

    def test_cannot_be_changed(self) -> None:
        one = Parameters(1.0, 1.0, 1.0)
        with pytest.raises(AttributeError):
            one.alpha = 2.0
        with pytest.raises(ValueError, match="read-only"):
            one.values[0] = 2.0


class TestRegressors:
    @given(vehicles, st.floats(0, 40), st.floats(0, 40), st.floats(0, 200))
    def test_times_theta_are_the_acceleration(
        self, one: Parameters, ahead: float, speed: float, gap: float
    ) -> None:
        row = regressors(np.array([[ahead, speed]]), np.array([[gap]]))[0, 0]
        expected = one.alpha * (gap - one.tau * speed) + one.beta * (ahead - speed)
        assert row @ one.theta == pytest.approx(expected, abs=1e-9)


class TestSimulate:
    @pytest.mark.parametrize("count", [1, 2, 255, 257, 700])
    def test_states_without_a_drive_are_the_powers_of_a_step(self, count: int) -> None:
        transition = np.array([[0.99, 0.1, 0.0], [-0.1, 0.98, 0.02], [0.0, 0.05, 0.9]])
        found = orbit(transition, np.array([1.0, -2.0, 0.5]), count)
        last = np.linalg.matrix_power(transition, count - 1) @ found[0]
        np.testing.assert_allclose(found[-1], last, atol=1e-12)
        np.testing.assert_allclose(found[1:], found[:-1] @ transition.T, atol=1e-13)

    @given(platoons, st.floats(0.5, 40))
    @settings(max_examples=25)
    def test_equilibrium_stays(self, platoon: Parameters, speed: float) -> None:
        time = np.arange(201) * 0.1
        gaps = platoon.tau * speed
        found = simulate(platoon, time, np.full(201, speed), np.full(len(platoon), speed), gaps)
        np.testing.assert_allclose(found.speeds, speed, rtol=1e-9)
        np.testing.assert_allclose(found.gaps, np.broadcast_to(gaps, found.gaps.shape), rtol=1e-9)


def test_a_gap_that_ends_at_zero_is_no_collision_and_one_below_it_is() -> None:
    gaps = np.array([2.0, 0.0, -1e-13, -0.05, -1e6, np.nan])
    assert collides(gaps).tolist() == [False, False, False, True, True, False]
    time = np.arange(0.0, 200.0, 0.1)
    speed = np.clip(20.0 - time, 0.0, None)
    stopping = simulate(Parameters([0.5], [1.0], [1.5]), time, speed, [20.0], [30.0]).gaps
    assert abs(stopping[-1, 0]) < 1e-9
    assert not collides(stopping).any()
