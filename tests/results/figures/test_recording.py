"""A recording and a window as figures: who is drawn, what is missing, who drove."""

import numpy as np
import pytest

from accpinn import cut, label_regimes
from accpinn.recordings import Window
from accpinn.results.figures import recording as figures
from accpinn.results.recording import RatedWindow
from tests.support.figures import names
from tests.support.openacc_files import platoon, recording

WINDOW = Window(5.0, 25.0)


def test_overview_draws_all_vehicles_and_the_window() -> None:
    figure = figures.overview(recording(), (1, 2), WINDOW)
    assert names(figure) == ["1 A", "2 B", "2 B", "3 C", "3 C"]
    assert [trace.opacity for trace in figure.data] == [1, 1, 1, 0.35, 0.35]
    (shape,) = figure.layout.shapes
    assert (shape.x0, shape.x1) == (5.0, 25.0)
    rows = (RatedWindow(1, Window(0, 10), True), RatedWindow(2, Window(20, 30), False))
    both = figures.overview(recording(), (1, 2), WINDOW, several=rows)
    assert [(shape.x0, shape.x1) for shape in both.layout.shapes] == [(0, 10), (20, 30)]
    used, unused = both.layout.shapes
    assert (used.line.dash, unused.line.dash) == ("solid", "dot")
    assert [note.text[0] for note in both.layout.annotations] == ["1", "2"]
    again = figures.overview(recording(), (2, 3), Window(0, 20)).layout.uirevision
    other = figures.overview(recording(names="XYZ"), (1, 2), Window(0, 20)).layout.uirevision
    assert figure.layout.uirevision == again != other, "the zoom is kept until another recording"


def test_views_of_the_followers_and_one_that_is_highlighted() -> None:
    run, vehicles = recording(), (1, 2, 3)
    relative = figures.overview(run, vehicles, WINDOW, view="relative")
    assert names(relative) == ["2 B", "3 C"]
    np.testing.assert_allclose(relative.data[1].y, run.speed[:, 1] - run.speed[:, 2])
    gaps = figures.overview(run, vehicles, WINDOW, view="time gap", highlight=3)
    np.testing.assert_allclose(gaps.data[0].y, run.gap[:, 0] / run.speed[:, 1])
    assert [trace.opacity for trace in gaps.data] == [0.35, 1]
    motion = figures.overview(run, vehicles, WINDOW, highlight=3)
    strong = [(trace.name, trace.yaxis) for trace in motion.data if trace.opacity == 1]
    assert strong == [("2 B", "y"), ("3 C", "y"), ("3 C", "y2")], "and the speed ahead of it"


def test_overview_shows_missing_blocks_and_driving_by_hand() -> None:
    frame = platoon()
    frame.loc[100:149, ["Speed2", "IVS1", "IVS2"]] = np.nan
    frame["Driver3"] = ["Human"] * 50 + ["ACC"] * 350
    run = recording(frame)
    whole = cut(run, 0.0, run.duration, allow_missing=True)
    regimes = label_regimes(whole, run)
    ribbons = figures.driver_ribbons(run, (1, 2, 3)), figures.regime_ribbons(whole, regimes)
    figure = figures.overview(run, (1, 2, 3), Window(20.0, 35.0), ribbons)
    assert figures.driver_ribbons(recording(), (1, 2)) == [], "nobody drives by hand"
    first, second = (
        {trace.name: trace for trace in figure.data if trace.yaxis == axis} for axis in ("y3", "y4")
    )
    assert set(first) == {"3 by hand", "3 ACC"}
    assert first["3 by hand"].x[:2] == pytest.approx((0.0, 4.9))
    assert second["2 missing"].x[:2] == pytest.approx((9.95, 14.95))
    assert figure.layout.yaxis4.categoryarray == ("3", "2")
    assert "missing" in figures.strip_key(ribbons[1])
    assert np.isnan(figure.data[1].y[100:150]).all(), "a hole stays a hole"


def test_jumps_of_a_chosen_gap_are_marked() -> None:
    frame = platoon(3, 600)
    frame.loc[200:, "IVS2"] += 15.0
    run = recording(frame)
    figure = figures.overview(run, (1, 2, 3), Window(0.0, 15.0))
    (marks,) = (trace for trace in figure.data if trace.mode == "markers")
    assert (list(marks.x), marks.yaxis) == ([20.0], "y2")
    assert marks.customdata == pytest.approx([15.0], abs=0.5)
    assert marks.y == pytest.approx(run.gap[200, 1])
    assert "customdata" in marks.hovertemplate
    for other in (
        figures.overview(run, (1, 2), Window(0.0, 15.0)),
        figures.overview(run, (1, 2, 3), Window(0.0, 15.0), view="relative"),
    ):
        assert all(trace.mode != "markers" for trace in other.data)
