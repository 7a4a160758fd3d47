"""The Compare page without a browser: rows, a stop, five starts, and the session's earlier runs."""

import re
from collections.abc import Sequence
from dataclasses import replace

import pytest

from accpinn import Result
from accpinn.errors import SegmentError
from accpinn.methods.estimate import Outcome
from accpinn.methods.registry import COMPARED, variant_of
from accpinn.recordings import Window
from accpinn.results.messages.summary import agreement, best_models
from accpinn.results.tables.estimates import compared_table
from accpinn.study.comparison import Refused, compare
from accpinn.tasks import Status, Task
from pages.ui.components.parameter_picker import cars_of, of_several
from pages.ui.session.resources import store, task_queue
from pages.ui.session.workspace import MOST_EARLIER, Workspace
from tests.support.apptest import (
    MINUTE,
    WAIT,
    Page,
    open_page,
    sample_recording,
    stop_tasks,
    train_at_once,
    with_pair,
    with_sample,
)

pytestmark = pytest.mark.usefixtures("fresh_server")


@pytest.fixture
def session(fresh_server: None) -> Workspace:
    return with_pair()


def finished(session: Workspace, results: Sequence[Result | Refused]) -> None:
    """Give the session a comparison that has these results."""
    names = COMPARED[: len(results)]
    task = Task(session.id, "comparison", lambda context: iter(results), names)
    session.comparison = task_queue().submit(task)
    assert task.wait(WAIT)
    assert task.status is Status.DONE


@pytest.mark.usefixtures("cthp_alone")
def test_the_recommended_estimate_comes_first_and_all_are_of_all_windows() -> None:
    session = with_sample()
    session.choose(vehicles=(1, 2))
    assert len(session.windows) > 1
    asked = session.analysis()
    finished(session, [*compare(asked, session.recording, ["least-squares", "pinn"])])
    assert [row.analysis.method for row in session.compared] == ["pinn", "least-squares"]
    recommended, least_squares = session.compared
    assert recommended.posterior
    assert least_squares.analysis.windows == asked.windows
    page = open_page("Compare", session)
    assert agreement(session.compared, recommended)[0] in page.plain()
    table = compared_table(session.compared, 0, recommended)
    assert page.shows(table, len(table.rows))
    for windows, count in ((asked.windows, 2), (asked.windows[:1], 0)):
        session.preset, session.window_starts = "fast", tuple(w.start for w in windows)
        train_at_once(session)
        assert len(session.as_snapshot().compared) == count, "those of the result's own data"


