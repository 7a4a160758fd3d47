"""A training while it runs: loss, α, β and τ over iterations, and the fit to the data below."""

from collections.abc import Sequence

import streamlit as st

from accpinn.methods import least_squares
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters
from accpinn.results.figures.live import TERMS, LiveChart, live_history, live_motion
from accpinn.results.figures.style import LEADER, MODEL, SERIES
from accpinn.tasks.task import Task
from accpinn.units import Seconds
from pages.ui.components import show

FIRST_DRAWING: Seconds = 1.0
"""Of training before the first curves: a short one would be slowed by drawing it."""


def show_live(training: Task[Fit], truth: Parameters | None) -> None:
    """What is known so far of a training that runs.

    Args:
        training: whose history is shown as far as it is known.
        truth: the true parameters, where they are known.
    """
    history, request = training.history(), training.request
    if history is None or request is None or history.seconds[-1] <= FIRST_DRAWING:
        return
    segment, case = request.segment, request.case
    shared = case == "I" and segment.followers > 1
    solved = least_squares.fit(segment, case).parameters
    loss, alpha, beta, tau = live_history(history, segment.info, truth, solved)
    show.vehicle_key(segment, bool(truth), shared, with_solved=True)
    show.key(zip((f"loss: {name}" for name in TERMS), (LEADER, *SERIES), strict=True))
    _show_row((loss, alpha))
    _show_row((beta, tau))
    if curves := training.surrogate:
        # Widgets must not stand in what is drawn again and again: it is the first follower's.
        show.key(((f"data of {segment.labels[1]}", LEADER), ("the network now", MODEL)))
        _show_row(live_motion(segment, 0, curves))


def _show_row(charts: Sequence[LiveChart]) -> None:
    colour = show.ink(st.context.theme.type)
    axes = {"config": {"axis": {"labelColor": colour, "titleColor": colour}}} if colour else {}
    for column, chart in zip(st.columns(len(charts)), charts, strict=True):
        column.vega_lite_chart(chart.data, chart.spec | axes, key=f"train_live_{chart.name}")
