"""Many recordings: every window in car-following under ACC, by several methods, on many processors.

One task is one window of a chain of vehicles with all methods that have no result for it yet. The
calling process reads the recordings, one at a time and as workers ask for more, sends each task its
data, and writes each result as it arrives. Results go by their content: recording, vehicles,
window, case and method. So a batch that was killed or stopped goes on where it was, a renamed file
is not computed again, and a further method adds its rows.

At the end the windows of each vehicle with one setting are taken together, where maximum likelihood
is among the methods (see `study.pooling`).

Workers are those of `study.cluster`.
"""

import hashlib
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from accpinn.errors import AccpinnError, ConfigError, RecordingError
from accpinn.methods.maximum_likelihood import KEY
from accpinn.methods.registry import METHODS, method_of
from accpinn.model.cthp import Case
from accpinn.recordings.files import mapping_of, read_all
from accpinn.recordings.makes import is_known
from accpinn.recordings.mapping import CsvMapping, write_mapping
from accpinn.recordings.recording import Recording, facts_of
from accpinn.segment.cut import DURATION, MINIMUM_DURATION, cut
from accpinn.segment.segment import Segment
from accpinn.study.batch_progress import BatchProgress, BatchSummary, Tally
from accpinn.study.batch_tasks import BatchTask, MethodRows, Place, PoolTask, run_pool, run_task
from accpinn.study.cluster import connected, fault_of, run_all, threads_of
from accpinn.study.journal import FORMAT, Failure, Journal, read_rows
from accpinn.study.plan import LEAST, plan
from accpinn.study.pooling import Pool, PoolWindow, pools
from accpinn.units import Seconds

if TYPE_CHECKING:
    from distributed import Client, Future

PUBLISHED_EVERY: Seconds = 60.0
"""How often `results.parquet` is made while a batch runs."""
ENDINGS = (".csv", ".txt")
NOTHING = f"no complete stretch of {LEAST:g} s in car-following under ACC"
OTHER_MAPPING = (
    "its columns were read by another mapping before; take another folder for results by this one"
)


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
        self._mapping, self._files = mapping, files
        self._on_progress, self._should_stop = on_progress, should_stop
        self._tally = Tally(len(files), methods, KEY in methods and case == "II", started)
        self._published = time.monotonic()
        self._stopped = False
        self._seen: dict[str, str] = {}
        self._paths: dict[str, Path] = {}

    def summary(self) -> BatchSummary:
        named = (row for row in read_rows(self._journal.folder) if row["make"])
        unknown = {row["name"] for row in named if not is_known(row["name"])}
        return self._tally.summary(self._stopped, tuple(sorted(unknown)))

    # Planning

    def tasks(self) -> Iterator[BatchTask]:
        """What is left to do, file by file; files are read when their turn comes."""
        for file in self._files:
            found = list(self._tasks_of(file))
            self._tally.plan_file([task.key for task in found])
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
        refused = self._tally.refused
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
                about = {"recordings": names, "refused": self._tally.refused - refused}
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
        self._tally.recordings += len(names)
        self._tally.refused += known["refused"]
        for place in places:
            self._count(place)
        return True

    def _tasks_in(self, recording: Recording, file: str) -> Iterator[BatchTask]:
        self._tally.recordings += 1
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
        if not self._tally.pools_vehicles or self._stopped:
            return
        known, at_hand = self._known.pooled | self._known.final, self._paths.keys()
        left = [
            pool
            for pool in pools(read_rows(self._journal.folder))
            if pool.key not in known and {one.sha256 for one in pool.windows} <= at_hand
        ]
        self._tally.plan_pooling(len(left))
        for pool in left:
            try:
                yield PoolTask(pool.key, pool, self._pool_segments(pool))
            except (AccpinnError, OSError) as fault:
                self._tally.pooled += 1
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
        tally = self._tally
        tally.windows += 1
        tally.followers += len(place.vehicles) - 1
        for method in self._methods:
            key = self._key(place, method)
            tally.reused += self._known.results.get(key, 0)
            tally.rows += self._known.results.get(key, 0)
            tally.failed += key in self._known.final

    def _refuse(self, key: str, file: str, reason: str) -> None:
        self._tally.refused += 1
        self._fail(key, Failure(file, None, None, reason), final=False)

    def _fail(self, key: str, failure: Failure, final: bool) -> None:
        if self._known.failures.get(key) != failure:
            self._journal.add("failure", key, **vars(failure), final=final)

    # Working

    def work(self, workers: int | None, scheduler: str | None) -> None:
        """Run all tasks; workers are started for the first one that is left to do."""
        self._tell(0)
        client: Client | None = None
        phases: tuple[tuple[Iterator[Any], Callable[[Any], Any], Callable[..., None]], ...] = (
            (self.tasks(), run_task, self._finish),
            (self.pool_tasks(), run_pool, self._finish_pool),
        )
        with ExitStack() as opened:
            for tasks, run, finish in phases:
                first = next(tasks, None)
                if first is not None:
                    client = client or opened.enter_context(connected(workers, scheduler))
                    self._tell(threads_of(client))
                    self._stopped = not run_all(
                        client,
                        chain([first], tasks),
                        run,
                        finish,
                        is_local=scheduler is None,
                        on_progress=self._tell,
                        should_stop=self._should_stop,
                    )
        self._tally.is_done = not self._stopped
        self._tell(0)

    def _tell(self, workers: int) -> None:
        self._on_progress(self._tally.progress(workers))
        if time.monotonic() - self._published > PUBLISHED_EVERY:
            self._journal.publish()
            self._published = time.monotonic()

    def _finish(self, future: "Future[Any]", task: BatchTask) -> None:
        """Write what became of a task."""
        self._tally.finish(task.key)
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
                self._tally.rows += len(one.rows)
                continue
            self._tally.failed += 1
            alone = vehicles[1] if len(vehicles) == 2 else None
            reason = f"{one.method}: {one.reason}"
            self._fail(
                key, Failure(task.recording["file"], task.place.start, alone, reason), one.final
            )

    def _finish_pool(self, future: "Future[Any]", task: PoolTask) -> None:
        """Write what became of a vehicle."""
        self._tally.pooled += 1
        reason = fault_of(future)
        found = MethodRows(KEY, [], reason, final=False) if reason else future.result()
        if found.rows:
            self._journal.add("pooled", task.key, row=found.rows[0])
        else:
            self._fail_pool(task.pool, found.reason, found.final)
