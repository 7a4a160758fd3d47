"""A batch as figures: parameters by groups, the α-β plane, and time gap against speed.

The boundaries in the plane are those of `stability.criteria` at one τ: for each α the smallest β
that is stable. Both criteria keep their form when time is counted in units of τ, so in the plane of
ατ² and βτ one line serves for all vehicles.
"""

import html
from collections.abc import Mapping, Sequence
from dataclasses import astuple, replace
from itertools import cycle

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from accpinn.channels import ALPHA, BETA, PARAMETER_KEYS, SPEED, TIME_GAP, Quantity
from accpinn.methods.estimate import SPEEDS
from accpinn.results.figures import style
from accpinn.results.figures.stability import EXACT, L2
from accpinn.results.tables import ABSENT
from accpinn.stability.criteria import smallest_beta_exact, smallest_beta_l2
from accpinn.study.groups import Groups
from accpinn.units import FloatArray

MOST_GROUPS = 16
"""Largest number of groups in a forest plot; those with most windows are drawn."""
LINE, NARROW_LINE, RIM = 28, 22, 74
"""Pixels of a group, of one among many, and of what is above and below all of them."""
FEW = 10
APART = 0.25
"""Share of a logarithmic axis between two labels, so that they do not touch on a narrow screen."""
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "x")
OTHERS = "others"
MOST_NAMED = len(style.FOLLOWERS)
"""Groups with a colour of their own."""
STABLE, UNSTABLE, IDLE = style.FOLLOWERS[0], style.FOLLOWERS[1], style.LEADER
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
    """The typical time gap, α and β of each group with their intervals; the shortest gap on top.

    A marker's size tells the number of windows, a ring that none holds the speed of the time gap,
    whose thin line is the interval for a further window. An arrowhead ends an interval that goes on
    beyond the axis.
    """
    speed = SPEEDS[-1]
    largest = sorted(grouped.groups, key=lambda group: -group.windows)[:MOST_GROUPS]
    spans = [(group.time_gap(speed), group.gain("alpha"), group.gain("beta")) for group in largest]
    values = np.array([[astuple(span) for span in row] for row in spans]).reshape(-1, 3, 5)
    order = np.argsort(-np.nan_to_num(values[:, 0, 0], nan=np.inf), kind="stable")
    groups, values = [largest[k] for k in order], values[order]
    names = [html.escape(label_of(group.values)) for group in groups]
    places = np.arange(len(groups))
    line = LINE if len(groups) <= FEW else NARROW_LINE
    height = max(300, RIM + line * len(groups))
    chart = style.Chart("forest", height, style.row(3, 0.025))
    chart.axis("y*", range=[-0.7, len(groups) - 0.3], showgrid=True)
    # The groups' names may be long.
    chart.axis("y", tickvals=places, ticktext=names, automargin=True)
    gap = replace(TIME_GAP, name=f"Time gap at {speed * 3.6:.0f} km/h", symbol="time gap")
    colour, counts = style.FOLLOWERS[0], [group.windows for group in groups]
    sizes = np.clip(5.0 + 1.6 * np.sqrt(counts), 7.0, 14.0)
    driven = ["circle" if group.is_driven(speed) else "circle-open" for group in groups]
    for panel, quantity in enumerate((gap, ALPHA, BETA), 1):
        part, on_log_axis = values[:, panel - 1], quantity is not gap
        shown = part[:, :3] if on_log_axis else part
        low, high = _axis(shown, on_log_axis)
        middle, *ends = np.clip(part, low, high).T
        if not on_log_axis:
            chart.dots(middle, places, panel=panel, marker={"opacity": 0}, along="x",
                       ends=(ends[2], ends[3]), bar={"color": colour, "thickness": 1})  # fmt: skip
        told = [
            (names[k], *(quantity.text(v) if np.isfinite(v) else ABSENT for v in row),
             groups[k].windows)
            for k, row in enumerate(part)
        ]  # fmt: skip
        hover = (
            f"%{{customdata[0]}}<br>{quantity.symbol} %{{customdata[1]}} {quantity.unit}"
            " (%{customdata[2]} to %{customdata[3]}; further window %{customdata[4]} to"
            " %{customdata[5]}), %{customdata[6]} windows<extra></extra>"
        )
        symbols = "circle" if on_log_axis else driven
        chart.dots(middle, places, quantity.symbol, panel, hover, customdata=told, along="x",
                   ends=(ends[0], ends[1]), bar={"thickness": 2.4},
                   marker={"color": colour, "size": sizes, "symbol": symbols}, cliponaxis=False,
                   showlegend=False)  # fmt: skip
        _mark_cut_ends(chart, panel, shown, places, low, high)
        scale = {"type": "log", **_decades(low, high)} if on_log_axis else {"range": [low, high]}
        title = quantity.heading if on_log_axis else quantity.axis
        chart.axis(f"x{panel}", title, **scale)
    return chart.figure()


