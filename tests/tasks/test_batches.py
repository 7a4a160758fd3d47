"""Batches and downloads as tasks: how far they are, and that one that was stopped goes on."""

import sys
from pathlib import Path
from types import ModuleType

import pytest

from accpinn.recordings.catalogue import Run
from accpinn.study.groups import read_study
from accpinn.study.studies import Request, read_request
from accpinn.tasks import Status, TaskQueue
from accpinn.tasks.batches import StudyTask
from tests.support.openacc_files import csv, platoon
from tests.support.samples import frame

RUN = Run("Casale", "part2.csv", None)
CONTENT = csv(platoon(2, 1500))


def test_workers_of_a_batch_do_not_run_the_page_that_the_server_calls_its_main_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, ran = tmp_path / "page.py", tmp_path / "ran"
    page.write_text(f"open({str(ran)!r}, 'w').close()")
    main = ModuleType("__main__")
    main.__file__ = str(page)
    monkeypatch.setitem(sys.modules, "__main__", main)
    (tmp_path / "run.csv").write_bytes(csv(frame()))
    sources = (str(tmp_path / "run.csv"),)
    queue = TaskQueue(prepare=lambda: None)
    study = tmp_path / "study"
    task = StudyTask("me", study, Request(sources, ("least-squares",), 60.0, workers=1))
    queue.submit(task)
    assert task.wait(120)
    assert (task.status, task.share, task.error) == (Status.DONE, 1.0, "")
    assert not ran.exists()
    assert len(read_study(study)) == task.summary.rows == 1
    request = read_request(study)
    assert (request.is_finished, request.sources) == (True, sources)
    queue.close()
