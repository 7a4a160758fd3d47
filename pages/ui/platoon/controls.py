"""The controls of the page Platoon: which vehicles drive behind the leader, and what it does."""

import re
from dataclasses import fields
from itertools import cycle

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from accpinn.channels import SPEED
from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.platoon.leader import Brake, Leader, Recorded, Sinusoid, SpeedStep
from accpinn.segment.segment import Segment
from pages.ui.components import show
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import bound, segments, select
from pages.ui.session.choices import Disturbance, PlatoonChoice
from pages.ui.session.resources import report_of
from pages.ui.session.workspace import Workspace

FOLLOWERS, MOST_FOLLOWERS = 8, 20
"""Followers of a repeated vehicle by default, as in the paper, and at most."""
ORDERS = {"learned": "In order", "repeated": "One car", "own": "Own order"}
PLANNED: dict[Disturbance, type[Sinusoid] | type[SpeedStep] | type[Brake]] = {
    "sinusoid": Sinusoid,
    "step": SpeedStep,
    "brake": Brake,
}
LABELS = {
    "frequency": ("Frequency [rad/s]", 0.01, "Of the leader's speed; 2π over it is the period."),
    "amplitude": ("Amplitude [m/s]", 0.1, "Of the leader's speed about its mean."),
    "change": ("Change of speed [m/s]", 0.5, "At once; below zero the leader slows down."),
    "drop": ("Drop of speed [m/s]", 1.0, "By how much the leader slows down."),
    "deceleration": ("Deceleration [m/s²]", 0.5, "Of the leader while it brakes."),
    "hold": ("Held for [s]", 1.0, "How long the leader keeps the lower speed."),
    "acceleration": ("Acceleration [m/s²]", 0.5, "Of the leader back to its speed."),
    "speed": ("Speed before [m/s]", 1.0, "Of all vehicles, in equilibrium."),
    "settle": ("Starts at [s]", 5.0, "When the disturbance begins."),
    "duration": ("Duration [s]", 50.0, "Of the whole run."),
}
"""Each setting's label, the step of its buttons, and what it is."""
FIRST = {"sinusoid": "frequency", "step": "change", "brake": "drop"}
"""The setting of each disturbance that stands in the row; the others are one click away."""


def choose_platoon(
    workspace: Workspace, chosen: ParameterSet
) -> tuple[list[int] | None, Leader | None]:
    """The row of controls: the followers' indices in ``chosen``, and the leader.

    Returns:
        None for what makes no sense, with a sentence.
    """
    choice = workspace.platoon_choice
    with st.container(horizontal=True, vertical_alignment="bottom", key="later_1_platoon"):
        order = _choose_order(workspace, chosen)
        leader = _choose_leader(workspace, chosen.parameters[order]) if order else None
    if choice.order == "own" and len(chosen) > 1:
        st.caption(
            " · ".join(f"{k} = {escape_markdown(n)}" for k, n in enumerate(chosen.labels, 1))
        )
    return order, leader


def _choose_order(workspace: Workspace, chosen: ParameterSet) -> list[int] | None:
    """The followers' indices in ``chosen``; None, with a sentence, for no order."""
    choice = workspace.platoon_choice
    if len(chosen) > 1:
        segments("Platoon", ORDERS, choice.order, "platoon_order",
                 lambda order: choice.set(order=order), labelled=True,
                 help="All vehicles in order, one of them repeated, or any order.")  # fmt: skip
    if choice.order == "repeated" or len(chosen) == 1:
        vehicle = min(choice.vehicle, len(chosen) - 1)
        if len(chosen) > 1:
            select("Vehicle", dict(enumerate(chosen.labels)), vehicle, "platoon_vehicle",
                   lambda k: choice.set(vehicle=k), width=200,
                   help="The vehicle that is repeated.")  # fmt: skip
        recorded = recorded_leader(workspace) if choice.kind == "recorded" else None
        followers = choice.followers or (recorded.followers if recorded else FOLLOWERS)
        counted = bound("platoon_followers", followers, lambda n: choice.set(followers=n))
        st.number_input(
            "Followers", **counted, min_value=1, max_value=MOST_FOLLOWERS, width=120,
            help="How many of it drive behind the leader.",
        )  # fmt: skip
        return [vehicle] * followers
    if choice.order == "learned":
        return list(range(len(chosen)))
    text = choice.own or f"1-{len(chosen)}, 1-{len(chosen)}"
    st.text_input(
        "Followers, first to last", **bound("platoon_own", text, lambda own: choice.set(own=own)),
        help="Numbers and ranges: 1-3, 2, 2", width=200,
    )  # fmt: skip
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


