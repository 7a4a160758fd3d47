"""What each follower does when, and how much the estimates depend on it, as tables."""

from collections.abc import Sequence

from accpinn.results.tables.names import TITLES
from accpinn.results.tables.results import PARAMETER_COLUMNS, where
from accpinn.results.tables.table import Cell, Column, Table
from accpinn.segment.regimes import Regimes
from accpinn.segment.segment import Segment
from accpinn.study.sensitivity import COMPARED, SensitivityResult


def regimes_table(segment: Segment, regimes: Regimes) -> Table:
    """One row a follower: its share of instants in each regime."""
    columns = (Column("Follower"), *(Column(name.capitalize(), "%", 0) for name in regimes.names))
    rows: list[tuple[Cell, ...]] = [
        (name, *(100 * share for share in shares))
        for name, shares in zip(segment.labels[1:], regimes.shares, strict=True)
    ]
    return Table(f"Regimes, {where(segment.info)}", columns, tuple(rows))


def sensitivity_table(segment: Segment, found: Sequence[SensitivityResult], follower: int) -> Table:
    """One row for each choice of instants; what each method learns of one follower from them."""
    columns = [Column("Instants"), Column("Left out", "%", 0)]
    for method in COMPARED:
        columns += [Column(c.title, c.unit, c.digits, TITLES[method]) for c in PARAMETER_COLUMNS]
    cells: dict[str, list[Cell]] = {}
    for row in found:
        line = cells.setdefault(row.choice, [row.choice.capitalize(), 100 * row.share[follower]])
        law = row.parameters[follower] if row.parameters else None
        line += [law.alpha, law.beta, law.tau] if law else [None] * 3
    title = f"{segment.labels[follower + 1]}, {where(segment.info)}"
    return Table(title, tuple(columns), tuple(tuple(line) for line in cells.values()))
