"""A piece of work in the background: its progress, its results, and a way to stop it.

A task runs one analysis (a training), or several that differ in method (a comparison) or in
initial values (a series of starts). Batches and downloads are tasks, too (see `tasks.batches`).
"""

import gc
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from enum import Enum
from functools import cache
from typing import Generic, TypeVar

from threadpoolctl import threadpool_limits

from accpinn.errors import AccpinnError
from accpinn.inference.model_adequacy import Adequacy
from accpinn.methods.fit import History, Outcome, Progress, Recorder
from accpinn.methods.method import TaskContext, relative_size
from accpinn.methods.pinn.config import STARTS
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Trajectories
from accpinn.recordings.recording import Recording
from accpinn.segment.segment import Segment
from accpinn.study.analysis import Analysis
from accpinn.study.comparison import Refused, compare
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.study.starts import starts
from accpinn.study.store import Store
from accpinn.units import Seconds

_log = logging.getLogger(__name__)

RATE_WINDOW: Seconds = 3.0
"""The rate of iterations is that of the last seconds, as it can change with the phase."""
FORMS_SECONDS: Seconds = 2.5
"""Typical time of the forms of the model for one follower, as the typical seconds of methods."""
Found = TypeVar("Found")
Steps = Callable[[TaskContext], Iterator[Found]]
"""The work: yields each result, reports progress between, and ends early once it should stop."""


class Status(Enum):
    """Where a task stands."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    STOPPED = "stopped"
    FAILED = "failed"


class Task(Generic[Found]):
    """A piece of work; every method may be called in any thread."""

    def __init__(
        self,
        owner: str,
        kind: str,
        steps: Steps[Found],
        names: tuple[str, ...] = ("",),
        weights: Sequence[float] = (),
        analysis: Analysis | None = None,
        recall: Callable[[], Found | None] = lambda: None,
    ) -> None:
        """Queued.

        Args:
            owner: who asked; an owner has one active task of a kind.
            kind: its name in sentences, as "comparison".
            steps: the work.
            names: names of the results, in their order.
            weights: how long each result takes compared with the others, which the time left is
                estimated from; empty for a task whose iterations have a rate.
            analysis: what a training answers; a task of an equal analysis is not run twice.
            recall: the answer where it is known already; None where it is not.
        """
        self.recall = recall
        self.owner, self.kind, self.names, self.analysis = owner, kind, names, analysis
        self._steps, self._weights = steps, tuple(weights)
        self._lock = threading.Lock()
        self._stop, self._ended = threading.Event(), threading.Event()
        self.status = Status.QUEUED
        self.error = ""
        """Why it failed, as a sentence; empty otherwise."""
        self.results: tuple[Found, ...] = ()
        """All results so far, also those of a task that was stopped or failed."""
        self.recorder = Recorder()
        """The course of the running estimation, or of the latest one."""
        self._recent = deque[Progress](maxlen=200)
        self._began: Seconds | None = None
        self.surrogate: Trajectories | None = None
        """The running estimation's latest curves."""

    @property
    def is_active(self) -> bool:
        """Whether it still waits or runs."""
        return self.status in (Status.QUEUED, Status.RUNNING)

    @property
    def is_stopping(self) -> bool:
        """Whether it was asked to stop and has not ended yet."""
        return self._stop.is_set() and self.is_active

    @property
    def result(self) -> Found | None:
        """The latest result, None before the first."""
        return self.results[-1] if self.results else None

    @property
    def progress(self) -> Progress | None:
        """The latest moment of the running estimation, None where it has reported none."""
        with self._lock:
            return self._recent[-1] if self._recent else None

    @property
    def current(self) -> str:
        """The name of the running estimation; empty where none runs."""
        done = len(self.results)
        return self.names[done] if self.is_active and done < len(self.names) else ""

    @property
    def share(self) -> float:
        """The share of the work that is done, 0 to 1."""
        with self._lock:
            done, now = len(self.results), self._recent[-1] if self._recent else None
        weights = self._weights or (1.0,) * len(self.names)
        within = min(1.0, now.iteration / max(1, now.iterations)) if now else 0.0
        running = within * weights[done] if done < len(weights) else 0.0
        return min(1.0, (sum(weights[:done]) + running) / sum(weights))

    @property
    def rate(self) -> float | None:
        """Iterations per second over the last seconds; None before two moments are known."""
        with self._lock:
            recent = list(self._recent)
        if not recent:
            return None
        last = recent[-1]
        first = next(moment for moment in recent if last.seconds - moment.seconds <= RATE_WINDOW)
        elapsed = last.seconds - first.seconds
        return (last.iteration - first.iteration) / elapsed if elapsed > 0 else None

    @property
    def time_left(self) -> Seconds | None:
        """Time until its end at the latest, in s; None where nothing is known of it."""
        if self._weights:
            share = self.share
            if self._began is None or share <= 0:
                return None
            return (time.monotonic() - self._began) * (1 - share) / share
        now, rate = self.progress, self.rate
        return (now.iterations - now.iteration) / rate if now and rate else None

    def history(self) -> History | None:
        """The history of the running or latest estimation, None before its first moment."""
        with self._lock:
            if isinstance(self.result, Result) and not self._recent:
                return self.result.fit.history
            return self.recorder.history() if self.recorder else None

    def stop(self) -> None:
        """Ask it to end soon, with its results so far; one that still waits ends at once."""
        self._stop.set()
        with self._lock:
            if self.status is Status.QUEUED:
                self._end(Status.STOPPED)

    def refuse(self, reason: str) -> None:
        """End it before it has begun, for a reason that is given as a sentence."""
        self._end(Status.FAILED, reason)

    def answer(self, result: Found) -> None:
        """End it with a result that is known already."""
        self._add(result)
        self._end(Status.DONE)

    def wait(self, timeout: Seconds | None = None) -> bool:
        """Wait for its end; False if that did not come in time."""
        return self._ended.wait(timeout)

    def work(self, threads: int | None) -> None:
        """Run it to its end, whatever that is, on so many threads; only the queue's worker does."""
        with self._lock:
            if self.status is not Status.QUEUED:
                return
            self.status, self._began = Status.RUNNING, time.monotonic()
        try:
            for result in self._steps(TaskContext(None, threads, self._note, self._stop.is_set)):
                self._add(result)
        except AccpinnError as fault:
            self._end(Status.FAILED, str(fault))
        except Exception as fault:
            _log.exception("A %s ended unexpectedly", self.kind)
            self._end(
                Status.FAILED,
                f"The {self.kind} ended unexpectedly ({type(fault).__name__}): a fault of this"
                " program, not of your data; its log has the details. Try other settings.",
            )
        else:
            self._end(Status.DONE if self._is_complete() else Status.STOPPED)

    def _note(self, progress: Progress) -> None:
        with self._lock:
            if not self._recent and self.results:
                self.recorder = Recorder()
            self._recent.append(progress)
            self.recorder.add(progress)
            self.surrogate = progress.surrogate or self.surrogate

    def _add(self, result: Found) -> None:
        with self._lock:
            self.results = (*self.results, result)
            self._recent.clear()

    def _is_complete(self) -> bool:
        results = [result for result in self.results if isinstance(result, Result)]
        is_stopped = any(result.fit.outcome is Outcome.STOPPED for result in results)
        return len(self.results) == len(self.names) and not is_stopped

    def _end(self, status: Status, error: str = "") -> None:
        self.error, self.status = error, status  # whoever sees that it failed can ask why
        self._ended.set()


