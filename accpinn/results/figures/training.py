"""An estimate as figures: its course, its curves and simulation beside the data, its windows.

The figures of a training that runs are the same.
"""

import html
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import DISTURBANCE, GAP, SPEED, TIME, Quantity
from accpinn.evaluation.closed_loop import simulated
from accpinn.methods.estimate import History, of_window
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters, Trajectories, collides
from accpinn.model.registry import FOLLOWING, PAPER, has_terms_of, value_of
from accpinn.results.figures import style
from accpinn.results.tables.estimates import EVERY_FOLLOWER, columns_of
from accpinn.segment import Segment, SegmentInfo
from accpinn.study.description import Description, view
from accpinn.study.result import Result
from accpinn.units import FloatArray, Mask, Seconds

NORMAL_90 = 1.645
"""Standard errors to each end of a 90 % interval."""
COURSE = 480
"""Usual height of the course of an estimation, in pixels."""
LOSS_SHARE = 0.28
"""Share of that height that the loss has."""
COURSE_POINTS, MOMENTS = 400, 80
"""Points of a line of the course, and moments that can be chosen."""
MARK, MARK_LINE = "chosen iteration", {"color": style.MODEL, "width": 1.5, "dash": "dot"}
"""Name of the points that mark a moment, and the line through them."""
UNSOUGHT = 0.5
"""Ends of the axis of a parameter that is zero throughout."""
FEW = 30
"""Moments of a training up to which each is marked."""
VISIBLE = 0.1
"""Least change of the log likelihood that fills the height of its chart."""
FIRST_STEPS = 0.1
"""Share of the iterations whose log likelihood may lie below its axis."""
LONG = 100
"""Iterations from which their axis is logarithmic."""
GAP_ERROR = replace(GAP, name="Gap error")
HEIGHTS = {2: (0.5, 0.5), 3: (0.36, 0.32, 0.32), 4: (0.28, 0.24, 0.24, 0.24)}
"""Relative heights of the panels over time, by their number."""
DATA, NETWORK, SIMULATION = "data", "network", "simulation"
"""The names of the lines that are measured, the network's, and by the estimate behind the vehicle
ahead."""
FURTHER, TYPICAL = 0.14, 0.28
"""Opacity of the bands of a further window and of the typical value."""
BAND_POINTS = 400
"""Points of a band's edges, about; more are not seen."""


def course(
    history: History,
    segment: SegmentInfo,
    model: str = PAPER,
    truth: Parameters | None = None,
    *,
    moment: int | None = None,
    height: int = COURSE,
) -> go.Figure:
    """The objective and each parameter over the iterations, one panel below the other.

    A loss has a logarithmic axis. The log likelihood is drawn as its difference from the last
    value, as it has too many digits for an axis.

    Args:
        history: of the estimation, also of one that runs.
        segment: the vehicles.
        model: whose parameters they are.
        truth: the true ones, one entry a follower, dashed where they are of the model's kind.
        moment: index of an entry of the history that is marked in every panel.
        height: in pixels.
    """
    names = FOLLOWING[model].names
    shares = [LOSS_SHARE, *[(1.0 - LOSS_SHARE) / len(names)] * len(names)]
    chart = style.Chart(
        "course", height, style.stack(*shares, spacing=0.03), hovermode="x unified",
        margin={"l": 66, "r": 14, "t": 24, "b": 42},
    )  # fmt: skip
    is_long = history.iteration.max(initial=0) >= LONG
    # A logarithmic axis has no zero, and some dozens are seen better on another one.
    at = np.maximum(history.iteration, 1.0 if is_long else 0.0)
    low, high = float(at.min(initial=0.0)), max(float(at.max(initial=0.0)), 1.0)
    rim = 0.02 * (high - low)
    if is_long:
        chart.axis("x*", type="log", dtick=1, range=[0.0, 1.02 * float(np.log10(high))])
    else:
        chart.axis("x*", range=[low - rim, high + rim])
    chart.axis(f"x{1 + len(names)}", "Iteration")
    marks = _loss(chart, history, at)
    for panel, name in enumerate(names, 2):
        marks += _parameter(chart, panel, history, at, name, segment, truth, model)
    chart.axis("y*", nticks=4)
    if moment is not None:
        for panel in range(1, len(names) + 2):
            chart.level(f"x{panel}", float(at[moment]), MARK_LINE, "below")
        for panel, values, colour in marks:
            chart.dots([at[moment]], [values[moment]], MARK, panel, showlegend=False,
                       marker={"size": 8, "color": colour, "line": {"width": 1.5,
                               "color": style.MODEL}})  # fmt: skip
    return chart.figure()


