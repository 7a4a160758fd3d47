"""Regimes on the Data page: what occurs when, what depends on it, and what the user leaves out."""

from contextlib import suppress
from dataclasses import replace

import streamlit as st

from accpinn.errors import SegmentError
from accpinn.model.cthp import Case
from accpinn.recordings.recording import Recording
from accpinn.results.tables import table as typeset
from accpinn.results.tables.estimates import regimes_table, sensitivity_table
from accpinn.segment.cut import cut
from accpinn.segment.regimes import EXCLUDABLE, label_regimes
from accpinn.segment.segment import Segment
from accpinn.study.sensitivity import SensitivityResult, sensitivity
from pages.ui.components.text import bullets
from pages.ui.session.workspace import Workspace, sync_widget

HELP = {
    "catching up": "The time gap, space-gap over speed, is above 2 s: the vehicle catches up or"
    " drives freely.",
    "manual": "A driver controls the vehicle, as far as the file says so.",
    "standstill": "The vehicle moves at 1 m/s or less.",
}


def show_regimes(workspace: Workspace, recording: Recording) -> None:
    """Shares, the user's choice, and on request what the estimates owe to it."""
    segment = whole(workspace)
    if segment is None:
        return
    regimes = label_regimes(segment, recording)
    # Its state is the server's, as what stands above it comes and goes.
    with st.expander("Regimes", icon=":material/category:", key="data_regimes", on_change="rerun"):
        st.html(typeset.STYLE + regimes_table(segment.info, regimes).to_html())
        if not any(regimes.mode_known):
            st.caption("This file does not say who drives, so no instant counts as manual.")
        st.markdown("**Leave out of the law's equations**")
        with st.container(horizontal=True):
            for name in EXCLUDABLE:
                _choose(workspace, name)
        st.caption(
            "The law is for car-following; nothing is left out unless you tick it, and then every"
            " method and every page says so. The data stay: only the equation of the follower's"
            " acceleration does not count there. Leaving out by the time gap biases as well, since"
            " the law is to explain that gap: compare before you decide."
        )
        if st.toggle("Show how much the estimates depend on this", key="data_sensitivity"):
            _show_sensitivity(workspace, segment, recording)


def whole(workspace: Workspace) -> Segment | None:
    """The segment with nothing left out; None where there is none."""
    if workspace.segment:
        return replace(workspace.segment, mask=None, excluded_regimes=())
    window = workspace.window
    if workspace.recording:
        with suppress(SegmentError):
            return cut(workspace.recording, window.start, window.duration, workspace.vehicles)
    return None


def _choose(workspace: Workspace, name: str) -> None:
    key = f"data_leave_out_{name}"
    chosen = name in workspace.leave_out

    def changed() -> None:
        ticked = set(workspace.leave_out) - {name}
        if st.session_state[key]:
            ticked.add(name)
        workspace.choose(exclude_regimes=tuple(n for n in EXCLUDABLE if n in ticked))

    st.checkbox(
        name.capitalize(), chosen, key=sync_widget(key, chosen), help=HELP[name], on_change=changed
    )


def _show_sensitivity(workspace: Workspace, segment: Segment, recording: Recording) -> None:
    request = f"{segment.info.digest} {recording.sha256} {workspace.case}"
    found = _sensitivity(request, segment, recording, workspace.case)
    if not any(any(row.share) for row in found):
        st.caption("None of these occurs in this window, so there is nothing to compare.")
        return
    for follower in range(segment.followers):
        st.html(typeset.STYLE + sensitivity_table(segment.info, found, follower).to_html())
    if faults := tuple(dict.fromkeys(str(row.fault) for row in found if row.fault)):
        st.info(bullets(faults), icon=":material/info:")


@st.cache_data(max_entries=32, show_spinner="Estimating with and without them …")
def _sensitivity(
    request: str, _segment: Segment, _recording: Recording, _case: Case
) -> tuple[SensitivityResult, ...]:
    """Kept by ``request``, which names the data and the case."""
    return sensitivity(_segment, _recording, _case)
