"""String stability as plotly figures: response over frequency, criteria over the platoon, maps."""

import html
from dataclasses import dataclass
from typing import Literal

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.results.figures.style import LEADER, MODEL, SERIES, finished, vehicle_colour
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
GROWS = "rgba(194, 47, 79, 0.10)"
PEAKS_GROW = "rgba(214, 140, 40, 0.14)"
STABLE = "rgba(85, 144, 15, 0.12)"
EVEN = {"color": LEADER, "width": 1.2}
"""The line between growing and fading."""

FREQUENCIES = 300
SPAN = (0.02, 1.0)
"""Frequencies in rad/s that a response always shows."""
TICKS = [digit * 10.0**power for power in range(-4, 3) for digit in (1, 2, 5)]
FLOOR, CEILING, FOOT = -12.0, 40.0, 0.6
"""Lowest and highest dB in sight."""
ALONG = 240
"""Points of a boundary."""
CRITERIA_KEY = (
    ("L2: criterion, peak of |H|", L2),
    ("L∞: the paper's criterion", PAPER),
    ("L∞: exact gain ‖h‖₁", EXACT),
)
"""What the lines of the figures below mean; a page shows it above them."""
MAP_KEY = (
    ("L2", L2),
    ("L∞, the paper's criterion", PAPER),
    ("L∞, exact", EXACT),
    ("only peaks grow", "rgba(214, 140, 40, 0.55)"),
)


def colours(vehicles: ParameterSet) -> tuple[str, ...]:
    """Each follower's colour, the same on every page."""
    leader, *followers = vehicles.vehicles
    return tuple(vehicle_colour(number, leader) for number in followers)


def bode(vehicles: ParameterSet, report: StabilityReport) -> go.Figure:
    """|H| in dB over ω: every vehicle, and from the leader to the last.

    Every point carries the vehicle's index as its custom data, -1 for the whole platoon.
    """
    omega = _frequencies(report)
    gains = np.abs(response(vehicles.parameters, omega))
    figure = go.Figure()
    names = [html.escape(label) for label in vehicles.labels]
    for k, (name, colour) in enumerate(zip(names, colours(vehicles), strict=True)):
        _curve(figure, omega, _db(gains[k]), k, name, {"color": colour, "width": 2.2})
    if len(vehicles) > 1:
        whole = {"color": LEADER, "width": 2, "dash": "dash"}
        _curve(figure, omega, _db(gains.prod(axis=0)), -1, "Leader to last follower", whole)
    _marks(figure, vehicles, report)
    tops = [vehicle.peak.db for vehicle in report.vehicles] + [report.platoon.peaks[-1].db]
    top = min(max(*tops, 1.0) * 1.12 + 0.4, CEILING)
    figure.add_shape(
        type="rect", xref="paper", x0=0, x1=1, y0=0, y1=top, fillcolor=GROWS, line_width=0,
        layer="below",
    )  # fmt: skip
    figure.add_shape(type="line", xref="paper", x0=0, x1=1, y0=0, y1=0, line=EVEN, layer="below")
    _say(figure, "amplified", 0.995, 0.995)
    figure.update_xaxes(
        type="log", title_text="Frequency ω [rad/s]", range=np.log10(omega[[0, -1]]).tolist(),
        tickvals=TICKS, ticktext=[f"{tick:g}" for tick in TICKS],
    )  # fmt: skip
    figure.update_yaxes(title_text="|H(jω)| [dB]", range=[FLOOR - FOOT, top])
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


def _db(gain: FloatArray) -> FloatArray:
    return np.asarray(20 * np.log10(np.clip(gain, 1e-6, 1e6)))


