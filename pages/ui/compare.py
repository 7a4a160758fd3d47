"""The page Compare: the methods' estimates and errors side by side, and car-following models."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import streamlit as st

from accpinn.evaluation.residuals import CONFIDENCE, residual_correlations
from accpinn.inference.identifiability import WIDE
from accpinn.inference.model_adequacy import Adequacy
from accpinn.methods import Segments
from accpinn.methods.estimate import ParameterTrack, of_window
from accpinn.methods.pinn.config import QUICK
from accpinn.methods.registry import COMPARED
from accpinn.methods.state_space import EXTRA
from accpinn.model import registry
from accpinn.model.registry import PAPER
from accpinn.results.figures import comparison as figures
from accpinn.results.figures.style import vehicle_colours
from accpinn.results.figures.training import tracking, tracking_of
from accpinn.results.messages import incidents, messages
from accpinn.results.messages.summary import about_curves, agreement, conditional, recommended_of
from accpinn.results.naming import name_of
from accpinn.results.tables import estimates as tables
from accpinn.segment.quality import LARGE_CONDITION
from accpinn.study.comparison import Refused, spread_of
from accpinn.study.result import Result
from accpinn.tasks import compared_seconds
from accpinn.units import nanmean
from pages.ui import models
from pages.ui.components import frame, show
from pages.ui.components.monitor import monitor, own_task_line, stop_button
from pages.ui.components.result import banner
from pages.ui.components.show import escape_markdown, pick, segments, select, tabs
from pages.ui.session.resources import title_of_variant
from pages.ui.session.workspace import TITLE_OF, Workspace

GAP_ERROR = "A constant error of the measured gap shifts τ: 0.1 m in 30 m by 0.3 %."
ONLINE = "α, β, τ by the online methods"
"""Choice of the online methods' tracks in place of one method's curves."""
VIEWS = {"methods": "Methods of estimation", "models": "Car-following models"}
MOST = 8
"""Earlier estimates over the chart at once."""


@dataclass(eq=False)
class _Shown:
    """Data, results and follower that the parts of the page show."""

    workspace: Workspace
    data: Segments
    """(K,) the windows."""
    rows: tuple[Result, ...]
    """The methods'; none before a comparison."""
    follower: int
    """0 for the first."""

    def __post_init__(self) -> None:
        """Derive the follower's number, colour and truth, and the `stem` of file names."""
        truth, vehicles = self.workspace.true_parameters, self.data[0].vehicles
        self.segment = self.data[0]
        self.stem = Path(self.segment.source).stem
        self.truth = truth[self.follower] if truth else None
        self.vehicle = vehicles[self.follower + 1]
        self.colour = vehicle_colours(vehicles)[self.follower + 1]
        self.recommended = recommended_of(self.rows)

    @cached_property
    def adequacy(self) -> Adequacy:
        """The forms of the model, by the comparison or by its first row."""
        task = self.workspace.comparison
        forms = (part for part in (task.results if task else ()) if isinstance(part, Adequacy))
        return next(forms, None) or self.rows[0].adequacy


def show_page(workspace: Workspace) -> None:
    task, rows = workspace.comparison, workspace.compared
    if not workspace.segment:
        frame.empty_state(workspace, "Nothing to compare on")
        return
    if workspace.restored and task is None:
        banner(workspace)
    data = rows[0].segments if rows else workspace.segments
    about = st.empty()
    show.not_acc(data[0])
    with st.container(horizontal=True, vertical_alignment="center"):
        view = segments("Compare", VIEWS, "methods", "compare_view", workspace)
        place = st.container(horizontal=True, vertical_alignment="center", width="content")
    if view == "models":
        models.show_models(workspace, about)
        return
    windows = [segment.window for segment in data]
    about.caption(frame.segment_line(data[0], workspace.selection.case, windows))
    with place:
        _show_start(workspace, data)
    if task:
        monitor(task, lambda running: _show(workspace, data, running))
    elif rows:
        _show(workspace, data, running=False)
    else:
        _show_before(workspace)
        if workspace.restarts or workspace.earlier:
            follower = pick(workspace, data[0].labels[1:], "compare_follower")
            _show_repeatability(_Shown(workspace, data, (), follower))


