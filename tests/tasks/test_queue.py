"""The queue of tasks, with work whose every step the test decides."""

import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from queue import Queue
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from accpinn import Analysis, Estimate, Parameters, PinnConfig, Recording, Result, Store
from accpinn import tasks as module
from accpinn.errors import ConfigError
from accpinn.methods import TaskContext
from accpinn.methods.estimate import History, Outcome, Progress
from accpinn.methods.forecast import SETTLED
from accpinn.methods.pinn.config import FAST, PAPER
from accpinn.model.cthp import Trajectories
from accpinn.study import single_window
from accpinn.study.result import result_of
from accpinn.tasks import Status, Task, TaskQueue, training_task
from tests.support.openacc_files import recording

WAIT = 90.0
"""Longest wait of a test, in s; a sound queue needs none of it."""
END = None
"""Given to a puppet: its steps are over."""


@cache
def run() -> Recording:
    return recording(names="AB")


def asked(config: PinnConfig = FAST) -> Analysis:
    return Analysis.of(run(), single_window(0.0, 20.0), method="pinn", settings=config)


def moment(iteration: int, seconds: float, phase: str = "Adam", **others: Any) -> Progress:
    parameters = Parameters.of([[0.1, 0.2, 1.0 + iteration]])
    return Progress(phase, iteration, 100, seconds, 2.0, 1.5, 0.5, 0.0, parameters, **others)


def point(outcome: Outcome = Outcome.FINISHED, **changes: Any) -> Estimate:
    analysis = asked()
    data, spec = analysis.segments(run()), analysis.spec
    parameters = Parameters([0.1], [0.2], [1.0])
    return Estimate.of("pinn", data, "II", spec, parameters, outcome=outcome, **changes)


def result(outcome: Outcome = Outcome.FINISHED, **changes: Any) -> Result:
    analysis = asked()
    return result_of(analysis, analysis.segments(run()), point(outcome, **changes))


def seed(number: int) -> PinnConfig:
    return replace(FAST, seed=number)


class Puppet:
    """The work of all tasks: it yields or raises what the test gives it, one after the other."""

    def __init__(self) -> None:
        """No task runs yet."""
        self.queue = TaskQueue(prepare=lambda: None)
        self.started: Queue[Any] = Queue()
        self.given: Queue[tuple[Any, threading.Event]] = Queue()
        self.context = TaskContext()

    def task(self, owner: str, name: Any = "", **options: Any) -> Task[Any]:
        """A task that tells its name when it starts; it ends with a result or `END`."""

        def steps(context: TaskContext) -> Iterator[Any]:
            self.context = context
            self.started.put(name)
            while True:
                item, taken = self.given.get(timeout=WAIT)
                if isinstance(item, Exception):
                    raise item
                if item is END:
                    return
                if isinstance(item, Progress):
                    context.on_progress(item)
                elif isinstance(item, Estimate):
                    context.on_estimate(item)
                else:
                    yield item
                taken.set()
                if isinstance(item, Result):
                    return

        return Task(owner, options.pop("kind", "training"), steps, **options)

    def train(self, owner: str, config: PinnConfig = FAST) -> Task[Any]:
        """Submit a training whose name is its settings."""
        return self.queue.submit(self.task(owner, config, analysis=asked(config)))

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


@pytest.fixture
def puppet() -> Iterator[Puppet]:
    made = Puppet()
    yield made
    made.give(result(), result())  # whatever a test left running
    made.queue.close()


def finished(task: Task[Any]) -> Task[Any]:
    assert task.wait(WAIT)
    return task


def test_progress_time_left_and_history(puppet: Puppet, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock[0], time=time.time))
    task = puppet.train("ann")
    known = (task.progress, task.time_left, task.history(), task.share)
    assert known == (None, None, None, 0.0)
    puppet.step(moment(0, 0.0))
    assert (task.time_left, task.share) == (None, 0.0), "nothing is known of it"
    puppet.step(moment(10, 1.0, left=9.0))
    assert (task.time_left, task.share) == (9.0, 0.1)
    clock[0] += 3.0
    assert (task.time_left, task.share) == (6.0, 0.4), "it passes between two moments"
    clock[0] += 9.0
    assert task.time_left == 3.0, "what takes longer than was told is not soon over"
    puppet.step(moment(30, 15.0, left=5.0))
    assert (task.time_left, task.share) == (5.0, 0.75)
    history = task.history()
    np.testing.assert_array_equal(history.iteration, [0, 10, 30])
    np.testing.assert_array_equal(history.parameters.values[:, 0, 2], [1, 11, 31])
    zeros = np.zeros(2)
    tables = Parameters.of(np.zeros((2, 1, 3)))
    own = History(np.array([0.0, 7.0]), zeros, zeros, zeros, zeros, zeros, tables)
    puppet.give(result(history=own))
    assert finished(task).history() is own, "the result's takes the place of the live one"


