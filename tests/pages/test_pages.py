"""Every page, and Home, Data and Train in full, without a browser: each step, and what can fail."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import accpinn
from accpinn import METHODS, Parameters, Recording, preset
from accpinn.findings import capital
from accpinn.methods import TaskContext
from accpinn.methods.estimate import Outcome, Progress
from accpinn.methods.findings import Continued
from accpinn.methods.forecast import INTERVALS
from accpinn.methods.pinn.config import CALIBRATED, FAST
from accpinn.model import registry
from accpinn.model.published import ASTAZERO_ALIKE
from accpinn.recordings import Window, files
from accpinn.recordings.synthetic import load_truth, truth_path
from accpinn.results.figures.training import SIMULATION
from accpinn.results.glossary import MEANINGS
from accpinn.results.messages.estimate import about_truth, cards
from accpinn.results.naming import PAPERS_POINT
from accpinn.results.recording import recording_table
from accpinn.results.reproduction import CASALE_RUN, ITEMS, PANELS, learned_line, reproduction_table
from accpinn.results.tables.estimates import parameter_table, windows_table
from accpinn.results.tables.next_drive import drive_table
from accpinn.study.run import run
from accpinn.tasks import Status, Task
from pages.ui.components.monitor import monitor, progress_parts
from pages.ui.components.parameter_picker import EXAMPLE
from pages.ui.components.show import bullets, escape_markdown, format_duration
from pages.ui.data.page import window_of
from pages.ui.data.sources import OPENING, find_run
from pages.ui.reproduction import runs_of
from pages.ui.session import resources, sessions, users
from pages.ui.session.resources import (
    FIRST_SAMPLE,
    SAMPLES,
    library,
    store,
    windows_in_car_following,
)
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.page import suggested_name
from tests.support.apptest import (
    MINUTE,
    PAGES,
    WAIT,
    WIDGETS,
    fitted,
    numbers,
    open_page,
    read,
    sample_recording,
    stop_tasks,
    train_at_once,
    until,
    with_pair,
    with_sample,
)
from tests.support.command import PLATOON
from tests.support.openacc_files import csv, metadata, platoon, recording
from tests.support.samples import frame

pytestmark = pytest.mark.usefixtures("fresh_server")


PAIR = csv(platoon(vehicles=2), metadata(("A", "B")))
HOSTILE = (
    "long-forgotten", "../../etc/passwd", "a" * 5000, "\x00", "/etc/passwd", "é" * 30, "\u202e",
    "%s%n\x1b[31m", "<script>",
)  # fmt: skip
"""Names of sessions, as many as pages."""


def with_recording(run: Recording) -> Workspace:
    session = sessions.workspaces().new()
    session.open(run)
    return session


# Every page


@pytest.mark.parametrize(("title", "name"), [*zip(PAGES, HOSTILE, strict=True)])
def test_a_link_to_an_unknown_session_says_so_shows_a_next_step_and_makes_no_file(
    title: str, name: str, tmp_path: Path
) -> None:
    before = {*tmp_path.rglob("*")}
    page = open_page(title, session=name)
    assert "no longer kept" in page.texts()
    assert page.workspace().id != name
    assert page.button or page.get("page_link"), "there must be a way on"
    assert not page.error
    assert "**Recording**" not in page.texts()
    assert {*tmp_path.rglob("*")} - before <= {store().folder}
    page.run()
    assert "no longer kept" not in page.texts()


@pytest.mark.parametrize("title", PAGES)
def test_with_a_result_drawn_again_and_with_a_window_that_cannot_be_used(title: str) -> None:
    session = fitted()
    page = open_page(title, session)
    assert not page.error
    shown = [one.id for kind in WIDGETS for one in page.get(kind)]
    page.run()
    assert [one.id for kind in WIDGETS for one in page.get(kind)] == shown, "no new widgets"
    assert shown or title == "Home"
    if title == "Home":
        assert "**Recording**" in page.texts()
        assert "vehicles 2–5" in page.texts()
    session.choose(window=Window(395.0, 399.0))
    assert session.fault
    page.sound()
    if title in ("Data", "Train", "Compare"):
        assert escape_markdown(session.fault) in page.texts()


def test_one_click_on_home_trains_a_sample() -> None:
    session = open_page("Home").press("Train a sample now").workspace()
    asked, recording = session.training.analysis, files.read(FIRST_SAMPLE)
    selection = session.selection
    windows = windows_in_car_following(recording, selection.vehicles) or (selection.window,)
    assert (asked.config, asked.windows) == (CALIBRATED, windows)
    assert session.true_parameters == load_truth(truth_path(FIRST_SAMPLE)).parameters
    stop_tasks(session)
    assert "**Training** was stopped" in open_page("Home", session).texts()


def test_published_parameters_and_the_papers_items_from_home() -> None:
    page = open_page("Home").open_tab("home_tabs", "Published parameters")
    session = page.workspace()
    page.press(f"home_{ASTAZERO_ALIKE.title}_Stability")
    assert session.choices[EXAMPLE] == ASTAZERO_ALIKE.title
    glossary = open_page("Home").press("frame_glossary").plain()
    assert all(read(escape_markdown(meaning)) in glossary for meaning in MEANINGS.values())
    page = open_page("Reproduce", session).open_tab("paper_tabs", "One at a time")
    assert page.button(key="paper_TableI_run").disabled, "no such recording is at hand"
    page.press("paper_TableI_starts")
    assert len(session.segment.vehicles) == 2
    assert session.restarts.wait(WAIT)
    found = [start.parameters.alpha[0] for start in session.restarts.results]
    assert found == pytest.approx([0.08] * 5, rel=0.02)
    shown = open_page("Compare", session).open_tab("compare_tabs", "Repeatability").plain()
    assert "All 5 trainings end within" in shown
    page = open_page("Reproduce", session).open_tab("paper_tabs", "One at a time")
    page.press("paper_Figure8_a")
    assert session.parameter_source == "published"
    platoon = open_page("Platoon", session)
    assert platoon.widget("platoon_sinusoid_frequency").value == PANELS[0].frequency
    assert "grows to 4.23 times" in platoon.plain()


@pytest.mark.parametrize("title", ["Table I", "Table II", "Table III"])
def test_a_table_of_the_paper_takes_two_clicks(
    title: str, monkeypatch: pytest.MonkeyPatch, openacc_dir: Path
) -> None:
    monkeypatch.setenv("ACCPINN_RECORDINGS", str(openacc_dir))
    (item,) = (item for item in ITEMS if item.title == title)
    run, printed = item.run, item.verdicts[0]
    session = open_page("Home").press(f"home_{title.replace(' ', '')}").workspace()
    assert (session.windows, session.selection.vehicles) == (run.windows, run.vehicles)
    assert (session.selection.case, session.preset, session.spec.model) == (
        run.case,
        "fast",
        "cthp",
    )
    page = open_page("Train", session).press("Start training")
    assert session.training.wait(WAIT)
    learned = session.result.parameters
    rows = learned[: len(printed.vehicles) if len(learned) >= len(printed.vehicles) else 1]
    table = reproduction_table(printed, rows)
    assert page.sound().shows(table, len(table.rows))
    assert learned_line(printed, rows) in page.plain()
    page = open_page("Reproduce", session)
    assert item.compared(rows).deviation in page.plain()
    page.choose("paper_printed", printed.vehicles.title)
    assert page.shows(table, len(table.rows))
    session.choose(window=Window(0.0, 60.0))
    assert open_page("Data", session).press(f"data_{title.replace(' ', '')}")
    assert session.windows == run.windows


def test_a_file_of_another_campaign_is_no_run_of_the_paper(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ACCPINN_RECORDINGS", str(tmp_path))
    run = replace(recording(frame(3001), "AB"), source="part7.csv")
    for campaign, is_run in (("JRC low speed", False), ("Casale", True)):
        session = with_recording(replace(run, campaign=campaign))
        session.choose(*CASALE_RUN.windows, vehicles=CASALE_RUN.vehicles)
        session.preset = "fast"
        train_at_once(session)
        assert bool(runs_of(session, CASALE_RUN)) is is_run
        assert not runs_of(session, replace(CASALE_RUN, vehicles=(2, 3))), "of other vehicles"
        place = tmp_path / campaign / "part7.csv"
        place.parent.mkdir()
        place.touch()
        for asks in (session, sessions.workspaces().new()):  # open there, and in the folder
            assert (find_run(asks, "Casale", "part7.csv") is not None) is is_run


# Data


def test_the_papers_window_is_offered_for_its_recording_recognised_by_content(
    openacc_dir: Path,
) -> None:
    content = (openacc_dir / CASALE_RUN.campaign / CASALE_RUN.file).read_bytes()
    page = open_page("Data").upload(CASALE_RUN.file, content)
    session = page.workspace()
    session.choose(window=Window(100.0, 200.0))
    session.window_starts = None
    assert session.several_windows
    page.sound().press("data_TableI")
    assert (session.selection.vehicles, session.windows) == (
        CASALE_RUN.vehicles,
        CASALE_RUN.windows,
    )
    assert session.preset == "fast"
    page = open_page("Data").upload("part7.csv", csv(platoon()))
    assert "data_TableI" not in page.buttons, "another's content"


def test_a_sample_is_opened_its_window_moved_by_slider_field_and_suggestion_and_trained() -> None:
    page = open_page("Data").choose("data_sample", PLATOON).press("Open this sample")
    session = page.workspace()
    assert len(page.widget("data_windows_on").value) == len(session.several_windows) > 1
    before = page.choose("data_which", "one").texts()
    session.preset = "fast"
    assert "Tesla (Model3-like)" in before
    (overview,) = page.figures()
    assert overview["layout"]["shapes"][0]["x1"] == 300.0
    assert page.slider(key="data_ends").value == (0.0, 300.0)
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
        assert session.selection.window == window
    assert page.texts() != before
    page.press("data_suggested")
    assert session.selection.window == Window(30.0, 330.0)
    assert page.figures()[0]["layout"]["shapes"][0]["x0"] == 30.0
    assert page.button(key="data_suggested").disabled
    page.choose("data_view", "relative")
    names = [trace["name"] for trace in page.figures()[0]["data"][:4]]
    assert names == list(session.segment.labels[1:])

    session.choose(vehicles=(1, 2))
    page.press("data_train")
    assert session.training is not None
    page = open_page("Data", session).choose("data_start", 20.0)
    assert session.training is None, "an early step drops what came after"
    page.choose("data_length", 5.0)
    assert "too short" in page.texts()
    assert page.button(key="data_train").disabled


def test_regimes_are_left_out_when_ticked_and_said_everywhere() -> None:
    time = np.arange(400)
    run = recording(names="AB")
    gap = np.where((time < 100)[:, None], 60.0, run.gap)
    session = with_recording(replace(run, gap=gap))
    page = open_page("Data", session)
    assert session.segment.mask is None
    assert "Without" not in page.texts()
    page.open_tab("data_tabs", "Regimes")
    page.choose("data_exclude_catching up", True)
    assert session.segment.mask[:, 0].tolist() == (time >= 100).tolist()
    page.open_tab("data_tabs", "Changes to the data")
    assert "(2 B: 25 % of the instants)" in page.plain()
    for title in ("Train", "Compare"):
        assert "without catching up" in open_page(title, session).texts()
    page.open_tab("data_tabs", "Regimes")
    page.choose("data_exclude_catching up", False)
    assert session.segment.mask is None


def test_human_drivers_are_no_acc_before_and_after_training() -> None:
    run = recording()
    session = with_recording(replace(run, mode=np.tile(np.int8([0, 1, 0]), (run.samples, 1))))
    hand = session.segment.driven_by_hand
    assert (hand.vehicles, hand.shares, hand.by_flag) == ((3,), (1.0,), False)
    for title in ("Data", "Train"):
        assert any("not ACC" in error for error in open_page(title, session).boxes("error"))
    page = open_page("Data", session).open_tab("data_tabs", "About the recording")
    assert page.shows(recording_table(session.recording), 3)
    session.choose(vehicles=(2, 3))
    session.preset = "fast"
    train_at_once(session)
    session.choices["train_tabs"] = "Errors"
    for title in ("Train", "Stability"):
        assert ">Human</td>" in open_page(title, session).texts(), "the table carries it"
    session.choose(window=Window(0.0, 30.0))
    assert session.segment.driven_by_hand
    by_flag = replace(run, mode=np.full_like(run.mode, -1), acc_flag=0)
    assert with_recording(by_flag).segment.driven_by_hand.by_flag


def test_vehicles_and_case_are_chosen_and_the_button_names_what_it_trains() -> None:
    session = with_sample()
    session.preset = "paper"
    page = open_page("Data", session)
    page.segmented_control(key="data_case").set_value("I").run()
    assert session.selection.case == "I"
    lasts = METHODS["pinn"].expected_seconds(session.segments, preset("paper"))
    label = page.button(key="data_train").label
    assert all(part in label for part in ("Paper", "Case I", format_duration(lasts)))
    leader, last, *_ = page.selectbox
    leader.set_value(3).run()
    assert session.selection.vehicles == (3, 4, 5)
    last.set_value(4).run()
    assert session.selection.vehicles == (3, 4)
    assert not any(box.key == "data_case" for box in page.segmented_control)
    assert session.true_parameters.alpha.tolist() == [0.0766]
    session.choose(case="I")
    session.open(sample_recording(SAMPLES / "synthetic_vicolungo_like.csv"))
    assert session.selection.case == "II", "a new recording has the default"


def test_a_bad_upload_is_one_sentence_and_loses_nothing_and_a_good_one_is_opened() -> None:
    session = with_sample()
    page = open_page("Data", session)
    before = session.recording, session.segment
    assert not page.get("file_uploader")
    page.session_state[OPENING] = True
    page.run()
    page.upload("bad.csv", b"\x89PNG not a run")
    (error,) = page.error
    assert "this is a PNG image, not a CSV file" in error.value.replace("\\", "")
    assert "The recording opened before is kept" in page.plain()
    assert (session.recording, session.segment) == before
    assert page.widget("data_windows_on")
    page.upload("mine.csv", PAIR)
    assert "mine\\.csv" in page.texts()
    assert "Case" not in [control.label for control in page.segmented_control], "M = 1 has no cases"
    page.switch_page(PAGES["Home"]).run()
    assert "**Recording**" in page.texts(), "Home stays open"


def test_several_files_of_one_drop_are_all_open_and_the_first_is_shown() -> None:
    page, other = open_page("Home"), csv(platoon(vehicles=3), metadata(("A", "B", "C")))
    for name, content in (("a.csv", PAIR), ("b.csv", other), ("c.csv", b"x")):
        page.file_uploader(key="data_upload").upload(name, content, "text/csv")
    session = page.sound().workspace()
    assert session.recording.source == "a.csv"
    assert {one.source for one in session.opened.values()} == {"a.csv", "b.csv"}
    page = open_page("Data", session)
    page.session_state[OPENING] = True
    (key,) = (key for key in page.sound().buttons if key.startswith("data_opened_"))
    page.press(key)
    assert session.recording.source == "b.csv"


def test_a_refused_click_is_said_once_and_on_its_own_page_only() -> None:
    page = open_page("Data").upload("bad.csv", bytes(range(256)))
    assert len(page.sound().boxes("error")) == 1
    page.switch_page("pages/2_Train.py")
    assert not page.sound().boxes("error")


def test_the_folder_on_the_server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    page = open_page("Data")
    assert "ACCPINN_RECORDINGS" in page.texts()
    root = tmp_path / "runs"
    (root / "deep").mkdir(parents=True)
    (root / "deep" / "run.csv").write_bytes(PAIR)
    (tmp_path / "secret.csv").write_text("secret")
    (root / "link.csv").symlink_to(tmp_path / "secret.csv")
    monkeypatch.setenv("ACCPINN_RECORDINGS", str(root))
    page.run()
    assert page.selectbox(key="data_file").options == ["deep/run.csv"]
    shown = [button.label for button in page.button]
    assert "Open this recording" not in shown, "none is chosen unasked: it may be damaged"
    page.choose("data_file", root / "deep" / "run.csv")
    assert "run\\.csv" in page.press("Open this recording").texts()


def test_learned_parameters_are_validated_on_a_window_beside_theirs() -> None:
    session = fitted(Window(0.0, 200.0))
    page = open_page("Train", session).open_tab("train_tabs", "Validation")
    assert "a window that was not trained on" in page.plain()
    page = open_page("Data", session).open_tab("data_tabs", "Validation")
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
    assert session.recording.source == PLATOON.name, "the first one stays open"


def test_windows_that_were_switched_off_stay_so_where_their_result_is_shown_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    every = (Window(0.0, 100.0), Window(100.0, 200.0), Window(200.0, 300.0))
    monkeypatch.setattr(resources, "windows_in_car_following", lambda *_: every)
    session = with_sample()
    assert session.several_windows == every
    session.take(replace(session.analysis(), windows=every[1:]))
    assert session.several_windows == every[1:]
    session.choose(vehicles=(1, 2))
    assert session.several_windows == every, "other vehicles have other windows"


def test_of_several_windows_one_alone_is_named_and_keeps_its_truth() -> None:
    session = with_sample()
    first, second = session.several_windows
    session.window_starts = (second.start,)
    page = open_page("Data", session)
    assert page.widget("data_windows_on").value == [second.start]
    assert f"Train on {second} (" in next(b.label for b in page.button if b.key == "data_train")
    page = open_page("Train", session).press("Start training")
    assert session.training.wait(WAIT)
    said = page.sound().plain()
    assert f"{session.recording.source} · {second}" in said
    assert str(first) not in said
    assert "True values: made with" in said
    assert suggested_name(session).endswith(str(second))


def test_of_several_windows_all_are_shown_and_what_belongs_to_one_is_hidden() -> None:
    session = with_sample()
    page = open_page("Data", session)
    first, second = session.several_windows
    written = page.texts()
    assert all(str(window).removesuffix(" s") in written for window in (first, second))
    numbers = {box.key for box in page.number_input}
    assert not any(key and key.startswith(("data_start", "data_length")) for key in numbers)
    bands = page.figures()[0]["layout"]
    assert [band["x1"] for band in bands["shapes"]] == [first.end, second.end]
    assert bands["dragmode"] is False, "a slip of the hand changes nothing"
    page.choose("data_windows_on", [second.start])
    assert session.several_windows == (second,)
    page.choose("data_windows_on", [])
    assert session.several_windows == (second,), "the last one stays"
    page.choose("data_windows_on", [first.start, second.start])
    assert session.window_starts is None
    page.choose("data_which", "one")
    assert (session.several_windows, session.windows) == ((), (first,))
    assert page.widget("data_start").value == first.start


def test_a_window_that_is_switched_off_serves_for_validation() -> None:
    session = with_sample()
    assert len(session.several_windows) == 2
    page = open_page("Data", session).open_tab("data_tabs", "Validation")
    assert "data_validate" not in {button.key for button in page.button}, "nothing is left"
    session.window_starts = (session.several_windows[1].start,)
    page = open_page("Data", session).open_tab("data_tabs", "Validation")
    page.press("data_validate")
    assert session.validation.window.end <= 300.0


def test_the_length_that_is_shown_rounded_is_accepted() -> None:
    session = with_sample()
    end = session.recording.duration
    arrays = ("time", "speed", "gap", "mode")
    shorter = {name: getattr(session.recording, name)[:-1] for name in arrays}
    session.open(replace(session.recording, **shorter))
    page = open_page("Data", session).choose("data_which", "one")
    assert page.number_input(key="data_length").max == end
    page.choose("data_length", end)
    assert session.segment.window.duration == pytest.approx(end - 0.1)


def test_dragging_over_the_chart() -> None:
    for ends, expected in (
        ((10.04, 30.06), Window(10.0, 30.1)),
        ((30.06, 10.04), Window(10.0, 30.1)),
        ((-20.0, 500.0), Window(0.0, 39.9)),
        ((10.0, 12.0), None),
    ):
        assert window_of(ends, recording()) == expected
    whole = window_of((10, 30), recording())
    assert [*map(type, (whole.start, whole.end))] == [float, float], "as a browser sends them"


def test_the_first_window_avoids_holes() -> None:
    frame = platoon(samples=4000)
    frame.loc[500:599, ["Speed2", "IVS1", "IVS2"]] = np.nan
    session = with_recording(recording(frame))
    assert session.selection.window == Window(60.0, 360.0)
    assert session.segment is not None


# Train


def test_train_shows_table_curves_and_downloads_and_keeps_the_result() -> None:
    session = with_sample()
    session.choose(window=Window(0.0, 60.0), vehicles=(1, 2, 3))
    session.preset = "fast"
    page = open_page("Train", session)
    for cached in (False, True):
        page.press("Start training")
        assert session.training.wait(WAIT)
        page.open_tab("train_tabs", "Errors")
        assert ("From the cache" in page.texts()) == cached
        assert session.result.analysis.key in store().session(session.key).decode()
    for said in ("Converged", "Surrogate fit, MAE", "Closed-loop simulation, MAE"):
        assert said in page.texts()
    page.open_tab("train_tabs", "Numbers")
    assert about_truth(session.true_parameters, session.result.estimate) in page.plain()
    assert len(page.figures()) == 1
    assert len(page.open_tab("train_tabs", "Training").figures()) == 3
    assert len(page.open_tab("train_tabs", "Export").get("download_button")) == 4
    assert "train_start" in page.buttons
    assert "train_stop" not in page.buttons
    page.choose("train_follower", page.widget("train_follower").options[1])
    assert page.figures()[0]["layout"]["uirevision"] == "tracking-3"


def test_train_shows_one_estimate_whichever_preset_it_is_of() -> None:
    session = fitted()
    result = session.result
    page = open_page("Train", session)
    shown = page.plain()
    said = cards(result, together=True)
    assert all(card.lead in shown for card in said)
    table = parameter_table(result)
    assert page.shows(table, len(table.rows))
    assert "90 % band" in [trace["name"] for trace in page.figures()[0]["data"]]
    page.open_tab("train_tabs", "Windows")
    assert page.shows(windows_table(result, 0))

    session.preset = "fast"
    collides = Parameters.stack([Parameters(0.01, 0.02, 0.2)] * 3)
    result = train_at_once(session, parameters=collides)
    page = open_page("Train", session).open_tab("train_tabs", "Numbers")
    shown, table = page.plain(), parameter_table(result)
    assert page.shows(table, len(table.rows))
    assert capital(PAPERS_POINT) in shown
    assert "% interval" not in shown, "a point has none"
    assert "robability" not in shown
    said = page.open_tab("train_tabs", "Errors").plain()
    assert f"{result.info.labels[1]} collides with the vehicle ahead at" in said


def test_recommended_estimates_a_nonlinear_model_by_simulation_and_says_so() -> None:
    session = with_pair()
    page = open_page("Train", session)
    assert "PiNN, calibrated" in page.plain()
    page.choose("train_model", "idm")
    assert "Closed-loop simulation" in page.plain()
    assert page.toggle(key="train_options").disabled, "it has no settings"
    page.press("Start training")
    assert session.training.wait(WAIT)
    result = session.result
    assert (result.estimate.method, result.estimate.model) == ("simulation", "idm")
    assert result.posterior
    table = parameter_table(result)
    assert page.sound().shows(table, len(table.rows))
    page = open_page("Stability", session)
    before = page.plain()
    assert page.choose("stability_speed", 40.0).plain() != before
    for title in ("Platoon", "Compare"):
        open_page(title, session)
    other = sessions.workspaces().new()
    other.restore(result)
    assert other.analysis().spec.model == "idm"
    page = open_page("Train", session).choose("train_preset", "fast")
    assert session.spec.model == "cthp", "each preset has a model of its own"
    assert session.result is result


def test_a_training_of_another_model_shows_its_own_parameters() -> None:
    session = with_pair()
    session.preset = "fast"
    session.choose_model("idm")
    session.settings["fast"] = {"iterations": 20}
    page = open_page("Train", session)
    page.press("Start training")
    assert session.training.wait(WAIT)
    page.sound()
    assert session.result.estimate.model == "idm"
    assert capital(PAPERS_POINT) not in page.plain(), "it is not the paper's"
    layout = page.open_tab("train_tabs", "Training").figures()[-1]["layout"]
    titles = [layout[f"yaxis{k}"]["title"]["text"] for k in range(2, 7)]
    assert titles == [f"{p.symbol} [{p.unit}]" for p in registry.FOLLOWING["idm"].parameters]


def curve_names(figure: dict[str, Any]) -> set[str]:
    return {trace["name"] for trace in figure["data"] if "name" in trace}


def test_before_a_training_the_page_shows_its_data_and_the_drive_by_the_initial_values() -> None:
    session = with_pair()
    page = open_page("Train", session)
    (figure,) = page.figures()
    assert curve_names(figure) == {"data", SIMULATION}
    assert "α = 1 1/s², β = 1 1/s, τ = 1 s" in page.plain()
    session.choose_model("idm")
    assert "s₀ = 4 m" in page.sound().plain(), "those at which its search begins"
    assert curve_names(page.figures()[0]) == {"data", SIMULATION}


def test_live_charts_take_the_place_of_an_older_result_whose_strip_comes_after_them() -> None:
    session = fitted()
    older, done = session.result, session.training
    session.restored = older
    task = Task(session.id, "training", lambda _: iter(()), analysis=older.analysis)
    session.training, task.status = task, Status.RUNNING
    page = open_page("Train", session)
    assert progress_parts(task) == ["Getting ready …"]
    assert [curve_names(figure) for figure in page.figures()] == [{"data", SIMULATION}]
    curves = older.curves[0]
    for k in range(3):
        now = older.history.parameters[k]
        moment = Progress("parameters", k, 9, k, *[1.0] * 4, now, curves=curves, left=60.4)
        task._note(moment)
    page.sound()
    assert progress_parts(task) == ["Parameters", "iteration 2", "about 1 min left"]
    live, moved = page.figures()
    assert curve_names(live) == {"data", "simulation so far"}
    assert set(older.info.labels[1:]) <= curve_names(moved)
    assert not page.get("tab"), "the older result's tabs"
    assert "strip-row" in page.everything()
    assert "train_stop" in page.buttons
    page.choose("train_follower", page.widget("train_follower").options[1])
    assert page.figures()[0]["layout"]["uirevision"] == "tracking-4"
    task.finish(older)
    session.training = done


def test_a_slider_goes_through_the_iterations_of_any_result_and_ends_at_its_simulation() -> None:
    session = fitted()
    page = open_page("Train", session).open_tab("train_tabs", "Training")

    def lines() -> tuple[Any, float]:
        *_, curves, moved = page.figures()
        simulation = next(line for line in curves["data"] if line["name"] == SIMULATION)
        mark = next(line for line in moved["data"] if line.get("name") == "chosen iteration")
        return numbers(simulation["y"]), float(mark["x"][0])

    last, at = lines()
    shown = next(line for line in page.figures()[0]["data"] if line["name"] == SIMULATION)
    np.testing.assert_array_equal(last, numbers(shown["y"]))
    assert at == session.result.history.iteration[-1]
    (slider,) = page.select_slider
    assert len(slider.options) == len(session.result.history.iteration)
    session.choices[f"train_moment_{session.result.analysis.key[:8]}"] = 0
    page.sound()
    first, at = lines()
    assert at == session.result.history.iteration[0]
    assert np.abs(first - last).max() > 1.0


@pytest.mark.parametrize("model", ["cthp-s0-delay", "idm"])
def test_what_was_stopped_before_its_intervals_says_nothing_of_them(model: str) -> None:
    session = with_pair()
    session.choose_model(model)
    asked = session.analysis()
    stopped: list[bool] = []
    context = TaskContext(
        on_progress=lambda now: stopped.append(now.phase == INTERVALS),
        should_stop=lambda: any(stopped),
    )
    result = run(asked, session.recording, segments=session.segments, context=context)
    assert result.posterior is None
    task = Task(session.id, "training", lambda _: iter(()), analysis=asked)
    session.training = task
    task.finish(result)
    assert result.weaknesses == ()
    for title in ("Train", "Stability", "Platoon"):
        page = open_page(title, session)
        said = re.sub("with(out)? intervals", "", page.plain())
        for word in ("interval", "robability", "posterior", "% band", "identified"):
            assert word not in said, (title, word)


def test_the_point_is_shown_while_its_intervals_are_computed() -> None:
    session = fitted()
    whole = session.result
    point = replace(whole.estimate, posterior=None, windows=None)
    task = session.training
    task.results, task.status = (), Status.RUNNING
    task._know(point)
    task._note(Progress("intervals", 0, 1, 1.0, *[0.0] * 4, whole.parameters, left=2.0))
    shown = open_page("Train", session).plain()
    assert progress_parts(task)[:2] == ["Intervals", "window 1 of 1"]
    known = cards(replace(whole, estimate=point), together=True)
    assert all(card.lead in shown for card in known)
    task.finish(whole)


def test_an_unfinished_training_has_neither_intervals_nor_probabilities() -> None:
    nothing = {"posterior": None, "windows": None}
    shown = open_page("Train", fitted(outcome=Outcome.DIVERGED, **nothing)).plain()
    assert Outcome.DIVERGED.value in shown
    assert "robability of" not in shown
    assert "% interval" not in shown


def test_stop_continue_or_begin_anew() -> None:
    session = with_pair()
    page = open_page("Train", session)
    page.segmented_control(key="train_preset").set_value("paper").run()
    page.press("Start training")
    assert "train_stop" in page.buttons
    assert "train_start" not in page.buttons
    job = session.training
    until(lambda: job.progress and job.progress.iteration)
    page.press("Stop training")
    assert job.wait(WAIT)
    assert job.status is Status.STOPPED
    at = job.result.estimate.iterations
    other = open_page("Train", with_pair())
    other.segmented_control(key="train_preset").set_value("paper").run()
    for one in (page.run(), other):
        start = one.button(key="train_start")
        assert start.label == f"Continue from iteration {at:,}", "another session goes on there too"
    page.press(f"Continue from iteration {at:,}")
    assert session.training is not job
    assert "train_stop" in page.buttons
    until(lambda: session.training.progress and session.training.progress.iteration > at)
    iterations = session.training.history().iteration
    assert iterations[0] == 0, "of the whole training"
    assert (np.diff(iterations) > 0).all()
    stop_tasks(session)
    assert session.result.estimate.iterations > at
    assert session.runs == (), "none is finished"
    page.run()
    page.press("Start anew")
    until(lambda: session.training.progress)
    assert session.training.history().iteration[0] == 0
    stop_tasks(session)
    assert not any(isinstance(f, Continued) for f in session.result.estimate.findings)


def test_a_second_session_waits_and_is_told() -> None:
    first, second = with_pair(), with_pair()
    first.preset = "paper"
    first.train()
    other = open_page("Train", second).press("Start training")
    assert "1 task of your other sessions comes first" in other.texts()
    assert second.training is not None
    assert "Stopped before it began" in other.press("Stop training").texts()


def test_options_are_refused_reach_the_training_and_survive_a_visit_elsewhere() -> None:
    session = with_pair()
    page = open_page("Train", session).choose("train_options", True)
    assert not [one for one in page.number_input if "initial" in one.key], "without effect"
    page.choose("train_preset", "fast")
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
    page = open_page("Train", session).choose("train_options", True)  # as after a reload
    assert page.number_input(key="train_fast_seed").value == 7
    page.press("Start training")
    config = session.training.analysis.config
    assert (config.seed, config.weight_data) == (7, (1.0, 2.0))
    assert config.initial.values.tolist() == [0.5, 0.5, 0.5]


# What the pages stand on


def test_foreign_text_is_made_literal_and_durations_are_words() -> None:
    escaped = r"a\*b\_\[c\]\(d\) \$x\$ \:red\[e\] \<i\>"
    assert escape_markdown("a*b_[c](d) $x$ :red[e] <i>") == escaped
    # Addresses are found once escapes are undone; these are the patterns of GFM's extension.
    links = re.compile(
        r"(https?://|www(?=\.))[-.\w]+|[-.\w+]+@[-\w]+(?:\.[-\w]+)+", re.IGNORECASE | re.ASCII
    )
    for address in ("http://a.org/x", "HTTPS://a.org", "www.a.org", "a.b+c@d-e.org", "(www.a.org)"):
        assert links.search(address)
        assert not links.search(escape_markdown(address).replace("\\", ""))
        assert read(escape_markdown(address)) == address
    assert bullets(("one.",)) == r"one\."
    assert bullets(("one", "two")) == "- one\n- two"
    seconds = (0.2, 59.4, 60, 200, 2706, 3900)
    words = ["1 s", "59 s", "1 min", "3 min 20 s", "45 min", "1 h 5 min"]
    assert [*map(format_duration, seconds)] == words


def test_a_training_goes_on_while_something_else_is_open_and_is_found_again() -> None:
    session = with_pair()
    session.preset = "paper"
    session.train()
    job, recording = session.training, session.recording
    session.choose(window=Window(10.0, 200.0))
    assert session.window_starts == (), "a window chosen by hand is the one that counts"
    assert session.training is None
    session.open(sample_recording(SAMPLES / "synthetic_vicolungo_like.csv"))
    assert job.is_active
    page = open_page("Data", session)
    assert f"{PLATOON.name}, 0–60 s" in page.plain()
    session.preset = "fast"
    session.train()
    assert job.is_active, "a new training waits for it"
    assert session.training is not job
    page.sound().press("frame_left_0_show")
    assert (session.recording, session.selection.window) == (recording, MINUTE)
    assert session.training is job, "what was open with it is open again"
    (later,) = session.left
    page.press("frame_left_0_stop")
    assert later.task.is_stopping or not later.task.is_active
    session.choose(window=Window(10.0, 200.0))
    session.undo()
    assert session.training is job, "nor is it run twice"
    stop_tasks(session)


def test_a_result_that_was_saved_is_one_row_of_mine_under_its_name() -> None:
    session = fitted()
    run = session.result.analysis.key

    def rows() -> dict[str, str]:
        page = open_page("Home", session)
        return {
            str(button.key).removeprefix("home_runs_open_"): read(button.label)
            for button in page.button
            if button.key and button.key.startswith("home_runs_open_")
        }

    assert rows() == {run: PLATOON.name}
    saved = library().add(session.as_snapshot("Before the update"), session.owner)
    assert rows() == {run: "Before the update"}
    store().path(run).unlink()
    assert rows() == {saved: "Before the update"}


def test_a_training_that_was_left_is_among_my_runs_once_it_is_done() -> None:
    session = with_pair()
    session.preset = "fast"
    session.train()
    job = session.training
    session.open(sample_recording(SAMPLES / "synthetic_vicolungo_like.csv"))
    assert job.wait(WAIT)
    (run,) = session.runs
    assert run.source == PLATOON.name
    for title in ("Home", "Train"):
        page = open_page(title, session)
        assert f"{'home_runs' if title == 'Home' else 'runs'}_open_{run.id}" in page.buttons
    page.press("frame_left_0_show")
    assert session.result.analysis.key == job.analysis.key
    assert not session.left


def test_a_training_in_another_session_of_mine_is_named_with_the_way_to_it() -> None:
    session = with_pair()
    session.preset = "paper"
    session.train()
    page = open_page("Home")
    assert page.workspace() is not session
    page.press("frame_elsewhere_0_show")
    assert page.workspace() is session
    stop_tasks(session)


def test_what_is_chosen_already_changes_nothing_and_changes_are_undone_with_their_result() -> None:
    session = fitted()
    result, recording = session.result, session.recording
    session.choose(window=Window(0.0, 60.0), vehicles=(2, 3, 4, 5))
    session.open(sample_recording())
    assert (session.result, session.recording) == (result, recording)
    page = open_page("Data", session).choose("data_start", 100.0)
    assert (session.selection.window, session.result) == (Window(100.0, 160.0), None)
    page.press("data_undo")
    assert (session.selection.window, session.result) == (Window(0.0, 60.0), result)
    assert session.selection.vehicles == (2, 3, 4, 5)
    for _ in range(len(session.undo_stack)):
        page.press("data_undo")
    assert page.button(key="data_undo").disabled


def test_a_change_in_another_recording_is_not_undone_in_a_result_of_this_one() -> None:
    session = with_sample()
    session.choose(vehicles=(4, 5))
    assert session.undo_stack
    other = with_recording(recording())
    other.preset = "fast"
    session.restore(train_at_once(other))
    assert session.undo_stack == ()
    assert session.selection.vehicles == (1, 2, 3), "as the recording was opened"


def test_sessions_and_runs_are_found_from_the_bare_address_and_after_another_recording(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    session = fitted()
    learned = session.result.parameters
    open_page("Train", session)
    bare = open_page("Home")
    assert bare.workspace() is not session
    assert escape_markdown(PLATOON.name) in bare.button(key="home_session_0").label
    assert session.id not in bare.everything()
    session.open(sample_recording(SAMPLES / "synthetic_vicolungo_like.csv"))
    open_page("Data", session)
    assert session.result is None
    (run,) = session.runs
    assert (run.source, run.window) == (PLATOON.name, "0–60 s")
    for page in (bare, open_page("Home", session)):
        found = page.press(f"home_runs_open_{run.id}").workspace()
        assert found.result.parameters == learned
        assert found.recording.source == PLATOON.name, "a sample is opened again"
        assert found.selection.window == Window(0.0, 60.0)
        assert not page.error
        assert f"snapshot={run.id}" not in page.texts()
    assert page.workspace() is session
    monkeypatch.setattr(users, "is_shared", lambda: True)
    page = open_page("Home")
    assert PLATOON.name not in page.everything(), "others' are nobody else's"


@pytest.mark.parametrize(
    ("title", "broken", "button"),
    [("Data", "pages.ui.data.views.show_window", ""),
     ("Train", "pages.ui.session.workspace.Workspace.train", "train_start")],
)  # fmt: skip
def test_a_fault_of_the_program_is_one_sentence_and_what_was_open_stays(
    monkeypatch: pytest.MonkeyPatch, title: str, broken: str, button: str
) -> None:
    session = fitted()
    page = open_page(title, session)
    shown = [written.value for written in (*page.title, *page.markdown, *page.caption)]
    with monkeypatch.context() as patched:
        patched.setattr(broken, lambda *_: 1 / 0)
        page.press(button) if button else page.run()
    if button:  # the page itself is sound, and drawn to its end
        assert shown == [one.value for one in (*page.title, *page.markdown, *page.caption)]
    else:
        assert [fault.value for fault in page.exception] == ["division by zero"], "the log has it"
    assert "what was open stays open" in page.boxes("error")[0]
    assert page.workspace() is session
    assert session.result is not None
    page.sound()


class Ending:
    """A task that ends after the first look at it."""

    looks = 0
    results, names, is_stopping = (), ("",), False

    @property
    def status(self) -> Status:
        self.looks += 1
        return Status.DONE if self.looks > 1 else Status.RUNNING

    @property
    def is_active(self) -> bool:
        return self.status is Status.RUNNING


def test_a_task_that_ends_while_the_page_is_drawn_is_not_polled_for_ever() -> None:
    polled = list[bool]()
    monitor(Ending(), polled.append)
    assert polled == [False]


def test_the_next_drive_is_proposed_when_it_is_asked_for() -> None:
    session = with_pair()
    session.preset = "calibrated"
    result = train_at_once(session)
    page = open_page("Train", session).open_tab("train_tabs", "Next drive")
    before = len(page.figures())
    page.press("train_next_drive")
    number = result.info.vehicles[1]
    assert page.shows(drive_table(accpinn.next_drive(result, vehicle=number)))
    assert len(page.figures()) == before + 2
    session.preset = "fast"
    train_at_once(session)
    assert "Next drive" not in open_page("Train", session).everything()
