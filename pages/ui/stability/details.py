"""Tabs of the page Stability: criteria, the map, why verdicts are so, and the measured gain."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import streamlit as st

from accpinn.inference.intervals import Uncertainty
from accpinn.inference.model_adequacy import Adequacy
from accpinn.model.published import ParameterSet
from accpinn.results.figures import stability as figures
from accpinn.results.figures.stability import Model, cloud_caption, measured_bode
from accpinn.results.figures.style import LEADER, vehicle_colour
from accpinn.results.messages import messages
from accpinn.results.messages.stability import BEHAVIOURS, BY_ESTIMATES, TITLES, reason
from accpinn.results.tables.stability import (
    answer,
    criteria_part,
    measured_gain_table,
    stability_table,
)
from accpinn.stability.measured_gain import measured_gain
from accpinn.stability.report import StabilityReport, VehicleStability, Verdict
from pages.ui.components import show
from pages.ui.components.parameter_picker import Chosen
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import segments, select
from pages.ui.session.resources import KEPT
from pages.ui.session.workspace import Workspace

PLANES: dict[figures.Plane, str] = {"beta": "β and τ", "alpha": "α and τ"}
NO_DATA = (
    "The measured gain needs the recorded speeds, which are not here: open a recording, or a"
    " snapshot with its data."
)
_measured = lru_cache(maxsize=KEPT)(measured_gain)
_figure = lru_cache(maxsize=KEPT)(measured_bode)


@dataclass(frozen=True, eq=False)
class ShownVehicles:
    """What the parts of the page are about."""

    workspace: Workspace
    source: Chosen
    """Where the parameters are from, and what is known of them."""
    report: StabilityReport
    """The stability report on the parameters."""

    @property
    def chosen(self) -> ParameterSet:
        """The vehicles' names and parameters."""
        return self.source.vehicles

    @property
    def known(self) -> Uncertainty | None:
        """The uncertainty of the fit that the parameters are from; None for others."""
        return self.source.uncertainty

    @property
    def uncertainty(self) -> Uncertainty | None:
        """The same where the user wants to see it in charts."""
        return self.known if self.workspace.map_choice.uncertainty else None

    @property
    def adequacy(self) -> Adequacy | None:
        """The forms of the model on the data that the parameters are from, where compared."""
        if self.source.source == "fit":
            return self.workspace.adequacy
        return self.source.result.parts.adequacy if self.source.result else None


def show_criteria(shown: ShownVehicles) -> None:
    """Each vehicle's criteria, and those of the platoon up to it."""
    st.caption(
        "Criteria and gains of each vehicle, in their order in the platoon: stable where a"
        " criterion is above 0 and a gain is at 1. Dotted: from the leader to that follower,"
        " through all vehicles before it."
    )
    show.key(figures.CRITERIA_KEY)
    show.chart(figures.criteria_by_vehicle(shown.chosen, shown.report), "stability_criteria")
    table = stability_table(shown.chosen, shown.report, shown.known)
    show.table(criteria_part(table), figures.colours(shown.chosen))
    posterior = (
        " In brackets: intervals from posterior samples of a model with disturbances that last for"
        " seconds."
    )
    st.caption(
        "Stable and the criteria: by the estimates. Smallest stable time headway: that of this"
        f" vehicle with its α and β.{posterior if shown.known else ''}"
    )
    show.downloads(table, f"criteria_{shown.chosen.title}".lower(), "criteria")
    if shown.known and shown.source.result:
        show.messages(messages(shown.known.findings, shown.source.result.info))


def show_map(shown: ShownVehicles) -> None:
    """The boundaries of stability in a plane of two parameters."""
    chosen, uncertainty, choice = shown.chosen, shown.uncertainty, shown.workspace.map_choice
    plane, many = choice.plane, len(chosen) > 1
    held = choice.held if 0 <= choice.held < len(chosen) else len(chosen) - 1
    with st.container(horizontal=True, vertical_alignment="center"):
        segments(
            "Plane", PLANES, plane, "stability_plane",
            lambda plane: choice.set(plane=plane),
            help="The two parameters on the axes; the third is that of the vehicle chosen.",
        )  # fmt: skip
        if many:
            select(
                "Vehicle", dict(enumerate(chosen.labels)), held, "stability_held",
                lambda k: choice.set(held=k), labelled=False, width=240,
                help="The vehicle whose third parameter the boundaries are drawn for.",
            )  # fmt: skip
        show.key(figures.MAP_KEY)
    chart = figures.stability_map(chosen, shown.report, held, plane, uncertainty)
    show.chart(chart, "stability_map")
    kept = "α" if plane == "beta" else "β"
    st.caption(
        f"Boundaries at {escape_markdown(chosen.labels[held])}'s {kept}; above them the vehicle is"
        " stable. Hatched: stable by the paper's L∞ criterion, but peaks grow."
        + (f" Rings: vehicles with a {kept} of their own." if many else "")
        + (f" {cloud_caption(chart, uncertainty, plane)}" if uncertainty else "")
    )


