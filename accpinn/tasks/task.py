"""A piece of work in the background: its progress, its results, and a way to stop it.

Three kinds are made here: a training, a comparison of all methods, and trainings from several
starts.
"""

import gc
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from enum import Enum
from functools import cache
from typing import Generic, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from accpinn.errors import AccpinnError
from accpinn.inference.intervals import intervals
from accpinn.inference.model_adequacy import Adequacy, model_forms
from accpinn.inference.multistart import Trial, multistart
from accpinn.methods.fit import Fit, History, Outcome, Progress, Recorder
from accpinn.methods.method import TaskContext, relative_size
from accpinn.methods.pinn.config import STARTS, PinnConfig
from accpinn.methods.pinn.request import TrainingRequest
from accpinn.methods.registry import METHODS
from accpinn.methods.store import Store
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.recordings.recording import Recording
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodFailure, MethodResult, compare
from accpinn.units import Seconds

_log = logging.getLogger(__name__)

RATE_WINDOW: Seconds = 3.0
"""The rate of iterations is that of the last seconds, as it can change with the phase."""

FORMS_SECONDS: Seconds = 2.5
"""Of the forms of the model for one follower, as the typical seconds of methods."""
Result = TypeVar("Result")
Steps = Callable[[TaskContext], Iterator[Result]]
"""The work: yields each result, reports progress between, and ends early once it should stop."""


class Status(Enum):
    """Where a task stands."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    STOPPED = "stopped"
    FAILED = "failed"


class Task(Generic[Result]):
    """One or several estimations, one after the other; every method may be called in any thread."""

    def __init__(
        self,
        owner: str,
        kind: str,
        steps: Steps[Result],
        names: tuple[str, ...] = ("",),
        weights: Sequence[float] = (),
        request: TrainingRequest | None = None,
    ) -> None:
        """Queued.

        Args:
            owner: who asked; an owner has one active task of a kind.
            kind: its name in sentences, as "comparison".
            steps: the work.
            names: of the results, in their order.
            weights: how long each result takes compared with the others, which the time left is
                estimated from; empty for a task whose iterations have a rate.
            request: what a training is to learn; a task of an equal request is not run twice.
        """
        self.owner, self.kind, self.names, self.request = owner, kind, names, request
        self._steps, self._weights = steps, tuple(weights)
        self._lock = threading.Lock()
        self._stop, self._ended = threading.Event(), threading.Event()
        self.status = Status.QUEUED
        self.error = ""
        """Why it failed, as a sentence; empty otherwise."""
        self.results: tuple[Result, ...] = ()
        """All results so far, also those of a task that was stopped or failed."""
        self._recent = deque[Progress](maxlen=200)
        self._recorder: Recorder | None = None
        self._began: Seconds | None = None
        self.surrogate: Trajectories | None = None
        """The running estimation's latest curves."""
        self.earlier: History | None = None
        """The history of the training that this one continues."""
        self.ended_at: Seconds | None = None
        """By the clock of the queue it belongs to."""

    @property
    def is_active(self) -> bool:
        """Whether it still waits or runs."""
        return self.status in (Status.QUEUED, Status.RUNNING)

    @property
    def is_stopping(self) -> bool:
        """Whether it was asked to stop and has not ended yet."""
        return self._stop.is_set() and self.is_active

    @property
    def result(self) -> Result | None:
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
        first = next(p for p in recent if last.seconds - p.seconds <= RATE_WINDOW)
        elapsed = last.seconds - first.seconds
        return (last.iteration - first.iteration) / elapsed if elapsed > 0 else None

    @property
    def time_left(self) -> Seconds | None:
        """Until its end at the latest; None where nothing is known of it."""
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
            last = self.results[-1] if self.results and not self._recent else None
            if isinstance(last, Fit) and last.history:
                return last.history
            if self._recorder is None:
                return self.earlier
            history = self._recorder.history()
        return _joined(self.earlier, history) if self.earlier else history

    def stop(self) -> None:
        """Ask it to end soon; its results so far are kept."""
        self._stop.set()

    def cancel(self) -> None:
        """End it before it has begun."""
        self.stop()
        self._end(Status.STOPPED)

    def refuse(self, reason: str) -> None:
        """End it before it has begun, for a reason that is given as a sentence."""
        self._end(Status.FAILED, reason)

    def answer(self, result: Result) -> None:
        """End it with a result that is known already."""
        self._add(result)
        self._end(Status.DONE)

    def wait(self, timeout: Seconds | None = None) -> bool:
        """Wait for its end; False if that did not come in time."""
        return self._ended.wait(timeout)

    def work(self, store: Store | None, threads: int | None) -> None:
        """Run it to its end, whatever that is; only the queue's worker calls this.

        Args:
            store: where results and checkpoints are kept.
            threads: processor threads for an estimation.
        """
        if self._stop.is_set():
            self.cancel()
            return
        self.status, self._began = Status.RUNNING, time.monotonic()
        try:
            for result in self._steps(TaskContext(store, threads, self._note, self._stop.is_set)):
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
            if not self._recent or self._recorder is None:
                self._recorder = Recorder()
            self._recent.append(progress)
            self._recorder.add(progress)
            self.surrogate = progress.surrogate or self.surrogate

    def _add(self, result: Result) -> None:
        with self._lock:
            self.results = (*self.results, result)
            self._recent.clear()

    def _is_complete(self) -> bool:
        fits = [result for result in self.results if isinstance(result, Fit)]
        stopped = any(fit.outcome is Outcome.STOPPED for fit in fits)
        return len(self.results) == len(self.names) and not stopped

    def _end(self, status: Status, error: str = "") -> None:
        self.error, self.status = error, status  # whoever sees that it failed can ask why
        self._ended.set()


