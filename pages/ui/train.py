"""The page Train: preset, options, the buttons that start and stop, and what is learned."""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import streamlit as st

from accpinn.channels import PARAMETERS
from accpinn.errors import ConfigError
from accpinn.methods.fit import Fit
from accpinn.methods.pinn.config import PRESETS, STARTS, PinnConfig
from accpinn.methods.pinn.method import WarmStart
from accpinn.tasks.task import Status, Task
from pages.ui.components import frame, show
from pages.ui.components.monitor import monitor, stop_button
from pages.ui.components.widgets import bound, segments, select
from pages.ui.results import banner, show_result, show_saved_result, show_training
from pages.ui.runs import show_runs
from pages.ui.session.resources import store
from pages.ui.session.workspace import Workspace

PRESET_LINES = {
    "fast": "A few seconds: output layer and α, β, τ solved exactly, hidden layers trained.",
    "calibrated": "A few seconds: the network's evidence in place of its loss removes the bias.",
    "paper": "As published, all by gradient: many minutes. Stop and continue at any time.",
}
CONTINUES = (
    "A training of this window with these settings, here or in another session, was stopped there;"
    " the server keeps its checkpoint."
)


def show_page() -> None:
    """Draw the page."""
    workspace = frame.begin("Train")
    _show_page(workspace)
    show_runs(workspace)


def _show_page(workspace: Workspace) -> None:
    """All but the list of runs."""
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
    show.not_acc(segment)
    _controls(workspace)
    _continue_button(workspace)
    if training := workspace.training:
        monitor(workspace, training, lambda running: _show_run(workspace, training, running))
    elif snapshot:
        show_saved_result(workspace, snapshot)
    if workspace.fit and st.button(
        "Next: do these vehicles amplify disturbances?", icon=":material/arrow_forward:",
        key="train_next", type="tertiary",
    ):  # fmt: skip
        workspace.choose_source("fit")
        frame.go(frame.STABILITY, workspace)


def _show_run(workspace: Workspace, training: Task[Fit], running: bool) -> None:
    """The training; once it is over, what was learned comes first."""
    if not running:
        show_result(workspace)
    show_training(training, workspace.true_parameters, running)


def _controls(workspace: Workspace) -> None:
    """Preset, options and the buttons."""
    preset = workspace.preset
    with st.container(horizontal=True, vertical_alignment="center"):
        segments(
            "Preset", {name: name.capitalize() for name in PRESETS}, preset, "train_preset",
            lambda name: setattr(workspace, "preset", name),
        )  # fmt: skip
        place = st.container(horizontal=True, width="content")
        changed = " With your options." if workspace.settings.get(preset) else ""
        st.caption(PRESET_LINES[preset] + changed, width="stretch")
    with st.expander("Options", icon=":material/tune:"):
        _options(workspace)
    config = show.attempt(lambda: chosen_config(workspace))
    with place:
        _buttons(workspace, config)


def chosen_config(workspace: Workspace) -> PinnConfig:
    """The preset with the user's changes.

    Raises:
        ConfigError: a setting outside its range, as one sentence.
    """
    changes = workspace.settings.get(workspace.preset, {})
    return PinnConfig.from_json(PRESETS[workspace.preset].to_json() | changes)


def _buttons(workspace: Workspace, config: PinnConfig | None) -> None:
    """Start, Stop or Continue: whichever makes sense now."""
    training = workspace.training
    if training and training.is_active:
        stop_button(training, "Stop training", "train_stop")
        return
    # From here an earlier training would go on; None where there is none.
    asked = workspace.request(config, _stopped_warm(workspace, config)) if config else None
    at = asked.resume_iteration(store()) if asked else None
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
        on_click=_start,
        args=(workspace,),
        help=CONTINUES if at is not None else None,
    )
    if at is not None:
        st.button(
            "Start anew", icon=":material/restart_alt:", key="train_anew", on_click=_start,
            args=(workspace, False, True),
        )  # fmt: skip


