"""Figures of the answer and of methods side by side: what they draw is what was estimated."""

import numpy as np
import pytest

import accpinn
from accpinn import Parameters, intervals, profiles
from accpinn.inference.identifiability import INCREASE
from accpinn.methods import recursive, splines
from accpinn.results.figures import comparison as figures
from accpinn.results.figures.comparison import JOINT_DRAWN, joint
from tests.support.command import STUDY
from tests.support.figures import rectangles
from tests.support.samples import NOISY, sample

COLOUR = "#0c7eae"
SEGMENT, TRUE = sample(NOISY).segment, sample(NOISY).truth[0]
TRUTH = Parameters.of(TRUE)


def test_estimates_intervals_and_truth_stand_where_they_belong() -> None:
    fit = splines.fit(SEGMENT)
    uncertainty, found = intervals(SEGMENT, fit), fit.parameters.values[0]
    row, old = ("PiNN (fast preset)", found), ("Before", 1.1 * found)
    band = np.array([uncertainty.lower.values[0], uncertainty.upper.values[0]])
    figure = figures.estimates([row], COLOUR, band, TRUE, [old])
    drawn = np.transpose([trace.x for trace in figure.data])
    np.testing.assert_allclose(drawn, [found, 1.1 * found])
    assert {tuple(trace.marker.symbol) for trace in figure.data} == {("circle", "circle-open")}
    assert list(figure.data[0].y) == ["PiNN<br>(fast preset)", "Before"]
    ends = [(band.x0, band.x1) for band in rectangles(figure)]
    np.testing.assert_allclose(ends, band.T)
    dashed = [shape.x0 for shape in figure.layout.shapes if shape.type == "line"]
    np.testing.assert_allclose(dashed, TRUE)
    beside = ("Beside", np.array([found, found - 1.0, found + 2.0]))
    for trace in figures.estimates([beside], COLOUR, band).data:
        np.testing.assert_allclose([trace.error_x.arrayminus, trace.error_x.array], [[1.0], [2.0]])
    unbounded = band.copy()
    unbounded[1, 2] = np.inf
    undetermined = ("Least squares", np.array([0.0, 0.2, np.nan]))
    figure = figures.estimates([undetermined], COLOUR, unbounded)
    assert np.isfinite([shape.x1 for shape in figure.layout.shapes]).all()


def test_tracks_end_at_the_estimate_in_the_recordings_time() -> None:
    track = recursive.fit(SEGMENT).track
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


def test_profiles_reach_the_dashed_line_at_their_ends() -> None:
    (found,) = profiles(SEGMENT)
    lower, upper = np.array([0.0, 0.02, np.nan]), np.array([0.3, np.inf, np.nan])
    figure = figures.profiles(found, COLOUR, lower, upper)
    for one, trace in zip(found, figure.data, strict=True):
        assert min(trace.y) < 10 * INCREASE
        at_end = np.interp(one.upper, trace.x, trace.y)
        assert at_end == pytest.approx(100 * INCREASE, rel=0.05)
    bands = rectangles(figure)
    assert [band.x0 for band in bands] == [0.0, 0.02], "the third has no interval"
    assert bands[0].x1 == 0.3 < figure.layout.xaxis.range[1]
    assert bands[1].x1 == figure.layout.xaxis2.range[1], "it has no end"


def test_each_pair_of_the_answers_parameters_has_a_panel() -> None:
    answer = accpinn.fit(STUDY, 0, 60, method="least-squares").answer
    figure = joint(answer, 0, COLOUR)
    clouds = [trace for trace in figure.data if len(trace.x) == JOINT_DRAWN]
    points = [trace for trace in figure.data if len(trace.x) == 1]
    assert len(clouds) == len(points) == 10
    assert (points[0].x[0], points[0].y[0]) == (answer.parameters.alpha, answer.parameters.beta)
    assert np.isin(clouds[0].x, answer.typical.alpha[:, 0]).all()
