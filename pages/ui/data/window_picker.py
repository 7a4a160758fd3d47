"""The segment to cut from a recording: vehicles, Case and window, by widgets or on the chart."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from itertools import takewhile
from math import ceil
from typing import Any

import streamlit as st

from accpinn.errors import SegmentError
from accpinn.recordings.recording import Recording, Window
from accpinn.results.figures import recording as figures
from accpinn.results.figures.recording import regime_key, regime_ribbons
from accpinn.results.figures.style import vehicle_colour
from accpinn.segment.cut import MAX_FOLLOWERS, MINIMUM_DURATION, chains
from accpinn.segment.quality import label_regimes
from pages.ui.components.charts import show_chart, show_key
from pages.ui.components.widgets import number, segments, select
from pages.ui.session.workspace import Workspace

CASES = {
    "I": "Case I: one set of α, β, τ for the whole platoon, as if all followers were the same car.",
    "II": "Case II: each follower has its own α, β, τ, as different cars do.",
}
CHART = "data_overview"


def choose_vehicles(workspace: Workspace, recording: Recording) -> None:
    """Leader and last follower, from the chains the recording has; and the Case."""
    possible = {
        leader: chain[position : position + MAX_FOLLOWERS + 1]
        for chain in chains(recording)
        for position, leader in enumerate(chain[:-1])
    }
    chosen = workspace.vehicles
    # Another recording gets widgets of its own: the same ones would show the former names.
    leader_key, last_key = (f"data_{end}_{recording.sha256[:12]}" for end in ("leader", "last"))

    def lead(leader: int) -> None:
        workspace.choose(_up_to(possible[leader], max(chosen[-1], leader + 1)))

    def follow(last: int) -> None:
        workspace.choose(_up_to(possible[chosen[0]], last))

    select("Leader", possible, chosen[0], leader_key, lead, recording.label)
    select("Last follower", possible[chosen[0]][1:], chosen[-1], last_key, follow, recording.label)
    if len(chosen) > 2:
        segments(
            "Case", {case: f"Case {case}" for case in CASES}, workspace.case, "data_case",
            lambda case: workspace.choose(case=case),
        )  # fmt: skip
        st.caption(CASES[workspace.case])


def _up_to(chain: tuple[int, ...], last: int) -> tuple[int, ...]:
    return tuple(takewhile(lambda vehicle: vehicle <= last, chain))


def choose_window(workspace: Workspace, recording: Recording) -> None:
    """Start and length in seconds."""
    window = workspace.window

    def moved(_: float) -> None:
        start, length = st.session_state["data_start"], st.session_state["data_length"]
        if start is not None and length is not None:
            workspace.choose(window=Window(start, start + length))

    left, right = st.columns(2)
    start, length = float(window.start), float(window.duration)
    longest = float(ceil(recording.duration))
    look: dict[str, Any] = {"min_value": 0.0, "step": 10.0, "format": "%.1f"}
    number(
        "Window starts at [s]", start, "data_start", moved, left,
        max_value=max(recording.duration, start), **look,
    )  # fmt: skip
    number(
        "and lasts [s]", length, "data_length", moved, right,
        max_value=max(longest, length), **look,
    )  # fmt: skip


def show_overview(workspace: Workspace, recording: Recording) -> None:
    """Speeds and gaps over the whole recording; dragging over them sets the window."""
    leader = workspace.vehicles[0]
    entries, faint = [], set()
    for vehicle in recording.present:
        role = " (leader)" if vehicle == leader else ""
        entries.append((recording.label(vehicle) + role, vehicle_colour(vehicle, leader)))
        if vehicle not in workspace.vehicles:
            faint.add(recording.label(vehicle))
    show_key(entries, faint)
    segment, ribbons = None, []
    with suppress(SegmentError):
        segment = workspace.whole_segment()
    if segment:
        regimes = label_regimes(segment, recording)
        ribbons = regime_ribbons(segment, regimes)
    show_chart(
        figures.overview(recording, workspace.vehicles, workspace.window, ribbons),
        CHART,
        on_select=_dragged(workspace, recording),
        selection_mode="box",
    )
    if figures.has_ribbons(recording):
        st.caption("Vehicle: driven by hand (in the vehicle's colour) and missing data (red).")
    if segment:
        show_key((f"Regime: {name}", colour) for name, colour in regime_key(regimes))


def _dragged(workspace: Workspace, recording: Recording) -> Callable[[], None]:
    def moved() -> None:
        if window := window_of(st.session_state[CHART], recording):
            workspace.choose(window=window)

    return moved


def window_of(
    event: Mapping[str, Mapping[str, list[dict[str, list[float]]]]], recording: Recording
) -> Window | None:
    """The window that a drag over the chart marks; None for a click or a slip of the hand."""
    boxes = event["selection"]["box"]
    if not boxes:
        return None
    low, high = (min(max(float(x), 0.0), recording.duration) for x in sorted(boxes[-1]["x"]))
    start, end = round(low, 1), round(high, 1)
    return Window(start, end) if end - start >= MINIMUM_DURATION else None
