"""A batch as figures: parameters by groups, the α-β plane, and time gap against speed.

The boundaries in the plane are those of `stability.criteria` at one τ: for each α the smallest β
that is stable. Both criteria keep their form when time is counted in units of τ, so in the plane of
ατ² and βτ one line serves for all vehicles.
"""

import html
from collections.abc import Callable, Mapping, Sequence
from itertools import cycle

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from accpinn.channels import ALPHA, BETA, PARAMETER_KEYS, PARAMETERS, SPEED, TAU, TIME_GAP, Quantity
from accpinn.model.cthp import Parameters
from accpinn.results.figures.stability import EXACT, L2, annotate
from accpinn.results.figures.style import FOLLOWERS, LEADER, finished, limits, subplots
from accpinn.results.tables.table import ABSENT
from accpinn.stability.criteria import smallest_headway_exact, smallest_headway_l2
from accpinn.study.groups import Groups
from accpinn.units import FloatArray

MOST_GROUPS = 16
"""In a forest plot; those with most windows."""
LINE, NARROW_LINE, RIM = 28, 22, 74
"""Pixels of a group, of one among many, and of what is above and below all of them."""
FEW = 10
APART = 0.25
"""Share of a logarithmic axis between two labels, so that they do not touch on a narrow screen."""
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "x")
OTHERS = "others"
MOST_NAMED = len(FOLLOWERS)
"""Groups with a colour of their own."""
STABLE, UNSTABLE = FOLLOWERS[0], FOLLOWERS[1]
INSIDE = 0.985
"""Share of the points that a plane shows before it is zoomed out."""
ALONG = 160
HOVERED = 3000
"""Largest number of points whose labels name vehicle, file and window."""
UNITS_OF_TAU = {
    "alpha": Quantity("Gain on spacing in units of τ", "ατ²", "", 3, 0.0, 10.0),
    "beta": Quantity("Gain on relative speed in units of τ", "βτ", "", 3, 0.0, 10.0),
}


def label_of(values: Sequence[str]) -> str:
    """What a group is called."""
    return " · ".join(value or ABSENT for value in values) or "all"


def forest(grouped: Groups) -> go.Figure:
    """The medians of τ, α and β of each group, with their intervals; the shortest τ on top.

    A marker's size tells the number of windows. A gain whose estimate is not above zero stands as a
    triangle at the left edge.
    """
    largest = sorted(grouped.groups, key=lambda group: -group.windows)[:MOST_GROUPS]
    groups = sorted(largest, key=lambda group: (not np.isnan(group.tau.median), -group.tau.median))
    names = [html.escape(label_of(group.values)) for group in groups]
    places = np.arange(len(groups))
    figure = subplots(rows=1, cols=3, shared_yaxes=True, horizontal_spacing=0.025)
    for column, which in enumerate((2, 0, 1), 1):  # τ, α, β
        quantity, typical = PARAMETERS[which], [group.parameters[which] for group in groups]
        on_log_axis = quantity is not TAU
        values = np.array([(value.median, value.low, value.high) for value in typical]).reshape(
            -1, 3
        )
        low, high = _axis(values, on_log_axis)
        middle, ends = np.clip(values[:, 0], low, high), np.clip(values[:, 1:], low, high)
        at_edge = values[:, 0] <= low
        figure.add_scatter(
            x=middle, y=places, mode="markers", name=quantity.symbol, showlegend=False,
            cliponaxis=False,
            marker={
                "color": FOLLOWERS[0],
                "size": [_size(group.windows) for group in groups],
                "symbol": ["triangle-left" if edge else "circle" for edge in at_edge],
            },
            error_x={
                "array": ends[:, 1] - middle, "arrayminus": middle - ends[:, 0],
                "color": FOLLOWERS[0], "thickness": 1.6, "width": 3,
            },
            customdata=[
                (names[k], *(quantity.text(v) if np.isfinite(v) else ABSENT for v in row),
                 groups[k].windows)
                for k, row in enumerate(values)
            ],
            hovertemplate=(
                f"%{{customdata[0]}}<br>{quantity.symbol} %{{customdata[1]}} {quantity.unit}"
                " (%{customdata[2]} to %{customdata[3]}), %{customdata[4]} windows<extra></extra>"
            ),
            row=1, col=column,
        )  # fmt: skip
        figure.update_xaxes(
            title_text=quantity.heading, row=1, col=column,
            **({"type": "log", "range": np.log10([low, high]).tolist(), **_decades(low, high)}
               if on_log_axis else {"range": [low, high]}),
        )  # fmt: skip
    figure.update_yaxes(range=[-0.7, len(groups) - 0.3], showgrid=True)
    figure.update_yaxes(tickvals=places, ticktext=names, row=1, col=1)
    line = LINE if len(groups) <= FEW else NARROW_LINE
    height = max(300, RIM + line * len(groups))
    figure = finished(figure, height, "forest")
    figure.update_yaxes(automargin=True, row=1, col=1)  # the groups' names may be long
    return figure.update_layout(hovermode="closest")


