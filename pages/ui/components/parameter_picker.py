"""Whose parameters the pages Stability and Platoon show: an estimate's, published, or typed in."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import streamlit as st

from accpinn.errors import ParameterError
from accpinn.inference.intervals import from_draws, of_first
from accpinn.model.cthp import TERMS, Parameters
from accpinn.model.following import DELAY, LAG
from accpinn.model.published import ASTAZERO, PUBLISHED, ParameterSet
from accpinn.model.registry import CTHP_S0, FOLLOWING, PAPER
from accpinn.platoon.leader import Sinusoid
from accpinn.results.messages.summary import unfinished
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.study.result import Result
from accpinn.study.store import Entry
from accpinn.study.vehicles import AssessedVehicles, assessed_vehicles, typed_vehicles
from accpinn.units import FloatArray
from pages.ui.components import frame, show
from pages.ui.components.show import bound, escape_markdown, segments, select
from pages.ui.session.resources import opened
from pages.ui.session.saved import readable_snapshots
from pages.ui.session.workspace import ParameterSource, Workspace
from pages.ui.snapshots.listing import choose_entry

SOURCES: dict[ParameterSource, str] = {
    "estimate": "Estimate",
    "several": "Cars from several results",
    "published": "Published",
    "snapshot": "Snapshot",
    "hand": "By hand",
}
OF_CTHP = (*CTHP_S0.parameters, LAG, DELAY)
"""The parameters of every CTHP, in the order of `Parameters.complete`."""
SPEED_COLUMN = "at [m/s]"
"""Heading of the speed at which a model is linearised that is no CTHP."""
BY_HAND = "parameters by hand"
EXAMPLE, SNAPSHOT, MODEL, ROWS, OF_MODELS, BASE, EDITION, SHOWN, TAKEN = (
    f"parameters_{name}"
    for name in ("example", "snapshot", "model", "rows", "of_models", "base", "edition", "shown",
                 "taken")
)  # fmt: skip
"""Names of choices: title of a published set, short name of a snapshot, the model by hand and its
rows, those of other models before, the rows when the table came to the page, how often they came
from elsewhere than the table, the vehicles shown last, and the model and rows of those shown last
that were not typed in."""
Row = tuple[Any, ...]
"""A vehicle by hand: its name, its parameters with all digits, and for a model that is no CTHP the
speed at which it is linearised; an empty cell is None or nan."""
OF_VEHICLES = (
    "stability_held", "stability_measured", "stability_speed", "stability_impulse",
    "laboratory_frequency",
    "laboratory_platoon", "platoon_vehicle", "platoon_sinusoid_frequency", "platoon_own",
)  # fmt: skip
"""Choices among vehicles, which say nothing of others."""
MOST = 20
"""Vehicles typed in at most."""


def choose_parameters(workspace: Workspace, page: str, lead: str) -> AssessedVehicles | None:
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
            with st.popover("Parameters", icon=":material/edit:", width=150):
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
    if source != "hand":
        choices[TAKEN] = rows_of(chosen)
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
) -> AssessedVehicles | None:
    """The parameters that a source holds now; None for the estimate where there is none.

    Raises:
        ParameterError: rows by hand that are too few or too many.
    """
    choices = workspace.choices
    if source == "published":
        title = choices.get(EXAMPLE, ASTAZERO.title)
        vehicles = next(published for published in PUBLISHED if published.title == title)
        return AssessedVehicles(vehicles, origin=f"{SOURCES[source]}: {title}")
    if source == "hand":
        return _typed(choices.get(MODEL, PAPER), choices.get(ROWS, ()))
    if source == "several":
        return of_several(cars_of(workspace))
    result = workspace.result
    if source == "snapshot":
        result = opened(_chosen_snapshot(workspace, entries))
    if result is None:
        return None
    subject = assessed_vehicles(result)
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

    Empty where no follower has one of its own. Without a present result there are these alone.
    """
    result, own = workspace.result, workspace.own_results
    if result is None:
        return tuple((own[number], 0) for number in sorted(own))
    if not own.keys() & {*result.info.vehicles[1:]}:
        return ()
    return tuple(
        (own[number], 0) if number in own else (result, k)
        for k, number in enumerate(result.info.vehicles[1:])
    )


def of_several(cars: Sequence[tuple[Result, int]]) -> AssessedVehicles:
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
    return AssessedVehicles(vehicles, uncertainty, checks, origin=origin, cars=tuple(cars))


def _chosen_snapshot(workspace: Workspace, entries: tuple[Entry, ...]) -> str:
    """The one chosen, or the newest where that was deleted meanwhile."""
    names = [entry.id for entry in entries]
    chosen = workspace.choices.get(SNAPSHOT)
    return chosen if chosen in names else names[0]


def rows_of(subject: AssessedVehicles) -> tuple[str, tuple[Row, ...]]:
    """The model of some vehicles, and their rows by hand."""
    vehicles, parameters = subject.vehicles, subject.vehicles.parameters
    if not parameters.nonlinear.size:
        rows = zip(vehicles.labels, *parameters.complete.T.tolist(), strict=True)
        return PAPER, tuple(rows)
    speeds = _speeds_of(subject).tolist()
    own = zip(vehicles.labels, *parameters.nonlinear.T.tolist(), speeds, strict=True)
    return vehicles.model, tuple(own)


