"""A recording and a segment as figures: speeds, gaps, the window, and who drove.

Vehicle names come from files, so they are escaped: plotly reads a little HTML.
"""

import html
from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from accpinn.channels import GAP, SPEED, TIME
from accpinn.recordings.recording import Mode, Recording, Window
from accpinn.results.figures.style import (
    FOLLOWERS,
    finished,
    label_axes,
    panels,
    thinned,
    vehicle_colour,
)
from accpinn.segment.quality import CATCHING_UP, FOLLOWING, MANUAL, STANDSTILL, Regimes
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds, stretches

MISSING = "#c22f4f"
WINDOW = "rgba(12, 126, 174, 0.16)"
FAINT = 0.35
"""Opacity of what is not chosen."""
REGIME_COLOURS = {
    FOLLOWING: "#8b93a1",
    CATCHING_UP: "#b07d00",
    MANUAL: "#b04a96",
    STANDSTILL: "#4f86b5",
}
"""Each with a contrast of 3 or more on white and on the dark page; car-following, which the model
is for, is grey; the others differ under any vision, and from the first vehicles."""


def overview(
    recording: Recording,
    vehicles: Sequence[int],
    window: Window,
    regimes: Sequence[go.Scatter] = (),
) -> go.Figure:
    """Speeds and gaps of a whole recording, the window on it, and who drove or is missing.

    Args:
        recording: all of it is drawn.
        vehicles: those chosen, leader first; the others are faint.
        window: the interval chosen.
        regimes: ribbons of what the followers do in it (see `regime_ribbons`).
    """
    strips = {"Vehicle": _ribbons(recording), "Regime": list(regimes)}
    strips = {title: traces for title, traces in strips.items() if traces}
    strip = max(0.14, 0.03 * len(vehicles))
    heights = [0.5, 0.36, *[strip] * len(strips)] if strips else [0.58, 0.42]
    figure = panels(*heights)
    for number in recording.present:
        chosen = number in vehicles
        label = html.escape(recording.label(number))
        colour = vehicle_colour(number, vehicles[0])
        curves = [(recording.speed_of(number), chosen)]
        if number > 1 and number - 1 in recording.present:
            curves.append((recording.gap_behind(number - 1), chosen and number != vehicles[0]))
        for row, (values, strong) in enumerate(curves, 1):
            x, y = thinned(recording.time, values)
            figure.add_scatter(
                x=x, y=y, name=label, mode="lines", connectgaps=False,
                line={"color": colour, "width": 1.8 if strong else 1},
                opacity=1 if strong else FAINT, legendgroup=label, showlegend=row == 1, row=row,
                col=1,
            )  # fmt: skip
    for row, (title, traces) in enumerate(strips.items(), 3):
        _strip(figure, row, title, traces)
    figure.add_shape(
        type="rect", xref="x", yref="paper", x0=window.start, x1=window.end, y0=0, y1=1,
        fillcolor=WINDOW, line={"color": FOLLOWERS[0], "width": 1.5}, layer="below",
    )  # fmt: skip
    figure.update_xaxes(range=[0, recording.duration], title_text="")
    label_axes(figure, (SPEED, GAP), len(heights))
    figure.update_layout(dragmode="select", selectdirection="h")
    return finished(figure, 430 + 40 * len(strips), f"overview-{recording.sha256}")


def _strip(figure: go.Figure, row: int, title: str, traces: Sequence[go.Scatter]) -> None:
    """Ribbons of vehicles, by number from the top down."""
    for trace in traces:
        figure.add_trace(trace.update(showlegend=False), row=row, col=1)
    numbers = sorted({trace.y[0] for trace in traces}, key=int, reverse=True)
    figure.update_yaxes(
        row=row, col=1, title_text=title, type="category", showgrid=False, categoryorder="array",
        categoryarray=numbers,
    )  # fmt: skip


def preview(segment: Segment) -> go.Figure:
    """The speeds of a segment, to look at rather than to work with."""
    figure = go.Figure()
    for column, number in enumerate(segment.vehicles):
        colour = vehicle_colour(number, segment.vehicles[0])
        label = html.escape(segment.labels[column])
        time, values = thinned(
            segment.start + segment.time, segment.measured_speeds[:, column], 600
        )
        line = {"color": colour, "width": 2}
        figure.add_scatter(x=time, y=values, name=label, line=line, connectgaps=False)
    figure.update_yaxes(title_text=SPEED.axis)
    figure.update_xaxes(title_text=TIME.axis)
    return finished(figure, 330, "preview")


def has_ribbons(recording: Recording) -> bool:
    """Whether `overview` has bars for stretches driven by hand or missing."""
    return bool(_ribbons(recording))


def _ribbons(recording: Recording) -> list[go.Scatter]:
    """A bar for each stretch driven by hand or missing; none where all is well."""
    by_hand = recording.mode == Mode.HUMAN
    missing = np.isnan(recording.speed)
    if not (recording.mode == Mode.ACC).any():
        by_hand = np.zeros_like(missing)  # a recording without ACC is by hand throughout
    return [
        bars
        for number in recording.present
        for name, mask, colour in (
            ("by hand", by_hand, vehicle_colour(number, 1)),
            ("missing", missing, MISSING),
        )
        for bars in _bars(number, name, mask[:, number - 1], recording.time, colour, 7)
    ]


def regime_ribbons(segment: Segment, regimes: Regimes) -> list[go.Scatter]:
    """A trace for each follower and regime that occurs, over the recording's time."""
    time, step = segment.window.start + segment.time, segment.sample_time
    return [
        bars.update(hoverinfo="skip")
        for codes, number in zip(regimes.codes.T, segment.vehicles[1:], strict=True)
        for code, name in enumerate(regimes.names)
        for bars in _bars(
            number, name, codes == code, time, REGIME_COLOURS[code], 8 if code else 3, step
        )
    ]


def regime_key(regimes: Regimes) -> list[tuple[str, str]]:
    """Name and colour of each regime that occurs."""
    occurring = [code for code in REGIME_COLOURS if (regimes.codes == code).any()]
    return [(regimes.names[code], REGIME_COLOURS[code]) for code in occurring]


def _bars(
    number: int, name: str, mask: NDArray[np.bool_], time: FloatArray, colour: str, width: float,
    step: Seconds = 0.0,
) -> list[go.Scatter]:  # fmt: skip
    """One trace with a bar a run of instants, each of which stands for the ``step`` around it."""
    x: list[float | None] = []
    for run in stretches(mask):
        x += [float(time[run.first]) - step / 2, float(time[run.last]) + step / 2, None]
    line, title = {"color": colour, "width": width}, f"{number} {name}"
    y = [str(number)] * len(x)
    return [go.Scatter(x=x, y=y, name=title, mode="lines", line=line)] if x else []
