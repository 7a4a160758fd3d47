"""The groups of a batch as a table."""

from accpinn.channels import PARAMETERS
from accpinn.methods.registry import METHODS
from accpinn.results.tables.table import ABSENT, Cell, Column, Estimate, Table
from accpinn.study.groups import Groups, Share, Typical

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


def group_table(found: Groups) -> Table:
    """One row a group: medians with intervals, spread between windows, shares that are stable.

    Args:
        found: the groups of a batch.
    """
    groups = found.groups
    method = METHODS[found.method].title if found.method in METHODS else found.method
    level = f"{100 * found.level:g} % intervals"
    caption = ", ".join(filter(None, (method, "median over windows", level)))
    columns: list[tuple[Column, list[Cell]]] = [
        (Column(HEADINGS[name]), [one.values[k] or ABSENT for one in groups])
        for k, name in enumerate(found.by)
    ] or [(Column("Group"), ["all" for _ in groups])]
    columns += [
        (Column("Windows", digits=0), [float(one.windows) for one in groups]),
        (Column("Vehicles", digits=0), [float(one.vehicles) for one in groups]),
    ]
    for k, quantity in enumerate(PARAMETERS):
        typical = [one.parameters[k] for one in groups]
        columns += [
            (Column(quantity.symbol, quantity.unit, quantity.digits), [*map(_estimate, typical)]),
            (
                Column(f"Spread of {quantity.symbol}", "%", 0),
                [100 * one.between.deviation for one in typical],
            ),
        ]
    columns += [
        (Column("Mean time gap", "s", 2), [one.mean_time_gap.value for one in groups]),
        (Column("L₂ stable", "%", 0), [_percent(one.l2_stable) for one in groups]),
        (Column("L∞ stable", "%", 0), [_percent(one.linf_stable) for one in groups]),
    ]
    return Table.of(caption, columns)


def _estimate(typical: Typical) -> Cell:
    return Estimate(typical.median, typical.low, typical.high)


def _percent(share: Share) -> Cell:
    return Estimate(100 * share.value, 100 * share.low, 100 * share.high)
