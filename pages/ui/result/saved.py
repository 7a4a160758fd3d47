"""What pages show of a snapshot: its banner, its data, its result and its comparison."""

from collections.abc import Callable

import streamlit as st
from accpinn.results.snapshot import Snapshot

from accpinn.results.figures.recording import preview
from accpinn.results.tables import estimates as tables
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import pick_follower
from pages.ui.result.evaluated import of_snapshot
from pages.ui.result.view import show_evaluated, show_intervals
from pages.ui.session import owners
from pages.ui.session.resources import library
from pages.ui.session.workspace import Workspace


def banner(workspace: Workspace) -> None:
    """Which snapshot a page shows, and what would complete it."""
    snapshot = workspace.snapshot
    if snapshot is None:
        return
    name = escape_markdown(snapshot.name or snapshot.id)
    if workspace.training:
        state = "the training is new, on the same window."
    elif workspace.recording:
        state = "its recording is open, so everything is complete."
    elif workspace.segment:
        state = "its data came with it."
    else:
        state = "it came without its data."
    is_run = workspace.runs.has(snapshot.id)
    kind = "An earlier run" if is_run else "From the snapshot"
    st.info(f"{kind} **{name}**; {state}", icon=":material/inventory_2:")

    def keep() -> None:
        with show.flashing():
            owners.save(workspace, snapshot)

    if snapshot.id and not is_run and not library().has(snapshot.id):
        show.messages(
            "This snapshot was deleted from the server and lasts only as long as this session;"
            " keep it again, and its link works again.",
            "warning",
            "delete",
        )
        st.button("Keep it again", key="snapshots_keep", on_click=keep)


def _recording_needed(
    workspace: Workspace, snapshot: Snapshot, what: str, here: bool = False
) -> None:
    """Which recording would complete a page without data, which may be opened ``here``."""
    if workspace.segment:
        return
    info = snapshot.info
    st.warning(
        f"{what} the recording, which is not part of the snapshot. It is"
        f" **{escape_markdown(info.source)}**, SHA-256 `{info.sha256 or 'not known'}`. Open that"
        f" file {'below' if here else 'on the Data page'}, and the window is restored.",
        icon=":material/database:",
    )
    if not here:
        frame.link(frame.DATA, "Open the recording on Data", workspace)


def show_data(workspace: Workspace, snapshot: Snapshot) -> None:
    """The window's own curves, if they came along; else which recording has them."""
    banner(workspace)
    segment = snapshot.segment
    if segment is None:
        _recording_needed(workspace, snapshot, "Speeds and gaps are in", here=True)
        return
    st.caption("These curves are the snapshot's; the whole recording is not part of it.")
    show.vehicle_key(segment)
    show.chart(preview(segment), "snapshots_data")


def show_saved_result(
    workspace: Workspace, snapshot: Snapshot, next_step: Callable[[], None] | None = None
) -> None:
    """A saved result as the page Train shows one of the session's; ``next_step`` leads on."""
    if workspace.segment is None:
        show.not_acc(snapshot.info)
    _recording_needed(workspace, snapshot, "To train on, the page needs")
    result = of_snapshot(snapshot, workspace.segment)
    show_evaluated(workspace, result, "snapshots", lambda: snapshot, next_step)


def show_saved_rows(workspace: Workspace) -> None:
    """The methods compared, as they were saved, on a page that has no newer comparison."""
    snapshot = workspace.snapshot
    if snapshot is None or workspace.comparison:
        return
    banner(workspace)
    _recording_needed(workspace, snapshot, "To run the methods, the page needs")
    info, rows = snapshot.info, snapshot.methods
    show_intervals(info, snapshot.uncertainty, "", snapshot.fit.case)
    if not rows:
        st.caption("No comparison of the methods was saved with this snapshot.")
        return
    show.table(tables.methods_table(info, rows, pick_follower(info, "snapshots_row_follower")))
