"""Figures of control engineering: poles, responses, margins, large waves."""

import html
from collections.abc import Sequence
from math import isnan

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import TIME
from accpinn.model.cthp import Parameters
from accpinn.results.figures import style
from accpinn.results.figures.stability import (
    AXIS_OF_FREQUENCY,
    CLOUD,
    DOT_OPACITY,
    L2_UNSTABLE,
    LIMIT,
    MAKE_END,
    TICKS,
    WHOLE_NAME,
    colours,
)
from accpinn.stability.modes import dominant_poles, responses
from accpinn.stability.waves import Waves
from accpinn.study.vehicles import AssessedVehicles
from accpinn.units import FloatArray, Quantity, Seconds

HEIGHT = 320
"""Height of poles and responses, in pixels."""
MOST_RADII = 1.3
"""Radius of the map of poles, in natural frequencies of the fastest rightmost one, at most."""
FARTHEST = 2.0
"""Farthest zero in sight, in the same."""
DAMPINGS = (0.4, 0.7)
"""Damping ratios whose rays are drawn."""
SETTLED = 0.02
"""Half the band within which a step response is settled."""
MOST_STEP = 1e3
"""Largest step response that is drawn."""
RESPONSE: tuple[Seconds, Seconds] = (10.0, 90.0)
"""Least and greatest length of the responses in sight."""

DIRECTIONS = "braking", "accelerating"
"""Of waves, as they are called."""
MOST_GROWTH = 5.0
"""Largest growth of a wave that is in sight."""


