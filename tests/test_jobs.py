"""The queue of trainings, with a stand-in for the training whose every step the test decides."""

import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from queue import Queue
from typing import Any

import numpy as np
import pytest

from accpinn.errors import ConfigError
from accpinn.methods.fit import Fit, History, Outcome, Progress
from accpinn.methods.pinn.config import FAST, PAPER, PinnConfig
from accpinn.methods.pinn.request import request_keys
from accpinn.methods.store import Store
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from accpinn.tasks.job import Job
from accpinn.tasks.queue import KEPT_FOR, KEPT_JOBS, TaskQueue
from accpinn.tasks.series import Series, TaskContext
from accpinn.tasks.task import Status
from tests.support.openacc_files import csv, platoon

WAIT = 20.0
"""Seconds after which a test gives up; a sound queue needs none of them."""

Command = Callable[[Any], Fit | None]


def moment(iteration: int, seconds: float, iterations: int = 100) -> Progress:
    table = np.array([[0.1, 0.2, 1.0 + iteration]])
    return Progress("Adam", iteration, iterations, seconds, 2.0, 1.5, 0.5, 0.0, table)


def result(outcome: Outcome = Outcome.FINISHED, **changes: Any) -> Fit:
    fit = Fit("pinn", "II", (Parameters(0.1, 0.2, 1.0),), None, outcome, 1.0, {})
    return replace(fit, **changes)


class Puppet:
    """In place of a training: does what it is told, one command after the other."""

    def __init__(self) -> None:
        """Not called yet."""
        self.started: Queue[PinnConfig] = Queue()
        self.commands: Queue[Command] = Queue()
        self.calls: dict[str, Any] = {}
        self.working = 0
        self.most_at_once = 0

    def __call__(self, segment: Segment, case: str, config: PinnConfig, **options: Any) -> Fit:
        self.calls = options
        self.working += 1
        self.most_at_once = max(self.most_at_once, self.working)
        try:
            self.started.put(config)
            while True:
                fit = self.commands.get(timeout=WAIT)(options)
                if fit:
                    return fit
        finally:
            self.working -= 1

    def step(self, iteration: int, seconds: float) -> None:
        """Report a moment, and wait until that is done."""
        done = threading.Event()

        def command(options: Any) -> None:
            options["on_progress"](moment(iteration, seconds))
            done.set()

        self.commands.put(command)
        assert done.wait(WAIT)

    def end(self, fit: Fit | None = None) -> None:
        self.commands.put(lambda options: fit or result())

    def end_if_stopped(self) -> None:
        def command(options: Any) -> Fit:
            assert options["should_stop"]()
            return result(Outcome.STOPPED)

        self.commands.put(command)

    def fail(self, fault: Exception) -> None:
        def command(options: Any) -> None:
            raise fault

        self.commands.put(command)


class Clock:
    """A clock that stands until it is moved."""

    now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture(scope="module")
def segment() -> Segment:
    return cut(read(csv(platoon(vehicles=2)), "run.csv"), 0.0, 20.0, (1, 2))


@pytest.fixture
def puppet() -> Puppet:
    return Puppet()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def trainings(puppet: Puppet, clock: Clock) -> Iterator[TaskQueue]:
    queue = TaskQueue(train=puppet, threads=1, clock=clock)
    yield queue
    puppet.end()  # whatever a test left running
    puppet.end()
    queue.close()


def finished(job: Job) -> Job:
    assert job.wait(WAIT)
    return job


def seed(number: int) -> PinnConfig:
    return replace(FAST, seed=number)


def test_a_job_runs_to_its_end(trainings: TaskQueue, puppet: Puppet, segment: Segment) -> None:
    job = trainings.submit("ann", segment, "II", FAST)
    assert puppet.started.get(timeout=WAIT) == FAST
    assert job.status is Status.RUNNING
    assert job.is_active
    assert job.fit is None
    puppet.end(result(notes=("well done",)))
    assert finished(job).status is Status.DONE
    assert job.fit is not None
    assert job.fit.notes == ("well done",)
    assert job.error == ""
    assert puppet.calls["threads"] == 1


