"""The page Snapshots: saving and importing, the list, and one result in full."""

from functools import lru_cache, partial

import streamlit as st

from accpinn.errors import SnapshotError
from accpinn.methods.estimate import Outcome
from accpinn.recordings import Recording
from accpinn.results.messages.summary import unfinished
from accpinn.results.report import render_report
from accpinn.results.reproduction import verification_table
from accpinn.study.result import Result
from accpinn.study.snapshot import LARGEST, LONGEST_NAME, LONGEST_NOTE, SUFFIX
from accpinn.study.store import Entry
from accpinn.study.verification import HOWEVER_LONG, PROMPT, Verification, refit_seconds, verify
from accpinn.units import Seconds
from pages.ui.components import frame, show
from pages.ui.components.result import banner, show_result
from pages.ui.components.show import escape_markdown
from pages.ui.session.resources import library, opened
from pages.ui.session.sessions import (
    SNAPSHOT,
    may_delete,
    own_snapshots,
    owner_mark,
    readable_snapshots,
)
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import choose_entry, show_both, show_entries, title_of

_verify = lru_cache(maxsize=16)(verify)
UNDO = "snapshots_undo"
"""The entry in Streamlit's session state with the snapshot that was deleted last."""
LONGEST: Seconds = 300.0
"""Methods that are expected to take longer are not run again while the page waits."""
CONTAINS = (
    "The file contains the recorded speeds and gaps of its windows. To share less, send the"
    " parameter card (Train, Export) or a report without curves."
)
NO_CURVES = "snapshots_no_curves"
"""The entry in Streamlit's session state that tells whether a report has curves."""


def show_page(workspace: Workspace) -> None:
    _undo_button()
    if workspace.viewed:
        try:
            show_one(workspace, opened(workspace.viewed))
        except SnapshotError as fault:  # deleted or damaged since the list was read
            show.messages(str(fault), "error")
            back_button(workspace)
        return
    st.caption("Results as files: keep them, send them, open them again, compare them.")
    banner(workspace)
    left, right = st.columns((2, 1), gap="large")
    with left:
        _save_form(workspace)
    with right:
        _upload_form(workspace)
    st.subheader("Kept here", anchor=False)
    entries = own_snapshots(workspace.id)
    if not entries:
        st.caption("You have kept no snapshot here yet.")
        return
    show_entries(
        workspace, entries, "snapshots", lambda entry: _view(workspace, entry.id),
        lambda entry: _delete_button(workspace, entry),
        help="Shows the result, with its link, report and verification.",
    )  # fmt: skip


def _view(workspace: Workspace, name: str) -> None:
    """Show a snapshot, or the list; what was said of another one goes."""
    workspace.viewed = name
    show.forget_flash()


def _save_form(workspace: Workspace) -> None:
    result = workspace.result
    st.subheader("Save the current result", anchor=False)
    if result is None or result.estimate.outcome is Outcome.DIVERGED:
        st.caption("There is no result to save yet: train on a window first.")
        frame.link(frame.TRAIN, "Go to Train", workspace)
        return
    show.messages(unfinished(result.estimate), "warning", "pause_circle")
    with st.form("snapshots_form", border=False):
        name, note = st.columns((1, 1.4))
        name.text_input(
            "Name", key="snapshots_name", max_chars=LONGEST_NAME,
            placeholder=suggested_name(workspace), help="As suggested, if you leave it empty.",
        )  # fmt: skip
        note.text_input("Note", key="snapshots_note", max_chars=LONGEST_NOTE)
        with st.container(horizontal=True, vertical_alignment="center"):
            st.form_submit_button(
                "Save", type="primary", icon=":material/save:", on_click=_save, args=(workspace,)
            )
            st.caption(CONTAINS, width="stretch")


def suggested_name(workspace: Workspace) -> str:
    """Which vehicle or platoon, in which recording and window."""
    if (result := workspace.result) is None:
        return ""
    info, windows = result.info, frame.in_words(result.info.window, result.analysis.windows)
    who = info.labels[1] if info.followers == 1 else f"{info.labels[1]} to {info.labels[-1]}"
    return f"{who}, {info.source.rpartition('.')[0] or info.source}, {windows}"[:LONGEST_NAME]


