"""A batch as figures: parameters by groups, the α-β plane, and time gap against speed.

The boundaries in the plane are those of `stability.criteria`: for each α the smallest β that is
stable. Both criteria keep their form when time is counted in units of τ, so in the plane of ατ² and
βτ one line serves for all vehicles without lag and delay.
"""

import html
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, replace
from itertools import cycle

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from accpinn.channels import ALPHA, BETA, PARAMETER_KEYS, SPEED, TIME_GAP, Quantity
from accpinn.findings import probability
from accpinn.methods.estimate import SPEEDS
from accpinn.results import marks
from accpinn.results.database import label_of
from accpinn.results.figures import style
from accpinn.results.figures.stability import EXACT, L2
from accpinn.results.figures.strip import GLYPHS
from accpinn.results.tables import ABSENT
from accpinn.stability import Assessment, assessment
from accpinn.stability.criteria import smallest_beta_exact, smallest_beta_l2
from accpinn.study.groups import Group, Groups
from accpinn.units import FloatArray, Mask

MOST_GROUPS = 24
"""Largest number of groups in a forest plot; those with most windows are drawn."""
LINE, NARROW_LINE, RIM, LEAST_HEIGHT = 28, 20, 76, 130
"""Heights in pixels: of a group, of one among many, of the margins, and of a plot."""
FEW, MOST_TICKS = 10, 5
WIDTHS = (0.46, 0.34, 0.2)
"""Shares of the panels of a forest plot."""
GROWTH = Quantity("Largest growth", "max |H|", "", 2, 0.0, 1e3)
MEASURED = "circle"
"""Symbol of a time gap at a speed that was driven; at others it is that of extrapolation."""
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "x")
OTHERS, OTHERS_SYMBOL = "others", "hexagram"
MOST_NAMED = len(style.FOLLOWERS)
"""Groups with a colour of their own."""
COLOUR = style.FOLLOWERS[0]
STABLE, UNSTABLE, IDLE = style.FOLLOWERS[0], style.FOLLOWERS[1], style.LEADER
CLASSES = (
    ("L₂ unstable (✗)", UNSTABLE, "x-thin-open"),
    ("L₂ stable alone (open diamond)", STABLE, "diamond-open"),
    ("L₂ and L∞ stable (diamond)", STABLE, "diamond"),
    ("no gap control, or not determined (–)", IDLE, "line-ew-open"),
)
"""Verdicts of a point in the plane, with colour and symbol."""
TONES: dict[Assessment, str] = {
    "stable": style.FOLLOWERS[3],
    "unstable": style.MODEL,
    "undecided": style.FOLLOWERS[7],
    "not determined": style.LEADER,
}
"""Colours of marks of string stability."""
INSIDE = 0.985
"""Share of the points that a plane shows before it is zoomed out."""
ALONG = 160
HOVERED = 3000
"""Largest number of points whose labels name vehicle, file and window."""
UNITS_OF_TAU = (
    Quantity("Gain on spacing in units of τ", "ατ²", "", 3, 0.0, 10.0),
    Quantity("Gain on relative speed in units of τ", "βτ", "", 3, 0.0, 10.0),
)
"""Quantities on the plane's axes."""


