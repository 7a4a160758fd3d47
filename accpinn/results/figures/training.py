"""An estimate as figures: its course, and its curves and simulation beside the data.

The figures of a training that runs are the same.
"""

import html
from dataclasses import replace
from typing import Any

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import DISTURBANCE, GAP, PARAMETERS, SPEED, Quantity
from accpinn.evaluation.closed_loop import closed_loop_findings, collision_times, simulated
from accpinn.inference.prediction import GapBand
from accpinn.methods.estimate import History, of_window
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.registry import FOLLOWING, PAPER, has_terms_of, value_of
from accpinn.results.figures import style
from accpinn.results.tables.estimates import EVERY_FOLLOWER, columns_of, name_of
from accpinn.segment import Segment, SegmentInfo
from accpinn.study.result import Result
from accpinn.units import FloatArray, Seconds, stretches

NORMAL_90 = 1.645
"""Standard errors to each end of a 90 % interval."""
HISTORY_HEIGHT = 225
FEW = 30
"""Moments of a training up to which each is marked."""
VISIBLE = 0.1
"""Least change of the log likelihood that fills the height of its chart."""
LONG = 100
"""Iterations from which their axis is logarithmic."""
GAP_ERROR = replace(GAP, name="Gap error")
HEIGHTS = {2: (0.5, 0.5), 3: (0.36, 0.32, 0.32), 4: (0.28, 0.24, 0.24, 0.24)}
"""Relative heights of the panels over time, by their number."""
SIMULATION = "simulation"
"""The name of the line of the estimate behind the measured vehicle ahead."""
TITLES = {parameter.key: parameter.name for parameter in PARAMETERS} | {
    "s0": "Intercept", "lag": "Lag", "delay": "Delay",
}  # fmt: skip
"""Titles of the charts of a CTHP's parameters; those of another model name it."""
BAND_POINTS = 400
"""Points of a band's edges, about; more are not seen."""


class _Course(style.Chart):
    """A small panel over the iterations of a training."""

    def __init__(self, history: History, title: str, key: str) -> None:
        head = {"text": title, "font": {"size": 13}, "x": 0, "y": 0.97}
        margin = {"l": 62, "r": 14, "t": 34, "b": 42}
        super().__init__(key, HISTORY_HEIGHT, title=head, margin=margin, hovermode="x unified")
        self.axis("x", "Iteration")
        is_long = history.iteration.max(initial=0) >= LONG
        if is_long:  # some dozens are seen better on another axis
            self.axis("x", type="log", dtick=1)
        # A logarithmic axis has no zero.
        self.iterations = np.maximum(history.iteration, 1.0 if is_long else 0.0)

    def course(
        self, values: FloatArray, name: str, colour: str, width: float = 2, **look: Any
    ) -> None:
        """Draw (K,) values; few of them are marked."""
        look |= {"mode": "lines+markers" if len(values) <= FEW else "lines", "marker": {"size": 4}}
        self.line(self.iterations, values, name, colour, width, **look)


def training_figures(
    history: History, segment: SegmentInfo, model: str = PAPER, truth: Parameters | None = None
) -> dict[str, go.Figure]:
    """What is optimised and the parameters over iterations, by name.

    The arguments are of `parameter_history`.
    """
    return {"loss": loss_history(history)} | {
        name: parameter_history(history, which, segment, truth, model)
        for which, name in enumerate(FOLLOWING[model].names)
    }


def loss_history(history: History) -> go.Figure:
    """The terms of the loss over iterations, or the log likelihood where that is maximised.

    Losses have logarithmic axes; the title is the key to their colours. The log likelihood is drawn
    as its difference from the last value, as it has too many digits for an axis.
    """
    if history.log_likelihood is not None:
        rising = history.log_likelihood - history.log_likelihood[-1]
        chart = _Course(history, "Log likelihood", "loss")
        chart.course(rising, "log likelihood", style.MODEL, hover="%{y:.4g}", showlegend=False)
        top = float(np.nanmax(rising, initial=0.0))
        span = max(VISIBLE, top - float(np.nanmin(rising, initial=0.0)))
        chart.axis("y", "Log likelihood minus its last value", exponentformat="none",
                   range=[top - 1.05 * span, top + 0.05 * span])  # fmt: skip
        return chart.figure()
    terms = (
        ("Ψ", "total", history.total, style.LEADER, 3.0),
        ("Ψ<sub>D</sub>", "data", history.data, style.SERIES[0], 1.5),
        ("Ψ<sub>F</sub>", "physics", history.physics, style.SERIES[1], 1.5),
        ("Ψ<sub>R</sub>", "start", history.initial, style.SERIES[2], 1.5),
    )
    used = [term for term in terms if np.nan_to_num(term[2]).any()]
    spans = ", ".join(
        f'<span style="color:{colour}">{name}</span>' for _, name, _, colour, _ in used
    )
    chart = _Course(history, f"Loss: {spans}", "loss")
    for symbol, name, values, colour, width in used:
        positive = np.where(values > 0, values, np.nan)
        hover = f"%{{y:.4g}}<extra>{symbol} {name}</extra>"
        chart.course(positive, name, colour, width, hover=hover, showlegend=False)
    chart.axis("y", "Loss", type="log", **_decades([term[2] for term in used]))
    return chart.figure()


