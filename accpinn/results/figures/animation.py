"""A simulated platoon on the road as an animation, seen from its leader."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from accpinn.channels import SPEED
from accpinn.platoon.simulation import PlatoonRun
from accpinn.results.figures import style
from accpinn.results.figures.platoon import CAR_LENGTH, Cast, close_up, samples
from accpinn.units import FloatArray

FRAMES = 60
FRAME_MS = 90


def watched(run: PlatoonRun) -> NDArray[np.intp]:
    """The samples that become frames, those of the close-up."""
    return samples(run, close_up(run), FRAMES)


def animation(run: PlatoonRun, cast: Cast) -> go.Figure:
    """The cars on the road, seen from the leader, and their speeds: an animation with a slider."""
    driven, rows = run.valid, watched(run)
    behind = np.zeros((len(rows), len(cast.names)))
    behind[:, 1:] = -np.cumsum(driven.gaps[rows] + CAR_LENGTH, axis=1)
    speeds = driven.speeds[rows]
    moments = [f"{driven.time[row]:.1f}" for row in rows]
    pictures = [  # rounded to what a screen shows
        ({"x": x, "y": [0.0] * len(x)}, {"x": x, "y": y})
        for x, y in zip(_rounded(behind, 2), _rounded(speeds, 3), strict=True)
    ]
    look = {"color": cast.colours, "line": {"width": 0}}
    road, track = pictures[0]
    traces = [
        {**road, **style.axes_of(1), "mode": "markers", "text": cast.names,
         "marker": {**look, "symbol": "square", "size": 13},
         "hovertemplate": "%{text}<br>%{x:.1f} m<extra></extra>"},
        {**track, **style.axes_of(2), "mode": "lines+markers", "text": cast.names,
         "line": {"color": style.LEADER, "width": 1.2}, "marker": {**look, "size": 10},
         "hovertemplate": "%{text}<br>%{y:.2f} m/s<extra></extra>"},
        *(  # for `with_legend`
            {"x": [None], "y": [None], **style.axes_of(1), "mode": "markers", "name": name,
             "hoverinfo": "skip", "marker": {"symbol": "square", "size": 13, "color": colour}}
            for name, colour in zip(cast.names, cast.colours, strict=True)
        ),
    ]  # fmt: skip
    # The axes stand still while the cars move.
    rear = float(np.nanmin(behind))
    margin = 2.0 - 0.06 * rear
    low, high = float(np.nanmin(speeds)), float(np.nanmax(speeds))
    rim = 0.1 * (high - low) + 0.05
    axes = {
        "y": {"visible": False, "range": [-1, 1]},
        "y2": style.titled(SPEED.axis) | {"range": [low - rim, high + rim]},
        "x2": style.titled("Position behind the leader [m], driving to the right"),
    }
    figure = style.composed(
        traces, 490, "platoon-wave", axes, {"x": {"range": [rear - margin, margin]}},
        style.stack(0.2, 0.8, spacing=0.04), hovermode="closest", updatemenus=[_buttons()],
        sliders=[_slider(moments)], margin={"l": 62, "r": 14, "t": 10, "b": 156},
        shapes=[style.across("y", -0.55, line={"color": style.LEADER, "width": 1})],
    )  # fmt: skip
    figure.frames = [
        go.Frame(name=moment, data=list(picture), traces=[0, 1])
        for moment, picture in zip(moments, pictures, strict=True)
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


def _slider(moments: Sequence[str]) -> dict[str, Any]:
    still = _motion(0)
    steps = [
        {"label": moment, "method": "animate", "args": [[moment], still]} for moment in moments
    ]
    return {
        "steps": steps, "x": 0, "len": 1, "y": 0, "yanchor": "top", "pad": {"t": 58},
        "ticklen": 0, "minorticklen": 0, "bordercolor": style.CLEAR,
        "bgcolor": "rgba(128, 140, 155, 0.35)", "font": {"color": style.CLEAR},
        "currentvalue": {"prefix": "t = ", "suffix": " s", "xanchor": "right",
                         "font": {"color": style.LEADER}},
    }  # fmt: skip
