"""Methods, models and windows side by side as figures.

Of methods: estimates beside the recommended one's intervals, parameters over time, residuals. Of
car-following models: errors in windows left out, and the peak gain over speed. Of one estimate: the
joint distribution of its parameters.
"""

import html
from collections.abc import Sequence
from itertools import cycle
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import PARAMETERS, TIME, Quantity
from accpinn.evaluation.residuals import Correlogram
from accpinn.inference.intervals import LEVEL
from accpinn.methods.estimate import Estimate, ParameterTrack
from accpinn.model.cthp import Parameters
from accpinn.model.following import FollowingModel
from accpinn.model.registry import FOLLOWING, PAPER, has_terms_of
from accpinn.results import marks
from accpinn.results.figures import style
from accpinn.results.naming import name_of
from accpinn.results.tables.estimates import columns_of
from accpinn.stability import peak_gains
from accpinn.study.judge import Judgement
from accpinn.study.result import Result
from accpinn.units import FloatArray, MetresPerSecond, Seconds, interval_ends

BAND = "rgba(128, 140, 155, 0.20)"
BAND_POINTS = 400
DASHES = ("solid", "dash", "dot")
SYMBOLS = ("circle", "square", "diamond", "triangle-up")
"""Dashes of models, beside their colours."""
LIMIT: style.Part = {"color": style.LEADER, "width": 1, "dash": "dash"}
EARLY = 0.25
"""The share of an online method's track, while it still converges, that does not set the axis."""
SPEEDS = 25
"""Speeds at which the peak gain is computed."""
BEYOND = 0.35
"""Share of the recorded range of speeds that is shown beyond it on either side."""
RECORDED = "rgba(128, 140, 155, 0.16)"
OPACITY, DRAWN = 0.2, 100
"""Opacity of a band over speed, and the draws that it is of."""
JOINT_DRAWN = 300
"""Draws of a joint distribution that are shown."""
INSIDE, OUTSIDE, EARLIER = "circle", marks.OUTSIDE.symbol, "diamond-open"
"""Symbols of estimates that lie in the recommended one's interval, outside, and of earlier runs; a
ring stands for an extrapolated value everywhere."""
ESTIMATED = (PARAMETERS[-1], *PARAMETERS[:-1])
"""The compared parameters: τ, α and β."""


class Row(NamedTuple):
    """One estimate of a follower."""

    name: str
    """The method's."""
    model: str
    """Key of the model in the registry."""
    values: FloatArray
    """(3, 3) τ, α and β with lower and upper ends of their intervals below, nan where
    undetermined; or (3,) without ends."""


def row_of(result: Result, follower: int) -> Row:
    """An estimate of one follower (0 for the first)."""
    estimate = result.estimate
    of = estimate.span if estimate.following.is_linear else estimate.gain
    spans = [of(quantity.key, follower) for quantity in ESTIMATED]
    values = np.array([(s.value, s.lower, s.upper) for s in spans]).T
    return Row(name_of(estimate, with_model=False), estimate.model, values)


def group_title(model: str) -> str:
    """The heading of the estimates of a model: its name and parameters."""
    following = FOLLOWING[model]
    symbols = ", ".join(parameter.symbol for parameter in following.parameters)
    name = "Paper's model" if model == PAPER else following.title
    return f"{name}: {symbols}"


