"""Whose α, β, τ the pages Stability and Platoon speak of: learned, published, or typed in."""

import math

import pandas as pd
import streamlit as st

from accpinn.errors import AccpinnError, ParameterError
from accpinn.model.cthp import Parameters
from accpinn.model.published import PUBLISHED, ParameterSet
from accpinn.results.snapshot.library import Entry
from accpinn.stability.report import StabilityReport, stability_report
from pages.ui.components.parameter_origin import (
    Learned,
    current,
    saved,
    say_not_ones_own,
    warn_unfinished,
)
from pages.ui.components.text import escape_markdown
from pages.ui.session.resources import library, opened
from pages.ui.session.ui_state import Source, TypedRow
from pages.ui.session.workspace import Workspace, sync_widget

SOURCES: dict[Source, str] = {
    "fit": "Current fit",
    "published": "Published",
    "snapshot": "Snapshot",
    "hand": "By hand",
}
COLUMNS = ("Vehicle", "α [1/s²]", "β [1/s]", "τ [s]")
BY_HAND = "parameters by hand"
MOST = 20
"""Vehicles typed in at most."""


def choose_parameters(workspace: Workspace, page: str) -> ParameterSet | None:
    """The picker, and what it stands at; None, with a sentence, where that cannot be used."""
    entries = whole_entries()
    there = {"fit": bool(workspace.fit), "snapshot": bool(entries)}
    offered = [source for source in SOURCES if there.get(source, True)]
    now = _source(workspace, entries)
    with st.container(horizontal=True, vertical_alignment="center"):
        st.segmented_control(
            "Parameters of",
            offered,
            default=now,
            format_func=SOURCES.__getitem__,
            key=sync_widget(f"{page}_source", now),
            on_change=lambda: _turn_to(workspace, st.session_state[f"{page}_source"]),
            required=True,
            label_visibility="collapsed",
        )
        if now == "published":
            _choose_example(workspace, page)
        elif now == "snapshot":
            _choose_snapshot(workspace, page, entries)
        elif learned := current(workspace) if now == "fit" else None:
            st.caption(escape_markdown(learned.title))
    say_not_ones_own(workspace, now)
    if now == "hand":
        _edit_rows(workspace, page)
    try:
        learned = _learned(workspace, now, entries)
        if learned:
            if now == "snapshot" and learned.described.excluded_regimes:
                st.caption(escape_markdown(learned.title))
            warn_unfinished(learned, now)
        return _laws(workspace, now, learned)
    except AccpinnError as fault:
        st.error(escape_markdown(str(fault)), icon=":material/error:")
        return None


def checked_report(laws: ParameterSet | None) -> StabilityReport | None:
    """What is to be said about them; None, with a sentence, where they make no sense."""
    if laws is None:
        return None
    try:
        return stability_report(laws.parameters)
    except AccpinnError as fault:
        st.error(escape_markdown(str(fault)), icon=":material/error:")
        return None


def parameters_from(workspace: Workspace, source: Source) -> ParameterSet:
    """The laws that a source holds now.

    Raises:
        ParameterError: rows that are too few or too many.
    """
    return _laws(workspace, source, _learned(workspace, source, whole_entries()))


def _learned(workspace: Workspace, source: Source, entries: tuple[Entry, ...]) -> Learned | None:
    """The fit that the source holds; None for one that holds laws alone."""
    if source == "snapshot":
        return saved(opened(_chosen_snapshot(workspace, entries)))
    return current(workspace) if source == "fit" else None


def _laws(workspace: Workspace, source: Source, learned: Learned | None) -> ParameterSet:
    if learned:
        seen = learned.described
        return ParameterSet(
            learned.title, seen.names[1:], learned.fit.parameters, seen.vehicles, seen.labels[1:]
        )
    if source == "hand":
        return _typed(workspace.laws.rows)
    return next(laws for laws in PUBLISHED if laws.title == workspace.laws.example)


def _source(workspace: Workspace, entries: tuple[Entry, ...]) -> Source:
    chosen = workspace.laws.source or "fit"
    gone = (chosen == "fit" and not workspace.fit) or (chosen == "snapshot" and not entries)
    return "published" if gone else chosen


