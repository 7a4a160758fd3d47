"""The page Platoon: controls, the simulation in words, speeds and time-space diagram, and tabs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import streamlit as st
from numpy import intp
from numpy.typing import NDArray

from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO
from accpinn.platoon.leader import Leader, Recorded, Sinusoid
from accpinn.platoon.simulation import Collision, PlatoonRun, simulate_platoon
from accpinn.results.figures import platoon as figures
from accpinn.results.figures.animation import animation, watched
from accpinn.results.figures.stability import colours
from accpinn.results.figures.style import LEADER
from accpinn.results.messages import messages
from accpinn.results.messages.stability import (
    PLACES,
    Places,
    disturbance,
    not_acc,
    probabilities,
    smallest_gap,
)
from accpinn.results.tables.stability import amplitude_table
from accpinn.segment.segment import Segment
from pages.ui.components import frame, show
from pages.ui.components.parameter_picker import Chosen, choose_parameters
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import bound, segments, tabs
from pages.ui.platoon.controls import choose_platoon, recorded_leader
from pages.ui.session.choices import PlatoonChoice
from pages.ui.session.resources import KEPT
from pages.ui.session.workspace import Workspace

LEAD = "A disturbance of the leader, in a platoon of these vehicles."
HEIGHT = 350
"""Height of both charts, in pixels."""
VIEWS: dict[figures.View, str] = {
    "observer": "Moving observer",
    "leader": "From the leader",
    "road": "From the road",
}
_simulated = lru_cache(maxsize=KEPT)(simulate_platoon)


TABS = "platoon"
"""Key of the page's tabs."""
PANELS = "The paper's four panels"
SHOWN_WHOLE = 0.99
"""A part of a run longer than this share of it is the run."""


@dataclass(frozen=True, eq=False)
class ShownRun:
    """What the parts of the page are about."""

    workspace: Workspace
    source: Chosen
    order: Sequence[int]
    """The index of each follower among the source's vehicles."""
    run: PlatoonRun

    @property
    def choice(self) -> PlatoonChoice:
        """What the user has chosen."""
        return self.workspace.platoon_choice

    @cached_property
    def cast(self) -> figures.Cast:
        """Labels and colours."""
        return figures.cast_of(self.source.vehicles, self.order)

    @property
    def places(self) -> Places:
        """What sentences call the vehicles."""
        vehicles = self.source.vehicles
        in_order = figures.is_in_order(vehicles, self.order)
        return Places(vehicles.spoken) if in_order else PLACES

    @property
    def span(self) -> figures.Span | None:
        """The part of the run that is drawn; None for all of it."""
        return None if self.choice.whole else figures.close_up(self.run)

    @property
    def recorded(self) -> Segment | None:
        """The recording whose leader drives."""
        return recorded_leader(self.workspace) if isinstance(self.run.leader, Recorded) else None


def open_panels(workspace: Workspace) -> None:
    """Let the page show the paper's four panels, which need parameters to stand beside."""
    if workspace.result is None:
        workspace.choose_source("published")
    workspace.tabs[TABS] = PANELS


def show_page() -> None:
    workspace = frame.begin("Platoon")
    source = choose_parameters(workspace, "platoon", LEAD)
    if source is None:
        return
    order, leader = choose_platoon(workspace, source.vehicles)
    run = _run(source.vehicles.parameters[order], leader) if order and leader else None
    if run is None or order is None:
        return
    shown = ShownRun(workspace, source, order, run)
    _show_answer(shown)
    _show_charts(shown)
    tabs(
        workspace,
        TABS,
        {
            "Amplitudes": lambda: show_amplitudes(shown.choice, run, shown.cast),
            "Map of speeds": lambda: show_map(run, shown.cast),
            "Animation": lambda: show_animation(run, shown.cast),
            PANELS: show_panels,
        },
    )


def _run(platoon: Parameters, leader: Leader) -> PlatoonRun | None:
    """The simulation; None, with a sentence, where it is refused."""
    work = simulate_platoon if isinstance(leader, Recorded) else _simulated
    return show.attempt(lambda: work(platoon, leader))


def _show_answer(shown: ShownRun) -> None:
    run, source, places = shown.run, shown.source, shown.places
    chosen = source.vehicles
    with st.container(border=True):
        said = f"{disturbance(run, places)} {not_acc(chosen)}".rstrip()
        st.markdown(f"{escape_markdown(source.origin)}\n\n#### {escape_markdown(said)}")
        details = smallest_gap(run, places)
        if recorded := shown.recorded:
            leader = f"{recorded.labels[0]} as recorded, {recorded.source}, {recorded.window}"
            details = f"The leader: {leader}; the platoon begins in equilibrium. {details}"
        if source.uncertainty:
            odds = probabilities(chosen, source.uncertainty)
            details += f" The simulation is that of the estimates. {odds}"
        st.caption(escape_markdown(details))
    # The answer names the collisions already.
    others = [finding for finding in run.findings if not isinstance(finding, Collision)]
    show.messages(messages(others, places), "warning")


def _show_charts(shown: ShownRun) -> None:
    run, cast, choice, recorded = shown.run, shown.cast, shown.choice, shown.recorded
    with st.container(horizontal=True, vertical_alignment="center"):
        _choose_part(shown)
        segments(
            "Seen from", VIEWS, choice.view, "platoon_view", lambda view: choice.set(view=view),
            help="Of the time-space diagram. The observer drives at the leader's mean speed, so"
            " that distances between the vehicles and their motion are seen.",
        )  # fmt: skip
        show.key(
            zip(cast.labels, cast.colours, strict=True),
            dashed="recorded (dotted)" if recorded and choice.measured else "",
        )
    left, right = st.columns(2, gap="medium")
    with left:
        measured = recorded if choice.measured else None
        figure = figures.profiles(run, cast, shown.span, measured, HEIGHT)
        show.chart(figure, "platoon_profiles")
    with right:
        figure = figures.time_space(run, cast, shown.span, choice.view, HEIGHT)
        show.chart(figure, "platoon_time_space")


def _choose_part(shown: ShownRun) -> None:
    """Which part of the run is drawn; of a recorded leader all, with or without its followers."""
    run, choice = shown.run, shown.choice
    if shown.recorded:
        st.toggle(
            "Recorded followers",
            **bound("platoon_measured", choice.measured, lambda on: choice.set(measured=on)),
            help="The speeds and space-gaps of the followers in the recording, dotted.",
        )
        return
    closer = "Last periods" if isinstance(run.leader, Sinusoid) else "Disturbance"
    segments(
        "Part of the run", {False: "Collision" if run.collisions else closer, True: "Whole run"},
        choice.whole, "platoon_whole", lambda whole: choice.set(whole=whole),
        help="Which part of the run both charts show.",
    )  # fmt: skip


# Tabs


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
    st.caption(
        "Each vehicle's speed relative to the speed before the disturbance."
        f" {_seconds_shown(run, figures.stretch(run))}"
    )
    show.chart(figures.speed_map(run, cast), "platoon_map")


def show_animation(run: PlatoonRun, cast: figures.Cast) -> None:
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
    vehicles = sorted({k for k, _ in figures.PANELS})
    show.key([("Leader", LEADER)] + [(ASTAZERO.labels[k], colours(ASTAZERO)[k]) for k in vehicles])
    grid = (*st.columns(2), *st.columns(2))
    for place, ((title, figure), cell) in enumerate(zip(figures.paper_panels(), grid, strict=True)):
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
