"""Stability under a lag or a delay: against closed forms, the exact delay, and integration."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

from accpinn import Parameters, stability_report
from accpinn.results.messages.stability import reason
from accpinn.stability.criteria import crossovers, peaks, response, step_metrics
from accpinn.stability.head_to_tail import head_to_tail_gains
from accpinn.stability.lagged import is_lagged, lagged_stability, step_gain
from accpinn.units import FloatArray
from tests.support.vehicles import AUDI, TESLA, row


def drawn(count: int, seed: int, lag: float = 0.0, delay: float = 0.0) -> Parameters:
    """Vehicles of (.01, .3) 1/s², (.05, .8) 1/s, (.6, 2) s, lag and delay up to the given ones."""
    low, high = np.array([[0.01, 0.05, 0.6, 0, 0, 0], [0.3, 0.8, 2.0, 0, lag, delay]])
    return Parameters.of(np.random.default_rng(seed).uniform(low, high, (count, 6)))


def test_without_lag_and_delay_it_is_the_closed_forms() -> None:
    vehicles = drawn(400, 1)
    assert not is_lagged(vehicles)
    stability, peak = lagged_stability(vehicles), peaks(vehicles)
    assert 0.2 < (peak.gain > 1).mean() < 0.9, "both verdicts occur"
    np.testing.assert_allclose(stability.peak, peak.gain, rtol=1e-9)
    np.testing.assert_allclose(stability.omega, peak.omega, rtol=1e-6)
    np.testing.assert_allclose(stability.crossover, crossovers(vehicles), rtol=1e-9)
    np.testing.assert_array_equal(stability.margin < -1e-9, peak.gain > 1)
    metrics = step_metrics(vehicles)
    overshoot, gain = step_gain(vehicles)
    np.testing.assert_allclose(gain, metrics.gain, rtol=1e-3)
    np.testing.assert_allclose(overshoot, metrics.overshoot, atol=1e-3)
    omega = np.geomspace(1e-3, 10, 40)
    s, (alpha, alpha_tau, beta) = 1j * omega, vehicles.theta.T[:, :, None]
    closed = (beta * s + alpha) / (s**2 + (alpha_tau + beta) * s + alpha)
    np.testing.assert_allclose(response(vehicles, omega), closed, 1e-12)


def test_a_vehicle_that_is_not_determined_leaves_the_others_as_they_are() -> None:
    vehicles = drawn(3, 9, lag=0.5, delay=0.5)
    unknown = Parameters.of(np.insert(vehicles.complete, 1, np.nan, axis=0))
    for found, known in zip(
        (*step_gain(unknown), lagged_stability(unknown).peak),
        (*step_gain(vehicles), lagged_stability(vehicles).peak),
        strict=True,
    ):
        np.testing.assert_array_equal(np.delete(found, 1), known)


def test_the_gain_is_that_of_the_exact_delay() -> None:
    vehicles, omega = drawn(400, 2, lag=0.5, delay=0.75), np.linspace(0.01, 1.0, 100)
    vehicles = vehicles[lagged_stability(vehicles).peak < 3.0]
    assert len(vehicles) > 300, "nearer to instability any error grows"
    s, (alpha, beta, tau, _, lag, delay) = 1j * omega, vehicles.complete.T[..., None]
    late = np.exp(-s * delay)
    lower = s**2 * (1 + lag * s) + late * ((alpha * tau + beta) * s + alpha)
    ratio = response(vehicles, omega) / (late * (beta * s + alpha) / lower)
    assert np.abs(20 * np.log10(np.abs(ratio))).max() < 0.01, "dB"
    assert np.abs(np.angle(ratio)).max() < 0.002


def test_the_peak_is_the_largest_gain_and_the_crossover_has_gain_one() -> None:
    vehicles, omega = drawn(60, 3, lag=0.5, delay=0.8), np.geomspace(1e-3, 20, 20_000)
    vehicles = vehicles[np.isfinite(lagged_stability(vehicles).peak)]
    stability = lagged_stability(vehicles)
    curve = np.abs(response(vehicles, omega))
    np.testing.assert_allclose(stability.peak, np.maximum(curve.max(axis=1), 1), rtol=1e-4)
    amplified = stability.peak > 1
    assert 0.3 < amplified.mean() < 1.0
    np.testing.assert_array_equal(stability.margin < 0, amplified)
    np.testing.assert_array_equal(np.isfinite(stability.crossover), amplified)
    at = stability.crossover[amplified]
    gains = np.abs(response(vehicles[amplified], at)).diagonal()
    np.testing.assert_allclose(gains, 1.0, atol=1e-7)


def test_a_vehicle_may_amplify_a_band_alone() -> None:
    """Lower frequencies are damped; without lag or delay all below the crossover are amplified."""
    band, wide = Parameters([0.1, 0.1], [0.6, 0.2], [2.0, 1.0], delay=[0.8, 0.3])
    report = stability_report(Parameters.of(np.array([band.complete, wide.complete])))
    one, other = report.vehicles
    assert (one.onset, one.crossover) == pytest.approx((0.749, 1.063), abs=4e-3)
    assert other.onset == 0.0 < other.crossover
    around = np.array([0.3, one.onset - 0.01, one.onset + 0.01, 1.0, one.crossover + 0.01])
    gains = np.abs(response(band[None], around))[0]
    assert (gains > 1).tolist() == [False, False, True, True, False]
    assert "between" in reason(one.l2, one)
    assert "between" not in reason(other.l2, other)


def variation_under_delay(vehicle: Parameters, step: float = 0.005, end: float = 120.0) -> float:
    """∫|h| as the total variation of the step response, by trapezoids over the true delay."""
    alpha, alpha_tau, beta = vehicle.theta
    late, count = round(vehicle.delay / step), round(end / step)
    gap, speed, command = 0.0, np.zeros(count), np.full(count, beta)
    for k in range(1, count):
        rate = (command[k - 1 - late] + command[k - late]) / 2 if k > late else 0.0
        speed[k] = speed[k - 1] + step * rate
        gap += step * (1 - (speed[k] + speed[k - 1]) / 2)
        command[k] = alpha * gap - alpha_tau * speed[k] + beta * (1 - speed[k])
    return float(np.abs(np.diff(speed)).sum())


def test_the_gain_of_peaks_is_the_integral_of_the_impulse_response() -> None:
    """Under a true delay within 1 %, as far as the approximant goes; under a lag within .2 %."""
    late = Parameters([0.06, 0.15, 0.04], [0.12, 0.4, 0.6], [1.2, 1, 1.8], delay=[0.7, 0.5, 0.3])
    expected = [variation_under_delay(vehicle) for vehicle in late]
    np.testing.assert_allclose(step_gain(late)[1], expected, rtol=0.01)
    lagged, time = drawn(8, 4, lag=1.0), np.linspace(0.0, 300.0, 15_001)
    expected = [integral(vehicle[None], time) for vehicle in lagged]
    np.testing.assert_allclose(step_gain(lagged)[1], expected, rtol=2e-3)


def integral(vehicles: Parameters, time: FloatArray) -> float:
    """∫|h| of a platoon by trapezoids, h being the sum of its poles' exponentials; all differ."""
    upper, lower = np.ones(1), np.ones(1)
    for alpha, beta, tau, _, lag, delay in vehicles.complete:
        pade = np.array([delay**2 / 12, delay / 2, 1.0])
        mirrored = np.polymul(pade * [1, -1, 1], [alpha * tau + beta, alpha])
        upper = np.polymul(upper, np.polymul([beta, alpha], pade))
        lower = np.polymul(lower, np.polyadd(np.polymul([lag, 1, 0, 0], pade), mirrored))
    poles = np.roots(lower)
    residues = np.polyval(upper, poles) / np.polyval(np.polyder(lower), poles)
    parts = (r * np.exp(p * time) for r, p in zip(residues, poles, strict=True))
    return float(trapezoid(np.abs(np.sum([*parts], axis=0).real), time))


