"""Vehicles with another control: equal to the plain response without it, and to a simulation."""

from collections.abc import Callable

import numpy as np
import pytest

from accpinn import Parameters, WhatIf
from accpinn.errors import ParameterError
from accpinn.model.published import ASTAZERO
from accpinn.stability.criteria import peaks, response
from accpinn.stability.lagged import lagged_stability
from accpinn.stability.what_if import LIMITS
from accpinn.units import FloatArray

OMEGA = np.geomspace(0.01, 5.0, 60)
LATE = Parameters([0.08, 0.08, 0.0, 0.05], [0.3, 0.3, 0.3, 0.4], [1.2, 1.2, 1.0, 1.6], 4.0,
                  [0.0, 0.4, 0.0, 0.2], [0.3, 0.0, 0.2, 0.9])  # fmt: skip


def test_without_a_change_it_is_the_vehicle_itself() -> None:
    unchanged = WhatIf(LATE)
    np.testing.assert_array_equal(unchanged.response(OMEGA), response(LATE, OMEGA))
    np.testing.assert_allclose(unchanged.peaks.gain, peaks(LATE).gain, rtol=1e-4)
    moved = WhatIf(ASTAZERO.parameters, time_gap=0.4, delay=0.2)
    np.testing.assert_allclose(moved.parameters.tau, ASTAZERO.parameters.tau + 0.4)
    np.testing.assert_allclose(moved.parameters.delay, 0.2)
    np.testing.assert_array_equal(moved.response(OMEGA), response(moved.parameters, OMEGA))
    assert (WhatIf(LATE, time_gap=-5, delay=-5).parameters.complete[:, [2, 5]] == 0).all()


def test_all_of_the_acceleration_at_once_leaves_no_vehicle_that_amplifies() -> None:
    """With k = 1 and neither lag, delay nor latency |D|² - |N|² = ω² ((ατ+β)² - β²) ≥ 0."""
    changed = WhatIf(ASTAZERO.parameters, feedforward=1.0)
    assert (changed.peaks.gain == 1.0).all()
    assert (peaks(ASTAZERO.parameters).gain > 1.0).all()
    assert changed.to_frame().l2_stable.all()
    stale = WhatIf(ASTAZERO.parameters, feedforward=1.0, latency=1.0)
    assert (stale.peaks.gain > 1.0).any(), "what comes late helps less"


@pytest.mark.parametrize(("lag", "latency"), [(0.0, 0.0), (0.4, 0.5)])
def test_the_gain_is_that_of_a_simulation(lag: float, latency: float) -> None:
    omega, k, step = 0.4, 0.5, 2e-3
    car = Parameters([0.1], [0.4], [1.3], lag=lag)
    time = np.arange(0.0, 150.0, step)
    command = _command(car, omega, k, latency)
    gap, speed, acceleration, speeds = 0.0, 0.0, 0.0, np.zeros(len(time))
    for i, at in enumerate(time):
        wanted = command(at, gap, speed)
        acceleration = acceleration + step * (wanted - acceleration) / lag if lag else wanted
        speeds[i] = speed
        gap += step * (np.sin(omega * at) - speed)
        speed += step * acceleration
    settled = time > time[-1] - 4 * np.pi / omega
    amplitude = np.ptp(speeds[settled]) / 2.0
    changed = WhatIf(car, feedforward=k, latency=latency)
    assert amplitude == pytest.approx(abs(changed.response(np.array([omega]))[0, 0]), rel=5e-3)


def _command(
    car: Parameters, omega: float, k: float, latency: float
) -> Callable[[float, float, float], float]:
    """The commanded acceleration behind a car whose speed is sin ωt."""
    (alpha,), (beta,), (tau,) = car.alpha, car.beta, car.tau

    def command(at: float, gap: float, speed: float) -> float:
        ahead = omega * np.cos(omega * (at - latency))
        return float(alpha * (gap - tau * speed) + beta * (np.sin(omega * at) - speed) + k * ahead)

    return command


def test_a_delay_that_is_too_long_is_without_limit() -> None:
    rng = np.random.default_rng(1)
    rows: FloatArray = rng.uniform([0.02, 0.0, 0.2, 0, 0, 0], [1, 2, 2, 0, 1, 2], (300, 6))
    cars = Parameters.of(rows)
    unstable = np.isinf(lagged_stability(cars).peak)
    np.testing.assert_array_equal(WhatIf(cars).decays, ~unstable)
    assert 20 < unstable.sum() < 280
    changed = WhatIf(Parameters([0.3], [0.8], [1.0]), delay=3.0, feedforward=1.0)
    assert np.isinf(changed.peaks.gain[0])
    assert "largest gain inf" in str(changed)


@pytest.mark.parametrize("name", LIMITS)
@pytest.mark.parametrize("value", [np.nan, 11.0, -11.0])
def test_a_change_beyond_any_vehicle_is_refused(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=name):
        WhatIf(LATE, **{name: value})
