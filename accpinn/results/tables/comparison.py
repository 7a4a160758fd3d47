"""All methods side by side: estimates with errors of each kind, and what the recording allows."""

from collections.abc import Sequence

from accpinn.inference.intervals import Uncertainty
from accpinn.results.tables.names import name_of
from accpinn.results.tables.results import (
    PARAMETER_COLUMNS,
    interval_cells,
    interval_columns,
    where,
)
from accpinn.results.tables.table import Cell, Column, Table
from accpinn.segment.segment import SegmentInfo
from accpinn.study.comparison import MethodResult

GAP = "MAE of the space-gap"


def methods_table(segment: SegmentInfo, rows: Sequence[MethodResult], follower: int) -> Table:
    """One row a method, for one follower (0 for the first)."""
    columns = (
        Column("Method"),
        *PARAMETER_COLUMNS,
        Column("Surrogate fit", "m", 3, GAP),
        Column("Closed loop", "m", 2, GAP),
        Column("Held out", "m", 2, GAP),
        Column("Unseen rest", "m", 2, GAP),
        Column("Collides at", "s", 1),
        Column("Time", "s", 2, least=True),
    )
    cells: list[tuple[Cell, ...]] = []
    for row in rows:
        law, worth = row.fit.parameters[follower], row.evaluation
        errors = (worth.surrogate, worth.closed_loop, worth.held_out, worth.unseen)
        cells.append(
            (
                name_of(row.fit),
                law.alpha,
                law.beta,
                law.tau,
                *(float(e.gap_mae[follower]) if e else None for e in errors),
                float(worth.collisions[follower]),
                row.fit.seconds,
            )
        )
    label = segment.labels[follower + 1]
    return Table(f"{label}, {where(segment)}", columns, tuple(cells))


def intervals_table(segment: SegmentInfo, uncertainty: Uncertainty) -> Table:
    """One row a follower: intervals, and how probable string stability is."""
    columns = (
        Column("Follower"),
        *interval_columns(uncertainty),
        Column("L2", "%", 0, "Stable laws"),
        Column("L∞", "%", 0, "Stable laws"),
    )
    rows: list[tuple[Cell, ...]] = []
    for k, label in enumerate(segment.labels[1:]):
        stable = (
            100 * float(uncertainty.probability_l2[k]),
            100 * float(uncertainty.probability_linf[k]),
        )
        rows.append((label, *interval_cells(uncertainty, k), *stable))
    return Table(f"What the recording allows, {where(segment)}", columns, tuple(rows))
