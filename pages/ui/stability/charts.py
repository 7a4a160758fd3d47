"""The response over frequency, which can be clicked, and what the map of parameters shows."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import streamlit as st

from accpinn.inference.intervals import Uncertainty
from accpinn.model.published import ParameterSet
from accpinn.results.figures import stability as figures
from accpinn.results.figures.style import LEADER
from accpinn.results.figures.uncertainty import add_bands
from accpinn.stability.report import StabilityReport
from accpinn.units import RadiansPerSecond
from pages.ui.components import frame
from pages.ui.components.charts import show_chart
from pages.ui.components.text import escape_markdown
from pages.ui.session.workspace import Workspace, sync_widget

PLATOON = "pages/4_Platoon.py"
WHOLE = -1
"""Stands for the platoon in place of one vehicle's index."""


def show_key(laws: ParameterSet) -> None:
    """Which colour is which vehicle."""
    entries = list(zip(laws.labels, figures.colours(laws), strict=True))
    if len(laws) > 1:
        entries.append(("Leader to last follower (dashed)", LEADER))
    frame.show_key(entries)


def show_bode(
    workspace: Workspace,
    laws: ParameterSet,
    report: StabilityReport,
    uncertainty: Uncertainty | None,
) -> None:
    """The chart, and a button for each peak; either leads to the platoon at that frequency."""
    figure = figures.bode(laws, report)
    event = show_chart(
        add_bands(figure, laws, uncertainty) if uncertainty else figure,
        "stability_bode",
        on_select="rerun",
        selection_mode="points",
    )
    band = f" Shaded: {100 * uncertainty.level:.0f} % bands." if uncertainty else ""
    st.caption(
        "Diamonds: peaks. Rings: below that frequency the vehicle amplifies. Click on a curve to"
        f" see what a platoon does to that frequency, or take a peak.{band}"
    )
    _peak_buttons(workspace, laws, report)
    clicked = clicked_point(event["selection"]["points"])
    if clicked:
        open_platoon(workspace, *clicked)


def _peak_buttons(workspace: Workspace, laws: ParameterSet, report: StabilityReport) -> None:
    whole = report.platoon.peaks[-1]
    entries = [
        (k, label, vehicle.peak)
        for k, (label, vehicle) in enumerate(zip(laws.spoken, report.vehicles, strict=True))
    ]
    if len(laws) > 1:
        entries.append((WHOLE, "the platoon in order", whole))
    with st.container(horizontal=True):
        for k, label, peak in entries:
            if peak.omega and st.button(
                f"Simulate {escape_markdown(label)} at {peak.omega:.3g} rad/s",
                key=f"stability_peak_{k}",
                icon=":material/directions_car:",
            ):
                open_platoon(workspace, peak.omega, k)


def clicked_point(points: Sequence[Mapping[str, Any]]) -> tuple[RadiansPerSecond, int] | None:
    """Frequency and vehicle of the point clicked on; None where there is none."""
    if not points:
        return None
    which = points[0].get("customdata", WHOLE)
    return float(points[0]["x"]), int(which[0] if isinstance(which, list) else which)


def open_platoon(workspace: Workspace, omega: RadiansPerSecond, vehicle: int) -> None:
    """To the platoon of that vehicle, or of all in order, at that frequency."""
    drive = workspace.drive
    drive.order = "learned" if vehicle == WHOLE else "repeated"
    drive.vehicle = max(vehicle, 0)
    drive.omega = float(f"{omega:.4g}")
    drive.kind = "sinusoid"
    frame.go(PLATOON, workspace)


def choose_map(workspace: Workspace, laws: ParameterSet) -> tuple[int, Literal["beta", "alpha"]]:
    """Which plane, and which vehicle's third parameter is kept."""
    choice = workspace.map
    held = choice.held if 0 <= choice.held < len(laws) else len(laws) - 1

    def changed() -> None:
        choice.plane = st.session_state["stability_plane"]
        choice.held = st.session_state.get("stability_held", held)

    with st.container(horizontal=True, vertical_alignment="center"):
        st.segmented_control(
            "Plane",
            ("beta", "alpha"),
            default=choice.plane,
            format_func=lambda plane: {"beta": "β and τ", "alpha": "α and τ"}[plane],
            key=sync_widget("stability_plane", choice.plane),
            on_change=changed,
            required=True,
            label_visibility="collapsed",
        )
        if len(laws) > 1:
            st.selectbox(
                "Vehicle",
                range(len(laws)),
                index=held,
                format_func=lambda k: laws.labels[k],
                key=sync_widget("stability_held", held),
                on_change=changed,
                label_visibility="collapsed",
                width=240,
            )
    return held, choice.plane
