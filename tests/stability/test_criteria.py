"""The criteria and their boundaries; exact L∞ gain by quadrature; response by python-control."""

from math import inf, nan

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.model.registry import FOLLOWING
from accpinn.stability.criteria import (
    checked,
    crossovers,
    exact_margin,
    l2_criterion,
    l2_margin,
    paper_margin,
    peaks,
    poles,
    response,
    slowest_rate,
    smallest_beta_exact,
    smallest_beta_l2,
    smallest_headway_exact,
    smallest_headway_l2,
    smallest_headway_paper,
    step_metrics,
    transfer_function,
)
from tests.stability.references import integral_of_magnitude
from tests.support.vehicles import AUDI, NO_GAP_CONTROL, NO_REACTION, TESLA, UNDAMPED, ordinary, row

BOUNDARIES = (
    (l2_margin, smallest_headway_l2),
    (paper_margin, smallest_headway_paper),
    (exact_margin, smallest_headway_exact),
)


@given(ordinary, st.floats(0.01, 0.5))
def test_each_margin_changes_sign_at_the_smallest_headway(vehicle: Parameters, off: float) -> None:
    for margin, smallest in BOUNDARIES:
        headway = smallest(vehicle)
        below, above = (
            margin(Parameters(vehicle.alpha, vehicle.beta, headway * factor))
            for factor in (1 - off, 1 + off)
        )
        assert above > 0
        assert below < 0 or headway == 0


def test_the_smallest_beta_separates_what_the_criteria_separate() -> None:
    rng = np.random.default_rng(0)
    alpha, beta = rng.uniform(1e-3, 2, 400), rng.uniform(0, 2, 400)
    for tau in (0.7, 2.0):
        vehicles = Parameters(alpha, beta, np.full(400, tau))
        stable = l2_criterion(vehicles) >= 0
        np.testing.assert_array_equal(beta >= smallest_beta_l2(alpha, tau), stable)
        stable = exact_margin(vehicles) >= 0
        np.testing.assert_array_equal(beta >= smallest_beta_exact(alpha, tau), stable)


def test_without_alpha_the_smallest_headways_are_the_limits() -> None:
    for smallest in (smallest_headway_l2, smallest_headway_exact):
        at_zero, near = smallest(Parameters([0.0, 1e-9], 0.5, 0.0))
        assert at_zero == pytest.approx(1 / 0.5)
        assert near == pytest.approx(at_zero, rel=1e-6)


@pytest.mark.parametrize(
    ("vehicle", "words"),
    [
        ((nan, 0.1, 1.0), "α is missing"),
        ((0.1, 0.1, nan), "τ is missing"),
        ((0.1, -0.2, 1.0), "β = -0.2 is negative"),
        ((0.1, 0.1, -1.0), "τ = -1 is negative"),
        ((inf, 0.1, 1.0), "α = inf is beyond any vehicle"),
        ((0.1, 1e51, 1.0), "β = 1e.51 is beyond any vehicle"),
    ],
)
def test_impossible_values_are_refused(vehicle: tuple[float, float, float], words: str) -> None:
    with pytest.raises(ParameterError, match=f"^Parameter set 2: {words}"):
        checked(row(AUDI, Parameters(*vehicle)))
    with pytest.raises(ParameterError, match="no vehicle"):
        checked(Parameters([], [], []))
    idm = FOLLOWING["idm"]
    near = idm.linearisations(idm.typical[:, None], 0.99 * idm.typical[-1])
    assert near.s0[0] < -1e3, "almost as fast as it drives without a vehicle ahead"
    assert checked(near).s0[0] == near.s0[0]
    assert checked(Parameters(1e-60, 0.3, 1.2)) == Parameters(0.0, 0.3, 0.0)
    assert checked(Parameters(0.0, 0.3, nan)) == Parameters(0.0, 0.3, 0.0)


def vehicle_with(total: float, share: float, alpha: float) -> Parameters:
    """With ατ + β = ``total``, of which β is a share."""
    return Parameters(alpha, share * total, (1 - share) * total / alpha)


@given(st.floats(0.08, 3.0), st.floats(0.0, 1.0), st.floats(0.01, 1.0))
@settings(max_examples=10)
def test_gain_agrees_with_quadrature(zeta: float, share: float, alpha: float) -> None:
    vehicle = vehicle_with(2 * zeta * alpha**0.5, share, alpha)
    gain = step_metrics(vehicle).gain
    assert gain == pytest.approx(integral_of_magnitude(vehicle), abs=1e-8)
    scaled = Parameters(vehicle.alpha * 1e8, vehicle.beta * 1e4, vehicle.tau * 1e-4)
    assert step_metrics(scaled).gain == pytest.approx(gain, rel=1e-6), "other units of time"


@pytest.mark.parametrize("off", [0.0, 1e-15, 1e-9, 1e-7, 1e-3])
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("share", [0.55, 1.0])
def test_gain_loses_nothing_near_a_double_pole(off: float, side: int, share: float) -> None:
    vehicle = vehicle_with(1.0 + side * off, share, 0.25)
    # With a double pole, t₁ = k/(k-1) and M = (k-1) exp(-t₁) for k = β/√α > 1.
    k = 2 * share
    double = 1 + 2 * (k - 1) * np.exp(-k / (k - 1))
    near = pytest.approx(double, abs=max(1e-14, 30 * off))
    expected = near if off <= 1e-9 else pytest.approx(integral_of_magnitude(vehicle), abs=1e-10)
    assert step_metrics(vehicle).gain == expected


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