def test_a_fast_oscillation_beside_a_slow_pole_is_resolved() -> None:
    time = np.concatenate([np.linspace(0, 200, 200_001), np.geomspace(200, 20_000, 20_001)[1:]])
    vehicles = Parameters(
        [0.00183, 0.001266, 0.00358, 0.0028, 0.0101], [0.9527, 0.823, 1.075, 0.946, 1.42],
        [2.704, 2.155, 1.425, 1.564, 0.466], lag=[0, 0, 0, 0.538, 0.841],
        delay=[0.9427, 1.768, 0.827, 0, 0],
    )  # fmt: skip
    expected = [integral(vehicle[None], time) for vehicle in vehicles]
    assert expected[0] > 2, "as |H| has a peak of 1.85"
    np.testing.assert_allclose(step_gain(vehicles)[1], expected, rtol=1e-3)


def test_gains_along_a_platoon_take_a_delay_as_a_shift() -> None:
    """‖h₁ * h₂‖ ≤ ‖h₁‖ ‖h₂‖, which the approximant outside the loop would exceed."""
    time = np.linspace(0, 1_500, 300_001)
    for first, second in drawn(12, 6, lag=0.3, delay=0.8).complete.reshape(6, 2, 6):
        pair = Parameters.of(np.array([first, second]))
        if np.isinf(lagged_stability(pair).peak).any():
            continue
        gain = head_to_tail_gains(pair).gain
        assert gain[1] <= np.prod(step_gain(pair)[1]) * (1 + 1e-3)
        assert gain[1] == pytest.approx(integral(pair, time), rel=1e-3)
    plain = head_to_tail_gains(row(AUDI, TESLA))
    assert plain.gain[1] == pytest.approx(integral(row(AUDI, TESLA), time), abs=2e-5)
    assert (plain.error[0], plain.error[1] < 1e-6) == (0, True)
    calm = Parameters([0.028, 0.043], [0.58, 0.516], [1.657, 2.467], delay=0.58)
    assert head_to_tail_gains(calm).gain[1] < 1.0001


