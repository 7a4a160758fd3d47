"""A window that nothing is learned from, and how well the learned parameters do on it."""

import streamlit as st

from accpinn.errors import SegmentError
from accpinn.evaluation.validation import validate
from accpinn.recordings.files import read
from accpinn.recordings.recording import Recording, Window
from accpinn.results.figures.style import vehicle_colours
from accpinn.results.messages import messages
from accpinn.results.tables.estimates import validation_table
from accpinn.segment.cut import DURATION, chains, complete_windows, cut, disjoint_windows
from pages.ui.components import show
from pages.ui.components.widgets import select
from pages.ui.session.workspace import Workspace


def choose_validation(workspace: Workspace, recording: Recording) -> None:
    """The recording, vehicles and window to validate on, and the result where there is a fit."""
    st.caption(
        "The learned parameters are simulated behind the leader of this window, from which nothing"
        " is learned. Page Train shows the errors beside those of the training window."
    )
    known = {recording.sha256: recording} | {key: one for key, (one, _) in workspace.opened.items()}
    columns = st.columns((2, 1.6, 1, 1, 1.4), gap="small", vertical_alignment="bottom")
    choice = workspace.data_choice
    if choice.validation not in known:
        choice.validation = recording.sha256
    names = {key: one.source for key, one in known.items()}
    names[recording.sha256] = "This recording"
    select(
        "Validation recording", names, choice.validation, "data_validation_recording",
        lambda key: choice.set(validation=key), place=columns[0],
        help="This one, or another that was opened in this session.",
    )  # fmt: skip
    chosen = known[choice.validation]
    followers = len(workspace.vehicles) - 1
    platoons = {
        chain[k]: chain[k : k + followers + 1]
        for chain in chains(chosen)
        for k in range(len(chain) - followers)
    }
    if not platoons:
        st.caption(f"{names[choice.validation]} has no platoon with {followers} followers.")
        return
    same = workspace.vehicles[0]
    leader = columns[1].selectbox(
        "Leader there", list(platoons), index=list(platoons).index(same) if same in platoons else 0,
        format_func=chosen.label, key=f"data_validation_leader_{chosen.sha256[:12]}",
        help="As many followers behind it are simulated as parameters are learned.",
    )  # fmt: skip
    vehicles = platoons[leader]
    first = _first_window(workspace, chosen, vehicles)
    key = f"{chosen.sha256[:12]}_{vehicles[0]}_{workspace.window}"
    start = columns[2].number_input(
        "Starts at [s]", 0.0, chosen.duration, first.start, 10.0, format="%.1f",
        key=f"data_validation_start_{key}", help="In that recording's time.",
    )  # fmt: skip
    length = columns[3].number_input(
        "Lasts [s]", 10.0, max(10.0, chosen.duration), max(10.0, first.duration), 10.0,
        format="%.1f", key=f"data_validation_length_{key}",
        help="Longer windows average over more driving.",
    )  # fmt: skip
    if columns[4].button(
        f"Validate on {Window(start, start + length)}", key="data_validate", width="stretch",
        help="Simulates the learned parameters on this window, now or once there are some.",
    ):  # fmt: skip
        try:
            workspace.validation = cut(chosen, start, length, vehicles)
        except SegmentError as fault:
            show.messages(str(fault), "error")
    _upload(workspace)
    show_validation(workspace)


def _first_window(workspace: Workspace, recording: Recording, vehicles: tuple[int, ...]) -> Window:
    """The first complete window beside the one learned from, else the longest complete one."""
    own, length = workspace.window, min(workspace.window.duration, recording.duration)
    is_other = recording is not workspace.recording
    if length >= 10.0:
        for window in disjoint_windows(recording, length, vehicles):
            if is_other or window.start >= own.end or window.end <= own.start:
                return window
    rest = [
        part
        for one in complete_windows(recording, vehicles)
        for part in (
            (one,)
            if is_other
            else (Window(one.start, min(one.end, own.start)),
                  Window(max(one.start, own.end), one.end))
        )
    ]  # fmt: skip
    best = max(rest, key=lambda window: window.duration, default=None)
    return best if best and best.duration >= 10.0 else Window(0.0, min(DURATION, length))


def _upload(workspace: Workspace) -> None:
    """Another recording to validate on, beside the one that is open."""

    def uploaded() -> None:
        upload = st.session_state["data_validation_upload"]
        if upload is not None:
            with show.flashing():
                one = read(upload.getvalue(), upload.name)
                if one.sha256 not in workspace.opened:
                    workspace.remember(one)
                workspace.data_choice.validation = one.sha256

    st.file_uploader(
        "Or drop a second recording here; the first one stays open.", key="data_validation_upload",
        on_change=uploaded, help="It joins the list of validation recordings above.",
    )  # fmt: skip
    show.flashed()


def show_validation(workspace: Workspace) -> None:
    """The closed-loop errors on both windows; nothing where no validation was chosen."""
    other, segment, result = workspace.validation, workspace.segment, workspace.result
    if other is None:
        return
    if segment is None or result is None:
        st.caption(
            f"Chosen for validation: {show.escape_markdown(other.source)}, {other.window}. There"
            " are no learned parameters yet."
        )
        return
    found = show.attempt(lambda: validate(result.fit, segment, other))
    if found is None:
        return
    table = validation_table(segment.info, other.info, found)
    show.table(table, vehicle_colours(segment.vehicles)[1:])
    said = (*messages(found.findings, segment), *messages(found.events, other))
    show.messages(said, "warning")
    show.downloads(table, f"{segment.source}_validation", "validation")
