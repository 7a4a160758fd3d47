"""The criteria and their boundaries, exact gains, and those from the leader to each follower."""

from math import inf, isnan, nan

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn import Parameters, transfer_function
from accpinn.errors import ParameterError
from accpinn.model.registry import FOLLOWING
from accpinn.stability.criteria import (
    checked,
    exact_margin,
    l2_criterion,
    l2_margin,
    paper_margin,
    peaks,
    poles,
    response,
    smallest_beta_exact,
    smallest_beta_l2,
    smallest_headway_exact,
    smallest_headway_l2,
    smallest_headway_paper,
    step_metrics,
)
from accpinn.stability.head_to_tail import head_to_tail_gains, head_to_tail_peaks
from tests.stability.references import TABLE, integral_of_magnitude
from tests.support.vehicles import AUDI, CALM, NO_REACTION, TESLA, UNDAMPED, damping, ordinary, row

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
        ((0.1, 0.3, 1.0, nan, 0.0, 0.5), "s0 = nan is beyond any vehicle"),
        ((0.1, 0.3, 1.0, 5.0, -0.1, 0.0), "lag = -0.1 is beyond any vehicle"),
        ((0.1, 0.3, 1.0, 5.0, 0.0, 1e200), "delay = 1e.200 is beyond any vehicle"),
        ((1e40, 0.3, 1.0, 5.0, 0.0, 0.5), "1e.40 with a lag or a delay is beyond any vehicle"),
    ],
)
def test_impossible_values_are_refused(vehicle: tuple[float, ...], words: str) -> None:
    with pytest.raises(ParameterError, match=f"^(Parameter set 2:|A gain or headway of) {words}"):
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
    late = [Parameters(alpha, 0.3, 1.2, lag=0.4, delay=0.5) for alpha in (0.1, 0.0)]
    for vehicle, curve in zip(late, response(row(*late), omega[:30]), strict=True):
        np.testing.assert_allclose(transfer_function(vehicle)(1j * omega[:30]), curve, rtol=1e-4)
    for vehicle, curve in zip(vehicles, response(vehicles, omega), strict=True):
        system = transfer_function(vehicle)
        assert isinstance(system, control.TransferFunction)
        np.testing.assert_allclose(curve, system(1j * omega), rtol=1e-12)
        np.testing.assert_allclose(sorted(poles(vehicle), key=abs), sorted(system.poles(), key=abs))
        assert system.zeros()[0].real == pytest.approx(-vehicle.alpha / vehicle.beta)


platoons = st.lists(
    ordinary.filter(lambda vehicle: damping(vehicle) > 0.05), min_size=2, max_size=5
)


def test_peak_is_the_largest_product_on_a_fine_grid() -> None:
    mixed = row(*(reference.vehicle for reference in TABLE))
    omega = np.geomspace(1e-3, 3.0, 100_001)
    largest = np.abs(np.cumprod(response(mixed, omega), axis=0)).max(axis=1)
    found = head_to_tail_peaks(mixed)
    np.testing.assert_allclose(found.gain, largest, rtol=1e-7)
    assert (found.gain >= largest * (1 - 1e-12)).all()
    assert found.omega[0] == pytest.approx(peaks(mixed).omega[0], rel=1e-10), "in closed form"
    # A parabola through its neighbours has its top where the peak is.
    near = found.omega[:, None] * (1 + np.array([-1e-3, 0.0, 1e-3]))
    sides = np.array(
        [np.log(np.abs(response(mixed[: k + 1], at))).sum(axis=0) for k, at in enumerate(near)]
    )
    bend = sides[:, 0] - 2 * sides[:, 1] + sides[:, 2]
    np.testing.assert_allclose((sides[:, 0] - sides[:, 2]) / (2 * bend), 0, atol=5e-3)


@given(platoons)
@settings(max_examples=25)
def test_the_exact_gain_lies_between_peak_and_product(platoon: list[Parameters]) -> None:
    vehicles = row(*platoon)
    found = head_to_tail_gains(vehicles)
    slack = 1e-7 + 3 * found.error
    assert (found.gain >= head_to_tail_peaks(vehicles).gain - slack).all()
    assert (found.gain <= np.cumprod(step_metrics(vehicles).gain) + slack).all()


def test_nothing_passes_one_that_does_not_react_and_an_undamped_one_has_no_bound() -> None:
    platoon = row(AUDI, NO_REACTION, AUDI)
    found = head_to_tail_peaks(platoon).gain
    assert found[0] > 1
    assert list(found[1:]) == list(head_to_tail_gains(platoon).gain[1:]) == [0, 0]
    undamped = head_to_tail_peaks(row(AUDI, UNDAMPED, CALM))
    assert list(undamped.gain[1:]) == [inf, inf]
    assert undamped.omega[2] == 0.5


@pytest.mark.parametrize(
    "platoon",
    [
        row(Parameters(1e-12, 1.0, 0.1), Parameters(1e8, 1.0, 1e-5)),
        row(Parameters(1.0, 0.001, 0.001), AUDI),
    ],
    ids=["time scales too far apart", "an oscillation that outlasts the samples"],
)
def test_what_cannot_be_computed_is_nan(platoon: Parameters) -> None:
    gain = head_to_tail_gains(platoon).gain
    assert gain[0] == step_metrics(platoon).gain[0]
    assert isnan(gain[1])
