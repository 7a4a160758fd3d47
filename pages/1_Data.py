"""Data: open a recording, choose vehicles and a window, preview what it holds."""

from contextlib import suppress

import streamlit as st

from accpinn.errors import ConfigError
from accpinn.results.messages import messages
from pages.ui.components import frame
from pages.ui.components.show import escape_markdown
from pages.ui.data import window
from pages.ui.data.sources import choose_source
from pages.ui.results import banner, show_data
from pages.ui.train import chosen_config


def main() -> None:
    workspace = frame.begin("Data", "Open a recording, choose who follows whom, and when.")
    recording = workspace.recording
    if recording is None:
        if workspace.snapshot:
            show_data(workspace, workspace.snapshot)
        with st.container(border=True):
            choose_source(workspace)
        window.show_preview(workspace)
        return
    banner(workspace)
    with st.expander(
        f"Open another recording instead of {escape_markdown(recording.source)}",
        icon=":material/folder_open:",
    ):
        choose_source(workspace)
    st.markdown(window.describe(recording))
    window.show_warnings(messages(recording.findings, recording), "this recording")
    controls, chart = st.columns((1, 2.6), gap="medium")
    with controls:
        window.choose_vehicles(workspace, recording)
        window.choose_window(workspace, recording)
        st.caption("Or drag over the chart to set the window.")
        if st.button(
            "Train on this window",
            type="primary",
            icon=":material/play_arrow:",
            width="stretch",
            disabled=workspace.segment is None,
        ):
            with suppress(ConfigError):  # the Train page shows what is wrong with a setting
                workspace.train(chosen_config(workspace))
            frame.go(frame.TRAIN, workspace)
    with chart:
        window.show_overview(workspace, recording)
    window.show_preview(workspace)
    window.show_regimes(workspace, recording)


main()
