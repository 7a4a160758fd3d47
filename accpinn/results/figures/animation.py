"""A simulated platoon on the road as an animation, seen from its leader."""

import html
from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from accpinn.channels import SPEED
from accpinn.platoon import PlatoonRun
from accpinn.results.figures import style
from accpinn.results.figures.platoon import CAR_LENGTH, close_up, colours_of, samples
from accpinn.results.vehicles import Cast
from accpinn.units import FloatArray, Seconds

FRAMES = 60
FRAME_MS = 90


def watched(run: PlatoonRun) -> NDArray[np.intp]:
    """The samples that become frames, those of the close-up."""
    return samples(run, close_up(run), FRAMES)


def animation(run: PlatoonRun, cast: Cast) -> go.Figure:
    """The cars on the road, seen from the leader, and their speeds: an animation with a slider."""
    driven, rows = run.valid, watched(run)
    behind = np.zeros((len(rows), len(cast.labels)))
    behind[:, 1:] = -np.cumsum(driven.gaps[rows] + CAR_LENGTH, axis=1)
    speeds = driven.speeds[rows]
    moments = driven.time[rows].tolist()
    # Rounded to what a screen shows.
    pictures = [*zip(_rounded(behind, 2), _rounded(speeds, 3), strict=True)]
    # The axes stand still while the cars move.
    rear = float(np.nanmin(behind))
    margin = 2.0 - 0.06 * rear
    low, high = float(np.nanmin(speeds)), float(np.nanmax(speeds))
    rim = 0.1 * (high - low) + 0.05
    chart = style.Chart(
        "platoon-wave", 490, style.stack(0.2, 0.8, spacing=0.04),
        updatemenus=[_buttons()], sliders=[_slider(moments)],
        margin={"l": 62, "r": 14, "t": 10, "b": 156},
    )  # fmt: skip
    chart.axis("x*", range=[rear - margin, margin])
    chart.axis("x2", "Position behind the leader [m], driving to the right")
    chart.axis("y", visible=False, range=[-1, 1])
    chart.axis("y2", SPEED.axis, range=[low - rim, high + rim])
    chart.level("y", -0.55, {"color": style.LEADER, "width": 1})
    paints, names = colours_of(cast), [*map(html.escape, cast.labels)]
    look = {"color": paints, "line": {"width": 0}}
    places, now = pictures[0]
    square = {"symbol": "square", "size": 13}
    chart.dots(
        places, [0.0] * len(places), panel=1, hover="%{text}<br>%{x:.1f} m<extra></extra>",
        text=names, marker=look | square,
    )  # fmt: skip
    chart.dots(
        places, now, panel=2, hover="%{text}<br>%{y:.2f} m/s<extra></extra>", text=names,
        mode="lines+markers", line={"color": style.LEADER, "width": 1.2},
        marker=look | {"size": 10},
    )  # fmt: skip
    for name, colour in zip(cast.labels, paints, strict=True):  # for `with_legend`
        chart.dots([None], [None], name, 1, marker=square | {"color": colour})
    figure = chart.figure()
    figure.frames = [
        go.Frame(
            name=_frame(moment),
            data=[{"x": x, "y": [0.0] * len(x)}, {"x": x, "y": y}],
            traces=[0, 1],
        )
        for moment, (x, y) in zip(moments, pictures, strict=True)
    ]
    return figure


def _rounded(values: FloatArray, digits: int) -> list[list[float | None]]:
    """Rows as a figure takes them; None for a vehicle that has collided."""
    return [[None if v != v else v for v in row] for row in values.round(digits).tolist()]


def _motion(duration: int) -> dict[str, Any]:
    return {
        "mode": "immediate", "fromcurrent": True, "frame": {"duration": duration, "redraw": False},
        "transition": {"duration": duration, "easing": "linear"},
    }  # fmt: skip


def _buttons() -> dict[str, Any]:
    play = {"label": "▶ Play", "method": "animate", "args": [None, _motion(FRAME_MS)]}
    pause = {"label": "Pause", "method": "animate", "args": [[None], _motion(0)]}
    return {
        "type": "buttons", "direction": "left", "buttons": [play, pause], "showactive": False,
        "x": 0, "xanchor": "left", "y": 0, "yanchor": "top", "pad": {"t": 112, "r": 8},
        "bgcolor": "rgba(128, 140, 155, 0.18)", "borderwidth": 0,
    }  # fmt: skip


def _frame(moment: Seconds) -> str:
    """The name of the frame of a moment, by which the slider calls it."""
    return f"{moment:.9g}"


def _slider(moments: Sequence[Seconds]) -> dict[str, Any]:
    still, digits = _motion(0), 1 if np.ptp(moments) > 0.1 * len(moments) else 2
    steps = [
        {"label": f"{moment:.{digits}f}", "method": "animate", "args": [[_frame(moment)], still]}
        for moment in moments
    ]
    return {
        "steps": steps, "x": 0, "len": 1, "y": 0, "yanchor": "top", "pad": {"t": 58},
        "ticklen": 0, "minorticklen": 0, "bordercolor": style.CLEAR,
        "bgcolor": "rgba(128, 140, 155, 0.35)", "font": {"color": style.CLEAR},
        "currentvalue": {"prefix": "t = ", "suffix": " s", "xanchor": "right",
                         "font": {"color": style.LEADER}},
    }  # fmt: skip
