"""Figures and table of string stability and of simulated platoons: what they draw."""

import csv
import io
import json
from itertools import combinations
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from tests.references_stability import TABLE

from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.model.published import (
    ASTAZERO,
    CASALE,
    PUBLISHED,
    VICOLUNGO,
    ParameterSet,
    parameter_set,
)
from accpinn.platoon.leader import Brake, Recorded, Sinusoid, SpeedStep
from accpinn.platoon.simulation import PlatoonRun, simulate_platoon
from accpinn.results.figures import platoon as figures_platoon
from accpinn.results.figures import stability as figures_stability
from accpinn.results.figures import wave
from accpinn.results.figures.style import FOLLOWERS, LEADER, SERIES, with_legend
from accpinn.results.tables.stability import stability_table
from accpinn.stability.frequency import response
from accpinn.stability.report import StabilityReport, stability_report

CALM = Parameters(0.05, 0.6, 1.8)
"""Stable by every criterion."""
STUCK = Parameters(0.0, 0.3, float("nan"))
"""Follows the speed ahead without keeping a gap."""


def traces(figure: go.Figure, name: str) -> list[Any]:
    return [trace for trace in figure.data if trace.name == name]


def named(figure: go.Figure, name: str) -> Any:
    (trace,) = traces(figure, name)
    return trace


@pytest.fixture(scope="module")
def astazero() -> StabilityReport:
    return stability_report(ASTAZERO.parameters)


def small(figure: go.Figure, bytes_at_most: int) -> bool:
    return len(json.dumps(json.loads(figure.to_json()))) <= bytes_at_most


# Published sets


def test_published_sets_are_those_of_the_paper() -> None:
    printed = {reference.name: reference.law for reference in TABLE}
    rows = [law for name, law in printed.items() if "average" not in name]
    shown = [law for laws in (ASTAZERO, VICOLUNGO, CASALE) for law in laws.parameters]
    assert shown == rows
    assert len({laws.title for laws in PUBLISHED}) == len(PUBLISHED)


def test_names_and_parameters_must_match() -> None:
    with pytest.raises(ParameterError, match="2 names and 1 sets"):
        parameter_set("Mine", ("a", "b"), (CALM,))
    with pytest.raises(ParameterError, match="at least one vehicle"):
        parameter_set("Mine", (), ())


# The table


def test_table_has_the_papers_verdicts_and_the_exact_gain_beside(astazero: StabilityReport) -> None:
    table = stability_table(ASTAZERO, astazero)
    heads = [f"{column.group} {column.title}".strip() for column in table.columns]
    tesla = dict(zip(heads, table.rows[3], strict=True))
    assert tesla["Vehicle"] == "Tesla Model 3"
    assert tesla["L2: no frequency grows Stable"] == "NO"
    assert tesla["L∞: no peak grows Paper's criterion"] == "YES"
    assert tesla["L∞: no peak grows Exact"] == "NO"
    assert tesla["L∞: no peak grows ‖h‖₁"] == pytest.approx(1.0954, abs=5e-5)
    assert tesla["L2: no frequency grows Peak"] == pytest.approx(0.3395, abs=5e-5)
    assert tesla["Stable from τ L2"] == pytest.approx(2.0534, abs=5e-5)


def test_table_leaves_out_what_has_no_meaning() -> None:
    laws = parameter_set("Mine", ("calm", "stuck"), (CALM, STUCK))
    table = stability_table(laws, stability_report(laws.parameters))
    rows = list(csv.reader(io.StringIO(table.to_csv())))
    at = {name: index for index, name in enumerate(rows[0])}
    calm, stuck = rows[1:]
    assert calm[at["L2: no frequency grows: Amplified below [rad/s]"]] == ""
    assert calm[at["L2: no frequency grows: at ω [rad/s]"]] == ""
    assert calm[at["L2: no frequency grows: Stable"]] == "YES"
    assert stuck[at["τ [s]"]] == ""
    assert stuck[at["Stable from τ: L2 [s]"]] == ""
    assert stuck[at["L2: no frequency grows: Stable"]] == "YES, marginal"


def test_latex_table_knows_its_letters(astazero: StabilityReport) -> None:
    text = stability_table(ASTAZERO, astazero).to_latex()
    assert text.isascii()
    assert r"at $\omega$ [rad/s]" in text


# The response over frequency


