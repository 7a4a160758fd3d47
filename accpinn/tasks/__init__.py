"""Work in the background: one kind of task, and the queue it waits in.

A task runs one analysis (a training), or several that differ in method (a comparison) or in
initial values (a series of starts). A training knows its point before its intervals. Batches and
downloads are tasks, too (see `tasks.batches`). Each keeps a processor core busy, so one task runs
at a time, in one thread, and the others wait their turn: users take turns, whatever number of tasks
each has. A server that many use sets a limit of time, and its operator can end all tasks. Whoever
asks (a page, many times a second)
gets answers at once and never waits for the worker. A training that was stopped is continued by
submitting the same request again: the store holds its checkpoint.
"""

import gc
import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache, partial
from itertools import takewhile
from pathlib import Path
from typing import Any, Generic, TypeVar

from threadpoolctl import threadpool_limits

from accpinn.errors import AccpinnError
from accpinn.inference.model_adequacy import Adequacy
from accpinn.methods import Segments, TaskContext, relative_size
from accpinn.methods.estimate import Estimate, History, Outcome, Progress, Recorder
from accpinn.methods.forecast import SETTLED
from accpinn.methods.pinn.config import STARTS
from accpinn.methods.registry import COMPARED, METHODS, variant_of
from accpinn.model.cthp import Trajectories
from accpinn.model.registry import following_model
from accpinn.recordings import Recording
from accpinn.study import Analysis
from accpinn.study.comparison import Refused, compare, starts
from accpinn.study.judge import Judgement, Subject, judge
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.study.snapshot_library import Library
from accpinn.study.store import Store
from accpinn.study.verification import HOWEVER_LONG, Verification, verify
from accpinn.units import Seconds

_log = logging.getLogger(__name__)

OVERRUN = 0.25
"""Least time left, as a share of the time since it was told: what takes longer is not soon over."""
FORMS = "forms of the model"
"""The last part of a comparison."""
FORMS_SECONDS: Seconds = 2.5
"""Typical time of the forms of the model for one follower in 300 s."""
WITH_BLOCKS = 3
"""Times as long as one estimate takes one with parts of the data held out in turn."""
KEPT_TASKS = 100
"""Finished tasks beyond this number are forgotten, the oldest first."""
LONGEST_QUEUE = 60
"""More tasks than this do not wait; each owner has one of a kind at most."""
WATCH: Seconds = 1.0
"""Time between two looks at whether a running task must end."""
GRACE: Seconds = 2.0
"""The worker gets ready after so long, or with the first task: meanwhile the first page is drawn,
which else shares the processor with imports."""
Found = TypeVar("Found")
Steps = Callable[[TaskContext], Iterator[Found]]
"""The work: yields each result, reports progress between, and ends early once it should stop."""


