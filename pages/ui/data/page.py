"""The page Data: the recording, the segment cut from it, its regimes, and a preview."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import takewhile
from math import ceil

import streamlit as st

from accpinn.errors import ConfigError, SegmentError
from accpinn.methods import least_squares
from accpinn.methods.fit import headway_findings
from accpinn.model.cthp import Case
from accpinn.recordings.recording import Recording, Window
from accpinn.results.figures import recording as figures
from accpinn.results.figures.style import vehicle_colour
from accpinn.results.messages import messages
from accpinn.results.messages.data import drivers
from accpinn.results.tables.estimates import quality_table, regimes_table, sensitivity_table
from accpinn.segment.cut import MAX_FOLLOWERS, MINIMUM_DURATION, chains
from accpinn.segment.quality import EXCLUDABLE, LARGE_CONDITION, assess_quality, label_regimes
from accpinn.segment.segment import DrivenByHand, Segment
from accpinn.study.sensitivity import SensitivityResult, sensitivity
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import bound, segments, select
from pages.ui.data.sources import choose_source, is_asked
from pages.ui.result.saved import banner, show_data
from pages.ui.session.workspace import Workspace
from pages.ui.train.options import chosen_config

CASES = {
    "I": "Case I: one set of α, β, τ for the whole platoon, as if all followers were the same car.",
    "II": "Case II: each follower has its own α, β, τ, as different cars do.",
}
CHART = "data_overview"
SHOWN = 3
"""Warnings that are shown without being asked for."""
REGIMES = {
    "catching up": "The time gap, space-gap over speed, is above 2 s: the vehicle catches up or"
    " drives freely.",
    "manual": "A driver controls the vehicle, according to the file.",
    "standstill": "The vehicle moves at 1 m/s or less.",
}


def show_page() -> None:
    """Draw the page."""
    workspace = frame.begin("Data", "Open a recording, choose who follows whom, and when.")
    recording = workspace.recording
    if recording is None:
        if workspace.snapshot:
            show_data(workspace, workspace.snapshot)
        with st.container(border=True):
            choose_source(workspace)
        _show_preview(workspace)
        return
    banner(workspace)
    with st.expander(
        f"Open another recording instead of {escape_markdown(recording.source)}",
        icon=":material/folder_open:",
        expanded=is_asked(),
    ):
        choose_source(workspace)
    st.markdown(_describe(recording))
    _show_warnings(messages(recording.findings, recording), "this recording")
    controls, chart = st.columns((1, 2.6), gap="medium")
    with controls:
        _choose_vehicles(workspace, recording)
        _choose_window(workspace, recording)
        st.caption("Or drag over the chart to set the window.")
        _train_button(workspace)
    with chart:
        _show_overview(workspace, recording)
    _show_preview(workspace)
    _show_regimes(workspace, recording)


def _train_button(workspace: Workspace) -> None:
    """The way to the result; it says which training this begins, and how long that takes."""
    segment, parts, request = workspace.segment, [f"{workspace.preset} preset"], None
    if workspace.settings.get(workspace.preset):
        parts[0] += " with your options"
    if segment and segment.followers > 1:
        parts.append(f"Case {workspace.case}")
    with suppress(ConfigError):  # the Train page shows what is wrong with a setting
        request = workspace.request(chosen_config(workspace))
    if request:
        parts.append(f"about {show.format_duration(request.typical_seconds)}")
    if st.button(
        f"Train on this window ({', '.join(parts)})", type="primary", icon=":material/play_arrow:",
        width="stretch", disabled=segment is None, key="data_train",
    ):  # fmt: skip
        if request:
            workspace.train(request.config)
        frame.go(frame.TRAIN, workspace)


def _describe(recording: Recording) -> str:
    """The recording's metadata in one line."""
    rate, setting = 1 / recording.sample_time, recording.distance_setting
    parts = [
        f"**{escape_markdown(recording.source)}**",
        escape_markdown(recording.campaign or ""),
        f"{recording.date.day} {recording.date:%B %Y}" if recording.date else "",
        f"{len(recording.present)} vehicles",
        f"{recording.duration:,.0f} s at {rate:.3g} Hz",
        escape_markdown(drivers(recording)),
        f"distance setting {escape_markdown(setting)}" if setting else "",
    ]
    return " · ".join(part for part in parts if part)


