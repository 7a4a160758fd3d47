"""Simulated platoons: exact motion against tight integration, and what is found on the way."""

from itertools import pairwise
from math import nan, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.platoon.leader import Brake, Leader, Recorded, Sinusoid, SpeedStep
from accpinn.platoon.simulation import Collision, PlatoonRun, Reversal, simulate_platoon
from accpinn.stability.head_to_tail import head_to_tail_gains
from accpinn.units import FloatArray
from tests.support.vehicles import AUDI, MERCEDES, MIXED, NO_GAP_CONTROL, TESLA, ordinary, row


def leader_speed(leader: Leader, instant: float) -> float:
    """Written out once more, on its own."""
    since = instant - getattr(leader, "settle", 0.0)
    if since < 0:
        return leader.speed
    if isinstance(leader, Sinusoid):
        return float(leader.speed + leader.amplitude * np.sin(leader.frequency * since))
    if isinstance(leader, SpeedStep):
        return leader.speed + leader.change
    assert isinstance(leader, Brake)
    low = leader.drop / leader.deceleration
    up = low + leader.hold
    back = up + leader.drop / leader.acceleration
    lowest = leader.speed - leader.drop
    corners = ([0, low, up, back], [leader.speed, lowest, lowest, leader.speed])
    return float(np.interp(since, *corners))


def integrated(
    platoon: Parameters, leader: Leader, run: PlatoonRun
) -> tuple[FloatArray, FloatArray]:
    """Speeds (N, M) and gaps (N, M) of the followers, by tight steps between the leader's kinks."""

    def rates(instant: float, state: FloatArray) -> FloatArray:
        ahead, result = leader_speed(leader, instant), np.empty_like(state)
        for i, vehicle in enumerate(platoon):
            gap, speed = state[2 * i : 2 * i + 2]
            result[2 * i] = ahead - speed
            spacing = vehicle.alpha * (gap - vehicle.tau * speed)
            result[2 * i + 1] = spacing + vehicle.beta * (ahead - speed)
            ahead = speed
        return result

    assert not isinstance(leader, Recorded)
    kinks = [phase.start for phase in leader.phases()] + [leader.duration]
    state = leader.speed * np.stack([platoon.tau, np.ones(len(platoon))], axis=1).ravel()
    instants = run.trajectories.time
    result = np.empty((len(instants), len(state)))
    for low, high in pairwise(kinks):
        inside = (instants >= low - 1e-9) & (instants <= high + 1e-9)
        span = (low, high - 1e-12)  # a step's new speed begins with its own piece
        solved = solve_ivp(
            rates,
            span,
            state,
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
            t_eval=np.clip(instants[inside], *span),
        )
        result[inside], state = solved.y.T, solved.y[:, -1]
        if instants[inside][-1] < span[1]:
            rest = solve_ivp(
                rates, (instants[inside][-1], span[1]), state, "DOP853", rtol=1e-12, atol=1e-12
            )
            state = rest.y[:, -1]
    return result[:, 1::2], result[:, 0::2]


def test_a_run_starts_in_equilibrium() -> None:
    run = simulate_platoon(row(*[TESLA] * 8), Sinusoid(0.25))
    instants, speeds = run.trajectories.time, run.trajectories.speeds
    assert (instants[0], instants[-1]) == (0, pytest.approx(500))
    assert speeds.shape == (5001, 9)
    steady = instants <= 20
    assert (speeds[steady] == 20).all()
    assert (run.trajectories.gaps[steady] == 20 * 1.16).all()


class TestExactMotion:
    @pytest.mark.parametrize(
        "leader",
        [
            Sinusoid(0.21, 2.0, settle=7.33, duration=60),
            Sinusoid(1.7, 0.5, speed=30.0, settle=0.0, duration=30),
            SpeedStep(-3.0, settle=5.05, duration=60),
            Brake(8.0, 1.7, 3.3, 0.9, settle=4.21, duration=60),
        ],
        ids=lambda leader: type(leader).__name__,
    )
    def test_agrees_with_a_tight_numerical_integration(self, leader: Leader) -> None:
        run = simulate_platoon(MIXED, leader, 0.25)
        speeds, gaps = integrated(MIXED, leader, run)
        np.testing.assert_allclose(run.trajectories.speeds[:, 1:], speeds, rtol=0, atol=1e-8)
        np.testing.assert_allclose(run.trajectories.gaps, gaps, rtol=0, atol=1e-8)
        ahead = [leader_speed(leader, instant + 1e-12) for instant in run.trajectories.time]
        np.testing.assert_allclose(run.trajectories.speeds[:, 0], ahead, atol=1e-9)

    @given(st.lists(ordinary, min_size=1, max_size=4), st.floats(0.5, 40.0))
    @settings(max_examples=10)
    def test_an_equilibrium_stays_to_the_last_bit(
        self, platoon: list[Parameters], speed: float
    ) -> None:
        vehicles = row(*platoon)
        run = simulate_platoon(vehicles, Sinusoid(amplitude=0.0, speed=speed, duration=50))
        assert (run.trajectories.speeds == speed).all()
        assert (run.trajectories.gaps == speed * vehicles.tau).all()

    def test_a_brake_sampled_at_its_corners_is_the_same_recorded(self) -> None:
        leader = Brake(4.0, 2.0, 6.0, 0.5, settle=5.0, duration=60)
        planned = simulate_platoon(MIXED, leader, 0.1)
        driven = planned.trajectories
        # Recordings count their time from somewhere else.
        recorded = simulate_platoon(MIXED, Recorded(driven.time + 43_000.0, driven.speeds[:, 0]))
        np.testing.assert_allclose(recorded.trajectories.gaps, driven.gaps, atol=1e-8)
        assert recorded.trajectories.time[0] == 0

    def test_peaks_stay_below_the_exact_gain(self) -> None:
        found = head_to_tail_gains(row(*[AUDI] * 3)).gain
        for leader in (Sinusoid(0.21), SpeedStep(), Brake()):
            run = simulate_platoon(row(*[AUDI] * 3), leader)
            assert (run.largest_deviation[1:] <= run.largest_deviation[0] * found).all()


