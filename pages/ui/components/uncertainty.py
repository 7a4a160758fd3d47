"""What the data leave open about the current fit: worked out once, shown where the user wants."""

import streamlit as st

from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.model.published import ParameterSet
from accpinn.results.figures import stability as figures
from accpinn.results.messages import messages
from accpinn.results.tables import table as typeset
from accpinn.results.tables.stability import stability_interval_table
from accpinn.segment.segment import SegmentInfo
from pages.ui.components.text import bullets
from pages.ui.session.workspace import Workspace, sync_widget


def doubt_of(workspace: Workspace, laws: ParameterSet) -> Uncertainty | None:
    """The uncertainty of the fit that ``laws`` are of; None for laws from elsewhere."""
    fit = workspace.fit
    return doubt_of_fit(workspace) if fit and fit.parameters == laws.parameters else None


def doubt_of_fit(workspace: Workspace) -> Uncertainty | None:
    """The uncertainty of the current fit; None where there is none, or its data are not here."""
    fit, segment = workspace.fit, workspace.segment
    if fit is None:
        return None
    known = workspace.uncertainty
    if known is None or known[0] is not fit:
        if segment is None:
            return None
        workspace.uncertainty = known = (fit, intervals(segment, fit))
    return known[1]


def choose_doubt(workspace: Workspace, laws: ParameterSet) -> Uncertainty | None:
    """A switch, and what it shows; None where it is off or there is nothing to show."""
    uncertainty = doubt_of(workspace, laws)
    if uncertainty is None:
        return None
    key = "stability_doubt"

    def changed() -> None:
        workspace.map.uncertainty = st.session_state[key]

    st.toggle(
        "Show what the data leave open",
        value=workspace.map.uncertainty,
        key=sync_widget(key, workspace.map.uncertainty),
        on_change=changed,
        help="Bands of the response, clouds of laws on the map, and intervals of the figures.",
    )
    return uncertainty if workspace.map.uncertainty else None


def show_doubt(laws: ParameterSet, uncertainty: Uncertainty, info: SegmentInfo) -> None:
    """Intervals of the figures of stability, and what they stand on."""
    table = stability_interval_table(laws, uncertainty).coloured(figures.colours(laws))
    st.html(typeset.STYLE + table.to_html())
    st.caption(
        "From laws drawn as the recording allows them, with disturbances that last for seconds."
        " Stable laws: the share of these that keeps a gap and is stable. Laws with α = 0"
        " follow the speed ahead and keep no gap; they amplify nothing, and are counted apart."
    )
    if uncertainty.findings:
        st.info(bullets(messages(uncertainty.findings, info)), icon=":material/info:")
