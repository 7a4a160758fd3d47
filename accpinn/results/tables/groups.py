"""The groups of a batch as a table."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isnan

from accpinn.inference.answer import SPEEDS, Span
from accpinn.model.registry import CTHPS, FOLLOWING, TITLES
from accpinn.results.tables.answer import columns_of, gap_column
from accpinn.results.tables.table import ABSENT, Cell, Column, Filled, Range, Table
from accpinn.study.groups import Group, Groups
from accpinn.study.studies import Failure
from accpinn.units import Estimate

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
    groups, own = grouped.groups, columns_of(grouped.model)
    caption = f"{TITLES[grouped.model]}, typical value ({100 * grouped.level:g} % interval)"
    gaps = {speed: [_estimate(group.time_gap(speed)) for group in groups] for speed in SPEEDS}
    if not is_wide:
        digits = NARROW.get(grouped.model.split("-")[0]) or dict.fromkeys(list(own)[:3], 2)
        columns = [
            *(filled for filled in _heads(grouped) if filled[0].title != "Vehicles"),
            (Column("Time gap", "s", 2), gaps[FASTEST]),
            *((replace(own[name], digits=count, group=""), [g.span(name).value for g in groups])
              for name, count in digits.items()),
            (Column.chance("L₂"), [100 * group.l2_stable.value for group in groups]),
        ]  # fmt: skip
        at = gap_column(FASTEST, title="time gap at").title
        return Table.of(f"{caption}; {at}; L₂: stable", columns)
    further = gap_column(FASTEST, GAP, "Further window, at", key="further_window_")
    columns = [
        *_heads(grouped),
        *((gap_column(speed, GAP, "at"), gaps[speed]) for speed in (FASTEST, SPEEDS[0])),
        (further, [_further(group.time_gap(FASTEST)) for group in groups]),
        (Column("Mean, measured", "s", 2, GAP, key="mean_time_gap_s"),
         [group.mean_time_gap.value for group in groups]),
        *((column, [_estimate(group.span(name)) for group in groups])
          for name, column in own.items()),
        (Column.chance("L₂ stable"), [_share(group.l2_stable, group) for group in groups]),
        (Column.chance("L∞ stable"), [_share(group.linf_stable, group) for group in groups]),
    ]  # fmt: skip
    return Table.of(caption, columns)


def spread_table(grouped: Groups) -> Table:
    """One row a group: how far its windows and its vehicles differ, with intervals."""
    columns, shown = _heads(grouped), columns_of(grouped.model)
    relative = {p.name for p in FOLLOWING[grouped.model].parameters if p.is_positive}
    if grouped.model in CTHPS:
        relative, shown = {"time_gap", "alpha", "beta"}, {"time_gap": gap_column(FASTEST)} | shown
        del shown["tau"]
    kinds: tuple[tuple[str, Callable[[Group], dict[str, Estimate]]], ...] = (
        ("Between windows of a vehicle", lambda group: group.between_windows),
        ("Between vehicles", lambda group: group.between_vehicles),
    )
    for title, spreads in kinds:
        for name, column in shown.items():
            scaled = replace(column, unit="%", digits=0) if name in relative else column
            factor = 100 if name in relative else 1
            cells = [_spread(spreads(group).get(name), factor) for group in grouped.groups]
            columns.append((replace(scaled, group=title, key=""), cells))
    return Table.of(f"Standard deviations, {100 * grouped.level:g} % intervals", columns)


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
