"""The frequency laboratory: one frequency marked on the responses, and the cars that follow it."""

import html
from functools import lru_cache
from typing import Literal

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import TIME
from accpinn.inference.gain_check import decibels
from accpinn.inference.intervals import Uncertainty
from accpinn.model.cthp import Parameters
from accpinn.platoon.steady import steady_deviations
from accpinn.results.figures import style
from accpinn.results.figures.platoon import WIDTHS, colours_of
from accpinn.results.figures.stability import (
    AT,
    AXIS_OF_FREQUENCY,
    BAND_OPACITY,
    BAND_POINTS,
    LIMIT,
    TICKS,
    WHOLE,
    WHOLE_NAME,
    bode,
    colours,
    draw_clickable,
    frequencies,
)
from accpinn.results.vehicles import Cast, KnownVehicles
from accpinn.stability.criteria import response
from accpinn.stability.head_to_tail import head_to_tail_peaks
from accpinn.units import FloatArray, MetresPerSecond, RadiansPerSecond, Seconds, interval_ends

Part = Literal["magnitude", "phase"]
"""The part of the response H(jω) that is drawn."""

MARK = "chosen frequency"
"""Name of the points that mark the chosen frequency on the curves."""
MARK_LINE: style.Part = {"color": style.MODEL, "width": 1.5, "dash": "dot"}
"""The line at the chosen frequency, and along one of its periods."""
PHASE_AT = "%{y:.1f}° at %{x:.3f} rad/s"
"""The text shown when a phase is hovered over."""
BELOW, BELOW_POINTS = 1e-3, 300
"""Share of the lowest frequency from which phases are followed, and by how many points."""
PHASE_STEP = 45.0
"""Distance of the phase's ticks in degrees, or a multiple of it."""
PHASE_TICKS = 8
"""Largest number of these ticks, about."""
SHOWN: Seconds = 100.0
"""Length of the waves' axis of time, at least."""
PERIODS = 2.0
"""Periods of a slow sinusoid that the waves show."""
INSTANTS_PER_PERIOD, INSTANTS = 40, 160
"""Instants of a wave: so many a period, and so many at least."""
AMPLITUDE: MetresPerSecond = 1.0
"""Amplitude of the leader's speed, as in the paper."""
MOST_GROWTH = 15.0
"""Growth up to which the waves have one scale at all frequencies."""
ROOM = 1.3
"""Height of the waves' axis over the largest amplitude; the period is marked there."""


def response_curves(
    subject: KnownVehicles, part: Part, omega: RadiansPerSecond, height: int
) -> go.Figure:
    """The magnitude or phase of every vehicle's response, with a mark at ω on every curve.

    Every point carries the vehicle's index as its custom data, as in `bode`. The height is in
    pixels.
    """
    is_magnitude, vehicles = part == "magnitude", subject.vehicles
    figure = bode(subject, height) if is_magnitude else bode_phase(subject, height)
    parts = style.parts_of(figure)
    for trace in parts["data"]:  # half the bytes, as they are sent at every step of the slider
        trace.update({axis: np.asarray(trace[axis], np.float32) for axis in ("x", "y")})
    at = np.array([omega])
    single = response(vehicles.parameters, at)
    values = decibels(np.abs(single)) if is_magnitude else phases(vehicles.parameters, at)
    labels, paints, values = [*vehicles.labels], [*colours(vehicles)], values[:, 0]
    indices = [*range(len(vehicles))]
    if len(vehicles) > 1:
        labels, paints, indices = [*labels, WHOLE_NAME], [*paints, style.LEADER], [*indices, WHOLE]
        values = np.append(values, values.sum())
    hover = AT if is_magnitude else PHASE_AT
    parts["data"].append({
        "x": np.full(len(values), omega), "y": values, "name": MARK, "mode": "markers",
        "showlegend": False, "customdata": indices,
        "hovertemplate": f"{hover}<extra>%{{text}}</extra>",
        "text": [html.escape(label) for label in labels],
        "marker": {"size": 10, "color": paints, "line": {"width": 2, "color": style.MODEL}},
        "selected": {"marker": {"opacity": 1}}, "unselected": {"marker": {"opacity": 1}},
    })  # fmt: skip
    parts["layout"]["shapes"].append({
        "type": "line", "xref": "x", "x0": omega, "x1": omega, "yref": "y domain", "y0": 0, "y1": 1,
        "line": MARK_LINE, "layer": "below",
    })  # fmt: skip
    return style.Figure(parts)


def phases(parameters: Parameters, omega: FloatArray) -> FloatArray:
    """(V, K) arg H(jω) in degrees at (K,) rising ω in rad/s, followed from 0 at ω = 0."""
    below = np.geomspace(BELOW * omega[0], omega[0], BELOW_POINTS, endpoint=False)
    along = np.angle(response(parameters, np.concatenate([below, omega])))
    return np.asarray(np.degrees(np.unwrap(along, axis=1)[:, BELOW_POINTS:]))


