"""The platoon: exact motion against tight integration, amplitudes against |H|, and what is said."""

import time
from itertools import pairwise
from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from accpinn.errors import ParameterError
from accpinn.model import cthp
from accpinn.model.cthp import Parameters
from accpinn.model.published import CASALE
from accpinn.platoon.amplitude import SETTLED
from accpinn.platoon.leader import Brake, Leader, Recorded, Sinusoid, SpeedStep
from accpinn.platoon.simulation import PlatoonRun, simulate_platoon
from accpinn.stability.frequency import response
from accpinn.stability.report import stability_report
from accpinn.units import FloatArray

# Apostolakis and Ampountolas, IEEE TVT 2024, Table III, AstaZero.
AUDI = Parameters(0.0612, 0.1200, 1.19)
BMW = Parameters(0.1000, 0.1470, 1.17)
MERCEDES = Parameters(0.0766, 0.2220, 1.16)
TESLA = Parameters(0.0409, 0.4450, 1.16)
MIXED = (AUDI, BMW, MERCEDES, TESLA)

laws = st.builds(
    Parameters, alpha=st.floats(0.01, 1.0), beta=st.floats(0.05, 1.0), tau=st.floats(0.3, 4.0)
)


def power(law: Parameters, omega: float, count: int) -> float:
    return float(abs(response([law], np.array([omega]))[0, 0]) ** count)


class TestThePapersFourPanels:
    """Its figure of eight followers behind a sinusoid of 1 m/s, 500 s."""

    @pytest.mark.parametrize(("law", "grows"), [(MERCEDES, True), (TESLA, False)])
    @pytest.mark.parametrize("omega", [0.25, 0.3])
    def test_the_eighth_follower_moves_as_the_eighth_power_says(
        self, law: Parameters, omega: float, grows: bool
    ) -> None:
        run = simulate_platoon([law] * 8, Sinusoid(omega))
        assert run.amplitudes is not None
        assert run.amplitudes.measured[8] == pytest.approx(power(law, omega, 8), rel=1e-2)
        assert (run.amplitudes.measured[8] > 1) == grows
        assert run.warnings == ()
        assert run.collisions == ()

    def test_all_amplitudes_are_measured_to_six_digits(self) -> None:
        run = simulate_platoon([MERCEDES] * 8, Sinusoid(0.25))
        assert run.amplitudes is not None
        expected = [power(MERCEDES, 0.25, k) for k in range(9)]
        np.testing.assert_allclose(run.amplitudes.predicted, expected, rtol=1e-12)
        np.testing.assert_allclose(run.amplitudes.measured, expected, rtol=1e-6)
        assert run.amplitudes.periods == 5

    def test_starts_as_described(self) -> None:
        run = simulate_platoon([TESLA] * 8, Sinusoid(0.25))
        instants, speeds = run.trajectories.time, run.trajectories.speeds
        assert (instants[0], instants[-1]) == (0, pytest.approx(500))
        assert speeds.shape == (5001, 9)
        steady = instants <= 20
        assert (speeds[steady] == 20).all()
        np.testing.assert_array_equal(
            run.trajectories.gaps[steady], np.full((steady.sum(), 8), 20 * 1.16)
        )
        np.testing.assert_allclose(
            speeds[:, 0], 20 + np.where(steady, 0, np.sin(0.25 * (instants - 20))), atol=1e-10
        )


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
        for i, law in enumerate(platoon):
            gap, speed = state[2 * i : 2 * i + 2]
            result[2 * i] = ahead - speed
            result[2 * i + 1] = law.alpha * (gap - law.tau * speed) + law.beta * (ahead - speed)
            ahead = speed
        return result

    assert not isinstance(leader, Recorded)
    kinks = [phase.start for phase in leader.phases()] + [leader.duration]
    state = np.array([[law.tau * leader.speed, leader.speed] for law in platoon]).ravel()
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

    @given(st.lists(laws, min_size=1, max_size=4), st.floats(0.5, 40.0))
    @settings(deadline=None, max_examples=25)
    def test_an_equilibrium_stays_to_the_last_bit(
        self, platoon: list[Parameters], speed: float
    ) -> None:
        run = simulate_platoon(platoon, Sinusoid(amplitude=0.0, speed=speed, duration=50))
        assert (run.trajectories.speeds == speed).all()
        for gap, law in zip(run.trajectories.gaps.T, platoon, strict=True):
            assert (gap == speed * law.tau).all()

    @given(laws, st.floats(0.05, 1.0), st.floats(0.1, 5.0))
    @settings(deadline=None, max_examples=25)
    def test_deviations_are_proportional_to_the_amplitude(
        self, law: Parameters, omega: float, amplitude: float
    ) -> None:
        one = simulate_platoon([law, AUDI], Sinusoid(omega, 1.0, duration=120))
        other = simulate_platoon([law, AUDI], Sinusoid(omega, amplitude, duration=120))
        scale = amplitude * np.abs(one.trajectories.speeds - 20).max()
        np.testing.assert_allclose(
            other.trajectories.speeds - 20,
            amplitude * (one.trajectories.speeds - 20),
            atol=1e-11 * scale + 1e-13,
        )

    @pytest.mark.parametrize(
        "leader", [Sinusoid(duration=105), SpeedStep(duration=105), Brake(duration=105)]
    )
    def test_does_not_depend_on_the_step(self, leader: Leader) -> None:
        fine, coarse = simulate_platoon(MIXED, leader, 0.05), simulate_platoon(MIXED, leader, 0.7)
        np.testing.assert_allclose(
            fine.trajectories.gaps[::14], coarse.trajectories.gaps, rtol=0, atol=1e-10
        )

    def test_a_recorded_leader_is_that_of_the_law_s_own_simulation(self) -> None:
        instants = np.arange(301) * 0.1
        rng = np.random.default_rng(5)
        ahead = 22 + np.cumsum(rng.normal(0, 0.1, 301))
        # Recordings count their time from somewhere else.
        run = simulate_platoon(MIXED, Recorded(instants + 43_000.0, ahead))
        equilibrium = np.array([law.tau for law in MIXED]) * ahead[0]
        expected = cthp.simulate(MIXED, instants, ahead, np.full(4, ahead[0]), equilibrium)
        np.testing.assert_allclose(run.trajectories.speeds, expected.speeds, atol=1e-10)
        np.testing.assert_allclose(run.trajectories.gaps, expected.gaps, atol=1e-10)
        assert run.trajectories.time[0] == 0

    def test_a_brake_sampled_at_its_corners_is_the_same_recorded(self) -> None:
        leader = Brake(4.0, 2.0, 6.0, 0.5, settle=5.0, duration=60)
        planned = simulate_platoon(MIXED, leader, 0.1)
        recorded = simulate_platoon(
            MIXED, Recorded(planned.trajectories.time, planned.trajectories.speeds[:, 0])
        )
        np.testing.assert_allclose(recorded.trajectories.gaps, planned.trajectories.gaps, atol=1e-9)

    def test_peaks_stay_below_the_exact_gain(self) -> None:
        found = stability_report([AUDI] * 3).platoon.linf.gain
        for leader in (Sinusoid(0.21), SpeedStep(), Brake()):
            run = simulate_platoon([AUDI] * 3, leader)
            assert (run.largest_deviation[1:] <= run.largest_deviation[0] * found).all()


