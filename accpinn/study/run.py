"""`run`: the only way from an `Analysis` to its `Result`."""

from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from itertools import combinations

from accpinn.errors import ConfigError, SegmentError
from accpinn.findings import joined
from accpinn.methods import TaskContext
from accpinn.methods.estimate import CacheProblem
from accpinn.methods.maximum_likelihood import KEY
from accpinn.methods.registry import METHODS
from accpinn.methods.series import series_of, stride_of
from accpinn.model.cthp import Case
from accpinn.model.registry import BEST, CTHPS
from accpinn.recordings import Recording
from accpinn.segment import Segment
from accpinn.segment.cut import SLACK
from accpinn.study import Analysis, Source
from accpinn.study.result import Result, result_of
from accpinn.study.store import Store


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
    segments = segments or analysis.segments(recording)
    known = store.find(analysis, problems.append) if store else None
    if known:
        cached = tuple(replace(fit, cached=True) for fit in known.fits)
        result = replace(known, fits=cached).on(segments, recording)
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
    method = METHODS[analysis.method]
    if len(segments) > 1 and not method.takes_windows:
        able = joined([key for key, method in METHODS.items() if method.takes_windows])
        raise ConfigError(
            f"windows: only {able} estimate from several windows, {analysis.method} does not;"
            " choose one of them, or one window."
        )
    if len(segments) > 1:
        _check_windows(segments, analysis.case)
    fits = method.fits(segments, analysis.case, analysis.config, context, analysis.spec)
    if len(fits) < len(segments):
        raise ConfigError(
            f"windows: stopped; {len(segments)} windows have no result before all are estimated."
            " Take fewer windows, or one."
        )
    return result_of(analysis, segments, fits, recording)


def fit_windows(segments: Sequence[Segment], case: Case = "II", model: str | None = None) -> Result:
    """One parameter set over windows that were cut already, also of several recordings.

    Args:
        segments: at least two, of the same vehicles in the same order, with the same step in time.
            The first one's numbers and names of vehicles serve for all.
        case: "I" for one parameter set, "II" for one per follower.
        model: a CTHP, by default "cthp-s0-delay".

    Raises:
        ConfigError: for fewer than two segments, or a model that is none.
        SegmentError: when segments overlap or do not match, or one is too short.
    """
    if len(segments) < 2:
        raise ConfigError("windows: one is no comparison; give at least two, or use fit for one.")
    if model and model not in CTHPS:
        raise ConfigError(f"model: {model[:40]} is not allowed; choose {', '.join(CTHPS)}.")
    first = segments[0].info
    data = sha256(" ".join(segment.info.digest for segment in segments).encode())
    analysis = Analysis(
        Source(first.source, first.sha256, None, data.hexdigest()),
        first.vehicles,
        tuple(segment.window for segment in segments),
        case,
        first.excluded_regimes,
        model=model or BEST,
        fitted=model or "",
        method=KEY,
    )
    return estimate(analysis, tuple(segments))


def _check_windows(segments: tuple[Segment, ...], case: Case) -> None:
    """Refuse segments that cannot share one likelihood.

    Raises:
        SegmentError: when they overlap or do not match, or one is too short.
    """
    first = segments[0]
    for other in segments[1:]:
        if other.followers != first.followers:
            raise SegmentError(
                f"{other.source}: {other.window} has {other.followers} followers and"
                f" {first.window} of {first.source} has {first.followers}; take windows of the same"
                " vehicles."
            )
        steps = [stride_of(segment) * segment.sample_time for segment in (first, other)]
        if abs(steps[1] - steps[0]) > SLACK:
            raise SegmentError(
                f"{other.source}: its samples are {other.sample_time:g} s apart and those of"
                f" {first.source} {first.sample_time:g} s, so one likelihood cannot hold both; take"
                " recordings with equal steps."
            )
    for earlier, later in combinations(segments, 2):
        shared = min(earlier.window.end, later.window.end) - max(earlier.start, later.start)
        same = earlier is later or (
            earlier.sha256 == later.sha256 != "" and earlier.vehicles == later.vehicles
        )
        if same and shared > SLACK:
            raise SegmentError(
                f"{earlier.source}: the windows {earlier.window} and {later.window} overlap, so"
                " their data would count twice; choose disjoint ones."
            )
    for segment in segments:
        series_of([segment], case)  # refuses one that is too short before any search begins
