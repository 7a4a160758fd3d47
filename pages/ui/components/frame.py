"""The frame of every page: admission, title, links to pages, and the session's state."""

import logging
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

# Whole before any chart is drawn: plotly looks into one that another thread has half imported.
import pandas  # noqa: F401
import streamlit as st
from streamlit.errors import StreamlitAuthError
from streamlit.runtime.state.session_state import WStates

from accpinn.errors import AccpinnError
from accpinn.recordings import Window
from accpinn.results.glossary import GROUPS
from accpinn.segment import Segment, SegmentInfo
from accpinn.study import Analysis
from accpinn.tasks import Status, Task
from accpinn.units import Seconds
from pages.ui.components import show
from pages.ui.components.show import escape_markdown, kept, segments
from pages.ui.session.resources import queues
from pages.ui.session.sessions import (
    SESSION,
    agree,
    begin_own,
    current,
    enter,
    is_others,
    training_elsewhere,
)
from pages.ui.session.users import is_admin, is_shared, may_use, recognise, user
from pages.ui.session.workspace import Left, Workspace

HERE = Path(__file__).parent
HOME, DATA, TRAIN = "app.py", "pages/1_Data.py", "pages/2_Train.py"
STABILITY, PLATOON = "pages/3_Stability.py", "pages/4_Platoon.py"
COMPARE, DATABASE = "pages/5_Compare.py", "pages/7_Database.py"
SNAPSHOTS, REPRODUCE = "pages/6_Snapshots.py", "pages/8_Reproduce.py"

_ICONS = {
    HOME: "home",
    DATA: "timeline",
    TRAIN: "model_training",
    STABILITY: "vital_signs",
    PLATOON: "directions_car",
    COMPARE: "compare_arrows",
    DATABASE: "database",
    SNAPSHOTS: "inventory_2",
    REPRODUCE: "article",
}
"""All pages, in the order of the links to them."""

SIDEBAR = 230
"""Width of the sidebar in pixels, which leaves tables their room."""

NAMED = 3
"""Windows that are named one by one."""

CHARTED = ("Stability", "Platoon", "Database", "Reproduce")
"""Pages that have charts also where nothing is open."""

FAILED = "The program failed {}; what was open stays open."
STOPPED = "An administrator of this server ended it; what it found is kept."
PAGE = "frame_page"
"""Entry with the title of the last drawn page, so that an outcome is reported on its own page."""
TURN = "frame_turn"
"""The entry with the page that a widget's callback turns to, once the script runs."""

LOOK: Seconds = 2.0
"""Time between two looks at trainings that go on while something else is open."""
_STATUS = {
    Status.QUEUED: "waits",
    Status.RUNNING: "is under way",
    Status.DONE: "is done",
    Status.STOPPED: "was stopped",
    Status.FAILED: "failed",
}

_BACKGROUND = _STATUS | {
    Status.QUEUED: "waits for its turn",
    Status.RUNNING: "goes on{remaining}; result on Home",
    Status.DONE: "is done; its result is on Home",
}
"""The same of one that goes on in the background, as something else was opened."""
_BACKGROUND_ICONS = {Status.QUEUED: "hourglass_top", Status.RUNNING: "model_training",
               Status.DONE: "check_circle", Status.FAILED: "error"}  # fmt: skip


def draw_page(title: str, draw: Callable[[Workspace], None]) -> None:
    """Draw a page; a fault of the program becomes one sentence and a way back."""
    if st.session_state.get(PAGE) != title:
        show.forget_flash()
    st.session_state.update({PAGE: title, show.IS_FLASHED: False})
    try:
        workspace = _begin(title)
        outcome = st.empty()
        show.attempt(lambda: draw(workspace))
        with outcome:
            show.flashed()
    except Exception:
        st.html("<style>[data-testid=stException] { display: none; }</style>")
        show.messages(FAILED.format("on this page"), "error")
        link(HOME, "Back to Home", current())
        raise  # the server's log has it


