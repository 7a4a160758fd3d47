"""Page Database, and on page Data the published runs."""

import io
import os
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

from accpinn import catalogue, group, read, read_study
from accpinn.errors import RecordingError
from accpinn.recordings import Window
from accpinn.results.database import extent, headline, supplied_line
from accpinn.study.batch import BatchProgress
from accpinn.study.studies import DROPPED, FILE, Computed, Request, written
from accpinn.study.supplied import read_about, supplied_study
from accpinn.tasks import Status, batches
from pages.ui.database import page as database_page
from pages.ui.database import study_folders
from pages.ui.session import users
from pages.ui.session.resources import batch_queue, download_queue
from tests.support.apptest import WAIT, Page, open_page, until
from tests.support.openacc_files import csv, metadata, platoon
from tests.support.publisher import publisher
from tests.support.studies import REQUEST, analysis, row, write_study

pytestmark = pytest.mark.usefixtures("fresh_server")

NAMES = ("Audi(A8)", "Tesla(Model3)", "Kia(Niro)")


@pytest.fixture
def recording() -> Path:
    """A run in the server's folder."""
    place = Path(os.environ["ACCPINN_RECORDINGS"]) / "Casale" / "mine.csv"
    place.parent.mkdir(parents=True)
    place.write_bytes(csv(platoon(3, 1500), metadata(NAMES)))
    return place


def made(file: str = "x.csv", **changes: Any) -> dict[str, Any]:
    where = {"file": file, "start": 10.0, "duration": 60.0, "vehicle": 2, "leader": 1, "case": "II"}
    return row("Tesla", **where, mean_speed=20.0, sha256="0", l2_stable=False) | changes


@pytest.fixture
def study(recording: Path) -> Path:
    """Two makes, and a window of the run that is there."""
    known = {"file": recording.name, "sha256": read(recording).sha256, "campaign": "Casale"}
    return write_study(
        Path(os.environ["ACCPINN_STUDIES"]) / "mine",
        made(**known, model="Model 3"),
        made(**known, vehicle=3, make="Kia", name="Kia", tau=1.5, p_l2_stable=1.0, l2_stable=True),
        made("gone.csv", tau=1.2, trajectory="1"),
        made("gone.csv", tau=3.0, method="splines", make=None),
    )


def opened(**address: str) -> Page:
    page = open_page("Database", **address)
    assert not page.boxes("error")
    return page


def with_form(page: Page) -> Page:
    """The page with the form of a new batch opened."""
    page.session_state["database_new"] = True
    return page.sound()


def test_a_first_visitor_sees_the_supplied_study_and_who_made_its_data(recording: Path) -> None:
    page = opened()
    assert page.widget("database_study").options == ["OpenACC cars (supplied)"]
    folder = supplied_study()
    assert folder
    about = read_about(folder)
    assert supplied_line(about) in page.plain()
    assert "CC BY 4.0" in page.plain()
    forest = page.figures()[0]["layout"]["yaxis"]["ticktext"]
    assert {"Audi · A6 · min", "Hyundai · Ioniq hybrid · min"} <= {*forest}
    assert not {"database_continue", "database_stop"} & page.buttons
    page = with_form(opened())
    assert page.selectbox(key="database_source").options == ["all recordings", "Casale"]
    assert "1 file: " in page.plain(), "an estimate before the start"
    assert not page.button(key="database_start").disabled
    page.choose("database_name", "../../etc")
    assert "is no name" in page.boxes("error")[0]
    assert page.button(key="database_start").disabled
    (recording.parent / "gone.csv").symlink_to(recording.parent / "nowhere.csv")
    assert "1 file: " in with_form(opened()).plain(), "a link that leads nowhere is no file"
    recording.unlink()
    page = with_form(opened())
    assert "database_start" not in page.buttons
    assert "database_upload" in {field.key for field in page.get("file_uploader")}


