"""`run`: the only way from an `Analysis` to its `Result`.

The method finds the point; where its estimates have a posterior, intervals follow in phases of
their own. Whoever watches is given the point in between, and with every moment the time left until
all phases are over.
"""

from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from itertools import combinations
from time import perf_counter

from accpinn.errors import SegmentError
from accpinn.inference.typical import posterior_phases, with_posterior
from accpinn.methods import Segments, TaskContext
from accpinn.methods.estimate import Estimate, History, Outcome, Progress
from accpinn.methods.findings import CacheProblem
from accpinn.methods.forecast import CHECKS, Forecast, Phase
from accpinn.methods.registry import METHODS
from accpinn.methods.series import series_of, stride_of
from accpinn.model.cthp import Case
from accpinn.recordings import Recording
from accpinn.segment import Segment
from accpinn.segment.cut import SLACK
from accpinn.study import Analysis, Source
from accpinn.study.result import Result, result_of
from accpinn.study.store import Store
from accpinn.units import Seconds


def run(
    analysis: Analysis,
    recording: Recording | None,
    *,
    segments: Segments = (),
    store: Store | None = None,
    context: TaskContext | None = None,
) -> Result:
    """Answer an analysis: from the store where it has the result, else by its method.

    Args:
        analysis: what is asked.
        recording: that it is asked of; None where only the data of its windows are at hand.
        segments: those data; by default they are cut from the recording.
        store: where results and checkpoints are kept; None keeps nothing.
        context: threads, progress and stop.

    Raises:
        AccpinnError: one sentence that names what is wrong with window, data or settings.

    Examples:
        >>> import accpinn
        >>> recording = accpinn.sample("motorway")
        >>> asked = accpinn.analyse(recording, vehicles="1-2", method="splines")
        >>> accpinn.run(asked, recording).estimate.method
        'splines'
    """
    problems: list[str] = []
    segments = segments or analysis.segments(recording)
    stored = store.find(analysis, problems.append) if store else None
    if stored:
        cached = replace(stored.estimate, cached=True)
        result = replace(stored, estimate=cached).on(segments, recording)
    else:
        if store and analysis.checkpoint_key:
            checkpoints = store.checkpoints(analysis, problems.append)
            context = replace(context or TaskContext(), checkpoints=checkpoints)
        context = context or TaskContext()
        if watched := context.on_progress:
            phases = _phases(analysis, segments, context, recording)
            forecast = Forecast(phases)
            context = replace(context, on_progress=lambda now: watched(forecast.of(now)))
        point = estimate(analysis, segments, context=context)
        result = result_of(analysis, segments, point, recording)
        if context.with_checks:
            if context.on_progress and point.history:
                context.on_progress(_moment(CHECKS, point.history, 0, 1, point.seconds))
            _ = result.trust, result.evaluation, result.gain_checks, result.gap_band
        if store and point.is_finished:
            store.keep(result, problems.append)
    if not problems:
        return result
    cache_problems = tuple(CacheProblem(sentence) for sentence in dict.fromkeys(problems))
    findings = (*result.estimate.findings, *cache_problems)
    return replace(result, estimate=replace(result.estimate, findings=findings))


def estimate(
    analysis: Analysis, segments: Segments, *, context: TaskContext | None = None
) -> Estimate:
    """The estimate by the method itself, from the data of its windows (K,), cut already.

    Raises:
        AccpinnError: as `run` does.
    """
    method, context = METHODS[analysis.method], context or TaskContext()
    kind = method.posterior(analysis.settings)
    if len(segments) > 1:
        _check_windows(segments, analysis.case, needs_likelihood=kind == "likelihood")
    point = method.fit(segments, analysis.case, analysis.config, context, analysis.spec)
    if context.on_estimate:
        context.on_estimate(point)
    if kind is None or not point.is_finished:
        return point
    started = perf_counter()

    def report(phase: str, done: int, steps: int) -> None:
        if context.on_progress and point.history:
            seconds = point.seconds + perf_counter() - started
            context.on_progress(_moment(phase, point.history, done, steps, seconds))

    whole = with_posterior(point, segments, kind, on_step=report, should_stop=context.should_stop)
    if whole.posterior is None:
        return replace(whole, outcome=Outcome.STOPPED)
    return replace(whole, seconds=point.seconds + perf_counter() - started)


def _moment(phase: str, history: History, done: int, steps: int, seconds: Seconds) -> Progress:
    """A moment of a phase that follows when the point is known."""
    likelihood = history.log_likelihood
    return Progress(
        phase=phase,
        iteration=done,
        iterations=steps,
        seconds=seconds,
        total=float(history.total[-1]),
        data=float(history.data[-1]),
        physics=float(history.physics[-1]),
        initial=float(history.initial[-1]),
        parameters=history.parameters[-1],
        log_likelihood=0.0 if likelihood is None else float(likelihood[-1]),
        deviations=None if history.deviations is None else history.deviations[-1],
    )


def _phases(
    analysis: Analysis, segments: Segments, context: TaskContext, recording: Recording | None
) -> dict[str, Phase]:
    """All phases of a training, in their order."""
    method, spec = METHODS[analysis.method], analysis.spec
    kind = method.posterior(analysis.settings)
    phases = dict(method.phases(segments, analysis.config, spec)) if method.phases else {}
    phases |= posterior_phases(segments, spec, kind) if kind else {}
    if context.with_checks:
        # Each follower behind the measured one ahead, the platoon, and the platoon outside.
        samples = sum(segment.samples for segment in segments)
        outside = recording.samples if recording else 0
        drawn = samples * (1 + segments[0].followers) + outside
        seconds = 0.02 + drawn * (1e-7 if spec.following.is_linear else 6e-5)
        seconds += segments[0].followers * (0.07 + 0.02 * len(segments)) if kind else 0.0
        phases[CHECKS] = Phase(1, seconds)
    return phases


def analysis_of(segments: Sequence[Segment], analysis: Analysis) -> Analysis:
    """The question of an analysis asked of windows that were cut already, also of several runs.

    The windows have the same vehicles in the same order, with the same step in time. The first
    one's numbers and names of vehicles serve for all.
    """
    first = segments[0].info
    data = sha256(" ".join(segment.info.digest for segment in segments).encode())
    return replace(
        analysis,
        source=Source(first.source, first.sha256, None, data.hexdigest(), analysis.source.mapping),
        vehicles=first.vehicles,
        windows=tuple(segment.window for segment in segments),
        excluded=first.excluded_regimes,
    )


def _check_windows(segments: Segments, case: Case, needs_likelihood: bool) -> None:
    """Refuse windows that cannot share their parameters.

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
        if not needs_likelihood:
            continue
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
    for segment in segments if needs_likelihood else ():
        series_of([segment], case)  # refuses one that is too short before any search begins
