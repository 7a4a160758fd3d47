"""The page Data: the recording over time, the choice of window and vehicles, and their quality.

The parts below the timeline are in `pages.ui.data.views`.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import takewhile
from math import ceil
from pathlib import Path
from typing import Any

import streamlit as st

from accpinn.errors import ConfigError
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.recordings import Recording, Window
from accpinn.results import recording as words
from accpinn.results.figures import recording as figures
from accpinn.results.figures.style import vehicle_colour
from accpinn.results.messages import messages
from accpinn.results.recording import RatedWindow
from accpinn.segment import Segment
from accpinn.segment.cut import MAX_FOLLOWERS, MINIMUM_DURATION, chains
from accpinn.segment.quality import Grade, Rating, Regimes
from accpinn.segment.windows import Information, suggest_window
from pages.ui.components import frame, show
from pages.ui.components.result import banner, show_data
from pages.ui.components.show import bound, escape_markdown, segments, select, tabs
from pages.ui.data import views
from pages.ui.data.mapping import show_cures
from pages.ui.data.sources import OPENING, ask, choose_source, read_anew
from pages.ui.data.views import choose_validation
from pages.ui.reproduction import table_buttons
from pages.ui.session.pending import Pending
from pages.ui.session.resources import (
    rated,
    rated_windows,
    whole_drive,
    windows_in_car_following,
)
from pages.ui.session.workspace import TITLE_OF, Workspace

CASES: Mapping[Case, str] = {
    "I": "Case I: one set of α, β, τ for the whole platoon, as if all followers were the same car.",
    "II": "Case II: each follower has its own α, β, τ, as different cars do.",
}
VIEWS: Mapping[figures.View, str] = {
    "motion": "Speed and gap",
    "relative": "Δv",
    "time gap": "Time gap",
}
CHART = "data_overview"
CROWD = 4
"""Largest number of followers of which none can be highlighted."""
MARKS = {
    Grade.GOOD: ("blue", "check_circle"),
    Grade.FAIR: ("orange", "warning"),
    Grade.POOR: ("red", "cancel"),
    Grade.UNKNOWN: ("gray", "help"),
}
"""Colour and icon of a grade: the icons differ in shape."""
TOOLS = ("zoom2d", "pan2d", "select2d", "zoomIn2d", "zoomOut2d", "resetScale2d")
TOOLS_OF_SEVERAL = tuple(tool for tool in TOOLS if tool != "select2d")
_STYLE = f"""<style>
.st-key-data_handles {{ padding: 0 {figures.MARGIN_RIGHT}px 0 {figures.MARGIN}px;
  margin: -0.3rem 0 -1.5rem; }}
