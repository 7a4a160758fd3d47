"""`run`: the only way from an `Analysis` to its `Result`."""

import time
from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256

from accpinn.errors import ConfigError
from accpinn.methods.fit import CacheProblem, Progress
from accpinn.methods.maximum_likelihood import KEY
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.recordings.recording import Recording
from accpinn.segment.segment import Segment
from accpinn.study.analysis import Analysis, Source
from accpinn.study.result import Result, result_of
from accpinn.study.store import Store
from accpinn.study.windows import check_windows


def run(
    analysis: Analysis,
    recording: Recording | None,
    *,
    segments: tuple[Segment, ...] = (),
    store: Store | None = None,
    context: TaskContext | None = None,
) -> Result:
    """Answer an analysis: from the store where it has the answer, else by its method.

    Args:
        analysis: what is asked.
        recording: that it is asked of; None where only the data of its windows are at hand.
        segments: those data; by default they are cut from the recording.
        store: where results and checkpoints are kept; None keeps nothing.
        context: threads, progress and stop.

    Raises:
        AccpinnError: one sentence that names what is wrong with window, data or settings.
    """
    problems: list[str] = []
    segments = analysis.segments(recording, segments)
    known = store.find(analysis, problems.append) if store else None
    if known:
        cached = tuple(replace(fit, cached=True) for fit in known.fits)
        result = replace(known, analysis=analysis, fits=cached).on(segments, recording)
    else:
        if store and analysis.checkpoint_key:
            checkpoints = store.checkpoints(analysis, problems.append)
            context = replace(context or TaskContext(), checkpoints=checkpoints)
        result = estimate(analysis, segments, recording, context=context)
        if store and result.is_finished:
            store.keep(result, problems.append)
    if not problems:
        return result
    told = tuple(CacheProblem(sentence) for sentence in dict.fromkeys(problems))
    first, *others = result.fits
    return replace(result, fits=(replace(first, findings=(*first.findings, *told)), *others))


def estimate(
    analysis: Analysis,
    segments: tuple[Segment, ...],
    recording: Recording | None = None,
    *,
    context: TaskContext | None = None,
) -> Result:
    """The answer by the method itself, from the data of its windows (K,), cut already.

    Raises:
        AccpinnError: as `run` does.
    """
    if len(segments) > 1:
        return _together(analysis, segments, recording, context)
    (segment,) = segments
    method, config = METHODS[analysis.method], analysis.config
    fit = method.fit(segment, analysis.case, config, context)
    return result_of(analysis, segments, (fit,), recording)


def fit_windows(segments: Sequence[Segment], case: Case = "II") -> Result:
    """One parameter set over windows that were cut already, also of several recordings.

    Args:
        segments: at least two, of the same vehicles in the same order, with the same step in time.
            The first one's numbers and names of vehicles serve for all.
        case: "I" for one parameter set, "II" for one per follower.

    Raises:
        ConfigError: for fewer than two segments.
        SegmentError: when segments overlap or do not match, or one is too short.
    """
    if len(segments) < 2:
        raise ConfigError("windows: one is no comparison; give at least two, or use fit for one.")
    first = segments[0].info
    data = sha256(" ".join(segment.info.digest for segment in segments).encode())
    analysis = Analysis(
        Source(first.source, first.sha256, None, data.hexdigest()),
        first.vehicles,
        tuple(segment.window for segment in segments),
        case,
        first.excluded_regimes,
        method=KEY,
    )
    return _together(analysis, tuple(segments), None)


def _together(
    analysis: Analysis,
    segments: tuple[Segment, ...],
    recording: Recording | None,
    context: TaskContext | None = None,
) -> Result:
    """Several windows under one likelihood, and each by itself."""
    method, config = METHODS[analysis.method], analysis.config
    if not method.together:
        able = " and ".join(key for key, method in METHODS.items() if method.together)
        raise ConfigError(
            f"windows: only {able} estimate from several windows, {analysis.method} does not;"
            " choose one of them, or one window."
        )
    check_windows(segments, analysis.case)
    context = context or TaskContext()
    fits = method.together(segments, analysis.case, config, context)
    windows, began = list[Result](), time.perf_counter()
    quiet = replace(context, on_progress=None, checkpoints=None)
    for asked, segment in zip(analysis.windows, segments, strict=True):
        if context.is_stopped or len(fits) < len(segments):
            raise ConfigError(
                f"windows: stopped; {len(segments)} windows have no result before all are"
                " estimated. Take fewer windows, or one."
            )
        fit, alone = method.fit(segment, analysis.case, config, quiet), (asked,)
        windows.append(result_of(replace(analysis, windows=alone), (segment,), (fit,), recording))
        if context.on_progress:
            elapsed = time.perf_counter() - began
            phase = "Estimating each window by itself"
            context.on_progress(Progress.of_part(phase, len(windows), len(segments), elapsed, fit))
    return result_of(analysis, segments, fits, recording, tuple(windows))
