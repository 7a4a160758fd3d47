"""One parameter set for all windows of a vehicle with one setting, under one likelihood.

The log-likelihoods of disjoint windows add up (see `study.windows`), whatever recordings they are
cut from, as long as the vehicle, its setting and the sampling are the same. The intervals assume
that the windows share their parameters; where these differ by more than sampling error, the
between-window deviation, which is given beside them, says how much a further window may differ.
"""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from accpinn.channels import PARAMETER_KEYS, by_key
from accpinn.errors import ConfigError
from accpinn.inference.intervals import intervals
from accpinn.methods.maximum_likelihood import KEY, fit_among
from accpinn.recordings.recording import unnamed
from accpinn.segment.segment import Segment
from accpinn.study.rows import (
    COLUMNS,
    VERDICTS,
    RowColumn,
    estimate_cells,
    parameter_columns,
    plain,
    verdicts,
)
from accpinn.study.windows import check_windows, random_effects

SHARED = ("campaign", "name", "make", "model", "distance_setting", "mode")
"""What all windows of a vehicle with one setting have in common."""
ONE_RECORDING = ("sha256", "vehicle")
"""The same where the name does not tell vehicles apart: where it is given by number alone, or where
several vehicles of a recording have it."""

_OF_ROWS = {column.name: column for column in COLUMNS}
POOLED_COLUMNS = (
    _OF_ROWS["campaign"],
    _OF_ROWS["name"],
    RowColumn("make", "string", "", "in one spelling"),
    _OF_ROWS["model"],
    _OF_ROWS["distance_setting"],
    _OF_ROWS["mode"],
    RowColumn("sha256", "string", "", "of the recording, where the name tells no vehicles apart"),
    RowColumn("vehicle", "int64", "", "its number there; empty where the name does"),
    RowColumn("windows", "int64", "", "how many share the parameters"),
    RowColumn("recordings", "int64", "", "that they are cut from"),
    RowColumn("duration", "double", "s", "of all windows together"),
    *parameter_columns("by the joint likelihood"),
    *(
        RowColumn(f"{key}_deviation", "double", "", f"of ln {key} between windows")
        for key in PARAMETER_KEYS
    ),
    RowColumn("level", "double", "", "how often the intervals cover the truth, if windows agree"),
    *(_OF_ROWS[name] for name in (*VERDICTS, "p_l2_stable", "p_linf_stable")),
)
"""One row a vehicle and setting."""


@dataclass(frozen=True)
class PoolWindow:
    """Where one window of a vehicle lies."""

    sha256: str
    """Of the recording."""
    vehicle: int
    start: float
    duration: float


@dataclass(frozen=True)
class Pool:
    """The windows of a vehicle with one setting."""

    shared: dict[str, Any]
    """With the keys of `SHARED` and `ONE_RECORDING`."""
    windows: tuple[PoolWindow, ...]
    deviations: tuple[float, ...]
    """Between windows, of ln α, ln β and ln τ."""

    @property
    def key(self) -> str:
        """A digest of what determines the result."""
        content = [sorted(vars(one).values(), key=str) for one in self.windows]
        text = json.dumps([self.shared, sorted(content, key=str)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:32]


def pools(rows: Iterable[dict[str, Any]]) -> tuple[Pool, ...]:
    """The vehicles and settings with two windows or more, of the rows by maximum likelihood."""
    found: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in rows:
        if row["method"] == KEY and row["alpha_error"] is not None:
            needed = (*SHARED, *PoolWindow.__annotations__, *PARAMETER_KEYS)
            errors = [f"{key}_error" for key in PARAMETER_KEYS]
            kept = {name: row[name] for name in (*needed, *errors)}
            found.setdefault(tuple(row[name] for name in SHARED), []).append(kept)
    return tuple(
        Pool(
            dict(zip((*SHARED, *ONE_RECORDING), (*key, *place), strict=True)),
            tuple(PoolWindow(*(o[n] for n in PoolWindow.__annotations__)) for o in own),
            tuple(_deviation(own, name) for name in PARAMETER_KEYS),
        )
        for key, members in found.items()
        for place, own in _apart(members).items()
        if len(own) > 1
    )


def _apart(members: list[dict[str, Any]]) -> dict[tuple[Any, ...], list[dict[str, Any]]]:
    """The windows of each vehicle, by `ONE_RECORDING`; all of them where they are of one."""
    places: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for one in members:
        places.setdefault(tuple(one[name] for name in ONE_RECORDING), []).append(one)
    several = len(places) > len({recording for recording, _ in places})
    unknown = members[0]["name"] == unnamed(members[0]["vehicle"])
    return places if several or unknown else {(None, None): members}


def _deviation(members: list[dict[str, Any]], name: str) -> float:
    values = np.array([one[name] or np.nan for one in members], float)
    return random_effects(
        np.log(values), [one[f"{name}_error"] or np.nan for one in members]
    ).deviation


def pooled_row(pool: Pool, segments: tuple[Segment, ...]) -> dict[str, Any]:
    """The row of a vehicle, on a worker.

    Args:
        pool: the vehicle.
        segments: (K,) of it and the vehicle ahead.

    Raises:
        SegmentError: where one likelihood cannot hold all windows.
        ConfigError: where the vehicle does not move.
    """
    segments = tuple(replace(one) for one in segments)
    check_windows(segments, "II")
    fit = fit_among(segments, segments[0], "II")
    known = intervals(segments, fit)
    if np.isnan(known.centre.alpha).any():
        raise ConfigError("nothing determines the parameters.")
    row: dict[str, Any] = pool.shared | {
        "windows": len(segments),
        "recordings": len({one.sha256 for one in segments}),
        "duration": sum(one.window.duration for one in segments),
        "level": known.level,
        "p_l2_stable": known.probability_l2[0],
        "p_linf_stable": known.probability_linf[0],
        **verdicts(fit.parameters[0]),
    }
    row |= estimate_cells(fit.parameters[0], known, 0)
    row |= {f"{key}_deviation": value for key, value in by_key(pool.deviations).items()}
    return {column.name: plain(row[column.name]) for column in POOLED_COLUMNS}
