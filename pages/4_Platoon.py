"""Platoon: a row of the vehicles behind a leader, and what becomes of its disturbance."""

import streamlit as st

from accpinn.platoon.simulation import simulate_platoon
from accpinn.results.figures.platoon import cast_of, profiles
from pages.ui.components import frame
from pages.ui.components.charts import show_chart
from pages.ui.components.messages import attempt
from pages.ui.components.parameter_picker import choose_parameters
from pages.ui.platoon.controls import choose_leader, choose_order
from pages.ui.platoon.views import (
    panels_button,
    show_amplitudes,
    show_answer,
    show_panels,
    show_wave_in_time,
    show_wave_on_road,
)


def main() -> None:
    workspace = frame.begin(
        "Platoon", "A disturbance of the leader, in a platoon of these vehicles."
    )
    if workspace.platoon_choice.panels:
        show_panels(workspace)
        return
    chosen = choose_parameters(workspace, "platoon")
    if chosen is None:
        return
    controls, chart = st.columns((1, 2.6), gap="medium")
    with controls:
        order = choose_order(workspace, chosen)
        platoon = chosen.parameters[order or []]
        leader = choose_leader(workspace, platoon) if order else None
        panels_button(workspace, "The paper's four panels", "grid_view", "platoon_panels", True)
    with chart:
        run = attempt(lambda: simulate_platoon(platoon, leader)) if leader else None
        if run is None or order is None:
            return
        cast = cast_of(chosen, order)
        show_answer(run, chosen, order)
        show_chart(profiles(run, cast), "platoon_profiles")
    left, right = st.columns(2, gap="large")
    with left:
        show_amplitudes(workspace, run, cast)
    with right:
        show_wave_in_time(run, cast)
    show_wave_on_road(run, cast)


main()
