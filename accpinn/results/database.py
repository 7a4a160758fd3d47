"""A batch of estimations in sentences and tables: its groups, its progress and its failures."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, replace
from datetime import date
from math import isnan
from typing import TYPE_CHECKING

from accpinn.findings import capital, joined, percent, probability
from accpinn.methods.estimate import SPEEDS
from accpinn.model.registry import FOLLOWING, TITLES
from accpinn.results.tables import ABSENT, Cell, Column, Filled, Range, Table, between
from accpinn.results.tables.estimates import cell_of, columns_of, gap_column
from accpinn.storage import csv_cell
from accpinn.study.batch import BatchProgress
from accpinn.study.description import EXTRAPOLATED, Value
from accpinn.study.groups import GROUPABLE, Group, Groups
from accpinn.study.plan import BatchEstimate
from accpinn.study.studies import Failure, Request
from accpinn.study.supplied import About
from accpinn.units import Quantity

if TYPE_CHECKING:
    import pandas as pd

TYPICAL = (
    "Typical value of each group with its interval: of its one vehicle, or of all such vehicles"
    " where it has several. It rests on every window's posterior: first over the windows of a"
    " vehicle, then over the vehicles of a group. How much these differ is estimated, too. Thin"
    " line: the time gap in a further window; arrowhead: the interval goes on; larger dot: more"
    " windows. ✓: stable with a probability above 95 %, ✗: below 5 %, ?: between."
)
"""The quantities in the picture of groups."""
OPENACC = (
    "OpenACC. An open database of car-following experiments to study the properties of commercial"
    " ACC systems, © European Union, 1995–2025, European Commission, Joint Research Centre, CC BY"
    " 4.0 (creativecommons.org/licenses/by/4.0), DOI 10.2905/9702C950-C80F-4D2F-982F-44D06EA0009F;"
    " M. Makridis, K. Mattas, A. Anesiadou, B. Ciuffo, Transportation Research Part C 125, 103047,"
    " 2021. What was changed: parameters were estimated from windows of the recordings; no recorded"
    " series is contained."
)
"""How the recordings of the supplied study are to be named."""


def headline(whole: Group) -> str:
    """The number of vehicles that are string stable, of all rows that are shown."""
    share, count = whole.l2_stable, len(whole.cars)
    if not math.isfinite(share.value):
        return "Nothing is known of string stability."
    if count == 1:
        return f"L₂ string stable with a probability of {probability(share.value)}."
    stable = round(share.value * count)
    verb = "is" if stable < 2 else "are"
    return f"{stable or 'None'} of the {count} vehicles {verb} L₂ string stable."


def further_vehicles(whole: Group) -> str:
    """The share among further vehicles that are string stable; empty for one vehicle."""
    share = whole.l2_stable
    if len(whole.cars) < 2 or not math.isfinite(share.value):
        return ""
    low, high = (f"{100 * part:.0f}" for part in (share.lower, share.upper))
    return (
        f"Share among further vehicles of these makes: {low} to {high} % ({percent(whole.level)}"
        " interval)."
    )


def extent(whole: Group, makes: int, recordings: int) -> str:
    """The number of windows, vehicles, makes and recordings that are shown."""
    return (
        f"{counted(whole.windows, 'follower window')}, {counted(whole.vehicles, 'vehicle')},"
        f" {counted(makes, 'make')}, {counted(recordings, 'recording')}"
    )


def supplied_line(about: About) -> str:
    """Where the study that comes with the program is from."""
    day = date.fromisoformat(about.date)
    return (
        f"Supplied study of {day.day} {day:%B %Y}, accpinn {about.version}. Data: OpenACC,"
        " © European Union, CC BY 4.0."
    )


def typical_line(whole: Group) -> str:
    """The typical time gap of all rows; empty where none is known."""
    speed = SPEEDS[-1]
    gap = whole.time_gap(speed)
    if not math.isfinite(gap.value):
        return ""
    return (
        f"typical time gap at {speed * 3.6:.0f} km/h {gap.value:.2f} s"
        f" ({between(gap.lower, gap.upper, 2)} s)"
    )


def batch_line(request: Request | None) -> str:
    """The settings that all rows of a batch share; empty where they are not known."""
    if request is None:
        return ""
    length = f"windows up to {request.window:g} s" if request.window else "whole stretches"
    return f"{TITLES[request.model]}, {length}, Case {request.case}"


def failures_line(failures: Sequence[Failure]) -> str:
    """The number of files and estimates without a result; empty if there are none."""
    files = len({failure.file for failure in failures if failure.start is None})
    estimates = sum(failure.start is not None for failure in failures)
    parts = [f"{counted(files, 'file')} without a window"] if files else []
    parts += [f"{counted(estimates, 'estimate')} failed"] if estimates else []
    return " and ".join(parts)


def progress_line(now: BatchProgress) -> str:
    """The progress of a batch."""
    files = f"{now.done:.0f} of {counted(now.files, 'file')}"
    rows = f"{counted(now.finished, 'window')} and {counted(now.rows, 'row')} so far"
    return f"{files} · {rows}" + (f" · {now.failed} failed" if now.failed else "")


def summary_line(summary: BatchProgress) -> str:
    """The result of a batch."""
    if summary.stopped:
        rows = counted(summary.rows, "row")
        return f"Stopped; what is finished is kept, and the same batch goes on from there: {rows}."
    unread = f" ({summary.refused:,} could not be read)" if summary.refused else ""
    counts = (
        f"{counted(summary.files, 'file')}, {counted(summary.recordings, 'recording')}{unread},"
        f" {counted(summary.windows, 'window')}, {counted(summary.followers, 'follower window')},"
        f" {counted(summary.rows, 'row')} (one a follower window and method)"
    )
    reused = f", {summary.reused:,} of them known before" if summary.reused else ""
    sentence = f"Done: {counts}{reused}."
    if summary.namesakes:
        sentence += (
            f" Other contents of {joined(summary.namesakes)} stay in the study beside these; if a"
            " file was changed, take another folder."
        )
    return sentence


def estimate_line(estimate: BatchEstimate) -> str:
    """The expected size of a batch; "about" where not all files were read."""
    about = "" if estimate.exact else "about "
    return (
        f"{counted(estimate.files, 'file')}: {about}{counted(round(estimate.windows), 'window')},"
        f" {about}{counted(round(estimate.followers), 'follower window')}"
    )


def counted(count: int, noun: str) -> str:
    """A count with its noun, as "1 file" or "1,200 files"."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