Marks = list[tuple[int, FloatArray, str]]
"""Panel, values (K,) and colour of each line on which a moment is marked."""


def _line(
    chart: style.Chart, panel: int, at: FloatArray, values: FloatArray, name: str, colour: str,
    **look: Any,
) -> None:  # fmt: skip
    """Draw (K,) values in a panel; few of them are marked."""
    look |= {"mode": "lines+markers" if len(values) <= FEW else "lines", "marker": {"size": 4}}
    chart.line(at, values, name, colour, panel=panel, points=COURSE_POINTS, **look)


def _loss(chart: style.Chart, history: History, at: FloatArray) -> Marks:
    """The terms of the loss, or the log likelihood where that is maximised, in the first panel."""
    if not np.isfinite(history.data).any() and history.log_likelihood is None:
        # The objective of a simulation is no sum of squares, and may be below zero.
        falling = history.total - history.total[-1]
        _line(chart, 1, at, falling, "objective", style.MODEL, hover="%{y:.4g}",
              showlegend=False)  # fmt: skip
        limits = style.limits(falling) or None
        chart.axis("y1", "Objective − last", tickformat="~s", range=limits)
        return [(1, falling, style.MODEL)]
    if history.log_likelihood is not None:
        rising = history.log_likelihood - history.log_likelihood[-1]
        _line(chart, 1, at, rising, "log likelihood", style.MODEL, hover="%{y:.4g}",
              showlegend=False)  # fmt: skip
        top = float(np.nanmax(rising, initial=0.0))
        # The first steps rise so much that all later ones would look level.
        later = rising[int(FIRST_STEPS * len(rising)) :]
        span = max(VISIBLE, top - float(np.nanmin(later, initial=0.0)))
        chart.axis("y1", "log L − last", tickformat="~s",
                   range=[top - 1.05 * span, top + 0.05 * span])  # fmt: skip
        return [(1, rising, style.MODEL)]
    terms = (
        ("Ψ", "total", history.total, style.LEADER, 3.0),
        ("Ψ<sub>D</sub>", "data", history.data, style.SERIES[0], 1.5),
        ("Ψ<sub>F</sub>", "physics", history.physics, style.SERIES[1], 1.5),
        ("Ψ<sub>R</sub>", "start", history.initial, style.SERIES[2], 1.5),
    )
    used = [term for term in terms if np.nan_to_num(term[2]).any()]
    spans = (f'<span style="color:{colour}">{name}</span>' for _, name, _, colour, _ in used)
    chart.words(", ".join(spans), 1.0, 1.0, yanchor="bottom", font={"size": 12})
    marks: Marks = []
    for symbol, name, values, colour, width in used:
        positive = np.where(values > 0, values, np.nan)
        hover = f"%{{y:.4g}}<extra>{symbol} {name}</extra>"
        _line(chart, 1, at, positive, name, colour, hover=hover, showlegend=False, width=width)
        marks.append((1, positive, colour))
    chart.axis("y1", "Loss", type="log", **_decades([term[2] for term in used]))
    return marks


