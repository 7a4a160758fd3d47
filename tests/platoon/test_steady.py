"""The steady motion in closed form against the exact simulation."""

import numpy as np
import pytest
from numpy.typing import NDArray

from accpinn import Parameters, simulate_platoon
from accpinn.platoon import SETTLED
from accpinn.platoon.leader import Sinusoid
from accpinn.platoon.steady import steady_gains

PARAMETERS = Parameters([0.08, 0.1], [0.3, 0.25], [1.2, 1.4])
DELAYED = Parameters([0.08, 0.1], [0.3, 0.25], [1.2, 1.4], [3.0, 0.0], [0.2, 0.0], [0.0, 0.3])
UNSTABLE = Parameters([0.08, 0.5, 0.08], [0.3, 1.5, 0.3], 1.2, 0.0, 0.0, [0.0, 3.0, 0.0])


def steady_deviations(
    parameters: Parameters, omega: float, time: NDArray[np.float64], amplitude: float = 1.0
) -> NDArray[np.float64]:
    """(N, M+1) deviations of speed in m/s at (N,) instants, leader first."""
    single = steady_gains(parameters, np.array([omega]))[:, 0]
    chain = np.cumprod(np.concatenate([[1.0], single]))
    return np.asarray((amplitude * chain * np.exp(1j * omega * time)[:, None]).imag)


@pytest.mark.parametrize("parameters", [PARAMETERS, DELAYED])
@pytest.mark.parametrize("omega", [0.1, 0.5])
def test_it_is_the_simulation_after_its_transient(parameters: Parameters, omega: float) -> None:
    leader = Sinusoid(frequency=omega, amplitude=0.7, settle=0.0, duration=400.0)
    run = simulate_platoon(parameters, leader)
    late = run.trajectories.time > 300.0
    steady = steady_deviations(parameters, omega, run.trajectories.time[late], 0.7)
    moved = run.trajectories.speeds[late] - leader.speed
    np.testing.assert_allclose(steady, moved, atol=0.7 * SETTLED)
    assert np.abs(steady[:, 1:]).max() > 0.1


def test_there_is_none_behind_a_vehicle_that_never_settles() -> None:
    steady = steady_deviations(UNSTABLE, 0.3, np.arange(0.0, 10.0))
    assert np.isfinite(steady).all(axis=0).tolist() == [True, True, False, False]
    one = steady_deviations(PARAMETERS[0], 0.3, np.arange(0.0, 10.0))
    assert one.shape == (10, 2)
