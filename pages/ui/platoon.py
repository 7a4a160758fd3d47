"""The page Platoon: vehicles and leader chosen, the simulation in words and charts, the panels."""

import re
from collections.abc import Sequence
from dataclasses import fields
from itertools import cycle

import numpy as np
import streamlit as st
from numpy.typing import NDArray

from accpinn.channels import SPEED
from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.platoon.leader import Brake, Leader, Recorded, Sinusoid, SpeedStep
from accpinn.platoon.simulation import Collision, PlatoonRun, simulate_platoon
from accpinn.results.figures import platoon as figures
from accpinn.results.figures.stability import colours
from accpinn.results.figures.style import LEADER
from accpinn.results.messages import messages
from accpinn.results.messages.stability import (
    PLACES,
    Places,
    disturbance,
    disturbance_details,
    not_acc,
    probabilities,
)
from accpinn.stability.report import stability_report
from pages.ui.components import frame, show
from pages.ui.components.parameter_picker import Chosen, choose_parameters, show_missing
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import bound, segments, select
from pages.ui.session.workspace import Disturbance, PlatoonChoice, Workspace

MOST_FOLLOWERS = 20
ORDERS = {"learned": "In order", "repeated": "One car", "own": "Own order"}
PLANNED: dict[Disturbance, type[Sinusoid] | type[SpeedStep] | type[Brake]] = {
    "sinusoid": Sinusoid,
    "step": SpeedStep,
    "brake": Brake,
}
LABELS = {
    "frequency": ("Frequency [rad/s]", 0.01),
    "amplitude": ("Amplitude [m/s]", 0.1),
    "change": ("Change of speed [m/s]", 0.5),
    "drop": ("Drop of speed [m/s]", 1.0),
    "deceleration": ("Deceleration [m/s²]", 0.5),
    "hold": ("Held for [s]", 1.0),
    "acceleration": ("Acceleration [m/s²]", 0.5),
    "speed": ("Speed before [m/s]", 1.0),
    "settle": ("Starts at [s]", 5.0),
    "duration": ("Duration [s]", 50.0),
}
"""Each setting's label and the step of its buttons."""
QUIET = 0.25
"""Frequency in rad/s for a platoon that amplifies none: the paper's first."""
SHOWN_WHOLE = 0.99
"""A part of a run longer than this share of it is the run."""


def show_page() -> None:
    """Draw the page."""
    workspace = frame.begin(
        "Platoon", "A disturbance of the leader, in a platoon of these vehicles."
    )
    choice = workspace.platoon_choice
    if choice.panels:
        _show_panels(choice)
        return
    source = choose_parameters(workspace, "platoon")
    if source is None:
        _panels_button(choice, "The paper's four panels", "grid_view", "platoon_panels", True)
        return
    if source.missing:
        show_missing(workspace, source)
        return
    chosen = source.vehicles
    controls, chart = st.columns((1, 2.6), gap="medium")
    with controls:
        order = _choose_order(choice, chosen)
        platoon = chosen.parameters[order or []]
        leader = _choose_leader(workspace, platoon) if order else None
        _panels_button(choice, "The paper's four panels", "grid_view", "platoon_panels", True)
    with chart:
        run = show.attempt(lambda: simulate_platoon(platoon, leader)) if leader else None
        if run is None or order is None:
            return
        cast = figures.cast_of(chosen, order)
        _show_answer(run, source, order, cast)
        show.chart(figures.profiles(run, cast), "platoon_profiles")
    left, right = st.columns(2, gap="large")
    with left:
        _show_amplitudes(choice, run, cast)
    with right:
        st.subheader("The wave in time", anchor=False)
        st.caption(
            "Each vehicle's speed relative to the speed before the disturbance."
            f" {_seconds_shown(run, figures.stretch(run))}"
        )
        show.chart(figures.speed_map(run, cast), "platoon_map")
    st.subheader("The wave on the road", anchor=False)
    st.caption(
        "Seen from the leader: press Play or drag the slider."
        f" {_seconds_shown(run, figures.watched(run))} Squares mark the cars, not to scale: from"
        f" one to the next it is the simulated space-gap and {figures.CAR_LENGTH:g} m of car."
    )
    show.chart(figures.animation(run, cast), "platoon_wave")