def test_curves_are_the_response_in_db(astazero: StabilityReport) -> None:
    figure = figures_stability.bode(ASTAZERO, astazero)
    curve = named(figure, "Audi A6")
    expected = 20 * np.log10(np.abs(response(ASTAZERO.parameters[:1], np.asarray(curve.x))[0]))
    np.testing.assert_allclose(curve.y, expected, atol=1e-9)
    whole = named(figure, "Leader to last follower")
    parts = sum(np.asarray(named(figure, label).y) for label in ASTAZERO.labels)
    np.testing.assert_allclose(whole.y, parts, atol=1e-9)
    assert whole.line.dash == "dash"


def test_peaks_and_crossovers_are_marked_where_the_curves_have_them(
    astazero: StabilityReport,
) -> None:
    figure = figures_stability.bode(ASTAZERO, astazero)
    for name, x, y in (
        ("peak", [v.peak.omega for v in astazero.vehicles], [v.peak.db for v in astazero.vehicles]),
        ("crossover", [v.crossover for v in astazero.vehicles], [0.0] * 4),
    ):
        marks = named(figure, name)
        assert list(marks.x) == x
        assert list(marks.y) == y
        assert list(marks.marker.color) == list(figures_stability.colours(ASTAZERO))
        curves = [np.interp(at, named(figure, label).x, named(figure, label).y)
                  for at, label in zip(x, ASTAZERO.labels, strict=True)]  # fmt: skip
        np.testing.assert_allclose(curves, y, atol=0.02)


def test_every_point_says_whose_it_is(astazero: StabilityReport) -> None:
    figure = figures_stability.bode(ASTAZERO, astazero)
    for k, label in enumerate(ASTAZERO.labels):
        assert set(named(figure, label).customdata) == {k}
        assert "markers" in named(figure, label).mode, "lines alone cannot be clicked"
    assert set(named(figure, "Leader to last follower").customdata) == {-1}
    assert list(named(figure, "peak").customdata) == [0, 1, 2, 3]
    assert figure.layout.clickmode == "event+select"


def test_amplified_band_is_shaded_from_0_db_up(astazero: StabilityReport) -> None:
    figure = figures_stability.bode(ASTAZERO, astazero)
    band = next(shape for shape in figure.layout.shapes if shape.type == "rect")
    assert (band.y0, band.y1) == (0, figure.layout.yaxis.range[1])
    assert figure.layout.yaxis.range[1] > astazero.platoon.peaks[-1].db
    assert figure.layout.xaxis.type == "log"
    assert "rad/s" in figure.layout.xaxis.title.text


def test_stable_and_single_vehicles_are_drawn_without_marks() -> None:
    laws = parameter_set("Mine", ("calm",), (CALM,))
    figure = figures_stability.bode(laws, stability_report(laws.parameters))
    assert traces(figure, "Leader to last follower") == []
    assert len(named(figure, "peak").x) == 0
    assert max(named(figure, "calm").y) < 0


@pytest.mark.parametrize(
    "law", [Parameters(0.04, 0.0, 0.0), Parameters(0.0, 0.0, 1.0), Parameters(1e-4, 0.01, 0.1)]
)
def test_extreme_vehicles_stay_in_sight(law: Parameters) -> None:
    laws = parameter_set("Mine", ("odd", "calm"), (law, CALM))
    found = stability_report(laws.parameters)
    figure = figures_stability.bode(laws, found)
    assert np.isfinite(figure.layout.yaxis.range).all()
    assert figure.layout.yaxis.range[1] <= figures_stability.CEILING
    for trace in figure.data[:2]:
        assert np.isfinite(trace.y).all()
    figures_stability.criteria_by_vehicle(laws, found)
    for plane in ("beta", "alpha"):
        axis = figures_stability.stability_map(laws, found, 0, plane).layout.yaxis.range
        assert np.isfinite(axis).all()


def test_names_are_shown_as_they_are() -> None:
    laws = parameter_set("Mine", ("<b>bold</b>",), (CALM,))
    found = stability_report(laws.parameters)
    for figure in (
        figures_stability.bode(laws, found),
        figures_stability.stability_map(laws, found, 0, "beta"),
    ):
        assert "<b>" not in figure.to_json()
    assert "<b>" not in figures_platoon.cast_of(laws, [0]).names[1]


# Criteria over the platoon


