"""The groups of a batch as a table."""

import math
from collections.abc import Sequence
from typing import Any

from accpinn.channels import PARAMETERS
from accpinn.results.tables.estimates import TITLES, number
from accpinn.results.tables.table import ABSENT, Cell, Column, Estimate, Table
from accpinn.study.groups import Groups, Share
from accpinn.study.journal import Failure
from accpinn.study.pooling import SHARED

HEADINGS = {
    "make": "Make",
    "model": "Model",
    "distance_setting": "Setting",
    "campaign": "Campaign",
    "mode": "Mode",
    "name": "Vehicle",
    "file": "File",
    "date": "Date",
    "method": "Method",
    "case": "Case",
}


def group_table(found: Groups, with_spread: bool = True) -> Table:
    """One row a group: medians with intervals, spread between windows, shares that are stable.

    Args:
        found: the groups of a batch.
        with_spread: whether the spread is among them; `spread_table` has it with its intervals.
    """
    groups = found.groups
    method = found.method and TITLES.get(found.method, found.method)
    level = f"{100 * found.level:g} % intervals"
    caption = ", ".join(filter(None, (method, "median over windows", level)))
    columns = _heads(found)
    for k, quantity in enumerate(PARAMETERS):
        typical = [one.parameters[k] for one in groups]
        values = [_estimate(one.median, one.low, one.high) for one in typical]
        columns.append((Column.of(quantity), values))
        if with_spread:
            spread = [100 * one.between.deviation for one in typical]
            columns.append((Column(f"Spread of {quantity.symbol}", "%", 0), [*spread]))
    columns += [
        (Column("Mean time gap", "s", 2), [one.mean_time_gap.value for one in groups]),
        (Column("L₂ stable", "%", 0), [_share(one.l2_stable) for one in groups]),
        (Column("L∞ stable", "%", 0), [_share(one.linf_stable) for one in groups]),
    ]
    return Table.of(caption, columns)


def spread_table(found: Groups) -> Table:
    """One row a group: how far windows differ beyond their standard errors, with intervals.

    Args:
        found: the groups of a batch.
    """
    columns = _heads(found)
    for k, quantity in enumerate(PARAMETERS):
        between = [one.parameters[k].between for one in found.groups]
        cells = [_percent(one.deviation, one.lower, one.upper) for one in between]
        columns.append((Column(f"Spread of {quantity.symbol}", "%", 0), cells))
        shares: list[Cell] = [100 * one.i_squared for one in between]
        columns.append((Column(f"I² of {quantity.symbol}", "%", 0), shares))
    return Table.of(f"Between windows, {100 * found.level:g} % intervals", columns)


def _heads(found: Groups) -> list[tuple[Column, list[Cell]]]:
    """What names each group, and how much it has."""
    groups = found.groups
    names: list[tuple[Column, list[Cell]]] = [
        (Column(HEADINGS[name]), [one.values[k] or ABSENT for one in groups])
        for k, name in enumerate(found.by)
    ] or [(Column("Group"), ["all" for _ in groups])]
    return [
        *names,
        (Column("Windows", digits=0), [float(one.windows) for one in groups]),
        (Column("Vehicles", digits=0), [float(one.vehicles) for one in groups]),
    ]


def _estimate(value: float, low: float, high: float) -> Cell:
    return Estimate(value, low, high) if math.isfinite(value) else None


def _percent(value: float, low: float, high: float) -> Cell:
    return _estimate(100 * value, 100 * low, 100 * high)


def _share(share: Share) -> Cell:
    return _percent(share.value, share.low, share.high)


def pooled_table(rows: Sequence[dict[str, Any]], level: float) -> Table:
    """One row a vehicle and setting: the parameters that its windows share, with intervals.

    Args:
        rows: as `read_pooled` gives them.
        level: of their intervals, for the caption.
    """
    ordered = sorted(rows, key=lambda row: [str(row[name] or "") for name in SHARED])
    columns: list[tuple[Column, list[Cell]]] = [
        (Column(HEADINGS[name]), [row[name] or ABSENT for row in ordered])
        for name in ("make", "model", "campaign", "distance_setting")
    ]
    columns[0] = (columns[0][0], [row["make"] or row["name"] for row in ordered])
    columns.append((Column("Windows", digits=0), [float(row["windows"]) for row in ordered]))
    columns.append((Column("Duration", "s", 0), [row["duration"] for row in ordered]))
    for quantity in PARAMETERS:
        keys = (f"{quantity.key}{end}" for end in ("", "_low", "_high"))
        ends = [[number(row[key]) for row in ordered] for key in keys]
        columns.append((Column.of(quantity), [*map(Estimate, *ends)]))
    for name, title in (("p_l2_stable", "P(L₂)"), ("p_linf_stable", "P(L∞)")):
        columns.append((Column(title, "%", 0), [100 * number(row[name]) for row in ordered]))
    caption = f"All windows of a vehicle together, {100 * level:g} % intervals"
    return Table.of(caption, columns)


def failure_table(failures: Sequence[Failure]) -> Table:
    """One row for each thing that has no result."""
    return Table.of(
        "",
        [
            (Column("File"), [one.file or ABSENT for one in failures]),
            (Column("From", "s", 0), [one.start for one in failures]),
            (
                Column("Vehicle", digits=0),
                [None if one.vehicle is None else float(one.vehicle) for one in failures],
            ),
            (Column("Reason", prose=True), [one.reason for one in failures]),
        ],
    )
