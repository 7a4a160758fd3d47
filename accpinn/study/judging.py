"""The judge over many recordings: models and methods side by side in windows left out.

Each follower of each recording is a subject of its own (see `study.judge`): one of its windows in
car-following is left out, the others of the same drive teach, and each model is one job, on dask
as those of a batch. What comes of a job is kept in a folder as it arrives, so that the same call
goes on where it was stopped, and a further model adds its own jobs.

Models are compared in pairs. With x_k and y_k the RMSE of two models in the windows of a vehicle,
over all its recordings, the vehicle has the mean of ln(x_k / y_k); d is the mean over vehicles and
s its standard error, so that a vehicle with many windows counts as one. Of a single vehicle they
are taken over its windows. One model is clearly better where |d| exceeds s by the 95 % quantile of
Student's distribution.
"""

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import stdtrit

from accpinn import __version__
from accpinn.display import Displayed
from accpinn.errors import ConfigError, RecordingError, SegmentError
from accpinn.methods.registry import METHODS, variant_of
from accpinn.methods.registry import SHIPPED as SHIPPED_METHODS
from accpinn.model.registry import SHIPPED, fingerprint
from accpinn.recordings import Facts, Recording, Window, facts_of, unnamed
from accpinn.recordings.files import opened, read_all
from accpinn.recordings.mapping import CsvMapping
from accpinn.segment.cut import chains
from accpinn.segment.windows import sound_windows
from accpinn.serial import dump, restore
from accpinn.storage import reported, write_whole
from accpinn.study.cluster import connected, run_all, sentence_of
from accpinn.study.judge import (
    CONFIDENCE,
    LEAST_WINDOWS,
    LONGEST,
    LONGEST_STRETCH,
    Judgement,
    ModelScore,
    Subject,
    beyond,
    candidate,
    judge,
    subject_of,
    subjects_of,
    wins,
)
from accpinn.study.plan import Sources, listing_of
from accpinn.study.result import Origin, now, origin
from accpinn.study.scripts import Script
from accpinn.study.studies import Failure
from accpinn.units import FloatArray, Metres, Seconds

if TYPE_CHECKING:
    from pandas import DataFrame

VERSION = 1
"""Raised whenever a change of the judge changes its numbers; what was kept then expires."""
NOTHING = "no window of car-following under ACC in which its gap fits the speeds"


# What comes of it


@dataclass(frozen=True)
class ModelSummary:
    """How one model does on all vehicles, and beside the reference."""

    key: str
    windows: int
    """Windows left out."""
    rmse: Metres
    """RMSE of the gap: the geometric mean over a vehicle's windows, then over vehicles."""
    mae: Metres
    """Mean absolute error of the gap, likewise."""
    difference: float
    """d: the mean of ln RMSE minus that of the reference; 0 for the reference itself."""
    error: float
    """Its standard error; nan where there is one window alone."""
    is_clear: bool
    """Whether the difference is more than chance explains."""
    best_in: int
    """Windows in which no model has a smaller RMSE."""
    collides_in: int
    """Windows in which the simulated vehicle collides."""
    gain_error: float
    """Rms error of |H| in dB: the median over followers; nan where no gain is measured."""
    gains: int
    """Followers with a measured gain."""


@dataclass(frozen=True)
class Made:
    """What a judgement was made with."""

    created: str
    """When: ISO 8601 in UTC to the second."""
    origin: Origin
    """The program and the kind of machine."""
    command: str = ""
    """The command line; empty where it was made in Python."""
    scripts: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of the scripts that register models, by the scripts' names."""