class TestWhatIsReported:
    def test_a_collision_with_its_follower_and_time(self) -> None:
        leader = SpeedStep(-8.0)
        run = simulate_platoon([MERCEDES] * 8, leader)
        assert [collision.follower for collision in run.collisions] == [4, 5, 6, 7, 8]
        assert all(a.time < b.time for a, b in pairwise(run.collisions))
        fine = simulate_platoon([MERCEDES] * 8, SpeedStep(-8.0, duration=60), 0.001).trajectories
        exact = fine.time[np.argmax(fine.gaps[:, 3] <= 0)]
        assert run.collisions[0].time == pytest.approx(exact, abs=2e-3)
        assert "Follower 4 runs into the vehicle ahead at 33.9 s" in run.warnings[0]

    def test_the_smallest_gap_and_when(self) -> None:
        run = simulate_platoon(MIXED, Brake())
        gaps, instants = run.trajectories.gaps, run.trajectories.time
        for k in range(4):
            assert run.minimum_gap[k] == gaps[:, k].min()
            assert gaps[instants == run.minimum_gap_time[k], k] == run.minimum_gap[k]
        assert run.collisions == ()
        assert run.warnings == ()

    def test_driving_backwards(self) -> None:
        run = simulate_platoon([AUDI], Sinusoid(1.0, amplitude=2.0, speed=1.5))
        assert any("The leader drives backwards" in text for text in run.warnings)

    def test_what_comes_after_a_collision_is_not_reported(self) -> None:
        run = simulate_platoon([AUDI] * 4, SpeedStep(-8.0, speed=10.0))
        driven, first = run.trajectories, run.collisions[0]
        assert driven.time[run.meaningful - 1] <= first.time < driven.time[run.meaningful]
        moved = np.abs(driven.speeds - 10.0)
        before = moved[driven.time <= first.time].max(axis=0)
        np.testing.assert_array_equal(run.largest_deviation, before)
        assert (before < moved.max(axis=0)).any()
        assert (driven.speeds < 0).any()
        (warning,) = run.warnings
        assert "no meaning" in warning

    def test_a_collision_at_the_start_leaves_two_samples(self) -> None:
        run = simulate_platoon([Parameters(0.1, 0.2, 0.0)], SpeedStep())
        assert run.collisions[0].time == 0
        assert run.meaningful == 2
        assert simulate_platoon([AUDI], SpeedStep(0.0)).meaningful == 3001

    def test_behind_anything_but_a_sinusoid_there_is_no_amplitude(self) -> None:
        assert simulate_platoon([AUDI], Brake()).amplitudes is None

    def test_arrays_cannot_be_changed(self) -> None:
        run = simulate_platoon([AUDI], Sinusoid())
        with pytest.raises(ValueError, match="read-only"):
            run.trajectories.speeds[0, 0] = 1.0


