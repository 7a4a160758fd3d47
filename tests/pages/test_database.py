"""Page Database, and on page Data the published runs."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

from accpinn import catalogue, group, read, read_study
from accpinn.errors import RecordingError
from accpinn.recordings import Window
from accpinn.results.database import extent, headline
from accpinn.study.batch import BatchProgress
from accpinn.study.studies import FILE, Computed, Request, written
from accpinn.tasks import Status, batches
from pages.ui.database import page as database_page
from pages.ui.session import sessions
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


def test_without_a_study_it_says_what_to_do(recording: Path) -> None:
    page = opened()
    assert "no study here yet" in page.plain()
    assert page.selectbox(key="database_source").options == ["all recordings", "Casale"]
    assert "1 file: " in page.plain(), "an estimate before the start"
    assert not page.button(key="database_start").disabled
    page = open_page("Database")
    page.choose("database_name", "../../etc")
    assert "is no name" in page.boxes("error")[0]
    assert page.button(key="database_start").disabled
    (recording.parent / "gone.csv").symlink_to(recording.parent / "nowhere.csv")
    assert "1 file: " in opened().plain(), "a link that leads nowhere is no file"
    recording.unlink()
    page = opened()
    assert "folder of recordings is empty" in page.plain()


def test_the_answer_is_that_of_the_rows_chosen_and_the_address_says_which(study: Path) -> None:
    page = opened()
    whole = group(read_study(study), ()).groups[0]
    assert headline(whole) in page.plain()
    assert extent(whole, 3, 2) in page.plain()
    page.choose("database_make", ["Kia"])
    kia = group(read_study(study).query("make == 'Kia'"), ("make", "model"))
    assert headline(kia.groups[0]) in page.plain()
    page.choose("database_by", "model")
    assert len(page.figures()) == 1
    address = dict(page.query_params)
    assert (address["make"], address["by"], address["study"]) == ("Kia", "model", "mine")
    del address["session"]
    other = opened(**address)
    assert other.multiselect(key="database_make").value == ["Kia"]
    assert headline(kia.groups[0]) in other.plain()
    other.choose("database_make", ["not stated"])
    assert "1 follower window of 1 vehicle" in other.plain()
    other.choose("database_make", [])
    other.open_tab("database_tabs", "All rows").choose("database_method", "splines")
    assert len(other.dataframe[0].value) == 1


@pytest.mark.parametrize("name", ["../mine", "/etc", "unknown"])
def test_a_link_to_no_study_shows_another(study: Path, name: str) -> None:
    page = opened(study=name, make="No such make", by="nonsense")
    assert any("There is no study" in said for said in page.boxes("warning"))
    assert "follower windows of" in page.plain()
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
    assert len(page.figures()) == 2
    page.choose("database_units", True)
    assert "ατ²" in page.figures()[1]["layout"]["xaxis"]["title"]["text"]
    page.open_tab("database_tabs", "Time gap")
    points = [trace for trace in page.figures()[1]["data"] if trace["type"] == "scattergl"]
    assert {trace["name"] for trace in points} == {"Tesla", "Kia"}


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
    assert (session.asked.vehicles, session.asked.window) == ((1, 2, 3), Window(10.0, 70.0))
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
    page = opened()
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
    page = opened().choose("database_name", "other").press("database_start")
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
        monkeypatch.setattr(sessions, "connection_headers", lambda: cookie)

    be("a")
    page = opened()
    assert "no study here yet" in page.plain(), "the one made by this computer's person is not hers"
    page.choose("database_name", "annsown").press("database_start")
    [path] = Path(os.environ["ACCPINN_STUDIES"]).glob("_*/annsown")
    until(lambda: not batch_queue().active_owners("batch"))
    write_study(path, made())
    page = open_page("Database", page.workspace())
    assert page.widget("database_study").options == ["annsown"]
    [link] = [code.value for code in page.code if "study=annsown" in code.value]
    be("b")
    other = opened()
    assert "no study here yet" in other.plain()
    assert "annsown" not in other.everything()
    assert other.widget("database_name").value == "OpenACC"
    for guessed in ("annsown", "mine", f"{path.parent.name}/annsown", f"annsown@{'0' * 32}",
                    "annsown@../x", f"mine@{link[-32:]}"):  # fmt: skip
        assert "There is no study" in opened(study=guessed).plain() or "no study here yet" in (
            opened(study=guessed).plain()
        )
        assert "Tesla" not in opened(study=guessed).everything()
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
