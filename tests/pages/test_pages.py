"""Every page, run without a browser: cold links, each step, and what is said when it fails."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest

from accpinn.methods import least_squares
from accpinn.methods.fit import Continued
from accpinn.methods.pinn.config import preset
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording, Window
from accpinn.segment.segment import Segment
from accpinn.tasks.task import Status, TrainingRequest, training_task
from pages.ui.components.messages import bullets, escape_markdown, format_duration
from pages.ui.data import sources
from pages.ui.data.window_picker import window_of
from pages.ui.session import sessions
from pages.ui.session.resources import task_queue
from pages.ui.session.sessions import KEPT_FOR, KEPT_WORKSPACES, Workspaces
from pages.ui.session.workspace import Workspace
from tests.support.apptest import (
    COMPARE,
    DATA,
    PAGES,
    TRAIN,
    WAIT,
    figures,
    open_page,
    plain,
    texts,
    with_sample,
)
from tests.support.openacc_files import csv, metadata, platoon

pytestmark = pytest.mark.usefixtures("fresh_server")


def with_recording(run: Recording) -> Workspace:
    found = sessions.workspaces().new()
    found.open(run)
    return found


def made(names: tuple[str, ...] = ("A", "B", "C"), **changes: Any) -> Recording:
    return read(csv(platoon(vehicles=len(names), **changes), metadata(names)), "made.csv")


def button(page: AppTest, label: str) -> Any:
    return next(b for b in page.button if b.label == label)


def labels(page: AppTest) -> list[str]:
    return [b.label for b in page.button]


# Every page


@pytest.mark.parametrize("path", PAGES)
def test_a_cold_link_shows_a_next_step(path: str) -> None:
    page = open_page(path)
    assert page.query_params["session"]
    assert page.button or page.get("page_link"), "there must be a way on"
    assert not page.error


@pytest.mark.parametrize("path", PAGES)
def test_with_a_recording_open(path: str) -> None:
    page = open_page(path, with_sample())
    assert not page.error


@pytest.mark.parametrize("path", PAGES)
def test_with_a_window_that_cannot_be_used(path: str) -> None:
    found = with_sample()
    found.choose(window=Window(395.0, 399.0))
    assert found.fault
    page = open_page(path, found)
    if path in (DATA, TRAIN, COMPARE):
        assert escape_markdown(found.fault) in texts(page)


@pytest.mark.parametrize("path", PAGES)
def test_an_unknown_session_begins_anew_and_says_so(path: str) -> None:
    page = open_page(path, session="long-forgotten")
    assert "no longer on this server" in texts(page)
    assert page.query_params["session"] != "long-forgotten"
    page.run()
    assert "no longer on this server" not in texts(page)


# Home


def test_one_click_trains_a_sample() -> None:
    page = open_page("app.py")
    button(page, "Train a sample now").click().run()
    assert not page.exception
    found = sessions.workspaces().find(page.query_params["session"])
    assert found is not None
    assert found.training is not None
    assert found.training.wait(WAIT)
    assert found.fit is not None
    assert found.true_parameters is not None
    truth = found.true_parameters.values
    np.testing.assert_allclose(found.fit.parameters.values, truth, rtol=0.03)


def test_home_says_where_the_session_stands() -> None:
    page = open_page("app.py", with_sample())
    assert "Your session" in texts(page)
    assert "vehicles 1–5" in texts(page)
    assert "Your session" not in texts(open_page("app.py"))


# Data


def test_open_a_sample() -> None:
    page = open_page(DATA)
    button(page, "Open this sample").click().run()
    assert not page.exception
    written = texts(page)
    assert "synthetic\\_astazero\\_like\\.csv" in written
    assert "5 vehicles" in written
    assert "Least squares" in written
    assert "Tesla(Model3-like)" in written
    (overview,) = figures(page)
    assert overview["layout"]["shapes"][0]["x1"] == 300.0


def test_regimes_are_left_out_when_ticked_and_said_everywhere() -> None:
    time = np.arange(400)
    run = made(("A", "B"))
    gap = np.where((time < 100)[:, None], 60.0, run.gap)
    found = with_recording(replace(run, gap=gap))
    page = open_page(DATA, found)
    assert found.segment is not None
    assert found.segment.mask is None
    assert "Without" not in texts(page)
    page.checkbox(key="data_exclude_catching up").check().run()
    assert not page.exception
    assert found.segment.mask is not None
    assert found.segment.mask[:, 0].tolist() == (time >= 100).tolist()
    assert "**Without** catching up" in texts(page)
    assert "(2 B: 25 % of the instants)" in texts(page).replace("\\", "")
    for path in (TRAIN, "pages/5_Compare.py"):
        assert "without catching up" in texts(open_page(path, found))
    page.toggle(key="data_sensitivity").set_value(True).run()
    assert not page.exception
    assert "Without catching up" in texts(page)
    page.checkbox(key="data_exclude_catching up").uncheck().run()
    assert found.segment.mask is None


def test_where_no_regime_occurs_there_is_nothing_to_compare() -> None:
    page = open_page(DATA, with_sample())
    page.toggle(key="data_sensitivity").set_value(True).run()
    assert "so there is nothing to compare" in texts(page)
    assert "Without catching up" not in texts(page)


def test_upload_a_recording() -> None:
    page = open_page(DATA)
    page.segmented_control(key="data_source").set_value("Upload").run()
    raw = csv(platoon(vehicles=2), metadata(("A", "B")))
    page.file_uploader(key="data_upload").upload("mine.csv", raw, "text/csv").run()
    assert not page.exception
    assert "mine\\.csv" in texts(page)
    assert "Case" not in [control.label for control in page.segmented_control], "M = 1 has no cases"


def test_a_bad_upload_is_one_sentence_and_loses_nothing() -> None:
    found = with_sample()
    page = open_page(DATA, found)
    before = found.recording, found.segment
    page.segmented_control(key="data_source").set_value("Upload").run()
    page.file_uploader(key="data_upload").upload("bad.csv", b"\x89PNG not a run", "x").run()
    assert not page.exception
    (error,) = page.error
    assert "this is a PNG image, not a CSV file" in error.value.replace("\\", "")
    assert (found.recording, found.segment) == before
    assert "Preview of the window" in texts(page)


def test_the_folder_on_the_server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    page = open_page(DATA)
    page.segmented_control(key="data_source").set_value("Folder on the server").run()
    assert "ACCPINN_RECORDINGS" in texts(page)
    root = tmp_path / "runs"
    (root / "deep").mkdir(parents=True)
    (root / "deep" / "run.csv").write_bytes(csv(platoon(vehicles=2), metadata(("A", "B"))))
    (tmp_path / "secret.csv").write_text("secret")
    (root / "link.csv").symlink_to(tmp_path / "secret.csv")
    monkeypatch.setenv("ACCPINN_RECORDINGS", str(root))
    page.run()
    assert page.selectbox(key="data_file").options == ["deep/run.csv"]
    button(page, "Open this recording").click().run()
    assert not page.exception
    assert "run\\.csv" in texts(page)


def test_the_window_moves_and_the_estimate_follows() -> None:
    found = with_sample()
    page = open_page(DATA, found)
    before = texts(page)
    page.number_input(key="data_start").set_value(80.0).run()
    page.number_input(key="data_length").set_value(120.0).run()
    assert found.window == Window(80.0, 200.0)
    assert texts(page) != before
    assert figures(page)[0]["layout"]["shapes"][0]["x0"] == 80.0
    page.number_input(key="data_length").set_value(5.0).run()
    assert "too short" in texts(page)
    assert button(page, "Train on this window").disabled


def test_the_length_that_is_shown_rounded_is_accepted() -> None:
    found = with_sample()
    assert found.recording is not None
    end = found.recording.duration
    arrays = ("time", "speed", "gap", "mode")
    shorter = {name: getattr(found.recording, name)[:-1] for name in arrays}
    found.open(replace(found.recording, **shorter))
    page = open_page(DATA, found)
    assert page.number_input(key="data_length").max == end
    page.number_input(key="data_length").set_value(end).run()
    assert found.segment is not None
    assert found.segment.window.duration == pytest.approx(end - 0.1)


def test_vehicles_and_case() -> None:
    found = with_sample()
    page = open_page(DATA, found)
    leader, last = page.selectbox[-2:]
    assert leader.label == "Leader"
    leader.set_value(3).run()
    assert found.vehicles == (3, 4, 5)
    page.segmented_control(key="data_case").set_value("I").run()
    assert found.case == "I"
    assert "one set of α, β, τ" in texts(page)
    last = page.selectbox[-1]
    last.set_value(4).run()
    assert found.vehicles == (3, 4)
    assert "one set of α, β, τ" not in texts(page)
    assert found.true_parameters is not None
    assert found.true_parameters.alpha.tolist() == [0.0766]


def test_a_new_recording_drops_what_came_after() -> None:
    found = with_sample()
    page = open_page(DATA, found)
    button(page, "Train on this window").click().run()
    assert found.training is not None
    page = open_page(DATA, found)
    page.number_input(key="data_start").set_value(20.0).run()
    assert found.training is None


def test_names_from_a_file_are_shown_as_they_are() -> None:
    nasty = "<script>alert(1)</script>"
    found = with_recording(made((nasty, "*B* $x$ :red[c]", "C")))
    for path in (DATA, TRAIN):
        page = open_page(path, found)
        assert nasty not in texts(page)
        markdown = "".join(element.value for element in (*page.markdown, *page.caption))
        assert "*B*" not in markdown
    assert "&lt;script&gt;" in texts(open_page(DATA, found))


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        ([], None),
        ([{"x": [10.04, 30.06]}], Window(10.0, 30.1)),
        ([{"x": [30.06, 10.04]}], Window(10.0, 30.1)),
        ([{"x": [-20.0, 500.0]}], Window(0.0, 39.9)),
        ([{"x": [10.0, 12.0]}], None),
    ],
)
def test_dragging_over_the_chart(box: list[Any], expected: Window | None) -> None:
    assert window_of({"selection": {"box": box}}, made()) == expected


def test_the_first_window_avoids_holes() -> None:
    frame = platoon(samples=4000)
    frame.loc[500:599, ["Speed2", "IVS1", "IVS2"]] = np.nan
    run = read(csv(frame), "holes.csv")
    found = with_recording(run)
    assert found.window == Window(60.0, 360.0)
    assert found.segment is not None


# Train


def test_train_shows_table_curves_and_downloads() -> None:
    found = with_sample()
    page = open_page(TRAIN, found)
    button(page, "Start training").click().run()
    assert found.training is not None
    assert found.training.wait(WAIT)
    page.run()
    assert not page.exception
    written = texts(page)
    assert "Converged" in written
    assert "Surrogate fit, MAE" in written
    assert "Closed-loop simulation, MAE" in written
    assert "0.0612" in written, "the truth of the first follower"
    assert len(figures(page)) == 5
    assert len(page.get("download_button")) == 2
    assert "Start training" in labels(page)
    assert "Stop training" not in labels(page)
    page.selectbox(key="train_follower").set_value(3).run()
    assert figures(page)[-1]["layout"]["uirevision"] == "tracking-5"


def excluding(segment: Segment | None, regimes: tuple[str, ...]) -> Segment:
    """The same with some instants left out, if any regimes are."""
    assert segment
    some = np.zeros_like(segment.gaps, dtype=bool)
    some[:50] = True
    return replace(segment, mask=~some if regimes else None, excluded_regimes=regimes)


@pytest.mark.parametrize("excluded", [(), ("catching up",)])
@pytest.mark.parametrize("parameters", [Parameters(0.01, 0.02, 0.2), Parameters(0.0001, 0.3, 26.3)])
def test_train_says_what_goes_wrong_and_how_sure_it_is(
    parameters: Parameters, excluded: tuple[str, ...]
) -> None:
    """With one set of parameters vehicles collide, the other's τ is no time headway."""
    found = with_sample()
    segment = found.segment = excluding(found.segment, excluded)
    known = least_squares.fit(segment)
    own = Trajectories(segment.time, segment.speeds, segment.gaps)
    same = Parameters.stack([parameters] * segment.followers)
    found.training = training_task(found.id, TrainingRequest(segment, "II", preset("fast")))
    found.training.answer(replace(known, method="pinn", parameters=same, surrogate=own))
    page = open_page(TRAIN, found)
    written = plain(page)
    collides = f"{segment.labels[1]} collides with the vehicle ahead at" in written
    assert collides == (parameters.tau < 1)
    assert ("errors include what follows" in written) == collides
    assert ("does not determine the time headway" in written) == (parameters.tau > 5)
    assert "90 % interval" in written
    marks = [trace for trace in figures(page)[-1]["data"] if trace["name"] == "collision"]
    assert len(marks) == collides
    titles = written.count(f"s, without {''.join(excluded)}")
    assert titles == 3 * len(excluded), "of the parameters, the intervals and the estimates"