def test_criteria_by_vehicle_has_each_vehicles_criteria_and_gains(
    astazero: StabilityReport,
) -> None:
    figure = figures_stability.criteria_by_vehicle(ASTAZERO, astazero)
    expected = {
        "L2 criterion": [v.l2_criterion for v in astazero.vehicles],
        "L∞ criterion of the paper": [v.paper_criterion for v in astazero.vehicles],
        "Peak of |H|": [v.peak.gain for v in astazero.vehicles],
        "Exact L∞ gain ‖h‖₁": [v.linf_gain for v in astazero.vehicles],
        "|H| from the leader": [peak.gain for peak in astazero.platoon.peaks],
        "‖h‖₁ from the leader": list(astazero.platoon.linf.gain),
    }
    assert {trace.name: list(trace.y) for trace in figure.data} == expected
    assert all(list(trace.x) == [1, 2, 3, 4] for trace in figure.data)
    # The paper's valley: both criteria are lowest at the second vehicle.
    for name in ("L2 criterion", "L∞ criterion of the paper"):
        assert int(np.argmin(expected[name])) == 1
    levels = [shape.y0 for shape in figure.layout.shapes]
    assert levels == [0, 1], "one line a panel between stable and not"


def test_criteria_have_colours_of_no_vehicle() -> None:
    keys = (*figures_stability.CRITERIA_KEY, *figures_stability.MAP_KEY)
    assert {colour for _, colour in keys}.isdisjoint(FOLLOWERS)
    assert figures_stability.L2 in SERIES, "whose contrast and likeness to vehicles are tested"


# The map


@pytest.mark.parametrize("plane", ["beta", "alpha"])
@pytest.mark.parametrize("held", range(4))
def test_boundaries_separate_stable_from_unstable(
    astazero: StabilityReport, plane: figures_stability.Plane, held: int
) -> None:
    figure = figures_stability.stability_map(ASTAZERO, astazero, held, plane)
    law = ASTAZERO.parameters[held]
    checks = {
        "L2": lambda vehicle: vehicle.l2.stable,
        "L∞, exact": lambda vehicle: vehicle.linf_exact.stable,
        "L∞, paper": lambda vehicle: vehicle.linf_paper.stable,
    }
    for name, stable in checks.items():
        line = named(figure, name)
        for x, tau in list(zip(line.x, line.y, strict=True))[20::60]:
            if tau <= 0:
                continue
            alpha, beta = (law.alpha, x) if plane == "beta" else (x, law.beta)
            below, above = stability_report(
                [Parameters(alpha, beta, tau * 0.999), Parameters(alpha, beta, tau * 1.001)]
            ).vehicles
            assert not stable(below)
            assert stable(above)


def test_map_shows_every_vehicle_and_fills_the_one_it_is_about(astazero: StabilityReport) -> None:
    figure = figures_stability.stability_map(ASTAZERO, astazero, 1, "beta")
    dots = figure.data[-1]
    assert list(dots.x) == [law.beta for law in ASTAZERO.parameters]
    assert list(dots.y) == [law.tau for law in ASTAZERO.parameters]
    assert list(dots.marker.symbol) == ["circle-open", "circle", "circle-open", "circle-open"]
    (left, right), (low, high) = figure.layout.xaxis.range, figure.layout.yaxis.range
    assert left <= min(dots.x) <= max(dots.x) <= right
    assert low <= min(dots.y) <= max(dots.y) <= high
    assert high > astazero.vehicles[1].smallest_tau.linf_exact


# Platoons


@pytest.fixture(scope="module")
def sinusoid() -> PlatoonRun:
    return simulate_platoon([ASTAZERO.parameters[2]] * 8, Sinusoid(0.25))


@pytest.fixture(scope="module")
def mixed() -> PlatoonRun:
    return simulate_platoon(ASTAZERO.parameters, Brake())


def test_a_mixed_platoon_has_the_vehicles_colours_and_a_repeated_one_shades() -> None:
    mixed = figures_platoon.cast_of(ASTAZERO, [0, 1, 2, 3])
    assert mixed.colours == (LEADER, *FOLLOWERS[:4])
    assert mixed.names == (
        "Leader", "Follower 1: Audi A6", "Follower 2: BMW X5", "Follower 3: Mercedes A-Class",
        "Follower 4: Tesla Model 3",
    )  # fmt: skip
    repeated = figures_platoon.cast_of(ASTAZERO, [2] * 8)
    assert len(set(repeated.colours)) == 9
    assert all(one != other for one, other in combinations(repeated.colours, 2))
    brightness = [sum(int(c[i : i + 2], 16) for i in (1, 3, 5)) for c in repeated.colours[1:]]
    assert brightness == sorted(brightness, reverse=True)
    both = figures_platoon.cast_of(ASTAZERO, [1, 0, 1])
    assert both.colours[2] == FOLLOWERS[0]
    assert both.colours[1] != both.colours[3]


def test_a_set_from_a_recording_keeps_its_colours() -> None:
    laws = ParameterSet("run", ("4 X",), (CALM,), (4,), leader=3)
    cast = figures_platoon.cast_of(laws, [0])
    assert cast.colours == (LEADER, FOLLOWERS[2])
    assert cast.names == ("Leader", "Follower 1: X"), "one number, that of its place"


