"""The comparison's tables, and what their columns mean."""

from collections.abc import Sequence

import streamlit as st

from accpinn.inference.intervals import Uncertainty
from accpinn.methods.registry import METHODS
from accpinn.results.messages import messages
from accpinn.results.tables import table as typeset
from accpinn.results.tables.estimates import methods_table
from accpinn.results.tables.names import TITLES
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodFailure, MethodResult
from pages.ui.components.text import bullets
from pages.ui.train import results

GAP_ERROR = "A lasting error of the measured gap shifts τ unseen: 0.1 m in 30 m by 0.3 %."


def show_intervals(segment: Segment, uncertainty: Uncertainty) -> None:
    """What the recording allows, whichever method is asked."""
    results.show_intervals(segment.info, uncertainty, GAP_ERROR)
    if uncertainty.findings:
        st.info(bullets(messages(uncertainty.findings, segment)), icon=":material/info:")


def show_refusals(refused: Sequence[MethodFailure]) -> None:
    """The methods that have no row, those with the same reason together."""
    reasons: dict[str, list[str]] = {}
    for one in refused:
        reasons.setdefault(str(one.fault), []).append(TITLES[one.method])
    if reasons:
        said = tuple(
            f"No result from {', '.join(who) if len(who) < len(METHODS) else 'any method'}: {why}"
            for why, who in reasons.items()
        )
        st.warning(bullets(said), icon=":material/warning:")


def show_methods(
    segment: Segment, rows: tuple[MethodResult, ...], follower: int, running: bool = False
) -> None:
    """Each method's estimates and errors."""
    table = methods_table(segment.info, rows, follower)
    st.html(typeset.STYLE + table.to_html())
    if running:
        return
    own = not all(row.evaluation.blocks for row in rows)
    gap = segment.gaps[:, follower]
    st.caption(
        "MAE: mean absolute error. Surrogate fit: how far the smooth curve that the method itself"
        " draws through the motion is from the data (a dash where it draws none). Closed loop: the"
        " law drives by itself behind the measured leader. Held out: each third of the window,"
        " driven by a law learned from the other two. Unseen rest: closed loop on the recording"
        " outside the window. Collides at: when the law would run into the vehicle ahead; it drives"
        " on, and the errors include what follows. For scale: the measured space-gap itself is"
        f" {abs(gap - gap.mean()).mean():.2f} m from its mean."
        + (" Your own training has no part held out: that would be three trainings more." * own)
    )
    results.downloads(table, segment.info)
