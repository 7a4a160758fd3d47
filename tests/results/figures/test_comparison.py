"""Figures of estimates side by side: what they draw is what was estimated."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from accpinn import Parameters
from accpinn.methods import recursive
from accpinn.results.figures import comparison as figures
from accpinn.results.figures.comparison import EARLIER, INSIDE, JOINT_DRAWN, OUTSIDE, joint
from accpinn.results.figures.training import forest
from tests.support.figures import rectangles
from tests.support.samples import NOISY, sample
from tests.support.snapshots import recommended, result_for, two_windows

COLOUR = "#0c7eae"
SEGMENT, TRUE = sample(NOISY).segment, sample(NOISY).truth[0]
TRUTH = Parameters.of(TRUE)


def test_points_are_marked_by_whether_they_lie_in_the_recommended_interval() -> None:
    result = recommended()
    model = result.estimate.model
    first = figures.row_of(result, 0)
    spans = [result.estimate.span(name, 0) for name in ("tau", "alpha", "beta")]
    np.testing.assert_allclose(first.values.T, [astuple(span)[:3] for span in spans])
    value, _, high = first.values
    inside = figures.Row("Splines (own)", model, value)
    away = figures.Row("Least squares", model, np.array([2 * high[0], *value[1:]]))
    figure = figures.estimates([inside, away], COLOUR, first, TRUTH, [first._replace(name="B")])
    drawn = np.transpose([trace.x for trace in figure.data])
    np.testing.assert_allclose(drawn, [value, value, away.values, value])
    symbols = [list(trace.marker.symbol) for trace in figure.data]
    assert symbols[0] == [INSIDE, INSIDE, OUTSIDE, EARLIER]
    assert symbols[1] == [INSIDE, INSIDE, INSIDE, EARLIER]
    for k, (trace, band) in enumerate(zip(figure.data, rectangles(figure), strict=True)):
        ends = value[k] + np.array([-trace.error_x.arrayminus[0], trace.error_x.array[0]])
        np.testing.assert_allclose(ends, first.values[1:, k])
        assert (band.x0, band.x1) == pytest.approx(tuple(ends))
        assert np.isnan(trace.error_x.array[1:]).all(), "the others are points"
    dashed = [shape.x0 for shape in figure.layout.shapes if shape.type == "line"]
    np.testing.assert_allclose(dashed, [TRUE[2], *TRUE[:2]])


def test_estimates_of_another_model_stand_apart_below_a_heading_of_their_own() -> None:
    first = figures.Row("PiNN", "cthp-s0-delay", np.array([[0.8, 0.1, 0.3], [0.7] * 3, [0.9] * 3]))
    other = figures.Row("Splines", "cthp", np.array([1.2, 0.1, 0.3]))
    alike = figures.Row("Simulation", "cthp-s0-delay", np.array([1.2, 0.1, 0.3]))
    truth = Parameters(0.1, 0.3, 0.8, s0=5.0, delay=0.5)
    figure = figures.estimates([other, alike], COLOUR, first, truth)
    headings = [note.text for note in figure.layout.annotations]
    assert headings == [f"<b>{figures.group_title(key)}</b>" for key in ("cthp-s0-delay", "cthp")]
    points = figure.data[0]
    places = dict(zip(points.customdata, points.y, strict=True))
    assert places["PiNN"] > places["Simulation"] > places["Splines"]
    assert list(points.marker.symbol) == [INSIDE, INSIDE, OUTSIDE], "of its own model alone"
    for shape in figure.layout.shapes:  # interval and truth
        assert shape.y0 < places["Simulation"] < places["PiNN"] < shape.y1
        assert shape.y0 > places["Splines"]


def test_without_a_recommended_estimate_there_are_points_alone() -> None:
    point = figures.row_of(result_for(SEGMENT), 0)
    assert np.isfinite(point.values).all(axis=1).tolist() == [True, False, False]
    figure = figures.estimates([point], COLOUR)
    assert not rectangles(figure)
    assert {tuple(trace.marker.symbol) for trace in figure.data} == {(INSIDE,)}
    unbounded = np.array([[1.0, *TRUE[:2]], [0.0, 0.0, 1.0], [0.1, 0.3, np.inf]])
    undetermined = figures.Row("Least squares", "cthp", np.array([np.nan, 0.0, 0.2]))
    figure = figures.estimates([undetermined], COLOUR, figures.Row("PiNN", "cthp", unbounded))
    assert np.isfinite([shape.x1 for shape in figure.layout.shapes]).all()


def test_tracks_end_at_the_estimate_in_the_recordings_time() -> None:
    track = recursive.fit((SEGMENT,)).track
    figure = figures.tracks([("A", track), ("B", track)], 0, TRUTH, start=320.0)
    lines = [trace for trace in figure.data if trace.name == "A"]
    last = track.parameters.values[-1, 0]
    np.testing.assert_allclose([line.y[-1] for line in lines], last)
    assert lines[0].x[-1] == pytest.approx(320.0 + track.time[-1])
    bands = [trace for trace in figure.data if trace.fill]
    assert len(bands) == 6, "one standard deviation around each"
    end = last[0] + track.deviation[-1, 0, 0]
    assert bands[0].y[len(bands[0].y) // 2] == pytest.approx(end, rel=0.01)
    assert [shape.y0 for shape in figure.layout.shapes] == list(TRUE)


def test_the_forest_has_each_windows_own_value_and_that_of_all() -> None:
    result = two_windows()
    estimate, known = result.estimate, result.posterior
    figure = forest(result, 0)
    (points,) = [trace for trace in figure.data if trace.mode == "markers"]
    gaps = estimate.windows.time_gap(estimate.stated_speed)[:, 0]
    np.testing.assert_allclose(points.y, gaps)
    ends = points.y - points.error_y.arrayminus, points.y + points.error_y.array
    low, high = known.windows_gap[:, :, 0]
    np.testing.assert_allclose(ends, [np.minimum(low, gaps), np.maximum(high, gaps)])
    span = estimate.time_gap(estimate.stated_speed, 0)
    bands = [(min(trace.y), max(trace.y)) for trace in figure.data if trace.fill]
    assert bands == [(span.further_lower, span.further_upper), (span.lower, span.upper)]
    (line,) = [trace for trace in figure.data if trace.mode == "lines"]
    assert list(line.y) == [span.value] * 2
    point = replace(result, estimate=replace(estimate, posterior=None))
    bare = forest(point, 0)
    assert not [trace for trace in bare.data if trace.fill]
    assert not bare.data[-1].error_y.array.any()


def test_each_pair_of_an_estimates_parameters_has_a_panel() -> None:
    estimate = recommended().estimate
    figure = joint(estimate, 0, COLOUR)
    clouds = [trace for trace in figure.data if len(trace.x) == JOINT_DRAWN]
    points = [trace for trace in figure.data if trace.name == "estimate"]
    assert len(clouds) == len(points) == 10
    assert (points[0].x[0], points[0].y[0]) == tuple(estimate.parameters.values[0, :2])
    assert np.isin(clouds[0].x, estimate.posterior.typical.alpha[:, 0]).all()
