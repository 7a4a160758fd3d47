"""Many recordings: every window in car-following under ACC, by several methods, on many processors.

One task is one window of a chain of vehicles with all methods that have no result for it yet. The
calling process reads the recordings, one at a time and as workers ask for more, sends each task its
data, and writes each result as it arrives. Results go by their content: recording, vehicles,
window, case and method. So a batch that was killed or stopped goes on where it was, a renamed file
is not computed again, and a further method adds its rows.

At the end the windows of each vehicle with one setting are taken together, where maximum likelihood
is among the methods (see `study.pooling`).

Workers are those of `study.cluster`. They need the package, but no access to the files.
"""

import hashlib
import json
import math
import os
import queue
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from accpinn.errors import AccpinnError, ConfigError, RecordingError
from accpinn.inference.intervals import intervals
from accpinn.methods.maximum_likelihood import KEY
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS, method_of
from accpinn.model.cthp import Case
from accpinn.recordings.files import mapping_of, read_all
from accpinn.recordings.makes import is_known
from accpinn.recordings.mapping import CsvMapping, write_mapping
from accpinn.recordings.recording import Recording, facts_of
from accpinn.segment.cut import DURATION, MINIMUM_DURATION, cut
from accpinn.segment.segment import Segment
from accpinn.study.cluster import WORKERLESS, connected, fault_of, is_killed, threads_of
from accpinn.study.journal import FORMAT, Failure, Journal, read_rows
from accpinn.study.plan import LEAST, plan
from accpinn.study.pooling import Pool, PoolWindow, pooled_row, pools
from accpinn.study.rows import rows_of
from accpinn.units import Seconds

if TYPE_CHECKING:
    from distributed import Client, Future

AHEAD = 2
"""Tasks that each worker has: one at work, and the next, so that none waits."""
POLL: Seconds = 0.2
PUBLISHED_EVERY: Seconds = 60.0
"""How often `results.parquet` is made while a batch runs."""
INTERVALS_SECONDS = POOLING_SECONDS = 2.0
"""Of a window's intervals, and of a vehicle's windows taken together, as the typical seconds of
methods."""
ENDINGS = (".csv", ".txt")
NOTHING = f"no complete stretch of {LEAST:g} s in car-following under ACC"
OTHER_MAPPING = (
    "its columns were read by another mapping before; take another folder for results by this one"
)


class Place(NamedTuple):
    """Where a planned window lies; that of uneven steps may be cut a little shorter."""

    sha256: str
    """Of the recording."""
    vehicles: tuple[int, ...]
    start: Seconds
    duration: Seconds


@dataclass(frozen=True, eq=False)
class BatchTask:
    """One window of a chain of vehicles, ready to be sent to a worker."""

    key: str
    place: Place
    segment: Segment
    recording: dict[str, Any]
    """What rows say of it."""
    modes: tuple[str, ...]
    """(M,) as `plan` gives them."""
    case: Case
    methods: tuple[str, ...]
    """Those that have no result yet."""


@dataclass(frozen=True, eq=False)
class PoolTask:
    """All windows of a vehicle with one setting, ready to be sent to a worker."""

    key: str
    pool: Pool
    segments: tuple[Segment, ...]
    """(K,) of the vehicle and the one ahead."""


@dataclass(frozen=True)
class MethodRows:
    """What one method made of a task, on a worker."""

    method: str
    rows: list[dict[str, Any]]
    """One a follower, or one for all windows of a vehicle; empty where it failed."""
    reason: str = ""
    """Why it failed."""
    final: bool = True
    """Whether it would fail again."""


@dataclass(frozen=True)
class BatchSummary:
    """What a batch has come to."""

    recordings: int
    """That could be read."""
    refused: int
    """Files, and trajectories of tables, that could not be read."""
    windows: int
    followers: int
    """Over all windows: followers of each."""
    rows: int
    """One a window, follower and method."""
    failed: int
    """Methods on windows that have no result."""
    reused: int
    """Rows that were there already."""
    seconds: Seconds
    stopped: bool
    """Whether it ended early because the caller said so."""
    unknown_names: tuple[str, ...] = ()
    """Of followers whose make and model the package does not know in one spelling."""


