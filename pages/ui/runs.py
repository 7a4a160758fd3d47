"""The list of a session's finished runs: restored at a click, compared with each other."""

import streamlit as st

from accpinn.recordings.recording import Recording
from accpinn.recordings.synthetic import Truth
from accpinn.segment.segment import SegmentInfo
from pages.ui.components import show
from pages.ui.session.recordings import find_sample
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.both import show_both
from pages.ui.snapshots.listing import show_entries
from pages.ui.snapshots.one import choose_entry


def show_runs(workspace: Workspace) -> None:
    """The list, whose rows restore a run, and two of them beside each other."""
    entries = workspace.runs.readable()
    if not entries:
        return
    with st.expander(f"Finished runs of this session ({len(entries)})", icon=":material/history:"):
        show.flashed()
        show_entries(
            entries, "runs", lambda entry: restore_run(workspace, entry.id),
            help="Shows this run on every page again. The present result stays in this list.",
        )  # fmt: skip
        if len(entries) > 1 and st.toggle("Show two side by side", key="runs_compare"):
            one = choose_entry("Run", "runs_first", [*entries])
            others = [entry for entry in entries if entry.id != one.id]
            other = choose_entry("Beside", "runs_second", others)
            with show.flashing():
                show_both(workspace.runs.open(one.id), workspace.runs.open(other.id))
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
