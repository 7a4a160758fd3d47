"""Methods on one segment, some of them in a second process, as a comparison runs them.

Most methods are loops over small arrays, which threads would not run side by side. The second
process takes the longest methods first, while the caller works through its list; an estimate is the
same wherever it is made. It is loky's: a copy of this process is not safe beside threads, and the
standard library's would run the caller's script again.
"""

import os
import threading
from collections.abc import Iterable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from typing import Any

from loky import ProcessPoolExecutor

from accpinn.errors import AccpinnError
from accpinn.evaluation.evaluation import Evaluation, evaluate
from accpinn.methods.fit import Fit
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.recordings.recording import Recording
from accpinn.segment.cut import DURATION
from accpinn.segment.segment import Segment
from accpinn.units import Seconds

WORTH: Seconds = 4.0
"""Typical time of the methods below which a second process would hardly have started."""
POLL: Seconds = 0.1

Answer = tuple[Fit, Evaluation] | AccpinnError
"""A method's fit with its evaluation, or why it could not serve the segment."""


@dataclass(frozen=True, eq=False)
class Job:
    """What methods are applied to."""

    segment: Segment
    case: Case
    recording: Recording | None
    """With it the errors outside the window are computed as well."""
    settings: Mapping[str, Any]
    """By method, for methods that have some; their defaults otherwise."""

    def run(self, key: str, context: TaskContext) -> Answer | None:
        """The answer of a method, blocks held out included; None once the context says stop."""
        settings = self.settings.get(key)
        estimate = partial(METHODS[key].fit, case=self.case, settings=settings, context=context)
        try:
            fit = estimate(self.segment)
            if context.is_stopped:
                return None
            return fit, evaluate(self.segment, fit, estimate, self.recording)
        except AccpinnError as fault:  # the others may well serve
            return fault


def helpful(methods: Iterable[str]) -> list[str]:
    """The methods that a second process can run: those without progress and checkpoints."""
    return [key for key in methods if not METHODS[key].is_iterative]


def is_worthwhile(segment: Segment, methods: Iterable[str], context: TaskContext) -> bool:
    """Whether a second process shortens a comparison: two processors, and enough to do."""
    share = min(1.0, segment.window.duration / DURATION)
    lasting = share * sum(METHODS[key].typical_seconds for key in helpful(methods))
    return context.threads != 1 and (os.cpu_count() or 1) > 1 and lasting >= WORTH


class Worker:
    """The second process; what it fails at is left to the caller."""

    def __init__(self, job: Job, methods: Iterable[str]) -> None:
        """Start it.

        Args:
            job: the data.
            methods: those it may take.
        """
        self._job = job
        self._left = sorted(methods, key=lambda key: METHODS[key].typical_seconds)
        self._answers: dict[str, Future[Answer | None]] = {}
        self._lock = threading.RLock()
        self._executor = ProcessPoolExecutor(max_workers=1, env={"OMP_NUM_THREADS": "1"})
        self._begin_next()

    def leaves(self, key: str) -> bool:
        """Whether a method is the caller's to run; it is from now on, where it was not begun."""
        with self._lock:
            if key in self._left:
                self._left.remove(key)
            return key not in self._answers

    def is_busy_with(self, key: str) -> bool:
        """Whether it has begun a method, and not ended it."""
        return key in self._answers and not self._answers[key].done()

    def answer(self, key: str, context: TaskContext) -> Answer | None:
        """Its answer, waited for; None for a method that is the caller's to run.

        Args:
            key: of a method.
            context: once it says stop, waiting ends with None.
        """
        future = self._answers.get(key)
        while future and not context.is_stopped:
            try:
                return future.result(POLL)
            except TimeoutError:
                continue
            except Exception:  # killed, it could not start, or a fault that the caller will meet
                return None
        return None

    def close(self) -> None:
        """End the process, whatever it is at."""
        with self._lock:
            self._left.clear()
        self._executor.shutdown(wait=False, kill_workers=True)

    def _begin_next(self, _: object = None) -> None:
        """Begin the longest method that is left; one at a time, so that the caller has a choice."""
        with self._lock:
            if self._left:
                key = self._left.pop()
                try:
                    future = self._executor.submit(self._job.run, key, TaskContext(threads=1))
                except (RuntimeError, OSError):  # ended, or it could not start
                    self._left.clear()
                else:
                    self._answers[key] = future
                    future.add_done_callback(self._begin_next)
