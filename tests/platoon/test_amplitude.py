"""Amplitudes along a platoon: measured as predicted, with the transient's end known exactly."""

from math import inf, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.model.cthp import Parameters
from accpinn.model.published import CASALE
from accpinn.platoon.leader import Sinusoid
from accpinn.platoon.simulation import (
    SETTLED,
    Amplitudes,
    NeverSettles,
    TooShort,
    TransientLeft,
    simulate_platoon,
)
from accpinn.stability.frequency import response
from tests.support.vehicles import AUDI, MERCEDES, MIXED, TESLA, row


def measured(platoon: Parameters, leader: Sinusoid) -> Amplitudes:
    found = simulate_platoon(platoon, leader).amplitudes
    assert found is not None
    return found


class TestThePapersFourPanels:
    """Its figure of eight followers behind a sinusoid of 1 m/s, 500 s."""

    @pytest.mark.parametrize(("vehicle", "grows"), [(MERCEDES, True), (TESLA, False)])
    @pytest.mark.parametrize("omega", [0.25, 0.3])
    def test_the_eighth_follower_moves_by_the_eighth_power(
        self, vehicle: Parameters, omega: float, grows: bool
    ) -> None:
        run = simulate_platoon(row(*[vehicle] * 8), Sinusoid(omega))
        assert run.amplitudes is not None
        power = np.abs(response(row(vehicle), np.array([omega])))[0, 0] ** 8
        assert run.amplitudes.measured[8] == pytest.approx(power, rel=1e-2)
        assert (run.amplitudes.measured[8] > 1) == grows
        assert (run.findings, run.collisions) == ((), ())

    def test_all_amplitudes_are_measured_to_six_digits(self) -> None:
        found = measured(row(*[MERCEDES] * 8), Sinusoid(0.25))
        gain = np.abs(response(row(MERCEDES), np.array([0.25])))[0, 0]
        np.testing.assert_allclose(found.predicted, gain ** np.arange(9), rtol=1e-12)
        np.testing.assert_allclose(found.measured, gain ** np.arange(9), rtol=1e-6)
        assert found.periods == 5


@given(st.permutations(range(4)), st.floats(0.05, 1.5))
@settings(max_examples=15)
def test_those_of_a_mixed_platoon_are_the_products_in_any_order(
    order: list[int], omega: float
) -> None:
    platoon = MIXED[order]
    found = measured(platoon, Sinusoid(omega, duration=900))
    products = np.cumprod(np.abs(response(platoon, np.array([omega])))[:, 0])
    np.testing.assert_allclose(found.predicted[1:], products, rtol=1e-12)
    np.testing.assert_allclose(found.measured, found.predicted, rtol=1e-3)


def test_the_transient_ends_at_the_time_given() -> None:
    leader, platoon = Sinusoid(0.25, duration=900), row(*[MERCEDES] * 8)
    run = simulate_platoon(platoon, leader)
    assert run.amplitudes is not None
    since = run.trajectories.time - leader.settle
    steady = np.cumprod(response(platoon, np.array([0.25]))[:, 0])
    for k, phasor in enumerate(steady, 1):
        wave = (phasor * np.exp(0.25j * since)).imag
        apart = np.abs(run.trajectories.speeds[:, k] - 20 - wave) / abs(phasor)
        settled = run.amplitudes.settled[k]
        assert apart[since > settled].max() < SETTLED
        assert apart[(since > 0) & (since < settled - 1)].max() > SETTLED


def test_a_run_too_short_for_the_transient_names_the_duration_that_is_enough() -> None:
    slow = CASALE.parameters[[0] * 8]
    found = measured(slow, Sinusoid(0.25, duration=500))
    assert found.settled[8] == pytest.approx(721, abs=2)
    assert found.findings == (TransientLeft(8, 767),)
    assert not found.free
    enough = measured(slow, Sinusoid(0.25, duration=767))
    assert enough.findings == ()
    assert enough.free


def test_less_than_a_period_is_not_measured() -> None:
    found = measured(AUDI, Sinusoid(0.25, duration=40))
    assert np.isnan(found.measured).all()
    (finding,) = found.findings
    assert isinstance(finding, TooShort)
    assert finding.period == pytest.approx(2 * pi / 0.25)
    assert measured(AUDI, Sinusoid(0.25, duration=finding.duration)).findings == ()
    assert measured(AUDI, Sinusoid(0.25, duration=10)).periods == 0


def test_a_fast_sinusoid_gets_enough_samples() -> None:
    run = simulate_platoon(row(AUDI, TESLA), Sinusoid(40.0, duration=300))
    assert run.trajectories.time[1] < 2 * pi / 40 / 20
    assert run.amplitudes is not None
    np.testing.assert_allclose(run.amplitudes.measured, run.amplitudes.predicted, rtol=1e-3)


def test_without_gap_control_the_gap_starts_at_the_headway_given() -> None:
    run = simulate_platoon(Parameters(0.0, 0.3, 1.2), Sinusoid(0.25))
    assert run.trajectories.gaps[0, 0] == 24
    assert run.amplitudes is not None
    assert run.amplitudes.measured[1] == pytest.approx(0.3 / np.hypot(0.25, 0.3), rel=1e-6)


def test_without_reaction_nothing_moves() -> None:
    run = simulate_platoon(row(Parameters(0.0, 0.0, 1.0), AUDI), Sinusoid(0.25))
    assert (run.trajectories.speeds[:, 1:] == 20).all()
    assert run.amplitudes is not None
    np.testing.assert_array_equal(run.amplitudes.predicted, [1, 0, 0])
    np.testing.assert_allclose(run.amplitudes.measured, [1, 0, 0], atol=1e-12)


def test_without_damping_it_never_settles() -> None:
    undamped = Parameters(0.0625, 0.0, 0.0)
    run = simulate_platoon(row(TESLA, undamped, TESLA), Sinusoid(0.25))
    assert run.amplitudes is not None
    assert np.isfinite(run.amplitudes.settled[:2]).all()
    np.testing.assert_array_equal(run.amplitudes.settled[2:], inf)
    np.testing.assert_array_equal(run.amplitudes.predicted[2:], inf)
    assert NeverSettles(2) in run.findings
    # In resonance the amplitude grows with time: by A|H_1|ω/2 a second.
    moved = np.abs(run.trajectories.speeds[:, 2] - run.leader.speed).max()
    assert moved == pytest.approx(0.948 * 0.125 * 480, rel=0.05)