def test_the_point_comes_before_its_intervals_which_are_a_phase_of_their_own(
    puppet: Puppet,
) -> None:
    task = puppet.train("ann")
    puppet.step(moment(10, 1.0))
    puppet.step(moment(30, 2.0))
    curves = Trajectories(np.zeros(1), np.zeros((1, 2)), np.zeros((1, 1)))
    puppet.step(moment(40, 2.5, curves=curves))
    assert (task.point, task.curves) == (None, curves)
    known = point()
    puppet.step(known)
    assert task.point is known
    for phase in SETTLED:
        puppet.step(moment(0, 3.0, phase))
    assert task.curves is curves
    np.testing.assert_array_equal(task.history().iteration, [10, 30, 40])
    puppet.give(result())
    assert finished(task).point is None, "the result has it"


def test_one_at_a_time_and_the_others_wait(puppet: Puppet) -> None:
    ann = puppet.train("ann", seed(1))
    assert puppet.starts().seed == 1
    ben, cem = puppet.train("ben", seed(2)), puppet.train("cem", seed(3))
    assert ben.status is cem.status is Status.QUEUED
    assert puppet.queue.ahead_of(ann) == ()
    assert puppet.queue.ahead_of(cem) == (ann, ben)
    assert puppet.queue.wait_for(ben) is None  # nothing is known of ann's yet
    puppet.step(moment(0, 0.0))
    puppet.step(moment(50, 2.0, left=200.0))
    assert puppet.queue.wait_for(ben) == pytest.approx(200.0, abs=WAIT)
    assert puppet.queue.wait_for(cem) is None  # nothing is known of ben's yet
    puppet.give(result())
    finished(ann)
    assert puppet.starts().seed == 2
    assert puppet.queue.ahead_of(cem) == (ben,)
    assert puppet.started.empty()
    puppet.give(result(), result())
    assert finished(cem).status is Status.DONE


def test_stop_keeps_the_result_so_far_and_ends_at_once_what_waits(puppet: Puppet) -> None:
    task = puppet.train("ann")
    puppet.starts()
    waiting = puppet.train("ben", seed(2))
    waiting.stop()
    assert (waiting.status, waiting.result) == (Status.STOPPED, None)
    assert (task.status, task.is_stopping, task.result) == (Status.RUNNING, False, None)
    task.stop()
    assert task.is_stopping
    assert puppet.context.should_stop()
    stopped = result(Outcome.STOPPED)
    puppet.give(stopped)
    assert finished(task).status is Status.STOPPED
    assert task.result is stopped
    assert not task.is_stopping
    after = puppet.train("cem", seed(3))
    assert puppet.starts().seed == 3, "what was stopped never starts"
    puppet.give(result())
    finished(after).stop()
    assert after.status is Status.DONE, "nothing is left to be stopped"


def test_a_new_request_stops_the_owners_earlier_one_but_an_equal_one_is_the_same(
    puppet: Puppet,
) -> None:
    first = puppet.train("ann", seed(1))
    puppet.starts()
    assert puppet.train("ann", seed(1)) is first
    second = puppet.train("ann", seed(2))
    assert first.is_stopping
    third = puppet.train("ann", seed(3))
    assert second.status is Status.STOPPED
    assert puppet.queue.of("ann") is third
    puppet.give(result(Outcome.STOPPED))
    finished(first)
    assert puppet.starts().seed == 3
    puppet.give(result())
    finished(third)
    assert puppet.train("ann", seed(3)) is not third


