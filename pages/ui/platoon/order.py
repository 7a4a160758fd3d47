"""Which vehicles drive in a platoon, and in which order."""

import re

import streamlit as st

from accpinn.errors import AccpinnError, ParameterError
from accpinn.model.published import ParameterSet
from pages.ui.components.text import escape_markdown
from pages.ui.session.ui_state import MOST_FOLLOWERS, PlatoonChoice
from pages.ui.session.workspace import Workspace, sync_widget

ORDERS = {"learned": "In order", "repeated": "One car", "own": "Own order"}


def choose_order(workspace: Workspace, laws: ParameterSet) -> list[int] | None:
    """The followers' indices in ``laws``; None, with a sentence, where that cannot be read."""
    drive = workspace.drive
    if len(laws) > 1:
        st.segmented_control(
            "Platoon",
            list(ORDERS),
            default=drive.order,
            format_func=ORDERS.__getitem__,
            key=sync_widget("platoon_order", drive.order),
            on_change=lambda: drive.change(order=st.session_state["platoon_order"]),
            required=True,
        )
    try:
        return _order(drive, laws)
    except AccpinnError as fault:
        st.error(escape_markdown(str(fault)), icon=":material/error:")
        return None


def _order(drive: PlatoonChoice, laws: ParameterSet) -> list[int]:
    if drive.order == "repeated" or len(laws) == 1:
        return _repeated(drive, laws)
    if drive.order == "learned":
        return list(range(len(laws)))
    return _own(drive, laws)


def _repeated(drive: PlatoonChoice, laws: ParameterSet) -> list[int]:
    vehicle = min(drive.vehicle, len(laws) - 1)
    left, right = st.columns((3, 2))
    left.selectbox(
        "Vehicle", range(len(laws)), index=vehicle, format_func=lambda k: laws.labels[k],
        key=sync_widget("platoon_vehicle", vehicle),
        on_change=lambda: drive.change(vehicle=st.session_state["platoon_vehicle"]),
    )  # fmt: skip
    right.number_input(
        "Followers", 1, MOST_FOLLOWERS, drive.followers,
        key=sync_widget("platoon_followers", drive.followers),
        on_change=lambda: drive.change(followers=st.session_state["platoon_followers"]),
    )  # fmt: skip
    return [vehicle] * drive.followers


def _own(drive: PlatoonChoice, laws: ParameterSet) -> list[int]:
    text = drive.own or f"1-{len(laws)}, 1-{len(laws)}"
    st.text_input(
        "Followers, first to last",
        value=text,
        key=sync_widget("platoon_own", text),
        on_change=lambda: drive.change(own=st.session_state["platoon_own"]),
        help="Numbers and ranges: 1-3, 2, 2",
    )
    st.caption(" · ".join(f"{k} = {escape_markdown(name)}" for k, name in enumerate(laws.names, 1)))
    return parse_order(text, len(laws))


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
        order += [number - 1 for number in range(first, last + step, step)]
    if not 0 < len(order) <= MOST_FOLLOWERS:
        raise ParameterError(
            f"Order of followers: there are {len(order)}; give at least one and at most"
            f" {MOST_FOLLOWERS}."
        )
    return order
