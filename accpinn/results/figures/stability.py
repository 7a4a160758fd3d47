"""String stability as figures: Bode magnitude, computed and measured, criteria, and maps."""

import html
import re
from functools import lru_cache

import numpy as np
import plotly.graph_objects as go

from accpinn.channels import ALPHA, BETA, MAGNITUDE, TAU
from accpinn.inference.gain_check import compared, decibels
from accpinn.inference.intervals import Uncertainty, gain_band
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.results.figures import style
from accpinn.results.reproduction import PANELS, TEXT_PEAK, TEXT_PEAK_AT
from accpinn.stability import StabilityReport, stability_report
from accpinn.stability.criteria import response, smallest_beta_l2, smallest_headway_exact
from accpinn.stability.lagged import is_lagged
from accpinn.stability.margin import l2_headways
from accpinn.stability.measured_gain import MeasuredGain
from accpinn.stability.region import AXES, Limits, Plane, Region, stable_region
from accpinn.study.vehicles import AssessedVehicles
from accpinn.units import FloatArray, RadiansPerSecond, interval_ends

QUANTITIES = (ALPHA, BETA, TAU)
"""The parameters on a map's axes, by place in `Parameters`."""
L2, PAPER, EXACT = style.SERIES[0], style.LEADER, style.MODEL
"""Colours of the three criteria; vehicles have others."""
L2_UNSTABLE = "rgba(194, 47, 79, 0.10)"
ONLY_LINF_UNSTABLE = "rgba(214, 140, 40, 0.14)"
STABLE = "rgba(85, 144, 15, 0.12)"
LIMIT: style.Part = {"color": style.LEADER, "width": 1.2}
"""The line between amplified and damped."""

MAKE_END = re.compile(r"(?<=[^\W\d]) ")
"""Where a vehicle's name is broken below an axis: behind its make."""
FREQUENCIES = 300
SPAN = (0.02, 1.0)
"""Frequencies in rad/s that the Bode magnitude always shows."""
_TICKS = [digit * 10.0**power for power in range(-4, 3) for digit in (1, 2, 5)]
TICKS: style.Part = {"tickvals": _TICKS, "ticktext": [f"{tick:g}" for tick in _TICKS]}
FLOOR, CEILING, FOOT = -12.0, 40.0, 0.6
"""Lowest and highest dB in sight, and the room below them."""
ALONG = 240
"""Points of a boundary."""
AT = "%{y:.2f} dB at %{x:.3f} rad/s"
"""The text shown when a Bode magnitude is hovered over."""
AXIS_OF_FREQUENCY = "Frequency ω [rad/s]"
CRITERIA_KEY = (
    ("L₂: criterion, peak of |H|", L2),
    ("L∞: the paper's criterion", PAPER),
    ("L∞: exact gain ‖h‖₁", EXACT),
)
"""The key of the figures below, which a page shows above them."""
MAP_KEY = (
    ("L₂", L2),
    ("L∞, the paper's criterion", PAPER),
    ("L∞, exact criterion", EXACT),
    ("L₂ stable, L∞ unstable", "rgba(214, 140, 40, 0.55)"),
)
BAND_OPACITY, DOT_OPACITY = 0.22, 0.35
CLOUD = 300
"""Draws shown of each vehicle; more only make the cloud darker."""
BAND_POINTS = 120
"""Points of a band along the frequencies."""
PAPER_TOP = 4.2
"""Top of the paper's Bode plots in dB, above every peak of its Table III."""
LEAST_SEEN = 0.08
"""Share of a map's height that a region takes, at least, so that its name is written there."""
LEAST_PEAK = 4.0
"""Top of a thumbnail in dB, at least: calm vehicles have the same axis."""
LOWEST = -60.0
"""dB that stands for a gain of zero."""
WHOLE, WHOLE_NAME = -1, "All cars in order"
"""The platoon in place of one vehicle's index, and the name of its curve."""
PLATOON_MEASURED = "All cars in order, measured"


def colours(vehicles: ParameterSet) -> tuple[str, ...]:
    """Each follower's colour, the same on every page."""
    return tuple(style.vehicle_colours(vehicles.vehicles)[1:])