def _mark_cut_ends(
    chart: style.Chart, panel: int, spans: FloatArray, places: NDArray[np.intp], low: float,
    high: float,
) -> None:  # fmt: skip
    """Draw arrowheads where intervals (K, 3) or (K, 5) go on beyond an axis."""
    left, right = (spans[:, 1:] < low).any(axis=1), (spans[:, 1:] > high).any(axis=1)
    symbols = ["triangle-left"] * left.sum() + ["triangle-right"] * right.sum()
    chart.dots(
        np.repeat([low, high], [left.sum(), right.sum()]), np.append(places[left], places[right]),
        panel=panel, marker={"color": style.FOLLOWERS[0], "size": 8, "symbol": symbols},
        cliponaxis=False,
    )  # fmt: skip


RIM_SHARE = 1.08
"""Room beyond the last end on a logarithmic axis."""


def _axis(values: FloatArray, on_log_axis: bool) -> tuple[float, float]:
    """Ends that hold all values, and of the intervals what is no further than five times them."""
    medians = values[:, 0]
    known = medians[np.isfinite(medians) & (medians > 0)]
    if not len(known):
        return (0.01, 1.0) if on_log_axis else (0.0, 3.0)
    ends = values[:, 1:][np.isfinite(values[:, 1:])]
    if on_log_axis:
        low = max(known.min() / 4, min(known.min() / 1.3, ends[ends > 0].min(initial=np.inf)))
        high = min(known.max() * 4, max(known.max() * 1.3, ends.max()))
        return float(low) / RIM_SHARE, float(high) * RIM_SHARE
    low = max(0.0, known.min() - 1.0, min(known.min(), ends.min(initial=np.inf)) - 0.1)
    return float(low), float(min(known.max() + 1.0, max(known.max(), ends.max(initial=0)) + 0.1))


def _decades(low: float, high: float) -> style.Part:
    """A logarithmic axis with few round values, as there is little room."""
    kept: list[float] = []
    for digits in ((1,), (1, 5), (1, 2, 5)):
        kept = []
        for tick in (d * 10.0**p for p in range(-5, 3) for d in digits):
            is_apart = not kept or np.log(tick / kept[-1]) > APART * np.log(high / low)
            if low <= tick <= high and is_apart:
                kept.append(tick)
        if len(kept) > 1:
            break
    return {"tickvals": kept, "ticktext": [f"{tick:g}" for tick in kept],
            "range": np.log10([low, high]).tolist()}  # fmt: skip


def colours(labels: Sequence[str]) -> Mapping[str, tuple[str, str]]:
    """Colour and symbol of each label, those that occur most first; others share one."""
    counts = pd.Series(list(labels), dtype=str).value_counts()
    named = list(counts.index[:MOST_NAMED])
    looks = dict(zip(named, zip(style.FOLLOWERS, cycle(SYMBOLS)), strict=False))
    return looks | ({OTHERS: (style.LEADER, "circle-open")} if len(counts) > len(named) else {})


