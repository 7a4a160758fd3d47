"""The Compare page without a browser: rows, a stop, five starts, and the session's earlier runs."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.errors import SegmentError
from accpinn.evaluation.closed_loop import ALONE
from accpinn.methods import least_squares
from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import FAST, PAPER
from accpinn.segment.segment import Segment, Window
from accpinn.study.comparison import METHODS, MethodFailure, MethodResult, compare, result_of
from accpinn.tasks.series import Series
from accpinn.tasks.task import Status
from pages.ui.compare.charts import picked_name
from pages.ui.compare.own import rows_of
from pages.ui.compare.verdict import collision_lines, incidents, verdict
from pages.ui.components.text import escape_markdown
from pages.ui.data.sources import FIRST_SAMPLE, sample
from pages.ui.session import resources as server
from pages.ui.session.workspace import KEPT_RUNS, Workspace
from tests.apptest import COMPARE, WAIT, everything, open_page, texts, with_sample
from tests.support.driving import MIXED, driven

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
    assert "**2 Audi\\(A6\\-like\\)**: " in texts(page)
    assert "The estimates differ most in" in shown
    for part in ("Do the methods agree?", "Can the data tell?", "Is the law all there is?"):
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
    assert found.runs[0].parameters[0] == pytest.approx(before.parameters.values[0])

    found.compare()
    assert found.comparison.wait(WAIT)
    page = open_page(COMPARE, found)
    assert "0–60 s → 10–60 s" in everything(page)
    page.multiselect(key="compare_earlier").set_value(
        [page.multiselect(key="compare_earlier").options[0]]
    ).run()
    assert not page.exception
    assert "Rings: earlier runs." in everything(page)


@pytest.mark.parametrize("refusing", [("splines", "particle"), METHODS])
def test_methods_that_refuse_are_named_and_the_others_shown(
    found: Workspace, refusing: tuple[str, ...]
) -> None:
    assert found.segment is not None
    fault = SegmentError("Too little is left of the window; choose a longer one.")
    row = result_of(found.segment, least_squares.fit(found.segment))
    results = [MethodFailure(name, fault) if name in refusing else row for name in METHODS]
    series = Series(found.id, "comparison", METHODS, lambda means: iter(results))
    found.comparison = server.trainings().run(series)
    assert series.wait(WAIT)
    assert series.status is Status.DONE
    page = open_page(COMPARE, found)
    (told,) = [box.value for box in page.warning if box.value.startswith("No result from ")]
    who = "Splines, Particle filter" if len(refusing) == 2 else "any method"
    assert told == escape_markdown(f"No result from {who}: {fault}")
    assert ("Least squares" in everything(page)) == (len(refusing) == 2)
    assert len(found.compared) == len(METHODS) - len(refusing)


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


@pytest.fixture(scope="module")
def two() -> tuple[Segment, list[MethodResult]]:
    segment = driven(MIXED[:2], noise=0.1)
    return segment, list(compare(segment, "II", ("least-squares", "splines", "recursive")))


class TestVerdict:
    def test_agreement_is_judged_by_the_interval_of_each_parameter(
        self, two: tuple[Segment, list[MethodResult]]
    ) -> None:
        segment, rows = two
        uncertainty = rows[0].uncertainty
        table = rows[0].fit.parameters.values

        def around(lower: float, upper: float) -> list[MethodResult]:
            ends = {"lower": lower * table, "upper": upper * table}
            return [replace(row, uncertainty=replace(uncertainty, **ends)) for row in rows]

        said = verdict(segment, around(0.5, 1.5), 0)
        assert (
            "yes, all methods lie within the 90 % intervals of the data. The estimates differ"
            in said
        )
        said = verdict(segment, around(0.1, 9.0), 0)
        assert "but those of α, β and τ are too wide for that to say much" in said
        said = verdict(segment, around(1.5, 2.0), 0)
        assert "no: by the 90 % intervals of the data, α is too low for every method; " in said

    def test_those_outside_are_named_the_shorter_way(
        self, two: tuple[Segment, list[MethodResult]]
    ) -> None:
        segment, rows = two
        uncertainty = rows[0].uncertainty
        between = np.sort([row.fit.parameters[0].beta for row in rows])
        lower, upper = 0.0 * uncertainty.lower, np.full_like(uncertainty.upper, np.inf)
        upper[0, 1] = between[:2].mean()
        judged = [replace(rows[0], uncertainty=replace(uncertainty, lower=lower, upper=upper))]
        assert "β is too high for all methods but " in verdict(segment, [*judged, *rows[1:]], 0)

    def test_one_law_for_all_has_one_sentence(
        self, two: tuple[Segment, list[MethodResult]]
    ) -> None:
        segment, rows = two
        shared = [replace(row, fit=replace(row.fit, case="I")) for row in rows]
        assert verdict(segment, shared, 0).startswith("**All followers together**: ")

    def test_data_that_determine_nothing_are_no_measure(
        self, two: tuple[Segment, list[MethodResult]]
    ) -> None:
        segment, rows = two
        nothing = np.full_like(rows[0].uncertainty.lower, np.nan)
        judged = replace(rows[0], uncertainty=replace(rows[0].uncertainty, lower=nothing))
        assert "determine nothing" in verdict(segment, [judged, *rows[1:]], 0)


def test_collisions_name_follower_and_method_before_anything_else(
    two: tuple[Segment, list[MethodResult]],
) -> None:
    segment, rows = two
    first, second = segment.labels[1:3]
    assert collision_lines(segment, rows) == []

    def touching(row: MethodResult, *times: float, said: tuple[str, ...] = ()) -> MethodResult:
        worth = replace(row.evaluation, collisions=np.array(times), incidents=said)
        return replace(row, evaluation=worth)

    never = float("nan")
    some = [
        touching(
            rows[0],
            5.0,
            never,
            said=(f"{first} runs{ALONE}; so.", f"{first} turns.", f"{second} diverges."),
        ),
        touching(rows[1], 5.0, 7.0, said=(f"{first} runs.",)),
        touching(rows[2], 5.0, never),
    ]
    assert collision_lines(segment, some) == [
        f"{escape_markdown(first)}, as learned by every method.",
        f"{escape_markdown(second)}, as learned by Splines.",
    ]
    told = incidents(segment, some)
    assert (
        told.index(escape_markdown(first))
        < told.index("Splines: runs")
        < told.index(escape_markdown(second))
    )
    assert "Least squares: runs\\; so · turns\n" in told
    assert told.endswith("Least squares: diverges")


def test_a_training_with_other_settings_has_a_row_of_its_own(found: Workspace) -> None:
    found.comparison = Series(found.id, "comparison", ("least-squares",), lambda means: iter(()))
    assert found.segment is not None
    least = compare(found.segment, "II", ("least-squares",))
    found.comparison._results = tuple(least)
    assert len(rows_of(found)) == 1
    found.train(replace(FAST, iterations=60))
    assert found.job is not None
    assert found.job.wait(WAIT)
    _, own = rows_of(found)
    assert own.fit is found.fit
    assert own.evaluation.held_out is None
    assert rows_of(found)[1] is own, "it is worked out once"
    found.comparison._results = (own,)
    assert rows_of(found) == (own,), "the same settings need no second row"
    found.job._fit = replace(own.fit, outcome=Outcome.STOPPED)
    assert rows_of(found) == (own,), "an unfinished training is no result"


def test_a_comparison_names_one_s_own_training_that_it_waits_for(found: Workspace) -> None:
    found.train(PAPER)
    page = open_page(COMPARE, found)
    assert "Your own training with the paper preset comes first" in texts(page)
    page.button(key="compare_run").click().run()
    said = "Your own training with the paper preset comes first"
    assert said in texts(page)
    assert "The comparison then starts by itself." in texts(page)
    assert "Go to Train to stop it" in everything(page)


def test_earlier_runs_are_shown_without_a_comparison(found: Workspace) -> None:
    assert found.segment is not None
    fit = replace(least_squares.fit(found.segment), method="pinn", config=PAPER.to_json())
    found._remember([replace(fit, outcome=Outcome.STOPPED)])
    page = open_page(COMPARE, found)
    assert "Kept from earlier in this session: 1 fit." in texts(page)
    assert "PiNN (paper preset, stopped), " in texts(page)
    assert "synthetic_astazero_like.csv 0–60 s" in texts(page)
    assert "Differs now in" not in texts(page)
