"""The common looks: colours, panels, axes, lines, bands, and no more points than a screen shows.

A figure is composed at once from its traces and its layout, both plain dictionaries: plotly checks
them together in a third of the time that it takes piece by piece. Colours and grid are chosen to be
read on light and on dark pages alike; texts take the page's colour.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache, reduce
from operator import or_
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.colors import hex_to_rgb
from plotly.subplots import make_subplots

from accpinn.channels import TIME, Quantity
from accpinn.units import FloatArray

Part = dict[str, Any]
"""A trace (a scatter one by default), a shape, an axis or an annotation, in plotly's terms."""

LEADER = "#7e8490"
FOLLOWERS = (
    "#0c7eae", "#d8660c", "#8a5af0", "#18a070", "#9c4e36",
    "#e0487a", "#3660ba", "#96862a", "#a83690", "#6090f6",
)  # fmt: skip
"""Ten followers; each has a contrast of 3 or more on white and on the dark page, and the first few
differ most under normal, red-blind and green-blind vision."""
SERIES = ("#55900f", "#d01cb4", "#84549c")
"""Lines that belong to no vehicle, as methods or terms of a loss; unlike every vehicle's colour,
with the same contrast."""
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
"""Height of a line of a legend, in pixels."""
POINTS = 1500
"""Largest number of points a trace; a screen has no more columns."""
AXIS: Part = {"gridcolor": GRID, "automargin": False, "zeroline": False, "showline": False}
"""Every axis. Margins are fixed: with those that follow the labels a chart is laid out twice."""


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


def composed(
    traces: Iterable[Part],
    height: int,
    revision: str,
    axes: Mapping[str, Part] | None = None,
    every: Mapping[str, Part] | None = None,
    grid: Mapping[str, Part] | None = None,
    channels: Sequence[Quantity] = (),
    top: int = 10,
    **layout: Any,
) -> go.Figure:
    """A figure with the common looks.

    Args:
        traces: from the lowest layer up; those of a figure with several panels name theirs.
        height: of the figure, in pixels.
        revision: keeps the user's zoom while the data change.
        axes: what differs from the common looks, by their names in traces, as "y2".
        every: what all horizontal ("x") or vertical ("y") axes share beyond them.
        grid: a `stack` of panels or a `row` of them; by default there is one panel.
        channels: of a stack's panels, from the top down: titles of their axes, above that of time.
        top: margin in pixels.
        layout: further properties.
    """
    grid = grid or {"x": {}, "y": {}}
    titles = {f"y{_place(panel)}": titled(q.axis) for panel, q in enumerate(channels, 1)}
    if channels:
        titles[[name for name in grid if name[0] == "x"][-1]] = titled(TIME.axis)
    for name in {**grid, **(axes or {})}:
        parts = (grid, titles, axes or {})
        look = AXIS | (every or {}).get(name[0], {})
        layout[f"{name[0]}axis{name[1:]}"] = reduce(or_, (p.get(name, {}) for p in parts), look)
    page = {
        "height": height, "showlegend": False, "hovermode": "x unified", "uirevision": revision,
        "paper_bgcolor": CLEAR, "plot_bgcolor": CLEAR,
        "margin": {"l": 62, "r": 14, "t": top, "b": 42},
    }  # fmt: skip
    return go.Figure([*traces], page | layout)


def thumbnail(
    curves: Iterable[Part], axes: Mapping[str, Part] | None = None, shapes: Sequence[Part] = ()
) -> go.Figure:
    """A small picture of lines without axes, to choose something by."""
    lines = [{"mode": "lines", "hoverinfo": "skip", **line} for line in curves]
    hidden = {"visible": False}
    return composed(
        lines, 110, "thumbnail", axes, {"x": hidden, "y": hidden}, shapes=shapes, hovermode=False,
        margin={"l": 0, "r": 0, "t": 4, "b": 4},
    )  # fmt: skip


def stack(*heights: float, spacing: float = 0.05) -> Mapping[str, Part]:
    """Panels over one axis of time, with their relative heights from the top down."""
    return _grid(
        rows=len(heights), cols=1, shared_xaxes=True, row_heights=heights, vertical_spacing=spacing
    )


