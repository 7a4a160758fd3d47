"""Compare: every method on the same window, and what the data identify."""

import streamlit as st

from accpinn.results.messages import messages
from accpinn.study.comparison import failures_among
from pages.ui.compare.charts import (
    choose_earlier,
    show_curves,
    show_estimates,
    show_records,
    show_tracks,
)
from pages.ui.compare.identifiability import show_adequacy, show_identifiability, show_starts
from pages.ui.compare.verdict import show_failures, show_methods, show_verdict
from pages.ui.components import frame
from pages.ui.components.messages import show_messages
from pages.ui.components.monitor import monitor, own_task_line, stop_button
from pages.ui.components.widgets import pick_follower
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.restored import show_saved_rows
from pages.ui.train.results import show_intervals

GAP_ERROR = "A constant error of the measured gap shifts τ: 0.1 m in 30 m by 0.3 %."


def main() -> None:
    workspace = frame.begin("Compare", "Every method on the same data: do they agree?")
    segment = workspace.segment
    show_saved_rows(workspace)
    if segment is None:
        if not workspace.snapshot:
            frame.empty_state(workspace, "Nothing to compare on")
        return
    st.caption(frame.segment_line(segment, workspace.case))
    controls(workspace)
    if workspace.comparison:
        monitor(workspace, workspace.comparison, lambda running: show(workspace, running))
    elif workspace.records and not workspace.snapshot:
        show_records(workspace.records, segment, (), pick_follower(segment, "compare_follower"))


def controls(workspace: Workspace) -> None:
    """Run, or stop what runs."""
    task, training = workspace.comparison, workspace.training
    if task and task.is_active:
        stop_button(task, "Stop", "compare_stop")
        return
    if task is None:
        st.markdown(
            "Eight ways to estimate α, β and τ, with the errors of each, take some seconds."
        )
        if training and training.is_active:
            first = own_task_line(training, training.time_left)
            st.caption(f"{first} The methods would run after it.")
    complete = task is not None and len(task.results) == len(task.names)
    if not complete and st.button(
        "Run all methods", type="primary", icon=":material/play_arrow:", key="compare_run"
    ):
        workspace.compare()
        st.rerun()


def show(workspace: Workspace, running: bool) -> None:
    """The rows so far; what takes a choice or a while only comes once all have ended."""
    segment, task = workspace.segment, workspace.comparison
    if segment is None or task is None:
        return
    show_failures(failures_among(task.results))
    if not workspace.compared:
        return
    if running:
        show_methods(segment, workspace.compared, 0, running=True)
        return
    rows = workspace.compared_with_training()
    uncertainty = rows[0].uncertainty
    show_verdict(segment, rows)
    show_intervals(segment.info, uncertainty, GAP_ERROR)
    show_messages(messages(uncertainty.findings, segment))
    follower = pick_follower(segment, "compare_follower")
    show_methods(segment, rows, follower)
    earlier = choose_earlier(workspace, segment, follower)
    truth = workspace.true_parameters
    true = truth[follower] if truth else None
    picked = show_estimates(segment, rows, follower, true, earlier)
    show_curves(segment, picked, follower)
    show_tracks(segment, rows, follower, true)
    show_identifiability(workspace, segment, rows, follower)
    show_adequacy(segment, follower)
    show_starts(workspace, segment, follower)
    show_records(workspace.records, segment, rows, follower)


main()
