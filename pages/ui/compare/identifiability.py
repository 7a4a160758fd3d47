"""Can the data tell: warnings, profiles of the loss, other forms of the law, and five starts."""

import streamlit as st

from accpinn.inference.identifiability import (
    INCREASE,
    identifiability_warnings,
    profiles,
)
from accpinn.inference.model_adequacy import better_forms, model_forms
from accpinn.inference.multistart import MultistartResult, summarise
from accpinn.methods.pinn.config import FAST, PAPER
from accpinn.results.figures.comparison import profiles as profiles_chart
from accpinn.results.figures.style import vehicle_colour
from accpinn.results.messages import messages
from accpinn.results.tables import table as typeset
from accpinn.results.tables.estimates import model_form_table, multistart_table
from accpinn.segment.quality import LARGE_CONDITION, assess_quality
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodResult
from pages.ui.compare.watch import watch
from pages.ui.components.charts import show_chart
from pages.ui.components.text import bullets
from pages.ui.session.resources import task_queue
from pages.ui.session.workspace import Workspace

RECIPES = {"fast": FAST, "paper": PAPER}


def show_telling(
    workspace: Workspace, segment: Segment, rows: tuple[MethodResult, ...], follower: int
) -> None:
    """What the data can tell, whichever method is asked."""
    st.subheader("Can the data tell?", anchor=False)
    warnings = identifiability_warnings(segment, rows[0].uncertainty, workspace.case)
    if warnings:
        st.warning(bullets(messages(warnings, segment)), icon=":material/warning:")
    else:
        st.success(
            "The data tell α, β and τ apart: no interval spans more than a factor of five."
            " That is, if the law holds: see below.",
            icon=":material/check_circle:",
        )
    quality = assess_quality(segment)
    st.caption(
        f"Condition number {quality.condition[follower]:.0f} (above {LARGE_CONDITION:.0f} the law's"
        " terms are nearly proportional) · excitation: the leader's speed"
        f" varies by {quality.leader_deviation:.2f} m/s, Δv by"
        f" {quality.relative_deviation[follower]:.2f} m/s, the acceleration by"
        f" {quality.acceleration_deviation[follower]:.2f} m/s² (standard deviations)."
    )
    found = profiles(segment, workspace.case)
    number = segment.vehicles[follower + 1]
    uncertainty = rows[0].uncertainty
    figure = profiles_chart(
        found[follower % len(found)],
        vehicle_colour(number, segment.vehicles[0]),
        uncertainty.lower.values[follower],
        uncertainty.upper.values[follower],
    )
    show_chart(figure, "compare_profiles")
    st.caption(
        "How much worse the law explains the accelerations when one parameter is held there and"
        f" the others are at their best. Dashed: {100 * INCREASE:.0f} % worse, hardly to be seen in"
        f" any plot. Grey: the {100 * uncertainty.level:.0f} % interval of the table above, which may"
        " lie"
        " beside the curve: the curve takes each sample as independent of the last, while the"
        " interval knows that disturbances last for seconds and pull the estimate."
    )
    show_extensions(segment, follower)
    show_starts(workspace, segment, follower)


def show_extensions(segment: Segment, follower: int) -> None:
    """Whether the law with one term more would say something else."""
    st.subheader("Is the law all there is?", anchor=False)
    found = model_forms(segment)
    if better := better_forms(segment.vehicles, found):
        st.info(bullets(messages(better, segment)), icon=":material/lightbulb:")
    st.html(typeset.STYLE + model_form_table(segment.info, found, follower).to_html())
    st.caption(
        "Intervals say what noise and disturbances leave open if the law holds. Real controllers"
        " keep a distance at standstill and act with a delay; a law without these puts them into α,"
        " β and τ. Unseen: the last third, explained by the form learned from the first two. A form"
        " that explains it clearly better deserves belief; where none does, the forms show how"
        " much α, β and τ depend on what is assumed."
    )


def show_starts(workspace: Workspace, segment: Segment, follower: int) -> None:
    """The paper's Table I for this window."""
    series = workspace.starts
    if series and series.is_active:
        if st.button("Stop the starts", icon=":material/stop:", disabled=series.is_stopping):
            task_queue().stop(series)
            st.rerun()
    else:
        with st.container(horizontal=True, vertical_alignment="center"):
            preset = st.segmented_control(
                "Preset of the starts", list(RECIPES), default="fast", key="compare_preset",
                required=True, label_visibility="collapsed", format_func=str.capitalize,
            )  # fmt: skip
            if st.button("Five starts", icon=":material/casino:", key="compare_starts"):
                workspace.train_starts(RECIPES[preset or "fast"])
                st.rerun()
        st.caption(
            "Trains the network from five initial values of α, β and τ, as the paper's Table I."
            " The paper preset takes minutes a start."
        )
    if series:
        watch(
            workspace,
            series,
            lambda: _show_table(segment, summarise(segment, series.results), follower),
        )


def _show_table(segment: Segment, found: MultistartResult, follower: int) -> None:
    if found.trials:
        st.html(typeset.STYLE + multistart_table(segment.info, found, follower).to_html())
    if found.findings:
        st.info(bullets(messages(found.findings, segment)), icon=":material/info:")
