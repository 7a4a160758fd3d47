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
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from accpinn.errors import AccpinnError, ConfigError, RecordingError, SegmentError
from accpinn.inference.window_posterior import window_posterior
from accpinn.methods import TaskContext, relative_size
from accpinn.methods.registry import (
    COMPARED,
    METHODS,
    recommended_method,
    variant_key,
    variant_of,
)
from accpinn.model.cthp import Case
from accpinn.model.registry import BEST, following_model
from accpinn.model.spec import ModelSpec
from accpinn.recordings import Recording, facts_of
from accpinn.recordings.files import opened, read_all
from accpinn.recordings.mapping import CsvMapping
from accpinn.recordings.openacc import is_listed_name
from accpinn.segment import Segment
from accpinn.segment.cut import DURATION, MINIMUM_DURATION
from accpinn.segment.windows import LEAST, left_out, plan
from accpinn.study import Analysis, Source
from accpinn.study.cluster import connected, run_all, sentence_of
from accpinn.study.plan import Listing, Sources, listing_of
from accpinn.study.result import result_of
from accpinn.study.rows import rows_of
from accpinn.study.run import estimate
from accpinn.study.scripts import ENDING, Script
from accpinn.study.studies import (
    Computed,
    KnownFile,
    Request,
    Study,
    StudyError,
    read_rows,
    written,
)
from accpinn.units import Seconds

PUBLISHED_EVERY: Seconds = 60.0
"""Time between two versions of `results.parquet` while a batch runs."""
NOTHING = f"no complete stretch of {LEAST:g} s in car-following under ACC"
OTHER_MAPPING = (
    "its columns were read by another mapping before; take another folder for results by this one"
)


@dataclass
class BatchProgress:
    """Progress of a batch, and at its end the counts of its results."""

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
    namesakes: tuple[str, ...] = ()
    """Files of whose name the study has answers from other contents, too."""
    unknown_names: tuple[str, ...] = ()
    """Names of followers whose make and model the package does not know in one spelling."""