def _begin(title: str) -> Workspace:
    """Set up a page; everything on it comes after this."""
    st.set_page_config(
        page_title=f"{title} · accpinn" if title else "accpinn",
        page_icon=str(HERE / "icon.svg"),
        layout="wide",
        initial_sidebar_state=SIDEBAR,
    )
    st.html(HERE / "frame.css")
    admit()
    workspace = current()
    if is_others(workspace):
        _tell_whose(workspace)
    if page := st.session_state.pop(TURN, None):
        go(page, workspace)
    _sidebar(workspace)
    if title:
        with st.container(horizontal=True, vertical_alignment="center", key="frame_head"):
            st.title(title, anchor=False)
            if workspace.info or title in CHARTED:
                _chart_menu(workspace)
    if st.session_state["lost_session"]:
        show.messages(
            "That session is no longer kept, so a new one has begun. Finished trainings"
            " are kept: open the same recording, and its result comes from the cache.",
            icon="history",
        )
    if awaited := workspace.awaited:
        show.messages(
            "The server was started anew, and it keeps no uploads: open"
            f" {awaited.source.name} again, and its window {awaited.window}, its vehicles and its"
            " result return.",
            icon="history",
        )
    show.messages(st.session_state["snapshot_fault"], "error", "link_off")
    _show_left(workspace)
    return workspace


def _show_left(workspace: Workspace) -> None:
    """The trainings that go on while something else is open, each with the way back to it."""
    for kind in workspace.ended:
        show.messages(
            f"The {kind} was ended, as something else was opened or chosen.", icon="stop_circle"
        )
    workspace.ended = ()
    elsewhere = training_elsewhere(workspace)
    tasks = [left.task for left in workspace.left]
    tasks += [other.training for other in elsewhere if other.training]
    if not tasks:
        return
    with st.container(key="frame_left", gap="xsmall"):
        for place, left in enumerate(workspace.left):

            def back(left: Left = left) -> None:
                workspace.go_back(left)
                st.session_state[TURN] = TRAIN

            _background_row(left.task, f"frame_left_{place}", back, partial(workspace.forget, left))
        for place, other in enumerate(elsewhere):

            def go_there(other: Workspace = other) -> None:
                enter(other)
                st.session_state[TURN] = TRAIN

            if other.training:
                _background_row(other.training, f"frame_elsewhere_{place}", go_there)
    before = [task.status for task in tasks]

    def look() -> None:
        if [task.status for task in tasks] != before:
            st.rerun()

    if any(task.is_active for task in tasks):
        st.fragment(look, run_every=LOOK)()


def _background_row(
    task: Task[Any], key: str, show_it: Callable[[], None], forget: Callable[[], None] | None = None
) -> None:
    """A training's progress with buttons to show, stop or dismiss it."""
    icon = _BACKGROUND_ICONS.get(task.status, "history")
    place = f" in another session {_STATUS[task.status]}{{remaining}}" if forget is None else (
        f" {_BACKGROUND[task.status]}"
    )  # fmt: skip
    about = escape_markdown(about_analysis(task.analysis))

    def tell() -> None:
        seconds = task.time_left if task.status is Status.RUNNING else None
        remaining = f", {show.format_duration(seconds)} left" if seconds else ""
        sentence = f"Training of **{about}**{place.format(remaining=remaining)}."
        st.markdown(f":material/{icon}: {sentence}", width="content")

    with st.container(horizontal=True, vertical_alignment="center"):
        st.fragment(tell, run_every=LOOK if task.is_active else None)()
        st.button("Show", key=f"{key}_show", type="tertiary", icon=":material/arrow_forward:",
                  on_click=show_it)  # fmt: skip
        if task.is_active:
            st.button("Stop", key=f"{key}_stop", type="tertiary", icon=":material/stop:",
                      on_click=task.stop, disabled=task.is_stopping)  # fmt: skip
        elif forget:
            st.button("Dismiss", key=f"{key}_forget", type="tertiary", icon=":material/close:",
                      on_click=forget)  # fmt: skip


def about_analysis(analysis: Analysis | None) -> str:
    """File and windows of a training."""
    return (
        f"{analysis.source.name}, {in_words(analysis.window, analysis.windows)}" if analysis else ""
    )


def _guarded(call: Callable[[WStates, str], None]) -> Callable[[WStates, str], None]:
    """Wrap a widget's callback so that the page reports a refusal, or a fault of the program.

    Streamlit would draw nothing of the page, and calls callbacks before any script runs.
    """

    def call_callback(states: WStates, widget: str) -> None:
        try:
            call(states, widget)
        except AccpinnError as fault:
            show.flash("error", str(fault))
        except Exception:
            logging.getLogger(__name__).exception("A widget's callback failed.")
            show.flash("error", FAILED.format("at this step"))

    return call_callback


