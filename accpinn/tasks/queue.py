"""The queue of tasks and the one thread that works on them."""

import gc
import threading
from collections.abc import Callable
from contextlib import suppress
from itertools import takewhile
from queue import SimpleQueue
from typing import Any

from accpinn.study.store import Store
from accpinn.tasks.task import Found, Status, Task, get_ready
from accpinn.units import Seconds

KEPT_TASKS = 100
"""Finished tasks beyond this number are forgotten, the oldest first."""
LONGEST_QUEUE = 60
"""More tasks than this do not wait; each owner has one of a kind at most."""
GRACE: Seconds = 2.0
"""The worker gets ready after so long, or with the first task: meanwhile the first page is drawn,
which else shares the processor with imports."""


class TaskQueue:
    """All tasks of a server, and the one thread that works on them."""

    def __init__(
        self,
        store: Store | None = None,
        threads: int | None = None,
        prepare: Callable[[], object] = get_ready,
    ) -> None:
        """Start the worker.

        Args:
            store: where results and checkpoints are kept.
            threads: processor threads for an estimation; None leaves the choice to the method.
            prepare: called in the worker before the first task.
        """
        self._store, self._threads, self._prepare = store, threads, prepare
        self._lock = threading.RLock()
        self._tasks: list[Task[Any]] = []
        """In the order of their submission; active ones run in that order."""
        self._waiting = SimpleQueue[Task[Any] | None]()
        self._asked = threading.Event()
        # A daemon, so that the server can end in the middle of a training.
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
        with self._lock:
            earlier = self.of(task.owner, task.kind)
            if earlier:
                asked = earlier.analysis
                is_same = analysis and asked and analysis.key == asked.key
                if is_same and earlier.is_active and not earlier.is_stopping:
                    return earlier
                earlier.stop()
            if anew and analysis and analysis.checkpoint_keys and store:
                store.checkpoints(analysis).drop()
            waiting = [other for other in self._tasks if other.status is Status.QUEUED]
            ended = [other for other in self._tasks if not other.is_active]
            forgotten = ended[:-KEPT_TASKS]
            self._tasks = [other for other in self._tasks if other not in forgotten]
            self._tasks.append(task)
            if known:
                task.answer(known)
            elif len(waiting) >= LONGEST_QUEUE:
                task.refuse(f"{len(waiting)} tasks are waiting already; try again later.")
            else:
                self._waiting.put(task)
                self._asked.set()
        return task

    def of(self, owner: str, kind: str = "training") -> Task[Any] | None:
        """The owner's latest task of that kind that is not forgotten."""
        with self._lock:
            tasks = reversed(self._tasks)
            return next((task for task in tasks if (task.owner, task.kind) == (owner, kind)), None)

    def active_owners(self, kind: str) -> tuple[str, ...]:
        """Whose tasks of that kind wait or run."""
        with self._lock:
            return tuple(t.owner for t in self._tasks if t.kind == kind and t.is_active)

    def ahead_of(self, task: Task[Any]) -> tuple[Task[Any], ...]:
        """The tasks that run or wait before a queued one; none once it runs."""
        with self._lock:
            if task.status is not Status.QUEUED:
                return ()
            earlier = takewhile(lambda other: other is not task, self._tasks)
            return tuple(other for other in earlier if other.is_active)

    def wait_for(self, task: Task[Any]) -> Seconds | None:
        """Until a queued task starts at the latest; None where that is not known."""
        times = [other.time_left for other in self.ahead_of(task)]
        known = [seconds for seconds in times if seconds is not None]
        return sum(known) if len(known) == len(times) else None

    def close(self) -> None:
        """Stop everything and end the worker."""
        with self._lock:
            for task in self._tasks:
                task.stop()
        self._waiting.put(None)
        self._asked.set()
        self._worker.join()

    def _serve(self) -> None:
        self._asked.wait(GRACE)
        with suppress(Exception):  # reported by every task that needs what is prepared
            self._prepare()
        for task in iter(self._waiting.get, None):
            task.work(self._threads)
            del task
            if self._waiting.empty():
                gc.collect()  # no page waits for that
