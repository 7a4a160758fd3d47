"""Simulated platoons: profiles, amplitudes, map of speeds, animation and the paper's panels."""

import json
from typing import Any

import numpy as np
import pytest

from accpinn.model.published import ASTAZERO
from accpinn.platoon import PlatoonRun, simulate_platoon
from accpinn.platoon.leader import Brake, Leader, Recorded, Sinusoid, SpeedStep
from accpinn.results.cast import Cast
from accpinn.results.figures import platoon as figures
from accpinn.results.figures.animation import motion
from accpinn.results.figures.style import FOLLOWERS
from accpinn.stability.criteria import response
from tests.support.driving import MIXED, driven
from tests.support.figures import legend, named

AUDIS = Cast(ASTAZERO, (0,) * 8)
ALL = Cast(ASTAZERO, (0, 1, 2, 3))
EIGHT = Cast(ASTAZERO, (2,) * 8)


@pytest.fixture(scope="module")
def sinusoid() -> PlatoonRun:
    return simulate_platoon(ASTAZERO.parameters[[2] * 8], Sinusoid(0.25))


@pytest.fixture(scope="module")
def collision() -> PlatoonRun:
    run = simulate_platoon(ASTAZERO.parameters[[0] * 8], Sinusoid(0.214))
    assert run.collisions
    return run


def ends(run: PlatoonRun) -> Any:
    """The last instant of each vehicle."""
    return run.trajectories.time[run.meaningful - 1]


def test_profiles_draw_every_speed_and_gap_within_few_points(sinusoid: PlatoonRun) -> None:
    figure = figures.profiles(sinusoid, EIGHT)
    speeds = [trace for trace in figure.data if trace.yaxis == "y"]
    assert len(legend(figure)) == len(speeds) == 9
    largest = dict(zip(EIGHT.labels, sinusoid.trajectories.speeds.max(axis=0), strict=True))
    for trace in speeds:
        assert max(trace.y) == pytest.approx(largest[trace.name], abs=1e-4)
    span = figures.close_up(sinusoid)
    assert span[1] - span[0] == pytest.approx(3 * 2 * np.pi / 0.25)
    for trace in figures.profiles(sinusoid, EIGHT, span).data:
        assert span[0] - 0.01 <= min(trace.x) < max(trace.x) <= span[1] + 0.01


def test_a_collision_ends_lines_with_a_cross(collision: PlatoonRun) -> None:
    figure, last = figures.profiles(collision, AUDIS), ends(collision)
    for trace in figure.data:
        if trace.name in AUDIS.labels:
            drawn = np.asarray(trace.x)[np.isfinite(trace.y)]
            assert drawn.max() == pytest.approx(last[AUDIS.labels.index(trace.name)], abs=1)
    crosses, gaps = (trace for trace in figure.data if trace.name == "ends with a collision")
    hitting = [hit.follower for hit in collision.collisions]
    np.testing.assert_array_equal(crosses.x, last[hitting])
    assert min(gaps.y) == pytest.approx(0, abs=1)
    ended = named(figures.time_space(collision, AUDIS), "ends with a collision")
    assert len(ended.x) == len(hitting) < 4
    assert max(ended.x) <= collision.collisions[-1].time


def test_a_disturbance_after_the_end_leaves_the_last_seconds_to_be_drawn() -> None:
    run = simulate_platoon(ASTAZERO.parameters[:1], SpeedStep(settle=400.0))
    span = figures.close_up(run)
    assert span == (295.0, 300.0)
    assert legend(figures.profiles(run, Cast(ASTAZERO, (0,)), span))


def test_recorded_followers_are_dotted_and_named() -> None:
    segment = driven(MIXED)
    leader = Recorded(segment.start + segment.time, segment.speeds[:, 0])
    run = simulate_platoon(ASTAZERO.parameters[:3], leader)
    figure = figures.profiles(run, Cast(ASTAZERO, (0, 1, 2)), measured=segment)
    for k, label in enumerate(segment.labels[1:]):
        speed, gap = (trace for trace in figure.data if trace.name == f"{label}, measured")
        np.testing.assert_allclose(speed.y, segment.speeds[:, k + 1], rtol=1e-6)
        np.testing.assert_allclose(gap.y, segment.gaps[:, k], rtol=1e-6)
        assert (speed.line.dash, speed.line.color) == ("dot", FOLLOWERS[k])
    assert figures.close_up(run) == (0.0, 60.0)


@pytest.mark.parametrize(("view", "way"), [("observer", 0), ("leader", 0), ("road", 2000)])
def test_positions_and_speeds_over_time_are_those_of_the_run(
    sinusoid: PlatoonRun, view: figures.View, way: float
) -> None:
    figure = figures.time_space(sinusoid, EIGHT, (400.0, 500.0), view)
    line = named(figure, figures.TRACKS)
    count, run = len(EIGHT.labels), sinusoid.trajectories
    time, places, speeds, numbers = (
        np.asarray(values).reshape(count, -1)[:, :-1]
        for values in (line.x, line.y, line.customdata, line.text)
    )
    rows = np.searchsorted(run.time, time[0].astype(float) - 0.05)
    assert [{*found} for found in numbers] == [{number} for number in EIGHT.numbers]
    np.testing.assert_allclose(speeds.T.astype(float), run.speeds[rows], atol=1e-3)
    apart = -np.diff(places.astype(float), axis=0) - figures.CAR_LENGTH
    np.testing.assert_allclose(apart.T, run.gaps[rows], atol=1e-2)
    assert places[0, -1] - places[0, 0] == pytest.approx(way, abs=10)


