"""Platoon: a row of the vehicles behind a leader, and what becomes of its disturbance."""

import streamlit as st

from accpinn.results.figures import platoon as figures
from pages.ui.components import frame
from pages.ui.components.charts import show_chart
from pages.ui.components.parameter_picker import choose_parameters
from pages.ui.platoon.leader import choose_leader
from pages.ui.platoon.order import choose_order
from pages.ui.platoon.views import (
    choose_panels,
    choose_scale,
    driven,
    seconds_shown,
    show_course,
    show_panels,
)


def main() -> None:
    workspace = frame.begin(
        "Platoon", "What a row of these vehicles makes of a disturbance of its leader."
    )
    if workspace.drive.panels:
        show_panels(workspace)
        return
    laws = choose_parameters(workspace, "platoon")
    if laws is None:
        return
    controls, chart = st.columns((1, 2.6), gap="medium")
    with controls:
        order = choose_order(workspace, laws)
        platoon = laws.parameters[order or []]
        leader = choose_leader(workspace, platoon) if order else None
        choose_panels(workspace)
    with chart:
        run = driven(platoon, leader)
        if run is None or order is None:
            return
        cast = figures.cast_of(laws, order)
        show_course(run, laws, order)
        show_chart(figures.profiles(run, cast), "platoon_profiles")
    left, right = st.columns(2, gap="large")
    with left:
        in_db = choose_scale(workspace, run)
        show_chart(figures.amplitude_by_vehicle(run, cast, in_db), "platoon_amplitude")
    with right:
        st.subheader("The wave in time", anchor=False)
        st.caption(
            "Each vehicle's speed against the speed before the disturbance."
            f" {seconds_shown(run, figures.stretch(run))}"
        )
        show_chart(figures.speed_map(run, cast), "platoon_map")
    st.subheader("The wave on the road", anchor=False)
    st.caption(
        "Seen from the leader: press Play or drag the slider."
        f" {seconds_shown(run, figures.watched(run))} Squares mark the cars, not to scale: from one to"
        f" the next it is the space-gap simulated and {figures.CAR_LENGTH:g} m of car."
    )
    show_chart(figures.animation(run, cast), "platoon_wave")


main()