def measured_of(subject: AssessedVehicles) -> list[tuple[str, str, MeasuredGain]]:
    """Label, colour and measured gain of each follower.

    There is none for vehicles at another speed than the recorded ones.
    """
    result, vehicles = subject.result, subject.vehicles
    if subject.speed is not None:
        return []
    if result:
        gains = result.measured_gains if result.segments else ()
        labels, numbers = result.info.labels[1:], result.info.vehicles
    else:
        gains = tuple(car.measured_gains[k] if car.segments else None for car, k in subject.cars)
        labels, numbers = vehicles.labels, vehicles.vehicles
    paints = style.vehicle_colours(numbers)[1:]
    named = zip(labels, paints, gains, strict=False)
    return [(label, colour, gain) for label, colour, gain in named if gain]


def bode(subject: AssessedVehicles, height: int = 400) -> go.Figure:
    """The Bode magnitude of every vehicle, and from the leader to the last.

    Every point carries the vehicle's index as its custom data, `WHOLE` for the whole platoon. The
    uncertainty adds the interval of |H| under the curve of every vehicle whose parameters are
    determined. Measured gains are points with bars. The height is in pixels.
    """
    vehicles, report, uncertainty = subject.vehicles, subject.report, subject.uncertainty
    measured, platoon = measured_of(subject), measured_platoon(subject)
    omega, paints = frequencies(report), colours(vehicles)
    gains = np.abs(response(vehicles.parameters, omega))
    bands = _bands(uncertainty, omega[0], omega[-1]) if uncertainty else {}
    tops = [*(vehicle.peak.db for vehicle in report.vehicles), report.platoon.peaks[-1].db, 1.0]
    tops += [float(decibels(g.upper[compared(g)]).max(initial=1.0)) for _, _, g in measured]
    tops += [float(upper.max()) for _, upper in bands.values()]
    tops += [float(platoon[1:].max())] if platoon.size else []
    top = min(max(tops) * 1.12 + 0.4, CEILING)
    chart = style.Chart("bode", height, hoverdistance=200, clickmode="event+select")
    chart.area("y", 0, top, L2_UNSTABLE)
    chart.level("y", 0, LIMIT, "below")
    chart.words("amplified", 0.995, 0.995)
    along = np.geomspace(omega[0], omega[-1], BAND_POINTS)
    for k, (lower, upper) in bands.items():
        chart.band(along, lower, upper, paints[k], BAND_OPACITY, f"band {k}")
    for label, colour, gain in measured:
        _draw_measured(chart, label, colour, gain, top)
    for k, (label, colour) in enumerate(zip(vehicles.labels, paints, strict=True)):
        draw_clickable(chart, omega, decibels(gains[k]), k, label, colour)
    if platoon.size:
        at, lower, upper, level = platoon
        chart.band(at, lower, upper, style.LEADER, BAND_OPACITY, "band of the measured platoon")
        chart.line(
            at, level, PLATOON_MEASURED, style.LEADER, 2.2,
            hover=f"{AT}<extra>{PLATOON_MEASURED}</extra>", showlegend=False,
        )  # fmt: skip
    if len(vehicles) > 1:
        whole = gains.prod(axis=0)
        draw_clickable(chart, omega, decibels(whole), WHOLE, WHOLE_NAME, style.LEADER)
    _draw_peaks(chart, vehicles, report)
    ends = np.log10(omega[[0, -1]]).tolist()
    chart.axis("x", AXIS_OF_FREQUENCY, type="log", range=ends, **TICKS)
    chart.axis("y", f"{MAGNITUDE.name} {MAGNITUDE.heading}", range=[FLOOR - FOOT, top])
    return chart.figure()


def measured_platoon(subject: AssessedVehicles) -> FloatArray:
    """(4, K) ω, and in dB both ends and the middle of the measured platoon's band; else empty."""
    many = len(subject.vehicles) > 1
    growth = subject.measured_growth(range(len(subject.vehicles))) if many else None
    if growth is None:
        return np.empty((4, 0))
    used = growth.is_measured & (growth.omega >= SPAN[0]) & (growth.omega <= SPAN[1])
    ends = growth.lower[used], growth.upper[used], growth.gain[used]
    return np.vstack([growth.omega[used], np.clip(decibels(np.array(ends)), FLOOR - FOOT, None)])