def plane(rows: pd.DataFrame, in_units_of_tau: bool = False) -> go.Figure:
    """Each row's α and β, by its L₂ verdict, and where string stability begins.

    Every point carries its place among the rows. In units of τ the axes are ατ² and βτ, with one
    boundary for all; else the boundaries are those of the median τ.
    """
    alpha, beta, tau = (rows[name].to_numpy(float) for name in PARAMETER_KEYS)
    at = 1.0 if in_units_of_tau else float(np.nanmedian(tau)) if np.isfinite(tau).any() else 1.0
    x, y = (alpha * tau**2, beta * tau) if in_units_of_tau else (alpha, beta)
    stable = rows["l2_stable"].astype("boolean").fillna(False).to_numpy(bool)
    idle = alpha == 0  # without gap control string stability means nothing
    chart = style.Chart(f"plane-{in_units_of_tau}", 430)
    for name, colour, symbol, part in (
        ("L₂ unstable", UNSTABLE, "circle-open", ~stable & ~idle),
        ("L₂ stable", STABLE, "diamond", stable & ~idle),
        ("no gap control", IDLE, "x-thin-open", idle),
    ):
        places = np.flatnonzero(part & np.isfinite(x + y))
        _draw_points(chart, rows, x, y, places, name, colour, symbol)
    right, top = _end(x), max(_end(y), 1.15 / at)
    along = np.linspace(right / ALONG, right, ALONG)
    chart.line(along, smallest_beta_l2(along, at), "L₂", L2, hoverinfo="skip")
    exact = smallest_beta_exact(along, at)
    chart.line(along, exact, "L∞, exact", EXACT, dash="dash", hoverinfo="skip")
    quantities = UNITS_OF_TAU.values() if in_units_of_tau else (ALPHA, BETA)
    for name, quantity, end in zip("xy", quantities, (right, top), strict=True):
        heading = f"{quantity.symbol}, {_lower(quantity.axis)}"
        chart.axis(name, heading, range=[-0.02 * end, end])
    chart.words("string stable", 0.995, 0.985)
    return chart.figure()


def _lower(text: str) -> str:
    """The text with a small first letter."""
    return text[0].lower() + text[1:]


def gap_against_speed(rows: pd.DataFrame, labels: Sequence[str]) -> go.Figure:
    """Each row's mean time gap over its mean speed, by the (K,) labels of their groups.

    Every point carries its place among the rows.
    """
    x, y = (rows[name].to_numpy(float) for name in ("mean_speed", "mean_time_gap"))
    group_of, looks = np.array(labels, dtype=str), colours(labels)
    chart = style.Chart("gap", 430)
    for label, (colour, symbol) in looks.items():
        part = group_of == label if label != OTHERS else ~np.isin(group_of, list(looks))
        places = np.flatnonzero(part & np.isfinite(x + y))
        _draw_points(chart, rows, x, y, places, label, colour, symbol)
    chart.axis("x", f"Mean {_lower(SPEED.axis)}", rangemode="tozero")
    chart.axis("y", f"Mean {_lower(TIME_GAP.axis)}", range=style.limits(y))
    return chart.figure()


def _draw_points(
    chart: style.Chart, rows: pd.DataFrame, x: FloatArray, y: FloatArray,
    places: NDArray[np.intp], name: str, colour: str, symbol: str,
) -> None:  # fmt: skip
    """Draw the points at some places among the rows; each tells its window while they are few."""
    few, texts = len(rows) <= HOVERED, list[str]()
    if few:
        part = rows.iloc[places]
        who = (part["make"].fillna("") + " " + part["model"].fillna("")).str.strip()
        start, end = part["start"], part["start"] + part["duration"]
        texts = [
            html.escape(f"{a or ABSENT}, {b}, {c:.0f}–{d:.0f} s")
            for a, b, c, d in zip(who, part["file"], start, end, strict=True)
        ]
    words = f"{'%{text}<br>' * few}%{{x:.4g}}, %{{y:.4g}}<extra>{html.escape(name)}</extra>"
    chart.dots(
        x[places].round(5), y[places].round(5), name, hover=words, type="scattergl",
        marker={"color": colour, "symbol": symbol, "size": 8 if few else 5,
                "opacity": 0.85 if few else 0.5, "line": {"width": 1.4 if few else 1}},
        selected={"marker": {"opacity": 1}}, unselected={"marker": {"opacity": 0.5}},
        customdata=places, text=texts or None,
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