def batch(
    sources: Sources,
    study: str | os.PathLike[str],
    *,
    window: Seconds = DURATION,
    methods: Sequence[str] = COMPARED,
    case: Case = "II",
    model: str | os.PathLike[str] = BEST,
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
        methods: names in `VARIANTS`; one that cannot estimate the model estimates its usual one.
        case: "I" or "II".
        model: that is estimated; a key of `accpinn.model.registry`, or the path of a script ending
            in .py that registers a model, which each worker runs.
        workers: processes on this machine; by default one for each processor.
        scheduler: address of a dask scheduler, as "tcp://host:8786", in place of ``workers``.
        mapping: of tables that are neither OpenACC runs nor tables of pairs.
        on_progress: called after every window.
        should_stop: asked several times a second; True ends the batch, and all is kept.

    Raises:
        ConfigError: for settings that are not allowed, or a study with others.
        RecordingError: when a source does not exist, the study cannot be written, or the scheduler
            cannot be reached.

    Examples:
        >>> import accpinn, tempfile
        >>> recording = accpinn.sample_path("paper_study")
        >>> with tempfile.TemporaryDirectory() as study:
        ...     done = accpinn.batch(recording, study, methods=("splines",), workers=1)
        >>> done.windows, done.rows, done.failed
        (1, 1, 0)
    """
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
    path = os.fspath(model)
    script = Script.read(path) if path.endswith(ENDING) else None
    listed = [sources] if isinstance(sources, str | os.PathLike) else sources
    request = Request(
        sources=tuple(map(os.path.abspath, listed)),
        methods=tuple(dict.fromkeys(map(variant_key, methods))),
        window=window if math.isfinite(window) else None,
        case=case,
        model=following_model(script.run() if script else path).key,
        workers=workers,
        scheduler=scheduler,
        mapping=mapping,
    )
    return run_request(Path(study), request, on_progress, should_stop, script)


def run_request(
    study: Path,
    request: Request,
    on_progress: Callable[[BatchProgress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    script: Script | None = None,
) -> BatchProgress:
    """Do what is missing of a request; see `batch`. The script registers its model in workers."""
    listing = listing_of(request.sources, study)
    with written(study, request) as opened_study:
        work = _Batch(opened_study, request, listing, on_progress or (lambda _: None), script)
        return work.run(should_stop or (lambda: False))


# In a worker


@dataclass(frozen=True, eq=False)
class WindowJob:
    """A planned window with all that its rows need, and what is asked of it."""

    file: Path
    analyses: tuple[Analysis, ...]
    """The window asked of several methods."""
    mode_sources: tuple[str, ...]
    """(M,) as `plan` gives them."""
    recording: dict[str, Any]
    """Columns of the recording, the same in all rows."""
    segment: Segment
    fraction: float = 0.0
    """Its share of what is left to do of its file."""
    script: Script | None = None
    """Script that registers the model; None for a model of the package."""


def answer_all(job: WindowJob) -> list[Computed]:
    """Answer the analyses of one window; one that fails does not stop the others."""
    if job.script:
        job.script.run()
    segment = replace(job.segment)  # arrays of its own: those received may lie anyhow in memory
    answers: list[Computed] = []
    for analysis in job.analyses:
        try:
            point = estimate(analysis, (segment,), context=TaskContext(threads=1))
            result = result_of(analysis, (segment,), point)
            rows = rows_of(result, job.recording, job.mode_sources)
            kind = METHODS[analysis.method].posterior(analysis.settings)
            draws = None
            if kind is not None:
                draws = window_posterior(segment, analysis.case, analysis.spec, kind).likely
            answers.append(Computed(analysis, rows, draws))
        except AccpinnError as fault:
            answers.append(Computed(analysis, reason=str(fault)))
        except Exception as fault:  # a fault of the program, told and tried again another time
            answers.append(Computed(analysis, reason=sentence_of(fault), is_final=False))
    return answers


# In the caller's process


def cut_windows(
    file: Path, recording: Recording, request: Request
) -> Iterator[WindowJob | AccpinnError]:
    """The windows of a recording, each asked of one method; where there is none, why."""
    source, planned = Source.of(recording), plan(recording, request.window or math.inf)
    named = {"file": file.name, "trajectory": source.trajectory, "sha256": source.sha256}
    about = {**facts_of(recording), **named}
    for finding in left_out(recording, planned):
        yield SegmentError(finding.sentence(recording))
    if not planned:
        yield SegmentError(NOTHING)
    for place in planned:
        analysis = Analysis(
            source, place.vehicles, (place.window,), request.case, spec=ModelSpec(request.model)
        ).with_method(recommended_method(request.model))
        try:
            (segment,) = analysis.segments(recording)
        except AccpinnError as fault:
            yield fault
        else:
            yield WindowJob(file, (analysis,), place.mode_sources, about, segment)


class _Batch:
    """One call of `batch`."""

    def __init__(
        self,
        study: Study,
        request: Request,
        listing: Listing,
        on_progress: Callable[[BatchProgress], None],
        script: Script | None = None,
    ) -> None:
        self._script = script
        self._study, self._request, self._files = study, request, listing.files
        files, self._left_out = listing.files, listing.refused
        self._digests: dict[str, Path] = {}
        """The files so far, by the SHA-256 of their bytes."""
        self._on_progress, self._now = on_progress, BatchProgress(len(files))
        sizes = {file: 1.0 + (file.stat().st_size if file.is_file() else 0.0) for file in files}
        self._weights = {file: size / sum(sizes.values()) for file, size in sizes.items()}
        """Each file's share of all work."""
        self._computed = 0.0
        """Share of all work that this call has computed."""
        self._began, self._published = time.monotonic(), 0.0

    def run(self, should_stop: Callable[[], bool]) -> BatchProgress:
        """Do all jobs; workers are started for the first one that is left to do."""
        for path, reason in self._left_out.items():
            self._study.refuse(path, [reason])
            self._now.refused += 1
        self._tell()
        jobs, request = self._jobs(), self._request
        first, is_ended = next(jobs, None), True
        if first:
            jobs, is_local = chain([first], jobs), not request.scheduler
            with connected(request.workers, request.scheduler) as client:
                for ended in run_all(client, answer_all, jobs, is_local=is_local):
                    if ended:
                        job, answers, workers = ended
                        self._finish(job, answers)
                        self._tell(workers)
                    if should_stop():
                        is_ended = False
                        break
        self._study.note(replace(request, is_finished=is_ended))
        named = {row["name"] for row in read_rows(self._study.folder) if row["make"]}
        self._now.unknown_names = tuple(sorted(name for name in named if not is_listed_name(name)))
        self._now.stopped = not is_ended
        if is_ended:
            self._now.share = 1.0
        self._tell()
        return self._now

    def _tell(self, workers: int = 0) -> None:
        """Say how far it has got, and make the study's files now and then.

        Each file is a share of the work by its bytes, split among its windows by their size. The
        time left is what the rest would take at the pace so far, once each worker has had a window.
        """
        now = self._now
        now.seconds = round(time.monotonic() - self._began, 3)
        if now.share == 1.0:
            now.seconds_left = 0.0
        elif self._computed and now.finished >= workers:
            now.seconds_left = now.seconds / self._computed * (1.0 - now.share)
        self._on_progress(replace(now))
        if now.seconds - self._published > PUBLISHED_EVERY:
            self._study.publish()
            self._published = now.seconds

    def _advance(self, file: Path, fraction: float = 1.0) -> float:
        """A fraction of a file is done; returns its share of all work."""
        share = fraction * self._weights[file]
        self._now.done = min(self._now.done + fraction, len(self._files))
        self._now.share = min(self._now.share + share, 1.0)
        return share

    def _jobs(self) -> Iterator[WindowJob]:
        """The windows that are left to do, file by file."""
        for file in self._files:
            try:
                jobs = self._jobs_of(file)
            except StudyError:
                raise
            except Exception as fault:  # whatever a file holds, the others go on
                self._study.refuse(file, [sentence_of(fault)])
                self._now.refused += 1
                jobs = []
            if not jobs:
                self._advance(file)
            sizes = [relative_size(job.segment) for job in jobs]
            for job, size in zip(jobs, sizes, strict=True):
                yield replace(job, fraction=size / sum(sizes), script=self._script)

    def _jobs_of(self, file: Path) -> list[WindowJob]:
        """The windows of a file that are left to do; a file that is complete is not read.

        Raises:
            AccpinnError: where nothing of it can be used.
        """
        content = opened(file, mapping=self._request.mapping)
        mapping, digest = content.supported_mapping, content.content.sha256()
        earlier = self._digests.setdefault(digest, file)
        if earlier != file:
            raise RecordingError(f"its contents are those of {earlier.name}")
        record, jobs = self._study.known_file(digest), list[WindowJob]()
        if record and record.mapping != mapping:
            raise RecordingError(OTHER_MAPPING)
        rows = self._rows(record) if record else []
        if not record or any(None in numbers.values() for numbers in rows):
            record, jobs = self._read(file, mapping)
            self._study.add_file(digest, record)
            rows = self._rows(record)
        if self._study.has_namesake(file.name, record):
            self._now.namesakes = tuple(sorted({*self._now.namesakes, file.name}))
        self._count(record, rows)
        left = list[WindowJob]()
        for job, numbers in zip(jobs, rows, strict=False):
            (window,) = job.analyses
            missing = [method for method, number in numbers.items() if number is None]
            if missing:
                analyses = tuple(window.with_method(*variant_of(name)) for name in missing)
                left.append(replace(job, analyses=analyses))
        return left

    def _read(self, file: Path, mapping: CsvMapping | None) -> tuple[KnownFile, list[WindowJob]]:
        """Read a file: its record in the study, and its windows with their data."""
        recordings, refused, parts = 0, 0, list[WindowJob | AccpinnError]()
        for recording in read_all(file, mapping=self._request.mapping):
            if isinstance(recording, Recording):
                recordings += 1
                parts += cut_windows(file, recording, self._request)
            else:
                refused += 1
                parts.append(recording)
        jobs = [part for part in parts if isinstance(part, WindowJob)]
        self._study.refuse(file, [str(part) for part in parts if isinstance(part, AccpinnError)])
        windows = tuple(job.analyses[0] for job in jobs)
        return KnownFile(mapping, recordings, refused, windows), jobs

    def _rows(self, record: KnownFile) -> list[dict[str, int | None]]:
        """The number of rows of each window of a file by method, as `Study.rows_of` gives it."""
        of, methods = self._study.rows_of, self._request.methods
        return [
            {name: of(window.with_method(*variant_of(name))) for name in methods}
            for window in record.windows
        ]

    def _count(self, record: KnownFile, rows: list[dict[str, int | None]]) -> None:
        """Count a file's recordings and windows, and the rows that the study has of them."""
        now = self._now
        now.recordings += record.recordings
        now.refused += record.refused
        now.windows += len(record.windows)
        now.followers += sum(len(window.vehicles) - 1 for window in record.windows)
        numbers = [n for window in rows for n in window.values() if n is not None]
        now.reused += sum(numbers)
        now.rows += sum(numbers)
        now.failed += numbers.count(0)

    def _finish(self, job: WindowJob, answers: list[Computed] | Exception) -> None:
        """Keep what came of a window."""
        self._computed += self._advance(job.file, job.fraction)
        self._now.finished += 1
        if isinstance(answers, Exception):
            reason = sentence_of(answers)
            answers = [Computed(each, reason=reason, is_final=False) for each in job.analyses]
        for answer in answers:
            self._study.add(job.file.name, answer)
            self._now.rows += len(answer.rows)
            self._now.failed += not answer.rows
