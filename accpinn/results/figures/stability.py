"""String stability as figures: Bode magnitude, computed and measured, criteria, and maps."""

import html
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import ALPHA, BETA, MAGNITUDE, TAU
from accpinn.inference.gain_check import compared, decibels
from accpinn.inference.intervals import Uncertainty, gain_band, interval_ends
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.results.figures import style
from accpinn.stability.criteria import (
    response,
    smallest_headway_exact,
    smallest_headway_l2,
    smallest_headway_paper,
)
from accpinn.stability.measured_gain import MeasuredGain
from accpinn.stability.report import StabilityReport
from accpinn.study.result import Result
from accpinn.units import FloatArray

Plane = Literal["beta", "alpha"]
"""The parameter on a map's horizontal axis; τ is on the vertical one."""

L2, PAPER, EXACT = style.SERIES[0], style.LEADER, style.MODEL
"""Colours of the three criteria; vehicles have others."""
L2_UNSTABLE = "rgba(194, 47, 79, 0.10)"
ONLY_LINF_UNSTABLE = "rgba(214, 140, 40, 0.14)"
STABLE = "rgba(85, 144, 15, 0.12)"
LIMIT = {"color": style.LEADER, "width": 1.2}
"""The line between amplified and damped."""

BOUNDARIES = {
    "L₂": (smallest_headway_l2, L2, "solid"),
    "L∞, paper": (smallest_headway_paper, PAPER, "dash"),
    "L∞, exact": (smallest_headway_exact, EXACT, "solid"),
}
"""The smallest stable τ by each criterion, and how a map draws it."""

MAKE_END = re.compile(r"(?<=[^\W\d]) ")
"""Where a vehicle's name is broken below an axis: behind its make."""
FREQUENCIES = 300
SPAN = (0.02, 1.0)
"""Frequencies in rad/s that the Bode magnitude always shows."""
_TICKS = [digit * 10.0**power for power in range(-4, 3) for digit in (1, 2, 5)]
TICKS = {"tickvals": _TICKS, "ticktext": [f"{tick:g}" for tick in _TICKS]}
FLOOR, CEILING, FOOT = -12.0, 40.0, 0.6
"""Lowest and highest dB in sight, and the room below them."""
ALONG = 240
"""Points of a boundary."""
CRITERIA_KEY = (
    ("L₂: criterion, peak of |H|", L2),
    ("L∞: the paper's criterion", PAPER),
    ("L∞: exact gain ‖h‖₁", EXACT),
)
"""What the lines of the figures below mean; a page shows it above them."""
MAP_KEY = (
    ("L₂", L2),
    ("L∞, the paper's criterion", PAPER),
    ("L∞, exact criterion", EXACT),
    ("L₂ stable, L∞ unstable", "rgba(214, 140, 40, 0.55)"),
)
BAND_OPACITY, DOT_OPACITY = 0.16, 0.35
CLOUD = 300
"""Draws shown of each vehicle; more only make the cloud darker."""
BAND_POINTS = 120
"""Points of a band along the frequencies."""
ACROSS: Mapping[Plane, int] = {"alpha": 0, "beta": 1}
"""Index of the parameter on a map's horizontal axis."""
LEAST_PEAK = 4.0
"""Top of a thumbnail in dB, at least: calm vehicles have the same axis."""
LOWEST = -60.0
"""dB that stands for a gain of zero."""


def colours(vehicles: ParameterSet) -> tuple[str, ...]:
    """Each follower's colour, the same on every page."""
    return tuple(style.vehicle_colours(vehicles.vehicles)[1:])


class Measured(NamedTuple):
    """A vehicle's measured gain in a figure."""

    label: str
    colour: str
    gain: MeasuredGain


def measured_of(result: Result) -> list[Measured]:
    """The measured gains of a result's followers; none where the data are not at hand."""
    info = result.info
    gains = result.measured_gains if result.segments else ()
    named = zip(info.labels[1:], style.vehicle_colours(info.vehicles)[1:], gains, strict=False)
    return [Measured(label, colour, gain) for label, colour, gain in named if gain]