def test_a_recordings_followers_go_by_its_numbers() -> None:
    ours = ParameterSet("run", ("4 X", "5 Y"), (CALM, CALM), (4, 5), leader=3)
    axis = figures_stability.criteria_by_vehicle(
        ours, stability_report(ours.parameters)
    ).layout.xaxis2
    assert (axis.title.text, axis.ticktext) == ("Vehicle", ("4", "5"))
    theirs = figures_stability.criteria_by_vehicle(ASTAZERO, stability_report(ASTAZERO.parameters))
    assert theirs.layout.xaxis2.title.text == "Follower"
    assert theirs.layout.xaxis2.ticktext == ("1", "2", "3", "4")
    assert ours.spoken == ("vehicle 4 X", "vehicle 5 Y")
    assert ASTAZERO.spoken == ASTAZERO.names == ASTAZERO.labels


def test_profiles_draw_every_speed_and_gap_within_few_points(sinusoid: PlatoonRun) -> None:
    cast = figures_platoon.cast_of(ASTAZERO, [2] * 8)
    figure = figures_platoon.profiles(sinusoid, cast)
    speeds = [trace for trace in figure.data if trace.yaxis == "y"]
    gaps = [trace for trace in figure.data if trace.yaxis == "y2"]
    assert len(speeds) == 9
    assert len(gaps) == 8
    assert speeds[-1].name == "Leader", "on top of the others"
    for trace in speeds:
        k = cast.names.index(trace.name)
        assert len(trace.x) <= 1500
        assert max(trace.y) == pytest.approx(sinusoid.trajectories.speeds[:, k].max(), abs=1e-4)
    assert small(figure, 400_000)


def test_a_collision_is_marked_and_what_follows_shaded() -> None:
    run = simulate_platoon([ASTAZERO.parameters[0]] * 8, Sinusoid(0.214))
    assert run.collisions
    figure = figures_platoon.profiles(run, figures_platoon.cast_of(ASTAZERO, [0] * 8))
    bands = [shape for shape in figure.layout.shapes if shape.type == "rect"]
    first = run.collisions[0].time
    assert [band.x0 for band in bands] == [first] * 2
    for trace in figure.data:
        assert max(trace.x) <= (500.0 if trace.name == "Leader" else first)
    (note,) = figure.layout.annotations
    assert (note.text, note.yanchor) == ("collision", "top"), "a legend stands above the axes"


def test_amplitudes_stand_on_the_predicted_line(sinusoid: PlatoonRun) -> None:
    cast = figures_platoon.cast_of(ASTAZERO, [2] * 8)
    figure = figures_platoon.amplitude_by_vehicle(sinusoid, cast, in_db=False)
    gain = abs(response([ASTAZERO.parameters[2]], np.array([0.25]))[0, 0])
    predicted = named(figure, "Predicted by |H(jω)|")
    np.testing.assert_allclose(predicted.y, gain ** np.arange(9), rtol=1e-9)
    np.testing.assert_allclose(named(figure, "Simulated").y, predicted.y, rtol=0.01)
    in_db = figures_platoon.amplitude_by_vehicle(sinusoid, cast, in_db=True)
    steps = np.diff(named(in_db, "Predicted by |H(jω)|").y)
    np.testing.assert_allclose(steps, 20 * np.log10(gain), rtol=1e-9)
    assert "dB" in in_db.layout.yaxis.title.text


def test_other_disturbances_show_their_largest_deviation(mixed: PlatoonRun) -> None:
    figure = figures_platoon.amplitude_by_vehicle(
        mixed, figures_platoon.cast_of(ASTAZERO, [0, 1, 2, 3]), in_db=False
    )
    (trace,) = figure.data
    np.testing.assert_allclose(trace.y, mixed.largest_deviation)


def test_nothing_is_drawn_of_what_comes_after_a_collision() -> None:
    run = simulate_platoon([ASTAZERO.parameters[0]] * 8, Sinusoid(0.214))
    cast = figures_platoon.cast_of(ASTAZERO, [0] * 8)
    (stripes,) = figures_platoon.speed_map(run, cast).data
    assert max(stripes.x) <= run.collisions[0].time
    chart = figures_platoon.amplitude_by_vehicle(run, cast, in_db=False)
    measured = named(chart, "Largest deviation before the collision")
    np.testing.assert_allclose(measured.y, run.largest_deviation)