class Status(Enum):
    """State of a task."""

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
    ) -> None:
        """Queued.

        Args:
            owner: who asked; an owner has one active task of a kind.
            kind: its name in sentences, as "comparison".
            steps: the work.
            names: names of the results, in their order.
            weights: how long each result takes compared with the others, which the time left is
                estimated from; empty for a task that tells it itself.
            analysis: what a training answers; a task of an equal analysis is not run twice.
        """
        self.owner, self.kind, self.names, self.analysis = owner, kind, names, analysis
        self._steps, self._weights = steps, tuple(weights)
        self._lock = threading.Lock()
        self._stop, self._ended = threading.Event(), threading.Event()
        self.status = Status.QUEUED
        self.user = owner
        """Whose turn it takes in the queue; see `TaskQueue.submit`."""
        self.round = 0
        """The round of turns in which it runs."""
        self.created = time.time()
        self.error = ""
        """Why it failed, or was stopped by someone else, as a sentence; empty otherwise."""
        self._reason = ""
        self.results: tuple[Found, ...] = ()
        """All results so far, also those of a task that was stopped or failed."""
        self.recorder = Recorder()
        """The course of the running estimation, or of the latest one."""
        self._latest: Progress | None = None
        self._latest_at: Seconds = 0.0
        """When that moment was told."""
        self._began: Seconds | None = None
        self.curves: Trajectories | None = None
        """The latest curves of the running estimation, in its first window."""
        self.point: Estimate | None = None
        """The running estimation's point, once it is known; its intervals follow."""
        self.latest: Any = None
        """Progress of work with a type of its own, which has a ``share``; see `tasks.batches`."""

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
        return self._latest

    @property
    def current(self) -> str:
        """The name of the running estimation; empty where none runs."""
        done = len(self.results)
        return self.names[done] if self.is_active and done < len(self.names) else ""

    @property
    def share(self) -> float:
        """The share of the work that is done, 0 to 1."""
        if self.latest is not None:
            return float(self.latest.share)
        with self._lock:
            done, now, left = len(self.results), self._latest, self._left
        weights = self._weights or (1.0,) * len(self.names)
        within = 0.0
        if now and left is not None:
            spent = now.seconds + time.monotonic() - self._latest_at
            within = spent / max(spent + left, 1e-9)
        running = within * weights[done] if done < len(weights) else 0.0
        return min(1.0, (sum(weights[:done]) + running) / sum(weights))

    @property
    def time_left(self) -> Seconds | None:
        """Time until its end, in s; None where nothing is known of it."""
        if self._weights:
            share = self.share
            if self._began is None or share <= 0:
                return None
            return (time.monotonic() - self._began) * (1 - share) / share
        with self._lock:
            return self._left

    @property
    def _left(self) -> Seconds | None:
        """Time left of the running estimation, since its latest moment told it."""
        if self._latest is None or self._latest.left is None:
            return None
        since = time.monotonic() - self._latest_at
        return max(self._latest.left - since, OVERRUN * since)

    def history(self) -> History | None:
        """The history of the running or latest estimation, None before its first moment."""
        with self._lock:
            if isinstance(self.result, Result) and not self._latest:
                return self.result.history
            return self.recorder.history() if self.recorder else None

    @property
    def seconds(self) -> Seconds:
        """Running time so far; 0 for a task that has not started."""
        return time.monotonic() - self._began if self._began is not None else 0.0

    def stop(self, reason: str = "") -> None:
        """Ask it to end soon, with its results so far; one that still waits ends at once.

        ``reason`` is a sentence where someone else than its owner ends it.
        """
        with self._lock:
            if not self._stop.is_set():
                self._reason = reason
            self._stop.set()
            if self.status is Status.QUEUED:
                self._end(Status.STOPPED, reason)

    def refuse(self, reason: str) -> None:
        """End it before it has begun, for a reason that is given as a sentence."""
        self._end(Status.FAILED, reason)

    def finish(self, result: Found) -> None:
        """End it with a result that is known already."""
        self._add(result)
        self._end(Status.DONE)

    def wait(self, timeout: Seconds | None = None) -> bool:
        """Wait for its end; False if that did not come in time."""
        return self._ended.wait(timeout)

    def work(self) -> None:
        """Run it to its end, whatever that is; only the queue's worker does."""
        with self._lock:
            if self.status is not Status.QUEUED:
                return
            self.status, self._began = Status.RUNNING, time.monotonic()
        context = TaskContext(
            on_progress=self._note, should_stop=self._stop.is_set, on_estimate=self._know
        )
        try:
            for result in self._steps(context):
                self._add(result)
        except AccpinnError as fault:  # a stop may leave nothing to answer with
            is_stopped = self._stop.is_set()
            error = (self._reason if is_stopped else "") or str(fault)
            self._end(Status.STOPPED if is_stopped else Status.FAILED, error)
        except Exception as fault:
            _log.exception("A %s ended unexpectedly", self.kind)
            self._end(
                Status.FAILED,
                f"The {self.kind} ended unexpectedly ({type(fault).__name__}): a fault of this"
                " program, not of your data; its log has the details. Try other settings.",
            )
        else:
            estimates = [r.estimate for r in self.results if isinstance(r, Result)]
            is_complete = len(self.results) == len(self.names) and all(
                estimate.outcome is not Outcome.STOPPED for estimate in estimates
            )
            self._end(
                Status.DONE if is_complete else Status.STOPPED, "" if is_complete else self._reason
            )

    def _note(self, progress: Progress) -> None:
        with self._lock:
            if not self._latest and self.results:
                self.recorder = Recorder()
            self._latest, self._latest_at = progress, time.monotonic()
            if progress.phase not in SETTLED:
                self.recorder.add(progress)
            self.curves = progress.curves or self.curves

    def _know(self, point: Estimate) -> None:
        with self._lock:
            self.point = point

    def _add(self, result: Found) -> None:
        with self._lock:
            self.results = (*self.results, result)
            self.point = self._latest = None

    def _end(self, status: Status, error: str = "") -> None:
        self.error, self.status = error, status  # whoever sees that it failed can ask why
        self._ended.set()