def _save(workspace: Workspace) -> None:
    snapshot = workspace.as_snapshot(
        name=st.session_state["snapshots_name"].strip() or suggested_name(workspace),
        note=st.session_state["snapshots_note"].strip(),
    )
    workspace.viewed = library().add(snapshot, owner_mark(workspace.id))
    show.flash("success", f"Saved as “{snapshot.name}”.")


def _upload_form(workspace: Workspace) -> None:
    """A file from elsewhere, kept only once it is known to be whole."""

    def took(name: str, raw: bytes) -> None:
        try:
            workspace.viewed = library().add(raw, owner_mark(workspace.id))
        except SnapshotError as fault:
            raise SnapshotError(f"{name}: {fault}") from fault
        show.flash("success", f"{name} is whole and now kept as {workspace.viewed}.")

    st.subheader("Import a snapshot", anchor=False)
    most = int(LARGEST / 1e6)
    show.upload(
        f"A file that ends in .accpinn.zip, up to {most} MB; it is checked first.",
        "snapshots_upload", took, type="zip", max_upload_size=most,
    )  # fmt: skip


def _delete_button(workspace: Workspace, entry: Entry) -> None:
    if not may_delete(workspace.id, entry.id):
        return

    def delete() -> None:
        library().delete(entry.id)
        st.session_state[UNDO] = entry
        show.flash("success", f"Deleted: {title_of(entry)}. Links to it no longer work.")

    st.button(
        "Delete", icon=":material/delete:", key=f"snapshots_delete_{entry.id}", on_click=delete,
        type="tertiary", help="From the server, for everyone; it can be brought back for a day.",
    )  # fmt: skip


def _undo_button() -> None:
    entry = st.session_state.get(UNDO)
    if entry is None:
        return

    def restore() -> None:
        library().restore(entry.id)
        st.session_state[UNDO] = None
        show.flash("success", f"Brought back: {title_of(entry)}.")

    st.button(
        f"Undo: bring {show.escape_markdown(title_of(entry))} back", icon=":material/undo:",
        key="snapshots_undo_button", on_click=restore,
    )  # fmt: skip


# One snapshot in full


def show_one(workspace: Workspace, snapshot: Result) -> None:
    """The result, as whoever follows its link sees it: nothing here changes or deletes it."""
    info, title = snapshot.info, title_of(snapshot)
    is_open = workspace.recording and workspace.recording.sha256 == snapshot.analysis.source.sha256
    recording = workspace.recording if is_open else None
    st.subheader(escape_markdown(title), anchor=False)
    when = snapshot.created[:16].replace("T", " ")
    where = frame.segment_line(info, snapshot.estimate.case, snapshot.analysis.windows)
    st.caption(f"{where} · saved {escape_markdown(when)} UTC")
    if snapshot.note:
        st.text(snapshot.note)
    _show_buttons(workspace, snapshot, recording, title)
    show.not_acc(info)
    show.messages(unfinished(snapshot.estimate), "warning", "pause_circle")
    whole = snapshot.found_in(recording)
    more = {
        "Verify": lambda: _show_verification(snapshot, recording),
        "Beside another": lambda: _show_beside(workspace, whole, recording),
    }
    standing = partial(_show_standing, snapshot, recording)
    show_result(workspace, whole, "snapshots", lambda: snapshot, standing, more)


