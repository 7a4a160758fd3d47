"""The page Train: preset, model, options, the button that starts, and the estimate."""

import math
from contextlib import suppress
from typing import Any

import plotly.graph_objects as go
import streamlit as st

from accpinn.channels import PARAMETERS
from accpinn.errors import ConfigError
from accpinn.evaluation.closed_loop import simulated
from accpinn.methods import Segments
from accpinn.methods.estimate import Estimate
from accpinn.methods.pinn.config import PRESET_INFOS, PRESETS, STARTS
from accpinn.methods.registry import METHODS, recommended_method
from accpinn.model.cthp import Parameters
from accpinn.model.registry import TITLES, has_terms_of
from accpinn.recordings import Recording
from accpinn.results.figures.training import NETWORK, course, tracking
from accpinn.results.messages.estimate import initial_in_words
from accpinn.results.messages.summary import unfinished
from accpinn.segment import Segment
from accpinn.study import Analysis
from accpinn.study.result import Result, result_of
from accpinn.tasks import Status, Task
from pages.ui.components import frame, show
from pages.ui.components.monitor import monitor, stop_button
from pages.ui.components.result import banner, show_estimate, show_result, theatre
from pages.ui.components.show import bound, escape_markdown, pick, segments, select
from pages.ui.data.views import show_validation
from pages.ui.session.resources import cached, segment_of, store
from pages.ui.session.workspace import TITLE_OF, Workspace
from pages.ui.snapshots.listing import show_runs

REDRAWN = 1.1
"""Growth of the iterations after which the live charts are drawn anew: less is not seen on their
logarithmic axes, and Streamlit takes down a chart that has changed and puts up another."""
LIVE = 500
"""Height in pixels of the live charts."""
LIVE_CURVES = "train_live_curves"
"""Key of the chart of the curves, before a training and while it runs."""
SIMULATED = "simulation so far"
"""Name of the live curves of a method that simulates the drive."""
CONTINUES = (
    "A training of this window with these settings, here or in another session, was stopped there;"
    " the server keeps its checkpoint."
)
MODEL_HELP = (
    "Recommended and Fast estimate every CTHP by the network; Recommended estimates the nonlinear"
    " models, as the IDM, by closed-loop simulation. Of the CTHPs, that with s₀ and a delay d"
    " predicts the gaps of other windows and the measured gain best; the paper's has neither."
)
START_HELP = (
    "Where the search begins for the CTHPs; IDM and FVDM begin at typical values. From other starts"
    " the same minimum should be found: page Compare trains from five."
)

WEIGHT_PHYSICS = (
    "Of the squared residual of the model's equation. A larger weight binds the curves to the"
    " model, a smaller one to the data."
)
WEIGHT_DATA = "Of the squared distance of the network's curves from the data."
OPTIONS: dict[str, tuple[str, float, str]] = {
    "iterations": ("Iterations, at most", 100, "Of the optimiser Adam, or rounds of"
                   " the calibrated preset's search. The fast and calibrated presets end earlier"
                   " once α, β and τ stand still."),
    "seed": ("Seed", 1, "Of the network's random initial weights and of the instants drawn"
             " at random. The same seed gives the same result."),
    "learning_rate": ("Learning rate", 0.001, "Adam's step. Larger is faster, until the"
                      " loss no longer falls; the paper's is 0.001."),
    "weight_initial": ("R, weight of the first instant (Ψ_R)", 0.1, "Of the squared error"
                       " at the first instant; 0 leaves it out, the authors' notebooks use 1."),
    **{f"initial-{k}": (f"Initial {parameter.heading}", 0.1, START_HELP)
       for k, parameter in enumerate(PARAMETERS)},
    "weight_physics-0": ("Q: weight of dp/dt in the physics loss", 0.1, WEIGHT_PHYSICS),
    "weight_physics-1": ("Q: weight of dv/dt in the physics loss", 0.1, WEIGHT_PHYSICS),
    "weight_data-0": ("S: weight of gaps in the data loss", 0.1, WEIGHT_DATA),
    "weight_data-1": ("S: weight of speeds in the data loss", 0.1, WEIGHT_DATA),
    "layers": ("Hidden layers", 1, "Of the network; the paper's has three. A smaller network"
               " is quicker, and the curves follow the data less closely."),
    "width": ("Neurons per layer", 10, "The paper's have sixty."),
    "lbfgs_iterations": ("L-BFGS iterations after Adam", 100, "The paper suggests them for"
                         " the last digits, but reports none."),
    "test_share": ("Share kept for testing", 0.05, "Instants drawn at random that the loss"
                   " does not see; their loss is reported."),
    "highest_frequency": ("Highest frequency [Hz]", 0.05, "The network's curves cannot move"
                          " faster than this. Platoons move below 0.1 Hz; the calibrated preset"
                          " resolves 0.5 Hz to tell noise from motion."),
    "batch": ("Instants per iteration", 100, "Drawn at random for each step of Adam."),
}  # fmt: skip
"""Label, step and meaning of the fields in their order, by setting, and by place in the setting
where it has several numbers."""