def _show_warnings(warnings: Sequence[str], about: str) -> None:
    """The first few openly, the rest on demand."""
    show.messages(warnings[:SHOWN], "warning")
    if warnings[SHOWN:]:
        with st.expander(f"{len(warnings) - SHOWN} more about {about}"):
            st.markdown(show.bullets(warnings[SHOWN:]))


def _choose_vehicles(workspace: Workspace, recording: Recording) -> None:
    """Leader and last follower, from the chains the recording has; and the Case."""
    possible = {
        leader: chain[position : position + MAX_FOLLOWERS + 1]
        for chain in chains(recording)
        for position, leader in enumerate(chain[:-1])
    }
    first, *_, end = workspace.vehicles
    # Another recording gets widgets of its own: the same ones would show the former names.
    leader_key, last_key = (f"data_{place}_{recording.sha256[:12]}" for place in ("leader", "last"))

    def choose(leader: int, last: int) -> None:
        workspace.choose(tuple(takewhile(lambda vehicle: vehicle <= last, possible[leader])))

    leaders = {number: recording.label(number) for number in possible}
    select(
        "Leader", leaders, first, leader_key, lambda leader: choose(leader, max(end, leader + 1))
    )
    followers = {number: recording.label(number) for number in possible[first][1:]}
    select("Last follower", followers, end, last_key, lambda last: choose(first, last))
    if len(workspace.vehicles) > 2:
        segments(
            "Case", {case: f"Case {case}" for case in CASES}, workspace.case, "data_case",
            lambda case: workspace.choose(case=case),
        )  # fmt: skip
        st.caption(CASES[workspace.case])


def _choose_window(workspace: Workspace, recording: Recording) -> None:
    """Start and length in seconds."""
    start, length = float(workspace.window.start), float(workspace.window.duration)
    longest = float(ceil(recording.duration))

    def moved(_: float) -> None:
        start, length = st.session_state["data_start"], st.session_state["data_length"]
        if start is not None and length is not None:
            workspace.choose(window=Window(start, start + length))

    fields = (
        ("Window starts at [s]", "data_start", start, recording.duration),
        ("and lasts [s]", "data_length", length, longest),
    )
    for column, (label, key, value, most) in zip(st.columns(2), fields, strict=True):
        column.number_input(
            label, **bound(key, value, moved), min_value=0.0, max_value=max(most, value),
            step=10.0, format="%.1f",
        )  # fmt: skip


def _show_overview(workspace: Workspace, recording: Recording) -> None:
    """Speeds and gaps over the whole recording; dragging over them sets the window."""
    leader = workspace.vehicles[0]
    entries, faint = [], set()
    for vehicle in recording.present:
        role = " (leader)" if vehicle == leader else ""
        entries.append((recording.label(vehicle) + role, vehicle_colour(vehicle, leader)))
        if vehicle not in workspace.vehicles:
            faint.add(recording.label(vehicle))
    show.key(entries, faint)
    segment = _whole_segment(workspace)
    regimes = label_regimes(segment, recording) if segment else None
    ribbons = figures.regime_ribbons(segment, regimes) if segment and regimes else []

    def dragged() -> None:
        if window := window_of(st.session_state[CHART], recording):
            workspace.choose(window=window)

    show.chart(
        figures.overview(recording, workspace.vehicles, workspace.window, ribbons),
        CHART, on_select=dragged, selection_mode="box",
    )  # fmt: skip
    if figures.has_ribbons(recording):
        st.caption("Vehicle: driven by hand (in the vehicle's colour) and missing data (red).")
    if regimes:
        show.key((f"Regime: {name}", colour) for name, colour in figures.regime_key(regimes))


def _whole_segment(workspace: Workspace) -> Segment | None:
    """The chosen segment with all its instants; None where the window cannot be used."""
    with suppress(SegmentError):
        return workspace.whole_segment()
    return None


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


