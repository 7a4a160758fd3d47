"""The answer as a table: time gaps first, as the data determine them, then the parameters."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from accpinn.inference.answer import SPEEDS, Answer
from accpinn.model import registry
from accpinn.model.cthp import Case
from accpinn.model.registry import CTHPS
from accpinn.results.tables import Column, Filled, Range, Table, estimate_cells, estimates
from accpinn.results.tables.estimates import parameter_rows, row_labels
from accpinn.segment.segment import SegmentInfo
from accpinn.units import MetresPerSecond

ORDER = ("tau", "s0", "alpha", "beta", "lag", "delay")
"""Parameters of the CTHPs in the order in which they are shown."""


def columns_of(model: str) -> dict[str, Column]:
    """The parameters of a model by their names, in the order in which they are shown."""
    columns = {column.key: column for _, column in estimates.columns_of(model)}
    names = [name for name in ORDER if name in columns] if model in CTHPS else [*columns][3:]
    return {name: columns[name] for name in names}


def gap_column(
    speed: MetresPerSecond, group: str = "", title: str = "Time gap at", key: str = ""
) -> Column:
    """The time gap in equilibrium at a speed; ``key`` goes before its name in CSV files."""
    at = f"{speed * 3.6:.0f}"
    return Column(f"{title} {at} km/h", "s", 2, group, key=f"{key}time_gap_at_{at}_kmh_s")


def counted_windows(answer: Answer) -> str:
    """As "one window" or "3 windows"."""
    count = len(answer.windows)
    return "one window" if count == 1 else f"{count} windows"


def answer_table(info: SegmentInfo, answer: Answer, case: Case = "II") -> Table:
    """One row a follower, or one for all that share their parameters.

    The columns are time gaps in equilibrium and parameters, with intervals. The last column is the
    interval of the time gap in a further window of the same car.
    """
    numbers = parameter_rows(info, case)
    level, last = f"Typical value ({100 * answer.level:.0f} % interval)", answer.stated_speed
    spans = [
        (gap_column(speed, level), [answer.time_gap(speed, k) for k in range(len(numbers))])
        for speed in SPEEDS
    ]
    further = dict(zip(SPEEDS, spans, strict=True))[last][1]
    for name, column in columns_of(answer.model).items():
        own = [answer.span(name, k) for k in range(len(numbers))]
        spans.append((replace(column, group=level), own))
    return Table.of(
        f"Answer: {registry.TITLES[answer.model]}, {counted_windows(answer)}",
        [
            (Column("Follower"), row_labels(info, numbers)),
            *spans,
            (gap_column(last, "Further window", key="further_"),
             [Range(s.further_lower, s.further_upper) for s in further]),
        ],
    )  # fmt: skip


def own_windows_table(infos: Sequence[SegmentInfo], answer: Answer, follower: int) -> Table:
    """One row a window: what it alone says of one follower (0 for the first).

    The time gap is that of the estimates of greatest likelihood, which stand beside it with their
    intervals.
    """
    speed = answer.stated_speed
    gaps = registry.time_gap(answer.model, answer.windows, speed)[:, follower]
    filled: list[Filled] = [
        (Column("Window"), [str(info.window) for info in infos]),
        (gap_column(speed), gaps.tolist()),
    ]
    parts = (answer.windows, answer.windows_lower, answer.windows_upper)
    how = "Maximum likelihood" if answer.model in CTHPS else "Closed-loop simulation"
    group = f"{how} ({100 * answer.level:.0f} % interval)"
    for name, column in columns_of(answer.model).items():
        value, low, high = (answer.values(part, name)[:, follower] for part in parts)
        ends = np.minimum(value, low), np.maximum(value, high)
        filled.append((replace(column, group=group), estimate_cells(value, *ends)))
    label = infos[0].labels[follower + 1]
    return Table.of(f"{label}: {registry.TITLES[answer.model]}, each window alone", filled)