def _show_start(workspace: Workspace, data: Segments) -> None:
    """The button that starts the comparison, or stops it."""
    task = workspace.comparison
    if task and task.is_active:
        stop_button(task, "Stop", "compare_stop")
        return
    takes = show.format_duration(sum(compared_seconds(data).values()))
    complete = task is not None and len(task.results) == len(task.names)
    if not complete and st.button(
        f"Run all methods (about {takes})", type="primary", icon=":material/play_arrow:",
        key="compare_run",
    ):  # fmt: skip
        workspace.compare()
        st.rerun()


def _show_before(workspace: Workspace) -> None:
    """The text of the page before a comparison."""
    training = workspace.training
    if training and training.is_active:
        first = own_task_line(training, training.time_left)
        st.caption(f"{first} The methods would run after it.")
    st.markdown(
        f"{len(COMPARED)} methods estimate the same cars from the same windows: those of the"
        " paper's model (α, β, τ), and those that estimate s₀ and d, too. Each gets its errors."
    )


def _show(workspace: Workspace, data: Segments, running: bool) -> None:
    """The rows so far; choices and longer computations come once all methods have ended."""
    task, rows = workspace.comparison, workspace.compared
    if running:
        if rows:
            show.table(tables.compared_table(rows, 0, recommended_of(rows)))
        return
    outcomes = task.results if task else ()
    _show_failures([outcome for outcome in outcomes if isinstance(outcome, Refused)])
    if not rows:
        return
    every = workspace.compared_with_training()
    if recommended := recommended_of(every):
        sentence, more = map(escape_markdown, agreement(every, recommended))
        if sentence:
            st.markdown(f"**{sentence}**", help=more or None)
    with st.container(horizontal=True, vertical_alignment="center"):
        follower = pick(workspace, data[0].labels[1:], "compare_follower")
        shown = _Shown(workspace, data, every, follower)
        earlier = _choose_earlier(shown)
        label = "Next: which model describes these cars?"
        frame.ask_which_model(workspace, label, "compare_next", "tertiary")
    _show_estimates(shown, earlier)
    tabs(workspace, "compare_tabs", {
        "Numbers": lambda: _show_numbers(shown),
        "Errors": lambda: _show_errors(shown),
        "Curves": lambda: _show_course(shown),
        "Identifiability": lambda: _show_identifiability(shown),
        "Model adequacy": lambda: _show_adequacy(shown),
        "Repeatability": lambda: _show_repeatability(shown),
    })  # fmt: skip


def _show_estimates(shown: _Shown, earlier: Sequence[figures.Row]) -> None:
    """Where the estimates of one follower lie, by the model that they are of."""
    follower, recommended = shown.follower, shown.recommended
    points = [figures.row_of(row, follower) for row in shown.rows if row is not recommended]
    above = figures.row_of(recommended, follower) if recommended else None
    show.chart(
        figures.estimates(points, shown.colour, above, shown.truth, earlier), "compare_estimates"
    )
    level = 100 * (recommended.estimate.level or 0) if recommended else 0
    interval = f"Shaded: the recommended {level:.0f} % interval; square: outside it." * bool(level)
    parts = [interval, "Dashed: true value." * bool(shown.truth),
             "Open diamonds: earlier estimates." * bool(earlier)]  # fmt: skip
    show.caption(
        " ".join(filter(None, parts)),
        "Parameters of different models mean different things: beside an intercept s₀ τ is smaller,"
        " and beside a delay d the gains are others. The time gap in the table can be compared.",
    )


def _show_numbers(shown: _Shown) -> None:
    """The same as one table, each model's parameters in columns of their own."""
    of = shown.rows, shown.follower, shown.recommended
    show.table(tables.compared_table(*of))
    show.downloads(tables.methods_table(*of), f"{shown.stem}_methods", "compare")


def _show_errors(shown: _Shown) -> None:
    """Each method's errors with their scale, and the events of its simulation."""
    of = shown.rows, shown.follower, shown.recommended
    show.table(tables.compared_errors_table(*of))
    gap = np.concatenate([part.measured_gaps[:, shown.follower] for part in shown.data])
    is_partial = not all(row.evaluation.blocks for row in shown.rows)
    st.caption(
        "For scale, the mean absolute deviation of the measured space-gap is"
        f" {nanmean(abs(gap - nanmean(gap))):.2f} m. {GAP_ERROR}"
        + " Hold-out is not computed for your own training."
        * is_partial
    )
    _show_collisions(shown)


