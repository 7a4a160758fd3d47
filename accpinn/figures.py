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
from accpinn.cthp import Parameters, Trajectories
from accpinn.fit import History
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
WINDOW = "rgba(12, 126, 174, 0.16)"
GRID = "rgba(128, 140, 155, 0.25)"
FAINT = 0.35
"""Opacity of what is not chosen."""

POINTS = 1500
"""Kept per trace at most; a screen has no more columns."""
FEW = 30
"""So few moments of a training are marked one by one."""


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
            row=3, col=1, title_text="Vehicle", type="category", showgrid=False,
            categoryorder="array", categoryarray=[str(n) for n in reversed(recording.present)],
        )  # fmt: skip
    figure.add_shape(
        type="rect", xref="x", yref="paper", x0=window.start, x1=window.end, y0=0, y1=1,
        fillcolor=WINDOW, line={"color": FOLLOWERS[0], "width": 1.5}, layer="below",
    )  # fmt: skip
    _label_axes(figure, (SPEED, GAP))
    figure.update_xaxes(range=[0, recording.duration], title_text="")
    figure.update_xaxes(title_text=TIME.axis, row=len(heights), col=1)
    figure.update_layout(dragmode="select", selectdirection="h")
    return _finished(figure, 470 if ribbons else 430, f"overview-{recording.sha256}")


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
    return _finished(figure, 330, "preview")


def loss_course(history: History) -> go.Figure:
    """The loss terms over iterations, on a logarithmic axis."""
    figure = go.Figure()
    terms = (
        ("Ψ", history.total, LEADER, 3.0),
        ("Ψ_D data", history.data, FOLLOWERS[0], 1.5),
        ("Ψ_F physics", history.physics, FOLLOWERS[1], 1.5),
        ("Ψ_R start", history.initial, FOLLOWERS[2], 1.5),
    )
    mode = _mode_for(len(history.iteration))
    for name, values, colour, width in terms:
        if values.any():
            figure.add_scatter(
                x=history.iteration, y=np.where(values > 0, values, np.nan), name=name,
                mode=mode, line={"color": colour, "width": width}, marker={"size": 4},
            )  # fmt: skip
    figure.update_yaxes(type="log", title_text="Loss", exponentformat="power")
    legend = {"x": 1, "xanchor": "right", "y": 1, "yanchor": "top", "bgcolor": "rgba(0,0,0,0)"}
    return _course(figure, "Loss and its terms", "loss").update_layout(
        showlegend=True, legend=legend
    )


def parameter_course(
    history: History,
    which: int,
    segment: Segment,
    truth: Sequence[Parameters] = (),
) -> go.Figure:
    """One parameter over iterations, dashed where the truth is known.

    Args:
        history: parameters (K, P, 3), P = 1 in Case I.
        which: 0 for α, 1 for β, 2 for τ.
        segment: whose vehicles they belong to.
        truth: one entry a follower, or nothing.
    """
    name, unit, title = (("α", "1/s²", "Gain on spacing"), ("β", "1/s", "Gain on relative speed"),
                         ("τ", "s", "Time headway"))[which]  # fmt: skip
    figure = go.Figure()
    sets = history.parameters.shape[1]
    leader = segment.vehicles[0]
    for k in range(sets):
        shared = sets == 1 and segment.followers > 1
        label = "all followers" if shared else html.escape(segment.labels[k + 1])
        colour = LEADER if shared else vehicle_colour(segment.vehicles[k + 1], leader)
        figure.add_scatter(
            x=history.iteration, y=history.parameters[:, k, which], name=label,
            mode=_mode_for(len(history.iteration)), line={"color": colour, "width": 2},
            marker={"size": 4},
        )  # fmt: skip
    true = [(law.alpha, law.beta, law.tau)[which] for law in truth]
    for k, value in enumerate(true):
        colour = vehicle_colour(segment.vehicles[k + 1], leader)
        figure.add_hline(y=value, line={"color": colour, "width": 1.5, "dash": "dash"})
    figure.update_yaxes(title_text=f"{name} [{unit}]", range=_settled_range(history, which, true))
    return _course(figure, title, f"parameter-{which}")


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
                x=time, y=shown, name=name, line=line, opacity=opacity, legendgroup=name,
                showlegend=row == 1, row=row, col=1,
            )  # fmt: skip
    _label_axes(figure, (GAP, SPEED))
    figure.update_xaxes(title_text=TIME.axis, row=2, col=1)
    figure = _finished(figure, 460, f"tracking-{number}")
    legend = {"orientation": "h", "x": 0, "y": 1.01, "yanchor": "bottom"}
    return figure.update_layout(showlegend=True, legend=legend, margin_t=34)


def _course(figure: go.Figure, title: str, revision: str) -> go.Figure:
    """The looks of a small panel over iterations."""
    figure.update_xaxes(title_text="Iteration")
    figure = _finished(figure, 250, revision)
    return figure.update_layout(
        title={"text": title, "font": {"size": 13}, "x": 0, "y": 0.97}, margin_t=34
    )


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
        x=x, y=y, name=label, mode="lines", connectgaps=False,
        line={"color": colour, "width": 1.8 if chosen else 1}, opacity=1 if chosen else FAINT,
        row=row, col=1,
    )  # fmt: skip


def _ribbons(recording: Recording) -> list[go.Scatter]:
    """A bar a vehicle for each stretch driven by hand or missing; empty where all is well."""
    traces = []
    kinds = (
        ("driven by hand", recording.mode == Mode.HUMAN, FOLLOWERS[1]),
        ("missing", np.isnan(recording.speed), LEADER),
    )
    mixed = (recording.mode == Mode.ACC).any()
    for name, mask, colour in kinds:
        if name == "driven by hand" and not mixed:
            continue
        x: list[float | None] = []
        y: list[str | None] = []
        for number in recording.present:
            for run in runs(mask[:, number - 1]):
                x += [float(recording.time[run.first]), float(recording.time[run.last]), None]
                y += [str(number), str(number), None]
        if x:
            line = {"color": colour, "width": 7}
            traces.append(go.Scatter(x=x, y=y, name=name, mode="lines", line=line))
    return traces


def _label(recording: Recording, number: int) -> str:
    name = recording.vehicles[number - 1].name
    return html.escape(name if name == f"Vehicle {number}" else f"{number} {name}")


def _label_axes(figure: go.Figure, channels: tuple[Channel, ...]) -> None:
    for row, channel in enumerate(channels, 1):
        figure.update_yaxes(title_text=channel.axis, row=row, col=1)


def _mode_for(moments: int) -> str:
    return "lines+markers" if moments <= FEW else "lines"


def _settled_range(history: History, which: int, truth: list[float]) -> list[float] | None:
    """Axis limits that show where the parameters settle, not where they happened to start."""
    values = history.parameters[len(history.iteration) // 4 :, :, which]
    values = np.concatenate([values[np.isfinite(values)], truth])
    if not len(values):
        return None
    low, high = float(values.min()), float(values.max())
    margin = max(0.12 * (high - low), 0.02 * abs(high), 1e-4)
    return [low - margin, high + margin]


def _finished(figure: go.Figure, height: int, revision: str) -> go.Figure:
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