def bode(
    vehicles: ParameterSet, report: StabilityReport, uncertainty: Uncertainty | None = None,
    measured: Sequence[Measured] = (), height: int = 400,
) -> go.Figure:  # fmt: skip
    """The Bode magnitude of every vehicle, and from the leader to the last.

    Every point carries the vehicle's index as its custom data, -1 for the whole platoon. The
    uncertainty adds the interval of |H| under the curve of every vehicle whose parameters are
    determined. Measured gains are points with bars. The height is in pixels.
    """
    omega = _frequencies(report)
    gains = np.abs(response(vehicles.parameters, omega))
    tops = [vehicle.peak.db for vehicle in report.vehicles] + [report.platoon.peaks[-1].db]
    tops += [float(decibels(m.gain.upper[compared(m.gain)]).max(initial=1.0)) for m in measured]
    traces = [*_bands(vehicles, uncertainty, omega)] if uncertainty else []
    tops += [float(np.max(trace["y"])) for trace in traces]
    top = min(max(*tops, 1.0) * 1.12 + 0.4, CEILING)
    traces += [part for one in measured for part in _points(one, top)]
    for k, (label, colour) in enumerate(zip(vehicles.labels, colours(vehicles), strict=True)):
        line = {"color": colour, "width": 2.2}
        traces.append(_clickable(omega, gains[k], k, html.escape(label), line))
    if len(vehicles) > 1:
        line = {"color": style.LEADER, "width": 2, "dash": "dash"}
        whole = gains.prod(axis=0)
        traces.append(_clickable(omega, whole, -1, "Leader to last follower", line))
    traces += _peaks(vehicles, report)
    amplified = style.across("y", 0, top, fillcolor=L2_UNSTABLE, line={"width": 0}, layer="below")
    ends = np.log10(omega[[0, -1]]).tolist()
    axes = {
        "x": style.titled("Frequency ω [rad/s]") | {"type": "log", "range": ends, **TICKS},
        "y": style.titled(f"{MAGNITUDE.name} {MAGNITUDE.heading}") | {"range": [FLOOR - FOOT, top]},
    }
    return style.composed(
        traces, height, "bode", axes, hovermode="closest", hoverdistance=200,
        clickmode="event+select", annotations=[style.corner("amplified", 0.995, 0.995)],
        shapes=[amplified, style.across("y", 0, line=LIMIT, layer="below")],
    )  # fmt: skip


def _points(measured: Measured, top: float) -> Iterator[style.Part]:
    """A measured gain with its band as bars: full where it is compared with a model's.

    Bars end at the axes, of which ``top`` in dB is one end.
    """
    gain, label = measured.gain, html.escape(measured.label)
    inside = (gain.omega <= SPAN[1]) & (decibels(gain.gain) >= FLOOR)
    sure = compared(gain)
    for part, name, opacity in (
        (sure & inside, f"{label}, measured", 1.0),
        (gain.coherent & ~sure & inside, f"{label}, less coherent", 0.35),
    ):
        levels, lower, upper = (
            np.clip(decibels(end[part]), FLOOR, top) for end in (gain.gain, gain.lower, gain.upper)
        )
        yield {
            "x": gain.omega[part], "y": levels, "name": name, "mode": "markers", "opacity": opacity,
            "marker": {"color": measured.colour, "size": 6, "line": {"width": 0}},
            "error_y": {"type": "data", "symmetric": False, "array": upper - levels,
                        "arrayminus": levels - lower, "width": 0, "thickness": 1.2,
                        "color": measured.colour},
            "showlegend": False,
            "hovertemplate": f"%{{y:.2f}} dB at %{{x:.3f}} rad/s<extra>{name}</extra>",
        }  # fmt: skip


