"""String stability as figures: Bode magnitude, criteria along the platoon, maps; uncertainty."""

import html
import re
from typing import Any, Literal

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import ALPHA, BETA, MAGNITUDE, TAU
from accpinn.inference.intervals import Uncertainty, gain_band
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.results.figures.style import (
    CLEAR,
    LEADER,
    MODEL,
    SERIES,
    band,
    finished,
    subplots,
    translucent,
    vehicle_colours,
)
from accpinn.stability.criteria import (
    smallest_headway_exact,
    smallest_headway_l2,
    smallest_headway_paper,
)
from accpinn.stability.frequency import response
from accpinn.stability.report import StabilityReport
from accpinn.units import FloatArray

Plane = Literal["beta", "alpha"]
"""What runs along a map's horizontal axis; τ runs along the vertical one."""

L2, PAPER, EXACT = SERIES[0], LEADER, MODEL
"""Colours of the three criteria; vehicles have others."""
L2_UNSTABLE = "rgba(194, 47, 79, 0.10)"
ONLY_LINF_UNSTABLE = "rgba(214, 140, 40, 0.14)"
STABLE = "rgba(85, 144, 15, 0.12)"
LIMIT = {"color": LEADER, "width": 1.2}
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
"""Of a band along the frequencies."""
LOWEST = -60.0
"""dB that stands for a gain of zero."""


def colours(vehicles: ParameterSet) -> tuple[str, ...]:
    """Each follower's colour, the same on every page."""
    return tuple(vehicle_colours(vehicles.vehicles)[1:])


def bode(vehicles: ParameterSet, report: StabilityReport) -> go.Figure:
    """The Bode magnitude of every vehicle, and from the leader to the last.

    Every point carries the vehicle's index as its custom data, -1 for the whole platoon.
    """
    omega = _frequencies(report)
    gains = np.abs(response(vehicles.parameters, omega))
    figure = go.Figure()
    for k, (label, colour) in enumerate(zip(vehicles.labels, colours(vehicles), strict=True)):
        line = {"color": colour, "width": 2.2}
        _add_curve(figure, omega, gains[k], k, html.escape(label), line)
    if len(vehicles) > 1:
        line = {"color": LEADER, "width": 2, "dash": "dash"}
        _add_curve(figure, omega, gains.prod(axis=0), -1, "Leader to last follower", line)
    _mark_peaks(figure, vehicles, report)
    tops = [vehicle.peak.db for vehicle in report.vehicles] + [report.platoon.peaks[-1].db]
    top = min(max(*tops, 1.0) * 1.12 + 0.4, CEILING)
    figure.add_hrect(y0=0, y1=top, fillcolor=L2_UNSTABLE, line_width=0, layer="below")
    figure.add_hline(y=0, line=LIMIT, layer="below")
    annotate(figure, "amplified", 0.995, 0.995)
    figure.update_xaxes(
        type="log", title_text="Frequency ω [rad/s]", range=np.log10(omega[[0, -1]]).tolist(),
        **TICKS,
    )  # fmt: skip
    title = f"{MAGNITUDE.name} {MAGNITUDE.heading}"
    figure.update_yaxes(title_text=title, range=[FLOOR - FOOT, top])
    figure = finished(figure, 400, "bode")
    return figure.update_layout(hovermode="closest", hoverdistance=200, clickmode="event+select")


def _frequencies(report: StabilityReport) -> FloatArray:
    """(K,) evenly spaced on a logarithmic axis, with the peaks and crossovers in sight."""
    edges = [vehicle.crossover for vehicle in report.vehicles if vehicle.crossover]
    tops = [vehicle.peak.omega for vehicle in report.vehicles if vehicle.peak.omega]
    return np.geomspace(
        min([SPAN[0], *(omega / 4 for omega in tops)]),
        max([SPAN[1], *(2 * omega for omega in edges)]),
        FREQUENCIES,
    )


