"""The part of page Compare that judges car-following models on each car."""

from collections.abc import Sequence
from pathlib import Path

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from accpinn.model.registry import FOLLOWING, JUDGED
from accpinn.results.figures import comparison as figures
from accpinn.results.messages.estimate import true_model
from accpinn.results.messages.summary import best_models, which_model
from accpinn.results.naming import brief
from accpinn.results.strip import strip_of
from accpinn.results.tables.estimates import judged_table, model_parameters_table
from accpinn.study.judge import Judgement, seconds_of
from accpinn.units import MetresPerSecond
from pages.ui.components import frame, show
from pages.ui.components.monitor import monitor, stop_button
from pages.ui.components.parameter_picker import cars_of, of_several
from pages.ui.components.result import recording_needed
from pages.ui.components.show import KMH, escape_markdown, kept, pick, select, tabs
from pages.ui.components.strip import show_strip
from pages.ui.session.workspace import Workspace

LEAD = (
    "Which model predicts each car best? Each is fitted to all windows but one by closed-loop"
    " simulation and then drives in the one left out, with only the speed ahead given."
)
ABOUT = (
    "RMSE of the gap: geometric mean over the windows left out. Beyond the best: error above that"
    " of the best model, mean ± one standard error over windows. |H| off: rms difference from the"
    " gain measured from the recording (Welch's method), a dash where none is measured. The"
    " verdicts on stability are for small disturbances at that speed."
)


def show_models(workspace: Workspace, about: DeltaGenerator) -> None:
    """Start or watch the judgement and show it for each follower; ``about`` names the data."""
    task = workspace.judgement
    if workspace.recording is None:
        show_judged(workspace, workspace.judgements)
        recording_needed(workspace, "To compare models, the page needs")
        return
    subjects = workspace.subjects
    choices = dict.fromkeys(tuple(part.window for part in subject.windows) for subject in subjects)
    windows = " or ".join(frame.in_words(parts[0], parts) for parts in choices)
    about.caption(
        escape_markdown(f"{workspace.recording.source} · {windows}, each window left out once"),
        help=LEAD,
    )
    if task and task.is_active:
        stop_button(task, "Stop", "models_stop")
    else:
        if not workspace.judgements:
            st.markdown(LEAD)
            place = st.container(horizontal=True, vertical_alignment="center")
        else:
            place = st.popover("Compare other models", icon=":material/gavel:")
        with place:
            chosen = st.multiselect(
                "Models", list(FOLLOWING), label_visibility="collapsed",
                format_func=lambda key: FOLLOWING[key].title, placeholder="Choose models",
                **kept(workspace, "models_chosen", list(JUDGED), default="default"),
            )  # fmt: skip
            share = _parameters(chosen) / _parameters(JUDGED)
            seconds = seconds_of(sum(len(subject.windows) for subject in subjects))
            takes = show.format_duration(share * seconds)
            start = st.button(
                f"Compare {len(chosen)} models (about {takes})", key="models_run",
                type="secondary" if workspace.judgements else "primary", disabled=not chosen,
                icon=":material/gavel:",
            )  # fmt: skip
        if start:
            workspace.judge_models(chosen)
            st.rerun()
    if task:
        monitor(task, lambda polled: show_judged(workspace, task.result or (), polled))
    else:
        show_judged(workspace, workspace.judgements)


def _parameters(models: Sequence[str]) -> int:
    """How many parameters some models have together."""
    return sum(len(FOLLOWING[key].parameters) for key in models)


