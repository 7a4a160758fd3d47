"""The page Stability: the answer in words, tables, reasons, Bode magnitude, criteria and map."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import streamlit as st

from accpinn.inference.intervals import Uncertainty
from accpinn.model.published import ParameterSet
from accpinn.results.figures import stability as figures
from accpinn.results.figures.stability import add_bands, add_clouds, cloud_caption
from accpinn.results.figures.style import LEADER
from accpinn.results.messages import messages
from accpinn.results.messages.stability import BEHAVIOURS, TITLES, certainty, headline, reason
from accpinn.results.tables.stability import answer, stability_interval_table, stability_table
from accpinn.stability.report import StabilityReport, VehicleStability, Verdict, stability_report
from accpinn.units import RadiansPerSecond
from pages.ui.components import frame, show
from pages.ui.components.parameter_picker import Chosen, choose_parameters, show_missing
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import bound, segments, select
from pages.ui.session.workspace import Plane, Workspace

PROBABILITY = (
    " Probability: the share of posterior samples that are string stable; all other columns are of"
    " the estimate."
)
WHOLE = -1
"""Stands for the platoon in place of one vehicle's index."""
PLANES: dict[Plane, str] = {"beta": "β and τ", "alpha": "α and τ"}


@dataclass(frozen=True, eq=False)
class _Shown:
    """What the parts of the page are about."""

    workspace: Workspace
    source: Chosen
    """Where the parameters are from, and what is known of them."""
    report: StabilityReport
    """Of the parameters."""

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
        """The same where the user wants to see it."""
        return self.known if self.workspace.map_choice.uncertainty else None


def show_page() -> None:
    """Draw the page."""
    workspace = frame.begin(
        "Stability", "Which of these vehicles amplify the disturbances of the car ahead?"
    )
    chosen = choose_parameters(workspace, "stability")
    if chosen is None:
        return
    if chosen.missing:
        show_missing(workspace, chosen)
        return
    report = show.attempt(lambda: stability_report(chosen.vehicles.parameters))
    if report is None:
        return
    shown = _Shown(workspace, chosen, report)
    _show_answer(shown)
    _show_verdicts(shown)
    _show_reasons(shown)
    _show_bode(shown)
    left, right = st.columns(2, gap="large")
    with left:
        _show_criteria(shown)
    with right:
        _show_map(shown)


def _show_answer(shown: _Shown) -> None:
    """Who amplifies, how certain that is, the platoon, and where the L∞ criteria disagree."""
    chosen, report = shown.chosen, shown.report
    with st.container(border=True):
        said = headline(chosen, report, shown.known)
        st.markdown(f"{escape_markdown(shown.source.origin)}\n\n#### {escape_markdown(said)}")
        if shown.known:
            st.markdown(escape_markdown(certainty(chosen, report, shown.known)))
        if len(chosen) > 1:
            platoon = report.platoon
            verdicts = (
                ("Strictly stable (nothing grows at any vehicle)",
                 platoon.l2_strict, platoon.linf_strict),
                ("Weakly stable (nothing has grown at the last one)",
                 platoon.l2_weak, platoon.linf_weak),
            )  # fmt: skip
            lines = [f"{name}: L₂ **{answer(l2)}**, L∞ **{answer(linf)}**."
                     for name, l2, linf in verdicts]  # fmt: skip
            why = escape_markdown(reason(platoon.l2_weak, report))
            of = "estimates" if shown.source.fit else "parameters"
            st.markdown(f"The {of} as a platoon in this order. {' '.join(lines)} {why}")
    wrong = [
        f"**{escape_markdown(label)}: L∞ stable by the paper's criterion, not by the exact one.**"
        f" {escape_markdown(reason(vehicle.linf_exact, vehicle))}"
        for label, vehicle in zip(chosen.labels, report.vehicles, strict=True)
        if vehicle.linf_paper.stable and not vehicle.linf_exact.stable
    ]
    if wrong:
        st.warning("  \n".join(wrong), icon=":material/warning:")


def _show_verdicts(shown: _Shown) -> None:
    """As the paper's Table III, with the exact gain beside its criterion; and the intervals."""
    chosen, choice = shown.chosen, shown.workspace.map_choice
    table = stability_table(chosen, shown.report, shown.known)
    show.table(table, figures.colours(chosen))
    st.caption(
        "‖h‖₁: the largest factor by which a peak of the speed deviation can grow. Smallest stable"
        " time headway: that of this vehicle with its α and β."
        + (PROBABILITY if shown.known else "")
    )
    show.downloads(table, f"stability_{chosen.title}".lower(), "stability")
    if shown.known:
        st.toggle(
            "Show the uncertainty",
            **bound("stability_uncertainty", choice.uncertainty,
                    lambda on: setattr(choice, "uncertainty", on)),
            help="Bands of the Bode magnitude, posterior samples on the map, and intervals of the"
            " stability measures.",
        )  # fmt: skip
    if (uncertainty := shown.uncertainty) and (info := shown.source.info):
        show.table(stability_interval_table(chosen, uncertainty), figures.colours(chosen))
        st.caption(
            "From posterior samples of a model with disturbances that last for seconds. Probability"
            " of string stability: the share of samples that are stable."
        )
        show.messages(messages(uncertainty.findings, info))


