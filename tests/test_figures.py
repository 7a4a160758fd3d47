"""Figures, as the JSON that the browser gets: what is drawn, in which colour, with which labels."""

import json
import re
import tomllib
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
from hypothesis import given
from hypothesis import strategies as st

from accpinn.methods.fit import History, ParameterTrack
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.published import CASALE
from accpinn.platoon.leader import Sinusoid
from accpinn.platoon.simulation import simulate_platoon
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording
from accpinn.results.figures import comparison as comparison_figures
from accpinn.results.figures import recording as recording_figures
from accpinn.results.figures import style, training
from accpinn.results.figures.platoon import cast_of, profiles
from accpinn.results.figures.stability import bode, stability_map
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment, Window
from accpinn.stability.report import stability_report as stability_report
from tests.support.openacc_files import csv, metadata, platoon

ROOT = Path(__file__).parent.parent


def recording(names: str = "ABC", frame: pd.DataFrame | None = None) -> Recording:
    return read(csv(platoon() if frame is None else frame, metadata(tuple(names))), "run.csv")


@pytest.fixture
def segment() -> Segment:
    return cut(recording(), 0.0, 30.0)


def history(*, sets: int = 2, moments: int = 40) -> History:
    """From 1 to the settled values 0.1, 0.2 and 1.2, by half each time."""
    steps = np.arange(moments, dtype=float)
    fading = 0.5**steps
    settled = np.array([0.1, 0.2, 1.2])
    table = settled + fading[:, None] * (1 - settled)
    tables = np.repeat(table[:, None, :], sets, axis=1)
    zeros = np.zeros(moments)
    return History(steps, steps, fading + 0.01, fading, fading * 0 + 0.01, zeros, tables)


def as_json(figure: Any) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads(figure.to_json())
    return loaded


# Colours


def test_every_vehicle_has_one_colour_and_the_leader_its_own() -> None:
    colours = [style.vehicle_colour(number, 1) for number in range(1, 12)]
    assert colours[0] == style.LEADER
    assert len(set(colours)) == 11
    assert style.vehicle_colour(3, 3) == style.LEADER
    assert style.vehicle_colour(4, 3) == style.vehicle_colour(4, 1)


@pytest.mark.parametrize("colour", [style.LEADER, *style.FOLLOWERS, *style.SERIES, style.MODEL])
def test_colours_are_seen_on_both_themes(colour: str) -> None:
    config = tomllib.loads((ROOT / ".streamlit" / "config.toml").read_text(encoding="utf-8"))
    for side in ("light", "dark"):
        assert contrast(colour, config["theme"][side]["backgroundColor"]) >= 3


def test_streamlit_s_own_charts_have_the_same_colours() -> None:
    config = tomllib.loads((ROOT / ".streamlit" / "config.toml").read_text(encoding="utf-8"))
    for side in ("light", "dark"):
        ours = [style.LEADER, *style.FOLLOWERS]
        assert config["theme"][side]["chartCategoricalColors"] == ours


@pytest.mark.parametrize("vision", ["normal", "red-blind", "green-blind"])
def test_a_platoon_of_six_can_be_told_apart(vision: str) -> None:
    colours = [lab(colour, vision) for colour in (style.LEADER, *style.FOLLOWERS[:5])]
    least = min(float(np.linalg.norm(one - two)) for one, two in combinations(colours, 2))
    assert least > 11, "a difference of 2.3 is just seen side by side"


def test_lines_of_no_vehicle_look_like_none() -> None:
    vehicles = [style.LEADER, *style.FOLLOWERS, style.MODEL]
    for colour in style.SERIES:
        apart = [np.linalg.norm(lab(colour, "normal") - lab(one, "normal")) for one in vehicles]
        assert min(apart) > 20
    assert {trace.line.color for trace in training.loss_history(history()).data} <= {
        style.LEADER,
        *style.SERIES,
    }


@pytest.mark.parametrize(
    "ends",
    [
        (0.0588, 0.0972),
        (0.0, 0.2),
        (-0.002, 0.031),
        (1.149, 1.181),
        (1.15, 1.23),
        (0.78, 1.47),
        (0.0, 10.0),
        (0.9999, 1.0001),
    ],
)
def test_short_axes_have_two_or_three_round_ticks(ends: tuple[float, float]) -> None:
    found = style.ticks(ends)
    values, shown = found["tickvals"], found["ticktext"]
    assert 2 <= len(values) <= 3
    assert ends[0] <= min(values) < max(values) <= ends[1]
    np.testing.assert_allclose([float(text) for text in shown], values, atol=1e-12)


