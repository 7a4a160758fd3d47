"""What a training has learned: outcome, table, curves, downloads."""

from pathlib import Path

import streamlit as st

from accpinn.evaluation.closed_loop import (
    ClosedLoopFinding,
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
    surrogate_errors,
)
from accpinn.inference.intervals import Uncertainty
from accpinn.methods import least_squares
from accpinn.methods.fit import Fit, Outcome, headway_notes
from accpinn.model.cthp import Parameters
from accpinn.results.figures.style import vehicle_colour
from accpinn.results.figures.training import tracking
from accpinn.results.messages import messages
from accpinn.results.tables import estimates as tables
from accpinn.results.tables import table as typeset
from accpinn.results.tables.estimates import intervals_table
from accpinn.segment.quality import assess_quality
from accpinn.segment.segment import Segment, SegmentInfo
from pages.ui.components.charts import show_chart
from pages.ui.components.text import bullets, escape_markdown, format_duration
from pages.ui.components.uncertainty import doubt_of_fit
from pages.ui.session.workspace import Workspace


def show_result(workspace: Workspace) -> None:
    """Everything about the session's training, once it has a fit."""
    fit, segment = workspace.fit, workspace.segment
    if fit is None or segment is None:
        return
    show_outcome(fit)
    uncertainty = doubt_of_fit(workspace)
    table = parameter_table(segment, fit)
    colours = [vehicle_colour(n, segment.vehicles[0]) for n in segment.vehicles]
    st.html(typeset.STYLE + table.coloured(colours).to_html())
    st.caption(
        "Surrogate fit: how far the network's own curves are from the data, as the paper's tables"
        " report it. Closed-loop simulation: how far the learned law drives off when it gets the"
        " leader's speed only and everything else is its own doing. MAE: mean absolute error of"
        " space-gap p and speed v."
    )
    show_closed_loop_findings(
        closed_loop_findings(segment, closed_loop(segment, fit)), segment.info
    )
    show_intervals(segment.info, uncertainty)
    notes = fit.notes + headway_notes(segment.labels, fit.parameters)
    if uncertainty:
        notes += messages(uncertainty.findings, segment)
    if notes:
        st.info(bullets(notes), icon=":material/info:")
    downloads(parameter_table(segment, fit, uncertainty), segment.info)
    compare(segment, fit, workspace.true_parameters)
    show_curves(segment, fit)


def show_intervals(
    segment: SegmentInfo,
    uncertainty: Uncertainty | None,
    more: str = "Compare and Stability say more.",
) -> None:
    """What the data leave open about the parameters, whichever method is asked."""
    if uncertainty is None:
        return
    table = intervals_table(segment, uncertainty)
    colours = [vehicle_colour(n, segment.vehicles[0]) for n in segment.vehicles[1:]]
    st.html(typeset.STYLE + table.coloured(colours).to_html())
    st.caption(
        "Interval: the values that the data support where disturbances last for seconds, as on a"
        " road. Stable laws: the share of the laws that the data support that is string stable."
        f" {more}"
    )


def show_closed_loop_findings(findings: tuple[ClosedLoopFinding, ...], info: SegmentInfo) -> None:
    """Collisions, reversing and divergence; the closed-loop errors beside them include these."""
    if findings:
        st.warning(
            f"{bullets(messages(findings, info))}\n\n"
            + escape_markdown(
                "The simulation continues, and the closed-loop errors include what follows."
            ),
            icon=":material/car_crash:",
        )


def show_outcome(fit: Fit) -> None:
    """How it ended, and at what cost."""
    cost = (
        f"{fit.iterations:,} iterations in {_duration(fit.seconds)},"
        f" {fit.network_weights:,} network weights."
    )
    cache = " Answered from the cache: this exact request was trained before." if fit.cached else ""
    sentence = f"{fit.outcome.value}  \n{cost}{cache}"
    if fit.outcome is Outcome.DIVERGED:
        st.error(sentence, icon=":material/error:")
    elif fit.outcome is Outcome.STOPPED:
        st.warning(sentence, icon=":material/pause_circle:")
    else:
        st.success(sentence, icon=":material/check_circle:")


def parameter_table(
    segment: Segment, fit: Fit, uncertainty: Uncertainty | None = None
) -> typeset.Table:
    """As in the paper, with the simulation's errors and the intervals beside."""
    return tables.parameter_table(
        segment.info,
        fit,
        assess_quality(segment),
        surrogate_errors(segment, fit),
        closed_loop_errors(segment, fit),
        uncertainty,
    )


def downloads(table: typeset.Table, segment: SegmentInfo) -> None:
    """The table as files."""
    name = f"{Path(segment.source).stem}_parameters"
    with st.container(horizontal=True):
        st.download_button(
            "CSV",
            table.to_csv(),
            f"{name}.csv",
            "text/csv",
            on_click="ignore",
            icon=":material/download:",
        )
        st.download_button(
            "LaTeX",
            table.to_latex(),
            f"{name}.tex",
            "application/x-tex",
            on_click="ignore",
            icon=":material/download:",
        )


def compare(segment: Segment, fit: Fit, truth: Parameters | None) -> None:
    """The network's parameters beside those of one least-squares solve, and the truth."""
    estimates = {
        "PiNN": fit.parameters,
        "Least squares": least_squares.fit(segment, fit.case).parameters,
    }
    if truth:
        estimates["Truth"] = truth
    table = tables.comparison_table(segment.info, estimates)
    colours = [vehicle_colour(n, segment.vehicles[0]) for n in segment.vehicles[1:]]
    st.subheader("Beside other estimates", anchor=False)
    st.html(typeset.STYLE + table.coloured(colours).to_html())


def show_curves(segment: Segment, fit: Fit) -> None:
    """Network against data, a follower at a time."""
    st.subheader("Network against data", anchor=False)
    follower = 0
    if segment.followers > 1:
        follower = st.selectbox(
            "Follower",
            range(segment.followers),
            format_func=lambda k: segment.labels[k + 1],
            key="train_follower",
            width=320,
        )
    driven = closed_loop(segment, fit)
    figure = tracking(segment, follower, fit.surrogate, driven)
    show_chart(figure, "train_tracking")


def _duration(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 60 else format_duration(seconds)
