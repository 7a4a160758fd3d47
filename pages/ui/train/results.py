"""The result of a training: outcome, tables, curves, downloads."""

from collections.abc import Sequence
from functools import partial

import streamlit as st

from accpinn.evaluation.closed_loop import (
    ClosedLoopFinding,
    TrackingErrors,
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
    surrogate_errors,
)
from accpinn.inference.intervals import Uncertainty
from accpinn.methods import least_squares
from accpinn.methods.fit import Fit, History, Outcome, headway_findings
from accpinn.model.cthp import Parameters
from accpinn.results.figures import training as figures
from accpinn.results.messages import messages
from accpinn.results.messages.methods import outcome_message
from accpinn.results.tables import estimates as tables
from accpinn.results.tables.estimates import intervals_table
from accpinn.segment.quality import Quality, assess_quality
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.tasks.task import Task
from pages.ui.components.charts import show_chart, vehicle_key
from pages.ui.components.messages import format_duration, show_messages
from pages.ui.components.table import show_downloads, show_table, stem_of, vehicle_colours
from pages.ui.components.widgets import pick_follower
from pages.ui.session.workspace import Workspace

FIRST_DRAWING = 1.0
"""Seconds of training before the first curves: a short one would be slowed by drawing it."""


def show_training(training: Task[Fit], truth: Parameters | None, running: bool) -> None:
    """Loss terms and parameters over iterations.

    Args:
        training: whose history is shown as far as it is known.
        truth: the true parameters, where they are known.
        running: nothing is drawn of the first moments.
    """
    history, request = training.history(), training.request
    if history is None or request is None:
        return
    if not running or history.seconds[-1] > FIRST_DRAWING:
        show_history(history, request.segment.info, "train", truth)
        st.caption(
            "Training minimises the loss Ψ, the sum of its terms: Ψ_D, the distance of the"
            " network's curves from the data, and Ψ_F, the residuals of the model's equations."
        )


def show_history(
    history: History, info: SegmentInfo, page: str, truth: Parameters | None = None
) -> None:
    """Loss terms and parameters over iterations.

    Args:
        history: of a training.
        info: names the vehicles.
        page: the beginning of the charts' keys.
        truth: the true parameters, where they are known.
    """
    vehicle_key(info, with_truth=bool(truth))
    loss, *parameters = st.columns(4)
    with loss:
        show_chart(figures.loss_history(history), f"{page}_loss")
    for which, column in enumerate(parameters):
        with column:
            figure = figures.parameter_history(history, which, info, truth)
            show_chart(figure, f"{page}_parameter_{which}")


def show_result(workspace: Workspace) -> None:
    """Everything about the session's training, once it has a fit."""
    fit, segment = workspace.fit, workspace.segment
    if fit is None or segment is None:
        return
    driven = closed_loop(segment, fit)
    errors = surrogate_errors(segment, fit), closed_loop_errors(segment, fit)
    show_fit(
        segment.info, fit, assess_quality(segment), errors, closed_loop_findings(segment, driven),
        workspace.uncertainty(), "train",
    )  # fmt: skip
    show_estimates(segment, fit, workspace.true_parameters)
    st.subheader("Network against data", anchor=False)
    follower = pick_follower(segment, "train_follower")
    show_chart(figures.tracking(segment, follower, fit.surrogate, driven), "train_tracking")


def show_fit(
    info: SegmentInfo,
    fit: Fit,
    quality: Quality,
    errors: tuple[TrackingErrors | None, TrackingErrors | None],
    events: Sequence[ClosedLoopFinding],
    uncertainty: Uncertainty | None,
    page: str,
) -> None:
    """Outcome, parameters, errors and intervals of a fit, and what limits it.

    Args:
        info: names the vehicles.
        fit: the result.
        quality: of the segment.
        errors: of the surrogate and of the closed-loop simulation.
        events: collisions and the like in that simulation.
        uncertainty: of the fit, where it is known.
        page: the beginning of the buttons' keys.
    """
    show_outcome(fit)
    table = partial(tables.parameter_table, info, fit, quality, *errors)
    show_table(table(), vehicle_colours(info))
    st.caption(
        "Surrogate fit: error of the network's own curves, as in the paper's tables. Closed-loop"
        " simulation: error of the simulation with the learned parameters, with only the leader's"
        " speed given. MAE: mean absolute error of space-gap p and speed v."
    )
    after = "The simulation continues, and the closed-loop errors include what follows."
    show_messages(messages(events, info), "warning", "car_crash", after)
    show_intervals(info, uncertainty)
    findings = (*fit.findings, *headway_findings(info.vehicles, fit.parameters))
    show_messages(messages((*findings, *(uncertainty.findings if uncertainty else ())), info))
    show_downloads(table(uncertainty), f"{stem_of(info)}_parameters", page)


def show_intervals(
    info: SegmentInfo,
    uncertainty: Uncertainty | None,
    more: str = "Pages Compare and Stability show more.",
) -> None:
    """Intervals of the parameters and the probability of string stability.

    Args:
        info: names the vehicles.
        uncertainty: None shows nothing.
        more: the end of the caption.
    """
    if uncertainty is None:
        return
    show_table(intervals_table(info, uncertainty), vehicle_colours(info)[1:])
    st.caption(
        "Interval: the values consistent with the data, with disturbances that last for seconds,"
        " as on a road. Probability of string stability: the share of parameter sets consistent"
        f" with the data (posterior samples) that are string stable. {more}"
    )


def show_outcome(fit: Fit) -> None:
    """The outcome, and its cost."""
    took = f"{fit.seconds:.1f} s" if fit.seconds < 60 else format_duration(fit.seconds)
    cost = f"{fit.iterations:,} iterations in {took}, {fit.network_weights:,} network weights."
    cache = " From the cache: this exact request was trained before." if fit.cached else ""
    sentence = f"{outcome_message(fit)}  \n{cost}{cache}"
    if fit.outcome is Outcome.DIVERGED:
        st.error(sentence, icon=":material/error:")
    elif fit.outcome is Outcome.STOPPED:
        st.warning(sentence, icon=":material/pause_circle:")
    else:
        st.success(sentence, icon=":material/check_circle:")


def show_estimates(segment: Segment, fit: Fit, truth: Parameters | None) -> None:
    """The network's parameters beside those of one least-squares solve, and the truth."""
    solved = least_squares.fit(segment, fit.case).parameters
    estimates = {"PiNN": fit.parameters, "Least squares": solved}
    estimates |= {"Truth": truth} if truth else {}
    st.subheader("Comparison with least squares", anchor=False)
    show_table(tables.comparison_table(segment.info, estimates), vehicle_colours(segment)[1:])
