"""Whose α, β, τ the pages Stability and Platoon show: learned, published, or typed in."""

import math

import pandas as pd
import streamlit as st

from accpinn.channels import PARAMETERS
from accpinn.errors import ParameterError
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters
from accpinn.model.published import PUBLISHED, ParameterSet
from accpinn.results.messages.methods import unfinished
from accpinn.results.snapshot.saved import Entry
from accpinn.results.tables.estimates import learned_parameters, where
from accpinn.segment.segment import SegmentInfo
from pages.ui.components.messages import attempt, escape_markdown, show_messages
from pages.ui.components.widgets import segments, select
from pages.ui.session.resources import library, opened
from pages.ui.session.ui_state import Source, TypedRow
from pages.ui.session.workspace import Workspace

SOURCES: dict[Source, str] = {
    "fit": "Current fit",
    "published": "Published",
    "snapshot": "Snapshot",
    "hand": "By hand",
}
COLUMNS = ("Vehicle", *(parameter.heading for parameter in PARAMETERS))
BY_HAND = "parameters by hand"
MOST = 20
"""Vehicles typed in at most."""


def choose_parameters(workspace: Workspace, page: str) -> ParameterSet | None:
    """The picker, and the parameters chosen; None, with a sentence, where they cannot be used."""
    entries = readable_entries()
    missing = {"fit": not workspace.fit, "snapshot": not entries}
    offered = {source: name for source, name in SOURCES.items() if not missing.get(source)}
    source = _source(workspace, entries)
    with st.container(horizontal=True, vertical_alignment="center"):
        segments(
            "Parameters of", offered, source, f"{page}_source",
            lambda chosen: _turn_to(workspace, chosen),
        )  # fmt: skip
        if source == "published":
            _choose_example(workspace, page)
        elif source == "snapshot":
            _choose_snapshot(workspace, page, entries)
        elif source == "fit" and workspace.fit_info:
            st.caption(escape_markdown(where(workspace.fit_info)))
    _warn_not_own(workspace, source)
    if source == "hand":
        _edit_rows(workspace, page)
    return attempt(lambda: _show_chosen(workspace, source, entries))


def _show_chosen(workspace: Workspace, source: Source, entries: tuple[Entry, ...]) -> ParameterSet:
    """The parameters chosen; what limits the fit that they are from is shown."""
    learned = _learned(workspace, source, entries)
    if not learned:
        return _without_fit(workspace, source)
    info, fit = learned
    if source == "snapshot" and info.excluded_regimes:
        st.caption(escape_markdown(where(info)))
    if sentence := unfinished(fit):
        cure = " Continue it on page Train." if source == "fit" else ""
        show_messages(sentence + cure, "warning", "pause_circle")
    return learned_parameters(info, fit)


def parameters_from(workspace: Workspace, source: Source) -> ParameterSet:
    """The parameters that a source holds now.

    Raises:
        ParameterError: rows that are too few or too many.
    """
    learned = _learned(workspace, source, readable_entries())
    return learned_parameters(*learned) if learned else _without_fit(workspace, source)


def _learned(
    workspace: Workspace, source: Source, entries: tuple[Entry, ...]
) -> tuple[SegmentInfo, Fit] | None:
    """The fit that the source holds; None for one that holds parameters alone."""
    fit, info = workspace.fit, workspace.fit_info
    if source == "snapshot":
        snapshot = opened(_chosen_snapshot(workspace, entries))
        return snapshot.info, snapshot.fit
    return (info, fit) if source == "fit" and fit and info else None


def _without_fit(workspace: Workspace, source: Source) -> ParameterSet:
    choice = workspace.parameter_choice
    if source == "hand":
        return _typed(choice.rows)
    return next(published for published in PUBLISHED if published.title == choice.example)


def _source(workspace: Workspace, entries: tuple[Entry, ...]) -> Source:
    chosen = workspace.parameter_choice.source or "fit"
    gone = (chosen == "fit" and not workspace.fit) or (chosen == "snapshot" and not entries)
    return "published" if gone else chosen


def readable_entries() -> tuple[Entry, ...]:
    """The server's snapshots that can be read, the newest first; every call looks at all files."""
    return tuple(entry for entry in library().entries() if not entry.fault)


def _chosen_snapshot(workspace: Workspace, entries: tuple[Entry, ...]) -> str:
    """The one chosen, or the newest where that was deleted meanwhile."""
    names = [entry.id for entry in entries]
    chosen = workspace.parameter_choice.snapshot
    return chosen if chosen in names else names[0]


def _warn_not_own(workspace: Workspace, source: Source) -> None:
    """Published parameters are shown until one's own are learned."""
    choice, training = workspace.parameter_choice, workspace.training
    asked = choice.source in (None, "fit")
    if source == "published" and asked and training and training.is_active:
        show_messages(
            f"These are published parameters, those of {choice.example}: your own training is not"
            " finished. Once it is done, this page shows its parameters.",
            icon="hourglass_top",
        )


def _turn_to(workspace: Workspace, source: Source) -> None:
    """Change the source; the first rows by hand are a copy of what was shown."""
    choice = workspace.parameter_choice
    if source == "hand" and not choice.rows:
        shown = parameters_from(workspace, _source(workspace, readable_entries()))
        choice.rows = tuple(
            (label, vehicle.alpha, vehicle.beta, vehicle.tau)
            for label, vehicle in zip(shown.labels, shown.parameters, strict=True)
        )
    _set(workspace, source=source)


def _set(workspace: Workspace, **choices: str) -> None:
    for name, value in choices.items():
        setattr(workspace.parameter_choice, name, value)
    workspace.platoon_choice.reset()


def _choose_snapshot(workspace: Workspace, page: str, entries: tuple[Entry, ...]) -> None:
    titles = {e.id: f"{e.name.strip() or e.id} · {e.source}" for e in entries}
    select(
        "Snapshot", titles, _chosen_snapshot(workspace, entries), f"{page}_snapshot",
        lambda name: _set(workspace, snapshot=name), lambda name: titles.get(name, name),
        labelled=False, width=420,
    )  # fmt: skip


def _choose_example(workspace: Workspace, page: str) -> None:
    select(
        "Published set", [published.title for published in PUBLISHED],
        workspace.parameter_choice.example, f"{page}_example",
        lambda title: _set(workspace, example=title), labelled=False, width=320,
    )  # fmt: skip


def _edit_rows(workspace: Workspace, page: str) -> None:
    """A table of vehicles to type into; it keeps its own changes while it is on the page."""
    choice, key = workspace.parameter_choice, f"{page}_rows"
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
        workspace.platoon_choice.reset()
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
    values = [[math.nan if v is None else v for v in values] for _, *values in rows]
    return ParameterSet(BY_HAND, names, Parameters.of(values))