def show_judged(workspace: Workspace, judged: tuple[Judgement, ...], polled: bool = False) -> None:
    """The comparison of each follower; a choice of models once all are judged."""
    if not judged:
        return
    if polled:
        show.table(judged_table(judged[0], judged[0].speeds[1]))
        return
    workspace.keep_judgements()
    made = true_model(workspace.true_parameters) if workspace.true_parameters else None
    truth = f" The sample was made with the {FOLLOWING[made].title}." if made else ""
    st.markdown(
        f"**{escape_markdown(best_models(judged))}**{escape_markdown(truth)}",
        help=show.bullets(which_model(judged)),
    )
    followers = figures.followers_of(judged[0])
    show.key((follower.name, follower.colour) for follower in followers)
    show.chart(figures.errors_by_car(judged), "models_cars")
    if workspace.recording:
        _choose_models(workspace, judged)
    with st.container(horizontal=True, vertical_alignment="bottom"):
        labels = [judgement.info.labels[1] for judgement in judged]
        car = judged[pick(workspace, labels, "models_follower")]
        low, middle, high = car.speeds
        speed = show.choose_speed(
            workspace, f"models_speed_{car.info.vehicles[1]}", middle,
            "Nonlinear models answer small disturbances differently at every speed. Recorded:"
            f" {KMH * low:.0f} to {KMH * high:.0f} km/h, median {KMH * middle:.0f}.",
        )  # fmt: skip
    _show_follower(workspace, car, speed)


def _choose_models(workspace: Workspace, judged: tuple[Judgement, ...]) -> None:
    """Choose a model for each car and combine the cars of several results into one platoon."""
    chosen: dict[int, str] = {}
    with st.container(horizontal=True, vertical_alignment="bottom", key="models_cars_chosen"):
        for judgement in judged:
            number, ranked = judgement.info.vehicles[1], judgement.ranked
            options = dict[str, str]()
            for score in ranked:
                words = brief(score.key)
                name = f"CTHP {words}" if words.startswith("with ") else words
                options[score.key] = f"{name}, {score.typical_rmse:.2f} m"
            chosen[number] = select(
                judgement.info.labels[1], options, ranked[0].key, f"models_of_{number}",
                workspace, width=250,
                help="The model with the least error first. Two errors may differ by chance: see"
                " the numbers below.",
            )  # fmt: skip
        active = [task for task in workspace.cars.values() if task.is_active]
        if not active:
            st.button(
                "Use these models", key="models_use", icon=":material/directions_car:",
                type="secondary" if workspace.own_results else "primary",
                on_click=workspace.use_models, args=(chosen,),
                help="Estimates each car alone behind the vehicle ahead, in its windows in"
                " car-following, by the recommended method of its model; a car whose model the"
                " present result has stays as it is. Stability and Platoon then take the cars"
                " together.",
            )  # fmt: skip
    if active:
        done = len(workspace.own_results)
        st.caption(f"{done} of {done + len(active)} cars estimated.")
        stop_button(active[0], "Stop", "models_use_stop")
        monitor(active[0])
    elif cars := cars_of(workspace):
        for task in workspace.cars.values():
            show.messages(task.error, "error")

        def show_next() -> None:
            frame.link(frame.STABILITY, "Next: string stability", workspace)
            frame.link(frame.PLATOON, "Platoon", workspace)

        show_strip(strip_of(of_several(cars)), next_step=show_next)


def _show_follower(workspace: Workspace, judgement: Judgement, speed: MetresPerSecond) -> None:
    """The details of one car."""
    table, stem = judged_table(judgement, speed), Path(judgement.info.source).stem

    def show_numbers() -> None:
        show.table(table)
        show.caption("Geometric mean over the windows left out.", ABOUT)
        show.downloads(table, f"{stem}_models", "models")

    def show_speeds() -> None:
        low, _, high = judgement.speeds
        figure = figures.peak_over_speed(figures.followers_of(judgement), (low, high), speed)
        show.chart(figure, "models_peak")
        st.caption(
            "Largest gain for small disturbances: above 0 dB they grow. Shaded: recorded speeds."
            " Dashed: the speed chosen."
        )

    def show_parameters() -> None:
        parameters = model_parameters_table(judgement)
        show.table(parameters)
        show.downloads(parameters, f"{stem}_model_parameters", "model_parameters")

    tabs(workspace, "models_tabs", {
        "Numbers": show_numbers,
        "Windows": lambda: show.chart(figures.errors_by_window(judgement), "models_errors"),
        "Peak over speed": show_speeds,
        "Parameters": show_parameters,
    })  # fmt: skip