def recorded_leader(workspace: Workspace) -> Segment | None:
    """The segment whose leader can drive: all of its speed was recorded."""
    segment = workspace.segment
    if segment is None:
        return None
    column = SPEED.of(segment.vehicles[0])
    gone = any(column in block.columns for block in segment.blocks_missing)
    return None if gone else segment


def _choose_leader(workspace: Workspace, platoon: Parameters) -> Leader | None:
    """The leader's disturbance; None, with a sentence, where its settings make no sense."""
    choice, segment = workspace.platoon_choice, recorded_leader(workspace)
    offered: dict[Disturbance, str] = {kind: kind.capitalize() for kind in PLANNED}
    offered |= {"recorded": "As recorded"} if segment else {}
    kind = choice.kind if choice.kind in offered else "sinusoid"
    select("Disturbance of the leader", offered, kind, "platoon_kind",
           lambda kind: choice.set(kind=kind), width=190,
           help="What the leader does; as recorded, it drives as in the open window.")  # fmt: skip
    if kind == "recorded" and segment:
        return Recorded(segment.start + segment.time, segment.speeds[:, 0])
    return show.attempt(lambda: _planned(choice, kind, platoon))


def _planned(choice: PlatoonChoice, kind: Disturbance, platoon: Parameters) -> Leader:
    values: dict[str, float] = {}
    first = FIRST[kind]
    if first == "frequency":
        values[first] = _frequency(choice, platoon)
    else:
        values[first] = _setting(choice, kind, first, st.container(width=170))
    with st.popover("Settings", icon=":material/tune:", help="Further settings of the leader"):
        columns = cycle(st.columns(2))
        for setting in fields(PLANNED[kind]):
            if setting.name != first:
                values[setting.name] = _setting(choice, kind, setting.name, next(columns))
    return PLANNED[kind](**values)


def _setting(
    choice: PlatoonChoice, kind: Disturbance, setting: str, place: DeltaGenerator
) -> float:
    name, usual = f"{kind}_{setting}", float(getattr(PLANNED[kind], setting))
    value, (label, step, meaning) = choice.settings.get(name, usual), LABELS[setting]

    def changed(new: float) -> None:
        choice.settings[name] = new

    place.number_input(
        label, **bound(f"platoon_{name}", value, changed), step=step, format="%.4g", help=meaning,
    )  # fmt: skip
    return value


def _frequency(choice: PlatoonChoice, platoon: Parameters) -> float:
    """The one chosen, otherwise the one at which this platoon's last follower moves most."""
    peak = float(f"{report_of(platoon).platoon.peaks[-1].omega:.4g}") or Sinusoid.frequency
    value = peak if choice.omega is None else choice.omega
    label, step, meaning = LABELS["frequency"]
    shown = bound("platoon_frequency", value, lambda new: choice.set(omega=new), optional=True)
    at_peak = " Now at the peak of this platoon." if value == peak else ""
    st.number_input(label, **shown, step=step, format="%.4g", width=170, help=meaning + at_peak)
    if value != peak:
        st.button(
            f"Peak: {peak:.4g} rad/s", icon=":material/vertical_align_top:", key="platoon_peak",
            on_click=lambda: choice.set(omega=None),
            help="The frequency that this platoon amplifies most.",
        )  # fmt: skip
    return value
