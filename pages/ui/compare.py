"""The page Compare: the methods' estimates and errors, and what the data identify."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import streamlit as st

from accpinn.evaluation.closed_loop import simulated, tracking_errors
from accpinn.evaluation.whiteness import CONFIDENCE, residual_correlations
from accpinn.inference.answer import Answer
from accpinn.inference.identifiability import INCREASE, WIDE, profiles
from accpinn.inference.intervals import OutsideInterval, interval_ends
from accpinn.methods.estimate import ParameterTrack
from accpinn.methods.pinn.config import CALIBRATED, PRESETS
from accpinn.methods.registry import METHODS
from accpinn.methods.state_space import EXTRA
from accpinn.model import registry
from accpinn.model.registry import PAPER, gains_and_gap
from accpinn.results.figures import comparison as figures
from accpinn.results.figures.style import vehicle_colours
from accpinn.results.figures.training import tracking
from accpinn.results.messages import incidents, messages
from accpinn.results.messages.answer import papers_estimate
from accpinn.results.messages.summary import about_curves, agreement, conditional
from accpinn.results.tables import estimates as tables
from accpinn.results.tables.answer import counted_windows
from accpinn.results.tables.estimates import TITLES, name_of
from accpinn.segment import Segment
from accpinn.segment.quality import LARGE_CONDITION
from accpinn.study.comparison import Refused, answered, spread_of
from accpinn.study.result import Result
from accpinn.tasks import Task, comparison_seconds
from accpinn.units import FloatArray, MetresPerSecond, nanmean
from pages.ui import models
from pages.ui.components import frame, show
from pages.ui.components.monitor import monitor, own_task_line, stop_button
from pages.ui.components.result import banner, recording_needed, show_cards, show_intervals
from pages.ui.components.show import escape_markdown, pick, segments, select, tabs
from pages.ui.session.workspace import Workspace

GAP_ERROR = "A constant error of the measured gap shifts τ: 0.1 m in 30 m by 0.3 %."
ONLINE = "α, β, τ by the online methods"
"""What is drawn over time in place of one method's curves."""
VIEWS = {"methods": "Methods of estimation", "models": "Car-following models"}
MOST = 8
"""Earlier fits over the chart at once."""


@dataclass(eq=False)
class _Shown:
    """What the parts of the page are about."""

    workspace: Workspace
    segment: Segment
    rows: tuple[Result, ...]
    """The methods'; none before a comparison."""
    follower: int
    """0 for the first."""

    def __post_init__(self) -> None:
        """What follows for the follower: number, colour and truth; file names begin with `stem`."""
        truth, vehicles = self.workspace.true_parameters, self.segment.vehicles
        self.stem = Path(self.segment.source).stem
        self.truth = truth[self.follower] if truth else None
        self.vehicle = vehicles[self.follower + 1]
        self.colour = vehicle_colours(vehicles)[self.follower + 1]
        self.adequacy = self.workspace.adequacy(self.segment.info)

    def row_of(self, model: str) -> Result:
        """The first method that estimates a model, whose intervals all such have; else any."""
        return next((row for row in self.rows if row.fit.model == model), self.rows[0])

    @cached_property
    def answered(self) -> Result:
        """The training's; before one, a row with the windows a training would take."""
        workspace, row = self.workspace, self.rows[0]
        asked = workspace.training_analysis(CALIBRATED) or row.analysis
        return workspace.result or answered(row, asked, workspace.recording)

    @property
    def answer(self) -> Answer:
        """What the windows say together."""
        return self.answered.answer


def show_page(workspace: Workspace) -> None:
    segment, task, rows = workspace.segment, workspace.comparison, workspace.compared
    if segment:  # that of the rows, also where another window was chosen for a training since
        segment = rows[0].segment if task and rows else workspace.compared_segment
    if workspace.restored and task is None:
        _show_saved_rows(workspace, workspace.restored)
    if segment is None:
        if not workspace.restored:
            frame.empty_state(workspace, "Nothing to compare on")
        models.show_judged(workspace, workspace.judgements)
        return
    about = st.empty()
    show.not_acc(segment)
    if segments("Compare", VIEWS, "methods", "compare_view", workspace) == "models":
        models.show_models(workspace, about)
        return
    about.caption(frame.segment_line(segment, workspace.asked.case))
    _controls(workspace, segment)
    if task:
        monitor(task, lambda running: _show(workspace, task, segment, running))
    elif workspace.starts or (workspace.earlier and not workspace.restored):
        follower = pick(workspace, segment.labels[1:], "compare_follower")
        _show_repeatability(_Shown(workspace, segment, (), follower))


