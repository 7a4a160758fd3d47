"""The queue of tasks, with work whose every step the test decides."""

import gc
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from queue import Queue
from typing import Any

import numpy as np
import pytest
from accpinn.methods.pinn.request import TrainingRequest
from accpinn.methods.store import Store

from accpinn.errors import ConfigError
from accpinn.methods.fit import Fit, History, Outcome, Progress
from accpinn.methods.method import TaskContext
from accpinn.methods.pinn.config import FAST, PAPER, PinnConfig
from accpinn.model.cthp import Parameters
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from accpinn.tasks.queue import KEPT_FOR, TaskQueue
from accpinn.tasks.task import Status, Task, get_ready, training_task
from tests.support.openacc_files import recording

WAIT = 20.0
"""Seconds after which a test gives up; a sound queue needs none of them."""
END = None
"""Given to a puppet: its steps are over."""


def moment(iteration: int, seconds: float, iterations: int = 100) -> Progress:
    parameters = Parameters.of([[0.1, 0.2, 1.0 + iteration]])
    return Progress("Adam", iteration, iterations, seconds, 2.0, 1.5, 0.5, 0.0, parameters)


def result(outcome: Outcome = Outcome.FINISHED, **changes: Any) -> Fit:
    fit = Fit("pinn", "II", Parameters([0.1], [0.2], [1.0]), None, outcome, 1.0, {})
    return replace(fit, **changes)


class Clock:
    """A clock that stands until it is moved."""

    now = 1000.0

    def __call__(self) -> float:
        return self.now


class Puppet:
    """The work of all tasks: it yields or raises what the test gives it, one after the other."""

    def __init__(self) -> None:
        """No task runs yet."""
        self.clock = Clock()
        self.queue: TaskQueue
        self.started: Queue[Any] = Queue()
        self.given: Queue[tuple[Any, threading.Event]] = Queue()
        self.context = TaskContext()
        self.working = self.most_at_once = 0

    def task(self, owner: str, name: Any, **options: Any) -> Task[Any]:
        """A task that tells its name when it starts; it ends with a fit or `END`."""

        def steps(context: TaskContext) -> Iterator[Any]:
            self.context = context
            self.working += 1
            self.most_at_once = max(self.most_at_once, self.working)
            self.started.put(name)
            try:
                while True:
                    item, taken = self.given.get(timeout=WAIT)
                    if isinstance(item, Exception):
                        raise item
                    if item is END:
                        return
                    if isinstance(item, Progress):
                        context.on_progress(item)
                    else:
                        yield item
                    taken.set()
                    if isinstance(item, Fit):
                        return
            finally:
                self.working -= 1

        return Task(owner, options.pop("kind", "training"), steps, **options)

    def training(self, owner: str, config: PinnConfig = FAST) -> Task[Fit]:
        return self.task(owner, config, request=TrainingRequest(segment(), "II", config))

    def train(self, owner: str, config: PinnConfig = FAST, anew: bool = False) -> Task[Fit]:
        return self.queue.submit(self.training(owner, config), anew)

    def give(self, *items: Any) -> None:
        """To be yielded or raised by whatever runs, now or later."""
        for item in items:
            self.given.put((item, threading.Event()))

    def step(self, item: Any) -> None:
        """The same, waiting until the task has taken note of it."""
        taken = threading.Event()
        self.given.put((item, taken))
        assert taken.wait(WAIT)

    def starts(self) -> Any:
        """Wait for the next task to start; its name."""
        return self.started.get(timeout=WAIT)


@cache
def segment() -> Segment:
    return cut(recording(names="AB"), 0.0, 20.0)


@pytest.fixture
def puppet() -> Iterator[Puppet]:
    found = Puppet()
    found.queue = TaskQueue(threads=1, clock=found.clock, prepare=lambda: None)
    yield found
    found.give(result(), result())  # whatever a test left running
    found.queue.close()


def finished(task: Task[Any]) -> Task[Any]:
    assert task.wait(WAIT)
    return task


def seed(number: int) -> PinnConfig:
    return replace(FAST, seed=number)