class TestAmplitudes:
    @given(st.permutations(MIXED), st.floats(0.05, 1.5))
    @settings(deadline=None, max_examples=15)
    def test_of_a_mixed_platoon_are_the_products_in_any_order(
        self, platoon: list[Parameters], omega: float
    ) -> None:
        run = simulate_platoon(platoon, Sinusoid(omega, duration=900))
        found = run.amplitudes
        assert found is not None
        products = np.cumprod(np.abs(response(platoon, np.array([omega])))[:, 0])
        np.testing.assert_allclose(found.predicted[1:], products, rtol=1e-12)
        np.testing.assert_allclose(found.measured, found.predicted, rtol=1e-3)

    def test_the_transient_ends_when_it_is_said_to(self) -> None:
        leader = Sinusoid(0.25, duration=900)
        run = simulate_platoon([MERCEDES] * 8, leader)
        assert run.amplitudes is not None
        since = run.trajectories.time - leader.settle
        steady = np.cumprod(response([MERCEDES] * 8, np.array([0.25]))[:, 0])
        for k, phasor in enumerate(steady, 1):
            wave = (phasor * np.exp(0.25j * since)).imag
            apart = np.abs(run.trajectories.speeds[:, k] - 20 - wave) / abs(phasor)
            settled = run.amplitudes.settled[k]
            assert apart[since > settled].max() < SETTLED
            assert apart[(since > 0) & (since < settled - 1)].max() > SETTLED

    def test_a_run_too_short_says_how_long_it_takes(self) -> None:
        slow = Parameters(0.0104, 0.0718, 1.52)
        run = simulate_platoon([slow] * 8, Sinusoid(0.25, duration=500))
        assert run.amplitudes is not None
        assert run.amplitudes.settled[8] == pytest.approx(721, abs=2)
        assert run.warnings == (
            "The transient of follower 8 is still above 0.1 % of its amplitude where that is"
            " measured; a duration of 767 s would do.",
        )
        assert simulate_platoon([slow] * 8, Sinusoid(0.25, duration=767)).warnings == ()

    def test_less_than_a_period_is_not_measured(self) -> None:
        run = simulate_platoon([AUDI], Sinusoid(0.25, duration=40))
        assert run.amplitudes is not None
        assert np.isnan(run.amplitudes.measured).all()
        assert "need a whole period of 25.1 s" in run.warnings[0]
        before = simulate_platoon([AUDI], Sinusoid(0.25, duration=10))
        assert before.amplitudes is not None
        assert before.amplitudes.periods == 0

    def test_a_fast_sinusoid_gets_enough_samples(self) -> None:
        run = simulate_platoon([AUDI, TESLA], Sinusoid(40.0, duration=300))
        assert run.trajectories.time[1] < 2 * pi / 40 / 20
        assert run.amplitudes is not None
        np.testing.assert_allclose(run.amplitudes.measured, run.amplitudes.predicted, rtol=1e-3)


