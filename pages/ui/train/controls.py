"""What starts, stops and continues a training."""

from contextlib import suppress
from typing import TYPE_CHECKING

import streamlit as st

from accpinn.errors import ConfigError
from accpinn.methods.pinn.config import PinnConfig
from accpinn.tasks.job import Job
from accpinn.tasks.task import Status
from pages.ui.session.resources import task_queue
from pages.ui.session.workspace import Workspace
from pages.ui.train.settings import (
    checked_config,
    choose_preset,
    chosen_config,
    options,
    preset_line,
)

if TYPE_CHECKING:
    from accpinn.methods.pinn.method import WarmStart

CONTINUES = (
    "A training of this window with these settings, here or in another session, was stopped there;"
    " the server keeps where it stood."
)


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
            on_click=task_queue().stop,
            args=(job,),
        )
        return
    at = None
    if config and workspace.segment:
        warm = stopped_warm(workspace, config)
        at = task_queue().resume_iteration(workspace.segment, workspace.case, config, warm)
    label, icon = ("Start training", "play_arrow")
    if at is not None:
        label, icon = (f"Continue from iteration {at:,}", "resume")
    st.button(
        label,
        type="primary" if not is_done(job, config) else "secondary",
        icon=f":material/{icon}:",
        key="train_start",
        disabled=config is None,
        on_click=start,
        args=(workspace,),
        help=CONTINUES if at is not None else None,
    )
    if at is not None:
        st.button(
            "Start anew",
            icon=":material/restart_alt:",
            key="train_anew",
            on_click=start,
            args=(workspace, False, True),
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


def start(workspace: Workspace, from_snapshot: bool = False, anew: bool = False) -> None:
    """Train with what is chosen at the moment of the click, also when that was not drawn yet."""
    with suppress(ConfigError):  # the page says what is wrong with a setting
        config = chosen_config(workspace)
        warm = workspace.warm if from_snapshot else None
        if not (from_snapshot or anew):
            warm = stopped_warm(workspace, config)
        workspace.train(config, warm, anew)


def stopped_warm(workspace: Workspace, config: PinnConfig) -> "WarmStart | None":
    """What the training that was stopped had begun with, so that going on is the same request."""
    job = workspace.job
    if job is None or job.status is not Status.STOPPED or job.request.config != config:
        return None
    asked = job.request
    if task_queue().resume_iteration(asked.segment, asked.case, config, asked.warm) is None:
        return None
    return asked.warm


def is_done(job: Job | None, config: PinnConfig | None) -> bool:
    """Whether just this was trained already."""
    return job is not None and job.status is Status.DONE and job.request.config == config
