"""The page Stability: the verdict beside the Bode magnitude, a table, and details in tabs."""

from functools import lru_cache
from typing import Any

import plotly.graph_objects as go
import streamlit as st

from accpinn.inference.intervals import Uncertainty
from accpinn.model.published import ParameterSet
from accpinn.results.figures import stability as figures
from accpinn.results.figures.style import LEADER
from accpinn.results.messages.stability import (
    GIVEN_PARAMETERS,
    criteria_differ,
    headline,
    reason,
)
from accpinn.results.messages.summary import conditional
from accpinn.results.tables.stability import answer, verdict_table
from accpinn.stability.report import CERTAIN
from accpinn.units import RadiansPerSecond
from pages.ui.components import frame, show
from pages.ui.components.parameter_picker import choose_parameters
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import bound, select, tabs
from pages.ui.session.resources import KEPT, report_of
from pages.ui.session.workspace import Workspace
from pages.ui.stability.details import (
    ShownVehicles,
    show_criteria,
    show_map,
    show_measured,
    show_reasons,
)

LEAD = "Which of these vehicles amplify the disturbances of the car ahead?"
GAIN = "‖h‖₁: the largest factor by which a peak of the speed deviation can grow."
HEIGHT = 370
"""Height of the Bode magnitude, in pixels: the table's head is above the fold then."""
WHOLE = -1
"""Stands for the platoon in place of one vehicle's index."""


def show_page() -> None:
    workspace = frame.begin("Stability")
    chosen = choose_parameters(workspace, "stability", LEAD)
    if chosen is None:
        return
    report = show.attempt(lambda: report_of(chosen.vehicles.parameters))
    if report is None:
        return
    shown = ShownVehicles(workspace, chosen, report)
    answer_column, chart_column = st.columns((1, 1.35), gap="medium")
    with answer_column:
        _show_answer(shown)
        _show_simulate(shown)
    with chart_column:
        _show_bode(shown)
    _show_verdicts(shown)
    tabs(
        workspace,
        "stability",
        {
            "Why": lambda: show_reasons(shown),
            "Criteria": lambda: show_criteria(shown),
            "Map": lambda: show_map(shown),
            "Measured": lambda: show_measured(shown),
        },
    )


def _show_answer(shown: ShownVehicles) -> None:
    """Who amplifies, with its probability; the platoon; and what the verdict assumes."""
    chosen, report, source = shown.chosen, shown.report, shown.source
    with st.container(border=True):
        said = headline(chosen, report, shown.known).replace(" %", "\N{NO-BREAK SPACE}%")
        st.markdown(f"{escape_markdown(source.origin)}\n\n#### {escape_markdown(said)}")
        if len(chosen) > 1:
            platoon = report.platoon
            verdicts = (
                ("Strictly stable", platoon.l2_strict, platoon.linf_strict),
                ("Weakly stable", platoon.l2_weak, platoon.linf_weak),
            )
            lines = [f"{name}: L₂ **{answer(l2)}**, L∞ **{answer(linf)}**."
                     for name, l2, linf in verdicts]  # fmt: skip
            why = escape_markdown(reason(platoon.l2_weak, report))
            of = "estimates" if source.result else "parameters"
            st.markdown(
                f"The {of} as a platoon in this order. {' '.join(lines)} {why}",
                help="Strictly: no vehicle amplifies anything. Weakly: nothing has grown at the"
                " last one.",
            )
        result, assumed = source.result, GIVEN_PARAMETERS
        if result:
            assumed = conditional(shown.adequacy, result.info)
        st.caption(escape_markdown(assumed))


