"""What a recording says of itself, and what is wrong with it."""

import streamlit as st

from accpinn.recordings.recording import Recording
from pages.ui.components.text import bullets, escape_markdown

SHOWN = 3
"""Sentences that are shown without being asked for."""


def describe(recording: Recording) -> str:
    """The metadata in one line."""
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


def show_warnings(warnings: tuple[str, ...], about: str) -> None:
    """The first few openly, the rest on demand."""
    if not warnings:
        return
    st.warning(bullets(warnings[:SHOWN]), icon=":material/warning:")
    if warnings[SHOWN:]:
        with st.expander(f"{len(warnings) - SHOWN} more about {about}"):
            st.markdown(bullets(warnings[SHOWN:]))
