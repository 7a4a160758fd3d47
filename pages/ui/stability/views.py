"""The answer in words, the tables with their downloads, and the reasons on demand."""

import streamlit as st

from accpinn.inference.intervals import Uncertainty
from accpinn.model.published import ParameterSet
from accpinn.results.figures import stability as figures
from accpinn.results.messages import messages
from accpinn.results.messages.stability import BEHAVIOURS, TITLES, amplification, certainty, reason
from accpinn.results.tables.stability import answer, stability_interval_table, stability_table
from accpinn.segment.segment import SegmentInfo
from accpinn.stability.report import StabilityReport, VehicleStability, Verdict
from pages.ui.components.messages import escape_markdown, show_messages
from pages.ui.components.table import show_downloads, show_table
from pages.ui.components.widgets import toggle
from pages.ui.session.workspace import Workspace


def uncertainty_of(workspace: Workspace, chosen: ParameterSet) -> Uncertainty | None:
    """The uncertainty of the fit that the parameters are from; None for others."""
    fit = workspace.fit
    return workspace.uncertainty() if fit and fit.parameters == chosen.parameters else None


def show_answer(
    chosen: ParameterSet, report: StabilityReport, uncertainty: Uncertainty | None
) -> None:
    """Who amplifies, how certain that is, the platoon, and where the L∞ criteria disagree."""
    with st.container(border=True):
        st.markdown(f"#### {escape_markdown(amplification(chosen, report))}")
        if uncertainty:
            st.markdown(escape_markdown(certainty(chosen, report, uncertainty)))
        if len(chosen) > 1:
            st.markdown(platoon_line(report))
    wrong = [
        f"**{escape_markdown(label)}: L∞ stable by the paper's criterion, not by the exact one.**"
        f" {escape_markdown(reason(vehicle.linf_exact, vehicle))}"
        for label, vehicle in zip(chosen.labels, report.vehicles, strict=True)
        if vehicle.linf_paper.stable and not vehicle.linf_exact.stable
    ]
    if wrong:
        st.warning("  \n".join(wrong), icon=":material/warning:")


def platoon_line(report: StabilityReport) -> str:
    """The verdicts on the whole platoon, weak and strict, in one line of markdown."""
    platoon = report.platoon
    questions = (
        ("Strictly stable (nothing grows at any vehicle)", platoon.l2_strict, platoon.linf_strict),
        ("Weakly stable (nothing has grown at the last one)", platoon.l2_weak, platoon.linf_weak),
    )
    parts = [f"{name}: L₂ **{answer(l2)}**, L∞ **{answer(linf)}**." for name, l2, linf in questions]
    why = escape_markdown(reason(platoon.l2_weak, report))
    return f"The platoon in this order. {' '.join(parts)} {why}"


def show_verdicts(chosen: ParameterSet, report: StabilityReport) -> None:
    """As the paper's Table III, with the exact gain beside its criterion."""
    table = stability_table(chosen, report)
    show_table(table, figures.colours(chosen))
    st.caption(
        "‖h‖₁: the largest factor by which a peak of the speed deviation can grow. Smallest stable"
        " time headway: that of this vehicle with its α and β."
    )
    show_downloads(table, f"stability_{chosen.title}".lower(), "stability")


def choose_uncertainty(workspace: Workspace, chosen: ParameterSet) -> Uncertainty | None:
    """A switch, and the uncertainty to be drawn; None where it is off or there is none."""
    uncertainty = uncertainty_of(workspace, chosen)
    if uncertainty is None:
        return None
    choice = workspace.map_choice
    toggle(
        "Show the uncertainty", choice.uncertainty, "stability_uncertainty",
        lambda on: setattr(choice, "uncertainty", on),
        help="Bands of the Bode magnitude, posterior samples on the map, and intervals of the"
        " stability measures.",
    )  # fmt: skip
    return uncertainty if choice.uncertainty else None


def show_intervals(chosen: ParameterSet, uncertainty: Uncertainty, info: SegmentInfo) -> None:
    """Intervals of the stability measures.

    Args:
        chosen: the vehicles' names and parameters.
        uncertainty: of the fit that these are from.
        info: of its segment.
    """
    show_table(stability_interval_table(chosen, uncertainty), figures.colours(chosen))
    st.caption(
        "From posterior samples, with disturbances that last for seconds. Probability of string"
        " stability: the share of samples that control the gap and are stable. Samples with α = 0"
        " have no gap control; they amplify nothing and are counted apart."
    )
    show_messages(messages(uncertainty.findings, info))


def show_reasons(chosen: ParameterSet, report: StabilityReport) -> None:
    """A sentence for every verdict."""
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
            followers = ", ".join(f"{k} {name}" for k, name in enumerate(chosen.names, 1))
            counted = f"Followers are counted from the leader on: {escape_markdown(followers)}."
            st.markdown(f"**The platoon.** {counted}\n" + _listed(verdicts, report))


def _listed(verdicts: tuple[Verdict, ...], of: VehicleStability | StabilityReport) -> str:
    return "".join(
        f"\n- {TITLES[verdict.criterion]}: **{answer(verdict)}**."
        f" {escape_markdown(reason(verdict, of))}"
        for verdict in verdicts
    )
