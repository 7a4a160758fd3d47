"""Finished trainings of a session: none vanishes with a new recording, a reload or a restart."""

import os
from pathlib import Path

import pytest

from accpinn.methods.fit import Outcome
from accpinn.recordings.files import read
from accpinn.recordings.recording import Window
from pages.ui.session import sessions
from pages.ui.session.resources import FIRST_SAMPLE, SAMPLES, sample
from pages.ui.snapshots.listing import restore_run
from tests.support.apptest import DATA, HOME, STABILITY, TRAIN, answer, fitted, open_page
from tests.support.openacc_files import csv, platoon

pytestmark = pytest.mark.usefixtures("fresh_server")


def test_runs_survive_another_recording_and_a_restart_and_are_restored() -> None:
    session = fitted(Window(0.0, 60.0))
    before = session.result.parameters
    session.open(*sample(SAMPLES / "synthetic_vicolungo_like.csv"))
    open_page(DATA, session)
    assert session.result is None
    (run,) = session.runs
    assert (run.source, run.window) == (FIRST_SAMPLE.name, "0–60 s")

    sessions.workspaces.clear()  # as a restart of the server
    page = open_page(HOME, session=session.id)
    again = page.workspace()
    assert again is not session
    assert again.id == session.id
    page.press(f"home_run_{run.id}")
    assert again.result.parameters == before
    again.open(*sample(FIRST_SAMPLE))
    page.run()
    page.press(f"runs_open_{run.id}")
    assert again.result.parameters == before
    assert again.recording is not None, "a sample is opened again"
    assert again.window == Window(0.0, 60.0)
    assert not page.error
    assert f"snapshot={run.id}" not in page.texts()


def test_after_a_restart_its_address_shows_what_a_session_had_open() -> None:
    session = open_page(TRAIN, session=fitted(Window(0.0, 60.0)).id).workspace()
    sessions.workspaces.clear()
    again = open_page(STABILITY, session=session.id).workspace()
    assert (again.recording.source, again.window) == (FIRST_SAMPLE.name, Window(0.0, 60.0))
    assert again.vehicles == session.vehicles
    assert again.result.parameters == session.result.parameters
    assert again.segment.info == session.segment.info

    # One of the server's folder is read again; an upload is asked for, and not believed by name.
    raw = csv(platoon(3, 1200))
    place = Path(os.environ["ACCPINN_RECORDINGS"]) / "mine.csv"
    place.parent.mkdir(parents=True)
    place.write_bytes(raw)
    again.open(read(raw, "mine.csv"))
    again.choose((2, 3), Window(20.0, 70.0), "I")
    open_page(DATA, session=session.id)
    for _ in range(2):
        sessions.workspaces.clear()
        again = open_page(DATA, session=session.id).workspace()
        if not place.exists():
            assert again.awaited.source.name == "mine.csv"
            again.open(read(raw, "mine.csv"))
        assert again.awaited is None
        assert (again.window, again.vehicles, again.case) == (Window(20.0, 70.0), (2, 3), "I")
        place.unlink(missing_ok=True)


def test_a_run_is_not_restored_with_the_truth_of_another_recording() -> None:
    session, own = sessions.workspaces().new(), read(csv(platoon(5)), "own.csv")
    session.open(own)
    answer(session)
    session.open(*sample(FIRST_SAMPLE))
    assert session.true_parameters is not None
    (run,) = session.runs
    restore_run(session, run.id)
    assert session.recording is own
    assert session.true_parameters is None


def test_equal_runs_are_kept_once_unfinished_ones_never_and_two_are_compared() -> None:
    session = fitted(Window(0.0, 60.0))
    for case, outcome, count in (
        ("II", Outcome.CONVERGED, 1),
        ("I", Outcome.STOPPED, 1),
        ("I", Outcome.CONVERGED, 2),
    ):
        answer(session, case, outcome=outcome)
        assert len(session.runs) == count
    page = open_page(TRAIN, session).choose("runs_compare", True)
    assert "case: II → I" in page.plain()
