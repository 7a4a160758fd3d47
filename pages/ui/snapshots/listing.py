"""Lists of saved results, snapshots or a session's own runs, and two results side by side."""

import html
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from itertools import zip_longest
from typing import Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import streamlit as st

from accpinn.errors import RecordingError
from accpinn.methods.registry import title_of as method_title
from accpinn.results.figures.runs import STYLE, Axes
from accpinn.results.figures.stability import bode
from accpinn.results.figures.style import SERIES, vehicle_colours
from accpinn.results.figures.training import SIMULATION, driven, tracking
from accpinn.results.naming import name_of
from accpinn.results.tables import ABSENT, Cell, Column, Table
from accpinn.results.tables.estimates import (
    gap_column,
    parameter_cells,
)
from accpinn.study import differences
from accpinn.study.result import Result
from accpinn.study.store import Entry
from accpinn.study.vehicles import AssessedVehicles, assessed_vehicles
from accpinn.units import MetresPerSecond, Quantity
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown, pick, select
from pages.ui.session.resources import find_recording
from pages.ui.session.saved import own_result
from pages.ui.session.sessions import DIGEST
from pages.ui.session.workspace import TITLE_OF, Workspace

SECOND = SERIES[1]
"""Colour of the second result's curves; the first one's is that of every simulation."""
LISTED, FEW = 7, 4
"""Rows at most, and before all are asked for; a search finds the others."""
WIDTHS = (2.1, 4.4, 1.1)
"""Widths of a row's cells: name and data, estimates and time, what can be done with it."""


def show_entries(
    workspace: Workspace,
    entries: Sequence[Entry],
    key: str,
    open_entry: Callable[[Entry], None],
    action: Callable[[Entry], None] | None = None,
    help: str | None = None,
    title: str = "",
) -> None:
    """A row for each entry with time gaps and growths on common axes, and a search field.

    A click on a name calls ``open_entry``; ``action`` draws what else can be done with an entry. A
    long list shows few rows until all are asked for.
    """
    is_long = len(entries) > FEW
    matching, search = entries, ""
    if is_long:
        if title:
            st.markdown(f"**{title}**")
            title = ""
        search = st.text_input(
            "Search", key=f"{key}_search", icon=":material/search:", width=420,
            placeholder="name, recording, vehicle or method", label_visibility="collapsed",
        )  # fmt: skip
        matching = [entry for entry in entries if entry.matches(search or "")]
    is_short = is_long and not search and not workspace.choices.get(f"{key}_all")
    rows = matching[: FEW if is_short else LISTED]
    if rows:
        _show_rows(rows, key, open_entry, action, help, title)
    hidden = len(matching) - len(rows)
    if not matching:
        st.caption("Nothing has these words.")
    elif is_short:
        st.button(
            f"Show all {len(entries)}", key=f"{key}_more", type="tertiary",
            icon=":material/expand_more:", on_click=workspace.keep(f"{key}_all"), args=(True,),
        )  # fmt: skip
    elif hidden:
        show.caption(f"{len(rows)} of {len(matching)} are shown: search for the others.")


def _show_rows(
    entries: Sequence[Entry],
    key: str,
    open_entry: Callable[[Entry], None],
    action: Callable[[Entry], None] | None,
    help: str | None,
    title: str,
) -> None:
    axes, now = Axes.of([entry for entry in entries if not entry.fault]), _now()
    widths = WIDTHS if action else WIDTHS[:2]
    with st.container(gap=None, key=f"runs_{key}"):
        st.html(STYLE)
        with st.container(key=f"runs_head_{key}"):
            first, second, *_ = st.columns(widths, vertical_alignment="bottom")
            first.markdown(f"**{title}**" if title else "")
            second.html(axes.head())
        for entry in entries:
            with st.container(key=f"{key}_row_{entry.id}", gap=None):
                named, drawn, *more = st.columns(widths, vertical_alignment="center")
                with named.container(gap=None):
                    about = escape_markdown(_about(entry))
                    icon = "inventory_2" if is_snapshot(entry) else "show_chart"
                    icon = "error" if entry.fault else icon
                    st.button(
                        escape_markdown(title_of(entry)), key=f"{key}_open_{entry.id}",
                        type="tertiary", icon=f":material/{icon}:",
                        on_click=open_entry, args=(entry,),
                        help="\n\n".join(filter(None, (about, help))),
                    )  # fmt: skip
                    # A name says enough; a long list has the rest on hovering.
                    if not entry.name.strip() and len(entries) <= FEW:
                        st.caption(about)
                drawn.html(axes.row(entry, now)) if not entry.fault else drawn.caption("damaged")
                if action and more:
                    with more[0]:
                        action(entry)


