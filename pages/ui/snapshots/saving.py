"""Saving the current result as a snapshot, and importing a snapshot's file."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import streamlit as st

from accpinn.errors import SnapshotError
from accpinn.methods.fit import Outcome
from accpinn.results.messages.methods import unfinished
from accpinn.results.snapshot import LARGEST, LONGEST_NAME, LONGEST_NOTE, create
from accpinn.units import Seconds
from pages.ui.components import frame
from pages.ui.components.messages import show_messages
from pages.ui.session.resources import library
from pages.ui.session.workspace import Workspace

FLASH = "snapshots_flash"
"""The entry in Streamlit's session state with the outcome of a click: kind, sentence, and when."""
FLASH_FOR: Seconds = 20.0


def flash(kind: Literal["success", "error"], sentence: str) -> None:
    """Show a sentence on this page for a while."""
    st.session_state[FLASH] = (kind, sentence, time.monotonic())


@contextmanager
def flashing(about: str = "") -> Iterator[None]:
    """Show why a snapshot cannot be stored or opened, and end the block; ``about`` names it."""
    try:
        yield
    except SnapshotError as fault:
        flash("error", f"{about}{fault}")


def show_flash() -> None:
    """The outcome of the last click; a second run right after the first must not swallow it."""
    if FLASH in st.session_state:
        kind, sentence, since = st.session_state[FLASH]
        if time.monotonic() - since <= FLASH_FOR:
            show_messages(sentence, kind)


def save_form(workspace: Workspace) -> None:
    """Name, note and the question about the data, for the current result."""
    fit, segment = workspace.fit, workspace.segment
    st.subheader("Save the current result", anchor=False)
    if fit is None or fit.outcome is Outcome.DIVERGED:
        st.caption("There is no result to save yet: train on a window first.")
        frame.link(frame.TRAIN, "Go to Train", workspace)
        return
    if segment is None:
        st.caption("The result shown is a snapshot already, and its data are not open.")
        return
    show_messages(unfinished(fit), "warning", "pause_circle")
    with st.form("snapshots_form", border=False):
        st.text_input("Name", key="snapshots_name", max_chars=LONGEST_NAME)
        st.text_area("Note", key="snapshots_note", max_chars=LONGEST_NOTE, height=80)
        st.checkbox(
            "Include the data slice (speeds and gaps of the window)",
            key="snapshots_with_data",
        )
        st.caption(
            "With it, whoever opens the file sees the data and can train on. OpenACC data may be"
            " passed on under CC BY 4.0; the file names its authors. Your own data: your choice."
        )
        st.form_submit_button(
            "Save", type="primary", icon=":material/save:", on_click=save, args=(workspace,)
        )


def save(workspace: Workspace) -> None:
    """Keep the current result with all that the session knows of it."""
    fit, segment, old = workspace.fit, workspace.segment, workspace.snapshot
    if fit is None or segment is None:
        return
    with flashing():
        snapshot = create(
            segment,
            fit,
            recording=workspace.recording,
            facts=old.facts if old else None,
            uncertainty=workspace.uncertainty(),
            evaluation=old.evaluation if old and old.fit is fit else None,
            methods=workspace.compared,
            name=st.session_state["snapshots_name"].strip(),
            note=st.session_state["snapshots_note"].strip(),
            with_data=st.session_state["snapshots_with_data"],
        )
        kept = library().add(snapshot)
        st.session_state["snapshots_chosen"] = kept
        name = f"“{snapshot.name}”" if snapshot.name else f"snapshot {kept}"
        flash("success", f"Saved as {name}.")


def upload_form() -> None:
    """A file from elsewhere, kept only once it is known to be whole."""

    def uploaded() -> None:
        upload = st.session_state["snapshots_upload"]
        if upload is None:
            return
        with flashing(f"{upload.name}: "):
            kept = library().add(upload.getvalue())
            st.session_state["snapshots_chosen"] = kept
            flash("success", f"{upload.name} is whole and now in the list as {kept}.")

    st.subheader("Import a snapshot", anchor=False)
    st.file_uploader(
        f"A file that ends in .accpinn.zip, up to {LARGEST / 1e6:.0f} MB; it is checked first.",
        type="zip",
        key="snapshots_upload",
        on_change=uploaded,
        max_upload_size=int(LARGEST / 1e6),
    )
