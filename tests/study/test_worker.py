"""The second process of a comparison: the same answers, and none where it cannot give any."""

import time

import numpy as np
import pytest
from accpinn.study.worker import Job, Worker, helpful, is_worthwhile

from accpinn.errors import SegmentError
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.study import worker as module
from tests.support.command import THREE

ALONE = TaskContext()


@pytest.fixture(scope="module")
def job() -> Job:
    return Job(cut(read(THREE), 0, 60), "II", None, {})


def test_it_answers_as_the_caller_would(job: Job) -> None:
    worker = Worker(job, ["splines", "dual-ukf"])
    while "dual-ukf" in worker._left:
        time.sleep(0.01)
    assert worker.leaves("splines"), "the caller came first"
    assert worker.leaves("pinn"), "it is never its own"
    assert not worker.leaves("dual-ukf")
    assert worker.answer("splines", ALONE) is None
    answer, expected = worker.answer("dual-ukf", ALONE), job.run("dual-ukf", ALONE)
    assert not worker.is_busy_with("dual-ukf")
    assert isinstance(answer, tuple)
    assert isinstance(expected, tuple)
    np.testing.assert_array_equal(answer[0].parameters.values, expected[0].parameters.values)
    np.testing.assert_array_equal(answer[1].holdout.gap_mae, expected[1].holdout.gap_mae)
    worker.close()


def test_what_it_cannot_start_is_the_callers(job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    worker = Worker(job, ["splines"])
    assert worker.answer("splines", ALONE) is None
    worker.close()


def test_a_stop_does_not_wait_for_it(job: Job) -> None:
    worker = Worker(job, ["particle"])
    while "particle" in worker._left:
        time.sleep(0.01)
    assert worker.answer("particle", TaskContext(should_stop=lambda: True)) is None
    worker.close()
    assert worker.answer("particle", ALONE) is None, "killed, so the caller's"


def test_a_refusal_is_an_answer(job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise SegmentError("Too little is left.")

    monkeypatch.setattr(module, "evaluate", refuse)
    assert isinstance(job.run("least-squares", ALONE), SegmentError)


def test_long_work_on_several_processors_is_worth_it(
    job: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, every = cut(read(THREE)), tuple(METHODS)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    assert "pinn" not in helpful(every)
    assert is_worthwhile(whole, every, ALONE)
    assert not is_worthwhile(whole, ("pinn", "splines"), ALONE)
    assert not is_worthwhile(job.segment, every, ALONE)
    assert not is_worthwhile(whole, every, TaskContext(threads=1))
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    assert not is_worthwhile(whole, every, ALONE)
