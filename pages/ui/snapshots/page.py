"""The page Snapshots: saving and importing, the list, and one result in full."""

import streamlit as st

from accpinn.errors import SnapshotError
from accpinn.methods.fit import Outcome
from accpinn.results.messages.summary import unfinished
from accpinn.study.snapshot import LARGEST, LONGEST_NAME, LONGEST_NOTE
from accpinn.study.store import Entry
from pages.ui.components import frame, show
from pages.ui.result.saved import banner
from pages.ui.session.identity import may_delete, owner_mark
from pages.ui.session.resources import library, opened
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import show_entries, title_of
from pages.ui.snapshots.one import back_button, show_one

UNDO = "snapshots_undo"
"""The entry in Streamlit's session state with the snapshot that was deleted last."""


def show_page() -> None:
    """Draw the page."""
    workspace = frame.begin("Snapshots")
    show.flashed()
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
    st.subheader("On this server", anchor=False)
    entries = library().entries()
    if not entries:
        st.caption("No snapshot is kept here yet.")
        return
    show_entries(
        entries, "snapshots", lambda entry: _view(workspace, entry.id),
        lambda entry: _delete_button(workspace, entry),
        help="Shows the result, with its link, report and verification.",
    )  # fmt: skip


def _view(workspace: Workspace, name: str) -> None:
    workspace.viewed = name
    show.forget_flash()


def _save_form(workspace: Workspace) -> None:
    """Name, note and the question about the data, for the current result."""
    result = workspace.result
    st.subheader("Save the current result", anchor=False)
    if result is None or result.fit.outcome is Outcome.DIVERGED:
        st.caption("There is no result to save yet: train on a window first.")
        frame.link(frame.TRAIN, "Go to Train", workspace)
        return
    if not result.segments:
        st.caption("The result shown is a snapshot already, and its data are not open.")
        return
    show.messages(unfinished(result.fit), "warning", "pause_circle")
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
            st.checkbox(
                "Include the data slice (speeds and gaps of the window)",
                value=workspace.truth is not None, key="snapshots_with_data",
                help="With it, whoever opens the file sees the data and can train on. OpenACC data"
                " may be passed on under CC BY 4.0; the file names its authors. Your own data: your"
                " choice.",
            )  # fmt: skip


def suggested_name(workspace: Workspace) -> str:
    """Which vehicle or platoon, in which recording and window."""
    info = workspace.info
    if info is None:
        return ""
    who = info.labels[1] if info.followers == 1 else f"{info.labels[1]} to {info.labels[-1]}"
    return f"{who}, {info.source.rpartition('.')[0] or info.source}, {info.window}"[:LONGEST_NAME]


def _save(workspace: Workspace) -> None:
    """Keep the current result with all that the session knows of it."""
    with show.flashing():
        snapshot = workspace.as_snapshot(
            name=st.session_state["snapshots_name"].strip() or suggested_name(workspace),
            note=st.session_state["snapshots_note"].strip(),
            with_data=st.session_state["snapshots_with_data"],
        )
        workspace.viewed = library().add(snapshot, owner_mark(workspace.id))
        show.flash("success", f"Saved as “{snapshot.name}”.")


def _upload_form(workspace: Workspace) -> None:
    """A file from elsewhere, kept only once it is known to be whole."""

    def uploaded() -> None:
        upload = st.session_state["snapshots_upload"]
        if upload is None:
            return
        with show.flashing(f"{upload.name}: "):
            workspace.viewed = library().add(upload.getvalue(), owner_mark(workspace.id))
            show.flash("success", f"{upload.name} is whole and now kept as {workspace.viewed}.")

    st.subheader("Import a snapshot", anchor=False)
    st.file_uploader(
        f"A file that ends in .accpinn.zip, up to {LARGEST / 1e6:.0f} MB; it is checked first.",
        type="zip",
        key="snapshots_upload",
        on_change=uploaded,
        max_upload_size=int(LARGEST / 1e6),
    )


def _delete_button(workspace: Workspace, entry: Entry) -> None:
    """For those who may delete it."""
    if not may_delete(workspace.id, entry.id):
        return

    def delete() -> None:
        with show.flashing():
            library().delete(entry.id)
            st.session_state[UNDO] = entry
            show.flash("success", f"Deleted: {title_of(entry)}. Links to it no longer work.")

    st.button(
        "Delete", icon=":material/delete:", key=f"snapshots_delete_{entry.id}", on_click=delete,
        type="tertiary", help="From the server, for everyone; it can be brought back for a day.",
    )  # fmt: skip


def _undo_button() -> None:
    """Brings back what this browser deleted last."""
    entry = st.session_state.get(UNDO)
    if entry is None:
        return

    def restore() -> None:
        with show.flashing():
            library().restore(entry.id)
            st.session_state[UNDO] = None
            show.flash("success", f"Brought back: {title_of(entry)}.")

    st.button(
        f"Undo: bring {show.escape_markdown(title_of(entry))} back", icon=":material/undo:",
        key="snapshots_undo_button", on_click=restore,
    )  # fmt: skip