def _parameter(
    chart: style.Chart, panel: int, history: History, at: FloatArray, name: str,
    segment: SegmentInfo, truth: Parameters | None, model: str,
) -> Marks:  # fmt: skip
    """One parameter of the model, with its band where the training states one."""
    which = FOLLOWING[model].names.index(name)
    column, values = columns_of(model)[name], value_of(model, history.parameters, name)
    sets = values.shape[1]
    labels, colours = segment.labels[1:], style.vehicle_colours(segment.vehicles)[1:]
    if sets < segment.followers:
        labels, colours = (EVERY_FOLLOWER,), [style.SHARED]
    ends = _interval(history, which)
    for k, (label, colour) in enumerate(zip(labels, colours, strict=True)):
        if ends is not None:
            chart.band(at, ends[0][:, k], ends[1][:, k], colour, 0.125, panel=panel)
        hover = f"%{{y:.4g}}<extra>{html.escape(label)}</extra>"
        _line(chart, panel, at, values[:, k], label, colour, hover=hover)
    seen = [values.ravel(), *(end[-1] for end in ends or ())]
    if truth and has_terms_of(model, truth):
        seen.append(value_of(model, truth, name)[:sets])
        for value, colour in zip(seen[-1].tolist(), colours, strict=False):
            chart.level(f"y{panel}", value, style.TRUTH | {"color": colour})
    limits = style.limits(np.concatenate(seen)) or None
    if limits and not np.nan_to_num(np.concatenate(seen)).any():  # it is not sought yet
        limits = [-UNSOUGHT, UNSOUGHT]
    chart.axis(f"y{panel}", column.heading, range=limits)
    return [(panel, values[:, k], colour) for k, colour in enumerate(colours[:sets])]


def moments_of(history: History) -> list[int]:
    """Indices of some moments, the last included: all of a few, else closer at the beginning."""
    count = len(history.iteration)
    if count <= MOMENTS:
        return [*range(count)]
    some = np.geomspace(1, count, MOMENTS).round().astype(int) - 1
    return [*map(int, np.unique(np.append(some, count - 1)))]


def _interval(history: History, which: int) -> tuple[FloatArray, FloatArray] | None:
    """Ends (K, P) of the 90 % interval that the training states; None where it states none."""
    if history.deviations is None or which >= history.deviations.shape[2]:
        return None
    spread = np.exp(NORMAL_90 * np.nan_to_num(history.deviations[:, :, which]))
    values = history.parameters.values[:, :, which]
    return values / spread, values * spread


def _decades(series: list[FloatArray]) -> dict[str, Any]:
    """A logarithmic axis over whole decades, with at most about three of them named."""
    values = np.concatenate([*series, []])
    exponents = np.log10(values[np.isfinite(values) & (values > 0)])
    if not len(exponents):
        return {}
    low, high = int(np.floor(exponents.min())), int(np.ceil(exponents.max()))
    step = 1 + (high - low) // 4
    return {"range": [low, high], "tick0": low, "dtick": step, "exponentformat": "power"}


# One follower in one window


@dataclass(frozen=True, eq=False)
class Curves:
    """The numbers of a chart of one follower in one window; time from the recording's start."""

    number: int
    """The follower's in the file."""
    colour: str
    lines: dict[str, Trajectories]
    """By name, one column each: the data, the method's own curves, the simulation."""
    collision: Seconds | None
    """When the simulated vehicle touches the one ahead, which the measured one does not."""
    disturbance: FloatArray | None = None
    """(N,) in m/s², where the method estimates it."""
    band: tuple[FloatArray, ...] = ()
    """(4, K) time, ends of the predicted gap, and the measured one, of each stretch with a band."""
    level: float = 0.0
    """Level of the band."""
    about: str = ""
    """Curves drawn beside the data."""


def driven(
    result: Result, follower: int, window: int = 0, moment: int | None = None
) -> Trajectories | None:
    """One follower by the estimate behind the measured vehicle ahead, as one column.

    Follower and window are counted from 0, as is the ``moment`` of the history whose parameters are
    taken, by default the estimate's. None where nothing can be simulated.
    """
    estimate, history = result.estimate, result.history
    sets = estimate.parameters
    if moment is not None and history:
        sets = history.parameters[moment]
    pair = result.segments[window].pair(follower)
    return simulated(pair, estimate.model, sets[[min(follower, len(sets) - 1)]])


def tracking_at(
    result: Result, follower: int, window: int, moment: int, height: int = COURSE
) -> go.Figure:
    """The chart `tracking` of one follower by the parameters of a moment of the history.

    At the last moment the method's own curves are drawn, too.
    """
    simulation = driven(result, follower, window, moment)
    assert result.history
    is_last = moment == len(result.history.iteration) - 1
    curves = curves_of(result, follower, window) if is_last else None
    drawn = curves_in(result.segments[window], follower, simulation=simulation)
    if curves and NETWORK in curves.lines:
        drawn = replace(drawn, lines={**drawn.lines, NETWORK: curves.lines[NETWORK]})
    return drive(drawn, with_error=False, height=height)