def test_data_says_what_its_figures_are_of() -> None:
    found = with_sample()
    assert "all other figures are of all instants" not in texts(open_page(DATA, found))
    found.segment = excluding(found.segment, ("standstill",))
    written = texts(open_page(DATA, found))
    assert "s, without standstill" in written
    assert "all other figures are of all instants" in written


def test_the_second_time_the_answer_comes_from_the_cache() -> None:
    found = with_sample()
    for _ in range(2):
        page = open_page(TRAIN, found)
        button(page, "Start training").click().run()
        assert found.training is not None
        assert found.training.wait(WAIT)
    page.run()
    assert "From the cache" in texts(page)


def stop_training(found: Workspace) -> None:
    """As the button does, and wait for it."""
    assert found.training
    task_queue().stop(found.training)
    assert found.training.wait(WAIT)


def test_stop_continue_or_begin_anew() -> None:
    found = with_sample()
    page = open_page(TRAIN, found)
    page.segmented_control(key="train_preset").set_value("paper").run()
    button(page, "Start training").click().run()
    assert "Stop training" in labels(page)
    assert "Start training" not in labels(page)
    job = found.training
    assert job is not None
    while not (job.progress and job.progress.iteration):
        assert job.is_active
        job.wait(0.05)
    button(page, "Stop training").click().run()
    assert job.wait(WAIT)
    assert job.status is Status.STOPPED
    assert job.result
    at = job.result.iterations
    other = open_page(TRAIN, with_sample())
    other.segmented_control(key="train_preset").set_value("paper").run()
    for one in (page.run(), other):
        assert f"Continue from iteration {at:,}" in labels(one), "another session goes on there too"
        assert "Start training" not in labels(one)
    button(page, f"Continue from iteration {at:,}").click().run()
    assert found.training is not job
    assert "Stop training" in labels(page)
    stop_training(found)
    page.run()
    button(page, "Start anew").click().run()
    assert found.training
    while found.training.progress is None:
        found.training.wait(0.05)
    first = found.training.history()
    assert first
    assert first.iteration[0] == 0
    stop_training(found)
    assert found.fit
    assert not any(isinstance(f, Continued) for f in found.fit.findings)