_NAMED = ("Make", "Model", "Setting", "Campaign", "Mode", "Vehicle", "File", "Date")
HEADINGS = dict(zip(GROUPABLE, _NAMED, strict=True))
FASTEST = SPEEDS[-1]
GAP = "Time gap"
GROWTH = Column("Largest growth", digits=2, key="growth")
MARGIN = Column("Margin, L₂", "s", 2, key="margin_l2")
"""By how much the time gap exceeds the smallest string stable one."""
NARROW = 2
"""Parameters in a table of 100 characters, each with a decimal less."""


def group_table(grouped: Groups, is_wide: bool = True) -> Table:
    """One row a group: typical time gap, parameters, and share of stable vehicles.

    A wide one shows every interval, and what a further window has; else it fits 100 characters.
    """
    groups, columns_of_model = grouped.groups, columns_of(grouped.model)
    caption = f"{TITLES[grouped.model]}, typical value ({100 * grouped.level:g} % interval)"
    if not is_wide:
        columns = [
            *(filled for filled in _heads(grouped) if filled[0].title != "Vehicles"),
            (Column("Time gap", "s", 2), next(_gaps(grouped))[1]),
            *((replace(column, digits=(column.digits or 1) - 1, group=""),
               [g.span(name).value for g in groups])
              for name, column in [*columns_of_model.items()][:NARROW]),
            (Column.chance("L₂"), [100 * group.l2_stable.value for group in groups]),
        ]  # fmt: skip
        at = gap_column(FASTEST, title="time gap at").title
        return Table.of(f"{caption}; {at}; L₂: stable", columns)
    columns = [
        *_heads(grouped),
        *_gaps(grouped),
        (GROWTH, [group.growth for group in groups]),
        (MARGIN, [_finite(group.margin) for group in groups]),
        *((column, [group.span(name) for group in groups])
          for name, column in columns_of_model.items()),
        *_stable(groups),
    ]  # fmt: skip
    return Table.of(caption, columns)


def _gaps(grouped: Groups) -> Iterator[Filled]:
    """The columns of the time gaps at speeds, in a further window, and as measured."""
    groups = grouped.groups
    for at in (FASTEST, SPEEDS[0]):
        spans = [Value(g.time_gap(at), EXTRAPOLATED * (not g.is_driven(at))) for g in groups]
        yield gap_column(at, GAP, "at"), [cell_of(span) for span in spans]
    further = gap_column(FASTEST, GAP, "Further window, at", key="further_window_")
    yield further, [Range(*astuple(group.time_gap(FASTEST))[3:]) for group in groups]
    measured = Column("Mean, measured", "s", 2, GAP, key="mean_time_gap_s")
    yield measured, [group.mean_time_gap.value for group in groups]


def _stable(groups: Sequence[Group]) -> Iterator[Filled]:
    """The columns of string stability."""
    yield Column.chance("L₂ stable"), [_share(group.l2_stable, group) for group in groups]
    yield Column.chance("L∞ stable"), [_share(group.linf_stable, group) for group in groups]


