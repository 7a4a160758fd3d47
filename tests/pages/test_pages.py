"""Every page, and Home, Data and Train in full, without a browser: each step, and what can fail."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.methods.fit import Continued, Outcome
from accpinn.methods.pinn.config import CALIBRATED, FAST, preset
from accpinn.methods.registry import METHODS
from accpinn.model import registry
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.published import ASTAZERO_ALIKE
from accpinn.model.registry import BEST
from accpinn.recordings.recording import Recording, Window
from accpinn.results.messages.summary import conditional
from accpinn.results.reproduction import ASTAZERO_RUN, CASALE_RUN, PrintedRun
from accpinn.results.tables import supported_digits
from accpinn.results.tables.answer import answer_table, own_windows_table
from accpinn.tasks import Status, training_task
from pages.ui.components.parameter_picker import EXAMPLE
from pages.ui.components.show import bullets, escape_markdown, format_duration
from pages.ui.data.page import window_of
from pages.ui.data.sources import OPENING, find_run
from pages.ui.home import runs_of
from pages.ui.platoon import PANELS, TABS
from pages.ui.session import sessions
from pages.ui.session.resources import (
    FIRST_SAMPLE,
    SAMPLES,
    sample,
    store,
    task_queue,
    windows_in_car_following,
)
from pages.ui.session.workspace import ALL_WINDOWS, MODEL, Workspace
from tests.support.apptest import (
    COMPARE,
    DATA,
    HOME,
    PAGES,
    PLATOON,
    STABILITY,
    TRAIN,
    WAIT,
    WIDGETS,
    Page,
    answer,
    fitted,
    open_page,
    with_pair,
    with_sample,
)
from tests.support.openacc_files import csv, metadata, platoon, recording
from tests.support.snapshots import whole

pytestmark = pytest.mark.usefixtures("fresh_server")


PAIR = csv(platoon(vehicles=2), metadata(("A", "B")))


def with_recording(run: Recording) -> Workspace:
    session = sessions.workspaces().new()
    session.open(run)
    return session


def labels(page: Page) -> list[str]:
    return [b.label for b in page.button]


# Every page


@pytest.mark.parametrize("path", PAGES)
def test_a_link_to_an_unknown_session_says_so_and_shows_a_next_step(path: str) -> None:
    page = open_page(path, session="long-forgotten")
    assert "no longer on this server" in page.texts()
    assert page.query_params["session"] != "long-forgotten"
    assert page.button or page.get("page_link"), "there must be a way on"
    assert not page.error
    assert "**Continue**" not in page.texts()
    page.run()
    assert "no longer on this server" not in page.texts()


@pytest.mark.parametrize("path", PAGES)
def test_with_a_result_drawn_again_and_with_a_window_that_cannot_be_used(path: str) -> None:
    session = fitted()
    page = open_page(path, session)
    assert not page.error
    shown = [one.id for kind in WIDGETS for one in page.get(kind)]
    page.run()
    assert [one.id for kind in WIDGETS for one in page.get(kind)] == shown, "no new widgets"
    assert shown or path == HOME
    if path == HOME:
        assert "**Continue**" in page.texts()
        assert "vehicles 2–5" in page.texts()
    session.choose(window=Window(395.0, 399.0))
    assert session.fault
    page.sound()
    if path in (DATA, TRAIN, COMPARE):
        assert escape_markdown(session.fault) in page.texts()


def test_one_click_on_home_trains_a_sample() -> None:
    session = open_page(HOME).press("Train a sample now").workspace()
    asked, (recording, truth) = session.training.analysis, sample(FIRST_SAMPLE)
    windows = windows_in_car_following(recording, session.vehicles) or (session.window,)
    assert (asked.config, asked.windows) == (CALIBRATED, windows)
    assert session.true_parameters == truth.parameters
    stop_training(session)
    assert "**Training** was stopped" in open_page(HOME, session).texts()


def test_a_file_dropped_on_home_leads_to_data() -> None:
    page = open_page(HOME)
    page.upload("bad.csv", b"nothing")
    (error,) = page.error
    assert "bad" in error.value
    page.upload("mine.csv", PAIR)
    assert page.workspace().recording.source == "mine.csv"
    assert "Preview of the window" in page.texts(), "this is page Data"


def test_published_parameters_and_the_papers_items_from_home() -> None:
    page = open_page(HOME).open_tab("home_tabs", "Published parameters")
    session = page.workspace()
    page.press(f"home_{ASTAZERO_ALIKE.title}_Stability")
    assert session.choices[EXAMPLE] == ASTAZERO_ALIKE.title
    page = open_page(HOME, session).open_tab("home_tabs", "Reproduce the paper")
    assert "14 of 14 printed verdicts agree" in page.texts()
    assert page.button(key="home_TableI_run").disabled, "no such recording is at hand"
    page.press("home_TableI_starts")
    assert len(session.segment.vehicles) == 2
    assert session.starts.wait(WAIT)
    found = [start.parameters.alpha[0] for start in session.starts.results]
    assert found == pytest.approx([0.08] * 5, rel=0.02)
    shown = open_page(COMPARE, session).open_tab("compare_tabs", "Repeatability").plain()
    assert "All 5 trainings end within" in shown
    page = open_page(HOME, session).open_tab("home_tabs", "Reproduce the paper")
    page.press("home_Figure8_panels")
    assert session.choices[TABS] == PANELS


def test_a_run_of_the_paper_is_opened_with_its_window(
    monkeypatch: pytest.MonkeyPatch, openacc_dir: Path
) -> None:
    monkeypatch.setenv("ACCPINN_RECORDINGS", str(openacc_dir))
    page = open_page(HOME).open_tab("home_tabs", "Reproduce the paper")
    session = page.press("home_TableII_run").workspace()
    assert (session.window, session.case) == (Window(320.0, 620.0), "I")
    assert session.recording.source == "ASta_040719_platoon5.csv"
    answer(session, "I")
    page = open_page(HOME, session).open_tab("home_tabs", "Reproduce the paper")
    assert "Learned here" not in page.texts(), "Table III is not of Case I"
    assert len([box for box in page.caption if "deviation at most α " in box.value]) == 1
    page.choose("home_printed", ASTAZERO_ALIKE.title)
    assert "Learned here" in page.texts()


def test_a_file_of_another_campaign_is_no_run_of_the_paper(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    campaigns = {"JRC low speed": False, "Casale": True}
    for campaign, is_run in campaigns.items():
        session = with_recording(
            replace(recording(platoon(samples=4000)), source="part7.csv", campaign=campaign)
        )
        session.choose(CASALE_RUN.vehicles, CASALE_RUN.window)
        answer(session)
        assert bool(runs_of(session, CASALE_RUN)) is is_run
        assert not runs_of(session, replace(CASALE_RUN, vehicles=(2, 3))), "of other vehicles"
        assert (find_run(session, "Casale", "part7.csv") is not None) is is_run
        monkeypatch.setenv("ACCPINN_RECORDINGS", str(tmp_path))
        place = tmp_path / campaign / "part7.csv"
        place.parent.mkdir()
        place.touch()
        load = find_run(sessions.workspaces().new(), "Casale", "part7.csv")
        assert (load is not None) is is_run


# Data


@pytest.mark.parametrize("run", [CASALE_RUN, ASTAZERO_RUN])
def test_the_papers_window_is_offered_for_its_recording_recognised_by_content(
    openacc_dir: Path, run: PrintedRun
) -> None:
    content = (openacc_dir / run.campaign / run.file).read_bytes()
    page = open_page(DATA).upload(run.file, content)
    session = page.workspace()
    session.choose(vehicles=session.vehicles[:2], window=Window(100.0, 200.0))
    page.sound().press("data_papers")
    assert (session.vehicles, session.window) == (run.vehicles, run.window)
    session.choices[ALL_WINDOWS] = True
    assert session.several_windows
    page.sound().press("data_papers")
    assert not session.several_windows
    assert page.button(key="data_papers").disabled
    page = open_page(DATA).upload("part7.csv", csv(platoon()))
    assert page.workspace().recording.source == "part7.csv"
    assert "data_papers" not in {button.key for button in page.button}, "another's content"


def test_a_sample_is_opened_its_window_moved_by_slider_field_and_suggestion_and_trained() -> None:
    page = open_page(DATA).press("Open this sample")
    session, before = page.workspace(), page.texts()
    session.preset = "fast"
    for said in ("synthetic\\_astazero\\_like\\.csv", "5 vehicles", "Least squares",
                 "Tesla (Model3-like)"):  # fmt: skip
        assert said in before
    (overview,) = page.figures()
    assert overview["layout"]["shapes"][0]["x1"] == 300.0
    assert page.slider(key="data_ends").value == (0.0, 300.0)
    page.open_tab("data_tabs", "Regimes")
    page.choose("data_sensitivity", True)
    assert "so there is nothing to compare" in page.texts(), "no regime occurs in it"
    page.open_tab("data_tabs", "Changes to the data")
    assert "None: every sample" in page.texts()
    page.open_tab("data_tabs", "Window")

    for key, value, window in (
        ("data_ends", (50.0, 250.0), Window(50.0, 250.0)),
        ("data_start", 30.0, Window(30.0, 230.0)),
        ("data_ends", (60.0, 200.0), Window(60.0, 200.0)),
        ("data_length", 100.0, Window(60.0, 160.0)),
        ("data_ends", (50.0, 55.0), Window(60.0, 160.0)),  # too short for a window
    ):
        page.choose(key, value)
        assert session.window == window
    assert page.texts() != before
    page.press("data_suggested")
    assert session.window == Window(30.0, 330.0)
    assert page.figures()[0]["layout"]["shapes"][0]["x0"] == 30.0
    assert "best excitation" in page.texts()
    assert page.button(key="data_suggested").disabled
    page.choose("data_view", "relative")
    names = [trace["name"] for trace in page.figures()[0]["data"][:4]]
    assert names == list(session.segment.labels[1:])

    session.choose(vehicles=(1, 2))
    page.press("data_train")
    assert session.training is not None
    page = open_page(DATA, session).choose("data_start", 20.0)
    assert session.training is None, "an early step drops what came after"
    page.choose("data_length", 5.0)
    assert "too short" in page.texts()
    assert page.button(key="data_train").disabled


def test_regimes_are_left_out_when_ticked_and_said_everywhere() -> None:
    time = np.arange(400)
    run = recording(names="AB")
    gap = np.where((time < 100)[:, None], 60.0, run.gap)
    session = with_recording(replace(run, gap=gap))
    page = open_page(DATA, session)
    assert session.segment.mask is None
    assert "Without" not in page.texts()
    page.open_tab("data_tabs", "Regimes")
    page.choose("data_exclude_catching up", True)
    assert session.segment.mask[:, 0].tolist() == (time >= 100).tolist()
    page.open_tab("data_tabs", "Changes to the data")
    assert "(2 B: 25 % of the instants)" in page.plain()
    page.open_tab("data_tabs", "Window")
    for said in ("**Without** catching up", "s, without catching up",
                 "all other figures are of all instants"):  # fmt: skip
        assert said in page.plain()
    page.open_tab("data_tabs", "Regimes")
    for path in (TRAIN, COMPARE):
        assert "without catching up" in open_page(path, session).texts()
    page.choose("data_sensitivity", True)
    assert "Without catching up" in page.texts()
    page.choose("data_exclude_catching up", False)
    assert session.segment.mask is None


def test_human_drivers_are_no_acc_before_and_after_training() -> None:
    run = recording()
    session = with_recording(replace(run, mode=np.tile(np.int8([0, 1, 0]), (run.samples, 1))))
    hand = session.segment.driven_by_hand
    assert (hand.vehicles, hand.shares, hand.by_flag) == ((3,), (1.0,), False)
    for path in (DATA, TRAIN, STABILITY):
        page = open_page(path, session)
        if path != STABILITY:
            assert any("not ACC" in error for error in page.boxes("error"))
        if path == DATA:
            marks = [one.proto.popover.label for one in page.get("popover")]
            assert any("red" in label and "Driven by hand" in label for label in marks)
            assert any("blue" in label and "Samples complete" in label for label in marks)
            answer(session)
        elif path == STABILITY:
            assert "not by ACC: 3 C" in page.plain()
        if path != DATA:
            assert "<td>Human</td>" in page.texts(), "the table carries it"
    session.choose(window=Window(0.0, 30.0), excluded=())
    assert session.segment.driven_by_hand
    by_flag = replace(run, mode=np.full_like(run.mode, -1), acc_flag=0)
    assert with_recording(by_flag).segment.driven_by_hand.by_flag


def test_vehicles_and_case_are_chosen_and_the_button_names_what_it_trains() -> None:
    session = with_sample()
    session.preset = "paper"
    page = open_page(DATA, session)
    page.segmented_control(key="data_case").set_value("I").run()
    assert session.case == "I"
    lasts = [METHODS["pinn"].expected_seconds(session.segment, preset(p))
             for p in ("fast", "paper")]  # fmt: skip
    duration = format_duration(lasts[1])
    label = page.button(key="data_train").label
    assert all(part in label for part in ("paper preset", "Case I", duration))
    assert lasts[0] < 5 < 600 < lasts[1]
    leader = page.selectbox[0]
    assert leader.label == "Leader"
    leader.set_value(3).run()
    assert session.vehicles == (3, 4, 5)
    page.selectbox[1].set_value(4).run()
    assert session.vehicles == (3, 4)
    assert not any(box.key == "data_case" for box in page.segmented_control)
    assert session.true_parameters.alpha.tolist() == [0.0766]
    session.choose(case="I")
    session.open(*sample(SAMPLES / "synthetic_vicolungo_like.csv"))
    assert session.case == "II", "a new recording has the default"


def test_a_bad_upload_is_one_sentence_and_loses_nothing_and_a_good_one_is_opened() -> None:
    session = with_sample()
    page = open_page(DATA, session)
    before = session.recording, session.segment
    assert not page.get("file_uploader")
    page.session_state[OPENING] = True
    page.run()
    page.upload("bad.csv", b"\x89PNG not a run")
    (error,) = page.error
    assert "this is a PNG image, not a CSV file" in error.value.replace("\\", "")
    assert (session.recording, session.segment) == before
    assert "Preview of the window" in page.texts()
    page.upload("mine.csv", PAIR)
    assert "mine\\.csv" in page.texts()
    assert "Case" not in [control.label for control in page.segmented_control], "M = 1 has no cases"
    page.switch_page(HOME).run()
    assert "**Continue**" in page.texts(), "Home stays open"


def test_the_folder_on_the_server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    page = open_page(DATA)
    assert "ACCPINN_RECORDINGS" in page.texts()
    root = tmp_path / "runs"
    (root / "deep").mkdir(parents=True)
    (root / "deep" / "run.csv").write_bytes(PAIR)
    (tmp_path / "secret.csv").write_text("secret")
    (root / "link.csv").symlink_to(tmp_path / "secret.csv")
    monkeypatch.setenv("ACCPINN_RECORDINGS", str(root))
    page.run()
    assert page.selectbox(key="data_file").options == ["deep/run.csv"]
    assert "Open this recording" not in labels(page), "none is chosen unasked: it may be damaged"
    page.choose("data_file", root / "deep" / "run.csv")
    assert "run\\.csv" in page.press("Open this recording").texts()


def test_learned_parameters_are_validated_on_a_window_beside_theirs() -> None:
    session = fitted(Window(0.0, 200.0))
    page = open_page(DATA, session).open_tab("data_tabs", "Validation")
    assert "Validation: error" not in page.texts()
    page.press("data_validate")
    assert session.validation.window == Window(200.0, 400.0)
    assert "Validation: error" in page.texts()
    assert not page.warning
    page.choose(next(n.key for n in page.number_input if "start" in n.key and n.value), 100.0)
    page.press("data_validate")
    assert any("shares 100 s" in said for said in page.boxes("warning"))
    page.file_uploader(key="data_validation_upload").upload("b.csv", PAIR, "text/csv").run()
    assert "has no platoon with 3 followers" in page.plain()
    assert session.recording.source == FIRST_SAMPLE.name, "the first one stays open"


def test_the_length_that_is_shown_rounded_is_accepted() -> None:
    session = with_sample()
    end = session.recording.duration
    arrays = ("time", "speed", "gap", "mode")
    shorter = {name: getattr(session.recording, name)[:-1] for name in arrays}
    session.open(replace(session.recording, **shorter))
    page = open_page(DATA, session)
    assert page.number_input(key="data_length").max == end
    page.choose("data_length", end)
    assert session.segment.window.duration == pytest.approx(end - 0.1)


def test_dragging_over_the_chart() -> None:
    assert window_of({"selection": {"box": []}}, recording()) is None
    for ends, expected in (
        ((10.04, 30.06), Window(10.0, 30.1)),
        ((30.06, 10.04), Window(10.0, 30.1)),
        ((-20.0, 500.0), Window(0.0, 39.9)),
        ((10.0, 12.0), None),
    ):
        assert window_of({"selection": {"box": [{"x": [*ends]}]}}, recording()) == expected


def test_the_first_window_avoids_holes() -> None:
    frame = platoon(samples=4000)
    frame.loc[500:599, ["Speed2", "IVS1", "IVS2"]] = np.nan
    session = with_recording(recording(frame))
    assert session.window == Window(60.0, 360.0)
    assert session.segment is not None


# Train


def test_train_shows_table_curves_and_downloads_and_keeps_the_result() -> None:
    session = with_sample()
    session.choose(window=Window(0.0, 60.0), vehicles=(1, 2, 3))
    session.preset = "fast"
    page = open_page(TRAIN, session)
    for cached in (False, True):
        page.press("Start training")
        assert session.training.wait(WAIT)
        page.sound()
        assert ("From the cache" in page.texts()) == cached
        assert session.result.analysis.fit_key in store().session(session.id).decode()
    for said in ("Converged", "Surrogate fit, MAE", "Closed-loop simulation, MAE"):
        assert said in page.texts()
    assert len(page.figures()) == 1
    page.open_tab("train_tabs", "Comparison")
    assert "0.0612" in page.texts(), "the truth of the first follower"
    assert conditional(None, session.segment) in page.plain()
    assert len(page.open_tab("train_tabs", "Training").figures()) == 5
    assert len(page.open_tab("train_tabs", "Export").get("download_button")) == 4
    page.open_tab("train_tabs", "Fit")
    assert "Start training" in labels(page)
    assert "Stop training" not in labels(page)
    page.choose("train_follower", page.widget("train_follower").options[1])
    assert page.figures()[0]["layout"]["uirevision"] == "tracking-3"
    assert "90 % band" in [trace["name"] for trace in page.figures()[0]["data"]]


def test_train_opens_with_the_answer_and_labels_the_papers_estimates() -> None:
    session = fitted()
    result = session.result
    assert result
    answered = result.answer
    page = open_page(TRAIN, session)
    shown, speed = page.plain(), answered.stated_speed
    for k, label in enumerate(result.info.labels[1:]):
        span = answered.time_gap(speed, k)
        digits = supported_digits(span.lower, span.upper, 2)
        said = f"{label} keeps {span.value:.{digits}f} s at {speed * 3.6:.0f} km/h"
        assert f"{said} ({span.lower:.{digits}f}–{span.upper:.{digits}f})." in shown
        assert answered.trust[k].in_words in shown
    table = answer_table(result.info, answered)
    (drawn,) = [e.proto.body for e in page.get("html") if "Further window" in e.proto.body]
    for column, cells in zip(table.columns, zip(*table.rows, strict=True), strict=True):
        assert all(str(column.html(cell)) in drawn for cell in cells)
    assert shown.index(" km/h (") < shown.index("The CTHP's parameters by Least squares")
    assert "biased if disturbances last" not in shown.partition("The CTHP's parameters")[2]

    alone = page.open_tab("train_tabs", "Windows").texts()
    assert "each window alone" in alone
    table = own_windows_table(result.infos, answered, 0)
    for column, cell in zip(table.columns, table.rows[0], strict=True):
        assert str(column.html(cell)) in alone

    answer(session, method="pinn", config=FAST.to_json())
    shown = page.open_tab("train_tabs", "Fit").plain()
    assert "PiNN (fast preset): **the paper's estimate, biased if disturbances last**" in shown


def test_a_training_of_another_model_shows_its_own_parameters() -> None:
    session = with_pair()
    session.choices[MODEL], session.preset = "idm", "fast"
    session.settings["fast"] = {"iterations": 20}
    page = open_page(TRAIN, session)
    page.press("Start training")
    assert session.training.wait(WAIT)
    page.sound()
    assert session.result.fit.model == "idm"
    shown = page.plain()
    assert "IDM's parameters by PiNN" in shown
    assert "the paper's estimate" not in shown.partition("IDM's parameters")[2]
    figures = page.open_tab("train_tabs", "Training").figures()
    titles = [figure["layout"]["yaxis"]["title"]["text"] for figure in figures]
    assert titles[-5:] == [f"{p.symbol} [{p.unit}]" for p in registry.FOLLOWING["idm"].parameters]


@pytest.mark.parametrize("outcome", [Outcome.STOPPED, Outcome.DIVERGED])
def test_an_unfinished_training_has_neither_intervals_nor_probabilities(outcome: Outcome) -> None:
    page = open_page(TRAIN, fitted(outcome=outcome))
    shown = page.plain()
    assert "s at 100 km/h (" in shown, "the answer does not depend on the training"
    assert "they have no intervals or probabilities" in shown
    assert "Probability of string stability" not in shown
    assert "Estimate (90 % interval)" not in shown


@pytest.mark.parametrize(
    ("parameters", "excluded"),
    [(Parameters(0.01, 0.02, 0.2), ("catching up",)), (Parameters(0.0001, 0.3, 26.3), ())],
    ids=["vehicles collide", "no time headway"],
)
def test_train_says_what_goes_wrong_and_how_sure_it_is(
    parameters: Parameters, excluded: tuple[str, ...]
) -> None:
    session = with_pair()
    if excluded:
        mask = np.ones_like(session.segment.gaps, dtype=bool)
        mask[:50] = False
        session.segment = replace(session.segment, mask=mask, excluded_regimes=excluded)
    segment = session.segment
    own = Trajectories(segment.time, segment.speeds, segment.gaps)
    same = Parameters.stack([parameters] * segment.followers)
    answer(session, parameters=same, surrogate=own)
    page = open_page(TRAIN, session)
    written, collide = page.plain(), parameters.tau < 1
    said = f"{segment.labels[1]} collides with the vehicle ahead at" in written
    assert said == collide
    assert ("errors include what follows" in written) == collide
    assert ("does not determine the time headway" in written) == (not collide)
    assert "90 % interval" in written
    marks = [trace for trace in page.figures()[-1]["data"] if trace["name"] == "collision"]
    assert len(marks) == collide
    titles = written.count(f"s, without {''.join(excluded)}")
    assert titles == len(excluded), "of the estimates"


def stop_training(session: Workspace) -> None:
    """As the button does, and wait for it."""
    session.training.stop()
    assert session.training.wait(WAIT)


def test_stop_continue_or_begin_anew() -> None:
    session = with_pair()
    page = open_page(TRAIN, session)
    page.segmented_control(key="train_preset").set_value("paper").run()
    page.press("Start training")
    assert "Stop training" in labels(page)
    assert "Start training" not in labels(page)
    job = session.training
    while not (job.progress and job.progress.iteration):
        assert job.is_active
        job.wait(0.05)
    page.press("Stop training")
    assert job.wait(WAIT)
    assert job.status is Status.STOPPED
    at = job.result.fit.iterations
    other = open_page(TRAIN, with_pair())
    other.segmented_control(key="train_preset").set_value("paper").run()
    for one in (page.run(), other):
        assert f"Continue from iteration {at:,}" in labels(one), "another session goes on there too"
        assert "Start training" not in labels(one)
    page.press(f"Continue from iteration {at:,}")
    assert session.training is not job
    assert "Stop training" in labels(page)
    while not (session.training.progress and session.training.progress.iteration > at):
        assert not session.training.wait(0.01)
    iterations = session.training.history().iteration
    assert iterations[0] == 0, "of the whole training"
    assert (np.diff(iterations) > 0).all()
    stop_training(session)
    assert session.result.fit.iterations > at
    assert session.runs == (), "none is finished"
    page.run()
    page.press("Start anew")
    while session.training.progress is None:
        session.training.wait(0.05)
    first = session.training.history()
    assert first.iteration[0] == 0
    stop_training(session)
    assert not any(isinstance(f, Continued) for f in session.result.fit.findings)


def test_a_second_session_waits_and_is_told() -> None:
    first, second = with_pair(), with_pair()
    first.train(preset("paper"))
    other = open_page(TRAIN, second).press("Start training")
    assert "yours is next" in other.texts()
    assert second.training is not None
    assert "Stopped before it began" in other.press("Stop training").texts()


def test_options_are_refused_reach_the_training_and_survive_a_visit_elsewhere() -> None:
    session = with_pair()
    session.preset = "fast"
    page = open_page(TRAIN, session).choose("train_options", True)
    page.choose("train_fast_iterations", 0)
    (error,) = page.error
    assert "iterations: 0 is not allowed" in error.value.replace("\\", "")
    assert page.button(key="train_start").disabled
    behind = page._tree.get_widget_states()
    page.press("Back to the preset")
    page._run(behind)  # the browser still shows the old value at the next click, and reports it
    assert not page.error
    assert page.widget("train_fast_iterations").value == FAST.iterations
    assert not page.button(key="train_start").disabled
    page.choose("train_fast_iterations", 0)
    assert page.error, "which can be chosen again"
    page.press("Back to the preset")
    page.choose("train_fast_seed", 7)
    page.choose("train_fast_weight_data_1", 2.0)
    page.choose("train_fast_start", (0.5, 0.5, 0.5))
    page = open_page(TRAIN, session).choose("train_options", True)  # as after a reload
    assert page.number_input(key="train_fast_seed").value == 7
    page.press("Start training")
    config = session.training.analysis.config
    assert (config.seed, config.weight_data) == (7, (1.0, 2.0))
    assert config.initial.values.tolist() == [0.5, 0.5, 0.5]


def test_calibrated_shows_no_initial_values_as_it_uses_none() -> None:
    session = with_sample()
    page = open_page(TRAIN, session).choose("train_options", True)
    keys = [str(field.key) for field in page.number_input]
    assert "train_calibrated_highest_frequency" in keys
    assert not [key for key in keys if "initial" in key or "weight" in key], "without effect"
    fast = page.choose("train_preset", "fast")
    assert "train_fast_initial_0" in [field.key for field in fast.number_input]


def test_the_answers_model_is_chosen_among_the_options_and_kept() -> None:
    session = with_pair()
    session.preset, session.settings["fast"] = "fast", {"iterations": 20}
    assert session.analysis().model == BEST
    page = open_page(TRAIN, session).choose("train_options", True).choose(MODEL, "cthp-s0")
    page.press("Start training")
    assert session.training.wait(WAIT)
    result = session.result
    assert result.analysis.model == result.parts.answer.model == "cthp-s0", "computed already"
    page = open_page(TRAIN, session)
    assert f"Answer: {registry.TITLES['cthp-s0']}, one window" in page.texts()
    other = sessions.workspaces().new()
    other.restore(result)
    assert other.analysis().model == "cthp-s0"


def test_an_answer_by_another_model_needs_no_second_training_and_holds_at_a_speed() -> None:
    session = with_pair()
    assert session.preset == "calibrated", "which estimates a CTHP whatever the answer's model"
    open_page(TRAIN, session).press("Start training")
    assert session.training.wait(WAIT)
    weights = session.result.fit.arrays
    open_page(TRAIN, session).choose("train_options", True).choose(MODEL, "idm")
    open_page(TRAIN, session).press("Start training")
    assert session.training.wait(WAIT)
    result = session.result
    assert result.parts.answer.model == "idm"
    assert result.fit.cached
    assert all((result.fit.arrays[name] == values).all() for name, values in weights.items())
    assert "Answer: IDM, one window" in open_page(TRAIN, session).plain()
    page = open_page(STABILITY, session)
    before = page.plain()
    page.choose("stability_speed", 40.0)
    assert page.plain() != before
    assert "linearised at the vehicle's median speed" in before
    open_page(PLATOON, session)
    open_page(COMPARE, session)


def test_all_windows_in_car_following_are_trained_on_when_ticked() -> None:
    session = with_pair()
    page = open_page(DATA, session).choose(ALL_WINDOWS, True)
    windows = session.several_windows
    assert len(windows) > 1
    assert f"Train on {len(windows)} windows" in page.button(key="data_train").label
    asked = session.training_analysis(CALIBRATED)
    assert asked.windows == windows
    assert session.training_analysis(FAST).windows == (session.window,)

    task = training_task(session.id, asked, session.recording, store())
    session.training = task_queue().submit(task)
    assert task.wait(WAIT)
    assert task.status is Status.DONE, task.error
    shown = open_page(TRAIN, session).plain()
    assert f"Answer: {registry.TITLES[BEST]}, {len(windows)} windows" in shown
    seconds = sum(window.duration for window in windows)
    assert f"{len(windows)} windows, {seconds:g} s together" in shown
    other = sessions.workspaces().new()
    other.restore(session.result)
    assert other.choices[ALL_WINDOWS]


# What the pages stand on


def test_foreign_text_is_made_literal_and_durations_are_words() -> None:
    escaped = r"a\*b\_\[c\]\(d\) \$x\$ \:red\[e\] \<i\>"
    assert escape_markdown("a*b_[c](d) $x$ :red[e] <i>") == escaped
    assert bullets(("one.",)) == r"one\."
    assert bullets(("one", "two")) == "- one\n- two"
    seconds = (0.2, 59.4, 60, 200, 2706, 3900)
    words = ["1 s", "59 s", "1 min", "3 min 20 s", "45 min", "1 h 5 min"]
    assert [*map(format_duration, seconds)] == words


def test_another_window_ends_a_training_and_forgets_choices_among_the_former_vehicles() -> None:
    session = with_sample()
    session.train(preset("paper", iterations=20_000))
    job, chosen = session.training, session.choices
    chosen |= {"platoon_own": "1-4", "platoon_frequency": 0.3, "stability_held": 3}
    session.choose(window=Window(10.0, 200.0), vehicles=(1, 2))
    assert chosen == {"data_all_windows": False}, "a window chosen by hand is the one that counts"
    assert job.wait(WAIT)
    assert job.status is Status.STOPPED, "nobody could stop it any more"
    session.choose_source("published")
    chosen["platoon_own"] = "1-4"
    session.choose(vehicles=(1, 2, 3))
    assert chosen["platoon_own"] == "1-4", "the published parameters stay the same"


def test_what_is_chosen_already_changes_nothing_and_changes_are_undone_with_their_result() -> None:
    session = fitted()
    result, recording = session.result, session.recording
    session.choose(window=Window(0.0, 60.0), vehicles=(2, 3, 4, 5))
    session.open(*sample(FIRST_SAMPLE))
    assert (session.result, session.recording) == (result, recording)
    page = open_page(DATA, session).choose("data_start", 100.0)
    assert (session.window, session.result) == (Window(100.0, 160.0), None)
    page.press("data_undo")
    assert (session.window, session.result) == (Window(0.0, 60.0), result)
    assert session.vehicles == (2, 3, 4, 5)
    for _ in range(len(session.steps)):
        page.press("data_undo")
    assert page.button(key="data_undo").disabled


def test_a_change_in_another_recording_is_not_undone_in_a_result_of_this_one() -> None:
    session = with_sample()
    session.choose(vehicles=(4, 5))
    assert session.steps
    session.restore(whole())
    assert session.steps == ()
    assert session.vehicles == (1, 2, 3, 4, 5), "as the recording was opened"


def test_the_finished_training_stays_while_a_second_one_runs() -> None:
    session = fitted()
    result = session.result
    session.preset = "paper"
    page = open_page(TRAIN, session).press("train_start")
    assert session.training.is_active
    assert session.result is result
    assert "it stays until the training that runs has a result" in page.plain()
    assert "Answer: " in page.everything()
    stop_training(session)


def test_the_computer_s_sessions_and_runs_are_found_from_the_bare_address(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    session = fitted()
    open_page(TRAIN, session)
    page = open_page(HOME)
    assert page.workspace() is not session
    named = escape_markdown(FIRST_SAMPLE.name)
    (link,) = (one.proto for one in page.get("page_link") if named in one.proto.label)
    assert f"session={session.id}" in link.query_string
    (run,) = session.runs
    page.press(f"home_runs_open_{run.id}")
    assert page.workspace().result.parameters == session.result.parameters
    monkeypatch.setattr(sessions, "is_shared", lambda: True)
    page = open_page(HOME)
    assert FIRST_SAMPLE.name not in page.everything(), "others' are nobody else's"


def test_a_fault_of_the_program_is_one_sentence_and_what_was_open_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    session = fitted()
    page = open_page(DATA, session)
    with monkeypatch.context() as broken:
        broken.setattr("pages.ui.data.views.show_window", lambda *_: 1 / 0)
        page.run()
    assert [fault.value for fault in page.exception] == ["division by zero"], "the log has it"
    assert "what was open stays open" in page.boxes("error")[0]
    assert page.workspace() is session
    assert session.result is not None
    page.sound()


def test_after_a_fault_of_a_widget_s_callback_the_page_says_so_once_and_shows_what_was_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    session = fitted()
    page = open_page(TRAIN, session)
    shown = [written.value for written in (*page.title, *page.markdown, *page.caption)]
    with monkeypatch.context() as broken:
        broken.setattr(Workspace, "train", lambda *_: 1 / 0)
        page.press("train_start")
    assert "what was open stays open" in page.boxes("error")[0]
    assert page.workspace() is session
    assert shown == [written.value for written in (*page.title, *page.markdown, *page.caption)]
    assert not page.sound().error
