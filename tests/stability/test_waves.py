"""The growth of waves of any size, against linear theory, simulation and the models' symmetries."""

import numpy as np
import pytest

from accpinn.errors import ParameterError
from accpinn.model.registry import FOLLOWING
from accpinn.stability.criteria import peaks
from accpinn.stability.lagged import frequency_response
from accpinn.stability.waves import SIZES, wave_growth, waves
from accpinn.units import FloatArray

SPEED = 25.0
OMEGA = np.array([0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.5])
UNEQUAL = np.array([0.06, 2.1, 0.25, 1.2, 1.1, 5.0])
"""α₊, q, β₊, k, τ, s₀ of a car that eases off twice as hard as it closes up."""


@pytest.mark.parametrize("key", ["cthp", "cthp-s0", "cthp-s0-lag", "cthp-s0-delay"])
def test_a_linear_model_grows_by_its_gain(key: str) -> None:
    model = FOLLOWING[key]
    gain = abs(frequency_response(model.linearised(model.typical, SPEED)[None], OMEGA))[0]
    growth = wave_growth(model, model.typical, SPEED, OMEGA)
    # A simulation, and so the linearisation of a nonlinear model, has Padé's delay.
    np.testing.assert_allclose(growth.harmonic, gain, rtol=1e-4)
    for peak in (growth.braking, growth.accelerating):
        np.testing.assert_allclose(peak, gain, rtol=1e-4)


@pytest.mark.parametrize(
    ("key", "theta", "amplitude"),
    [
        ("unequal", UNEQUAL, 1.0),
        ("unequal-delay", np.append(UNEQUAL, 0.6), 1.0),
        ("unequal-lag", np.append(UNEQUAL, 0.4), 3.0),
        ("idm", FOLLOWING["idm"].typical, 4.0),
        ("idm-delay", FOLLOWING["idm-delay"].typical, 2.0),
        ("fvdm-lag", FOLLOWING["fvdm-lag"].typical, 5.0),
    ],
)
def test_peaks_are_those_of_a_simulation_once_it_is_steady(
    key: str, theta: FloatArray, amplitude: float
) -> None:
    model, omega = FOLLOWING[key], (0.15, 0.3, 0.6)
    gap = model.equilibrium_gaps(theta, SPEED)[None]
    growth = wave_growth(model, theta, SPEED, omega, amplitude)
    for k, frequency in enumerate(omega):
        period = 2 * np.pi / frequency
        time = np.arange(0.0, max(12, 300 / period) * period, period / 100)
        leader = SPEED + amplitude * np.sin(frequency * time)
        run = model.simulate(theta, time, leader, np.array([SPEED]), gap)
        last = (run.speeds[-100:, 1] - SPEED) / amplitude
        peaks = growth.braking[k], growth.accelerating[k]
        np.testing.assert_allclose(peaks, (-last.min(), last.max()), rtol=0.01)


def test_growth_under_unequal_gains_depends_on_direction_and_not_on_size() -> None:
    model = FOLLOWING["unequal-delay"]
    theta = np.append(UNEQUAL, 0.6)
    small, large = (wave_growth(model, theta, SPEED, OMEGA, size) for size in (1.0, 4.0))
    np.testing.assert_allclose(small.braking, large.braking, rtol=5e-3)
    np.testing.assert_allclose(small.accelerating, large.accelerating, rtol=5e-3)
    assert abs(large.braking / large.accelerating - 1).max() > 0.02
    alpha, q, beta, k, *others = theta
    mirrored = np.array([alpha * q, 1 / q, beta * k, 1 / k, *others])
    other = wave_growth(model, mirrored, SPEED, OMEGA, 4.0)
    np.testing.assert_allclose(other.braking, large.accelerating, rtol=5e-3)


def test_equal_gains_are_the_cthp_with_s0() -> None:
    theta = np.array([0.06, 1.0, 0.25, 1.0, 1.1, 5.0])
    linear = FOLLOWING["cthp-s0"].linearised(np.array([0.06, 0.25, 1.1, 5.0]), SPEED)
    growth = wave_growth(FOLLOWING["unequal"], theta, SPEED, OMEGA)
    np.testing.assert_allclose(growth.harmonic, abs(frequency_response(linear[None], OMEGA))[0])


@pytest.mark.parametrize("key", ["cthp-s0-delay", "unequal", "fvdm-lag"])
def test_the_largest_growth_of_a_small_wave_is_the_peak_of_the_gain(key: str) -> None:
    model = FOLLOWING[key]
    theta = np.append(UNEQUAL, 0.6) if key == "unequal" else model.typical
    theta = theta[: len(model.parameters)]
    found = waves(model, theta[None], np.array([SPEED]), ("A",), (2,))
    (vehicle,) = found.vehicles
    np.testing.assert_array_equal(vehicle.amplitude, SIZES)
    peak = float(peaks(model.linearised(theta, SPEED)[None]).gain[0])
    assert vehicle.harmonic[0] == pytest.approx(peak, rel=0.02)
    assert np.isfinite(vehicle.braking).all()
    frame = found.to_frame()
    assert frame.braking.tolist() == vehicle.braking.tolist()
    assert vehicle.at(SIZES[1])[0] == vehicle.braking[1]


def test_nothing_is_said_of_a_vehicle_that_is_not_determined_and_slow_waves_are_small() -> None:
    model = FOLLOWING["idm"]
    theta = np.stack([model.typical, np.full(len(model.parameters), np.nan)])
    first, second = waves(model, theta, np.array([5.0, SPEED]), ("A", "B"), (2, 3)).vehicles
    assert first.amplitude.max() <= 0.4 * 5.0
    assert np.isfinite(first.braking).all()
    assert np.isnan(second.braking).all()


def test_a_size_at_which_a_frequency_has_no_steady_wave_has_no_largest_growth() -> None:
    """The gap of this car falls below zero in a wave of 6 m/s, which it amplifies 1.4-fold."""
    model, theta = FOLLOWING["unequal"], np.array([0.067, 1.17, 0.114, 1.1, 0.865, 5.14])
    (vehicle,) = waves(model, theta[None], np.array([SPEED]), ("A",), (2,)).vehicles
    growth = wave_growth(model, theta, SPEED, vehicle.by_frequency.omega, 6.0)
    assert np.isnan(growth.harmonic).any()
    assert not np.isnan(growth.harmonic).all()
    for part in (vehicle.harmonic, vehicle.braking, vehicle.accelerating):
        assert np.isnan(part).tolist() == [size == 6.0 for size in SIZES]


def test_waves_of_a_vehicle_that_does_not_settle_grow_without_limit() -> None:
    model = FOLLOWING["cthp-s0-delay"]
    theta = np.array([0.3, 0.6, 4.0, 3.0, 1.6])
    assert np.isinf(peaks(model.linearised(theta, SPEED)[None]).gain).all()
    assert np.isinf(wave_growth(model, theta, SPEED, OMEGA).harmonic).all()
    found = waves(model, theta[None], np.array([SPEED]), ("A",), (2,))
    assert np.isinf(found.to_frame().braking).all()


def test_a_speed_without_equilibrium_is_refused() -> None:
    idm = FOLLOWING["idm"]
    with pytest.raises(ParameterError, match="equilibrium"):
        wave_growth(idm, idm.typical, 60.0, OMEGA)
