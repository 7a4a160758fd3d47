"""A simulated platoon as figures: profiles, time-space diagram, growth, map, the paper's."""

import colorsys
import html
from collections import Counter
from functools import cache
from itertools import product
from typing import Any, Literal

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.colors import hex_to_rgb, sample_colorscale

from accpinn.channels import GAP, SPEED, TIME
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.published import ASTAZERO
from accpinn.platoon import PlatoonRun, simulate_platoon
from accpinn.platoon.leader import Recorded, Sinusoid
from accpinn.results.cast import Cast
from accpinn.results.figures import style
from accpinn.results.figures.stability import colours
from accpinn.results.messages.stability import three
from accpinn.results.reproduction import PANEL_FOLLOWERS, PANELS
from accpinn.segment import Segment
from accpinn.units import FloatArray, Metres, Seconds, stretches

CLOSE: Metres = 5.0
"""Gaps below this make the figure show where zero is."""
PREDICTION_RIM = 0.3
"""How far an axis goes on for a linear prediction, as a share of what the vehicles span."""
POINTS = 800
"""Largest number of points a line of a profile."""
COLUMNS = 240
"""Instants of the map of speeds."""
DOTS = 2400
"""Instants of all vehicles in the time-space diagram together."""
SHADES = 11
"""Colours of its tracks."""
LABEL_ROOM = 0.07
"""Least distance of two vehicles' numbers beside their tracks, as a share of all places."""
TRACKS = "tracks"
"""Name of the line that answers to the pointer, on all tracks."""
STRIPES = 8
"""Periods of a sinusoid on the map of speeds; with more the wave's slope is not seen."""
CAR_LENGTH: Metres = 4.5
"""Length of a car in m: the model has gaps only, not the distance between two fronts."""
PERIODS = 3
"""Periods of a sinusoid in a close-up."""
WATCHED: Seconds = 120.0
"""Length of a close-up of any other planned disturbance, in s."""
PLACE = "Follower (0 = leader)"
SLOWER, FASTER = style.FOLLOWERS[1], style.FOLLOWERS[0]
SPEED_SCALE = [[0.0, SLOWER], [0.5, "rgba(140, 150, 162, 0.25)"], [1.0, FASTER]]
TRACK_SCALE = [[0.0, SLOWER], [0.5, "#9aa2ac"], [1.0, FASTER]]
"""The same on lines, which must be seen at any speed."""
END = {"symbol": "x", "size": 9, "color": style.MODEL}
"""Where a vehicle collides with the one ahead."""
ENDS = "ends with a collision"
MEASURED_OPACITY = 0.65
LABELLED = 6
"""Followers up to which the bars of growth carry their gains."""
LEAST_GROWTH, GROWTH_RIM, LEAST_RIM = 1e-3, 0.15, 0.02
"""Least growth in sight; room around the bars as a share of their span, and at least, in decades.
"""
MOST_DECADES = 3
"""Decades of growth from which an axis has ticks at powers of ten alone."""
WIDTHS = (2.5, 1.5)
"""Widths of the line of the leader, and of a follower."""
LIGHTEST, DARKEST = 0.70, 0.42
"""Lightness of the shades of one colour, between what white and what dark pages swallow."""
SOFTENED = 0.8
"""Saturation of the shades, relative to the colour's."""
PANEL_POINTS = 500
"""Largest number of points a line of the paper's panels."""
Span = tuple[Seconds, Seconds]
"""Beginning and end of a part of a run, by its clock."""
View = Literal["observer", "leader", "road"]
"""From where a time-space diagram is seen: an observer who drives at the leader's mean speed, so
that the vehicles' distances fill the axes and their motion is seen; the leader; or the road."""


def colours_of(cast: Cast) -> list[str]:
    """(M+1,) the colour of each vehicle, leader first; one that is repeated gets shades of it."""
    total, seen, paints = Counter(cast.order), Counter[int](), [style.LEADER]
    for k in cast.order:
        share = seen[k] / (total[k] - 1) if total[k] > 1 else None
        paints.append(_shade(colours(cast.vehicles)[k], share))
        seen[k] += 1
    return paints