def _joined(before: History, after: History) -> History:
    """One history from two; what was repeated after a checkpoint is taken from the second."""
    kept = before.iteration < after.iteration[0]
    parts = {
        name: np.concatenate([getattr(before, name)[kept], values])
        for name, values in vars(after).items()
        if name != "parameters" and values is not None and getattr(before, name) is not None
    }
    tables = np.concatenate([before.parameters.values[kept], after.parameters.values])
    return History(**parts, parameters=Parameters.of(tables))


def training_task(owner: str, request: TrainingRequest) -> Task[Fit]:
    """A training of the PiNN.

    Args:
        owner: who asked.
        request: what is to be learned.
    """

    def steps(context: TaskContext) -> Iterator[Fit]:
        get_ready()
        context = replace(context, warm=request.warm)
        fit = METHODS["pinn"].fit(request.segment, request.case, request.config, context)
        with suppress(AccpinnError):
            intervals(request.segment, fit)  # remembered; else the page would compute them
        yield fit

    return Task(owner, "training", steps, request=request)


def comparison_task(
    owner: str, segment: Segment, case: Case, recording: Recording | None = None
) -> Task[MethodResult | MethodFailure | Adequacy]:
    """All methods on one segment, those first that take least, and the forms of the model.

    Args:
        owner: who asked.
        segment: the data.
        case: "I" or "II".
        recording: the segment's; with it the methods are also tested outside the window.
    """
    methods = sorted(METHODS.values(), key=lambda method: method.typical_seconds)

    def steps(context: TaskContext) -> Iterator[MethodResult | MethodFailure | Adequacy]:
        quiet = replace(context, on_progress=None)  # several fits make one result
        keys = [method.key for method in methods]
        yield from compare(segment, case, keys, recording=recording, context=quiet)
        if not context.is_stopped:
            yield model_forms(segment, case)

    names = (*(method.title for method in methods), "Forms of the model")
    weights = [*(method.typical_seconds for method in methods), FORMS_SECONDS]
    return Task(owner, "comparison", steps, names, weights)


def comparison_seconds(segment: Segment) -> Seconds:
    """How long a comparison of all methods takes on two cores, to within a factor of two or so."""
    typical = sum(method.typical_seconds for method in METHODS.values()) + FORMS_SECONDS
    return relative_size(segment) * typical


def starts_task(owner: str, segment: Segment, case: Case, config: PinnConfig) -> Task[Trial]:
    """Trainings of one segment from five initial values.

    Args:
        owner: who asked.
        segment: the data.
        case: "I" or "II".
        config: of all trainings, but for the initial values.
    """
    names = tuple(f"start {k} of {len(STARTS)}" for k in range(1, len(STARTS) + 1))
    return Task(
        owner,
        "series of starts",
        lambda context: multistart(segment, case, config, context=context),
        names,
        (1.0,) * len(names),
    )


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
