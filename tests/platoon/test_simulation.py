"""Simulated platoons: exact motion against tight integration, findings, and amplitudes."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from accpinn import Brake, Parameters, Sinusoid, SpeedStep, simulate_platoon
from accpinn.errors import ParameterError
from accpinn.model.published import CASALE, ParameterSet
from accpinn.model.registry import FOLLOWING
from accpinn.platoon import (
    SETTLED,
    Amplitudes,
    NeverSettles,
    PlatoonRun,
    Reversal,
    TooShort,
    TransientLeft,
)
from accpinn.platoon.leader import Leader, Recorded
from accpinn.results.cast import Cast
from accpinn.results.messages.platoon import disturbance
from accpinn.stability.criteria import response
from accpinn.units import FloatArray
from tests.support.driving import motion
from tests.support.vehicles import AUDI, MERCEDES, MIXED, NO_GAP_CONTROL, TESLA, row


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
    rates = motion(platoon.values, partial(leader_speed, leader))
    kinks = [phase.start for phase in leader.phases()] + [leader.duration]
    state = leader.speed * np.r_[platoon.tau, np.ones(len(platoon))]
    instants = run.trajectories.time
    result = np.empty((len(instants), len(state)))
    for low, high in pairwise(kinks):
        inside = (instants >= low - 1e-9) & (instants <= high + 1e-9)
        span = (low, high - 1e-12)  # a step's new speed begins with its own piece
        wanted = np.append(np.clip(instants[inside], *span), span[1])
        solved = solve_ivp(
            rates, span, state, "DOP853", np.unique(wanted), rtol=1e-12, atol=1e-12
        ).y.T
        result[inside], state = solved[: inside.sum()], solved[-1]
    gaps, speeds = np.hsplit(result, 2)
    return speeds, gaps


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
        run = simulate_platoon(MIXED, leader, sample_time=0.25)
        speeds, gaps = integrated(MIXED, leader, run)
        np.testing.assert_allclose(run.trajectories.speeds[:, 1:], speeds, rtol=0, atol=1e-8)
        np.testing.assert_allclose(run.trajectories.gaps, gaps, rtol=0, atol=1e-8)
        ahead = [leader_speed(leader, instant + 1e-12) for instant in run.trajectories.time]
        np.testing.assert_allclose(run.trajectories.speeds[:, 0], ahead, atol=1e-9)
        with pytest.raises(ValueError, match="read-only"):
            run.trajectories.speeds[0, 0] = 1.0
        if isinstance(leader, Brake):  # its corners are samples, and a recorded clock is kept
            planned = simulate_platoon(MIXED, Brake(4.0, 2.0, 6.0, 0.5, settle=5.0)).trajectories
            recorded = Recorded(planned.time + 43_000.0, planned.speeds[:, 0])
            driven = simulate_platoon(MIXED, recorded).trajectories
            np.testing.assert_allclose(driven.gaps, planned.gaps, atol=1e-8)
            assert driven.time[0] == 43_000.0


class TestFindings:
    def test_driving_backwards(self) -> None:
        run = simulate_platoon(AUDI, Sinusoid(1.0, amplitude=2.0, speed=1.5))
        (found,) = (finding for finding in run.findings if isinstance(finding, Reversal))
        assert found.follower == 0
        assert found.time == pytest.approx(20 + pi + np.arcsin(1.5 / 2), abs=0.1)

    def test_a_collision_ends_the_vehicle_and_those_behind_it_only(self) -> None:
        run = simulate_platoon(row(*[MERCEDES] * 8), SpeedStep(-8.0))
        driven, valid, first = run.trajectories, run.valid, run.collisions[0]
        assert run.findings == (first,)
        leader = SpeedStep(-8.0, duration=60)
        fine = simulate_platoon(run.parameters, leader, sample_time=0.001).trajectories
        exact = fine.time[np.argmax(fine.gaps[:, 3] <= 0)]
        assert first.time == pytest.approx(exact, abs=2e-3)
        np.testing.assert_array_equal(run.minimum_gap, driven.gaps.min(axis=0))
        assert (first.follower, run.survivors) == (4, 4)
        assert run.collisions == (first,), "those behind it collide with what is not there any more"
        ahead, behind = slice(None, 4), slice(4, None)
        np.testing.assert_array_equal(valid.speeds[:, ahead], driven.speeds[:, ahead])
        np.testing.assert_array_equal(valid.gaps[:, :3], driven.gaps[:, :3])
        after = driven.time > first.time
        assert np.isnan(valid.speeds[after, behind]).all()
        np.testing.assert_array_equal(valid.speeds[~after], driven.speeds[~after])
        np.testing.assert_array_equal(valid.gaps[~after], driven.gaps[~after])
        moved = np.abs(driven.speeds - run.leader.speed)
        np.testing.assert_array_equal(run.largest_deviation[ahead], moved[:, ahead].max(axis=0))
        before = moved[~after].max(axis=0)
        np.testing.assert_array_equal(run.largest_deviation[behind], before[behind])
        assert (before < moved.max(axis=0))[behind].any()

    def test_a_vehicle_further_ahead_may_collide_later(self) -> None:
        run = simulate_platoon(row(*[AUDI] * 8), Sinusoid(0.214))
        assert [one.follower for one in run.collisions] == [6, 5]
        ends = run.trajectories.time[run.meaningful - 1]
        assert ends[6] <= run.collisions[0].time < run.collisions[1].time
        assert ends[5] == pytest.approx(run.collisions[1].time, abs=0.1)
        assert (ends[:5] == run.trajectories.time[-1]).all()
        assert (ends[7:] == ends[6]).all()

    def test_a_nonlinear_model_that_diverges_where_its_gap_is_used_up_collides(self) -> None:
        own = np.array([[3.03, 28.3, 0.858, 5.65, 62.1], [1.51, 4.98, 1.026, 2.32, 48.0]])
        platoon = FOLLOWING["idm"].linearisations(own[[0, 1, 1]].T, 5.0)
        run = simulate_platoon(platoon, Sinusoid(0.5023, amplitude=8.0, speed=5.0), model="idm")
        assert np.isnan(run.trajectories.gaps[-1, 1:]).all()
        (hit,) = run.collisions
        assert hit.follower == 2, "what the one behind does has no meaning then"
        assert abs(run.valid.gaps[: run.meaningful[2], 1]).max() < 100.0
        assert disturbance(run, Cast(ParameterSet("", ("A", "B", "C"), platoon), (0, 1, 2)))

    def test_a_stop_behind_a_stopped_leader_is_no_collision(self) -> None:
        """At standstill the equilibrium gap is zero; rounding makes that -1e-13 m."""
        platoon = row(*[Parameters(0.02, 0.5, 2.0)] * 2)
        run = simulate_platoon(platoon, SpeedStep(-20.0, speed=20.0))
        assert run.minimum_gap[-1] == pytest.approx(0.0, abs=1e-9)
        assert run.collisions == ()
        assert run.meaningful.tolist() == [3001] * 3
        at_once = simulate_platoon(Parameters(0.1, 0.2, 0.0), SpeedStep())
        assert (at_once.collisions[0].time, at_once.meaningful.tolist()) == (0, [3001, 2])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: simulate_platoon(row(AUDI, NO_GAP_CONTROL), Sinusoid()), r"set 2: .* give τ"),
        (lambda: simulate_platoon(AUDI, Sinusoid(), sample_time=0.0), "Sample time 0 s"),
        (lambda: simulate_platoon(AUDI, Brake(), sample_time=1e-9), "shorten its duration"),
        (lambda: simulate_platoon(Parameters([], [], []), Sinusoid()), "no vehicle"),
        (lambda: simulate_platoon(Parameters(nan, 1, 1), Sinusoid()), "set 1: α is missing"),
        (lambda: simulate_platoon(Parameters(1e9, 1e9, 1), Sinusoid()), "within a microsecond"),
        (lambda: Sinusoid(frequency=0.0), "frequency = 0, but it must be above zero"),
        (lambda: Sinusoid(frequency=nan), "frequency = nan is no number"),
        (lambda: Sinusoid(amplitude=-1.0), "amplitude = -1, but it must be zero or more"),
        (lambda: SpeedStep(duration=0.0), "duration = 0, but it must be above zero"),
        (lambda: Brake(deceleration=0.0), "deceleration = 0, but it must be above zero"),
        (lambda: Brake(hold=inf), "hold = inf is no number"),
    ],
)
def test_what_cannot_be_simulated_is_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        make()


def measured(platoon: Parameters, leader: Sinusoid) -> Amplitudes:
    return simulate_platoon(platoon, leader).amplitudes


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


def test_without_gap_control_the_gap_starts_at_the_headway_given() -> None:
    run = simulate_platoon(row(Parameters(0.0, 0.3, 1.2), AUDI), Sinusoid(0.25))
    assert run.trajectories.gaps[0, 0] == 24
    assert run.amplitudes.measured[1] == pytest.approx(0.3 / np.hypot(0.25, 0.3), rel=1e-6)
    still = simulate_platoon(row(Parameters(0.0, 0.0, 1.0), AUDI), Sinusoid(0.25))
    assert (still.trajectories.speeds[:, 1:] == 20).all(), "without reaction nothing moves"
    np.testing.assert_array_equal(still.amplitudes.predicted, [1, 0, 0])


def test_what_a_vehicle_that_is_itself_unstable_does_is_no_oscillation() -> None:
    """Nothing is predicted for it and those behind it, however short the run."""
    platoon = Parameters([0.1, 0.1374, 0.1], [0.3, 0.106, 0.3], [1.5, 1.05, 1.5],
                         lag=[0, 1.06, 0], delay=[0.3, 0.82, 0.3])  # fmt: skip
    run = simulate_platoon(platoon, Sinusoid(amplitude=0.1, duration=120.0))
    assert np.isfinite(run.amplitudes.predicted).tolist() == [True, True, False, False]
    assert np.isfinite(run.amplitudes.settled).tolist() == [True, True, False, False]
    assert "without limit" in disturbance(
        run, Cast(ParameterSet("", tuple("ABC"), platoon), (0, 1, 2))
    )


def test_without_damping_it_never_settles() -> None:
    undamped = Parameters(0.0625, 0.0, 0.0)
    run = simulate_platoon(row(TESLA, undamped, TESLA), Sinusoid(0.25))
    assert np.isfinite(run.amplitudes.settled[:2]).all()
    np.testing.assert_array_equal(run.amplitudes.settled[2:], inf)
    np.testing.assert_array_equal(run.amplitudes.predicted[2:], inf)
    assert NeverSettles(2) in run.findings
    # In resonance the amplitude grows with time: by A|H_1|ω/2 a second.
    moved = np.abs(run.trajectories.speeds[:, 2] - run.leader.speed).max()
    assert moved == pytest.approx(0.948 * 0.125 * 480, rel=0.05)