def test_a_leader_that_does_nothing_is_no_division_by_zero() -> None:
    run = simulate_platoon(ASTAZERO.parameters, SpeedStep(change=0.0))
    cast = figures_platoon.cast_of(ASTAZERO, [0, 1, 2, 3])
    figure = figures_platoon.amplitude_by_vehicle(run, cast, in_db=True)
    assert np.isnan(figure.data[0].y).all()
    assert figures_platoon.speed_map(run, cast).data[0].zmax > 0
    wave.animation(run, cast)


def test_speed_map_has_a_row_a_vehicle_and_is_even_about_zero(sinusoid: PlatoonRun) -> None:
    cast = figures_platoon.cast_of(ASTAZERO, [2] * 8)
    (stripes,) = figures_platoon.speed_map(sinusoid, cast).data
    assert np.shape(stripes.z) == (9, len(stripes.x))
    assert stripes.zmin == -stripes.zmax
    assert len(stripes.x) <= figures_platoon.COLUMNS
    # The leader's wave, from before its start on.
    expected = np.where(stripes.x < 20, 0, np.sin(0.25 * (np.asarray(stripes.x) - 20)))
    np.testing.assert_allclose(stripes.z[0], expected, atol=1e-5)


@pytest.mark.parametrize(
    "leader",
    [
        Sinusoid(0.25),
        Sinusoid(0.05, duration=60.0),
        SpeedStep(),
        Brake(),
        Recorded(np.arange(0, 30, 0.1), 20 + np.sin(np.arange(0, 30, 0.1))),
    ],
    ids=lambda leader: type(leader).__name__,
)
def test_animation_moves_the_cars_as_simulated(leader: Any) -> None:
    run = simulate_platoon(ASTAZERO.parameters, leader)
    figure = wave.animation(run, figures_platoon.cast_of(ASTAZERO, [0, 1, 2, 3]))
    assert 2 <= len(figure.frames) <= 60
    assert len(figure.layout.sliders[0].steps) == len(figure.frames)
    names = [frame.name for frame in figure.frames]
    assert len(set(names)) == len(names)
    assert small(figure, 80_000)
    for frame in figure.frames[:: len(figure.frames) // 3]:
        row = int(np.argmin(abs(run.trajectories.time - float(frame.name))))
        gaps = -np.diff(frame.data[0].x) - wave.CAR_LENGTH
        np.testing.assert_allclose(gaps, run.trajectories.gaps[row], atol=0.02)
        np.testing.assert_allclose(frame.data[1].y, run.trajectories.speeds[row], atol=1e-3)


def test_the_animations_legend_names_every_vehicle() -> None:
    cast = figures_platoon.cast_of(ASTAZERO, [0, 1, 2, 3])
    figure = with_legend(wave.animation(simulate_platoon(ASTAZERO.parameters, Brake()), cast))
    entries = [trace for trace in figure.data if trace.showlegend is not False]
    assert tuple(trace.name for trace in entries) == cast.names
    assert tuple(trace.marker.color for trace in entries) == cast.colours


def test_animation_ends_at_a_collision() -> None:
    run = simulate_platoon([ASTAZERO.parameters[0]] * 8, Sinusoid(0.214))
    figure = wave.animation(run, figures_platoon.cast_of(ASTAZERO, [0] * 8))
    assert float(figure.frames[-1].name) <= run.collisions[0].time + 0.1


def test_the_papers_panels_grow_and_fade_as_the_response_says() -> None:
    panels = figures_platoon.paper_panels()
    assert [panel.title[:3] for panel in panels] == ["(a)", "(c)", "(b)", "(d)"]
    for panel, (k, omega) in zip(panels, figures_platoon.PANELS, strict=True):
        last = abs(response([ASTAZERO.parameters[k]], np.array([omega]))[0, 0]) ** 8
        assert ("grows" in panel.title) == (last > 1)
        assert float(panel.title.split(" to ")[1].split()[0]) == pytest.approx(last, rel=0.01)
        assert len(panel.figure.data) == 9
        settled = next(t for t in panel.figure.data if t.name.startswith("Follower 8:"))
        late = np.asarray(settled.y)[np.asarray(settled.x) > 400]
        assert np.ptp(late) / 2 == pytest.approx(last, rel=0.03)
        assert small(panel.figure, 80_000)
    ranges = [panel.figure.layout.yaxis.range for panel in panels]
    assert ranges[0] == ranges[1] != ranges[2] == ranges[3]


def test_the_lowest_tick_of_the_response_keeps_clear_of_the_frequencies() -> None:
    figure = figures_stability.bode(ASTAZERO, stability_report(ASTAZERO.parameters))
    assert figure.layout.yaxis.range[0] < figures_stability.FLOOR