def test_a_second_session_waits_and_is_told() -> None:
    first, second = with_sample(), with_sample()
    page = open_page(TRAIN, first)
    page.segmented_control(key="train_preset").set_value("paper").run()
    button(page, "Start training").click().run()
    other = open_page(TRAIN, second)
    button(other, "Start training").click().run()
    assert "yours is next" in texts(other)
    assert second.training is not None
    button(other, "Stop training").click().run()
    assert "Stopped before it began" in texts(other)


def test_a_bad_option_is_one_sentence_and_disables_the_button() -> None:
    page = open_page(TRAIN, with_sample())
    page.number_input(key="train_fast_iterations").set_value(0).run()
    (error,) = page.error
    assert "iterations: 0 is not allowed" in error.value.replace("\\", "")
    assert button(page, "Start training").disabled
    button(page, "Back to the preset").click().run()
    assert not page.error
    assert not button(page, "Start training").disabled


def test_options_reach_the_training_and_survive_a_visit_elsewhere() -> None:
    found = with_sample()
    page = open_page(TRAIN, found)
    page.number_input(key="train_fast_seed").set_value(7).run()
    page.number_input(key="train_fast_weight_data_1").set_value(2.0).run()
    page.selectbox(key="train_fast_start").set_value((0.5, 0.5, 0.5)).run()
    page = open_page(TRAIN, found)  # as after a reload
    assert page.number_input(key="train_fast_seed").value == 7
    button(page, "Start training").click().run()
    assert found.training is not None
    config = found.training.request.config
    assert (config.seed, config.weight_data) == (7, (1.0, 2.0))
    assert config.initial.values.tolist() == [0.5, 0.5, 0.5]
    assert found.training.wait(WAIT)


