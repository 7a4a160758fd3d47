"""Tabs of the page Platoon: amplitudes, map of speeds, the animation, the paper's panels."""

import streamlit as st
from numpy import intp
from numpy.typing import NDArray

from accpinn.model.published import ASTAZERO
from accpinn.platoon.simulation import PlatoonRun
from accpinn.results.figures import platoon as figures
from accpinn.results.figures.animation import animation, watched
from accpinn.results.figures.platoon import PANELS, paper_panels
from accpinn.results.figures.stability import colours
from accpinn.results.figures.style import LEADER
from accpinn.results.tables.stability import amplitude_table
from pages.ui.components import show
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import bound
from pages.ui.session.choices import PlatoonChoice

SHOWN_WHOLE = 0.99
"""A part of a run longer than this share of it is the run."""


def show_amplitudes(choice: PlatoonChoice, run: PlatoonRun, cast: figures.Cast) -> None:
    """Amplitudes along the platoon, on the user's scale, beside their table."""
    left, right = st.columns(2, gap="large")
    wave = run.amplitudes
    with left:
        with st.container(horizontal=True, vertical_alignment="center"):
            st.toggle("in dB", **bound("platoon_db", choice.in_db,
                                       lambda on: choice.set(in_db=on)),
                      help="Relative to the leader's.")  # fmt: skip
            if wave and wave.periods:
                periods = "period" if wave.periods == 1 else f"{wave.periods} periods"
                when = "after" if wave.free else "within"
                more = "" if wave.free else ": simulate longer"
                st.caption(f"Measured over the last {periods}, {when} the transient{more}.")
        show.chart(figures.amplitude_by_vehicle(run, cast, choice.in_db), "platoon_amplitude")
    with right:
        table = amplitude_table(run, cast.labels)
        show.table(table, cast.colours)
        if run.collisions:
            st.caption("A dash: the vehicle, or one ahead of it, collides.")
        show.downloads(table, "platoon_amplitudes", "amplitudes")


def show_map(run: PlatoonRun, cast: figures.Cast) -> None:
    """The speed of every vehicle at every instant."""
    st.caption(
        "Each vehicle's speed relative to the speed before the disturbance."
        f" {_seconds_shown(run, figures.stretch(run))}"
    )
    show.chart(figures.speed_map(run, cast), "platoon_map")


def show_animation(run: PlatoonRun, cast: figures.Cast) -> None:
    """The vehicles on the road."""
    st.caption(
        "Seen from the leader: press Play or drag the slider."
        f" {_seconds_shown(run, watched(run))} Squares mark the cars, not to scale: from"
        f" one to the next it is the simulated space-gap and {figures.CAR_LENGTH:g} m of car."
        " A vehicle that has collided is not drawn any more."
    )
    show.chart(animation(run, cast), "platoon_wave")


def show_panels() -> None:
    """The paper's figure of eight vehicles behind a sinusoid."""
    st.caption(
        f"Eight times one vehicle of {ASTAZERO.title} behind a leader that drives 20 m/s for 20 s"
        " and then a sinusoid of 1 m/s. Neither vehicle is string stable; which disturbances"
        " grow depends on their frequency."
    )
    vehicles = sorted({k for k, _ in PANELS})
    show.key([("Leader", LEADER)] + [(ASTAZERO.labels[k], colours(ASTAZERO)[k]) for k in vehicles])
    grid = (*st.columns(2), *st.columns(2))
    for place, ((title, figure), cell) in enumerate(zip(paper_panels(), grid, strict=True)):
        with cell:
            st.markdown(escape_markdown(title))
            show.chart(figure, f"platoon_panel_{place}")


def _seconds_shown(run: PlatoonRun, rows: NDArray[intp]) -> str:
    """Which part of the run these samples are, for a caption."""
    time = run.trajectories.time
    first, last, end = float(time[rows[0]]), float(time[rows[-1]]), float(time[-1])
    if last - first > SHOWN_WHOLE * (end - float(time[0])):
        return f"All {end:.0f} s." if not first else f"From {first:.0f} to {last:.0f} s."
    return f"From {first:.0f} to {last:.0f} s of {end:.0f} s."