def _show_collisions(shown: _Shown) -> None:
    """The events of the closed-loop simulations by method, as one line that opens."""
    info, rows = shown.segment.info, shown.rows
    happened = {name_of(row.estimate): incidents(row.evaluation, info) for row in rows}
    count = sum(map(len, happened.values()))
    if not count:
        return
    times = [row.evaluation.collision_times(info.vehicles) for row in rows]
    colliding = int(np.isfinite(times).any(axis=0).sum())
    title = f"{colliding} of {info.followers} followers collide" if colliding else (
        "No follower collides on these data"
    )  # fmt: skip
    with st.expander(
        f"{title} in closed-loop simulation by some method's parameters; {count}"
        f" {'event' if count == 1 else 'events'} in all, inside and outside the windows",
        icon=":material/car_crash:",
    ):
        for name, sentences in happened.items():
            if sentences:
                st.markdown(f"**{escape_markdown(name)}**\n\n{show.bullets(sentences)}")


def _show_failures(failures: Sequence[Refused]) -> None:
    reasons: dict[str, list[str]] = {}
    for failure in failures:
        reasons.setdefault(str(failure.fault), []).append(title_of_variant(failure.method))
    sentences = [
        f"No result from {', '.join(who) if len(who) < len(COMPARED) else 'any method'}: {why}"
        for why, who in reasons.items()
    ]
    show.messages(sentences, "warning")


def _show_course(shown: _Shown) -> None:
    """One method's curves against the data, or the parameters over time of the online methods."""
    by_name = {name_of(row.estimate): row for row in shown.rows}
    tracks = [(n, row.estimate.track) for n, row in by_name.items() if row.estimate.track]
    options = [*by_name, *([ONLINE] if tracks else [])]
    with st.container(horizontal=True):
        name = select(
            "Over time", dict(zip(options, options, strict=True)), options[0], "compare_method",
            shown.workspace, width=320,
            help="A method's curves against the data, or how the online methods' estimates of α, β"
            " and τ move as samples come in.",
        )  # fmt: skip
        names = [str(part.window) for part in shown.data]
        window = pick(shown.workspace, names, "compare_window", label="Window", labelled=True)
    if name == ONLINE:
        _show_tracks(shown, tracks)
    else:
        st.subheader(f"{escape_markdown(name)} against the data", anchor=False)
        show.chart(tracking_of(by_name[name], shown.follower, window), "compare_curves")


def _choose_earlier(shown: _Shown) -> list[figures.Row]:
    """Earlier estimates of the session to lay over the chart."""
    rows: dict[str, figures.Row] = {}
    for row in reversed(shown.workspace.earlier):
        if shown.vehicle in row.info.vehicles[1:]:
            follower = row.info.vehicles.index(shown.vehicle) - 1
            title = f"{len(rows) + 1}. {tables.earlier_title(row)}"
            rows[title] = figures.row_of(row, follower)._replace(name=title)
    if not rows:
        return []
    with st.popover("Earlier estimates", icon=":material/history:"):
        chosen = st.multiselect(
            "Earlier estimates to lay over the chart", list(rows), key="compare_earlier",
            max_selections=MOST, placeholder=f"{len(rows)} kept",
        )  # fmt: skip
    return [rows[name] for name in chosen if name in rows]


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
    """Which parameters the data determine."""
    segment, follower, row = shown.segment, shown.follower, shown.recommended
    if row is None:
        st.caption("No method with intervals has run; the recommended one has them.")
        return
    quality, warnings = row.quality, row.weaknesses
    show.messages(messages(warnings, segment), "warning")
    if not warnings:
        show.messages(
            f"α, β and τ are identifiable: no interval spans more than a factor of {WIDE:g},"
            " provided that the model is adequate (tab Model adequacy).",
            "info" if shown.adequacy.better else "success",
        )
    st.caption(
        f"Condition number {quality.condition[follower]:.0f} (above {LARGE_CONDITION:.0f} the"
        " model's terms are nearly proportional). Standard deviations: the leader's speed"
        f" {quality.leader_deviation:.2f} m/s, Δv {quality.relative_deviation[follower]:.2f} m/s,"
        f" acceleration {quality.acceleration_deviation[follower]:.2f} m/s²."
    )
    if np.isfinite(row.estimate.parameters.alpha[follower]):
        show.chart(figures.joint(row.estimate, follower, shown.colour), "compare_joint")
        st.caption(
            "Joint distribution of the typical value; cross: the estimate. A slanted cloud means"
            " that two parameters trade off: each alone is known less than both together."
        )


