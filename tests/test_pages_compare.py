"""The Compare page without a browser: rows, a stop, five starts, and the session's earlier runs."""

from dataclasses import replace

import pytest

from accpinn.estimators import least_squares
from accpinn.jobs import Status
from accpinn.pinn.config import FAST
from accpinn.segment import Window
from pages.shared import server
from pages.shared.compare_charts import picked_name
from pages.shared.compare_words import collision_line
from pages.shared.sources import FIRST_SAMPLE, sample
from pages.shared.workspace import KEPT_RUNS, Workspace
from tests.apptest import COMPARE, WAIT, everything, open_page, with_sample

pytestmark = pytest.mark.usefixtures("fresh_server")


@pytest.fixture
def found(fresh_server: None) -> Workspace:
    made = with_sample()
    made.choose(window=Window(0.0, 60.0), vehicles=(1, 2))
    return made


def test_rows_pictures_warnings_starts_and_earlier_runs(found: Workspace) -> None:
    page = open_page(COMPARE, found)
    page.button(key="compare_run").click().run()
    assert found.comparison is not None
    assert found.comparison.wait(WAIT)
    assert found.comparison.status is Status.DONE
    page = open_page(COMPARE, found)
    shown = everything(page)
    assert "eight methods, α from" in shown
    assert "string stable" in shown
    for part in ("Do the methods agree?", "Can the data tell?", "Condition number"):
        assert part in shown
    assert "Earlier runs" not in shown
    page.selectbox(key="compare_method").set_value("Splines").run()
    assert "Splines against the data" in everything(page)

    found.train_starts(FAST)
    assert found.starts is not None
    assert found.starts.wait(WAIT)
    assert "Spread" in everything(open_page(COMPARE, found))

    before = found.compared[0].fit
    found.choose(window=Window(10.0, 60.0))
    assert found.compared == ()
    assert found.starts is None
    assert [run.method for run in found.runs] == [
        "pinn", "least-squares", "savitzky-golay", "splines",
        "simulation", "recursive", "particle", "dual-ukf",
    ]  # fmt: skip
    assert found.runs[0].parameters[0] == pytest.approx(before.table()[0])

    found.compare()
    assert found.comparison.wait(WAIT)
    page = open_page(COMPARE, found)
    assert "0–60 s → 10–60 s" in everything(page)
    page.multiselect(key="compare_earlier").set_value(
        [page.multiselect(key="compare_earlier").options[0]]
    ).run()
    assert not page.exception
    assert "Rings: earlier runs." in everything(page)


def test_a_stop_keeps_the_rows_and_offers_to_run_again(found: Workspace) -> None:
    found.compare()
    series = found.comparison
    assert series is not None
    server.trainings().stop(series)
    assert series.wait(WAIT)
    assert series.status is Status.STOPPED
    page = open_page(COMPARE, found)
    assert "Stopped: " in everything(page)
    assert page.button(key="compare_run").label == "Run all methods"


def test_earlier_runs_are_bounded_and_none_is_kept_twice(found: Workspace) -> None:
    assert found.segment is not None
    fit = least_squares.fit(found.segment)
    found._remember([fit, fit])
    assert len(found.runs) == 1
    for seed in range(KEPT_RUNS + 3):
        found._remember([replace(fit, config={"seed": seed})])
    assert len(found.runs) == KEPT_RUNS
    assert found.runs[-1].config == {"seed": KEPT_RUNS + 2}
    found.open(*sample(FIRST_SAMPLE))
    assert len(found.runs) == KEPT_RUNS, "an early step does not drop them"


def test_a_click_names_its_row() -> None:
    assert picked_name([]) == ""
    assert picked_name([{"customdata": "PiNN"}]) == "PiNN"
    assert picked_name([{"customdata": ["Splines"]}]) == "Splines"


def test_collisions_are_told_before_anything_else() -> None:
    assert collision_line(["PiNN"], 1) == (
        "Driving by itself behind the measured leader, the law runs into the vehicle ahead on this"
        " window: PiNN."
    )
    assert "2 of 8 methods have a law that runs" in collision_line(["PiNN", "Splines"], 8)
    assert "the laws of all methods run" in collision_line(["PiNN", "Splines"], 2)