def forest(grouped: Groups) -> go.Figure:
    """Time gap, largest growth and string stability of each group, ranked by the time gap.

    The groups stand as `Groups.ranked` has them, the first on top. A marker's size tells the number
    of windows. A ring tells that none of these holds the speed of the time gap, which is then
    extrapolated; those groups stand below a line. A thin line is the interval for a further window.
    An arrowhead ends an interval that goes on beyond the axis.
    """
    speed = SPEEDS[-1]
    ranked = grouped.ranked(speed).groups
    largest = sorted(ranked, key=lambda group: -group.windows)[:MOST_GROUPS]
    groups = [group for group in ranked if group in largest][::-1]
    names = [html.escape(label_of(group.values)) for group in groups]
    places = np.arange(len(groups))
    line = LINE if len(groups) <= FEW else NARROW_LINE
    height = max(LEAST_HEIGHT, RIM + line * len(groups))
    grid = style.row(3, 0.045, WIDTHS)
    chart = style.Chart("forest", height, grid, dragmode=False,
                        margin={"l": 62, "r": 8, "t": 62, "b": 6})  # fmt: skip
    chart.axis("x*", side="top", tickangle=0)
    chart.axis("y*", range=[-0.7, len(groups) - 0.3], showgrid=True, tickvals=places)
    chart.axis("y", ticktext=names, automargin=True)  # the groups' names may be long
    gap = replace(TIME_GAP, name=f"Time gap at {speed * 3.6:.0f} km/h", symbol="time gap")
    counts = [group.windows for group in groups]
    sizes = np.clip(5.0 + 1.6 * np.sqrt(counts), 7.0, 14.0)
    driven = [group.is_driven(speed) for group in groups]
    looks = [MEASURED if is_driven else marks.EXTRAPOLATED.symbol for is_driven in driven]
    shown = (
        (gap, [astuple(group.time_gap(speed)) for group in groups], looks, 0.0),
        (GROWTH, [(*astuple(group.growth), np.nan, np.nan) for group in groups], MEASURED, 1.0),
    )
    for panel, (quantity, spans, symbols, least) in enumerate(shown, 1):
        part = np.array(spans).reshape(-1, 5)
        low, high = _axis(part, least)
        middle, *ends = np.clip(part, low, high).T
        chart.dots(middle, places, panel=panel, marker={"opacity": 0}, along="x",
                   ends=(ends[2], ends[3]), bar={"color": COLOUR, "thickness": 1})  # fmt: skip
        texts = [
            (name, *(quantity.text(v) if np.isfinite(v) else ABSENT for v in row), group.windows)
            for name, row, group in zip(names, part, groups, strict=True)
        ]
        further = "; further window %{customdata[4]} to %{customdata[5]}" * (quantity is gap)
        hover = (
            f"%{{customdata[0]}}<br>{quantity.symbol} %{{customdata[1]}} {quantity.unit}"
            f" (%{{customdata[2]}} to %{{customdata[3]}}{further}), %{{customdata[6]}} windows"
            "<extra></extra>"
        )
        chart.dots(middle, places, quantity.symbol, panel, hover, customdata=texts, along="x",
                   ends=(ends[0], ends[1]), bar={"thickness": 2.4, "color": COLOUR},
                   marker={"color": COLOUR, "size": sizes, "symbol": symbols,
                           "line": {"width": 2, "color": COLOUR}},
                   cliponaxis=False, showlegend=False)  # fmt: skip
        _mark_cut_ends(chart, panel, part, places, low, high)
        whole = np.arange(np.ceil(low), np.floor(high) + 1)
        steps = {"tickvals": whole} if 1 < len(whole) <= MOST_TICKS else style.ticks((low, high))
        look = {"range": [low, high], **steps}
        title = quantity.axis.replace(" at ", " at<br>").replace(" growth", "<br>growth")
        chart.axis(f"x{panel}", title, **look)  # of two lines that fit a narrow panel
    chart.level("x2", 1.0, style.TRUTH, layer="below")
    _mark_stability(chart, groups, names)
    below = driven.count(False)
    if 0 < below < len(groups):
        chart.shape({"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": "y",
                     "y0": below - 0.5, "y1": below - 0.5, "line": style.TRUTH})  # fmt: skip
    return chart.figure()


def _mark_stability(chart: style.Chart, groups: Sequence[Group], names: Sequence[str]) -> None:
    """Draw the marks of string stability, L₂ and L∞, in the last panel."""
    for x, (title, attribute) in enumerate((("L₂", "l2_stable"), ("L∞", "linf_stable"))):
        shares = [float(getattr(group, attribute).value) for group in groups]
        verdicts = [assessment(share) for share in shares]
        reasons = [
            f"{name}<br>{title} string stable: {verdict}"
            + (f", probability {probability(share)}" if np.isfinite(share) else "")
            for name, verdict, share in zip(names, verdicts, shares, strict=True)
        ]
        chart.add(
            [x] * len(groups), np.arange(len(groups)), title, 3, mode="text", showlegend=False,
            text=[GLYPHS[verdict] for verdict in verdicts], customdata=reasons,
            hovertemplate="%{customdata}<extra></extra>",
            textfont={"color": [TONES[verdict] for verdict in verdicts], "size": 15},
        )  # fmt: skip
    chart.axis("x3", "Stable", tickvals=[0, 1], ticktext=["L₂", "L∞"], range=[-0.6, 1.6],
               showgrid=False)  # fmt: skip


