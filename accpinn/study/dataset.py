"""The parameters of every car in a folder of recordings, as one table that can be published.

For each of the `MODELS`, the recommended one and the IDM, a batch estimates every window by the
model's recommended method, and the windows are grouped by make, model and distance setting (see
`study.groups`). Beside the parameters stand

    point           the joint estimate of all windows of the group; intervals are of its draws
    margin          how far the time gap is from string stability (`stability.margin`)
    held-out error  that of the same method's estimate from other windows (`study.judging`)
    measured gain   the peak of Welch's estimate of all windows of the group together

All of it is resumable: batches and scores are kept in the folder as they arrive.
"""

import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from accpinn import __version__
from accpinn.arguments import check_level
from accpinn.errors import AccpinnError, RecordingError, SegmentError
from accpinn.inference.gain_check import LEAST, compared, decibels
from accpinn.inference.intervals import LEVEL
from accpinn.methods.registry import METHODS, recommended_method
from accpinn.model.cthp import Parameters
from accpinn.model.registry import BEST, FOLLOWING, IDM
from accpinn.model.spec import ModelSpec
from accpinn.recordings import Facts, Recording, facts_of, unnamed
from accpinn.recordings.files import opened, read_all
from accpinn.recordings.mapping import CsvMapping
from accpinn.recordings.openacc import make_and_model
from accpinn.segment import Segment
from accpinn.segment.cut import SLACK, chains, cut
from accpinn.segment.windows import sound_windows
from accpinn.stability.margin import NormMargin
from accpinn.stability.measured_gain import measured_gain
from accpinn.storage import reported, write_whole
from accpinn.study.batch import BatchProgress, batch
from accpinn.study.cluster import connected, run_all
from accpinn.study.groups import BY, Group, Groups, group, read_study
from accpinn.study.judge import LONGEST_STRETCH, Judgement
from accpinn.study.judging import Judgements, JudgeProgress, judge_recordings
from accpinn.study.plan import Sources, listing_of
from accpinn.study.studies import Failure, read_failures
from accpinn.units import FloatArray, MetresPerSecond, Quantity, RadiansPerSecond, Seconds

if TYPE_CHECKING:
    from pandas import DataFrame

MODELS = (BEST, IDM.key)
"""Models whose parameters are in the table."""
STUDIES, SCORES, POINTS = "studies", "scores", "points"
"""Folders below that of the data set with what it is made from."""
UNKNOWN = Quantity(np.nan, np.nan, np.nan)
Key = tuple[str, ...]
"""Make, model and distance setting."""


@dataclass(frozen=True)
class GainPeak:
    """The peak of the gain that was measured on the windows of a group."""

    peak: Quantity
    """In dB, with the band of the estimate there; nan where too little is coherent."""
    omega: RadiansPerSecond
    frequencies: int
    """Number of frequencies with enough coherence."""


NOT_MEASURED = GainPeak(UNKNOWN, np.nan, 0)


