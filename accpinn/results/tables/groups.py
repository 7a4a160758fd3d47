"""The groups of a batch as a table."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isnan

from accpinn.inference.answer import SPEEDS, Span
from accpinn.model.registry import CTHPS, FOLLOWING, TITLES
from accpinn.results.tables.answer import columns_of
from accpinn.results.tables.table import (
    ABSENT,
    Cell,
    Column,
    Filled,
    Range,
    Table,
)
from accpinn.study.groups import Group, Groups
from accpinn.study.studies import Failure
from accpinn.units import Estimate, MetresPerSecond

HEADINGS = {
    "make": "Make",
    "model": "Model",
    "distance_setting": "Setting",
    "campaign": "Campaign",
    "mode": "Mode",
    "name": "Vehicle",
    "file": "File",
    "date": "Date",
}
FASTEST = SPEEDS[-1]
GAP = "Time gap"
NARROW = {"cthp": {"alpha": 3, "beta": 2}, "idm": {"a": 2, "T": 2, "s0": 1}}
"""Parameters in a table of 100 characters, with their decimals; else a model's first three."""


def group_table(grouped: Groups, is_wide: bool = True) -> Table:
    """One row a group: typical time gap and parameters, and the share of stable vehicles.

    Args:
        grouped: the groups of a batch.
        is_wide: whether every interval is shown, and what a further window has; else the table fits
            100 characters.
    """
    groups = grouped.groups
    level = f"{100 * grouped.level:g} % interval"
    caption = f"{TITLES[grouped.model]}, typical value ({level})"

    def gaps(speed: MetresPerSecond) -> list[Cell]:
        return [_estimate(group.time_gap(speed)) for group in groups]

    fastest = f"Time gap at {FASTEST * 3.6:.0f} km/h"
    columns, own = _heads(grouped), columns_of(grouped.model)
    if not is_wide:
        base = grouped.model.split("-")[0]
        digits = NARROW.get(base) or dict.fromkeys(list(own)[:3], 2)
        columns += [
            (Column("Time gap", "s", 2), gaps(FASTEST)),
            *((replace(own[name], digits=count, group=""), [g.span(name).value for g in groups])
              for name, count in digits.items()),
            (Column.chance("L₂"), [100 * group.l2_stable.value for group in groups]),
        ]  # fmt: skip
        columns = [filled for filled in columns if filled[0].title != "Vehicles"]
        return Table.of(f"{caption}; t{fastest[1:]}; L₂: stable", columns)
    columns += [
        *((Column(f"at {speed * 3.6:.0f} km/h", "s", 2, GAP, key=_gap_key(speed)), gaps(speed))
          for speed in (FASTEST, SPEEDS[0])),
        (Column(f"Further window, at {FASTEST * 3.6:.0f} km/h", "s", 2, GAP,
                key=f"further_window_{_gap_key(FASTEST)}"),
         [_further(group.time_gap(FASTEST)) for group in groups]),
        (Column("Mean, measured", "s", 2, GAP, key="mean_time_gap_s"),
         [group.mean_time_gap.value for group in groups]),
        *((replace(column, key=name), [_estimate(group.span(name)) for group in groups])
          for name, column in own.items()),
        (Column.chance("L₂ stable"), [_share(group.l2_stable, group) for group in groups]),
        (Column.chance("L∞ stable"), [_share(group.linf_stable, group) for group in groups]),
    ]  # fmt: skip
    return Table.of(caption, columns)


def spread_table(grouped: Groups) -> Table:
    """One row a group: how far its windows and its vehicles differ, with intervals.

    Args:
        grouped: the groups of a batch.
    """
    groups = grouped.groups
    columns = _heads(grouped)
    kinds: tuple[tuple[str, Callable[[Group], dict[str, Estimate]]], ...] = (
        ("Between windows of a vehicle", lambda group: group.between_windows),
        ("Between vehicles", lambda group: group.between_vehicles),
    )
    fastest = Column(f"Time gap at {FASTEST * 3.6:.0f} km/h", "%", 0)
    relative = {p.name for p in FOLLOWING[grouped.model].parameters if p.is_positive}
    shown, columns_shown = dict[str, Column](), columns_of(grouped.model)
    if grouped.model in CTHPS:
        relative, shown = {"alpha", "beta"}, {"time_gap": fastest}
        del columns_shown["tau"]
    for name, column in columns_shown.items():
        shown[name] = replace(column, unit="%", digits=0) if name in relative else column
    for title, spreads in kinds:
        for name, column in shown.items():
            factor = 100 if column.unit == "%" else 1
            cells = [_spread(spreads(group).get(name), factor) for group in groups]
            columns.append((replace(column, group=title, key=""), cells))
    return Table.of(f"Standard deviations, {100 * grouped.level:g} % intervals", columns)


def _gap_key(speed: MetresPerSecond) -> str:
    """The name of a time gap in CSV files."""
    return f"time_gap_at_{speed * 3.6:.0f}_km_h_s"


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


def _estimate(span: Span) -> Cell:
    return None if isnan(span.value) else span


def _further(span: Span) -> Cell:
    return None if isnan(span.value) else Range(span.further_lower, span.further_upper)


def _spread(spread: Estimate | None, factor: float) -> Cell:
    if spread is None:
        return None
    return Estimate(*(factor * value for value in (spread.value, spread.lower, spread.upper)))


def _share(share: Estimate, group: Group) -> Cell:
    """Of one vehicle its probability, else the share with its interval."""
    value, low, high = (100 * part for part in (share.value, share.lower, share.upper))
    if isnan(value) or len(group.cars) == 1:
        return value
    return Estimate(value, low, high)


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
