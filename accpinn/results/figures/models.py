"""Car-following models as figures: errors in windows left out, and the peak gain over speed."""

from collections.abc import Sequence
from itertools import cycle
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go

from accpinn.inference.intervals import LEVEL, interval_ends
from accpinn.model.following import FollowingModel
from accpinn.results.figures import style
from accpinn.stability.report import peak_gains
from accpinn.study.judge import Judgement
from accpinn.units import FloatArray, MetresPerSecond

SPEEDS = 25
"""Speeds at which the peak gain is computed."""
BEYOND = 0.35
"""Share of the recorded range of speeds that is shown beyond it on either side."""
RECORDED = "rgba(128, 140, 155, 0.16)"
BAND, DRAWN = 0.2, 100
"""Opacity of a band, and the draws that it is of."""


class Follower(NamedTuple):
    """A model with its parameters, as one line of a figure."""

    name: str
    colour: str
    model: FollowingModel
    theta: FloatArray
    """(n,)"""
    draws: FloatArray | None = None
    """(N, n) of the posterior, for a band."""


def followers_of(judged: Judgement) -> list[Follower]:
    """The models in the order in which they were judged."""
    return [
        Follower(score.model.title, colour, score.model, score.theta)
        for score, colour in zip(judged.scores, cycle(style.FOLLOWERS), strict=False)
    ]


def errors_by_window(judged: Judgement) -> go.Figure:
    """The RMSE of the gap in each window left out, a line a model."""
    chart = style.Chart("models-errors", 330)
    starts = np.array([f"{window.start:.0f}" for window in judged.windows])
    for one, score in zip(followers_of(judged), judged.scores, strict=True):
        chart.line(starts, score.rmse, one.name, one.colour, 1.5, hover="%{y:.2f} m",
                   mode="lines+markers", marker={"size": 8})  # fmt: skip
    top = 1.08 * max(float(score.rmse.max()) for score in judged.scores)
    chart.axis("x", "Start of the window left out [s]", type="category", showgrid=False,
               automargin=True)  # fmt: skip
    chart.axis("y", "RMSE of the gap [m]", range=[0, top])
    return chart.figure()


def peak_over_speed(
    followers: Sequence[Follower], recorded: tuple[MetresPerSecond, MetresPerSecond],
    speed: MetresPerSecond,
) -> go.Figure:  # fmt: skip
    """The largest gain of each follower over the speed, with its 90 % band where draws are known.

    The range of ``recorded`` speeds is shaded, and one ``speed`` is marked.
    """
    chart = style.Chart("models-peak", 330)
    low, high = recorded
    margin = BEYOND * max(high - low, 5.0)
    speeds = np.linspace(max(1.0, low - margin), high + margin, SPEEDS)
    chart.area("x", 3.6 * low, 3.6 * high, RECORDED)
    chart.level("x", 3.6 * speed, style.TRUTH)
    tops = [1.0]
    for name, colour, model, theta, draws in followers:
        if draws is not None:
            some = np.linspace(0, len(draws) - 1, DRAWN).astype(int)
            each = np.repeat(draws[some].T, SPEEDS, axis=1)
            drawn = peak_gains(model, each, np.tile(speeds, DRAWN)).reshape(DRAWN, SPEEDS)
            known = np.isfinite(drawn).all(axis=0)
            lower, upper = interval_ends(drawn[:, known], LEVEL)
            chart.band(3.6 * speeds[known], lower, upper, colour, BAND)
            tops += upper.tolist()
        peaks = peak_gains(model, theta, speeds)
        chart.line(3.6 * speeds, peaks, name, colour, hover="%{y:.2f} dB")
        tops += peaks[np.isfinite(peaks)].tolist()
    chart.axis("x", "Speed in equilibrium [km/h]", range=(3.6 * speeds[[0, -1]]).tolist())
    chart.axis("y", "Peak of |H| [dB]", range=[-0.1, 1.1 * min(12.0, max(tops))])
    return chart.figure()
