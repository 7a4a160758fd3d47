"""Sessions: who is let in, whose sessions and snapshots are whose, limits, reloads and restarts."""

import gc
import os
import sys
from pathlib import Path
from typing import Any

import pytest
import streamlit as st
from streamlit import config

from accpinn.methods.estimate import Outcome
from accpinn.recordings import Window
from accpinn.recordings.files import read
from pages.ui.session import resources, sessions, users
from pages.ui.session.resources import library, store
from pages.ui.session.sessions import KEPT_FOR, KEPT_WORKSPACES, Workspaces
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import restore_run
from tests.support.apptest import (
    MINUTE,
    WAIT,
    fitted,
    open_page,
    sample_recording,
    train_at_once,
    with_sample,
)
from tests.support.command import PLATOON
from tests.support.openacc_files import csv, platoon
from tests.support.samples import frame

pytestmark = pytest.mark.usefixtures("fresh_server")

ANN = {"is_logged_in": True, "email": "Ann@lab.org", "email_verified": True, "sub": "1"}
BOB = {"is_logged_in": True, "email": "bob@school.edu", "sub": "2"}


class TestSignIn:
    @pytest.mark.parametrize("title", ["Home", "Snapshots"])
    def test_nothing_is_shown_and_no_session_begins_before(self, title: str) -> None:
        page = open_page(title, user={"is_logged_in": False}, session=with_sample().id)
        assert page.buttons == {"sign_in"}
        assert "synthetic" not in page.texts()

    def test_a_session_is_opened_by_its_own_user_only(self) -> None:
        own = open_page("Home", user=ANN).workspace()
        assert open_page("Home", user=ANN, session=own.id).workspace() is own
        assert open_page("Home", user=BOB, session=own.id).workspace() is not own
        own.open(sample_recording())
        open_page("Home", user=ANN, session=own.id)
        sessions.workspaces.clear()
        assert open_page("Home", user=BOB, session=own.id).workspace().id != own.id
        assert open_page("Home", user=ANN, session=own.id).workspace().id == own.id, (
            "as before a restart"
        )

    @pytest.mark.parametrize(
        ("named", "user", "admitted"),
        [
            ("", BOB, True),
            ("ann@lab.org, @school.edu", ANN, True),
            ("ann@lab.org, @school.edu", BOB, True),
            ("ann@lab.org", BOB, False),
            ("@lab.org", ANN | {"email_verified": False}, False),
            ("@lab.org", ANN | {"email": "x@evil.lab.org"}, False),
            ("@lab.org", {"is_logged_in": True}, False),
        ],
    )
    def test_who_is_named_is_admitted(
        self, monkeypatch: pytest.MonkeyPatch, named: str, user: dict[str, Any], admitted: bool
    ) -> None:
        monkeypatch.setenv(users.USERS_VARIABLE, named)
        page = open_page("Home", user=user)
        assert (len(page.buttons) > 1) is admitted
        assert "sign_out" in page.buttons

    def test_settings_that_cannot_be_read_admit_nobody(self, tmp_path: Path) -> None:
        """Streamlit takes such a file for none, and would ask nobody."""
        secrets, before = tmp_path / "secrets.toml", config.get_option("secrets.files")
        try:
            for content, admitted in (("[auth\n", False), ("other = 1\n", True)):
                secrets.write_text(content)
                config.set_option("secrets.files", [str(secrets)])
                st.secrets._reset()
                assert (open_page("Home").buttons != {"sign_in"}) is admitted
        finally:
            config.set_option("secrets.files", before)
            st.secrets._reset()

    def test_where_users_are_named_nobody_is_admitted_without_sign_in(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for variable in (users.USERS_VARIABLE, users.ADMINS_VARIABLE):
            with monkeypatch.context() as named:
                named.setenv(variable, "ann@lab.org")
                assert open_page("Home").buttons == {"sign_in"}


class TestDeletion:
    def delete_key(self) -> str:
        return f"snapshots_delete_{library().entries()[0].id}"

    def test_anyone_may_here_and_on_a_shared_server_only_the_session_that_saved_which_can_undo_it(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        own = fitted()
        open_page("Snapshots", own).press("Save")
        own.viewed = ""
        (entry,) = library().entries()
        assert self.delete_key() in open_page("Snapshots").buttons
        monkeypatch.setattr(users, "is_shared", lambda: True)
        assert self.delete_key() not in open_page("Snapshots").buttons
        page = open_page("Snapshots", own).press(self.delete_key())
        assert not library().entries()
        page.press("snapshots_undo_button")
        assert library().read(entry.id).id == entry.id
        assert self.delete_key() in open_page("Snapshots", own).buttons

    def test_with_sign_in_the_user_and_an_administrator_may(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        page = open_page("Snapshots", user=ANN)
        own = page.workspace()
        source = fitted()
        own.recording, own.segment, own.training = source.recording, source.segment, source.training
        own.selection = source.selection
        page.run().press("Save")
        assert self.delete_key() in open_page("Snapshots", user=ANN).buttons, "in another session"
        assert self.delete_key() not in open_page("Snapshots", user=BOB).buttons
        monkeypatch.setenv(users.ADMINS_VARIABLE, "bob@school.edu")
        assert self.delete_key() in open_page("Snapshots", user=BOB).buttons


HERE = {"Host": "localhost:8501", "Origin": "http://localhost:8501"}
LAB = {"Host": "app.lab.org", "Origin": "https://app.lab.org"}


class TestStrangers:
    """Who is taken for the one person at this computer, and what strangers see of each other."""

    @pytest.mark.parametrize(
        ("headers", "options", "shared"),
        [
            (HERE, {}, False),
            ({"Host": "[::1]:8501"}, {}, False),
            (HERE, {"server.address": "0.0.0.0"}, True),
            (HERE, {"server.address": ""}, True),
            (HERE, {"server.allowedHosts": ["app.lab.org"]}, True),
            (HERE, {"server.allowedHosts": ["localhost", "*"]}, True),
            (HERE, {"server.allowedHosts": []}, True),
            (LAB, {}, True),
            (HERE | {"Origin": "https://app.lab.org"}, {}, True),
            (HERE | {"X-Forwarded-For": "192.0.2.7"}, {}, True),
            (HERE | {"Forwarded": "for=192.0.2.7"}, {}, True),
            ({"Host": "localhost.evil.org"}, {}, True),
            ({"Host": "[broken"}, {}, True),
            ({"Host": ""}, {}, True),
            ({}, {}, True),
        ],
    )
    def test_only_who_asks_for_this_computer_by_its_name_is_the_person_at_it(
        self,
        monkeypatch: pytest.MonkeyPatch,
        headers: dict[str, str],
        options: dict[str, Any],
        shared: bool,
    ) -> None:
        before = {name: config.get_option(name) for name in options}
        mine = with_sample()
        open_page("Home", mine)
        monkeypatch.setattr(users, "connection_headers", lambda: headers)
        try:
            for name, value in options.items():
                config.set_option(name, value)
            page = open_page("Home")
        finally:
            for name, value in before.items():
                config.set_option(name, value)
        assert ("Anyone with this address controls" in page.texts()) is shared, "a warning"
        assert ("stay on this computer" in page.texts()) is not shared
        assert ("home_session_0" in page.buttons) is not shared
        assert mine.id not in page.everything()

    def test_a_broken_connection_leaves_a_stranger_a_stranger(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """What is drawn then is sent once the browser is back."""
        open_page("Home", with_sample())
        monkeypatch.setattr(users, "connection_headers", lambda: LAB)
        page = open_page("Home")
        monkeypatch.setattr(users, "connection_headers", dict)
        assert "home_session_0" not in page.sound().buttons

    def test_an_earlier_session_is_gone_on_with_and_its_secret_is_nowhere(self) -> None:
        session = open_page("Train", session=fitted().id).workspace()
        page = open_page("Home")
        assert session.id not in page.everything()
        page.press("home_session_0")
        assert page.workspace() is session, "it is still there"
        sessions.workspaces.clear()
        again = open_page("Home").press("home_session_0").workspace()
        assert again.result.parameters == session.result.parameters
        assert again.id != session.id, "the server has forgotten the secret"
        kept = b"".join(path.read_bytes() for path in store().folder.glob("*sqlite*"))
        assert session.id.encode() not in kept
        assert again.id.encode() not in kept

    def test_a_stranger_s_lists_have_his_own_runs_and_snapshots_in_every_session_of_his_browser(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        self.use(monkeypatch, "a")
        page = open_page("Home")
        self.give_result(page.workspace())
        open_page("Snapshots", page.workspace()).press("Save")
        (entry,) = library().entries()
        (run,) = open_page("Home", page.workspace()).workspace().runs
        for browser, sees in (("a", True), ("b", False), ("", False)):
            self.use(monkeypatch, browser)
            for title in ("Home", "Snapshots"):
                other = open_page(title)
                assert other.workspace() is not page.workspace()
                named = f"snapshots_open_{entry.id}" if title == "Snapshots" else (
                    f"home_runs_open_{run.id}"
                )  # fmt: skip
                assert (named in other.buttons) is sees, (browser, title)
            sources = open_page("Stability").widget("stability_source").options
            assert any("snapshot" in source.casefold() for source in map(str, sources)) is sees
            assert open_page("Snapshots", snapshot=entry.id).buttons >= {"snapshots_back"}, (
                "whoever has its link opens it"
            )

    def test_a_session_that_another_browser_began_says_so_before_anything_is_opened_in_it(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        self.use(monkeypatch, "a")
        theirs = open_page("Home").workspace()
        theirs.open(sample_recording())
        open_page("Home", theirs)
        self.use(monkeypatch, "b")
        for title in ("Home", "Data", "Snapshots"):
            page = open_page(title, theirs, snapshot="0123456789abcdef")
            assert page.buttons == {"frame_own_session", "frame_agree"}
            assert not page.get("file_uploader")
            assert PLATOON.name not in page.plain()
        assert page.press("frame_own_session").workspace() is not theirs
        assert page.get("file_uploader")
        page = open_page("Data", theirs).press("frame_agree")
        assert PLATOON.name in page.plain()
        assert PLATOON.name in open_page("Data", theirs).plain(), "asked once"
        sessions.workspaces.clear()
        assert PLATOON.name in open_page("Data", session=theirs.id).plain(), "also after a restart"
        self.use(monkeypatch, "c")
        sessions.workspaces.clear()
        assert "frame_agree" in open_page("Data", session=theirs.id).buttons

    def use(self, monkeypatch: pytest.MonkeyPatch, browser: str) -> None:
        """Be a browser behind the laboratory's proxy; an empty name has no cookie."""
        cookie = {"Cookie": f"accpinn_browser={browser * 22}"} if browser else {}
        monkeypatch.setattr(users, "connection_headers", lambda: LAB | cookie)

    def give_result(self, session: Workspace) -> None:
        session.open(sample_recording())
        session.choose(window=MINUTE, vehicles=(2, 3, 4, 5))
        train_at_once(session)


def test_sessions_cannot_be_guessed_and_are_bounded_in_number_age_and_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [0.0]
    kept = Workspaces(clock=lambda: now[0])
    first = kept.new()
    assert len(first.id) >= 20
    assert kept.find("") is None
    assert kept.new(first.id) is first, "of two tabs after a restart"
    runs = [read(csv(platoon(samples=400 + k)), f"{k}.csv") for k in range(2)]
    first.open(runs[0])
    for _ in range(2 * KEPT_WORKSPACES):
        last = kept.new()
    assert kept.find(first.id) is first, "empty sessions end nobody's work"
    assert kept.find(last.id) is last
    monkeypatch.setattr(sessions, "KEPT_BYTES", 1.5 * runs[0].nbytes)
    last.open(runs[1])
    assert kept.find(last.id) is last, "whoever works goes on"
    assert kept.find(last.id) is last
    assert kept.find(first.id) is None
    now[0] = KEPT_FOR - 1
    assert kept.find(last.id) is last
    now[0] = 2 * KEPT_FOR - 2
    assert kept.find(last.id) is last, "it was used in between"
    now[0] = 3 * KEPT_FOR
    assert kept.find(last.id) is None


def test_settings_that_protect_are_on() -> None:
    assert config.get_option("server.enableXsrfProtection") is True
    assert config.get_option("server.enableCORS") is True
    assert config.get_option("server.enableStaticServing") is False
    assert config.get_option("server.maxUploadSize") <= 50
    assert config.get_option("server.address") == "localhost"
    assert config.get_option("server.showEmailPrompt") is False
    assert config.get_option("browser.gatherUsageStats") is False, "nothing leaves the computer"


def test_no_page_waits_for_a_full_garbage_collection() -> None:
    """It takes longer than the page itself, and holds up all other sessions."""
    full: list[int] = []

    def note(phase: str, info: dict[str, int]) -> None:
        if phase == "start" and info["generation"] == 2:
            full.append(1)

    gc.disable()
    gc.callbacks.append(note)
    try:
        open_page("Home")
    finally:
        gc.callbacks.remove(note)
        gc.enable()
    assert not full


# Finished trainings: none vanishes with a new recording, a reload or a restart


def test_after_a_restart_its_address_shows_what_a_session_had_open() -> None:
    session = open_page("Train", session=fitted().id).workspace()
    sessions.workspaces.clear()
    again = open_page("Stability", session=session.id).workspace()
    assert (again.recording.source, again.selection.window) == (PLATOON.name, Window(0.0, 60.0))
    assert again.selection.vehicles == session.selection.vehicles
    assert again.result.parameters == session.result.parameters
    assert again.segment.info == session.segment.info

    # One of the server's folder is read again; an upload is asked for, and not believed by name.
    raw = csv(platoon(3, 1200))
    place = Path(os.environ["ACCPINN_RECORDINGS"]) / "mine.csv"
    place.parent.mkdir(parents=True)
    place.write_bytes(raw)
    again.open(read(raw, "mine.csv"))
    again.choose(Window(20.0, 70.0), vehicles=(2, 3), case="I")
    open_page("Data", session=session.id)
    for _ in range(2):
        sessions.workspaces.clear()
        again = open_page("Data", session=session.id).workspace()
        if not place.exists():
            assert again.awaited.source.name == "mine.csv"
            again.open(read(raw, "mine.csv"))
        assert again.awaited is None
        assert (again.selection.window, again.selection.vehicles, again.selection.case) == (
            Window(20.0, 70.0),
            (2, 3),
            "I",
        )
        place.unlink(missing_ok=True)


def test_an_upload_returns_after_a_restart_with_its_result_of_several_windows() -> None:
    raw = PLATOON.read_bytes()
    session = open_page("Data").upload("mine.csv", raw).workspace()
    session.choose(vehicles=(1, 2))
    page = open_page("Data", session).choose("data_which", "all")
    windows = session.several_windows
    assert len(windows) > 1
    assert f"Train on {len(windows)} windows" in page.button(key="data_train").label
    assert session.analysis("fast").windows == windows, "every preset takes them"
    session.train()
    assert session.training.wait(WAIT)
    assert session.result.analysis.windows == windows
    page = open_page("Train", session)
    said = [written.value for written in page.markdown]
    seconds = sum(window.duration for window in windows)
    assert f"{len(windows)} windows, {seconds:g} s together" in page.plain()
    sessions.workspaces.clear()
    page = open_page("Data", session=session.id).upload("mine.csv", raw)
    again = page.workspace()
    assert again is not session
    assert again.result.analysis == session.result.analysis
    assert again.several_windows == session.several_windows
    assert again.result.recording is again.recording
    assert [written.value for written in open_page("Train", again).markdown] == said


def test_a_run_is_not_restored_with_the_truth_of_another_recording() -> None:
    session, own = sessions.workspaces().new(), read(csv(frame()), "own.csv")
    session.open(own)
    train_at_once(session)
    session.open(sample_recording())
    assert session.true_parameters is not None
    (run,) = session.runs
    restore_run(session, run.id)
    assert session.recording is own
    assert session.true_parameters is None


def test_equal_runs_are_kept_once_unfinished_ones_never_and_two_are_compared() -> None:
    session = fitted()
    for case, outcome, count in (
        ("II", Outcome.CONVERGED, 1),
        ("I", Outcome.STOPPED, 1),
        ("I", Outcome.CONVERGED, 2),
    ):
        train_at_once(session, case, outcome=outcome)
        assert len(session.runs) == count
    page = open_page("Train", session).choose("runs_compare", True)
    written = page.plain()  # runs of the same second are in the order of their keys
    assert "case: II → I" in written or "case: I → II" in written


@pytest.mark.skipif(sys.platform != "linux", reason="names of other systems are text")
def test_a_file_whose_name_is_no_text_is_named_and_the_rest_is_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ACCPINN_RECORDINGS", str(tmp_path))
    (tmp_path / "good.csv").write_bytes(b"a")
    Path(os.fsdecode(bytes(tmp_path) + b"/odd\xff.csv")).write_bytes(b"a")
    assert [path.name for path in resources.listed()] == ["good.csv"]
    assert resources.misnamed() == ["odd\ufffd.csv"]