@dataclass(frozen=True, eq=False)
class Judgements(Displayed):
    """The models on each follower of one or many recordings, as `accpinn.judge` gives them."""

    cars: tuple[Judgement, ...]
    """(M,) one a follower that all models were judged on."""
    facts: Mapping[str, Facts] = field(default_factory=dict)
    """What recordings say of themselves, by their SHA-256."""
    failures: tuple[Failure, ...] = ()
    """Files and followers that were not judged, and why."""
    made: Made = field(default_factory=lambda: Made(now(), origin()))
    """What it was made with."""
    is_whole: bool = True
    """Whether all that was asked is judged; False where it was stopped."""

    def __iter__(self) -> Iterator[Judgement]:
        """Iterate over the followers."""
        return iter(self.cars)

    def __len__(self) -> int:
        """The number of followers."""
        return len(self.cars)

    def __getitem__(self, place: int) -> Judgement:
        """The judgement of a follower, 0 for the first."""
        return self.cars[place]

    def __str__(self) -> str:
        """A sentence a follower, and the gap errors of its models, the best first."""
        lines = []
        for car in self.cars:
            lines += [finding.sentence(car.info) for finding in car.findings]
            errors = (f"{score.key} {score.typical_rmse:.2f} m" for score in car.ranked)
            lines.append(f"{car.info.labels[1]}: {', '.join(errors)}")
        if len(self.cars) > 1:
            errors = (f"{model.key} {model.rmse:.2f} m" for model in self.summary())
            lines.append(f"All {len(self.vehicles)} vehicles: {', '.join(errors)}")
        return "\n".join([*lines, 'More: .to_frame(), .to_frame("models"), .to_frame("windows")'])

    @property
    def keys(self) -> tuple[str, ...]:
        """The models in the order in which they were judged."""
        return tuple(score.key for score in self.cars[0].scores) if self.cars else ()

    @cached_property
    def vehicles(self) -> tuple[tuple[Judgement, ...], ...]:
        """The followers by vehicle: those of one name within a campaign are one.

        Where a file names none, each of its followers is a vehicle of its own.
        """
        groups: dict[tuple[object, ...], list[Judgement]] = {}
        for car in self.cars:
            number, name = car.info.vehicles[1], car.info.names[1]
            campaign = self.facts.get(car.info.sha256, {}).get("campaign")
            is_named = name and name != unnamed(number)
            who = (campaign, name) if is_named else (car.info.sha256, number)
            groups.setdefault(who, []).append(car)
        return tuple(map(tuple, groups.values()))

    @property
    def windows(self) -> int:
        """The number of windows left out."""
        return sum(len(car.windows) for car in self.cars)

    @property
    def recordings(self) -> int:
        """The number of recordings with a follower that was judged."""
        return len({car.info.sha256 for car in self.cars})

    def difference(self, key: str, other: str) -> tuple[float, float, bool]:
        """Mean of ln RMSE minus that of another model, its standard error, and whether clear."""
        at, beside = self.keys.index(key), self.keys.index(other)
        vehicles = [
            np.concatenate([np.log(c.scores[at].rmse / c.scores[beside].rmse) for c in cars])
            for cars in self.vehicles
        ]
        means = vehicles[0] if len(vehicles) == 1 else np.array([part.mean() for part in vehicles])
        count, mean = len(means), float(means.mean())
        if count < 2:
            return mean, float("nan"), False
        error = float(means.std(ddof=1) / np.sqrt(count))
        least = stdtrit(count - 1, CONFIDENCE)
        return mean, error, count >= LEAST_WINDOWS and bool(abs(mean) > least * error)

    def summary(self, reference: str | None = None) -> tuple[ModelSummary, ...]:
        """The models, the one with the least RMSE first.

        Args:
            reference: key of the model that the others are compared with; by default the first.

        Raises:
            ConfigError: for a model that was not judged.
        """
        if not self.cars:
            return ()
        reference = self.keys[0] if reference is None else reference
        if reference not in self.keys:
            raise ConfigError(
                f"reference: {reference[:40]} is not judged; choose {', '.join(self.keys)}."
            )
        shares, rows = wins(self.cars), []
        for k, key in enumerate(self.keys):
            scores = [car.scores[k] for car in self.cars]
            gains = [score.gain_error for score in scores if np.isfinite(score.gain_error)]
            rows.append(
                ModelSummary(
                    key,
                    self.windows,
                    self._typical(k, lambda score: score.rmse),
                    self._typical(k, lambda score: score.mae),
                    *self.difference(key, reference),
                    best_in=round(shares[k] * self.windows),
                    collides_in=sum(int(score.collided.sum()) for score in scores),
                    gain_error=float(np.median(gains)) if gains else float("nan"),
                    gains=len(gains),
                )
            )
        return tuple(sorted(rows, key=lambda row: row.rmse))

    def _typical(self, k: int, errors: Callable[[ModelScore], FloatArray]) -> Metres:
        """The geometric mean of a model's errors over each vehicle's windows, then vehicles."""
        means = [
            np.log(np.concatenate([errors(car.scores[k]) for car in cars])).mean()
            for cars in self.vehicles
        ]
        return float(np.exp(np.mean(means)))

    def to_frame(self, rows: str = "followers") -> "DataFrame":
        """One row a follower and model, the best model of each follower first.

        Columns are file, vehicle, name, model, windows, gap_rmse and gap_mae (m, geometric means
        over windows left out), worse_low and worse_high (percent beyond the best, one standard
        error to either side), best_in and collides_in (windows), gain_error (dB), and the model's
        parameters as a dict.

        Args:
            rows: "followers"; "models" for one row a model over all vehicles, with the difference
                of ln RMSE to the first model's and its standard error; "windows" for one row a
                window left out and model.

        Raises:
            ConfigError: for other rows.
        """
        from pandas import DataFrame  # takes a third of a second

        kinds = {"followers": self._followers, "models": self._models, "windows": self._windows}
        if rows not in kinds:
            raise ConfigError(f"rows: {rows[:40]} is not known; choose {', '.join(kinds)}.")
        return DataFrame(list(kinds[rows]()))

    def _models(self) -> Iterator[dict[str, Any]]:
        for row in self.summary():
            yield {
                "model": row.key,
                "vehicles": len(self.vehicles),
                "windows": row.windows,
                "gap_rmse": row.rmse,
                "gap_mae": row.mae,
                "difference": row.difference,
                "difference_error": row.error,
                "is_clear": row.is_clear,
                "best_in": row.best_in,
                "collides_in": row.collides_in,
                "gain_error": row.gain_error,
            }

    def _followers(self) -> Iterator[dict[str, Any]]:
        for car in self.cars:
            shares = dict(zip(self.keys, wins([car]).tolist(), strict=True))
            for score in car.ranked:
                _, low, high = beyond(score, car.ranked[0])
                yield {
                    "file": car.info.source,
                    "vehicle": car.info.vehicles[1],
                    "name": car.info.names[1],
                    "model": score.key,
                    "windows": len(car.windows),
                    "gap_rmse": score.typical_rmse,
                    "gap_mae": float(np.exp(np.log(score.mae).mean())),
                    "worse_low": low,
                    "worse_high": high,
                    "best_in": round(shares[score.key] * len(car.windows)),
                    "collides_in": int(score.collided.sum()),
                    "gain_error": score.gain_error,
                    "parameters": score.named,
                }

    def _windows(self) -> Iterator[dict[str, Any]]:
        for car in self.cars:
            facts = self.facts.get(car.info.sha256, {})
            for k, window in enumerate(car.windows):
                for score in car.scores:
                    yield {
                        "campaign": facts.get("campaign"),
                        "file": car.info.source,
                        "sha256": car.info.sha256,
                        "vehicle": car.info.vehicles[1],
                        "name": car.info.names[1],
                        "start": window.start,
                        "duration": window.duration,
                        "model": score.key,
                        "gap_rmse": float(score.rmse[k]),
                        "gap_mae": float(score.mae[k]),
                        "time_gap_rmse": float(score.time_gap_rmse[k]),
                        "collided": bool(score.collided[k]),
                    }


