"""Tabs of the page Stability: criteria along the platoon, the map, and why verdicts are so."""

from collections.abc import Sequence
from dataclasses import dataclass

import streamlit as st

from accpinn.inference.intervals import Uncertainty
from accpinn.inference.model_adequacy import Adequacy
from accpinn.model.published import ParameterSet
from accpinn.results.figures import stability as figures
from accpinn.results.figures.stability import cloud_caption
from accpinn.results.messages import messages
from accpinn.results.messages.stability import BEHAVIOURS, BY_ESTIMATES, TITLES, reason
from accpinn.results.tables.stability import (
    answer,
    criteria_part,
    stability_table,
)
from accpinn.stability.report import StabilityReport, VehicleStability, Verdict
from pages.ui.components import show
from pages.ui.components.parameter_picker import Chosen
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import segments, select
from pages.ui.session.workspace import Workspace

PLANES: dict[figures.Plane, str] = {"beta": "β and τ", "alpha": "α and τ"}


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
    """A sentence for every verdict."""
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
