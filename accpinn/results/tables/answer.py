"""The answer as a table: time gaps first, as the data determine them, then the parameters."""

from accpinn.channels import ALPHA, BETA, TAU
from accpinn.inference.answer import SPEEDS, Answer, Span
from accpinn.model import models
from accpinn.results.tables.table import Column, Estimate, Filled, Range, Table
from accpinn.segment.segment import SegmentInfo

COLUMNS: dict[str, Column] = {
    "tau": Column.of(TAU, key="tau"),
    "s0": Column("s₀", "m", 1),
    "alpha": Column.of(ALPHA, key="alpha"),
    "beta": Column.of(BETA, key="beta"),
    "lag": Column("λ", "s", 2),
    "delay": Column("d", "s", 2),
}
"""Parameters in the order in which they are shown, by their names in `Parameters`."""


def answer_table(info: SegmentInfo, answer: Answer) -> Table:
    """One row a follower: time gaps in equilibrium and parameters, with intervals.

    The last column is the interval of the time gap in a further window of the same car.
    """
    followers = range(info.followers)

    def cells(spans: list[Span]) -> list[Estimate]:
        return [Estimate(span.value, span.lower, span.upper) for span in spans]

    level = f"{100 * answer.level:.0f} % interval as the typical value"
    gaps = {speed: [answer.time_gap(speed, k) for k in followers] for speed in SPEEDS}
    filled: list[Filled] = [(Column("Follower"), list(info.labels[1:]))]
    filled += [
        (Column(f"Time gap at {speed * 3.6:.0f} km/h", "s", 2, level), cells(spans))
        for speed, spans in gaps.items()
    ]
    for name, column in COLUMNS.items():
        if name in answer.names:
            spans = [answer.span(name, k) for k in followers]
            filled.append((Column(column.title, column.unit, column.digits, level), cells(spans)))
    last = SPEEDS[-1]
    further = [Range(s.further_lower, s.further_upper) for s in gaps[last]]
    filled.append((Column(f"at {last * 3.6:.0f} km/h in a further window", "s", 2), further))
    count = len(answer.windows)
    windows = "one window" if count == 1 else f"{count} windows"
    return Table.of(f"Answer: {models.TITLES[answer.model]}, {windows}", filled)