def test_a_failed_training_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*args: Any, **options: Any) -> Any:
        raise RuntimeError("boom")

    monkeypatch.setattr("accpinn.methods.pinn.training.training", failing)
    found = with_sample()
    page = open_page(TRAIN, found)
    button(page, "Start training").click().run()
    assert found.training is not None
    assert found.training.wait(WAIT)
    page.run()
    assert not page.exception
    assert "ended unexpectedly" in texts(page)
    assert "boom" not in texts(page)
    assert "Start training" in labels(page)


# What the pages stand on


def test_sessions_cannot_be_guessed_and_are_bounded() -> None:
    now = [0.0]
    kept = Workspaces(clock=lambda: now[0])
    first = kept.new()
    assert len(first.id) >= 20
    assert kept.find(first.id) is first
    assert kept.find("") is None
    for _ in range(KEPT_WORKSPACES):
        last = kept.new()
    assert kept.find(first.id) is None
    now[0] = KEPT_FOR / 2
    assert kept.find(last.id) is last
    now[0] = KEPT_FOR * 1.4
    assert kept.find(last.id) is last, "it was used in between"
    now[0] = KEPT_FOR * 3
    assert kept.find(last.id) is None


def test_recordings_are_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    raw = csv(platoon())
    one = sources.from_bytes(raw, "a.csv")
    assert sources.from_bytes(raw, "a.csv") is one
    assert sources.from_bytes(raw, "b.csv").source == "b.csv"
    assert sources.from_bytes(csv(platoon(samples=300)), "a.csv") is not one


