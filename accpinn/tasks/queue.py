"""The queue of trainings and comparisons and the one thread that works on them."""

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from accpinn.methods.fit import Fit
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.method import (
    WarmStart,
    drop_checkpoints,
    request_keys,
    resume_iteration,
)
from accpinn.methods.store import Store
from accpinn.model.cthp import Case
from accpinn.segment.segment import Segment
from accpinn.tasks.job import Job, Request, Train, load_train
from accpinn.tasks.series import Result, Series
from accpinn.tasks.task import Status, Task
from accpinn.units import Seconds

KEPT_JOBS = 100
"""Finished jobs beyond this number are forgotten, the oldest first."""
KEPT_FOR: Seconds = 24 * 3600.0
"""A finished job is forgotten after this time."""


class TaskQueue:
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
        self._threads = threads
        self._clock = clock
        self._changed = threading.Condition()
        self._queue: deque[Task] = deque()
        self._running: Task | None = None
        self._jobs: list[Task] = []
        self._closed = False
        self._worker = threading.Thread(target=self._serve, name="trainings", daemon=True)
        self._worker.start()

    def submit(
        self,
        owner: str,
        segment: Segment,
        case: Case,
        config: PinnConfig,
        warm: WarmStart | None = None,
        anew: bool = False,
    ) -> Job:
        """Queue a training; an owner has one at a time, so a different earlier one is stopped.

        It goes on where a stopped one of the same request ended, unless it is to begin ``anew``.
        """
        request = Request(segment, case, config, warm)
        known = self._recall(request)  # before the lock: others need not wait for the disk
        with self._changed:
            self._forget()
            earlier, track = self.of(owner), None
            if earlier and earlier.request.same_as(request):
                if earlier.is_active and not earlier.is_stopping:
                    return earlier
                goes_on = earlier.status is not Status.DONE and not anew
                track = earlier.history() if goes_on else None
            elif earlier:
                self.stop(earlier)
            if anew and self._store:
                drop_checkpoints(self._store, segment, case, config, warm)
            job = Job(owner, request, self._train, track)
            self._jobs.append(job)
            if known:
                job.answer(known)
                job.ended_at = self._clock()
            else:
                self._enqueue(job)
        return job

    def resume_iteration(
        self, segment: Segment, case: Case, config: PinnConfig, warm: WarmStart | None = None
    ) -> int | None:
        """The iteration from which an earlier training of this request would go on, if any."""
        return resume_iteration(self._store, segment, case, config, warm) if self._store else None

    def run(self, series: Series[Result]) -> Series[Result]:
        """Queue a series; an earlier one of its owner and kind is stopped."""
        with self._changed:
            self._forget()
            for other in self._jobs:
                if (
                    isinstance(other, Series)
                    and other.is_active
                    and (other.owner, other.what) == (series.owner, series.what)
                ):
                    self.stop(other)
            self._jobs.append(series)
            self._enqueue(series)
        return series

    def _enqueue(self, task: Task) -> None:
        self._queue.append(task)
        self._changed.notify_all()

    def _recall(self, request: Request) -> Fit | None:
        """The stored result of an identical request, which need not wait for its turn."""
        if self._store is None:
            return None
        result_key, _ = request_keys(request.segment, request.case, request.config, request.warm)
        known = self._store.load_fit(result_key, request.segment)
        return replace(known, cached=True) if known else None

    def of(self, owner: str) -> Job | None:
        """The owner's latest job that is not forgotten."""
        with self._changed:
            jobs = (job for job in reversed(self._jobs) if isinstance(job, Job))
            return next((job for job in jobs if job.owner == owner), None)

    def ahead_of(self, job: Task) -> tuple[Task, ...]:
        """What runs or waits before a queued job; nothing once it runs."""
        with self._changed:
            if job not in self._queue:
                return ()
            waiting = list(self._queue)[: self._queue.index(job)]
            return (self._running, *waiting) if self._running else tuple(waiting)

    def wait_for(self, job: Task) -> Seconds | None:
        """Until a queued job starts at the latest; None where that cannot be told."""
        times = [other.time_left for other in self.ahead_of(job)]
        known = [seconds for seconds in times if seconds is not None]
        return sum(known) if len(known) == len(times) else None

    def stop(self, job: Task) -> None:
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
        if self._train is None:
            with suppress(Exception):  # said by every job that needs it
                load_train()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._closed)
                if not self._queue:
                    return
                self._running = job = self._queue.popleft()
            job.work(self._store, self._threads)
            with self._changed:
                self._running = None
                job.ended_at = self._clock()

    def _forget(self) -> None:
        """Drop what ended long ago, and the oldest of too many."""
        now = self._clock()
        finished = [job for job in self._jobs if not job.is_active]
        kept = [j for j in finished[-KEPT_JOBS:] if now - (j.ended_at or now) <= KEPT_FOR]
        self._jobs = [job for job in self._jobs if job.is_active or job in kept]
