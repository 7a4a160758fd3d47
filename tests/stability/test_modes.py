"""Poles of the exact delay: counted by the argument principle; responses beside the verdict."""

from math import inf, isnan

import numpy as np
import pytest

from accpinn import Parameters, stability_report
from accpinn.stability.modes import MOST_POLES, dominant_poles, exact_poles, modes, responses
from tests.support.vehicles import AUDI, NO_REACTION, TESLA, UNDAMPED


def equation(vehicle: Parameters, s: np.ndarray) -> np.ndarray:
    """Δ(s) of a vehicle."""
    alpha, alpha_tau, beta = vehicle.theta
    late = np.exp(-vehicle.delay * s)
    return s**2 * (1 + vehicle.lag * s) + late * ((alpha_tau + beta) * s + alpha)


def turns(vehicle: Parameters, left: float, right: float = 5.0, high: float = 60.0) -> int:
    """How many roots Δ has in a rectangle, by its phase along the edges."""
    corners = left - 1j * high, right - 1j * high, right + 1j * high, left + 1j * high
    total = 0.0
    for first, last in zip(corners, (*corners[1:], corners[0]), strict=True):
        values = equation(vehicle, first + (last - first) * np.linspace(0, 1, 60_001))
        total += float(np.angle(values[1:] / values[:-1]).sum())
    return round(total / (2 * np.pi))


@pytest.mark.parametrize("seed", range(8))
def test_no_pole_is_missed_and_none_invented(seed: int) -> None:
    rng = np.random.default_rng(seed)
    alpha, beta, tau, lag, delay = rng.uniform([0.01, 0.05, 0.5, 0, 0.1], [0.5, 1, 2.5, 1, 2])
    vehicle = Parameters(alpha, beta, tau, 0.0, lag * (seed % 2), delay)
    poles = exact_poles(vehicle)
    left = max(float(poles[-1].real) + 1e-3, -3.0 / delay)
    assert (poles.real > left).sum() == turns(vehicle, left)
    late = np.exp(-delay * poles)
    size = np.abs(poles) ** 2 * (1 + vehicle.lag * np.abs(poles)) + np.abs(late)
    assert (np.abs(equation(vehicle, poles)) < 1e-9 * size).all()
    assert (np.diff(poles.real) <= 1e-9).all()
    assert len(poles) <= MOST_POLES


def test_without_a_delay_poles_are_those_of_the_polynomial() -> None:
    found = modes(AUDI)
    total, alpha = AUDI.alpha * AUDI.tau + AUDI.beta, AUDI.alpha
    assert found.poles == pytest.approx(np.roots([1, total, alpha])[::1])
    assert found.natural_frequency == pytest.approx(alpha**0.5)
    assert found.damping_ratio == pytest.approx(total / alpha**0.5 / 2)
    assert found.zeros == pytest.approx([-AUDI.alpha / AUDI.beta])


@pytest.mark.parametrize(
    "vehicle",
    [
        AUDI,
        TESLA,
        Parameters(0.07, 0.13, 1.2, delay=0.5),
        Parameters(0.07, 0.13, 1.2, lag=0.4),
        Parameters(0.04, 0.2, 0.0),
        Parameters(0.0, 0.3, 0.0, delay=0.5),
    ],
)
def test_the_area_of_the_impulse_response_is_the_verdicts_gain(vehicle: Parameters) -> None:
    (said,) = stability_report(vehicle[None]).vehicles
    found = responses(vehicle, 200.0, 40_001)
    area = np.trapezoid(np.abs(found.impulse), found.time)
    assert area == pytest.approx(said.linf_gain, rel=1e-3)
    assert np.trapezoid(found.impulse, found.time) == pytest.approx(1.0, abs=1e-3)
    assert found.step[-1] == pytest.approx(1.0, abs=1e-4)
    assert found.step.max() - 1 == pytest.approx(said.overshoot, abs=1e-3)
    last = found.time[np.abs(found.step - 1) > 0.02].max()
    assert modes(vehicle).settling == pytest.approx(last, abs=0.05)


def test_extremes_have_no_settling() -> None:
    assert modes(UNDAMPED).settling == inf
    assert modes(UNDAMPED).damping_ratio == pytest.approx(0.0, abs=1e-12)
    silent = modes(NO_REACTION)
    assert len(silent.poles) == 0
    assert isnan(silent.damping_ratio)
    growing = modes(Parameters(0.1, 0.4, 1.0, delay=3.0))
    assert growing.settling == inf
    assert growing.damping_ratio < 0


def test_dominant_poles_of_draws_are_the_rightmost() -> None:
    rng = np.random.default_rng(0)
    low, high = [0.03, 0.1, 0.6, 0, 0, 0], [0.15, 0.5, 2.0, 0, 0, 0.8]
    draws = Parameters.of(rng.uniform(low, high, (30, 6)))
    expected = [exact_poles(draw)[0] for draw in draws]
    expected = [complex(pole.real, abs(pole.imag)) for pole in expected]
    np.testing.assert_allclose(dominant_poles(draws), expected, atol=1e-5)