def _frequencies(report: StabilityReport) -> FloatArray:
    """(K,) evenly spaced on a logarithmic axis, with the peaks and crossovers in sight."""
    edges = [vehicle.crossover for vehicle in report.vehicles if vehicle.crossover]
    tops = [vehicle.peak.omega for vehicle in report.vehicles if vehicle.peak.omega]
    return np.geomspace(
        min([SPAN[0], *(omega / 4 for omega in tops)]),
        max([SPAN[1], *(2 * omega for omega in edges)]),
        FREQUENCIES,
    )


def _clickable(
    omega: FloatArray, gain: FloatArray, which: int, name: str, line: Mapping[str, Any]
) -> style.Part:
    """A curve of |H|. Only markers can be clicked, so it has some that are not seen."""
    return {
        "x": omega, "y": decibels(gain), "name": name, "mode": "lines+markers", "line": line,
        "marker": {"opacity": 0, "size": 9, "color": line["color"]},
        "customdata": np.full(len(omega), which),
        "selected": {"marker": {"opacity": 0.9}}, "unselected": {"marker": {"opacity": 0}},
        "hovertemplate": f"%{{y:.2f}} dB at %{{x:.3f}} rad/s<extra>{name}</extra>",
    }  # fmt: skip


def _bands(
    vehicles: ParameterSet, uncertainty: Uncertainty, omega: FloatArray
) -> Iterator[style.Part]:
    """The interval of |H| at the uncertainty's level, for each vehicle that has one."""
    omega = np.geomspace(omega[0], omega[-1], BAND_POINTS)
    for k, colour in enumerate(colours(vehicles)):
        gain = gain_band(uncertainty, k, omega)
        if np.isfinite(gain.lower).all():
            lower, upper = (
                np.clip(decibels(end), LOWEST, 2 * CEILING).round(3)
                for end in (gain.lower, gain.upper)
            )
            yield style.band(omega, lower, upper, colour, BAND_OPACITY, f"band {k}")


def _peaks(vehicles: ParameterSet, report: StabilityReport) -> Iterator[style.Part]:
    """A diamond on the peak and a ring on the crossover of each vehicle that amplifies."""
    shown = [k for k, vehicle in enumerate(report.vehicles) if vehicle.crossover]
    amplifying, paints = [report.vehicles[k] for k in shown], colours(vehicles)
    peaks = [v.peak.omega for v in amplifying], [min(v.peak.db, CEILING) for v in amplifying]
    crossovers = [v.crossover for v in amplifying], [0.0] * len(shown)
    for name, (x, y), look, words in (
        ("peak", peaks, {"symbol": "diamond", "size": 10}, "Peak %{y:.2f} dB at"),
        ("crossover", crossovers, {"symbol": "circle-open", "size": 9, "line": {"width": 2}},
         "Amplified below"),
    ):  # fmt: skip
        yield {
            "x": x, "y": y, "name": name, "mode": "markers", "customdata": shown,
            "text": [html.escape(vehicles.labels[k]) for k in shown], "showlegend": False,
            "marker": look | {"color": [paints[k] for k in shown]},
            "selected": {"marker": {"opacity": 1}}, "unselected": {"marker": {"opacity": 1}},
            "hovertemplate": f"{words} %{{x:.3f}} rad/s<extra>%{{text}}</extra>",
        }  # fmt: skip