def test_bars_of_growth_end_at_the_predicted_marks(sinusoid: PlatoonRun) -> None:
    wave = sinusoid.amplitudes
    figure = figures.growth_by_vehicle(sinusoid, EIGHT)
    marks, bars = named(figure, "Predicted by |H(jω)|"), named(figure, "Simulated")
    np.testing.assert_allclose(marks.y, wave.predicted / wave.measured[0])
    growth = wave.measured / wave.measured[0]
    np.testing.assert_allclose(bars.base + bars.y, growth[1:])
    np.testing.assert_allclose(bars.base + bars.y, marks.y[1:], rtol=0.01)
    np.testing.assert_allclose(bars.customdata[:, 0], growth[1:] / growth[:-1])
    assert [*bars.marker.color] == figures.colours_of(EIGHT)[1:]
    assert not any(bars.text), "labels of eight bars would cover each other"
    few = figures.growth_by_vehicle(simulate_platoon(ASTAZERO.parameters, Sinusoid(0.25)), ALL)
    labels = named(few, "Simulated").text
    gains = np.abs(response(ASTAZERO.parameters, np.array([0.25])))[:, 0]
    np.testing.assert_allclose([float(text[:-1]) for text in labels], gains, rtol=0.01)


def test_growth_of_other_disturbances_is_that_of_the_largest_deviations(
    collision: PlatoonRun,
) -> None:
    braking = simulate_platoon(ASTAZERO.parameters, Brake())
    (bars,) = figures.growth_by_vehicle(braking, ALL).data
    moved = braking.largest_deviation
    np.testing.assert_allclose(bars.base + bars.y, (moved / moved[0])[1:])
    figure = figures.growth_by_vehicle(collision, AUDIS)
    ended = named(figure, "Before the collision")
    base = collision.amplitudes.measured[0]
    np.testing.assert_allclose(ended.base + ended.y, collision.largest_deviation[5:] / base)
    np.testing.assert_array_equal(ended.x, [5, 6, 7, 8])
    still = simulate_platoon(ASTAZERO.parameters, SpeedStep(change=0.0))
    assert np.isnan(figures.growth_by_vehicle(still, ALL).data[0].y).all()
    assert figures.speed_map(still, ALL).data[0].zmax > 0, "no division by zero"
    motion(still, ALL)


@pytest.mark.parametrize(("cast", "mode"), [(ALL, "x unified"), (EIGHT, "closest")])
def test_the_pointer_tells_all_of_few_lines_and_the_nearest_of_many(cast: Cast, mode: str) -> None:
    run = simulate_platoon(ASTAZERO.parameters[[*cast.order]], Sinusoid(0.25))
    figure = figures.profiles(run, cast)
    assert figure.layout.hovermode == mode
    hovers = [trace.hovertemplate for trace in figure.data]
    assert all(("%{x" in hover) == (mode == "closest") for hover in hovers)


def test_speed_map_has_a_row_a_vehicle_and_is_even_about_zero(
    sinusoid: PlatoonRun, collision: PlatoonRun
) -> None:
    (stripes,) = figures.speed_map(sinusoid, EIGHT).data
    assert np.shape(stripes.z) == (9, len(stripes.x))
    assert stripes.zmin == -stripes.zmax
    # The leader's wave, from before its start on.
    expected = np.where(stripes.x < 20, 0, np.sin(0.25 * (np.asarray(stripes.x) - 20)))
    np.testing.assert_allclose(stripes.z[0], expected, atol=1e-5)
    (stripes,) = figures.speed_map(collision, AUDIS).data
    drawn = np.isfinite(np.asarray(stripes.z, float))
    assert drawn[:5].all()
    before = np.asarray(stripes.x) <= collision.collisions[0].time
    np.testing.assert_array_equal(drawn[6], before)


@pytest.mark.parametrize(
    "leader",
    [Sinusoid(0.25), Sinusoid(0.05, duration=60.0), SpeedStep(),
     Recorded(np.arange(0, 30, 0.1), 20 + np.sin(np.arange(0, 30, 0.1)))],
)  # fmt: skip
def test_the_animation_moves_the_cars_as_simulated(leader: Leader) -> None:
    run = simulate_platoon(ASTAZERO.parameters, leader)
    shown, driven = motion(run, ALL), run.trajectories
    time, places = np.array(shown["time"]), np.array(shown["places"], float)
    assert 2 <= len(time) <= 500
    at = np.searchsorted(driven.time, time - 0.002)
    np.testing.assert_allclose(-np.diff(places, axis=0).T - figures.CAR_LENGTH, driven.gaps[at],
                               atol=0.02)  # fmt: skip
    np.testing.assert_allclose(np.transpose(shown["speeds"]), driven.speeds[at], atol=1e-3)
    mean = float(driven.speeds[at[0] : at[-1] + 1, 0].mean())
    assert shown["way"][-1] == pytest.approx(mean * (time[-1] - time[0]), rel=0.01)
    json.dumps(shown, allow_nan=False)


def test_animated_vehicles_vanish_with_a_collision_and_are_named(collision: PlatoonRun) -> None:
    shown = motion(collision, AUDIS)
    for end, speeds, places in zip(ends(collision), shown["speeds"], shown["places"], strict=True):
        for now, speed, place in zip(shown["time"], speeds, places, strict=True):
            assert (speed is None) == (place is None) == (now > end + 0.05)
    assert [k for k, speeds in enumerate(shown["speeds"]) if speeds[-1] is None] == [5, 6, 7, 8]
    assert shown["names"] == [*AUDIS.labels]
    assert shown["colours"] == figures.colours_of(AUDIS)
