"""Simulated platoons: profiles, amplitudes, map of speeds, animation and the paper's panels."""

import json
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.platoon.leader import Brake, Recorded, Sinusoid, SpeedStep
from accpinn.platoon.simulation import PlatoonRun, simulate_platoon
from accpinn.results.figures import platoon as figures
from accpinn.results.figures.animation import animation
from accpinn.results.figures.platoon import PANELS, paper_panels
from accpinn.results.figures.style import FOLLOWERS, LEADER
from accpinn.stability.criteria import response
from tests.support.driving import MIXED, driven
from tests.support.figures import legend, named
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
        assert ALL.labels == ("Leader", *ASTAZERO.labels)
        assert EIGHT.labels[1:3] == ("Follower 1: Mercedes A-Class", "Follower 2: Mercedes A-Class")

        brightness = [sum(int(c[i : i + 2], 16) for i in (1, 3, 5)) for c in EIGHT.colours[1:]]
        assert brightness == sorted({*brightness}, reverse=True), "shades from light to dark"
        both = figures.cast_of(ASTAZERO, [1, 0, 1])
        assert both.colours[2] == FOLLOWERS[0]
        assert both.colours[1] != both.colours[3]

    def test_a_set_from_a_recording_keeps_its_colours(self) -> None:
        learned = ParameterSet("run", ("<X>",), row(CALM), vehicles=(3, 4))
        cast = figures.cast_of(learned, [0])
        assert cast.colours == (LEADER, FOLLOWERS[2])
        assert cast.labels == ("Leader", "<X>")
        recorded = ParameterSet("run", ("X", "Y"), row(CALM, CALM), (3, 4, 5), ("4 X", "5 Y"))
        assert figures.cast_of(recorded, [0, 1]).numbers == ("L", "4", "5")
        assert figures.cast_of(recorded, [1, 0]).numbers == ("0", "1", "2")


class TestProfiles:
    def test_draw_every_speed_and_gap_within_few_points(self, sinusoid: PlatoonRun) -> None:
        figure = figures.profiles(sinusoid, EIGHT)
        speeds = [trace for trace in figure.data if trace.yaxis == "y"]
        assert (len(speeds), len(figure.data)) == (9, 17)
        assert speeds[-1].name == "Leader", "on top of the others"
        for trace in speeds:
            k = EIGHT.labels.index(trace.name)
            assert len(trace.x) <= 1500
            assert max(trace.y) == pytest.approx(sinusoid.trajectories.speeds[:, k].max(), abs=1e-4)
        assert size(figure) <= 400_000
        assert len(legend(figure)) == 9

    def test_a_collision_ends_lines_with_a_cross(self, collision: PlatoonRun) -> None:
        figure = figures.profiles(collision, AUDIS)
        ends = collision.trajectories.time[collision.meaningful - 1]
        for trace in figure.data:
            if trace.name in AUDIS.labels:
                drawn = np.asarray(trace.x)[np.isfinite(trace.y)]
                assert drawn.max() == pytest.approx(ends[AUDIS.labels.index(trace.name)], abs=1)
        crosses, gaps = (trace for trace in figure.data if trace.name == "ends with a collision")
        np.testing.assert_array_equal(crosses.x, ends[5:])
        assert min(gaps.y) == pytest.approx(0, abs=1)
        (note,) = figure.layout.annotations
        assert (note.text, note.yanchor) == ("collision", "top"), "a legend stands above the axes"

    def test_a_close_up_draws_the_last_periods_alone(self, sinusoid: PlatoonRun) -> None:
        span = figures.close_up(sinusoid)
        assert span[1] - span[0] == pytest.approx(3 * 2 * np.pi / 0.25)
        for trace in figures.profiles(sinusoid, EIGHT, span).data:
            assert span[0] - 0.01 <= min(trace.x) < max(trace.x) <= span[1] + 0.01

    def test_recorded_followers_are_dotted_and_named(self) -> None:
        segment = driven(MIXED)
        leader = Recorded(segment.start + segment.time, segment.speeds[:, 0])
        run = simulate_platoon(ASTAZERO.parameters[:3], leader)
        cast = figures.cast_of(ASTAZERO, [0, 1, 2])
        figure = figures.profiles(run, cast, measured=segment)
        for k, label in enumerate(segment.labels[1:]):
            speed, gap = (trace for trace in figure.data if trace.name == f"{label}, measured")
            np.testing.assert_allclose(speed.y, segment.speeds[:, k + 1], rtol=1e-6)
            np.testing.assert_allclose(gap.y, segment.gaps[:, k], rtol=1e-6)
            assert speed.line.dash == "dot"
            assert speed.line.color == FOLLOWERS[k]
        assert figures.close_up(run) == (0.0, 60.0)