def _add_curve(
    figure: go.Figure, omega: FloatArray, gain: FloatArray, which: int, name: str,
    line: dict[str, object],
) -> None:  # fmt: skip
    # Only markers can be clicked, so every line has some that are not seen.
    figure.add_scatter(
        x=omega, y=decibels(gain), name=name, mode="lines+markers",
        line=line, marker={"opacity": 0, "size": 9, "color": line["color"]},
        customdata=np.full(len(omega), which),
        selected={"marker": {"opacity": 0.9}}, unselected={"marker": {"opacity": 0}},
        hovertemplate=f"%{{y:.2f}} dB at %{{x:.3f}} rad/s<extra>{name}</extra>",
    )  # fmt: skip


def decibels(gain: FloatArray) -> FloatArray:
    """A gain in dB, finite whatever it is."""
    return np.asarray(20 * np.log10(np.clip(gain, 1e-6, 1e6)))


def _mark_peaks(figure: go.Figure, vehicles: ParameterSet, report: StabilityReport) -> None:
    """A diamond on each peak and a ring on each crossover, of those who amplify."""
    shown = [k for k, vehicle in enumerate(report.vehicles) if vehicle.crossover]
    found, paints = [report.vehicles[k] for k in shown], colours(vehicles)
    diamond, ring = {"symbol": "diamond", "size": 10}, {"symbol": "circle-open", "size": 9}
    peaks = [v.peak.omega for v in found], [min(v.peak.db, CEILING) for v in found]
    crossovers = [v.crossover for v in found], [0.0] * len(found)
    for name, (x, y), look, words in (
        ("peak", peaks, diamond, "Peak %{y:.2f} dB at"),
        ("crossover", crossovers, ring | {"line": {"width": 2}}, "Amplified below"),
    ):
        figure.add_scatter(
            x=x, y=y, name=name, mode="markers", customdata=shown,
            text=[html.escape(vehicles.labels[k]) for k in shown],
            showlegend=False, marker={**look, "color": [paints[k] for k in shown]},
            selected={"marker": {"opacity": 1}}, unselected={"marker": {"opacity": 1}},
            hovertemplate=f"{words} %{{x:.3f}} rad/s<extra>%{{text}}</extra>",
        )  # fmt: skip


def criteria_by_vehicle(vehicles: ParameterSet, report: StabilityReport) -> go.Figure:
    """Criteria and gains along the platoon: the paper's figure, with the exact gains below it."""
    found, platoon = report.vehicles, report.platoon
    figure = subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.1)
    places = list(range(1, len(vehicles) + 1))
    for row, name, values, colour, symbol in (
        (1, "L₂ criterion", [v.l2.value for v in found], L2, "circle"),
        (1, "L∞ criterion of the paper", [v.linf_paper.value for v in found], PAPER, "square"),
        (2, "Peak of |H|", [v.peak.gain for v in found], L2, "circle"),
        (2, "Exact L∞ gain ‖h‖₁", [v.linf_gain for v in found], EXACT, "diamond"),
        (2, "|H| from the leader", [p.gain for p in platoon.peaks], L2, "circle-open"),
        (2, "‖h‖₁ from the leader", platoon.linf.gain.tolist(), EXACT, "diamond-open"),
    ):
        dash = "dot" if symbol.endswith("-open") else "solid"
        figure.add_scatter(
            x=places, y=values, name=name, mode="lines+markers",
            line={"color": colour, "width": 2, "dash": dash},
            marker={"symbol": symbol, "size": 8, "color": colour},
            hovertemplate=f"%{{y:.4g}}<extra>{name}</extra>", row=row, col=1,
        )  # fmt: skip
    for row, limit, title in ((1, 0, "Criterion [1/s²]"), (2, 1, "Gain")):
        figure.add_hline(y=limit, line=LIMIT, row=row, col=1)
        figure.update_yaxes(title_text=title, row=row, col=1)
    names = [MAKE_END.sub("<br>", html.escape(label), count=1) for label in vehicles.labels]
    figure.update_xaxes(tickvals=places, ticktext=names, ticklabeloverflow="allow",
                        range=[0.7, len(vehicles) + 0.3])  # fmt: skip
    figure = finished(figure, 400, "criteria")
    return figure.update_xaxes(automargin=True)  # long names are turned where there is no room


