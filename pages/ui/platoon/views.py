"""What a simulated platoon tells in words, and the paper's four panels."""

from collections.abc import Sequence

import numpy as np
import streamlit as st
from numpy.typing import NDArray

from accpinn.errors import AccpinnError
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.platoon.leader import Leader
from accpinn.platoon.simulation import Collision, PlatoonRun, simulate_platoon
from accpinn.results.figures import platoon as figures
from accpinn.results.figures.stability import colours
from accpinn.results.figures.style import LEADER
from accpinn.results.messages import messages
from accpinn.results.messages.platoon import AFTER_COLLISION, PLACES
from pages.ui.components.charts import show_chart
from pages.ui.components.frame import show_key
from pages.ui.components.text import bullets, escape_markdown
from pages.ui.session.workspace import Workspace, sync_widget

SHOWN_WHOLE = 0.99
"""A part of a run longer than this share of it is the run."""
EVEN = 0.005
"""An amplitude that differs by less is called as large as the leader's."""


def driven(platoon: Parameters, leader: Leader | None) -> PlatoonRun | None:
    """The simulation; None, with a sentence, where there can be none."""
    if not len(platoon) or leader is None:
        return None
    try:
        return simulate_platoon(platoon, leader)
    except AccpinnError as fault:
        st.error(escape_markdown(str(fault)), icon=":material/error:")
        return None


def show_course(run: PlatoonRun, laws: ParameterSet, order: Sequence[int]) -> None:
    """The answer, what to beware of, and which colour is whom."""
    with st.container(border=True):
        st.markdown(f"#### {headline(run)}")
        if details := detail(run, laws, order):
            st.markdown(details)
    # The headline names the collision; what follows from it stands below that.
    if others := [finding for finding in run.findings if not isinstance(finding, Collision)]:
        st.warning(bullets(messages(others, PLACES)), icon=":material/warning:")
    cast = figures.cast_of(laws, order)
    names = ["Leader", *(figures.follower_name(laws, k, p) for p, k in enumerate(order, 1))]
    show_key(list(zip(names, cast.colours, strict=True)))


def headline(run: PlatoonRun) -> str:
    """What has become of the disturbance at the last follower."""
    wave, moved = run.amplitudes, run.largest_deviation
    what = "oscillation" if wave else "largest speed deviation"
    if run.collisions:
        first = run.collisions[0]
        fate = f"follower {first.follower} collides at {first.time:.0f} s"
        if not moved[0] > 0:
            return f"{fate[0].upper()}{fate[1:]}."
        ratio = moved.max() / moved[0]
        return f"Speeds deviate up to {ratio:.3g} times as much as the leader's, until {fate}."
    sizes = wave.measured if wave and wave.periods else moved
    if not sizes[0] > 0:
        return "The leader keeps its speed, so nothing happens."
    ratio, size = sizes[-1] / sizes[0], f"{sizes[-1]:.3g} m/s against {sizes[0]:.3g} m/s"
    if abs(ratio - 1) < EVEN:
        return f"The last follower's {what} is as large as the leader's: {size}."
    verb = "grows" if ratio > 1 else "fades"
    return f"The {what} {verb} to {ratio:.3g} times the leader's: {size}."


def detail(run: PlatoonRun, laws: ParameterSet, order: Sequence[int]) -> str:
    """What the response predicts for a sinusoid, and how close the vehicles get."""
    wave, parts = run.amplitudes, []
    if run.collisions:
        parts.append(AFTER_COLLISION)
    if wave:
        would = "would reach" if run.collisions else "reaches"
        parts.append(f"By |H| the last follower {would} {wave.predicted[-1]:.3g} m/s.")
    if not run.collisions:
        k = int(run.minimum_gap.argmin())
        parts.append(
            f"The smallest gap is {round(run.minimum_gap[k], 1) + 0.0:.1f} m, follower {k + 1}"
            f" ({escape_markdown(laws.names[order[k]])}) at {run.minimum_gap_time[k]:.0f} s."
        )
    return " ".join(parts)


def choose_scale(workspace: Workspace, run: PlatoonRun) -> bool:
    """Whether amplitudes are drawn in dB; with their heading."""
    drive, wave = workspace.drive, run.amplitudes
    what = "Amplitude" if wave and not run.collisions else "Largest deviation"
    st.subheader(f"{what} along the platoon", anchor=False)
    with st.container(horizontal=True, vertical_alignment="center"):
        st.toggle(
            "in dB",
            value=drive.in_db,
            key=sync_widget("platoon_db", drive.in_db),
            on_change=lambda: drive.change(in_db=st.session_state["platoon_db"]),
        )
        if run.collisions:
            st.caption("Only what comes before the collision.")
        elif wave and wave.periods:
            periods = "period" if wave.periods == 1 else f"{wave.periods} periods"
            when = (
                "after the transient" if wave.free else "with a transient in it: let it run longer"
            )
            st.caption(f"Measured over the last {periods}, {when}.")
    return drive.in_db


def seconds_shown(run: PlatoonRun, rows: NDArray[np.intp]) -> str:
    """Which part of the run these samples are, for a caption."""
    time = run.trajectories.time
    first, last, end = float(time[rows[0]]), float(time[rows[-1]]), float(time[-1])
    if last - first > SHOWN_WHOLE * (end - float(time[0])):
        return f"All {end:.0f} s."
    cut = run.collisions and rows[-1] >= run.meaningful - 2
    return (
        f"From {first:.0f} to {last:.0f} s of {end:.0f} s{', until the collision' if cut else ''}."
    )


def choose_panels(workspace: Workspace) -> None:
    """The way to the paper's figure."""
    st.button(
        "The paper's four panels",
        icon=":material/grid_view:",
        key="platoon_panels",
        on_click=lambda: workspace.drive.change(panels=True),
    )


def show_panels(workspace: Workspace) -> None:
    """The paper's figure of eight vehicles behind a sinusoid."""
    st.button(
        "Back to my platoon",
        icon=":material/arrow_back:",
        key="platoon_back",
        on_click=lambda: workspace.drive.change(panels=False),
    )
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