def training_task(
    owner: str,
    analysis: Analysis,
    recording: Recording | None,
    store: Store | None,
    segments: tuple[Segment, ...] = (),
) -> Task[Result]:
    """The answer to one analysis, with all that a page shows of it.

    Args:
        owner: who asked; a finished training is entered among what this session has shown.
        analysis: what is asked.
        recording: that it is asked of; None where only the data of its window are at hand.
        store: where results and checkpoints are kept.
        segments: those data; by default they are cut from the recording.
    """

    def answer(context: TaskContext | None) -> Result:
        result = run(analysis, recording, segments=segments, store=store, context=context)
        _ = result.quality, result.uncertainty, result.evaluation
        if store and result.is_finished:
            store.show(owner, result)
        return result

    def steps(context: TaskContext) -> Iterator[Result]:
        get_ready()
        if store and (state := store.stopped_state(analysis)):
            task.recorder.restore(state)
        yield answer(context)

    def recall() -> Result | None:
        return answer(None) if store and store.find(analysis) else None

    task = Task(owner, "training", steps, analysis=analysis, recall=recall)
    return task


def comparison_task(
    owner: str,
    analysis: Analysis,
    recording: Recording | None,
    segments: tuple[Segment, ...] = (),
) -> Task[Result | Refused | Adequacy]:
    """All methods on one window, those first that take least, and the forms of the model."""
    methods = sorted(METHODS.values(), key=lambda method: method.typical_seconds)

    def steps(context: TaskContext) -> Iterator[Result | Refused | Adequacy]:
        quiet = replace(context, on_progress=None)  # several fits make one result
        last: Result | None = None
        keys = [method.key for method in methods]
        for outcome in compare(analysis, recording, keys, segments=segments, context=quiet):
            last = outcome if isinstance(outcome, Result) else last
            yield outcome
        if last and not context.is_stopped:
            yield last.adequacy

    names = (*(method.title for method in methods), "Forms of the model")
    weights = [*(method.typical_seconds for method in methods), FORMS_SECONDS]
    return Task(owner, "comparison", steps, names, weights)


def comparison_seconds(segment: Segment) -> Seconds:
    """How long a comparison of all methods takes on two cores, to within a factor of two or so."""
    typical = sum(method.typical_seconds for method in METHODS.values()) + FORMS_SECONDS
    return relative_size(segment) * typical


def starts_task(
    owner: str,
    analysis: Analysis,
    recording: Recording | None,
    store: Store | None,
    segments: tuple[Segment, ...] = (),
) -> Task[Result]:
    """Trainings of one window from five initial values; the arguments are `training_task`'s."""

    def steps(context: TaskContext) -> Iterator[Result]:
        for asked in starts(analysis):
            result = run(asked, recording, segments=segments, store=store, context=context)
            if context.is_stopped:
                return
            yield result

    names = tuple(f"start {k} of {len(STARTS)}" for k in range(1, len(STARTS) + 1))
    return Task(owner, "series of starts", steps, names, (1.0,) * len(names))


@cache
def get_ready() -> None:
    """Import what a training needs, and share the process among threads.

    What is imported stays for good, and a search of it for garbage would hold up all threads, so it
    is kept from the collector. Linear algebra takes one thread each.
    """
    from accpinn.methods.pinn import calibrated, fast  # noqa: F401  (with PyTorch)

    gc.collect()
    gc.freeze()
    threadpool_limits(limits=1, user_api="blas")