@pytest.mark.usefixtures("cthp_alone")
def test_rows_pictures_warnings_starts_and_earlier_estimates(
    session: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    methods = ("pinn", "least-squares", "splines")
    monkeypatch.setattr("accpinn.tasks.COMPARED", methods)
    page = open_page("Compare", session)
    page.button(key="compare_run").click().run()
    assert session.comparison.wait(WAIT)
    assert session.comparison.status is Status.DONE
    page = open_page("Compare", session)
    shown = page.everything()
    assert "Inside the interval" in shown
    assert len(page.figures()) == 1, "only the open tab is drawn"
    errors = page.open_tab("compare_tabs", "Errors")
    assert "Outside the windows" in errors.everything()
    assert "Collides at" in errors.plain()
    assert "Joint distribution" in page.open_tab("compare_tabs", "Identifiability").plain()
    adequacy = page.open_tab("compare_tabs", "Model adequacy").plain()
    assert "the disturbance has a standard deviation of" in adequacy
    page.open_tab("compare_tabs", "Curves")
    page.choose("compare_method", "Splines")
    assert "Splines against the data" in page.everything()
    assert "Earlier estimates" not in page.open_tab("compare_tabs", "Repeatability").everything()

    session.settings["fast"] = {"iterations": 20}
    session.train_restarts("fast")
    assert session.restarts.wait(WAIT)
    assert len({row.analysis.key for row in session.restarts.results}) == 5
    assert session.runs == (), "they are no results of their own"
    assert "Spread" in open_page("Compare", session).everything()

    before = session.compared[0]
    session.choose(window=Window(10.0, 60.0))
    assert session.compared == ()
    assert session.restarts is None
    assert {row.analysis.method for row in session.earlier} == {*methods}
    assert before.analysis.key in [row.analysis.key for row in session.earlier]

    finished(
        session,
        tuple(compare(session.analysis(), session.recording, ("least-squares",))),
    )
    page = open_page("Compare", session)
    assert "0–60 s → 10–60 s" in page.everything()
    page.open_tab("compare_tabs", "Numbers")
    earlier = page.multiselect(key="compare_earlier")
    page.choose("compare_earlier", earlier.options[:1])
    assert "Open diamonds: earlier estimates." in page.plain()


def test_methods_that_fail_are_named_and_the_others_shown(session: Workspace) -> None:
    fault = SegmentError("Too little is left of the window; choose a longer one.")
    row, asked, failing = train_at_once(session), session.analysis(), ("splines", "particle")
    finished(session, [
        Refused(asked.with_method(*variant_of(name)), fault)
        if name in failing
        else replace(row, analysis=asked.with_method(*variant_of(name)))
        for name in COMPARED
    ])  # fmt: skip
    page = open_page("Compare", session)
    (failures,) = [box for box in page.boxes("warning") if box.startswith("No result from ")]
    assert failures == f"No result from Splines, Particle filter: {fault}"
    assert len(session.compared) == len(COMPARED) - len(failing)


def test_which_model_predicts_this_car(session: Workspace) -> None:
    page = open_page("Compare", session).choose("compare_view", "models")
    assert page.button(key="models_run").label.startswith("Compare 5 models (about ")
    page.choose("models_chosen", ["cthp", "cthp-s0"]).press("models_run")
    assert session.judgement.wait(WAIT)
    assert session.judgement.status is Status.DONE
    (judged,) = session.judgement.result
    page = open_page("Compare", session)
    said = best_models([judged])
    assert said in page.plain()
    assert "CTHP with intercept s₀" in page.everything()
    assert len(page.figures()) == 1
    page.open_tab("models_tabs", "Peak over speed")
    assert len(page.figures()) == 2
    page.open_tab("models_tabs", "Numbers").choose(
        f"models_speed_{judged.info.vehicles[1]}", 90.0
    )  # fmt: skip
    assert "At 90 km/h" in page.everything()

    result = train_at_once(session)
    open_page("Compare", session)
    assert store().find(result.analysis).judgements, "a result is kept with it"
    session.restore(session.as_snapshot())
    assert session.judgement is None
    page = open_page("Compare", session).choose("compare_view", "models")
    assert said in page.plain(), "it comes back with a result"


def test_each_car_has_the_model_that_was_chosen_for_it_and_all_make_one_platoon() -> None:
    session = with_sample()
    session.choose(window=MINUTE, vehicles=(1, 2, 3))
    session.judge_models(["cthp", "cthp-s0"])
    assert session.judgement.wait(WAIT)
    page = open_page("Compare", session).choose("compare_view", "models")
    judged = session.judgement.result
    numbers = [one.info.vehicles[1] for one in judged]
    assert [page.widget(f"models_of_{n}").value for n in numbers] == [
        one.ranked[0].key for one in judged
    ], "the best predicted is offered first"
    page.choose("models_of_2", "cthp").choose("models_of_3", "cthp-s0")
    page.press("models_use")
    assert all(task.wait(WAIT) for task in session.cars.values())
    page.run()
    models = {number: own.estimate.model for number, own in session.own_results.items()}
    assert models == {2: "cthp", 3: "cthp-s0"}, "also without a result of all cars"
    assert session.result is None
    assert session.parameter_source == "several"
    for title in ("Stability", "Platoon"):
        page = open_page(title, session)
        assert not page.boxes("error")
        assert {"2", "3"} <= {label.split()[0] for label in _labels(page)}
    # A car whose model the result of all has stays as it is there.
    result = train_at_once(session)
    kept = session.cars[2 if result.estimate.model != "cthp" else 3]
    session.use_models({2: result.estimate.model, 3: "cthp"})
    assert 2 not in session.cars
    assert session.cars[3] is not kept
    assert session.cars[3].wait(WAIT)
    shown = of_several(cars_of(session))
    assert [own for own, _ in shown.cars] == [result, session.own_results[3]]
    session.use_models({2: result.estimate.model, 3: result.estimate.model})
    assert (session.cars, session.parameter_source) == ({}, "estimate")
    session.choose(vehicles=(2, 3))
    assert session.judgement is None, "it was of other vehicles"


def _labels(page: Page) -> list[str]:
    """The vehicles of the strip on a page."""
    return re.findall(r'class="strip-name" title="([^"]+)"', page.texts())


def test_earlier_estimates_are_bounded_and_shown_without_a_comparison(session: Workspace) -> None:
    session.preset, session.settings["paper"] = "paper", {"iterations": 20}
    result = train_at_once(session, outcome=Outcome.STOPPED)
    for _ in range(2):
        session._record([result])
    assert len(session.earlier) == 1, "none is kept twice"
    session.training = None
    said = open_page("Compare", session).plain()
    assert "Kept from earlier in this session: 1 estimate." in said
    assert "PiNN (paper preset, own options, stopped), " in said
    for seed in range(MOST_EARLIER + 3):
        session.settings["paper"] = {"seed": seed}
        session._record([replace(result, analysis=session.analysis())])
    assert len(session.earlier) == MOST_EARLIER
    session.open(sample_recording())
    assert len(session.earlier) == MOST_EARLIER, "an early step does not drop them"


def test_a_training_with_other_settings_has_a_row_of_its_own(session: Workspace) -> None:
    session.comparison = Task(session.id, "comparison", lambda context: iter(()))
    rows = compare(session.analysis(), session.recording, ("least-squares",))
    session.comparison.results = tuple(rows)
    assert len(session.compared_with_training()) == 1
    session.preset, session.settings["fast"] = "fast", {"iterations": 60}
    session.train()
    assert session.training.wait(WAIT)
    _, own = session.compared_with_training()
    assert own is session.result
    assert own.evaluation.holdout is None
    session.comparison.results = (own,)
    assert session.compared_with_training() == (own,), "the same settings need no second row"
    stopped = replace(own, estimate=replace(own.estimate, outcome=Outcome.STOPPED))
    session.training.results = (stopped,)
    assert session.compared_with_training() == (own,), "an unfinished training is no result"


def test_a_comparison_names_one_s_own_training_that_it_waits_for(session: Workspace) -> None:
    session.preset = "paper"
    session.train()
    page = open_page("Compare", session)
    said = "Your own training comes first"
    assert said in page.plain()
    page.button(key="compare_run").click().run()
    assert said in page.plain()
    assert "The comparison then starts by itself." in page.plain()
    assert "monitor_stop_training" in page.buttons
    stop_tasks(session)
    assert "Stopped: no result" in open_page("Compare", session).plain()