def _show_preview(workspace: Workspace) -> None:
    """The window's figures, and the estimate that needs no training."""
    segment = workspace.segment
    if segment is None:
        show.messages(workspace.fault, "error")
        return
    quality = assess_quality(segment)
    estimate = least_squares.fit(segment, workspace.case)
    st.subheader("Preview of the window", anchor=False)
    show.not_acc(segment)
    show.table(quality_table(segment.info, quality, estimate), show.vehicle_colours(segment)[1:])
    excluded = (
        f" Without {', '.join(segment.excluded_regimes)}: the estimate and the condition number;"
        " all other figures are of all instants."
    )
    st.caption(
        "Least squares solves the model for α, β and τ in one step, from differences of the"
        " measured speeds. Noise in the data biases it: take it as a first look. The leader's"
        f" speed varies by {quality.leader_deviation:.2f} m/s (standard deviation). Condition"
        f" number: above about {LARGE_CONDITION:.0f}, gap, speed and relative speed move so alike"
        " that α, β and τ are not identifiable." + excluded * bool(segment.excluded_regimes)
    )
    headways = headway_findings(segment.vehicles, estimate.parameters)
    findings = (*headways, *quality.findings, *estimate.findings)
    _show_warnings(messages(findings, segment), "this window")
    changes = [one for one in segment.findings if not isinstance(one, DrivenByHand)]
    if changes:
        with st.expander("Changes to the data", icon=":material/build:"):
            st.markdown(show.bullets(messages(changes, segment)))


def _show_regimes(workspace: Workspace, recording: Recording) -> None:
    """Shares, the user's choice, and on request the sensitivity of the estimates to it."""
    segment = _whole_segment(workspace)
    if segment is None:
        return
    regimes, excluded = label_regimes(segment, recording), workspace.excluded_regimes
    # Its state is the server's, as what stands above it comes and goes.
    with st.expander("Regimes", icon=":material/category:", key="data_regimes", on_change="rerun"):
        show.table(regimes_table(segment.info, regimes))
        if not any(regimes.mode_known):
            st.caption("The file has no driver modes, so no instant counts as manual.")
        st.markdown("**Leave out of the model's equations**")
        with st.container(horizontal=True):
            for name in EXCLUDABLE:

                def ticked(on: bool, name: str = name) -> None:
                    left_out = {*workspace.excluded_regimes} - {name} | ({name} if on else set())
                    workspace.choose(excluded_regimes=tuple(n for n in EXCLUDABLE if n in left_out))

                shown = bound(f"data_exclude_{name}", name in excluded, ticked)
                st.checkbox(name.capitalize(), **shown, help=REGIMES[name])
        st.caption(
            "The model describes car-following. Nothing is left out unless you tick it; every"
            " method then works without it, and every page names it. The data stay: only the"
            " equation of the follower's acceleration does not count there. Leaving out by the"
            " time gap biases as well, since the model is to explain that gap: compare before you"
            " decide."
        )
        if st.toggle("Show the sensitivity of the estimates", key="data_sensitivity"):
            _show_sensitivity(workspace, segment, recording)


def _show_sensitivity(workspace: Workspace, segment: Segment, recording: Recording) -> None:
    request = f"{segment.info.digest} {recording.sha256} {workspace.case}"
    found = _sensitivity(request, segment, recording, workspace.case)
    if not any(any(row.share) for row in found):
        st.caption("None of these occurs in this window, so there is nothing to compare.")
        return
    for follower in range(segment.followers):
        show.table(sensitivity_table(segment.info, found, follower))
    show.messages(tuple(dict.fromkeys(str(row.fault) for row in found if row.fault)))


@st.cache_data(max_entries=32, show_spinner="Estimating with and without them …")
def _sensitivity(
    request: str, _segment: Segment, _recording: Recording, _case: Case
) -> tuple[SensitivityResult, ...]:
    """Kept by ``request``, which names the data and the case."""
    return sensitivity(_segment, _recording, _case)
