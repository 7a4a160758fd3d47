"""All methods on identical data, side by side, with errors and intervals that mean something."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from accpinn.errors import AccpinnError, ConfigError
from accpinn.evaluation.closed_loop import closed_loop_errors
from accpinn.evaluation.evaluation import Evaluation, evaluate
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.methods.fit import Fit, Outcome, ShouldStop
from accpinn.methods.method import TaskContext
from accpinn.methods.pinn.config import FAST, PinnConfig
from accpinn.methods.registry import METHODS
from accpinn.methods.store import Store
from accpinn.model.cthp import Case
from accpinn.recordings.recording import Recording
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.units import FloatArray


@dataclass(frozen=True, eq=False)
class MethodResult:
    """What one method says of a segment, and what that is worth."""

    fit: Fit
    uncertainty: Uncertainty
    evaluation: Evaluation


@dataclass(frozen=True)
class MethodFailure:
    """A method that has no row, and why."""

    method: str
    """From `METHODS`."""
    fault: AccpinnError

    @property
    def reason(self) -> str:
        """In a sentence."""
        return str(self.fault)


def result_of(segment: Segment, fit: Fit, recording: Recording | None = None) -> MethodResult:
    """A fit that is there already; no block is held out, as that would mean to train it anew."""
    return MethodResult(fit, intervals(segment, fit), evaluate(segment, fit, recording=recording))


@dataclass(frozen=True, eq=False)
class FitRecord:
    """A fit that is no longer current, without its data: enough to be held against another."""

    info: SegmentInfo
    method: str
    case: Case
    config: dict[str, Any]
    outcome: Outcome
    parameters: FloatArray
    """(M, 3) α, β, τ."""
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
            fit.parameters.values,
            gaps,
        )

    def same_as(self, other: "FitRecord") -> bool:
        """Whether both come from the same request."""
        return self.info.digest == other.info.digest and (
            (self.method, self.case, self.config) == (other.method, other.case, other.config)
        )

    def of_vehicle(self, number: int) -> FloatArray | None:
        """(3,) α, β, τ of the follower with that number in the file; None if it has none."""
        followers = self.info.vehicles[1:]
        return self.parameters[followers.index(number)] if number in followers else None


def differences(one: FitRecord, other: FitRecord) -> tuple[str, ...]:
    """What was asked differently in the two, a few words each; empty where nothing was."""
    return tuple(
        f"{name.replace('_', ' ')}: {before} → {after}"
        for name, before, after in (
            *_pairs(_asked(one), _asked(other)),
            *(_pairs(one.config, other.config) if one.method == other.method else ()),
        )
        if before != after
    )


def _asked(run: FitRecord) -> dict[str, str]:
    info = run.info
    return {
        "recording": info.source,
        "window": f"{info.window}",
        "vehicles": ", ".join(map(str, info.vehicles)),
        "left out": ", ".join(info.excluded_regimes) or "nothing",
        "case": run.case,
        "method": run.method,
    }


def _pairs(one: dict[str, Any], other: dict[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    for name in dict.fromkeys([*one, *other]):
        yield name, one.get(name, "–"), other.get(name, "–")


def parse_methods(text: str) -> tuple[str, ...]:
    """The methods of a text as "all" or "pinn,splines".

    Raises:
        ConfigError: for a method that is not known.
    """
    if text == "all":
        return tuple(METHODS)
    chosen = tuple(part.strip() for part in text.split(","))
    for name in chosen:
        if name not in METHODS:
            raise ConfigError(
                f'methods: "{name}" is not known; choose all or {", ".join(METHODS)}.'
            )
    return chosen


def compare(
    segment: Segment,
    case: Case = "II",
    methods: Sequence[str] = tuple(METHODS),
    *,
    config: PinnConfig = FAST,
    store: Store | None = None,
    threads: int | None = None,
    recording: Recording | None = None,
    should_stop: ShouldStop | None = None,
) -> Iterator[MethodResult | MethodFailure]:
    """Run the methods one by one; each row comes as soon as it is known.

    A method that cannot serve the segment gives a `Refusal` in place of its row.

    Args:
        segment: the data.
        case: "I" or "II".
        methods: names from `METHODS`.
        config: of the PiNN.
        store: where the PiNN's results are kept.
        threads: for the PiNN.
        recording: the segment's; with it the law is also tested on what lies outside the window.
        should_stop: asked between methods, and several times a second while the PiNN trains;
            True ends the iteration, and a method that was not finished has no row.
    """
    context = TaskContext(store=store, threads=threads, should_stop=should_stop)
    for name in methods:
        settings = config if METHODS[name].parse_settings else None
        estimate = partial(METHODS[name].fit, case=case, settings=settings, context=context)
        if should_stop and should_stop():
            return
        try:
            fit = estimate(segment)
            if should_stop and should_stop():
                return
            evaluation = evaluate(segment, fit, estimate, recording)
            if should_stop and should_stop():
                return
            row = MethodResult(fit, intervals(segment, fit), evaluation)
        except AccpinnError as fault:  # the others may well serve
            yield MethodFailure(name, fault)
        else:
            yield row


def results_among(results: Iterable[MethodResult | MethodFailure]) -> tuple[MethodResult, ...]:
    """What the methods say, without those that refused."""
    return tuple(result for result in results if isinstance(result, MethodResult))


def failures_among(results: Iterable[MethodResult | MethodFailure]) -> tuple[MethodFailure, ...]:
    """The methods that refused."""
    return tuple(result for result in results if isinstance(result, MethodFailure))
