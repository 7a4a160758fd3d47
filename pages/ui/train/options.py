"""The settings of a training: the preset's, and the user's changes to them."""

from collections.abc import Sequence
from typing import Any

import streamlit as st

from accpinn.channels import PARAMETERS
from accpinn.methods.pinn.config import PRESETS, STARTS
from pages.ui.components.widgets import bound, select
from pages.ui.session.workspace import Workspace

START_HELP = (
    "Where the search begins. From other starts the same minimum should be found: page Compare"
    " trains from five."
)


def show_options(workspace: Workspace) -> None:
    """All settings of the preset."""
    fields = _Fields(workspace)
    rows = [st.columns(4) for _ in range(5)]
    fields.number(
        "iterations", "Iterations, at most", rows[0][0], step=100,
        help="Of the optimiser Adam. The fast and calibrated presets end earlier once α, β and τ"
        " stand still.",
    )  # fmt: skip
    fields.number(
        "seed", "Seed", rows[0][1], step=1,
        help="Of the network's random initial weights and of the instants drawn at random. The same"
        " seed gives the same result.",
    )  # fmt: skip
    fields.number(
        "learning_rate", "Learning rate", rows[0][2], step=0.001, format="%g",
        help="Adam's step. Larger is faster, until the loss no longer falls; the paper's is 0.001.",
    )  # fmt: skip
    fields.number(
        "weight_initial", "R, weight of the first instant (Ψ_R)", rows[0][3], step=0.1, format="%g",
        help="Of the squared error at the first instant; 0 leaves the term out, the authors'"
        " notebooks use 1.",
    )  # fmt: skip
    fields.start(rows[1])
    fields.several(
        "weight_physics", ("Q, weight of dp/dt in Ψ_F", "Q, weight of dv/dt in Ψ_F"), rows[2][:2],
        "Of the squared residual of the model's equation. A larger weight binds the curves to the"
        " model, a smaller one to the data.",
    )  # fmt: skip
    fields.several(
        "weight_data", ("S, weight of gaps in Ψ_D", "S, weight of speeds in Ψ_D"), rows[2][2:],
        "Of the squared distance of the network's curves from the data.",
    )  # fmt: skip
    fields.number(
        "layers", "Hidden layers", rows[3][0], step=1,
        help="Of the network; the paper's has three. A smaller network is quicker, and the curves"
        " follow the data less closely.",
    )  # fmt: skip
    fields.number("width", "Neurons per layer", rows[3][1], step=10, help="The paper's have sixty.")
    _special(workspace, fields, rows[3][2:])
    with rows[4][3]:
        st.space("stretch")
        st.button(
            "Back to the preset", on_click=fields.changes.clear, icon=":material/undo:",
            help="Forgets all changes made here.",
        )  # fmt: skip


def _special(workspace: Workspace, fields: "_Fields", columns: Sequence[Any]) -> None:
    """What only some presets have."""
    left, right = columns
    if workspace.preset == "paper":
        fields.number(
            "lbfgs_iterations", "L-BFGS iterations after Adam", left, step=100,
            help="The paper suggests them for the last digits, but reports none.",
        )  # fmt: skip
        fields.number(
            "test_share", "Share kept for testing", right, step=0.05, format="%g",
            help="Instants drawn at random that the loss does not see; their loss is reported.",
        )  # fmt: skip
        return
    fields.number(
        "highest_frequency", "Highest frequency [Hz]", left, step=0.05, format="%g",
        help="The network's curves cannot move faster than this. Platoons move below 0.1 Hz; the"
        " calibrated preset resolves 0.5 Hz to tell noise from motion.",
    )  # fmt: skip
    fields.number(
        "batch", "Instants per iteration", right, step=100,
        help="Drawn at random for each step of Adam.",
    )  # fmt: skip


class _Fields:
    """Number inputs for the settings of one preset; only what differs from it is kept."""

    def __init__(self, workspace: Workspace) -> None:
        self.changes = workspace.settings.setdefault(workspace.preset, {})
        self._preset = workspace.preset
        self._default = PRESETS[workspace.preset].to_json()

    def _value(self, name: str) -> Any:
        return self.changes.get(name, self._default[name])

    def number(self, name: str, label: str, column: Any, **look: Any) -> None:
        """One number, whole or not as the preset has it."""

        def changed(value: float) -> None:
            self.changes[name] = value

        shown = bound(f"train_{self._preset}_{name}", self._value(name), changed)
        column.number_input(label, **shown, **look)

    def several(
        self, name: str, labels: Sequence[str], columns: Sequence[Any], explained: str
    ) -> None:
        """A setting of several numbers."""
        values = [float(value) for value in self._value(name)]
        for at, (label, column) in enumerate(zip(labels, columns, strict=True)):

            def changed(value: float, at: int = at) -> None:
                values[at] = float(value)
                self.changes[name] = tuple(values)

            shown = bound(f"train_{self._preset}_{name}_{at}", values[at], changed)
            column.number_input(label, **shown, step=0.1, format="%g", help=explained)

    def start(self, columns: Sequence[Any]) -> None:
        """Initial values, each by itself or one of five sets."""
        now = tuple(float(value) for value in self._value("initial"))
        starts = [*(tuple(start.values.tolist()) for start in STARTS), now]
        select(
            "Start from", {start: "α {:g}, β {:g}, τ {:g}".format(*start) for start in starts},
            now, f"train_{self._preset}_start",
            lambda initial: self.changes.update(initial=initial), place=columns[0], help=START_HELP,
        )  # fmt: skip
        labels = tuple(f"Initial {parameter.heading}" for parameter in PARAMETERS)
        self.several("initial", labels, columns[1:], START_HELP)
