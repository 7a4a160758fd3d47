"""A fit as figures: loss and parameters over iterations, and its curves beside the data.

The figures of a training that runs are the same.
"""

import html
from dataclasses import replace
from typing import Any

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import DISTURBANCE, GAP, PARAMETERS, SPEED, Quantity
from accpinn.evaluation.closed_loop import closed_loop_findings, collision_times
from accpinn.inference.prediction import GapBand
from accpinn.methods.estimate import History
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.registry import FOLLOWING, PAPER, has_terms_of, value_of
from accpinn.results.figures import style
from accpinn.results.tables.estimates import EVERY_FOLLOWER, columns_of
from accpinn.segment import Segment, SegmentInfo
from accpinn.units import FloatArray, Seconds, stretches

SOLVED = style.TRUTH | {"dash": "dot"}
"""The line at the value of least squares."""
NORMAL_90 = 1.645
"""Standard errors to each end of a 90 % interval."""
HISTORY_HEIGHT = 225
FEW = 30
"""Moments of a training up to which each is marked."""
VISIBLE = 0.1
"""Least change of the log evidence that fills the height of its chart."""
LONG = 100
"""Iterations from which their axis is logarithmic."""
GAP_ERROR = replace(GAP, name="Gap error")
HEIGHTS = {2: (0.5, 0.5), 3: (0.36, 0.32, 0.32), 4: (0.28, 0.24, 0.24, 0.24)}
"""Relative heights of the panels over time, by their number."""
TITLES = {parameter.key: parameter.name for parameter in PARAMETERS} | {
    "s0": "Intercept", "lag": "Lag", "delay": "Delay",
}  # fmt: skip
"""Titles of the charts of a CTHP's parameters; those of another model name it."""
BAND_POINTS = 400
"""Points of a band's edges, about; more are not seen."""


class _Course(style.Chart):
    """A small panel over the iterations of a training; ``right`` is its margin in pixels."""

    def __init__(self, history: History, title: str, key: str, right: float = 14) -> None:
        head = {"text": title, "font": {"size": 13}, "x": 0, "y": 0.97}
        margin = {"l": 62, "r": right, "t": 34, "b": 42}
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
    history: History,
    segment: SegmentInfo,
    model: str = PAPER,
    truth: Parameters | None = None,
    solved: Parameters | None = None,
) -> dict[str, go.Figure]:
    """Loss and parameters over iterations, by name; the arguments are of `parameter_history`."""
    return {"loss": loss_history(history)} | {
        name: parameter_history(history, which, segment, truth, solved, model)
        for which, name in enumerate(FOLLOWING[model].names)
    }


def loss_history(history: History) -> go.Figure:
    """The loss terms over iterations, on logarithmic axes; the title is the key to the colours."""
    terms = (
        ("Ψ", "total", history.total, style.LEADER, 3.0),
        ("Ψ<sub>D</sub>", "data", history.data, style.SERIES[0], 1.5),
        ("Ψ<sub>F</sub>", "physics", history.physics, style.SERIES[1], 1.5),
        ("Ψ<sub>R</sub>", "start", history.initial, style.SERIES[2], 1.5),
    )
    used = [term for term in terms if term[2].any()]
    names = [(name, colour) for _, name, _, colour, _ in used]
    names += [("log evidence", style.MODEL)] if history.evidence is not None else []
    spans = ", ".join(f'<span style="color:{colour}">{name}</span>' for name, colour in names)
    right = 14 if history.evidence is None else 62
    chart = _Course(history, f"Loss: {spans}", "loss", right)
    for symbol, name, values, colour, width in used:
        positive = np.where(values > 0, values, np.nan)
        hover = f"%{{y:.4g}}<extra>{symbol} {name}</extra>"
        chart.course(positive, name, colour, width, hover=hover, showlegend=False)
    chart.axis("y", "Loss", type="log", **_decades([term[2] for term in used]))
    if history.evidence is not None:
        # As a difference: the evidence itself has too many digits for an axis.
        missing = history.evidence - history.evidence[-1]
        span = max(VISIBLE, float(np.ptp(missing)))
        chart.axis("y2", "Log evidence minus its last value", overlaying="y", side="right",
                   showgrid=False, tickmode="auto", nticks=5, standoff=2, exponentformat="none",
                   range=[missing.max() - 1.05 * span, missing.max() + 0.05 * span])  # fmt: skip
        chart.course(missing, "log evidence", style.MODEL, dash="dash", yaxis="y2",
                     showlegend=False)  # fmt: skip
    return chart.figure()


