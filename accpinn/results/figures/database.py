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
from accpinn.inference.answer import SPEEDS
from accpinn.results.figures import style
from accpinn.results.figures.stability import EXACT, L2
from accpinn.results.tables.table import ABSENT
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
STABLE, UNSTABLE = style.FOLLOWERS[0], style.FOLLOWERS[1]
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

    A marker's size tells the number of windows; the thin line of the time gap is the interval for a
    further window. An arrowhead ends an interval that goes on beyond the axis.
    """
    speed = SPEEDS[-1]
    largest = sorted(grouped.groups, key=lambda group: -group.windows)[:MOST_GROUPS]
    spans = [(group.time_gap(speed), group.gain("alpha"), group.gain("beta")) for group in largest]
    values = np.array([[astuple(span) for span in row] for row in spans]).reshape(-1, 3, 5)
    order = np.argsort(-np.nan_to_num(values[:, 0, 0], nan=np.inf), kind="stable")
    groups, values = [largest[k] for k in order], values[order]
    names = [html.escape(label_of(group.values)) for group in groups]
    places = np.arange(len(groups))
    gap = replace(TIME_GAP, name=f"Time gap at {speed * 3.6:.0f} km/h", symbol="time gap")
    traces, axes = list[style.Part](), dict[str, style.Part]()
    for panel, quantity in enumerate((gap, ALPHA, BETA)):
        part, on_log_axis = values[:, panel], quantity is not gap
        low, high = _axis(part if quantity is gap else part[:, :3], on_log_axis)
        middle, *ends = np.clip(part, low, high).T
        at = style.axes_of(panel + 1)
        for lower, upper, width in ((ends[2], ends[3], 1.0), (ends[0], ends[1], 2.4)):
            if width == 1.0 and quantity is not gap:
                continue
            blank = np.full(len(places), np.nan)
            traces.append({
                "x": np.column_stack([lower, upper, blank]).ravel(),
                "y": np.column_stack([places, places, blank]).ravel(), "mode": "lines",
                "hoverinfo": "skip", "showlegend": False, **at,
                "line": {"color": style.FOLLOWERS[0], "width": width},
            })  # fmt: skip
        traces.append({
            "x": middle, "y": places, "mode": "markers", "name": quantity.symbol,
            "showlegend": False, "cliponaxis": False, **at,
            "marker": {"color": style.FOLLOWERS[0], "size": [_size(g.windows) for g in groups]},
            "customdata": [
                (names[k], *(quantity.text(v) if np.isfinite(v) else ABSENT for v in row),
                 groups[k].windows)
                for k, row in enumerate(part)
            ],
            "hovertemplate": (
                f"%{{customdata[0]}}<br>{quantity.symbol} %{{customdata[1]}} {quantity.unit}"
                " (%{customdata[2]} to %{customdata[3]}; further window %{customdata[4]} to"
                " %{customdata[5]}), %{customdata[6]} windows<extra></extra>"
            ),
        })  # fmt: skip
        traces.append(_cut_ends(part if quantity is gap else part[:, :3], places, low, high) | at)
        scale = {"type": "log", **_decades(low, high)} if on_log_axis else {"range": [low, high]}
        title = f"{quantity.name} [s]" if quantity is gap else quantity.heading
        axes[at["xaxis"]] = style.titled(title) | scale
    # The groups' names may be long.
    axes["y"] = {"tickvals": places, "ticktext": names, "automargin": True}
    every = {"y": {"range": [-0.7, len(groups) - 0.3], "showgrid": True}}
    line = LINE if len(groups) <= FEW else NARROW_LINE
    height = max(300, RIM + line * len(groups))
    return style.composed(
        traces, height, "forest", axes, every, style.row(3, 0.025), hovermode="closest"
    )


def _cut_ends(spans: FloatArray, places: NDArray[np.intp], low: float, high: float) -> style.Part:
    """Arrowheads where intervals (K, 3) or (K, 5) go on beyond an axis."""
    left, right = (spans[:, 1:] < low).any(axis=1), (spans[:, 1:] > high).any(axis=1)
    symbols = ["triangle-left"] * left.sum() + ["triangle-right"] * right.sum()
    return {
        "x": np.repeat([low, high], [left.sum(), right.sum()]),
        "y": np.append(places[left], places[right]), "mode": "markers", "hoverinfo": "skip",
        "showlegend": False, "cliponaxis": False,
        "marker": {"color": style.FOLLOWERS[0], "size": 8, "symbol": symbols},
    }  # fmt: skip


def _size(windows: int) -> float:
    return float(np.clip(5.0 + 1.6 * np.sqrt(windows), 7.0, 14.0))


def _axis(values: FloatArray, on_log_axis: bool) -> tuple[float, float]:
    """Ends that hold all values, and of the intervals what is no further than five times them."""
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


def _decades(low: float, high: float) -> style.Part:
    """A logarithmic axis with few round values, as there is little room."""
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

    Args:
        rows: of a batch; every point carries its place among them.
        in_units_of_tau: draw ατ² and βτ, with one boundary for all; else the boundaries are those
            of the median τ.
    """
    alpha, beta, tau = (rows[name].to_numpy(float) for name in PARAMETER_KEYS)
    at = 1.0 if in_units_of_tau else float(np.nanmedian(tau)) if np.isfinite(tau).any() else 1.0
    x, y = (alpha * tau**2, beta * tau) if in_units_of_tau else (alpha, beta)
    stable = rows["l2_stable"].astype("boolean").fillna(False).to_numpy(bool)
    traces = [
        _points(rows, x, y, np.flatnonzero(part & np.isfinite(x + y)), name, colour, symbol)
        for name, colour, symbol, part in (
            ("L₂ unstable", UNSTABLE, "circle-open", ~stable),
            ("L₂ stable", STABLE, "diamond", stable),
        )
    ]
    right, top = _end(x), max(_end(y), 1.15 / at)
    along = np.linspace(right / ALONG, right, ALONG)
    traces += [
        {"x": along, "y": boundary(along, at), "mode": "lines", "name": name, "hoverinfo": "skip",
         "line": {"color": colour, "width": 2, "dash": dash}}
        for name, boundary, colour, dash in (
            ("L₂", smallest_beta_l2, L2, "solid"), ("L∞, exact", smallest_beta_exact, EXACT, "dash")
        )
    ]  # fmt: skip
    quantities = UNITS_OF_TAU.values() if in_units_of_tau else (ALPHA, BETA)
    axes = {
        name: style.titled(f"{quantity.symbol}, {_lower(quantity.axis)}")
        | {"range": [-0.02 * end, end]}
        for name, quantity, end in zip("xy", quantities, (right, top), strict=True)
    }
    return style.composed(
        traces, 430, f"plane-{in_units_of_tau}", axes, hovermode="closest",
        annotations=[style.corner("string stable", 0.995, 0.985)],
    )  # fmt: skip


