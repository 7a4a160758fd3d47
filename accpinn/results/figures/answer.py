"""The answer as a figure: what each window says over time, and the typical value."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import TIME
from accpinn.inference.answer import Answer
from accpinn.model.registry import time_gap
from accpinn.results.figures import style
from accpinn.results.tables.answer import columns_of
from accpinn.segment import SegmentInfo

JOINT = ("alpha", "beta", "tau", "s0", "lag", "delay")
"""Parameters of a CTHP whose joint distribution is drawn; of another model all are."""
DRAWN = 300
"""Draws of it that are shown."""
FURTHER, TYPICAL = 0.14, 0.28
"""Opacity of the bands of a further window and of the typical value."""


def forest(infos: Sequence[SegmentInfo], answer: Answer, follower: int, colour: str) -> go.Figure:
    """The time gap of each window alone with its interval, over the answer's two intervals.

    The windows ``infos`` are those of the answer; the follower is 0 for the first.
    """
    chart = style.Chart(f"forest-{follower}", 300, hovermode="closest")
    speed = answer.stated_speed
    span = answer.time_gap(speed, follower)
    gaps = time_gap(answer.model, answer.windows, speed)[:, follower]
    low, high = answer.windows_gap[:, :, follower]
    ends = np.array([[info.window.start, info.window.end] for info in infos])
    margin = 0.03 * max(float(np.ptp(ends)), 1.0)
    whole = np.array([ends.min() - margin, ends.max() + margin])
    further = np.array([span.further_lower, span.further_upper])
    for (lower, upper), opacity in ((further, FURTHER), ((span.lower, span.upper), TYPICAL)):
        chart.band(whole, np.full(2, lower), np.full(2, upper), colour, opacity)
    chart.line(whole, np.full(2, span.value), colour=colour, hoverinfo="skip")
    bar = {"color": style.LEADER, "thickness": 1.6, "width": 5, "type": "data", "symmetric": False}
    for info, gap, lower, upper in zip(infos, gaps, low, high, strict=True):
        start, end = info.window.start, info.window.end
        error = {
            **bar,
            "array": [None, max(upper - gap, 0), None],
            "arrayminus": [None, max(gap - lower, 0), None],
        }
        chart.line(
            np.array([start, (start + end) / 2, end]), np.full(3, gap), str(info.window), width=3,
            mode="lines+markers", marker={"size": [0, 9, 0]}, hover="%{y:.2f} s", error_y=error,
        )  # fmt: skip
    known = np.concatenate([gaps, low, high, further])
    known = known[np.isfinite(known)]
    shown = [max(0.0, float(known.min()) - 0.05), float(known.max()) + 0.05] if len(known) else None
    chart.axis("x", TIME.axis, range=whole.tolist(), showgrid=False)
    chart.axis("y", f"Time gap at {3.6 * speed:.0f} km/h [s]", range=shown)
    return chart.figure()


def joint(answer: Answer, follower: int, colour: str) -> go.Figure:
    """Each pair of parameters in draws of the typical value of one follower, and the value itself.

    The follower is 0 for the first of M.
    """
    columns = columns_of(answer.model)
    names = [name for name in JOINT if name in columns] if "alpha" in columns else [*columns]
    count = len(names) - 1
    chart = style.Chart(
        f"joint-{follower}", 60 + 150 * count, style.matrix(count), hovermode="closest"
    )
    rows = np.linspace(0, len(answer.typical.alpha) - 1, DRAWN).astype(int)
    drawn = {name: answer.values(answer.typical, name)[rows, follower] for name in names}
    values = {name: answer.span(name, follower).value for name in names}
    cross = {"color": style.LEADER, "size": 9, "symbol": "x"}
    for row, down in enumerate(names[1:]):
        for column, across in enumerate(names[:-1]):
            panel = row * count + column + 1
            if column > row:
                chart.axis(f"x{panel}", visible=False)
                chart.axis(f"y{panel}", visible=False)
                continue
            chart.dots(drawn[across], drawn[down], panel=panel,
                       marker={"color": colour, "size": 4, "opacity": 0.35})  # fmt: skip
            chart.dots([values[across]], [values[down]], "answer", panel, "%{x:.3g}, %{y:.3g}",
                       marker=cross)  # fmt: skip
            if row == count - 1:
                chart.axis(f"x{panel}", columns[across].heading)
            if column == 0:
                chart.axis(f"y{panel}", columns[down].heading)
    return chart.figure()
