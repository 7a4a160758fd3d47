"""What is cut from a recording: vehicles, Case and window, by widgets or on the chart."""

from collections.abc import Callable, Mapping
from itertools import takewhile
from math import ceil

import streamlit as st

from accpinn.recordings.recording import Recording, Window
from accpinn.results.figures.recording import has_ribbons, regime_key, regime_ribbons
from accpinn.results.figures.recording import overview as draw_overview
from accpinn.results.figures.style import vehicle_colour
from accpinn.segment.cut import MINIMUM_DURATION
from accpinn.segment.regimes import label_regimes
from accpinn.segment.vehicles import MAX_FOLLOWERS, chains
from pages.ui.components.charts import show_chart
from pages.ui.components.frame import show_key
from pages.ui.data.regimes import whole
from pages.ui.session.workspace import Workspace, sync_widget

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

    def lead() -> None:
        leader = st.session_state[leader_key]
        last = max(chosen[-1], leader + 1)
        workspace.choose(vehicles=_up_to(possible[leader], last))

    def follow() -> None:
        last = st.session_state[last_key]
        workspace.choose(vehicles=_up_to(possible[chosen[0]], last))

    leaders, followers = list(possible), possible[chosen[0]][1:]
    st.selectbox(
        "Leader",
        leaders,
        index=leaders.index(chosen[0]),
        format_func=recording.label,
        key=sync_widget(leader_key, chosen[0]),
        on_change=lead,
    )
    st.selectbox(
        "Last follower",
        followers,
        index=followers.index(chosen[-1]),
        format_func=recording.label,
        key=sync_widget(last_key, chosen[-1]),
        on_change=follow,
    )
    if len(chosen) > 2:
        _choose_case(workspace)


def _up_to(chain: tuple[int, ...], last: int) -> tuple[int, ...]:
    return tuple(takewhile(lambda number: number <= last, chain))


def _choose_case(workspace: Workspace) -> None:
    st.segmented_control(
        "Case",
        list(CASES),
        default=workspace.case,
        format_func=lambda case: f"Case {case}",
        key=sync_widget("data_case", workspace.case),
        on_change=lambda: workspace.choose(case=st.session_state["data_case"]),
        required=True,
        label_visibility="collapsed",
    )
    st.caption(CASES[workspace.case])


def choose_window(workspace: Workspace, recording: Recording) -> None:
    """Start and length in seconds."""
    window = workspace.window

    def moved() -> None:
        start = st.session_state["data_start"]
        length = st.session_state["data_length"]
        if start is not None and length is not None:
            workspace.choose(window=Window(start, start + length))

    left, right = st.columns(2)
    start, length = float(window.start), float(window.duration)
    left.number_input(
        "Window starts at [s]",
        0.0,
        max(recording.duration, start),
        start,
        key=sync_widget("data_start", start),
        step=10.0,
        format="%.1f",
        on_change=moved,
    )
    right.number_input(
        "and lasts [s]",
        0.0,
        max(float(ceil(recording.duration)), length),
        length,
        key=sync_widget("data_length", length),
        step=10.0,
        format="%.1f",
        on_change=moved,
    )


def overview(workspace: Workspace, recording: Recording) -> None:
    """Speeds and gaps over the whole recording; dragging over them sets the window."""
    leader = workspace.vehicles[0]
    entries, faint = [], set()
    for number in recording.present:
        label = recording.label(number)
        role = " (leader)" if number == leader else ""
        entries.append((label + role, vehicle_colour(number, leader)))
        if number not in workspace.vehicles:
            faint.add(label)
    show_key(entries, faint)
    segment, ribbons = whole(workspace), []
    if segment:
        regimes = label_regimes(segment, recording)
        ribbons = regime_ribbons(segment, regimes)
    show_chart(
        draw_overview(recording, workspace.vehicles, workspace.window, ribbons),
        CHART,
        on_select=_dragged(workspace, recording),
        selection_mode="box",
    )
    if has_ribbons(recording):
        st.caption("Vehicle: driven by hand (in the vehicle's colour) and missing data (red).")
    if segment:
        show_key([(f"Regime: {name}", colour) for name, colour in regime_key(regimes)])


def _dragged(workspace: Workspace, recording: Recording) -> Callable[[], None]:
    def moved() -> None:
        window = window_of(st.session_state[CHART], recording)
        if window:
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
