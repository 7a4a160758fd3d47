"""The groups of a batch as a table."""

import math
from collections.abc import Sequence

from accpinn.channels import PARAMETERS
from accpinn.results.tables.estimates import TITLES
from accpinn.results.tables.table import (
    ABSENT,
    Cell,
    Column,
    Estimate,
    Filled,
    Table,
    percent_cells,
)
from accpinn.study.groups import Groups, Share
from accpinn.study.studies import Failure

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


def group_table(grouped: Groups, with_spread: bool = True) -> Table:
    """One row a group: medians with intervals, spread between windows, shares that are stable.

    Args:
        grouped: the groups of a batch.
        with_spread: whether the spread is among them; `spread_table` has it with its intervals.
    """
    groups = grouped.groups
    method = grouped.method and TITLES.get(grouped.method, grouped.method)
    level = f"{100 * grouped.level:g} % intervals"
    caption = ", ".join(filter(None, (method, "median over windows", level)))
    columns = _heads(grouped)
    for k, quantity in enumerate(PARAMETERS):
        typical = [group.parameters[k] for group in groups]
        columns.append((Column.of(quantity), [_estimate(t.median, t.low, t.high) for t in typical]))
        if with_spread:
            spread = percent_cells([t.between.deviation for t in typical])
            columns.append((Column(f"Spread of {quantity.symbol}", "%", 0), spread))
    columns += [
        (Column("Mean time gap", "s", 2), [group.mean_time_gap.value for group in groups]),
        (Column("L₂ stable", "%", 0), [_share(group.l2_stable) for group in groups]),
        (Column("L∞ stable", "%", 0), [_share(group.linf_stable) for group in groups]),
    ]
    return Table.of(caption, columns)


def spread_table(grouped: Groups) -> Table:
    """One row a group: how far windows differ beyond their standard errors, with intervals.

    Args:
        grouped: the groups of a batch.
    """
    columns = _heads(grouped)
    for k, quantity in enumerate(PARAMETERS):
        effects = [group.parameters[k].between for group in grouped.groups]
        cells = [_percent(effect.deviation, effect.lower, effect.upper) for effect in effects]
        columns.append((Column(f"Spread of {quantity.symbol}", "%", 0), cells))
        shares = percent_cells([effect.i_squared for effect in effects])
        columns.append((Column(f"I² of {quantity.symbol}", "%", 0), shares))
    return Table.of(f"Between windows, {100 * grouped.level:g} % intervals", columns)


def _heads(grouped: Groups) -> list[Filled]:
    """What names each group, and how much it has."""
    groups = grouped.groups
    names: list[Filled] = [
        (Column(HEADINGS[name]), [group.values[k] or ABSENT for group in groups])
        for k, name in enumerate(grouped.by)
    ]
    return [
        *(names or [(Column("Group"), ["all"] * len(groups))]),
        (Column("Windows", digits=0), [float(group.windows) for group in groups]),
        (Column("Vehicles", digits=0), [float(group.vehicles) for group in groups]),
    ]


def _estimate(value: float, low: float, high: float) -> Cell:
    return Estimate(value, low, high) if math.isfinite(value) else None


def _percent(value: float, low: float, high: float) -> Cell:
    return _estimate(100 * value, 100 * low, 100 * high)


def _share(share: Share) -> Cell:
    return _percent(share.value, share.low, share.high)


def failure_table(failures: Sequence[Failure]) -> Table:
    """One row for each thing that has no result."""
    vehicles = [None if f.vehicle is None else float(f.vehicle) for f in failures]
    return Table.of(
        "",
        [
            (Column("File"), [failure.file or ABSENT for failure in failures]),
            (Column("From", "s", 0), [failure.start for failure in failures]),
            (Column("Vehicle", digits=0), vehicles),
            (Column("Reason", prose=True), [failure.reason for failure in failures]),
        ],
    )