def pole_map(subject: AssessedVehicles, height: int = HEIGHT) -> go.Figure:
    """Poles and zeros of every vehicle, and the rightmost poles of some posterior samples.

    What is in sight are the poles that decide; faster ones lie to the left. The height is in
    pixels.
    """
    vehicles, paints = subject.vehicles, colours(subject.vehicles)
    chart = style.Chart("pole-map", height, hoverdistance=40)
    every = subject.modes
    fast = max((m.natural_frequency for m in every if m.natural_frequency > 0), default=0.3)
    seen = [min(float(abs(pole)), MOST_RADII * fast) for m in every for pole in m.poles[:2]]
    zeros = [float(abs(zero)) for m in every for zero in m.zeros]
    radius = 1.25 * max([*seen, *(zero for zero in zeros if zero <= FARTHEST * fast), 0.1])
    upper = [abs(m.poles[0].imag) for m in every if len(m.poles)]
    height_seen = max(1.25 * max(upper, default=0.0), 0.4 * radius)
    chart.area("x", 0.0, radius, L2_UNSTABLE)
    chart.level("x", 0.0, LIMIT, "below")
    chart.level("y", 0.0, {"color": style.GRID, "width": 1}, "below")
    for ratio in DAMPINGS:
        reach = 1.5 * radius
        x, y = -ratio * reach, (1.0 - ratio**2) ** 0.5 * reach
        chart.add([x, 0.0, x], [y, 0.0, -y], mode="lines", hoverinfo="skip", showlegend=False,
                  line={"color": style.LEADER, "width": 1, "dash": "dot"})  # fmt: skip
    if subject.uncertainty:
        draws = subject.uncertainty.draws
        rows = np.linspace(0, len(draws.alpha) - 1, CLOUD // 2).astype(int)
        for k, colour in enumerate(paints):
            at = dominant_poles(Parameters.of(draws.complete[rows, k]))
            at = np.concatenate([at, at.conj()])
            at = at[np.isfinite(at)]
            dot = {"size": 3.5, "color": style.translucent(colour, DOT_OPACITY)}
            chart.dots(
                at.real.round(5), at.imag.round(5), f"cloud {k}", showlegend=False, marker=dot
            )
    for k, (label, colour, modes) in enumerate(zip(vehicles.labels, paints, every, strict=True)):
        for at, what, symbol, size in (
            (modes.poles, "pole", "x-thin", 9), (modes.zeros, "zero", "circle-open", 10),
        ):  # fmt: skip
            chart.dots(
                at.real, at.imag, f"{label}, {what}", customdata=[k] * len(at),
                hover=f"{what} %{{x:.4f}} %{{y:+.4f}}j rad/s<extra>{html.escape(label)}</extra>",
                marker={"symbol": symbol, "size": size, "color": colour,
                        "line": {"width": 2.5, "color": colour}},
            )  # fmt: skip
    chart.words("unstable", 0.985, 0.985)
    chart.axis("x", "Real part [rad/s]", range=[-radius, 0.22 * radius])
    chart.axis("y", "Imaginary part [rad/s]", range=[-height_seen, height_seen])
    return chart.figure()


def step_responses(subject: AssessedVehicles, height: int = HEIGHT) -> go.Figure:
    """The speed of every vehicle after a unit step of the speed ahead. The height is in pixels."""
    vehicles, end = subject.vehicles, response_length(subject)
    chart = style.Chart("step-responses", height, hoverdistance=200)
    chart.area("y", 1.0 - SETTLED, 1.0 + SETTLED, style.GRID)
    chart.level("y", 1.0, LIMIT, "below")
    tops = [1.1]
    for label, colour, vehicle in zip(
        vehicles.labels, colours(vehicles), vehicles.parameters, strict=True
    ):
        response = responses(vehicle, end)
        step = np.clip(response.step, -MOST_STEP, MOST_STEP)
        hover = f"%{{y:.3f}} at %{{x:.1f}} s<extra>{html.escape(label)}</extra>"
        chart.line(response.time, step, label, colour, 2.2, hover=hover, points=600)
        tops.append(float(step.max()))
    chart.axis("x", TIME.axis, range=[0.0, end])
    chart.axis("y", "Step response of the speed", range=[-0.05, min(1.05 * max(tops), 3.0)])
    return chart.figure()


def impulse_response(subject: AssessedVehicles, k: int, height: int = HEIGHT) -> go.Figure:
    """H of one vehicle, its areas above and below zero shaded, with the verdict's ‖h‖₁.

    The height is in pixels.
    """
    label, colour = subject.vehicles.labels[k], colours(subject.vehicles)[k]
    end, gain = response_length(subject), subject.report.vehicles[k].linf_gain
    chart = style.Chart(f"impulse-response-{k}", height, hoverdistance=200)
    response = responses(subject.vehicles.parameters[k], end)
    h = np.nan_to_num(response.impulse, posinf=0.0, neginf=0.0)
    for part, paint, name in (
        (np.maximum(h, 0.0), colour, "above zero"), (np.minimum(h, 0.0), style.MODEL, "below zero")
    ):  # fmt: skip
        chart.band(response.time, np.zeros_like(h), part, paint, 0.35, name)
    hover = f"%{{y:.4f}} 1/s at %{{x:.1f}} s<extra>{html.escape(label)}</extra>"
    chart.line(response.time, h, label, colour, 2.2, hover=hover, points=600)
    chart.level("y", 0.0, LIMIT, "below")
    if np.isfinite(gain) and gain > 0:
        above, below = (gain + 1.0) / 2.0, (gain - 1.0) / 2.0
        area = f"‖h‖₁ = {above:.3f} + {below:.3f} = <b>{gain:.3f}</b>"
    else:
        area = f"‖h‖₁ = <b>{'∞' if gain else '0'}</b>"
    chart.words(area, 0.985, 0.985, font={"size": 14})
    low, high = float(h.min()), float(h.max())
    room = max(high - low, 1e-3)
    chart.axis("x", TIME.axis, range=[0.0, end])
    chart.axis("y", "Impulse response h [1/s]", range=[low - 0.08 * room, high + 0.22 * room])
    return chart.figure()


def response_length(subject: AssessedVehicles) -> Seconds:
    """The time that responses show: until all vehicles that settle have done so."""
    settled = [m.settling for m in subject.modes if np.isfinite(m.settling)]
    return float(np.clip(1.25 * max(settled, default=RESPONSE[1]), *RESPONSE))


def margin_forest(subject: AssessedVehicles) -> go.Figure:
    """The margin of every vehicle's time gap by both norms, and of the platoon, with intervals.

    A triangle at the left end stands for a vehicle that no larger time gap makes stable, one at the
    right end for a vehicle that is stable whatever its time gap.
    """
    margins, vehicles = subject.margins, subject.vehicles
    rows = [*vehicles.labels] + [WHOLE_NAME] * bool(margins.platoon)
    paints, last = [*colours(vehicles), style.LEADER], len(rows) - 1
    points = {
        "L₂": [(v.l2.distance, v.l2.state.value) for v in margins.vehicles],
        "L∞, exact": [(v.linf.distance, v.linf.state.value) for v in margins.vehicles],
    }
    if margins.platoon:
        points["L₂"].append((margins.platoon, "the platoon as a whole"))
    low, high = _reach([distance for norm in points.values() for distance, _ in norm])
    chart = style.Chart(
        "margins", 78 + 46 * len(rows), margin={"l": 118, "r": 14, "t": 10, "b": 42},
        hoverdistance=30,
    )  # fmt: skip
    chart.area("x", low, 0.0, L2_UNSTABLE)
    chart.level("x", 0.0, LIMIT)
    for (name, norm), (symbol, shift) in zip(
        points.items(), (("circle", 0.13), ("diamond", -0.13)), strict=True
    ):
        for k, (distance, state) in enumerate(norm):
            value = distance.value
            if isnan(value):
                continue
            ends = np.array([[distance.lower], [distance.upper]])
            lower, upper = np.clip(np.where(np.isnan(ends), value, ends), low, high)
            off = "triangle-left" if value < low else "triangle-right" if value > high else symbol
            chart.dots(
                np.clip([value], low, high), [last - k + shift], f"{rows[k]}, {name}", along="x",
                hover="%{text}<extra></extra>", text=[f"{name}: {_said(distance)}{state}"],
                ends=(lower, upper), bar={"thickness": 2, "color": paints[k]}, customdata=[k],
                marker={"symbol": off, "size": 11, "color": paints[k]},
            )  # fmt: skip
    names = [MAKE_END.sub("<br>", html.escape(row), count=1) for row in rows]
    chart.axis("x", "Margin of the time gap [s]", range=[low, high])
    chart.axis("y", tickvals=[*range(len(rows))][::-1], ticktext=names, showgrid=False,
               range=[-0.6, last + 0.6])  # fmt: skip
    chart.words("unstable", 0.005, 0.995)
    return chart.figure()


def growth_by_frequency(subject: AssessedVehicles, found: Waves) -> go.Figure:
    """How much waves of one size grow over their frequency: braking, and dashed accelerating."""
    chart, tops = _growth_chart("waves-frequency"), [1.1]
    for k, vehicle in enumerate(found.vehicles):
        growth = vehicle.by_frequency
        parts = growth.braking, growth.accelerating
        tops += _draw_directions(
            chart, subject, found, k, growth.omega, parts, "%{y:.2f} at %{x:.3f} rad/s"
        )
    chart.axis("x", AXIS_OF_FREQUENCY, type="log", **TICKS)
    chart.axis("y", "Growth", range=[0.0, 1.05 * min(max(tops), MOST_GROWTH)])
    return chart.figure()


def growth_by_size(subject: AssessedVehicles, found: Waves) -> go.Figure:
    """How much waves grow by their size: braking, and dashed accelerating."""
    chart, tops = _growth_chart("waves-size"), [1.1]
    linear = (vehicle.peak.gain for vehicle in subject.report.vehicles)
    for k, (vehicle, peak) in enumerate(zip(found.vehicles, linear, strict=True)):
        parts = [np.insert(part, 0, peak) for part in (vehicle.braking, vehicle.accelerating)]
        size = 3.6 * np.insert(vehicle.amplitude, 0, 0.0)
        tops += _draw_directions(chart, subject, found, k, size, parts, "%{y:.2f} at %{x:.0f} km/h")
    end = 3.6 * max(float(vehicle.amplitude[-1]) for vehicle in found.vehicles)
    chart.axis("x", "Size of the wave [km/h]", range=[0.0, end])
    chart.axis("y", "Largest growth", range=[min(0.9, *tops), 1.05 * min(max(tops), MOST_GROWTH)])
    return chart.figure()


def _growth_chart(key: str) -> style.Chart:
    chart = style.Chart(key, HEIGHT, hoverdistance=30)
    chart.level("y", 1.0, LIMIT, "below")
    return chart


def _draw_directions(
    chart: style.Chart, subject: AssessedVehicles, found: Waves, k: int, x: FloatArray,
    parts: Sequence[FloatArray], at: str,
) -> list[float]:  # fmt: skip
    """Draw the growth of braking and accelerating waves by one vehicle; returns what is finite."""
    label, colour = found.names[k], colours(subject.vehicles)[k]
    for part, words, dash in zip(parts, DIRECTIONS, ("solid", "dash"), strict=True):
        chart.line(
            x, part, f"{label}, {words}", colour, 2.2, dash, showlegend=dash == "solid",
            hover=f"{words}: {at}<extra>{html.escape(label)}</extra>",
        )  # fmt: skip
    every = np.concatenate(parts)
    return [float(value) for value in every[np.isfinite(every)]]


def _said(value: Quantity) -> str:
    """A margin with its interval, for a hover text; nothing of an infinite one."""
    if not np.isfinite(value.value):
        return ""
    ends = "" if isnan(value.lower) else f" ({value.lower:+.2f} to {value.upper:+.2f})"
    return f"{value.value:+.2f} s{ends}<br>"


def _reach(margins: Sequence[Quantity]) -> tuple[float, float]:
    """The axis of margins: around zero and all points, and their intervals where not too wide."""
    points = [m.value for m in margins if np.isfinite(m.value)] or [0.0]
    most = 2.5 * max(*map(abs, points), 0.4)
    ends = [end for m in margins for end in (m.lower, m.upper) if abs(end) <= most]
    low, high = min(*ends, *points, 0.0), max(*ends, *points, 0.0)
    room = 0.12 * max(high - low, 0.5)
    return low - room, high + room
