"""From a recording to parameters, their uncertainty, string stability and files, in one call.

import accpinn

result = accpinn.fit("recording.csv", start=0, duration=300)
accpinn.save(result, "result.accpinn.zip")
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from accpinn.errors import ConfigError
from accpinn.methods import TaskContext
from accpinn.methods.pinn.config import DEFAULT
from accpinn.methods.pinn.config import preset as named_config
from accpinn.methods.registry import METHODS, method_of, usual_method
from accpinn.model.cthp import Case
from accpinn.recordings import Recording, Window
from accpinn.recordings.files import read
from accpinn.segment.cut import DURATION, parse_windows
from accpinn.study import Analysis, comparison, single_window, snapshot, verification
from accpinn.study.plan import AUTO, car_following
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.study.store import Store
from accpinn.study.verification import PATIENCE, Verification
from accpinn.units import Seconds

__all__ = ["analyse", "compare", "fit", "report", "save", "verify"]


def analyse(
    recording: Recording,
    start: Seconds = 0.0,
    duration: Seconds = DURATION,
    vehicles: str | Sequence[int] | None = None,
    *,
    windows: str | Sequence[tuple[Seconds, Seconds]] = (),
    case: Case = "II",
    model: str | None = None,
    hold: Mapping[str, float] | None = None,
    method: str | None = None,
    preset: str = DEFAULT,
    seed: int = 0,
    exclude: str | Sequence[str] = (),
) -> Analysis:
    """The analysis that `fit` runs; the arguments are the same.

    Raises:
        AccpinnError: one sentence that names what is not allowed.
    """
    chosen: Sequence[Window] = single_window(start, duration)
    if windows == AUTO:
        chosen = car_following(recording, vehicles)
    elif isinstance(windows, str):
        chosen = parse_windows(windows)
    elif windows:
        chosen = [Window(float(first), float(last)) for first, last in windows]
    method = method or usual_method(model, preset)
    if not isinstance(seed, int) or isinstance(seed, bool):
        raise ConfigError(f"seed: {repr(seed)[:40]} is not allowed; choose a whole number, as 0.")
    settings = named_config(preset, seed=seed) if method_of(method).settings else None
    return Analysis.of(
        recording, chosen, vehicles, case=case, excluded=exclude, model=model, held=hold,
        method=method, settings=settings,
    )  # fmt: skip


def fit(
    recording: str | os.PathLike[str] | Recording,
    start: Seconds = 0.0,
    duration: Seconds = DURATION,
    vehicles: str | Sequence[int] | None = None,
    *,
    windows: str | Sequence[tuple[Seconds, Seconds]] = (),
    case: Case = "II",
    model: str | None = None,
    hold: Mapping[str, float] | None = None,
    method: str | None = None,
    preset: str = DEFAULT,
    seed: int = 0,
    exclude: str | Sequence[str] = (),
    store: Store | None = None,
    threads: int | None = None,
) -> Result:
    """Estimate α, β and τ from a window of a recording.

    Args:
        recording: a CSV file, or what `read` made of it.
        start: start of the window, in s from the recording's first sample.
        duration: length of the window, in s.
        vehicles: consecutive numbers, leader first, also as "1-5"; by default the longest run of
            vehicles with data from the first one on.
        windows: several windows in place of one, as "0-300,600-900" or as pairs of start and end in
            s, or "auto" for all in car-following under ACC. Methods are then "maximum-likelihood"
            and the preset "calibrated".
        case: "I" for one parameter set, "II" for one per follower.
        model: of `result.answer`, and of the fit where its method can estimate it; by default
            "cthp-s0-delay", which "maximum-likelihood", "simulation" and the preset "calibrated"
            fit, all others "cthp". Others are "cthp-s0", "idm" and "fvdm".
        hold: terms of that model that keep their values, as {"s0": 4.0}.
        method: a key of `METHODS`, by default "pinn", or "simulation" for a model that the preset
            cannot estimate; with "maximum-likelihood" samples may be missing.
        preset: "calibrated", "fast" or "paper", for a method with presets; the latter two minimise
            the paper's loss, also with the residual of "idm" and "fvdm", and are biased if
            disturbances last.
        seed: seed of a method with presets.
        exclude: regimes whose instants do not count, as "catching-up" or ["catching up"].
        store: where results and checkpoints are kept; None keeps nothing.
        threads: processor threads; by default the method's choice.

    Raises:
        AccpinnError: one sentence that names what is wrong with file, window or settings.
    """
    source = _recording(recording)
    analysis = analyse(
        source, start, duration, vehicles, windows=windows, case=case, model=model, hold=hold,
        method=method, preset=preset, seed=seed, exclude=exclude,
    )  # fmt: skip
    return run(analysis, source, store=store, context=TaskContext(threads=threads))


def compare(
    recording: str | os.PathLike[str] | Recording,
    start: Seconds = 0.0,
    duration: Seconds = DURATION,
    vehicles: str | Sequence[int] | None = None,
    *,
    methods: Sequence[str] = tuple(METHODS),
    case: Case = "II",
    exclude: str | Sequence[str] = (),
    threads: int | None = None,
) -> Iterator[Result | comparison.Refused]:
    """Run several methods on one window, and yield each result; the arguments are those of `fit`.

    Raises:
        AccpinnError: as `fit` does.
    """
    source = _recording(recording)
    analysis = analyse(source, start, duration, vehicles, case=case, exclude=exclude)
    context = TaskContext(threads=threads)
    return comparison.compare(analysis, source, methods, context=context)


def save(
    result: Result,
    path: str | os.PathLike[str],
    name: str = "",
    note: str = "",
    with_data: bool = False,
) -> Path:
    """Write a result as a snapshot, in one step.

    Args:
        result: of `fit`.
        path: where to; a snapshot that stands there is replaced.
        name: name of the snapshot; may be empty.
        note: a text of up to a few pages; may be empty.
        with_data: whether the window's speeds and space-gaps go in.

    Raises:
        SnapshotError: when there is nothing to save, or no file can be written there.
    """
    return snapshot.save(snapshot.named(result, name, note, with_data), path)


def report(result: Result, path: str | os.PathLike[str]) -> Path:
    """Write one web page of a result that needs no network.

    Raises:
        SnapshotError: when there is nothing to report, or no file can be written there.
    """
    from accpinn.results.report import render_report  # plotly's script is read from disk

    place = snapshot.writable_path(Path(path), "report")
    page = render_report(snapshot.named(result, with_data=True))
    return snapshot.write_file(page.encode(), place, "report")


def verify(
    content: str | os.PathLike[str] | bytes,
    recording: str | os.PathLike[str] | Recording | None = None,
    *,
    refit_within: Seconds = PATIENCE,
) -> Verification:
    """Read a snapshot, run its analysis again and compare.

    Args:
        content: the file's path, or its bytes.
        recording: the CSV file of its data, or what `read` made of it; needed where the data are
            not in the snapshot.
        refit_within: how many seconds running its methods again may be expected to take; 0 for
            none, infinity for all.

    Raises:
        AccpinnError: when one of them cannot be read.
    """
    source = None if recording is None else _recording(recording)
    return verification.verify(snapshot.load(content), source, refit_within=refit_within)


def _recording(source: str | os.PathLike[str] | Recording) -> Recording:
    if isinstance(source, Recording):
        return source
    if not isinstance(source, str | os.PathLike | bytes):
        raise ConfigError(f"recording: {repr(source)[:40]} is not allowed; choose a file's path.")
    return read(source)