def _draw_measured(
    chart: style.Chart, label: str, colour: str, gain: MeasuredGain, top: float
) -> None:
    """Draw a measured gain, full where it is compared with a model's, with its band as bars.

    Bars end at the axes, of which ``top`` in dB is one end.
    """
    inside = (gain.omega <= SPAN[1]) & (decibels(gain.gain) >= FLOOR)
    sure = compared(gain)
    for part, words, opacity in (
        (sure & inside, "measured", 1.0),
        (gain.coherent & ~sure & inside, "less coherent", 0.35),
    ):
        levels, lower, upper = (
            np.clip(decibels(end[part]), FLOOR, top) for end in (gain.gain, gain.lower, gain.upper)
        )
        name = f"{label}, {words}"
        chart.dots(
            gain.omega[part], levels, name, hover=f"{AT}<extra>{html.escape(name)}</extra>",
            ends=(lower, upper), bar={"thickness": 1.2, "color": colour},
            marker={"color": colour, "size": 6, "line": {"width": 0}}, opacity=opacity,
            showlegend=False,
        )  # fmt: skip


def frequencies(report: StabilityReport) -> FloatArray:
    """(K,) evenly spaced on a logarithmic axis, with the peaks and crossovers in sight."""
    edges = [vehicle.crossover for vehicle in report.vehicles if vehicle.crossover]
    tops = [vehicle.peak.omega for vehicle in report.vehicles if vehicle.peak.omega]
    return np.geomspace(
        min([SPAN[0], *(omega / 4 for omega in tops)]),
        max([SPAN[1], *(2 * omega for omega in edges)]),
        FREQUENCIES,
    )


def draw_clickable(
    chart: style.Chart, omega: FloatArray, values: FloatArray, which: int, name: str, colour: str,
    hover: str = AT,
) -> None:  # fmt: skip
    """Draw a curve. Only one with markers can be clicked, so it has one that is not seen."""
    is_vehicle, hidden = which >= 0, {"marker": {"opacity": 0}}
    chart.line(
        omega, values, name, colour, 2.2 if is_vehicle else 2,
        "solid" if is_vehicle else "dash", hover=f"{hover}<extra>{html.escape(name)}</extra>",
        marker={"opacity": 0, "size": 9, "color": colour, "maxdisplayed": 1}, mode="lines+markers",
        customdata=np.full(len(omega), which), selected=hidden, unselected=hidden,
    )  # fmt: skip


@lru_cache(maxsize=64)
def _bands(
    uncertainty: Uncertainty, first: RadiansPerSecond, last: RadiansPerSecond
) -> dict[int, tuple[FloatArray, FloatArray]]:
    """The interval of |H| in dB at the uncertainty's level, of each vehicle that has one."""
    omega = np.geomspace(first, last, BAND_POINTS)
    bands = dict[int, tuple[FloatArray, FloatArray]]()
    for k in range(uncertainty.draws.alpha.shape[1]):
        gain = gain_band(uncertainty, k, omega)
        if np.isfinite(gain.lower).all():
            lower, upper = (
                np.clip(decibels(end), LOWEST, 2 * CEILING).round(3)
                for end in (gain.lower, gain.upper)
            )
            bands[k] = lower, upper
    return bands


def _draw_peaks(chart: style.Chart, vehicles: ParameterSet, report: StabilityReport) -> None:
    """Draw a diamond on the peak of each vehicle that amplifies, and rings where that ends."""
    shown = [k for k, vehicle in enumerate(report.vehicles) if vehicle.crossover]
    amplifying, paints = [report.vehicles[k] for k in shown], colours(vehicles)
    peaks = [v.peak.omega for v in amplifying], [min(v.peak.db, CEILING) for v in amplifying]
    ring = {"symbol": "circle-open", "size": 9, "line": {"width": 2}}
    onsets = [v.onset or np.nan for v in amplifying], [0.0] * len(shown)
    crossovers = [v.crossover for v in amplifying], [0.0] * len(shown)
    for name, (x, y), look, words in (
        ("peak", peaks, {"symbol": "diamond", "size": 10}, "Peak %{y:.2f} dB at"),
        ("onset", onsets, ring, "Amplified above"),
        ("crossover", crossovers, ring, "Amplified below"),
    ):
        chart.dots(
            x, y, name, hover=f"{words} %{{x:.3f}} rad/s<extra>%{{text}}</extra>",
            marker=look | {"color": [paints[k] for k in shown]}, customdata=shown,
            text=[html.escape(vehicles.labels[k]) for k in shown], showlegend=False,
            selected={"marker": {"opacity": 1}}, unselected={"marker": {"opacity": 1}},
        )  # fmt: skip