def parameter_history(
    history: History,
    which: int,
    segment: SegmentInfo,
    truth: Parameters | None = None,
    model: str = PAPER,
) -> go.Figure:
    """One parameter over iterations, with its band where the training states one.

    ``which`` is its place among the model's own parameters: 0 for the α of a CTHP. The true
    parameters, one entry a follower, are dashed, where they are of the model's kind.
    """
    name = FOLLOWING[model].names[which]
    column, values = columns_of(model)[name], value_of(model, history.parameters, name)
    sets = values.shape[1]
    labels, colours = segment.labels[1:], style.vehicle_colours(segment.vehicles)[1:]
    if sets < segment.followers:
        labels, colours = (EVERY_FOLLOWER,), [style.SHARED]
    ends = _interval(history, which)
    title = TITLES.get(name, "") if FOLLOWING[model].is_cthp else ""
    chart = _Course(history, title or f"{column.group}: {column.title}", f"parameter-{which}")
    for k, (label, colour) in enumerate(zip(labels, colours, strict=True)):
        if ends is not None:
            chart.band(chart.iterations, ends[0][:, k], ends[1][:, k], colour, 0.125)
        chart.course(values[:, k], label, colour)
    seen = [values.ravel(), *(end[-1] for end in ends or ())]
    if truth and has_terms_of(model, truth):
        seen.append(value_of(model, truth, name)[:sets])
        for value, colour in zip(seen[-1].tolist(), colours, strict=False):
            chart.level("y", value, style.TRUTH | {"color": colour})
    chart.axis("y", column.heading, range=style.limits(np.concatenate(seen)) or None)
    return chart.figure()


def _interval(history: History, which: int) -> tuple[FloatArray, FloatArray] | None:
    """Ends (K, P) of the 90 % interval that the training states; None where it states none."""
    if history.deviations is None or which >= history.deviations.shape[2]:
        return None
    spread = np.exp(NORMAL_90 * np.nan_to_num(history.deviations[:, :, which]))
    values = history.parameters.values[:, :, which]
    return values / spread, values * spread


def _decades(series: list[FloatArray]) -> dict[str, Any]:
    """A logarithmic axis over whole decades, with at most about six of them named."""
    values = np.concatenate([*series, []])
    exponents = np.log10(values[np.isfinite(values) & (values > 0)])
    if not len(exponents):
        return {}
    low, high = int(np.floor(exponents.min())), int(np.ceil(exponents.max()))
    step = 1 + (high - low) // 6
    return {"range": [low, high], "tick0": low, "dtick": step, "exponentformat": "power"}


def driven(result: Result, follower: int, window: int = 0) -> Trajectories | None:
    """One follower by the estimate behind the measured vehicle ahead, as one column.

    Follower and window are counted from 0. None where nothing can be simulated.
    """
    estimate = result.estimate
    pair = result.segments[window].pair(follower)
    return simulated(pair, estimate.model, estimate.parameters[[follower]])


def tracking_of(
    result: Result, follower: int, window: int = 0, *, height: int | None = None
) -> go.Figure:
    """One follower of an estimate: data, curves, simulation, band, error and disturbance.

    Follower and window are counted from 0; the band is known in the first window. Curves that are
    the simulation itself are drawn once. The height is in pixels.
    """
    estimate = result.estimate
    has_curves = bool(estimate.curves) and not METHODS[estimate.method].is_closed_loop
    return tracking(
        result.segments[window],
        follower,
        estimate.curves[window] if has_curves else None,
        driven(result, follower, window),
        "network" if estimate.method == "pinn" else name_of(estimate, with_model=False),
        with_error=True,
        predicted=result.gap_band if window == 0 else None,
        disturbance=of_window(estimate.arrays, window).get("disturbance"),
        height=height,
    )