def test_foreign_text_is_made_literal() -> None:
    assert escape_markdown("a*b_[c](d) $x$ :red[e] <i>") == (
        r"a\*b\_\[c\]\(d\) \$x\$ \:red\[e\] \<i\>"
    )
    assert bullets(("one.",)) == r"one\."
    assert bullets(("one", "two")) == "- one\n- two"


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0.2, "1 s"),
        (59.4, "59 s"),
        (60, "1 min"),
        (200, "3 min 20 s"),
        (2706, "45 min"),
        (3900, "1 h 5 min"),
    ],
)
def test_durations_in_words(seconds: float, said: str) -> None:
    assert format_duration(seconds) == said


def test_another_window_ends_a_training_that_nobody_could_stop_any_more() -> None:
    found = with_sample()
    found.train(preset("paper", iterations=20_000))
    job = found.training
    found.choose(window=Window(10.0, 200.0))
    assert job is not None
    assert job.wait(WAIT)
    assert job.status is Status.STOPPED


def test_another_window_forgets_what_was_chosen_among_the_former_vehicles() -> None:
    found = with_sample()
    found.platoon_choice.own, found.platoon_choice.omega, found.map_choice.held = "1-4", 0.3, 3
    found.choose(vehicles=(1, 2))
    assert (found.platoon_choice.own, found.platoon_choice.omega, found.map_choice.held) == (
        "",
        None,
        -1,
    )
    found.parameter_choice.source, found.platoon_choice.own = "published", "1-4"
    found.choose(vehicles=(1, 2, 3))
    assert found.platoon_choice.own == "1-4", "the published laws stay the same"