def criteria_by_vehicle(subject: AssessedVehicles) -> go.Figure:
    """Criteria and gains along the platoon: the paper's figure, with the exact gains below it."""
    chart = style.Chart("criteria", 400, style.stack(1, 1, spacing=0.1), hovermode="x unified")
    vehicles, rows, platoon = subject.vehicles, subject.report.vehicles, subject.report.platoon
    places = [*range(1, len(vehicles) + 1)]
    for panel, name, values, colour, symbol in (
        (1, "L₂ criterion", [v.l2.value for v in rows], L2, "circle"),
        (1, "L∞ criterion of the paper", [v.linf_paper.value for v in rows], PAPER, "square"),
        (2, "Peak of |H|", [v.peak.gain for v in rows], L2, "circle"),
        (2, "Exact L∞ gain ‖h‖₁", [v.linf_gain for v in rows], EXACT, "diamond"),
        (2, "|H| from the leader", [p.gain for p in platoon.peaks], L2, "circle-open"),
        (2, "‖h‖₁ from the leader", platoon.linf.gain.tolist(), EXACT, "diamond-open"),
    ):
        chart.line(
            places, values, name, colour, 2, "dot" if symbol.endswith("-open") else "solid", panel,
            f"%{{y:.4g}}<extra>{name}</extra>", mode="lines+markers",
            marker={"symbol": symbol, "size": 8, "color": colour},
        )  # fmt: skip
    chart.level("y", 0, LIMIT)
    chart.level("y2", 1, LIMIT)
    names = [MAKE_END.sub("<br>", html.escape(label), count=1) for label in vehicles.labels]
    # Long names are turned where there is no room.
    chart.axis(
        "x*", tickvals=places, ticktext=names, ticklabeloverflow="allow", automargin=True,
        range=[0.7, len(vehicles) + 0.3],
    )  # fmt: skip
    chart.axis("y", "Criterion [1/s²]")
    chart.axis("y2", "Gain")
    return chart.figure()


def stability_map(subject: AssessedVehicles, held: int, plane: Plane) -> go.Figure:
    """The boundaries of the criteria in a plane of two parameters, with the vehicles.

    The map keeps the third parameter, the lag and the delay of the vehicle of index ``held``, and
    says so. The uncertainty adds parameter sets consistent with the data; one with α = 0 has no
    time headway, hence no place in a plane with τ.
    """
    vehicles, uncertainty = subject.vehicles, subject.uncertainty
    chart = style.Chart(
        f"map-{plane}-{held}", 420, margin={"l": 62, "r": 14, "t": 30, "b": 42}, hoverdistance=30
    )
    parameters, (first, second) = vehicles.parameters[held], AXES[plane]
    x, y = (vehicles.parameters.complete[:, place] for place in (first, second))
    right, top = _right(x, first), _top(y, second, parameters)
    region = stable_region(parameters, plane, right, top)
    if uncertainty:
        _draw_clouds(chart, vehicles, uncertainty, plane)
    _draw_regions(chart, region, top)
    up = QUANTITIES[second]
    for name, (limits, colour, dash) in {
        "L₂": (region.l2, L2, "solid"),
        "L∞, paper": (region.paper, PAPER, "dash"),
        "L∞, exact": (region.linf, EXACT, "solid"),
    }.items():
        hover = f"{name}: stable from {up.symbol} = %{{y:.3g}} {up.unit} on<extra></extra>"
        chart.line(region.across, limits.lower, name, colour, 2, dash, hover=hover)
        if (limits.upper < 2 * top).any():
            hover = f"{name}: stable up to {up.symbol} = %{{y:.3g}} {up.unit}<extra></extra>"
            high = np.where(limits.upper < 2 * top, limits.upper, np.nan)
            chart.line(
                region.across, high, f"{name}, largest", colour, 2, dash, hover=hover,
                showlegend=False,
            )  # fmt: skip
    chart.dots(
        x, y, hover="%{text}<extra></extra>",
        text=[
            f"{html.escape(label)}<br>α {p.alpha:.4g}, β {p.beta:.4g}, τ {p.tau:.4g}"
            for label, p in zip(vehicles.labels, vehicles.parameters, strict=True)
        ],
        marker={
            "size": 13, "color": colours(vehicles), "line": {"width": 2.5},
            "symbol": ["circle" if k == held else "circle-open" for k in range(len(vehicles))],
        },
    )  # fmt: skip
    for name, quantity, end in (("x", QUANTITIES[first], right), ("y", up, top)):
        heading = f"{quantity.symbol}, {quantity.name.lower()} [{quantity.unit}]"
        chart.axis(name, heading, range=[0, end])
    is_along_alpha = plane == "alpha"
    chart.words("L₂ unstable", 0.985 if is_along_alpha else 0.015, 0.015)  # beside the hatching
    _name_stable(chart, region, right, top)
    chart.words(
        f"with {held_text(parameters, plane)} of {html.escape(vehicles.labels[held])}", 0.0, 1.0,
        yanchor="bottom",
    )  # fmt: skip
    return chart.figure()


