"""The list of a session's finished trainings: restored at a click, compared with each other."""

import streamlit as st

from pages.ui.components import show
from pages.ui.session.recordings import find_sample
from pages.ui.session.sessions import result_of
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.both import show_both
from pages.ui.snapshots.listing import choose_entry, show_entries


def show_runs(workspace: Workspace) -> None:
    """The list, whose rows restore a training, and two of them beside each other."""
    entries = workspace.runs
    if not entries:
        return
    with st.expander(f"Finished runs of this session ({len(entries)})", icon=":material/history:"):
        show.flashed()
        show_entries(
            entries, "runs", lambda entry: restore_run(workspace, entry.id),
            help="Shows this run on every page again. The present result stays in this list.",
        )  # fmt: skip
        if len(entries) > 1 and st.toggle("Show two side by side", key="runs_compare"):
            first = choose_entry("Run", "runs_first", entries)
            others = [entry for entry in entries if entry.id != first.id]
            second = choose_entry("Beside", "runs_second", others)
            with show.flashing():
                show_both(result_of(first.id), result_of(second.id))
        st.caption(
            "The last runs are kept on this server, without the recordings; your recording itself"
            " is not stored."
        )


def restore_run(workspace: Workspace, name: str) -> None:
    """Show a training on every page, with its recording where that was open or is a sample."""
    with show.flashing():
        result = result_of(name)
        source = result.analysis.source
        known = workspace.opened.get(source.sha256) or find_sample(source.name, source.sha256)
        workspace.restore(result, *(known or (None, None)))
