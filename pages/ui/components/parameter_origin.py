"""Where the laws shown come from, and what to beware of in that."""

from dataclasses import dataclass

import streamlit as st

from accpinn.methods.fit import Fit, unfinished
from accpinn.results.snapshot.schema import Snapshot
from accpinn.results.tables.estimates import where
from accpinn.segment.segment import SegmentInfo
from pages.ui.components.text import escape_markdown
from pages.ui.session.ui_state import Source
from pages.ui.session.workspace import Workspace


@dataclass(frozen=True, eq=False)
class Learned:
    """A fit and what it was learned from."""

    described: SegmentInfo
    fit: Fit

    @property
    def title(self) -> str:
        """File, seconds and regimes left out, for tables and the files made of them."""
        return where(self.described)


def current(workspace: Workspace) -> Learned | None:
    """The session's own; None before there is one."""
    fit, described = workspace.fit, workspace.described
    return Learned(described, fit) if fit and described else None


def saved(snapshot: Snapshot) -> Learned:
    """That of a snapshot."""
    return Learned(snapshot.info, snapshot.fit)


def warn_unfinished(learned: Learned, source: Source) -> None:
    """Say that these are not yet the parameters, where that is so."""
    if sentence := unfinished(learned.fit):
        cure = " Continue it on page Train." if source == "fit" else ""
        st.warning(sentence + cure, icon=":material/pause_circle:")


def say_not_ones_own(workspace: Workspace, source: Source) -> None:
    """Published laws stand in while one's own are learned."""
    job = workspace.job
    asked = workspace.laws.source in (None, "fit")
    if source == "published" and asked and job and job.is_active:
        st.info(
            f"These are published laws, those of {escape_markdown(workspace.laws.example)}:"
            " your own training"
            " is not finished. Come back when it is done, and your laws stand here.",
            icon=":material/hourglass_top:",
        )