def _name_stable(chart: style.Chart, region: Region, right: float, top: float) -> None:
    """Write the name of the stable region into its widest visible column."""
    for limits, text in ((region.linf, "L∞ stable"), (region.l2, "L₂ stable")):
        seen = np.minimum(limits.upper, top) - limits.lower
        if np.nanmax(np.append(seen, 0.0)) > LEAST_SEEN * top:
            k = int(np.nanargmax(seen))
            chart.words(
                text, float(np.clip(region.across[k], 0.08 * right, 0.92 * right)),
                float(limits.lower[k] + 0.6 * seen[k]), xref="x", yref="y", xanchor="center",
                yanchor="middle",
            )  # fmt: skip
            return
    if not (region.l2.lower < top).any():
        chart.words("nothing here is L₂ stable", 0.5, 0.9, xanchor="center")


def held_text(vehicle: Parameters, plane: Plane) -> str:
    """The parameters that a map keeps of a vehicle, as "α 0.073, d 0.55 s"."""
    third = ({0, 1, 2} - {*AXES[plane]}).pop()
    quantity = QUANTITIES[third]
    unit = f" {quantity.unit}" if quantity is TAU else ""
    parts = [f"{quantity.symbol} {vehicle.complete[third]:.3g}{unit}"]
    terms = (("s₀", vehicle.s0, "m"), ("λ", vehicle.lag, "s"), ("d", vehicle.delay, "s"))
    return ", ".join(
        [*parts, *(f"{name} {value:.2g} {unit}" for name, value, unit in terms if value)]
    )


def _right(values: FloatArray, place: int) -> float:
    """The right end of a map's axis of α or β, beyond all vehicles."""
    return max(1.35 * _most(values), (0.15, 0.6)[place])


def _top(values: FloatArray, place: int, held: Parameters) -> float:
    """The upper end of a map's axis of β or τ: beyond all vehicles, and what the held one needs."""
    most = _most(values)
    if place == 1:
        needed = float(smallest_beta_l2(np.array(held.alpha), held.tau)) if held.tau > 0 else 0.0
        return max(_right(values, place), min(1.25 * needed, 3.0 * most))
    needed = float(l2_headways(held[None]).smallest[0])
    if held.alpha and not is_lagged(held):
        needed = float(smallest_headway_exact(held))
    wanted = max(most, needed if np.isfinite(needed) else 0.0, 2.0)
    return float(min(1.2 * wanted, max(12.0, 1.2 * most)))


def _most(values: FloatArray) -> float:
    return float(values[np.isfinite(values)].max(initial=0.0))


def _draw_regions(chart: style.Chart, region: Region, top: float) -> None:
    """Fill areas from below: L₂ unstable, only L∞ unstable, stable; hatch where the paper errs."""
    roof = 2.0 * top
    l2, linf = (_closed(limits, roof) for limits in (region.l2, region.linf))
    linf = np.clip(linf[0], *l2), np.clip(linf[1], *l2)
    paper = np.minimum(region.paper.lower, roof)
    layers: list[tuple[FloatArray, style.Part]] = [
        (np.zeros_like(paper), {}),
        (l2[0], {"fillcolor": L2_UNSTABLE}),
        (linf[0], {"fillcolor": ONLY_LINF_UNSTABLE}),
        (linf[1], {"fillcolor": STABLE}),
        (l2[1], {"fillcolor": ONLY_LINF_UNSTABLE}),
        (np.full_like(paper, roof), {"fillcolor": L2_UNSTABLE}),
    ]
    # Where the paper's criterion holds and the exact one does not, below what is stable.
    end = np.where(np.isnan(region.linf.lower), roof, linf[0])
    begin = np.minimum(paper, end)
    if (begin < end).any():
        hatching = {"shape": "/", "fgcolor": PAPER, "bgcolor": style.CLEAR, "size": 9,
                    "solidity": 0.12}  # fmt: skip
        layers += [(begin, {}), (end, {"fillcolor": style.CLEAR, "fillpattern": hatching})]
    for values, look in layers:
        chart.add(region.across, values, mode="lines", line={"width": 0}, hoverinfo="skip",
                  showlegend=False, fill="tonexty" if look else None, **look)  # fmt: skip


