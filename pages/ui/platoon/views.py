"""A simulated platoon in words and charts, and the paper's four panels."""

from collections.abc import Sequence

import numpy as np
import streamlit as st
from numpy.typing import NDArray

from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.platoon.simulation import Collision, PlatoonRun
from accpinn.results.figures import platoon as figures
from accpinn.results.figures.stability import colours
from accpinn.results.figures.style import LEADER
from accpinn.results.messages import messages
from accpinn.results.messages.stability import PLACES, disturbance, disturbance_details
from pages.ui.components.charts import show_chart, show_key
from pages.ui.components.messages import escape_markdown, show_messages
from pages.ui.components.widgets import toggle
from pages.ui.session.workspace import Workspace

SHOWN_WHOLE = 0.99
"""A part of a run longer than this share of it is the run."""


def show_answer(run: PlatoonRun, chosen: ParameterSet, order: Sequence[int]) -> None:
    """What becomes of the disturbance, what limits the run, and the key to the colours."""
    with st.container(border=True):
        st.markdown(f"#### {escape_markdown(disturbance(run))}")
        names = [chosen.names[k] for k in order]
        if details := disturbance_details(run, names):
            st.markdown(escape_markdown(details))
    # The answer names the collision already.
    others = [finding for finding in run.findings if not isinstance(finding, Collision)]
    show_messages(messages(others, PLACES), "warning")
    labels = ["Leader", *(figures.follower_name(chosen, k, p) for p, k in enumerate(order, 1))]
    show_key(zip(labels, figures.cast_of(chosen, order).colours, strict=True))


def show_amplitudes(workspace: Workspace, run: PlatoonRun, cast: figures.Cast) -> None:
    """Amplitudes along the platoon, on the user's scale."""
    choice, wave = workspace.platoon_choice, run.amplitudes
    what = "Amplitude" if wave and not run.collisions else "Largest deviation"
    st.subheader(f"{what} along the platoon", anchor=False)
    with st.container(horizontal=True, vertical_alignment="center"):
        toggle("in dB", choice.in_db, "platoon_db", lambda on: choice.set(in_db=on))
        if run.collisions:
            st.caption("Only up to the collision.")
        elif wave and wave.periods:
            periods = "period" if wave.periods == 1 else f"{wave.periods} periods"
            when = "after the transient" if wave.free else "within the transient: simulate longer"
            st.caption(f"Measured over the last {periods}, {when}.")
    show_chart(figures.amplitude_by_vehicle(run, cast, choice.in_db), "platoon_amplitude")


def show_wave_in_time(run: PlatoonRun, cast: figures.Cast) -> None:
    """Speed deviations over time and vehicles."""
    st.subheader("The wave in time", anchor=False)
    st.caption(
        "Each vehicle's speed relative to the speed before the disturbance."
        f" {seconds_shown(run, figures.stretch(run))}"
    )
    show_chart(figures.speed_map(run, cast), "platoon_map")


def show_wave_on_road(run: PlatoonRun, cast: figures.Cast) -> None:
    """The vehicles' places behind the leader, animated."""
    st.subheader("The wave on the road", anchor=False)
    st.caption(
        "Seen from the leader: press Play or drag the slider."
        f" {seconds_shown(run, figures.watched(run))} Squares mark the cars, not to scale: from one"
        f" to the next it is the simulated space-gap and {figures.CAR_LENGTH:g} m of car."
    )
    show_chart(figures.animation(run, cast), "platoon_wave")


def seconds_shown(run: PlatoonRun, rows: NDArray[np.intp]) -> str:
    """Which part of the run these samples are, for a caption."""
    time = run.trajectories.time
    first, last, end = float(time[rows[0]]), float(time[rows[-1]]), float(time[-1])
    if last - first > SHOWN_WHOLE * (end - float(time[0])):
        return f"All {end:.0f} s."
    until = ", until the collision" if run.collisions and rows[-1] >= run.meaningful - 2 else ""
    return f"From {first:.0f} to {last:.0f} s of {end:.0f} s{until}."


def panels_button(workspace: Workspace, label: str, icon: str, key: str, on: bool) -> None:
    """The way to the paper's figure, or back."""
    st.button(
        label, icon=f":material/{icon}:", key=key,
        on_click=lambda: workspace.platoon_choice.set(panels=on),
    )  # fmt: skip


def show_panels(workspace: Workspace) -> None:
    """The paper's figure of eight vehicles behind a sinusoid."""
    panels_button(workspace, "Back to my platoon", "arrow_back", "platoon_back", False)
    st.subheader("The paper's four panels", anchor=False)
    st.caption(
        f"Eight times one vehicle of {ASTAZERO.title} behind a leader that drives 20 m/s for 20 s"
        " and then a sinusoid of 1 m/s. Neither vehicle is string stable; which disturbances"
        " grow depends on their frequency."
    )
    vehicles = sorted({k for k, _ in figures.PANELS})
    show_key([("Leader", LEADER)] + [(ASTAZERO.labels[k], colours(ASTAZERO)[k]) for k in vehicles])
    grid = (*st.columns(2), *st.columns(2))
    for place, (panel, cell) in enumerate(zip(figures.paper_panels(), grid, strict=True)):
        with cell:
            st.markdown(escape_markdown(panel.title))
            show_chart(panel.figure, f"platoon_panel_{place}")
