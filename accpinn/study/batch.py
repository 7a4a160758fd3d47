"""Many recordings: every window in car-following under ACC, by several methods, on many processors.

A batch is the analyses of a folder, mapped over dask: each planned window of a chain of vehicles by
each method. Answers are kept in a study by the keys of their analyses as they arrive. So a batch
that was killed or stopped goes on where it was, a renamed file is not computed again, and a further
method adds its rows.

Workers on this machine read the files themselves; those of a scheduler elsewhere are sent the data
and need no access to the files.
"""

import math
import os
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

from accpinn.errors import AccpinnError, ConfigError
from accpinn.methods.maximum_likelihood import KEY
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS, method_of
from accpinn.model.cthp import Case
from accpinn.recordings.catalogue import is_known
from accpinn.recordings.files import mapping_of, read_all
from accpinn.recordings.mapping import CsvMapping, write_mapping
from accpinn.recordings.recording import Recording, facts_of
from accpinn.segment.cut import DURATION, MINIMUM_DURATION
from accpinn.segment.segment import Segment
from accpinn.storage import reason_of
from accpinn.study.analysis import Analysis, Source
from accpinn.study.cluster import Job, connected, run_all, sentence_of
from accpinn.study.plan import LEAST, Sources, files_of, plan
from accpinn.study.progress import BatchProgress, BatchSummary, Tally, size_of
from accpinn.study.rows import rows_of
from accpinn.study.run import estimate
from accpinn.study.studies import Failure, KnownFile, Request, Study, read_rows
from accpinn.units import Seconds

PUBLISHED_EVERY: Seconds = 60.0
"""Time between two versions of `results.parquet` while a batch runs."""
NOTHING = f"no complete stretch of {LEAST:g} s in car-following under ACC"
OTHER_MAPPING = (
    "its columns were read by another mapping before; take another folder for results by this one"
)


