"""What the window tells before anything is trained: its figures, and the least-squares estimate."""

import streamlit as st

from accpinn.methods import least_squares
from accpinn.methods.fit import headway_notes
from accpinn.results.figures.style import vehicle_colour
from accpinn.results.messages import messages
from accpinn.results.tables import table as typeset
from accpinn.results.tables.estimates import quality_table
from accpinn.segment.quality import LARGE_CONDITION, assess_quality
from accpinn.segment.segment import Segment
from pages.ui.components.text import bullets, escape_markdown
from pages.ui.data.metadata import show_warnings
from pages.ui.session.workspace import Workspace


def show_segment(workspace: Workspace) -> None:
    """What the window tells, and the estimate that needs no training."""
    segment = workspace.segment
    if segment is None:
        if workspace.fault:
            st.error(escape_markdown(workspace.fault), icon=":material/error:")
        return
    quality = assess_quality(segment)
    estimate = least_squares.fit(segment, workspace.case)
    table = quality_table(segment.info, quality, estimate)
    colours = [vehicle_colour(n, segment.vehicles[0]) for n in segment.vehicles[1:]]
    st.subheader("What this window tells", anchor=False)
    st.html(typeset.STYLE + table.coloured(colours).to_html())
    st.caption(
        "Least squares solves the law for α, β, τ in one step, from differences of the measured"
        " speeds. It follows the window at once; noise in the data biases it, so take it as a"
        f" first look. The leader's speed varies by {quality.leader_deviation:.2f} m/s (standard"
        " deviation); car-following means moving with a time gap of at most 2 s. The condition"
        " number says how alike gap, speed and relative speed move: above about"
        f" {LARGE_CONDITION:.0f}, α, β and τ cannot be told apart." + _what_counts(segment)
    )
    unsure = headway_notes(segment.labels, estimate.parameters)
    show_warnings(unsure + messages(quality.findings, segment) + estimate.notes, "this window")
    if segment.findings:
        with st.expander("What was done to the data", icon=":material/build:"):
            st.markdown(bullets(messages(segment.findings, segment)))


def _what_counts(segment: Segment) -> str:
    if not segment.excluded_regimes:
        return ""
    return (
        f" Without {', '.join(segment.excluded_regimes)}: the estimate and the condition number;"
        " all other figures are of all instants."
    )