def _show_saved_rows(workspace: Workspace, restored: Result) -> None:
    """The methods compared, as they were saved, on a page that has no newer comparison."""
    banner(workspace)
    recording_needed(workspace, "To run the methods, the page needs")
    info, rows = restored.info, restored.compared
    if restored.known_answer:
        show_cards(restored)
    if rows:
        follower = pick(workspace, info.labels[1:], "snapshots_row_follower")
        show.table(tables.methods_table(info, rows, follower))
    else:
        st.caption("No comparison of the methods was saved with this snapshot.")
    show_intervals(restored, "")


def _controls(workspace: Workspace, segment: Segment) -> None:
    task, training = workspace.comparison, workspace.training
    if task and task.is_active:
        stop_button(task, "Stop", "compare_stop")
        return
    if task is None:
        if training and training.is_active:
            first = own_task_line(training, training.time_left)
            st.caption(f"{first} The methods would run after it.")
        st.markdown(
            f"{len(METHODS)} methods to estimate α, β and τ, each with its errors, beside the"
            " maximum-likelihood intervals, and other forms of the model."
        )
    complete = task is not None and len(task.results) == len(task.names)
    takes = show.format_duration(comparison_seconds(segment))
    if not complete and st.button(
        f"Run all methods (about {takes})", type="primary", icon=":material/play_arrow:",
        key="compare_run",
    ):  # fmt: skip
        workspace.compare()
        st.rerun()


def _show(workspace: Workspace, task: Task[Any], segment: Segment, running: bool) -> None:
    """The rows so far; what takes a choice or a while only comes once all have ended."""
    if running:
        if workspace.compared:
            show.table(tables.methods_table(segment.info, workspace.compared, 0))
        return
    _show_failures([outcome for outcome in task.results if isinstance(outcome, Refused)])
    if not workspace.compared:
        return
    rows = workspace.compared_with_training()
    first = st.container()
    follower = pick(workspace, segment.labels[1:], "compare_follower")
    shown = _Shown(workspace, segment, rows, follower)
    with first:
        with st.spinner("The answer takes some seconds."):
            show_cards(shown.answered)
        if said := agreement(rows, shown.answer):
            st.markdown(f"**{escape_markdown(said)}**")
        st.caption(_about_methods(shown))
        label = "Next: which model describes these cars?"
        frame.ask_which_model(workspace, label, "compare_next", "tertiary")
    tabs(workspace, "compare_tabs", {
        "Summary": lambda: _show_summary(shown),
        "Curves": lambda: _show_course(shown),
        "Identifiability": lambda: _show_identifiability(shown),
        "Model adequacy": lambda: _show_adequacy(shown),
        "Repeatability": lambda: _show_repeatability(shown),
    })  # fmt: skip


def _about_methods(shown: _Shown) -> str:
    """What the methods estimate, and which of them is the paper's."""
    rows, window, model = shown.rows, shown.segment.window, shown.answer.model
    said = (
        f"Each method below estimates α, β and τ in the window {window}: under the CTHP, or with"
        " the terms in its name."
    )
    if len(shown.answered.infos) > 1:
        said += f" The answer rests on {counted_windows(shown.answer)}."
    if model != PAPER:
        said += f" The {registry.TITLES[model]} predicts further drives of real cars better."
        if shown.truth and registry.has_terms_of(PAPER, shown.truth):
            said += (
                " This sample obeys the CTHP alone, so the answer is less certain and drawn towards"
                " other cars, as it counts how much windows of these differ."
            )
    papers = [
        f"{name_of(row.fit)}: {label}." for row in rows if (label := papers_estimate(row.fit))
    ]
    return escape_markdown(" ".join((said, *papers)))


def _show_summary(shown: _Shown) -> None:
    """Where the estimates lie, each method's errors, and the intervals."""
    segment, rows = shown.segment, shown.rows
    _show_estimates(shown)
    drive = simulated(segment, shown.answer.model, shown.answer.parameters)
    error = float(tracking_errors(segment, drive).gap_mae[shown.follower]) if drive else None
    answered, model = (shown.answer.parameters[shown.follower], error), shown.answer.model
    table = tables.methods_table(segment.info, rows, shown.follower, answered, model)
    show.table(table)
    st.caption(_about_errors(shown))
    show.downloads(table, f"{shown.stem}_methods", "compare")
    _show_collisions(shown)
    row = shown.row_of(shown.answer.model)
    show_intervals(row, conditional(row, shown.adequacy))
    # Which estimates lie outside is said above.
    found = (f for f in row.uncertainty.findings if not isinstance(f, OutsideInterval))
    show.messages(messages(found, segment))