def _show_bode(shown: ShownVehicles) -> None:
    """The chart; a click on a curve leads to the platoon at that frequency."""
    chosen, choice, uncertainty = shown.chosen, shown.workspace.map_choice, shown.uncertainty
    key = list(zip(chosen.labels, figures.colours(chosen), strict=True))
    key += [("Leader to last follower (dashed)", LEADER)] if len(chosen) > 1 else []
    with st.container(horizontal=True):
        show.key(key)
        if shown.known:
            st.toggle(
                "Uncertainty",
                **bound("stability_uncertainty", choice.uncertainty,
                        lambda on: choice.set(uncertainty=on)),
                help="Bands of the Bode magnitude and of the model beside the measured gain, and"
                " posterior samples on the map.",
            )  # fmt: skip
    event = show.chart(
        _bode(chosen, uncertainty), "stability_bode", on_select="rerun", selection_mode="points"
    )
    band = f" Shaded: {100 * uncertainty.level:.0f} % bands." if uncertainty else ""
    st.caption(
        "Diamonds: peaks. Rings: below that frequency the vehicle amplifies. Click on a curve"
        f" to simulate a platoon at that frequency.{band}"
    )
    if clicked := clicked_point(event["selection"]["points"]):
        _open_platoon(shown.workspace, *clicked)


@lru_cache(maxsize=KEPT)
def _bode(chosen: ParameterSet, uncertainty: Uncertainty | None) -> go.Figure:
    return figures.bode(chosen, report_of(chosen.parameters), uncertainty, HEIGHT)


def _show_verdicts(shown: ShownVehicles) -> None:
    chosen, known, sure = shown.chosen, shown.known, 100 * CERTAIN
    table = verdict_table(chosen, shown.report, known)
    show.table(table, figures.colours(chosen))
    posterior = known and (
        "Probability: the share of posterior samples that are string stable; the verdict is"
        f" undecided between {100 - sure:.0f} and {sure:.0f} %. In brackets:"
        f" {100 * known.level:.0f} % intervals. "
    )
    st.caption(f"{posterior or ''}{GAIN}")
    if differ := criteria_differ(chosen, shown.report):
        st.markdown(f":material/warning: {escape_markdown(differ)}")
    show.downloads(table, f"stability_{chosen.title}".lower(), "stability")


def _show_simulate(shown: ShownVehicles) -> None:
    """One vehicle or the platoon chosen, and a button; nothing where none has a peak."""
    chosen, report, workspace = shown.chosen, shown.report, shown.workspace
    peaks = {WHOLE: report.platoon.peaks[-1]} if len(chosen) > 1 else {}
    peaks |= {k: vehicle.peak for k, vehicle in enumerate(report.vehicles)}
    peaks = {k: peak for k, peak in peaks.items() if peak.omega}
    if not peaks:
        return
    choice = workspace.map_choice
    which = choice.simulated if choice.simulated in peaks else next(iter(peaks))
    with st.container(horizontal=True, vertical_alignment="center"):
        if len(peaks) > 1:
            names = {k: "All vehicles in order" if k == WHOLE else chosen.labels[k] for k in peaks}
            select(
                "Platoon of", names, which, "stability_simulate",
                lambda k: choice.set(simulated=k), labelled=False, width=200,
                help="Of the platoon that is simulated: all vehicles in order, or one repeated.",
            )  # fmt: skip
        if st.button(
            f"Simulate at the peak, {peaks[which].omega:.3g} rad/s",
            key="stability_open_platoon",
            icon=":material/directions_car:",
        ):
            _open_platoon(workspace, peaks[which].omega, which)


def clicked_point(points: list[dict[str, Any]]) -> tuple[RadiansPerSecond, int] | None:
    """Frequency and vehicle of the point clicked on; None where there is none."""
    vehicle = show.clicked_data(points)
    if not points:
        return None
    return float(points[0]["x"]), WHOLE if vehicle is None else int(vehicle)


def _open_platoon(workspace: Workspace, omega: RadiansPerSecond, vehicle: int) -> None:
    """Turn to the platoon of that vehicle, or of all in order, at that frequency."""
    workspace.platoon_choice.set(
        order="learned" if vehicle == WHOLE else "repeated",
        vehicle=max(vehicle, 0),
        omega=float(f"{omega:.4g}"),
        kind="sinusoid",
    )
    frame.go(frame.PLATOON, workspace)