def test_a_fault_is_a_sentence_and_the_log_has_what_is_the_programs(
    puppet: Puppet, caplog: pytest.LogCaptureFixture
) -> None:
    task = puppet.train("ann")
    puppet.give(ZeroDivisionError("secret detail"))
    assert finished(task).status is Status.FAILED
    assert "ZeroDivisionError" in task.error
    assert "secret detail" not in task.error
    assert "secret detail" in caplog.text
    users = puppet.train("ann")
    puppet.give(ConfigError("batch: 5 is not allowed; choose 10 or more."))
    assert finished(users).error == "batch: 5 is not allowed; choose 10 or more."
    after = puppet.train("ann")
    puppet.give(result())
    assert finished(after).status is Status.DONE, "the worker lives on"
    assert after.error == ""


def test_tasks_are_bounded_in_number(puppet: Puppet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("accpinn.tasks.KEPT_TASKS", 2)
    monkeypatch.setattr("accpinn.tasks.LONGEST_QUEUE", 1)
    for k in range(5):
        puppet.give(result())
        finished(puppet.train(f"user {k}", seed(k)))
        puppet.starts()
    assert puppet.queue.of("user 1") is None
    assert puppet.queue.of("user 3")
    first = puppet.train("ann", seed(1))
    puppet.starts()
    waits, refused = puppet.train("bob", seed(2)), puppet.train("eve", seed(3))
    assert waits.status is Status.QUEUED
    assert refused.status is Status.FAILED
    assert refused.error.startswith("1 tasks are waiting already")
    puppet.give(result(), result())
    assert finished(waits).status is finished(first).status is Status.DONE


class TestOfManyUsers:
    """Who fills the queue holds up himself; a limit of time and the operator end what runs."""

    def started(self, puppet: Puppet, count: int) -> list[Any]:
        puppet.give(*[result() for _ in range(count)])
        return [puppet.starts() for _ in range(count)]

    def submit(self, puppet: Puppet, user: str, name: str) -> Task[Any]:
        return puppet.queue.submit(puppet.task(f"{user} {name}", f"{user}{name}"), user)

    def test_users_take_turns_whatever_they_have_waiting(self, puppet: Puppet) -> None:
        self.submit(puppet, "eve", "0")
        puppet.starts()
        eves = [self.submit(puppet, "eve", str(k)) for k in range(1, 5)]
        ann = self.submit(puppet, "ann", "1")
        ben = [self.submit(puppet, "ben", str(k)) for k in (1, 2)]
        assert [task.user for task in puppet.queue.ahead_of(ben[1])] == [
            "eve", "eve", "ann", "ben", "eve",
        ]  # fmt: skip
        assert puppet.queue.ahead_of(ann) == puppet.queue.active()[:2]
        order = ["eve1", "ann1", "ben1", "eve2", "ben2", "eve3", "eve4"]
        assert self.started(puppet, 7) == order
        puppet.give(result())
        assert finished(eves[-1]).status is Status.DONE

    def test_newcomers_without_end_starve_nobody(self, puppet: Puppet) -> None:
        self.submit(puppet, "ann", "1")
        puppet.starts()
        self.submit(puppet, "ann", "2")
        names = []
        for k in range(4):
            self.submit(puppet, f"new{k}", "")
            names += self.started(puppet, 1)
        assert "ann2" in names[:2]
        puppet.give(result())

    def test_a_full_queue_refuses_who_fills_it(
        self, puppet: Puppet, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("accpinn.tasks.LONGEST_QUEUE", 3)
        self.submit(puppet, "eve", "0")
        puppet.starts()
        eves = [self.submit(puppet, "eve", str(k)) for k in range(1, 5)]
        assert [task.status for task in eves] == [Status.QUEUED] * 3 + [Status.FAILED]
        ann = self.submit(puppet, "ann", "1")
        assert ann.status is Status.QUEUED
        assert eves[2].status is Status.FAILED
        assert "3 tasks are waiting" in eves[2].error
        assert self.started(puppet, 3) == ["eve1", "ann1", "eve2"]
        puppet.give(result())

    def test_a_task_ends_at_the_limit_with_what_it_has(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("accpinn.tasks.WATCH", 0.01)
        puppet = Puppet()
        puppet.queue.close()
        puppet.queue = TaskQueue(lambda: None, limit=0.3)
        endless = puppet.queue.submit(puppet.task("eve", names=("one", "two")))
        puppet.step("first")
        after = puppet.queue.submit(puppet.task("ann"))
        until_stop(puppet.context)
        puppet.give(END, END)
        assert finished(endless).status is Status.STOPPED
        assert endless.results == ("first",)
        assert "limit" in endless.error
        assert finished(after).error != endless.error
        puppet.queue.close()

    def test_the_operator_ends_all_that_was_asked_for_before(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("accpinn.tasks.WATCH", 0.01)
        puppet, stop = Puppet(), tmp_path / "stop"
        puppet.queue.close()
        puppet.queue = TaskQueue(lambda: None, stop_file=stop)
        running, waiting = (puppet.queue.submit(puppet.task(name)) for name in ("ann", "ben"))
        puppet.starts()
        assert not puppet.context.should_stop()
        time.sleep(0.05)  # the clock of files is behind by some milliseconds
        stop.touch()
        until_stop(puppet.context)
        puppet.give(END)
        assert finished(running).status is finished(waiting).status is Status.STOPPED
        assert running.error == waiting.error != ""
        after = puppet.queue.submit(puppet.task("cem"))
        puppet.starts()
        puppet.give(result())
        assert finished(after).status is Status.DONE
        puppet.queue.close()


def until_stop(context: TaskContext) -> None:
    end = time.monotonic() + WAIT
    while not context.should_stop():
        assert time.monotonic() < end
        time.sleep(0.005)


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
        task = puppet.task(owner, kind="comparison", names=names, **options)
        return puppet.queue.submit(task)

    def test_they_come_one_by_one(self, puppet: Puppet) -> None:
        task = self.comparison(puppet, "ann", weights=(1.0, 3.0))
        assert task.current == "one"
        puppet.step("first")
        puppet.step(moment(50, 1000.0, left=1000.0))
        assert (task.results, task.current) == (("first",), "two")
        assert task.share == pytest.approx(0.625, abs=0.01)
        assert task.time_left is not None
        puppet.give("second", END)
        assert finished(task).status is Status.DONE
        assert (task.results, task.share) == (("first", "second"), 1.0)

    @pytest.mark.parametrize("stopped", [True, False])
    def test_a_stop_or_a_fault_keeps_what_is_known(self, puppet: Puppet, stopped: bool) -> None:
        task = self.comparison(puppet, "ann")
        puppet.step("first")
        if stopped:
            task.stop()
        puppet.give(END if stopped else ZeroDivisionError())
        assert finished(task).status is (Status.STOPPED if stopped else Status.FAILED)
        assert ("comparison" in task.error) is not stopped
        assert task.results == ("first",)

    def test_it_replaces_its_owners_earlier_one_and_no_training(self, puppet: Puppet) -> None:
        training = puppet.train("ann")
        puppet.starts()
        old, new = (self.comparison(puppet, "ann") for _ in range(2))
        assert old.status is Status.STOPPED
        assert puppet.queue.ahead_of(new) == (training,)
        assert puppet.queue.of("ann") is training
        puppet.give(result(), "result", END)
        finished(new)
        assert training.status is Status.DONE


def test_a_result_is_shown_by_who_asked_and_known_to_the_next(
    puppet: Puppet, tmp_path: Path
) -> None:
    store, analysis = Store(tmp_path), asked(replace(FAST, iterations=2))
    (tmp_path / f"{analysis.key}.accpinn.zip").write_bytes(b"damaged")
    queue = TaskQueue()
    task = finished(queue.submit(training_task("ann", analysis, run(), store)))
    assert any(analysis.key in str(note) for note in task.result.estimate.findings)
    assert [entry.id for entry in store.entries(session="ann")] == [analysis.key]
    busy = queue.submit(puppet.task("cem"))
    puppet.starts()
    known = queue.submit(training_task("ben", analysis, run(), store))
    assert known.status is Status.DONE, "it does not wait for its turn"
    assert known.result.estimate.cached
    assert known.result.id == "", "it is no snapshot"
    assert known.result.parameters == task.result.parameters
    assert [entry.id for entry in store.entries(session="ben")] == [analysis.key]
    puppet.give(result())
    finished(busy)
    queue.close()


def test_a_library_that_cannot_be_loaded_fails_the_task_with_a_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    queue = TaskQueue()
    task = finished(queue.submit(training_task("ann", asked(PAPER), run(), None)))
    queue.close()
    assert task.status is Status.FAILED
    assert task.error.startswith("PyTorch, which the PiNN needs, cannot be loaded (")