def _size(windows: int) -> float:
    return float(np.clip(5.0 + 1.6 * np.sqrt(windows), 7.0, 14.0))


def _axis(values: FloatArray, on_log_axis: bool) -> tuple[float, float]:
    """Ends that hold all medians, and of the intervals what is no further than five times them."""
    medians = values[:, 0]
    known = medians[np.isfinite(medians) & (medians > 0)]
    if not len(known):
        return (0.01, 1.0) if on_log_axis else (0.0, 3.0)
    ends = values[:, 1:][np.isfinite(values[:, 1:])]
    if on_log_axis:
        low = max(known.min() / 4, min(known.min() / 1.3, ends[ends > 0].min(initial=np.inf)))
        return float(low), float(min(known.max() * 4, max(known.max() * 1.3, ends.max())))
    low = max(0.0, known.min() - 1.0, min(known.min(), ends.min(initial=np.inf)) - 0.1)
    return float(low), float(min(known.max() + 1.0, max(known.max(), ends.max(initial=0)) + 0.1))


def _decades(low: float, high: float) -> dict[str, list[float] | list[str]]:
    """Few round values, as there is little room."""
    chosen: list[float] = []
    for digits in ((1,), (1, 5), (1, 2, 5)):
        every = (d * 10.0**p for p in range(-5, 3) for d in digits)
        chosen = [tick for tick in every if low <= tick <= high]
        if len(chosen) > 1:
            break
    kept: list[float] = []
    for tick in chosen:
        if not kept or np.log(tick / kept[-1]) > APART * np.log(high / low):
            kept.append(tick)
    return {"tickvals": kept, "ticktext": [f"{tick:g}" for tick in kept]}


def colours(labels: Sequence[str]) -> Mapping[str, tuple[str, str]]:
    """Colour and symbol of each label, those that occur most first; others share one."""
    counts = pd.Series(list(labels), dtype=str).value_counts()
    named = list(counts.index[:MOST_NAMED])
    looks = zip(FOLLOWERS, cycle(SYMBOLS))
    by_label = dict(zip(named, looks, strict=False))
    return by_label | ({OTHERS: (LEADER, "circle-open")} if len(counts) > len(named) else {})


def plane(rows: pd.DataFrame, in_units_of_tau: bool = False) -> go.Figure:
    """Each row's α and β, by its L₂ verdict, and where string stability begins.

    Args:
        rows: of a batch; every point carries its place among them.
        in_units_of_tau: draw ατ² and βτ, with one boundary for all; else the boundaries are those
            of the median τ.
    """
    alpha, beta, tau = (rows[name].to_numpy(float) for name in PARAMETER_KEYS)
    at = 1.0 if in_units_of_tau else float(np.nanmedian(tau)) if np.isfinite(tau).any() else 1.0
    x, y = (alpha * tau**2, beta * tau) if in_units_of_tau else (alpha, beta)
    stable = rows["l2_stable"].astype("boolean").fillna(False).to_numpy(bool)
    figure = go.Figure()
    for name, colour, symbol, part in (
        ("L₂ unstable", UNSTABLE, "circle-open", ~stable),
        ("L₂ stable", STABLE, "diamond", stable),
    ):
        _add_points(figure, rows, x, y, np.flatnonzero(part & np.isfinite(x + y)), name, colour,
                    symbol)  # fmt: skip
    right, top = _end(x), max(_end(y), 1.15 / at)
    along = np.linspace(right / ALONG, right, ALONG)
    for name, headway, colour, dash in (
        ("L₂", smallest_headway_l2, L2, "solid"),
        ("L∞, exact", smallest_headway_exact, EXACT, "dash"),
    ):
        figure.add_scatter(
            x=along, y=smallest_stable_beta(along, at, headway), mode="lines", name=name,
            line={"color": colour, "width": 2, "dash": dash}, hoverinfo="skip",
        )  # fmt: skip
    annotate(figure, "string stable", 0.995, 0.985)
    x_axis, y_axis = (UNITS_OF_TAU.values()) if in_units_of_tau else (ALPHA, BETA)
    for axis, quantity, end in (("xaxis", x_axis, right), ("yaxis", y_axis, top)):
        title = f"{quantity.symbol}, {quantity.axis[0].lower()}{quantity.axis[1:]}"
        figure.layout[axis].update(title={"text": title}, range=[-0.02 * end, end])
    return finished(figure, 430, f"plane-{in_units_of_tau}").update_layout(hovermode="closest")