def _speeds_of(subject: AssessedVehicles) -> FloatArray:
    """(M,) the speeds in m/s at which vehicles are linearised."""
    count = len(subject.vehicles)
    if subject.result and subject.speed is None:
        return subject.result.estimate.speeds[:count]
    return np.full(count, subject.speed or Sinusoid.speed)


def _edit_rows(workspace: Workspace, key: str) -> None:
    """The model, the number of cars, and a table to type into, to begin with those shown last.

    The table keeps its own changes while it is on the page.
    """
    choices = workspace.choices
    taken = choices.get(TAKEN) or rows_of(AssessedVehicles(ASTAZERO))
    if ROWS not in choices:
        choices[MODEL], choices[ROWS] = taken
    model, rows = choices.get(MODEL, PAPER), choices[ROWS]

    def choose_model(chosen: str) -> None:
        choices[OF_MODELS] = {**choices.get(OF_MODELS, {}), model: rows}
        usual = tuple((row[0], *_usual_row(chosen)[1:]) for row in rows)
        change(chosen, choices[OF_MODELS].get(chosen, usual))

    def change(model: str, rows: Sequence[Row]) -> None:
        choices.update({MODEL: model, ROWS: tuple(rows), EDITION: choices.get(EDITION, 0) + 1})

    def count(cars: float) -> None:
        last = rows[-1] if rows else _usual_row(model)
        added = [(f"Vehicle {k + 1}", *last[1:]) for k in range(len(rows), int(cars))]
        change(model, [*rows[: int(cars)], *added])

    with st.container(horizontal=True, vertical_alignment="bottom"):
        select("Model", _models(), model, f"{key}_model", choose_model, width=240)
        st.number_input(
            "Cars", min_value=1, max_value=MOST, step=1, width=130,
            help="A further car is like the last; change its values in its row.",
            **bound(f"{key}_cars", min(max(len(rows), 1), MOST), count),
        )  # fmt: skip
    columns = _columns(model)
    table = f"{key}_{choices.get(EDITION, 0)}"
    if table not in st.session_state:
        choices[BASE] = tuple(_padded(row, len(columns)) for row in rows)
    edited = st.data_editor(
        pd.DataFrame(list(choices[BASE]), columns=[*columns]),
        key=table,
        num_rows="dynamic",
        hide_index=True,
        width=158 + 79 * (len(columns) - 1),
        column_config=columns,
    )
    choices[ROWS] = tuple(edited.itertuples(index=False, name=None))
    if taken != (model, rows):
        st.button(
            "Take over what was shown", icon=":material/content_copy:", key=f"{key}_take",
            on_click=change, args=taken,
            help="The parameters of the estimate, set or snapshot shown before, with all digits.",
        )  # fmt: skip


def _models() -> dict[str, str]:
    """The models by their keys: one CTHP, which has all terms, and every other."""
    others = {key: model.title for key, model in FOLLOWING.items() if not model.is_linear}
    return {PAPER: "CTHP"} | others


def _columns(model: str) -> Mapping[str, Any]:
    """The columns of a table by hand: no step and no format, so that no digit is lost."""
    following = FOLLOWING[model]
    number = st.column_config.NumberColumn
    parameters = OF_CTHP if following.is_linear else following.parameters
    named = {p.heading: number(format="%.6g", width=79) for p in parameters}
    speed = number(format="%.6g", width=79, help="The speed at which the model is linearised.")
    text = st.column_config.TextColumn(max_chars=40, width=126)
    return {"Vehicle": text} | named | ({} if following.is_linear else {SPEED_COLUMN: speed})


def _usual_row(model: str) -> Row:
    """A vehicle at the typical values of its model; a CTHP without further terms."""
    following = FOLLOWING[model]
    if following.is_linear:
        return ("Vehicle 1", *following.typical[:3].tolist(), *(0.0 for _ in TERMS))
    return ("Vehicle 1", *following.typical.tolist(), Sinusoid.speed)


def _padded(row: Row, length: int) -> Row:
    """A row with as many cells as the table has columns."""
    return (*row, *(None for _ in range(length - len(row))))


def _typed(model: str, rows: Sequence[Row]) -> AssessedVehicles:
    """The vehicles of a table by hand."""
    if not 0 < len(rows) <= MOST:
        raise ParameterError(
            f"The table has {len(rows)} vehicles; give at least one and at most {MOST}."
        )
    columns = len(_columns(model))
    table = pd.DataFrame([_padded(row, columns) for row in rows])
    names = table[0].astype(object).fillna("").str.strip()
    known = tuple(name or f"Vehicle {k}" for k, name in enumerate(names, 1))
    values = table.iloc[:, 1:].to_numpy(float)
    if FOLLOWING[model].is_linear:
        typed = typed_vehicles(BY_HAND, model, known, values, np.empty(0))
        return AssessedVehicles(typed, origin=SOURCES["hand"])
    speeds = values[:, -1]
    typed = typed_vehicles(BY_HAND, model, known, values[:, :-1], speeds)
    return AssessedVehicles(typed, origin=SOURCES["hand"], typed_speeds=tuple(speeds.tolist()))