</style>"""


def show_page(workspace: Workspace) -> None:
    st.html(_STYLE)
    recording = workspace.recording
    if workspace.pending:
        if recording:
            show.caption(f"{recording.source} stays open until another recording is.")
        ask(workspace, workspace.pending)
        return
    if recording is None:
        st.caption("Open a recording, then choose who follows whom, and when.")
        if workspace.restored:
            show_data(workspace)
        with st.container(border=True):
            choose_source(workspace)
        if workspace.segment:
            views.show_window(workspace, workspace.segment)
        return
    is_mapped = workspace.table_of_recording is not None
    widths = (3, *((1,) if is_mapped else ()), 1 if is_mapped else 0.75)
    named, *changing, other = st.columns(widths, vertical_alignment="center")
    named.caption(_describe(recording))
    for place in changing:
        with place:
            _change_columns_button(workspace, recording)
    with other:
        popover = st.popover(
            "Open another recording", icon=":material/folder_open:", width="stretch", key=OPENING,
            on_change="rerun",
        )  # fmt: skip
    if popover.open:
        with popover:
            choose_source(workspace)
    banner(workspace)
    whole, regimes, information = whole_drive(recording, workspace.selection.vehicles)
    every = windows_in_car_following(recording, workspace.selection.vehicles)
    rows: tuple[RatedWindow, ...] = ()
    if used := workspace.several_windows:
        selection = workspace.selection
        rows = rated_windows(recording, every, used, selection.vehicles, selection.excluded)
    with st.container(key="later_1_data"):
        _controls(workspace, recording, information, len(every))
    _show_overview(workspace, recording, whole, regimes, rows)
    if rows:
        _show_windows(workspace, recording, rows)
    else:
        _assessment(workspace, recording)
    _train_button(workspace, rows)
    drawn = {
        "Window": lambda: views.show_window(workspace, workspace.segment),
        "Regimes": lambda: views.show_regimes(workspace, recording),
        "Validation": lambda: choose_validation(workspace, recording),
        "Changes to the data": lambda: views.show_changes(workspace),
        "About the recording": lambda: views.show_about(recording),
    }
    if rows:
        del drawn["Window"]
    tabs(workspace, "data_tabs", drawn)


def _describe(recording: Recording) -> str:
    rate, setting = 1 / recording.sample_time, recording.distance_setting
    parts = [
        f"**{escape_markdown(recording.source)}**",
        escape_markdown(recording.campaign or ""),
        f"{recording.date.day} {recording.date:%B %Y}" if recording.date else "",
        f"{len(recording.present)} vehicles",
        f"{recording.duration:,.0f} s at {rate:.3g} Hz",
        escape_markdown(words.driver_summary(recording)),
        f"distance setting {escape_markdown(setting)}" if setting else "",
    ]
    return " · ".join(part for part in parts if part)


def _change_columns_button(workspace: Workspace, recording: Recording) -> None:
    """The way back to the columns of a table that was opened by a mapping."""
    file = workspace.table_of_recording
    if file and recording.mapping:
        pending = Pending(file, recording.mapping)

        def change() -> None:
            workspace.pending = pending

        st.button(
            "Columns and units", icon=":material/tune:", key="data_columns", on_click=change,
            width="stretch", help="How the columns of this table were read; to change it.",
        )  # fmt: skip


# What is chosen


def _controls(
    workspace: Workspace, recording: Recording, information: Information, count: int
) -> None:
    """Vehicles and Case, all of the ``count`` windows or one, and that one window."""
    has_cases, is_one = len(workspace.selection.vehicles) > 2, not workspace.several_windows
    has_choice = count > 0
    widths = [1.3, 1.3]
    widths += [1.1] if has_cases else []
    widths += [1.6] if has_choice else []
    field_widths = [1.12, 0.95, 1.4]
    if is_one and not has_choice:
        widths += field_widths
    columns = st.columns(
        [*widths, max(0.01, 7.2 - sum(widths))], gap="small", vertical_alignment="bottom"
    )[:-1]
    _choose_vehicles(workspace, recording, columns[:2])
    if has_cases:
        with columns[2]:
            segments(
                "Case", {"I": "I: shared", "II": "II: own"}, workspace.selection.case, "data_case",
                lambda case: workspace.choose(case=case), labelled=True,
                help="  \n".join(CASES.values()),
            )  # fmt: skip
    if has_choice:
        with columns[2 + has_cases]:
            _choose_which(workspace, count)
    if not is_one:
        return
    fields = columns[-3:]
    if has_choice:
        row = [*field_widths, 7.2 - sum(field_widths)]
        fields = st.columns(row, gap="small", vertical_alignment="bottom")[:-1]
    _choose_window(workspace, recording, fields[:2])
    with fields[2]:
        _suggest(workspace, recording, information)


def _choose_which(workspace: Workspace, count: int) -> None:
    """Whether the training takes all windows in car-following, or one that is chosen."""

    def change(which: str) -> None:
        workspace.window_starts = None if which == "all" else ()

    segments(
        "Train on", {"all": f"{count} windows", "one": "One window"},
        "all" if workspace.several_windows else "one", "data_which", change, labelled=True,
        help="All windows in which every follower is in car-following, or one of your own."
        " Intervals narrow with every window of the same vehicles, more than by any refinement in"
        " one. Short stretches of catching up stay in a window.",
    )  # fmt: skip


def _choose_vehicles(workspace: Workspace, recording: Recording, columns: list[Any]) -> None:
    """Leader and last follower, from the chains the recording has."""
    possible = {
        leader: chain[position : position + MAX_FOLLOWERS + 1]
        for chain in chains(recording)
        for position, leader in enumerate(chain[:-1])
    }
    first, *_, end = workspace.selection.vehicles
    # Another recording gets widgets of its own: the same ones would show the former names.
    leader_key, last_key = (f"data_{place}_{recording.sha256[:12]}" for place in ("leader", "last"))

    def choose(leader: int, last: int) -> None:
        workspace.choices["data_highlight"] = 0
        workspace.choose(
            vehicles=tuple(takewhile(lambda vehicle: vehicle <= last, possible[leader]))
        )

    leaders = {number: recording.label(number) for number in possible}
    select(
        "Leader", leaders, first, leader_key, lambda leader: choose(leader, max(end, leader + 1)),
        place=columns[0], help="The vehicle whose speed is given; nothing is estimated of it.",
    )  # fmt: skip
    followers = {number: recording.label(number) for number in possible[first][1:]}
    select(
        "Last follower", followers, end, last_key, lambda last: choose(first, last),
        place=columns[1], help="Every vehicle from behind the leader to this one is a follower.",
    )  # fmt: skip


def _choose_window(workspace: Workspace, recording: Recording, columns: list[Any]) -> None:
    def choose(start: float, length: float) -> None:
        workspace.choose(window=Window(start, start + length))

    # The state, not a widget, has the other number: after a change elsewhere keys are new.
    now = workspace.selection.window
    fields = (
        ("Window starts at [s]", "data_start", now.start, recording.duration,
         lambda start: choose(start, workspace.selection.window.duration),
         "In the recording's time, from its first sample."),
        ("and lasts [s]", "data_length", now.duration, float(ceil(recording.duration)),
         lambda length: choose(workspace.selection.window.start, length),
         "300 s are usual; a longer window narrows the intervals."),
    )  # fmt: skip
    for column, (label, key, value, most, moved, help_text) in zip(columns, fields, strict=True):
        column.number_input(
            label, **bound(key, float(value), moved), min_value=0.0, max_value=max(most, value),
            step=10.0, format="%.1f", help=help_text,
        )  # fmt: skip


def _suggest(workspace: Workspace, recording: Recording, information: Information) -> None:
    """The most informative window, the reasons, and the button that takes it."""
    suggestion = suggest_window(recording, workspace.selection.vehicles, information)
    if suggestion is None:
        st.button(
            "Suggest a window", icon=":material/lightbulb:", disabled=True, width="stretch",
            help="No stretch is complete with every follower in car-following.",
        )  # fmt: skip
        return
    taken = suggestion.window == workspace.selection.window
    label = "As suggested" if taken else f"Suggested: {suggestion.window}"
    with st.popover(
        label, icon=":material/lightbulb:", width="stretch",
        help="The window that tells most about α, β and τ, and why.",
    ):  # fmt: skip
        usable = workspace.segment.window if workspace.segment else None
        efficiency = information.efficiency(usable, suggestion.window) if usable else 0.0
        st.markdown(show.bullets(words.suggestion_reasons(suggestion, usable, efficiency)))
        st.button(
            "This window is chosen" if taken else f"Take {suggestion.window}",
            disabled=taken, key="data_suggested",
            on_click=lambda: workspace.choose(window=suggestion.window),
        )  # fmt: skip


# The timeline


def _show_overview(
    workspace: Workspace,
    recording: Recording,
    whole: Segment,
    regimes: Regimes,
    rows: Sequence[RatedWindow],
) -> None:
    """The whole recording over time, with several windows or one.

    Dragging over the chart, or the handles below, set the one.
    """
    (leader, *followers), highlight = workspace.selection.vehicles, 0
    with st.container(horizontal=True, vertical_alignment="center"):
        view = segments(
            "Drawn", VIEWS, "motion", "data_view", workspace,
            help="Δv: speed of the vehicle ahead minus the follower's. Time gap: space-gap over"
            " speed; dotted: its limit, above which a vehicle catches up or drives freely.",
        )  # fmt: skip
        if len(followers) > CROWD:
            options = {0: "All chosen vehicles"} | {n: recording.label(n) for n in followers}
            highlight = select(
                "Highlight", options, 0, "data_highlight", workspace, labelled=False, width=240,
                help="One follower and the vehicle ahead of it; the others are faint.",
            )  # fmt: skip
        names = {n: recording.label(n) + " (leader)" * (n == leader) for n in recording.present}
        show.key(
            [(name, vehicle_colour(n, leader)) for n, name in names.items()],
            faint=[name for n, name in names.items() if n not in (leader, *followers)],
        )
        st.button(
            "Undo", icon=":material/undo:", type="tertiary", key="data_undo",
            disabled=not workspace.undo_stack, on_click=workspace.undo,
            help="Takes back the last change of window, vehicles, Case or regimes, and shows the"
            " result of before.",
        )  # fmt: skip

    def dragged() -> None:
        for box in st.session_state[CHART]["selection"]["box"][-1:]:
            take(box["x"])

    def take(ends: Sequence[float]) -> None:
        if window := window_of(ends, recording):
            workspace.choose(window)

    drivers = figures.driver_ribbons(recording, workspace.selection.vehicles)
    driving = figures.regime_ribbons(whole, regimes)
    vehicles, window = workspace.selection.vehicles, workspace.selection.window
    ribbons = drivers, driving
    figure = figures.overview(recording, vehicles, window, ribbons, view, highlight, rows)
    if rows:
        show.chart(figure, f"{CHART}_windows", TOOLS_OF_SEVERAL)
    else:
        show.chart(figure, CHART, TOOLS, on_select=dragged, selection_mode="box")
        _handles(workspace, recording, take)
    with st.container(horizontal=True, vertical_alignment="center", gap="large"):
        if drivers:
            show.key(figures.strip_key(drivers).items(), title="Upper bars, driver:")
        bars = "Lower bars" if drivers else "Bars"
        show.key(figures.strip_key(driving).items(), title=f"{bars}, regime:")
        if view == "motion" and any(jumps.follower in followers for jumps in recording.jumps):
            show.key([("jump of the gap", figures.JUMP)], title="×:")
        if view == "time gap":
            show.key((), dotted="longest in car-following")
        with st.container(horizontal=True, vertical_alignment="center", width="content"):
            table_buttons(workspace, "data")


def _handles(
    workspace: Workspace, recording: Recording, take: Callable[[Sequence[float]], None]
) -> None:
    """The window's two ends, below the axis of time."""
    window = workspace.selection.window
    with st.container(key="data_handles"):
        st.slider(
            "Window [s]; drag an end, or drag over the chart", min_value=0.0,
            max_value=max(recording.duration, window.end), step=0.1, format="%.1f s",
            label_visibility="collapsed", **bound("data_ends", (window.start, window.end), take),
        )  # fmt: skip


