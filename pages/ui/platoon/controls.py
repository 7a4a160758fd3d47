"""Which vehicles drive in a platoon and in which order, and what the leader does."""

import re
from dataclasses import fields
from itertools import cycle

import streamlit as st

from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.platoon.leader import Brake, Leader, Recorded, Sinusoid, SpeedStep
from accpinn.stability.report import stability_report
from pages.ui.components.messages import attempt, escape_markdown
from pages.ui.components.widgets import number, segments, select, sync_widget
from pages.ui.session.ui_state import MOST_FOLLOWERS, Disturbance, PlatoonChoice
from pages.ui.session.workspace import Workspace

ORDERS = {"learned": "In order", "repeated": "One car", "own": "Own order"}
KINDS: dict[Disturbance, str] = {
    "sinusoid": "Sinusoid",
    "step": "Step",
    "brake": "Brake",
    "recorded": "As recorded",
}
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


def choose_order(workspace: Workspace, chosen: ParameterSet) -> list[int] | None:
    """The followers' indices in ``chosen``; None, with a sentence, for no order."""
    choice = workspace.platoon_choice
    if len(chosen) > 1:
        segments("Platoon", ORDERS, choice.order, "platoon_order",
                 lambda order: choice.set(order=order), labelled=True)  # fmt: skip
    if choice.order == "repeated" or len(chosen) == 1:
        return _repeated(choice, chosen)
    if choice.order == "learned":
        return list(range(len(chosen)))
    return attempt(lambda: _own(choice, chosen))


def _repeated(choice: PlatoonChoice, chosen: ParameterSet) -> list[int]:
    vehicle = min(choice.vehicle, len(chosen) - 1)
    left, right = st.columns((3, 2))
    select("Vehicle", range(len(chosen)), vehicle, "platoon_vehicle",
           lambda k: choice.set(vehicle=k), lambda k: chosen.labels[k], place=left)  # fmt: skip
    number("Followers", choice.followers, "platoon_followers",
           lambda count: choice.set(followers=count), right,
           min_value=1, max_value=MOST_FOLLOWERS)  # fmt: skip
    return [vehicle] * choice.followers


def _own(choice: PlatoonChoice, chosen: ParameterSet) -> list[int]:
    text = choice.own or f"1-{len(chosen)}, 1-{len(chosen)}"
    st.text_input(
        "Followers, first to last",
        value=text,
        key=sync_widget("platoon_own", text),
        on_change=lambda: choice.set(own=st.session_state["platoon_own"]),
        help="Numbers and ranges: 1-3, 2, 2",
    )
    st.caption(" · ".join(f"{k} = {escape_markdown(n)}" for k, n in enumerate(chosen.names, 1)))
    return parse_order(text, len(chosen))


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


def choose_leader(workspace: Workspace, platoon: Parameters) -> Leader | None:
    """The leader's disturbance; None, with a sentence, where its settings make no sense."""
    choice, segment = workspace.platoon_choice, workspace.segment
    offered = [kind for kind in KINDS if kind != "recorded" or segment]
    kind = choice.kind if choice.kind in offered else "sinusoid"
    select("Disturbance of the leader", offered, kind, "platoon_kind",
           lambda kind: choice.set(kind=kind), KINDS.__getitem__)  # fmt: skip
    if kind == "recorded" and segment:
        place = f"{segment.labels[0]} as recorded, {segment.source}, {segment.window}."
        st.caption(escape_markdown(place))
        return Recorded(segment.time, segment.speeds[:, 0])
    return attempt(lambda: _planned(choice, kind, platoon))


def _planned(choice: PlatoonChoice, kind: Disturbance, platoon: Parameters) -> Leader:
    values: dict[str, float] = {}
    if kind == "sinusoid":  # its frequency is what matters, so it gets the room of two
        values["frequency"] = _frequency(choice, peak_frequency(platoon))
    columns = cycle(st.columns(2))
    for setting in fields(PLANNED[kind]):
        if setting.name not in values:
            with next(columns):
                values[setting.name] = _setting(choice, kind, setting.name)
    return PLANNED[kind](**values)


def _frequency(choice: PlatoonChoice, peak: float) -> float:
    """The one chosen, otherwise the one that this platoon amplifies most."""
    value = peak if choice.omega is None else choice.omega
    label, step = LABELS["frequency"]
    number(label, value, "platoon_frequency", lambda omega: choice.set(omega=omega),
           optional=True, step=step, format="%.4g")  # fmt: skip
    if value == peak:
        st.caption("The peak frequency of this platoon.")
    else:
        st.button(
            f"Take this platoon's peak, {peak:.4g} rad/s",
            icon=":material/vertical_align_top:",
            key="platoon_peak",
            on_click=lambda: choice.set(omega=None),
        )
    return value


def _setting(choice: PlatoonChoice, kind: Disturbance, setting: str) -> float:
    name, usual = f"{kind}_{setting}", float(getattr(PLANNED[kind], setting))
    value, (label, step) = choice.settings.get(name, usual), LABELS[setting]
    number(label, value, f"platoon_{name}",
           lambda new: choice.settings.update({name: new}), step=step, format="%.4g")  # fmt: skip
    return value


def peak_frequency(platoon: Parameters) -> float:
    """The frequency in rad/s at which the disturbance of the last follower is largest."""
    peak = stability_report(platoon).platoon.peaks[-1]
    return float(f"{peak.omega:.4g}") or QUIET