def curves_in(
    segment: Segment, follower: int, curves: Trajectories | None = None,
    simulation: Trajectories | None = None, curve_name: str = NETWORK,
    disturbance: FloatArray | None = None,
) -> Curves:  # fmt: skip
    """One follower (0 for the first) in a segment, with curves and a disturbance (N, M) in m/s².

    The simulation is of this follower alone, behind the measured vehicle ahead, as one column;
    ``curve_name`` names the curves.
    """
    given = {DATA: (segment.measured, follower), curve_name: (curves, follower)}
    lines = {
        name: Trajectories(segment.start + of.time, of.speeds[:, [k, k + 1]], of.gaps[:, [k]])
        for name, (of, k) in (given | {SIMULATION: (simulation, 0)}).items()
        if of
    }
    hits: Mask = np.zeros(1, bool)
    if simulation:
        hits = collides(simulation.gaps[:, 0]) & (segment.measured_gaps[:, follower] > 0)
    return Curves(
        segment.vehicles[follower + 1],
        style.vehicle_colours(segment.vehicles)[follower + 1],
        lines,
        float(segment.start + segment.time[hits.argmax()]) if hits.any() else None,
        None if disturbance is None else disturbance[:, follower],
    )


def curves_of(result: Result, follower: int, window: int = 0) -> Curves:
    """One follower of an estimate in one window, both counted from 0.

    Curves that are the simulation itself are left out; the band is known in the first window.
    """
    estimate, segment, method = result.estimate, result.segments[window], result.estimate.method
    has_own = bool(estimate.curves) and not METHODS[method].is_closed_loop
    curves = curves_in(
        segment,
        follower,
        estimate.curves[window] if has_own else None,
        driven(result, follower, window),
        METHODS[method].curve_title or METHODS[method].title,
        of_window(estimate.arrays, window).get("disturbance"),
    )
    several = f"Window {segment.window}. " if len(result.segments) > 1 else ""
    about = f"{several}Simulation: the vehicle behind the measured one ahead, by the estimate."
    curves = replace(curves, about=about)
    if window > 0 or not (band := result.gap_band):
        return curves
    measured = np.interp(band.time, segment.time, segment.measured.gaps[:, follower])
    ends = band.lower[:, follower], band.upper[:, follower]
    parts = np.array([segment.start + band.time, *ends, measured])
    finite = np.flatnonzero(np.isfinite(parts[1]))
    pieces = np.split(finite, np.flatnonzero(np.diff(finite) > 1) + 1) if len(finite) else []
    step = 1 + len(measured) // BAND_POINTS
    drawn = tuple(parts[:, piece[::step]] for piece in pieces)
    return replace(curves, band=drawn, level=band.level)


def tracking(
    segment: Segment, follower: int, curves: Trajectories | None = None,
    simulation: Trajectories | None = None, curve_name: str = NETWORK,
    disturbance: FloatArray | None = None, height: int | None = None,
) -> go.Figure:  # fmt: skip
    """The chart `drive` of `curves_in` a segment, without the gap's error."""
    numbers = curves_in(segment, follower, curves, simulation, curve_name, disturbance)
    return drive(numbers, with_error=False, height=height)


def tracking_of(result: Result, follower: int, window: int = 0) -> go.Figure:
    """The chart `drive` of `curves_of` a result."""
    return drive(curves_of(result, follower, window))