def _show_collisions(shown: _Shown) -> None:
    """The events of the closed-loop simulations by method, as one line that opens."""
    info, rows = shown.segment.info, shown.rows
    happened = {name_of(row.fit): incidents(row.evaluation, info) for row in rows}
    count = sum(map(len, happened.values()))
    if not count:
        return
    times = [row.evaluation.collision_times(info.vehicles) for row in rows]
    colliding = int(np.isfinite(times).any(axis=0).sum())
    title = f"{colliding} of {info.followers} followers collide" if colliding else (
        "No follower collides on this window"
    )  # fmt: skip
    with st.expander(
        f"{title} in closed-loop simulation by some method's parameters; {count}"
        f" {'event' if count == 1 else 'events'} in all, inside and outside the window",
        icon=":material/car_crash:",
    ):
        for name, sentences in happened.items():
            if sentences:
                st.markdown(f"**{escape_markdown(name)}**\n\n{show.bullets(sentences)}")


def _show_failures(failures: Sequence[Refused]) -> None:
    reasons: dict[str, list[str]] = {}
    for failure in failures:
        reasons.setdefault(str(failure.fault), []).append(TITLES[failure.method])
    sentences = [
        f"No result from {', '.join(who) if len(who) < len(METHODS) else 'any method'}: {why}"
        for why, who in reasons.items()
    ]
    show.messages(sentences, "warning")


def _about_errors(shown: _Shown) -> str:
    """What the errors of the methods mean, and how much the gap itself varies."""
    is_partial = not all(row.evaluation.blocks for row in shown.rows)
    gap = shown.segment.measured_gaps[:, shown.follower]
    return (
        "Closed loop: the answer's is by its typical values. For scale, the mean absolute deviation"
        f" of the measured space-gap is {nanmean(abs(gap - nanmean(gap))):.2f} m. {GAP_ERROR}"
        + (" Hold-out is not computed for your own training." * is_partial)
    )


def _show_estimates(shown: _Shown) -> None:
    follower, answer = shown.follower, shown.answer
    speed, row = float(answer.speeds[follower]), shown.row_of(answer.model)
    uncertainty, model = row.uncertainty, row.fit.model
    earlier = _choose_earlier(shown, speed)
    spans = answer.gains_and_gap(follower)
    parts = np.array([(span.value, span.lower, span.upper) for span in spans]).T
    dots = [(f"Answer ({registry.TITLES[answer.model]})", parts)]
    dots += [
        (name_of(f), gains_and_gap(f.model, f.parameters[follower], speed))
        for f in (row.fit for row in shown.rows)
    ]
    truth = gains_and_gap(PAPER, shown.truth, speed) if shown.truth else None
    drawn = gains_and_gap(model, uncertainty.draws[:, follower], speed)
    band = np.array(interval_ends(drawn, uncertainty.level))
    figure = figures.estimates(dots, shown.colour, band, truth, earlier)
    st.caption(
        f"{escape_markdown(shown.segment.labels[follower + 1])}: the answer with its"
        f" {100 * uncertainty.level:.0f} % interval, and one dot a method. Grey: that interval of"
        f" the {escape_markdown(registry.TITLES[model])} in this window. Time gap: in equilibrium"
        f" at {3.6 * speed:.0f} km/h."
        + (" Dashed: true value." if shown.truth else "")
        + (" Rings: earlier fits." if earlier else "")
    )
    show.chart(figure, "compare_estimates")


def _show_course(shown: _Shown) -> None:
    """One method's curves against the data, or the parameters over time of the online methods."""
    by_name = {name_of(row.fit): row for row in shown.rows}
    tracks = [(name, row.fit.track) for name, row in by_name.items() if row.fit.track]
    options = [*by_name, *([ONLINE] if tracks else [])]
    name = select(
        "Over time", dict(zip(options, options, strict=True)), options[0], "compare_method",
        shown.workspace, width=320,
        help="A method's curves against the data, or how the online methods' estimates of α, β and"
        " τ move as samples come in.",
    )  # fmt: skip
    if name == ONLINE:
        _show_tracks(shown, tracks)
    else:
        st.subheader(f"{escape_markdown(name)} against the data", anchor=False)
        row = by_name[name]
        curves, simulated = row.fit.surrogate, row.simulated
        figure = tracking(shown.segment, shown.follower, curves, simulated, name, with_error=True)
        show.chart(figure, "compare_curves")