def show_reasons(shown: ShownVehicles) -> None:
    chosen, report = shown.chosen, shown.report
    if shown.known:
        st.caption(BY_ESTIMATES)
    texts = []
    for label, vehicle in zip(chosen.labels, report.vehicles, strict=True):
        verdicts: tuple[Verdict, ...] = (vehicle.l2, vehicle.linf_paper, vehicle.linf_exact)
        texts.append(
            f"**{escape_markdown(label)}.** {BEHAVIOURS[vehicle.behaviour]}\n"
            + _listed(verdicts, vehicle)
        )
    if len(chosen) > 1:
        platoon = report.platoon
        verdicts = (platoon.l2_strict, platoon.l2_weak, platoon.linf_strict, platoon.linf_weak)
        texts.append(
            "**The platoon.** Strict: no vehicle amplifies anything. Weak: nothing has grown at"
            " the last one.\n" + _listed(verdicts, report, chosen.spoken)
        )
    # A row of columns each, so that a narrow screen keeps their order.
    for at in range(0, len(texts), 2):
        for column, text in zip(st.columns(2, gap="large"), texts[at : at + 2], strict=False):
            column.markdown(text)


def _listed(
    verdicts: tuple[Verdict, ...], of: VehicleStability | StabilityReport, names: Sequence[str] = ()
) -> str:
    return "".join(
        f"\n- {TITLES[verdict.criterion]}: **{answer(verdict)}**."
        f" {escape_markdown(reason(verdict, of, names))}"
        for verdict in verdicts
    )


@lru_cache(maxsize=KEPT)
def _model(chosen: ParameterSet, which: int, uncertainty: Uncertainty | None) -> Model:
    """One vehicle's curve, with the band of its posterior where that is known."""
    draws = uncertainty.draws[:, which] if uncertainty else None
    known = draws is not None and np.isfinite(draws.alpha).all()
    return Model(chosen.labels[which], chosen.parameters[which], draws if known else None)


def show_measured(shown: ShownVehicles) -> None:
    """The gain of one follower by Welch's method, beside the model's curve."""
    chosen, choice = shown.chosen, shown.workspace.map_choice
    result = shown.source.result
    segment = (result.segment if result else None) or shown.workspace.segment
    if segment is None:
        show.messages(NO_DATA)
        return
    labels = segment.labels[1:]
    follower = choice.measured if choice.measured < len(labels) else 0
    head = st.container(horizontal=True, vertical_alignment="center")
    with head:
        if len(labels) > 1:
            select(
                "Follower", dict(enumerate(labels)), follower, "stability_measured",
                lambda k: choice.set(measured=k), labelled=False, width=240,
                help="The vehicle whose recorded speed is compared with that of the car ahead.",
            )  # fmt: skip
    gain = show.attempt(lambda: _measured(segment, follower))
    if gain is None:
        return
    # Vehicles of another source stand for those of the recording, in their order.
    which = 0 if len(chosen) == 1 else follower if len(chosen) == len(labels) else None
    model = None if which is None else _model(chosen, which, shown.uncertainty)
    colour = vehicle_colour(segment.vehicles[follower + 1], segment.vehicles[0])
    key = [(f"{labels[follower]}, measured", LEADER)]
    if model:
        key.append((f"{model.name}, model", colour))
    with head:
        show.key(key)
    show.chart(_figure(gain, labels[follower], colour, model), "stability_measured_gain")
    level = f"{100 * gain.level:.0f} %"
    band = f" Shaded: {level} band of the model." if model and model.draws is not None else ""
    st.caption(
        f"{escape_markdown(segment.source)}, {segment.window}. The measured gain from the speed"
        " ahead to the vehicle's own, from the recorded speeds alone (Welch's method,"
        f" {gain.pieces} pieces of {gain.length:.0f} s), with {level} bars for the random error."
        " Faint: the coherence is not above that of unrelated signals. Where the points leave the"
        " curve, the CTHP with these parameters does not describe how this vehicle passes on"
        f" disturbances. A peak narrower than {gain.omega[0]:.2g} rad/s appears lower than it is;"
        " above 0.3 rad/s, where vehicles pass on little, the vehicle's own disturbances make the"
        f" gain appear higher (by a quarter in simulated recordings of 300 s).{band}"
    )
    show.downloads(
        measured_gain_table(labels[follower], gain),
        f"measured_gain_{labels[follower]}",
        "measured",
    )
