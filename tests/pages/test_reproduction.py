"""The page Reproduce: figures before any training, one button for all tables, what is missing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.errors import RecordingError
from accpinn.model.published import ASTAZERO, VICOLUNGO
from accpinn.recordings import Window
from accpinn.recordings.openacc import catalogue, read
from accpinn.results.reproduction import ASTAZERO_RUN, CASALE_RUN, ITEMS, PANELS, item_of
from accpinn.stability import stability_report
from accpinn.study.run import run
from accpinn.tasks import Status
from pages.ui.components.frame import REPRODUCE
from pages.ui.data.sources import OPENING, RUN
from pages.ui.session.resources import store
from tests.support.apptest import PAGES, WAIT, Page, numbers, open_page, with_pair
from tests.support.openacc_files import csv, metadata, platoon

pytestmark = pytest.mark.usefixtures("fresh_server")

TABLE_I, TABLE_II, TABLE_III = ITEMS[:3]
TRAININGS = 7
"""Five starts of Table I, and one training of each of the others."""


def shown(page: Page, name: str) -> list[dict[str, object]]:
    """The charts on the page that have a trace of that name."""
    return [
        figure
        for figure in page.figures()
        if any(trace.get("name") == name for trace in figure["data"])
    ]


def on_one_click(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Page:
    """The page with recordings of a folder, once its button was pressed and all is done."""
    monkeypatch.setenv("ACCPINN_RECORDINGS", str(folder))
    page = open_page("Reproduce").press("paper_all")
    task = page.workspace().reproduction
    assert task
    assert task.wait(WAIT)
    return page.sound()


def test_it_is_the_last_page_and_one_click_from_home() -> None:
    assert [*PAGES.values()][-1] == REPRODUCE
    assert "home_reproduce" in open_page("Home").buttons


def test_the_figures_stand_there_before_any_training() -> None:
    page = open_page("Reproduce")
    for vehicles in (ASTAZERO, VICOLUNGO):
        (bode,) = shown(page, vehicles.labels[0])[:1]
        for label, vehicle in zip(
            vehicles.labels, stability_report(vehicles.parameters).vehicles, strict=True
        ):
            (line,) = [trace for trace in bode["data"] if trace.get("name") == label]
            assert numbers(line["y"]).max() == pytest.approx(vehicle.peak.db, abs=0.02)
    panels = page.figures()[2:6]
    assert len({tuple(panel["layout"]["yaxis"]["range"]) for panel in panels}) == 1, "one scale"
    for panel, figure in zip(PANELS, panels, strict=True):
        assert len(figure["data"]) == 9
        last = figure["data"][7]  # the eighth follower; the leader is drawn last, on top
        late = numbers(last["y"])[numbers(last["x"]) > 400]
        assert np.ptp(late) / 2 == pytest.approx(panel.gain(ASTAZERO.parameters), rel=0.03)
    assert not page.workspace().runs


def test_a_recording_that_is_not_here_is_named_with_the_way_to_it() -> None:
    page = open_page("Reproduce")
    assert page.button(key="paper_all").disabled
    for taken in (CASALE_RUN, ASTAZERO_RUN):
        assert "/".join(taken.place) in page.plain()
    session = page.workspace()
    page.press("paper_get_ASta_040719_platoon5_csv")
    chosen = page.session_state[RUN]
    assert chosen in catalogue()
    assert (chosen.campaign, chosen.file) == ASTAZERO_RUN.place
    assert page.session_state[OPENING]
    assert session.recording is None


def test_a_file_of_that_name_that_is_another_run_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder = tmp_path / "recordings" / CASALE_RUN.campaign
    folder.mkdir(parents=True)
    (folder / CASALE_RUN.file).write_bytes(csv(platoon(vehicles=2), metadata(("A", "B"))))
    page = on_one_click(folder.parent, monkeypatch)
    task = page.workspace().reproduction
    assert (task.status, task.results) == (Status.FAILED, ())
    assert [CASALE_RUN.file in said for said in page.boxes("error")] == [True]
    assert "AstaZero/" in page.plain(), "the other is missing"


def test_one_click_learns_all_tables(monkeypatch: pytest.MonkeyPatch, openacc_dir: Path) -> None:
    monkeypatch.setenv("ACCPINN_RECORDINGS", str(openacc_dir))
    session = with_pair()
    before = session.recording
    page = open_page("Reproduce", session).press("paper_all")
    task = session.reproduction
    assert task.wait(WAIT)
    assert (task.status, len(task.results)) == (Status.DONE, TRAININGS)
    assert session.recording is before, "what is open stays open"
    page.sound()
    for item in (TABLE_I, TABLE_II, TABLE_III):
        learned = item.learned(task.results)
        comparison = item.compared(learned)
        assert comparison.deviation.startswith("✓")
        assert comparison.learned in page.plain()
        assert comparison.deviation in page.plain()
    first = [result.analysis.config.initial.values.tolist() for result in task.results[:5]]
    assert len({str(initial) for initial in first}) == 5
    assert len(TABLE_I.learned(task.results)) == 5
    assert shown(page, f"{ASTAZERO.labels[0]}, learned")[0] == page.figures()[0]
    entries = store().entries(session=session.key)
    assert [entry.source for entry in entries].count(CASALE_RUN.file) == 1, "not each start"
    session.reproduction = None
    again = open_page("Reproduce", session).plain()
    assert TABLE_III.compared(TABLE_III.learned(task.results)).learned in again, "kept as runs"


def test_it_can_be_stopped(monkeypatch: pytest.MonkeyPatch, openacc_dir: Path) -> None:
    monkeypatch.setenv("ACCPINN_RECORDINGS", str(openacc_dir))
    page = open_page("Reproduce").press("paper_all")
    page.press("paper_stop")
    task = page.workspace().reproduction
    assert task.wait(WAIT)
    assert task.status is Status.STOPPED
    assert len(task.results) < TRAININGS
    assert "paper_all" in page.sound().buttons


def test_learned_rows_of_another_window_are_no_rows_of_a_table(openacc_dir: Path) -> None:
    assert TABLE_I.learned(()) is None
    assert TABLE_I.compared(None).learned == ""
    assert not TABLE_III.compared(ASTAZERO.parameters[:1]).deviation.startswith("✓")
    recording = read(openacc_dir / CASALE_RUN.campaign / CASALE_RUN.file)
    (asked, *others) = TABLE_I.analyses(recording)
    assert len(others) == 4
    shorter = replace(asked, windows=(Window(0.0, 60.0),))
    result = run(shorter, recording)
    assert item_of(result) is None
    assert TABLE_I.learned([result]) is None
    with pytest.raises(RecordingError, match=ASTAZERO_RUN.file):
        TABLE_III.analyses(recording)