class TestDegenerate:
    def test_without_spacing_the_gap_starts_at_the_headway_given(self) -> None:
        run = simulate_platoon([Parameters(0.0, 0.3, 1.2)], Sinusoid(0.25))
        assert run.trajectories.gaps[0, 0] == 24
        assert run.amplitudes is not None
        assert run.amplitudes.measured[1] == pytest.approx(0.3 / np.hypot(0.25, 0.3), rel=1e-6)

    def test_without_spacing_and_headway_it_is_refused(self) -> None:
        with pytest.raises(ParameterError, match=r"set 2: α = 0 leaves the gap open; give τ"):
            simulate_platoon([AUDI, Parameters(0.0, 0.3, nan)], Sinusoid())

    def test_without_reaction_nothing_moves(self) -> None:
        run = simulate_platoon([Parameters(0.0, 0.0, 1.0), AUDI], Sinusoid(0.25))
        assert (run.trajectories.speeds[:, 1:] == 20).all()
        assert run.amplitudes is not None
        np.testing.assert_array_equal(run.amplitudes.predicted, [1, 0, 0])
        np.testing.assert_allclose(run.amplitudes.measured, [1, 0, 0], atol=1e-12)

    def test_without_damping_it_never_settles(self) -> None:
        undamped = Parameters(0.0625, 0.0, 0.0)
        run = simulate_platoon([TESLA, undamped, TESLA], Sinusoid(0.25))
        assert run.amplitudes is not None
        assert np.isfinite(run.amplitudes.settled[:2]).all()
        np.testing.assert_array_equal(run.amplitudes.settled[2:], inf)
        np.testing.assert_array_equal(run.amplitudes.predicted[2:], inf)
        assert any("Follower 2 never settles" in text for text in run.warnings)
        # In resonance the amplitude grows with time: by A|H_1|ω/2 a second.
        moved = np.abs(run.trajectories.speeds[:, 2] - run.leader.speed).max()
        assert moved == pytest.approx(0.948 * 0.125 * 480, rel=0.05)

    @pytest.mark.parametrize(
        ("make", "words"),
        [
            (lambda: Sinusoid(frequency=0.0), "frequency = 0, but it must be above zero"),
            (lambda: Sinusoid(frequency=nan), "frequency = nan is no number"),
            (lambda: Sinusoid(amplitude=-1.0), "amplitude = -1, but it must be zero or more"),
            (lambda: SpeedStep(duration=0.0), "duration = 0, but it must be above zero"),
            (lambda: Brake(deceleration=0.0), "deceleration = 0, but it must be above zero"),
            (lambda: Brake(hold=inf), "hold = inf is no number"),
            (lambda: Recorded(np.arange(3.0), np.arange(2.0)), "as many speeds as instants"),
            (lambda: Recorded(np.arange(2.0), np.array([20, nan])), "numbers are missing"),
            (lambda: Recorded(np.array([0, 1, 3.0]), np.ones(3)), "not evenly spaced"),
            (lambda: simulate_platoon([AUDI], Sinusoid(), 0.0), "Sample time 0 s"),
            (lambda: simulate_platoon([AUDI], Sinusoid(frequency=1e4)), "shorten its duration"),
            (lambda: simulate_platoon([AUDI], Brake(), 1e-9), "shorten its duration"),
            (lambda: simulate_platoon([], Sinusoid()), "no vehicle"),
            (lambda: simulate_platoon([Parameters(nan, 1, 1)], Sinusoid()), "set 1: α is missing"),
            (
                lambda: simulate_platoon([Parameters(1e9, 1e9, 1)], Sinusoid()),
                "within a microsecond",
            ),
        ],
    )
    def test_impossible_settings_are_refused_in_one_sentence(self, make, words: str) -> None:
        with pytest.raises(ParameterError) as caught:
            make()
        assert words in str(caught.value)
        assert str(caught.value).endswith(".")
        assert "\n" not in str(caught.value)


def test_eight_vehicles_and_500_s_take_less_than_fifty_milliseconds() -> None:
    leader = Sinusoid(0.25)
    seconds = []
    for _ in range(5):
        start = time.perf_counter()
        simulate_platoon([MERCEDES] * 8, leader)
        seconds.append(time.perf_counter() - start)
    assert min(seconds) < 0.05


def test_a_stop_behind_a_stopped_leader_is_no_collision() -> None:
    """At standstill the law keeps no gap at all; rounding makes that -1e-13 m."""
    run = simulate_platoon([Parameters(0.02, 0.5, 2.0)] * 2, SpeedStep(-20.0, speed=20.0))
    assert run.minimum_gap[-1] == pytest.approx(0.0, abs=1e-9)
    assert run.collisions == ()


def test_amplitudes_say_whether_the_transient_was_over() -> None:
    slow = [CASALE.parameters[0]] * 8
    short, long = (
        simulate_platoon(slow, Sinusoid(0.088, duration=seconds)).amplitudes
        for seconds in (200.0, 900.0)
    )
    assert short is not None
    assert long is not None
    assert (short.free, long.free) == (False, True)