def stability_map(
    vehicles: ParameterSet, report: StabilityReport, held: int, plane: Plane
) -> go.Figure:
    """Where the criteria's boundaries run in the (β, τ) or (α, τ) plane, and the vehicles on it.

    Args:
        vehicles: the vehicles.
        report: about them.
        held: index of the vehicle whose third parameter the map keeps.
        plane: "beta" keeps that vehicle's α, "alpha" its β.
    """
    kept = vehicles.parameters[held]
    own = (vehicles.parameters.beta if plane == "beta" else vehicles.parameters.alpha).tolist()
    right = max(1.35 * max(own), 0.6 if plane == "beta" else 0.15)
    along = np.linspace(right / ALONG, right, ALONG)
    along_beta = plane == "beta"
    grid = Parameters(kept.alpha, along, 0.0) if along_beta else Parameters(along, kept.beta, 0.0)
    edges = {name: headway(grid) for name, (headway, _, _) in BOUNDARIES.items()}
    top = _highest(vehicles, report, held)
    figure = go.Figure()
    _add_regions(figure, along, edges, top)
    for name, (_, colour, dash) in BOUNDARIES.items():
        figure.add_scatter(
            x=along, y=edges[name], name=name, mode="lines",
            line={"color": colour, "width": 2, "dash": dash},
            hovertemplate=f"{name}: stable from τ = %{{y:.2f}} s on<extra></extra>",
        )  # fmt: skip
    figure.add_scatter(
        x=own, y=vehicles.parameters.tau, mode="markers", showlegend=False,
        text=[
            f"{html.escape(label)}<br>α {one.alpha:.4g}, β {one.beta:.4g}, τ {one.tau:.4g}"
            for label, one in zip(vehicles.labels, vehicles.parameters, strict=True)
        ],
        marker={
            "size": 13, "color": colours(vehicles), "line": {"width": 2.5},
            "symbol": ["circle" if k == held else "circle-open" for k in range(len(vehicles))],
        },
        hovertemplate="%{text}<extra></extra>",
    )  # fmt: skip
    across = BETA if along_beta else ALPHA
    for axis, quantity, end in (("xaxis", across, right), ("yaxis", TAU, top)):
        title = f"{quantity.symbol}, {quantity.name.lower()} [{quantity.unit}]"
        figure.layout[axis].update(title={"text": title}, range=[0, end])
    annotate(figure, "L₂ unstable", 0.015 if along_beta else 0.985, 0.015)  # beside hatching
    annotate(figure, "L∞ stable", 0.985, 0.985)
    return finished(figure, 400, f"map-{plane}-{held}").update_layout(hovermode="closest")


def annotate(figure: go.Figure, text: str, x: float, y: float) -> None:
    """A few words in a corner of the axes."""
    figure.add_annotation(
        text=text, xref="x domain", x=x, xanchor="left" if x < 0.5 else "right",
        yref="y domain", y=y, yanchor="bottom" if y < 0.5 else "top", showarrow=False,
    )  # fmt: skip


def _highest(vehicles: ParameterSet, report: StabilityReport, held: int) -> float:
    """The map's upper edge in s: above all vehicles, and above what the held one needs."""
    needed = report.vehicles[held].smallest_tau
    taus = [float(one.tau) for one in vehicles.parameters if one.alpha]
    wanted = [*taus, needed.linf_exact if needed else 0.0, 2.0]
    return float(min(1.2 * max(wanted), max([12.0, *(1.2 * tau for tau in taus)])))


