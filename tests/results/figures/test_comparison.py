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
    speed = float(result.estimate.speeds[0])
    first = figures.row_of(result, 0, speed)
    spans = result.estimate.gains_and_gap(0)
    np.testing.assert_allclose(first[1].T, [astuple(span)[:3] for span in spans])
    value, _, high = first[1]
    inside, away = ("Splines (own)", value), ("Least squares", np.array([*value[:2], 2 * high[2]]))
    figure = figures.estimates([inside, away], COLOUR, first, TRUE, [("Before", value)])
    drawn = np.transpose([trace.x for trace in figure.data])
    np.testing.assert_allclose(drawn, [value, value, away[1], value])
    assert list(figure.data[0].y)[1:] == ["Splines<br>(own)", "Least squares", "Before"]
    symbols = [list(trace.marker.symbol) for trace in figure.data]
    assert symbols[0] == [INSIDE, INSIDE, INSIDE, EARLIER]
    assert symbols[2] == [INSIDE, INSIDE, OUTSIDE, EARLIER]
    for k, (trace, band) in enumerate(zip(figure.data, rectangles(figure), strict=True)):
        ends = value[k] + np.array([-trace.error_x.arrayminus[0], trace.error_x.array[0]])
        np.testing.assert_allclose(ends, first[1][1:, k])
        assert (band.x0, band.x1) == pytest.approx(tuple(ends))
        assert np.isnan(trace.error_x.array[1:]).all(), "the others are points"
    dashed = [shape.x0 for shape in figure.layout.shapes if shape.type == "line"]
    np.testing.assert_allclose(dashed, TRUE)


def test_without_a_recommended_estimate_there_are_points_alone() -> None:
    point = figures.row_of(result_for(SEGMENT), 0, 20.0)
    assert np.isfinite(point[1]).all(axis=1).tolist() == [True, False, False]
    figure = figures.estimates([point], COLOUR)
    assert not rectangles(figure)
    assert {tuple(trace.marker.symbol) for trace in figure.data} == {(INSIDE,)}
    unbounded = np.array([TRUE, [0.0, 0.0, 1.0], [0.1, 0.3, np.inf]])
    undetermined = ("Least squares", np.array([0.0, 0.2, np.nan]))
    figure = figures.estimates([undetermined], COLOUR, ("PiNN", unbounded))
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
