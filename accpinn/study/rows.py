"""One row a (recording, window, follower, method): its columns, and how a fit becomes rows."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from accpinn.channels import PARAMETER_KEYS
from accpinn.errors import ParameterError
from accpinn.evaluation.closed_loop import (
    TrackingErrors,
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
    collision_times,
    surrogate_errors,
)
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters
from accpinn.recordings.makes import make_and_model
from accpinn.recordings.recording import Recording, unnamed
from accpinn.segment.quality import assess_quality
from accpinn.segment.segment import Segment
from accpinn.stability.criteria import MARGINAL, checked, exact_margin, l2_margin, step_metrics
from accpinn.units import known_mean


@dataclass(frozen=True)
class RowColumn:
    """A column of the results: what stands in it."""

    name: str
    kind: str
    """"string", "bool", "int64" or "double"; any cell may be empty."""
    unit: str
    meaning: str


_column = RowColumn

_UNITS = dict(zip(PARAMETER_KEYS, ("1/s²", "1/s", "s"), strict=True))
_MEANINGS = dict(
    zip(PARAMETER_KEYS, ("gain on spacing", "gain on relative speed", "time headway"), strict=True)
)


def parameter_columns(source: str) -> tuple[RowColumn, ...]:
    """Those of α, β and τ, and of the ends of their intervals.

    Args:
        source: where the estimates come from, in a few words.
    """
    values = [
        _column(key, "double", _UNITS[key], f"{_MEANINGS[key]}, {source}") for key in PARAMETER_KEYS
    ]
    ends = [
        _column(f"{key}_{end}", "double", _UNITS[key], f"{word} end of the interval")
        for key in PARAMETER_KEYS
        for end, word in (("low", "lower"), ("high", "upper"))
    ]
    return (*values, *ends)


COLUMNS = (
    _column("campaign", "string", "", "campaign or data set"),
    _column("file", "string", "", "file name of the recording"),
    _column("trajectory", "string", "", "of a table with several: which one"),
    _column("sha256", "string", "", "of the recording"),
    _column("date", "string", "", "ISO 8601, from the header"),
    _column("start", "double", "s", "of the window, from the recording's first sample"),
    _column("duration", "double", "s", "of the window"),
    _column("vehicle", "int64", "", "the follower's number in the file, 1 = first"),
    _column("leader", "int64", "", "number of the chain's first vehicle, whose speed is given"),
    _column("name", "string", "", "the follower's, as in the header"),
    _column("make", "string", "", "in one spelling; empty where the file names no vehicles"),
    _column("model", "string", "", "in one spelling; empty where the header does not tell"),
    _column("distance_setting", "string", "", "as in the header"),
    _column("mode", "string", "", "ACC, or unknown where neither drivers nor flag tell"),
    _column("mode_source", "string", "", "what the mode rests on: driver, flag or nothing"),
    _column("method", "string", "", "key of the estimation method"),
    _column("case", "string", "", "I: one parameter set for all followers; II: one for each"),
    *parameter_columns("the method's estimate"),
    *(_column(f"{key}_error", "double", "",
              f"standard error of ln {key}: deviation of its posterior")
      for key in PARAMETER_KEYS),
    _column("level", "double", "", "how often the intervals cover the truth, if the model holds"),
    _column("l2_stable", "bool", "", "L₂ string stability of the estimate"),
    _column("linf_stable", "bool", "", "L∞ string stability of the estimate, exact criterion"),
    _column("linf_gain", "double", "", "‖h‖₁ of the estimate"),
    _column("p_l2_stable", "double", "", "posterior probability of L₂ string stability"),
    _column("p_linf_stable", "double", "", "posterior probability of L∞ string stability"),
    _column("mean_time_gap", "double", "s", "mean of p/v over the instants in motion"),
    _column("mean_speed", "double", "m/s", "the follower's"),
    _column("speed_deviation", "double", "m/s", "standard deviation of the follower's speed"),
    _column("surrogate_mae", "double", "m", "of the space-gap: the method's own trajectories"),
    _column("closed_loop_mae", "double", "m", "of the space-gap: simulation behind the leader"),
    _column("collision_time", "double", "s", "in that simulation, from the recording's start"),
    _column("outcome", "string", "", "how the estimation ended"),
    _column("seconds", "double", "s", "duration of the estimation for all followers together"),
)  # fmt: skip


@dataclass(frozen=True)
class RecordingFacts:
    """What rows say of a recording."""

    campaign: str | None
    file: str
    trajectory: str | None
    sha256: str
    date: str | None
    distance_setting: str | None

    @classmethod
    def of(cls, recording: Recording, file: str) -> "RecordingFacts":
        """Those of a recording."""
        return cls(
            campaign=recording.campaign,
            file=file,
            trajectory=recording.trajectory,
            sha256=recording.sha256,
            date=recording.date.isoformat() if recording.date else None,
            distance_setting=recording.distance_setting,
        )


def rows_of(
    segment: Segment,
    facts: RecordingFacts,
    modes: Sequence[str],
    fit: Fit,
    uncertainty: Uncertainty,
) -> list[dict[str, Any]]:
    """One row a follower, with the keys of `COLUMNS`; None where a value is unknown.

    Args:
        segment: the window, with M followers.
        facts: of its recording.
        modes: (M,) as `plan` gives them.
        fit: of one method.
        uncertainty: of the window.
    """
    own = assess_quality(segment)
    surrogate, simulated = surrogate_errors(segment, fit), closed_loop_errors(segment, fit)
    findings = closed_loop_findings(segment, closed_loop(segment, fit))
    collisions = collision_times(findings, segment.vehicles)
    speeds = segment.measured_speeds[:, 1:]
    mean_speeds = known_mean(speeds)
    errors = np.log(uncertainty.draws.values).std(axis=0)
    shared = vars(facts) | {
        "start": segment.window.start,
        "duration": segment.window.duration,
        "leader": segment.vehicles[0],
        "method": fit.method,
        "case": fit.case,
        "level": uncertainty.level,
        "outcome": fit.outcome.name.lower(),
        "seconds": fit.seconds,
    }
    rows = []
    for k, (number, name) in enumerate(zip(segment.vehicles[1:], segment.names[1:], strict=True)):
        make, model = ("", "") if name == unnamed(number) else make_and_model(name)
        mode, _, by_flag = modes[k].partition(" by ")
        source = "" if mode == "unknown" else by_flag or "driver"
        row = shared | {
            "vehicle": number,
            "name": name,
            "make": make,
            "model": model,
            "mode": mode,
            "mode_source": source,
            "p_l2_stable": uncertainty.probability_l2[k],
            "p_linf_stable": uncertainty.probability_linf[k],
            "mean_time_gap": own.mean_time_gap[k],
            "mean_speed": mean_speeds[k],
            "speed_deviation": float(np.nanstd(speeds[:, k])),
            "surrogate_mae": _gap_error(surrogate, k),
            "closed_loop_mae": _gap_error(simulated, k),
            "collision_time": collisions[k],
            **verdicts(fit.parameters[k]),
        }
        values = (fit.parameters, uncertainty.lower, uncertainty.upper)
        for i, key in enumerate(PARAMETER_KEYS):
            row[key], row[f"{key}_low"], row[f"{key}_high"] = (v.values[k, i] for v in values)
            row[f"{key}_error"] = errors[k, i]
        rows.append({column.name: plain(row[column.name]) for column in COLUMNS})
    return rows


def _gap_error(errors: TrackingErrors | None, follower: int) -> float | None:
    return None if errors is None else float(errors.gap_mae[follower])


def verdicts(parameters: Parameters) -> dict[str, Any]:
    """Verdicts as the command `stability` gives them; None where the parameters allow none."""
    try:
        clean = checked(parameters)
    except ParameterError:
        return {"l2_stable": None, "linf_stable": None, "linf_gain": None}
    return {
        "l2_stable": bool(np.where(clean.alpha > 0, l2_margin(clean), 0.0) >= -MARGINAL),
        "linf_stable": bool(exact_margin(clean) >= -MARGINAL),
        "linf_gain": float(step_metrics(clean).gain),
    }


def plain(value: Any) -> Any:
    """As JSON has it; what is not finite is unknown."""
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
