"""`fit --windows`: one parameter set over several windows of a recording."""

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np

from accpinn.channels import by_key
from accpinn.cli.options import (
    chosen_analysis,
    chosen_store,
    describe_errors,
    describe_interval_ends,
    describe_parameters,
    describe_segment,
    fields,
    incidents,
)
from accpinn.cli.output import show_result
from accpinn.cli.recording import chosen_recording
from accpinn.errors import ConfigError, SegmentError
from accpinn.evaluation.closed_loop import TrackingErrors, closed_loop_errors, surrogate_errors
from accpinn.findings import Finding
from accpinn.methods.fit import Fit
from accpinn.methods.maximum_likelihood import KEY
from accpinn.recordings.recording import Recording, Window
from accpinn.results.messages import messages
from accpinn.results.tables.estimates import between_table, joint_table, windows_table
from accpinn.segment.cut import DURATION, disjoint_windows
from accpinn.segment.quality import assess_quality
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.study.windows import (
    BetweenWindows,
    RandomEffects,
    between_windows,
    differing_windows,
    log_errors,
)

ALL = "all"
EFFECTS = ("windows", "mean", "error", "deviation", "q", "probability", "i_squared")


def run_windows(options: argparse.Namespace) -> int:
    """Estimate from all windows together and from each, and print both."""
    _check(options)
    windows = _windows(chosen_recording(options), options)
    analysis, recording = chosen_analysis(options, KEY, windows=windows)
    result = run(analysis, recording, store=chosen_store(options))
    show_result(options, describe_joint, joint_text, result, between_windows(result))
    return 0


def _check(options: argparse.Namespace) -> None:
    """Refuse options that --windows has no use for."""
    if options.method != KEY:
        raise ConfigError(
            f"windows: only --method {KEY} estimates from several windows, {options.method} does"
            " not; choose that method, or leave --windows out."
        )
    if options.out is not None:
        raise ConfigError("out: a snapshot holds one window; leave --out or --windows out.")
    idle = [("start", 0.0)] + [("duration", DURATION)] * (options.windows != ALL)
    for name, default in idle:
        if getattr(options, name) != default:
            raise ConfigError(f"{name}: --windows says where windows lie; leave --{name} out.")
    if options.windows != ALL and len(options.windows) < 2:
        only = options.windows[0]
        raise ConfigError(
            f"windows: {only} is one window; give at least two, as 0-300,600-900, or use"
            f" --start {only.start:g} --duration {only.duration:g}."
        )


def _windows(recording: Recording, options: argparse.Namespace) -> Sequence[Window]:
    if options.windows != ALL:
        chosen: Sequence[Window] = options.windows
        return chosen
    windows = disjoint_windows(recording, options.duration, options.vehicles)
    if len(windows) < 2:
        raise SegmentError(
            f"{recording.source}: --windows {ALL} finds {len(windows) or 'no'}"
            f" window{'s' * (not windows)} of {options.duration:g} s without missing samples, and"
            " at least two are needed; choose a shorter --duration."
        )
    return windows


def describe_joint(result: Result, between: Sequence[BetweenWindows]) -> dict[str, Any]:
    """The result with the keys of `fit`, and what each window says.

    Samples and durations of the segment are sums over the windows, errors are means over their
    samples.
    """
    fit, first = result.fit, result.segments[0]
    pairs = list(zip(result.segments, result.fits, strict=True))
    samples = [segment.samples for segment in result.segments]
    gaps = [assess_quality(segment).mean_time_gap for segment in result.segments]
    return {
        **fields(fit, "method", "case", "loss", "network_weights", "iterations", "cached"),
        "seconds": fit.seconds,
        "preset": None,
        "seed": None,
        "segment": describe_segment(first)
        | {
            "duration": round(sum(info.window.duration for info in result.infos), 6),
            "samples": sum(samples),
        },
        "parameters": describe_parameters(first, result.parameters),
        "intervals": describe_interval_ends(first, result.uncertainty),
        "level": result.uncertainty.level,
        "unconstrained": describe_parameters(first, fit.unconstrained),
        "active_bounds": fit.active_bounds,
        "mae": _mean_errors(samples, [surrogate_errors(*pair) for pair in pairs]),
        "closed_loop_mae": _mean_errors(samples, [closed_loop_errors(*pair) for pair in pairs]),
        "mean_time_gap": np.average(gaps, axis=0, weights=samples).tolist(),
        "outcome": fit.outcome.name.lower(),
        "outcome_sentence": fit.outcome.value,
        "windows": [
            _describe_window(window, together)
            for window, together in zip(result.windows, result.fits, strict=True)
        ],
        "between_windows": [
            {
                "vehicle": follower.vehicle,
                "name": name,
                **by_key(map(_describe_effect, follower.effects)),
            }
            for follower, name in zip(between, first.names[1:], strict=True)
        ],
        "notes": _notes(result, between),
    }


def _describe_window(window: Result, together: Fit) -> dict[str, Any]:
    (segment,) = window.segments
    return {
        **fields(segment.window, "start", "duration"),
        **fields(segment, "source", "samples"),
        "parameters": describe_parameters(segment, window.parameters),
        "standard_errors": [
            {"vehicle": vehicle, **by_key(row)}
            for vehicle, row in zip(segment.vehicles[1:], log_errors(window).tolist(), strict=True)
        ],
        "intervals": describe_interval_ends(segment, window.uncertainty),
        "log_likelihood": window.fit.loss["log_likelihood"],
        "closed_loop_mae": describe_errors(closed_loop_errors(segment, together)),
        "incidents": incidents(segment, together),
        "outcome": window.fit.outcome.name.lower(),
    }


def _describe_effect(effect: RandomEffects) -> dict[str, Any]:
    return {
        **fields(effect, *EFFECTS),
        "median": effect.typical,
        "deviation_interval": [effect.lower, effect.upper],
        "further_window": list(effect.further),
    }


def _mean_errors(
    samples: Sequence[int], errors: Sequence[TrackingErrors | None]
) -> dict[str, list[float]] | None:
    """Mean absolute errors over all samples; None where a window has none."""
    known = [one for one in errors if one is not None]
    if len(known) < len(errors):
        return None
    return {
        key: np.average([getattr(one, name) for one in known], axis=0, weights=samples).tolist()
        for key, name in (("v", "speed_mae"), ("p", "gap_mae"))
    }


def joint_text(result: Result, between: Sequence[BetweenWindows]) -> str:
    """The result as tables and sentences."""
    shown = between[:1] if result.fit.case == "I" else between
    tables = [
        joint_table(result),
        *(windows_table(result, k) for k in range(len(between))),
        *(between_table(result, follower) for follower in shown),
    ]
    effort = f"{result.fit.iterations} iterations, {result.fit.seconds:.1f} s in all"
    said = [f"{result.fit.outcome.value} ({effort})", *_incidents_of(result)]
    notes = [f"Note: {note}" for note in _notes(result, between)]
    return "\n".join(["\n\n".join(table.to_text() for table in tables), "", *said, *notes])


def _incidents_of(result: Result) -> list[str]:
    return [
        sentence
        for segment, fit in zip(result.segments, result.fits, strict=True)
        for sentence in incidents(segment, fit)
    ]


def _notes(result: Result, between: Sequence[BetweenWindows]) -> tuple[str, ...]:
    """What was done to the data, each sentence once, then what the windows show."""
    done = [said for info in result.infos for said in messages(info.findings, info)]
    findings: list[Finding] = [*result.fit.findings, *result.uncertainty.findings]
    findings += differing_windows(between, result.fit.case)
    return tuple(dict.fromkeys([*done, *messages(findings, result.info)]))
