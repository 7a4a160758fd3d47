"""Compare: every method on the same window, and what the recording leaves open."""

import streamlit as st

from accpinn.comparison import METHODS, Row, compare
from accpinn.figures.style import vehicle_colour
from accpinn.segment import Segment
from accpinn.tables import typeset
from accpinn.tables.comparison import TITLES, intervals_table, methods_table
from pages.shared import frame
from pages.shared.results import downloads
from pages.shared.snapshots_listing import recording_needed
from pages.shared.text import bullets, left_out, plain
from pages.shared.workspace import Workspace, store


def main() -> None:
    workspace = frame.begin("Compare", "Every method on the same data: do they agree?")
    segment = workspace.segment
    if segment is None and workspace.snapshot:
        recording_needed(workspace, workspace.snapshot, "To run the methods, the page needs")
        return
    if segment is None:
        st.info("Nothing to compare on yet: first open a recording.", icon=":material/info:")
        frame.link(frame.DATA, "Go to Data", workspace, "arrow_forward")
        return
    place = f"{segment.source} · {segment.start:g}–{segment.start + segment.duration:g} s"
    case = f" · Case {workspace.case}" if segment.followers > 1 else ""
    st.caption(plain(place) + case + left_out(segment.left_out_regimes))
    if not workspace.compared:
        st.markdown(
            "Eight ways to estimate α, β and τ, with the errors of each, take some seconds."
        )
        if st.button("Run all methods", type="primary", icon=":material/play_arrow:"):
            run(workspace, segment)
            st.rerun()
        return
    show(segment, workspace.compared)


def run(workspace: Workspace, segment: Segment) -> None:
    """One method after the other, with a bar."""
    bar, rows = st.progress(0.0, f"{TITLES[METHODS[0]]} …"), []
    found = compare(
        segment, workspace.case, store=store(), threads=1, recording=workspace.recording
    )
    for row in found:
        rows.append(row)
        left = METHODS[len(rows) :]
        bar.progress(len(rows) / len(METHODS), f"{TITLES[left[0]]} …" if left else "")
    workspace.compared = tuple(rows)


def show(segment: Segment, rows: tuple[Row, ...]) -> None:
    """What the recording allows, then each method's estimates and errors."""
    doubt = rows[0].uncertainty
    colours = [vehicle_colour(n, segment.vehicles[0]) for n in segment.vehicles[1:]]
    intervals = intervals_table(segment, doubt)
    st.html(typeset.STYLE + intervals.coloured(colours).to_html())
    st.caption(
        "Which parameters the data support where disturbances last for seconds, as on a road. A"
        " method's estimate may lie outside: disturbances that the vehicle itself answers pull it."
        " A lasting error of the measured gap shifts τ unseen: 0.1 m in 30 m by 0.3 %."
    )
    if doubt.notes:
        st.info(bullets(doubt.notes), icon=":material/info:")
    follower = 0
    if segment.followers > 1:
        follower = st.selectbox(
            "Follower",
            range(segment.followers),
            format_func=lambda k: segment.labels[k + 1],
            key="compare_follower",
            width=320,
        )
    table = methods_table(segment, rows, follower)
    st.html(typeset.STYLE + table.to_html())
    st.caption(
        "Surrogate fit: the method's own curve against the data. Closed loop: the law drives behind"
        " the measured leader. Held out: the window's first and last third, each driven by a law"
        " learned without it. Unseen rest: closed loop on the recording outside the window."
        " Collides at: when the law would run into the vehicle ahead; it drives on, and the errors"
        " include what follows."
    )
    downloads(table, segment)


main()
