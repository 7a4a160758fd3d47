"""Public functions: parameters, uncertainty, string stability and files of a recording in one call.

import accpinn

result = accpinn.fit("recording.csv", start=0, duration=300)
accpinn.save(result, "result.accpinn.zip")
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from accpinn import platoon
from accpinn.errors import ConfigError, shown
from accpinn.methods import TaskContext
from accpinn.methods.estimate import OnProgress
from accpinn.methods.pinn.config import DEFAULT
from accpinn.methods.registry import COMPARED, method_of, recommended_method, variant_key
from accpinn.model.cthp import Case, Parameters
from accpinn.model.following import FollowingModel
from accpinn.model.registry import FOLLOWING, JUDGED, PAPER, following_model, register_model
from accpinn.platoon import PlatoonRun
from accpinn.platoon.leader import Leader, Recorded
from accpinn.recordings import Recording, Window
from accpinn.recordings.files import read
from accpinn.recordings.mapping import CsvMapping
from accpinn.segment import Segment
from accpinn.segment.cut import DURATION, parse_windows
from accpinn.segment.windows import AUTO, car_following
from accpinn.storage import shipped
from accpinn.study import Analysis, comparison, single_window, snapshot, vehicles_of, verification
from accpinn.study.judge import candidate
from accpinn.study.judging import Judgements, judge_recordings
from accpinn.study.result import Result
from accpinn.study.run import analysis_of, run
from accpinn.study.scripts import ENDING, Script
from accpinn.study.store import Store
from accpinn.study.verification import PATIENCE, Verification
from accpinn.units import Seconds

__all__ = [
    "analyse",
    "compare",
    "fit",
    "judge",
    "report",
    "sample",
    "sample_path",
    "save",
    "simulate_platoon",
    "verify",
]

Data = Recording | Segment | Sequence[Segment]
"""A recording, or windows of one or of several that are cut already."""
Windows = str | Sequence[Window | tuple[Seconds, Seconds]]
"""Several windows: "0-300,600-900", pairs of start and end in s, or "auto"."""
_PREFIX = "synthetic_"
"""Beginning of the file names of samples."""


def sample_path(name: str) -> Path:
    """The CSV file of a sample recording.

    Args:
        name: "motorway" (four cars, 600 s), "astazero_like" and "vicolungo_like" (six and four cars
            as on those tracks), "paper_study" and "paper_study_noise_free" (the paper's simulation
            of two cars). All are simulated; beside each file one that ends in .truth.json has the
            true parameters.

    Raises:
        ConfigError: for another name.

    Examples:
        >>> import accpinn
        >>> accpinn.sample_path("motorway").name
        'synthetic_motorway.csv'
    """
    paths = {path.stem: path for path in sorted(shipped("sample_data").glob("*.csv"))}
    stem = name.removesuffix(".csv")
    path = paths.get(stem) or paths.get(_PREFIX + stem)
    if path is None:
        names = ", ".join(stem.removeprefix(_PREFIX) for stem in paths) or "none, as none are here"
        raise ConfigError(f"name: {name[:40]} is no sample; choose {names}.")
    return path


def sample(name: str) -> Recording:
    """A sample recording, of which the true parameters are known; see `sample_path`.

    Args:
        name: "motorway" and others.

    Raises:
        ConfigError: for another name.

    Examples:
        >>> import accpinn
        >>> recording = accpinn.sample("motorway")
        >>> recording.duration, len(recording.vehicles)
        (600.0, 4)
    """
    return read(sample_path(name))


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
    seed: int | None = None,
    exclude: str | Sequence[str] = (),
) -> Analysis:
    """The analysis that `fit` runs; the arguments are the same, but the data are read already.

    Raises:
        AccpinnError: one sentence that names what is not allowed.

    Examples:
        >>> import accpinn
        >>> analysis = accpinn.analyse(accpinn.sample("motorway"), vehicles="1-2")
        >>> analysis.method, analysis.spec.model, analysis.settings["preset"]
        ('pinn', 'cthp-s0-delay', 'calibrated')
    """
    key, config = _method(model, method, preset, settings, seed)
    request: dict[str, Any] = {
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
        recording = Recording(  # the first segment, against which the analysis is checked
            source=first.source,
            sha256=first.sha256,
            names={},
            time=first.time,
            speed=first.speeds,
            gap=first.gaps,
            mode=np.zeros(first.speeds.shape, np.int8),
        )
        return analysis_of(segments, Analysis.of(recording, (), first.vehicles, **request))
    chosen: Sequence[Window] = single_window(
        0.0 if start is None else start, DURATION if duration is None else duration
    )
    if windows is not None:
        _refuse("the windows say where they lie", start=start, duration=duration)
        chosen = _windows(data, windows, vehicles)
    return Analysis.of(data, chosen, vehicles, excluded=exclude, **request)


def _method(
    model: str | None,
    method: str | None,
    preset: str | None,
    settings: Mapping[str, Any] | None,
    seed: int | None,
) -> tuple[str, Any]:
    """The key of the requested method, and its settings.

    Raises:
        ConfigError: for an unknown name, or a setting that the method does not have.
    """
    changes = dict(settings or {})
    for name, value in (("preset", preset), ("seed", seed)):
        if value is not None and changes.setdefault(name, value) != value:
            raise ConfigError(
                f"{name}: {value} contradicts {changes[name]} in settings; give one of them."
            )
    preset = changes.get("preset")
    if method is None:
        method = recommended_method(model, preset)
    entry = method_of(method)
    if method != entry.key and preset not in (None, DEFAULT):  # an alias means a certain preset
        raise ConfigError(
            f"preset: {method} means {entry.key} with the preset {DEFAULT}; leave {method} out."
        )
    if entry.settings:
        return entry.key, changes
    _refuse(f"the method {entry.key} has none", preset=preset, seed=seed, settings=settings)
    return entry.key, None


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
        return (
            car_following(recording, vehicles_of(recording, vehicles))
            if windows == AUTO
            else parse_windows(windows)
        )
    try:
        ends = [(w.start, w.end) if isinstance(w, Window) else w for w in windows]
        chosen = [Window(float(first), float(last)) for first, last in ends]
    except (TypeError, ValueError):
        chosen = []
    if not chosen:
        raise ConfigError(
            f"windows: {shown(windows)} is not allowed; choose pairs of start and end in s, as"
            " [(0, 300), (600, 900)]."
        )
    return chosen


def _segments(data: Segment | Sequence[Segment]) -> tuple[Segment, ...]:
    segments = (data,) if isinstance(data, Segment) else tuple(data)
    if not segments or not all(isinstance(segment, Segment) for segment in segments):
        raise ConfigError(
            f"source: {shown(data)} is not allowed; choose a file's path, a recording, or"
            " segments of recordings."
        )
    return segments


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
    seed: int | None = None,
    exclude: str | Sequence[str] = (),
    store: Store | None = None,
    threads: int | None = None,
    progress: bool | OnProgress = False,
) -> Result:
    """Estimate the parameters of each follower from a window of a recording, or from several.

    Vehicles are numbered as in the file, from 1; followers of a result are places in its arrays,
    from 0, so follower 0 of vehicles="3-5" is vehicle 4.

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
        settings: what differs from the preset, as {"iterations": 100, "width": 40}; the keys are
            the fields of `PinnConfig`.
        seed: of the random numbers of a method with presets (0).
        exclude: regimes whose instants do not count, as "catching-up" or ["catching up"].
        store: where results and checkpoints are kept; None keeps nothing.
        threads: most processor threads; by default the method's choice.
        progress: whether a bar on standard error shows how far it has got, or what is called with
            each `Progress`.

    Raises:
        AccpinnError: one sentence that names what is wrong with file, window or settings.

    Examples:
        >>> import accpinn
        >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
        >>> result.parameters.tau.round(1)
        array([1.])
    """
    data = _data(source)
    analysis = analyse(
        data, start, duration, vehicles, windows=windows, case=case, model=model, fixed=fixed,
        method=method, preset=preset, settings=settings, seed=seed, exclude=exclude,
    )  # fmt: skip
    bar: Any = nullcontext(progress or None)
    if progress is True:
        from accpinn.results.progress import progress_bar  # tqdm, for those who watch

        bar = progress_bar(True)
    with bar as on_progress:
        context = _context(threads, on_progress)
        if isinstance(data, Recording):
            return run(analysis, data, store=store, context=context)
        return run(analysis, None, segments=_segments(data), store=store, context=context)


def _context(threads: int | None, on_progress: OnProgress | None = None) -> TaskContext:
    if threads is not None and threads < 1:
        raise ConfigError(f"threads: {threads} is not allowed; choose 1 or more.")
    return TaskContext(threads=threads, on_progress=on_progress)


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
        threads: most processor threads.

    Raises:
        AccpinnError: as `fit` does.

    Examples:
        >>> import accpinn
        >>> recording = accpinn.sample("motorway")
        >>> rows = accpinn.compare(recording, vehicles="1-2", methods=("least-squares", "splines"))
        >>> [row.estimate.method for row in rows]
        ['least-squares', 'splines']
    """
    data = _data(source)
    for name in methods:
        variant_key(name)
    analysis = analyse(
        data, start, duration, vehicles, windows=windows, case=case, model=model, fixed=fixed,
        exclude=exclude,
    )  # fmt: skip
    context = _context(threads)
    if isinstance(data, Recording):
        return comparison.compare(analysis, data, methods, context=context)
    return comparison.compare(analysis, None, methods, segments=_segments(data), context=context)