class TestTimeSpace:
    @pytest.mark.parametrize(("view", "way"), [("observer", 0), ("leader", 0), ("road", 2000)])
    def test_positions_and_speeds_are_those_of_the_run(
        self, sinusoid: PlatoonRun, view: figures.View, way: float
    ) -> None:
        figure = figures.time_space(sinusoid, EIGHT, (400.0, 500.0), view)
        line = named(figure, figures.TRACKS)
        count, run = len(EIGHT.labels), sinusoid.trajectories
        time, places, speeds, numbers = (
            np.asarray(values).reshape(count, -1)[:, :-1]
            for values in (line.x, line.y, line.customdata, line.text)
        )
        rows = np.searchsorted(run.time, time[0].astype(float) - 0.05)
        for k, number in enumerate(EIGHT.numbers):
            assert set(numbers[k]) == {number}
            np.testing.assert_allclose(speeds[k], run.speeds[rows, k], atol=1e-3)
            if k:
                apart = places[k - 1] - places[k] - figures.CAR_LENGTH
                np.testing.assert_allclose(apart, run.gaps[rows, k - 1], atol=1e-2)
        assert places[0, -1] - places[0, 0] == pytest.approx(way, abs=10)
        (labels,) = (trace for trace in figure.data if trace.mode == "text")
        assert [text.strip() for text in labels.text] == list("012345678")
        coloured = [trace for trace in figure.data if trace.line.width == 3]
        drawn = np.concatenate([trace.y for trace in coloured])
        assert np.isfinite(drawn).sum() >= count * (len(rows) - 1)
        low, high = (np.nanmax(np.abs(run.speeds[:, :1] - 20)), np.nanmax(np.abs(run.speeds - 20)))
        assert low < high, "the last vehicle swings most, and has the strongest colours"
        strongest = {*np.flatnonzero([len(trace.y) > 0 for trace in coloured])}
        assert {0, len(coloured) - 1} <= strongest
        assert size(figure) <= 120_000

    def test_tracks_end_with_a_collision(self, collision: PlatoonRun) -> None:
        figure = figures.time_space(collision, AUDIS)
        ended = named(figure, "ends with a collision")
        assert len(ended.x) == 4
        assert max(ended.x) <= collision.contacts[-1].time


class TestAmplitudes:
    def test_stand_on_the_predicted_line(self, sinusoid: PlatoonRun) -> None:
        wave = sinusoid.amplitudes
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
        drives, ended = "Simulated", "Largest deviation before the collision"
        np.testing.assert_allclose(named(figure, drives).y, collision.amplitudes.measured[:5])
        np.testing.assert_allclose(named(figure, ended).y, collision.largest_deviation[5:])
        np.testing.assert_array_equal(named(figure, ended).x, [5, 6, 7, 8])

        still = simulate_platoon(ASTAZERO.parameters, SpeedStep(change=0.0))
        assert np.isnan(figures.amplitude_by_vehicle(still, ALL, in_db=True).data[0].y).all()
        assert figures.speed_map(still, ALL).data[0].zmax > 0, "no division by zero"
        animation(still, ALL)


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
    first = collision.contacts[0].time
    drawn = np.isfinite(np.asarray(stripes.z, float))
    assert drawn[:5].all()
    np.testing.assert_array_equal(drawn[6], np.asarray(stripes.x) <= first)


class TestAnimation:
    @pytest.mark.parametrize(
        "leader",
        [Sinusoid(0.25), Sinusoid(0.05, duration=60.0), SpeedStep(),
         Recorded(np.arange(0, 30, 0.1), 20 + np.sin(np.arange(0, 30, 0.1)))],
    )  # fmt: skip
    def test_moves_the_cars_as_simulated(self, leader: Any) -> None:
        run = simulate_platoon(ASTAZERO.parameters, leader)
        figure = animation(run, ALL)
        assert 2 <= len(figure.frames) <= 60
        assert len(figure.layout.sliders[0].steps) == len(figure.frames)
        assert len({frame.name for frame in figure.frames}) == len(figure.frames)
        assert size(figure) <= 80_000
        for frame in figure.frames[:: len(figure.frames) // 3]:
            at = int(np.argmin(abs(run.trajectories.time - float(frame.name))))
            gaps = -np.diff(frame.data[0].x) - figures.CAR_LENGTH
            np.testing.assert_allclose(gaps, run.trajectories.gaps[at], atol=0.02)
            np.testing.assert_allclose(frame.data[1].y, run.trajectories.speeds[at], atol=1e-3)

    def test_has_a_legend_and_vehicles_vanish_with_a_collision(self, collision: PlatoonRun) -> None:
        figure = animation(collision, AUDIS)
        for frame in figure.frames:
            speeds = frame.data[1].y
            gone = [k for k, speed in enumerate(speeds) if speed is None]
            now = float(frame.name)
            ends = collision.trajectories.time[collision.meaningful - 1]
            assert gone == [k for k, end in enumerate(ends) if now > end + 0.05]
        assert gone == [5, 6, 7, 8]
        entries = [(trace.name, trace.marker.color) for trace in legend(figure)]
        assert entries == list(zip(AUDIS.labels, AUDIS.colours, strict=True))


def test_the_papers_panels_grow_and_fade_as_the_response_predicts() -> None:
    panels = paper_panels()
    assert [title[:3] for title, _ in panels] == ["(a)", "(c)", "(b)", "(d)"]
    for (title, figure), (k, omega) in zip(panels, PANELS, strict=True):
        last = abs(response(ASTAZERO.parameters[[k]], np.array([omega]))[0, 0]) ** 8
        assert ("grows" in title) == (last > 1)
        assert float(title.split(" to ")[1].split()[0]) == pytest.approx(last, rel=0.01)
        assert size(figure) <= 80_000
    ranges = [figure.layout.yaxis.range for _, figure in panels]
    assert ranges[0] == ranges[1] != ranges[2] == ranges[3]
