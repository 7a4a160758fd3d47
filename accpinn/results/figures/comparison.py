"""Methods side by side as figures: estimates, parameters over time, profiles of the loss."""

import html
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import PARAMETERS, TIME
from accpinn.evaluation.whiteness import ResidualCorrelations
from accpinn.inference.identifiability import INCREASE, Profile
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import ParameterTrack
from accpinn.model.cthp import Parameters
from accpinn.results.figures import style
from accpinn.units import FloatArray, Seconds

BAND = "rgba(128, 140, 155, 0.20)"
BAND_POINTS = 400
DASHES = ("solid", "dash", "dot")
EARLY = 0.25
"""The share of an online method's track, while it still converges, that does not set the axis."""


@dataclass(frozen=True, eq=False)
class NamedEstimate:
    """A method's estimate: one row of the chart."""

    name: str
    values: FloatArray
    """(3,) α, β, τ; nan where undetermined."""
    earlier: bool = False
    """Whether it is from an earlier run, which is drawn as a ring."""
    ends: FloatArray | None = None
    """(2, 3) lower and upper ends of its own interval, drawn as a bar."""


def estimates(
    rows: Sequence[NamedEstimate],
    colour: str,
    uncertainty: Uncertainty,
    follower: int,
    truth: Parameters | None = None,
) -> go.Figure:
    """A dot a method for each of α, β, τ of one follower (0 for the first), over the intervals.

    The rows are given from the top down; the truth is dashed, where it is known. Intervals of a
    row's own are bars.
    """
    true = truth.values.tolist() if truth else []
    # What stands in brackets takes a line of its own, which leaves narrow windows room for dots.
    names = [html.escape(row.name).replace(" (", "<br>(", 1) for row in rows]
    marker = {
        "size": 10, "color": colour, "line": {"width": 2, "color": colour},
        "symbol": ["circle-open" if row.earlier else "circle" for row in rows],
    }  # fmt: skip
    values = np.array([row.values for row in rows])
    known = [[row.values] * 2 if row.ends is None else row.ends for row in rows]
    low, high = np.moveaxis(np.array(known), 1, 0)
    traces = [
        {"x": column, "y": names, "mode": "markers", "marker": marker, **style.axes_of(which + 1),
         "error_x": {"type": "data", "symmetric": False, "array": high[:, which] - column,
                     "arrayminus": column - low[:, which], "width": 0, "thickness": 2},
         "hovertemplate": f"%{{y}}<br>{style.named_value(quantity, 'x')}<extra></extra>"}
        for which, (quantity, column) in enumerate(zip(PARAMETERS, values.T, strict=True))
    ]  # fmt: skip
    lower, upper = (ends.values[follower] for ends in (uncertainty.lower, uncertainty.upper))
    others = [[*column, *low[:, k], *high[:, k], *true[k : k + 1]]
              for k, column in enumerate(values.T)]  # fmt: skip
    lines = [style.across(style.axes_of(k + 1)["xaxis"], value, line=style.TRUTH | {"width": 2})
             for k, value in enumerate(true)]  # fmt: skip
    categories = {"categoryorder": "array", "categoryarray": names[::-1], "showgrid": True,
                  "automargin": True}  # fmt: skip
    return _beside_each_other(
        traces, 110 + 30 * len(rows), "compare-estimates", lower, upper, others, lines, categories
    )


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
        truth: the true parameters, dashed.
        start: the segment's start, in s from the recording's first sample.
    """
    true = truth.values.tolist() if truth else []
    traces, axes = list[style.Part](), dict[str, style.Part]()
    for which, quantity in enumerate(PARAMETERS):
        panel = style.axes_of(which + 1)
        late = [np.array(true[which : which + 1])]
        for (title, track), colour, dash in zip(followed, cycle(style.SERIES), cycle(DASHES)):
            name = html.escape(title)
            values = track.parameters.values[:, follower, which]
            late.append(values[int(EARLY * len(values)) :])
            if track.deviation is not None:
                around = track.deviation[:, follower, which]
                late.append(values[-1] + around[-1] * np.array([-1, 1]))
                known = np.flatnonzero(np.isfinite(values) & np.isfinite(around))
                known = known[:: max(1, len(known) // BAND_POINTS)]
                low, high = (values + around * np.array([[-1], [1]]))[:, known]
                traces.append(
                    style.band(start + track.time[known], low, high, colour, 0.10, **panel)
                )
            traces.append(style.curve(
                start + track.time, values, name=name, legendgroup=name, showlegend=which == 0,
                line={"color": colour, "width": 2, "dash": dash}, **panel,
                hovertemplate=f"{style.named_value(quantity, 'y')}<extra>{name}</extra>",
            ))  # fmt: skip
        shown = style.limits(np.concatenate(late)) or None
        axes[panel["yaxis"]] = style.titled(quantity.heading) | {"range": shown}
    shapes = [
        style.across(style.axes_of(k + 1)["yaxis"], value, line=style.TRUTH)
        for k, value in enumerate(true)
    ]
    axes["x3"] = style.titled(TIME.axis)
    return style.with_legend(
        style.composed(
            traces, 560, "compare-tracks", axes, grid=style.stack(1, 1, 1), shapes=shapes
        )
    )


def residual(found: ResidualCorrelations, colour: str) -> go.Figure:
    """Correlations of a residual with itself and with the acceleration ahead, and their limits."""
    parts = (
        (found.lags, found.own, found.own_limit, "Residual with itself"),
        (found.ahead_lags, found.ahead, found.ahead_limit, "Residual after acceleration ahead"),
    )
    traces, lines, axes = list[style.Part](), list[style.Part](), dict[str, style.Part]()
    limit = {"color": style.LEADER, "width": 1, "dash": "dash"}
    shown = 1.1 * max(np.abs([*values, 2 * most]).max() for _, values, most, _ in parts)
    for panel, (lags, values, most, title) in enumerate(parts, 1):
        at = style.axes_of(panel)
        traces.append(
            {"type": "bar", "x": lags, "y": values, "marker": {"color": colour}, **at,
             "hovertemplate": "%{x:.0f} s: %{y:.2f}<extra></extra>"}
        )  # fmt: skip
        lines += [style.across(at["yaxis"], end, line=limit) for end in (-most, most)]
        axes[at["xaxis"]] = style.titled(f"{title}: lag [s]")
        axes[at["yaxis"]] = {"range": [-shown, shown]}
    return style.composed(
        traces, 240, "compare-residual", axes, {"x": {}, "y": {}}, style.row(2, 0.06), shapes=lines,
        hovermode="closest", dragmode=False,
    )  # fmt: skip


def profiles(
    profiled: Sequence[Profile], colour: str, lower: FloatArray, upper: FloatArray
) -> go.Figure:
    """The increase of the least-squares criterion with α, β or τ held, in percent.

    Behind the profiles are the intervals: (3,) lower ends, nan where there is none, and (3,) upper
    ends, which may be infinite.
    """
    traces = [
        {"x": profile.values, "y": 100 * profile.increase, "mode": "lines",
         "line": {"color": colour, "width": 2.5}, **style.axes_of(which + 1),
         "hovertemplate": f"{style.named_value(quantity, 'x')}: %{{y:.2f}} % worse<extra></extra>"}
        for which, (profile, quantity) in enumerate(zip(profiled, PARAMETERS, strict=True))
    ]  # fmt: skip
    limit = {"color": style.LEADER, "width": 1, "dash": "dash"}
    lines = [
        style.across(style.axes_of(panel)["yaxis"], 100 * INCREASE, line=limit)
        for panel in (1, 2, 3)
    ]
    ends = [profile.values[[0, -1]] for profile in profiled]
    figure = _beside_each_other(
        traces, 240, "compare-profiles", lower, upper, ends, lines, {"range": [0, 200 * INCREASE]}
    )
    return figure.update_layout(yaxis_title_text="Worse by [%]")


def _beside_each_other(
    traces: Sequence[style.Part], height: int, revision: str, lower: FloatArray, upper: FloatArray,
    others: Sequence[Sequence[float] | FloatArray], lines: Sequence[style.Part],
    vertical: style.Part,
) -> go.Figure:  # fmt: skip
    """A panel for each of α, β, τ: its interval, on an axis that holds that and the others."""
    axes, areas = dict[str, style.Part](), list[style.Part]()
    for which, quantity in enumerate(PARAMETERS):
        ends = float(lower[which]), float(upper[which])
        shown = style.limits(np.array([*ends, *others[which]])) or [0.0, 1.0]
        panel = style.axes_of(which + 1)
        if np.isfinite(ends[0]):
            areas.append(style.across(
                panel["xaxis"], ends[0], min(ends[1], shown[1]), fillcolor=BAND, line={"width": 0},
                layer="below",
            ))  # fmt: skip
        axes[panel["xaxis"]] = style.titled(quantity.heading) | {
            "range": shown,
            **style.ticks(shown),
        }
    return style.composed(
        traces, height, revision, axes, {"x": {"tickangle": 0}, "y": vertical}, style.row(3, 0.03),
        shapes=[*areas, *lines], hovermode="closest", dragmode=False,
    )  # fmt: skip
