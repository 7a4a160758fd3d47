"""Buttons that start, stop and continue a training."""

from contextlib import suppress

import streamlit as st

from accpinn.errors import ConfigError
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.method import WarmStart
from accpinn.tasks.task import Status
from pages.ui.components.messages import attempt
from pages.ui.components.monitor import stop_button
from pages.ui.session.resources import store
from pages.ui.session.workspace import Workspace
from pages.ui.train.settings import (
    choose_preset,
    chosen_config,
    options,
    preset_line,
)

CONTINUES = (
    "A training of this window with these settings, here or in another session, was stopped there;"
    " the server keeps its checkpoint."
)


def controls(workspace: Workspace) -> None:
    """Preset, options and the buttons."""
    with st.container(horizontal=True, vertical_alignment="center"):
        choose_preset(workspace)
        place = st.container(horizontal=True, width="content")
        st.caption(preset_line(workspace), width="stretch")
    with st.expander("Options", icon=":material/tune:"):
        options(workspace)
    config = attempt(lambda: chosen_config(workspace))
    with place:
        buttons(workspace, config)


def buttons(workspace: Workspace, config: PinnConfig | None) -> None:
    """Start, Stop or Continue: whichever makes sense now."""
    training = workspace.training
    if training and training.is_active:
        stop_button(training, "Stop training", "train_stop")
        return
    at = resume_iteration(workspace, config, stopped_warm(workspace, config)) if config else None
    label, icon = ("Start training", "play_arrow")
    if at is not None:
        label, icon = (f"Continue from iteration {at:,}", "resume")
    done = training and training.status is Status.DONE and training.request
    st.button(
        label,
        type="secondary" if done and done.config == config else "primary",
        icon=f":material/{icon}:",
        key="train_start",
        disabled=config is None,
        on_click=start,
        args=(workspace,),
        help=CONTINUES if at is not None else None,
    )
    if at is not None:
        st.button(
            "Start anew", icon=":material/restart_alt:", key="train_anew", on_click=start,
            args=(workspace, False, True),
        )  # fmt: skip


def continue_button(workspace: Workspace) -> None:
    """Train on from the weights of the snapshot shown, where it has some and the data are here."""
    snapshot, training = workspace.snapshot, workspace.training
    if snapshot is None or not snapshot.fit.arrays or (training and training.is_active):
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
    """Train with the settings at the moment of the click, also when they were not drawn yet.

    Args:
        workspace: the session.
        from_snapshot: begin with the weights of the snapshot shown.
        anew: begin at the first iteration, also where an earlier training stopped later.
    """
    with suppress(ConfigError):  # the page shows what is wrong with a setting
        config = chosen_config(workspace)
        warm = workspace.warm if from_snapshot else None
        if not (from_snapshot or anew):
            warm = stopped_warm(workspace, config)
        workspace.train(config, warm, anew)


def resume_iteration(
    workspace: Workspace, config: PinnConfig, warm: WarmStart | None
) -> int | None:
    """The iteration from which an earlier training would go on; None where there is none."""
    request = workspace.request(config, warm)
    return request.resume_iteration(store()) if request else None


def stopped_warm(workspace: Workspace, config: PinnConfig | None) -> WarmStart | None:
    """The weights with which the stopped training began: going on is the same request."""
    training = workspace.training
    asked = training.request if training and training.status is Status.STOPPED else None
    if asked is None or asked.config != config or asked.resume_iteration(store()) is None:
        return None
    return asked.warm
