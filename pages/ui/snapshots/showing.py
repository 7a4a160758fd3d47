"""What a snapshot holds, on the pages Data and Train, as it was saved."""

import streamlit as st

from accpinn.evaluation.closed_loop import closed_loop
from accpinn.results.figures import training
from accpinn.results.figures.recording import preview
from accpinn.results.figures.style import vehicle_colour
from accpinn.results.snapshot.schema import Snapshot
from accpinn.results.tables import estimates as tables
from accpinn.results.tables import table as typeset
from accpinn.results.tables.estimates import methods_table
from accpinn.results.tables.names import name_of
from accpinn.segment.segment import SegmentInfo
from pages.ui.components import frame
from pages.ui.components.charts import show_chart
from pages.ui.components.text import bullets
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import banner, recording_needed, recording_needed_here
from pages.ui.train.results import (
    downloads,
    show_closed_loop_findings,
    show_intervals,
    show_outcome,
)


def show_data(workspace: Workspace, snapshot: Snapshot) -> None:
    """The window's own curves, if they came along; else which recording has them."""
    banner(workspace)
    segment = snapshot.segment
    if segment is None:
        recording_needed_here(snapshot, "Speeds and gaps are in")
        return
    st.caption("These curves are the snapshot's; the whole recording is not part of it.")
    frame.vehicle_key(segment.info)
    show_chart(preview(segment), "snapshots_data")


def show_result(workspace: Workspace, snapshot: Snapshot) -> None:
    """Outcome, table, course and curves of a saved result."""
    fit, info, worth = snapshot.fit, snapshot.info, snapshot.evaluation
    if workspace.segment is None:
        recording_needed(workspace, snapshot, "To train on, the page needs")
    show_outcome(fit)
    errors = (worth.surrogate, worth.closed_loop) if worth else (None, None)
    table = tables.parameter_table(info, fit, snapshot.quality, *errors)
    colours = [vehicle_colour(n, info.vehicles[0]) for n in info.vehicles]
    st.html(typeset.STYLE + table.coloured(colours).to_html())
    show_closed_loop_findings(worth.all_findings if worth else (), info)
    show_intervals(info, snapshot.uncertainty)
    if fit.notes:
        st.info(bullets(fit.notes), icon=":material/info:")
    whole = tables.parameter_table(info, fit, snapshot.quality, *errors, snapshot.uncertainty)
    downloads(whole, info)
    show_history(snapshot)
    show_curves(workspace, snapshot)


def show_history(snapshot: Snapshot) -> None:
    """How loss and parameters moved."""
    history, info = snapshot.fit.history, snapshot.info
    if history is None:
        return
    frame.vehicle_key(info)
    loss, *parameters = st.columns(4)
    with loss:
        show_chart(training.loss_history(history), "snapshots_loss")
    for which, column in enumerate(parameters):
        with column:
            figure = training.parameter_history(history, which, info)
            show_chart(figure, f"snapshots_parameter_{which}")


def show_curves(workspace: Workspace, snapshot: Snapshot) -> None:
    """The method's curve, with the data and the closed loop where these are known."""
    fit, segment, info = snapshot.fit, workspace.segment, snapshot.info
    if segment is None and fit.surrogate is None:
        return
    st.subheader("The method's curve" + (" against data" if segment else ""), anchor=False)
    follower = choose_follower(info, "snapshots_follower")
    driven = closed_loop(segment, fit) if segment else None
    own = "network" if fit.method == "pinn" else name_of(fit)
    figure = training.tracking(segment or info, follower, fit.surrogate, driven, own)
    show_chart(figure, "snapshots_tracking")


def choose_follower(info: SegmentInfo, key: str) -> int:
    """Whose curves or rows are shown; no question where there is one."""
    if info.followers == 1:
        return 0
    chosen = st.selectbox(
        "Follower",
        range(info.followers),
        format_func=lambda k: info.labels[k + 1],
        key=key,
        width=320,
    )
    return chosen or 0


def show_rows(workspace: Workspace) -> None:
    """The methods compared, as they were saved, on a page that has no newer comparison."""
    snapshot = workspace.snapshot
    if snapshot is None or workspace.comparison:
        return
    banner(workspace)
    if workspace.segment is None:
        recording_needed(workspace, snapshot, "To run the methods, the page needs")
    info, rows = snapshot.info, snapshot.methods
    show_intervals(info, snapshot.uncertainty, "")
    if not rows:
        st.caption("No comparison of the methods was saved with this snapshot.")
        return
    follower = choose_follower(info, "snapshots_row_follower")
    st.html(typeset.STYLE + methods_table(info, rows, follower).to_html())
