"""Results as plotly figures: pure functions, transparent grounds, one colour per vehicle.

Colours and grid are chosen to be read on light and on dark pages alike; texts take the page's
colour. Vehicle names come from files, so they are escaped: plotly reads a little HTML.
"""

import html
from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from accpinn.channels import GAP, SPEED, TIME, Channel
from accpinn.cthp import Trajectories
from accpinn.openacc import Mode, Recording
from accpinn.runs import runs
from accpinn.segment import Segment
from accpinn.segment.missing import Window
from accpinn.units import FloatArray

LEADER = "#7e8490"
FOLLOWERS = (
    "#0c7eae", "#d8660c", "#8a5af0", "#18a070", "#9c4e36",
    "#e0487a", "#3660ba", "#96862a", "#a83690", "#6090f6",
)  # fmt: skip
"""Ten followers; each has a contrast of 3 or more on white and on the dark page, and the first few
differ most under normal, red-blind and green-blind vision."""
MODEL = "#c22f4f"
"""What the law drives in closed loop, beside the vehicle's own colour for its data."""
MISSING = "#c22f4f"
WINDOW = "rgba(12, 126, 174, 0.16)"
GRID = "rgba(128, 140, 155, 0.25)"
FAINT = 0.35
"""Opacity of what is not chosen."""

POINTS = 1500
"""Kept per trace at most; a screen has no more columns."""


def vehicle_colour(number: int, leader: int) -> str:
    """The colour of a vehicle, by its number in the file; the platoon's leader has its own."""
    return LEADER if number in (leader, 1) else FOLLOWERS[(number - 2) % len(FOLLOWERS)]


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


def overview(recording: Recording, vehicles: Sequence[int], window: Window) -> go.Figure:
    """Speeds and gaps of a whole recording, the window on it, and who drove or is missing."""
    ribbons = _ribbons(recording)
    heights = [0.5, 0.36, 0.14] if ribbons else [0.58, 0.42]
    figure = _panels(len(heights), heights)
    for number in recording.present:
        chosen = number in vehicles
        label = _label(recording, number)
        colour = vehicle_colour(number, vehicles[0])
        _line(figure, recording.time, recording.speed_of(number), 1, label, colour, chosen)
        if number > 1 and number - 1 in recording.present:
            gap = recording.gap_behind(number - 1)
            followed = chosen and number != vehicles[0]
            _line(figure, recording.time, gap, 2, label, colour, followed)
    for trace in ribbons:
        figure.add_trace(trace, row=3, col=1)
    if ribbons:
        figure.update_yaxes(
            row=3,
            col=1,
            title_text="Vehicle",
            type="category",
            showgrid=False,
            categoryorder="array",
            categoryarray=sorted({t.y[0] for t in ribbons}, reverse=True),
        )
    figure.add_shape(
        type="rect",
        xref="x",
        yref="paper",
        x0=window.start,
        x1=window.end,
        y0=0,
        y1=1,
        fillcolor=WINDOW,
        line={"color": FOLLOWERS[0], "width": 1.5},
        layer="below",
    )
    _label_axes(figure, (SPEED, GAP))
    figure.update_xaxes(range=[0, recording.duration], title_text="")
    figure.update_xaxes(title_text=TIME.axis, row=len(heights), col=1)
    figure.update_layout(dragmode="select", selectdirection="h")
    return finished(figure, 470 if ribbons else 430, f"overview-{recording.sha256}")


def preview(segment: Segment) -> go.Figure:
    """The speeds of a segment, to look at rather than to work with."""
    figure = go.Figure()
    for column, number in enumerate(segment.vehicles):
        colour = vehicle_colour(number, segment.vehicles[0])
        label = html.escape(segment.labels[column])
        time, values = thinned(segment.time, segment.speeds[:, column], 600)
        figure.add_scatter(x=time, y=values, name=label, line={"color": colour, "width": 2})
    figure.update_yaxes(title_text=SPEED.axis)
    figure.update_xaxes(title_text=TIME.axis)
    return finished(figure, 330, "preview")


