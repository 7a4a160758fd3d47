"""The Compare page without a browser: rows, a stop, five starts, and the session's earlier runs."""

from collections.abc import Sequence
from dataclasses import replace

import pytest
from accpinn.inference.answer import Answer
from accpinn.inference.answer import answer as answer_of
from accpinn.results.messages.answer import time_gap_in_words

from accpinn import METHODS, Result, messages
from accpinn.errors import SegmentError
from accpinn.methods.estimate import Outcome
from accpinn.methods.pinn.config import CALIBRATED, FAST, PAPER
from accpinn.model.registry import BEST
from accpinn.recordings import Window, files
from accpinn.results.messages.summary import agreement
from accpinn.study.comparison import Refused, compare
from accpinn.study.judge import Judgement
from accpinn.tasks import Status, Task
from pages.ui.session.resources import store, task_queue
from pages.ui.session.workspace import KEPT_EARLIER, Workspace
from tests.support.apptest import WAIT, answer, open_page, stop_tasks, with_pair, with_sample
from tests.support.command import PLATOON

pytestmark = pytest.mark.usefixtures("fresh_server")


@pytest.fixture
def session(fresh_server: None) -> Workspace:
    return with_pair()


def finished(session: Workspace, results: Sequence[Result | Refused]) -> None:
    """Give the session a comparison that has these results."""
    names = tuple(METHODS)[: len(results)]
    task = Task(session.id, "comparison", lambda context: iter(results), names)
    session.comparison = task_queue().submit(task)
    assert task.wait(WAIT)
    assert task.status is Status.DONE


def headline(known: Answer) -> str:
    """What the page says first of the first follower."""
    gap = known.time_gap(known.stated_speed, 0)
    return time_gap_in_words(gap, known.stated_speed, known.level)


def test_before_a_training_the_answer_is_that_of_the_windows_it_would_take() -> None:
    session = with_sample()
    session.choose(vehicles=(1, 2))
    asked = session.training_analysis(CALIBRATED)
    assert len(asked.windows) > 1
    first = replace(asked, windows=asked.windows[:1])
    finished(session, [*compare(first, session.recording, ["least-squares"])])
    whole = answer_of(asked.segments(session.recording), asked.case, asked.model)
    assert headline(whole) in open_page("Compare", session).plain()


