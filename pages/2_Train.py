"""Train: learn α, β, τ with the physics-inspired neural network, and watch it learn."""

import streamlit as st

from pages.ui.components import frame
from pages.ui.components.monitor import monitor
from pages.ui.restored import banner, show_saved_result
from pages.ui.train.controls import continue_button, controls
from pages.ui.train.results import show_result, show_training


def main() -> None:
    workspace = frame.begin("Train")
    segment, snapshot = workspace.segment, workspace.snapshot
    if segment is None:
        if snapshot:
            banner(workspace)
            show_saved_result(workspace, snapshot)
        else:
            frame.empty_state(workspace, "Nothing to train on")
        return
    banner(workspace)
    st.caption(frame.segment_line(segment, workspace.case, vehicles=True))
    controls(workspace)
    continue_button(workspace)
    if training := workspace.training:
        truth = workspace.true_parameters
        monitor(workspace, training, lambda running: show_training(training, truth, running))
        if not training.is_active:
            show_result(workspace)
    elif snapshot:
        show_saved_result(workspace, snapshot)
    if workspace.fit:
        frame.link(frame.STABILITY, "Next: do these vehicles amplify disturbances?", workspace)


main()