def smallest_stable_beta(
    alpha: FloatArray, tau: float, headway: Callable[[Parameters], FloatArray]
) -> FloatArray:
    """(K,) the β from which on the smallest stable headway is ``tau`` or less.

    Args:
        alpha: (K,) in 1/s², above zero.
        tau: in s.
        headway: the criterion; it falls with β.
    """
    low, high = np.zeros_like(alpha), np.full_like(alpha, 4.0 / tau)
    for _ in range(50):
        middle = (low + high) / 2
        enough = headway(Parameters(alpha, middle, tau)) <= tau
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return high


def gap_against_speed(rows: pd.DataFrame, labels: Sequence[str]) -> go.Figure:
    """Each row's mean time gap over its mean speed, by groups.

    Args:
        rows: of a batch; every point carries its place among them.
        labels: (K,) of each row's group.
    """
    x, y = (rows[name].to_numpy(float) for name in ("mean_speed", "mean_time_gap"))
    label_of_row = np.array(labels, dtype=str)
    looks = colours(labels)
    figure = go.Figure()
    for label, (colour, symbol) in looks.items():
        named = label_of_row == label
        part = named if label != OTHERS else ~np.isin(label_of_row, list(looks))
        places = np.flatnonzero(part & np.isfinite(x + y))
        _add_points(figure, rows, x, y, places, label, colour, symbol)
    figure.update_xaxes(
        title_text=f"Mean {SPEED.axis[0].lower()}{SPEED.axis[1:]}", rangemode="tozero"
    )
    figure.update_yaxes(
        title_text=f"Mean {TIME_GAP.axis[0].lower()}{TIME_GAP.axis[1:]}", range=limits(y)
    )
    return finished(figure, 430, "gap").update_layout(hovermode="closest")


def _add_points(
    figure: go.Figure, rows: pd.DataFrame, x: FloatArray, y: FloatArray, places: NDArray[np.intp],
    name: str, colour: str, symbol: str,
) -> None:  # fmt: skip
    said, few = {}, len(rows) <= HOVERED
    if few:
        part = rows.iloc[places]
        who = (part["make"].fillna("") + " " + part["model"].fillna("")).str.strip()
        start, end = part["start"], part["start"] + part["duration"]
        said["text"] = [
            html.escape(f"{a or ABSENT}, {b}, {c:.0f}–{d:.0f} s")
            for a, b, c, d in zip(who, part["file"], start, end, strict=True)
        ]
    figure.add_trace(
        go.Scattergl(
            x=x[places].round(5), y=y[places].round(5), mode="markers", name=html.escape(name),
            customdata=places,
            marker={"color": colour, "symbol": symbol, "size": 8 if few else 5,
                    "opacity": 0.85 if few else 0.5, "line": {"width": 1.4 if few else 1}},
            selected={"marker": {"opacity": 1}}, unselected={"marker": {"opacity": 0.5}},
            hovertemplate=("%{text}<br>" if few else "")
            + f"%{{x:.4g}}, %{{y:.4g}}<extra>{html.escape(name)}</extra>",
            **said,
        )
    )  # fmt: skip


def beyond(figure: go.Figure) -> int:
    """How many points a `plane` does not show before it is zoomed out."""
    right, top = figure.layout.xaxis.range[1], figure.layout.yaxis.range[1]
    points = [trace for trace in figure.data if trace.type == "scattergl"]
    return sum(
        int(((np.asarray(p.x, float) > right) | (np.asarray(p.y, float) > top)).sum())
        for p in points
    )


def _end(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return 1.12 * float(np.quantile(known, INSIDE)) if len(known) and known.max() > 0 else 1.0