def tracking(
    segment: Segment,
    follower: int,
    surrogate: Trajectories | None,
    closed_loop: Trajectories | None,
) -> go.Figure:
    """Gap and speed of one follower: data, the network's curve, and the law in closed loop.

    Args:
        segment: the data.
        follower: 0 for the first.
        surrogate: the method's own trajectories.
        closed_loop: the law driving behind the measured leader.
    """
    figure = _panels(2, [0.5, 0.5])
    number = segment.vehicles[follower + 1]
    colour = vehicle_colour(number, segment.vehicles[0])
    sources = (
        ("data", segment, {"color": colour, "width": 3.5}, 0.45),
        ("network", surrogate, {"color": colour, "width": 1.5}, 1.0),
        ("closed-loop simulation", closed_loop, {"color": MODEL, "width": 1.5, "dash": "dot"}, 1.0),
    )
    for name, source, line, opacity in sources:
        if source is None:
            continue
        for row, values in ((1, source.gaps[:, follower]), (2, source.speeds[:, follower + 1])):
            time, shown = thinned(segment.time, values)
            figure.add_scatter(
                x=time,
                y=shown,
                name=name,
                line=line,
                opacity=opacity,
                legendgroup=name,
                showlegend=row == 1,
                row=row,
                col=1,
            )
    _label_axes(figure, (GAP, SPEED))
    figure.update_xaxes(title_text=TIME.axis, row=2, col=1)
    figure = finished(figure, 460, f"tracking-{number}")
    legend = {"orientation": "h", "x": 0, "y": 1.01, "yanchor": "bottom"}
    return figure.update_layout(showlegend=True, legend=legend, margin_t=34)


def _panels(rows: int, heights: list[float]) -> go.Figure:
    """Stacked panels over one time axis."""
    return make_subplots(
        rows=rows, cols=1, shared_xaxes=True, row_heights=heights, vertical_spacing=0.05
    )


def _line(
    figure: go.Figure,
    time: FloatArray,
    values: FloatArray,
    row: int,
    label: str,
    colour: str,
    chosen: bool,
) -> None:
    x, y = thinned(time, values)
    figure.add_scatter(
        x=x,
        y=y,
        name=label,
        mode="lines",
        connectgaps=False,
        line={"color": colour, "width": 1.8 if chosen else 1},
        opacity=1 if chosen else FAINT,
        row=row,
        col=1,
    )


def has_ribbons(recording: Recording) -> bool:
    """Whether `overview` has bars for stretches driven by hand or missing."""
    return bool(_ribbons(recording))


def _ribbons(recording: Recording) -> list[go.Scatter]:
    """A bar for each stretch driven by hand or missing; none where all is well."""
    by_hand = recording.mode == Mode.HUMAN
    missing = np.isnan(recording.speed)
    if not (recording.mode == Mode.ACC).any():
        by_hand = np.zeros_like(missing)  # a recording without ACC is by hand throughout
    traces = []
    for number in recording.present:
        colour = vehicle_colour(number, 1)
        for name, mask, paint in (("by hand", by_hand, colour), ("missing", missing, MISSING)):
            x: list[float | None] = []
            for run in runs(mask[:, number - 1]):
                x += [float(recording.time[run.first]), float(recording.time[run.last]), None]
            if x:
                traces.append(
                    go.Scatter(
                        x=x,
                        y=[str(number)] * len(x),
                        name=f"{number} {name}",
                        mode="lines",
                        line={"color": paint, "width": 7},
                    )
                )
    return traces


def _label(recording: Recording, number: int) -> str:
    name = recording.vehicles[number - 1].name
    return html.escape(name if name == f"Vehicle {number}" else f"{number} {name}")


def _label_axes(figure: go.Figure, channels: tuple[Channel, ...]) -> None:
    for row, channel in enumerate(channels, 1):
        figure.update_yaxes(title_text=channel.axis, row=row, col=1)


def finished(figure: go.Figure, height: int, revision: str) -> go.Figure:
    """Common looks; ``revision`` keeps the user's zoom while data change."""
    figure.update_xaxes(gridcolor=GRID, zeroline=False, showline=False)
    figure.update_yaxes(gridcolor=GRID, zeroline=False, showline=False)
    return figure.update_layout(
        height=height,
        showlegend=False,
        hovermode="x unified",
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        margin={"l": 8, "r": 8, "t": 10, "b": 8},
        uirevision=revision,
    )
