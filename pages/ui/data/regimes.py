"""Regimes on the Data page: their shares, which are left out, and the estimates' sensitivity."""

from contextlib import suppress

import streamlit as st

from accpinn.errors import SegmentError
from accpinn.model.cthp import Case
from accpinn.recordings.recording import Recording
from accpinn.results.tables.estimates import regimes_table, sensitivity_table
from accpinn.segment.quality import EXCLUDABLE, label_regimes
from accpinn.segment.segment import Segment
from accpinn.study.sensitivity import SensitivityResult, sensitivity
from pages.ui.components.messages import show_messages
from pages.ui.components.table import show_table
from pages.ui.components.widgets import sync_widget
from pages.ui.session.workspace import Workspace

HELP = {
    "catching up": "The time gap, space-gap over speed, is above 2 s: the vehicle catches up or"
    " drives freely.",
    "manual": "A driver controls the vehicle, according to the file.",
    "standstill": "The vehicle moves at 1 m/s or less.",
}


def show_regimes(workspace: Workspace, recording: Recording) -> None:
    """Shares, the user's choice, and on request the sensitivity of the estimates to it."""
    segment = None
    with suppress(SegmentError):
        segment = workspace.whole_segment()
    if segment is None:
        return
    regimes = label_regimes(segment, recording)
    # Its state is the server's, as what stands above it comes and goes.
    with st.expander("Regimes", icon=":material/category:", key="data_regimes", on_change="rerun"):
        show_table(regimes_table(segment.info, regimes))
        if not any(regimes.mode_known):
            st.caption("The file has no driver modes, so no instant counts as manual.")
        st.markdown("**Leave out of the model's equations**")
        with st.container(horizontal=True):
            for name in EXCLUDABLE:
                _choose(workspace, name)
        st.caption(
            "The model describes car-following. Nothing is left out unless you tick it; every"
            " method then works without it, and every page names it. The data stay: only the"
            " equation of the follower's acceleration does not count there. Leaving out by the"
            " time gap biases as well, since the model is to explain that gap: compare before you"
            " decide."
        )
        if st.toggle("Show the sensitivity of the estimates", key="data_sensitivity"):
            _show_sensitivity(workspace, segment, recording)


def _choose(workspace: Workspace, name: str) -> None:
    key, chosen = f"data_exclude_{name}", name in workspace.excluded_regimes

    def changed() -> None:
        ticked = {*workspace.excluded_regimes} - {name}
        ticked |= {name} if st.session_state[key] else set()
        workspace.choose(excluded_regimes=tuple(n for n in EXCLUDABLE if n in ticked))

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
        show_table(sensitivity_table(segment.info, found, follower))
    show_messages(tuple(dict.fromkeys(str(row.fault) for row in found if row.fault)))


@st.cache_data(max_entries=32, show_spinner="Estimating with and without them …")
def _sensitivity(
    request: str, _segment: Segment, _recording: Recording, _case: Case
) -> tuple[SensitivityResult, ...]:
    """Kept by ``request``, which names the data and the case."""
    return sensitivity(_segment, _recording, _case)