def row(count: int, spacing: float) -> Mapping[str, Part]:
    """Panels beside each other with one vertical scale."""
    return _grid(rows=1, cols=count, shared_yaxes=True, horizontal_spacing=spacing)


def matrix(count: int) -> Mapping[str, Part]:
    """As many rows as columns of panels, with one scale in each row and each column."""
    return _grid(
        rows=count, cols=count, shared_xaxes=True, shared_yaxes=True,
        horizontal_spacing=0.02, vertical_spacing=0.03,
    )  # fmt: skip


@lru_cache(maxsize=32)
def _grid(**options: Any) -> Mapping[str, Part]:
    """The axes of plotly's `make_subplots`, which takes long."""
    layout = make_subplots(**options).layout.to_plotly_json()
    return {name.replace("axis", ""): part for name, part in layout.items() if "axis" in name}


def titled(text: str) -> Part:
    """An axis with a title."""
    return {"title": {"text": text}}


def _place(panel: int) -> str:
    return str(panel) if panel > 1 else ""


def axes_of(panel: int) -> Part:
    """The axes of a panel, counted from 1; none for a figure that has only one."""
    place = _place(panel)
    return {"xaxis": f"x{place}", "yaxis": f"y{place}"} if panel else {}


def curve(x: FloatArray, y: FloatArray, panel: int = 0, points: int = POINTS, **look: Any) -> Part:
    """A line through (N,) samples, with no more of them than are seen."""
    x, y = thinned(x, y, points)
    return {"x": x, "y": y, **axes_of(panel), **look}


def across(axis: str, low: float, high: float | None = None, **look: Any) -> Part:
    """A line at a value of an axis, or the area between two values, through its whole panel."""
    along, other, place = axis[0], "xy".replace(axis[0], ""), axis[1:]
    return {
        "type": "line" if high is None else "rect", f"{along}ref": axis, f"{along}0": low,
        f"{along}1": low if high is None else high, f"{other}ref": f"{other}{place} domain",
        f"{other}0": 0, f"{other}1": 1, **look,
    }  # fmt: skip


def band(
    x: FloatArray, low: FloatArray, high: FloatArray, colour: str, opacity: float, name: str = "",
    panel: int = 0, **look: Any,
) -> Part:  # fmt: skip
    """The area between two lines over (K,) ``x``; in no legend unless ``look`` says so."""
    return {
        "x": np.concatenate([x, x[::-1]]), "y": np.concatenate([low, high[::-1]]), "mode": "none",
        "fill": "toself", "fillcolor": translucent(colour, opacity), "hoverinfo": "skip",
        "name": name, "showlegend": False, **axes_of(panel), **look,
    }  # fmt: skip


def corner(text: str, x: float, y: float) -> Part:
    """A few words in a corner of the axes, at shares of their lengths."""
    return {
        "text": text, "xref": "x domain", "x": x, "xanchor": "left" if x < 0.5 else "right",
        "yref": "y domain", "y": y, "yanchor": "bottom" if y < 0.5 else "top", "showarrow": False,
    }  # fmt: skip


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


def named_value(quantity: Quantity, axis: str) -> str:
    """The text shown when a point is hovered over: τ = 1.5200 s."""
    return f"{quantity.symbol} = %{{{axis}:.4f}} {quantity.unit}"


def with_legend(figure: go.Figure) -> go.Figure:
    """The figure with a legend, for where no key stands beside it, as in a file of its own.

    Every figure knows which of its traces a legend names: those that have a name and do not refuse.
    It stands above the figure, or below where a title is in the way.
    """
    for trace in figure.data:
        if not trace.name:
            trace.showlegend = False
    entries = sum(trace.showlegend is not False for trace in figure.data)
    if not entries:
        return figure
    layout, margin = figure.layout, figure.layout.margin
    layout.showlegend = True
    if layout.title.text:
        layout.legend = LEGEND | {"y": 0, "yref": "container"}
        layout.height += LINE * entries
    else:
        layout.legend, margin.t = LEGEND, max(margin.t or 0, 34)
    return figure