def _closed(limits: Limits, roof: float) -> tuple[FloatArray, FloatArray]:
    """Both ends (K,) for areas; where nothing is stable they are one, where the region closed."""
    lower, upper = (np.minimum(end, roof) for end in (limits.lower, limits.upper))
    empty = np.isnan(lower)
    if empty.all():
        return np.full_like(lower, roof), np.full_like(lower, roof)
    places = np.arange(len(lower))
    middle = np.interp(places, places[~empty], (lower[~empty] + upper[~empty]) / 2.0)
    return np.where(empty, middle, lower), np.where(empty, middle, upper)


def _draw_clouds(
    chart: style.Chart, vehicles: ParameterSet, uncertainty: Uncertainty, plane: Plane
) -> None:
    """Draw a dot for each of some posterior samples of every vehicle."""
    first, second = AXES[plane]
    for k, colour in enumerate(colours(vehicles)):
        draws = uncertainty.draws.values[:, k]
        draws = draws[np.linspace(0, len(draws) - 1, CLOUD).astype(int)]
        draws = draws[np.isfinite(draws).all(axis=1)]
        chart.dots(
            draws[:, first].round(5), draws[:, second].round(4), f"cloud {k}", showlegend=False,
            marker={"size": 3.5, "color": style.translucent(colour, DOT_OPACITY)},
        )  # fmt: skip


def cloud_caption(figure: go.Figure, uncertainty: Uncertainty, plane: Plane) -> str:
    """The meaning of the clouds, and the share of draws outside the map."""
    draws = uncertainty.draws.values[:, ~np.isnan(uncertainty.draws.alpha[0])]
    ends = figure.layout.xaxis.range[1], figure.layout.yaxis.range[1]
    outside = (draws[..., [*AXES[plane]]] > ends).any(axis=-1)
    beyond = float(outside.mean()) if draws.size else 0.0
    missing = f"; {100 * beyond:.0f} % of them lie beyond the map" if beyond >= 0.005 else ""
    return f"Clouds: parameter sets consistent with the data{missing}."


def gains_thumbnail(vehicles: ParameterSet, learned: Parameters | None = None) -> go.Figure:
    """The Bode magnitudes of followers, small and without axes; of those ``learned``, dashed."""
    chart, omega = style.thumbnail(), np.geomspace(*SPAN, 75)
    gains = decibels(np.abs(response(vehicles.parameters, omega)))
    _draw_plain(chart, omega, vehicles, learned, width=1.6)
    chart.axis("x", type="log")
    chart.axis("y", range=[-6, max(LEAST_PEAK, 1.1 * float(gains.max()))])
    chart.level("y", 0, LIMIT, "below")
    return chart.figure()


def _draw_plain(
    chart: style.Chart, omega: FloatArray, vehicles: ParameterSet,
    learned: Parameters | None = None, width: float = 2.2,
) -> None:  # fmt: skip
    """Draw the Bode magnitude of each follower, and dashed the one that was learned.

    The learned parameters are (M,), or one set for all.
    """
    names, paints = vehicles.labels, colours(vehicles)
    for parameters, dash, what in (
        (vehicles.parameters, "solid", ""),
        (learned, "dash", "learned"),
    ):
        if parameters is None:
            continue
        levels = decibels(np.abs(response(parameters, omega)))
        for name, colour, level in zip(names, paints, levels, strict=False):
            label = f"{name}, {what}" if what else name
            hover = f"{AT}<extra>{html.escape(label)}</extra>"
            chart.line(omega, level, label, colour, width, dash, hover=hover)


