"""Trainings in the background: a queue, one worker, and what is known of each at any moment.

Training keeps a processor core busy, so one runs at a time and the others wait their turn. Whoever
asks (a page, many times a second) gets answers at once and never waits for the worker. A job that
was stopped is continued by submitting the same request again: the store holds its checkpoint.
"""

import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Protocol

import numpy as np

from accpinn.cthp import Case
from accpinn.errors import AccpinnError
from accpinn.fit import Fit, History, OnProgress, Outcome, Progress, ShouldStop
from accpinn.pinn.config import PinnConfig
from accpinn.pinn.history import Recorder
from accpinn.segment import Segment
from accpinn.store import Store
from accpinn.units import Seconds

KEPT_JOBS = 100
"""Finished jobs beyond this number are forgotten, the oldest first."""
KEPT_FOR: Seconds = 24 * 3600.0
"""A finished job is forgotten after this time."""
RATE_WINDOW: Seconds = 3.0
"""The rate of iterations is that of the last seconds, as it can change with the phase."""

_log = logging.getLogger(__name__)


class Train(Protocol):
    """What does the work: `accpinn.pinn.training.train`, or a test's stand-in."""

    def __call__(
        self,
        segment: Segment,
        case: Case,
        config: PinnConfig,
        *,
        store: Store | None,
        on_progress: OnProgress,
        should_stop: ShouldStop,
        threads: int,
    ) -> Fit:
        """Learn the parameters of a segment."""


