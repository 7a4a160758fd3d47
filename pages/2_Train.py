"""Train: learn α, β, τ with the physics-inspired neural network, and watch it learn."""

import streamlit as st

from pages.ui.components import frame
from pages.ui.components.empty_state import show_missing
from pages.ui.components.monitor import watch
from pages.ui.components.text import escape_markdown, left_out
from pages.ui.snapshots.listing import banner
from pages.ui.snapshots.showing import show_result as show_saved
from pages.ui.train.controls import continue_button, controls
from pages.ui.train.results import show_result


def main() -> None:
    workspace = frame.begin("Train")
    segment, snapshot = workspace.segment, workspace.snapshot
    if segment is None:
        if snapshot:
            banner(workspace)
            show_saved(workspace, snapshot)
        else:
            show_missing(workspace, "Nothing to train on")
        return
    banner(workspace)
    first, last = segment.labels[0], segment.labels[-1]
    case = f" · Case {workspace.case}" if segment.followers > 1 else ""
    st.caption(
        escape_markdown(f"{segment.source} · {segment.window}")
        + f" · {escape_markdown(first)} to {escape_markdown(last)}{case}"
        + left_out(segment.excluded_regimes)
    )
    controls(workspace)
    continue_button(workspace)
    if workspace.job:
        watch(workspace.job, workspace.true_parameters)
        if not workspace.job.is_active:
            show_result(workspace)
    elif snapshot:
        show_saved(workspace, snapshot)
    if workspace.fit:
        frame.link(frame.STABILITY, "Next: do these vehicles amplify disturbances?", workspace,
                   "arrow_forward")  # fmt: skip


main()