def _curve(
    figure: go.Figure,
    omega: FloatArray,
    db: FloatArray,
    which: int,
    name: str,
    line: dict[str, object],
) -> None:
    # Only markers can be clicked, so every line has some that are not seen.
    unseen = {"opacity": 0, "size": 9}
    figure.add_scatter(
        x=omega, y=db, name=name, mode="lines+markers", line=line,
        marker={**unseen, "color": line["color"]}, customdata=np.full(len(omega), which),
        selected={"marker": {"opacity": 0.9}}, unselected={"marker": {"opacity": 0}},
        hovertemplate=f"%{{y:.2f}} dB at %{{x:.3f}} rad/s<extra>{name}</extra>",
    )  # fmt: skip


def _marks(figure: go.Figure, vehicles: ParameterSet, report: StabilityReport) -> None:
    """A diamond on each peak and a ring on each crossover, of those who amplify."""
    names = [html.escape(label) for label in vehicles.labels]
    shown = [k for k, vehicle in enumerate(report.vehicles) if vehicle.crossover]
    paints = [colours(vehicles)[k] for k in shown]
    peaks = [report.vehicles[k].peak for k in shown]
    kept = {"selected": {"marker": {"opacity": 1}}, "unselected": {"marker": {"opacity": 1}}}
    figure.add_scatter(
        x=[peak.omega for peak in peaks], y=[min(peak.db, CEILING) for peak in peaks],
        name="peak", mode="markers", customdata=shown, text=[names[k] for k in shown],
        showlegend=False,
        marker={"symbol": "diamond", "size": 10, "color": paints}, **kept,
        hovertemplate="Peak %{y:.2f} dB at %{x:.3f} rad/s<extra>%{text}</extra>",
    )  # fmt: skip
    figure.add_scatter(
        x=[report.vehicles[k].crossover for k in shown], y=[0.0] * len(shown),
        name="crossover", mode="markers", customdata=shown, text=[names[k] for k in shown],
        showlegend=False,
        marker={"symbol": "circle-open", "size": 9, "color": paints, "line": {"width": 2}}, **kept,
        hovertemplate="Amplified below %{x:.3f} rad/s<extra>%{text}</extra>",
    )  # fmt: skip


def criteria_by_vehicle(vehicles: ParameterSet, report: StabilityReport) -> go.Figure:
    """Criteria and gains over the platoon: the paper's figure, with the exact gains below it."""
    found, platoon = report.vehicles, report.platoon
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.1)
    upper = (
        ("L₂ criterion", [v.l2.value for v in found], L2, "circle"),
        ("L∞ criterion of the paper", [v.linf_paper.value for v in found], PAPER, "square"),
    )
    for name, values, colour, symbol in upper:
        _along(figure, 1, vehicles, name, values, colour, symbol)
    lower = (
        ("Peak of |H|", [v.peak.gain for v in found], L2, "circle", "solid"),
        ("Exact L∞ gain ‖h‖₁", [v.linf_gain for v in found], EXACT, "diamond", "solid"),
        ("|H| from the leader", [p.gain for p in platoon.peaks], L2, "circle-open", "dot"),
        ("‖h‖₁ from the leader", platoon.linf.gain.tolist(), EXACT, "diamond-open", "dot"),
    )
    for name, values, colour, symbol, dash in lower:
        _along(figure, 2, vehicles, name, values, colour, symbol, dash)
    figure.add_hline(y=0, line=EVEN, row=1, col=1)
    figure.add_hline(y=1, line=EVEN, row=2, col=1)
    figure.update_yaxes(title_text="Criterion [1/s²]", row=1, col=1)
    figure.update_yaxes(title_text="Gain", row=2, col=1)
    places = list(range(1, len(vehicles) + 1))
    numbers = vehicles.vehicles[1:] if vehicles.numbered else places
    figure.update_xaxes(tickvals=places, ticktext=[str(number) for number in numbers],
                        range=[0.7, len(vehicles) + 0.3])  # fmt: skip
    figure.update_xaxes(title_text="Vehicle" if vehicles.numbered else "Follower", row=2, col=1)
    return finished(figure, 400, "criteria")


