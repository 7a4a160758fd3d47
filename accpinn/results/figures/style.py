"""The common looks: colours, panels, and no more points than a screen has columns.

Colours and grid are chosen to be read on light and on dark pages alike; texts take the page's
colour.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.colors import hex_to_rgb
from plotly.subplots import make_subplots

from accpinn.channels import TIME, Quantity
from accpinn.units import FloatArray

LEADER = "#7e8490"
FOLLOWERS = (
    "#0c7eae", "#d8660c", "#8a5af0", "#18a070", "#9c4e36",
    "#e0487a", "#3660ba", "#96862a", "#a83690", "#6090f6",
)  # fmt: skip
"""Ten followers; each has a contrast of 3 or more on white and on the dark page, and the first few
differ most under normal, red-blind and green-blind vision."""
SERIES = ("#55900f", "#d01cb4", "#84549c")
"""Lines that are of no vehicle, as methods or terms of a loss; unlike every vehicle's colour, with
the same contrast."""
SHARED = SERIES[2]
"""What all followers share, as the parameters of Case I."""
MODEL = "#c22f4f"
"""The closed-loop simulation, beside the vehicle's own colour for its data."""
GRID = "rgba(128, 140, 155, 0.25)"
CLEAR = "rgba(0,0,0,0)"
TRUTH = {"color": LEADER, "width": 1.5, "dash": "dash"}
"""The line at a true value."""
LEGEND = {"orientation": "h", "x": 0, "y": 1.01, "yanchor": "bottom"}
"""Above a figure."""
LINE = 20
"""Pixels of a line of a legend."""
POINTS = 1500
"""Kept per trace at most; a screen has no more columns."""


def vehicle_colour(number: int, leader: int) -> str:
    """The colour of a vehicle, by its number in the file; the platoon's leader has its own.

    Number 0 stands for all followers together.
    """
    if number == 0:
        return SHARED
    return LEADER if number in (leader, 1) else FOLLOWERS[(number - 2) % len(FOLLOWERS)]


def vehicle_colours(vehicles: Sequence[int], numbers: Sequence[int] | None = None) -> list[str]:
    """The colour of each of the ``vehicles``, leader first, or of those with other ``numbers``."""
    return [vehicle_colour(number, vehicles[0]) for number in numbers or vehicles]


def translucent(colour: str, opacity: float) -> str:
    """A colour #rrggbb that shows what lies beneath."""
    red, green, blue = hex_to_rgb(colour)
    return f"rgba({red}, {green}, {blue}, {opacity})"


def band(
    x: FloatArray, low: FloatArray, high: FloatArray, colour: str, opacity: float, name: str = ""
) -> go.Scatter:
    """The area between two lines over (K,) ``x``; in no legend."""
    return go.Scatter(
        x=np.concatenate([x, x[::-1]]), y=np.concatenate([low, high[::-1]]), mode="none",
        fill="toself", fillcolor=translucent(colour, opacity), hoverinfo="skip", name=name,
        showlegend=False,
    )  # fmt: skip


def limits(values: FloatArray) -> list[float]:
    """Axis limits around what is finite, with 8 % of its range as margin; else empty."""
    values = values[np.isfinite(values)]
    if not len(values):
        return []
    low, high = float(values.min()), float(values.max())
    rim = max(0.08 * (high - low), 0.02 * abs(high), 1e-4)
    return [low - rim, high + rim]


