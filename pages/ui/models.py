"""The part of page Compare that asks which car-following model describes this car."""

from collections.abc import Sequence
from pathlib import Path

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from accpinn.model.registry import FOLLOWING, JUDGED
from accpinn.results.figures import comparison as figures
from accpinn.results.messages import messages
from accpinn.results.messages.estimate import true_model
from accpinn.results.messages.summary import which_model
from accpinn.results.tables.estimates import judged_table, model_parameters_table
from accpinn.study.judge import Judgement, seconds_of
from accpinn.units import MetresPerSecond
from pages.ui.components import frame, show
from pages.ui.components.monitor import monitor, stop_button
from pages.ui.components.result import recording_needed, show_estimate
from pages.ui.components.show import KMH, escape_markdown, kept, pick
from pages.ui.session.workspace import Workspace

LEAD = (
    "Which model does each car follow? Each is fitted to all windows but one by closed-loop"
    " simulation and then drives in the one left out, with only the speed ahead given."
)
ABOUT = (
    "RMSE of the gap: geometric mean over the windows left out. Beyond the best: error above that"
    " of the best model, mean ± one standard error over windows. |H| off: rms difference from the"
    " gain measured from the recording (Welch's method), a dash where none is measured. The"
    " verdicts on stability are for small disturbances at that speed."
)


def show_models(workspace: Workspace, about: DeltaGenerator) -> None:
    """The question, its work, and what is found of each follower; ``about`` names the data."""
    task = workspace.judgement
    if workspace.recording is None:
        show_judged(workspace, workspace.judgements)
        recording_needed(workspace, "To compare models, the page needs")
        return
    subjects = workspace.subjects
    every = dict.fromkeys(tuple(part.window for part in one.windows) for one in subjects)
    windows = " or ".join(frame.in_words(parts[0], parts) for parts in every)
    about.caption(
        escape_markdown(f"{workspace.recording.source} · {windows}, each window left out once")
    )
    st.markdown(LEAD)
    if task and task.is_active:
        stop_button(task, "Stop", "models_stop")
    else:
        chosen = st.multiselect(
            "Models", list(FOLLOWING), label_visibility="collapsed",
            format_func=lambda key: FOLLOWING[key].title, placeholder="Choose models",
            **kept(workspace, "models_chosen", list(JUDGED), default="default"),
        )  # fmt: skip
        share = _parameters(chosen) / _parameters(JUDGED)
        seconds = seconds_of(sum(len(one.windows) for one in subjects))
        takes = show.format_duration(share * seconds)
        if st.button(
            f"Compare {len(chosen)} models (about {takes})", key="models_run", disabled=not chosen,
            type="secondary" if task else "primary", icon=":material/gavel:",
        ):  # fmt: skip
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
    """What is found of each follower; charts and details of one once all models are judged."""
    if not judged:
        return
    if polled:
        show.table(judged_table(judged[0], judged[0].speeds[1]))
        return
    workspace.keep_judgements()
    for said in which_model(judged):
        st.markdown(f"**{escape_markdown(said)}**")
    if workspace.true_parameters and (made := true_model(workspace.true_parameters)):
        st.caption(f"This sample was made with the {escape_markdown(FOLLOWING[made].title)}.")
    _estimate_cars(workspace, judged)
    if workspace.result:
        frame.link(frame.SNAPSHOTS, "Next: keep the result as a snapshot", workspace)
    with st.container(horizontal=True, vertical_alignment="bottom"):
        labels = [one.info.labels[1] for one in judged]
        car = judged[pick(workspace, labels, "models_follower")]
        low, middle, high = car.speeds
        speed = show.choose_speed(
            workspace, f"models_speed_{car.info.vehicles[1]}", middle,
            "Nonlinear models answer small disturbances differently at every speed. Recorded:"
            f" {KMH * low:.0f} to {KMH * high:.0f} km/h, median {KMH * middle:.0f}.",
        )  # fmt: skip
    if len(judged) > 1:
        st.markdown(escape_markdown(" ".join(messages(car.findings, car.info))))
    _show_follower(car, speed)


def _estimate_cars(workspace: Workspace, judged: tuple[Judgement, ...]) -> None:
    """A button for each car that another model clearly describes best, and what came of it."""
    spec = workspace.result.estimate.spec if workspace.result else workspace.spec
    cars, own = workspace.cars, workspace.own_results
    better = [one for one in judged if one.is_clear and one.ranked[0].key != spec.model]
    if workspace.recording is None or not better:
        return
    row = st.container(horizontal=True)
    for one in better:
        number, model = one.info.vehicles[1], one.ranked[0].key
        task = cars.get(number)
        if task and task.is_active:
            stop_button(task, "Stop", f"models_stop_{number}")
            monitor(task)
        elif number in own and own[number].estimate.model == model:
            show_estimate(own[number])
        else:
            row.button(
                f"Estimate {one.info.labels[1]} with the {FOLLOWING[model].title}",
                key=f"models_take_{number}", icon=":material/directions_car:",
                on_click=workspace.estimate_car, args=(number, model),
                help="This car alone behind the vehicle ahead, in its windows in car-following, by"
                " the recommended method; Stability and Platoon can then take it from there.",
            )  # fmt: skip
    if own and workspace.result:
        frame.link(frame.STABILITY, "String stability with cars from several results", workspace)


def _show_follower(one: Judgement, speed: MetresPerSecond) -> None:
    table, stem = judged_table(one, speed), Path(one.info.source).stem
    show.table(table)
    st.caption(ABOUT)
    followers = figures.followers_of(one)
    show.key((follower.name, follower.colour) for follower in followers)
    left, right = st.columns(2)
    with left:
        show.chart(figures.errors_by_window(one), "models_errors")
    with right:
        low, _, high = one.speeds
        show.chart(figures.peak_over_speed(followers, (low, high), speed), "models_peak")
        st.caption(
            "Largest gain for small disturbances: above 0 dB they grow. Shaded: recorded speeds."
            " Dashed: the speed chosen."
        )
    with st.expander("Parameters of each model and their uncertainty"):
        parameters = model_parameters_table(one)
        show.table(parameters)
        show.downloads(parameters, f"{stem}_model_parameters", "model_parameters")
    show.downloads(table, f"{stem}_models", "models")