def bode_phase(subject: KnownVehicles, height: int) -> go.Figure:
    """The phase of every vehicle's response over frequency, and from the leader to the last.

    Points carry the vehicle's index as in `bode`; the uncertainty adds the interval of every
    vehicle whose parameters are determined. The height is in pixels.
    """
    vehicles, omega = subject.vehicles, frequencies(subject.report)
    chart = style.Chart("bode-phase", height, hoverdistance=200, clickmode="event+select")
    angles, paints = phases(vehicles.parameters, omega), colours(vehicles)
    along = np.geomspace(omega[0], omega[-1], BAND_POINTS)
    bands = _phase_bands(subject.uncertainty, omega[0], omega[-1]) if subject.uncertainty else {}
    for k, (lower, upper) in bands.items():
        chart.band(along, lower, upper, paints[k], BAND_OPACITY, f"band {k}")
    chart.level("y", 0, LIMIT, "below")
    for k, (label, colour) in enumerate(zip(vehicles.labels, paints, strict=True)):
        draw_clickable(chart, omega, angles[k], k, label, colour, PHASE_AT)
    whole = angles.sum(axis=0)
    if len(vehicles) > 1:
        draw_clickable(chart, omega, whole, WHOLE, WHOLE_NAME, style.LEADER, PHASE_AT)
    low = min(float(whole.min()), *(float(row.min()) for row in angles))
    step = PHASE_STEP * max(1.0, np.ceil(-low / PHASE_STEP / PHASE_TICKS))
    ends = np.log10(omega[[0, -1]]).tolist()
    chart.axis("x", AXIS_OF_FREQUENCY, type="log", range=ends, **TICKS)
    chart.axis("y", "Phase of H(jω) [°]", range=[1.04 * low - 2.0, 0.04 * abs(low) + 2.0],
               dtick=step)  # fmt: skip
    return chart.figure()


@lru_cache(maxsize=64)
def _phase_bands(
    uncertainty: Uncertainty, first: RadiansPerSecond, last: RadiansPerSecond
) -> dict[int, tuple[FloatArray, FloatArray]]:
    """The interval of the phase in degrees at the uncertainty's level, of each vehicle with one."""
    omega, bands = np.geomspace(first, last, BAND_POINTS), {}
    for k in range(uncertainty.draws.alpha.shape[1]):
        draws = uncertainty.draws[:, k]
        if np.isfinite(draws.alpha).all():
            lower, upper = interval_ends(phases(draws, omega), uncertainty.level)
            bands[k] = lower.round(2), upper.round(2)
    return bands


def steady_waves(cast: Cast, omega: RadiansPerSecond, height: int) -> go.Figure:
    """The speeds of a platoon behind a sinusoid, once its transient is over, about their mean.

    The scale is the same at all frequencies, unless the platoon grows more than `MOST_GROWTH`-fold,
    so that growth is seen. One period of the leader is marked. The height is in pixels.
    """
    platoon, period = cast.vehicles.parameters[[*cast.order]], 2.0 * np.pi / omega
    end = max(SHOWN, PERIODS * period)
    time = np.linspace(0.0, end, max(INSTANTS, int(INSTANTS_PER_PERIOD * end / period)) + 1)
    moved = steady_deviations(platoon, omega, time, AMPLITUDE)
    chart, paints = style.Chart("steady-waves", height), colours_of(cast)
    for k in [*range(1, len(cast.labels)), 0]:  # the leader last, on top
        if np.isfinite(moved[:, k]).all():
            name = cast.labels[k]
            chart.line(
                time.astype(np.float32), moved[:, k].astype(np.float32), name, paints[k],
                WIDTHS[k > 0], legendrank=k,
                hover=f"%{{y:+.2f}} m/s at %{{x:.1f}} s<extra>{html.escape(name)}</extra>",
            )  # fmt: skip
    settled = np.asarray(np.isfinite(moved).all(axis=0))
    gains = np.abs(response(platoon, np.array([omega]))[settled[1:], 0])
    here = float(np.max(np.cumprod(gains), initial=1.0))
    top = ROOM * AMPLITUDE * max(here, _largest_growth(cast))
    _mark_period(chart, period, top)
    if not settled.all():
        first = cast.labels[int(np.argmin(settled))]
        chart.words(f"{html.escape(first)} never settles", 0.995, 0.005)
    chart.axis("x", TIME.axis, range=[0.0, end])
    chart.axis("y", "Speed about the mean [m/s]", range=[-top, top])
    return chart.figure()


def _largest_growth(cast: Cast) -> float:
    """The largest growth along the platoon at any frequency, between 1 and `MOST_GROWTH`."""
    gains = head_to_tail_peaks(cast.vehicles.parameters[[*cast.order]]).gain
    return float(np.clip(np.max(gains, initial=1.0), 1.0, MOST_GROWTH))


def _mark_period(chart: style.Chart, period: Seconds, top: float) -> None:
    """Mark the leader's second period from crest to crest, and say how long it is."""
    start, level = 0.25 * period, top * (1.0 + 1.0 / ROOM) / 2.0
    tick = 0.03 * top
    for x0, x1, y0, y1 in (
        (start, start + period, level, level),
        (start, start, level - tick, level + tick),
        (start + period, start + period, level - tick, level + tick),
    ):
        chart.shape({"type": "line", "xref": "x", "yref": "y", "x0": x0, "x1": x1, "y0": y0,
                     "y1": y1, "line": {"color": style.MODEL, "width": 2}})  # fmt: skip
    chart.words(
        f" one period: {period:.1f} s", start + period, level, xref="x", xanchor="left",
        yref="y", yanchor="middle",
    )  # fmt: skip