def thinned(time: FloatArray, values: FloatArray, points: int = POINTS) -> tuple[FloatArray, ...]:
    """At most about ``points`` of (N,) samples: lowest and highest of each bin, and every hole.

    Unlike plain decimation this keeps peaks, and a missing block still breaks the line.
    """
    count = len(values)
    bins = points // 2
    if count <= points:
        return time, values
    width = -(-count // bins)
    padded = np.full(bins * width, np.nan)
    padded[:count] = values
    table = padded.reshape(bins, width)
    missing = np.isnan(table)
    kept = [
        np.where(missing, np.inf, table).argmin(axis=1),
        np.where(missing, -np.inf, table).argmax(axis=1),
        missing.argmax(axis=1),
    ]
    offsets = np.arange(bins) * width
    rows = np.unique(np.concatenate([[0, count - 1], *(offsets + at for at in kept)]))
    rows = rows[rows < count]
    return time[rows], values[rows]


def ticks(ends: Sequence[float]) -> dict[str, Any]:
    """Two or three round values on an axis too short for more, where plotly may name only one."""
    low, high = ends
    decade = 10.0 ** np.floor(np.log10(high - low))
    for factor in (5.0, 2.0, 1.0, 0.5, 0.2):
        step = factor * decade
        first, last = np.ceil(low / step), np.floor(high / step)
        if last > first:
            break
    values = step * np.arange(first, last + 1, 2 if last - first > 2 else 1)
    digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return {"tickvals": values, "ticktext": [f"{v + 0.0:.{digits}f}" for v in values]}


def panels(*heights: float, spacing: float = 0.05) -> go.Figure:
    """Stacked panels over one axis of time, with their relative heights from the top down."""
    return subplots(
        rows=len(heights), cols=1, shared_xaxes=True, row_heights=heights, vertical_spacing=spacing
    )


def subplots(**options: Any) -> go.Figure:
    """What plotly's `make_subplots` gives, in a tenth of the time from the second call on."""
    return go.Figure(_subplots(**options))


@lru_cache(maxsize=32)
def _subplots(**options: Any) -> go.Figure:
    """To be copied: without a template, which plotly would check in every copy."""
    figure = make_subplots(**options)
    figure.layout.template = None
    return figure


def label_axes(figure: go.Figure, channels: Sequence[Quantity], lowest: int = 0) -> None:
    """Name and unit of each panel's channel, from the top down, and of the time below the lowest.

    The lowest panel is by default that of the last channel.
    """
    for row, channel in enumerate(channels, 1):
        figure.update_yaxes(title_text=channel.axis, row=row, col=1)
    figure.update_xaxes(title_text=TIME.axis, row=lowest or len(channels), col=1)


def named_value(quantity: Quantity, axis: str) -> str:
    """What a point says when hovered over: τ = 1.5200 s."""
    return f"{quantity.symbol} = %{{{axis}:.4f}} {quantity.unit}"


def with_legend(figure: go.Figure) -> go.Figure:
    """The figure with a legend, for where no key stands beside it, as in a file of its own.

    Every figure knows which of its traces a legend names: those that have a name and do not refuse.
    It stands above the figure, or below where a title is in the way.
    """
    figure.for_each_trace(lambda trace: trace.update(showlegend=False), lambda one: not one.name)
    entries = sum(trace.showlegend is not False for trace in figure.data)
    if not entries:
        return figure
    if figure.layout.title.text:
        legend = LEGEND | {"y": 0, "yref": "container"}
        height = figure.layout.height + LINE * entries
        return figure.update_layout(showlegend=True, legend=legend, height=height)
    margin = max(figure.layout.margin.t or 0, 34)
    return figure.update_layout(showlegend=True, legend=LEGEND, margin_t=margin)


def finished(figure: go.Figure, height: int, revision: str) -> go.Figure:
    """Common looks; ``revision`` keeps the user's zoom while data change.

    Margins are fixed: with those that follow the labels every chart is laid out twice.
    """
    # One by one, as an update of many properties takes three times as long.
    for axis in (*figure.select_xaxes(), *figure.select_yaxes()):
        axis.gridcolor, axis.automargin = GRID, False
        axis.zeroline = axis.showline = False
    layout = figure.layout
    layout.height, layout.showlegend = height, False
    layout.hovermode, layout.uirevision = "x unified", revision
    layout.paper_bgcolor = layout.plot_bgcolor = CLEAR
    layout.margin = {"l": 62, "r": 14, "t": 10, "b": 42}
    return figure
