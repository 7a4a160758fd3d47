"""A fit as figures: loss and parameters over iterations, and its curves beside the data.

The figures of a training that runs are the same, with fewer points.
"""

import html
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import DISTURBANCE, GAP, PARAMETERS, SPEED
from accpinn.evaluation.closed_loop import closed_loop_findings, collision_times
from accpinn.inference.prediction import GapBand
from accpinn.methods.fit import History
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.registry import CTHPS, FOLLOWING, PAPER
from accpinn.results.figures import style
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.units import FloatArray, Seconds, stretches

SOLVED = style.TRUTH | {"dash": "dot"}
"""The line at the value of least squares."""
NORMAL_90 = 1.645
"""Standard errors to each end of a 90 % interval."""
HISTORY_HEIGHT = 225
FEW = 30
"""Moments of a training up to which each is marked."""
GAP_ERROR = replace(GAP, name="Error of the space-gap")
HEIGHTS = {2: (0.5, 0.5), 3: (0.36, 0.32, 0.32), 4: (0.28, 0.24, 0.24, 0.24)}
"""Relative heights of the panels over time, by their number."""
BAND_POINTS = 400
"""Points of a band's edges, about; more are not seen."""


def thinned_history(history: History, points: int) -> History:
    """About ``points`` of the K moments, evenly spread on a logarithmic axis, with the last one."""
    rows = np.unique(np.geomspace(1, len(history.iteration), points).round().astype(int)) - 1
    parts = {part.name: getattr(history, part.name) for part in fields(history)}
    kept: dict[str, Any] = {
        name: part if part is None else part[rows] for name, part in parts.items()
    }
    return History(**kept)


def training_figures(
    history: History,
    segment: SegmentInfo,
    model: str = PAPER,
    truth: Parameters | None = None,
    solved: Parameters | None = None,
) -> dict[str, go.Figure]:
    """Loss and parameters over iterations, by name; the arguments are of `parameter_history`."""
    return {"loss": loss_history(history)} | {
        curve.key: parameter_history(history, which, segment, truth, solved, model)
        for which, curve in enumerate(_curves(model))
    }


def loss_history(history: History) -> go.Figure:
    """The loss terms over iterations, on logarithmic axes."""
    terms = (
        ("Ψ", "total", history.total, style.LEADER, 3.0),
        ("Ψ<sub>D</sub>", "data", history.data, style.SERIES[0], 1.5),
        ("Ψ<sub>F</sub>", "physics", history.physics, style.SERIES[1], 1.5),
        ("Ψ<sub>R</sub>", "start", history.initial, style.SERIES[2], 1.5),
    )
    used = [term for term in terms if term[2].any()]
    # The title names the lines, each in its colour, so the legend does not.
    traces = [
        _line(history, np.where(values > 0, values, np.nan), f"{symbol} {name}",
              {"color": colour, "width": width}, showlegend=False)
        for symbol, name, values, colour, width in used
    ]  # fmt: skip
    names = [(name, colour) for _, name, _, colour, _ in used]
    axes = {"y": {"type": "log", **style.titled("Loss"), **_decades([term[2] for term in used])}}
    if history.evidence is not None:
        line = {"color": style.MODEL, "width": 2, "dash": "dash"}
        traces.append(_line(history, history.evidence, "log evidence", line, yaxis="y2",
                            showlegend=False))  # fmt: skip
        axes["y2"] = {"overlaying": "y", "side": "right", "showgrid": False,
                          **style.titled("Log evidence")}  # fmt: skip
        names.append(("log evidence", style.MODEL))
    spans = ", ".join(f'<span style="color:{colour}">{name}</span>' for name, colour in names)
    return _over_iterations(traces, f"Loss: {spans}", "loss", axes)