def test_what_follows_an_unstable_vehicle_is_without_limit() -> None:
    report = stability_report(Parameters([0.1, 0.5, 0.1], [0.3, 1, 0.3], 1.5, delay=[0.3, 2, 0.3]))
    assert [np.isinf(vehicle.linf_gain) for vehicle in report.vehicles] == [False, True, False]
    platoon = report.platoon
    assert [np.isinf(peak.gain) for peak in platoon.peaks] == [False, True, True]
    assert np.isinf(platoon.linf.gain).tolist() == [False, True, True]
    assert not any(verdict.stable for verdict in (platoon.l2_weak, platoon.linf_weak))


def test_a_vehicle_is_unstable_beyond_rouths_lag_and_the_delay_margin() -> None:
    """λ = τ + β/α by Routh; d = phase margin / gain crossover of ((ατ+β)s + α)/s²."""
    alpha, beta, tau = 0.1, 0.4, 1.0
    total = alpha * tau + beta
    omega = np.sqrt((total**2 + np.sqrt(total**4 + 4 * alpha**2)) / 2)
    longest = tau + beta / alpha
    for term, limit, resonance in (
        ("lag", longest, np.sqrt(total / longest)),
        ("delay", np.arctan(total * omega / alpha) / omega, omega),
    ):
        vehicles = Parameters([alpha] * 2, beta, tau, **{term: limit * np.array([0.98, 1.02])})
        stability, (overshoot, gain) = lagged_stability(vehicles), step_gain(vehicles)
        assert np.isfinite(stability.peak).tolist() == [True, False], term
        assert stability.peak[0] > 5
        for values in (stability.peak, overshoot, gain, -stability.margin):
            assert (np.isfinite(values[0]), values[1]) == (True, np.inf)
        assert stability.omega[0] == pytest.approx(resonance, rel=0.02)


def test_one_that_hardly_decays_takes_many_instants_alone() -> None:
    near = Parameters([0.015689], [0.992564], [3.161597], delay=[1.5])
    gain = step_gain(near)[1][0]
    assert gain == pytest.approx(peaks(near).gain[0] * 4 / np.pi, rel=0.01), "as a square wave"
    assert np.isfinite(
        step_gain(Parameters.of([near.everything[0], *drawn(3, 1).everything]))
    ).all()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("lag", [0.1, 0.3])
def test_what_is_far_from_the_boundary_is_not_called_marginal(lag: float) -> None:
    """Without the lag these gains are far on the stable side, and 0.3 s change no verdict."""
    (vehicle,) = stability_report(Parameters([0.05], [1.0], [2.0], lag=[lag])).vehicles
    assert (vehicle.linf_exact.stable, vehicle.linf_exact.marginal) == (True, False)
    (vehicle,) = stability_report(Parameters([0.1], [0.1], [1.0], lag=[lag])).vehicles
    assert (vehicle.linf_exact.stable, vehicle.linf_exact.marginal) == (False, False)


def test_a_delay_may_amplify_without_gap_control() -> None:
    """With α = 0 the loop is β e^(-ds)/s, which amplifies from βd = 1/2 and is unstable at π/2."""
    delays = [0.0, 1.0, 2.0, 6.0]
    report = stability_report(Parameters([0.0] * 4, 0.3, np.nan, delay=delays))
    assert [vehicle.l2.stable for vehicle in report.vehicles] == [True, True, False, False]
    gains = [vehicle.peak.gain for vehicle in report.vehicles]
    assert gains[:2] == [1.0, 1.0]
    assert 1.0 < gains[2] < np.inf == gains[3]
    assert "no speed disturbance grows" not in reason(report.vehicles[2].l2, report.vehicles[2])
    (silent,) = stability_report(Parameters([0.0], [0.0], [np.nan], delay=[1.0])).vehicles
    assert (silent.l2.stable, silent.peak.gain, silent.linf_gain) == (True, 0.0, 0.0)
