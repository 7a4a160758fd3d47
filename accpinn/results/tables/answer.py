"""The answer as a table: time gaps first, as the data determine them, then the parameters."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from accpinn.inference.answer import SPEEDS, Answer
from accpinn.model import registry
from accpinn.model.cthp import Case
from accpinn.model.registry import CTHPS
from accpinn.results.tables import estimates
from accpinn.results.tables.estimates import (
    EVERY_FOLLOWER,
    PARAMETER_COLUMNS,
    TERM_COLUMNS,
    parameter_rows,
)
from accpinn.results.tables.table import (
    Column,
    Filled,
    Range,
    Table,
    estimate_cells,
)
from accpinn.segment.segment import SegmentInfo
from accpinn.units import MetresPerSecond

ORDER = ("tau", "s0", "alpha", "beta", "lag", "delay")
_COLUMNS = {column.key: column for column in (*PARAMETER_COLUMNS, *TERM_COLUMNS)}
COLUMNS = {name: replace(_COLUMNS[name], key="") for name in ORDER}
"""Parameters of the CTHPs by name, in the order in which they are shown."""


def columns_of(model: str) -> dict[str, Column]:
    """The parameters of a model by their names, in the order in which they are shown."""
    columns = {column.key: column for _, column in estimates.columns_of(model)}
    names = [name for name in ORDER if name in columns] if model in CTHPS else [*columns][3:]
    return {name: columns[name] for name in names}


def answer_table(info: SegmentInfo, answer: Answer, case: Case = "II") -> Table:
    """One row a follower, or one for all that share their parameters.

    The columns are time gaps in equilibrium and parameters, with intervals. The last column is the
    interval of the time gap in a further window of the same car.
    """
    numbers = parameter_rows(info, case)
    labels = [info.label(number) if number else EVERY_FOLLOWER for number in numbers]
    followers = range(len(numbers))

    level = f"Typical value ({100 * answer.level:.0f} % interval)"
    gaps = {speed: [answer.time_gap(speed, k) for k in followers] for speed in SPEEDS}
    filled: list[Filled] = [(Column("Follower"), labels)]
    filled += [
        (
            Column(f"Time gap at {speed * 3.6:.0f} km/h", "s", 2, level, key=_gap_key(speed)),
            spans,
        )
        for speed, spans in gaps.items()
    ]
    for name, column in columns_of(answer.model).items():
        spans = [answer.span(name, k) for k in followers]
        filled.append((replace(column, group=level, key=name), spans))
    last = answer.stated_speed
    further = [Range(s.further_lower, s.further_upper) for s in gaps[last]]
    title, group = f"Time gap at {last * 3.6:.0f} km/h", "Further window"
    filled.append((Column(title, "s", 2, group, key=f"further_{_gap_key(last)}"), further))
    count = len(answer.windows)
    windows = "one window" if count == 1 else f"{count} windows"
    return Table.of(f"Answer: {registry.TITLES[answer.model]}, {windows}", filled)


def _gap_key(speed: MetresPerSecond) -> str:
    """The name of a time gap in CSV files."""
    return f"time_gap_at_{speed * 3.6:.0f}_kmh_s"


def own_windows_table(infos: Sequence[SegmentInfo], answer: Answer, follower: int) -> Table:
    """One row a window: what it alone says of one follower (0 for the first).

    The time gap is that of the estimates of greatest likelihood, which stand beside it with their
    intervals.
    """
    speed = answer.stated_speed
    gaps = registry.time_gap(answer.model, answer.windows, speed)[:, follower]
    filled: list[Filled] = [
        (Column("Window"), [str(info.window) for info in infos]),
        (Column(f"Time gap at {speed * 3.6:.0f} km/h", "s", 2), gaps.tolist()),
    ]
    parts = (answer.windows, answer.windows_lower, answer.windows_upper)
    how = "Maximum likelihood" if answer.model in CTHPS else "Closed-loop simulation"
    group = f"{how} ({100 * answer.level:.0f} % interval)"
    for name, column in columns_of(answer.model).items():
        value, low, high = (answer.values(part, name)[:, follower] for part in parts)
        ends = np.minimum(value, low), np.maximum(value, high)
        shown = replace(column, group=group, key=name)
        filled.append((shown, estimate_cells(value, *ends)))
    label = infos[0].labels[follower + 1]
    return Table.of(f"{label}: {registry.TITLES[answer.model]}, each window alone", filled)
