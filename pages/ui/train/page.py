"""The page Train: preset, options, the buttons that start and stop, and what is learned."""

from collections.abc import Sequence
from contextlib import suppress

import streamlit as st

from accpinn.errors import ConfigError
from accpinn.methods import least_squares
from accpinn.methods.pinn.config import PinnConfig
from accpinn.model.cthp import Case, Parameters
from accpinn.results.figures.live import TERMS, LiveChart, live_history, live_motion
from accpinn.results.figures.style import LEADER, MODEL, SERIES
from accpinn.segment.segment import Segment
from accpinn.study.result import Result
from accpinn.tasks.task import Status, Task
from accpinn.units import Seconds
from pages.ui.components import frame, show
from pages.ui.components.monitor import monitor, stop_button
from pages.ui.components.widgets import segments
from pages.ui.data.validation import show_validation
from pages.ui.result.saved import banner, recording_needed
from pages.ui.result.view import show_result
from pages.ui.runs import show_runs
from pages.ui.session.resources import store
from pages.ui.session.workspace import Workspace
from pages.ui.train.options import show_options

PRESET_LINES = {
    "calibrated": "A few seconds: the network's evidence, not its loss, is maximised: no bias.",
    "fast": "A second: the paper's loss, solved exactly for the output layer and α, β, τ; biased.",
    "paper": "As published, all by gradient: many minutes. Stop and continue at any time.",
}
FIRST_DRAWING: Seconds = 1.0
"""Training before the first curves, in s: a short one would be slowed by drawing it."""
CONTINUES = (
    "A training of this window with these settings, here or in another session, was stopped there;"
    " the server keeps its checkpoint."
)


def show_page() -> None:
    """Draw the page."""
    workspace = frame.begin("Train")
    _show_page(workspace)
    with st.container(key="later_3_runs"):
        show_runs(workspace)


def _show_page(workspace: Workspace) -> None:
    """All but the list of runs."""
    segment, result, training = workspace.segment, workspace.result, workspace.training
    if segment is None and result is None:
        frame.empty_state(workspace, "Nothing to train on")
        return
    banner(workspace)
    if about := workspace.info:
        st.caption(frame.segment_line(about, workspace.case))
        show.not_acc(about)
    if segment:
        # On a narrow screen a result comes before what led to it, while a training can be stopped.
        done = result is not None and not (training and training.is_active)
        with st.container(key="later_1_train" if done else "train_controls"):
            _controls(workspace)
    else:
        recording_needed(workspace, "To train on, the page needs")
    if training and segment:
        monitor(workspace, training, lambda running: _show_run(workspace, segment, running))
    elif result:
        _show_result(workspace, result)


def _show_run(workspace: Workspace, segment: Segment, running: bool) -> None:
    """The training, or what was learned once it is over."""
    result, training = workspace.result, workspace.training
    if running and training:
        _show_live(training, segment, workspace.case, workspace.true_parameters)
    elif result:
        _show_result(workspace, result)


def _show_result(workspace: Workspace, result: Result) -> None:
    is_saved = result is workspace.restored
    show_result(
        workspace, result, "train", lambda: result if is_saved else workspace.as_snapshot(),
        (lambda: _next_button(workspace)) if workspace.segment else None,
        {"Validation": lambda: _show_validation(workspace)} if workspace.segment else {},
    )  # fmt: skip


def _show_live(
    training: Task[Result], segment: Segment, case: Case, truth: Parameters | None
) -> None:
    """What is known so far of a training that runs.

    Args:
        training: whose history is shown as far as it is known.
        segment: its data.
        case: "I" or "II".
        truth: the true parameters, where they are known.
    """
    history = training.history()
    if history is None or history.seconds[-1] <= FIRST_DRAWING:
        return
    solved = least_squares.fit(segment, case).parameters
    loss, alpha, beta, tau = live_history(history, segment.info, truth, solved)
    show.vehicle_key(segment, bool(truth), segment.shares(case), with_solved=True)
    show.key(zip((f"loss: {name}" for name in TERMS), (LEADER, *SERIES), strict=True))
    _show_row((loss, alpha))
    _show_row((beta, tau))
    if curves := training.surrogate:
        # Widgets must not stand in what is drawn again and again: it is the first follower's.
        show.key(((f"data of {segment.labels[1]}", LEADER), ("the network now", MODEL)))
        _show_row(live_motion(segment, 0, curves))


def _show_row(charts: Sequence[LiveChart]) -> None:
    colour = show.ink(st.context.theme.type)
    axes = {"config": {"axis": {"labelColor": colour, "titleColor": colour}}} if colour else {}
    for column, chart in zip(st.columns(len(charts)), charts, strict=True):
        column.vega_lite_chart(chart.data, chart.spec | axes, key=f"train_live_{chart.name}")


def _show_validation(workspace: Workspace) -> None:
    """What the learned parameters do in another window, once the user chose one."""
    if workspace.validation is None:
        st.caption(
            "Choose a second window, or another recording of the same vehicles, on page Data: the"
            " learned parameters are then simulated there."
        )
        frame.link(frame.DATA, "Choose it on Data", workspace)
        return
    show_validation(workspace)


def _next_button(workspace: Workspace) -> None:
    if st.button(
        "Next: do these vehicles amplify disturbances?", icon=":material/arrow_forward:",
        key="train_next", type="primary",
    ):  # fmt: skip
        workspace.choose_source("fit")
        frame.go(frame.STABILITY, workspace)


def _controls(workspace: Workspace) -> None:
    """Preset, options and the buttons."""
    preset = workspace.preset
    with st.container(horizontal=True, vertical_alignment="center"):
        segments(
            "Preset", {name: name.capitalize() for name in PRESET_LINES}, preset, "train_preset",
            lambda name: setattr(workspace, "preset", name),
        )  # fmt: skip
        place = st.container(horizontal=True, width="content")
        st.toggle("Options", key="train_options", help="All settings of the preset.")
        changed = " With your options." if workspace.settings.get(preset) else ""
        st.caption(PRESET_LINES[preset] + changed, width="stretch")
    if st.session_state.get("train_options"):
        with st.container(border=True):
            show_options(workspace)
    config = show.attempt(lambda: workspace.config)
    with place:
        _buttons(workspace, config)


def _buttons(workspace: Workspace, config: PinnConfig | None) -> None:
    """Start, Stop or Continue: whichever makes sense now."""
    training = workspace.training
    if training and training.is_active:
        stop_button(training, "Stop training", "train_stop")
        return
    asked = workspace.analysis(config) if config else None
    at = store().stopped_at(asked) if asked else None
    label, icon = ("Start training", "play_arrow")
    if at is not None:
        label, icon = (f"Continue from iteration {at:,}", "resume")
    answered = training.analysis if training and training.status is Status.DONE else None
    done = answered and asked and answered.key == asked.key
    st.button(
        label,
        type="secondary" if done else "primary",
        icon=f":material/{icon}:",
        key="train_start",
        disabled=config is None,
        on_click=_start,
        args=(workspace,),
        help=CONTINUES if at is not None else None,
    )
    if at is not None:
        st.button(
            "Start anew", icon=":material/restart_alt:", key="train_anew", on_click=_start,
            args=(workspace, True),
        )  # fmt: skip


def _start(workspace: Workspace, anew: bool = False) -> None:
    """Train with the settings at the moment of the click, also when they were not drawn yet.

    Args:
        workspace: the session.
        anew: begin at the first iteration, also where an earlier training stopped later.
    """
    with suppress(ConfigError):  # the page shows what is wrong with a setting
        workspace.train(workspace.config, anew)
