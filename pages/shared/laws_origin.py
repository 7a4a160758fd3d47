"""Where the laws shown come from, and what to beware of in that."""

from dataclasses import dataclass

import streamlit as st

from accpinn.fit import Fit, unfinished
from accpinn.segment.outline import Described
from accpinn.snapshot import Snapshot
from accpinn.tables.results import where
from pages.shared.remembered import Source
from pages.shared.text import plain
from pages.shared.workspace import Workspace


@dataclass(frozen=True, eq=False)
class Learned:
    """A fit and what it was learned from."""

    described: Described
    fit: Fit
    left_out: tuple[str, ...]
    """Names of the regimes that the law leaves out."""

    @property
    def title(self) -> str:
        """File, seconds and regimes left out, for tables and the files made of them."""
        without = f", law without {', '.join(self.left_out)}" if self.left_out else ""
        return where(self.described) + without


def current(workspace: Workspace) -> Learned | None:
    """The session's own; None before there is one."""
    fit, described, segment = workspace.fit, workspace.described, workspace.segment
    if fit is None or described is None:
        return None
    return Learned(described, fit, segment.left_out_regimes if segment else workspace.leave_out)


def saved(snapshot: Snapshot) -> Learned:
    """That of a snapshot."""
    return Learned(snapshot.outline, snapshot.fit, snapshot.outline.left_out)


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
            f"These are published laws, those of {plain(workspace.laws.example)}: your own training"
            " is not finished. Come back when it is done, and your laws stand here.",
            icon=":material/hourglass_top:",
        )