def paper_bode(
    vehicles: ParameterSet, learned: Parameters | None = None, height: int = 230
) -> go.Figure:
    """One of the paper's two Bode plots by its Table III, with the values of its text.

    Learned parameters (M,) are dashed. A cross marks the text's largest amplitude, vertical lines
    the frequencies of the four panels. The height is in pixels.
    """
    chart = style.Chart(f"paper-bode-{vehicles.title}", height, hoverdistance=200)
    report, omega = stability_report(vehicles.parameters), np.geomspace(*SPAN, FREQUENCIES)
    chart.area("y", 0, PAPER_TOP, L2_UNSTABLE)
    chart.level("y", 0, LIMIT, "below")
    for frequency in sorted({panel.frequency for panel in PANELS}):
        chart.level("x", frequency, {"color": style.LEADER, "width": 1, "dash": "dot"}, "below")
    _draw_plain(chart, omega, vehicles, learned)
    _draw_peaks(chart, vehicles, report)
    chart.dots(
        [TEXT_PEAK_AT], [TEXT_PEAK], "the paper's text", showlegend=False,
        hover=f"{AT}<extra>the paper's text</extra>",
        marker={"symbol": "x", "size": 9, "color": style.MODEL},
    )  # fmt: skip
    chart.words(html.escape(vehicles.title.partition(" (")[0]), 0.01, 0.02)
    chart.axis("x", AXIS_OF_FREQUENCY, type="log", range=np.log10(SPAN).tolist(), **TICKS)
    chart.axis("y", MAGNITUDE.heading, range=[-6, PAPER_TOP])
    return chart.figure()


def measured_bode(
    measured: MeasuredGain,
    name: str,
    colour: str,
    model: AssessedVehicles | None = None,
    k: int = 0,
) -> go.Figure:
    """The measured gain of one vehicle over the model's Bode magnitude, and its coherence below.

    The model is that of the ``k``-th of some vehicles, with a band where its posterior is known.
    """
    chart = style.Chart("measured-gain", 440, style.stack(0.7, 0.3, spacing=0.07))
    low, high = min(SPAN[0], float(measured.omega[0])), max(SPAN[1], float(measured.omega[-1]))
    if model:
        if model.uncertainty and np.isfinite(model.uncertainty.draws.alpha[:, k]).all():
            omega, draws = np.geomspace(low, high, BAND_POINTS), model.uncertainty.draws[:, k]
            lower, upper = interval_ends(np.abs(response(draws, omega)), measured.level)
            chart.band(omega, decibels(lower), decibels(upper), colour, BAND_OPACITY, panel=1)
        omega = np.geomspace(low, high, FREQUENCIES)
        gain = decibels(np.abs(response(model.vehicles.parameters[[k]], omega))[0])
        title = f"{model.vehicles.labels[k]}, model"
        chart.line(omega, gain, title, colour, 2.2, panel=1, hover=AT)
    levels = decibels(measured.gain)
    ends = [np.clip(decibels(end), levels - CEILING, levels + CEILING)
            for end in (measured.lower, measured.upper)]  # fmt: skip
    for part, words, opacity, symbol in (
        (measured.coherent, "measured", 1.0, "circle"),
        (~measured.coherent, "measured, not coherent", 0.35, "circle-open"),
    ):
        marker = {"color": style.LEADER, "size": 7, "symbol": symbol}
        bars = (ends[0][part], ends[1][part]) if opacity == 1 else None
        label = f"{name}, {words}"
        for panel, values, title in (
            (1, levels, label), (2, measured.coherence, f"coherence, {label}"),
        ):  # fmt: skip
            chart.dots(
                measured.omega[part], values[part], title, panel, "%{y:.2f} at %{x:.3f} rad/s",
                marker=marker, ends=bars if panel == 1 else None, bar={"thickness": 1.2},
                opacity=opacity, showlegend=panel == 1,
            )  # fmt: skip
    top = float(np.max(ends[1][measured.coherent], initial=3.0))
    chart.axis("x*", type="log", range=np.log10([low, high]).tolist(), **TICKS)
    chart.axis("x2", AXIS_OF_FREQUENCY)
    chart.axis("y", "Gain [dB]", range=[2 * FLOOR, min(top, CEILING) + 1.0])
    chart.axis("y2", "Coherence", range=[0, 1.03])
    chart.level("y", 0, LIMIT)
    return chart.figure()