@dataclass(frozen=True, eq=False)
class Dataset:
    """What a data set holds, before it is written."""

    groups: Mapping[str, Groups]
    """The groups of each model."""
    rows: "DataFrame"
    """One row a window, follower and model."""
    judgements: Judgements
    """The same models in windows left out."""
    gains: Mapping[Key, GainPeak]
    recordings: tuple[tuple[Facts, str, str], ...]
    """Facts, file and SHA-256 of every recording that was read."""
    failures: tuple[Failure, ...]
    """What has no result."""

    def to_frame(self) -> "DataFrame":
        """One row a group and model, in the order of groups."""
        from pandas import concat

        frames = []
        for model, grouped in self.groups.items():
            frame = grouped.to_frame()
            more = [self._further(model, part) for part in grouped.groups]
            frames.append(frame.assign(**{name: [row[name] for row in more] for name in more[0]}))
        return concat(frames, ignore_index=True).sort_values(
            [*BY, "following_model"], ignore_index=True
        )

    def _further(self, model: str, part: Group) -> dict[str, Any]:
        """The columns beyond those of a batch's group."""
        cars = [car for car in self.judgements if self._key(car) == part.values]
        scores = [car.scores[self.judgements.keys.index(judged_as(model))] for car in cars]
        errors = {
            name: np.concatenate([getattr(score, name) for score in scores] or [[]])
            for name in ("rmse", "mae", "collided")
        }
        off = [score.gain_error for score in scores if np.isfinite(score.gain_error)]
        gain, margin = self.gains.get(part.values, NOT_MEASURED), part.margins
        is_here = self.rows[list(BY)].fillna("").to_numpy() == np.array(part.values, object)
        places = self.rows[is_here.all(axis=1)]
        return {
            "method": recommended_method(model),
            "point": "joint" if part.point else "mean of draws",
            "level": part.level,
            "campaigns": ", ".join(sorted(set(places["campaign"].dropna()))),
            "recordings": places["sha256"].nunique(),
            "lowest_speed": part.driven[0],
            "highest_speed": part.driven[1],
            "median_speed": part.median_speed,
            **_with_ends("growth", part.growth),
            **_with_ends("time_gap_at_median_speed", margin.time_gap),
            **_margin("l2", margin.l2),
            **_margin("linf", margin.linf),
            "held_out_windows": len(errors["rmse"]),
            "held_out_gap_rmse": _geometric(errors["rmse"]),
            "held_out_gap_mae": _geometric(errors["mae"]),
            "held_out_collisions": int(errors["collided"].sum()),
            "gain_error": float(np.median(off)) if off else np.nan,
            **_with_ends("measured_peak", gain.peak),
            "measured_peak_omega": gain.omega,
            "measured_frequencies": gain.frequencies,
        }

    def _key(self, car: Judgement) -> Key:
        facts = self.judgements.facts.get(car.info.sha256, Facts())
        return key_of(car.info.vehicles[1], car.info.names[1], facts)


def judged_as(model: str) -> str:
    """What is judged for a model's estimate: that of its recommended method."""
    return "pinn" if recommended_method(model) == "pinn" else model


def key_of(number: int, name: str, facts: Facts) -> Key:
    """Make, model and distance setting of a vehicle, as groups have them."""
    make, model = ("", "") if name == unnamed(number) else make_and_model(name)
    return make, model, facts.get("distance_setting") or ""


def _geometric(errors: FloatArray) -> float:
    return float(np.exp(np.log(errors).mean())) if len(errors) else float("nan")


def _with_ends(name: str, of: Quantity) -> dict[str, float]:
    return {name: of.value, f"{name}_low": of.lower, f"{name}_high": of.upper}


def _margin(norm: str, margin: NormMargin) -> dict[str, Any]:
    return {
        **_with_ends(f"smallest_time_gap_{norm}", margin.smallest),
        **_with_ends(f"margin_{norm}", margin.distance),
        f"state_{norm}": margin.state.name.lower(),
    }


# The way to it


@dataclass(frozen=True)
class DatasetProgress:
    """How far the making of a data set has got."""

    step: str
    """What is done, in words."""
    share: float
    """Share of all steps that is done, 0 to 1."""
    seconds_left: Seconds | None = None


Report = Callable[[DatasetProgress], object]


