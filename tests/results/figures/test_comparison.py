"""Figures that compare methods: what they draw is what was estimated."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.inference.identifiability import INCREASE, profiles
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.methods import recursive, splines
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters
from accpinn.results.figures import comparison as figures
from accpinn.results.figures.style import FOLLOWERS
from accpinn.segment.segment import Segment
from tests.support.figures import rectangles
from tests.support.samples import NOISY, sample

COLOUR = "#0c7eae"


@pytest.fixture(scope="module")
def segment() -> Segment:
    return sample(NOISY).segment


@pytest.fixture(scope="module")
def fit(segment: Segment) -> Fit:
    return splines.fit(segment)


@pytest.fixture(scope="module")
def uncertainty(segment: Segment, fit: Fit) -> Uncertainty:
    return intervals(segment, fit)


def test_estimates_intervals_and_truth_stand_where_they_belong(
    fit: Fit, uncertainty: Uncertainty
) -> None:
    row = figures.NamedEstimate("PiNN (fast preset)", fit.parameters.values[0])
    old = figures.NamedEstimate("Before <b>", 1.1 * fit.parameters.values[0], earlier=True)
    truth = Parameters.of(sample(NOISY).truth[0])
    figure = figures.estimates([row, old], COLOUR, uncertainty, 0, truth)
    for which, trace in enumerate(figure.data):
        np.testing.assert_allclose(trace.x, [row.values[which], old.values[which]])
        assert list(trace.marker.symbol) == ["circle", "circle-open"]
    assert list(figure.data[0].y) == ["PiNN<br>(fast preset)", "Before &lt;b&gt;"]
    bands = rectangles(figure)
    np.testing.assert_allclose([band.x0 for band in bands], uncertainty.lower.values[0])
    np.testing.assert_allclose([band.x1 for band in bands], uncertainty.upper.values[0])
    dashed = [shape.x0 for shape in figure.layout.shapes if shape.type == "line"]
    np.testing.assert_allclose(dashed, sample(NOISY).truth[0])
    beside = replace(row, ends=np.array([row.values - 1.0, row.values + 2.0]))
    for trace in figures.estimates([beside], COLOUR, uncertainty, 0).data:
        np.testing.assert_allclose([trace.error_x.arrayminus, trace.error_x.array], [[1.0], [2.0]])
    ends = uncertainty.upper.values.copy()
    ends[0, 2] = np.inf
    undetermined = figures.NamedEstimate("Least squares", np.array([0.0, 0.2, np.nan]))
    unbounded = replace(uncertainty, upper=Parameters.of(ends))
    figure = figures.estimates([undetermined], COLOUR, unbounded, 0)
    assert np.isfinite([shape.x1 for shape in figure.layout.shapes]).all()


def test_tracks_end_at_the_estimate_in_the_recordings_time(segment: Segment) -> None:
    track = recursive.fit(segment).track
    truth = Parameters.of(sample(NOISY).truth[0])
    figure = figures.tracks([("A", track), ("B", track)], 0, truth, start=320.0)
    lines = [trace for trace in figure.data if trace.name == "A"]
    last = track.parameters.values[-1, 0]
    np.testing.assert_allclose([line.y[-1] for line in lines], last)
    assert lines[0].x[-1] == pytest.approx(320.0 + track.time[-1])
    bands = [trace for trace in figure.data if trace.fill]
    assert len(bands) == 6, "one standard deviation around each"
    end = last[0] + track.deviation[-1, 0, 0]
    assert bands[0].y[len(bands[0].y) // 2] == pytest.approx(end, rel=0.01)
    colours = {trace.line.color for trace in figure.data if trace.name}
    assert len(colours) == 2
    assert colours.isdisjoint(FOLLOWERS), "lines of methods do not look like vehicles"
    assert [shape.y0 for shape in figure.layout.shapes] == list(sample(NOISY).truth[0])


def test_profiles_reach_the_dashed_line_at_their_ends(segment: Segment) -> None:
    (found,) = profiles(segment)
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
