"""The Compare page without a browser: rows, a stop, five starts, and the session's earlier runs."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from accpinn.errors import SegmentError
from accpinn.methods import least_squares
from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import FAST, PAPER
from accpinn.methods.registry import METHODS
from accpinn.recordings.recording import Window
from accpinn.results.messages.summary import outside_intervals
from accpinn.study.comparison import MethodFailure, MethodResult, compare, result_of
from accpinn.tasks.task import Status, Task
from pages.ui.session.recordings import FIRST_SAMPLE, sample
from pages.ui.session.resources import task_queue
from pages.ui.session.workspace import KEPT_RECORDS, Workspace
from tests.support.apptest import COMPARE, WAIT, open_page, with_sample

pytestmark = pytest.mark.usefixtures("fresh_server")


@pytest.fixture
def found(fresh_server: None) -> Workspace:
    made = with_sample()
    made.choose(window=Window(0.0, 60.0), vehicles=(1, 2))
    return made


def finished(found: Workspace, results: Sequence[MethodResult | MethodFailure]) -> None:
    """Give the session a comparison that has these results."""
    names = tuple(METHODS)[: len(results)]
    task = Task(found.id, "comparison", lambda context: iter(results), names)
    found.comparison = task_queue().submit(task)
    assert task.wait(WAIT)
    assert task.status is Status.DONE


def test_rows_pictures_warnings_starts_and_earlier_fits(
    found: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    methods = {key: METHODS[key] for key in ("maximum-likelihood", "least-squares", "splines")}
    monkeypatch.setattr("accpinn.tasks.task.METHODS", methods)
    page = open_page(COMPARE, found)
    page.button(key="compare_run").click().run()
    assert found.comparison.wait(WAIT)
    assert found.comparison.status is Status.DONE
    assert found.known_adequacy, "the forms of the model come with the methods"
    page = open_page(COMPARE, found)
    shown = page.everything()
    assert "Maximum likelihood (90 % interval)" in shown
    assert outside_intervals(found.compared, 0) in page.plain()
    assert len(page.figures()) == 1, "only the open tab is drawn"
    assert "Profile of the loss" in page.open_tab("compare_tabs", "Identifiability").plain()
    adequacy = page.open_tab("compare_tabs", "Model adequacy").plain()
    assert "the disturbance has a standard deviation of" in adequacy
    assert "Collides at" in page.open_tab("compare_tabs", "Methods").plain()
    page.choose("compare_method", "Splines")
    assert "Splines against the data" in page.everything()
    assert "Earlier fits" not in page.open_tab("compare_tabs", "Repeatability").everything()

    found.train_starts(replace(FAST, iterations=20))
    assert found.starts.wait(WAIT)
    assert "Spread" in open_page(COMPARE, found).everything()

    before = found.compared[0].fit
    found.choose(window=Window(10.0, 60.0))
    assert found.compared == ()
    assert found.starts is None
    assert [run.method for run in found.records] == list(methods)
    assert found.records[0].parameters.values[0] == pytest.approx(before.parameters.values[0])

    finished(found, tuple(compare(found.segment, "II", ("least-squares",))))
    page = open_page(COMPARE, found)
    assert "0–60 s → 10–60 s" in page.everything()
    page.open_tab("compare_tabs", "Summary")
    earlier = page.multiselect(key="compare_earlier")
    page.choose("compare_earlier", earlier.options[:1])
    assert "Rings: earlier fits." in page.everything()


@pytest.mark.parametrize("failing", [("splines", "particle"), tuple(METHODS)])
def test_methods_that_fail_are_named_and_the_others_shown(
    found: Workspace, failing: tuple[str, ...]
) -> None:
    fault = SegmentError("Too little is left of the window; choose a longer one.")
    row = result_of(found.segment, least_squares.fit(found.segment))
    results = [MethodFailure(name, fault) if name in failing else row for name in METHODS]
    finished(found, results)
    page = open_page(COMPARE, found)
    (failures,) = [box for box in page.boxes("warning") if box.startswith("No result from ")]
    who = "Splines, Particle filter" if len(failing) == 2 else "any method"
    assert failures == f"No result from {who}: {fault}"
    if len(failing) == 2:
        assert "Least squares" in page.open_tab("compare_tabs", "Methods").everything()
    assert len(found.compared) == len(METHODS) - len(failing)


def test_a_stop_keeps_the_rows_and_offers_to_run_again(found: Workspace) -> None:
    found.compare()
    task_queue().stop(found.comparison)
    assert found.comparison.wait(WAIT)
    assert found.comparison.status is Status.STOPPED
    page = open_page(COMPARE, found)
    assert "Stopped: no result" in page.plain()
    assert page.button(key="compare_run").label.startswith("Run all methods (about ")


def test_earlier_fits_are_bounded_and_shown_without_a_comparison(found: Workspace) -> None:
    fit = replace(least_squares.fit(found.segment), method="pinn", config=PAPER.to_json())
    for _ in range(2):
        found._record([replace(fit, outcome=Outcome.STOPPED)])
    assert len(found.records) == 1, "none is kept twice"
    said = open_page(COMPARE, found).plain()
    assert "Kept from earlier in this session: 1 fit." in said
    assert "PiNN (paper preset, stopped), " in said
    assert "synthetic_astazero_like.csv, 0–60 s" in said
    assert "Differs now in" not in said
    for seed in range(KEPT_RECORDS + 3):
        found._record([replace(fit, config={"seed": seed})])
    assert len(found.records) == KEPT_RECORDS
    assert found.records[-1].config == {"seed": KEPT_RECORDS + 2}
    found.open(*sample(FIRST_SAMPLE))
    assert len(found.records) == KEPT_RECORDS, "an early step does not drop them"


def test_a_training_with_other_settings_has_a_row_of_its_own(found: Workspace) -> None:
    found.comparison = Task(found.id, "comparison", lambda context: iter(()))
    least = compare(found.segment, "II", ("least-squares",))
    found.comparison.results = tuple(least)
    assert len(found.compared_with_training()) == 1
    found.train(replace(FAST, iterations=60))
    assert found.training.wait(WAIT)
    _, own = found.compared_with_training()
    assert own.fit is found.fit
    assert own.evaluation.holdout is None
    assert found.compared_with_training()[1] is own, "it is worked out once"
    found.comparison.results = (own,)
    assert found.compared_with_training() == (own,), "the same settings need no second row"
    found.training.results = (replace(own.fit, outcome=Outcome.STOPPED),)
    assert found.compared_with_training() == (own,), "an unfinished training is no result"


def test_a_comparison_names_one_s_own_training_that_it_waits_for(found: Workspace) -> None:
    found.train(PAPER)
    page = open_page(COMPARE, found)
    said = "Your own training with the paper preset comes first"
    assert said in page.plain()
    page.button(key="compare_run").click().run()
    assert said in page.plain()
    assert "The comparison then starts by itself." in page.plain()
    assert "Go to Train to stop it" in page.everything()