def ranking_table(grouped: Groups) -> Table:
    """One row a group in the order of `Groups.ranked`: time gaps, growth and string stability."""
    ranked = grouped.ranked(FASTEST)
    caption = (
        f"Typical value ({100 * grouped.level:g} % interval), by time gap at"
        f" {3.6 * FASTEST:.0f} km/h, measured before extrapolated"
    )
    more: list[Filled] = [
        (GROWTH, [group.growth for group in ranked.groups]),
        (MARGIN, [_finite(group.margin) for group in ranked.groups]),
    ]
    columns = [*_gaps(ranked), *more, *_stable(ranked.groups), *_counts(ranked)]
    return Table.of(caption, [_labels(ranked), *columns])


def group_parameters_table(grouped: Groups) -> Table:
    """One row a group in the same order: the parameters of the model."""
    ranked = grouped.ranked(FASTEST)
    columns = [
        (column, [group.span(name) for group in ranked.groups])
        for name, column in columns_of(grouped.model).items()
    ]
    caption = f"{TITLES[grouped.model]}, typical value ({100 * grouped.level:g} % interval)"
    return Table.of(caption, [_labels(ranked), *columns, *_counts(ranked)])


def spread_table(grouped: Groups) -> Table:
    """One row a group: how far its windows and its vehicles differ, with intervals."""
    columns, shown = _heads(grouped), columns_of(grouped.model)
    relative = {p.name for p in FOLLOWING[grouped.model].parameters if p.is_positive}
    if FOLLOWING[grouped.model].is_linear:
        relative, shown = {"time_gap", "alpha", "beta"}, {"time_gap": gap_column(FASTEST)} | shown
        del shown["tau"]
    kinds: tuple[tuple[str, Callable[[Group], dict[str, Quantity]]], ...] = (
        ("Between windows of a vehicle", lambda group: group.between_windows),
        ("Between vehicles", lambda group: group.between_vehicles),
    )
    for title, spreads in kinds:
        for name, column in shown.items():
            scaled = replace(column, unit="%", digits=0) if name in relative else column
            factor = 100 if name in relative else 1
            spreads_of_groups = [spreads(group).get(name) for group in grouped.groups]
            cells = [_scaled(spread, factor) if spread else None for spread in spreads_of_groups]
            columns.append((replace(scaled, group=title, key=""), cells))
    return Table.of(f"Standard deviations, with {100 * grouped.level:g} % intervals", columns)


def guarded(rows: "pd.DataFrame") -> "pd.DataFrame":
    """Rows of a study without texts that a spreadsheet evaluates, as they are saved as CSV."""
    changed = {}
    for name, column in rows.select_dtypes(exclude=["number", "bool"]).items():
        formulas = {text: csv_cell(text) for text in column.unique() if csv_cell(text) is not text}
        if formulas:  # which no honest study has
            changed[str(name)] = [formulas.get(text, text) for text in column]
    return rows.assign(**changed) if changed else rows


def _heads(grouped: Groups) -> list[Filled]:
    """The columns with each group's name and size."""
    groups = grouped.groups
    names: list[Filled] = [
        (Column(HEADINGS[name]), [group.values[k] or ABSENT for group in groups])
        for k, name in enumerate(grouped.by)
    ]
    return [*(names or [(Column("Group"), ["all"] * len(groups))]), *_counts(grouped)]


def _counts(grouped: Groups) -> Iterator[Filled]:
    """How much each group has."""
    yield Column("Windows", digits=0), [float(group.windows) for group in grouped.groups]
    yield Column("Vehicles", digits=0), [float(group.vehicles) for group in grouped.groups]


def _labels(grouped: Groups) -> Filled:
    """The column with each group's name."""
    title = ", ".join(HEADINGS[name].lower() for name in grouped.by)
    return Column(capital(title) or "Group"), [label_of(g.values) for g in grouped.groups]


def label_of(values: Sequence[str]) -> str:
    """The name of a group."""
    return " · ".join(value or ABSENT for value in values) or "all"


def _share(share: Quantity, group: Group) -> Cell:
    """The probability of one vehicle, else the share of several with its interval."""
    shown = _scaled(share, 100)
    return shown.value if isnan(share.value) or len(group.cars) == 1 else shown


def _finite(of: Quantity) -> Cell:
    """A value with its interval; none where it is infinite."""
    return of if math.isfinite(of.value) else None


def _scaled(of: Quantity, factor: float) -> Quantity:
    return Quantity(*(factor * value for value in (of.value, of.lower, of.upper)))


def failure_table(failures: Sequence[Failure]) -> Table:
    """One row for each thing that has no result."""
    vehicles = [None if f.vehicle is None else float(f.vehicle) for f in failures]
    places: list[Filled] = [
        (Column("From", "s", 0), [failure.start for failure in failures]),
        (Column("Vehicle", digits=0), vehicles),
    ]
    return Table.of(
        "",
        [
            (Column("File"), [failure.file or ABSENT for failure in failures]),
            *(filled for filled in places if any(cell is not None for cell in filled[1])),
            (Column("Reason", prose=True), [failure.reason for failure in failures]),
        ],
    )