# Thinning


def test_thinning_leaves_short_series_alone() -> None:
    time, values = np.arange(100.0), np.arange(100.0)
    assert style.thinned(time, values)[1] is values


def test_thinning_keeps_a_single_peak_and_a_single_hole() -> None:
    time, values = np.arange(50_000.0), np.zeros(50_000)
    values[31_234], values[12_345] = 9.0, np.nan
    x, y = style.thinned(time, values, 1000)
    assert len(x) <= 1502
    assert y[x == 31_234] == 9.0
    assert np.isnan(y[x == 12_345])
    assert x[0] == 0
    assert x[-1] == 49_999


@given(
    st.lists(st.one_of(st.floats(-50, 50), st.just(float("nan"))), min_size=1, max_size=400),
    st.integers(4, 60),
)
def test_thinning_keeps_extremes_order_and_holes(values: list[float], points: int) -> None:
    time, series = np.arange(float(len(values))), np.array(values)
    x, y = style.thinned(time, series, points)
    assert (np.diff(x) > 0).all()
    np.testing.assert_array_equal(y, series[x.astype(int)])
    assert np.isnan(y).any() == np.isnan(series).any()
    if np.isfinite(series).any():
        assert np.nanmax(y) == np.nanmax(series)
        assert np.nanmin(y) == np.nanmin(series)
    assert len(x) <= max(points, len(values) if len(values) <= points else 1.5 * points + 2)


# Overview


def test_overview_draws_all_vehicles_and_the_window() -> None:
    drawn = as_json(recording_figures.overview(recording(), (1, 2), Window(5.0, 25.0)))
    names = [trace["name"] for trace in drawn["data"]]
    assert names == ["1 A", "2 B", "2 B", "3 C", "3 C"]
    assert [trace["opacity"] for trace in drawn["data"]] == [1, 1, 1, 0.35, 0.35]
    (shape,) = drawn["layout"]["shapes"]
    assert (shape["x0"], shape["x1"]) == (5.0, 25.0)
    assert drawn["layout"]["yaxis"]["title"]["text"] == "Speed [m/s]"
    assert drawn["layout"]["yaxis2"]["title"]["text"] == "Space-gap [m]"
    assert drawn["layout"]["xaxis2"]["title"]["text"] == "Time [s]"
    assert drawn["layout"]["dragmode"] == "select"
    assert drawn["layout"]["selectdirection"] == "h"


def test_overview_keeps_its_view_until_another_recording_comes() -> None:
    one, other = recording(), recording("XYZ")
    revisions = [
        as_json(recording_figures.overview(run, vehicles, window))["layout"]["uirevision"]
        for run, vehicles, window in (
            (one, (1, 2), Window(0, 20)),
            (one, (2, 3), Window(5, 25)),
            (other, (1, 2), Window(0, 20)),
        )
    ]
    assert revisions[0] == revisions[1] != revisions[2]


def test_overview_shows_missing_blocks_and_driving_by_hand() -> None:
    frame = platoon()
    frame.loc[100:149, ["Speed2", "IVS1", "IVS2"]] = np.nan
    frame["Driver3"] = ["Human"] * 50 + ["ACC"] * 350
    run = recording(frame=frame)
    assert recording_figures.has_ribbons(run)
    drawn = recording_figures.overview(run, (1, 2, 3), Window(20.0, 35.0))
    ribbons = {trace.name: trace for trace in drawn.data if trace.yaxis == "y3"}
    assert set(ribbons) == {"2 missing", "3 by hand"}
    assert ribbons["2 missing"].x[:2] == pytest.approx((10.0, 14.9))
    assert ribbons["3 by hand"].x[:2] == pytest.approx((0.0, 4.9))
    assert drawn.layout.yaxis3.categoryarray == ("3", "2")
    speed = next(trace for trace in drawn.data if trace.name == "2 B")
    assert np.isnan(speed.y[100:150]).all(), "a hole stays a hole"


