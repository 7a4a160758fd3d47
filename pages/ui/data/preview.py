"""The recording in a line, and the window's figures and estimate before anything is trained."""

from collections.abc import Sequence

import streamlit as st

from accpinn.methods import least_squares
from accpinn.methods.fit import headway_findings
from accpinn.recordings.recording import Recording
from accpinn.results.messages import messages
from accpinn.results.tables.estimates import quality_table
from accpinn.segment.quality import LARGE_CONDITION, assess_quality
from accpinn.segment.segment import Segment
from pages.ui.components.messages import bullets, escape_markdown, show_error, show_messages
from pages.ui.components.table import show_table, vehicle_colours
from pages.ui.session.workspace import Workspace

SHOWN = 3
"""Sentences that are shown without being asked for."""


def describe(recording: Recording) -> str:
    """The recording's metadata in one line."""
    rate = 1 / recording.sample_time
    parts = [
        f"**{escape_markdown(recording.source)}**",
        escape_markdown(recording.campaign or ""),
        f"{recording.date.day} {recording.date:%B %Y}" if recording.date else "",
        f"{len(recording.present)} vehicles",
        f"{recording.duration:,.0f} s at {rate:.3g} Hz",
        f"ACC flag {recording.acc_flag}" if recording.acc_flag is not None else "",
        f"distance setting {escape_markdown(recording.distance_setting)}"
        if recording.distance_setting
        else "",
        "" if (recording.mode >= 0).any() else "driver modes not recorded",
    ]
    return " · ".join(part for part in parts if part)


def show_warnings(warnings: Sequence[str], about: str) -> None:
    """The first few openly, the rest on demand."""
    show_messages(warnings[:SHOWN], "warning")
    if warnings[SHOWN:]:
        with st.expander(f"{len(warnings) - SHOWN} more about {about}"):
            st.markdown(bullets(warnings[SHOWN:]))


def show_preview(workspace: Workspace) -> None:
    """The window's figures, and the estimate that needs no training."""
    segment = workspace.segment
    if segment is None:
        if workspace.fault:
            show_error(workspace.fault)
        return
    quality = assess_quality(segment)
    estimate = least_squares.fit(segment, workspace.case)
    st.subheader("Preview of the window", anchor=False)
    show_table(quality_table(segment.info, quality, estimate), vehicle_colours(segment)[1:])
    st.caption(
        "Least squares solves the model for α, β and τ in one step, from differences of the"
        " measured speeds. Noise in the data biases it: take it as a first look. The leader's"
        f" speed varies by {quality.leader_deviation:.2f} m/s (standard deviation). Car-following:"
        " moving with a time gap of at most 2 s. Condition number: above about"
        f" {LARGE_CONDITION:.0f}, gap, speed and relative speed move so alike that α, β and τ are"
        " not identifiable." + _excluded_line(segment)
    )
    headways = headway_findings(segment.vehicles, estimate.parameters)
    findings = (*headways, *quality.findings, *estimate.findings)
    show_warnings(messages(findings, segment), "this window")
    if segment.findings:
        with st.expander("Changes to the data", icon=":material/build:"):
            st.markdown(bullets(messages(segment.findings, segment)))


def _excluded_line(segment: Segment) -> str:
    if not segment.excluded_regimes:
        return ""
    return (
        f" Without {', '.join(segment.excluded_regimes)}: the estimate and the condition number;"
        " all other figures are of all instants."
    )
