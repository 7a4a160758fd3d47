"""Compare: every method on the same window, and what the recording leaves open."""

import streamlit as st

from accpinn.study.comparison import failures_among
from pages.ui.compare.charts import choose_follower, show_courses, show_curves, show_estimates
from pages.ui.compare.fit_records import choose_earlier, show_earlier
from pages.ui.compare.identifiability import show_telling
from pages.ui.compare.own import rows_of
from pages.ui.compare.tables import show_intervals, show_methods, show_refusals
from pages.ui.compare.verdict import show_verdict
from pages.ui.compare.waiting import show_busy
from pages.ui.compare.watch import watch
from pages.ui.components import frame
from pages.ui.components.empty_state import show_missing
from pages.ui.components.text import escape_markdown, left_out
from pages.ui.session.resources import task_queue
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.showing import show_rows


def main() -> None:
    workspace = frame.begin("Compare", "Every method on the same data: do they agree?")
    segment = workspace.segment
    show_rows(workspace)
    if segment is None and workspace.snapshot:
        return
    if segment is None:
        show_missing(workspace, "Nothing to compare on")
        return
    place = f"{segment.source} · {segment.window}"
    case = f" · Case {workspace.case}" if segment.followers > 1 else ""
    st.caption(escape_markdown(place) + case + left_out(segment.excluded_regimes))
    controls(workspace)
    if workspace.comparison:
        watch(workspace, workspace.comparison, lambda: show(workspace))
    elif workspace.runs and not workspace.snapshot:
        show_earlier(workspace, segment, (), choose_follower(segment))


def controls(workspace: Workspace) -> None:
    """Run, or stop what runs."""
    series = workspace.comparison
    if series and series.is_active:
        if st.button("Stop", icon=":material/stop:", disabled=series.is_stopping):
            task_queue().stop(series)
            st.rerun()
        return
    if series is None:
        st.markdown(
            "Eight ways to estimate α, β and τ, with the errors of each, take some seconds."
        )
        show_busy(workspace)
    whole = series is not None and len(series.results) == len(series.names)
    if not whole and st.button(
        "Run all methods", type="primary", icon=":material/play_arrow:", key="compare_run"
    ):
        workspace.compare()
        st.rerun()


def show(workspace: Workspace) -> None:
    """The rows so far; what takes a choice or a while only comes once all have ended."""
    segment, series = workspace.segment, workspace.comparison
    if segment is None or series is None:
        return
    show_refusals(failures_among(series.results))
    if not workspace.compared:
        return
    if series.is_active:
        show_methods(segment, workspace.compared, 0, running=True)
        return
    rows = rows_of(workspace)
    show_verdict(segment, rows)
    show_intervals(segment, rows[0].uncertainty)
    follower = choose_follower(segment)
    show_methods(segment, rows, follower)
    earlier = choose_earlier(workspace, segment, follower)
    truth = workspace.true_parameters
    true = truth[follower] if truth else None
    chosen = show_estimates(segment, rows, follower, true, earlier)
    show_curves(segment, chosen, follower)
    show_courses(segment, rows, follower, true)
    show_telling(workspace, segment, rows, follower)
    show_earlier(workspace, segment, rows, follower)


main()