def test_a_recording_without_acc_has_no_ribbons_of_driving_by_hand() -> None:
    frame = platoon()
    frame["Driver2"] = "Human"
    assert not recording_figures.has_ribbons(recording(frame=frame))


def test_names_from_files_are_not_read_as_html(segment: Segment) -> None:
    nasty = "<script>alert(1)</script>"
    run = recording([nasty, "B<b>", "C"])  # type: ignore[arg-type]
    text = recording_figures.overview(run, (1, 2), Window(0.0, 20.0)).to_json()
    text += recording_figures.preview(cut(run, 0.0, 30.0)).to_json()
    text += training.parameter_history(history(), 0, cut(run, 0.0, 30.0)).to_json()
    assert not re.search(r"<script|\\u003cscript|<b>|\\u003cb\\u003e", text)
    assert "&lt;" in text or "\\u0026lt;" in text


# Training


def test_loss_is_drawn_on_whole_decades() -> None:
    drawn = as_json(training.loss_history(history()))
    assert len(drawn["data"]) == 3, "Ψ_R is not used, so it is not drawn"
    axis = drawn["layout"]["yaxis"]
    assert axis["type"] == "log"
    assert axis["range"][0] % 1 == 0
    assert axis["range"][1] == 1, "the loss starts a little above 1"
    assert "10⁻³" in axis["ticktext"]
    assert all(text.startswith("10") for text in axis["ticktext"])
    assert len(axis["ticktext"]) <= 8


def test_loss_that_is_zero_or_infinite_is_left_out() -> None:
    track = history()
    track.physics[:] = 0.0
    track.total[-1] = np.inf
    drawn = as_json(training.loss_history(track))
    assert len(drawn["data"]) == 2
    assert all(np.isfinite(drawn["layout"]["yaxis"]["range"]))


@pytest.mark.parametrize(("which", "label"), [*enumerate(("α [1/s²]", "β [1/s]", "τ [s]"))])
def test_parameters_have_units_colours_and_the_truth(
    segment: Segment, which: int, label: str
) -> None:
    truth = (Parameters(0.1, 0.2, 1.2), Parameters(0.11, 0.21, 1.21))
    drawn = as_json(training.parameter_history(history(), which, segment, truth))
    assert drawn["layout"]["yaxis"]["title"]["text"] == label
    assert [trace["name"] for trace in drawn["data"]] == ["2 B", "3 C"]
    colours = [trace["line"]["color"] for trace in drawn["data"]]
    assert colours == [style.vehicle_colour(2, 1), style.vehicle_colour(3, 1)]
    lines = drawn["layout"]["shapes"]
    assert [line["line"]["color"] for line in lines] == colours
    assert {line["line"]["dash"] for line in lines} == {"dash"}
    values = [(law.alpha, law.beta, law.tau)[which] for law in truth]
    assert [line["y0"] for line in lines] == values


def test_the_axis_shows_where_parameters_settle(segment: Segment) -> None:
    drawn = as_json(training.parameter_history(history(), 0, segment))
    low, high = drawn["layout"]["yaxis"]["range"]
    assert 0.09 < low < 0.1 < high < 0.2


def test_case_one_is_one_line_for_all(segment: Segment) -> None:
    drawn = as_json(training.parameter_history(history(sets=1), 2, segment))
    assert [trace["name"] for trace in drawn["data"]] == ["all followers"]


def test_undetermined_parameters_do_not_break_the_axis(segment: Segment) -> None:
    track = history()
    track.parameters[:] = np.nan
    drawn = as_json(training.parameter_history(track, 2, segment))
    assert "range" not in drawn["layout"]["yaxis"]


def test_tracking_shows_data_network_and_simulation(segment: Segment) -> None:
    curves = Trajectories(segment.time, segment.speeds + 1, segment.gaps + 1)
    drawn = training.tracking(segment, 1, curves, curves)
    names = [trace.name for trace in drawn.data]
    assert names == [n for n in ("data", "network", "closed-loop simulation") for _ in range(2)]
    np.testing.assert_array_equal(drawn.data[0].y, segment.gaps[:, 1])
    np.testing.assert_array_equal(drawn.data[1].y, segment.speeds[:, 2])
    np.testing.assert_array_equal(drawn.data[2].y, segment.gaps[:, 1] + 1)
    assert len(training.tracking(segment, 0, None, None).data) == 2