def _choose_order(choice: PlatoonChoice, chosen: ParameterSet) -> list[int] | None:
    """The followers' indices in ``chosen``; None, with a sentence, for no order."""
    if len(chosen) > 1:
        segments("Platoon", ORDERS, choice.order, "platoon_order",
                 lambda order: choice.set(order=order), labelled=True)  # fmt: skip
    if choice.order == "repeated" or len(chosen) == 1:
        vehicle = min(choice.vehicle, len(chosen) - 1)
        left, right = st.columns((3, 2))
        select("Vehicle", dict(enumerate(chosen.labels)), vehicle, "platoon_vehicle",
               lambda k: choice.set(vehicle=k), place=left)  # fmt: skip
        counted = bound("platoon_followers", choice.followers, lambda n: choice.set(followers=n))
        right.number_input("Followers", **counted, min_value=1, max_value=MOST_FOLLOWERS)
        return [vehicle] * choice.followers
    if choice.order == "learned":
        return list(range(len(chosen)))
    text = choice.own or f"1-{len(chosen)}, 1-{len(chosen)}"
    st.text_input(
        "Followers, first to last", **bound("platoon_own", text, lambda own: choice.set(own=own)),
        help="Numbers and ranges: 1-3, 2, 2",
    )  # fmt: skip
    st.caption(" · ".join(f"{k} = {escape_markdown(n)}" for k, n in enumerate(chosen.labels, 1)))
    return show.attempt(lambda: parse_order(text, len(chosen)))


def parse_order(text: str, count: int) -> list[int]:
    """Indices from numbers and ranges such as "1-3, 2, 2"; the first vehicle is 1.

    Raises:
        ParameterError: for anything else, and for vehicles that there are not.
    """
    order: list[int] = []
    for part in filter(None, re.split(r"[,\s]+", re.sub(r"\s*[-–]\s*", "-", text))):
        match = re.fullmatch(r"(\d{1,3})(?:-(\d{1,3}))?", part)
        if not match:
            raise ParameterError(
                f"Order of followers: “{part}” is not a number; write numbers from 1 to {count}"
                " with commas between them, such as 1-3, 2."
            )
        first, last = int(match[1]), int(match[2] or match[1])
        if not (1 <= first <= count and 1 <= last <= count):
            raise ParameterError(
                f"Order of followers: there is no vehicle {part}; give numbers from 1 to {count}."
            )
        step = 1 if last >= first else -1
        order += [vehicle - 1 for vehicle in range(first, last + step, step)]
    if not 0 < len(order) <= MOST_FOLLOWERS:
        raise ParameterError(
            f"Order of followers: there are {len(order)}; give at least one and at most"
            f" {MOST_FOLLOWERS}."
        )
    return order


def _choose_leader(workspace: Workspace, platoon: Parameters) -> Leader | None:
    """The leader's disturbance; None, with a sentence, where its settings make no sense."""
    choice, segment = workspace.platoon_choice, workspace.segment
    offered: dict[Disturbance, str] = {kind: kind.capitalize() for kind in PLANNED}
    gone = segment is not None and any(
        SPEED.of(segment.vehicles[0]) in block.columns for block in segment.blocks_missing
    )
    offered |= {"recorded": "As recorded"} if segment and not gone else {}
    kind = choice.kind if choice.kind in offered else "sinusoid"
    select("Disturbance of the leader", offered, kind, "platoon_kind",
           lambda kind: choice.set(kind=kind))  # fmt: skip
    if kind == "recorded" and segment:
        place = f"{segment.labels[0]} as recorded, {segment.source}, {segment.window}."
        st.caption(escape_markdown(place))
        return Recorded(segment.start + segment.time, segment.speeds[:, 0])
    return show.attempt(lambda: _planned(choice, kind, platoon))


def _planned(choice: PlatoonChoice, kind: Disturbance, platoon: Parameters) -> Leader:
    values: dict[str, float] = {}
    if kind == "sinusoid":  # its frequency is what matters, so it gets the room of two
        values["frequency"] = _frequency(choice, platoon)
    columns = cycle(st.columns(2))
    for setting in fields(PLANNED[kind]):
        if setting.name not in values:
            name, usual = f"{kind}_{setting.name}", float(getattr(PLANNED[kind], setting.name))
            value, (label, step) = choice.settings.get(name, usual), LABELS[setting.name]

            def changed(new: float, name: str = name) -> None:
                choice.settings[name] = new

            shown = bound(f"platoon_{name}", value, changed)
            next(columns).number_input(label, **shown, step=step, format="%.4g")
            values[setting.name] = value
    return PLANNED[kind](**values)