def _now() -> datetime:
    """Now, in the time zone of the browser."""
    try:
        return datetime.now(ZoneInfo(st.context.timezone or "UTC"))
    except (ZoneInfoNotFoundError, ValueError, TypeError):
        return datetime.now(UTC)


def is_snapshot(entry: Entry) -> bool:
    """Whether it is kept as a snapshot; else it is a run."""
    return len(entry.id) < DIGEST


def title_of(saved: Entry | Result) -> str:
    """The title of a saved result: its name, or else its recording; of a run, the method."""
    if saved.name.strip():
        return saved.name.strip()
    if isinstance(saved, Entry):
        return saved.source or saved.id
    case = f", Case {saved.estimate.case}" * (len(saved.parameters) > 1)
    return (name_of(saved.estimate) + case) or saved.id


def _about(entry: Entry) -> str:
    """Data and method of an entry, as far as its title does not name them."""
    if entry.fault:
        return "cannot be read"
    windows, cars = entry.window.split(", "), entry.vehicles[1:]
    parts = [
        entry.source if entry.name.strip() else "",
        entry.window if len(windows) == 1 else f"{len(windows)} windows",
        cars[0] if len(cars) == 1 else f"{len(cars)} followers",
        TITLE_OF[entry.preset] if entry.preset in TITLE_OF else method_title(entry.method),
        f"Case {entry.case}" if entry.case == "I" and len(cars) > 1 else "",
    ]
    return " · ".join(filter(None, parts))


def choose_entry(
    workspace: Workspace, label: str, key: str, entries: Sequence[Entry], **look: Any
) -> str:
    """The short name of one of them; at first of the newest. ``look`` is as of `select`."""
    entries_by_id = {
        entry.id: " · ".join((title_of(entry), _about(entry), entry.id[:6])) for entry in entries
    }
    return select(label, entries_by_id, entries[0].id, key, workspace, **{"width": 520} | look)


# Two results


def show_both(workspace: Workspace, first: Result, second: Result) -> None:
    """Compare two results: estimates with intervals, Bode magnitudes, settings and data."""
    if changes := what_differs(first, second):
        st.markdown(f"**What differs**, first → second:\n\n{show.bullets(changes)}")
    else:
        sentence = "Both are from the same data of one recording, by the same settings"
        if first.parameters == second.parameters:
            st.caption(f"{sentence}, and have the same parameters: nothing differs.")
            return
        st.caption(f"{sentence}.")
    show.messages(other_vehicles(first, second), "warning", "compare_arrows")
    show.table(differences_table(first, second))
    _show_responses(first, second)
    _show_curves(workspace, first, second)


def other_vehicles(first: Result, second: Result) -> str:
    """A warning where followers in the same place are not the same; else empty."""
    pairs = zip_longest(first.info.labels[1:], second.info.labels[1:], fillvalue="no vehicle")
    unlike = [f"{label} stands beside {beside}" for label, beside in pairs if label != beside]
    if not unlike:
        return ""
    return (
        f"The followers are not the same: {'; '.join(unlike)}. The differences below are then"
        " between vehicles, not between two results for one."
    )


def differences_table(first: Result, second: Result) -> Table:
    """One row a follower and quantity: both values with intervals, and the second less the first.

    The quantities are the time gap and the parameters. Followers are matched in driving order.
    """
    rows, colours = [], []
    speed = first.estimate.stated_speed
    labels = zip_longest(first.info.labels[1:], second.info.labels[1:], fillvalue=ABSENT)
    longer = max(first.info, second.info, key=lambda info: info.followers)
    paints = vehicle_colours(longer.vehicles)[1:]
    for k, (label, beside) in enumerate(labels):
        name = label if label == beside else f"{label} / {beside}"
        left, right = (_estimates(side, k, speed) for side in (first, second))
        for column in left | right:
            cells = left.get(column), right.get(column)
            before, after = map(_value, cells)
            change, digits = after - before, column.digits or 0
            share = 100 * change / before if before else np.nan
            texts = (*map(column.shown, cells), _signed(change, digits), _signed(share, 1))
            rows.append((name, column.heading, *texts))
            colours.append(paints[k])
    titles = ("Follower", "Quantity", "First", "Second", "Δ", "Δ in %")
    methods = dict.fromkeys(name_of(side.estimate) for side in (first, second))
    caption = f"Estimates by {' / '.join(methods)}"
    return Table(caption, tuple(map(Column, titles)), tuple(rows), tuple(colours))


def _estimates(result: Result, follower: int, speed: MetresPerSecond) -> dict[Column, Cell]:
    """The time gap at a speed, and the parameters; nothing of no follower."""
    if follower >= result.info.followers:
        return {}
    estimate = result.estimate
    columns = parameter_cells(result.parameters, "", estimate.model, result.uncertainty)
    gap = estimate.time_gap(speed, follower)
    cells: dict[Column, Cell] = {gap_column(speed): gap if result.posterior else gap.value}
    return cells | {column: [*estimates][follower] for column, estimates in columns}