def judge(
    source: str | os.PathLike[str] | Recording | Sequence[str | os.PathLike[str] | Recording],
    models: Sequence[str | FollowingModel] = JUDGED,
    windows: Windows = AUTO,
    vehicles: str | Sequence[int] | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Judgements:
    """Judge which car-following model describes each car, in windows left out of its fit.

    Args:
        source: a CSV file, or what `read` made of it; or several of either, or folders.
        models: models, or their keys, or paths of scripts ending in .py that register some; names
            of methods are judged under their usual model. By default the paper's model, the
            recommended one, and the usual ones.
        windows: that are left out in turn, as for `fit`; of fewer than three windows, blocks. Of
            several recordings "auto" alone.
        vehicles: leader first; by default all that follow another, and those of ``windows`` as for
            `fit`.
        folder: where each score is kept as it arrives, so that the same call goes on from there;
            by default nothing is kept.
        workers: processes on this machine; by default all is done in this one. Workers know no
            model that is registered in this process alone: give its script.
        scheduler: address of a dask scheduler, as "tls://host:8786", in place of ``workers``.

    Raises:
        AccpinnError: one sentence that names what is wrong with files, windows or models.

    Examples:
        >>> import accpinn
        >>> recording = accpinn.sample("motorway")
        >>> judgements = accpinn.judge(recording, ("cthp", "cthp-s0"), [(0, 60), (60, 120)], "1-2")
        >>> judgements.to_frame().model.tolist()
        ['cthp-s0', 'cthp']
    """
    scripts = [Script.read(m) for m in models if isinstance(m, str) and m.endswith(ENDING)]
    keys = [key for model in models for key in _judged_keys(model)]
    for key in keys:
        candidate(key)
    about: dict[str, Any] = {
        "scripts": scripts, "folder": None if folder is None else Path(folder),
        "workers": workers, "scheduler": scheduler,
    }  # fmt: skip
    if workers is not None and (workers < 1 or scheduler):
        raise ConfigError(
            f"workers: {workers} is not allowed; choose 1 or more, and none beside a scheduler."
        )
    listed = [source] if isinstance(source, str | os.PathLike | Recording) else list(source)
    if len(listed) == 1 and (isinstance(listed[0], Recording) or not Path(listed[0]).is_dir()):
        recording = _recording(listed[0])
        chosen = () if windows == AUTO else _windows(recording, windows, vehicles)
        given = None if vehicles is None else vehicles_of(recording, vehicles)
        return judge_recordings([recording], keys, vehicles=given, windows=chosen, **about)
    if windows != AUTO or vehicles is not None:
        raise ConfigError(
            "windows: those of several recordings, and their vehicles, are found; leave windows and"
            " vehicles out."
        )
    if any(isinstance(part, Recording) for part in listed):
        listed = [_recording(part) for part in listed]
    return judge_recordings(listed, keys, **about)  # type: ignore[arg-type]  # all are alike


def _judged_keys(model: str | FollowingModel) -> tuple[str, ...]:
    """The keys that stand for a model, which is registered where it is not yet, or a script."""
    if isinstance(model, FollowingModel):
        if FOLLOWING.get(model.key) is not model:
            register_model(model)
        return (model.key,)
    return Script.read(model).names() if model.endswith(ENDING) else (model,)


def simulate_platoon(
    parameters: Result | Parameters,
    leader: Leader,
    followers: int | None = None,
    *,
    sample_time: Seconds | None = None,
    model: str | None = None,
) -> PlatoonRun:
    """Simulate a platoon behind a leader from equilibrium, exactly at every sample.

    Args:
        parameters: a result, for its followers in their order, or one entry a follower.
        leader: what the vehicle ahead of them does: a `Sinusoid`, `SpeedStep`, `Brake` or
            `Recorded` speed.
        followers: how many times one parameter set is repeated, as 8; by default each set is one
            follower.
        sample_time: by default 0.1 s, or less for a fast sinusoid; a recorded leader has its own.
        model: of `Parameters` that have parameters of their own, as the IDM's; a result knows.

    Raises:
        AccpinnError: for parameters or settings that cannot be simulated.

    Examples:
        >>> import accpinn
        >>> car = accpinn.Parameters(alpha=0.08, beta=0.3, tau=1.2)
        >>> run = accpinn.simulate_platoon(car, accpinn.Sinusoid(frequency=0.25), followers=8)
        >>> run.amplitudes.measured.round(2)[[0, 1, 8]]
        array([1.  , 1.09, 2.  ])
    """
    sets = parameters.parameters if isinstance(parameters, Result) else parameters
    if isinstance(parameters, Result):
        if model not in (None, parameters.estimate.model):
            raise ConfigError(
                f"model: the result is of {parameters.estimate.model}; leave model out."
            )
        model = parameters.estimate.model
    elif not sets.is_linear and model is None:
        raise ConfigError(
            "model: these parameters are of a model that is no CTHP; name it, or give the result."
        )
    sets = sets.flat
    if isinstance(leader, Recorded) and sample_time is not None:
        raise ConfigError("sample_time: a recorded leader has its own; leave sample_time out.")
    model = following_model(model or PAPER).key
    return platoon.simulate_platoon(
        sets[platoon.order_of(len(sets), followers)], leader, sample_time, model
    )


def save(result: Result, path: str | os.PathLike[str], name: str = "", note: str = "") -> Path:
    """Write a result as a snapshot, in one step; it holds the windows' speeds and space-gaps.

    Args:
        result: of `fit`.
        path: where to; a snapshot that stands there is replaced.
        name: name of the snapshot; may be empty.
        note: a text of up to a few pages; may be empty.

    Raises:
        SnapshotError: when there is nothing to save, or no file can be written there.

    Examples:
        >>> import accpinn, pathlib, tempfile
        >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = accpinn.save(result, pathlib.Path(folder) / "car.accpinn.zip", name="A car")
        ...     accpinn.load(path).name
        'A car'
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

    Examples:
        >>> import accpinn, pathlib, tempfile
        >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     accpinn.report(result, pathlib.Path(folder) / "car.html", curves=False).name
        'car.html'
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

    Returns:
        its ``ok`` is True only if everything was computed again and agrees, False if something
        differs, and None if something was not computed again.

    Raises:
        AccpinnError: when one of them cannot be read.

    Examples:
        >>> import accpinn, pathlib, tempfile
        >>> recording = accpinn.sample("motorway")
        >>> result = accpinn.fit(recording, vehicles="1-2", method="splines")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = accpinn.save(result, pathlib.Path(folder) / "car.accpinn.zip")
        ...     accpinn.verify(path).ok, accpinn.verify(path, refit_within=0).ok
        (True, None)
    """
    if not refit_within >= 0:
        raise ConfigError(f"refit_within: {refit_within} is not allowed; choose 0 s or more.")
    snapshot_result = snapshot.load(content)
    if recording is None or isinstance(recording, Recording):
        data = recording
    else:  # as it was read then
        source = snapshot_result.analysis.source
        data = _read(recording, source.trajectory, source.mapping)
    return verification.verify(snapshot_result, data, refit_within=refit_within)


def _data(source: str | os.PathLike[str] | Data) -> Data:
    """The data to analyse, read from the file where a path is given."""
    if isinstance(source, Segment | Sequence) and not isinstance(source, str | bytes):
        return _segments(source)
    return _recording(source)


def _recording(source: object) -> Recording:
    return source if isinstance(source, Recording) else _read(source)


def _read(
    source: object, trajectory: str | None = None, mapping: CsvMapping | None = None
) -> Recording:
    if not isinstance(source, str | os.PathLike | bytes):
        raise ConfigError(f"recording: {shown(source)} is not allowed; choose a file's path.")
    return read(source, trajectory=trajectory, mapping=mapping)