def criteria_by_vehicle(vehicles: ParameterSet, report: StabilityReport) -> go.Figure:
    """Criteria and gains along the platoon: the paper's figure, with the exact gains below it."""
    rows, platoon = report.vehicles, report.platoon
    places = list(range(1, len(vehicles) + 1))
    traces = [
        {"x": places, "y": values, "name": name, "mode": "lines+markers", **style.axes_of(panel),
         "line": {"color": colour, "width": 2,
                  "dash": "dot" if symbol.endswith("-open") else "solid"},
         "marker": {"symbol": symbol, "size": 8, "color": colour},
         "hovertemplate": f"%{{y:.4g}}<extra>{name}</extra>"}
        for panel, name, values, colour, symbol in (
            (1, "L₂ criterion", [v.l2.value for v in rows], L2, "circle"),
            (1, "L∞ criterion of the paper", [v.linf_paper.value for v in rows], PAPER, "square"),
            (2, "Peak of |H|", [v.peak.gain for v in rows], L2, "circle"),
            (2, "Exact L∞ gain ‖h‖₁", [v.linf_gain for v in rows], EXACT, "diamond"),
            (2, "|H| from the leader", [p.gain for p in platoon.peaks], L2, "circle-open"),
            (2, "‖h‖₁ from the leader", platoon.linf.gain.tolist(), EXACT, "diamond-open"),
        )
    ]  # fmt: skip
    names = [MAKE_END.sub("<br>", html.escape(label), count=1) for label in vehicles.labels]
    vehicle_axis = {
        "tickvals": places, "ticktext": names, "ticklabeloverflow": "allow",
        "range": [0.7, len(vehicles) + 0.3],
        "automargin": True,  # long names are turned where there is no room
    }  # fmt: skip
    axes = {"y": style.titled("Criterion [1/s²]"), "y2": style.titled("Gain")}
    limits = [style.across("y", 0, line=LIMIT), style.across("y2", 1, line=LIMIT)]
    return style.composed(
        traces,
        400,
        "criteria",
        axes,
        {"x": vehicle_axis},
        style.stack(1, 1, spacing=0.1),
        shapes=limits,
    )


def stability_map(
    vehicles: ParameterSet, report: StabilityReport, held: int, plane: Plane,
    uncertainty: Uncertainty | None = None,
) -> go.Figure:  # fmt: skip
    """Where the criteria's boundaries run in the (β, τ) or (α, τ) plane, and the vehicles on it.

    The map keeps the third parameter of the vehicle of index ``held``: the plane "beta" its α,
    "alpha" its β. The uncertainty adds parameter sets consistent with the data; one with α = 0 has
    no time headway, hence no place on the map.
    """
    kept, along_beta = vehicles.parameters[held], plane == "beta"
    across_map = (vehicles.parameters.beta if along_beta else vehicles.parameters.alpha).tolist()
    right = max(1.35 * max(across_map), 0.6 if along_beta else 0.15)
    along = np.linspace(right / ALONG, right, ALONG)
    grid = Parameters(kept.alpha, along, 0.0) if along_beta else Parameters(along, kept.beta, 0.0)
    edges = {name: headway(grid) for name, (headway, _, _) in BOUNDARIES.items()}
    top = _highest(vehicles, report, held)
    traces = [*_clouds(vehicles, uncertainty, plane)] if uncertainty else []
    traces += _regions(along, edges, top)
    traces += [
        {"x": along, "y": edges[name], "name": name, "mode": "lines",
         "line": {"color": colour, "width": 2, "dash": dash},
         "hovertemplate": f"{name}: stable from τ = %{{y:.2f}} s on<extra></extra>"}
        for name, (_, colour, dash) in BOUNDARIES.items()
    ]  # fmt: skip
    traces.append({
        "x": across_map, "y": vehicles.parameters.tau, "mode": "markers", "showlegend": False,
        "text": [
            f"{html.escape(label)}<br>α {p.alpha:.4g}, β {p.beta:.4g}, τ {p.tau:.4g}"
            for label, p in zip(vehicles.labels, vehicles.parameters, strict=True)
        ],
        "marker": {
            "size": 13, "color": colours(vehicles), "line": {"width": 2.5},
            "symbol": ["circle" if k == held else "circle-open" for k in range(len(vehicles))],
        },
        "hovertemplate": "%{text}<extra></extra>",
    })  # fmt: skip
    horizontal = BETA if along_beta else ALPHA
    axes = {
        name: style.titled(f"{quantity.symbol}, {quantity.name.lower()} [{quantity.unit}]")
        | {"range": [0, end]}
        for name, quantity, end in (("x", horizontal, right), ("y", TAU, top))
    }
    words = [
        style.corner("L₂ unstable", 0.015 if along_beta else 0.985, 0.015),  # beside the hatching
        style.corner("L∞ stable", 0.985, 0.985),
    ]
    return style.composed(
        traces, 400, f"map-{plane}-{held}", axes, hovermode="closest", annotations=words
    )