@cache
def get_ready() -> None:
    """Import what a training needs, and share the process among threads.

    What is imported stays for good, and a search of it for garbage would hold up all threads, so it
    is kept from the collector. Linear algebra takes one thread each.
    """
    # Whole before PyTorch: it looks into what another thread has half imported, and a page fails.
    import scipy.interpolate
    import scipy.stats  # noqa: F401

    from accpinn.methods.pinn import calibrated, fast  # noqa: F401  (with PyTorch)

    gc.collect()
    gc.freeze()
    threadpool_limits(limits=1, user_api="blas")


class TaskQueue:
    """All tasks of a server, and the one thread that works on them.

    Users take turns, by start-time fair queueing: a user's first waiting task belongs to the round
    after the present one, the next to the round after that, and so on.
    """

    def __init__(
        self,
        prepare: Callable[[], object] = get_ready,
        limit: Seconds | None = None,
        stop_file: Path | None = None,
    ) -> None:
        """Start the worker, which calls ``prepare`` before the first task.

        Args:
            prepare: called in the worker's thread.
            limit: longest time that a task may run; it then ends with its results so far.
            stop_file: whenever its operator touches it, all tasks end that were submitted before.
        """
        self._prepare, self.limit, self._stop_file = prepare, limit, stop_file
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._tasks: list[Task[Any]] = []
        """In the order of their submission."""
        self._round, self._is_closed = 0, False
        self._asked = threading.Event()
        # A daemon, so that the server can end in the middle of a training.
        self._worker = threading.Thread(target=self._serve, name="tasks", daemon=True)
        self._worker.start()

    def submit(self, task: Task[Found], user: str = "") -> Task[Found]:
        """Queue a task, unless it has an answer; an active one of its owner and kind is stopped.

        An active task of an equal analysis is returned in its place. ``user`` is who takes a turn
        with it, by default its owner. Where too many wait already, the task fails at once and says
        so; or the latest of the user who has most in the queue does, where that is another.
        """
        analysis, task.user = task.analysis, user or task.owner
        with self._lock:
            earlier = self.of(task.owner, task.kind)
            if earlier:
                is_same = analysis and earlier.analysis and analysis.key == earlier.analysis.key
                if is_same and earlier.is_active and not earlier.is_stopping:
                    return earlier
                earlier.stop()
            ended = [other for other in self._tasks if not other.is_active]
            forgotten = ended[:-KEPT_TASKS]
            self._tasks = [other for other in self._tasks if other not in forgotten]
            waiting = self._waiting()
            theirs = [other for other in self._tasks if other.user == task.user]
            rounds = [other.round for other in theirs if other.status is not Status.STOPPED]
            task.round = 1 + max(self._round, *rounds, 0)
            self._tasks.append(task)
            if task.is_active and len(waiting) >= LONGEST_QUEUE:
                # Room is made at the cost of who has most in the queue; else the task is refused.
                counts, refused = Counter(other.user for other in waiting), task
                user, most = counts.most_common(1)[0]
                if most > counts[task.user] + 1:
                    refused = next(other for other in reversed(waiting) if other.user == user)
                refused.refuse(f"{len(waiting)} tasks are waiting already; try again later.")
            self._changed.notify()
            self._asked.set()
        return task

    def of(self, owner: str, kind: str = "training") -> Task[Any] | None:
        """The owner's latest task of that kind that is not forgotten."""
        with self._lock:
            tasks = reversed(self._tasks)
            return next((task for task in tasks if (task.owner, task.kind) == (owner, kind)), None)

    def active_owners(self, kind: str) -> tuple[str, ...]:
        """Whose tasks of that kind wait or run."""
        return tuple(task.owner for task in self.active() if task.kind == kind)

    def active(self) -> tuple[Task[Any], ...]:
        """The task that runs, and those that wait, in the order of their turns."""
        with self._lock:
            running = [task for task in self._tasks if task.status is Status.RUNNING]
            return (*running, *self._in_turn())

    def ahead_of(self, task: Task[Any]) -> tuple[Task[Any], ...]:
        """The tasks that run or wait before a queued one; none once it runs."""
        with self._lock:
            if task.status is not Status.QUEUED:
                return ()
            return tuple(takewhile(lambda other: other is not task, self.active()))

    def wait_for(self, task: Task[Any]) -> Seconds | None:
        """Longest wait until a queued task starts; None where that is not known."""
        times = [other.time_left for other in self.ahead_of(task)]
        longest = self.limit or float("inf")
        total = 0.0
        for seconds in times:
            if seconds is None:
                return None
            total += min(seconds, longest)
        return total

    def close(self) -> None:
        """Stop everything and end the worker."""
        with self._lock:
            for task in self._tasks:
                task.stop()
            self._is_closed = True
            self._changed.notify()
        self._asked.set()
        self._worker.join()

    def _waiting(self) -> list[Task[Any]]:
        return [task for task in self._tasks if task.status is Status.QUEUED]

    def _in_turn(self) -> Iterator[Task[Any]]:
        """The waiting tasks in the order in which they will run, if no other comes."""
        return iter(sorted(self._waiting(), key=lambda task: task.round))

    def _serve(self) -> None:
        self._asked.wait(GRACE)
        with suppress(Exception):  # reported by every task that needs what is prepared
            self._prepare()
        while True:
            with self._changed:
                while not (self._is_closed or self._waiting()):
                    self._changed.wait()
                if self._is_closed:
                    return
                task = next(self._in_turn())
                self._round = task.round
            if self.limit or self._stop_file:
                threading.Thread(target=self._watch, args=(task,), daemon=True).start()
            task.work()
            del task
            if not self._waiting():
                gc.collect()  # no page waits for that

    def _watch(self, task: Task[Any]) -> None:
        """End a task that runs for too long, and all tasks whose end the operator asks for."""
        while True:
            stopped_at = 0.0
            with suppress(OSError):  # there is no such file yet
                stopped_at = self._stop_file.stat().st_mtime if self._stop_file else 0.0
            with self._lock:
                tasks = [other for other in self._tasks if other.created <= stopped_at]
            for other in tasks:
                other.stop("Whoever runs this server ended it; what it found is kept.")
            if self.limit and task.seconds > self.limit:
                task.stop(
                    f"It ended at this server's limit of {self.limit / 60:g} min; what it found is"
                    " kept. It may be continued, after the tasks of others."
                )
            if task.wait(WATCH):
                return


