"""The preset and its options, as widgets whose values the workspace holds."""

from collections.abc import Sequence
from typing import Any

import streamlit as st

from accpinn.channels import PARAMETERS
from accpinn.methods.pinn.config import PRESETS, STARTS, PinnConfig
from pages.ui.components.widgets import number, segments, select
from pages.ui.session.workspace import Workspace

PRESET_LINES = {
    "fast": "A few seconds: output layer and α, β, τ solved exactly, hidden layers trained.",
    "paper": "As published, all by gradient: many minutes. Stop and continue at any time.",
}


def choose_preset(workspace: Workspace) -> None:
    """Fast or paper."""
    segments(
        "Preset", {name: name.capitalize() for name in PRESETS}, workspace.preset, "train_preset",
        lambda name: setattr(workspace, "preset", name),
    )  # fmt: skip


def preset_line(workspace: Workspace) -> str:
    """The preset in a sentence, and whether the user changed it."""
    changed = workspace.settings.get(workspace.preset)
    return PRESET_LINES[workspace.preset] + (" With your options." if changed else "")


def chosen_config(workspace: Workspace) -> PinnConfig:
    """The preset with the user's changes.

    Raises:
        ConfigError: a setting outside its range, as one sentence.
    """
    changes = workspace.settings.get(workspace.preset, {})
    return PinnConfig.from_json(PRESETS[workspace.preset].to_json() | changes)


def options(workspace: Workspace) -> None:
    """All settings of the preset."""
    fields = _Fields(workspace)
    top = st.columns(4)
    fields.one("iterations", "Iterations, at most", top[0], step=100)
    fields.one("seed", "Seed", top[1], step=1)
    fields.one("learning_rate", "Learning rate", top[2], step=0.001, format="%g")
    fields.several("weight_initial", ("R, weight of the first instant (Ψ_R)",), top[3:])
    fields.start(st.columns(4))
    weights = st.columns(4)
    physics = ("Q, weight of dp/dt in Ψ_F", "Q, weight of dv/dt in Ψ_F")
    fields.several("weight_physics", physics, weights[:2])
    data = ("S, weight of gaps in Ψ_D", "S, weight of speeds in Ψ_D")
    fields.several("weight_data", data, weights[2:])
    bottom = st.columns(4)
    if workspace.preset == "paper":
        fields.one("lbfgs_iterations", "L-BFGS iterations after Adam", bottom[0], step=100)
        fields.one("test_share", "Share kept for testing", bottom[1], step=0.05, format="%g")
    else:
        fields.one("highest_frequency", "Highest frequency [Hz]", bottom[0], step=0.05, format="%g")
        fields.one("batch", "Instants per iteration", bottom[1], step=100)
    with bottom[3]:
        st.space("stretch")
        st.button("Back to the preset", on_click=fields.reset, icon=":material/undo:")


class _Fields:
    """Number inputs for the settings of one preset; only what differs from it is kept."""

    def __init__(self, workspace: Workspace) -> None:
        self._preset = workspace.preset
        self._default = PRESETS[workspace.preset].to_json()
        self._changes = workspace.settings.setdefault(workspace.preset, {})

    def _value(self, name: str) -> Any:
        return self._changes.get(name, self._default[name])

    def _key(self, name: str) -> str:
        return f"train_{self._preset}_{name}"

    def one(self, name: str, label: str, column: Any, **look: Any) -> None:
        """One number, whole or not as the preset has it."""

        def changed(value: float) -> None:
            self._changes[name] = value

        number(label, self._value(name), self._key(name), changed, column, **look)

    def several(self, name: str, labels: tuple[str, ...], columns: Sequence[Any]) -> None:
        """A setting of several numbers, or of one that is a float."""
        now = self._value(name)
        single = not isinstance(now, list | tuple)
        values = [float(now)] if single else [float(value) for value in now]
        for at, (label, column) in enumerate(zip(labels, columns, strict=True)):

            def changed(value: float, at: int = at) -> None:
                values[at] = float(value)
                self._changes[name] = values[0] if single else tuple(values)

            key = f"{self._key(name)}_{at}"
            number(label, values[at], key, changed, column, step=0.1, format="%g")

    def start(self, columns: Sequence[Any]) -> None:
        """Initial values, each by itself or one of five sets."""
        now = tuple(float(value) for value in self._value("initial"))
        starts = [tuple(start.values.tolist()) for start in STARTS]
        select(
            "Start from", starts if now in starts else [*starts, now], now, self._key("start"),
            lambda initial: self._changes.update(initial=initial),
            lambda initial: "α {:g}, β {:g}, τ {:g}".format(*initial), place=columns[0],
        )  # fmt: skip
        labels = tuple(f"Initial {parameter.heading}" for parameter in PARAMETERS)
        self.several("initial", labels, columns[1:])

    def reset(self) -> None:
        self._changes.clear()