def parameter_history(
    history: History,
    which: int,
    segment: SegmentInfo,
    truth: Parameters | None = None,
    solved: Parameters | None = None,
    model: str = PAPER,
) -> go.Figure:
    """One parameter over iterations, with lines at the values to compare it with.

    Args:
        history: parameters (K, P), P = 1 in Case I.
        which: 0 for α, 1 for β, 2 for τ of a CTHP; the place among another model's own parameters.
        segment: names the vehicles that the parameters belong to.
        truth: the true parameters, one entry a follower, dashed; None where they are unknown.
        solved: those of least squares, one entry a follower, dotted; None draws none.
        model: key of the model that is estimated; only parameters of its kind are compared.
    """
    curve = _curves(model)[which]
    values = history.parameters.everything[:, :, curve.at]
    sets = values.shape[1]
    names, colours = segment.labels[1:], style.vehicle_colours(segment.vehicles)[1:]
    if sets < segment.followers:
        names, colours = (EVERY_FOLLOWER,), [style.SHARED]
    ends, traces = _interval(history, which), list[style.Part]()
    for k, (name, colour) in enumerate(zip(names, colours, strict=True)):
        if ends is not None:
            low, high = (end[:, k] for end in ends)
            traces.append(style.band(_counted(history), low, high, colour, 0.125))
        traces.append(
            _line(history, values[:, k], html.escape(name), {"color": colour, "width": 2})
        )
    compared = [
        (float(value), look | {"color": colour})
        for reference, look in ((truth, style.TRUTH), (solved, SOLVED))
        if reference and reference.own.shape[-1] == history.parameters.own.shape[-1]
        for value, colour in zip(reference.everything[:sets, curve.at], colours, strict=False)
    ]  # fmt: skip
    seen = [values.ravel(), np.array([value for value, _ in compared])]
    seen += [end[-1] for end in ends or ()]
    axis = style.titled(curve.heading) | {"range": style.limits(np.concatenate(seen)) or None}
    shapes = [style.across("y", value, line=look) for value, look in compared]
    return _over_iterations(traces, curve.title, f"parameter-{which}", {"y": axis}, shapes=shapes)


class _Curve(NamedTuple):
    """A parameter that is drawn over iterations."""

    key: str
    title: str
    heading: str
    at: int
    """Its place in `Parameters.everything`."""


def _curves(model: str) -> list[_Curve]:
    """α, β and τ of a CTHP; another model's own parameters."""
    if model in CTHPS:
        return [_Curve(p.key, p.name, p.heading, at) for at, p in enumerate(PARAMETERS)]
    following = FOLLOWING[model]
    return [
        _Curve(p.name, f"{following.title}: {p.symbol}", f"{p.symbol} [{p.unit}]", at)
        for at, p in enumerate(following.parameters, 6)
    ]


def _line(
    history: History, values: FloatArray, name: str, line: Mapping[str, Any], **look: Any
) -> style.Part:
    """(K,) values over the iterations; few of them are marked."""
    mode = "lines+markers" if len(values) <= FEW else "lines"
    return {"x": _counted(history), "y": values, "name": name, "line": line, "mode": mode,
            "marker": {"size": 4}, **look}  # fmt: skip


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


def _over_iterations(
    traces: list[style.Part], title: str, revision: str, axes: dict[str, Any], **layout: Any
) -> go.Figure:
    """A small panel over iterations."""
    axes["x"] = style.titled("Iteration") | {"type": "log", "dtick": 1}
    head = {"text": title, "font": {"size": 13}, "x": 0, "y": 0.97}
    return style.composed(traces, HISTORY_HEIGHT, revision, axes, top=34, title=head, **layout)