# What is asked


def training_task(
    owner: str,
    analysis: Analysis,
    recording: Recording | None,
    store: Store | None,
    segments: Segments = (),
    anew: bool = False,
    kind: str = "training",
    shown_to: Sequence[str] = (),
) -> Task[Result]:
    """The answer to one analysis, with all that a page shows of it; a stored one is there at once.

    A stopped training of an equal analysis goes on from its checkpoint, if it is not to begin anew.
    A finished one is entered among what each of ``shown_to`` was shown, by default its owner. The
    data are given or cut from the recording. Trainings of one owner that differ in ``kind`` wait
    for each other.
    """

    def answered(context: TaskContext | None) -> Result:
        result = run(analysis, recording, segments=segments, store=store, context=context)
        if store and result.is_finished:
            for session in shown_to or (owner,):
                store.record_shown(session, result)
        return result

    def steps(context: TaskContext) -> Iterator[Result]:
        get_ready()
        if store and (state := store.stopped_state(analysis)):
            task.recorder.restore(state)
        yield answered(replace(context, with_checks=True))

    task = Task(owner, kind, steps, analysis=analysis)
    if store and store.find(analysis):
        task.finish(answered(None))
    elif store and anew and analysis.checkpoint_key:
        store.checkpoints(analysis).drop()
    return task