@pytest.mark.usefixtures("cthp_alone")
def test_rows_pictures_warnings_starts_and_earlier_fits(
    session: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    methods = {key: METHODS[key] for key in ("maximum-likelihood", "least-squares", "splines")}
    monkeypatch.setattr("accpinn.tasks.METHODS", methods)
    page = open_page("Compare", session)
    page.button(key="compare_run").click().run()
    assert session.comparison.wait(WAIT)
    assert session.comparison.status is Status.DONE
    assert session.adequacy(session.segment.info), "the forms of the model come with the methods"
    page = open_page("Compare", session)
    shown = page.everything()
    assert headline(session.compared[0].answer) in page.plain()
    assert "Maximum likelihood (90 % interval)" in shown
    assert agreement(session.compared, session.compared[0].answer) in page.plain()
    assert "Outside the window" in shown
    assert "Collides at" in page.plain()
    assert len(page.figures()) == 1, "only the open tab is drawn"
    assert "Profile of the loss" in page.open_tab("compare_tabs", "Identifiability").plain()
    adequacy = page.open_tab("compare_tabs", "Model adequacy").plain()
    assert "the disturbance has a standard deviation of" in adequacy
    page.open_tab("compare_tabs", "Curves")
    page.choose("compare_method", "Splines")
    assert "Splines against the data" in page.everything()
    assert "Earlier fits" not in page.open_tab("compare_tabs", "Repeatability").everything()

    session.train_starts(replace(FAST, iterations=20))
    assert session.starts.wait(WAIT)
    assert len({row.analysis.fit_key for row in session.starts.results}) == 5
    assert session.runs == (), "they are no results of their own"
    assert "Spread" in open_page("Compare", session).everything()

    before = session.compared[0]
    session.choose(window=Window(10.0, 60.0))
    assert session.compared == ()
    assert session.starts is None
    assert {row.analysis.method for row in session.earlier} == {*methods}
    assert session.earlier[0].parameters == before.parameters

    finished(
        session,
        tuple(compare(session.analysis(session.config), session.recording, ("least-squares",))),
    )
    page = open_page("Compare", session)
    assert "0–60 s → 10–60 s" in page.everything()
    page.open_tab("compare_tabs", "Summary")
    earlier = page.multiselect(key="compare_earlier")
    page.choose("compare_earlier", earlier.options[:1])
    assert "Rings: earlier fits." in page.everything()


def test_methods_that_fail_are_named_and_the_others_shown(session: Workspace) -> None:
    fault = SegmentError("Too little is left of the window; choose a longer one.")
    row, asked, failing = answer(session), session.analysis(session.config), ("splines", "particle")
    finished(session, [
        Refused(asked.with_method(name), fault) if name in failing else row for name in METHODS
    ])  # fmt: skip
    page = open_page("Compare", session)
    (failures,) = [box for box in page.boxes("warning") if box.startswith("No result from ")]
    assert failures == f"No result from Splines, Particle filter: {fault}"
    assert "Least squares" in page.open_tab("compare_tabs", "Curves").everything()
    assert len(session.compared) == len(METHODS) - len(failing)


def test_which_model_this_car_follows(session: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    page = open_page("Compare", session).choose("compare_view", "models")
    assert page.button(key="models_run").label.startswith("Judge 4 models (about ")
    page.choose("models_chosen", ["cthp", "cthp-s0"]).press("models_run")
    assert session.judgement.wait(WAIT)
    assert session.judgement.status is Status.DONE
    (judged,) = session.judgement.result
    page = open_page("Compare", session)
    said = messages(judged.findings, judged.info)
    assert all(sentence in page.plain() for sentence in said)
    assert "CTHP with intercept s₀" in page.everything()
    assert len(page.figures()) == 2
    page.choose(f"models_speed_{judged.info.vehicles[1]}", 90.0)
    assert "At 90 km/h" in page.everything()

    result = answer(session)
    open_page("Compare", session)
    assert store().find(result.analysis).parts.judgements, "a result is kept with it"
    session.restore(session.as_snapshot())
    assert session.judgement is None
    page = open_page("Compare", session).choose("compare_view", "models")
    assert all(sentence in page.plain() for sentence in said), "it comes back with a result"

    assert "models_take" not in page.buttons, "one is hardly better than the other"
    monkeypatch.setattr(Judgement, "is_clear", True)
    session.settings[session.preset] = {"width": -1}
    assert "not allowed" in page.run().press("models_take").boxes("error")[0]
    assert (session.training, session.asked.model) == (None, BEST), "nothing changed"
    session.settings.clear()
    page.press("models_take")
    assert session.training.analysis.model == judged.ranked[0].model.key
    session.judge_models(["cthp"])
    session.choose(vehicles=(2, 3))
    assert session.judgement is None, "it was of other vehicles"


def test_earlier_fits_are_bounded_and_shown_without_a_comparison(session: Workspace) -> None:
    result = replace(answer(session, outcome=Outcome.STOPPED), analysis=session.analysis(PAPER))
    result = replace(result, fits=(replace(result.fit, method="pinn", config=PAPER.to_json()),))
    for _ in range(2):
        session._record([result])
    assert len(session.earlier) == 1, "none is kept twice"
    session.training = None
    said = open_page("Compare", session).plain()
    assert "Kept from earlier in this session: 1 fit." in said
    assert "PiNN (paper preset, stopped), " in said
    for seed in range(KEPT_EARLIER + 3):
        session._record([replace(result, analysis=session.analysis(replace(PAPER, seed=seed)))])
    assert len(session.earlier) == KEPT_EARLIER
    session.open(files.read(PLATOON))
    assert len(session.earlier) == KEPT_EARLIER, "an early step does not drop them"


def test_a_training_with_other_settings_has_a_row_of_its_own(session: Workspace) -> None:
    session.comparison = Task(session.id, "comparison", lambda context: iter(()))
    session.comparison.results = tuple(
        compare(session.analysis(session.config), session.recording, ("least-squares",))
    )
    assert len(session.compared_with_training()) == 1
    session.train(replace(FAST, iterations=60))
    assert session.training.wait(WAIT)
    _, own = session.compared_with_training()
    assert own is session.result
    assert own.evaluation.holdout is None
    session.comparison.results = (own,)
    assert session.compared_with_training() == (own,), "the same settings need no second row"
    stopped = replace(own, fits=(replace(own.fit, outcome=Outcome.STOPPED),))
    session.training.results = (stopped,)
    assert session.compared_with_training() == (own,), "an unfinished training is no result"


def test_a_comparison_names_one_s_own_training_that_it_waits_for(session: Workspace) -> None:
    session.train(PAPER)
    page = open_page("Compare", session)
    said = "Your own training with the paper preset comes first"
    assert said in page.plain()
    page.button(key="compare_run").click().run()
    assert said in page.plain()
    assert "The comparison then starts by itself." in page.plain()
    assert "monitor_stop_training" in page.buttons
    stop_tasks(session)
    assert "Stopped: no result" in open_page("Compare", session).plain()
