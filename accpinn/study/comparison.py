"""All methods on identical data, side by side, with errors and intervals that mean something."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from accpinn.errors import AccpinnError, ConfigError
from accpinn.evaluation.closed_loop import closed_loop_errors
from accpinn.evaluation.evaluation import Evaluation, evaluate
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.inference.model_adequacy import Adequacy
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case, Parameters
from accpinn.recordings.recording import Recording
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.study.worker import Answer, Job, Worker, helpful, is_worthwhile
from accpinn.units import FloatArray


@dataclass(frozen=True, eq=False)
class MethodResult:
    """One method's estimate on a segment, with its uncertainty and its errors."""

    fit: Fit
    uncertainty: Uncertainty
    evaluation: Evaluation


@dataclass(frozen=True)
class MethodFailure:
    """A method that could not serve the segment."""

    method: str
    """Its key in `METHODS`."""
    fault: AccpinnError


def result_of(segment: Segment, fit: Fit, recording: Recording | None = None) -> MethodResult:
    """The result of a fit that exists already, without cross-validation, which would repeat it."""
    return MethodResult(fit, intervals(segment, fit), evaluate(segment, fit, recording=recording))


@dataclass(frozen=True, eq=False)
class FitRecord:
    """A fit that is no longer current, without its data: enough to compare it with another."""

    info: SegmentInfo
    method: str
    case: Case
    config: dict[str, Any]
    outcome: Outcome
    parameters: Parameters
    """(M,) parameters of the followers."""
    closed_loop: FloatArray
    """(M,) MAE of the space-gap in closed loop, in m; nan where it has no meaning."""

    @classmethod
    def of(cls, segment: Segment, fit: Fit) -> "FitRecord":
        """What is kept of a fit."""
        errors = closed_loop_errors(segment, fit)
        gaps = errors.gap_mae if errors else np.full(segment.followers, np.nan)
        return cls(
            segment.info,
            fit.method,
            fit.case,
            fit.config,
            fit.outcome,
            fit.parameters,
            gaps,
        )

    def same_as(self, other: "FitRecord") -> bool:
        """Whether both come from the same request."""
        return self.info.digest == other.info.digest and (
            (self.method, self.case, self.config) == (other.method, other.case, other.config)
        )

    def of_vehicle(self, number: int) -> Parameters | None:
        """Those of the follower with that number in the file; None if it has none."""
        followers = self.info.vehicles[1:]
        return self.parameters[followers.index(number)] if number in followers else None


def differences(one: FitRecord, other: FitRecord) -> tuple[str, ...]:
    """The settings that differ between two fits, a few words each; empty where none does."""
    return tuple(
        f"{name.replace('_', ' ')}: {before} → {after}"
        for name, before, after in (
            *_pairs(_request(one), _request(other)),
            *(_pairs(one.config, other.config) if one.method == other.method else ()),
        )
        if before != after
    )


def _request(run: FitRecord) -> dict[str, str]:
    info = run.info
    return {
        "recording": info.source,
        "window": str(info.window),
        "vehicles": ", ".join(map(str, info.vehicles)),
        "excluded": ", ".join(info.excluded_regimes) or "nothing",
        "case": run.case,
        "method": run.method,
    }


def _pairs(one: dict[str, Any], other: dict[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    for name in dict.fromkeys([*one, *other]):
        yield name, one.get(name, "–"), other.get(name, "–")


def parse_methods(text: str) -> tuple[str, ...]:
    """The methods of a text as "all" or "pinn,splines", each once.

    Raises:
        ConfigError: for a method that is not known.
    """
    if text == "all":
        return tuple(METHODS)
    chosen = tuple(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in chosen:
        if name not in METHODS:
            raise ConfigError(
                f'methods: "{name[:40]}" is not known; choose all or {", ".join(METHODS)}.'
            )
    return chosen


def compare(
    segment: Segment,
    case: Case = "II",
    methods: Sequence[str] = tuple(METHODS),
    *,
    recording: Recording | None = None,
    settings: Mapping[str, Any] | None = None,
    context: TaskContext | None = None,
) -> Iterator[MethodResult | MethodFailure]:
    """Run the methods, and yield each result once it and those before it are known.

    A method that cannot serve the segment gives a `MethodFailure`, and the others run on. A second
    process takes some of the methods where that saves time, and while its answer is the next one to
    be told, later ones are run here; results are the same.

    Args:
        segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
        case: "I" or "II".
        methods: keys of `METHODS`.
        recording: the segment's; with it the errors outside the window are computed as well.
        settings: by method, for methods that have some; their defaults otherwise.
        context: store, threads and progress; its ``should_stop`` ends the iteration, and a method
            that was not finished has no result.
    """
    context = context or TaskContext()
    job = Job(segment, case, recording, dict(settings or {}))
    worker = None
    if is_worthwhile(segment, methods, context):
        worker, context = Worker(job, helpful(methods)), replace(context, threads=1)

    known: dict[str, Answer] = {}
    try:
        for index, key in enumerate(methods):
            for other in methods[index:]:
                if context.is_stopped:
                    return
                if other not in known and (worker is None or worker.leaves(other)):
                    found = job.run(other, context)
                    if found is None:
                        return
                    known[other] = found
                if not worker or not worker.is_busy_with(key):
                    break
            answer = known.get(key) or (worker.answer(key, context) if worker else None)
            if answer is None and not context.is_stopped:  # the second process has failed
                answer = job.run(key, context)
            if answer is None or context.is_stopped:
                return
            if isinstance(answer, AccpinnError):
                yield MethodFailure(key, answer)
            else:
                fit, evaluation = answer
                yield MethodResult(fit, intervals(segment, fit), evaluation)
    finally:
        if worker:
            worker.close()


Outcomes = Iterable[MethodResult | MethodFailure | Adequacy]


def results_among(outcomes: Outcomes) -> tuple[MethodResult, ...]:
    """The methods that have a result."""
    return tuple(one for one in outcomes if isinstance(one, MethodResult))


def failures_among(outcomes: Outcomes) -> tuple[MethodFailure, ...]:
    """The methods that could not serve the segment."""
    return tuple(one for one in outcomes if isinstance(one, MethodFailure))