def _highest(vehicles: ParameterSet, report: StabilityReport, held: int) -> float:
    """The map's upper edge in s: above all vehicles, and above what the held one needs."""
    needed = report.vehicles[held].smallest_tau
    taus = [float(vehicle.tau) for vehicle in vehicles.parameters if vehicle.alpha]
    wanted = [*taus, needed.linf_exact if needed else 0.0, 2.0]
    return float(min(1.2 * max(wanted), max([12.0, *(1.2 * tau for tau in taus)])))


def _regions(
    along: FloatArray, edges: Mapping[str, FloatArray], top: float
) -> Iterator[style.Part]:
    """Areas from below: L₂ unstable, only L∞ unstable, stable; hatched where the paper differs."""
    l2, paper, exact = edges.values()
    exact = np.minimum(exact, 2 * top)
    paper = np.minimum(paper, exact)
    layers: list[tuple[FloatArray, style.Part]] = [
        (np.zeros_like(exact), {}),
        (np.minimum(l2, 2 * top), {"fillcolor": L2_UNSTABLE}),
        (exact, {"fillcolor": ONLY_LINF_UNSTABLE}),
        (np.maximum(exact, 2 * top), {"fillcolor": STABLE}),
    ]
    if (paper < exact).any():
        hatching = {
            "shape": "/",
            "fgcolor": PAPER,
            "bgcolor": style.CLEAR,
            "size": 9,
            "solidity": 0.12,
        }
        layers += [(paper, {}), (exact, {"fillcolor": style.CLEAR, "fillpattern": hatching})]
    for values, look in layers:
        yield {
            "x": along, "y": values, "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip",
            "showlegend": False, "fill": "tonexty" if look else None, **look,
        }  # fmt: skip


def _clouds(vehicles: ParameterSet, uncertainty: Uncertainty, plane: Plane) -> Iterator[style.Part]:
    """A dot for each of some posterior samples of every vehicle."""
    for k, colour in enumerate(colours(vehicles)):
        draws = uncertainty.draws.values[:, k]
        draws = draws[np.linspace(0, len(draws) - 1, CLOUD).astype(int)]
        draws = draws[np.isfinite(draws).all(axis=1)]
        yield {
            "x": draws[:, ACROSS[plane]].round(5), "y": draws[:, 2].round(4), "mode": "markers",
            "marker": {"size": 3.5, "color": style.translucent(colour, DOT_OPACITY)},
            "hoverinfo": "skip", "name": f"cloud {k}", "showlegend": False,
        }  # fmt: skip


def cloud_caption(figure: go.Figure, uncertainty: Uncertainty, plane: Plane) -> str:
    """What the clouds show, and the share of the draws that the map does not show."""
    known = uncertainty.draws.values[:, ~np.isnan(uncertainty.draws.alpha[0])]
    right, top = figure.layout.xaxis.range[1], figure.layout.yaxis.range[1]
    outside = (known[..., ACROSS[plane]] > right) | (known[..., 2] > top)
    beyond = float(outside.mean()) if known.size else 0.0
    missing = f"; {100 * beyond:.0f} % of them lie beyond the map" if beyond >= 0.005 else ""
    return f"Clouds: parameter sets consistent with the data{missing}."


def gains_thumbnail(vehicles: ParameterSet) -> go.Figure:
    """The Bode magnitudes of followers, small and without axes."""
    omega = np.geomspace(*SPAN, 75)
    gains = 20 * np.log10(np.abs(response(vehicles.parameters, omega)))
    curves = [
        {"x": omega, "y": gain, "line": {"color": colour, "width": 1.6}}
        for gain, colour in zip(gains, colours(vehicles), strict=True)
    ]
    top = max(LEAST_PEAK, 1.1 * float(gains.max()))
    return style.thumbnail(curves, {"x": {"type": "log"}, "y": {"range": [-6, top]}},
                     [style.across("y", 0, line=LIMIT, layer="below")])  # fmt: skip


