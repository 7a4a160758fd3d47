"""What the leader of a platoon does: the kind of disturbance and its numbers."""

from dataclasses import fields
from itertools import cycle

import streamlit as st

from accpinn.errors import AccpinnError
from accpinn.model.cthp import Parameters
from accpinn.platoon.leader import Brake, Leader, Recorded, Sinusoid, SpeedStep
from accpinn.stability.report import stability_report
from pages.ui.components.text import escape_markdown
from pages.ui.session.ui_state import Disturbance, PlatoonChoice
from pages.ui.session.workspace import Workspace, sync_widget

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


def choose_leader(workspace: Workspace, platoon: Parameters) -> Leader | None:
    """The kind and its settings; None, with a sentence, where they make no sense."""
    drive = workspace.drive
    offered = [kind for kind in KINDS if kind != "recorded" or workspace.segment]
    kind = drive.kind if drive.kind in offered else "sinusoid"
    st.selectbox(
        "Disturbance of the leader",
        offered,
        index=offered.index(kind),
        format_func=KINDS.__getitem__,
        key=sync_widget("platoon_kind", kind),
        on_change=lambda: drive.change(kind=st.session_state["platoon_kind"]),
    )
    try:
        if kind == "recorded" and workspace.segment:
            segment = workspace.segment
            st.caption(
                f"{escape_markdown(segment.labels[0])} as recorded,"
                f" {escape_markdown(segment.source)},"
                f" {segment.window}."
            )
            return Recorded(segment.time, segment.speeds[:, 0])
        return _planned(workspace, kind, platoon)
    except AccpinnError as fault:
        st.error(escape_markdown(str(fault)), icon=":material/error:")
        return None


def _planned(workspace: Workspace, kind: Disturbance, platoon: Parameters) -> Leader:
    values: dict[str, float] = {}
    if kind == "sinusoid":  # its frequency is what matters, so it gets the room of two
        values["frequency"] = _frequency(workspace.drive, loudest(platoon))
    columns = cycle(st.columns(2))
    for setting in fields(PLANNED[kind]):
        if setting.name not in values:
            with next(columns):
                values[setting.name] = _number(workspace.drive, kind, setting.name)
    return PLANNED[kind](**values)


def _frequency(drive: PlatoonChoice, peak: float) -> float:
    """As carried here or typed in, otherwise the one that this platoon amplifies most."""
    value = peak if drive.omega is None else drive.omega
    label, step = LABELS["frequency"]
    st.number_input(
        label, value=value, key=sync_widget("platoon_frequency", value), step=step, format="%.4g",
        on_change=lambda: drive.change(omega=st.session_state["platoon_frequency"]),
    )  # fmt: skip
    if value == peak:
        st.caption("What this platoon amplifies most.")
    else:
        st.button(
            f"Take this platoon's peak, {peak:.4g} rad/s",
            icon=":material/vertical_align_top:",
            key="platoon_peak",
            on_click=lambda: drive.change(omega=None),
        )
    return value


def _number(drive: PlatoonChoice, kind: Disturbance, setting: str) -> float:
    name, usual = f"{kind}_{setting}", float(getattr(PLANNED[kind], setting))
    key, value = f"platoon_{name}", drive.settings.get(name, usual)

    def changed() -> None:
        if st.session_state[key] is not None:
            drive.settings[name] = st.session_state[key]

    label, step = LABELS[setting]
    st.number_input(
        label, value=value, key=sync_widget(key, value), step=step, format="%.4g", on_change=changed
    )
    return value


def loudest(platoon: Parameters) -> float:
    """The frequency in rad/s that reaches the last follower largest."""
    peak = stability_report(platoon).platoon.peaks[-1]
    return float(f"{peak.omega:.4g}") or QUIET
