"""The answer as a figure: what each window says over time, and the typical value."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import TIME
from accpinn.inference.answer import Answer
from accpinn.model.registry import time_gap
from accpinn.results.figures import style
from accpinn.results.tables.answer import columns_of
from accpinn.segment.segment import SegmentInfo

JOINT = ("alpha", "beta", "tau", "s0")
"""Parameters of a CTHP whose joint distribution is drawn; of another model all are."""
DRAWN = 300
"""Draws of it that are shown."""
FURTHER, TYPICAL = 0.10, 0.22
"""Opacity of the bands of a further window and of the typical value."""


def forest(infos: Sequence[SegmentInfo], answer: Answer, follower: int, colour: str) -> go.Figure:
    """The time gap of each window alone with its interval, over the answer's two intervals.

    Args:
        infos: (K,) the windows.
        answer: over these windows.
        follower: 0 for the first.
        colour: of the vehicle.
    """
    speed = answer.stated_speed
    span = answer.time_gap(speed, follower)
    gaps = time_gap(answer.model, answer.windows, speed)[:, follower]
    low, high = answer.windows_gap[:, :, follower]
    ends = np.array([[info.window.start, info.window.end] for info in infos])
    margin = 0.03 * max(float(np.ptp(ends)), 1.0)
    whole = np.array([ends.min() - margin, ends.max() + margin])
    traces: list[style.Part] = [
        style.band(whole, np.full(2, lower), np.full(2, upper), colour, opacity)
        for lower, upper, opacity in (
            (span.further_lower, span.further_upper, FURTHER),
            (span.lower, span.upper, TYPICAL),
        )
    ]
    traces.append(
        {"x": whole, "y": np.full(2, span.value), "mode": "lines", "hoverinfo": "skip",
         "line": {"color": colour, "width": 2}}
    )  # fmt: skip
    for info, gap, lower, upper in zip(infos, gaps, low, high, strict=True):
        part = np.array([info.window.start, info.window.end])
        traces.append(
            {"x": [*part[:1], part.mean(), *part[1:]], "y": np.full(3, gap), "mode": "lines",
             "line": {"color": style.LEADER, "width": 3}, "hovertemplate": "%{y:.2f} s",
             "name": str(info.window),
             "error_y": {"type": "data", "symmetric": False, "array": [0, max(upper - gap, 0), 0],
                         "arrayminus": [0, max(gap - lower, 0), 0], "color": style.LEADER,
                         "thickness": 1.6, "width": 5}}
        )  # fmt: skip
    known = np.concatenate([gaps, low, high, [span.further_lower, span.further_upper]])
    known = known[np.isfinite(known)]
    shown = [max(0.0, float(known.min()) - 0.05), float(known.max()) + 0.05] if len(known) else None
    axes = {
        "x": style.titled(TIME.axis) | {"range": whole.tolist(), "showgrid": False},
        "y": style.titled(f"Time gap at {3.6 * speed:.0f} km/h [s]") | {"range": shown},
    }
    return style.composed(traces, 300, f"forest-{follower}", axes, hovermode="closest")


def joint(answer: Answer, follower: int, colour: str) -> go.Figure:
    """Each pair of parameters in draws of the typical value of one follower, and the value itself.

    Args:
        answer: of M followers.
        follower: 0 for the first.
        colour: of the vehicle.
    """
    columns = columns_of(answer.model)
    names = [name for name in JOINT if name in columns] if "alpha" in columns else [*columns]
    count = len(names) - 1
    rows = np.linspace(0, len(answer.typical.alpha) - 1, DRAWN).astype(int)
    drawn = {name: answer.values(answer.typical, name)[rows, follower] for name in names}
    values = {name: answer.span(name, follower).value for name in names}
    traces, axes = list[style.Part](), dict[str, style.Part]()
    for row, vertical in enumerate(names[1:]):
        for column, horizontal in enumerate(names[:-1]):
            at = style.axes_of(row * count + column + 1)
            if column > row:
                axes[at["xaxis"]] = axes[at["yaxis"]] = {"visible": False}
                continue
            traces += [
                {"x": drawn[horizontal], "y": drawn[vertical], "mode": "markers",
                 "hoverinfo": "skip", **at,
                 "marker": {"color": colour, "size": 4, "opacity": 0.35}},
                {"x": [values[horizontal]], "y": [values[vertical]], "mode": "markers",
                 "name": "answer", "marker": {"color": style.LEADER, "size": 9, "symbol": "x"},
                 "hovertemplate": "%{x:.3g}, %{y:.3g}", **at},
            ]  # fmt: skip
            if row == count - 1:
                axes[at["xaxis"]] = style.titled(columns[horizontal].heading)
            if column == 0:
                axes[at["yaxis"]] = style.titled(columns[vertical].heading)
    height = 60 + 150 * count
    grid = style.matrix(count)
    return style.composed(
        traces, height, f"joint-{follower}", axes, None, grid, hovermode="closest"
    )
