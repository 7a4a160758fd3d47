"""Train: learn α, β, τ with the physics-inspired neural network, and watch it learn."""

import streamlit as st

from pages.shared import frame
from pages.shared.controls import continue_button, controls
from pages.shared.live import watch
from pages.shared.missing import show_missing
from pages.shared.results import show_result
from pages.shared.snapshots_listing import banner
from pages.shared.snapshots_showing import show_result as show_saved
from pages.shared.text import left_out, plain


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
        plain(f"{segment.source} · {segment.start:g}–{segment.start + segment.duration:g} s")
        + f" · {plain(first)} to {plain(last)}{case}"
        + left_out(segment.left_out_regimes)
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
