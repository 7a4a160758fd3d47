"""Simulated platoons: profiles, amplitudes, map of speeds, animation and the paper's panels."""

import json
from itertools import combinations
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.platoon.leader import Brake, Recorded, Sinusoid, SpeedStep
from accpinn.platoon.simulation import PlatoonRun, simulate_platoon
from accpinn.results.figures import platoon as figures
from accpinn.results.figures.style import FOLLOWERS, LEADER
from accpinn.stability.frequency import response
from tests.support.figures import legend, named, rectangles
from tests.support.vehicles import CALM, row

AUDIS = figures.cast_of(ASTAZERO, [0] * 8)
ALL = figures.cast_of(ASTAZERO, [0, 1, 2, 3])
EIGHT = figures.cast_of(ASTAZERO, [2] * 8)


@pytest.fixture(scope="module")
def sinusoid() -> PlatoonRun:
    return simulate_platoon(ASTAZERO.parameters[[2] * 8], Sinusoid(0.25))


@pytest.fixture(scope="module")
def collision() -> PlatoonRun:
    run = simulate_platoon(ASTAZERO.parameters[[0] * 8], Sinusoid(0.214))
    assert run.collisions
    return run


def size(figure: go.Figure) -> int:
    return len(json.dumps(json.loads(figure.to_json())))


class TestCast:
    def test_a_mixed_platoon_has_the_vehicles_colours(self) -> None:
        assert ALL.colours == (LEADER, *FOLLOWERS[:4])
        assert ALL.names == ("Leader", *ASTAZERO.labels)
        assert EIGHT.names[1:3] == ("Follower 1: Mercedes A-Class", "Follower 2: Mercedes A-Class")

    def test_a_repeated_vehicle_has_shades_from_light_to_dark(self) -> None:
        assert all(one != other for one, other in combinations(EIGHT.colours, 2))
        brightness = [sum(int(c[i : i + 2], 16) for i in (1, 3, 5)) for c in EIGHT.colours[1:]]
        assert brightness == sorted(brightness, reverse=True)
        both = figures.cast_of(ASTAZERO, [1, 0, 1])
        assert both.colours[2] == FOLLOWERS[0]
        assert both.colours[1] != both.colours[3]

    def test_a_set_from_a_recording_keeps_its_colours(self) -> None:
        learned = ParameterSet("run", ("<X>",), row(CALM), vehicles=(3, 4))
        cast = figures.cast_of(learned, [0])
        assert cast.colours == (LEADER, FOLLOWERS[2])
        assert cast.names == ("Leader", "&lt;X&gt;")


class TestProfiles:
    def test_draw_every_speed_and_gap_within_few_points(self, sinusoid: PlatoonRun) -> None:
        figure = figures.profiles(sinusoid, EIGHT)
        speeds = [trace for trace in figure.data if trace.yaxis == "y"]
        assert (len(speeds), len(figure.data)) == (9, 17)
        assert speeds[-1].name == "Leader", "on top of the others"
        for trace in speeds:
            k = EIGHT.names.index(trace.name)
            assert len(trace.x) <= 1500
            assert max(trace.y) == pytest.approx(sinusoid.trajectories.speeds[:, k].max(), abs=1e-4)
        assert size(figure) <= 400_000
        assert len(legend(figure)) == 9

    def test_a_collision_is_marked_and_what_follows_shaded(self, collision: PlatoonRun) -> None:
        figure = figures.profiles(collision, AUDIS)
        first = collision.collisions[0].time
        assert [band.x0 for band in rectangles(figure)] == [first] * 2
        for trace in figure.data:
            assert max(trace.x) <= (500.0 if trace.name == "Leader" else first)
        (note,) = figure.layout.annotations
        assert (note.text, note.yanchor) == ("collision", "top"), "a legend stands above the axes"


