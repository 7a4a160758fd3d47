"""A fit as figures: loss and parameters over iterations, and its curves beside the data."""

import html
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import DISTURBANCE, GAP, PARAMETERS, SPEED
from accpinn.evaluation.closed_loop import closed_loop_findings, collision_times
from accpinn.inference.prediction import GapBand
from accpinn.methods.fit import History
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.results.figures.style import (
    GRID,
    LEADER,
    MODEL,
    SERIES,
    SHARED,
    TRUTH,
    band,
    finished,
    label_axes,
    limits,
    panels,
    thinned,
    vehicle_colours,
    with_legend,
)
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.units import FloatArray, Seconds, stretches

NORMAL_90 = 1.645
"""Standard errors to each end of a 90 % interval."""
HISTORY_HEIGHT = 225
FEW = 30
"""So few moments of a training are marked one by one."""
GAP_ERROR = replace(GAP, name="Error of the space-gap")
HEIGHTS = {2: (0.5, 0.5), 3: (0.36, 0.32, 0.32), 4: (0.28, 0.24, 0.24, 0.24)}
"""Of the panels over time, by their number."""
BAND_POINTS = 400
"""Of a band's edges, about; more are not seen."""

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def loss_history(history: History) -> go.Figure:
    """The loss terms over iterations, on logarithmic axes."""
    figure = go.Figure()
    terms = (
        ("Ψ", "total", history.total, LEADER, 3.0),
        ("Ψ<sub>D</sub>", "data", history.data, SERIES[0], 1.5),
        ("Ψ<sub>F</sub>", "physics", history.physics, SERIES[1], 1.5),
        ("Ψ<sub>R</sub>", "start", history.initial, SERIES[2], 1.5),
    )
    mode = _mode_for(len(history.iteration))
    used = [term for term in terms if term[2].any()]
    for symbol, name, values, colour, width in used:
        figure.add_scatter(
            x=_counted(history), y=np.where(values > 0, values, np.nan), name=f"{symbol} {name}",
            showlegend=False,  # the title names them, each in its colour
            mode=mode, line={"color": colour, "width": width}, marker={"size": 4},
        )  # fmt: skip
    figure.update_yaxes(type="log", title_text="Loss", **_decades([term[2] for term in used]))
    names = [f'<span style="color:{colour}">{name}</span>' for _, name, _, colour, _ in used]
    if history.evidence is not None:
        figure.add_scatter(
            x=_counted(history), y=history.evidence, name="log evidence", yaxis="y2",
            showlegend=False, mode=mode, line={"color": MODEL, "width": 2, "dash": "dash"},
            marker={"size": 4},
        )  # fmt: skip
        figure.update_layout(
            yaxis2={"overlaying": "y", "side": "right", "title": "Log evidence", "showgrid": False}
        )
        names.append(f'<span style="color:{MODEL}">log evidence</span>')
    return _over_iterations(figure, f"Loss: {', '.join(names)}", "loss")


def parameter_history(
    history: History, which: int, segment: SegmentInfo, truth: Parameters | None = None
) -> go.Figure:
    """One parameter over iterations, dashed where the truth is known.

    Args:
        history: parameters (K, P, 3), P = 1 in Case I.
        which: 0 for α, 1 for β, 2 for τ.
        segment: whose vehicles they belong to.
        truth: one entry a follower, or nothing.
    """
    quantity = PARAMETERS[which]
    figure = go.Figure()
    sets = history.parameters.values.shape[1]
    ends = _interval(history, which)
    names, colours = segment.labels[1:], vehicle_colours(segment.vehicles)[1:]
    if sets < segment.followers:
        names, colours = (EVERY_FOLLOWER,), [SHARED]
    for k, (name, colour) in enumerate(zip(names, colours, strict=True)):
        if ends is not None:
            figure.add_scatter(
                x=np.concatenate([_counted(history), _counted(history)[::-1]]),
                y=np.concatenate([ends[0][:, k], ends[1][::-1, k]]), fill="toself",
                line={"width": 0, "color": colour}, opacity=0.25, mode="lines", hoverinfo="skip",
                showlegend=False,
            )  # fmt: skip
        figure.add_scatter(
            x=_counted(history), y=history.parameters.values[:, k, which], name=html.escape(name),
            mode=_mode_for(len(history.iteration)), marker={"size": 4},
            line={"color": colour, "width": 2},
        )  # fmt: skip
    seen = history.parameters.values[:, :, which]
    if ends is not None:
        seen = np.append(seen, [one[-1] for one in ends])
    values = truth.values[:sets, which] if truth else np.zeros(0)
    for value, colour in zip(values, colours, strict=False):
        figure.add_hline(y=value, line=TRUTH | {"color": colour})
    seen = np.append(seen, values)
    shown = limits(seen) or None
    figure.update_yaxes(title_text=quantity.heading, range=shown)
    return _over_iterations(figure, quantity.name, f"parameter-{which}")


def _interval(history: History, which: int) -> tuple[FloatArray, FloatArray] | None:
    """Ends (K, P) of the 90 % interval that the training states; None where it states none."""
    if history.deviations is None:
        return None
    spread = np.exp(NORMAL_90 * np.nan_to_num(history.deviations[:, :, which]))
    values = history.parameters.values[:, :, which]
    return values / spread, values * spread


def _counted(history: History) -> FloatArray:
    """(K,) the iterations for a logarithmic axis, which has no zero."""
    return np.maximum(history.iteration, 1.0)


