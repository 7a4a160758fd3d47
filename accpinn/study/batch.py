"""Many recordings: every window in car-following under ACC, by several methods, on many processors.

A batch is the analyses of a folder, mapped over dask: each planned window of a chain of vehicles by
each method. Answers are kept in a study by the keys of their analyses as they arrive. So a batch
that was killed or stopped goes on where it was, a renamed file is not computed again, and a further
method adds its rows.

The files are read here; workers, on this machine or elsewhere, are sent the data of windows.
"""

import math
import os
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import Any

from accpinn.errors import AccpinnError, ConfigError
from accpinn.inference.window_posterior import window_posterior
from accpinn.methods.maximum_likelihood import KEY
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS, method_of
from accpinn.model.cthp import Case
from accpinn.model.registry import BEST, following_model
from accpinn.recordings.catalogue import is_known
from accpinn.recordings.files import opened, read_all
from accpinn.recordings.mapping import CsvMapping, write_mapping
from accpinn.recordings.recording import Recording, facts_of
from accpinn.segment.cut import DURATION, MINIMUM_DURATION
from accpinn.segment.segment import Segment
from accpinn.storage import reason_of
from accpinn.study.analysis import Analysis, Source
from accpinn.study.cluster import Job, connected, run_all, sentence_of
from accpinn.study.plan import LEAST, Sources, files_of, plan, size_of
from accpinn.study.rows import rows_of
from accpinn.study.run import estimate
from accpinn.study.studies import Failure, KnownFile, Request, Study, read_rows
from accpinn.units import FloatArray, Seconds

PUBLISHED_EVERY: Seconds = 60.0
"""Time between two versions of `results.parquet` while a batch runs."""
NOTHING = f"no complete stretch of {LEAST:g} s in car-following under ACC"
OTHER_MAPPING = (
    "its columns were read by another mapping before; take another folder for results by this one"
)


@dataclass(frozen=True)
class BatchProgress:
    """How far a batch has got, and at its end what it has come to."""

    files: int = 0
    done: float = 0.0
    """Finished files, those in work as fractions."""
    recordings: int = 0
    """Recordings that could be read."""
    refused: int = 0
    """Files, and trajectories of tables, that could not be read."""
    windows: int = 0
    """Windows of the files so far."""
    finished: int = 0
    """Windows that this call has computed."""
    followers: int = 0
    """Sum over all windows of each one's followers."""
    rows: int = 0
    """One a window, follower and method; those reused included."""
    failed: int = 0
    """Methods on windows that have no result."""
    reused: int = 0
    """Rows that were there already."""
    seconds: Seconds = 0.0
    seconds_left: Seconds | None = None
    """None as long as nothing is known."""
    share: float = 0.0
    """Share of all the work that is done, 0 to 1."""
    stopped: bool = False
    """Whether it ended early because the caller said so."""
    unknown_names: tuple[str, ...] = ()
    """Names of followers whose make and model the package does not know in one spelling."""


