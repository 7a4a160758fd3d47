"""Stability: which vehicles amplify the disturbances of the car ahead, how much, and why."""

import streamlit as st

from pages.ui.components import frame
from pages.ui.components.parameter_picker import choose_parameters
from pages.ui.stability.charts import checked_report, show_bode, show_criteria, show_map
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
    report = checked_report(chosen) if chosen else None
    if chosen is None or report is None:
        return
    show_answer(chosen, report, uncertainty_of(workspace, chosen))
    show_verdicts(chosen, report)
    uncertainty = choose_uncertainty(workspace, chosen)
    if uncertainty:
        show_intervals(chosen, uncertainty)
    show_reasons(chosen, report)
    st.subheader("Bode magnitude", anchor=False)
    show_bode(workspace, chosen, report, uncertainty)
    left, right = st.columns(2, gap="large")
    with left:
        show_criteria(chosen, report)
    with right:
        show_map(workspace, chosen, report, uncertainty)


main()
