"""Where the laws shown come from, and what to beware of in that."""

import streamlit as st

from accpinn.fit import Fit, unfinished
from accpinn.segment.outline import Described
from accpinn.tables.results import where
from pages.shared.remembered import Source
from pages.shared.text import left_out, plain
from pages.shared.workspace import Workspace


def say_where(workspace: Workspace) -> None:
    """The window of the current fit, and the regimes that its law leaves out."""
    described, segment = workspace.described, workspace.segment
    if described:
        regimes = segment.left_out_regimes if segment else workspace.leave_out
        st.caption(where_learned(described, regimes))


def where_learned(described: Described, regimes: tuple[str, ...]) -> str:
    """File, seconds and regimes left out, as markdown."""
    return plain(where(described)) + left_out(regimes)


def warn_unfinished(fit: Fit) -> None:
    """Say that these are not yet the parameters, where that is so."""
    if sentence := unfinished(fit):
        st.warning(f"{sentence} Continue it on page Train.", icon=":material/pause_circle:")


def say_not_ones_own(workspace: Workspace, source: Source) -> None:
    """Published laws stand in while one's own are learned."""
    job = workspace.job
    asked = workspace.laws.source in (None, "fit")
    if source == "published" and asked and job and job.is_active:
        st.info(
            f"These are published laws, those of {plain(workspace.laws.example)}: your own training"
            " is not finished. Come back when it is done, and your laws stand here.",
            icon=":material/hourglass_top:",
        )