def test_progress_rate_and_time_left(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    job = trainings.submit("ann", segment, "II", FAST)
    assert job.progress is None
    assert job.rate is None
    assert job.time_left is None
    assert job.history() is None
    puppet.step(0, 0.0)
    assert job.rate is None  # one moment is no rate
    puppet.step(10, 1.0)
    puppet.step(30, 2.0)
    assert job.rate == 15.0
    puppet.step(90, 5.0)
    assert job.rate == 20.0, "the rate is that of the last three seconds"
    assert job.time_left == 0.5
    assert job.progress is not None
    assert job.progress.iteration == 90
    history = job.history()
    assert history is not None
    np.testing.assert_array_equal(history.iteration, [0, 10, 30, 90])
    np.testing.assert_array_equal(history.parameters[:, 0, 2], [1, 11, 31, 91])


def test_the_course_stays_bounded_while_it_runs(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    job = trainings.submit("ann", segment, "II", FAST)
    puppet.step(0, 0.0)

    def many(options: Any) -> None:
        for k in range(1, 9000):
            options["on_progress"](moment(k, k * 0.01))

    puppet.commands.put(many)
    puppet.step(9000, 90.0)
    history = job.history()
    assert history is not None
    assert len(history.iteration) <= 2001
    assert history.iteration[0] == 0
    assert history.iteration[-1] == 9000


def test_the_result_s_own_course_replaces_the_live_one(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    job = trainings.submit("ann", segment, "II", FAST)
    puppet.step(3, 0.1)
    zeros = np.zeros(2)
    own = History(np.array([0.0, 7.0]), zeros, zeros, zeros, zeros, zeros, np.zeros((2, 1, 3)))
    puppet.end(result(history=own))
    assert finished(job).history() is own


def test_one_at_a_time_and_the_rest_wait(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    ann = trainings.submit("ann", segment, "II", seed(1))
    assert puppet.started.get(timeout=WAIT).seed == 1
    ben = trainings.submit("ben", segment, "II", seed(2))
    cem = trainings.submit("cem", segment, "II", seed(3))
    assert ben.status is cem.status is Status.QUEUED
    assert trainings.ahead_of(ann) == ()
    assert trainings.ahead_of(ben) == (ann,)
    assert trainings.ahead_of(cem) == (ann, ben)
    assert trainings.wait_for(ben) is None  # nothing is known of ann's yet
    puppet.step(0, 0.0)
    puppet.step(50, 2.0)
    assert trainings.wait_for(ben) == 2.0
    assert trainings.wait_for(cem) is None  # ben's has no rate yet
    puppet.end()
    finished(ann)
    assert puppet.started.get(timeout=WAIT).seed == 2
    assert trainings.ahead_of(cem) == (ben,)
    puppet.end()
    assert puppet.started.get(timeout=WAIT).seed == 3
    puppet.end()
    assert finished(cem).status is Status.DONE
    assert puppet.most_at_once == 1


def test_stop_keeps_the_result_so_far(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    job = trainings.submit("ann", segment, "II", PAPER)
    puppet.started.get(timeout=WAIT)
    assert not job.is_stopping
    trainings.stop(job)
    assert job.is_stopping
    puppet.end_if_stopped()
    assert finished(job).status is Status.STOPPED
    assert not job.is_stopping
    assert job.fit is not None
    assert job.fit.outcome is Outcome.STOPPED


def test_stop_of_a_waiting_job_ends_it_at_once(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    ann = trainings.submit("ann", segment, "II", seed(1))
    puppet.started.get(timeout=WAIT)
    ben = trainings.submit("ben", segment, "II", seed(2))
    cem = trainings.submit("cem", segment, "II", seed(3))
    trainings.stop(ben)
    assert ben.status is Status.STOPPED
    assert ben.fit is None
    assert trainings.ahead_of(cem) == (ann,)
    puppet.end()
    assert puppet.started.get(timeout=WAIT).seed == 3
    puppet.end()
    finished(cem)


def test_stop_of_a_finished_job_changes_nothing(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    job = trainings.submit("ann", segment, "II", FAST)
    puppet.end()
    finished(job)
    trainings.stop(job)
    assert job.status is Status.DONE
    assert not job.is_stopping


def test_a_continued_job_keeps_its_course(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    job = trainings.submit("ann", segment, "II", PAPER)
    for k in range(4):
        puppet.step(5 * k, 0.1 * k)
    trainings.stop(job)
    puppet.end_if_stopped()
    finished(job)
    again = trainings.submit("ann", segment, "II", PAPER)
    assert again is not job
    history = again.history()
    assert history is not None
    np.testing.assert_array_equal(history.iteration, [0, 5, 10, 15])
    puppet.step(15, 0.35)  # the checkpoint may lie a little back
    puppet.step(20, 0.45)
    history = again.history()
    assert history is not None
    np.testing.assert_array_equal(history.iteration, [0, 5, 10, 15, 20])
    np.testing.assert_allclose(history.seconds[-2:], [0.35, 0.45])


def test_the_same_request_twice_is_one_job(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    job = trainings.submit("ann", segment, "II", FAST)
    assert trainings.submit("ann", segment, "II", FAST) is job
    assert trainings.submit("ben", segment, "II", FAST) is not job
    puppet.end()
    puppet.end()
    finished(job)
    assert trainings.submit("ann", segment, "II", FAST) is not job


def test_a_new_request_stops_the_owner_s_earlier_one(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    first = trainings.submit("ann", segment, "II", seed(1))
    puppet.started.get(timeout=WAIT)
    second = trainings.submit("ann", segment, "II", seed(2))
    assert first.is_stopping
    third = trainings.submit("ann", segment, "II", seed(3))
    assert second.status is Status.STOPPED
    assert trainings.of("ann") is third
    puppet.end_if_stopped()
    finished(first)
    assert puppet.started.get(timeout=WAIT).seed == 3


def test_a_fault_of_the_user_s_is_told_verbatim(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    job = trainings.submit("ann", segment, "II", FAST)
    puppet.fail(ConfigError("batch: 5 is not allowed; choose 10 or more."))
    assert finished(job).status is Status.FAILED
    assert job.error == "batch: 5 is not allowed; choose 10 or more."


def test_a_fault_of_ours_is_one_sentence_and_the_log_has_the_rest(
    trainings: TaskQueue, puppet: Puppet, segment: Segment, caplog: pytest.LogCaptureFixture
) -> None:
    job = trainings.submit("ann", segment, "II", FAST)
    puppet.fail(ZeroDivisionError("secret detail"))
    assert finished(job).status is Status.FAILED
    assert "ZeroDivisionError" in job.error
    assert "secret detail" not in job.error
    assert "Traceback" in caplog.text
    assert "secret detail" in caplog.text
    after = trainings.submit("ann", segment, "II", FAST)
    puppet.end()
    assert finished(after).status is Status.DONE, "the worker lives on"


@pytest.mark.parametrize("part", [0, 1], ids=["result", "checkpoint"])
def test_a_damaged_file_is_said_in_the_notes_of_the_job_that_met_it(
    segment: Segment, tmp_path: Path, part: int
) -> None:
    store, config = Store(tmp_path), replace(FAST, iterations=2)
    name = f"{request_keys(segment, 'II', config)[part]}.{('fit', 'state')[part]}.npz"
    (tmp_path / name).write_bytes(b"damaged")
    trainings = TaskQueue(store=store, threads=1)
    try:
        assert trainings.resume_iteration(segment, "II", config) is None
        notes = []
        for owner in ("ann", "ben"):
            job = finished(trainings.submit(owner, segment, "II", config))
            assert job.fit is not None
            notes.append([note for note in job.fit.notes if "set aside" in note])
    finally:
        trainings.close()
    assert notes[0][0].startswith(name)
    assert notes[1] == [], "the next one is told nothing of it"


def test_the_disk_is_read_while_others_may_ask(
    puppet: Puppet, segment: Segment, tmp_path: Path
) -> None:
    reading, read_on = threading.Event(), threading.Event()

    class Slow(Store):
        def load_fit(self, *_: object) -> None:
            reading.set()
            assert read_on.wait(WAIT)

    trainings = TaskQueue(train=puppet, store=Slow(tmp_path), threads=1)
    submitting = threading.Thread(target=trainings.submit, args=("ann", segment, "II", FAST))
    submitting.start()
    assert reading.wait(WAIT)
    asked: list[Job | None] = []
    asking = threading.Thread(target=lambda: asked.append(trainings.of("ben")))
    asking.start()
    asking.join(2.0)
    answered = list(asked)
    read_on.set()
    for thread in (submitting, asking):
        thread.join(WAIT)
    puppet.end()
    trainings.close()
    assert answered == [None]


def test_a_library_that_cannot_be_loaded_fails_the_job_with_a_sentence(
    segment: Segment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "accpinn.methods.pinn.training", None)
    trainings = TaskQueue(threads=1)
    job = finished(trainings.submit("ann", segment, "II", FAST))
    trainings.close()
    assert job.status is Status.FAILED
    assert job.error.startswith("PyTorch, which trains the network, cannot be loaded (")


def test_old_jobs_are_forgotten(
    trainings: TaskQueue, puppet: Puppet, segment: Segment, clock: Clock
) -> None:
    job = trainings.submit("ann", segment, "II", seed(1))
    puppet.end()
    finished(job)
    last = trainings.submit("ben", segment, "II", seed(2))  # after it, the first one is noted
    puppet.started.get(timeout=WAIT)
    assert puppet.started.get(timeout=WAIT).seed == 2
    assert trainings.of("ann") is job
    clock.now += KEPT_FOR + 1
    trainings.submit("cem", segment, "II", seed(3))
    assert trainings.of("ann") is None
    assert trainings.of("ben") is last, "what still runs is never forgotten"


def test_too_many_jobs_are_forgotten(
    trainings: TaskQueue, puppet: Puppet, segment: Segment
) -> None:
    for k in range(KEPT_JOBS + 5):
        job = trainings.submit(f"user {k}", segment, "II", seed(k))
        puppet.end()
        finished(job)
    assert trainings.of("user 0") is None
    assert trainings.of(f"user {KEPT_JOBS + 4}") is job


def test_a_known_result_does_not_wait_for_its_turn(
    puppet: Puppet, segment: Segment, tmp_path: Path
) -> None:
    store = Store(tmp_path)
    result_key, _ = request_keys(segment, "II", seed(7))
    kept = result(unconstrained=result().parameters, active_bounds=((),))
    store.save_fit(result_key, kept)
    trainings = TaskQueue(train=puppet, store=store, threads=1)
    running = trainings.submit("ann", segment, "II", seed(1))
    puppet.started.get(timeout=WAIT)
    known = trainings.submit("ben", segment, "II", seed(7))
    assert known.status is Status.DONE
    assert known.fit is not None
    assert known.fit.cached
    assert running.status is Status.RUNNING
    puppet.end()
    trainings.close()


def test_closing_stops_everything(puppet: Puppet, segment: Segment) -> None:
    trainings = TaskQueue(train=puppet, threads=1)
    running = trainings.submit("ann", segment, "II", seed(1))
    puppet.started.get(timeout=WAIT)
    waiting = trainings.submit("ben", segment, "II", seed(2))
    puppet.end_if_stopped()
    trainings.close()
    assert running.status is waiting.status is Status.STOPPED


def test_the_real_training_is_the_default(segment: Segment, tmp_path: Path) -> None:
    trainings = TaskQueue(store=Store(tmp_path), threads=1)
    config = replace(FAST, iterations=20)
    job = trainings.submit("ann", segment, "II", config)
    assert job.wait(120)
    assert job.fit is not None, job.error
    again = trainings.submit("ann", segment, "II", config)
    assert again.wait(WAIT)
    trainings.close()
    assert again.fit is not None
    assert again.fit.cached
    np.testing.assert_array_equal(again.fit.parameters.values, job.fit.parameters.values)


class TestSeries:
    """Results one by one, each when the test lets it come."""

    def series(self, owner: str, gate: "Queue[Any]", **options: Any) -> Series[Any]:
        def steps(means: TaskContext) -> Iterator[Any]:
            while not means.should_stop():
                item = gate.get(timeout=WAIT)
                if isinstance(item, Exception):
                    raise item
                if isinstance(item, Progress):
                    means.on_progress(item)
                elif item is None:
                    return
                else:
                    yield item
                gate.task_done()

        return Series(owner, "comparison", ("one", "two"), steps, **options)

    def test_results_come_one_by_one(self, trainings: TaskQueue) -> None:
        gate: Queue[Any] = Queue()
        series = trainings.run(self.series("ann", gate, efforts=(1.0, 3.0)))
        assert series.current == "one"
        gate.put("first")
        gate.put(moment(50, 1.0))
        gate.join()
        assert series.results == ("first",)
        assert series.current == "two"
        assert series.share == pytest.approx(0.625)
        assert series.time_left is not None
        gate.put("second")
        gate.put(None)
        assert series.wait(WAIT)
        assert series.status is Status.DONE
        assert series.results == ("first", "second")
        assert series.share == 1.0

    def test_a_stop_keeps_what_is_known(self, trainings: TaskQueue) -> None:
        gate: Queue[Any] = Queue()
        series = trainings.run(self.series("ann", gate))
        gate.put("first")
        gate.join()
        trainings.stop(series)
        gate.put(None)
        assert series.wait(WAIT)
        assert series.status is Status.STOPPED
        assert series.results == ("first",)
        assert series.time_left is None

    @pytest.mark.parametrize(
        ("fault", "said"),
        [(ConfigError("methods: none."), "methods: none."), (ZeroDivisionError(), "comparison")],
    )
    def test_a_fault_keeps_what_is_known(
        self, trainings: TaskQueue, fault: Exception, said: str
    ) -> None:
        gate: Queue[Any] = Queue()
        series = trainings.run(self.series("ann", gate))
        gate.put("first")
        gate.put(fault)
        assert series.wait(WAIT)
        assert series.status is Status.FAILED
        assert said in series.error
        assert series.results == ("first",)

    def test_waits_for_trainings_and_replaces_its_owner_s_earlier_one(
        self, trainings: TaskQueue, puppet: Puppet, segment: Segment
    ) -> None:
        job = trainings.submit("ann", segment, "II", FAST)
        puppet.started.get(timeout=WAIT)
        gate: Queue[Any] = Queue()
        old = trainings.run(self.series("ann", gate))
        bens = trainings.run(self.series("ben", gate))
        new = trainings.run(self.series("ann", gate))
        assert old.status is Status.STOPPED
        assert trainings.ahead_of(new) == (job, bens)
        assert trainings.of("ann") is job, "a comparison does not end a training"
        puppet.end()
        for _ in range(2):
            gate.put("result")
            gate.put(None)
        assert bens.wait(WAIT)
        assert new.wait(WAIT)
        assert job.status is Status.DONE
