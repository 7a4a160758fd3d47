"""Resources that all browsers share: store, library, queues, recordings and their windows."""

import logging
import os
from collections.abc import Callable, Container, Hashable, Sequence
from contextlib import suppress
from functools import lru_cache, wraps
from math import inf, nan
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import streamlit as st

from accpinn.errors import RecordingError, SegmentError
from accpinn.methods.registry import METHODS, VARIANTS
from accpinn.recordings import Recording, Window, files
from accpinn.recordings.mapping import CsvMapping
from accpinn.recordings.synthetic import Truth, load_truth, truth_path
from accpinn.results.recording import RatedWindow
from accpinn.segment import Segment
from accpinn.segment.cut import cut
from accpinn.segment.quality import Rating, Regimes, assess_quality, label_regimes, rate
from accpinn.segment.windows import Information, car_following
from accpinn.storage import folder, is_text, printable, shipped, variable
from accpinn.study import Analysis
from accpinn.study.judge import Subject, subjects_of
from accpinn.study.plan import ENDINGS
from accpinn.study.result import Result
from accpinn.study.snapshot_library import Library
from accpinn.study.store import Store
from accpinn.tasks import Task, TaskQueue
from accpinn.units import Seconds
from pages.ui.server import is_open

KEPT = 64
"""Snapshots that are kept in memory: one for each of many users at a time."""
KEPT_VALUES = 128
"""Values that are kept of all functions with `cached` together."""
TASK_VARIABLE, BATCH_VARIABLE = "ACCPINN_TASK_MINUTES", "ACCPINN_BATCH_MINUTES"
"""Environment variables with the longest time of a training, comparison or download, and of a
batch, in minutes; "inf" for none."""
TASK_LIMIT: Seconds = 3600.0
BATCH_LIMIT: Seconds = 12 * 3600.0
"""Limits of a server that others use, where the variables are not set."""
SAMPLES = shipped("sample_data")
FIRST_SAMPLE = SAMPLES / "synthetic_motorway.csv"
TITLES = {
    "synthetic_motorway": "Motorway cars: three followers with an intercept and a delay",
    "synthetic_astazero_like": "AstaZero-like platoon: four followers on a test track",
    "synthetic_vicolungo_like": "Vicolungo-like platoon: three followers on a motorway",
    "synthetic_paper_study": "Paper's study, noisy: one follower, with receiver noise",
    "synthetic_paper_study_noise_free": "Paper's study, no noise: the same drive without errors",
}


P = ParamSpec("P")
R = TypeVar("R")

once = st.cache_resource(show_spinner=False)
"""Decorates a function that makes one object for all browsers."""
store, library = once(Store), once(Library)


@lru_cache(maxsize=KEPT_VALUES)
def _value(function: Callable[..., Any], *arguments: Hashable, **named: Hashable) -> Any:
    return function(*arguments, **named)