def estimates(
    points: Sequence[Row], colour: str, recommended: Row | None = None,
    truth: Parameters | None = None, earlier: Sequence[Row] = (),
) -> go.Figure:  # fmt: skip
    """Estimates of τ, α and β of one follower by every method, grouped by model.

    Parameters of different models mean different things, as τ beside an s₀, so each is held against
    estimates of its own model alone. The recommended estimate is on top, with its intervals as bars
    and shaded over the rows of its model; a point there has another symbol where it lies outside.
    Those of ``earlier`` runs are open diamonds. The truth is dashed over the rows of models that
    have all its terms.
    """
    rows = [*([recommended] if recommended else []), *points, *earlier]
    groups = {row.model: [r for r in rows if r.model == row.model] for row in rows}
    lines = sum(1 + len(members) for members in groups.values())
    chart = style.Chart(
        "compare-estimates", 94 + 26 * lines, style.row(3, 0.03), dragmode=False,
        margin={"l": 0, "r": 12, "t": 62, "b": 6},
    )  # fmt: skip
    ticks, at = dict[float, str](), 0.0
    place = dict[int, float]()
    for model, members in groups.items():
        # A tick's label as long as a heading would leave a narrow screen's panels no room.
        chart.words(f"<b>{html.escape(group_title(model), quote=False)}</b>", 0, at, xref="paper",
                    yref="y", xanchor="left", yanchor="middle")  # fmt: skip
        at -= 1
        for row in members:
            place[id(row)] = at
            ticks[at], at = html.escape(row.name).replace(" (", "<br>(", 1), at - 1
    chart.axis("x*", tickangle=0)
    chart.axis("y*", range=[at + 0.4, 0.6], showgrid=False, tickvals=[*ticks], automargin=True,
               ticktext=[*ticks.values()])  # fmt: skip
    values = np.array([np.atleast_2d(row.values)[0] for row in rows]).reshape(-1, 3)
    ends = recommended.values[1:] if recommended else np.full((2, 3), np.nan)
    is_alike = np.array([row.model == rows[0].model for row in rows])
    y = np.array([place[id(row)] for row in rows])
    names = [html.escape(row.name) for row in rows]
    true = [] if truth is None else [truth.tau, truth.alpha, truth.beta]
    for which, quantity in enumerate(ESTIMATED):
        column, (low, high) = values[:, which], ends[:, which].tolist()
        bars = np.full((2, len(rows)), np.nan)
        bars[:, :1] = [[low], [high]] if recommended else np.nan
        is_outside = (((column < low) | (column > high)) & is_alike).tolist()
        symbols = [OUTSIDE if outside else INSIDE for outside in is_outside]
        symbols[len(rows) - len(earlier) :] = [EARLIER] * len(earlier)
        marker = {"size": 10, "color": colour, "line": {"width": 2, "color": colour},
                  "symbol": symbols}  # fmt: skip
        panel = which + 1
        chart.dots(
            column, y, panel=panel, marker=marker, ends=(bars[0], bars[1]), along="x",
            bar={"thickness": 2}, customdata=names,
            hover=f"%{{customdata}}<br>{_value(quantity, 'x')}<extra></extra>",
        )  # fmt: skip
        true_values = [float(value) for value in true[which : which + 1]]
        shown = style.limits(np.array([low, high, *column, *true_values])) or [0.0, 1.0]
        if np.isfinite(low):
            alike = y[is_alike]
            chart.shape({"type": "rect", "xref": f"x{panel}", "x0": low, "x1": min(high, shown[1]),
                         "yref": f"y{panel}", "y0": alike.min() - 0.5, "y1": alike.max() + 0.5,
                         "fillcolor": BAND, "line": {"width": 0}, "layer": "below"})  # fmt: skip
        for model, members in groups.items():
            if truth is not None and has_terms_of(model, truth):
                group = np.array([place[id(row)] for row in members])
                chart.shape({"type": "line", "xref": f"x{panel}", "x0": true_values[0],
                             "x1": true_values[0],
                             "yref": f"y{panel}", "y0": group.min() - 0.5, "y1": group.max() + 0.5,
                             "line": style.TRUTH | {"width": 2}})  # fmt: skip
        heading = quantity.heading.replace(" [", "<br>[")  # narrow panels have no room beside it
        chart.axis(f"x{panel}", heading, side="top", range=shown, **style.ticks(shown))
    return chart.figure()