def test_without_the_supplied_study_the_form_stands_on_the_page(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (study_folders, database_page):
        monkeypatch.setattr(module, "supplied_study", lambda: None)
    page = opened()
    assert "no study here yet" in page.plain()
    assert not page.button(key="database_start").disabled


def test_dropped_files_are_unpacked_refused_one_by_one_and_removed_after_the_batch(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw, packed = recording.read_bytes(), io.BytesIO()
    other = csv(platoon(2, 1500), metadata(NAMES[:2]))
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("Casale/part3.csv", other)
        archive.writestr("notes.txt", "a note")
    page = with_form(opened())
    field = page.file_uploader(key="database_upload")
    field.set_value([
        ("mine.csv", raw, "text/csv"), ("runs.zip", packed.getvalue(), "application/zip"),
        ("again.csv", raw, "text/csv"), ("picture.csv", b"\x89PNG", "text/csv"),
    ])  # fmt: skip
    page.sound()
    session = page.workspace()
    assert [str(file.path) for file in session.dropped.files] == ["mine.csv", "Casale/part3.csv"]
    (refused,) = page.boxes("warning")
    assert "again.csv: its contents are those of mine.csv" in refused
    assert "picture.csv: this is a PNG image" in refused
    found: list[list[str]] = []

    def run(folder: Path, request: Request, *_: object) -> BatchProgress:
        found.append([Path(source).name for source in request.sources])
        assert all(Path(source).is_file() for source in request.sources)
        with written(folder, request) as kept:
            kept.add("x.csv", Computed(analysis(), [made("x.csv")]))
        return BatchProgress(2, rows=1)

    monkeypatch.setattr(batches, "run_request", run)
    page.choose("database_name", "dropped").press("database_start")
    assert batch_queue().of("dropped", "batch").wait(WAIT)
    assert found == [["mine.csv", "part3.csv"]]
    assert session.dropped.files == ()
    study = Path(os.environ["ACCPINN_STUDIES"]) / "dropped"
    left = study / DROPPED / "0" / "left.csv"  # as of a batch that was stopped
    left.parent.mkdir(parents=True)
    left.write_bytes(raw)
    monkeypatch.setattr(study_folders, "sees_all", lambda: True)  # as on the page
    study_folders.make_room(session.id, "dropped", 1)
    assert left.exists()
    monkeypatch.setattr(study_folders, "MOST_DROPPED", len(raw))
    with pytest.raises(RecordingError, match="dropped files"):
        study_folders.make_room(session.id, "dropped", 1)
    study_folders.make_room(session.id, "another", len(raw))
    assert not (study / DROPPED).exists()
    assert (study / FILE).exists()


def test_the_answer_is_that_of_the_rows_chosen_and_the_address_says_which(study: Path) -> None:
    page = opened()
    whole = group(read_study(study), ()).groups[0]
    assert headline(whole) in page.plain()
    assert extent(whole, 3, 2) in page.plain()
    page.choose("database_make", ["Kia"])
    kia = group(read_study(study).query("make == 'Kia'"), ("make", "model"))
    assert headline(kia.groups[0]) in page.plain()
    page.choose("database_by", "model")
    assert len(page.figures()) == 2, "the groups, and the open tab"
    address = dict(page.query_params)
    assert (address["make"], address["by"], address["study"]) == ("Kia", "model", "mine")
    del address["session"]
    other = opened(**address)
    assert other.multiselect(key="database_make").value == ["Kia"]
    assert headline(kia.groups[0]) in other.plain()
    other.choose("database_make", ["not stated"])
    assert "1 follower window, 1 vehicle" in other.plain()
    other.choose("database_make", [])
    other.open_tab("database_tabs", "All rows").choose("database_method", "splines")
    assert len(other.dataframe[0].value) == 1


@pytest.mark.parametrize("name", ["../mine", "/etc", "unknown"])
def test_a_link_to_no_study_shows_another(study: Path, name: str) -> None:
    page = opened(study=name, make="No such make", by="nonsense")
    assert any("There is no study" in said for said in page.boxes("warning"))
    assert "follower windows, " in page.plain()
    assert page.query_params["study"] == "mine"


def test_every_tab_and_the_failures(study: Path) -> None:
    with written(study, REQUEST) as kept:
        said = "it <b>cannot</b> be read"
        kept.refuse(Path("bad0.csv"), [said])
        kept.add("bad1.csv", Computed(analysis(), reason=said))
    page = opened()
    assert "1 file without a window and 1 estimate failed" in page.plain()
    page.open_tab("database_tabs", "Failures")
    assert "bad1.csv" in page.texts()
    assert "it &lt;b&gt;cannot" in page.texts()
    assert "Standard deviations beyond" in page.open_tab("database_tabs", "Spread").plain()
    page.open_tab("database_tabs", "α–β plane")
    assert "ατ²" in page.figures()[1]["layout"]["xaxis"]["title"]["text"]
    page.open_tab("database_tabs", "Time gap over speed")
    points = [trace for trace in page.figures()[1]["data"] if trace["type"] == "scattergl"]
    makes = {trace["name"].partition(" ")[0] for trace in points}
    assert makes == {"Tesla", "Kia"}


def test_a_row_opens_its_window(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = opened().open_tab("database_tabs", "All rows")
    assert len(page.dataframe[0].value) == 3
    session = page.workspace()
    session.choices["database_row"] = 0
    page.run()
    page.press("database_open")
    assert "gone.csv: this recording is not in the server's folder" in page.boxes("error")[0]
    page.choose("database_make", ["Tesla"])
    session.choices["database_row"] = 1
    page.run()
    page.press("database_open")
    assert "Preview of the window" in page.texts(), "this is page Data"
    assert session.recording.source == "mine.csv"
    assert (session.selection.vehicles, session.selection.window) == ((1, 2, 3), Window(10.0, 70.0))
    assert session.segment is not None
    # One that the browser still reports is not chosen among others.
    page = opened().open_tab("database_tabs", "All rows")
    reported = {"selection": {"rows": [0]}}
    monkeypatch.setattr(database_page.st, "dataframe", lambda *_, **__: reported)
    page.choose("database_make", ["Kia"])
    assert page.workspace().choices["database_row"] is None


def test_a_study_that_is_damaged_says_so(study: Path) -> None:
    write_study(study.parent / "other", made())
    (study / FILE).write_bytes(b"SQLite format 3\0 no more")
    page = open_page("Database", study="mine")
    assert "is damaged" in page.boxes("error")[0]
    page.choose("database_study", "other")
    assert "1 follower window" in page.plain()


def test_a_batch_is_started_stopped_and_continued(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Path, Request]] = []

    def run(
        folder: Path, request: Request, note: Callable[..., Any], should_stop: Callable[[], bool]
    ) -> BatchProgress:
        asked.append((folder, request))
        is_first = len(asked) == 1
        with written(folder, request) as kept:
            kept.add("x.csv", Computed(analysis(), [made("x.csv")]))
            note(BatchProgress(4, 1.0, finished=1, rows=1, seconds_left=30.0, share=0.25))
            if is_first:
                until(should_stop)
            kept.note(replace(request, is_finished=not is_first))
        return BatchProgress(1, recordings=1, windows=1, rows=1, stopped=is_first)

    monkeypatch.setattr(batches, "run_request", run)
    page = with_form(opened())
    page.choose("database_name", "first")
    page.choose("database_window", 60.0)
    page.press("database_start")
    task = batch_queue().of("first", "batch")
    until(lambda: task.latest)
    folder, request = asked[0]
    assert (request.window, request.sources) == (60.0, (str(recording.parents[1]),))
    assert folder == Path(os.environ["ACCPINN_STUDIES"]) / "first"
    # Another browser finds it at work, too.
    other = opened(study="first")
    (bar,) = other.get("progress")
    assert (bar.proto.value, "about 30 s left" in bar.proto.text) == (25, True)
    other.press("database_stop")
    assert task.wait(WAIT)
    assert task.status is Status.STOPPED
    page.run()
    assert "what is finished is kept" in page.plain()
    # After a restart of the server nothing but the folder is left.
    batch_queue().close()
    batch_queue.clear()
    page = opened()
    assert "did not come to its end" in page.plain()
    page.press("database_continue")
    again = batch_queue().of("first", "batch")
    assert again.wait(WAIT)
    assert again.status is Status.DONE
    assert asked[1] == asked[0]
    page.run()
    assert "database_continue" not in page.buttons


def test_a_batch_that_is_refused_says_why_and_one_from_elsewhere_is_not_continued(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> BatchProgress:
        raise RecordingError("it cannot be written")

    monkeypatch.setattr(batches, "run_request", refuse)
    page = with_form(opened()).choose("database_name", "other").press("database_start")
    assert batch_queue().of("other", "batch").wait(WAIT)
    page.run()
    assert page.boxes("error") == ["it cannot be written"]
    study = write_study(Path(os.environ["ACCPINN_STUDIES"]) / "mine", made())
    for source, offered in ((recording.parent, True), (study, False), (Path("/etc"), False)):
        with written(study, replace(REQUEST, sources=(str(source),))):
            pass
        assert ("database_continue" in opened(study="mine").buttons) is offered


# Page Data


def test_a_stranger_s_studies_are_listed_to_nobody_else_and_a_link_shows_one_without_its_batch(
    study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def be(browser: str) -> None:
        cookie = {"Host": "app.lab.org", "Cookie": f"accpinn_browser={browser * 22}"}
        monkeypatch.setattr(users, "connection_headers", lambda: cookie)

    be("a")
    page = with_form(opened())
    supplied = ["OpenACC cars (supplied)"]
    assert page.widget("database_study").options == supplied, "another person's is not hers"
    page.choose("database_name", "annsown").press("database_start").press("database_stop")
    until(lambda: not batch_queue().active_owners("batch"))
    [path] = Path(os.environ["ACCPINN_STUDIES"]).glob("_*/annsown")
    write_study(path, made())
    page = open_page("Database", page.workspace())
    assert page.widget("database_study").options == ["annsown", *supplied]
    [link] = [code.value for code in page.code if "study=annsown" in code.value]
    be("b")
    other = with_form(opened())
    assert other.widget("database_study").options == supplied
    assert "annsown" not in other.everything()
    assert other.widget("database_name").value == "My study"
    for guessed in ("annsown", "mine", f"{path.parent.name}/annsown", f"annsown@{'0' * 32}",
                    "annsown@../x", f"mine@{link[-32:]}"):  # fmt: skip
        assert "There is no study" in opened(study=guessed).plain()
        assert opened(study=guessed).widget("database_study").options == supplied
    shown = opened(study=parse_qs(urlsplit(link).query)["study"][0])
    assert "Tesla" in shown.everything()
    assert not {"database_continue", "database_stop"} & shown.buttons


def test_a_published_run_is_downloaded_and_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    run = next(run for run in catalogue() if run.sha256 is None)
    content = csv(platoon(2, 400), metadata(NAMES[:2]))
    page = open_page("Data")
    page.choose("data_run", run)
    monkeypatch.setenv("ACCPINN_MIRROR", "http://127.0.0.1:9")
    page.press("data_download")
    owner = page.workspace().id
    assert download_queue().of(owner, "download").wait(WAIT)
    page.run()
    assert "127.0.0.1:9" in page.boxes("error")[0]
    with publisher({run.key: content}) as server:
        monkeypatch.setenv("ACCPINN_MIRROR", server.url)
        page.press("data_download")
        assert download_queue().of(owner, "download").wait(WAIT)
    page.run()
    assert not page.boxes("error")
    assert "1 of 139" in page.selectbox(key="data_run").label
    page.press("Open this run")
    assert page.workspace().recording.source == run.file