def window_of(ends: Sequence[float], recording: Recording) -> Window | None:
    """The window between two instants of a recording; None for a slip of the hand."""
    # A browser sends whole numbers as integers, and no slider takes one beside another number.
    start, end = (round(float(min(max(x, 0.0), recording.duration)), 1) for x in sorted(ends))
    return Window(start, end) if end - start >= MINIMUM_DURATION else None


# What the window is worth, and the next step


def _show_windows(workspace: Workspace, recording: Recording, rows: Sequence[RatedWindow]) -> None:
    """The quality of each window in one table, and which windows are used."""
    names = {row.window.start: str(row.number) for row in rows}

    def change(starts: Sequence[float]) -> None:
        if starts:  # the last one stays
            is_whole = len(starts) == len(rows)
            workspace.window_starts = None if is_whole else tuple(sorted(starts))

    segment = workspace.segment
    with st.container(horizontal=True, vertical_alignment="center"):
        st.pills(
            "Windows in the training", list(names), selection_mode="multi",
            format_func=lambda start: names.get(start, str(start)), label_visibility="visible",
            **bound("data_windows_on", [row.window.start for row in rows if row.is_used], change,
                    default="default"),
        )  # fmt: skip
        st.space("stretch")
        table = words.windows_table(recording.source, rows)
        show.downloads(table, f"{Path(recording.source).stem}_windows", "data_windows")
    if segment:
        st.html(figures.WINDOWS_STYLE + figures.windows_html(rows, segment))
    used = [row for row in rows if row.is_used and row.ratings]
    wrong = [rating for row in used for rating in row.ratings if rating.question == "consistent"]
    if poor := [rating for rating in wrong if rating.grade is Grade.POOR]:
        _show_wrong(workspace, recording, poor[0])
    if segment:
        show.not_acc(segment)