def _shade(colour: str, share: float | None) -> str:
    """From light to dark as ``share`` goes from 0 to 1; the colour itself without one."""
    if share is None:
        return colour
    hue, _, saturation = colorsys.rgb_to_hls(*(part / 255 for part in hex_to_rgb(colour)))
    lightness = LIGHTEST + share * (DARKEST - LIGHTEST)
    rgb = colorsys.hls_to_rgb(hue, lightness, SOFTENED * saturation)
    return "#" + "".join(f"{round(255 * part):02x}" for part in rgb)


def close_up(run: PlatoonRun) -> Span:
    """The part of a run for a close-up.

    The last periods of a sinusoid, or what follows another disturbance; where a vehicle collides,
    what goes before. With a recorded leader it is the whole run.
    """
    leader, time = run.leader, run.trajectories.time
    first, end = float(time[0]), float(time[-1])
    if isinstance(leader, Recorded):
        return first, end
    width = PERIODS * leader.period if isinstance(leader, Sinusoid) else WATCHED
    if run.collisions:
        last = min(end, run.collisions[-1].time + width / PERIODS)
        return max(first, min(run.collisions[0].time, last - width / 2) - width / 2), last
    if isinstance(leader, Sinusoid):
        return max(first, end - width), end
    start = max(first, min(leader.settle, end) - 5.0)
    return start, min(end, start + width)


def profiles(
    run: PlatoonRun, cast: Cast, span: Span | None = None, measured: Segment | None = None,
    height: int = 540, linear: Trajectories | None = None,
) -> go.Figure:  # fmt: skip
    """Speeds of all vehicles, and the gaps of the followers, over a part of a run (by default all).

    Followers that were measured behind the same leader are drawn dotted, those of a linear
    prediction dashed. The height is in pixels.
    """
    chart = style.Chart(
        "platoon-profiles", height, style.stack(0.58, 0.42, spacing=0.06), (SPEED, GAP)
    )
    driven, paints = run.valid, colours_of(cast)
    start, end = span or (-np.inf, np.inf)
    rows = np.flatnonzero((driven.time >= start - 1e-9) & (driven.time <= end + 1e-9))
    if measured:
        time, recorded = measured.start + measured.time, style.vehicle_colours(measured.vehicles)
        for k, label in enumerate(measured.labels[1:]):
            speeds, gaps = measured.measured_speeds[:, k + 1], measured.measured_gaps[:, k]
            _draw(chart, time, f"{label}, measured", recorded[k + 1], speeds, gaps, width=1.3,
                  dash="dot", opacity=MEASURED_OPACITY, legendrank=100 + k)  # fmt: skip
    if linear:
        for k, label in enumerate(cast.labels[1:]):
            speeds, gaps = linear.speeds[rows, k + 1], linear.gaps[rows, k]
            _draw(chart, linear.time[rows], f"{label}, linear", paints[k + 1], speeds, gaps,
                  width=1.2, dash="dash", opacity=MEASURED_OPACITY)  # fmt: skip
        if not measured:
            for axis, shown, predicted in (
                ("y1", driven.speeds[rows], linear.speeds[rows]),
                ("y2", driven.gaps[rows], linear.gaps[rows]),
            ):
                chart.axis(axis, range=_limits(shown, predicted))
    for k in [*range(1, len(cast.labels)), 0]:  # the leader last, on top
        below = driven.gaps[rows, k - 1] if k else None
        _draw(chart, driven.time[rows], cast.labels[k], paints[k], driven.speeds[rows, k],
              below, width=WIDTHS[k > 0], legendrank=k)  # fmt: skip
    if np.nanmin(driven.gaps[rows]) < CLOSE:
        chart.level("y2", 0, {"color": SLOWER, "width": 1.5, "dash": "dash"})
    _draw_collisions(chart, run, span)
    return chart.figure()


def _limits(shown: FloatArray, predicted: FloatArray) -> list[float]:
    """Limits of an axis, which a prediction that is far off may leave."""
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    rim = PREDICTION_RIM * (high - low)
    inside = np.clip(predicted[np.isfinite(predicted)], low - rim, high + rim)
    return style.limits(np.concatenate([shown.ravel(), inside]))