WStates.call_callback = _guarded(WStates.call_callback)  # type: ignore[assignment,method-assign]


def _chart_menu(workspace: Workspace) -> None:
    """How the page's charts are drawn and saved."""
    with st.popover("Charts", icon=":material/more_vert:", type="tertiary"):
        picture = segments(
            "Charts are saved as", {name: name for name in show.FORMATS}, show.FORMATS[0],
            "frame_pictures", workspace, labelled=True,
            help="Point at a chart: the camera in its corner saves it as such a picture.",
        )  # fmt: skip
        has_legend = st.toggle(
            "Legend in every chart", **kept(workspace, "frame_legend", False),
            help="A saved picture then shows which colour is which vehicle.",
        )  # fmt: skip
        st.session_state[show.PICTURES] = (picture, has_legend)


def link(page: str, label: str, workspace: Workspace, icon: str = "arrow_forward") -> None:
    """A link to another page that keeps the session in the address."""
    parameters = {SESSION: workspace.id}
    st.page_link(page, label=label, icon=f":material/{icon}:", query_params=parameters)


def go(page: str, workspace: Workspace) -> None:
    """Turn to another page; nothing after this runs."""
    st.switch_page(page, query_params={SESSION: workspace.id})


def ask_which_model(
    workspace: Workspace, label: str, key: str, look: Literal["secondary", "tertiary"] = "secondary"
) -> None:
    """The way to car-following models that are judged on the same data."""
    if st.button(label, icon=":material/arrow_forward:", key=key, type=look):
        workspace.choices["compare_view"] = "models"
        go(COMPARE, workspace)


def empty_state(workspace: Workspace, nothing: str) -> None:
    """Why there is no segment to work on, and the way to one; ``nothing`` begins the sentence."""
    if workspace.recording is None:
        show.messages(f"{nothing} yet: first open a recording.")
    else:
        show.messages(f"The window cannot be used yet. {workspace.fault}", "warning")
    if st.button("Go to Data", type="primary", icon=":material/arrow_forward:", key="frame_data"):
        go(DATA, workspace)


def segment_line(segment: Segment | SegmentInfo, case: str, windows: Sequence[Window] = ()) -> str:
    """File, window or ``windows``, vehicles, Case and excluded regimes, for a caption."""
    platoon = f"{segment.labels[0]} to {segment.labels[-1]}"
    parts = [segment.source, in_words(segment.window, windows), platoon]
    parts += [f"Case {case}"] if segment.followers > 1 else []
    excluded = segment.excluded_regimes
    parts += [f"without {', '.join(excluded)}"] if excluded else []
    return " · ".join(map(escape_markdown, parts))


def in_words(window: Window, windows: Sequence[Window] = ()) -> str:
    """A window, or ``windows`` in place of it: each of a few, else from when to when."""
    if len(windows) < 2:  # a single one need not be that chosen on page Data
        return str(*(windows or (window,)))
    if len(windows) <= NAMED:
        return ", ".join(map(str, windows)).replace(" s,", ",")
    whole = Window(windows[0].start, max(other.end for other in windows))
    return f"{len(windows)} windows in {whole}"


def session_state(workspace: Workspace) -> list[str]:
    """Open recording, window and training, a line each."""
    restored, recording = workspace.restored, workspace.recording
    source = recording.source if recording else restored.info.source if restored else ""
    if not source:
        return ["No recording is open yet."]
    lines = [f"**Recording** {escape_markdown(source)}"]
    if restored and restored.id:
        lines.insert(0, f"**Snapshot** {escape_markdown(restored.name[:60] or restored.id)}")
    if info := workspace.info:
        case = f", Case {workspace.selection.case}" if info.followers > 1 else ""
        vehicles = f"vehicles {info.vehicles[0]}–{info.vehicles[-1]}"
        windows = workspace.several_windows
        if restored and not recording:
            windows = restored.analysis.windows
        window = in_words(info.window, windows)
        lines.append(f"**Window** {window}, {vehicles}{case}")
        if excluded := ", ".join(info.excluded_regimes):
            lines.append(f"**Without** {escape_markdown(excluded)}")
    else:
        lines.append("**Window** cannot be used yet")
    training = workspace.training
    return lines + ([f"**Training** {_STATUS[training.status]}"] if training else [])