def parameter_history(
    history: History,
    which: int,
    segment: SegmentInfo,
    truth: Parameters | None = None,
    solved: Parameters | None = None,
    model: str = PAPER,
) -> go.Figure:
    """One parameter over iterations, with lines at the values to compare it with.

    ``which`` is 0 for α, 1 for β, 2 for τ of a CTHP, and the place among another model's own
    parameters. The true parameters, one entry a follower, are dashed, those of least squares
    dotted; only those of the model's kind are compared.
    """
    name = FOLLOWING[model].names[which]
    column, values = columns_of(model)[name], value_of(model, history.parameters, name)
    sets = values.shape[1]
    labels, colours = segment.labels[1:], style.vehicle_colours(segment.vehicles)[1:]
    if sets < segment.followers:
        labels, colours = (EVERY_FOLLOWER,), [style.SHARED]
    ends = _interval(history, which)
    is_cthp = not column.group
    title = TITLES[column.key] if is_cthp else f"{column.group}: {column.title}"
    chart = _Course(history, title, f"parameter-{which}")
    for k, (label, colour) in enumerate(zip(labels, colours, strict=True)):
        if ends is not None:
            chart.band(chart.iterations, ends[0][:, k], ends[1][:, k], colour, 0.125)
        chart.course(values[:, k], label, colour)
    seen = [values.ravel(), *(end[-1] for end in ends or ())]
    for reference, look in ((truth, style.TRUTH), (solved, SOLVED)):
        if reference and has_terms_of(model, reference):
            seen.append(value_of(model, reference, name)[:sets])
            for value, colour in zip(seen[-1].tolist(), colours, strict=False):
                chart.level("y", value, look | {"color": colour})
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
    answered: Trajectories | None = None,
) -> go.Figure:
    """Gap and speed of one follower: data, the method's curve, and the closed-loop simulation.

    The follower is 0 for the first. That simulation is behind the measured leader, while
    ``answered`` is the follower alone by the answer, one column; ``own`` names the method's curve.
    The error of the gap, which needs the data, and a disturbance (N, M) in m/s² have panels of
    their own. The height is in pixels, by default that of the panels.
    """
    data = segment if isinstance(segment, Segment) else None
    measured = data.measured if data else None
    rows = [GAP, SPEED, *([GAP_ERROR] if data and with_error else [])]
    moved, start = len(rows), segment.window.start
    rows += [DISTURBANCE] if disturbance is not None else []
    chart = style.Chart(
        f"tracking-{segment.vehicles[follower + 1]}", height or 140 + 160 * len(rows),
        style.stack(*HEIGHTS[len(rows)]), rows,
    )  # fmt: skip
    for row in range(3, len(rows) + 1):
        chart.level(f"y{row}", 0, {"color": style.GRID, "width": 1.5})
    if predicted:
        _draw_band(chart, predicted, follower, start)
        if data and with_error:  # narrow bands are seen there alone
            _draw_band(chart, predicted, follower, start, data)
    colour = style.vehicle_colours(segment.vehicles)[follower + 1]
    for name, source, paint, width, dash, opacity in (
        ("data", measured, style.LEADER, 4, "solid", 0.7),
        (own, surrogate, colour, 1.5, "solid", 1.0),
        ("closed-loop simulation", closed_loop, style.MODEL, 1.5, "dot", 1.0),
        ("answer's simulation", answered, style.SERIES[0], 1.5, "dash", 1.0),
    ):
        if source is None:
            continue
        k = 0 if source is answered else follower
        drawn = [source.gaps[:, k], source.speeds[:, k + 1]]
        if measured and source is not measured:
            drawn.append(source.gaps[:, k] - measured.gaps[:, follower])
        for row, (channel, values) in enumerate(zip(rows[:moved], drawn, strict=False), 1):
            chart.line(
                start + source.time, values, name, paint, width, dash, row, _hover(channel, name),
                opacity=opacity,
            )  # fmt: skip
    if data and closed_loop:
        findings = closed_loop_findings(data, closed_loop)
        collision = float(collision_times(findings, data.vehicles)[follower])
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