class Status(Enum):
    """Where a job stands."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    STOPPED = "stopped"
    FAILED = "failed"


@dataclass(frozen=True, eq=False)
class Request:
    """What is to be trained."""

    segment: Segment
    case: Case
    config: PinnConfig

    def same_as(self, other: "Request") -> bool:
        """Whether both ask for the same result."""
        alike = self.case == other.case and self.config == other.config
        return alike and self.segment.digest() == other.segment.digest()


class Job:
    """One training, from any thread: its status, course, result, and a way to stop it."""

    def __init__(self, owner: str, request: Request, earlier: History | None = None) -> None:
        """Queued; ``earlier`` is the course of the training that this one continues."""
        self.owner, self.request = owner, request
        self._earlier = earlier
        self._lock = threading.Lock()
        self._stop, self._ended = threading.Event(), threading.Event()
        self._recorder, self._recent = Recorder(), deque[Progress](maxlen=200)
        self._status, self._error = Status.QUEUED, ""
        self._fit: Fit | None = None
        self.ended_at: Seconds | None = None
        """By the clock of the `Trainings` it belongs to."""

    @property
    def status(self) -> Status:
        """Where it stands."""
        with self._lock:
            return self._status

    @property
    def is_active(self) -> bool:
        """Whether it still waits or runs."""
        return self.status in (Status.QUEUED, Status.RUNNING)

    @property
    def is_stopping(self) -> bool:
        """Whether it was told to stop, and has not ended yet."""
        return self._stop.is_set() and self.is_active

    @property
    def progress(self) -> Progress | None:
        """Its latest moment, None before the first."""
        with self._lock:
            return self._recent[-1] if self._recent else None

    @property
    def fit(self) -> Fit | None:
        """Its result, also that of a stopped training."""
        with self._lock:
            return self._fit

    @property
    def error(self) -> str:
        """Why it failed, as a sentence; empty otherwise."""
        with self._lock:
            return self._error

    @property
    def rate(self) -> float | None:
        """Iterations per second of late."""
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
        """Until the last planned iteration; a training that settles ends earlier."""
        now, rate = self.progress, self.rate
        return (now.iterations - now.iteration) / rate if now and rate else None

    def history(self) -> History | None:
        """Its course so far, None before the first moment."""
        with self._lock:
            if self._fit and self._fit.history:
                return self._fit.history
            if not self._recent:
                return self._earlier
            history = self._recorder.history()
        return _joined(self._earlier, history) if self._earlier else history

    def stop(self) -> None:
        """Ask it to end soon; its result so far is kept."""
        self._stop.set()

    def cancel(self) -> None:
        """End it before it has begun."""
        self.stop()
        self._end(Status.STOPPED)

    def wait(self, timeout: Seconds | None = None) -> bool:
        """Wait for its end; False if that did not come in time."""
        return self._ended.wait(timeout)

    def work(self, train: Train, store: Store | None, threads: int) -> None:
        """Run it to its end, whatever that is; only the worker calls this."""
        if self._stop.is_set():
            self.cancel()
            return
        with self._lock:
            self._status = Status.RUNNING
        known_messages = len(store.messages) if store else 0
        try:
            fit = train(
                self.request.segment,
                self.request.case,
                self.request.config,
                store=store,
                on_progress=self._note,
                should_stop=self._stop.is_set,
                threads=threads,
            )
        except AccpinnError as fault:
            self._end(Status.FAILED, error=str(fault))
        except Exception as fault:
            _log.exception("A training ended unexpectedly")
            self._end(
                Status.FAILED,
                error=f"The training ended unexpectedly ({type(fault).__name__}), a fault of this"
                " program and not of your data; its log has the details. Try other settings.",
            )
        else:
            messages = dict.fromkeys(store.messages[known_messages:]) if store else ()
            stopped = fit.outcome is Outcome.STOPPED
            self._end(
                Status.STOPPED if stopped else Status.DONE,
                fit=replace(fit, notes=(*fit.notes, *messages)),
            )

    def _note(self, progress: Progress) -> None:
        with self._lock:
            self._recorder.add(progress)
            self._recent.append(progress)

    def _end(self, status: Status, fit: Fit | None = None, error: str = "") -> None:
        with self._lock:
            self._status, self._fit, self._error = status, fit, error
        self._ended.set()


class Trainings:
    """All jobs of a server, and the one thread that works on them."""

    def __init__(
        self,
        train: Train | None = None,
        store: Store | None = None,
        threads: int | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start the worker; by default it leaves one processor core to others."""
        self._train, self._store = train, store
        self._threads = threads or max(1, (os.cpu_count() or 2) - 1)
        self._clock = clock
        self._changed = threading.Condition()
        self._queue: deque[Job] = deque()
        self._running: Job | None = None
        self._jobs: list[Job] = []
        self._closed = False
        self._worker = threading.Thread(target=self._serve, name="trainings", daemon=True)
        self._worker.start()

    def submit(self, owner: str, segment: Segment, case: Case, config: PinnConfig) -> Job:
        """Queue a training; an owner has one at a time, so a different earlier one is stopped."""
        request = Request(segment, case, config)
        with self._changed:
            self._forget()
            earlier, course = self.of(owner), None
            if earlier and earlier.request.same_as(request):
                if earlier.is_active and not earlier.is_stopping:
                    return earlier
                course = earlier.history() if earlier.status is not Status.DONE else None
            elif earlier:
                self.stop(earlier)
            job = Job(owner, request, course)
            self._jobs.append(job)
            self._queue.append(job)
            self._changed.notify_all()
        return job

    def of(self, owner: str) -> Job | None:
        """The owner's latest job that is not forgotten."""
        with self._changed:
            return next((job for job in reversed(self._jobs) if job.owner == owner), None)

    def ahead_of(self, job: Job) -> tuple[Job, ...]:
        """What runs or waits before a queued job; nothing once it runs."""
        with self._changed:
            if job not in self._queue:
                return ()
            waiting = list(self._queue)[: self._queue.index(job)]
            return (self._running, *waiting) if self._running else tuple(waiting)

    def wait_for(self, job: Job) -> Seconds | None:
        """Until a queued job starts at the latest; None where that cannot be told."""
        times = [other.time_left for other in self.ahead_of(job)]
        known = [seconds for seconds in times if seconds is not None]
        return sum(known) if len(known) == len(times) else None

    def stop(self, job: Job) -> None:
        """Stop a job; one that still waits ends at once."""
        with self._changed:
            if job in self._queue:
                self._queue.remove(job)
                job.cancel()
                job.ended_at = self._clock()
            else:
                job.stop()

    def close(self) -> None:
        """Stop everything and end the worker."""
        with self._changed:
            self._closed = True
            for job in self._jobs:
                job.stop()
            self._changed.notify_all()
        self._worker.join()

    def _serve(self) -> None:
        # Loading the network's library takes a second or two: done before the first job comes.
        train = self._train or _load_train()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._closed)
                if not self._queue:
                    return
                self._running = job = self._queue.popleft()
            job.work(train, self._store, self._threads)
            with self._changed:
                self._running = None
                job.ended_at = self._clock()

    def _forget(self) -> None:
        """Drop what ended long ago, and the oldest of too many."""
        now = self._clock()
        finished = [job for job in self._jobs if not job.is_active]
        kept = [j for j in finished[-KEPT_JOBS:] if now - (j.ended_at or now) <= KEPT_FOR]
        self._jobs = [job for job in self._jobs if job.is_active or job in kept]


def _load_train() -> Train:
    from accpinn.pinn.training import train

    return train


def _joined(before: History, after: History) -> History:
    """One course from two; what was repeated after a checkpoint is taken from the second."""
    kept = before.iteration < after.iteration[0]
    names = ("iteration", "seconds", "total", "data", "physics", "initial", "parameters")
    parts = {
        name: np.concatenate([getattr(before, name)[kept], getattr(after, name)]) for name in names
    }
    return History(**parts)
