"""Methods side by side as figures: estimates, curves against data, parameters over time."""

import html
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
import plotly.graph_objects as go
from plotly.colors import hex_to_rgb
from plotly.subplots import make_subplots

from accpinn.channels import GAP, PARAMETERS, SPEED, TIME, Quantity
from accpinn.inference.identifiability import INCREASE, Profile
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import ParameterTrack
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.results.figures.style import (
    GRID,
    LEADER,
    MODEL,
    SERIES,
    finished,
    label_axes,
    thinned,
    ticks,
    vehicle_colour,
    with_legend,
)
from accpinn.results.figures.training import tracking
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

BAND = "rgba(128, 140, 155, 0.20)"
DASHES = ("solid", "dash", "dot")
SETTLED = 0.25
"""The first quarter of an online method's course does not set the axis: it still finds its way."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """One row of the chart."""

    name: str
    values: FloatArray
    """(3,) α, β, τ; nan where undetermined."""
    earlier: bool = False
    """From an earlier run, drawn as a ring."""


def estimates(
    rows: Sequence[Estimate],
    colour: str,
    uncertainty: Uncertainty,
    follower: int,
    truth: Parameters | None = None,
    chosen: str = "",
) -> go.Figure:
    """A dot a method for each of α, β, τ, over the interval that the data support.

    Args:
        rows: from the top down.
        colour: of the vehicle.
        uncertainty: the segment's intervals.
        follower: 0 for the first.
        truth: dashed, where it is known.
        chosen: the name of the row that is drawn larger.
    """
    figure = make_subplots(rows=1, cols=3, shared_yaxes=True, horizontal_spacing=0.03)
    true = (truth.alpha, truth.beta, truth.tau) if truth else ()
    # What stands in brackets takes a line of its own, which leaves narrow windows room for dots.
    names = [html.escape(row.name).replace(" (", "<br>(", 1) for row in rows]
    for which, quantity in enumerate(PARAMETERS):
        column = which + 1
        values = np.array([row.values[which] for row in rows])
        low, high = uncertainty.lower.values, uncertainty.upper.values
        ends = float(low[follower, which]), float(high[follower, which])
        shown = _range(np.concatenate([values, ends, true[which : which + 1]]))
        figure.add_scatter(
            x=values,
            y=names,
            mode="markers",
            customdata=[row.name for row in rows],
            marker={
                "size": [15 if row.name == chosen else 10 for row in rows],
                "color": colour,
                "opacity": 1,
                "symbol": ["circle-open" if row.earlier else "circle" for row in rows],
                "line": {"width": 2, "color": colour},
            },
            selected={"marker": {"opacity": 1}},
            unselected={"marker": {"opacity": 1}},
            hovertemplate=f"%{{y}}<br>{_hover(quantity, 'x')}<extra></extra>",
            row=1,
            col=column,
        )
        _add_interval(figure, column, ends, shown)
        if true:
            figure.add_vline(
                x=true[which], line={"color": LEADER, "width": 2, "dash": "dash"}, row=1, col=column
            )
        _name_axis(figure, column, shown)
    figure = finished(figure, 110 + 30 * len(rows), "compare-estimates")
    figure.update_yaxes(
        categoryorder="array", categoryarray=names[::-1], showgrid=True, automargin=True
    )
    figure.update_layout(hovermode="closest", dragmode=False, clickmode="event+select")
    return figure


def curves(
    segment: Segment,
    follower: int,
    surrogate: Trajectories | None,
    closed_loop: Trajectories | None,
    own: str,
) -> go.Figure:
    """Gap, speed and the error of the gap of one method over one axis of time.

    Args:
        segment: the data.
        follower: 0 for the first.
        surrogate: the method's own trajectories.
        closed_loop: its simulation behind the measured leader.
        own: how its trajectories are called.
    """
    upper = tracking(segment, follower, surrogate, closed_loop, own)
    figure = make_subplots(
        rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.36, 0.32, 0.32]
    )
    for trace in upper.data:
        row = 1 if trace.yaxis in (None, "y") else 2
        figure.add_trace(trace, row=row, col=1)
    for line_at_zero in upper.layout.shapes:
        figure.add_shape(line_at_zero)
    colour = vehicle_colour(segment.vehicles[follower + 1], segment.vehicles[0])
    lines = (
        (own, surrogate, {"color": colour, "width": 1.5}),
        ("closed-loop simulation", closed_loop, {"color": MODEL, "width": 1.5, "dash": "dot"}),
    )
    for name, source, line in lines:
        if source is None:
            continue
        error = (source.gaps - segment.gaps)[:, follower]
        time, error = thinned(segment.window.start + source.time, error)
        figure.add_scatter(
            x=time,
            y=error,
            name=name,
            line=line,
            legendgroup=name,
            showlegend=False,
            hovertemplate=f"%{{y:.2f}} {GAP.unit}<extra>{name}, error</extra>",
            row=3,
            col=1,
        )
    label_axes(figure, (GAP, SPEED))
    figure.update_yaxes(title_text=f"Error of gap [{GAP.unit}]", row=3, col=1)
    figure.add_hline(y=0, line={"color": GRID, "width": 1.5}, row=3, col=1)
    figure.update_xaxes(title_text=TIME.axis, row=3, col=1)
    return with_legend(finished(figure, 620, "compare-curves"))


def courses(
    followed: Sequence[tuple[str, ParameterTrack]],
    follower: int,
    truth: Parameters | None = None,
    start: Seconds = 0.0,
) -> go.Figure:
    """α, β and τ over time as online methods followed them, one standard deviation around each.

    Args:
        followed: name and course of each method.
        follower: 0 for the first.
        truth: dashed, where it is known.
        start: of the segment, in s from the recording's first sample.
    """
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    true = (truth.alpha, truth.beta, truth.tau) if truth else ()
    for which, quantity in enumerate(PARAMETERS):
        late = [np.array(true[which : which + 1])]
        for (name, track), colour, dash in zip(followed, cycle(SERIES), cycle(DASHES)):
            values = track.parameters.values[:, follower, which]
            late.append(values[int(SETTLED * len(values)) :])
            if track.deviation is not None:
                late.append(values[-1] + track.deviation[-1, follower, which] * np.array([-1, 1]))
            time, shown = thinned(start + track.time, values)
            if track.deviation is not None:
                around = track.deviation[:, follower, which]
                figure.add_trace(_ribbon(start + track.time, values, around, colour), which + 1, 1)
            figure.add_scatter(
                x=time,
                y=shown,
                name=name,
                line={"color": colour, "width": 2, "dash": dash},
                legendgroup=name,
                showlegend=which == 0,
                hovertemplate=f"{_hover(quantity, 'y')}<extra>{name}</extra>",
                row=which + 1,
                col=1,
            )
        if true:
            line = {"color": LEADER, "width": 1.5, "dash": "dash"}
            figure.add_hline(y=true[which], line=line, row=which + 1, col=1)
        figure.update_yaxes(
            title_text=quantity.heading, range=_range(np.concatenate(late)), row=which + 1,
            col=1,
        )  # fmt: skip
    figure.update_xaxes(title_text=TIME.axis, row=3, col=1)
    return with_legend(finished(figure, 560, "compare-courses"))


def profiles(
    found: Sequence[Profile], colour: str, lower: FloatArray, upper: FloatArray
) -> go.Figure:
    """The increase of the least-squares criterion with one parameter held, in percent.

    Args:
        found: of α, β, τ.
        colour: of the vehicle.
        lower: (3,) ends of the intervals behind the profiles; nan where there is none.
        upper: (3,) may be infinite.
    """
    figure = make_subplots(rows=1, cols=3, shared_yaxes=True, horizontal_spacing=0.03)
    for which, (one, quantity) in enumerate(zip(found, PARAMETERS, strict=True)):
        column, ends = which + 1, (float(lower[which]), float(upper[which]))
        shown = _range(np.array([*ends, one.values[0], one.values[-1]]))
        figure.add_scatter(
            x=one.values,
            y=100 * one.increase,
            mode="lines",
            line={"color": colour, "width": 2.5},
            hovertemplate=f"{_hover(quantity, 'x')}: %{{y:.2f}} % worse<extra></extra>",
            row=1,
            col=column,
        )
        _add_interval(figure, column, ends, shown)
        figure.add_hline(
            y=100 * INCREASE, line={"color": LEADER, "width": 1, "dash": "dash"}, row=1, col=column
        )
        _name_axis(figure, column, shown)
    figure.update_yaxes(range=[0, 200 * INCREASE])
    figure.update_yaxes(title_text="Worse by [%]", row=1, col=1)
    figure = finished(figure, 240, "compare-profiles")
    return figure.update_layout(hovermode="closest", dragmode=False)


def _add_interval(
    figure: go.Figure, column: int, ends: tuple[float, float], shown: Sequence[float]
) -> None:
    """An interval behind one panel; to be added after its lines, as plotly draws none without."""
    if np.isfinite(ends[0]):
        figure.add_vrect(
            x0=ends[0], x1=min(ends[1], shown[1]), fillcolor=BAND, line_width=0, layer="below",
            row=1, col=column,
        )  # fmt: skip


def _name_axis(figure: go.Figure, column: int, shown: Sequence[float]) -> None:
    title = PARAMETERS[column - 1].heading
    figure.update_xaxes(
        title_text=title, range=shown, tickangle=0, **ticks(shown), row=1, col=column
    )


def _hover(quantity: Quantity, axis: str) -> str:
    return f"{quantity.symbol} = %{{{axis}:.4f}} {quantity.unit}"


def _ribbon(time: FloatArray, values: FloatArray, around: FloatArray, colour: str) -> go.Scatter:
    """The area of one deviation on either side, where both are known."""
    known = np.flatnonzero(np.isfinite(values) & np.isfinite(around))
    known = known[:: max(1, len(known) // 400)]
    t, middle, width = time[known], values[known], around[known]
    red, green, blue = hex_to_rgb(colour)
    return go.Scatter(
        x=np.concatenate([t, t[::-1]]),
        y=np.concatenate([middle - width, (middle + width)[::-1]]),
        mode="none",
        fill="toself",
        fillcolor=f"rgba({red}, {green}, {blue}, 0.10)",
        hoverinfo="skip",
        showlegend=False,
    )


def _range(values: FloatArray) -> list[float]:
    """Axis limits around what is finite."""
    values = values[np.isfinite(values)]
    if not len(values):
        return [0.0, 1.0]
    low, high = float(values.min()), float(values.max())
    margin = max(0.08 * (high - low), 0.02 * abs(high), 1e-4)
    return [low - margin, high + margin]
