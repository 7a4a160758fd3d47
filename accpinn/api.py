"""From a recording to parameters, their uncertainty, string stability and files, in one call.

import accpinn

result = accpinn.fit("recording.csv", start=0, duration=300)
accpinn.save(result, "result.accpinn.zip")
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from accpinn.errors import ConfigError
from accpinn.methods import TaskContext
from accpinn.methods.pinn.config import DEFAULT
from accpinn.methods.pinn.config import preset as named_config
from accpinn.methods.registry import COMPARED, method_of, recommended_method
from accpinn.model.cthp import Case
from accpinn.recordings import Recording, Window
from accpinn.recordings.files import read
from accpinn.recordings.mapping import CsvMapping
from accpinn.segment import Segment
from accpinn.segment.cut import DURATION, parse_windows
from accpinn.study import Analysis, comparison, single_window, snapshot, verification
from accpinn.study.plan import AUTO, car_following
from accpinn.study.result import Result
from accpinn.study.run import analysis_of, run
from accpinn.study.store import Store
from accpinn.study.verification import PATIENCE, Verification
from accpinn.units import Seconds

__all__ = ["analyse", "compare", "fit", "report", "save", "verify"]

Data = Recording | Segment | Sequence[Segment]
"""A recording, or windows of one or of several that are cut already."""
Windows = str | Sequence[Window | tuple[Seconds, Seconds]]
"""Several windows: "0-300,600-900", pairs of start and end in s, or "auto"."""


def analyse(
    data: Data,
    start: Seconds | None = None,
    duration: Seconds | None = None,
    vehicles: str | Sequence[int] | None = None,
    *,
    windows: Windows | None = None,
    case: Case = "II",
    model: str | None = None,
    fixed: Mapping[str, float] | None = None,
    method: str | None = None,
    preset: str | None = None,
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
    exclude: str | Sequence[str] = (),
) -> Analysis:
    """The analysis that `fit` runs; the arguments are the same, but the data are read already.

    Raises:
        AccpinnError: one sentence that names what is not allowed.
    """
    key, config = _method(model, method, preset, settings, seed)
    asked: dict[str, Any] = {
        "case": case, "model": model, "fixed": fixed, "method": key, "settings": config,
    }  # fmt: skip
    if not isinstance(data, Recording):
        _refuse(
            "the segments are cut already",
            start=start, duration=duration, vehicles=vehicles, windows=windows,
            exclude=exclude or None,
        )  # fmt: skip
        segments = _segments(data)
        first = segments[0]
        return analysis_of(segments, Analysis.of(_recorded(first), (), first.vehicles, **asked))
    chosen: Sequence[Window] = single_window(
        0.0 if start is None else start, DURATION if duration is None else duration
    )
    if windows is not None:
        _refuse("the windows say where they lie", start=start, duration=duration)
        chosen = _windows(data, windows, vehicles)
    return Analysis.of(data, chosen, vehicles, excluded=exclude, **asked)


def _method(
    model: str | None,
    method: str | None,
    preset: str | None,
    settings: Mapping[str, Any] | None,
    seed: int,
) -> tuple[str, Any]:
    """The key of the method that is asked for, and its settings.

    Raises:
        ConfigError: for an unknown name, or a setting that the method does not have.
    """
    if not isinstance(seed, int) or isinstance(seed, bool):
        raise ConfigError(f"seed: {repr(seed)[:40]} is not allowed; choose a whole number, as 0.")
    if method is None:
        method = recommended_method(model) if preset is None else "pinn"
    found = method_of(method)
    if method != found.key and preset not in (None, DEFAULT):  # an alias means a certain preset
        raise ConfigError(
            f"preset: {method} means {found.key} with the preset {DEFAULT}; leave {method} out."
        )
    if found.settings:
        config = named_config(preset or DEFAULT, seed=seed).to_json()
        return found.key, config | dict(settings or {})
    _refuse(f"the method {found.key} has none", preset=preset, settings=settings)
    return found.key, None


def _refuse(why: str, **given: object) -> None:
    """Refuse arguments that have no meaning.

    Raises:
        ConfigError: naming the first that is given.
    """
    for name, value in given.items():
        if value is not None:
            raise ConfigError(f"{name}: {why}; leave {name} out.")


def _windows(
    recording: Recording, windows: Windows, vehicles: str | Sequence[int] | None
) -> Sequence[Window]:
    if isinstance(windows, str):
        return car_following(recording, vehicles) if windows == AUTO else parse_windows(windows)
    try:
        ends = [(w.start, w.end) if isinstance(w, Window) else w for w in windows]
        chosen = [Window(float(first), float(last)) for first, last in ends]
    except (TypeError, ValueError):
        chosen = []
    if not chosen:
        raise ConfigError(
            f"windows: {repr(windows)[:40]} is not allowed; choose pairs of start and end in s, as"
            " [(0, 300), (600, 900)]."
        )
    return chosen


def _segments(data: Segment | Sequence[Segment]) -> tuple[Segment, ...]:
    segments = (data,) if isinstance(data, Segment) else tuple(data)
    if not segments or not all(isinstance(segment, Segment) for segment in segments):
        raise ConfigError(
            f"source: {repr(data)[:40]} is not allowed; choose a file's path, a recording, or"
            " segments of recordings."
        )
    return segments


def _recorded(segment: Segment) -> Recording:
    """A segment as a recording that has nothing else, which an analysis is checked against."""
    return Recording(
        source=segment.source,
        sha256=segment.sha256,
        names={},
        time=segment.time,
        speed=segment.speeds,
        gap=segment.gaps,
        mode=np.zeros(segment.speeds.shape, np.int8),
    )


def fit(
    source: str | os.PathLike[str] | Data,
    start: Seconds | None = None,
    duration: Seconds | None = None,
    vehicles: str | Sequence[int] | None = None,
    *,
    windows: Windows | None = None,
    case: Case = "II",
    model: str | None = None,
    fixed: Mapping[str, float] | None = None,
    method: str | None = None,
    preset: str | None = None,
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
    exclude: str | Sequence[str] = (),
    store: Store | None = None,
    threads: int | None = None,
) -> Result:
    """Estimate the parameters of each follower from a window of a recording, or from several.

    Args:
        source: a CSV file, what `read` made of it, or segments that `cut` made, also of several
            recordings; of these neither windows nor vehicles nor regimes are left to choose.
        start: start of the window, in s from the recording's first sample (0).
        duration: length of the window, in s (300).
        vehicles: consecutive numbers, leader first, also as "1-5"; by default the longest run of
            vehicles with data from the first one on.
        windows: several windows in place of one, as "0-300,600-900" or as pairs of start and end in
            s, or "auto" for all in car-following under ACC.
        case: "I" for one parameter set, "II" for one per follower.
        model: a key of a car-following model, as "idm"; by default "cthp-s0-delay" where the method
            has a posterior, and the paper's "cthp" elsewhere.
        fixed: parameters of that model that keep their values, as {"s0": 4.0}.
        method: a key of `METHODS`; by default the one with a posterior: "pinn" with the preset
            "calibrated" for a CTHP, "simulation" for any other model.
        preset: of the method "pinn": "calibrated", or the paper's "fast" and "paper", which have no
            intervals and are biased where disturbances last.
        settings: what differs from the preset, as {"iterations": 100}.
        seed: of a method with presets.
        exclude: regimes whose instants do not count, as "catching-up" or ["catching up"].
        store: where results and checkpoints are kept; None keeps nothing.
        threads: processor threads; by default the method's choice.

    Raises:
        AccpinnError: one sentence that names what is wrong with file, window or settings.
    """
    data = _data(source)
    analysis = analyse(
        data, start, duration, vehicles, windows=windows, case=case, model=model, fixed=fixed,
        method=method, preset=preset, settings=settings, seed=seed, exclude=exclude,
    )  # fmt: skip
    context = TaskContext(threads=threads)
    if isinstance(data, Recording):
        return run(analysis, data, store=store, context=context)
    return run(analysis, None, segments=_segments(data), store=store, context=context)


def compare(
    source: str | os.PathLike[str] | Data,
    start: Seconds | None = None,
    duration: Seconds | None = None,
    vehicles: str | Sequence[int] | None = None,
    *,
    windows: Windows | None = None,
    methods: Sequence[str] = COMPARED,
    case: Case = "II",
    model: str | None = None,
    fixed: Mapping[str, float] | None = None,
    exclude: str | Sequence[str] = (),
    threads: int | None = None,
) -> Iterator[Result | comparison.Refused]:
    """Run several methods on the same windows, and yield each result.

    Args:
        source: as for `fit`, like all others.
        start: in s.
        duration: in s.
        vehicles: leader first.
        windows: several in place of one.
        methods: names as "pinn", "pinn-fast" and "least-squares"; by default all but "pinn-paper",
            which takes minutes.
        case: "I" or "II".
        model: of the methods that can estimate it; the others have their usual one.
        fixed: parameters of that model that keep their values.
        exclude: regimes.
        threads: processor threads.

    Raises:
        AccpinnError: as `fit` does.
    """
    data = _data(source)
    analysis = analyse(
        data, start, duration, vehicles, windows=windows, case=case, model=model, fixed=fixed,
        exclude=exclude,
    )  # fmt: skip
    context = TaskContext(threads=threads)
    if isinstance(data, Recording):
        return comparison.compare(analysis, data, methods, context=context)
    return comparison.compare(analysis, None, methods, segments=_segments(data), context=context)


def save(result: Result, path: str | os.PathLike[str], name: str = "", note: str = "") -> Path:
    """Write a result as a snapshot, in one step; it holds the windows' speeds and space-gaps.

    Args:
        result: of `fit`.
        path: where to; a snapshot that stands there is replaced.
        name: name of the snapshot; may be empty.
        note: a text of up to a few pages; may be empty.

    Raises:
        SnapshotError: when there is nothing to save, or no file can be written there.
    """
    return snapshot.save(snapshot.prepare_snapshot(result, name, note), path)


def report(result: Result, path: str | os.PathLike[str], curves: bool = True) -> Path:
    """Write one web page of a result that needs no network.

    Args:
        result: of `fit`.
        path: where to; a report that stands there is replaced.
        curves: whether it shows measured and fitted series, from which these can be read again.

    Raises:
        SnapshotError: when there is nothing to report, or no file can be written there.
    """
    from accpinn.results.report import render_report  # plotly's script is read from disk

    place = snapshot.writable_path(Path(path), "report")
    page = render_report(snapshot.prepare_snapshot(result), with_curves=curves)
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
        recording: the CSV file of its data, or what `read` made of it; with it the data are cut
            again, and errors outside the windows are compared.
        refit_within: how many seconds running its methods again may be expected to take; 0 for
            none, infinity for all.

    Raises:
        AccpinnError: when one of them cannot be read.
    """
    snapshot_result = snapshot.load(content)
    if recording is None or isinstance(recording, Recording):
        known = recording
    else:  # as it was read then
        source = snapshot_result.analysis.source
        known = _read(recording, source.trajectory, source.mapping)
    return verification.verify(snapshot_result, known, refit_within=refit_within)


def _data(source: str | os.PathLike[str] | Data) -> Data:
    """What is to be analysed, read from the file where a path is given."""
    if isinstance(source, Segment | Sequence) and not isinstance(source, str | bytes):
        return _segments(source)
    return _recording(source)


def _recording(source: object) -> Recording:
    return source if isinstance(source, Recording) else _read(source)


def _read(
    source: object, trajectory: str | None = None, mapping: CsvMapping | None = None
) -> Recording:
    if not isinstance(source, str | os.PathLike | bytes):
        raise ConfigError(f"recording: {repr(source)[:40]} is not allowed; choose a file's path.")
    return read(source, trajectory=trajectory, mapping=mapping)