class TestFindings:
    def test_a_collision_with_its_follower_and_time(self) -> None:
        platoon = row(*[MERCEDES] * 8)
        run = simulate_platoon(platoon, SpeedStep(-8.0))
        assert [collision.follower for collision in run.collisions] == [4, 5, 6, 7, 8]
        assert all(a.time < b.time for a, b in pairwise(run.collisions))
        fine = simulate_platoon(platoon, SpeedStep(-8.0, duration=60), 0.001).trajectories
        exact = fine.time[np.argmax(fine.gaps[:, 3] <= 0)]
        assert run.collisions[0].time == pytest.approx(exact, abs=2e-3)
        assert run.findings == run.collisions[:1]

    def test_the_smallest_gap_and_when(self) -> None:
        run = simulate_platoon(MIXED, Brake())
        gaps, instants = run.trajectories.gaps, run.trajectories.time
        for k in range(4):
            assert run.minimum_gap[k] == gaps[:, k].min()
            assert gaps[instants == run.minimum_gap_time[k], k] == run.minimum_gap[k]
        assert (run.collisions, run.findings, run.amplitudes) == ((), (), None)

    def test_driving_backwards(self) -> None:
        run = simulate_platoon(AUDI, Sinusoid(1.0, amplitude=2.0, speed=1.5))
        (found,) = (finding for finding in run.findings if isinstance(finding, Reversal))
        assert found.follower == 0
        assert found.time == pytest.approx(20 + pi + np.arcsin(1.5 / 2), abs=0.1)

    def test_what_comes_after_a_collision_is_left_out(self) -> None:
        run = simulate_platoon(row(*[AUDI] * 4), SpeedStep(-8.0, speed=10.0))
        driven, first = run.trajectories, run.collisions[0]
        assert driven.time[run.meaningful - 1] <= first.time < driven.time[run.meaningful]
        moved = np.abs(driven.speeds - 10.0)
        before = moved[driven.time <= first.time].max(axis=0)
        np.testing.assert_array_equal(run.largest_deviation, before)
        assert (before < moved.max(axis=0)).any()
        assert (driven.speeds < 0).any()
        assert [type(finding) for finding in run.findings] == [Collision]

    def test_a_collision_at_the_start_leaves_two_samples(self) -> None:
        run = simulate_platoon(Parameters(0.1, 0.2, 0.0), SpeedStep())
        assert run.collisions[0].time == 0
        assert run.meaningful == 2
        assert simulate_platoon(AUDI, SpeedStep(0.0)).meaningful == 3001

    def test_a_stop_behind_a_stopped_leader_is_no_collision(self) -> None:
        """At standstill the equilibrium gap is zero; rounding makes that -1e-13 m."""
        platoon = row(*[Parameters(0.02, 0.5, 2.0)] * 2)
        run = simulate_platoon(platoon, SpeedStep(-20.0, speed=20.0))
        assert run.minimum_gap[-1] == pytest.approx(0.0, abs=1e-9)
        assert run.collisions == ()


class TestRefusals:
    def test_without_gap_control_and_headway(self) -> None:
        with pytest.raises(ParameterError, match=r"set 2: with α = 0 .* give τ"):
            simulate_platoon(row(AUDI, NO_GAP_CONTROL), Sinusoid())

    @pytest.mark.parametrize(
        ("platoon", "leader", "step", "words"),
        [
            (AUDI, Sinusoid(), 0.0, "Sample time 0 s"),
            (AUDI, Sinusoid(frequency=1e4), None, "shorten its duration"),
            (AUDI, Brake(), 1e-9, "shorten its duration"),
            (Parameters([], [], []), Sinusoid(), None, "no vehicle"),
            (Parameters(nan, 1, 1), Sinusoid(), None, "set 1: α is missing"),
            (Parameters(1e9, 1e9, 1), Sinusoid(), None, "within a microsecond"),
        ],
    )
    def test_impossible_settings(
        self, platoon: Parameters, leader: Leader, step: float | None, words: str
    ) -> None:
        with pytest.raises(ParameterError, match=words):
            simulate_platoon(platoon, leader, step)


def test_arrays_cannot_be_changed() -> None:
    run = simulate_platoon(AUDI, Sinusoid())
    with pytest.raises(ValueError, match="read-only"):
        run.trajectories.speeds[0, 0] = 1.0