def _decades(series: list[FloatArray]) -> dict[str, Any]:
    """A logarithmic axis over whole decades, with at most about six of them named."""
    values = np.concatenate([*series, []])
    exponents = np.log10(values[np.isfinite(values) & (values > 0)])
    if not len(exponents):
        return {}
    low, high = int(np.floor(exponents.min())), int(np.ceil(exponents.max()))
    step = 1 + (high - low) // 6
    return {"range": [low, high], "tick0": low, "dtick": step, "exponentformat": "power"}


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
    points: int = style.POINTS,
) -> go.Figure:
    """Gap and speed of one follower: data, the method's curve, and the closed-loop simulation.

    Args:
        segment: the data, or only what they are about.
        follower: 0 for the first.
        surrogate: the method's own trajectories.
        closed_loop: the simulation behind the measured leader.
        own: the name of the method's trajectories, as plain text.
        with_error: adds a panel with the error of the gap; needs the data.
        predicted: the band of the gap, drawn under its curves.
        disturbance: (N, M) in m/s²; adds a panel.
        height: in pixels; by default that of its panels.
        points: drawn per line at most, about.
    """
    data = segment if isinstance(segment, Segment) else None
    measured = data.measured if data else None
    rows = [GAP, SPEED, *([GAP_ERROR] if data and with_error else [])]
    moved, start = len(rows), segment.window.start
    colour = style.vehicle_colours(segment.vehicles)[follower + 1]
    own_line = {"color": colour, "width": 1.5}
    sources = (
        ("data", measured, {"color": style.LEADER, "width": 4}, 0.7),
        (html.escape(own), surrogate, own_line, 1.0),
        (
            "closed-loop simulation",
            closed_loop,
            {"color": style.MODEL, "width": 1.5, "dash": "dot"},
            1.0,
        ),
    )
    traces = list(_bands(predicted, follower, start)) if predicted else []
    for name, source, line, opacity in sources:
        if source is None:
            continue
        drawn = [source.gaps[:, follower], source.speeds[:, follower + 1]]
        if measured and source is not measured:
            drawn.append((source.gaps - measured.gaps)[:, follower])
        traces += [
            style.curve(
                start + source.time, values, row, points, name=name, line=line, opacity=opacity,
                legendgroup=name, showlegend=row == 1,
                hovertemplate=f"%{{y:.2f}} {channel.unit}<extra>{name}</extra>",
            )
            for row, (channel, values) in enumerate(zip(rows[:moved], drawn, strict=False), 1)
        ]  # fmt: skip
    shapes = []
    if data and closed_loop:
        findings = closed_loop_findings(data, closed_loop)
        collision = float(collision_times(findings, data.vehicles)[follower])
        if not np.isnan(collision):
            shapes.append(style.across("y", 0, line={"color": style.LEADER, "width": 1.5}))
            traces.append(_cross(collision))
    if disturbance is not None:
        rows.append(DISTURBANCE)
        time = start + np.linspace(0, segment.window.duration, len(disturbance))
        traces.append(style.curve(
            time, disturbance[:, follower], len(rows), points, name="disturbance", line=own_line,
            hovertemplate=f"%{{y:.2f}} {DISTURBANCE.unit}<extra>disturbance</extra>",
            showlegend=False,
        ))  # fmt: skip
    shapes += [
        style.across(f"y{row}", 0, line={"color": style.GRID, "width": 1.5})
        for row in range(3, len(rows) + 1)
    ]
    figure = style.composed(
        traces, height or 140 + 160 * len(rows), f"tracking-{segment.vehicles[follower + 1]}",
        grid=style.stack(*HEIGHTS[len(rows)]), channels=rows, shapes=shapes,
    )  # fmt: skip
    return style.with_legend(figure)


def _bands(predicted: GapBand, follower: int, start: Seconds) -> Iterator[style.Part]:
    """The band, one area for each stretch of time that has one; the first stands in the legend."""
    lower, upper = predicted.lower[:, follower], predicted.upper[:, follower]
    for at, stretch in enumerate(stretches(np.isfinite(lower))):
        rows = np.arange(stretch.first, stretch.last + 1)[:: 1 + len(lower) // BAND_POINTS]
        name = f"{100 * predicted.level:.0f} % band"
        yield style.band(
            start + predicted.time[rows], lower[rows], upper[rows], style.MODEL, 0.2, name, panel=1,
            showlegend=at == 0, legendgroup=name,
        )  # fmt: skip


def _cross(when: Seconds) -> style.Part:
    """The closed-loop simulation's first collision, at gap zero."""
    return {
        "x": [when], "y": [0.0], "xaxis": "x", "yaxis": "y", "name": "collision", "mode": "markers",
        "marker": {"symbol": "x", "size": 11, "color": style.MODEL},
        "hovertemplate": f"{when:.1f} s<extra>collision</extra>",
    }  # fmt: skip