class TestAmplitudes:
    def test_stand_on_the_predicted_line(self, sinusoid: PlatoonRun) -> None:
        wave = sinusoid.amplitudes
        assert wave is not None
        figure = figures.amplitude_by_vehicle(sinusoid, EIGHT, in_db=False)
        np.testing.assert_allclose(named(figure, "Predicted by |H(jω)|").y, wave.predicted)
        np.testing.assert_allclose(named(figure, "Simulated").y, wave.measured)
        in_db = figures.amplitude_by_vehicle(sinusoid, EIGHT, in_db=True)
        levels = named(in_db, "Predicted by |H(jω)|").y
        np.testing.assert_allclose(levels, 20 * np.log10(wave.predicted), atol=1e-9)
        assert "dB" in in_db.layout.yaxis.title.text

    def test_of_other_disturbances_are_the_largest_deviations(self, collision: PlatoonRun) -> None:
        braking = simulate_platoon(ASTAZERO.parameters, Brake())
        (trace,) = figures.amplitude_by_vehicle(braking, ALL, in_db=False).data
        np.testing.assert_allclose(trace.y, braking.largest_deviation)
        figure = figures.amplitude_by_vehicle(collision, AUDIS, in_db=False)
        measured = named(figure, "Largest deviation before the collision")
        np.testing.assert_allclose(measured.y, collision.largest_deviation)

    def test_of_an_undisturbed_leader_are_no_division_by_zero(self) -> None:
        run = simulate_platoon(ASTAZERO.parameters, SpeedStep(change=0.0))
        figure = figures.amplitude_by_vehicle(run, ALL, in_db=True)
        assert np.isnan(figure.data[0].y).all()
        assert figures.speed_map(run, ALL).data[0].zmax > 0
        figures.animation(run, ALL)


def test_speed_map_has_a_row_a_vehicle_and_is_even_about_zero(
    sinusoid: PlatoonRun, collision: PlatoonRun
) -> None:
    (stripes,) = figures.speed_map(sinusoid, EIGHT).data
    assert np.shape(stripes.z) == (9, len(stripes.x))
    assert stripes.zmin == -stripes.zmax
    assert len(stripes.x) <= figures.COLUMNS
    # The leader's wave, from before its start on.
    expected = np.where(stripes.x < 20, 0, np.sin(0.25 * (np.asarray(stripes.x) - 20)))
    np.testing.assert_allclose(stripes.z[0], expected, atol=1e-5)
    (stripes,) = figures.speed_map(collision, AUDIS).data
    assert max(stripes.x) <= collision.collisions[0].time


class TestAnimation:
    @pytest.mark.parametrize(
        "leader",
        [Sinusoid(0.25), Sinusoid(0.05, duration=60.0), SpeedStep(),
         Recorded(np.arange(0, 30, 0.1), 20 + np.sin(np.arange(0, 30, 0.1)))],
    )  # fmt: skip
    def test_moves_the_cars_as_simulated(self, leader: Any) -> None:
        run = simulate_platoon(ASTAZERO.parameters, leader)
        figure = figures.animation(run, ALL)
        assert 2 <= len(figure.frames) <= 60
        assert len(figure.layout.sliders[0].steps) == len(figure.frames)
        assert len({frame.name for frame in figure.frames}) == len(figure.frames)
        assert size(figure) <= 80_000
        for frame in figure.frames[:: len(figure.frames) // 3]:
            at = int(np.argmin(abs(run.trajectories.time - float(frame.name))))
            gaps = -np.diff(frame.data[0].x) - figures.CAR_LENGTH
            np.testing.assert_allclose(gaps, run.trajectories.gaps[at], atol=0.02)
            np.testing.assert_allclose(frame.data[1].y, run.trajectories.speeds[at], atol=1e-3)

    def test_has_a_legend_and_ends_at_a_collision(self, collision: PlatoonRun) -> None:
        figure = figures.animation(collision, AUDIS)
        assert float(figure.frames[-1].name) <= collision.collisions[0].time + 0.1
        entries = [(trace.name, trace.marker.color) for trace in legend(figure)]
        assert entries == list(zip(AUDIS.names, AUDIS.colours, strict=True))


def test_the_papers_panels_grow_and_fade_as_the_response_predicts() -> None:
    panels = figures.paper_panels()
    assert [panel.title[:3] for panel in panels] == ["(a)", "(c)", "(b)", "(d)"]
    for panel, (k, omega) in zip(panels, figures.PANELS, strict=True):
        last = abs(response(ASTAZERO.parameters[[k]], np.array([omega]))[0, 0]) ** 8
        assert ("grows" in panel.title) == (last > 1)
        assert float(panel.title.split(" to ")[1].split()[0]) == pytest.approx(last, rel=0.01)
        assert size(panel.figure) <= 80_000
    ranges = [panel.figure.layout.yaxis.range for panel in panels]
    assert ranges[0] == ranges[1] != ranges[2] == ranges[3]