def _draw(
    chart: style.Chart, time: FloatArray, name: str, colour: str, speeds: FloatArray,
    gaps: FloatArray | None = None, points: int = POINTS, **look: Any,
) -> None:  # fmt: skip
    """Draw speeds and, below them, gaps in half the bytes, as there are many lines."""
    for panel, values in ((1, speeds), (2, gaps)):
        if values is not None:
            x, y = (axis.astype(np.float32) for axis in style.thinned(time, values, points))
            chart.line(x, y, name, colour, panel=panel, hover="%{y:.2f}", **look)


def _draw_collisions(chart: style.Chart, run: PlatoonRun, span: Span | None) -> None:
    """Draw a cross where a vehicle collides; nothing where none does in sight.

    The lines of those behind it end there without one.
    """
    driven = run.valid
    start, end = span or (-np.inf, np.inf)
    hitting = _colliding(run)
    at = run.meaningful[hitting] - 1
    shown = (driven.time[at] >= start) & (driven.time[at] <= end)
    hitting, at = hitting[shown], at[shown]
    if not len(hitting):
        return
    for panel, values in ((1, driven.speeds[at, hitting]), (2, driven.gaps[at, hitting - 1])):
        chart.dots(driven.time[at], values, ENDS, panel, ENDS, marker=END, legendrank=90)
    first = run.collisions[0].time
    for axis in ("x", "x2"):
        chart.level(axis, first, {"color": style.MODEL, "width": 1, "dash": "dot"})
    # Within the axes, where no legend above them can be in the way.
    side = "left" if first < 0.8 * min(end, driven.time[-1]) else "right"
    chart.words("collision", first, 1, xref="x", xanchor=side)


def _colliding(run: PlatoonRun) -> NDArray[np.intp]:
    """The vehicles that collide with the one ahead before any further ahead has done so."""
    return np.array([hit.follower for hit in run.collisions], np.intp)