def whole_entries() -> tuple[Entry, ...]:
    """The server's snapshots that can be read, the newest first; every call looks at all files."""
    return tuple(entry for entry in library().entries() if not entry.fault)


def _chosen_snapshot(workspace: Workspace, entries: tuple[Entry, ...]) -> str:
    """The one chosen, or the newest where that was deleted meanwhile."""
    names = [entry.id for entry in entries]
    return workspace.laws.snapshot if workspace.laws.snapshot in names else names[0]


def _choose_snapshot(workspace: Workspace, page: str, entries: tuple[Entry, ...]) -> None:
    key, now = f"{page}_snapshot", _chosen_snapshot(workspace, entries)
    titles = {e.id: f"{e.name.strip() or e.id} · {e.source}" for e in entries}

    def changed() -> None:
        workspace.laws.snapshot = st.session_state[key]
        workspace.drive.forget()

    st.selectbox(
        "Snapshot",
        list(titles),
        index=list(titles).index(now),
        format_func=lambda name: titles.get(name, name),
        key=sync_widget(key, now),
        on_change=changed,
        label_visibility="collapsed",
        width=420,
    )


def _turn_to(workspace: Workspace, source: Source) -> None:
    """Change the source; the first rows by hand are a copy of what was shown."""
    choice = workspace.laws
    if source == "hand" and not choice.rows:
        laws = parameters_from(workspace, _source(workspace, whole_entries()))
        choice.rows = tuple(
            (label, law.alpha, law.beta, law.tau)
            for label, law in zip(laws.labels, laws.parameters, strict=True)
        )
    choice.source = source
    workspace.drive.forget()


def _choose_example(workspace: Workspace, page: str) -> None:
    key, titles = f"{page}_example", [laws.title for laws in PUBLISHED]

    def changed() -> None:
        workspace.laws.example = st.session_state[key]
        workspace.drive.forget()

    st.selectbox(
        "Published set",
        titles,
        index=titles.index(workspace.laws.example),
        key=sync_widget(key, workspace.laws.example),
        on_change=changed,
        label_visibility="collapsed",
        width=320,
    )


def _edit_rows(workspace: Workspace, page: str) -> None:
    """A table of vehicles to type into; it keeps its own changes while it is on the page."""
    choice, key = workspace.laws, f"{page}_rows"
    if key not in st.session_state:
        choice.base = choice.rows
    number = st.column_config.NumberColumn
    edited = st.data_editor(
        pd.DataFrame(list(choice.base), columns=list(COLUMNS)),
        key=key,
        num_rows="dynamic",
        hide_index=True,
        width=560,
        column_config={
            COLUMNS[0]: st.column_config.TextColumn(max_chars=40),
            COLUMNS[1]: number(format="%.4f", step=0.0001, help="Gain on the spacing error"),
            COLUMNS[2]: number(format="%.4f", step=0.0001, help="Gain on the relative speed"),
            COLUMNS[3]: number(format="%.3f", step=0.001, help="Desired time headway"),
        },
    )
    rows = tuple(_row(*row) for row in edited.itertuples(index=False, name=None))
    if len(rows) != len(choice.rows):
        workspace.drive.forget()
    choice.rows = rows


def _row(name: object, *values: float | None) -> TypedRow:
    alpha, beta, tau = (None if v is None or math.isnan(v) else float(v) for v in values)
    return (name if isinstance(name, str) else "", alpha, beta, tau)


def _typed(rows: tuple[TypedRow, ...]) -> ParameterSet:
    if not 0 < len(rows) <= MOST:
        raise ParameterError(
            f"The table has {len(rows)} vehicles; give at least one and at most {MOST}."
        )
    names = tuple(name.strip() or f"Vehicle {k}" for k, (name, *_) in enumerate(rows, 1))
    laws = Parameters.of([[math.nan if v is None else v for v in values] for _, *values in rows])
    return ParameterSet(BY_HAND, names, laws)
