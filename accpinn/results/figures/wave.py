"""The wave that runs down a platoon, as an animation that the browser plays by itself."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from accpinn.channels import SPEED
from accpinn.platoon.leader import Recorded, Sinusoid
from accpinn.platoon.simulation import PlatoonRun
from accpinn.results.figures.platoon import Cast
from accpinn.results.figures.style import LEADER, finished
from accpinn.units import FloatArray, Metres, Seconds

CAR_LENGTH: Metres = 4.5
"""Between the fronts of two cars lie the gap and this; the model has gaps only."""
FRAMES = 60
FRAME_MS = 90
PERIODS = 2
"""Of a sinusoid that are shown."""
WATCHED: Seconds = 120.0
"""What is shown of any other planned disturbance."""


def animation(run: PlatoonRun, cast: Cast) -> go.Figure:
    """The cars on the road, seen from the leader, and their speeds: an animation with a slider."""
    driven = run.trajectories
    rows = watched(run)
    behind = np.zeros((len(rows), len(cast.names)))
    behind[:, 1:] = -np.cumsum(driven.gaps[rows] + CAR_LENGTH, axis=1)
    speeds = driven.speeds[rows]
    moments = [f"{driven.time[row]:.1f}" for row in rows]
    pictures = [_pictures(behind[i], speeds[i]) for i in range(len(rows))]
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.2, 0.8], vertical_spacing=0.04
    )
    look = {"color": cast.colours, "line": {"width": 0}}
    road, track = pictures[0]
    figure.add_scatter(
        **road, mode="markers", marker={**look, "symbol": "square", "size": 13}, text=cast.names,
        hovertemplate="%{text}<br>%{x:.1f} m<extra></extra>", row=1, col=1,
    )  # fmt: skip
    figure.add_scatter(
        **track, mode="lines+markers", line={"color": LEADER, "width": 1.2}, text=cast.names,
        marker={**look, "size": 10}, hovertemplate="%{text}<br>%{y:.2f} m/s<extra></extra>",
        row=2, col=1,
    )  # fmt: skip
    for name, colour in zip(cast.names, cast.colours, strict=True):  # for `with_legend`
        figure.add_scatter(
            x=[None], y=[None], mode="markers", name=name, hoverinfo="skip",
            marker={"symbol": "square", "size": 13, "color": colour}, row=1, col=1,
        )  # fmt: skip
    figure.frames = [
        go.Frame(name=moment, data=list(picture), traces=[0, 1])
        for moment, picture in zip(moments, pictures, strict=True)
    ]
    _ranges(figure, behind, speeds)
    figure = finished(figure, 490, "platoon-wave")
    return figure.update_layout(
        hovermode="closest", margin_b=156, updatemenus=[_buttons()], sliders=[_slider(moments)]
    )


def watched(run: PlatoonRun) -> NDArray[np.intp]:
    """The samples that become frames: the last periods, or what follows the disturbance.

    Those after a collision have no meaning.
    """
    time, leader = run.trajectories.time[: run.meaningful], run.leader
    start, end = 0.0, float(time[-1])
    if isinstance(leader, Sinusoid):
        start = max(0.0, end - PERIODS * leader.period)
    elif not isinstance(leader, Recorded):
        start = min(max(0.0, leader.settle - 5.0), end)
        end = min(end, start + WATCHED)
    instants = np.linspace(start, end, FRAMES)
    return np.unique(np.clip(np.searchsorted(time, instants - 1e-9), 0, len(time) - 1))


def _pictures(behind: FloatArray, speeds: FloatArray) -> tuple[dict[str, Any], ...]:
    """One frame, rounded to what a screen shows."""
    x = np.round(behind, 2).tolist()
    return {"x": x, "y": [0.0] * len(x)}, {"x": x, "y": np.round(speeds, 3).tolist()}


def _ranges(figure: go.Figure, behind: FloatArray, speeds: FloatArray) -> None:
    """Axes that stand still while the cars move."""
    margin = 0.06 * float(np.ptp(behind)) + 2.0
    figure.update_xaxes(range=[float(behind.min()) - margin, float(behind.max()) + margin])
    low, high = float(speeds.min()), float(speeds.max())
    rim = 0.1 * (high - low) + 0.05
    figure.update_yaxes(visible=False, range=[-1, 1], row=1, col=1)
    figure.add_hline(y=-0.55, line={"color": LEADER, "width": 1}, row=1, col=1)
    figure.update_yaxes(title_text=SPEED.axis, range=[low - rim, high + rim], row=2, col=1)
    figure.update_xaxes(title_text="Position behind the leader [m], driving to the right",
                        row=2, col=1)  # fmt: skip


def _motion(duration: int) -> dict[str, Any]:
    return {
        "mode": "immediate",
        "fromcurrent": True,
        "frame": {"duration": duration, "redraw": False},
        "transition": {"duration": duration, "easing": "linear"},
    }


def _buttons() -> dict[str, Any]:
    play = {"label": "▶ Play", "method": "animate", "args": [None, _motion(FRAME_MS)]}
    pause = {"label": "Pause", "method": "animate", "args": [[None], _motion(0)]}
    return {
        "type": "buttons", "direction": "left", "buttons": [play, pause], "showactive": False,
        "x": 0, "xanchor": "left", "y": 0, "yanchor": "top", "pad": {"t": 112, "r": 8},
        "bgcolor": "rgba(128, 140, 155, 0.18)", "borderwidth": 0,
    }  # fmt: skip


def _slider(moments: Sequence[str]) -> dict[str, Any]:
    steps = [
        {"label": moment, "method": "animate", "args": [[moment], _motion(0)]} for moment in moments
    ]
    return {
        "steps": steps, "x": 0, "len": 1, "y": 0, "yanchor": "top", "pad": {"t": 58},
        "ticklen": 0, "minorticklen": 0, "bordercolor": "rgba(0,0,0,0)",
        "bgcolor": "rgba(128, 140, 155, 0.35)", "font": {"color": "rgba(0,0,0,0)"},
        "currentvalue": {
            "prefix": "t = ", "suffix": " s", "xanchor": "right", "font": {"color": LEADER},
        },
    }  # fmt: skip