def tracks(
    followed: Sequence[tuple[str, ParameterTrack]],
    follower: int,
    truth: Parameters | None = None,
    start: Seconds = 0.0,
) -> go.Figure:
    """α, β and τ over time as online methods estimate them, one standard deviation around each.

    The truth is dashed. The follower is 0 for the first; the start is the segment's, in s from the
    recording's first sample.
    """
    chart = style.Chart("compare-tracks", 560, style.stack(1, 1, 1), hovermode="x unified")
    chart.axis("x3", TIME.axis)
    for which, quantity in enumerate(PARAMETERS):
        panel, true = which + 1, truth.values[[which]].tolist() if truth else []
        late = [np.array(true)]
        for (name, track), colour, dash in zip(followed, cycle(style.SERIES), cycle(DASHES)):
            values = track.parameters.values[:, follower, which]
            late.append(values[int(EARLY * len(values)) :])
            if track.deviation is not None:
                around = track.deviation[:, follower, which]
                late.append(values[-1] + around[-1] * np.array([-1, 1]))
                finite = np.flatnonzero(np.isfinite(values) & np.isfinite(around))
                finite = finite[:: max(1, len(finite) // BAND_POINTS)]
                low, high = (values + around * np.array([[-1], [1]]))[:, finite]
                chart.band(start + track.time[finite], low, high, colour, 0.10, panel=panel)
            hover = f"{_value(quantity, 'y')}<extra>{html.escape(name)}</extra>"
            chart.line(start + track.time, values, name, colour, 2, dash, panel, hover)
        chart.axis(f"y{panel}", quantity.heading, range=style.limits(np.concatenate(late)) or None)
        for value in true:
            chart.level(f"y{panel}", value, style.TRUTH)
    return style.with_legend(chart.figure())


def residual(correlograms: tuple[Correlogram, Correlogram], colour: str) -> go.Figure:
    """Correlations of a residual with itself and with the acceleration ahead, and their limits."""
    chart = style.Chart("compare-residual", 258, style.row(2, 0.06), dragmode=False,
                        margin={"b": 67})  # fmt: skip
    titles = ("Residual with itself", "Acceleration ahead")
    shown = 1.1 * max(np.abs([*values, 2 * most]).max() for _, values, most in correlograms)
    chart.axis("y*", range=[-shown, shown])
    chart.axis("y", "Correlation")
    pairs = zip(correlograms, titles, strict=True)
    for panel, ((lags, values, most), title) in enumerate(pairs, 1):
        chart.add(lags, values, panel=panel, type="bar", marker={"color": colour},
                  hovertemplate="%{x:.0f} s: %{y:.2f}<extra></extra>")  # fmt: skip
        chart.axis(f"x{panel}", f"{title}:<br>lag [s]")
        for end in (-most, most):
            chart.level(f"y{panel}", end, LIMIT)
    return chart.figure()


def _value(quantity: Quantity, axis: str) -> str:
    """The hover text of a point, as "τ = 1.5200 s"."""
    return f"{quantity.symbol} = %{{{axis}:.4f}} {quantity.unit}"


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


def errors_by_car(judgements: Sequence[Judgement]) -> go.Figure:
    """The typical RMSE of the gap in windows left out, a row a car and a mark a model."""
    chart = style.Chart("models-cars", 64 + 32 * len(judgements), dragmode=False,
                        margin={"l": 0, "r": 14, "t": 6, "b": 42})  # fmt: skip
    labels = [html.escape(judged.info.labels[1]) for judged in judgements]
    places = np.arange(len(labels))[::-1]
    chart.axis("y", range=[-0.6, len(labels) - 0.4], tickvals=places, ticktext=labels,
               automargin=True)  # fmt: skip
    scores = zip(*(judged.scores for judged in judgements), strict=True)
    for of_model, colour, symbol in zip(scores, cycle(style.FOLLOWERS), cycle(SYMBOLS)):
        errors = np.array([score.typical_rmse for score in of_model])
        title = of_model[0].model.title
        best = [judged.ranked[0].key == of_model[0].key for judged in judgements]
        chart.dots(
            errors, places, title, customdata=labels,
            hover=f"%{{customdata}}<br>{html.escape(title)}: %{{x:.2f}} m<extra></extra>",
            marker={"color": colour, "symbol": symbol, "size": [15 if b else 9 for b in best]},
        )  # fmt: skip
    every = [score.typical_rmse for judged in judgements for score in judged.scores]
    chart.axis("x", "RMSE of the gap in windows left out [m]", range=[0, 1.06 * max(every)])
    return chart.figure()


def errors_by_window(judged: Judgement) -> go.Figure:
    """The RMSE of the gap in each window left out, a line a model."""
    chart = style.Chart("models-errors", 330, hovermode="x unified")
    starts = np.array([f"{window.start:.0f}" for window in judged.windows])
    for follower, score in zip(followers_of(judged), judged.scores, strict=True):
        chart.line(starts, score.rmse, follower.name, follower.colour, 1.5, hover="%{y:.2f} m",
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
    chart = style.Chart("models-peak", 330, hovermode="x unified")
    low, high = recorded
    margin = BEYOND * max(high - low, 5.0)
    speeds = np.linspace(max(1.0, low - margin), high + margin, SPEEDS)
    chart.area("x", 3.6 * low, 3.6 * high, RECORDED)
    chart.level("x", 3.6 * speed, style.TRUTH)
    tops = [1.0]
    for name, colour, model, theta, draws in followers:
        if draws is not None:
            some = np.linspace(0, len(draws) - 1, DRAWN).astype(int)
            parameters = np.repeat(draws[some].T, SPEEDS, axis=1)
            drawn = peak_gains(model, parameters, np.tile(speeds, DRAWN)).reshape(DRAWN, SPEEDS)
            finite = np.isfinite(drawn).all(axis=0)
            lower, upper = interval_ends(drawn[:, finite], LEVEL)
            chart.band(3.6 * speeds[finite], lower, upper, colour, OPACITY)
            tops += upper.tolist()
        peaks = peak_gains(model, theta, speeds)
        chart.line(3.6 * speeds, peaks, name, colour, hover="%{y:.2f} dB")
        tops += peaks[np.isfinite(peaks)].tolist()
    chart.axis("x", "Speed in equilibrium [km/h]", range=(3.6 * speeds[[0, -1]]).tolist())
    chart.axis("y", "Peak of |H| [dB]", range=[-0.1, 1.1 * min(12.0, max(tops))])
    return chart.figure()


# One estimate


def joint(estimate: Estimate, follower: int, colour: str) -> go.Figure:
    """Each pair of parameters in draws of the typical value of one follower, and the estimate.

    The estimate has a posterior; the follower is 0 for the first of M.
    """
    posterior = estimate.posterior
    assert posterior is not None  # as the caller knows
    columns = columns_of(estimate.model)
    names, count = [*columns], len(columns) - 1
    chart = style.Chart(f"joint-{follower}", 60 + 150 * count, style.matrix(count))
    rows = np.linspace(0, len(posterior.typical.alpha) - 1, JOINT_DRAWN).astype(int)
    drawn = {name: estimate.values(posterior.typical, name)[rows, follower] for name in names}
    values = {name: estimate.span(name, follower).value for name in names}
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
            chart.dots([values[across]], [values[down]], "estimate", panel, "%{x:.3g}, %{y:.3g}",
                       marker=cross)  # fmt: skip
            if row == count - 1:
                chart.axis(f"x{panel}", columns[across].heading)
            if column == 0:
                chart.axis(f"y{panel}", columns[down].heading)
    return chart.figure()