def _frequency(choice: PlatoonChoice, platoon: Parameters) -> float:
    """The one chosen, otherwise the one at which this platoon's last follower moves most."""
    peak = float(f"{stability_report(platoon).platoon.peaks[-1].omega:.4g}") or QUIET
    value = peak if choice.omega is None else choice.omega
    label, step = LABELS["frequency"]
    shown = bound("platoon_frequency", value, lambda new: choice.set(omega=new), optional=True)
    st.number_input(label, **shown, step=step, format="%.4g")
    if value == peak:
        st.caption("The peak frequency of this platoon.")
    else:
        st.button(
            f"Take this platoon's peak, {peak:.4g} rad/s", icon=":material/vertical_align_top:",
            key="platoon_peak", on_click=lambda: choice.set(omega=None),
        )  # fmt: skip
    return value


def _show_answer(run: PlatoonRun, source: Chosen, order: Sequence[int], cast: figures.Cast) -> None:
    """What becomes of the disturbance, what limits the run, and the key to the colours."""
    chosen = source.vehicles
    places = Places(chosen.spoken) if figures.is_in_order(chosen, order) else PLACES
    with st.container(border=True):
        said = f"{disturbance(run, places)} {not_acc(chosen)}".rstrip()
        st.markdown(f"{escape_markdown(source.origin)}\n\n#### {escape_markdown(said)}")
        if source.uncertainty:
            st.markdown(
                "The simulation is that of the estimates. "
                + escape_markdown(probabilities(chosen, source.uncertainty))
            )
        if details := disturbance_details(run, places):
            st.markdown(escape_markdown(details))
    # The answer names the collision already.
    others = [finding for finding in run.findings if not isinstance(finding, Collision)]
    show.messages(messages(others, places), "warning")
    show.key(zip(cast.labels, cast.colours, strict=True))


def _show_amplitudes(choice: PlatoonChoice, run: PlatoonRun, cast: figures.Cast) -> None:
    """Amplitudes along the platoon, on the user's scale."""
    wave = run.amplitudes
    what = "Amplitude" if wave and not run.collisions else "Largest deviation"
    st.subheader(f"{what} along the platoon", anchor=False)
    with st.container(horizontal=True, vertical_alignment="center"):
        st.toggle("in dB", **bound("platoon_db", choice.in_db, lambda on: choice.set(in_db=on)))
        if run.collisions:
            st.caption("Only up to the collision.")
        elif wave and wave.periods:
            periods = "period" if wave.periods == 1 else f"{wave.periods} periods"
            when = "after the transient" if wave.free else "within the transient: simulate longer"
            st.caption(f"Measured over the last {periods}, {when}.")
    show.chart(figures.amplitude_by_vehicle(run, cast, choice.in_db), "platoon_amplitude")


def _seconds_shown(run: PlatoonRun, rows: NDArray[np.intp]) -> str:
    """Which part of the run these samples are, for a caption."""
    time = run.trajectories.time
    first, last, end = float(time[rows[0]]), float(time[rows[-1]]), float(time[-1])
    if last - first > SHOWN_WHOLE * (end - float(time[0])):
        return f"All {end:.0f} s." if not first else f"From {first:.0f} to {last:.0f} s."
    until = ", until the collision" if run.collisions and rows[-1] >= run.meaningful - 2 else ""
    return f"From {first:.0f} to {last:.0f} s of {end:.0f} s{until}."


def _panels_button(choice: PlatoonChoice, label: str, icon: str, key: str, on: bool) -> None:
    """The way to the paper's figure, or back."""
    st.button(label, icon=f":material/{icon}:", key=key, on_click=lambda: choice.set(panels=on))


def _show_panels(choice: PlatoonChoice) -> None:
    """The paper's figure of eight vehicles behind a sinusoid."""
    _panels_button(choice, "Back to my platoon", "arrow_back", "platoon_back", False)
    st.subheader("The paper's four panels", anchor=False)
    st.caption(
        f"Eight times one vehicle of {ASTAZERO.title} behind a leader that drives 20 m/s for 20 s"
        " and then a sinusoid of 1 m/s. Neither vehicle is string stable; which disturbances"
        " grow depends on their frequency."
    )
    vehicles = sorted({k for k, _ in figures.PANELS})
    show.key([("Leader", LEADER)] + [(ASTAZERO.labels[k], colours(ASTAZERO)[k]) for k in vehicles])
    grid = (*st.columns(2), *st.columns(2))
    for place, (panel, cell) in enumerate(zip(figures.paper_panels(), grid, strict=True)):
        with cell:
            st.markdown(escape_markdown(panel.title))
            show.chart(panel.figure, f"platoon_panel_{place}")
