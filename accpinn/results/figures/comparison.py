"""Methods side by side as figures: estimates, parameters over time, profiles of the loss."""

import html
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import PARAMETERS, TIME
from accpinn.inference.identifiability import INCREASE, Profile
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import ParameterTrack
from accpinn.model.cthp import Parameters
from accpinn.results.figures.style import (
    LEADER,
    SERIES,
    TRUTH,
    band,
    finished,
    limits,
    named_value,
    panels,
    subplots,
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
class NamedEstimate:
    """One row of the chart."""

    name: str
    values: FloatArray
    """(3,) α, β, τ; nan where undetermined."""
    earlier: bool = False
    """From an earlier run, drawn as a ring."""


def estimates(
    rows: Sequence[NamedEstimate],
    colour: str,
    uncertainty: Uncertainty,
    follower: int,
    truth: Parameters | None = None,
) -> go.Figure:
    """A dot a method for each of α, β, τ, over the interval of the data.

    Args:
        rows: from the top down.
        colour: of the vehicle.
        uncertainty: the segment's intervals.
        follower: 0 for the first.
        truth: dashed, where it is known.
    """
    figure = subplots(rows=1, cols=3, shared_yaxes=True, horizontal_spacing=0.03)
    true = truth.values.tolist() if truth else []
    # What stands in brackets takes a line of its own, which leaves narrow windows room for dots.
    names = [html.escape(row.name).replace(" (", "<br>(", 1) for row in rows]
    lower, upper = (ends.values[follower] for ends in (uncertainty.lower, uncertainty.upper))
    for which, quantity in enumerate(PARAMETERS):
        values = np.array([row.values[which] for row in rows])
        marker = {
            "size": 10, "color": colour, "line": {"width": 2, "color": colour},
            "symbol": ["circle-open" if row.earlier else "circle" for row in rows],
        }  # fmt: skip
        dots = go.Scatter(
            x=values, y=names, mode="markers", marker=marker,
            hovertemplate=f"%{{y}}<br>{named_value(quantity, 'x')}<extra></extra>",
        )  # fmt: skip
        ends = float(lower[which]), float(upper[which])
        _add_panel(figure, which, dots, ends, [*values, *true[which : which + 1]])
        if true:
            figure.add_vline(x=true[which], line=TRUTH | {"width": 2}, row=1, col=which + 1)
    figure = finished(figure, 110 + 30 * len(rows), "compare-estimates")
    figure.update_yaxes(
        categoryorder="array", categoryarray=names[::-1], showgrid=True, automargin=True
    )
    return figure.update_layout(hovermode="closest", dragmode=False)


def tracks(
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
        row = which + 1
        late = [np.array(true[which:row])]
        for (title, track), colour, dash in zip(followed, cycle(SERIES), cycle(DASHES)):
            name = html.escape(title)
            values = track.parameters.values[:, follower, which]
            late.append(values[int(EARLY * len(values)) :])
            time, drawn = thinned(start + track.time, values)
            if track.deviation is not None:
                around = track.deviation[:, follower, which]
                late.append(values[-1] + around[-1] * np.array([-1, 1]))
                known = np.flatnonzero(np.isfinite(values) & np.isfinite(around))
                known = known[:: max(1, len(known) // BAND_POINTS)]
                low, high = (values + around * np.array([[-1], [1]]))[:, known]
                figure.add_trace(band(start + track.time[known], low, high, colour, 0.10), row, 1)
            figure.add_scatter(
                x=time, y=drawn, name=name, line={"color": colour, "width": 2, "dash": dash},
                legendgroup=name, showlegend=which == 0,
                hovertemplate=f"{named_value(quantity, 'y')}<extra>{name}</extra>", row=row, col=1,
            )  # fmt: skip
        if true:
            figure.add_hline(y=true[which], line=TRUTH, row=row, col=1)
        shown = limits(np.concatenate(late)) or None
        figure.update_yaxes(title_text=quantity.heading, range=shown, row=row, col=1)
    figure.update_xaxes(title_text=TIME.axis, row=3, col=1)
    return with_legend(finished(figure, 560, "compare-tracks"))


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
    figure = subplots(rows=1, cols=3, shared_yaxes=True, horizontal_spacing=0.03)
    for which, (one, quantity) in enumerate(zip(found, PARAMETERS, strict=True)):
        hover = f"{named_value(quantity, 'x')}: %{{y:.2f}} % worse<extra></extra>"
        curve = go.Scatter(
            x=one.values, y=100 * one.increase, mode="lines",
            line={"color": colour, "width": 2.5}, hovertemplate=hover,
        )  # fmt: skip
        ends = float(lower[which]), float(upper[which])
        _add_panel(figure, which, curve, ends, one.values[[0, -1]])
        limit = {"color": LEADER, "width": 1, "dash": "dash"}
        figure.add_hline(y=100 * INCREASE, line=limit, row=1, col=which + 1)
    figure.update_yaxes(range=[0, 200 * INCREASE])
    figure.update_yaxes(title_text="Worse by [%]", row=1, col=1)
    figure = finished(figure, 240, "compare-profiles")
    return figure.update_layout(hovermode="closest", dragmode=False)


def _add_panel(
    figure: go.Figure, which: int, trace: go.Scatter, ends: tuple[float, float],
    others: Sequence[float] | FloatArray,
) -> None:  # fmt: skip
    """One parameter's panel: its trace over its interval, on an axis that holds them and others."""
    shown = limits(np.array([*ends, *others])) or [0.0, 1.0]
    figure.add_trace(trace, 1, which + 1)
    # After the trace, as plotly draws no area in a panel without one.
    if np.isfinite(ends[0]):
        figure.add_vrect(
            x0=ends[0], x1=min(ends[1], shown[1]), fillcolor=BAND, line_width=0, layer="below",
            row=1, col=which + 1,
        )  # fmt: skip
    figure.update_xaxes(
        title_text=PARAMETERS[which].heading, range=shown, tickangle=0, **ticks(shown), row=1,
        col=which + 1,
    )  # fmt: skip