def test_progress_rate_and_time_left(puppet: Puppet) -> None:
    task = puppet.train("ann")
    known = (task.progress, task.rate, task.time_left, task.history(), task.share)
    assert known == (None, None, None, None, 0.0)
    puppet.step(moment(0, 0.0))
    assert task.rate is None  # one moment is no rate
    puppet.step(moment(10, 1.0))
    puppet.step(moment(30, 2.0))
    assert task.rate == 15.0
    puppet.step(moment(90, 5.0))
    assert task.rate == 20.0, "the rate is that of the last three seconds"
    assert (task.time_left, task.share) == (0.5, 0.9)
    history = task.history()
    np.testing.assert_array_equal(history.iteration, [0, 10, 30, 90])
    np.testing.assert_array_equal(history.parameters.values[:, 0, 2], [1, 11, 31, 91])


def test_the_history_of_the_result_replaces_the_live_one(puppet: Puppet) -> None:
    task = puppet.train("ann")
    puppet.step(moment(3, 0.1))
    zeros = np.zeros(2)
    tables = Parameters.of(np.zeros((2, 1, 3)))
    own = History(np.array([0.0, 7.0]), zeros, zeros, zeros, zeros, zeros, tables)
    puppet.give(result(history=own))
    assert finished(task).history() is own


def test_one_at_a_time_and_the_rest_wait(puppet: Puppet) -> None:
    ann = puppet.train("ann", seed(1))
    assert puppet.starts().seed == 1
    ben = puppet.train("ben", seed(2))
    cem = puppet.train("cem", seed(3))
    assert ben.status is cem.status is Status.QUEUED
    assert puppet.queue.ahead_of(ann) == ()
    assert puppet.queue.ahead_of(ben) == (ann,)
    assert puppet.queue.ahead_of(cem) == (ann, ben)
    assert puppet.queue.wait_for(ben) is None  # nothing is known of ann's yet
    puppet.step(moment(0, 0.0))
    puppet.step(moment(50, 2.0))
    assert puppet.queue.wait_for(ben) == 2.0
    assert puppet.queue.wait_for(cem) is None  # ben's has no rate yet
    puppet.give(result())
    finished(ann)
    assert puppet.starts().seed == 2
    assert puppet.queue.ahead_of(cem) == (ben,)
    puppet.give(result(), result())
    assert finished(cem).status is Status.DONE
    assert puppet.most_at_once == 1


def test_stop_keeps_the_result_so_far(puppet: Puppet) -> None:
    task = puppet.train("ann")
    assert puppet.starts() == FAST
    assert (task.status, task.is_active, task.is_stopping) == (Status.RUNNING, True, False)
    assert task.result is None
    puppet.queue.stop(task)
    assert task.is_stopping
    assert puppet.context.threads == 1
    assert puppet.context.should_stop()
    fit = result(Outcome.STOPPED)
    puppet.give(fit)
    assert finished(task).status is Status.STOPPED
    assert not task.is_stopping
    assert task.result is fit


def test_stop_of_a_waiting_task_ends_it_at_once(puppet: Puppet) -> None:
    ann = puppet.train("ann", seed(1))
    puppet.starts()
    ben = puppet.train("ben", seed(2))
    cem = puppet.train("cem", seed(3))
    puppet.queue.stop(ben)
    assert (ben.status, ben.result) == (Status.STOPPED, None)
    assert puppet.queue.ahead_of(cem) == (ann,)
    puppet.give(result(), result())
    assert puppet.starts().seed == 3
    finished(cem)
    puppet.queue.stop(cem)
    assert cem.status is Status.DONE, "nothing is left to be stopped"


def test_a_continued_training_keeps_its_history(puppet: Puppet) -> None:
    task = puppet.train("ann", PAPER)
    for k in range(4):
        puppet.step(moment(5 * k, 0.1 * k))
    puppet.queue.stop(task)
    puppet.give(result(Outcome.STOPPED))
    finished(task)
    again = puppet.train("ann", PAPER)
    assert again is not task
    np.testing.assert_array_equal(again.history().iteration, [0, 5, 10, 15])
    puppet.step(moment(15, 0.35))  # the checkpoint may lie a little back
    puppet.step(moment(20, 0.45))
    history = again.history()
    np.testing.assert_array_equal(history.iteration, [0, 5, 10, 15, 20])
    np.testing.assert_allclose(history.seconds[-2:], [0.35, 0.45])
    puppet.queue.stop(again)
    puppet.give(result(Outcome.STOPPED))
    finished(again)
    assert puppet.train("ann", PAPER, anew=True).history() is None


def test_an_equal_active_request_is_one_task(puppet: Puppet) -> None:
    task = puppet.train("ann")
    assert puppet.train("ann") is task
    other = puppet.train("ben")
    assert other is not task
    puppet.give(result(), result())
    finished(other)
    assert puppet.train("ann") is not task


