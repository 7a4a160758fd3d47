"""The frequency response against python-control, and its peaks against the response."""

import control
import numpy as np
import pytest
from hypothesis import given

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import (
    crossovers,
    peaks,
    poles,
    response,
    slowest_rate,
    transfer_function,
)
from tests.support.vehicles import AUDI, NO_GAP_CONTROL, NO_REACTION, TESLA, UNDAMPED, ordinary, row


def test_response_and_poles_are_those_of_python_control() -> None:
    omega = np.geomspace(1e-3, 10, 50)
    vehicles = row(AUDI, TESLA)
    for vehicle, curve in zip(vehicles, response(vehicles, omega), strict=True):
        system = transfer_function(vehicle)
        assert isinstance(system, control.TransferFunction)
        np.testing.assert_allclose(curve, system(1j * omega), rtol=1e-12)
        np.testing.assert_allclose(sorted(poles(vehicle), key=abs), sorted(system.poles(), key=abs))
        assert system.zeros()[0].real == pytest.approx(-vehicle.alpha / vehicle.beta)


@given(ordinary)
def test_the_response_is_one_at_the_crossover_and_largest_at_the_peak(vehicle: Parameters) -> None:
    one, (slow, fast) = row(vehicle), poles(vehicle)
    assert slow + fast == pytest.approx(-vehicle.alpha * vehicle.tau - vehicle.beta, rel=1e-9)
    assert slow * fast == pytest.approx(vehicle.alpha, rel=1e-9)
    (peak,), (crossover,) = peaks(one), crossovers(one)
    if np.isnan(crossover):
        assert (peak.gain, peak.omega) == (1, 0)
        return
    assert 0 < peak.omega < crossover
    magnitude = np.abs(response(one, np.array([peak.omega, crossover, 0.0])))[0]
    np.testing.assert_allclose(magnitude, [peak.gain, 1, 1], rtol=1e-7)
    around = peak.omega * np.array([0.5, 0.9, 0.99, 1.01, 1.1, 2.0])
    assert (np.abs(response(one, around)) <= peak.gain * (1 + 1e-12)).all()


def test_without_alpha_it_is_a_first_order_lag() -> None:
    h = response(row(NO_GAP_CONTROL), np.array([0.0, 0.3]))
    np.testing.assert_allclose(h, [[1, 1 / (1 + 1j)]])
    assert slowest_rate(NO_GAP_CONTROL) == 0.3
    assert not response(row(NO_REACTION), np.array([0.0, 1.0])).any()
    assert np.isinf(np.abs(response(row(UNDAMPED), np.array([0.5])))), "without damping"
    assert slowest_rate(UNDAMPED) == 0
