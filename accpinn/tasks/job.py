"""One training as seen from outside while a worker is at it."""

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from accpinn.errors import AccpinnError
from accpinn.methods.fit import Fit, OnProgress, Outcome, ShouldStop
from accpinn.methods.history import History, Progress, Recorder
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.method import WarmStart
from accpinn.methods.store import Store
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.tasks.task import Status, Task
from accpinn.units import Seconds

RATE_WINDOW: Seconds = 3.0
"""The rate of iterations is that of the last seconds, as it can change with the phase."""


class Train(Protocol):
    """What does the work: `accpinn.methods.pinn.training.train`, or a test's stand-in."""

    def __call__(
        self,
        segment: Segment,
        case: Case,
        config: PinnConfig,
        *,
        store: Store | None,
        on_progress: OnProgress,
        should_stop: ShouldStop,
        threads: int | None,
        warm: WarmStart | None = None,
    ) -> Fit:
        """Learn the parameters of a segment."""


@dataclass(frozen=True, eq=False)
class Request:
    """What is to be trained."""

    segment: Segment
    case: Case
    config: PinnConfig
    warm: WarmStart | None = None
    """What it begins with in place of random weights."""

    def same_as(self, other: "Request") -> bool:
        """Whether both ask for the same result."""
        alike = self.case == other.case and self.config == other.config
        begins = [request.warm.digest() if request.warm else "" for request in (self, other)]
        alike = alike and begins[0] == begins[1]
        return alike and self.segment.info.digest == other.segment.info.digest


class Job(Task):
    """One training, from any thread: its status, course, result, and a way to stop it."""

    def __init__(
        self,
        owner: str,
        request: Request,
        train: Train | None = None,
        earlier: History | None = None,
    ) -> None:
        """Queued.

        Args:
            owner: who asked.
            request: what is to be trained.
            train: what does it; by default the network's training.
            earlier: the course of the training that this one continues.
        """
        super().__init__(owner)
        self.request = request
        self._train, self._earlier = train, earlier
        self._recorder, self._recent = Recorder(), deque[Progress](maxlen=200)
        self._fit: Fit | None = None

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

    def answer(self, fit: Fit) -> None:
        """End it with a result that was there before."""
        self._finish(Status.DONE, fit)

    def work(self, store: Store | None, threads: int | None) -> None:
        """Run it to its end, whatever that is; only the worker calls this."""
        if not self._begin():
            return
        try:
            warm = {"warm": self.request.warm} if self.request.warm else {}
            fit = (self._train or load_train())(
                self.request.segment,
                self.request.case,
                self.request.config,
                store=store,
                on_progress=self._note,
                should_stop=self._stop.is_set,
                threads=threads,
                **warm,
            )
        except AccpinnError as fault:
            self._end(Status.FAILED, error=str(fault))
        except Exception as fault:
            self._fail(fault, "training")
        else:
            stopped = fit.outcome is Outcome.STOPPED
            self._finish(Status.STOPPED if stopped else Status.DONE, fit)

    def _note(self, progress: Progress) -> None:
        with self._lock:
            self._recorder.add(progress)
            self._recent.append(progress)

    def _finish(self, status: Status, fit: Fit) -> None:
        with self._lock:
            self._fit = fit
        self._end(status)


def load_train() -> Train:
    """The network's training; its library takes a second or two to load.

    Raises:
        AccpinnError: where that library cannot be loaded.
    """
    try:
        from accpinn.methods.pinn.training import train
    except (ImportError, OSError) as fault:  # the latter for a library of another system
        raise AccpinnError(
            f"PyTorch, which trains the network, cannot be loaded ({str(fault)[:80]}); install the"
            " packages of requirements.txt again, then start the app anew."
        ) from fault
    return train


def _joined(before: History, after: History) -> History:
    """One course from two; what was repeated after a checkpoint is taken from the second."""
    kept = before.iteration < after.iteration[0]
    names = ("iteration", "seconds", "total", "data", "physics", "initial")
    parts = {
        name: np.concatenate([getattr(before, name)[kept], getattr(after, name)]) for name in names
    }
    tables = np.concatenate([before.parameters.values[kept], after.parameters.values])
    return History(**parts, parameters=Parameters.of(tables))