# The way to it


@dataclass(frozen=True, eq=False)
class Follower:
    """A follower of a recording that models can be judged on."""

    subject: Subject
    facts: Facts
    """What its recording says of itself."""


@dataclass(frozen=True, eq=False)
class JudgeJob:
    """One model on one follower, as a worker is sent it."""

    number: int
    """The follower's place among all."""
    subject: Subject
    model: str
    scripts: tuple[Script, ...] = ()
    """What registers models and methods."""
    fraction: float = 0.0
    """Its share of all work."""


def judged_by(job: JudgeJob, should_stop: Callable[[], bool] | None = None) -> ModelScore | None:
    """Judge one model on one follower; None where it was stopped."""
    for script in job.scripts:
        script.names()
    # Arrays of its own: those received may lie anyhow in memory.
    windows, stretches = (
        tuple(replace(segment) for segment in part)
        for part in (job.subject.windows, job.subject.stretches)
    )
    rounds = list(judge([Subject(windows, stretches)], [job.model], should_stop))
    return rounds[0][0].scores[0] if rounds else None


@dataclass
class JudgeProgress:
    """How far the judge has got."""

    files: int
    done: float = 0.0
    """Finished files, those in work as fractions."""
    followers: int = 0
    """Followers found so far."""
    finished: int = 0
    """Models that this call has judged, each on one follower."""
    kept: int = 0
    """Those that were there already."""