def batch(
    sources: Sources,
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

    Args:
        sources: files and folders; of a folder all CSV files in it and below.
        study: the folder of the results; one that exists is continued.
        window: longest window, in s; infinite for whole stretches.
        methods: keys of `METHODS`.
        case: "I" or "II".
        workers: processes on this machine; by default one for each processor.
        scheduler: address of a dask scheduler, as "tcp://host:8786", in place of ``workers``.
        mapping: of tables that are neither OpenACC runs nor tables of pairs.
        on_progress: called after every window.
        should_stop: asked several times a second; True ends the batch, and all is kept.

    Raises:
        ConfigError: for settings that are not allowed, or a study with others.
        RecordingError: when a source does not exist, the study cannot be written, or the scheduler
            cannot be reached.
    """
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
    listed = [sources] if isinstance(sources, str | os.PathLike) else sources
    request = Request(
        sources=tuple(map(os.path.abspath, listed)),
        methods=tuple(dict.fromkeys(methods)),
        window=window if math.isfinite(window) else None,
        case=case,
        workers=workers,
        scheduler=scheduler,
        mapping=mapping,
    )
    with Study(Path(study), request) as opened:
        running = _Batch(opened, request, files, on_progress, should_stop)
        return running.work()


# On a worker


@dataclass(frozen=True, eq=False)
class WindowData:
    """A planned window with all that its rows need."""

    analysis: Analysis
    """The window asked of one method; the others are asked the same."""
    modes: tuple[str, ...]
    """(M,) as `plan` gives them."""
    recording: dict[str, Any]
    """What rows say of the recording."""
    segment: Segment


@dataclass(frozen=True, eq=False)
class FileContents:
    """What a file has for a batch."""

    known: KnownFile
    """What a study keeps of it."""
    reasons: tuple[str, ...]
    """Why these could not, recordings have no window, and windows could not be cut."""
    windows: tuple[WindowData, ...]


def read_file(path: Path, mapping: CsvMapping | None, window: Seconds, case: Case) -> FileContents:
    """Read a file, and cut its windows, each of at most ``window`` s.

    Raises:
        RecordingError: when the file as a whole cannot be read.
    """
    recordings, refused, reasons, windows = 0, 0, list[str](), []
    for recording in read_all(path, mapping=mapping):
        if not isinstance(recording, Recording):
            refused += 1
            reasons.append(str(recording))
            continue
        recordings += 1
        source, planned = Source.of(recording), plan(recording, window)
        named = {"file": path.name, "trajectory": source.trajectory, "sha256": source.sha256}
        about = {**facts_of(recording), **named}
        if not planned:
            reasons.append(NOTHING)
        for place in planned:
            analysis = Analysis(source, place.vehicles, (place.window,), case, method=KEY)
            try:
                (segment,) = analysis.segments(recording)
            except AccpinnError as fault:
                reasons.append(str(fault))
            else:
                windows.append(WindowData(analysis, place.modes, about, segment))
    analyses = tuple(data.analysis for data in windows)
    known = KnownFile("", recordings, refused, analyses)
    return FileContents(known, tuple(reasons), tuple(windows))


@dataclass(frozen=True)
class Answer:
    """What came of one analysis."""

    analysis: Analysis
    rows: list[dict[str, Any]]
    """One a follower; empty where it failed."""
    reason: str = ""
    """Why it failed."""
    is_final: bool = True
    """Whether it would fail again."""


def answer_all(window: WindowData, analyses: Sequence[Analysis]) -> list[Answer]:
    """Answer analyses of one window; one that fails does not stop the others."""
    return [_answer(window, analysis) for analysis in analyses]


def _answer(window: WindowData, analysis: Analysis) -> Answer:
    segment = replace(window.segment)  # arrays of its own: those received may lie anyhow in memory
    try:
        result = estimate(analysis, (segment,), context=TaskContext(threads=1))
        return Answer(analysis, rows_of(result, window.recording, window.modes))
    except AccpinnError as fault:
        return Answer(analysis, [], str(fault))
    except Exception as fault:  # a fault of the program, told and tried again another time
        return Answer(analysis, [], sentence_of(fault), is_final=False)


# In the caller's process

Known = tuple[Analysis, int | None]
"""An analysis, and the number of its rows as `Study.rows_of` gives it."""


def _missing(rows: list[Known]) -> tuple[Analysis, ...]:
    """Those analyses of a window that are to be run."""
    return tuple(analysis for analysis, number in rows if number is None)


class _Batch:
    """One call of `batch`."""

    def __init__(
        self,
        study: Study,
        request: Request,
        files: list[Path],
        on_progress: Callable[[BatchProgress], None] | None,
        should_stop: Callable[[], bool] | None,
    ) -> None:
        self._study, self._request, self._methods = study, request, request.methods
        self._on_progress = on_progress or (lambda _: None)
        self._should_stop = should_stop or (lambda: False)
        self._tally, self._published = Tally(files), 0.0
        self._unread, self._jobs = deque(files), deque[Callable[[], Job]]()
        self._files: dict[str, Path] = {}
        """The files so far, by the SHA-256 of their bytes."""

    def work(self) -> BatchSummary:
        """Run all jobs; workers are started for the first one that is left to do."""
        request, study = self._request, self._study
        self._tell(0)
        is_ended, first = True, self._next_job()
        if first:
            with connected(request.workers, request.scheduler) as client:
                waiting = [first]
                is_ended = run_all(
                    client,
                    lambda: waiting.pop() if waiting else self._next_job(),
                    is_local=not request.scheduler,
                    on_progress=self._tell,
                    should_stop=self._should_stop,
                )
        study.note(replace(request, is_finished=is_ended))
        self._on_progress(self._tally.progress(0, is_done=is_ended))
        named = {row["name"] for row in read_rows(study.folder) if row["make"]}
        counts = self._tally.counts
        names = ("recordings", "refused", "windows", "followers", "rows", "failed", "reused")
        return BatchSummary(
            **{name: counts[name] for name in names},
            seconds=self._tally.seconds,
            stopped=not is_ended,
            unknown_names=tuple(sorted(name for name in named if not is_known(name))),
        )

    def _tell(self, workers: int) -> None:
        self._on_progress(self._tally.progress(workers))
        if self._tally.seconds - self._published > PUBLISHED_EVERY:
            self._study.publish()
            self._published = self._tally.seconds

    def _next_job(self) -> Job | None:
        """The next window that is left to do, else the next file that is not known."""
        while not self._jobs and self._unread:
            self._look_at(self._unread.popleft())
        return self._jobs.popleft()() if self._jobs else None

    def _look_at(self, file: Path) -> None:
        """Have a file read, unless all of it is known."""
        try:
            raw = file.read_bytes()
            used = mapping_of(raw, file.name, self._request.mapping)
        except OSError as fault:
            self._refuse(file, f"it cannot be opened ({reason_of(fault)})")
            return
        except Exception as fault:  # whatever a file holds, the others go on
            self._refuse(file, sentence_of(fault))
            return
        digest = sha256(raw).hexdigest()
        mapping = sha256(write_mapping(used)).hexdigest() if used else ""
        earlier = self._files.setdefault(digest, file)
        known = self._study.known_file(digest)
        if earlier != file:
            self._refuse(file, f"its contents are those of {earlier.name}")
        elif known and known.mapping != mapping:
            self._refuse(file, OTHER_MAPPING)
        elif known and not any(map(_missing, rows := self._rows(known))):
            self._count(known, rows)
            self._tally.skip(file)
        else:
            longest = self._request.window or math.inf
            arguments = (file.absolute(), self._request.mapping, longest, self._request.case)
            finish = partial(self._plan, file, digest, mapping)
            job = Job(read_file, arguments, finish)
            if self._request.scheduler:
                job.work_here()
            else:
                self._jobs.append(lambda: job)

    def _plan(
        self, file: Path, digest: str, mapping: str, contents: FileContents | None, fault: str
    ) -> None:
        """Keep what was read of a file, and have its windows estimated."""
        if contents is None:
            self._refuse(file, fault)
            return
        windows = contents.windows
        known = replace(contents.known, mapping=mapping)
        self._study.refuse(file, contents.reasons)
        self._study.add_file(digest, known)
        rows = self._rows(known)
        self._count(known, rows)
        left = [(window, asked) for window, asked in zip(windows, map(_missing, rows), strict=True)
                if asked]  # fmt: skip
        if not left:
            self._tally.skip(file)
        sizes = [size_of(window.analysis.window.duration, len(window.modes)) for window, _ in left]
        for (window, asked), size in zip(left, sizes, strict=True):
            self._jobs.append(partial(self._job, file, size / sum(sizes), window, asked))

    def _job(
        self, file: Path, fraction: float, window: WindowData, asked: tuple[Analysis, ...]
    ) -> Job:
        began = self._tally.begin()

        def finish(answers: list[Answer] | None, fault: str) -> None:
            self._tally.finish(file, fraction, began)
            for answer in answers or [Answer(a, [], fault, is_final=False) for a in asked]:
                self._keep(answer, file.name)

        return Job(answer_all, (window, asked), finish)

    def _keep(self, answer: Answer, file: str) -> None:
        """Write what came of an analysis."""
        analysis = answer.analysis
        if answer.rows:
            self._study.add_rows(analysis, file, answer.rows)
            self._tally.counts["rows"] += len(answer.rows)
            return
        self._tally.counts["failed"] += 1
        alone = analysis.vehicles[1] if len(analysis.vehicles) == 2 else None
        reason = f"{analysis.method}: {answer.reason}"
        failure = Failure(file, analysis.window.start, alone, reason)
        self._study.add_failure(analysis, failure, answer.is_final)

    def _rows(self, known: KnownFile) -> list[list[Known]]:
        """What is known of each window by each method."""
        every = ([w.with_method(method) for method in self._methods] for w in known.windows)
        return [[(asked, self._study.rows_of(asked)) for asked in window] for window in every]

    def _count(self, known: KnownFile, rows: list[list[Known]]) -> None:
        """Count a file's recordings and windows, and what is known of them."""
        counts = self._tally.counts
        counts["recordings"] += known.recordings
        counts["refused"] += known.refused
        counts["windows"] += len(known.windows)
        counts["followers"] += sum(len(window.vehicles) - 1 for window in known.windows)
        numbers = [number for window in rows for _, number in window if number is not None]
        counts["reused"] += sum(numbers)
        counts["rows"] += sum(numbers)
        counts["failed"] += numbers.count(0)

    def _refuse(self, file: Path, reason: str) -> None:
        """Nothing of a file can be used."""
        self._tally.counts["refused"] += 1
        self._tally.skip(file)
        self._study.refuse(file, [reason])