def test_a_new_request_stops_the_owners_earlier_one(puppet: Puppet) -> None:
    first = puppet.train("ann", seed(1))
    puppet.starts()
    second = puppet.train("ann", seed(2))
    assert first.is_stopping
    third = puppet.train("ann", seed(3))
    assert second.status is Status.STOPPED
    assert puppet.queue.of("ann") is third
    puppet.give(result(Outcome.STOPPED))
    finished(first)
    assert puppet.starts().seed == 3


def test_a_fault_is_a_sentence_and_the_log_has_what_is_the_programs(
    puppet: Puppet, caplog: pytest.LogCaptureFixture
) -> None:
    task = puppet.train("ann")
    puppet.give(ZeroDivisionError("secret detail"))
    assert finished(task).status is Status.FAILED
    assert "ZeroDivisionError" in task.error
    assert "secret detail" not in task.error
    assert "Traceback" in caplog.text
    assert "secret detail" in caplog.text
    users = puppet.train("ann")
    puppet.give(ConfigError("batch: 5 is not allowed; choose 10 or more."))
    assert finished(users).status is Status.FAILED
    assert users.error == "batch: 5 is not allowed; choose 10 or more."
    after = puppet.train("ann")
    fit = result()
    puppet.give(fit)
    assert finished(after).status is Status.DONE, "the worker lives on"
    assert (after.results, after.error) == ((fit,), "")


def test_old_tasks_are_forgotten(puppet: Puppet) -> None:
    task = puppet.train("ann", seed(1))
    puppet.give(result())
    finished(task)
    last = puppet.train("ben", seed(2))
    assert [puppet.starts().seed for _ in range(2)] == [1, 2]  # so the end of the first is noted
    assert puppet.queue.of("ann") is task
    puppet.clock.now += KEPT_FOR + 1
    puppet.train("cem", seed(3))
    assert puppet.queue.of("ann") is None
    assert puppet.queue.of("ben") is last, "what still runs is never forgotten"