@st.dialog("Glossary", width="large")
def _show_glossary() -> None:
    for subject, terms in GROUPS.items():
        st.markdown(f"**{subject}**")
        lines = (
            f"- **{escape_markdown(term.word)}**"
            + (f" [{escape_markdown(term.unit)}]" if term.unit else "")
            + f" {escape_markdown(term.meaning)}"
            for term in terms
        )
        st.markdown("\n".join(lines))


def _sidebar(workspace: Workspace) -> None:
    st.logo(str(HERE / "logo.svg"), size="large", icon_image=str(HERE / "icon.svg"))
    with st.sidebar:
        for page, icon in _ICONS.items():
            name = "Home" if page == HOME else Path(page).stem.partition("_")[2]
            link(page, name, workspace, icon)
        st.divider()
        st.caption("  \n".join(session_state(workspace)))
        if st.button(
            "Glossary", icon=":material/menu_book:", key="frame_glossary", type="tertiary",
            help="What the symbols and terms mean.",
        ):  # fmt: skip
            _show_glossary()
        sign_out_button()
        if is_admin():
            _show_tasks()
        if not is_shared() and not user().is_asked:
            st.caption("Recordings and results stay on this computer.")
            return
        st.caption(
            (
                "Nobody else can open this session."
                if user().is_asked
                else "Anyone with this address controls this session."
            )
            + " To show a result, send a snapshot's link instead."
        )


def _show_tasks() -> None:
    """The tasks of all users, for an administrator to stop."""
    with st.popover("Tasks of all users", icon=":material/list:", type="tertiary"):
        tasks = [task for queue in queues().values() for task in queue.active()]
        if not tasks:
            st.caption("None runs or waits.")
        for place, task in enumerate(tasks):
            line = f"{task.kind.capitalize()}, {_STATUS[task.status]}"
            if task.seconds:
                line += f" for {show.format_duration(task.seconds)}"
            with st.container(horizontal=True, vertical_alignment="center"):
                st.caption(escape_markdown(line))
                st.button(
                    "Stop", key=f"frame_stop_{place}", type="tertiary", icon=":material/stop:",
                    on_click=task.stop, args=(STOPPED,), disabled=task.is_stopping,
                )  # fmt: skip


def _tell_whose(workspace: Workspace) -> None:
    """End the page here, with a word of who else has the session, and the ways on."""
    st.title("A session of another browser", anchor=False)
    show.messages(
        "Someone else began the session that this address names. Whoever has the address sees and"
        " controls everything that is opened in it. Go on in it only if you know who sent you the"
        " address, or if it is yours from another browser.",
        "warning", "group",
    )  # fmt: skip
    with st.container(horizontal=True):
        st.button(
            "Begin a session of your own", icon=":material/add:", type="primary",
            key="frame_own_session", on_click=begin_own,
        )  # fmt: skip
        st.button(
            "Go on in this session", key="frame_agree", on_click=agree, args=(workspace,),
            type="tertiary",
        )  # fmt: skip
    st.stop()


def admit() -> None:
    """End the page here, before anything is shown, unless the user may use the server."""
    visitor = recognise()
    if not visitor.is_asked or may_use():
        return
    st.title("accpinn", anchor=False)
    if visitor.is_signed_in:
        show.messages(
            "Your account may not use this server; ask whoever runs it to name you.", "warning"
        )
        sign_out_button()
    else:
        st.caption("This server asks you to sign in.")
        if st.button("Sign in", type="primary", icon=":material/login:", key="sign_in"):
            try:
                st.login()
            except StreamlitAuthError as fault:
                show.messages(f"Signing in is not set up on this server: {fault}", "error")
    st.stop()


def sign_out_button() -> None:
    """Signs out; drawn only where one is signed in."""
    if user().is_signed_in:
        st.button(
            "Sign out", icon=":material/logout:", key="sign_out", type="tertiary",
            on_click=st.logout, help=f"You are signed in as {user().name or 'someone unnamed'}.",
        )  # fmt: skip