def test_charts_of_a_window_run_in_the_recordings_time(segment: Segment) -> None:
    later = replace(segment, start=320.0)
    own = Trajectories(segment.time, segment.speeds, segment.gaps)
    track = ParameterTrack(segment.time, np.ones((segment.samples, segment.followers, 3)))
    for figure in (
        recording_figures.preview(later),
        training.tracking(later, 0, own, own),
        comparison_figures.curves(later, 0, own, own, "network"),
        comparison_figures.courses([("filter", track)], 0, start=320.0),
    ):
        for trace in figure.data:
            assert trace.x[0] == 320.0
            assert trace.x[-1] == pytest.approx(320.0 + segment.window.duration)


def test_a_collision_is_marked_on_a_line_at_gap_zero(segment: Segment) -> None:
    gaps = segment.gaps.copy()
    gaps[100:] = -1.0
    colliding = Trajectories(segment.time, segment.speeds, gaps)
    for draw in (
        training.tracking,
        lambda *given: comparison_figures.curves(*given, own="network"),
    ):
        assert "collision" not in [trace.name for trace in draw(segment, 0, None, None).data]
        figure = draw(segment, 0, None, colliding)
        [mark] = [trace for trace in figure.data if trace.name == "collision"]
        assert (mark.x[0], mark.y[0]) == (segment.start + segment.time[100], 0.0)
        assert any(shape.y0 == shape.y1 == 0 for shape in figure.layout.shapes)


@pytest.mark.parametrize("dark", ["paper_bgcolor", "plot_bgcolor"])
def test_grounds_are_transparent(segment: Segment, dark: str) -> None:
    for figure in (
        recording_figures.overview(recording(), (1, 2), Window(0, 20)),
        recording_figures.preview(segment),
        training.tracking(segment, 0, None, None),
        training.loss_history(history()),
        training.parameter_history(history(), 0, segment),
    ):
        assert figure.layout[dark] == "rgba(0,0,0,0)"
        assert figure.layout.uirevision
        assert figure.layout.height


def contrast(one: str, other: str) -> float:
    """Contrast ratio of two #rrggbb colours (WCAG 2)."""
    dark, light = sorted(float(linear(c) @ [0.2126, 0.7152, 0.0722]) for c in (one, other))
    return (light + 0.05) / (dark + 0.05)


def linear(colour: str) -> np.ndarray:
    channels = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)


SEEN = {
    "normal": np.eye(3),
    "red-blind": np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]]),
    "green-blind": np.array(
        [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]
    ),
}
"""What linear RGB becomes without one kind of cone (Machado, Oliveira and Fernandes 2009)."""


def lab(colour: str, vision: str) -> np.ndarray:
    """CIELAB coordinates, in which distance is difference as seen."""
    seen = np.clip(SEEN[vision] @ linear(colour), 0, 1)
    to_xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    f = np.cbrt(to_xyz @ seen / [0.9505, 1.0, 1.089])
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


class TestLegends:
    """A figure saved as a picture has no page around it that says which line is which."""

    def entries(self, figure: go.Figure) -> list[str]:
        shown = style.with_legend(figure)
        assert shown.layout.showlegend
        return [trace.name for trace in shown.data if trace.showlegend is not False]

    def test_each_vehicle_once(self, segment: Segment) -> None:
        names = list(segment.labels)
        whole = recording_figures.overview(recording(), (1, 2, 3), Window(0, 30))
        assert self.entries(whole) == names
        assert self.entries(recording_figures.preview(segment)) == names
        track = training.parameter_history(history(), 0, segment)
        assert self.entries(track) == names[1:]

    def test_stability_and_platoon(self) -> None:
        report = stability_report(CASALE.parameters)
        assert self.entries(bode(CASALE, report)) == list(CASALE.labels)
        assert len(self.entries(stability_map(CASALE, report, 0, "beta"))) == 3
        run = simulate_platoon([*CASALE.parameters] * 3, Sinusoid(0.1))
        assert len(self.entries(profiles(run, cast_of(CASALE, [0, 0, 0])))) == 4

    def test_a_figure_without_names_has_none(self) -> None:
        assert not style.with_legend(go.Figure(go.Scatter(x=[0, 1], y=[0, 1]))).layout.showlegend
