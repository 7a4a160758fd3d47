"""The tabs of page Database: groups, planes, rows, and what has no result."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import pandas as pd
import plotly.graph_objects as go
import streamlit as st

from accpinn.recordings.recording import Window
from accpinn.results.figures import database as figures
from accpinn.results.figures.stability import EXACT, L2
from accpinn.results.tables.groups import failure_table, group_table, spread_table
from accpinn.study.studies import Failure
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import bound
from pages.ui.database.selection import NOT_TOLD, ShownRows, study_rows
from pages.ui.session.choices import DatabaseChoice
from pages.ui.session.resources import find_recording
from pages.ui.session.workspace import Workspace

LISTED = 100
"""Failures that are shown; the file has all of them."""
TOOLS = ("zoom2d", "pan2d", "resetScale2d")
_number = st.column_config.NumberColumn
COLUMNS: dict[str, Any] = {
    "make": "Make",
    "model": "Model",
    "distance_setting": "Setting",
    "campaign": "Campaign",
    "file": "File",
    "start": _number("From [s]", format="%.0f"),
    "tau": _number("τ [s]", format="%.2f"),
    "tau_low": _number("τ from", format="%.2f"),
    "tau_high": _number("τ to", format="%.2f"),
    "alpha": _number("α [1/s²]", format="%.3f"),
    "beta": _number("β [1/s]", format="%.3f"),
    "mean_time_gap": _number("Time gap [s]", format="%.2f"),
    "mean_speed": _number("Speed [m/s]", format="%.1f"),
    "p_l2_stable": _number("P(L₂)", format="%.2f"),
}
"""The columns of the list of rows, with headings and formats, by their names in the results."""


def show_groups(selected: ShownRows, choice: DatabaseChoice) -> None:
    groups = selected.groups
    show.table(group_table(groups, with_spread=False))
    st.caption(
        "In brackets: intervals, of the shares that are string stable, too. The files have the"
        " spread between windows as well."
    )
    show.downloads(
        group_table(selected.groups), f"{choice.study}_by_{choice.by}", "database_groups"
    )


def show_spread(selected: ShownRows, choice: DatabaseChoice) -> None:
    """How far the windows of each group differ."""
    table = spread_table(selected.groups)
    show.table(table)
    st.caption(
        "Spread: how far windows differ beyond their own standard errors, as a share of the"
        " parameter. I²: the share of the variance between estimates that is no sampling error."
    )
    show.downloads(table, f"{choice.study}_spread_by_{choice.by}", "database_spread")


def show_plane(workspace: Workspace, choice: DatabaseChoice, selected: ShownRows) -> None:
    """α and β of each row, and where string stability begins."""
    with st.container(horizontal=True, vertical_alignment="center"):
        show.key(
            [("L₂ unstable (ring)", figures.UNSTABLE), ("L₂ stable (diamond)", figures.STABLE),
             ("L₂ boundary", L2), ("L∞ boundary, exact (dashed)", EXACT)]
        )  # fmt: skip
        st.toggle(
            "In units of τ",
            **bound("database_units", choice.in_units_of_tau,
                    lambda on: choice.set(in_units_of_tau=on)),
            help="Draws ατ² and βτ: the boundaries are then the same for every vehicle.",
        )  # fmt: skip
    figure = _plane(selected, choice.in_units_of_tau)
    _chart(figure, "database_plane", choice)
    tau = selected.rows["tau"].median()
    where = "" if choice.in_units_of_tau else (
        f" The boundaries are those of the median τ, {tau:.2f} s; a vehicle with another τ has"
        " others."
    )  # fmt: skip
    away = figures.beyond(figure)
    out = f" {away:,} of {len(selected.rows):,} rows lie beyond the axes." if away else ""
    st.caption(f"String stable above the lines.{where}{out} Click on a point to open its window.")
    show_chosen(workspace, choice, selected)


@lru_cache(maxsize=16)
def _plane(selected: ShownRows, in_units_of_tau: bool) -> go.Figure:
    return figures.plane(selected.rows, in_units_of_tau)


def show_gaps(workspace: Workspace, choice: DatabaseChoice, selected: ShownRows) -> None:
    labels = _labels(selected)
    show.key([(name, colour) for name, (colour, _) in figures.colours(labels).items()])
    _chart(_gaps(selected), "database_gaps", choice)
    st.caption(
        "Each point is a follower of one window. A constant time headway is a horizontal row of"
        " points. Click on a point to open its window."
    )
    show_chosen(workspace, choice, selected)


@lru_cache(maxsize=16)
def _labels(selected: ShownRows) -> tuple[str, ...]:
    parts = selected.rows[list(selected.groups.by)].itertuples(index=False, name=None)
    return tuple(map(figures.label_of, parts))


@lru_cache(maxsize=16)
def _gaps(selected: ShownRows) -> go.Figure:
    return figures.gap_against_speed(selected.rows, _labels(selected))


def _chart(figure: go.Figure, key: str, choice: DatabaseChoice) -> None:
    def clicked() -> None:
        place = show.clicked_data(st.session_state[key]["selection"]["points"])
        if place is not None:
            choice.row = int(place)

    show.chart(figure, key, TOOLS, on_select=clicked, selection_mode="points")


def show_rows(workspace: Workspace, choice: DatabaseChoice, selected: ShownRows) -> None:
    """All rows that the filters leave; one of them can be chosen."""
    rows = selected.rows[list(COLUMNS)]

    def picked() -> None:
        if chosen := st.session_state["database_rows"]["selection"]["rows"]:
            choice.row = int(chosen[0])

    # By a callback, as the browser goes on to report the row when other rows have taken its place.
    st.dataframe(
        rows, hide_index=True, height=420, on_select=picked, selection_mode="single-row",
        key="database_rows", column_config=COLUMNS,
    )  # fmt: skip
    st.caption(
        f"{len(rows):,} rows; P(L₂): probability of L₂ string stability. Click on a heading to"
        " sort, on the magnifier to search, on the left edge of a row to choose it."
    )
    show_chosen(workspace, choice, selected)
    st.download_button(
        "CSV, all columns", lambda: selected.rows.to_csv(index=False), f"{choice.study}_rows.csv",
        "text/csv", on_click="ignore", icon=":material/download:", key="database_rows_csv",
        help="The rows shown, with intervals, stability and errors; results.parquet in the study's"
        " folder has all of them.",
    )  # fmt: skip


# One row


def show_chosen(workspace: Workspace, choice: DatabaseChoice, selected: ShownRows) -> None:
    """The row that is chosen, and the way to its window."""
    if choice.row is None or choice.row >= len(selected.rows):
        return
    row = selected.rows.iloc[choice.row]
    with st.container(border=True, horizontal=True, vertical_alignment="center"):
        end = row["start"] + row["duration"]
        who = " ".join(part for part in (row["make"], row["model"]) if part != NOT_TOLD)
        said = (
            f"{row['campaign']}, {row['file']}, {row['start']:.0f}–{end:.0f} s, vehicle"
            f" {row['vehicle']}: α {row['alpha']:.3f} 1/s², β {row['beta']:.3f} 1/s, τ"
            f" {row['tau']:.2f} s"
        )
        st.markdown(f"**{escape_markdown(who)}**  \n{escape_markdown(said)}", width="stretch")
        if st.button(
            "Open this window", icon=":material/timeline:", type="primary", key="database_open",
            help="Page Data, with this recording, window and vehicles, ready to train.",
        ):  # fmt: skip
            _open(workspace, study_rows(selected.stamp), row)


def _open(workspace: Workspace, rows: pd.DataFrame, row: "pd.Series[Any]") -> None:
    """Turn to page Data with a row's window, or say why not."""
    names = ("file", "sha256", "trajectory", "campaign")
    recording = show.attempt(lambda: find_recording(*(row[name] for name in names)))
    if recording is None:
        return
    # All that the study has of the window, whatever the filters leave of it.
    window = rows[["sha256", "start", "duration", "leader"]].eq(
        row[["sha256", "start", "duration", "leader"]]
    )
    last = int(rows[window.all(axis=1)]["vehicle"].max())
    workspace.open(recording)
    workspace.choose(
        vehicles=tuple(range(int(row["leader"]), last + 1)),
        window=Window(float(row["start"]), float(row["start"] + row["duration"])),
        case=row["case"],
    )
    frame.go(frame.DATA, workspace)


# Failures


def show_failures(failures: Sequence[Failure], study: str) -> None:
    if not failures:
        st.caption("Every file has a window, and every method a result on it.")
        return
    show.table(failure_table(failures[:LISTED]))
    if len(failures) > LISTED:
        st.caption(f"{len(failures) - LISTED} more are in the file.")
    show.downloads(failure_table(failures), f"{study}_failures", "database_failures")
