"""Several estimations one after the other as seen from outside: results come one by one."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Generic, TypeVar

from accpinn.errors import AccpinnError
from accpinn.methods.history import Progress
from accpinn.methods.method import TaskContext
from accpinn.methods.store import Store
from accpinn.tasks.task import Status, Task
from accpinn.units import Seconds

Result = TypeVar("Result")


Steps = Callable[[TaskContext], Iterator[Result]]
"""Yields each result as soon as it is known, and ends early once it is told to stop."""


class Series(Task, Generic[Result]):
    """Estimations by name; those that ended before a stop or a fault are kept."""

    def __init__(
        self,
        owner: str,
        what: str,
        names: tuple[str, ...],
        steps: Steps[Result],
        efforts: Sequence[float] = (),
    ) -> None:
        """Queued.

        Args:
            owner: who asked.
            what: it is called in sentences, as "comparison".
            names: of the estimations, in the order in which they run.
            steps: the work.
            efforts: how long each takes compared with the others, so that the time left can be
                told; empty where nobody knows.
        """
        super().__init__(owner)
        self.what, self.names = what, names
        self._steps, self._efforts = steps, tuple(efforts)
        self._results: tuple[Result, ...] = ()
        self._now: Progress | None = None
        self._began: Seconds | None = None

    @property
    def results(self) -> tuple[Result, ...]:
        """What is known so far."""
        with self._lock:
            return self._results

    @property
    def current(self) -> str:
        """The name of what runs; empty where nothing does."""
        done = len(self.results)
        return self.names[done] if self.is_active and done < len(self.names) else ""

    @property
    def share(self) -> float:
        """How much is done, 0 to 1."""
        with self._lock:
            done, now = len(self._results), self._now
        efforts = self._efforts or (1.0,) * len(self.names)
        within = min(1.0, now.iteration / max(1, now.iterations)) if now else 0.0
        partly = within * efforts[done] if done < len(efforts) else 0.0
        return min(1.0, (sum(efforts[:done]) + partly) / sum(efforts))

    @property
    def time_left(self) -> Seconds | None:
        """Estimated from what is done; None where nobody knows what the rest takes."""
        share = self.share
        if not self._efforts or self._began is None or share <= 0:
            return None
        return (time.monotonic() - self._began) * (1 - share) / share

    def work(self, store: Store | None, threads: int | None) -> None:
        """Run it to its end, whatever that is; only the worker calls this."""
        if not self._begin():
            return
        self._began = time.monotonic()
        try:
            for result in self._steps(TaskContext(store, threads, self._note, self._stop.is_set)):
                with self._lock:
                    self._results, self._now = (*self._results, result), None
        except AccpinnError as fault:
            self._end(Status.FAILED, error=str(fault))
        except Exception as fault:
            self._fail(fault, self.what)
        else:
            whole = len(self.results) == len(self.names)
            self._end(Status.DONE if whole else Status.STOPPED)

    def _note(self, progress: Progress) -> None:
        with self._lock:
            self._now = progress
