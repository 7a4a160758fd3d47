"""The list of a session's finished runs: restored at a click, compared with each other."""

import streamlit as st

from accpinn.recordings.recording import Recording
from accpinn.recordings.synthetic import Truth
from accpinn.segment.segment import SegmentInfo
from pages.ui.components import show
from pages.ui.data.sources import find_sample
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots import choose_entry, listing, show_both

CHOSEN, SECOND = "runs_chosen", "runs_second"


def show_runs(workspace: Workspace) -> None:
    """The list, with a button that restores one and a second one to compare it with."""
    entries = workspace.runs.entries()
    if not entries:
        return
    with st.expander(f"Finished runs of this session ({len(entries)})", icon=":material/history:"):
        show.flashed()
        show.table(listing(entries))
        entry = choose_entry("Run", CHOSEN, entries)
        if entry is None:
            return
        st.button(
            "Restore", icon=":material/restore:", key="runs_restore",
            on_click=restore_run, args=(workspace, entry.id),
            help="Shows this run on every page again. The present result stays in this list.",
        )  # fmt: skip
        others = tuple(one for one in entries if one.id != entry.id)
        if others:
            other = choose_entry("Compare with", SECOND, others)
            if other and st.toggle("Show both side by side", key="runs_compare"):
                with show.flashing():
                    show_both(workspace.runs.open(entry.id), workspace.runs.open(other.id))
        st.caption(
            "The last runs are kept on this server, without the recordings; your recording itself"
            " is not stored."
        )


def restore_run(workspace: Workspace, name: str) -> None:
    """Show a run on every page, with its recording where that was open or is a sample."""
    with show.flashing():
        run = workspace.runs.open(name)
        workspace.restore(run, *_recording_of(workspace, run.info))


def _recording_of(workspace: Workspace, info: SegmentInfo) -> tuple[Recording | None, Truth | None]:
    known = workspace.opened.get(info.sha256)
    return known or find_sample(info.source, info.sha256) or (None, None)
