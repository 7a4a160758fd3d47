"""What starts, stops and continues a training."""

from contextlib import suppress

import streamlit as st

from accpinn.errors import ConfigError
from accpinn.jobs import Job, Status
from accpinn.pinn.config import PinnConfig
from pages.shared.server import trainings
from pages.shared.settings import (
    checked_config,
    choose_preset,
    chosen_config,
    options,
    preset_line,
)
from pages.shared.workspace import Workspace


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
        on_click=start,
        args=(workspace,),
    )


def continue_button(workspace: Workspace) -> None:
    """Train on from the weights of the snapshot shown, where it has some and the data are here."""
    snapshot, job = workspace.snapshot, workspace.job
    if snapshot is None or not snapshot.fit.arrays or (job and job.is_active):
        return
    st.button(
        "Continue from these weights",
        icon=":material/resume:",
        key="train_warm",
        on_click=start,
        args=(workspace, True),
        help="Trains this window with the preset above; in place of random weights it begins with"
        " those of the snapshot.",
    )


def start(workspace: Workspace, from_snapshot: bool = False) -> None:
    """Train with what is chosen at the moment of the click, also when that was not drawn yet."""
    with suppress(ConfigError):  # the page says what is wrong with a setting
        workspace.train(chosen_config(workspace), from_snapshot)


def is_done(job: Job | None, config: PinnConfig | None) -> bool:
    """Whether just this was trained already."""
    return job is not None and job.status is Status.DONE and job.request.config == config