def test_too_many_tasks_are_forgotten(puppet: Puppet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("accpinn.tasks.queue.KEPT_TASKS", 2)
    for k in range(5):
        puppet.give(result())
        finished(puppet.train(f"user {k}", seed(k)))
    assert puppet.queue.of("user 1") is None
    assert puppet.queue.of("user 2")


def test_closing_stops_everything(puppet: Puppet) -> None:
    running = puppet.train("ann", seed(1))
    puppet.starts()
    waiting = puppet.train("ben", seed(2))
    puppet.give(result(Outcome.STOPPED))
    puppet.queue.close()
    assert running.status is waiting.status is Status.STOPPED


class TestSeveralResults:
    def comparison(self, puppet: Puppet, owner: str, **options: Any) -> Task[Any]:
        names = ("one", "two")
        return puppet.task(owner, "comparison", kind="comparison", names=names, **options)

    def test_they_come_one_by_one(self, puppet: Puppet) -> None:
        task = puppet.queue.submit(self.comparison(puppet, "ann", weights=(1.0, 3.0)))
        assert task.current == "one"
        puppet.step("first")
        puppet.step(moment(50, 1.0))
        assert (task.results, task.current) == (("first",), "two")
        assert task.share == pytest.approx(0.625)
        assert task.time_left is not None
        puppet.give("second", END)
        assert finished(task).status is Status.DONE
        assert (task.results, task.share) == (("first", "second"), 1.0)

    @pytest.mark.parametrize("stopped", [True, False])
    def test_a_stop_or_a_fault_keeps_what_is_known(self, puppet: Puppet, stopped: bool) -> None:
        task = puppet.queue.submit(self.comparison(puppet, "ann"))
        puppet.step("first")
        if stopped:
            puppet.queue.stop(task)
        puppet.give(END if stopped else ZeroDivisionError())
        assert finished(task).status is (Status.STOPPED if stopped else Status.FAILED)
        assert ("comparison" in task.error) is not stopped
        assert task.results == ("first",)

    def test_it_waits_for_trainings_and_replaces_its_owners_earlier_one(
        self, puppet: Puppet
    ) -> None:
        training = puppet.train("ann")
        puppet.starts()
        old = puppet.queue.submit(self.comparison(puppet, "ann"))
        bens = puppet.queue.submit(self.comparison(puppet, "ben"))
        new = puppet.queue.submit(self.comparison(puppet, "ann"))
        assert old.status is Status.STOPPED
        assert puppet.queue.ahead_of(new) == (training, bens)
        assert puppet.queue.of("ann") is training, "a comparison does not end a training"
        puppet.give(result(), "result", END, "result", END)
        finished(bens)
        finished(new)
        assert training.status is Status.DONE


class TestStore:
    @pytest.mark.parametrize("part", [0, 1], ids=["result", "checkpoint"])
    def test_a_damaged_file_is_noted_by_the_task_that_met_it(
        self, tmp_path: Path, part: int
    ) -> None:
        store, config = Store(tmp_path), replace(PAPER, iterations=2)
        request = TrainingRequest(segment(), "II", config)
        name = f"{request.keys[part]}.{('fit', 'state')[part]}.npz"
        (tmp_path / name).write_bytes(b"damaged")
        assert request.resume_iteration(store) is None
        queue = TaskQueue(store=store, threads=1)
        fits = [
            finished(queue.submit(training_task(owner, request))).result for owner in ("ann", "ben")
        ]
        queue.close()
        assert any(name in str(note) for note in fits[0].findings)
        assert not any(name in str(note) for note in fits[1].findings)
        assert [fit.cached for fit in fits] == [False, True]

    def test_it_is_read_while_others_may_ask(self, puppet: Puppet, tmp_path: Path) -> None:
        reading, read_on = threading.Event(), threading.Event()

        class Slow(Store):
            def load_fit(self, *_: object) -> None:
                reading.set()
                assert read_on.wait(WAIT)

        queue = TaskQueue(store=Slow(tmp_path), threads=1, prepare=lambda: None)
        task = puppet.training("ann")
        submitting = threading.Thread(target=queue.submit, args=(task,))
        submitting.start()
        assert reading.wait(WAIT)
        asked: list[Task[Any] | None] = []
        asking = threading.Thread(target=lambda: asked.append(queue.of("ben")))
        asking.start()
        asking.join(2.0)
        answered = list(asked)
        read_on.set()
        for thread in (submitting, asking):
            thread.join(WAIT)
        puppet.give(result())
        queue.close()
        assert answered == [None]

    def test_a_known_result_does_not_wait_for_its_turn(
        self, puppet: Puppet, tmp_path: Path
    ) -> None:
        store, known = Store(tmp_path), puppet.training("ben", seed(7))
        kept = result(unconstrained=result().parameters, active_bounds=((),))
        store.save_fit(known.request.key, kept)
        queue = TaskQueue(store=store, threads=1, prepare=lambda: None)
        running = queue.submit(puppet.training("ann", seed(1)))
        puppet.starts()
        queue.submit(known)
        assert known.status is Status.DONE
        assert known.result.cached
        assert running.status is Status.RUNNING
        puppet.give(result())
        queue.close()


def test_a_queue_that_is_too_long_refuses_in_a_sentence(
    puppet: Puppet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("accpinn.tasks.queue.LONGEST_QUEUE", 1)
    first = puppet.train("ann", seed(1))
    puppet.starts()
    waits, refused = puppet.train("bob", seed(2)), puppet.train("eve", seed(3))
    assert waits.status is Status.QUEUED
    assert refused.status is Status.FAILED
    assert refused.error.startswith("1 tasks are waiting already")
    puppet.give(result(), result())
    assert finished(waits).status is finished(first).status is Status.DONE


def test_an_idle_queue_tidies_up_and_still_takes_tasks() -> None:
    tidied = threading.Semaphore(0)
    queue = TaskQueue(threads=1, prepare=lambda: None, tidy=tidied.release, idle=0.01)
    assert tidied.acquire(timeout=WAIT)
    assert tidied.acquire(timeout=WAIT), "more than once"
    task = finished(queue.submit(Task("ann", "training", lambda _: iter([result()]))))
    assert task.status is Status.DONE
    queue.close()


def test_what_is_imported_is_not_searched_for_garbage() -> None:
    get_ready()
    searched = {id(found) for found in gc.get_objects()}
    assert id(sys.modules["scipy.linalg"].__dict__) not in searched


def test_a_library_that_cannot_be_loaded_fails_the_task_with_a_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    queue = TaskQueue(threads=1)
    task = training_task("ann", TrainingRequest(segment(), "II", PAPER))
    finished(queue.submit(task))
    queue.close()
    assert task.status is Status.FAILED
    assert task.error.startswith("PyTorch, which the PiNN needs, cannot be loaded (")