def _assessment(workspace: Workspace, recording: Recording) -> None:
    """The checks of the chosen window."""
    segment = workspace.segment
    if segment is None:
        show.messages(workspace.fault, "error")
        return
    ratings = rated(recording, segment)
    with st.container(horizontal=True):
        for rating in ratings:
            colour, icon = MARKS[rating.grade]
            label = words.LABELS[rating.question][rating.grade]
            figure = words.quantity_of(rating)
            counted = f": {figure}" if rating.grade in (Grade.FAIR, Grade.POOR) else ""
            with st.popover(f":{colour}[:material/{icon}:] {label}{counted}"):
                st.markdown(escape_markdown(words.MEANING[rating.question]))
                column = words.QUANTITIES[rating.question]
                st.markdown(f"{escape_markdown(column.title)}: **{escape_markdown(figure)}**")
                if reasons := messages(rating.findings, segment):
                    st.markdown(show.bullets(reasons))
    wrong = next(rating for rating in ratings if rating.question == "consistent")
    if wrong.grade is Grade.POOR:
        _show_wrong(workspace, recording, wrong)
    show.not_acc(segment)


def _show_wrong(workspace: Workspace, recording: Recording, wrong: Rating) -> None:
    """Contradictions of gaps and speeds, and their cures: estimates from such gaps are wrong."""
    file = workspace.table_of_recording
    if file and recording.mapping:
        show_cures(
            recording, recording.mapping, lambda mapping: read_anew(workspace, file, mapping),
            "data",
        )  # fmt: skip
    elif workspace.segment:
        show.messages(messages(wrong.findings, workspace.segment), "warning")


def _train_button(workspace: Workspace, rows: Sequence[RatedWindow]) -> None:
    """The button that starts a training, with its windows, preset and expected time."""
    segment, parts, analysis = workspace.segment, [TITLE_OF[workspace.preset]], None
    windows = workspace.windows
    which = f"{len(windows)} windows" if len(windows) > 1 else "this window"
    if len(windows) == 1 and workspace.several_windows:
        which = str(windows[0])
    if workspace.settings.get(workspace.preset):
        parts[0] += " with your options"
    if segment and segment.followers > 1:
        parts.append(f"Case {workspace.selection.case}")
    with suppress(ConfigError):  # the Train page shows what is wrong with a setting
        analysis = workspace.analysis()
    is_usable = segment is not None and not any(row.fault for row in rows if row.is_used)
    if is_usable and analysis:
        seconds = METHODS[analysis.method].expected_seconds(workspace.segments, analysis.config)
        parts.append(f"about {show.format_duration(seconds)}")
    if st.button(
        f"Train on {which} ({', '.join(parts)})", type="primary", icon=":material/play_arrow:",
        disabled=not is_usable, key="data_train",
    ):  # fmt: skip
        if analysis:
            workspace.train()
        frame.go(frame.TRAIN, workspace)
