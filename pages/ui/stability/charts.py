"""The Bode magnitude, which can be clicked, the criteria and the map of parameters."""

from typing import Any

import streamlit as st

from accpinn.inference.intervals import Uncertainty
from accpinn.model.published import ParameterSet
from accpinn.results.figures import stability as figures
from accpinn.results.figures.stability import add_bands, add_clouds, cloud_caption
from accpinn.results.figures.style import LEADER
from accpinn.stability.report import StabilityReport
from accpinn.units import RadiansPerSecond
from pages.ui.components import frame
from pages.ui.components.charts import clicked_data, show_chart, show_key
from pages.ui.components.messages import escape_markdown
from pages.ui.components.widgets import segments, select
from pages.ui.session.ui_state import Plane
from pages.ui.session.workspace import Workspace

WHOLE = -1
"""Stands for the platoon in place of one vehicle's index."""
PLANES: dict[Plane, str] = {"beta": "β and τ", "alpha": "α and τ"}


def show_bode(
    workspace: Workspace,
    chosen: ParameterSet,
    report: StabilityReport,
    uncertainty: Uncertainty | None,
) -> None:
    """The chart, and a button for each peak; either leads to the platoon at that frequency.

    Args:
        workspace: the session.
        chosen: the vehicles' names and parameters.
        report: theirs.
        uncertainty: to be drawn as bands.
    """
    entries = list(zip(chosen.labels, figures.colours(chosen), strict=True))
    if len(chosen) > 1:
        entries.append(("Leader to last follower (dashed)", LEADER))
    show_key(entries)
    figure = figures.bode(chosen, report)
    event = show_chart(
        add_bands(figure, chosen, uncertainty) if uncertainty else figure,
        "stability_bode",
        on_select="rerun",
        selection_mode="points",
    )
    band = f" Shaded: {100 * uncertainty.level:.0f} % bands." if uncertainty else ""
    st.caption(
        "Diamonds: peaks. Rings: below that frequency the vehicle amplifies. Click on a curve to"
        f" simulate a platoon at that frequency, or take a peak.{band}"
    )
    _peak_buttons(workspace, chosen, report)
    if clicked := clicked_point(event["selection"]["points"]):
        open_platoon(workspace, *clicked)


def _peak_buttons(workspace: Workspace, chosen: ParameterSet, report: StabilityReport) -> None:
    entries = [
        (k, label, vehicle.peak)
        for k, (label, vehicle) in enumerate(zip(chosen.spoken, report.vehicles, strict=True))
    ]
    if len(chosen) > 1:
        entries.append((WHOLE, "the platoon in order", report.platoon.peaks[-1]))
    with st.container(horizontal=True):
        for k, label, peak in entries:
            if peak.omega and st.button(
                f"Simulate {escape_markdown(label)} at {peak.omega:.3g} rad/s",
                key=f"stability_peak_{k}",
                icon=":material/directions_car:",
            ):
                open_platoon(workspace, peak.omega, k)


def clicked_point(points: list[dict[str, Any]]) -> tuple[RadiansPerSecond, int] | None:
    """Frequency and vehicle of the point clicked on; None where there is none."""
    vehicle = clicked_data(points)
    if not points:
        return None
    return float(points[0]["x"]), WHOLE if vehicle is None else int(vehicle)


def open_platoon(workspace: Workspace, omega: RadiansPerSecond, vehicle: int) -> None:
    """Turn to the platoon of that vehicle, or of all in order, at that frequency."""
    workspace.platoon_choice.set(
        order="learned" if vehicle == WHOLE else "repeated",
        vehicle=max(vehicle, 0),
        omega=float(f"{omega:.4g}"),
        kind="sinusoid",
    )
    frame.go(frame.PLATOON, workspace)


def show_criteria(chosen: ParameterSet, report: StabilityReport) -> None:
    """Each vehicle's criteria, and those of the platoon up to it."""
    st.subheader("Criteria over the platoon", anchor=False)
    st.caption(
        "Stable where a criterion is above 0 and a gain is at 1. Dotted: from the leader to that"
        " follower, through all vehicles before it."
    )
    show_key(figures.CRITERIA_KEY)
    show_chart(figures.criteria_by_vehicle(chosen, report), "stability_criteria")


def show_map(
    workspace: Workspace,
    chosen: ParameterSet,
    report: StabilityReport,
    uncertainty: Uncertainty | None,
) -> None:
    """The boundaries of stability in a plane of two parameters.

    Args:
        workspace: the session.
        chosen: the vehicles' names and parameters.
        report: theirs.
        uncertainty: to be drawn as posterior samples.
    """
    st.subheader("Map of stability", anchor=False)
    held, plane = choose_map(workspace, chosen)
    show_key(figures.MAP_KEY)
    chart = figures.stability_map(chosen, report, held, plane)
    if uncertainty:
        chart = add_clouds(chart, chosen, uncertainty, plane)
    show_chart(chart, "stability_map")
    kept = "α" if plane == "beta" else "β"
    st.caption(
        f"Boundaries at {escape_markdown(chosen.labels[held])}'s {kept}; above them the vehicle is"
        " stable. Hatched: stable by the paper's L∞ criterion, but peaks grow."
        + (f" Rings: vehicles with a {kept} of their own." if len(chosen) > 1 else "")
        + (f" {cloud_caption(chart, uncertainty, plane)}" if uncertainty else "")
    )


def choose_map(workspace: Workspace, chosen: ParameterSet) -> tuple[int, Plane]:
    """The vehicle whose third parameter is kept, and the plane."""
    choice = workspace.map_choice
    held = choice.held if 0 <= choice.held < len(chosen) else len(chosen) - 1
    with st.container(horizontal=True, vertical_alignment="center"):
        segments("Plane", PLANES, choice.plane, "stability_plane",
                 lambda plane: setattr(choice, "plane", plane))  # fmt: skip
        if len(chosen) > 1:
            select(
                "Vehicle", range(len(chosen)), held, "stability_held",
                lambda k: setattr(choice, "held", k), lambda k: chosen.labels[k],
                labelled=False, width=240,
            )  # fmt: skip
    return held, choice.plane