def _add_regions(
    figure: go.Figure, along: FloatArray, edges: dict[str, FloatArray], top: float
) -> None:
    """Areas from below: L₂ unstable, only L∞ unstable, stable; hatched where the paper differs."""
    l2, paper, exact = edges.values()
    exact = np.minimum(exact, 2 * top)
    paper = np.minimum(paper, exact)
    layers: list[tuple[FloatArray, dict[str, Any]]] = [
        (np.zeros_like(exact), {}),
        (np.minimum(l2, 2 * top), {"fillcolor": L2_UNSTABLE}),
        (exact, {"fillcolor": ONLY_LINF_UNSTABLE}),
        (np.maximum(exact, 2 * top), {"fillcolor": STABLE}),
    ]
    if (paper < exact).any():
        hatching = {"shape": "/", "fgcolor": PAPER, "bgcolor": CLEAR, "size": 9, "solidity": 0.12}
        layers += [(paper, {}), (exact, {"fillcolor": CLEAR, "fillpattern": hatching})]
    for values, look in layers:
        figure.add_scatter(
            x=along, y=values, mode="lines", line={"width": 0}, hoverinfo="skip",
            showlegend=False, fill="tonexty" if look else None, **look,
        )  # fmt: skip


def add_bands(figure: go.Figure, vehicles: ParameterSet, uncertainty: Uncertainty) -> go.Figure:
    """The interval of |H| at the uncertainty's level, under the curves of `bode`.

    A vehicle whose parameters are not determined has no band.
    """
    omega = np.asarray(figure.data[0].x, float)
    omega = np.geomspace(omega[0], omega[-1], BAND_POINTS)
    bands = []
    for k, colour in enumerate(colours(vehicles)):
        gain = gain_band(uncertainty, k, omega)
        if np.isfinite(gain.lower).all():
            ends = _db(gain.lower), _db(gain.upper)
            bands.append(band(omega, *ends, colour, BAND_OPACITY, f"band {k}"))
    return _beneath(figure, bands)


def add_clouds(
    figure: go.Figure, vehicles: ParameterSet, uncertainty: Uncertainty, plane: Plane
) -> go.Figure:
    """Parameter sets consistent with the data, under the vehicles of a `stability_map`.

    A draw with α = 0 has no time headway, hence no place on the map.
    """
    across = {"alpha": 0, "beta": 1}[plane]
    clouds = []
    for k, colour in enumerate(colours(vehicles)):
        draws = uncertainty.draws.values[:, k]
        draws = draws[np.linspace(0, len(draws) - 1, CLOUD).astype(int)]
        draws = draws[np.isfinite(draws).all(axis=1)]
        clouds.append(
            go.Scatter(
                x=draws[:, across].round(5), y=draws[:, 2].round(4), mode="markers",
                marker={"size": 3.5, "color": translucent(colour, DOT_OPACITY)}, hoverinfo="skip",
                name=f"cloud {k}", showlegend=False,
            )
        )  # fmt: skip
    return _beneath(figure, clouds)


def cloud_caption(figure: go.Figure, uncertainty: Uncertainty, plane: Plane) -> str:
    """What the clouds show, and the share of the draws that the map does not show."""
    known = uncertainty.draws.values[:, ~np.isnan(uncertainty.draws.alpha[0])]
    across = known[..., {"alpha": 0, "beta": 1}[plane]]
    right, top = figure.layout.xaxis.range[1], figure.layout.yaxis.range[1]
    beyond = float(((across > right) | (known[..., 2] > top)).mean()) if known.size else 0.0
    missing = f"; {100 * beyond:.0f} % of them lie beyond the map" if beyond >= 0.005 else ""
    return f"Clouds: parameter sets consistent with the data{missing}."


def _beneath(figure: go.Figure, traces: list[go.Scatter]) -> go.Figure:
    """The traces first, so that everything else is drawn over them."""
    return go.Figure(data=[*traces, *figure.data], layout=figure.layout)


def _db(gain: FloatArray) -> FloatArray:
    level = 20 * np.log10(np.clip(gain, 10 ** (LOWEST / 20), None))
    return np.asarray(np.minimum(level, 2 * CEILING).round(3))