def show_page(workspace: Workspace) -> None:
    if workspace.segment:
        _show_training(workspace)
    else:
        frame.empty_state(workspace, "Nothing to train on")
    if not (runs := workspace.runs):
        return
    title = f"Finished runs of this session ({len(runs)})"
    with st.container(key="later_3_runs"), st.expander(title, icon=":material/history:"):
        show_runs(workspace, runs, "runs")


def _show_training(workspace: Workspace) -> None:
    segment, result, training = workspace.segment, workspace.result, workspace.training
    assert segment is not None
    banner(workspace)
    is_active = training is not None and training.is_active
    windows = result.analysis.windows if result and not is_active else workspace.windows
    st.caption(frame.segment_line(segment, workspace.selection.case, windows))
    show.not_acc(segment)
    # On a narrow screen a result comes before what led to it, while a training can be stopped.
    done = result is not None and not is_active
    with st.container(key="later_1_train" if done else "train_controls"):
        analysis = _controls(workspace)
    if training and training.status is Status.RUNNING:
        _show_live(workspace, training)
        return
    if training:
        monitor(training)
    if result:
        is_snapshot = bool(result.id)
        show_result(
            workspace, result, "train", lambda: result if is_snapshot else workspace.as_snapshot(),
            lambda: _next_button(workspace, result),
            {"Validation": lambda: _show_validation(workspace)},
        )  # fmt: skip
    elif analysis := training.analysis if training and is_active else analysis:
        _show_beginning(workspace, analysis)


def _show_beginning(workspace: Workspace, analysis: Analysis) -> None:
    """The data of a follower, and the drive by the values at which a training begins."""
    data = _segments(workspace, analysis)
    with st.container(horizontal=True, vertical_alignment="center"):
        follower = pick(workspace, data[0].labels[1:], "train_follower")
        if initial := show.attempt(lambda: _initial(analysis, data)):
            show.caption(f"{initial_in_words(*initial)} Dotted: the drive simulated by them.")
    show.chart(_first_curves(data[0], follower, initial, LIVE), LIVE_CURVES)


def _initial(analysis: Analysis, data: Segments) -> tuple[str, Parameters] | None:
    """The model and the parameters at which a training begins, where its method seeks step by step.

    Raises:
        ConfigError: where the initial values are not the model's.
    """
    initial = METHODS[analysis.method].initial
    return initial(data, analysis.config, analysis.spec) if initial else None


def _first_curves(
    segment: Segment, follower: int, initial: tuple[str, Parameters] | None, height: int
) -> go.Figure:
    """The data of a follower, and the simulation by initial parameters."""
    motion = None
    if initial:
        model, parameters = initial
        motion = simulated(segment.pair(follower), model, parameters[[follower]])
    return tracking(segment, follower, simulation=motion, height=height)


def _show_live(workspace: Workspace, training: Task[Result]) -> None:
    """A training as it runs: the curves bend into the data, the loss falls, parameters move."""
    analysis, result = training.analysis, workspace.result
    assert analysis is not None
    data, truth = _segments(workspace, analysis), workspace.true_parameters
    segment = data[0]
    with st.container(horizontal=True, vertical_alignment="center"):
        follower = pick(workspace, segment.labels[1:], "train_follower")
        has_truth = truth is not None and has_terms_of(analysis.spec.model, truth)
        show.follower_key(segment, has_truth, segment.shares(analysis.case))

    def draw(polled: bool) -> None:
        """Draw the present moment, and the strip of what is known."""
        history = training.history()
        if history is None:
            curves, moved = _first_curves(segment, follower, _initial(analysis, data), LIVE), None
        else:
            step = int(math.log(max(history.iteration[-1], 1.0)) / math.log(REDRAWN))
            curves, moved = _live_figures(training, segment, follower, truth, step)
        theatre(curves, moved, "train_live")
        if point := training.point:
            show_estimate(_of_point(training, point, data, workspace.recording))
        elif result:
            show_estimate(result)

    monitor(training, draw)


def _segments(workspace: Workspace, analysis: Analysis) -> Segments:
    """The data of a training."""
    if recording := workspace.recording:
        about = analysis.vehicles, analysis.excluded
        return tuple(segment_of(recording, window, *about) for window in analysis.windows)
    return workspace.segments


@cached
def _of_point(
    training: Task[Result], point: Estimate, segments: Segments, recording: Recording | None
) -> Result:
    """The result that a point is so far."""
    assert training.analysis is not None
    return result_of(training.analysis, segments, point, recording)


@cached
def _live_figures(
    training: Task[Result], segment: Segment, follower: int, truth: Parameters | None, step: int
) -> tuple[go.Figure, go.Figure]:
    """The curves of a training at a ``step``, and the course of its loss and parameters."""
    history, curves, analysis = training.history(), training.curves, training.analysis
    assert history is not None
    assert analysis is not None
    drawn = course(history, segment.info, analysis.spec.model, truth, height=LIVE)
    name = SIMULATED if analysis.has_posterior else NETWORK
    return tracking(segment, follower, curves, curve_name=name, height=LIVE), drawn