def _show_buttons(
    workspace: Workspace, snapshot: Result, recording: Recording | None, title: str
) -> None:
    stem = show.stem_of(title)[:60] or snapshot.id

    def open_it() -> None:
        workspace.restore(snapshot)
        show.flash("success", "Opened: every page now shows this snapshot.")

    with st.container(horizontal=True):
        back_button(workspace)
        if workspace.restored is None or workspace.restored.id != snapshot.id:
            st.button(
                "Open on every page", type="primary", icon=":material/folder_open:",
                key="snapshots_open", on_click=open_it,
                help="Stability, Platoon and Train then show it; your present result stays in the"
                " list of finished runs on page Train.",
            )  # fmt: skip
        with st.popover("Share", icon=":material/share:"):
            st.caption("A link to this page; it opens on any page of this server.")
            show.address(f"Snapshots?{SNAPSHOT}={snapshot.id}")
        with st.popover("Report", icon=":material/description:"):
            st.checkbox(
                "Without curves", key=NO_CURVES,
                help="The report then has neither recorded speeds and gaps nor simulated ones.",
            )  # fmt: skip
            st.download_button(
                "Download the report", lambda: _report(snapshot, recording), f"{stem}.html",
                "text/html", on_click="ignore", key="snapshots_report",
                help="One web page that needs nothing but a browser; it can be printed.",
            )  # fmt: skip
        if library().has(snapshot.id):
            st.download_button(
                "Download", lambda: library().raw(snapshot.id), f"{stem}{SUFFIX}",
                "application/zip", on_click="ignore", icon=":material/download:",
                help="The file itself: it can be sent, kept, and imported on any server. "
                + CONTAINS,
            )  # fmt: skip


def back_button(workspace: Workspace) -> None:
    st.button(
        "All snapshots", icon=":material/arrow_back:", key="snapshots_back",
        on_click=_view, args=(workspace, ""),
    )  # fmt: skip


def _again(snapshot: Result) -> str:
    """The entry in Streamlit's session state that tells whether the methods are run again."""
    return f"snapshots_again_{snapshot.id}"


def _report(snapshot: Result, recording: Recording | None) -> str:
    has_curves = not st.session_state.get(NO_CURVES)
    verification = _verified(snapshot, recording)
    return render_report(snapshot, verification, with_curves=has_curves)


def _verified(snapshot: Result, recording: Recording | None) -> Verification:
    """The methods run again, all of them where the user asked for that, and compared."""
    again = st.session_state.get(_again(snapshot))
    return _verify(snapshot, recording, refit_within=HOWEVER_LONG if again else PROMPT)


def _show_standing(snapshot: Result, recording: Recording | None) -> None:
    """Whether it agrees with what is computed now, or a button that runs its methods again."""
    again = _again(snapshot)
    if st.session_state.get(again):
        with st.spinner("Running the methods again"):
            verification = _verified(snapshot, recording)
        if verification.ok is not False:
            st.caption(escape_markdown(verification.sentence))
        else:
            show.messages(verification.sentence, "error")
        return
    seconds = sum(map(refit_seconds, (snapshot, *snapshot.compared)))
    with st.container(horizontal=True, vertical_alignment="center", width="content"):
        st.caption("Not verified yet.", width="content")
        if 0 < seconds <= LONGEST:
            st.button(
                f"Verify by running it again, about {show.format_duration(seconds)}",
                icon=":material/replay:", key="snapshots_again",
                on_click=lambda: st.session_state.update({again: True}),
                help="Runs every method of the snapshot anew on its data, with its settings.",
            )  # fmt: skip


def _show_verification(snapshot: Result, recording: Recording | None) -> None:
    """How many of the stored numbers agree with those computed now, and every part."""
    with st.spinner("Running the method again"):
        verification = _verified(snapshot, recording)
    st.markdown(f"**{escape_markdown(verification.counted)}**")
    if verification.ok is False:
        show.messages(verification.sentence, "error")
    show.table(verification_table(verification))


def _show_beside(workspace: Workspace, snapshot: Result, recording: Recording | None) -> None:
    """The same beside another of the user's snapshots."""
    others = [entry for entry in readable_snapshots(workspace.id) if entry.id != snapshot.id]
    if not others:
        st.caption("No other snapshot is kept here.")
        return
    other = choose_entry(workspace, "The second snapshot", "snapshots_second", others)
    show_both(workspace, snapshot, opened(other).found_in(recording))