def _lower(text: str) -> str:
    """The text with a small first letter."""
    return text[0].lower() + text[1:]


def gap_against_speed(rows: pd.DataFrame, labels: Sequence[str]) -> go.Figure:
    """Each row's mean time gap over its mean speed, by groups.

    Args:
        rows: of a batch; every point carries its place among them.
        labels: (K,) of each row's group.
    """
    x, y = (rows[name].to_numpy(float) for name in ("mean_speed", "mean_time_gap"))
    group_of, looks = np.array(labels, dtype=str), colours(labels)
    traces = []
    for label, (colour, symbol) in looks.items():
        part = group_of == label if label != OTHERS else ~np.isin(group_of, list(looks))
        places = np.flatnonzero(part & np.isfinite(x + y))
        traces.append(_points(rows, x, y, places, label, colour, symbol))
    axes = {
        "x": style.titled(f"Mean {_lower(SPEED.axis)}") | {"rangemode": "tozero"},
        "y": style.titled(f"Mean {_lower(TIME_GAP.axis)}") | {"range": style.limits(y)},
    }
    return style.composed(traces, 430, "gap", axes, hovermode="closest")


def _points(
    rows: pd.DataFrame, x: FloatArray, y: FloatArray, places: NDArray[np.intp],
    name: str, colour: str, symbol: str,
) -> style.Part:  # fmt: skip
    """The points at some places among the rows; each tells its window while they are few."""
    few, escaped = len(rows) <= HOVERED, html.escape(name)
    points = {
        "type": "scattergl", "x": x[places].round(5), "y": y[places].round(5), "mode": "markers",
        "name": escaped, "customdata": places,
        "marker": {"color": colour, "symbol": symbol, "size": 8 if few else 5,
                   "opacity": 0.85 if few else 0.5, "line": {"width": 1.4 if few else 1}},
        "selected": {"marker": {"opacity": 1}}, "unselected": {"marker": {"opacity": 0.5}},
        "hovertemplate": ("%{text}<br>" if few else "")
        + f"%{{x:.4g}}, %{{y:.4g}}<extra>{escaped}</extra>",
    }  # fmt: skip
    if few:
        part = rows.iloc[places]
        who = (part["make"].fillna("") + " " + part["model"].fillna("")).str.strip()
        start, end = part["start"], part["start"] + part["duration"]
        points["text"] = [
            html.escape(f"{a or ABSENT}, {b}, {c:.0f}–{d:.0f} s")
            for a, b, c, d in zip(who, part["file"], start, end, strict=True)
        ]
    return points


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