def batch(
    sources: Sources,
    study: str | os.PathLike[str],
    *,
    window: Seconds = DURATION,
    methods: Sequence[str] = tuple(METHODS),
    case: Case = "II",
    model: str = BEST,
    workers: int | None = None,
    scheduler: str | None = None,
    mapping: CsvMapping | None = None,
    on_progress: Callable[[BatchProgress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> BatchProgress:
    """Apply methods to every window of many recordings, and keep what they find in a folder.

    Args:
        sources: files and folders; of a folder all CSV files in it and below.
        study: the folder of the results; one that exists is continued.
        window: longest window, in s; infinite for whole stretches.
        methods: keys of `METHODS`.
        case: "I" or "II".
        model: of the answers; a key of `accpinn.model.registry`.
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
    listed = [sources] if isinstance(sources, str | os.PathLike) else sources
    request = Request(
        sources=tuple(map(os.path.abspath, listed)),
        methods=tuple(dict.fromkeys(methods)),
        window=window if math.isfinite(window) else None,
        case=case,
        model=following_model(model).key,
        workers=workers,
        scheduler=scheduler,
        mapping=mapping,
    )
    return run_request(Path(study), request, on_progress, should_stop)


def run_request(
    study: Path,
    request: Request,
    on_progress: Callable[[BatchProgress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> BatchProgress:
    """Do what is missing of a request; see `batch`."""
    files = files_of(request.sources, study)
    with Study(study, request) as opened:
        return _Batch(opened, request, files, on_progress, should_stop).work()


# Windows


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
    """One sentence for each trajectory that was not read, recording without a window, and window
    that was not cut."""
    windows: tuple[WindowData, ...]


def read_file(path: Path, request: Request, mapping: str) -> FileContents:
    """Read a file, and cut its windows; ``mapping`` is the digest of how its columns are read.

    Raises:
        RecordingError: when the file as a whole cannot be read.
    """
    recordings, refused, reasons, windows = 0, 0, list[str](), []
    longest = request.window or math.inf
    for recording in read_all(path, mapping=request.mapping):
        if not isinstance(recording, Recording):
            refused += 1
            reasons.append(str(recording))
            continue
        recordings += 1
        source, planned = Source.of(recording), plan(recording, longest)
        named = {"file": path.name, "trajectory": source.trajectory, "sha256": source.sha256}
        about = {**facts_of(recording), **named}
        if not planned:
            reasons.append(NOTHING)
        for place in planned:
            analysis = Analysis(
                source, place.vehicles, (place.window,), request.case, model=request.model,
                method=KEY,
            )  # fmt: skip
            try:
                (segment,) = analysis.segments(recording)
            except AccpinnError as fault:
                reasons.append(str(fault))
            else:
                windows.append(WindowData(analysis, place.modes, about, segment))
    analyses = tuple(data.analysis for data in windows)
    known = KnownFile(mapping, recordings, refused, analyses)
    return FileContents(known, tuple(reasons), tuple(windows))


@dataclass(frozen=True)
class WindowRows:
    """What came of one analysis."""

    analysis: Analysis
    rows: list[dict[str, Any]]
    """One a follower; empty where it failed."""
    posteriors: FloatArray | None = None
    """(M, n, p) draws of each follower for the answer over several windows."""
    reason: str = ""
    """Why it failed."""
    is_final: bool = True
    """Whether it would fail again."""


def answer_all(window: WindowData, analyses: Sequence[Analysis]) -> list[WindowRows]:
    """Answer analyses of one window; one that fails does not stop the others."""
    return [_answer(window, analysis) for analysis in analyses]


def _answer(window: WindowData, analysis: Analysis) -> WindowRows:
    segment = replace(window.segment)  # arrays of its own: those received may lie anyhow in memory
    try:
        result = estimate(analysis, (segment,), context=TaskContext(threads=1))
        posterior = window_posterior(segment, analysis.case, analysis.model)
        rows = rows_of(result, posterior, window.recording, window.modes)
        return WindowRows(analysis, rows, posterior.drawn)
    except AccpinnError as fault:
        return WindowRows(analysis, [], reason=str(fault))
    except Exception as fault:  # a fault of the program, told and tried again another time
        return WindowRows(analysis, [], reason=sentence_of(fault), is_final=False)


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
        self._study, self._request, self._files = study, request, files
        self._digests: dict[str, Path] = {}
        """The files so far, by the SHA-256 of their bytes."""
        self._on_progress = on_progress or (lambda _: None)
        self._should_stop = should_stop or (lambda: False)
        sizes = {file: 1.0 + (file.stat().st_size if file.is_file() else 0.0) for file in files}
        self._weights = {file: size / sum(sizes.values()) for file, size in sizes.items()}
        self._counts: dict[str, Any] = Counter[str]()
        """The counts of `BatchProgress` by name."""
        self._done = self._share = self._computed = 0.0
        """Files done, and shares of all work that are done and that were computed by this call."""
        self._began, self._published = time.monotonic(), 0.0

    def work(self) -> BatchProgress:
        """Run all jobs; workers are started for the first one that is left to do."""
        request, study = self._request, self._study
        self._tell(0)
        jobs = chain.from_iterable(map(self._jobs_of, self._files))
        is_ended, first = True, next(jobs, None)
        if first:
            with connected(request.workers, request.scheduler) as client:
                is_ended = run_all(
                    client,
                    chain([first], jobs),
                    is_local=not request.scheduler,
                    on_progress=self._tell,
                    should_stop=self._should_stop,
                )
        study.note(replace(request, is_finished=is_ended))
        named = {row["name"] for row in read_rows(study.folder) if row["make"]}
        names = tuple(sorted(name for name in named if not is_known(name)))
        summary = replace(self._progress(0), stopped=not is_ended, unknown_names=names)
        if is_ended:
            summary = replace(summary, seconds_left=0.0, share=1.0)
        self._on_progress(summary)
        return summary

    def _tell(self, workers: int) -> None:
        now = self._progress(workers)
        self._on_progress(now)
        if now.seconds - self._published > PUBLISHED_EVERY:
            self._study.publish()
            self._published = now.seconds

    def _progress(self, workers: int) -> BatchProgress:
        """How far it has got.

        Each file is a share of the work by its bytes, split among its windows by their size. The
        time left is what the rest would take at the pace so far, once each worker has had a window.
        """
        seconds, share = round(time.monotonic() - self._began, 3), min(1.0, self._share)
        is_known = self._counts["finished"] >= max(1, workers)
        return BatchProgress(
            files=len(self._files),
            done=min(self._done, len(self._files)),
            seconds=seconds,
            seconds_left=seconds / self._computed * (1.0 - share) if is_known else None,
            share=share,
            **self._counts,
        )

    def _advance(self, file: Path, fraction: float = 1.0) -> None:
        """A fraction of a file is done."""
        self._done += fraction
        self._share += fraction * self._weights[file]

    def _jobs_of(self, file: Path) -> Iterator[Job]:
        """The windows of a file that are left to do."""
        try:
            raw = file.read_bytes()
            used = opened(raw, file.name, self._request.mapping).mapping
        except OSError as fault:
            reason = f"it cannot be opened ({reason_of(fault)})"
        except Exception as fault:  # whatever a file holds, the others go on
            reason = sentence_of(fault)
        else:
            mapping = sha256(write_mapping(used)).hexdigest() if used else ""
            reason = yield from self._jobs_in(file, sha256(raw).hexdigest(), mapping)
        if reason:
            self._counts["refused"] += 1
            self._advance(file)
            self._study.refuse(file, [reason])

    def _jobs_in(self, file: Path, digest: str, mapping: str) -> Generator[Job, None, str]:
        """The same; returns why nothing of it can be used. What is known whole is not read."""
        earlier = self._digests.setdefault(digest, file)
        known, windows = self._study.known_file(digest), tuple[WindowData, ...]()
        if earlier != file:
            return f"its contents are those of {earlier.name}"
        if known and known.mapping != mapping:
            return OTHER_MAPPING
        if not known or any(map(_missing, self._rows(known))):
            try:
                contents = read_file(file, self._request, mapping)
            except Exception as fault:
                return sentence_of(fault)
            known, windows = contents.known, contents.windows
            self._study.refuse(file, contents.reasons)
            self._study.add_file(digest, known)
        rows = self._rows(known)
        self._count(known, rows)
        left = [
            (window, asked)
            for window, asked in zip(windows, map(_missing, rows), strict=False)
            if asked
        ]
        if not left:
            self._advance(file)
        sizes = [size_of(window.analysis.window.duration, len(window.modes)) for window, _ in left]
        for (window, asked), size in zip(left, sizes, strict=True):
            finish = partial(self._finish, file, size / sum(sizes), asked)
            yield Job(answer_all, (window, asked), finish)
        return ""

    def _finish(
        self,
        file: Path,
        fraction: float,
        asked: tuple[Analysis, ...],
        answers: list[WindowRows] | None,
        fault: str,
    ) -> None:
        """Write what came of a window, which is a fraction of what was left of its file."""
        self._advance(file, fraction)
        self._computed += fraction * self._weights[file]
        self._counts["finished"] += 1
        for answer in answers or [WindowRows(a, [], reason=fault, is_final=False) for a in asked]:
            self._keep(answer, file.name)

    def _keep(self, answer: WindowRows, file: str) -> None:
        """Write what came of an analysis."""
        analysis = answer.analysis
        if answer.rows:
            self._study.add_rows(analysis, file, answer.rows, answer.posteriors)
            self._counts["rows"] += len(answer.rows)
            return
        self._counts["failed"] += 1
        alone = analysis.vehicles[1] if len(analysis.vehicles) == 2 else None
        reason = f"{analysis.method}: {answer.reason}"
        failure = Failure(file, analysis.window.start, alone, reason)
        self._study.add_failure(analysis, failure, answer.is_final)

    def _rows(self, known: KnownFile) -> list[list[Known]]:
        """What is known of each window by each method."""
        methods = self._request.methods
        every = ([w.with_method(method) for method in methods] for w in known.windows)
        return [[(asked, self._study.rows_of(asked)) for asked in window] for window in every]

    def _count(self, known: KnownFile, rows: list[list[Known]]) -> None:
        """Count a file's recordings and windows, and what is known of them."""
        counts = self._counts
        counts["recordings"] += known.recordings
        counts["refused"] += known.refused
        counts["windows"] += len(known.windows)
        counts["followers"] += sum(len(window.vehicles) - 1 for window in known.windows)
        numbers = [number for window in rows for _, number in window if number is not None]
        counts["reused"] += sum(numbers)
        counts["rows"] += sum(numbers)
        counts["failed"] += numbers.count(0)