def _over_iterations(figure: go.Figure, title: str, revision: str) -> go.Figure:
    """The looks of a small panel over iterations."""
    figure.update_xaxes(title_text="Iteration", type="log", dtick=1)
    figure = finished(figure, HISTORY_HEIGHT, revision)
    return figure.update_layout(
        title={"text": title, "font": {"size": 13}, "x": 0, "y": 0.97}, margin_t=34
    )


def _decades(series: list[FloatArray]) -> dict[str, Any]:
    """A logarithmic axis over whole decades, with at most about six of them named."""
    values = np.concatenate([*series, []])
    exponents = np.log10(values[np.isfinite(values) & (values > 0)])
    if not len(exponents):
        return {}
    low, high = int(np.floor(exponents.min())), int(np.ceil(exponents.max()))
    named = range(low, high + 1, 1 + (high - low) // 6)
    texts = ["10" + str(k).translate(_SUPERSCRIPTS) for k in named]
    return {"range": [low, high], "tickvals": [10.0**k for k in named], "ticktext": texts}


def _mode_for(moments: int) -> str:
    return "lines+markers" if moments <= FEW else "lines"


def tracking(
    segment: Segment | SegmentInfo,
    follower: int,
    surrogate: Trajectories | None,
    closed_loop: Trajectories | None,
    own: str = "network",
    with_error: bool = False,
    predicted: GapBand | None = None,
    disturbance: FloatArray | None = None,
    height: int | None = None,
) -> go.Figure:
    """Gap and speed of one follower: data, the method's curve, and the closed-loop simulation.

    Args:
        segment: the data, or only what they are of.
        follower: 0 for the first.
        surrogate: the method's own trajectories.
        closed_loop: the simulation behind the measured leader.
        own: how the method's trajectories are called, as plain text.
        with_error: adds a panel with the error of the gap; needs the data.
        predicted: the band of the gap, drawn under its curves.
        disturbance: (N, M) in m/s²; adds a panel.
        height: in pixels; by default that of its panels.
    """
    data = segment if isinstance(segment, Segment) else None
    measured = data.measured if data else None
    rows = [GAP, SPEED, *([GAP_ERROR] if data and with_error else [])]
    moved = len(rows)
    rows += [] if disturbance is None else [DISTURBANCE]
    figure = panels(*HEIGHTS[len(rows)])
    colour = vehicle_colours(segment.vehicles)[follower + 1]
    start = segment.window.start
    sources = (
        ("data", measured, {"color": colour, "width": 3.5}, 0.45),
        (html.escape(own), surrogate, {"color": colour, "width": 1.5}, 1.0),
        ("closed-loop simulation", closed_loop, {"color": MODEL, "width": 1.5, "dash": "dot"}, 1.0),
    )
    if predicted:
        figure.add_traces(list(_bands(predicted, follower, start)), rows=1, cols=1)
    for name, source, line, opacity in sources:
        if source is None:
            continue
        drawn = [source.gaps[:, follower], source.speeds[:, follower + 1]]
        if measured and source is not measured:
            drawn.append((source.gaps - measured.gaps)[:, follower])
        for row, (channel, values) in enumerate(zip(rows[:moved], drawn, strict=False), 1):
            time, shown = thinned(start + source.time, values)
            figure.add_scatter(
                x=time, y=shown, name=name, line=line, opacity=opacity, legendgroup=name,
                hovertemplate=f"%{{y:.2f}} {channel.unit}<extra>{name}</extra>",
                showlegend=row == 1, row=row, col=1,
            )  # fmt: skip
    if data and closed_loop:
        findings = closed_loop_findings(data, closed_loop)
        _mark_collision(figure, float(collision_times(findings, data.vehicles)[follower]))
    if moved > 2:
        figure.add_hline(y=0, line={"color": GRID, "width": 1.5}, row=3, col=1)
    if disturbance is not None:
        figure.add_hline(y=0, line={"color": GRID, "width": 1.5}, row=len(rows), col=1)
        time = start + np.linspace(0, segment.window.duration, len(disturbance))
        time, shown = thinned(time, disturbance[:, follower])
        figure.add_scatter(
            x=time, y=shown, name="disturbance", line={"color": colour, "width": 1.5},
            hovertemplate=f"%{{y:.2f}} {DISTURBANCE.unit}<extra>disturbance</extra>",
            showlegend=False, row=len(rows), col=1,
        )  # fmt: skip
    label_axes(figure, rows)
    height = height or 140 + 160 * len(rows)
    return with_legend(finished(figure, height, f"tracking-{segment.vehicles[follower + 1]}"))


def _bands(predicted: GapBand, follower: int, start: Seconds) -> Iterator[go.Scatter]:
    """The band, one area for each stretch of time that has one; the first stands in the legend."""
    lower, upper = predicted.lower[:, follower], predicted.upper[:, follower]
    for at, stretch in enumerate(stretches(np.isfinite(lower))):
        rows = np.arange(stretch.first, stretch.last + 1)[:: 1 + len(lower) // BAND_POINTS]
        name = f"{100 * predicted.level:.0f} % band"
        area = band(start + predicted.time[rows], lower[rows], upper[rows], MODEL, 0.2, name)
        yield area.update(showlegend=at == 0, legendgroup=name)


def _mark_collision(figure: go.Figure, when: Seconds) -> None:
    """Collisions of the closed-loop simulation, on a line at gap zero; nothing for nan."""
    if np.isnan(when):
        return
    figure.add_hline(y=0, line={"color": LEADER, "width": 1.5}, row=1, col=1)
    figure.add_scatter(
        x=[when], y=[0.0], name="collision", mode="markers",
        marker={"symbol": "x", "size": 11, "color": MODEL},
        hovertemplate=f"{when:.1f} s<extra>collision</extra>", row=1, col=1,
    )  # fmt: skip