def _along(
    figure: go.Figure, row: int, vehicles: ParameterSet, name: str, values: list[float], colour: str,
    symbol: str, dash: str = "solid",
) -> None:  # fmt: skip
    places = list(range(1, len(vehicles) + 1))
    figure.add_scatter(
        x=places, y=values, name=name, mode="lines+markers",
        line={"color": colour, "width": 2, "dash": dash},
        marker={"symbol": symbol, "size": 8, "color": colour},
        hovertemplate=f"%{{y:.4g}}<extra>{name}</extra>", row=row, col=1,
    )  # fmt: skip


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
    edges = _boundaries(
        along,
        Parameters(kept.alpha, along, 0.0)
        if plane == "beta"
        else Parameters(along, kept.beta, 0.0),
    )
    top = _highest(vehicles, report, held)
    figure = go.Figure()
    _regions(figure, edges, top)
    _lines(figure, edges)
    _dots(figure, vehicles, own, held)
    title = "β, gain on relative speed [1/s]" if plane == "beta" else "α, gain on spacing [1/s²]"
    figure.update_xaxes(title_text=title, range=[0, right])
    figure.update_yaxes(title_text="τ, time headway [s]", range=[0, top])
    _say(figure, "something grows", 0.015 if plane == "beta" else 0.985, 0.015)  # beside hatching
    _say(figure, "nothing grows", 0.985, 0.985)
    return finished(figure, 400, f"map-{plane}-{held}").update_layout(hovermode="closest")


@dataclass(frozen=True, eq=False)
class _Boundaries:
    """The smallest τ in s of each criterion along a range of α or β; (K,) each."""

    along: FloatArray
    l2: FloatArray
    linf_paper: FloatArray
    linf_exact: FloatArray


def _boundaries(along: FloatArray, parameters: Parameters) -> _Boundaries:
    kinds = (smallest_headway_l2, smallest_headway_paper, smallest_headway_exact)
    return _Boundaries(along, *(kind(parameters) for kind in kinds))


def _say(figure: go.Figure, text: str, x: float, y: float) -> None:
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


def _regions(figure: go.Figure, edges: _Boundaries, top: float) -> None:
    """Shades from below: something grows, only peaks grow, nothing grows; hatched: disagreement."""
    exact = np.minimum(edges.linf_exact, 2 * top)
    layers = (
        (np.zeros_like(exact), None),
        (np.minimum(edges.l2, 2 * top), GROWS),
        (exact, PEAKS_GROW),
        (np.maximum(exact, 2 * top), STABLE),
    )
    for values, fill in layers:
        _band(figure, edges.along, values, fillcolor=fill, fill="tonexty" if fill else None)
    paper = np.minimum(edges.linf_paper, exact)
    if (paper < exact).any():
        clear = "rgba(0,0,0,0)"
        pattern = {"shape": "/", "fgcolor": PAPER, "bgcolor": clear, "size": 9, "solidity": 0.12}
        _band(figure, edges.along, paper)
        _band(figure, edges.along, exact, fill="tonexty", fillcolor=clear, fillpattern=pattern)


def _band(figure: go.Figure, along: FloatArray, values: FloatArray, **fill: object) -> None:
    """An unseen line, and what is filled between it and the one before."""
    figure.add_scatter(
        x=along, y=values, mode="lines", line={"width": 0}, hoverinfo="skip", showlegend=False,
        **fill,
    )  # fmt: skip


def _lines(figure: go.Figure, edges: _Boundaries) -> None:
    lines = (
        ("L2", edges.l2, {"color": L2, "width": 2}),
        ("L∞, exact", edges.linf_exact, {"color": EXACT, "width": 2}),
        ("L∞, paper", edges.linf_paper, {"color": PAPER, "width": 2, "dash": "dash"}),
    )
    for name, values, line in lines:
        figure.add_scatter(
            x=edges.along, y=values, name=name, mode="lines", line=line,
            hovertemplate=f"{name}: stable from τ = %{{y:.2f}} s on<extra></extra>",
        )  # fmt: skip


def _dots(figure: go.Figure, vehicles: ParameterSet, own: list[float], held: int) -> None:
    """The vehicles; the one whose parameter is held is filled."""
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
