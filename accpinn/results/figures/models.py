"""Car-following models as figures: errors in windows left out, and the peak gain over speed."""

import html
from itertools import cycle

import numpy as np
import plotly.graph_objects as go

from accpinn.results.figures import style
from accpinn.stability.report import peak_gains
from accpinn.study.judge import Judgement
from accpinn.units import MetresPerSecond

SPEEDS = 25
"""Speeds at which the peak gain is computed."""
BEYOND = 0.35
"""Share of the recorded range of speeds that is shown beyond it on either side."""
RECORDED = "rgba(128, 140, 155, 0.16)"


def colours(judged: Judgement) -> list[tuple[str, str]]:
    """Title and colour of each model, in the order in which they were judged."""
    titles = (score.estimate.model.title for score in judged.scores)
    return list(zip(titles, cycle(style.FOLLOWERS), strict=False))


def errors_by_window(judged: Judgement) -> go.Figure:
    """The RMSE of the gap in each window left out, a line a model."""
    windows = [segment.window for segment in judged.subject.windows]
    names = [f"{window.start:.0f} s" for window in windows]
    traces = [
        {"x": names, "y": score.rmse, "mode": "lines+markers", "name": html.escape(title),
         "line": {"color": colour, "width": 1.5}, "marker": {"size": 8},
         "hovertemplate": "%{y:.2f} m"}
        for (title, colour), score in zip(colours(judged), judged.scores, strict=True)
    ]  # fmt: skip
    top = 1.08 * max(float(score.rmse.max()) for score in judged.scores)
    axes = {
        "x": style.titled("Start of the window left out") | {"type": "category", "showgrid": False},
        "y": style.titled("RMSE of the gap [m]") | {"range": [0, top]},
    }
    return style.composed(traces, 330, "models-errors", axes)


def peak_over_speed(judged: Judgement, speed: MetresPerSecond) -> go.Figure:
    """The largest gain of each model over the speed; the recorded speeds are shaded."""
    low, _, high = judged.subject.speeds
    margin = BEYOND * max(high - low, 5.0)
    speeds = np.linspace(max(1.0, low - margin), high + margin, SPEEDS)
    curves = [peak_gains(s.estimate.model, s.estimate.theta, speeds) for s in judged.scores]
    known = np.concatenate(curves)
    finite = known[np.isfinite(known)]
    traces = [
        style.curve(
            3.6 * speeds, curve, name=html.escape(title), line={"color": colour, "width": 2},
            hovertemplate="%{y:.2f} dB",
        )
        for (title, colour), curve in zip(colours(judged), curves, strict=True)
    ]  # fmt: skip
    ends = 3.6 * speeds[[0, -1]]
    axes = {
        "x": style.titled("Speed in equilibrium [km/h]") | {"range": ends.tolist()},
        "y": style.titled("Peak of |H| [dB]")
        | {"range": [-0.1, 1.1 * min(12.0, float(finite.max(initial=1.0)))]},
    }
    shapes = [
        style.across(
            "x", 3.6 * low, 3.6 * high, fillcolor=RECORDED, line={"width": 0}, layer="below"
        ),
        style.across("x", 3.6 * speed, line=style.TRUTH),
    ]
    return style.composed(traces, 330, "models-peak", axes, shapes=shapes)