def _mark_cut_ends(
    chart: style.Chart, panel: int, spans: FloatArray, places: NDArray[np.intp], low: float,
    high: float,
) -> None:  # fmt: skip
    """Draw arrowheads where intervals (K, 5) go on beyond an axis."""
    left, right = (spans[:, 1:] < low).any(axis=1), (spans > high).any(axis=1)
    symbols = ["triangle-left"] * left.sum() + ["triangle-right"] * right.sum()
    chart.dots(
        np.repeat([low, high], [left.sum(), right.sum()]), np.append(places[left], places[right]),
        panel=panel, marker={"color": COLOUR, "size": 8, "symbol": symbols},
        cliponaxis=False,
    )  # fmt: skip


def _axis(values: FloatArray, least: float) -> tuple[float, float]:
    """Ends that hold all values (K, 5), and their intervals as far as these are not too wide.

    The axis begins at the least value, where one above zero is given.
    """
    medians = values[:, 0]
    finite = medians[np.isfinite(medians) & (medians > 0)]
    if not len(finite):
        return least, least + 1.0
    ends = values[:, 1:][np.isfinite(values[:, 1:])]
    low = least or max(0.0, finite.min() - 1.0, min(finite.min(), ends.min(initial=np.inf)) - 0.1)
    high = min(finite.max() + 1.0, max(finite.max(), ends.max(initial=0)) + 0.1)
    return float(low - 0.02 * (high - low) if low == least else low), float(high)


def colours(labels: Sequence[str]) -> Mapping[str, tuple[str, str]]:
    """Colour and symbol of each label, those that occur most first; others share one."""
    counts = pd.Series(list(labels), dtype=str).value_counts()
    named = list(counts.index[:MOST_NAMED])
    looks = dict(zip(named, zip(style.FOLLOWERS, cycle(SYMBOLS)), strict=False))
    return looks | ({OTHERS: (style.LEADER, OTHERS_SYMBOL)} if len(counts) > len(named) else {})


def plane(rows: pd.DataFrame) -> go.Figure:
    """α and β of each row with its string stability, and the stability boundaries.

    Where no vehicle has a lag or a delay, the axes are ατ² and βτ, in which one boundary of each
    criterion holds for all. A vehicle that has one has boundaries of its own, so with such a row
    the axes are α and β and no boundary is drawn. Every point carries its place among the rows.
    """
    alpha, beta, tau = (rows[name].to_numpy(float) for name in PARAMETER_KEYS)
    has_lines = has_common_boundaries(rows)
    x, y = (alpha * tau**2, beta * tau) if has_lines else (alpha, beta)
    chart = style.Chart(f"plane-{has_lines}", 430)
    for (name, colour, symbol), part in classified(rows):
        places = np.flatnonzero(part & np.isfinite(x + y))
        _draw_points(chart, rows, x, y, places, name, colour, symbol)
    right, top = _end(x), _end(y)
    if has_lines:
        top = max(top, 1.15)
        along = np.linspace(right / ALONG, right, ALONG)
        chart.line(along, smallest_beta_l2(along, 1.0), "L₂", L2, hoverinfo="skip")
        exact = smallest_beta_exact(along, 1.0)
        chart.line(along, exact, "L∞, exact", EXACT, dash="dash", hoverinfo="skip")
        chart.words("string stable", 0.995, 0.985)
    for name, quantity, end in zip(
        "xy", UNITS_OF_TAU if has_lines else (ALPHA, BETA), (right, top), strict=True
    ):
        heading = f"{quantity.symbol}, {_lower(quantity.axis)}"
        chart.axis(name, heading, range=[-0.02 * end, end])
    return chart.figure()


def classified(rows: pd.DataFrame) -> Iterator[tuple[tuple[str, str, str], Mask]]:
    """Each of `CLASSES`, and which rows (N,) are of it."""
    l2, linf = (rows[name].astype("boolean") for name in ("l2_stable", "linf_stable"))
    stable, exactly = (part.fillna(False).to_numpy(bool) for part in (l2, linf))
    # Without gap control string stability means nothing.
    idle = (rows["alpha"].to_numpy(float) == 0) | (l2.isna() | linf.isna()).to_numpy(bool)
    parts = (~stable & ~idle, stable & ~exactly & ~idle, exactly & ~idle, idle)
    yield from zip(CLASSES, parts, strict=True)


def has_common_boundaries(rows: pd.DataFrame) -> bool:
    """Whether no row has a lag or a delay, so that all share the boundaries of a plane."""
    return not (rows[["lag", "delay"]].fillna(0.0).to_numpy(float) > 0).any()


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
    finite = values[np.isfinite(values)]
    return 1.12 * float(np.quantile(finite, INSIDE)) if len(finite) and finite.max() > 0 else 1.0
