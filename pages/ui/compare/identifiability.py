"""Identifiability, model adequacy, and trainings from several initial values."""

import streamlit as st

from accpinn.inference.identifiability import INCREASE, identifiability_warnings, profiles
from accpinn.inference.model_adequacy import better_forms, model_forms
from accpinn.inference.multistart import summarise
from accpinn.methods.pinn.config import PRESETS
from accpinn.results.figures.comparison import profiles as profiles_chart
from accpinn.results.messages import messages
from accpinn.results.tables.estimates import model_form_table, multistart_table
from accpinn.segment.quality import LARGE_CONDITION, assess_quality
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodResult
from pages.ui.components.charts import show_chart
from pages.ui.components.messages import show_messages
from pages.ui.components.monitor import monitor, stop_button
from pages.ui.components.table import show_table, vehicle_colours
from pages.ui.session.workspace import Workspace


def show_identifiability(
    workspace: Workspace, segment: Segment, rows: tuple[MethodResult, ...], follower: int
) -> None:
    """Which parameters the data determine, whichever method is used.

    Args:
        workspace: the session.
        segment: the data.
        rows: the methods'.
        follower: 0 for the first.
    """
    st.subheader("Identifiability", anchor=False)
    uncertainty, case = rows[0].uncertainty, workspace.case
    warnings = identifiability_warnings(segment, uncertainty, case)
    show_messages(messages(warnings, segment), "warning")
    if not warnings:
        show_messages(
            "α, β and τ are identifiable: no interval spans more than a factor of five, provided"
            " that the model is adequate (see below).",
            "success",
        )
    quality = assess_quality(segment)
    st.caption(
        f"Condition number {quality.condition[follower]:.0f} (above {LARGE_CONDITION:.0f} the"
        " model's terms are nearly proportional). Standard deviations: the leader's speed"
        f" {quality.leader_deviation:.2f} m/s, Δv {quality.relative_deviation[follower]:.2f} m/s,"
        f" acceleration {quality.acceleration_deviation[follower]:.2f} m/s²."
    )
    found = profiles(segment, case)
    lower, upper = (ends.values[follower] for ends in (uncertainty.lower, uncertainty.upper))
    colour = vehicle_colours(segment)[follower + 1]
    figure = profiles_chart(found[follower % len(found)], colour, lower, upper)
    show_chart(figure, "compare_profiles")
    st.caption(
        "Profile of the loss: the misfit of the accelerations with one parameter held and the"
        f" others at their best. Dashed: {100 * INCREASE:.0f} % worse, hardly visible in any plot."
        f" Grey: the {100 * uncertainty.level:.0f} % interval of the table above. It may lie beside"
        " the curve: the curve takes all samples as independent, while the interval accounts for"
        " disturbances that last for seconds and bias the estimate."
    )


def show_adequacy(segment: Segment, follower: int) -> None:
    """Whether a model with one term more explains the data better."""
    st.subheader("Model adequacy", anchor=False)
    found = model_forms(segment)
    better = better_forms(segment.vehicles, found)
    show_messages(messages(better, segment), icon="lightbulb")
    show_table(model_form_table(segment.info, found, follower))
    st.caption(
        "The intervals hold if the model does. Real controllers keep a distance at standstill and"
        " act with a delay; a model without these terms shifts them into α, β and τ. Unseen: the"
        " last third of the window, explained by the form learned from the first two. Trust a form"
        " that explains it clearly better; where none does, the forms show how much α, β and τ"
        " depend on the assumptions."
    )


def show_starts(workspace: Workspace, segment: Segment, follower: int) -> None:
    """The paper's Table I for this window."""
    task = workspace.starts
    if task and task.is_active:
        stop_button(task, "Stop the starts", "compare_stop_starts")
    else:
        with st.container(horizontal=True, vertical_alignment="center"):
            preset = st.segmented_control(
                "Preset of the starts", list(PRESETS), default="fast", key="compare_preset",
                required=True, label_visibility="collapsed", format_func=str.capitalize,
            )  # fmt: skip
            if st.button("Five starts", icon=":material/casino:", key="compare_starts"):
                workspace.train_starts(PRESETS[preset or "fast"])
                st.rerun()
        st.caption(
            "Trains the network from five initial values of α, β and τ, as the paper's Table I."
            " The paper preset takes minutes a start."
        )
    if task is None:
        return

    def draw(_: bool) -> None:
        found = summarise(segment, task.results)
        if found.trials:
            show_table(multistart_table(segment.info, found, follower))
        show_messages(messages(found.findings, segment))

    monitor(workspace, task, draw)