def _choose_earlier(shown: _Shown, speed: MetresPerSecond) -> list[figures.Row]:
    """Earlier fits of the session to lay over the chart of estimates."""
    known: dict[str, FloatArray] = {}
    for row in reversed(shown.workspace.earlier):
        if shown.vehicle in row.info.vehicles[1:]:
            follower = row.info.vehicles.index(shown.vehicle) - 1
            title = f"{len(known) + 1}. {tables.earlier_title(row)}"
            own = row.fit.parameters[follower]
            known[title] = gains_and_gap(row.fit.model, own, speed)
    if not known:
        return []
    chosen = st.multiselect(
        "Earlier fits to lay over the chart", list(known), key="compare_earlier",
        max_selections=MOST, placeholder=f"{len(known)} kept",
    )  # fmt: skip
    return [(name, known[name]) for name in chosen if name in known]


def _show_tracks(shown: _Shown, tracks: Sequence[tuple[str, ParameterTrack]]) -> None:
    st.subheader(ONLINE, anchor=False)
    truth = shown.truth if shown.truth and registry.has_terms_of(PAPER, shown.truth) else None
    figure = figures.tracks(tracks, shown.follower, truth, shown.segment.start)
    show.chart(figure, "compare_tracks")
    st.caption(
        "Shaded: one standard deviation by the method itself. Where disturbances last for seconds,"
        " that of recursive least squares is too small, and the filters' α and β are too low."
        + (" Dashed: true value." if truth else "")
    )


def _show_identifiability(shown: _Shown) -> None:
    """Which parameters the data determine, whichever method is used."""
    segment, follower, row = shown.segment, shown.follower, shown.row_of(PAPER)
    uncertainty = row.uncertainty
    case, adequacy = shown.workspace.asked.case, shown.adequacy
    st.markdown(f"**{escape_markdown(registry.TITLES[row.fit.model])} in this window**")
    quality, warnings = row.quality, row.weaknesses
    show.messages(messages(warnings, segment), "warning")
    if not warnings:
        show.messages(
            f"α, β and τ are identifiable: no interval spans more than a factor of {WIDE:g},"
            " provided that the model is adequate (tab Model adequacy).",
            "info" if adequacy and adequacy.better else "success",
        )
    st.caption(
        f"Condition number {quality.condition[follower]:.0f} (above {LARGE_CONDITION:.0f} the"
        " model's terms are nearly proportional). Standard deviations: the leader's speed"
        f" {quality.leader_deviation:.2f} m/s, Δv {quality.relative_deviation[follower]:.2f} m/s,"
        f" acceleration {quality.acceleration_deviation[follower]:.2f} m/s²."
    )
    curves = profiles(segment, case)
    lower, upper = (ends.values[follower] for ends in (uncertainty.lower, uncertainty.upper))
    figure = figures.profiles(curves[follower % len(curves)], shown.colour, lower, upper)
    show.chart(figure, "compare_profiles")
    st.caption(
        "Profile of the loss: the misfit of the accelerations with one parameter held and the"
        f" others at their best. Dashed: {100 * INCREASE:.0f} % worse, hardly visible in any plot."
        f" Grey: the {100 * uncertainty.level:.0f} % interval of this model by maximum likelihood."
        " It may lie beside the curve: the curve takes all samples as independent, while the"
        " interval accounts for disturbances that last for seconds and bias the estimate."
    )
    if np.isfinite(shown.answer.parameters.alpha[follower]):
        model = escape_markdown(registry.TITLES[shown.answer.model])
        st.markdown(f"**The answer's model: {model}**")
        show.chart(figures.joint(shown.answer, follower, shown.colour), "compare_joint")
        st.caption(
            "Joint distribution of the answer's typical value; cross: the answer. A slanted cloud"
            " means that two parameters trade off: each alone is known less than both together."
        )


