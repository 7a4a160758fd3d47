"""Methods side by side as figures: estimates, parameters over time, profiles of the loss."""

import html
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from accpinn.channels import PARAMETERS, TIME, Quantity
from accpinn.inference.identifiability import INCREASE, Profile
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import ParameterTrack
from accpinn.model.cthp import Parameters
from accpinn.results.figures.style import (
    LEADER,
    SERIES,
    band,
    finished,
    limits,
    panels,
    thinned,
    ticks,
    with_legend,
)
from accpinn.units import FloatArray, Seconds

BAND = "rgba(128, 140, 155, 0.20)"
BAND_POINTS = 400
DASHES = ("solid", "dash", "dot")
EARLY = 0.25
"""The share of an online method's track, while it still converges, that does not set the axis."""


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
    """A dot a method for each of α, β, τ, over the interval of the data.

    Args:
        rows: from the top down.
        colour: of the vehicle.
        uncertainty: the segment's intervals.
        follower: 0 for the first.
        truth: dashed, where it is known.
        chosen: the name of the row that is drawn larger.
    """
    figure = make_subplots(rows=1, cols=3, shared_yaxes=True, horizontal_spacing=0.03)
    true = truth.values.tolist() if truth else []
    # What stands in brackets takes a line of its own, which leaves narrow windows room for dots.
    names = [html.escape(row.name).replace(" (", "<br>(", 1) for row in rows]
    for which, quantity in enumerate(PARAMETERS):
        column = which + 1
        values = np.array([row.values[which] for row in rows])
        low, high = uncertainty.lower.values, uncertainty.upper.values
        ends = float(low[follower, which]), float(high[follower, which])
        shown = limits(np.concatenate([values, ends, true[which : which + 1]])) or [0.0, 1.0]
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


def courses(
    followed: Sequence[tuple[str, ParameterTrack]],
    follower: int,
    truth: Parameters | None = None,
    start: Seconds = 0.0,
) -> go.Figure:
    """α, β and τ over time as online methods estimate them, one standard deviation around each.

    Args:
        followed: name and track of each method.
        follower: 0 for the first.
        truth: dashed, where it is known.
        start: of the segment, in s from the recording's first sample.
    """
    figure = panels(1, 1, 1)
    true = truth.values.tolist() if truth else []
    for which, quantity in enumerate(PARAMETERS):
        late = [np.array(true[which : which + 1])]
        for (name, track), colour, dash in zip(followed, cycle(SERIES), cycle(DASHES)):
            values = track.parameters.values[:, follower, which]
            late.append(values[int(EARLY * len(values)) :])
            time, shown = thinned(start + track.time, values)
            if track.deviation is not None:
                around = track.deviation[:, follower, which]
                late.append(values[-1] + around[-1] * np.array([-1, 1]))
                known = np.flatnonzero(np.isfinite(values) & np.isfinite(around))
                known = known[:: max(1, len(known) // BAND_POINTS)]
                low, high = (values + around * np.array([[-1], [1]]))[:, known]
                figure.add_trace(
                    band(start + track.time[known], low, high, colour, 0.10), which + 1, 1
                )
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
            title_text=quantity.heading, range=limits(np.concatenate(late)) or None, row=which + 1,
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
        shown = limits(np.array([*ends, one.values[0], one.values[-1]])) or [0.0, 1.0]
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
