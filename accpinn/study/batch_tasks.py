"""The tasks of a batch, and what workers make of them.

A task carries its data; workers need the package, but no access to the files.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

from accpinn.errors import AccpinnError
from accpinn.inference.intervals import intervals
from accpinn.methods.maximum_likelihood import KEY
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.segment.segment import Segment
from accpinn.study.pooling import Pool, pooled_row
from accpinn.study.rows import rows_of
from accpinn.units import Seconds


class Place(NamedTuple):
    """Where a planned window lies; that of uneven steps may be cut a little shorter."""

    sha256: str
    """Of the recording."""
    vehicles: tuple[int, ...]
    start: Seconds
    duration: Seconds


@dataclass(frozen=True, eq=False)
class BatchTask:
    """One window of a chain of vehicles, ready to be sent to a worker."""

    key: str
    place: Place
    segment: Segment
    recording: dict[str, Any]
    """What rows say of it."""
    modes: tuple[str, ...]
    """(M,) as `plan` gives them."""
    case: Case
    methods: tuple[str, ...]
    """Those that have no result yet."""


@dataclass(frozen=True, eq=False)
class PoolTask:
    """All windows of a vehicle with one setting, ready to be sent to a worker."""

    key: str
    pool: Pool
    segments: tuple[Segment, ...]
    """(K,) of the vehicle and the one ahead."""


@dataclass(frozen=True)
class MethodRows:
    """What one method made of a task, on a worker."""

    method: str
    rows: list[dict[str, Any]]
    """One a follower, or one for all windows of a vehicle; empty where it failed."""
    reason: str = ""
    """Why it failed."""
    final: bool = True
    """Whether it would fail again."""


def run_task(task: BatchTask) -> list[MethodRows]:
    """All methods of a task, on a worker; one that fails does not stop the others."""
    segment = replace(task.segment)  # arrays of one's own: those received may lie anyhow in memory

    def rows(key: str) -> list[dict[str, Any]]:
        fit = METHODS[key].fit(segment, task.case, None, TaskContext(threads=1))
        return rows_of(segment, task.recording, task.modes, fit, intervals(segment, fit))

    return [_tried(key, partial(rows, key)) for key in task.methods]


def run_pool(task: PoolTask) -> MethodRows:
    """The pooled parameters of a vehicle, on a worker."""
    return _tried(KEY, lambda: [pooled_row(task.pool, task.segments)])


def _tried(method: str, rows: Callable[[], list[dict[str, Any]]]) -> MethodRows:
    try:
        return MethodRows(method, rows())
    except AccpinnError as fault:
        return MethodRows(method, [], str(fault))
    except Exception as fault:  # a fault of the program, told and tried again another time
        return MethodRows(method, [], f"{type(fault).__name__}: {fault}", final=False)