def _show_adequacy(shown: _Shown) -> None:
    """Whether a model with one term more explains the data better."""
    segment, row, adequacy = shown.segment, shown.recommended or shown.rows[0], shown.adequacy
    if not adequacy.forms:
        st.caption("Too little is measured, or moves, for the likelihood of the model's forms.")
        return
    st.caption(conditional(row, adequacy))
    show.messages(messages(adequacy.findings, segment), icon="lightbulb")
    table = tables.model_form_table(segment.info, adequacy.forms, shown.follower)
    show.table(table)
    show.downloads(table, f"{shown.stem}_model_forms", "compare_forms")
    show.caption(
        f"In the window {segment.window}: prefer a form in which both differences are clearly above"
        " 0.",
        "In brackets: the interval under that form, which holds if the form does. Real controllers"
        " keep a distance at standstill and act with a lag and a delay; a model without these terms"
        " shifts them into α, β and τ. The log density is that of held-out time (the last third,"
        " under the form learned from the first two). A lag or delay is at least"
        f" {EXTRA['lag'].lower:g} s, so the likelihood with one can be below the CTHP's.",
    )
    _show_residual(shown, row)
    _show_disturbance(shown, row)


def _show_residual(shown: _Shown, row: Result) -> None:
    """The residual's correlation with its past and with the car ahead."""
    correlograms = residual_correlations(shown.segment, row.estimate, shown.follower)
    if correlograms is None:
        return
    show.chart(figures.residual(correlograms, shown.colour), "compare_residual")
    show.caption(
        f"Residual of dv/dt by {name_of(row.estimate)}. Dashed: by chance alone,"
        f" {100 * CONFIDENCE:.0f} % of the bars lie between.",
        "In steps of a second. Left, bars above: disturbances last; the first one below: noise of"
        " the measured speeds. Right, bars beyond at lags above zero: the model lacks a part of the"
        " response to the car ahead, as a delay.",
    )


def _show_disturbance(shown: _Shown, row: Result) -> None:
    """The estimated disturbance of the model's equation below the data."""
    values = of_window(row.estimate.arrays, 0).get("disturbance")
    if values is None:
        return
    figure = tracking(shown.segment, shown.follower, disturbance=values)
    show.chart(figure, "compare_disturbance")
    sentences = " ".join(about_curves(row, shown.follower))
    st.caption(f"{escape_markdown(sentences)} Shown is its most probable course, given all data.")


def _show_repeatability(shown: _Shown) -> None:
    _show_restarts(shown)
    _show_earlier(shown)


def _show_restarts(shown: _Shown) -> None:
    """The paper's Table I for these data."""
    workspace, segment = shown.workspace, shown.segment
    task = workspace.restarts
    if task and task.is_active:
        stop_button(task, "Stop the starts", "compare_stop_starts")
    else:
        with st.container(horizontal=True, vertical_alignment="center"):
            preset = segments("Preset of the starts", TITLE_OF, QUICK, "compare_preset", workspace)
            if st.button("Five starts", icon=":material/casino:", key="compare_starts"):
                workspace.train_restarts(preset)
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
    st.subheader("Earlier estimates", anchor=False)
    count = len(earlier)
    st.caption(f"Kept from earlier in this session: {count} estimate{'s' if count != 1 else ''}.")
    # Of two results of one method the first counts: the second is the session's own training.
    now = {row.analysis.method: row for row in reversed(shown.rows)}
    table = tables.earlier_table(tuple(reversed(earlier)), now, shown.vehicle)
    if table.rows:
        show.table(table)
        show.downloads(table, f"{shown.stem}_earlier", "compare_records")
    else:
        st.caption("None of them has this vehicle as a follower.")