def cached(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function of immutable objects: the app's one bounded cache keeps its values."""

    @wraps(function)
    def look_up(*arguments: P.args, **named: P.kwargs) -> R:
        value: R = _value(function, *arguments, **named)  # type: ignore[arg-type]
        return value

    return look_up


@once
def task_queue() -> TaskQueue:
    """The queue of trainings and comparisons."""
    return TaskQueue(limit=limit_of(TASK_VARIABLE, TASK_LIMIT), stop_file=stop_file())


@st.cache_resource(max_entries=KEPT, show_spinner=False)
def opened(name: str) -> Result:
    """A snapshot of the library; its name is its content, so it never changes.

    Raises:
        SnapshotError: for an unknown name, or a file that is damaged or another's.
    """
    return library().read(name)


@once
def batch_queue() -> TaskQueue:
    """The queue of batches; they may take hours, which no training should wait for."""
    return TaskQueue(lambda: None, limit_of(BATCH_VARIABLE, BATCH_LIMIT), stop_file())


@once
def download_queue() -> TaskQueue:
    """The queue of downloads."""
    return TaskQueue(lambda: None, limit_of(TASK_VARIABLE, TASK_LIMIT), stop_file())


def queues() -> dict[str, TaskQueue]:
    """The queues by the kind of task; "" for every kind that has none of its own."""
    return {"batch": batch_queue(), "download": download_queue(), "": task_queue()}


def queue_of(task: Task[Any]) -> TaskQueue:
    """The queue in which a task waits."""
    every = queues()
    return every.get(task.kind, every[""])


def limit_of(variable: str, limit: Seconds) -> Seconds | None:
    """The longest time of a task in s, from an environment variable in minutes.

    Without it, it is ``limit`` on a server that others use, and none on one's own computer; and
    ``limit`` for what is no number of minutes, which the log has.
    """
    if not (named := os.environ.get(variable, "").strip()):
        return limit if is_open() else None
    try:
        minutes = float(named)
    except ValueError:
        minutes = nan
    if minutes > 0:
        return 60 * minutes if minutes < inf else None
    logging.getLogger(__name__).error(
        '%s: "%s" is no number of minutes; %g hold.', variable, named[:20], limit / 60
    )
    return limit


def stop_file() -> Path:
    """The file that ends all tasks submitted before its last change."""
    return folder("cache") / "stop"


def title_of_variant(name: str) -> str:
    """The title of a variant's method; another name as it is."""
    if name not in VARIANTS:
        return name
    key, config = VARIANTS[name]
    return METHODS[key].title + (f" ({config.preset})" if config else "")


# The server's own recordings, samples and files of its folder


def find_recording(
    file: str, sha256: str, trajectory: str | None = None, mapping: CsvMapping | None = None
) -> Recording:
    """The recording with that content, from the server's folder or the samples, read as before.

    Raises:
        RecordingError: where none is there.
    """
    name = file.partition(", trajectory ")[0]
    for path in (path for path in (*samples(), *listed()) if path.name == name):
        with suppress(RecordingError):  # another file of that name
            table = files.opened(path, mapping=mapping)
            if table.content.sha256(trajectory) == sha256:
                return table.read(trajectory)
    raise RecordingError(
        f"{file}: this recording is not in the server's folder; download it on page Data, or put it"
        f" there ({variable('recordings')})."
    )


def samples() -> list[Path]:
    """The samples' files in the order of their titles, then any others by name."""
    place = {stem: k for k, stem in enumerate(TITLES)}
    return sorted(SAMPLES.glob("*.csv"), key=lambda path: (place.get(path.stem, len(place)), path))


def sample_title(path: Path) -> str:
    """The title of a sample."""
    return TITLES.get(path.stem, path.stem)


def recordings_folder() -> Path:
    """The server's folder of recordings, which need not exist."""
    return folder("recordings").resolve()


def folders(root: Path) -> tuple[str, ...]:
    """The folders of recordings below one, itself first as "."; none where there is no file."""
    below = {path.parent.relative_to(root) for path in listed()}
    parents = {parent for path in below for parent in path.parents}
    return tuple(str(path) for path in sorted(below | parents))


def listed() -> list[Path]:
    """The files of tables in the server's folder; none where there is no folder."""
    root = recordings_folder()
    paths = (path for path in _tables(root) if path.is_file())
    # A link that leads out of the folder is left out, and a name that is no text: see `misnamed`.
    return [path for path in paths if is_text(path) and path.resolve().is_relative_to(root)]


def misnamed() -> list[str]:
    """Names of files in the server's folder that are no text, which no browser can be sent."""
    paths = _tables(recordings_folder())
    return sorted(printable(path.name) for path in paths if not is_text(path))


def _tables(root: Path) -> list[Path]:
    """The files of tables below a folder, by the ends of their names."""
    return [path for path in sorted(root.rglob("*")) if path.suffix.lower() in ENDINGS]


# What follows for a recording that is open, computed once


@cached
def truth_of(recording: Recording) -> Truth | None:
    """A sample's true parameters; None of any other recording."""
    for path in (path for path in samples() if path.name == recording.source):
        with suppress(RecordingError):
            if files.opened(path).content.sha256() == recording.sha256:
                return load_truth(truth_path(path))
    return None


@cached
def whole_drive(
    recording: Recording, vehicles: tuple[int, ...]
) -> tuple[Segment, Regimes, Information]:
    """Data, regimes and information content of a whole recording, also with missing samples."""
    whole = cut(recording, 0.0, recording.duration, vehicles, allow_missing=True)
    regimes = label_regimes(whole, recording)
    return whole, regimes, Information.of(whole, regimes)


@cached
def windows_in_car_following(recording: Recording, vehicles: tuple[int, ...]) -> tuple[Window, ...]:
    """The windows in which all followers are in car-following; empty for fewer than two."""
    with suppress(SegmentError):
        windows = car_following(recording, vehicles)
        return windows if len(windows) > 1 else ()
    return ()


@cached
def segment_of(
    recording: Recording, window: Window, vehicles: tuple[int, ...], excluded: tuple[str, ...]
) -> Segment:
    """The data of a window.

    Raises:
        SegmentError: as `Analysis.segments` does.
    """
    (segment,) = Analysis.of(recording, (window,), vehicles, excluded=excluded).segments(recording)
    return segment


@cached
def rated(recording: Recording, segment: Segment) -> tuple[Rating, ...]:
    """The quality of a window, as ratings."""
    return rate(segment, recording, assess_quality(segment))


def rated_windows(
    recording: Recording,
    windows: Sequence[Window],
    used: Container[Window],
    vehicles: tuple[int, ...],
    excluded: tuple[str, ...],
) -> tuple[RatedWindow, ...]:
    """The quality of each of several windows, and which are used."""

    def row(number: int, window: Window) -> RatedWindow:
        try:
            segment = segment_of(recording, window, vehicles, excluded)
        except SegmentError as fault:
            return RatedWindow(number, window, window in used, fault=str(fault))
        return RatedWindow(number, window, window in used, rated(recording, segment))

    return tuple(row(number, window) for number, window in enumerate(windows, 1))


@cached
def judged_subjects(
    recording: Recording, vehicles: tuple[int, ...], window: Window
) -> tuple[Subject, ...]:
    """Followers in their windows in car-following; in blocks of ``window`` where there is none."""
    with suppress(SegmentError):
        return subjects_of(recording, vehicles)
    return subjects_of(recording, vehicles, [window])
