"""A snapshot on the other pages: which one is shown, what is missing, and what it holds."""

import streamlit as st

from accpinn.errors import SnapshotError
from accpinn.evaluation.closed_loop import closed_loop
from accpinn.results.figures.recording import preview
from accpinn.results.figures.training import tracking
from accpinn.results.snapshot.schema import Snapshot
from accpinn.results.tables.estimates import methods_table, name_of
from pages.ui.components import frame
from pages.ui.components.charts import show_chart, vehicle_key
from pages.ui.components.messages import escape_markdown, show_messages
from pages.ui.components.table import show_table
from pages.ui.components.widgets import pick_follower
from pages.ui.session.resources import library
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.saving import flash
from pages.ui.train.results import show_fit, show_history, show_intervals


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
    st.info(f"From the snapshot **{name}**; {state}", icon=":material/inventory_2:")
    if snapshot.id and not library().has(snapshot.id):
        show_messages(
            "This snapshot was deleted from the server and lasts only as long as this session;"
            " keep it again, and its link works again.",
            "warning",
            "delete",
        )
        st.button("Keep it again", key="snapshots_keep", on_click=_keep, args=(snapshot,))


def _keep(snapshot: Snapshot) -> None:
    try:
        library().add(snapshot)
    except SnapshotError as fault:
        flash("error", str(fault))


def recording_needed(snapshot: Snapshot, what: str, where: str) -> None:
    """Which recording would complete a page.

    Args:
        snapshot: without its data.
        what: the beginning of the sentence, as "Speeds and gaps are in".
        where: the recording can be opened, as "below".
    """
    info = snapshot.info
    st.warning(
        f"{what} the recording, which is not part of the snapshot. It is"
        f" **{escape_markdown(info.source)}**, SHA-256 `{info.sha256 or 'not known'}`. Open that"
        f" file {where}, and the window is restored.",
        icon=":material/database:",
    )


def _need_recording(workspace: Workspace, snapshot: Snapshot, what: str) -> None:
    if workspace.segment is None:
        recording_needed(snapshot, what, "on the Data page")
        frame.link(frame.DATA, "Open the recording on Data", workspace)


def show_data(workspace: Workspace, snapshot: Snapshot) -> None:
    """The window's own curves, if they came along; else which recording has them."""
    banner(workspace)
    segment = snapshot.segment
    if segment is None:
        recording_needed(snapshot, "Speeds and gaps are in", "below")
        return
    st.caption("These curves are the snapshot's; the whole recording is not part of it.")
    vehicle_key(segment)
    show_chart(preview(segment), "snapshots_data")


def show_saved_result(workspace: Workspace, snapshot: Snapshot) -> None:
    """Outcome, tables, history and curves of a saved result."""
    fit, info, evaluation = snapshot.fit, snapshot.info, snapshot.evaluation
    _need_recording(workspace, snapshot, "To train on, the page needs")
    errors = (evaluation.surrogate, evaluation.closed_loop) if evaluation else (None, None)
    events = evaluation.all_findings if evaluation else ()
    show_fit(info, fit, snapshot.quality, errors, events, snapshot.uncertainty, "snapshots")
    if fit.history:
        show_history(fit.history, info, "snapshots")
    show_curves(workspace, snapshot)


def show_curves(workspace: Workspace, snapshot: Snapshot) -> None:
    """The surrogate, with the data and the closed loop where these are known."""
    fit, segment, info = snapshot.fit, workspace.segment, snapshot.info
    if segment is None and fit.surrogate is None:
        return
    st.subheader("The method's curve" + (" against data" if segment else ""), anchor=False)
    follower = pick_follower(info, "snapshots_follower")
    driven = closed_loop(segment, fit) if segment else None
    own = "network" if fit.method == "pinn" else name_of(fit)
    figure = tracking(segment or info, follower, fit.surrogate, driven, own)
    show_chart(figure, "snapshots_tracking")


def show_saved_rows(workspace: Workspace) -> None:
    """The methods compared, as they were saved, on a page that has no newer comparison."""
    snapshot = workspace.snapshot
    if snapshot is None or workspace.comparison:
        return
    banner(workspace)
    _need_recording(workspace, snapshot, "To run the methods, the page needs")
    info, rows = snapshot.info, snapshot.methods
    show_intervals(info, snapshot.uncertainty, "")
    if not rows:
        st.caption("No comparison of the methods was saved with this snapshot.")
        return
    show_table(methods_table(info, rows, pick_follower(info, "snapshots_row_follower")))
