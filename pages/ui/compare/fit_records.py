"""Earlier runs of the session: laid over the chart, and held against the present one."""

from collections.abc import Sequence

import streamlit as st

from accpinn.results.figures.comparison import Estimate
from accpinn.results.tables import table as typeset
from accpinn.results.tables.estimates import fit_record_table, fit_record_title
from accpinn.segment.segment import Segment
from accpinn.study.comparison import FitRecord, MethodResult
from pages.ui.session.workspace import Workspace

MOST = 8
"""Earlier runs over the chart at once."""


def choose_earlier(workspace: Workspace, segment: Segment, follower: int) -> list[Estimate]:
    """What the user lays over the chart."""
    number = segment.vehicles[follower + 1]
    known = [run for run in reversed(workspace.runs) if run.of_vehicle(number) is not None]
    if not known:
        return []
    names = {f"{k}. {fit_record_title(run)}": run for k, run in enumerate(known, 1)}
    chosen = st.multiselect(
        "Earlier runs to lay over the chart",
        list(names),
        key="compare_earlier",
        max_selections=MOST,
        placeholder=f"{len(known)} kept",
    )
    values = [(name, names[name].of_vehicle(number)) for name in chosen if name in names]
    return [
        Estimate(name, value.values, earlier=True) for name, value in values if value is not None
    ]


def show_earlier(
    workspace: Workspace, segment: Segment, rows: Sequence[MethodResult], follower: int
) -> None:
    """All earlier runs: what came out, and where there are rows what they say and ask now."""
    if not workspace.runs:
        return
    st.subheader("Earlier runs", anchor=False)
    count = len(workspace.runs)
    st.caption(f"Kept from earlier in this session: {count} fit{'s' if count != 1 else ''}.")
    # Of two fits by one method the first counts: the second is the session's own training.
    now = {row.fit.method: FitRecord.of(segment, row.fit) for row in reversed(rows)}
    table = fit_record_table(tuple(reversed(workspace.runs)), now, segment.vehicles[follower + 1])
    if table.rows:
        st.html(typeset.STYLE + table.to_html())
    else:
        st.caption("None of them has this vehicle as a follower.")