def _value(cell: Cell) -> float:
    value = cell.value if isinstance(cell, Quantity) else cell
    return value if isinstance(value, float) else np.nan


def _signed(value: float, digits: int) -> str:
    sign = "+" if value else ""
    return f"{value:{sign}.{digits}f}" if np.isfinite(value) else ABSENT


def _show_responses(first: Result, second: Result) -> None:
    """Both Bode magnitudes in one chart; nothing where the parameters of either have none."""
    charts = []
    for subject in map(assessed_vehicles, (first, second)):
        if not subject.has_report:
            return
        charts.append(bode(AssessedVehicles(subject.vehicles)))
    chart, added = charts
    for trace in added.data:
        if trace.mode == "lines+markers" and (trace.customdata is None or trace.customdata[0] >= 0):
            # The whole platoon's line is left to the first alone: the chart stays readable.
            chart.add_scatter(
                x=trace.x, y=trace.y, mode="lines",
                name=f"{trace.name}, {html.escape(title_of(second))}",
                line={**trace.line.to_plotly_json(), "dash": "dot"},
                hovertemplate="%{y:.2f} dB at %{x:.3f} rad/s",
            )  # fmt: skip
    whole = " Dashed: the first one's whole platoon." if first.info.followers > 1 else ""
    st.caption(f"Bode magnitude. Full lines: the first; dotted: the second.{whole}")
    show.chart(chart, "snapshots_bode")


def _show_curves(workspace: Workspace, first: Result, second: Result) -> None:
    """Both simulations over the data of the first window; nothing where the two have others."""
    shorter = min(first.info, second.info, key=lambda info: info.followers)
    if first.info.digest != second.info.digest:
        return
    follower = pick(workspace, shorter.labels[1:], "beside_follower")
    motions = driven(first, follower), driven(second, follower)
    if not all(motions):
        return
    st.caption(f"Simulation of both behind the measured vehicle ahead, {first.info.window}.")
    chart = tracking(first.segments[0], follower, simulation=motions[0], height=400)
    added = tracking(second.segments[0], follower, simulation=motions[1], height=400)
    name = {"name": SIMULATION}
    chart.for_each_trace(lambda trace: trace.update(name="first", line={"dash": "solid"}), name)
    added.for_each_trace(
        lambda trace: chart.add_trace(
            trace.update(name="second", line={"color": SECOND, "dash": "dot"})
        ),
        name,
    )
    show.chart(chart, "snapshots_curves")


def what_differs(first: Result, second: Result) -> tuple[str, ...]:
    """Differences in data, settings and program, a few words each."""
    settings = differences(first.analysis, second.analysis)
    further = (
        ("SHA-256", first.analysis.source.sha256[:16], second.analysis.source.sha256[:16]),
        ("iterations done", f"{first.estimate.iterations:,}", f"{second.estimate.iterations:,}"),
        ("accpinn", first.origin.accpinn, second.origin.accpinn),
    )
    return settings + tuple(f"{name}: {a} → {b}" for name, a, b in further if a != b)


# Finished runs


def show_runs(workspace: Workspace, entries: Sequence[Entry], key: str, title: str = "") -> None:
    """The list of runs; a click shows a result again, and two can stand side by side."""

    def restore(entry: Entry) -> None:
        restore_run(workspace, entry.id)
        st.session_state[frame.TURN] = frame.TRAIN

    show.flashed()
    show_entries(
        workspace, entries, key, restore, title=title,
        help="Shows this result on every page. The present one stays in this list.",
    )  # fmt: skip
    is_whole = len(entries) <= FEW or workspace.choices.get(f"{key}_all")
    if is_whole and len(entries) > 1 and st.toggle("Show two side by side", key=f"{key}_compare"):
        first = choose_entry(workspace, "Run", f"{key}_first", entries)
        others = [entry for entry in entries if entry.id != first]
        second = choose_entry(workspace, "Beside", f"{key}_second", others)
        pair = (own_result(workspace, run).found_in(workspace.recording) for run in (first, second))
        show_both(workspace, *pair)


def restore_run(workspace: Workspace, name: str) -> None:
    """Show a training on every page, with its recording where the session or server has it."""
    result = own_result(workspace, name)
    source = result.analysis.source
    recording = workspace.opened.get(source.sha256)
    with suppress(RecordingError):
        recording = recording or find_recording(
            source.name, source.sha256, source.trajectory, source.mapping
        )
    workspace.restore(result, recording)
