"""The answer as a table: time gaps first, as the data determine them, then the parameters."""

from collections.abc import Sequence
from dataclasses import replace
from math import isnan

from accpinn.inference.answer import SPEEDS, Answer, Span
from accpinn.model import registry
from accpinn.model.cthp import Case
from accpinn.model.registry import CTHPS, FOLLOWING
from accpinn.results.tables import (
    Cell,
    Column,
    Filled,
    Marked,
    Range,
    Table,
    estimate_cells,
    estimates,
)
from accpinn.results.tables.estimates import (
    EVERY_FOLLOWER,
    marked_at_least,
    parameter_rows,
    row_labels,
    with_legend,
)
from accpinn.segment import SegmentInfo
from accpinn.units import MetresPerSecond

EXTRAPOLATED = "extrapolated: no window holds this speed"
ORDER = ("tau", "s0", "alpha", "beta", "lag", "delay")
"""Parameters of the CTHPs in the order in which they are shown."""


def columns_of(model: str) -> dict[str, Column]:
    """A model's own parameters by name, in the order in which they are shown."""
    columns = estimates.columns_of(model)
    names = filter(columns.get, ORDER) if model in CTHPS else FOLLOWING[model].names
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
    numbers, last = parameter_rows(info, case), answer.stated_speed
    followers, level = range(len(numbers)), f"({100 * answer.level:.0f} % interval)"
    gaps, own = f"Time gap {level}", f"Parameters {level}"
    one_more = f"Further window ({100 * answer.level:.0f} %)"
    at_median = Column("at median speed", "s", 2, gaps, key="time_gap_at_median_speed_s")
    further = [answer.time_gap(last, k) for k in followers]
    return Table.of(
        f"Answer: {registry.TITLES[answer.model]}, {counted_windows(answer)}",
        [
            (Column("Follower"), row_labels(info, numbers)),
            *((gap_column(speed, gaps, "at"),
               [gap_cell(answer.time_gap(speed, k), answer.is_driven(speed, k)) for k in followers])
              for speed in SPEEDS),
            (at_median, [answer.time_gap(float(answer.speeds[k]), k) for k in followers]),
            *((replace(column, group=own), [answer.span(name, k) for k in followers])
              for name, column in columns_of(answer.model).items()),
            (gap_column(last, one_more, key="further_"),
             [Range(span.further_lower, span.further_upper) for span in further]),
        ],
    )  # fmt: skip


def gap_cell(span: Span, is_driven: bool) -> Cell:
    """A time gap, marked where no window holds its speed."""
    return span if is_driven or isnan(span.value) else Marked(span, EXTRAPOLATED)


def own_windows_table(infos: Sequence[SegmentInfo], answer: Answer, follower: int) -> Table:
    """One row a window: what it alone says of one follower (0 for the first); below, the answer.

    The values are those of greatest likelihood, with their intervals.
    """
    speed = answer.stated_speed
    gaps = registry.time_gap(answer.model, answer.windows, speed)[:, follower]
    alone = estimate_cells(gaps, *answer.windows_gap[:, :, follower])
    filled: list[Filled] = [
        (Column("Window"), [*(str(info.window) for info in infos), "Answer"]),
        (gap_column(speed), [*alone, answer.time_gap(speed, follower)]),
    ]
    parts = (answer.windows, answer.windows_lower, answer.windows_upper)
    group = f"Estimate ({100 * answer.level:.0f} % interval)"
    for name, column in columns_of(answer.model).items():
        sets = zip(*(part[:, follower] for part in parts), strict=True)
        cells = [marked_at_least(answer.model, name, *ends) for ends in sets]
        filled.append((replace(column, group=group), [*cells, answer.span(name, follower)]))
    is_shared = infos[0].followers > len(answer.trust)
    label = EVERY_FOLLOWER if is_shared else infos[0].labels[follower + 1]
    title = f"{label}: {registry.TITLES[answer.model]}, each window alone, and the answer"
    return with_legend(title, filled)
