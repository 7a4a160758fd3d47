"""A recording and a window as figures: who is drawn, what is missing, who drove."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import pytest

from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording, Window
from accpinn.results.figures.recording import has_ribbons, overview, preview
from accpinn.segment.cut import cut
from tests.support.figures import names
from tests.support.openacc_files import csv, metadata, platoon


def recording(names: Sequence[str] = "ABC", frame: pd.DataFrame | None = None) -> Recording:
    return read(csv(platoon() if frame is None else frame, metadata(tuple(names))), "run.csv")


def test_overview_draws_all_vehicles_and_the_window() -> None:
    figure = overview(recording(), (1, 2), Window(5.0, 25.0))
    assert names(figure) == ["1 A", "2 B", "2 B", "3 C", "3 C"]
    assert [trace.opacity for trace in figure.data] == [1, 1, 1, 0.35, 0.35]
    (shape,) = figure.layout.shapes
    assert (shape.x0, shape.x1) == (5.0, 25.0)
    axes = (figure.layout.yaxis, figure.layout.yaxis2, figure.layout.xaxis2)
    assert [axis.title.text for axis in axes] == ["Speed [m/s]", "Space-gap [m]", "Time [s]"]
    assert (figure.layout.dragmode, figure.layout.selectdirection) == ("select", "h")


def test_overview_keeps_its_zoom_until_another_recording_comes() -> None:
    one, other = recording(), recording("XYZ")
    first, second, third = (
        overview(run, vehicles, Window(0, 20)).layout.uirevision
        for run, vehicles in ((one, (1, 2)), (one, (2, 3)), (other, (1, 2)))
    )
    assert first == second != third


def test_overview_shows_missing_blocks_and_driving_by_hand() -> None:
    frame = platoon()
    frame.loc[100:149, ["Speed2", "IVS1", "IVS2"]] = np.nan
    frame["Driver3"] = ["Human"] * 50 + ["ACC"] * 350
    run = recording(frame=frame)
    assert has_ribbons(run)
    figure = overview(run, (1, 2, 3), Window(20.0, 35.0))
    ribbons = {trace.name: trace for trace in figure.data if trace.yaxis == "y3"}
    assert set(ribbons) == {"2 missing", "3 by hand"}
    assert ribbons["2 missing"].x[:2] == pytest.approx((10.0, 14.9))
    assert ribbons["3 by hand"].x[:2] == pytest.approx((0.0, 4.9))
    assert figure.layout.yaxis3.categoryarray == ("3", "2")
    assert np.isnan(figure.data[1].y[100:150]).all(), "a hole stays a hole"


def test_a_recording_without_acc_has_no_ribbons_of_driving_by_hand() -> None:
    frame = platoon()
    frame["Driver2"] = "Human"
    assert not has_ribbons(recording(frame=frame))


def test_preview_has_every_vehicle_in_the_recordings_time() -> None:
    figure = preview(cut(recording(), 5.0, 30.0))
    assert names(figure) == ["1 A", "2 B", "3 C"]
    assert {(trace.x[0], trace.x[-1]) for trace in figure.data} == {(5.0, 35.0)}


def test_names_from_files_are_not_read_as_html() -> None:
    run = recording(["<script>alert(1)</script>", "B<b>", "C"])
    for figure in (overview(run, (1, 2), Window(0.0, 20.0)), preview(cut(run, 0.0, 30.0))):
        assert "<" not in "".join(names(figure))
        assert "2 B&lt;b&gt;" in names(figure)