def tracking(
    segment: Segment,
    follower: int,
    curves: Trajectories | None = None,
    simulation: Trajectories | None = None,
    own: str = "network",
    *,
    with_error: bool = False,
    predicted: GapBand | None = None,
    disturbance: FloatArray | None = None,
    height: int | None = None,
) -> go.Figure:
    """Gap and speed of one follower (0 for the first): data, a method's curves and a simulation.

    The simulation is of this follower alone, behind the measured vehicle ahead, as one column;
    ``own`` names the curves. The error of the gap, and a disturbance (N, M) in m/s², have panels of
    their own. The height is in pixels, by default that of the panels.
    """
    measured, start = segment.measured, segment.window.start
    rows = [GAP, SPEED, *([GAP_ERROR] if with_error else [])]
    moved = len(rows)
    rows += [DISTURBANCE] if disturbance is not None else []
    chart = style.Chart(
        f"tracking-{segment.vehicles[follower + 1]}", height or 140 + 160 * len(rows),
        style.stack(*HEIGHTS[len(rows)]), rows,
    )  # fmt: skip
    for row in range(3, len(rows) + 1):
        chart.level(f"y{row}", 0, {"color": style.GRID, "width": 1.5})
    if predicted:
        _draw_band(chart, predicted, follower, start)
        if with_error:  # narrow bands are seen there alone
            _draw_band(chart, predicted, follower, start, segment)
    colour = style.vehicle_colours(segment.vehicles)[follower + 1]
    gaps = measured.gaps[:, follower]
    for name, source, k, paint, width, dash in (
        ("data", measured, follower, style.LEADER, 4, "solid"),
        (own, curves, follower, colour, 1.5, "solid"),
        (SIMULATION, simulation, 0, style.MODEL, 1.5, "dot"),
    ):
        if source is None:
            continue
        drawn = [source.gaps[:, k], source.speeds[:, k + 1]]
        drawn += [] if source is measured else [source.gaps[:, k] - gaps]
        opacity = 0.7 if source is measured else 1.0
        for row, (channel, values) in enumerate(zip(rows[:moved], drawn, strict=False), 1):
            chart.line(
                start + source.time, values, name, paint, width, dash, row, _hover(channel, name),
                opacity=opacity,
            )  # fmt: skip
    if simulation:
        pair = segment.pair(follower)
        findings = closed_loop_findings(pair, simulation)
        collision = float(collision_times(findings, pair.vehicles)[0])
        if not np.isnan(collision):
            chart.level("y", 0, {"color": style.LEADER, "width": 1.5})
            cross = {"symbol": "x", "size": 11, "color": style.MODEL}
            hover = f"{collision:.1f} s<extra>collision</extra>"
            chart.dots([collision], [0.0], "collision", 1, hover, marker=cross)
    if disturbance is not None:
        time = start + np.linspace(0, segment.window.duration, len(disturbance))
        chart.line(
            time, disturbance[:, follower], "disturbance", colour, 1.5, panel=len(rows),
            hover=_hover(DISTURBANCE, "disturbance"), showlegend=False,
        )  # fmt: skip
    return style.with_legend(chart.figure())


def _hover(channel: Quantity, name: str) -> str:
    return f"%{{y:.2f}} {channel.unit}<extra>{html.escape(name)}</extra>"


def _draw_band(
    chart: style.Chart, predicted: GapBand, follower: int, start: Seconds,
    data: Segment | None = None,
) -> None:  # fmt: skip
    """Draw the band, one area for each stretch of time that has one.

    With ``data`` it is that of the gap's error.
    """
    lower, upper, panel = predicted.lower[:, follower], predicted.upper[:, follower], 1
    if data:
        measured = np.interp(predicted.time, data.time, data.measured.gaps[:, follower])
        lower, upper, panel = lower - measured, upper - measured, 3
    for at, stretch in enumerate(stretches(np.isfinite(lower))):
        rows = np.arange(stretch.first, stretch.last + 1)[:: 1 + len(lower) // BAND_POINTS]
        time, name = start + predicted.time[rows], f"{100 * predicted.level:.0f} % band"
        first = at == 0 and data is None
        chart.band(time, lower[rows], upper[rows], style.MODEL, 0.3, name, panel, showlegend=first)