def _show_adequacy(shown: _Shown) -> None:
    """Whether a model with one term more explains the data better."""
    segment = shown.segment
    row = shown.row_of(PAPER)
    adequacy = shown.adequacy or row.adequacy
    if not adequacy.forms:
        st.caption("Too little is measured, or moves, for the likelihood of the model's forms.")
        return
    st.caption(conditional(row, adequacy))
    show.messages(messages(adequacy.findings, segment), icon="lightbulb")
    table = tables.model_form_table(segment.info, adequacy.forms, shown.follower)
    show.table(table)
    show.downloads(table, f"{shown.stem}_model_forms", "compare_forms")
    st.caption(
        "In brackets: the interval under that form, which holds if the form does. Real controllers"
        " keep a distance at standstill and act with a lag and a delay; a model without these terms"
        " shifts them into α, β and τ. The log density is that of held-out time (the last third,"
        " under the form learned from the first two): prefer a form in which both are clearly"
        " above 0. If there is none, the forms show how α, β and τ depend on the assumptions. A"
        f" lag or delay is at least {EXTRA['lag'].lower:g} s, so the likelihood with one can be"
        " below the CTHP's."
    )
    _show_residual(shown)
    _show_disturbance(shown)


def _show_residual(shown: _Shown) -> None:
    """What the model leaves unexplained: its memory, and what it has to do with the car ahead."""
    row = shown.rows[0]
    found = residual_correlations(shown.segment, row.fit, shown.follower)
    if found is None:
        return
    show.chart(figures.residual(found, shown.colour), "compare_residual")
    st.caption(
        f"Residual of dv/dt by {escape_markdown(tables.name_of(row.fit))}, in steps of a second."
        f" Dashed: by chance alone, {CONFIDENCE:.0%} of the bars lie between. Left, bars above:"
        " disturbances last; the first one below: noise of the measured speeds. Right, bars beyond"
        " at lags above zero: the model lacks a part of the response to the car ahead, as a"
        " delay.".replace("%", " %")
    )


def _show_disturbance(shown: _Shown) -> None:
    """What moves the vehicle beside the model's equation, below the data."""
    row = next((row for row in shown.rows if "disturbance" in row.fit.arrays), None)
    if row is None:
        return
    values = row.fit.arrays["disturbance"]
    figure = tracking(shown.segment, shown.follower, None, None, disturbance=values)
    show.chart(figure, "compare_disturbance")
    said = " ".join(about_curves(row, shown.follower))
    st.caption(f"{escape_markdown(said)} Shown is its most probable course, given all data.")


def _show_repeatability(shown: _Shown) -> None:
    _show_starts(shown)
    _show_earlier(shown)


def _show_starts(shown: _Shown) -> None:
    """The paper's Table I for this window."""
    workspace, segment = shown.workspace, shown.segment
    task = workspace.starts
    if task and task.is_active:
        stop_button(task, "Stop the starts", "compare_stop_starts")
    else:
        with st.container(horizontal=True, vertical_alignment="center"):
            names = {name: name.capitalize() for name in PRESETS}
            preset = segments("Preset of the starts", names, "fast", "compare_preset", workspace)
            if st.button("Five starts", icon=":material/casino:", key="compare_starts"):
                workspace.train_starts(PRESETS[preset])
                st.rerun()
        st.caption(
            "Trains the network from five initial values of α, β and τ, as in the paper's Table I."
            " The paper preset takes minutes a start."
        )
    if task is None:
        return

    def draw(polled: bool) -> None:
        if task.results:
            spread = spread_of(task.results)
            table = tables.starts_table(task.results, spread, shown.follower)
            show.table(table)
            if not polled:  # a fragment that polls has no buttons
                show.downloads(table, f"{shown.stem}_starts", "compare_starts")
            show.messages(messages(spread.findings, segment))

    monitor(task, draw)


def _show_earlier(shown: _Shown) -> None:
    """All earlier results, and where there are rows the differences from the present ones."""
    earlier = shown.workspace.earlier
    if not earlier:
        return
    st.subheader("Earlier fits", anchor=False)
    count = len(earlier)
    st.caption(f"Kept from earlier in this session: {count} fit{'s' if count != 1 else ''}.")
    # Of two results of one method the first counts: the second is the session's own training.
    now = {row.analysis.method: row for row in reversed(shown.rows)}
    table = tables.earlier_table(tuple(reversed(earlier)), now, shown.vehicle)
    if table.rows:
        show.table(table)
        show.downloads(table, f"{shown.stem}_earlier_fits", "compare_records")
    else:
        st.caption("None of them has this vehicle as a follower.")
