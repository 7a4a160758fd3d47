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
from pages.ui.components import show
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import segments, select
from pages.ui.session.resources import library, opened
from pages.ui.session.workspace import Source, TypedRow, Workspace

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
    choice, training = workspace.parameter_choice, workspace.training
    # Every call looks at all files of the store; the newest snapshot comes first.
    entries = tuple(entry for entry in library().entries() if not entry.fault)
    missing = {"fit": not workspace.fit, "snapshot": not entries}
    asked = choice.source or "fit"
    source: Source = "published" if missing.get(asked) else asked

    def turn_to(new: Source) -> None:
        """The first rows by hand are a copy of what was shown."""
        if new == "hand" and not choice.rows:
            shown = parameters_from(workspace, source, entries)
            choice.rows = tuple(
                (label, vehicle.alpha, vehicle.beta, vehicle.tau)
                for label, vehicle in zip(shown.labels, shown.parameters, strict=True)
            )
        choose(source=new)

    def choose(**choices: str) -> None:
        for name, value in choices.items():
            setattr(choice, name, value)
        workspace.platoon_choice.reset()

    with st.container(horizontal=True, vertical_alignment="center"):
        offered = {source: name for source, name in SOURCES.items() if not missing.get(source)}
        segments("Parameters of", offered, source, f"{page}_source", turn_to)
        if source == "published":
            select(
                "Published set", {published.title: published.title for published in PUBLISHED},
                choice.example, f"{page}_example", lambda title: choose(example=title),
                labelled=False, width=320,
            )  # fmt: skip
        elif source == "snapshot":
            select(
                "Snapshot", {e.id: f"{e.name.strip() or e.id} · {e.source}" for e in entries},
                _chosen_snapshot(workspace, entries), f"{page}_snapshot",
                lambda name: choose(snapshot=name), labelled=False, width=420,
            )  # fmt: skip
        elif source == "fit" and workspace.fit_info:
            st.caption(escape_markdown(where(workspace.fit_info)))
    if source == "published" and asked == "fit" and training and training.is_active:
        show.messages(
            f"These are published parameters, those of {choice.example}: your own training is not"
            " finished. Once it is done, this page shows its parameters.",
            icon="hourglass_top",
        )
    if source == "hand":
        _edit_rows(workspace, f"{page}_rows")

    def chosen() -> ParameterSet:
        if learned := _learned(workspace, source, entries):
            info, fit = learned
            if source == "snapshot" and info.excluded_regimes:
                st.caption(escape_markdown(where(info)))
            cure = " Continue it on page Train." if source == "fit" else ""
            if sentence := unfinished(fit):
                show.messages(sentence + cure, "warning", "pause_circle")
        return parameters_from(workspace, source, entries)

    return show.attempt(chosen)


def parameters_from(
    workspace: Workspace, source: Source, entries: tuple[Entry, ...]
) -> ParameterSet:
    """The parameters that a source holds now.

    Args:
        workspace: the session.
        source: one that can be chosen.
        entries: the server's snapshots, those that can be read.

    Raises:
        ParameterError: rows that are too few or too many.
    """
    if learned := _learned(workspace, source, entries):
        return learned_parameters(*learned)
    choice = workspace.parameter_choice
    if source == "hand":
        return _typed(choice.rows)
    return next(published for published in PUBLISHED if published.title == choice.example)


def _learned(
    workspace: Workspace, source: Source, entries: tuple[Entry, ...]
) -> tuple[SegmentInfo, Fit] | None:
    """The fit that the source holds; None for one that holds parameters alone."""
    fit, info = workspace.fit, workspace.fit_info
    if source == "snapshot":
        snapshot = opened(_chosen_snapshot(workspace, entries))
        return snapshot.info, snapshot.fit
    return (info, fit) if source == "fit" and fit and info else None


def _chosen_snapshot(workspace: Workspace, entries: tuple[Entry, ...]) -> str:
    """The one chosen, or the newest where that was deleted meanwhile."""
    names = [entry.id for entry in entries]
    chosen = workspace.parameter_choice.snapshot
    return chosen if chosen in names else names[0]


def _edit_rows(workspace: Workspace, key: str) -> None:
    """A table of vehicles to type into; it keeps its own changes while it is on the page."""
    choice = workspace.parameter_choice
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
