"""The queue of tasks and the one thread that works on them."""

import gc
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from accpinn.study.store import Store
from accpinn.tasks.task import Found, Task, get_ready
from accpinn.units import Seconds

KEPT_TASKS = 100
"""Finished tasks beyond this number are forgotten, the oldest first."""
KEPT_FOR: Seconds = 24 * 3600.0
"""A finished task is forgotten after this time."""
LONGEST_QUEUE = 60
"""More tasks than this do not wait; each owner has one of a kind at most."""
GRACE: Seconds = 2.0
"""The worker gets ready after so long, or with the first task: meanwhile the first page is drawn,
which else shares the processor with imports."""
IDLE: Seconds = 30.0
"""After so long without a task the worker collects garbage; a page need not wait for that."""


class TaskQueue:
    """All tasks of a server, and the one thread that works on them."""

    def __init__(
        self,
        store: Store | None = None,
        threads: int | None = None,
        clock: Callable[[], float] = time.monotonic,
        prepare: Callable[[], object] = get_ready,
        tidy: Callable[[], object] = gc.collect,
        idle: Seconds = IDLE,
    ) -> None:
        """Start the worker.

        Args:
            store: where results and checkpoints are kept.
            threads: processor threads for an estimation; None leaves the choice to the method.
            clock: in s; finished tasks are forgotten by it.
            prepare: called in the worker before the first task comes.
            tidy: called in the worker whenever no task has come for some time.
            idle: that time.
        """
        self._store, self._threads = store, threads
        self._clock, self._prepare = clock, prepare
        self._tidy, self._idle = tidy, idle
        self._changed = threading.Condition()
        self._queue: deque[Task[Any]] = deque()
        self._running: Task[Any] | None = None
        self._tasks: list[Task[Any]] = []
        self._closed = False
        self._worker = threading.Thread(target=self._serve, name="tasks", daemon=True)
        self._worker.start()

    def submit(self, task: Task[Found], anew: bool = False) -> Task[Found]:
        """Queue a task; an active one of the same owner and kind is stopped.

        An active task of an equal analysis is returned in its place. A stored result is the answer
        at once. A stopped training of an equal analysis goes on from its checkpoint. Where too many
        wait already, the task fails at once and says so.

        Args:
            task: not queued yet.
            anew: begin at the first iteration, whatever checkpoint there is.
        """
        analysis, store = task.analysis, self._store
        known: Any = None
        if analysis and store:  # before the lock: others need not wait for the disk
            known = store.has(analysis.key) and task.recall()
        with self._changed:
            self._forget()
            earlier = self.of(task.owner, task.kind)
            asked = earlier.analysis if earlier else None
            if earlier and analysis and asked and analysis.key == asked.key:
                if earlier.is_active and not earlier.is_stopping:
                    return earlier
            elif earlier:
                self.stop(earlier)
            if anew and analysis and analysis.checkpoint_keys and store:
                store.checkpoints(analysis).drop()
            self._tasks.append(task)
            if known:
                task.answer(known)
                task.ended_at = self._clock()
            elif len(self._queue) >= LONGEST_QUEUE:
                task.refuse(f"{len(self._queue)} tasks are waiting already; try again later.")
                task.ended_at = self._clock()
            else:
                self._queue.append(task)
                self._changed.notify_all()
        return task

    def of(self, owner: str, kind: str = "training") -> Task[Any] | None:
        """The owner's latest task of that kind that is not forgotten."""
        with self._changed:
            tasks = reversed(self._tasks)
            return next((task for task in tasks if (task.owner, task.kind) == (owner, kind)), None)

    def active_owners(self, kind: str) -> tuple[str, ...]:
        """Whose tasks of that kind wait or run."""
        with self._changed:
            return tuple(t.owner for t in self._tasks if t.kind == kind and t.is_active)

    def ahead_of(self, task: Task[Any]) -> tuple[Task[Any], ...]:
        """The tasks that run or wait before a queued one; none once it runs."""
        with self._changed:
            if task not in self._queue:
                return ()
            waiting = list(self._queue)[: self._queue.index(task)]
            return (self._running, *waiting) if self._running else tuple(waiting)

    def wait_for(self, task: Task[Any]) -> Seconds | None:
        """Until a queued task starts at the latest; None where that is not known."""
        times = [other.time_left for other in self.ahead_of(task)]
        known = [seconds for seconds in times if seconds is not None]
        return sum(known) if len(known) == len(times) else None

    def stop(self, task: Task[Any]) -> None:
        """Stop a task; one that still waits ends at once."""
        with self._changed:
            if task in self._queue:
                self._queue.remove(task)
                task.cancel()
                task.ended_at = self._clock()
            else:
                task.stop()

    def close(self) -> None:
        """Stop everything and end the worker."""
        with self._changed:
            self._closed = True
            for task in self._tasks:
                task.stop()
            self._changed.notify_all()
        self._worker.join()

    def _serve(self) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._closed, GRACE)
            if self._closed and not self._queue:
                return
        with suppress(Exception):  # reported by every task that needs what is prepared
            self._prepare()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._closed, self._idle)
                if self._closed and not self._queue:
                    return
                self._running = task = self._queue.popleft() if self._queue else None
            if task is None:
                with self._changed:
                    self._forget()
                self._tidy()
                continue
            task.work(self._threads)
            with self._changed:
                self._running = None
                task.ended_at = self._clock()

    def _forget(self) -> None:
        """Drop what ended long ago, and the oldest of too many."""
        now = self._clock()
        finished = [task for task in self._tasks if not task.is_active]
        kept = [t for t in finished[-KEPT_TASKS:] if now - (t.ended_at or now) <= KEPT_FOR]
        self._tasks = [task for task in self._tasks if task.is_active or task in kept]
