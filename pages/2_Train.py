"""Train: learn α, β, τ with the physics-inspired neural network, and watch it learn."""

import streamlit as st

from accpinn.jobs import Job, Status
from accpinn.pinn.config import PinnConfig
from pages.shared import frame
from pages.shared.live import watch
from pages.shared.results import show_result
from pages.shared.settings import checked_config, choose_preset, options, preset_line
from pages.shared.text import plain
from pages.shared.workspace import Workspace, trainings


def main() -> None:
    workspace = frame.begin("Train")
    segment = workspace.segment
    if segment is None:
        no_segment(workspace)
        return
    first, last = segment.labels[0], segment.labels[-1]
    case = f" · Case {workspace.case}" if segment.followers > 1 else ""
    st.caption(
        plain(f"{segment.source} · {segment.start:g}–{segment.start + segment.duration:g} s")
        + f" · {plain(first)} to {plain(last)}{case}"
    )
    controls(workspace)
    if workspace.job:
        watch(workspace.job, workspace.true_parameters)
        if not workspace.job.is_active:
            show_result(workspace.job, workspace.true_parameters)


def no_segment(workspace: Workspace) -> None:
    """The way to something that can be trained."""
    if workspace.recording is None:
        st.info("Nothing to train on yet: first open a recording.", icon=":material/info:")
    else:
        st.warning(
            f"The window cannot be used yet. {plain(workspace.fault)}", icon=":material/warning:"
        )
    frame.link(frame.DATA, "Go to Data", workspace, "arrow_forward")


def controls(workspace: Workspace) -> None:
    """Preset, options and the buttons."""
    with st.container(horizontal=True, vertical_alignment="center"):
        choose_preset(workspace)
        place = st.container(horizontal=True, width="content")
        st.caption(preset_line(workspace), width="stretch")
    with st.expander("Options", icon=":material/tune:"):
        options(workspace)
    config = checked_config(workspace)
    with place:
        buttons(workspace, config)


def buttons(workspace: Workspace, config: PinnConfig | None) -> None:
    """Start, Stop or Continue: whichever makes sense now."""
    job = workspace.job
    if job and job.is_active:
        st.button(
            "Stop training",
            icon=":material/stop:",
            key="train_stop",
            disabled=job.is_stopping,
            on_click=trainings().stop,
            args=(job,),
        )
        return
    continues = job is not None and job.status is Status.STOPPED and job.request.config == config
    label, icon = ("Continue", "resume") if continues else ("Start training", "play_arrow")
    st.button(
        label,
        type="primary" if not is_done(job, config) else "secondary",
        icon=f":material/{icon}:",
        key="train_start",
        disabled=config is None,
        on_click=workspace.train,
        args=(config,),
    )


def is_done(job: Job | None, config: PinnConfig | None) -> bool:
    """Whether just this was trained already."""
    return job is not None and job.status is Status.DONE and job.request.config == config


main()
