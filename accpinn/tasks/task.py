"""A piece of work in the background: where it stands, how it ends, and a way to stop it."""

import logging
import threading
from abc import ABC, abstractmethod
from enum import Enum

from accpinn.methods.store import Store
from accpinn.units import Seconds

_log = logging.getLogger(__name__)


class Status(Enum):
    """Where a task stands."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    STOPPED = "stopped"
    FAILED = "failed"


class Task(ABC):
    """What the queue works on; everything may be asked from any thread."""

    def __init__(self, owner: str) -> None:
        """Queued."""
        self.owner = owner
        self._lock = threading.Lock()
        self._stop, self._ended = threading.Event(), threading.Event()
        self._status, self._error = Status.QUEUED, ""
        self.ended_at: Seconds | None = None
        """By the clock of the queue it belongs to."""

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
    def error(self) -> str:
        """Why it failed, as a sentence; empty otherwise."""
        with self._lock:
            return self._error

    @property
    @abstractmethod
    def time_left(self) -> Seconds | None:
        """Until its end at the latest; None where that cannot be told."""

    @abstractmethod
    def work(self, store: Store | None, threads: int | None) -> None:
        """Run it to its end, whatever that is; only the worker calls this."""

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

    def _begin(self) -> bool:
        """Whether it may run: it was not stopped while it waited."""
        if self._stop.is_set():
            self.cancel()
            return False
        with self._lock:
            self._status = Status.RUNNING
        return True

    def _end(self, status: Status, error: str = "") -> None:
        with self._lock:
            self._status, self._error = status, error
        self._ended.set()

    def _fail(self, fault: Exception, what: str) -> None:
        """End it with a fault that nobody foresaw; called while that is handled."""
        _log.exception("A %s ended unexpectedly", what)
        self._end(
            Status.FAILED,
            error=f"The {what} ended unexpectedly ({type(fault).__name__}), a fault of this"
            " program and not of your data; its log has the details. Try other settings.",
        )