def _show_reasons(shown: _Shown) -> None:
    """A sentence for every verdict."""
    chosen, report = shown.chosen, shown.report
    with st.expander("Reasons for the verdicts", icon=":material/help:"):
        for label, vehicle in zip(chosen.labels, report.vehicles, strict=True):
            verdicts: tuple[Verdict, ...] = (vehicle.l2, vehicle.linf_paper, vehicle.linf_exact)
            st.markdown(
                f"**{escape_markdown(label)}.** {BEHAVIOURS[vehicle.behaviour]}\n"
                + _listed(verdicts, vehicle)
            )
        if len(chosen) > 1:
            platoon = report.platoon
            verdicts = (platoon.l2_strict, platoon.l2_weak,
                        platoon.linf_strict, platoon.linf_weak)  # fmt: skip
            st.markdown("**The platoon.**\n" + _listed(verdicts, report, chosen.spoken))


def _listed(
    verdicts: tuple[Verdict, ...],
    of: VehicleStability | StabilityReport,
    names: Sequence[str] = (),
) -> str:
    return "".join(
        f"\n- {TITLES[verdict.criterion]}: **{answer(verdict)}**."
        f" {escape_markdown(reason(verdict, of, names))}"
        for verdict in verdicts
    )


def _show_bode(shown: _Shown) -> None:
    """The chart, and a button for each peak; either leads to the platoon at that frequency."""
    chosen, report, uncertainty = shown.chosen, shown.report, shown.uncertainty
    st.subheader("Bode magnitude", anchor=False)
    key = list(zip(chosen.labels, figures.colours(chosen), strict=True))
    key += [("Leader to last follower (dashed)", LEADER)] if len(chosen) > 1 else []
    show.key(key)
    figure = figures.bode(chosen, report)
    event = show.chart(
        add_bands(figure, chosen, uncertainty) if uncertainty else figure,
        "stability_bode", on_select="rerun", selection_mode="points",
    )  # fmt: skip
    band = f" Shaded: {100 * uncertainty.level:.0f} % bands." if uncertainty else ""
    st.caption(
        "Diamonds: peaks. Rings: below that frequency the vehicle amplifies. Click on a curve to"
        f" simulate a platoon at that frequency, or take a peak.{band}"
    )
    peaks = [
        (k, label, vehicle.peak)
        for k, (label, vehicle) in enumerate(zip(chosen.spoken, report.vehicles, strict=True))
    ]
    if len(chosen) > 1:
        peaks.append((WHOLE, "the platoon in order", report.platoon.peaks[-1]))
    with st.container(horizontal=True):
        for k, label, peak in peaks:
            if peak.omega and st.button(
                f"Simulate {escape_markdown(label)} at {peak.omega:.3g} rad/s",
                key=f"stability_peak_{k}",
                icon=":material/directions_car:",
            ):
                _open_platoon(shown.workspace, peak.omega, k)
    if clicked := clicked_point(event["selection"]["points"]):
        _open_platoon(shown.workspace, *clicked)


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


def _show_criteria(shown: _Shown) -> None:
    """Each vehicle's criteria, and those of the platoon up to it."""
    st.subheader("Criteria over the platoon", anchor=False)
    st.caption(
        "Stable where a criterion is above 0 and a gain is at 1. Dotted: from the leader to that"
        " follower, through all vehicles before it."
    )
    show.key(figures.CRITERIA_KEY)
    show.chart(figures.criteria_by_vehicle(shown.chosen, shown.report), "stability_criteria")


def _show_map(shown: _Shown) -> None:
    """The boundaries of stability in a plane of two parameters."""
    chosen, uncertainty, choice = shown.chosen, shown.uncertainty, shown.workspace.map_choice
    plane, many = choice.plane, len(chosen) > 1
    held = choice.held if 0 <= choice.held < len(chosen) else len(chosen) - 1
    st.subheader("Map of stability", anchor=False)
    with st.container(horizontal=True, vertical_alignment="center"):
        segments("Plane", PLANES, plane, "stability_plane",
                 lambda plane: setattr(choice, "plane", plane))  # fmt: skip
        if many:
            select(
                "Vehicle", dict(enumerate(chosen.labels)), held, "stability_held",
                lambda k: setattr(choice, "held", k), labelled=False, width=240,
            )  # fmt: skip
    show.key(figures.MAP_KEY)
    chart = figures.stability_map(chosen, shown.report, held, plane)
    if uncertainty:
        chart = add_clouds(chart, chosen, uncertainty, plane)
    show.chart(chart, "stability_map")
    kept = "α" if plane == "beta" else "β"
    st.caption(
        f"Boundaries at {escape_markdown(chosen.labels[held])}'s {kept}; above them the vehicle is"
        " stable. Hatched: stable by the paper's L∞ criterion, but peaks grow."
        + (f" Rings: vehicles with a {kept} of their own." if many else "")
        + (f" {cloud_caption(chart, uncertainty, plane)}" if uncertainty else "")
    )