def make_dataset(
    sources: Sources,
    folder: Path,
    *,
    mapping: CsvMapping | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    command: str = "",
    level: float = LEVEL,
    on_progress: Report | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Dataset | None:
    """Make the data set of many recordings; None where it was stopped.

    Args:
        sources: files and folders of recordings.
        folder: where batches and scores are kept; the same call goes on from there.
        mapping: of tables that are neither OpenACC runs nor tables of pairs.
        workers: processes on this machine; by default one for each processor.
        scheduler: address of a dask scheduler, in their place.
        command: the command line, for the record.
        level: of the intervals.
        on_progress: called with each moment of the work.
        should_stop: asked several times a second.

    Raises:
        ConfigError: for settings that are not allowed.
        RecordingError: where no recording can be used, or the folder cannot be written.
    """
    check_level(level)
    tell, stop = on_progress or (lambda _: None), should_stop or (lambda: False)
    about: dict[str, Any] = {"mapping": mapping, "workers": workers, "scheduler": scheduler}
    steps, studies = len(MODELS) + 2, {model: folder / STUDIES / model for model in MODELS}
    for k, (model, study) in enumerate(studies.items()):

        def of_batch(now: BatchProgress, k: int = k, model: str = model) -> None:
            tell(DatasetProgress(f"{model}: estimates", (k + now.share) / steps, now.seconds_left))

        method = recommended_method(model)
        done = batch(
            sources, study, methods=(method,), model=model, on_progress=of_batch, should_stop=stop,
            **about,
        )  # fmt: skip
        if done.stopped:
            return None

    def of_judge(now: JudgeProgress) -> None:
        share = now.done / max(1, now.files)
        tell(DatasetProgress("windows left out", (steps - 2 + share) / steps))

    judgements = judge_recordings(
        sources, [judged_as(model) for model in MODELS], folder=folder / SCORES, command=command,
        on_progress=of_judge, should_stop=stop, **about,
    )  # fmt: skip
    if not judgements.is_whole:
        return None
    frames = {model: read_study(study) for model, study in studies.items()}
    rows = _rows(frames)
    recordings, drives, windows = _drives(sources, mapping, rows)
    grouped = {model: group(rows, BY, level) for model, rows in frames.items()}

    def of_joint(share: float) -> None:
        tell(DatasetProgress("joint estimates", (steps - 1 + share) / steps))

    jobs = [
        JointJob(model, part.values, tuple(windows[part.values]), part.median_speed)
        for model, groups in grouped.items()
        for part in groups.groups
        if windows[part.values]
    ]
    points = _joint(jobs, folder / POINTS, workers, scheduler, of_joint, stop)
    if points is None:
        return None
    return Dataset(
        {
            model: replace(
                groups,
                groups=tuple(
                    replace(part, point=points.get((model, part.values))) for part in groups.groups
                ),
            )
            for model, groups in grouped.items()
        },
        rows,
        judgements,
        {key: gain_peak(segments) for key, segments in drives.items()},
        recordings,
        tuple(dict.fromkeys(part for study in studies.values() for part in read_failures(study))),
    )


def _rows(frames: Mapping[str, "DataFrame"]) -> "DataFrame":
    """The rows of all batches, without their draws."""
    from pandas import concat

    bare = [frame.drop(columns="posterior") for frame in frames.values()]
    return concat(bare, ignore_index=True)


def _drives(
    sources: Sources, mapping: CsvMapping | None, rows: "DataFrame"
) -> tuple[tuple[tuple[Facts, str, str], ...], dict[Key, list[Segment]], dict[Key, list[Segment]]]:
    """Each recording's facts, file and SHA-256; each group's whole drives, and its windows."""
    recordings = list[tuple[Facts, str, str]]()
    drives, windows = (defaultdict[Key, list[Segment]](list) for _ in range(2))
    places = rows[["sha256", "start", "duration", "vehicle"]].drop_duplicates()
    of_recording = {
        digest: part[["start", "duration", "vehicle"]].to_numpy().tolist()
        for digest, part in places.groupby("sha256")
    }
    for recording in _recordings(sources, mapping):
        facts = facts_of(recording)
        recordings.append((facts, recording.source, recording.sha256))

        def key(
            number: int, names: Mapping[int, str] = recording.names, facts: Facts = facts
        ) -> Key:
            return key_of(number, names.get(number) or unnamed(number), facts)

        for pair in (pair for chain in chains(recording) for pair in pairwise(chain)):
            for window in sound_windows(recording, pair[1], LONGEST_STRETCH):
                segment = cut(recording, window.start, window.duration, pair)
                drives[key(pair[1])].append(segment)
        for start, duration, vehicle in of_recording.get(recording.sha256, ()):
            number = int(vehicle)
            pair = number - 1, number
            segment = cut(recording, start, duration, pair, allow_missing=True)
            windows[key(number)].append(segment)
    return tuple(recordings), drives, windows


@dataclass(frozen=True, eq=False)
class JointJob:
    """All windows of a group, each of one follower, and the model they are to share."""

    model: str
    key: Key
    windows: tuple[Segment, ...]
    speed: MetresPerSecond
    """Speed at which a model that is no CTHP is linearised."""

    @property
    def name(self) -> str:
        """The name of the file in which its point is kept."""
        data = [(part.info.digest, part.start, part.vehicles) for part in self.windows]
        version = METHODS[recommended_method(self.model)].version
        about = repr((__version__, version, self.model, self.speed, data))
        return f"{sha256(about.encode()).hexdigest()[:32]}.json"


def joint_point(job: JointJob) -> Parameters:
    """The parameters that all windows of a group support together, by the recommended method."""
    method, model = METHODS[recommended_method(job.model)], FOLLOWING[job.model]
    windows = tuple(replace(segment) for segment in job.windows)
    (found,) = method.fit(windows, "II", None, None, ModelSpec(job.model)).parameters
    if model.is_linear:
        return found
    (linearised,) = model.linearisations(found.nonlinear[:, None], job.speed)
    return linearised


def _joint(
    jobs: Sequence[JointJob],
    folder: Path,
    workers: int | None,
    scheduler: str | None,
    tell: Callable[[float], None],
    should_stop: Callable[[], bool],
) -> dict[tuple[str, Key], Parameters] | None:
    """The points of groups; those that cannot be found are left out. None where it was stopped."""
    points, left = dict[tuple[str, Key], Parameters](), list[JointJob]()
    for job in jobs:
        try:
            values = json.loads((folder / job.name).read_bytes())
            points[job.model, job.key] = Parameters.of(np.array(values, float))
        except (OSError, ValueError, AccpinnError):  # what is damaged is done again
            left.append(job)
    if not left:
        return points
    with reported(lambda reason: RecordingError(f"{folder}: it cannot be written ({reason}).")):
        folder.mkdir(parents=True, exist_ok=True)
    done = 0
    with connected(workers, scheduler) as client:
        for ended in run_all(client, joint_point, iter(left), is_local=not scheduler):
            if ended:
                job, point, _ = ended
                done += 1
                tell(done / len(left))
                if isinstance(point, Parameters) and np.isfinite(point.complete).all():
                    points[job.model, job.key] = point
                    write_whole(folder / job.name, json.dumps(point.everything.tolist()).encode())
            if should_stop():
                return None
    return points


def _recordings(sources: Sources, mapping: CsvMapping | None) -> Iterator[Recording]:
    """Every recording that can be read, each contents once."""
    seen = set[str]()
    for file in listing_of(sources).files:
        try:
            digest = opened(file).content.sha256()
            if digest in seen:
                continue
            seen.add(digest)
            for recording in read_all(file, mapping=mapping):
                if isinstance(recording, Recording):
                    yield recording
        except AccpinnError:  # the batch has told it
            continue


def gain_peak(segments: Sequence[Segment]) -> GainPeak:
    """The peak of the measured gain of followers, one a segment, averaged over all of them.

    Of drives with other steps between samples than the first those of the first count.
    """
    step = segments[0].sample_time
    alike = [segment for segment in segments if abs(segment.sample_time - step) < SLACK]
    try:
        measured = measured_gain(alike, 0)
    except SegmentError:
        return NOT_MEASURED
    at = np.flatnonzero(compared(measured))
    if len(at) < LEAST:
        return GainPeak(UNKNOWN, np.nan, len(at))
    top = at[measured.gain[at].argmax()]
    ends = (decibels(part[top]) for part in (measured.gain, measured.lower, measured.upper))
    return GainPeak(Quantity(*map(float, ends)), float(measured.omega[top]), len(at))