def _show_validation(workspace: Workspace) -> None:
    """The errors of the learned parameters in another window, once the user has chosen one."""
    if workspace.validation is None:
        st.caption(
            "Choose a window that was not trained on, or another recording of the same vehicles, on"
            " page Data: the learned parameters are then simulated there."
        )
        frame.link(frame.DATA, "Choose it on Data", workspace)
        return
    show_validation(workspace)


def _next_button(workspace: Workspace, result: Result) -> None:
    """The next step, and another model where this one misses the drive.

    After a training that was stopped it is to train on, by the button above.
    """
    if unfinished(result.estimate):
        return
    if not all(trust.is_reproduced for trust in result.trust):
        frame.ask_which_model(workspace, "Which model misses less?", "train_models")
    if st.button(
        "Next: string stability", icon=":material/arrow_forward:", key="train_next", type="primary"
    ):
        workspace.choose_source("estimate")
        frame.go(frame.STABILITY, workspace)


def _controls(workspace: Workspace) -> Analysis | None:
    """Draw what a training is chosen by; what it would answer is None where that is refused."""
    preset = workspace.preset
    analysis = show.attempt(workspace.analysis)
    with st.container(horizontal=True, vertical_alignment="bottom"):
        segments(
            "Preset", TITLE_OF, preset, "train_preset",
            lambda name: setattr(workspace, "preset", name),
        )  # fmt: skip
        select(
            "Model", TITLES, workspace.spec.model, "train_model", workspace.choose_model,
            labelled=False, width=330, help=MODEL_HELP,
        )  # fmt: skip
        _buttons(workspace, analysis)
        method = METHODS[analysis.method if analysis else recommended_method()]
        settings = analysis.settings if analysis else PRESETS[preset].to_json()
        # While a training runs, nothing pushes its charts down.
        is_active = workspace.training is not None and workspace.training.is_active
        has_options = method.settings is not None and not is_active
        st.toggle("Options", key="train_options", disabled=not has_options)
    changed = " With your options." if workspace.settings.get(preset) else ""
    fixed = f" Fixed: {workspace.spec.in_words.partition(', ')[2]}." * bool(workspace.spec.fixed)
    st.caption(escape_markdown(method.described(settings) + changed + fixed))
    if has_options and st.session_state.get("train_options"):
        with st.container(border=True):
            _show_options(workspace)
    return analysis


def _buttons(workspace: Workspace, analysis: Analysis | None) -> None:
    training = workspace.training
    if training and training.is_active:
        stop_button(training, "Stop training", "train_stop")
        return
    at = store().stopped_at(analysis) if analysis else None
    label, icon, result = "Start training", "play_arrow", workspace.result
    if at is not None:
        label, icon = (f"Continue from iteration {at:,}", "resume")
    st.button(
        label,
        type="secondary" if result and not unfinished(result.estimate) else "primary",
        icon=f":material/{icon}:",
        key="train_start",
        disabled=analysis is None,
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
    with suppress(ConfigError):  # the page shows what is wrong with a setting
        workspace.train(anew)


# The preset's settings, and the user's changes to them


def _show_options(workspace: Workspace) -> None:
    """A field for each setting; only what differs from the preset is kept."""
    preset = workspace.preset
    changes = workspace.settings.setdefault(preset, {})
    settings = PRESETS[preset].to_json() | changes
    unused = PRESET_INFOS[preset].unused
    fields = {k: field for k, field in OPTIONS.items() if k.partition("-")[0] not in unused}
    count = len(fields) + 1 + ("initial-0" in fields)
    places = [column for _ in range(math.ceil(count / 4)) for column in st.columns(4)]

    def number(column: Any, name: str, label: str, step: float, help: str) -> None:
        """A field; a name ends with a place where the setting has several numbers."""
        setting, _, place = name.partition("-")
        values = settings[setting]

        def changed(value: float) -> None:
            numbers = {int(place): float(value)} if place else {}
            changes[setting] = (
                tuple(numbers.get(k, number) for k, number in enumerate(values)) if place else value
            )

        value = float(values[int(place)]) if place else values
        shown = bound(f"train_{preset}_{name.replace('-', '_')}", value, changed)
        look = {} if isinstance(step, int) else {"format": "%g"}
        column.number_input(label, **shown, step=step, help=help, **look)

    if "initial-0" in fields:
        now = tuple(float(value) for value in settings["initial"])
        starts = [*(tuple(start.values.tolist()) for start in STARTS), now]
        select(
            "Start from", {start: "α {:g}, β {:g}, τ {:g}".format(*start) for start in starts},
            now, f"train_{preset}_start", lambda initial: changes.update(initial=initial),
            place=places.pop(4), help=START_HELP,
        )  # fmt: skip
    for column, (name, (label, step, explained)) in zip(places, fields.items(), strict=False):
        number(column, name, label, step, explained)
    with places[-1]:
        st.space("stretch")
        st.button(
            "Back to the preset", on_click=changes.clear, icon=":material/undo:",
            help="Forgets all changes made here.",
        )  # fmt: skip