def time_space(
    run: PlatoonRun, cast: Cast, span: Span | None = None, view: View = "observer",
    height: int = 540,
) -> go.Figure:  # fmt: skip
    """The time-space diagram: each vehicle's position over time, coloured by its speed.

    It shows a part of a run (by default all) as seen from somewhere. The height is in pixels.
    """
    driven = run.valid
    rows = samples(run, span or (-np.inf, np.inf), DOTS // len(cast.labels))
    time, speeds = driven.time[rows], driven.speeds[rows]
    from scipy.integrate import cumulative_trapezoid  # takes a while, which few need

    ahead = cumulative_trapezoid(driven.speeds[:, 0], driven.time, initial=0)[rows]
    ahead -= ahead[0]
    mean = float(ahead[-1] / (time[-1] - time[0]))
    origin = {"road": 0.0 * time, "leader": ahead, "observer": mean * (time - time[0])}[view]
    places = np.empty(speeds.shape)
    places[:, 0] = ahead - origin
    places[:, 1:] = places[:, :1] - np.cumsum(driven.gaps[rows] + CAR_LENGTH, axis=1)
    middle = float(speeds[:, 0].mean()) if isinstance(run.leader, Recorded) else run.leader.speed
    limit = float(np.nanmax(np.abs(speeds - middle))) or 1.0
    last = [int(np.flatnonzero(np.isfinite(column))[-1]) for column in places.T]
    final = [places[at, k] for k, at in enumerate(last)]
    collided = [k for k in _colliding(run) if last[k] < len(rows) - 1]
    chart = style.Chart(
        f"platoon-time-space-{view}", height, margin={"l": 62, "r": 22, "t": 28, "b": 42},
    )  # fmt: skip
    ends = ((0.0, middle - limit), (0.5, middle), (1.0, middle + limit))
    shades = (f'<span style="color:{sample_colorscale(TRACK_SCALE, [at])[0]}">■</span> {speed:.1f}'
              for at, speed in ends)  # fmt: skip
    chart.words(f"{'  '.join(shades)} m/s", 1, 1, yanchor="bottom")
    # One line with gaps answers to the pointer, as each trace costs the browser milliseconds.
    chart.add(
        np.tile(np.append(time, np.nan), len(cast.labels)).astype(np.float32),
        _with_gaps(places).astype(np.float32), TRACKS, mode="lines", showlegend=False,
        customdata=_with_gaps(speeds).round(3).astype(np.float32),
        line={"color": style.CLEAR, "width": 8}, text=np.repeat(cast.numbers, len(time) + 1),
        hovertemplate="%{customdata:.2f} m/s at %{x:.1f} s<extra>vehicle %{text}</extra>",
    )  # fmt: skip
    _draw_tracks(chart, time, places, (speeds - middle) / limit)
    named, room = [0], LABEL_ROOM * float(np.nanmax(places) - np.nanmin(places))
    for k in range(1, len(final)):
        if last[k] != last[named[-1]] or abs(final[named[-1]] - final[k]) >= room:
            named.append(k)
    chart.add(time[[last[k] for k in named]], [final[k] for k in named], mode="text",
              textposition="middle right", cliponaxis=False, hoverinfo="skip",
              text=[f" {cast.numbers[k]}" for k in named])  # fmt: skip
    at = time[[last[k] for k in collided]]
    chart.dots(at, [final[k] for k in collided], ENDS, hover=ENDS, marker=END)
    seen = {"road": "on the road", "leader": "seen from leader",
            "observer": f"relative to {mean:.1f} m/s"}  # fmt: skip
    chart.axis("x", TIME.axis)
    chart.axis("y", f"Position {seen[view]} [m]")
    return chart.figure()


def _with_gaps(values: FloatArray) -> FloatArray:
    """The columns (K, V) one below the other, each followed by nan."""
    return np.append(values, np.full((1, values.shape[1]), np.nan), axis=0).T.ravel()


def _draw_tracks(
    chart: style.Chart, time: FloatArray, places: FloatArray, levels: FloatArray
) -> None:
    """Draw lines of one colour each, which browsers draw far faster than a dot for each instant.

    Places (K, V) in m are nan where a vehicle drives no more. Levels (K, V) are speeds, -1 to 1.
    """
    between = (levels[:-1] + levels[1:]) / 2  # nan where either end is
    is_driving = np.isfinite(between)
    shade = np.where(is_driving, ((np.nan_to_num(between) + 1) / 2 * (SHADES - 1)).round(), -1)
    for index, colour in enumerate(sample_colorscale(TRACK_SCALE, SHADES)):
        x, y = list[float](), list[float]()
        for k in range(places.shape[1]):
            for stretch in stretches(shade[:, k] == index):
                rows = slice(stretch.first, stretch.last + 2)
                x += [*time[rows].round(2).tolist(), np.nan]
                y += [*places[rows, k].round(2).tolist(), np.nan]
        chart.add(np.array(x, np.float32), np.array(y, np.float32), mode="lines",
                  hoverinfo="skip", line={"color": colour, "width": 3})  # fmt: skip


def growth_by_vehicle(
    run: PlatoonRun, cast: Cast, recorded: Segment | None = None, height: int = 380
) -> go.Figure:
    """The growth along the platoon on a logarithmic axis: one floating bar for each follower.

    A bar begins at the amplitude of the car ahead and ends at the follower's own, both relative to
    the leader's: its length is the follower's own gain, and its end the growth up to it. Amplitudes
    are those of the speed once settled, and behind a leader that is no sinusoid the largest
    deviations; of a vehicle that does not drive to the end the largest until then, in outline. A
    tick marks the growth predicted by |H(jω)|, a diamond that of the recorded vehicles behind a
    recorded leader. The height is in pixels.
    """
    wave, driving = run.amplitudes, run.survivors
    sizes = wave.measured if wave else run.largest_deviation
    sizes = np.where(np.arange(len(sizes)) < driving, sizes, run.largest_deviation)
    base = sizes[0] if sizes[0] > 0 else np.nan
    growth, places, paints = sizes / base, np.arange(len(sizes)), colours_of(cast)
    ahead, ends = np.append(1.0, growth[:-1]), [growth]
    with np.errstate(divide="ignore", invalid="ignore"):  # a car behind one that stands still
        gains = growth / ahead
    names = [html.escape(label) for label in cast.labels]
    margin = {"l": 62, "r": 14, "t": 28, "b": 42}
    chart = style.Chart("platoon-growth", height, bargap=0.25, margin=margin)
    is_labelled = len(growth) <= LABELLED + 1
    for rows, name, look in (
        (slice(1, driving), "Simulated", {}),
        (slice(max(1, driving), None), "Before the collision",
         {"pattern": {"shape": "/", "size": 5}}),
    ):  # fmt: skip
        if len(places[rows]):
            chart.add(
                places[rows], (growth - ahead)[rows], name, type="bar", base=ahead[rows],
                marker={"color": paints[rows], **look},
                text=[f"{three(gain)}×" if is_labelled and np.isfinite(gain) else ""
                      for gain in gains[rows].tolist()],
                textposition="outside", textangle=0, constraintext="none", cliponaxis=False,
                customdata=np.column_stack([gains, growth, sizes])[rows],
                hovertext=names[rows], hovertemplate="%{hovertext}<br>%{customdata[0]:.3g} × the"
                " car ahead<br>%{customdata[1]:.3g} × the leader's, %{customdata[2]:.3f} m/s"
                "<extra></extra>",
            )  # fmt: skip
    if wave:
        ends.append(wave.predicted / base)
        chart.dots(
            places, ends[-1], "Predicted by |H(jω)|", hover="predicted %{y:.3g} ×<extra></extra>",
            marker={"symbol": "line-ew", "size": 16, "line": {"width": 2, "color": style.LEADER}},
        )  # fmt: skip
    if recorded:
        ends.append(np.fmax.reduce(np.abs(recorded.measured_speeds - run.leader.speed)) / base)
        chart.dots(
            places[: len(ends[-1])], ends[-1], "Recorded",
            hover="recorded %{y:.3g} ×<extra></extra>",
            marker={"symbol": "diamond-open", "size": 10, "color": style.MODEL,
                    "line": {"width": 2}},
        )  # fmt: skip
    chart.level("y", 1, {"color": style.LEADER, "width": 1, "dash": "dash"})
    what = "Amplitude" if wave else "Largest deviation"
    shown = np.concatenate(ends)
    shown = np.log10(np.clip(shown[np.isfinite(shown)], LEAST_GROWTH, None))
    low, high = min(shown, default=0.0), max(shown, default=0.0)
    rim = max(GROWTH_RIM * (high - low), LEAST_RIM)
    span = low - rim, high + rim
    chart.axis("y", f"{what} [× the leader's]", type="log", range=span, **_decade_ticks(*span))
    about = "bars: the car's own gain; ◇ recorded" if recorded else "each bar: the car's own gain"
    chart.words(about, 0, 1, yanchor="bottom")
    _mark_vehicles(chart, "x", cast)
    return chart.figure()


def _decade_ticks(low: float, high: float) -> dict[str, Any]:
    """Ticks of a logarithmic axis over more than a decade, whose own are too many; else none."""
    if high - low < 1:
        return {}
    steps = (1, 2, 5) if high - low < MOST_DECADES else (1,)
    decades = 10.0 ** np.arange(np.floor(low), np.ceil(high))
    values = np.outer(decades, steps).ravel()
    return {"tickvals": values, "ticktext": [f"{value:g}" for value in values]}


def _mark_vehicles(chart: style.Chart, axis: str, cast: Cast) -> None:
    """Give an axis a tick for each vehicle."""
    title = PLACE if cast.numbers[0] == "0" else "Vehicle (L = leader)"
    chart.axis(axis, title, tickvals=np.arange(len(cast.labels)), ticktext=cast.numbers)


def speed_map(run: PlatoonRun, cast: Cast) -> go.Figure:
    """Speeds relative to the first one, over time and along the platoon."""
    chart = style.Chart("platoon-map", 380)
    driven, rows = run.valid, stretch(run)
    deviation = (driven.speeds[rows] - run.leader.speed).T
    limit = float(np.nanmax(np.abs(deviation))) or 1.0
    chart.add(
        driven.time[rows].astype(np.float32), np.arange(len(cast.labels)), type="heatmap",
        z=deviation.astype(np.float32), zmin=-limit, zmax=limit, colorscale=SPEED_SCALE, ygap=1,
        colorbar={"title": {"text": "Δ speed [m/s]", "side": "right"}, "thickness": 12},
        hovertemplate="vehicle %{y} at %{x:.0f} s: %{z:+.2f} m/s<extra></extra>",
    )  # fmt: skip
    chart.axis("x", TIME.axis)
    chart.axis("y", autorange="reversed")
    _mark_vehicles(chart, "y", cast)
    return chart.figure()


def stretch(run: PlatoonRun) -> NDArray[np.intp]:
    """The samples of the map: from just before the disturbance on; of a sinusoid, few periods."""
    leader, time = run.leader, run.trajectories.time
    if not isinstance(leader, Sinusoid):
        return samples(run, (float(time[0]), float(time[-1])), COLUMNS)
    start = max(0.0, leader.settle - leader.period / 2)
    return samples(run, (start, start + STRIPES * leader.period), COLUMNS)


def samples(run: PlatoonRun, span: Span, count: int) -> NDArray[np.intp]:
    """At most ``count`` samples of a part, evenly spread."""
    time = run.trajectories.time
    start, end = np.clip(span, time[0], time[-1])
    instants = np.linspace(start, end, count)
    return np.unique(np.clip(np.searchsorted(time, instants - 1e-9), 0, len(time) - 1))


@cache
def paper_panels(height: int = 300) -> tuple[go.Figure, ...]:
    """The paper's four panels: eight times one AstaZero vehicle behind a sinusoid of 1 m/s.

    Row by row, two a row, all on one scale. The height is in pixels.
    """
    runs = [
        simulate_platoon(
            ASTAZERO.parameters[[panel.vehicle] * PANEL_FOLLOWERS], Sinusoid(panel.frequency)
        )
        for panel in PANELS
    ]
    reach = 1.05 * max(float(run.largest_deviation.max()) for run in runs)
    panels = []
    for panel, run in zip(PANELS, runs, strict=True):
        cast = Cast(ASTAZERO, (panel.vehicle,) * PANEL_FOLLOWERS)
        driven, name = run.trajectories, ASTAZERO.labels[panel.vehicle]
        paints = colours_of(cast)
        chart = style.Chart(
            f"platoon-panel-{panel.letter}", height, channels=(SPEED,),
            margin={"l": 62, "r": 14, "t": 24, "b": 42},
        )  # fmt: skip
        chart.axis("y", range=[run.leader.speed - reach, run.leader.speed + reach])
        for j in [*range(1, PANEL_FOLLOWERS + 1), 0]:
            _draw(chart, driven.time, cast.labels[j], paints[j], driven.speeds[:, j],
                  points=PANEL_POINTS, width=WIDTHS[j > 0], legendrank=j)  # fmt: skip
        title = f"({panel.letter}) {name.split()[0]}, {panel.frequency:g} rad/s: {_fate(run)}"
        chart.words(title, 0, 1, yanchor="bottom", xshift=-50)
        panels.append(chart.figure())
    return tuple(panels)


def panels_thumbnail(learned: Parameters | None = None) -> go.Figure:
    """How the amplitude grows or fades along the platoon of each panel, small and without axes.

    The AstaZero followers' learned parameters (M,) are dashed.
    """
    chart, places = style.thumbnail(), np.arange(PANEL_FOLLOWERS + 1)
    drawn = [(ASTAZERO.parameters, "solid")] + ([] if learned is None else [(learned, "dash")])
    for (parameters, dash), panel in product(drawn, PANELS):
        growth = panel.gain(parameters) ** (places / PANEL_FOLLOWERS)
        colour = colours(ASTAZERO)[panel.vehicle]
        chart.line(places, growth, colour=colour, width=1.6, dash=dash, hoverinfo="skip")
    chart.level("y", 1, {"color": style.LEADER, "width": 1.2}, "below")
    return chart.figure()


def _fate(run: PlatoonRun) -> str:
    """Whether the wave grows or fades along the platoon; its amplitude at the last follower."""
    size = run.amplitudes
    if size is None or not size.periods:
        return "not settled"
    ratio = size.measured[-1] / size.measured[0]
    return f"{'grows' if ratio > 1 else 'fades'} to {size.measured[-1]:.2f} m/s"
