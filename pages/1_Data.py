"""Data: open a recording, choose vehicles and a window, see what it can tell."""

from contextlib import suppress

import streamlit as st

from accpinn.errors import ConfigError
from accpinn.results.messages import messages
from pages.ui.components import frame
from pages.ui.components.text import escape_markdown
from pages.ui.data.metadata import describe, show_warnings
from pages.ui.data.preview import show_segment
from pages.ui.data.regimes import show_regimes
from pages.ui.data.sources import choose_source
from pages.ui.data.window_picker import choose_vehicles, choose_window, overview
from pages.ui.snapshots.listing import banner
from pages.ui.snapshots.showing import show_data
from pages.ui.train.settings import chosen_config


def main() -> None:
    workspace = frame.begin("Data", "Open a recording, choose who follows whom, and when.")
    recording = workspace.recording
    if recording is None:
        if workspace.snapshot:
            show_data(workspace, workspace.snapshot)
        with st.container(border=True):
            choose_source(workspace)
        show_segment(workspace)
        return
    banner(workspace)
    with st.expander(
        f"Open another recording instead of {escape_markdown(recording.source)}",
        icon=":material/folder_open:",
    ):
        choose_source(workspace)
    st.markdown(describe(recording))
    show_warnings(messages(recording.findings, recording), "this recording")
    controls, chart = st.columns((1, 2.6), gap="medium")
    with controls:
        choose_vehicles(workspace, recording)
        choose_window(workspace, recording)
        st.caption("Or drag over the chart to set the window.")
        if st.button(
            "Train on this window",
            type="primary",
            icon=":material/play_arrow:",
            width="stretch",
            disabled=workspace.segment is None,
        ):
            with suppress(ConfigError):  # the Train page says what is wrong with a setting
                workspace.train(chosen_config(workspace))
            frame.go(frame.TRAIN, workspace)
    with chart:
        overview(workspace, recording)
    show_segment(workspace)
    show_regimes(workspace, recording)


main()