def judge_recordings(
    sources: Sources | Sequence[Recording],
    models: Sequence[str],
    *,
    vehicles: Sequence[int] | None = None,
    windows: Sequence[Window] = (),
    mapping: CsvMapping | None = None,
    scripts: Sequence[Script] = (),
    folder: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    command: str = "",
    on_progress: Callable[[JudgeProgress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Judgements:
    """Judge models on every follower of many recordings.

    Args:
        sources: files and folders, of a folder all tables in it and below; or recordings.
        models: keys of models, or names of methods.
        vehicles: consecutive numbers, leader first; by default all followers of a recording.
        windows: that are left out in turn; by default those in car-following under ACC.
        mapping: of tables that are neither OpenACC runs nor tables of pairs.
        scripts: what registers models and methods; workers run them, too.
        folder: where each score is kept as it arrives; None keeps nothing.
        workers: processes on this machine; None judges in this process.
        scheduler: address of a dask scheduler in place of ``workers``.
        command: the command line, for the record.
        on_progress: called with each moment of the work.
        should_stop: asked several times a second; True ends it with the followers that are done.

    Raises:
        ConfigError: for unknown models.
        AccpinnError: where nothing can be judged.
    """
    keys = tuple(dict.fromkeys(models))
    if not keys:
        raise ConfigError('models: none is given; choose keys in a tuple, as ("cthp", "idm").')
    for key in keys:
        candidate(key)
    if (workers or scheduler) and (local := _known_here_alone(keys, scripts)):
        raise ConfigError(
            f"workers: {local} is registered in this process alone; give the script that registers"
            " it, or no workers."
        )
    work = _Judging(keys, folder, tuple(scripts), on_progress or (lambda _: None))
    with reported(lambda reason: RecordingError(f"{folder}: it cannot be written ({reason}).")):
        if folder:
            folder.mkdir(parents=True, exist_ok=True)
    jobs = work.jobs(_found(sources, vehicles, windows, mapping, work))
    is_whole = work.run(jobs, workers, scheduler, should_stop or (lambda: False))
    judged = tuple(work.judgements())
    if not judged and is_whole:
        first = work.failures[0]
        place = "" if first.reason.startswith(first.file) else f"{first.file}: "
        raise RecordingError(f"{place}{first.reason.removesuffix('.')}.")
    digests = {script.name: sha256(script.text.encode()).hexdigest() for script in scripts}
    return Judgements(
        judged,
        work.facts,
        tuple(work.failures),
        Made(now(), origin(), command, digests),
        is_whole,
    )


def _known_here_alone(keys: Sequence[str], scripts: Sequence[Script]) -> str:
    """The first key that neither a script registers nor the package has; empty for none."""
    named = {name for script in scripts for name in script.names()}
    named |= {f"{name}-{term}" for name in named for term in ("lag", "delay")}
    return next((key for key in keys if key not in named | SHIPPED | SHIPPED_METHODS), "")


Found = Follower | Failure
"""What a file holds: followers, and why others are left out."""


def _found(
    sources: Sources | Sequence[Recording],
    vehicles: Sequence[int] | None,
    windows: Sequence[Window],
    mapping: CsvMapping | None,
    work: "_Judging",
) -> Iterator[tuple[list[Found], float]]:
    """What each file or recording holds, and its share of all work."""
    if not isinstance(sources, str | os.PathLike) and all(
        isinstance(source, Recording) for source in sources
    ):
        recordings = [source for source in sources if isinstance(source, Recording)]
        work.progress.files = len(recordings)
        for recording in recordings:
            yield [*followers_of(recording, vehicles, windows)], 1 / len(recordings)
        return
    listing = listing_of(sources)  # type: ignore[arg-type]  # no recordings are left
    work.failures += [Failure(path.name, None, None, why) for path, why in listing.refused.items()]
    work.progress.files = len(listing.files)
    sizes = [1.0 + (file.stat().st_size if file.is_file() else 0) for file in listing.files]
    digests: dict[str, str] = {}
    for file, size in zip(listing.files, sizes, strict=True):
        try:
            earlier = digests.setdefault(opened(file).content.sha256(), file.name)
            if earlier != file.name:
                raise RecordingError(f"its contents are those of {earlier}")
            found = [
                part
                for recording in read_all(file, mapping=mapping)
                for part in (
                    followers_of(recording, vehicles, windows)
                    if isinstance(recording, Recording)
                    else [Failure(file.name, None, None, str(recording))]
                )
            ]
        except Exception as fault:  # whatever a file holds, the others go on
            found = [Failure(file.name, None, None, sentence_of(fault))]
        yield found, size / sum(sizes)


def followers_of(
    recording: Recording, vehicles: Sequence[int] | None = None, windows: Sequence[Window] = ()
) -> Iterator[Found]:
    """The followers of a recording that models can be judged on, and why others cannot.

    By default these are all with windows of car-following in which the gap fits the speeds.
    """
    facts = facts_of(recording)
    if vehicles or windows:
        try:
            subjects = subjects_of(recording, vehicles, windows)
        except SegmentError as fault:
            yield Failure(recording.source, None, None, str(fault))
        else:
            yield from (Follower(subject, facts) for subject in subjects)
        return
    for pair in (pair for chain in chains(recording) for pair in pairwise(chain)):
        chosen = sound_windows(recording, pair[1], LONGEST)
        try:
            if not chosen:
                raise SegmentError(NOTHING)
            stretches = sound_windows(recording, pair[1], LONGEST_STRETCH)
            yield Follower(subject_of(recording, pair, chosen, stretches), facts)
        except SegmentError as fault:
            yield Failure(recording.source, None, pair[1], str(fault))


class _Judging:
    """One call of `judge_recordings`."""

    def __init__(
        self,
        keys: tuple[str, ...],
        folder: Path | None,
        scripts: tuple[Script, ...],
        on_progress: Callable[[JudgeProgress], None],
    ) -> None:
        self._keys, self._folder, self._scripts = keys, folder, scripts
        self._on_progress, self.progress = on_progress, JudgeProgress(0)
        self.failures = list[Failure]()
        self.facts: dict[str, Facts] = {}
        self._followers = list[Judgement]()
        """Each follower without its data, and without scores."""
        self._scores: dict[tuple[int, str], ModelScore] = {}

    def jobs(self, files: Iterator[tuple[list[Found], float]]) -> Iterator[JudgeJob]:
        """What is left to do, file by file."""
        for found, share in files:
            jobs = list[JudgeJob]()
            for part in found:
                if isinstance(part, Failure):
                    self.failures.append(part)
                    continue
                number, subject = len(self._followers), part.subject
                self._followers.append(subject.judgement(()))
                self.facts[subject.windows[0].sha256] = part.facts
                self.progress.followers += 1
                for key in self._keys:
                    score = self._read(subject, key)
                    if score:
                        self._scores[number, key] = score
                        self.progress.kept += 1
                    else:
                        jobs.append(JudgeJob(number, subject, key, self._scripts))
            if not jobs:
                self._advance(share)
            sizes = [_size(job) for job in jobs]
            for job, size in zip(jobs, sizes, strict=True):
                yield replace(job, fraction=share * size / sum(sizes))

    def run(
        self,
        jobs: Iterator[JudgeJob],
        workers: int | None,
        scheduler: str | None,
        should_stop: Callable[[], bool],
    ) -> bool:
        """Do them; returns whether all have ended."""
        if not workers and not scheduler:
            for job in jobs:
                try:
                    score: ModelScore | Exception | None = judged_by(job, should_stop)
                except Exception as fault:  # of a model of the user's
                    score = fault
                if score is None or should_stop():
                    return False
                self._finish(job, score)
            return True
        first = next(jobs, None)
        if first is None:
            return True
        every = (job for part in ([first], jobs) for job in part)
        with connected(workers, scheduler) as client:
            for ended in run_all(client, judged_by, every, is_local=not scheduler):
                if ended:
                    self._finish(ended[0], ended[1])
                if should_stop():
                    return False
        return True

    def judgements(self) -> Iterator[Judgement]:
        """The followers on which all models are judged."""
        for number, follower in enumerate(self._followers):
            scores = [self._scores.get((number, key)) for key in self._keys]
            whole = tuple(score for score in scores if score)
            if len(whole) == len(self._keys):
                yield replace(follower, scores=whole)

    def _advance(self, share: float) -> None:
        now = self.progress
        now.done = min(now.done + share * now.files, now.files)
        self._on_progress(replace(now))

    def _finish(self, job: JudgeJob, score: ModelScore | Exception) -> None:
        if isinstance(score, Exception):
            first = job.subject.windows[0]
            reason = f"{job.model}: {sentence_of(score)}"
            self.failures.append(Failure(first.source, None, job.subject.vehicle, reason))
        else:
            self._scores[job.number, job.model] = score
            if self._folder:
                tree, arrays = dump(score)
                document = {"score": tree, "arrays": {k: v.tolist() for k, v in arrays.items()}}
                sentence = f"{self._folder}: it cannot be written ({{}})."
                with reported(lambda reason: RecordingError(sentence.format(reason))):
                    path = self._path(job.subject, job.model)
                    write_whole(path, json.dumps(document).encode())
        self.progress.finished += 1
        self._advance(job.fraction)

    def _read(self, subject: Subject, key: str) -> ModelScore | None:
        """The score that an earlier call kept; None where there is none."""
        if self._folder is None:
            return None
        with suppress(OSError, ValueError, KeyError, TypeError):  # what is damaged is done again
            document = json.loads(self._path(subject, key).read_bytes())
            arrays = {name: np.array(values) for name, values in document["arrays"].items()}
            score = restore(ModelScore, document["score"], arrays)
            if (score.key, len(score.rmse)) == (key, len(subject.windows)):
                return score
        return None

    def _path(self, subject: Subject, key: str) -> Path:
        """The file of a score: its name is a digest of data, windows and model."""
        assert self._folder
        parts = (*subject.windows, *subject.stretches)
        data = [(part.info.digest, part.start, part.vehicles) for part in parts]
        judged = candidate(key)
        version = METHODS[variant_of(judged.method)[0]].version if judged.method else 0
        about = (VERSION, __version__, key, fingerprint(judged.model.key), version, data)
        return self._folder / f"{sha256(repr(about).encode()).hexdigest()[:32]}.json"


def _size(job: JudgeJob) -> float:
    """Work of a job in relation to others: each of K windows is left out of K fits."""
    seconds: Seconds = sum(part.window.duration for part in job.subject.windows)
    return seconds * len(job.subject.windows) * len(candidate(job.model).model.parameters) ** 2
