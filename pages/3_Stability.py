"""Stability: which vehicles amplify the disturbances of the car ahead, how much, and why."""

import streamlit as st

from accpinn.stability.report import stability_report
from pages.ui.components import frame
from pages.ui.components.messages import attempt
from pages.ui.components.parameter_picker import choose_parameters
from pages.ui.stability.charts import show_bode, show_criteria, show_map
from pages.ui.stability.views import (
    choose_uncertainty,
    show_answer,
    show_intervals,
    show_reasons,
    show_verdicts,
    uncertainty_of,
)


def main() -> None:
    workspace = frame.begin(
        "Stability", "Which of these vehicles amplify the disturbances of the car ahead?"
    )
    chosen = choose_parameters(workspace, "stability")
    report = attempt(lambda: stability_report(chosen.parameters)) if chosen else None
    if chosen is None or report is None:
        return
    show_answer(chosen, report, uncertainty_of(workspace, chosen))
    show_verdicts(chosen, report)
    uncertainty = choose_uncertainty(workspace, chosen)
    if uncertainty and workspace.fit_info:
        show_intervals(chosen, uncertainty, workspace.fit_info)
    show_reasons(chosen, report)
    st.subheader("Bode magnitude", anchor=False)
    show_bode(workspace, chosen, report, uncertainty)
    left, right = st.columns(2, gap="large")
    with left:
        show_criteria(chosen, report)
    with right:
        show_map(workspace, chosen, report, uncertainty)


main()
