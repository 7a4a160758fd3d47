"""Stability: which vehicles amplify the disturbances of the car ahead, how much, and why."""

import streamlit as st

from accpinn.results.figures import stability as figures
from accpinn.results.figures.uncertainty import add_clouds, cloud_caption
from pages.ui.components import frame
from pages.ui.components.charts import show_chart
from pages.ui.components.parameter_picker import checked_report, choose_parameters
from pages.ui.components.text import escape_markdown
from pages.ui.components.uncertainty import choose_doubt, doubt_of, show_doubt
from pages.ui.stability.charts import choose_map, show_bode, show_key
from pages.ui.stability.views import show_answer, show_reasons, show_table


def main() -> None:
    workspace = frame.begin(
        "Stability", "Which of these vehicles amplify the disturbances of the car ahead?"
    )
    laws = choose_parameters(workspace, "stability")
    report = checked_report(laws)
    if laws is None or report is None:
        return
    show_answer(laws, report, doubt_of(workspace, laws))
    show_table(laws, report)
    uncertainty = choose_doubt(workspace, laws)
    if uncertainty and workspace.described:
        show_doubt(laws, uncertainty, workspace.described)
    show_reasons(laws, report)
    st.subheader("Response over frequency", anchor=False)
    show_key(laws)
    show_bode(workspace, laws, report, uncertainty)
    left, right = st.columns(2, gap="large")
    with left:
        st.subheader("Criteria over the platoon", anchor=False)
        st.caption(
            "Stable where a criterion is above 0 and a gain is at 1. Dotted: from the leader to"
            " that follower, through all vehicles before it."
        )
        frame.show_key(figures.CRITERIA_KEY)
        show_chart(figures.criteria_by_vehicle(laws, report), "stability_criteria")
    with right:
        st.subheader("What would make it stable", anchor=False)
        held, plane = choose_map(workspace, laws)
        frame.show_key(figures.MAP_KEY)
        chart = figures.stability_map(laws, report, held, plane)
        if uncertainty:
            chart = add_clouds(chart, laws, uncertainty, plane)
        show_chart(chart, "stability_map")
        kept = "α" if plane == "beta" else "β"
        st.caption(
            f"Boundaries at {escape_markdown(laws.labels[held])}'s {kept}; above them the vehicle is"
            " stable."
            " Hatched: stable by the paper's L∞ criterion, but peaks grow."
            + (f" Rings: vehicles with a {kept} of their own." if len(laws) > 1 else "")
            + (f" {cloud_caption(chart, uncertainty, plane)}" if uncertainty else "")
        )


main()
