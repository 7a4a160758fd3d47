"""`fit --windows`: which windows share one estimate, and what each of them says by itself."""

import argparse
from collections.abc import Sequence
from typing import Any

from accpinn.cli.options import (
    describe_errors,
    describe_intervals,
    describe_parameters,
    fields,
    incidents,
)
from accpinn.errors import ConfigError, SegmentError
from accpinn.evaluation.closed_loop import closed_loop_errors
from accpinn.methods.fit import Fit
from accpinn.recordings.recording import Recording, Window
from accpinn.results.tables.answer import own_windows_table
from accpinn.results.tables.estimates import joint_table
from accpinn.results.tables.table import Table
from accpinn.segment.cut import DURATION, disjoint_windows
from accpinn.study.plan import AUTO, car_following
from accpinn.study.result import Result

ALL = "all"


def check_windows_options(options: argparse.Namespace) -> None:
    """Refuse options that --windows has no use for.

    Raises:
        ConfigError: naming the option.
    """
    idle = [("start", 0.0)] + [("duration", DURATION)] * (options.windows != ALL)
    for name, default in idle:
        if getattr(options, name) != default:
            raise ConfigError(f"{name}: --windows says where windows lie; leave --{name} out.")


def chosen_windows(options: argparse.Namespace, recording: Recording) -> Sequence[Window]:
    """The windows that --windows names.

    Raises:
        SegmentError: where a recording has no complete one.
    """
    if options.windows == AUTO:
        return car_following(recording, options.vehicles)
    if options.windows != ALL:
        named: Sequence[Window] = options.windows
        return named
    windows = disjoint_windows(recording, options.duration, options.vehicles)
    if not windows:
        raise SegmentError(
            f"{recording.source}: --windows {ALL} finds no window of {options.duration:g} s without"
            " missing samples; choose a shorter --duration."
        )
    return windows


def describe_windows(result: Result) -> list[dict[str, Any]]:
    """What each of several windows says by itself."""
    pairs = zip(result.windows, result.fits, strict=True)
    return [_describe_window(window, together) for window, together in pairs]


def _describe_window(window: Result, together: Fit) -> dict[str, Any]:
    (segment,) = window.segments
    return {
        **fields(segment.window, "start", "duration"),
        **fields(segment, "source", "samples"),
        "parameters": describe_parameters(segment, window.parameters, window.fit.model),
        "intervals": describe_intervals(segment, window.uncertainty, window.fit.model),
        "log_likelihood": window.fit.loss.get("log_likelihood"),
        "closed_loop_mae": describe_errors(closed_loop_errors(segment, together)),
        "incidents": incidents(segment, together),
        "outcome": window.fit.outcome.name.lower(),
    }


def windows_tables(result: Result) -> list[Table]:
    """The method's estimate over all windows, and each window alone under the answer's model."""
    followers = range(1 if result.fit.case == "I" else result.info.followers)
    windows = (own_windows_table(result.infos, result.answer, k) for k in followers)
    return [joint_table(result), *windows]
