"""How a snapshot comes to the server's store: saved from the current result, or brought along."""

import time

import streamlit as st

from accpinn.errors import SnapshotError
from accpinn.methods.fit import Outcome, unfinished
from accpinn.results.snapshot.create import create
from accpinn.results.snapshot.schema import LARGEST, LONGEST_NAME, LONGEST_NOTE
from accpinn.units import Seconds
from pages.ui.components import frame
from pages.ui.components.text import escape_markdown
from pages.ui.session.resources import library
from pages.ui.session.workspace import Workspace

SAID = "snapshots_said"
"""The entry in Streamlit's session state with what a click came to: kind, sentence, and when."""
SAID_FOR: Seconds = 20.0


def flash(kind: str, sentence: str) -> None:
    """Show a sentence on this page for a while."""
    st.session_state[SAID] = (kind, sentence, time.monotonic())


def show_flash() -> None:
    """What the last click came to; a second run right after the first must not swallow it."""
    kind, sentence, said = st.session_state.get(SAID, ("", "", 0.0))
    if time.monotonic() - said > SAID_FOR:
        return
    if kind == "error":
        st.error(escape_markdown(sentence), icon=":material/error:")
    elif kind:
        st.success(escape_markdown(sentence), icon=":material/check_circle:")


def save_form(workspace: Workspace) -> None:
    """Name, note and the question about the data, for the current result."""
    fit, segment = workspace.fit, workspace.segment
    st.subheader("Save the current result", anchor=False)
    if fit is None or fit.outcome is Outcome.DIVERGED:
        st.caption("There is no result to save yet: train on a window first.")
        frame.link(frame.TRAIN, "Go to Train", workspace, "arrow_forward")
        return
    if segment is None:
        st.caption("The result shown is a snapshot already, and its data are not open.")
        return
    stopped = unfinished(fit)
    if stopped:
        st.warning(escape_markdown(stopped), icon=":material/pause_circle:")
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
    fit, segment, known = workspace.fit, workspace.segment, workspace.uncertainty
    if fit is None or segment is None:
        return
    old = workspace.snapshot
    try:
        found = create(
            segment,
            fit,
            recording=workspace.recording,
            facts=old.facts if old else None,
            uncertainty=known[1] if known and known[0] is fit else None,
            evaluation=old.evaluation if old and old.fit is fit else None,
            methods=workspace.compared,
            name=st.session_state["snapshots_name"].strip(),
            note=st.session_state["snapshots_note"].strip(),
            with_data=st.session_state["snapshots_with_data"],
        )
        kept = library().add(found)
    except SnapshotError as fault:
        flash("error", str(fault))
        return
    st.session_state["snapshots_chosen"] = kept
    flash("success", f"Saved as “{found.name}”." if found.name else f"Saved as snapshot {kept}.")


def upload_form() -> None:
    """A colleague's file, kept only once it is known to be whole."""

    def brought() -> None:
        upload = st.session_state["snapshots_upload"]
        if upload is None:
            return
        try:
            kept = library().add(upload.getvalue())
        except SnapshotError as fault:
            flash("error", f"{upload.name}: {fault}")
            return
        st.session_state["snapshots_chosen"] = kept
        flash("success", f"{upload.name} is whole and now in the list as {kept}.")

    st.subheader("Bring one from a colleague", anchor=False)
    st.file_uploader(
        f"A file that ends in .accpinn.zip, up to {LARGEST / 1e6:.0f} MB; it is checked first.",
        type="zip",
        key="snapshots_upload",
        on_change=brought,
        max_upload_size=int(LARGEST / 1e6),
    )
