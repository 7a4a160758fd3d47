"""Whose parameters the pages Stability and Platoon show: an estimate's, published, or typed in."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import streamlit as st

from accpinn.channels import PARAMETERS
from accpinn.errors import ParameterError
from accpinn.inference.intervals import from_draws, of_first
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, PUBLISHED, ParameterSet
from accpinn.results.messages.summary import unfinished
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.results.vehicles import KnownVehicles, known_vehicles
from accpinn.study.result import Result
from accpinn.study.store import Entry
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown, segments, select
from pages.ui.session.resources import opened
from pages.ui.session.sessions import readable_snapshots
from pages.ui.session.workspace import ParameterSource, Workspace
from pages.ui.snapshots.listing import choose_entry

SOURCES: dict[ParameterSource, str] = {
    "estimate": "Estimate",
    "several": "Cars from several results",
    "published": "Published",
    "snapshot": "Snapshot",
    "hand": "By hand",
}
COLUMNS = ("Vehicle", *(parameter.heading for parameter in PARAMETERS))
BY_HAND = "parameters by hand"
EXAMPLE, SNAPSHOT, ROWS, BASE, SHOWN = (
    f"parameters_{name}" for name in ("example", "snapshot", "rows", "base", "shown")
)
"""Names of choices: title of a published set, short name of a snapshot, the rows by hand, now
and when the table came to the page, and the vehicles shown last."""
OF_VEHICLES = (
    "stability_held", "stability_measured", "stability_speed", "laboratory_frequency",
    "laboratory_platoon", "platoon_vehicle", "platoon_sinusoid_frequency", "platoon_own",
)  # fmt: skip
"""Choices among vehicles, which say nothing of others."""
MOST = 20
"""Vehicles typed in at most."""


def choose_parameters(workspace: Workspace, page: str, lead: str) -> KnownVehicles | None:
    """The picker below what it is about, and the parameters chosen; None without a verdict.

    ``page`` begins the keys of the widgets; ``lead`` is the caption for those of no recording.
    """
    about = st.empty()
    about.caption(lead)
    # Every call looks at all files of the store; the newest snapshot comes first.
    entries, choices = readable_snapshots(workspace.id), workspace.choices
    absent = {"snapshot"} if not entries else set[str]()
    absent |= {"several"} if not cars_of(workspace) else set()
    source = workspace.parameter_source
    if source in absent:
        source = "estimate"
    with st.container(horizontal=True, vertical_alignment="center"):
        offered = {key: name for key, name in SOURCES.items() if key not in absent}
        segments("Parameters of", offered, source, f"{page}_source", workspace.choose_source)
        if source == "published":
            select(
                "Published set", {published.title: published.title for published in PUBLISHED},
                ASTAZERO.title, EXAMPLE, workspace, labelled=False, width=320,
            )  # fmt: skip
        elif source == "snapshot":
            choose_entry(workspace, "Snapshot", SNAPSHOT, entries, labelled=False, width=420)
    if source == "hand":
        _edit_rows(workspace, f"{page}_rows")
    chosen = parameters_from(workspace, source, entries)
    if chosen is None:
        _empty_state(workspace, page)
        return None
    now, before = chosen.vehicles, choices.get(SHOWN, chosen.vehicles)
    if (before.title, before.labels) != (now.title, now.labels):
        for key in OF_VEHICLES:
            choices.pop(key, None)
    choices[SHOWN] = now
    if not (result := chosen.result):
        return chosen
    about.caption(frame.segment_line(result.info, result.analysis.case, result.analysis.windows))
    if page != "platoon":  # which has only some of the vehicles, and says it of these
        show.not_acc(result.info)
    if not (missing := unfinished(result.estimate)):
        return chosen
    with st.container(border=True):
        st.markdown(f"{escape_markdown(chosen.origin)}\n\n#### No verdict")
        show.messages(missing, "warning", "pause_circle")
        if source == "estimate":
            frame.link(frame.TRAIN, "Continue the training", workspace)
    return None


def _empty_state(workspace: Workspace, page: str) -> None:
    training = workspace.training
    if training and training.is_active:
        show.messages(
            "The training is not finished; its parameters will be shown here.", icon="hourglass_top"
        )
    else:
        show.messages("There is no estimate yet: train on a window, or open a published example.")
    with st.container(horizontal=True, vertical_alignment="center"):
        if workspace.recording:
            frame.link(frame.TRAIN, "Go to Train", workspace)
        else:
            frame.link(frame.DATA, "Open a recording", workspace)
        st.button(
            "Open a published example", icon=":material/menu_book:", key=f"{page}_open_example",
            on_click=workspace.choose_source, args=("published",),
        )  # fmt: skip


def parameters_from(
    workspace: Workspace, source: ParameterSource, entries: tuple[Entry, ...]
) -> KnownVehicles | None:
    """The parameters that a source holds now; None for the estimate where there is none.

    Raises:
        ParameterError: rows by hand that are too few or too many.
    """
    choices = workspace.choices
    if source == "published":
        title = choices.get(EXAMPLE, ASTAZERO.title)
        vehicles = next(published for published in PUBLISHED if published.title == title)
        return KnownVehicles(vehicles, origin=f"{SOURCES[source]}: {title}")
    if source == "hand":
        return KnownVehicles(_typed(choices.get(ROWS, ())), origin=SOURCES[source])
    if source == "several":
        return _of_several(cars_of(workspace))
    result = workspace.result
    if source == "snapshot":
        result = opened(_chosen_snapshot(workspace, entries))
    if result is None:
        return None
    subject = known_vehicles(result)
    vehicles, known = subject.vehicles, subject.uncertainty
    if result.info.shares(result.estimate.case):  # one stands for all
        known = of_first(known) if known else None
        vehicles = ParameterSet(
            vehicles.title, (EVERY_FOLLOWER,), vehicles.parameters[:1],
            (result.info.vehicles[0], 0), by_hand=tuple(filter(None, vehicles.by_hand))[:1],
            model=vehicles.model,
        )  # fmt: skip
    origin = f"{SOURCES[source]}: {vehicles.title}"
    return replace(subject, vehicles=vehicles, uncertainty=known, origin=origin)


def cars_of(workspace: Workspace) -> tuple[tuple[Result, int], ...]:
    """The result and the place in it of each follower, its own result before the present one.

    Empty where no follower of the present result has one of its own.
    """
    result, own = workspace.result, workspace.own_results
    if result is None or not own.keys() & {*result.info.vehicles[1:]}:
        return ()
    return tuple(
        (own[number], 0) if number in own else (result, k)
        for k, number in enumerate(result.info.vehicles[1:])
    )


def _of_several(cars: Sequence[tuple[Result, int]]) -> KnownVehicles:
    """Vehicles of several results, each near its median speed."""
    labels = [result.info.labels[k + 1] for result, k in cars]
    vehicles = ParameterSet(
        "several results",
        tuple(result.info.names[k + 1] for result, k in cars),
        Parameters.of([result.parameters.complete[k] for result, k in cars]),
        (cars[0][0].info.vehicles[0], *(result.info.vehicles[k + 1] for result, k in cars)),
        tuple(labels),
    )
    checks = tuple(
        check
        for result, k in cars
        for check in result.gain_checks
        if check.vehicle == result.info.vehicles[k + 1]
    )
    models = (result.estimate.following.title for result, _ in cars)
    said = "; ".join(f"{label}: {model}" for label, model in zip(labels, models, strict=True))
    known = [(result.uncertainty, k) for result, k in cars]
    draws = [part.draws.complete[:, k] for part, k in known if part]
    uncertainty = None
    if len(draws) == len(cars):
        level = min(result.estimate.level or 0.0 for result, _ in cars)
        drawn = Parameters.of(np.stack(draws, axis=1))
        uncertainty = from_draws(vehicles.parameters, drawn, level)
    origin = f"{SOURCES['several']}: {said}"
    return KnownVehicles(vehicles, uncertainty, checks, origin=origin, cars=tuple(cars))


def _chosen_snapshot(workspace: Workspace, entries: tuple[Entry, ...]) -> str:
    """The one chosen, or the newest where that was deleted meanwhile."""
    names = [entry.id for entry in entries]
    chosen = workspace.choices.get(SNAPSHOT)
    return chosen if chosen in names else names[0]


def _edit_rows(workspace: Workspace, key: str) -> None:
    """A table of vehicles to type into, to begin with those shown last.

    It keeps its own changes while it is on the page.
    """
    choices = workspace.choices
    if ROWS not in choices:
        shown = choices.get(SHOWN, ASTAZERO)
        each = zip(shown.labels, shown.parameters, strict=True)
        choices[ROWS] = tuple((label, one.alpha, one.beta, one.tau) for label, one in each)
    if key not in st.session_state:
        choices[BASE] = choices[ROWS]
    number = st.column_config.NumberColumn
    edited = st.data_editor(
        pd.DataFrame(list(choices[BASE]), columns=list(COLUMNS)),
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
    choices[ROWS] = tuple(edited.itertuples(index=False, name=None))


def _typed(rows: Sequence[tuple[Any, ...]]) -> ParameterSet:
    """The vehicles of a table of names, α, β and τ; an empty cell is None or nan."""
    if not 0 < len(rows) <= MOST:
        raise ParameterError(
            f"The table has {len(rows)} vehicles; give at least one and at most {MOST}."
        )
    table = pd.DataFrame(rows)
    names = table[0].astype(object).fillna("").str.strip()
    known = tuple(name or f"Vehicle {k}" for k, name in enumerate(names, 1))
    return ParameterSet(BY_HAND, known, Parameters.of(table.iloc[:, 1:].to_numpy(float)))