def drive(curves: Curves, *, with_error: bool = True, height: int | None = None) -> go.Figure:
    """Gap and speed of one follower: data, a method's curves and a simulation.

    The error of the gap, and a disturbance, have panels of their own. The height is in pixels, by
    default that of the panels.
    """
    moved, data = curves.disturbance, curves.lines[DATA]
    rows = [GAP, SPEED, *([GAP_ERROR] if with_error else [])]
    rows += [] if moved is None else [DISTURBANCE]
    chart = style.Chart(
        f"tracking-{curves.number}", height or 140 + 160 * len(rows),
        style.stack(*HEIGHTS[len(rows)]), rows,
    )  # fmt: skip
    for row in range(3, len(rows) + 1):
        chart.level(f"y{row}", 0, {"color": style.GRID, "width": 1.5})
    for at, (time, lower, upper, measured) in enumerate(curves.band):
        look: style.Part = {"colour": style.MODEL, "opacity": 0.3}
        name = f"{100 * curves.level:.0f} % band"
        chart.band(time, lower, upper, name=name, panel=1, showlegend=at == 0, **look)
        if with_error:  # narrow bands are seen there alone
            ends = lower - measured, upper - measured
            chart.band(time, *ends, name=name, panel=3, showlegend=False, **look)
    looks: dict[str, style.Part] = {
        DATA: {"colour": style.LEADER, "width": 4, "opacity": 0.7},
        SIMULATION: {"colour": style.MODEL, "width": 1.5, "dash": "dot"},
    }
    for name, line in curves.lines.items():
        drawn = {GAP: line.gaps[:, 0], SPEED: line.speeds[:, 1]}
        drawn |= {GAP_ERROR: (line.gaps - data.gaps)[:, 0]} if with_error and name != DATA else {}
        look = looks.get(name, {"colour": curves.colour, "width": 1.5})
        for row, (channel, values) in enumerate(drawn.items(), 1):
            chart.line(line.time, values, name, panel=row, hover=_hover(channel, name), **look)
    if curves.collision is not None:
        chart.level("y", 0, {"color": style.LEADER, "width": 1.5})
        cross = {"symbol": "x", "size": 11, "color": style.MODEL}
        hover = f"{curves.collision:.1f} s<extra>collision</extra>"
        chart.dots([curves.collision], [0.0], "collision", 1, hover, marker=cross)
    if moved is not None:
        chart.line(
            np.linspace(data.time[0], data.time[-1], len(moved)), moved, "disturbance",
            curves.colour, 1.5, panel=len(rows), hover=_hover(DISTURBANCE, "disturbance"),
            showlegend=False,
        )  # fmt: skip
    return style.with_legend(chart.figure())


def _hover(channel: Quantity, name: str) -> str:
    return f"%{{y:.2f}} {channel.unit}<extra>{html.escape(name)}</extra>"


@view
def forest(description: Description, follower: int) -> go.Figure:
    """The time gap of each window alone, and of all of them together, with intervals.

    The estimate has its windows' own values; the follower is 0 for the first.
    """
    described, speed = description.follower(follower), description.estimate.stated_speed
    colour = style.vehicle_colours(description.info.vehicles)[follower + 1]
    chart = style.Chart(f"forest-{follower}", 300)
    span = described.values.time_gap.span
    alone = [values.time_gap.span for values in described.windows]
    gaps, low, high = np.array([(gap.value, gap.lower, gap.upper) for gap in alone]).T
    low, high = np.fmin(low, gaps), np.fmax(high, gaps)  # a point has no ends
    ends = np.array([[info.window.start, info.window.end] for info in description.infos])
    margin = 0.03 * max(float(np.ptp(ends)), 1.0)
    whole = np.array([ends.min() - margin, ends.max() + margin])
    if description.estimate.posterior:
        for lower, upper, opacity in (
            (span.further_lower, span.further_upper, FURTHER),
            (span.lower, span.upper, TYPICAL),
        ):
            chart.band(whole, np.full(2, lower), np.full(2, upper), colour, opacity)
    chart.line(whole, np.full(2, span.value), colour=colour, hoverinfo="skip")
    middles, grey = ends.mean(axis=1), {"color": style.LEADER}
    chart.dots(
        middles, gaps, hover="%{text}: %{y:.2f} s<extra></extra>", marker=grey | {"size": 9},
        text=[str(info.window) for info in description.infos],
        ends=(low, high), bar=grey | {"thickness": 1.6, "width": 5},
        error_x=grey | {"array": ends[:, 1] - middles, "thickness": 3, "width": 0},
    )  # fmt: skip
    seen = np.array([*gaps, *low, *high, span.value, span.further_lower, span.further_upper])
    seen = seen[np.isfinite(seen)]
    shown = [max(0.0, float(seen.min()) - 0.05), float(seen.max()) + 0.05] if len(seen) else None
    chart.axis("x", TIME.axis, range=whole.tolist(), showgrid=False)
    chart.axis("y", f"Time gap at {3.6 * speed:.0f} km/h [s]", range=shown)
    return chart.figure()