def _continue_button(workspace: Workspace) -> None:
    """Train on from the weights of the snapshot shown, where it has some and the data are here."""
    training = workspace.training
    if workspace.warm is None or (training and training.is_active):
        return
    st.button(
        "Continue from these weights", icon=":material/resume:", key="train_warm", on_click=_start,
        args=(workspace, True),
        help="Trains this window with the preset above; in place of random weights it begins with"
        " those of the snapshot.",
    )  # fmt: skip


def _start(workspace: Workspace, from_snapshot: bool = False, anew: bool = False) -> None:
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
            warm = _stopped_warm(workspace, config)
        workspace.train(config, warm, anew)


def _stopped_warm(workspace: Workspace, config: PinnConfig) -> WarmStart | None:
    """The weights with which the stopped training began: going on is the same request."""
    training = workspace.training
    asked = training.request if training and training.status is Status.STOPPED else None
    if asked is None or asked.config != config or asked.resume_iteration(store()) is None:
        return None
    return asked.warm


def _options(workspace: Workspace) -> None:
    """All settings of the preset."""
    fields = _Fields(workspace)
    rows = [st.columns(4) for _ in range(4)]
    fields.one("iterations", "Iterations, at most", rows[0][0], step=100)
    fields.one("seed", "Seed", rows[0][1], step=1)
    fields.one("learning_rate", "Learning rate", rows[0][2], step=0.001, format="%g")
    fields.several("weight_initial", ("R, weight of the first instant (Ψ_R)",), rows[0][3:])
    fields.start(rows[1])
    physics = ("Q, weight of dp/dt in Ψ_F", "Q, weight of dv/dt in Ψ_F")
    fields.several("weight_physics", physics, rows[2][:2])
    data = ("S, weight of gaps in Ψ_D", "S, weight of speeds in Ψ_D")
    fields.several("weight_data", data, rows[2][2:])
    left, right, _, last = rows[3]
    if workspace.preset == "paper":
        fields.one("lbfgs_iterations", "L-BFGS iterations after Adam", left, step=100)
        fields.one("test_share", "Share kept for testing", right, step=0.05, format="%g")
    else:
        fields.one("highest_frequency", "Highest frequency [Hz]", left, step=0.05, format="%g")
        fields.one("batch", "Instants per iteration", right, step=100)
    with last:
        st.space("stretch")
        st.button("Back to the preset", on_click=fields.changes.clear, icon=":material/undo:")


class _Fields:
    """Number inputs for the settings of one preset; only what differs from it is kept."""

    def __init__(self, workspace: Workspace) -> None:
        self.changes = workspace.settings.setdefault(workspace.preset, {})
        self._preset = workspace.preset
        self._default = PRESETS[workspace.preset].to_json()

    def _value(self, name: str) -> Any:
        return self.changes.get(name, self._default[name])

    def one(self, name: str, label: str, column: Any, **look: Any) -> None:
        """One number, whole or not as the preset has it."""

        def changed(value: float) -> None:
            self.changes[name] = value

        shown = bound(f"train_{self._preset}_{name}", self._value(name), changed)
        column.number_input(label, **shown, **look)

    def several(self, name: str, labels: tuple[str, ...], columns: Sequence[Any]) -> None:
        """A setting of several numbers, or of one that is a float."""
        now = self._value(name)
        single = not isinstance(now, list | tuple)
        values = [float(now)] if single else [float(value) for value in now]
        for at, (label, column) in enumerate(zip(labels, columns, strict=True)):

            def changed(value: float, at: int = at) -> None:
                values[at] = float(value)
                self.changes[name] = values[0] if single else tuple(values)

            shown = bound(f"train_{self._preset}_{name}_{at}", values[at], changed)
            column.number_input(label, **shown, step=0.1, format="%g")

    def start(self, columns: Sequence[Any]) -> None:
        """Initial values, each by itself or one of five sets."""
        now = tuple(float(value) for value in self._value("initial"))
        starts = [*(tuple(start.values.tolist()) for start in STARTS), now]
        select(
            "Start from", {start: "α {:g}, β {:g}, τ {:g}".format(*start) for start in starts},
            now, f"train_{self._preset}_start",
            lambda initial: self.changes.update(initial=initial), place=columns[0],
        )  # fmt: skip
        labels = tuple(f"Initial {parameter.heading}" for parameter in PARAMETERS)
        self.several("initial", labels, columns[1:])