def comparison_task(
    owner: str, analysis: Analysis, recording: Recording | None, segments: Segments
) -> Task[Result | Refused | Adequacy]:
    """All methods on the windows, those first that take least, and the forms of the model."""
    seconds = compared_seconds(segments)
    names = sorted(COMPARED, key=seconds.__getitem__)

    def steps(context: TaskContext) -> Iterator[Result | Refused | Adequacy]:
        get_ready()
        # Several fits make one result, so there is no progress within one.
        quiet = replace(context, on_progress=None, on_estimate=None)
        last: Result | None = None
        for outcome in compare(analysis, recording, names, segments=segments, context=quiet):
            last = outcome if isinstance(outcome, Result) else last
            yield outcome
        if last and not context.is_stopped:
            yield last.adequacy

    return Task(owner, "comparison", steps, (*names, FORMS), [seconds[n] for n in (*names, FORMS)])


def compared_seconds(segments: Segments) -> dict[str, Seconds]:
    """Expected time of each part of a comparison on two cores, right within a factor of two."""
    expected = {FORMS: FORMS_SECONDS * relative_size(segments[0])}
    for name in COMPARED:
        key, config = variant_of(name)
        seconds = METHODS[key].expected_seconds(segments, config)
        expected[name] = seconds * (WITH_BLOCKS if METHODS[key].duration else 1)
    return expected


def judgement_task(
    owner: str, subjects: Sequence[Subject], models: Sequence[str]
) -> Task[tuple[Judgement, ...]]:
    """Car-following models in windows left out; each result has all models so far."""

    def steps(context: TaskContext) -> Iterator[tuple[Judgement, ...]]:
        return judge(subjects, models, context.should_stop)

    following = [following_model(key) for key in models]
    weights = [len(model.parameters) ** 2 for model in following]
    titles = tuple(model.title for model in following)
    return Task(owner, "judgement of models", steps, titles, weights)


def verification_task(
    owner: str, snapshot: Result, recording: Recording | None, library: Library
) -> Task[Verification]:
    """The methods of a snapshot run again, and compared; the library keeps what came of it."""

    def steps(context: TaskContext) -> Iterator[Verification]:
        get_ready()
        verification = verify(snapshot, recording, refit_within=HOWEVER_LONG, context=context)
        if not context.is_stopped:
            library.keep_verification(snapshot, verification)
            yield verification

    return Task(owner, "verification", steps)


@dataclass(frozen=True)
class Part:
    """One training of a series."""

    name: str
    prepare: Callable[[], tuple[Analysis, Recording | None]]
    """Gives the analysis and its recording, which are not read before its turn comes."""
    seconds: Seconds = 1.0
    """Typical time, relative to that of the others."""
    is_listed: bool = False
    """Whether its result is entered among what the owner was shown."""


def series_task(
    owner: str,
    kind: str,
    parts: Sequence[Part],
    store: Store | None,
    segments: Segments = (),
    shown_to: Sequence[str] = (),
) -> Task[Result]:
    """Trainings one after the other; the further arguments are those of `training_task`."""

    def steps(context: TaskContext) -> Iterator[Result]:
        get_ready()
        for part in parts:
            analysis, recording = part.prepare()
            result = run(analysis, recording, segments=segments, store=store, context=context)
            if context.is_stopped:
                return
            if store and part.is_listed:
                for session in shown_to or (owner,):
                    store.record_shown(session, result)
            yield result

    names, seconds = tuple(part.name for part in parts), [part.seconds for part in parts]
    return Task(owner, kind, steps, names, seconds)


def starts_task(
    owner: str,
    analysis: Analysis,
    recording: Recording | None,
    store: Store | None,
    segments: Segments = (),
) -> Task[Result]:
    """Trainings from five initial values; the arguments are those of `training_task`."""
    parts = [
        Part(f"start {k} of {len(STARTS)}", partial(lambda start: (start, recording), start))
        for k, start in enumerate(starts(analysis), 1)
    ]
    return series_task(owner, "series of starts", parts, store, segments)