@dataclass(frozen=True, eq=False)
class Model:
    """The vehicle whose Bode magnitude stands beside the measured gain."""

    name: str
    parameters: Parameters
    """One vehicle's."""
    draws: Parameters | None = None
    """(n,) posterior samples, for a band; None without."""


def measured_bode(
    measured: MeasuredGain, name: str, colour: str, model: Model | None = None
) -> go.Figure:
    """The measured gain of one vehicle over the model's Bode magnitude, and its coherence below."""
    low, high = min(SPAN[0], float(measured.omega[0])), max(SPAN[1], float(measured.omega[-1]))
    traces = [*_model_curve(model, low, high, colour, measured.level)] if model else []
    levels = decibels(measured.gain)
    bounds = [np.abs(decibels(end) - levels) for end in (measured.upper, measured.lower)]
    for part, words, opacity, symbol in (
        (measured.coherent, "measured", 1.0, "circle"),
        (~measured.coherent, "measured, not coherent", 0.35, "circle-open"),
    ):
        above, below = (np.minimum(end[part], CEILING) for end in bounds)
        bars = {"type": "data", "symmetric": False, "array": above, "arrayminus": below,
                "width": 0, "thickness": 1.2}  # fmt: skip
        gain = f"{html.escape(name)}, {words}"
        points = {
            "x": measured.omega[part], "mode": "markers", "opacity": opacity,
            "marker": {"color": style.LEADER, "size": 7, "symbol": symbol},
            "hovertemplate": "%{y:.2f} at %{x:.3f} rad/s",
        }  # fmt: skip
        traces += [
            points | style.axes_of(1) | {"y": levels[part], "name": gain, "showlegend": True}
            | ({"error_y": bars} if symbol == "circle" else {}),
            points | style.axes_of(2)
            | {"y": measured.coherence[part], "name": f"coherence, {gain}", "showlegend": False},
        ]  # fmt: skip
    top = float(np.max((levels + bounds[0])[measured.coherent], initial=3.0))
    every = {"x": {"type": "log", "range": np.log10([low, high]).tolist(), **TICKS}}
    axes = {
        "x2": style.titled("Frequency ω [rad/s]"),
        "y": style.titled("Gain [dB]") | {"range": [2 * FLOOR, min(top, CEILING) + 1.0]},
        "y2": style.titled("Coherence") | {"range": [0, 1.03]},
    }
    return style.composed(
        traces, 440, "measured-gain", axes, every, style.stack(0.7, 0.3, spacing=0.07),
        hovermode="closest", shapes=[style.across("y", 0, line=LIMIT)],
    )  # fmt: skip


def _model_curve(
    model: Model, low: float, high: float, colour: str, at_level: float
) -> Iterator[style.Part]:
    """The model's Bode magnitude between two frequencies in rad/s, over its band."""
    if model.draws is not None:
        omega = np.geomspace(low, high, BAND_POINTS)
        gains = np.abs(response(model.draws, omega))
        lower, upper = (decibels(end) for end in interval_ends(gains, at_level))
        yield style.band(omega, lower, upper, colour, BAND_OPACITY, panel=1)
    omega = np.geomspace(low, high, FREQUENCIES)
    gain = np.abs(response(Parameters.stack([model.parameters]), omega))[0]
    yield {
        "x": omega, "y": decibels(gain), "mode": "lines", "line": {"color": colour, "width": 2.2},
        "name": f"{html.escape(model.name)}, model", **style.axes_of(1),
        "hovertemplate": "%{y:.2f} dB at %{x:.3f} rad/s",
    }  # fmt: skip
