"""How to train: the preset and its options, as widgets that the workspace remembers."""

from typing import Any

import streamlit as st

from accpinn.errors import ConfigError
from accpinn.methods.pinn.config import PRESETS, STARTS, PinnConfig, preset
from accpinn.model.cthp import Parameters
from pages.ui.components.text import escape_markdown
from pages.ui.session.workspace import Workspace, sync_widget

PRESET_LINES = {
    "fast": "A few seconds: output layer and α, β, τ solved exactly, hidden layers trained.",
    "paper": "As published, all by gradient: many minutes. Stop and continue at any time.",
}


def choose_preset(workspace: Workspace) -> None:
    """Fast or paper."""

    def changed() -> None:
        workspace.preset = st.session_state["train_preset"]

    st.segmented_control(
        "Preset",
        list(PRESETS),
        format_func=str.capitalize,
        default=workspace.preset,
        key=sync_widget("train_preset", workspace.preset),
        on_change=changed,
        required=True,
        label_visibility="collapsed",
    )


def chosen_config(workspace: Workspace) -> PinnConfig:
    """The preset with the user's changes.

    Raises:
        ConfigError: a setting outside its range, as one sentence.
    """
    changes = dict(workspace.settings.get(workspace.preset, {}))
    if "initial" in changes:
        changes["initial"] = Parameters.of(changes["initial"])
    return preset(workspace.preset, **changes)


def checked_config(workspace: Workspace) -> PinnConfig | None:
    """The same; what is wrong is shown, and then there is none."""
    try:
        return chosen_config(workspace)
    except ConfigError as fault:
        st.error(escape_markdown(str(fault)), icon=":material/error:")
        return None


def options(workspace: Workspace) -> None:
    """Everything the preset leaves open."""
    fields = _Fields(workspace)
    top = st.columns(4)
    with top[0]:
        fields.number("iterations", "Iterations, at most", step=100)
    with top[1]:
        fields.number("seed", "Seed", step=1)
    with top[2]:
        fields.number("learning_rate", "Learning rate", step=0.001, format="%g")
    with top[3]:
        fields.numbers("weight_initial", ("R, weight of the first instant (Ψ_R)",))
    fields.start()
    labels = ("Q, weight of dp/dt in Ψ_F", "Q, weight of dv/dt in Ψ_F")
    weights = st.columns(4)
    fields.numbers("weight_physics", labels, weights[:2])
    labels = ("S, weight of gaps in Ψ_D", "S, weight of speeds in Ψ_D")
    fields.numbers("weight_data", labels, weights[2:])
    bottom = st.columns(4)
    if workspace.preset == "paper":
        with bottom[0]:
            fields.number("lbfgs_iterations", "L-BFGS iterations after Adam", step=100)
        with bottom[1]:
            fields.number("test_share", "Share kept for testing", step=0.05, format="%g")
    else:
        with bottom[0]:
            fields.number("highest_frequency", "Highest frequency [Hz]", step=0.05, format="%g")
        with bottom[1]:
            fields.number("batch", "Instants per iteration", step=100)
    with bottom[3]:
        st.space("stretch")
        st.button("Back to the preset", on_click=fields.reset, icon=":material/undo:")


class _Fields:
    """Number inputs for the settings of one preset; only what differs from it is kept."""

    def __init__(self, workspace: Workspace) -> None:
        self._preset = workspace.preset
        self._default = PRESETS[workspace.preset].to_json()
        self._changes = workspace.settings.setdefault(workspace.preset, {})

    def value(self, name: str) -> Any:
        return self._changes.get(name, self._default[name])

    def _key(self, name: str) -> str:
        return f"train_{self._preset}_{name}"

    def number(self, name: str, label: str, **look: Any) -> None:
        """One number, whole or not as the preset has it."""
        key = self._key(name)

        def changed() -> None:
            if st.session_state[key] is not None:
                self._changes[name] = st.session_state[key]

        now = self.value(name)
        st.number_input(label, value=now, key=sync_widget(key, now), on_change=changed, **look)

    def numbers(self, name: str, labels: tuple[str, ...], columns: Any = None) -> None:
        """A setting of several numbers, or of one that is a float."""
        values = self.value(name)
        single = not isinstance(values, list | tuple)
        kept = [values] if single else list(values)
        for at, label in enumerate(labels):
            key = f"{self._key(name)}_{at}"

            def changed(at: int = at, key: str = key) -> None:
                if st.session_state[key] is not None:
                    kept[at] = float(st.session_state[key])
                    self._changes[name] = kept[0] if single else tuple(kept)

            place = columns[at] if columns else st
            now = float(kept[at])
            place.number_input(
                label,
                value=now,
                key=sync_widget(key, now),
                on_change=changed,
                step=0.1,
                format="%g",
            )

    def start(self) -> None:
        """Initial values, each by itself or one of five sets."""
        columns = st.columns(4)
        now = tuple(float(v) for v in self.value("initial"))
        starts = [tuple(start.values.tolist()) for start in STARTS]
        offered = starts if now in starts else [*starts, now]
        key = self._key("start")

        def changed() -> None:
            if st.session_state[key] is not None:
                self._changes["initial"] = st.session_state[key]

        columns[0].selectbox(
            "Start from",
            offered,
            index=offered.index(now),
            format_func=lambda start: "α {:g}, β {:g}, τ {:g}".format(*start),
            key=sync_widget(key, now),
            on_change=changed,
        )
        labels = ("Initial α [1/s²]", "Initial β [1/s]", "Initial τ [s]")
        self.numbers("initial", labels, columns[1:])

    def reset(self) -> None:
        self._changes.clear()


def preset_line(workspace: Workspace) -> str:
    """What the preset is, and whether the user changed it."""
    changed = workspace.settings.get(workspace.preset)
    return PRESET_LINES[workspace.preset] + (" With your options." if changed else "")
