"""The page Database: parameters of many vehicles by make, model and setting, and how sure they are.

A study is the folder of one batch of estimations on the server. Its tabs are in
`pages.ui.database.views`, the batch that fills it in `pages.ui.database.running`.
"""

import pandas as pd
import streamlit as st

from accpinn.methods.maximum_likelihood import KEY
from accpinn.results.figures.database import MOST_GROUPS
from accpinn.results.messages.database import (
    DEPENDENT,
    batch_line,
    extent,
    failures_line,
    headline,
    typical_line,
)
from accpinn.results.tables.estimates import TITLES
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import bound, select, tabs
from pages.ui.database import running, views
from pages.ui.database.selection import (
    FILTERS,
    GROUPINGS,
    ShownRows,
    Stamp,
    failures_of,
    folder_of,
    follow_link,
    known_studies,
    query,
    request_of,
    shown,
    study_rows,
    write_link,
)
from pages.ui.session.choices import DatabaseChoice
from pages.ui.session.resources import batch_queue
from pages.ui.session.workspace import Workspace

LEAD = (
    "Which headway and gains each make, model and distance setting has, how sure that is, and how"
    " many are string stable."
)


def show_page() -> None:
    workspace = frame.begin("Database")
    choice = workspace.database_choice
    follow_link(choice)
    # Of a batch that waits nothing may be written yet.
    names = tuple(dict.fromkeys((*batch_queue().active_owners("batch"), *known_studies())))
    refused = choice.study not in names and running.show_refusal(choice.study)
    if not names:
        _show_empty(workspace, choice)
        return
    if choice.study not in names:
        if choice.study and not refused:
            show.messages(f"There is no study {choice.study[:60]} on this server.", "warning")
        choice.set(study=names[0], row=None)
    folder = folder_of(choice.study)
    stamp = Stamp.of(folder)
    _show_head(workspace, choice, names)
    show.attempt(lambda: _show_body(workspace, choice, stamp))
    write_link(choice)


def _show_body(workspace: Workspace, choice: DatabaseChoice, stamp: Stamp) -> None:
    running.show_batch(choice.study, request_of(stamp))
    rows = study_rows(stamp) if stamp.state else pd.DataFrame()
    if len(rows):
        _show_study(workspace, choice, stamp, rows)
        return
    show.messages("The study has no rows yet.")
    if stamp.state:
        views.show_failures(failures_of(stamp), choice.study)


def _show_empty(workspace: Workspace, choice: DatabaseChoice) -> None:
    st.caption(LEAD)
    show.messages(
        "There is no study on this server yet. A study holds the estimates from every window in"
        " car-following under ACC of a folder of recordings: choose the folder, then start."
    )
    with st.container(border=True):
        running.show_form(workspace, choice)


def _show_head(workspace: Workspace, choice: DatabaseChoice, names: tuple[str, ...]) -> None:
    named, new, link = st.columns((3.2, 1, 1), gap="small", vertical_alignment="bottom")
    with named:
        select(
            "Study", {name: name for name in names}, choice.study, "database_study",
            lambda name: choice.set(study=name, filters={}, method="", row=None),
            help="The estimates from one folder of recordings; the one written to last is first.",
        )  # fmt: skip
    popover = new.popover(
        "New batch", icon=":material/playlist_add:", width="stretch", key="database_new",
        on_change="rerun",
        help="Estimate the parameters from all windows of a folder of recordings.",
    )  # fmt: skip
    if popover.open:
        with popover:
            running.show_form(workspace, choice)
    with link.popover("Link to this view", icon=":material/share:", width="stretch"):
        st.caption("It opens this study with these filters, without your session.")
        show.address(f"Database?{query(choice)}")


def _show_study(
    workspace: Workspace, choice: DatabaseChoice, stamp: Stamp, rows: pd.DataFrame
) -> None:
    methods = list(dict.fromkeys(rows["method"]))
    if choice.method not in methods:
        choice.method = KEY if KEY in methods else methods[0]
    with st.container(key="later_1_database_filters"):
        _show_filters(choice, rows, methods)
    filters = tuple(sorted((name, values) for name, values in choice.filters.items() if values))
    selected = shown(stamp, filters, choice.method, choice.by)
    failures = failures_of(stamp)
    if selected.whole is None:
        show.messages("No row has these properties; take a filter back.")
        return
    answer, chart = st.columns((1, 2.1), gap="medium")
    with answer, st.container(border=True):
        level = selected.groups.level
        st.markdown(f"#### {escape_markdown(headline(selected.whole, level))}")
        said = extent(selected.whole, selected.makes, selected.recordings)
        st.markdown(escape_markdown(f"{said} {typical_line(selected.whole)}"))
        st.caption(DEPENDENT)
        if line := failures_line(failures):
            st.caption(f":material/error: {escape_markdown(line)}")
    with chart:
        _show_forest(selected, batch_line(request_of(stamp)))
    drawn = {
        "Groups": lambda: views.show_groups(selected, choice),
        "Spread": lambda: views.show_spread(selected, choice),
        "α–β plane": lambda: views.show_plane(workspace, choice, selected),
        "Time gap": lambda: views.show_gaps(workspace, choice, selected),
        "All rows": lambda: views.show_rows(workspace, choice, selected),
        "Failures": lambda: views.show_failures(failures, choice.study),
    }
    tabs(workspace, "database_tabs", drawn)


def _show_filters(choice: DatabaseChoice, rows: pd.DataFrame, methods: list[str]) -> None:
    columns = st.columns(
        (0.95, 0.95, 0.95, 0.95, 0.8, 1.35, 1.15), gap="small", vertical_alignment="bottom"
    )
    for column, (name, label) in zip(columns, FILTERS.items(), strict=False):
        there = sorted(rows[name].unique())
        kept = [value for value in choice.filters.get(name, ()) if value in there]

        def choose(values: list[str], name: str = name) -> None:
            choice.set(filters={**choice.filters, name: tuple(values)}, row=None)

        column.multiselect(
            label, there, placeholder="All",
            **bound(f"database_{name}", kept, choose, default=""),
            help=f"Only rows with one of these; all where none is chosen. {len(there)} are there.",
        )  # fmt: skip
        choice.filters[name] = tuple(kept)
    titles = {key: TITLES.get(key, key) for key in methods}
    select(
        "Method", titles, choice.method, "database_method",
        lambda key: choice.set(method=key, row=None), place=columns[5],
        help="Whose estimates; the intervals are those of the exact likelihood for all methods.",
    )  # fmt: skip
    select(
        "Grouped by", {key: title for key, (title, _) in GROUPINGS.items()}, choice.by,
        "database_by", lambda by: choice.set(by=by), place=columns[6],
        help="What the rows of a group have in common.",
    )  # fmt: skip


def _show_forest(selected: ShownRows, about: str) -> None:
    show.chart(selected.forest, "database_forest")
    hidden, level = len(selected.groups.groups) - MOST_GROUPS, 100 * selected.groups.level
    more = f" {hidden} groups with fewer windows are in the table only." if hidden > 0 else ""
    st.caption(
        f"Median over the windows of each group with its {level:.0f} % interval; a larger dot"
        f" stands for more windows.{more} {about}"
    )
