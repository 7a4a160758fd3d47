"""The frequency laboratory: responses, and the data from which a browser draws the cars' waves.

The browser marks a frequency on the curves and draws the steady motion of the cars itself, from
each car's complex gain at all frequencies on offer: moving the frequency takes no server.
"""

import html
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from accpinn.channels import TIME
from accpinn.inference.gain_check import decibels
from accpinn.inference.intervals import Uncertainty
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.platoon.steady import steady_gains
from accpinn.results.cast import Cast
from accpinn.results.figures import style
from accpinn.results.figures.platoon import WIDTHS, colours_of
from accpinn.results.figures.stability import (
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
from accpinn.stability.criteria import checked, response
from accpinn.stability.head_to_tail import head_to_tail_peaks
from accpinn.stability.lagged import is_lagged
from accpinn.study.vehicles import AssessedVehicles
from accpinn.units import FloatArray, MetresPerSecond, RadiansPerSecond, Seconds, interval_ends

Part = Literal["magnitude", "phase"]
"""The part of the response H(jω) that is drawn."""

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
AMPLITUDE: MetresPerSecond = 1.0
"""Amplitude of the leader's speed, as in the paper."""
INSTANTS = 601
"""Instants of the waves in a report."""
MOST_GROWTH = 15.0
"""Growth up to which the waves have one scale at all frequencies."""
DIGITS = 7
"""Significant digits of a number that is sent."""
CONDITION = "L∞ condition of the paper"
"""Name of the lines to the limit that D > 0 sets."""
UNITS: dict[Part, tuple[str, int]] = {"magnitude": ("dB", 2), "phase": ("°", 1)}
"""Unit and decimals of each part where it is written."""


def response_curves(subject: AssessedVehicles, part: Part, height: int) -> go.Figure:
    """The magnitude or phase of every vehicle's response, in half the bytes.

    Every point carries the vehicle's index as its custom data, as in `bode`. The magnitude has the
    paper's conditions on it. The height is in pixels.
    """
    figure = bode(subject, height) if part == "magnitude" else bode_phase(subject, height)
    parts = style.parts_of(figure)
    if part == "magnitude":
        _draw_conditions(parts, subject.vehicles)
    for trace in parts["data"]:
        trace.update({axis: np.asarray(trace[axis], np.float32) for axis in ("x", "y")})
    return style.Figure(parts)


def _draw_conditions(parts: style.Part, vehicles: ParameterSet) -> None:
    """Draw the limits that the paper's conditions set to the curves.

    L₂ asks |H| ≤ 0 dB everywhere. L∞, D > 0, is a condition on one point: by

        |H(j√α)|² = (α + β²) / (ατ + β)²,   D > 0  ⇔  (ατ + β)² > 4α

    the curve of α, β and τ has to pass below (α + β²) / 4α at ω = √α. With a lag or a delay, which
    the paper's model does not have, the stem ends where that curve passes without them.
    """
    chart, paints = style.Chart("conditions", 0), colours(vehicles)
    without = " without lag and delay" * is_lagged(vehicles.parameters)
    for k, (alpha, alpha_tau, beta) in enumerate(vehicles.parameters.theta.tolist()):
        if not alpha:
            continue
        denominators = np.array([4.0 * alpha, (alpha_tau + beta) ** 2])
        with np.errstate(divide="ignore"):  # an undamped vehicle in resonance
            limit, level = decibels(np.sqrt((alpha + beta**2) / denominators)).tolist()
        words = f"{'met' if level < limit else 'not met'}, {level:.2f} dB{without}"
        chart.line(
            [alpha**0.5] * 2, [limit, level], CONDITION, paints[k], 1.2, "dot", opacity=0.8,
            mode="lines+markers", showlegend=False,
            marker={"symbol": ["line-ew", "circle"], "size": [18, 3],
                    "line": {"width": [3, 0], "color": paints[k]}, "color": paints[k]},
            hover=f"L∞, the paper's D > 0: below {limit:.2f} dB at √α = {alpha**0.5:.3f} rad/s;"
            f" {words}<extra>{html.escape(vehicles.labels[k])}</extra>",
        )  # fmt: skip
    drawn = style.parts_of(chart.figure())
    parts["data"] += drawn["data"]
    parts["layout"]["annotations"] += drawn["layout"]["annotations"]


def frequency_data(
    subject: AssessedVehicles, cast: Cast, part: Part, offered: Sequence[RadiansPerSecond]
) -> dict[str, Any]:
    """The data that the browser draws at any of the offered frequencies, as JSON.

    Returns:
        "omega" (K,); of each of the platoon's different vehicles its gain H(jω) as real and
        imaginary parts, null where it never settles; its "order" in terms of these; names, colours
        and widths of all vehicles, leader first; the "curves" of the response with their values
        at each frequency; and the "cars" (V, 5) α, β, τ, λ and d of these curves, of which the
        platoon's "different" ones are places, for what a change of these would do.
    """
    omega, vehicles = np.array(offered), subject.vehicles
    different = [*dict.fromkeys(cast.order)]
    gains = steady_gains(cast.vehicles.parameters[different], omega)
    parameters, (unit, decimals) = vehicles.parameters, UNITS[part]
    if part == "magnitude":
        values = decibels(np.abs(response(parameters, omega)))
    else:
        values = phases(parameters, omega)
    names, paints = [*vehicles.labels], [*colours(vehicles)]
    if len(vehicles) > 1:
        values = np.vstack([values, values.sum(axis=0)])
        names, paints = [*names, WHOLE_NAME], [*paints, style.LEADER]
    return {
        "omega": [*offered],
        "gains": [[_sent(row.real), _sent(row.imag)] for row in gains],
        "order": [different.index(k) for k in cast.order],
        "names": [*cast.labels],
        "colours": colours_of(cast),
        "widths": [WIDTHS[k > 0] for k in range(len(cast.labels))],
        "curves": [
            {"name": name, "colour": paint, "values": _sent(row)}
            for name, paint, row in zip(names, paints, values, strict=True)
        ],
        "cars": checked(vehicles.parameters).complete[:, [0, 1, 2, 4, 5]].tolist(),
        "different": different,
        "unit": unit,
        "decimals": decimals,
        "amplitude": AMPLITUDE,
        "growth": _largest_growth(cast),
        "shown": SHOWN,
        "periods": PERIODS,
        "mark": style.MODEL,
        "grid": style.GRID,
        "time": TIME.axis,
        "speed": "Speed about the mean [m/s]",
    }


def _sent(values: NDArray[np.float64]) -> list[float | None]:
    """Numbers as JSON has them."""
    return [float(f"{v:.{DIGITS}g}") if np.isfinite(v) else None for v in values.tolist()]


def phases(parameters: Parameters, omega: FloatArray) -> FloatArray:
    """(V, K) arg H(jω) in degrees at (K,) rising ω in rad/s, followed from 0 at ω = 0."""
    below = np.geomspace(BELOW * omega[0], omega[0], BELOW_POINTS, endpoint=False)
    along = np.angle(response(parameters, np.concatenate([below, omega])))
    return np.asarray(np.degrees(np.unwrap(along, axis=1)[:, BELOW_POINTS:]))


def bode_phase(subject: AssessedVehicles, height: int) -> go.Figure:
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
    """The speeds that the browser draws at one frequency, for a report; the height is in pixels."""
    platoon, end = cast.vehicles.parameters[[*cast.order]], max(SHOWN, PERIODS * 2 * np.pi / omega)
    time = np.linspace(0.0, end, INSTANTS)
    gains = np.cumprod(np.append(1.0, steady_gains(platoon, np.array([omega]))[:, 0]))
    moved = (AMPLITUDE * gains[:, None] * np.exp(1j * omega * time)).imag
    chart, paints = style.Chart("steady-waves", height), colours_of(cast)
    for k in [*range(1, len(cast.labels)), 0]:  # the leader last, on top
        if np.isfinite(moved[k]).all():
            chart.line(
                time.astype(np.float32), moved[k].astype(np.float32), cast.labels[k], paints[k],
                WIDTHS[k > 0], legendrank=k,
                hover=f"%{{y:+.2f}} m/s<extra>{html.escape(cast.labels[k])}</extra>",
            )  # fmt: skip
    largest = float(np.nanmax(np.abs(gains)))
    top = 1.1 * AMPLITUDE * max(largest, _largest_growth(cast))
    chart.axis("x", TIME.axis, range=[0.0, end])
    chart.axis("y", "Speed about the mean [m/s]", range=[-top, top])
    return chart.figure()


def _largest_growth(cast: Cast) -> float:
    """The largest growth along the platoon at any frequency, between 1 and `MOST_GROWTH`."""
    gains = head_to_tail_peaks(cast.vehicles.parameters[[*cast.order]]).gain
    return float(np.clip(np.max(gains, initial=1.0), 1.0, MOST_GROWTH))
