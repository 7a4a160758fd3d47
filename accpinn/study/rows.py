"""One row a (recording, window, follower, method): its columns, and how a result becomes rows."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from accpinn.channels import PARAMETER_KEYS, by_key
from accpinn.evaluation.closed_loop import TrackingErrors, collision_times
from accpinn.methods.registry import variant_name
from accpinn.model.registry import FOLLOWING, SHIPPED
from accpinn.recordings import unnamed
from accpinn.recordings.openacc import make_and_model
from accpinn.storage import packaged_rows
from accpinn.study.description import describe
from accpinn.study.result import Result
from accpinn.units import nanmean


@dataclass(frozen=True)
class RowColumn:
    """A column of the results: what stands in it."""

    name: str
    kind: str
    """"string", "bool", "int64" or "double"; any cell may be empty."""
    unit: str
    meaning: str


FURTHER = {
    p.name: p.unit
    for key, model in FOLLOWING.items()
    for p in model.parameters
    if key in SHIPPED and p.name not in PARAMETER_KEYS
}
"""The parameters that a model may have beside α, β and τ, with their units; of a registered model
rows have the linearisation alone."""


def _columns() -> Iterator[RowColumn]:
    for cells in packaged_rows("study", "columns.csv"):
        is_template = "{name}" in cells["name"]
        for name, unit in FURTHER.items() if is_template else [("", "")]:
            yield RowColumn(*(cell.format(name=name, unit=unit) for cell in cells.values()))


COLUMNS: tuple[RowColumn, ...] = tuple(_columns())


def rows_of(
    result: Result, recording: Mapping[str, Any], mode_sources: tuple[str, ...]
) -> list[dict[str, Any]]:
    """One row a follower, with the keys of `COLUMNS`; None where a value is unknown.

    Args:
        result: of one window.
        recording: what is known of the recording: its facts, file, trajectory and SHA-256.
        mode_sources: (M,) as `plan` gives them.
    """
    estimate, uncertainty, evaluation = result.estimate, result.uncertainty, result.evaluation
    description = describe(result)
    (segment,) = result.segments
    collisions = collision_times(evaluation.findings, segment.vehicles)
    speeds = segment.measured_speeds[:, 1:]
    mean_speeds = nanmean(speeds)
    shared = {
        **recording,
        "start": segment.window.start,
        "duration": segment.window.duration,
        "leader": segment.vehicles[0],
        "method": variant_name(estimate.method, estimate.settings),
        "case": estimate.case,
        "following_model": estimate.model,
        "level": estimate.level,
        "outcome": estimate.outcome.name.lower(),
        "seconds": estimate.seconds,
    }
    lacking = description.vehicles.l2_margins
    rows = []
    for k, (number, name) in enumerate(zip(segment.vehicles[1:], segment.names[1:], strict=True)):
        make, model = ("", "") if name == unnamed(number) else make_and_model(name)
        stability = description.vehicles.assessed[k]
        verdicts = stability.stability
        row = shared | {
            "vehicle": number,
            "name": name,
            "make": make,
            "model": model,
            "mode": "ACC" if mode_sources[k] else "unknown",
            "mode_source": mode_sources[k],
            "p_l2_stable": stability.l2.probability,
            "p_linf_stable": stability.linf.probability,
            "l2_stable": verdicts and verdicts.l2.stable,
            "linf_stable": verdicts and verdicts.linf_exact.stable,
            "linf_gain": verdicts and verdicts.linf_gain,
            **{
                name: estimate.values(estimate.parameters, name)[k]
                if name in estimate.names
                else None
                for name in FURTHER
            },
            "mean_time_gap": result.quality.mean_time_gap[k],
            "mean_speed": mean_speeds[k],
            "median_speed": estimate.speeds[k],
            "lowest_speed": float(np.nanmin(speeds[:, k])),
            "highest_speed": float(np.nanmax(speeds[:, k])),
            "speed_deviation": float(np.nanstd(speeds[:, k])),
            "surrogate_mae": _gap_error(evaluation.surrogate, k),
            "closed_loop_mae": _gap_error(evaluation.closed_loop, k),
            "collision_time": collisions[k],
            **{
                f"margin_l2{ending}": getattr(lacking[k].distance, name)
                for ending, name in (("", "value"), ("_low", "lower"), ("_high", "upper"))
            },
        }
        for ending, values in (
            ("", estimate.parameters[k].values),
            ("_low", uncertainty.lower[k].values if uncertainty else [None] * 3),
            ("_high", uncertainty.upper[k].values if uncertainty else [None] * 3),
        ):
            row |= {f"{key}{ending}": value for key, value in by_key(values).items()}
        rows.append({column.name: _plain(row[column.name]) for column in COLUMNS})
    return rows


def _gap_error(errors: TrackingErrors | None, follower: int) -> float | None:
    return None if errors is None else float(errors.gap_mae[follower])


def _plain(value: Any) -> Any:
    """As JSON has it; what is not finite is unknown."""
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