@dataclass(frozen=True)
class BatchProgress:
    """How far a batch has got."""

    files: int
    done: float
    """Files, those in work as fractions."""
    windows: int
    """Finished."""
    rows: int
    """Known so far, those reused included."""
    failed: int
    workers: int
    seconds: Seconds
    seconds_left: Seconds | None
    """None as long as nothing is known."""
    vehicles: int = 0
    """Whose windows are taken together at the end; known once all windows are finished."""
    pooled: int = 0
    """Of these, how many are finished."""
    share: float = 0.0
    """Of all the work that is done, 0 to 1."""


def batch(
    sources: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    study: str | os.PathLike[str],
    *,
    window: Seconds = DURATION,
    methods: Sequence[str] = tuple(METHODS),
    case: Case = "II",
    workers: int | None = None,
    scheduler: str | None = None,
    mapping: CsvMapping | None = None,
    on_progress: Callable[[BatchProgress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> BatchSummary:
    """Apply methods to every window of many recordings, and keep what they find in a folder.

    A script that calls this needs ``if __name__ == "__main__":``, as worker processes import it.

    Args:
        sources: files and folders; of a folder all CSV files in it and below.
        study: the folder of the results; one that exists is continued.
        window: longest window, in s; infinite for whole stretches.
        methods: keys of `METHODS`.
        case: "I" or "II".
        workers: processes on this machine; by default one for each processor.
        scheduler: address of a dask scheduler, as "tcp://host:8786", in place of ``workers``.
        mapping: of tables that are neither OpenACC runs nor tables of pairs.
        on_progress: called after every task.
        should_stop: asked several times a second; True ends the batch, and all is kept.

    Raises:
        ConfigError: for settings that are not allowed, or a study with others.
        RecordingError: when a source does not exist, the study cannot be written, or the scheduler
            cannot be reached.
    """
    started = time.monotonic()
    for key in methods:
        method_of(key)
    if case not in ("I", "II"):
        raise ConfigError(f"case: {case} is not known; choose I or II.")
    if not window >= MINIMUM_DURATION:
        raise ConfigError(
            f"window: {window:g} s is not allowed; choose {MINIMUM_DURATION:g} s or more."
        )
    if workers is not None and (workers < 1 or scheduler):
        raise ConfigError(
            f"workers: {workers} is not allowed; choose 1 or more, and none beside a scheduler."
        )
    files = files_of(sources, Path(study))
    length = window if math.isfinite(window) else "all"
    with Journal(Path(study), {"window": length, "case": case}) as journal:
        run = _Run(
            journal, tuple(dict.fromkeys(methods)), case, window, mapping, files, started,
            on_progress or (lambda _: None), should_stop or (lambda: False),
        )  # fmt: skip
        run.work(workers, scheduler)
        return run.summary()


def files_of(
    sources: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], study: Path | None = None
) -> list[Path]:
    """The files of a batch: each once, those of a folder in the order of their names.

    Args:
        sources: as `batch` takes them.
        study: the folder of the results, which may lie among them.

    Raises:
        RecordingError: when a source does not exist, or holds no CSV file.
    """
    listed = [sources] if isinstance(sources, str | os.PathLike) else list(sources)
    own = study.resolve() if study else None
    found: dict[Path, None] = {}
    for source in listed:
        path = Path(source)
        if path.is_dir():
            inside = (p for p in path.rglob("*") if p.suffix.lower() in ENDINGS and p.is_file())
            runs = (p for p in inside if not _is_note(p) and own not in p.resolve().parents)
            found |= dict.fromkeys(sorted(runs))
        elif path.exists():
            found[path] = None
        else:
            raise RecordingError(f"{path}: there is no such file or folder; check its name.")
    if not found:
        raise RecordingError(f"{listed[0] if listed else 'No source'}: no CSV file is there.")
    return list(found)


def _is_note(path: Path) -> bool:
    """Whether a text accompanies the runs and is none."""
    return path.suffix.lower() == ".txt" and not path.stem.lower().startswith("step")


class _Run:
    """One call of `batch`."""

    def __init__(
        self,
        journal: Journal,
        methods: tuple[str, ...],
        case: Case,
        window: Seconds,
        mapping: CsvMapping | None,
        files: list[Path],
        started: float,
        on_progress: Callable[[BatchProgress], None],
        should_stop: Callable[[], bool],
    ) -> None:
        self._journal, self._known = journal, journal.known
        self._methods, self._case, self._window = methods, case, window
        self._mapping, self._files, self._started = mapping, files, started
        self._on_progress, self._should_stop = on_progress, should_stop
        self._recordings = self._refused = self._windows = self._followers = 0
        self._rows = self._failed = self._reused = self._finished = 0
        self._stopped = False
        self._seen: dict[str, str] = {}
        self._paths: dict[str, Path] = {}
        # Progress: shares of files, each split among its tasks.
        self._done = self._computed = 0.0
        self._shares: dict[str, float] = {}
        self._vehicles = self._pooled = 0
        self._pooling_since: float | None = None
        self._is_done = False

    def summary(self) -> BatchSummary:
        return BatchSummary(
            recordings=self._recordings,
            refused=self._refused,
            windows=self._windows,
            followers=self._followers,
            rows=self._rows,
            failed=self._failed,
            reused=self._reused,
            seconds=round(time.monotonic() - self._started, 3),
            stopped=self._stopped,
            unknown_names=self._unknown_names(),
        )

    def _unknown_names(self) -> tuple[str, ...]:
        named = (row for row in read_rows(self._journal.folder) if row["make"])
        return tuple(sorted({row["name"] for row in named if not is_known(row["name"])}))

    def progress(self, workers: int) -> BatchProgress:
        pooling = self._pooling_cost() if self._pools_vehicles else 0.0
        done = min(self._done / len(self._files), 1.0)
        together = 1.0 if self._is_done else self._pooled / max(1, self._vehicles)
        return BatchProgress(
            files=len(self._files),
            done=min(self._done, len(self._files)),
            windows=self._finished,
            rows=self._rows,
            failed=self._failed,
            workers=workers,
            seconds=time.monotonic() - self._started,
            seconds_left=self._seconds_left(pooling),
            vehicles=self._vehicles,
            pooled=self._pooled,
            share=1.0 if self._is_done else (done + pooling * together) / (1.0 + pooling),
        )

    @property
    def _pools_vehicles(self) -> bool:
        return KEY in self._methods and self._case == "II"

    def _pooling_cost(self) -> float:
        """Of taking vehicles' windows together, against the methods on all windows."""
        every = sum(METHODS[key].typical_seconds for key in self._methods) + INTERVALS_SECONDS
        return POOLING_SECONDS / every

    def _seconds_left(self, pooling: float) -> Seconds | None:
        """By the pace of the stage that runs, and before the last one by its usual cost."""
        now = time.monotonic()
        if self._is_done:
            return 0.0
        if self._pooling_since is not None and self._pooled:
            spent = now - self._pooling_since
            return spent * (self._vehicles - self._pooled) / self._pooled
        if self._computed <= 0:
            return None
        since = self._pooling_since or now
        a_file = (since - self._started) / self._computed
        left = max(0.0, len(self._files) - self._done) * a_file
        return max(0.0, left + pooling * len(self._files) * a_file - (now - since))

    # Planning

    def tasks(self) -> Iterator[BatchTask]:
        """What is left to do, file by file; files are read when their turn comes."""
        for file in self._files:
            found = list(self._tasks_of(file))
            if not found:
                self._done += 1.0
            self._shares |= {task.key: 1.0 / len(found) for task in found}
            yield from found

    def _tasks_of(self, file: Path) -> Iterator[BatchTask]:
        place = f"file:{file}"
        try:
            raw = file.read_bytes()
        except OSError as fault:
            self._refuse(place, file.name, f"it cannot be opened ({fault.strerror})")
            return
        content = hashlib.sha256(raw).hexdigest()
        if content in self._seen:
            self._refuse(place, file.name, f"its contents are those of {self._seen[content]}")
            return
        self._seen[content] = file.name
        names: list[str] = []
        refused = self._refused
        try:
            used = mapping_of(raw, file.name, self._mapping)
            mapping = hashlib.sha256(write_mapping(used)).hexdigest() if used else ""
            known = self._known.recordings.get(content, {})
            if known.get("mapping") not in (None, mapping):
                self._refuse(place, file.name, OTHER_MAPPING)
                return
            if not self._skip(known, file):
                for found in read_all(file, mapping=self._mapping):
                    if isinstance(found, Recording):
                        names.append(found.sha256)
                        self._paths[found.sha256] = file
                        yield from self._tasks_in(found, file.name)
                    else:
                        self._refuse(f"{place}:{found}", file.name, str(found))
                about = {"recordings": names, "refused": self._refused - refused}
                self._journal.add("recording", content, file=file.name, mapping=mapping, **about)
        except AccpinnError as fault:
            self._refuse(place, file.name, str(fault))
            return
        except Exception as fault:  # whatever a file holds, the others go on
            self._refuse(place, file.name, f"{type(fault).__name__}: {fault}")
            return
        if place in self._known.failures:  # the file was replaced since
            self._journal.add("recovered", place)

    def _skip(self, known: dict[str, Any], file: Path) -> bool:
        """Whether all of a file is known; its numbers are then counted without reading it."""
        plans = self._known.plans
        names = known.get("recordings", ())
        if not known or any(name not in plans for name in names):
            return False
        self._paths |= dict.fromkeys(names, file)
        places = [
            Place(name, tuple(w["vehicles"]), w["start"], w["duration"])
            for name in names
            for w in plans[name]
        ]
        if any(map(self._missing, places)):
            return False
        self._recordings += len(names)
        self._refused += known["refused"]
        for place in places:
            self._count(place)
        return True

    def _tasks_in(self, recording: Recording, file: str) -> Iterator[BatchTask]:
        self._recordings += 1
        planned = plan(recording, self._window)
        own = {"file": file, "trajectory": recording.trajectory, "sha256": recording.sha256}
        about = {**facts_of(recording), **own}
        name = recording.sha256
        windows = [
            {"vehicles": list(p.vehicles), "start": p.window.start, "duration": p.window.duration}
            for p in planned
        ]
        if self._known.plans.get(name) != windows:
            self._journal.add("plan", name, windows=windows)
        if not planned:
            self._fail(name, Failure(file, None, None, NOTHING), final=True)
        for one in planned:
            place = Place(name, one.vehicles, one.window.start, one.window.duration)
            self._count(place)
            missing = self._missing(place)
            if missing:
                segment = self._segment(recording, place)
                if segment:
                    key = self._key(place, ",".join(missing))
                    yield BatchTask(key, place, segment, about, one.modes, self._case, missing)

    def pool_tasks(self) -> Iterator[PoolTask]:
        """The vehicles whose pooled parameters are not known; files are read again for each."""
        if not self._pools_vehicles or self._stopped:
            return
        known, at_hand = self._known.pooled | self._known.final, self._paths.keys()
        left = [
            pool
            for pool in pools(read_rows(self._journal.folder))
            if pool.key not in known and {one.sha256 for one in pool.windows} <= at_hand
        ]
        self._vehicles, self._pooling_since = len(left), time.monotonic()
        for pool in left:
            try:
                yield PoolTask(pool.key, pool, self._pool_segments(pool))
            except (AccpinnError, OSError) as fault:
                self._pooled += 1
                self._fail_pool(pool, str(fault), final=False)

    def _pool_segments(self, pool: Pool) -> tuple[Segment, ...]:
        wanted: dict[Path, dict[str, list[PoolWindow]]] = {}
        for one in pool.windows:
            by_name = wanted.setdefault(self._paths[one.sha256], {})
            by_name.setdefault(one.sha256, []).append(one)
        segments = []
        for path, by_name in wanted.items():
            for recording in read_all(path, mapping=self._mapping):
                if isinstance(recording, Recording):
                    for one in by_name.get(recording.sha256, ()):
                        pair = (one.vehicle - 1, one.vehicle)
                        segments.append(cut(recording, one.start, one.duration, pair))
        return tuple(segments)

    def _fail_pool(self, pool: Pool, reason: str, final: bool) -> None:
        said = f"{pool.shared['name']}, all windows together: {reason}"
        self._fail(pool.key, Failure("", None, None, said), final)

    def _segment(self, recording: Recording, place: Place) -> Segment | None:
        try:
            return cut(recording, place.start, place.duration, place.vehicles)
        except AccpinnError as fault:
            failure = Failure(recording.source, place.start, None, str(fault))
            self._fail(self._key(place, ""), failure, final=True)
            return None

    def _key(self, place: Place, method: str) -> str:
        """The address of a result: a digest of all that determines it."""
        content = [FORMAT, *place, self._case, method]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:32]

    def _missing(self, place: Place) -> tuple[str, ...]:
        keys = {method: self._key(place, method) for method in self._methods}
        known = self._known
        return tuple(m for m, k in keys.items() if k not in known.results and k not in known.final)

    def _count(self, place: Place) -> None:
        """A window, and what is known of it."""
        self._windows += 1
        self._followers += len(place.vehicles) - 1
        for method in self._methods:
            key = self._key(place, method)
            self._reused += self._known.results.get(key, 0)
            self._rows += self._known.results.get(key, 0)
            self._failed += key in self._known.final

    def _refuse(self, key: str, file: str, reason: str) -> None:
        self._refused += 1
        self._fail(key, Failure(file, None, None, reason), final=False)

    def _fail(self, key: str, failure: Failure, final: bool) -> None:
        if self._known.failures.get(key) != failure:
            self._journal.add("failure", key, **vars(failure), final=final)

    # Working

    def work(self, workers: int | None, scheduler: str | None) -> None:
        """Run all tasks; workers are started for the first one that is left to do."""
        self._on_progress(self.progress(0))
        client: Client | None = None
        with ExitStack() as opened:
            windows: Phase[Any] = Phase(self.tasks, run_task, self._finish)
            vehicles: Phase[Any] = Phase(self.pool_tasks, run_pool, self._finish_pool)
            for phase in (windows, vehicles):
                tasks = phase.tasks()
                first = next(tasks, None)
                if first is not None:
                    client = client or opened.enter_context(connected(workers, scheduler))
                    self._on_progress(self.progress(threads_of(client)))
                    self._drive(client, phase, first, tasks, scheduler is None)
        self._is_done = not self._stopped
        self._on_progress(self.progress(0))

    def _drive(
        self,
        client: "Client",
        phase: "Phase[Any]",
        first: Any,
        tasks: Iterator[Any],
        is_local: bool,
    ) -> None:
        """Keep workers at a phase's tasks until all have ended, or the caller says stop."""
        ended: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        running: dict[str, tuple[Future[Any], Any]] = {}
        put_off: list[Any] = []
        waiting = first
        published = alive = time.monotonic()
        slots, looked, alone = 0, -1.0, False
        try:
            while waiting or running or put_off:
                if self._should_stop():
                    self._stopped = True
                    break
                if time.monotonic() - looked > 1.0:
                    slots, looked = threads_of(client), time.monotonic()
                    alive = looked if slots or not is_local else alive
                if time.monotonic() - alive > WORKERLESS:
                    raise RecordingError(
                        "The workers have died and no others start; what was finished is kept, and"
                        " the same call goes on from there."
                    )
                if not waiting and not running:
                    # What workers died at, one by one, so that nothing else is to blame.
                    alone, waiting = True, put_off.pop(0)
                room = 1 if alone else AHEAD * max(1, slots)
                # What has ended is written before another file is read.
                while waiting and len(running) < room and ended.empty():
                    key = f"{waiting.key}{'-alone' * alone}"
                    future = client.submit(phase.run, waiting, key=key, pure=False)
                    running[key] = (future, waiting)
                    future.add_done_callback(ended.put)
                    waiting = None if alone else next(tasks, None)
                try:
                    future = ended.get(timeout=POLL)
                except queue.Empty:
                    continue
                if future.key in running:
                    future, task = running.pop(future.key)
                    if not alone and is_killed(future):
                        put_off.append(task)
                        continue
                    phase.finish(future, task)
                    future.release()
                    self._on_progress(self.progress(slots))
                if time.monotonic() - published > PUBLISHED_EVERY:
                    self._journal.publish()
                    published = time.monotonic()
        finally:
            for future, _ in running.values():
                future.cancel()

    def _finish(self, future: "Future[Any]", task: BatchTask) -> None:
        """Write what became of a task."""
        share = self._shares.pop(task.key)
        self._done += share
        self._computed += share
        self._finished += 1
        reason = fault_of(future)
        if reason:
            found = [MethodRows(m, [], reason, final=False) for m in task.methods]
        else:
            found = future.result()
        vehicles = task.place.vehicles
        for one in found:
            key = self._key(task.place, one.method)
            if one.rows:
                self._journal.add("result", key, rows=one.rows)
                self._rows += len(one.rows)
                continue
            self._failed += 1
            alone = vehicles[1] if len(vehicles) == 2 else None
            reason = f"{one.method}: {one.reason}"
            self._fail(
                key, Failure(task.recording["file"], task.place.start, alone, reason), one.final
            )

    def _finish_pool(self, future: "Future[Any]", task: PoolTask) -> None:
        """Write what became of a vehicle."""
        self._pooled += 1
        reason = fault_of(future)
        found = MethodRows(KEY, [], reason, final=False) if reason else future.result()
        if found.rows:
            self._journal.add("pooled", task.key, row=found.rows[0])
        else:
            self._fail_pool(task.pool, found.reason, found.final)


T = TypeVar("T")


@dataclass(frozen=True)
class Phase(Generic[T]):
    """Tasks of one kind: where they come from, what workers do, what becomes of the answer."""

    tasks: Callable[[], Iterator[T]]
    run: Callable[[T], Any]
    finish: Callable[["Future[Any]", T], None]


def run_task(task: BatchTask) -> list[MethodRows]:
    """All methods of a task, on a worker; one that fails does not stop the others."""
    segment = replace(task.segment)  # arrays of one's own: those received may lie anyhow in memory

    def rows(key: str) -> list[dict[str, Any]]:
        fit = METHODS[key].fit(segment, task.case, None, TaskContext(threads=1))
        return rows_of(segment, task.recording, task.modes, fit, intervals(segment, fit))

    return [_tried(key, partial(rows, key)) for key in task.methods]


def run_pool(task: PoolTask) -> MethodRows:
    """The pooled parameters of a vehicle, on a worker."""
    return _tried(KEY, lambda: [pooled_row(task.pool, task.segments)])


def _tried(method: str, rows: Callable[[], list[dict[str, Any]]]) -> MethodRows:
    try:
        return MethodRows(method, rows())
    except AccpinnError as fault:
        return MethodRows(method, [], str(fault))
    except Exception as fault:  # a fault of the program, told and tried again another time
        return MethodRows(method, [], f"{type(fault).__name__}: {fault}", final=False)
