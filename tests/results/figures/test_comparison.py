"""Figures and tables of the Compare page: what they draw is what was estimated."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import closed_loop
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.inference.profiles import INCREASE, profiles
from accpinn.methods import least_squares, recursive, splines
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters
from accpinn.results.figures import comparison as figures
from accpinn.results.figures.style import FOLLOWERS
from accpinn.results.tables.estimates import fit_record_table, fit_record_title
from accpinn.segment.segment import Segment
from accpinn.study.comparison import FitRecord, differences
from tests.support.samples import NOISY, PLATOON, sample


@pytest.fixture(scope="module")
def segment() -> Segment:
    return sample(NOISY).segment


@pytest.fixture(scope="module")
def fit(segment: Segment) -> Fit:
    return splines.fit(segment)


@pytest.fixture(scope="module")
def uncertainty(segment: Segment, fit: Fit) -> Uncertainty:
    return intervals(segment, fit)


class TestEstimates:
    def test_dots_bands_and_truth_stand_where_they_belong(
        self, segment: Segment, fit: Fit, uncertainty: Uncertainty
    ) -> None:
        row = figures.Estimate("PiNN (fast preset)", fit.parameters.values[0])
        old = figures.Estimate("Before <b>", 1.1 * fit.parameters.values[0], earlier=True)
        truth = Parameters(*sample(NOISY).truth[0])
        figure = figures.estimates(
            [row, old], "#0c7eae", uncertainty, 0, truth, "PiNN (fast preset)"
        )
        for which, trace in enumerate(figure.data):
            np.testing.assert_allclose(trace.x, [row.values[which], old.values[which]])
            assert list(trace.marker.symbol) == ["circle", "circle-open"]
            assert trace.marker.size[0] > trace.marker.size[1]
        assert list(figure.data[0].y) == ["PiNN<br>(fast preset)", "Before &lt;b&gt;"]
        assert figure.data[0].customdata[0] == "PiNN (fast preset)"
        bands = [shape for shape in figure.layout.shapes if shape.type == "rect"]
        np.testing.assert_allclose([band.x0 for band in bands], uncertainty.lower[0])
        np.testing.assert_allclose([band.x1 for band in bands], uncertainty.upper[0])
        dashed = [shape.x0 for shape in figure.layout.shapes if shape.type == "line"]
        np.testing.assert_allclose(dashed, sample(NOISY).truth[0])

    def test_an_open_end_and_an_unknown_tau_can_be_drawn(
        self, fit: Fit, uncertainty: Uncertainty
    ) -> None:
        upper = uncertainty.upper.copy()
        upper[0, 2] = np.inf
        row = figures.Estimate("Least squares", np.array([0.0, 0.2, np.nan]))
        figure = figures.estimates([row], "#0c7eae", replace(uncertainty, upper=upper), 0)
        ends = [shape.x1 for shape in figure.layout.shapes]
        assert np.isfinite(ends).all()


class TestCurves:
    def test_share_one_axis_of_time_and_show_the_error(self, segment: Segment, fit: Fit) -> None:
        driven = closed_loop(segment, fit)
        assert driven is not None
        figure = figures.curves(segment, 0, fit.surrogate, driven, "Splines")
        assert {figure.layout.xaxis.matches, figure.layout.xaxis2.matches} == {"x3"}
        errors = [trace for trace in figure.data if trace.yaxis == "y3"]
        assert [trace.name for trace in errors] == ["Splines", "closed-loop simulation"]
        worst = np.abs(driven.gaps - segment.gaps).max()
        assert np.abs(errors[1].y).max() == pytest.approx(worst)

    def test_a_law_without_headway_has_no_simulation(self, segment: Segment) -> None:
        figure = figures.curves(segment, 0, None, None, "Least squares")
        assert {trace.name for trace in figure.data} == {"data"}

    def test_courses_end_at_the_estimate(self, segment: Segment) -> None:
        online = recursive.fit(segment)
        assert online.track is not None
        figure = figures.courses([("Recursive", online.track)], 0)
        lines = [trace for trace in figure.data if trace.name == "Recursive"]
        assert len(lines) == 3
        last = [trace.y[-1] for trace in lines]
        np.testing.assert_allclose(last, online.track.parameters[-1, 0])


def test_profiles_touch_zero_at_the_estimate_and_the_line_at_the_ends(segment: Segment) -> None:
    (found,) = profiles(segment)
    lower, upper = np.array([0.0, 0.02, np.nan]), np.array([0.3, np.inf, np.nan])
    figure = figures.profiles(found, "#0c7eae", lower, upper)
    for one, trace in zip(found, figure.data, strict=True):
        assert min(trace.y) < 10 * INCREASE
        at_end = np.interp(one.upper, trace.x, trace.y)
        assert at_end == pytest.approx(100 * INCREASE, rel=0.05)
    bands = [shape for shape in figure.layout.shapes if shape.type == "rect"]
    assert [band.x0 for band in bands] == [0.0, 0.02], "the third has no interval"
    assert bands[0].x1 == 0.3 < figure.layout.xaxis.range[1]
    assert bands[1].x1 == figure.layout.xaxis2.range[1], "it has no end"


def test_online_methods_do_not_look_like_vehicles(segment: Segment) -> None:
    online = recursive.fit(segment)
    assert online.track is not None
    figure = figures.courses([("A", online.track), ("B", online.track)], 0)
    lines = {trace.line.color for trace in figure.data if trace.name}
    assert len(lines) == 2
    assert lines.isdisjoint(FOLLOWERS)


@pytest.fixture(scope="module")
def four() -> Segment:
    return sample(PLATOON).segment


class TestEarlier:
    def test_what_was_asked_differently_is_named(self, four: Segment) -> None:
        fit = least_squares.fit(four)
        one = FitRecord.of(four, fit)
        assert differences(one, FitRecord.of(four, fit)) == ()
        assert one.same_as(FitRecord.of(four, fit))
        shared = FitRecord.of(four, least_squares.fit(four, "I"))
        assert "case: II → I" in differences(one, shared)
        assert not one.same_as(shared)
        moved = replace(one, info=replace(one.info, start=40.0, left_out=("manual",)))
        said = differences(one, moved)
        assert "window: 0–300 s → 40–340 s" in said
        assert "left out: nothing → manual" in said

    def test_the_table_says_what_changed(self, four: Segment) -> None:
        then = FitRecord.of(four, least_squares.fit(four))
        now = replace(then, parameters=then.parameters + 0.5, case="I")
        table = fit_record_table([then], {"least-squares": now}, vehicle=3)
        assert [c.title for c in table.columns if c.prose] == ["Earlier run", "Differs now in"]
        (row,) = table.rows
        assert row[0] == fit_record_title(then)
        assert row[1] == pytest.approx(then.parameters[1, 0])
        np.testing.assert_allclose(row[5:8], 0.5)
        assert row[8] == "case: II → I"
        assert fit_record_table([then], {"splines": now}, vehicle=3).rows[0][5:] == (None,) * 4
        assert fit_record_table([then], {}, vehicle=3).rows[0][5:] == (), (
            "nothing to hold it against"
        )
        assert fit_record_table([then], {}, vehicle=1).rows == (), "the leader has no law"
