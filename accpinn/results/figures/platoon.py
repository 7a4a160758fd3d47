"""A simulated platoon as figures: profiles, time-space diagram, amplitudes, map, the paper's."""

import colorsys
import html
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.colors import hex_to_rgb, sample_colorscale

from accpinn.channels import GAP, SPEED, TIME
from accpinn.model.cthp import Trajectories
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.platoon.leader import Recorded, Sinusoid
from accpinn.platoon.simulation import PlatoonRun, simulate_platoon
from accpinn.results.figures import style
from accpinn.results.figures.stability import colours
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Metres, Seconds, stretches

CLOSE: Metres = 5.0
"""Gaps below this make the figure show where zero is."""
POINTS = 800
"""Largest number of points a line of a profile."""
COLUMNS = 240
"""Instants of the map of speeds."""
DOTS = 2400
"""Instants of all vehicles in the time-space diagram together."""
SHADES = 11
"""Colours of its tracks."""
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
"""Where a vehicle's motion ends with a collision."""
MEASURED_OPACITY = 0.65
LIGHTEST, DARKEST = 0.70, 0.42
"""Lightness of the shades of one colour, between what white and what dark pages swallow."""
SOFTENED = 0.8
"""Saturation of the shades, relative to the colour's."""
PANEL_POINTS = 500
"""Largest number of points a line of the paper's panels."""
PANEL_FOLLOWERS = 8
PANELS = ((2, 0.25), (2, 0.3), (3, 0.25), (3, 0.3))
"""AstaZero vehicle, by its index, and frequency in rad/s; row by row (a), (c), (b), (d)."""
Span = tuple[Seconds, Seconds]
"""Beginning and end of a part of a run, by its clock."""
View = Literal["observer", "leader", "road"]
"""From where a time-space diagram is seen: an observer who drives at the leader's mean speed, so
that the vehicles' distances fill the axes and their motion is seen; the leader; or the road."""


@dataclass(frozen=True)
class Cast:
    """Labels and colours of a leader and its M followers, M+1 each."""

    labels: tuple[str, ...]
    colours: tuple[str, ...]
    numbers: tuple[str, ...]
    """What stands beside a line in place of the label: the number in a recording, or the place."""

    @property
    def names(self) -> tuple[str, ...]:
        """The labels ready for plotly, which reads a little HTML."""
        return tuple(map(html.escape, self.labels))


def cast_of(vehicles: ParameterSet, order: Sequence[int]) -> Cast:
    """Followers by their indices in ``vehicles``; repeated ones get shades of one colour.

    In the vehicles' own order each has its own label, otherwise its place and label.
    """
    in_order = is_in_order(vehicles, order)
    total, seen = Counter(order), Counter[int]()
    recorded = in_order and vehicles.numbered
    names, paints, numbers = ["Leader"], [style.LEADER], ["L" if recorded else "0"]
    for place, k in enumerate(order, 1):
        label = vehicles.labels[k]
        names.append(label if in_order else f"Follower {place}: {label}")
        share = seen[k] / (total[k] - 1) if total[k] > 1 else None
        paints.append(_shade(colours(vehicles)[k], share))
        numbers.append(str(vehicles.vehicles[k + 1] if recorded else place))
        seen[k] += 1
    return Cast(tuple(names), tuple(paints), tuple(numbers))


def is_in_order(vehicles: ParameterSet, order: Sequence[int]) -> bool:
    """Whether each vehicle drives once, in its own place."""
    return [*order] == [*range(len(vehicles))]


def _shade(colour: str, share: float | None) -> str:
    """From light to dark as ``share`` goes from 0 to 1; the colour itself without one."""
    if share is None:
        return colour
    hue, _, saturation = colorsys.rgb_to_hls(*(part / 255 for part in hex_to_rgb(colour)))
    lightness = LIGHTEST + share * (DARKEST - LIGHTEST)
    rgb = colorsys.hls_to_rgb(hue, lightness, SOFTENED * saturation)
    return "#" + "".join(f"{round(255 * part):02x}" for part in rgb)


def close_up(run: PlatoonRun) -> Span:
    """The part worth a closer look.

    The last periods of a sinusoid, or what follows another disturbance; where a vehicle collides,
    what goes before. With a recorded leader it is the whole run.
    """
    leader, time = run.leader, run.trajectories.time
    first, end = float(time[0]), float(time[-1])
    if isinstance(leader, Recorded):
        return first, end
    width = PERIODS * leader.period if isinstance(leader, Sinusoid) else WATCHED
    if run.contacts:
        last = min(end, run.contacts[-1].time + width / PERIODS)
        return max(first, min(run.contacts[0].time, last - width / 2) - width / 2), last
    if isinstance(leader, Sinusoid):
        return max(first, end - width), end
    start = max(first, leader.settle - 5.0)
    return start, min(end, start + width)


def profiles(
    run: PlatoonRun, cast: Cast, span: Span | None = None, measured: Segment | None = None,
    height: int = 540, linear: Trajectories | None = None,
) -> go.Figure:  # fmt: skip
    """Speeds of all vehicles, and the gaps of the followers, over a part of a run (by default all).

    Followers that were measured behind the same leader are drawn dotted, those of a linear
    prediction dashed. The height is in pixels.
    """
    driven = run.valid
    rows = _within(driven.time, span)
    traces = [*_measured(measured)] if measured else []
    traces += _predicted(linear, rows, cast) if linear else []
    for k in [*range(1, len(cast.names)), 0]:  # the leader last, on top
        traces.append(line_of(driven.time[rows], driven.speeds[rows, k], cast, k))
        if k:
            traces.append(line_of(driven.time[rows], driven.gaps[rows, k - 1], cast, k, 2))
    shapes, words = list[style.Part](), list[style.Part]()
    if np.nanmin(driven.gaps[rows]) < CLOSE:
        shapes.append(style.across("y2", 0, line={"color": SLOWER, "width": 1.5, "dash": "dash"}))
    if ends := _collisions(run, span):
        traces += ends
        first, shown_end = run.contacts[0].time, min(span[1] if span else np.inf, driven.time[-1])
        words.append({  # within the axes, where no legend above them can be in the way
            "text": "collision", "x": first, "y": 1, "xref": "x", "yref": "y domain",
            "xanchor": "left" if first < 0.8 * shown_end else "right", "yanchor": "top",
            "showarrow": False,
        })  # fmt: skip
        dotted = {"color": style.MODEL, "width": 1, "dash": "dot"}
        shapes += [style.across(axis, first, line=dotted) for axis in ("x", "x2")]
    return style.composed(
        traces, height, "platoon-profiles", grid=style.stack(0.58, 0.42, spacing=0.06),
        channels=(SPEED, GAP), shapes=shapes, annotations=words,
    )  # fmt: skip


def _within(time: FloatArray, span: Span | None) -> NDArray[np.intp]:
    """The samples of a part, two at least."""
    start, end = span or (-np.inf, np.inf)
    inside = np.flatnonzero((time >= start - 1e-9) & (time <= end + 1e-9))
    return inside if len(inside) > 1 else np.arange(len(time))


def line_of(
    time: FloatArray, values: FloatArray, cast: Cast, k: int, panel: int = 1, points: int = POINTS
) -> style.Part:
    """A vehicle's line in a panel, and in the legend if that is the first."""
    return _line(
        time, values, panel, points, name=cast.names[k], legendrank=k,
        line={"color": cast.colours[k], "width": 1.5 if k else 2.5},
    )  # fmt: skip


def _line(
    time: FloatArray, values: FloatArray, panel: int, points: int = POINTS, **look: Any
) -> style.Part:
    """A line in half the bytes, as there are many."""
    line = style.curve(time, values, panel, points, mode="lines", hovertemplate="%{y:.2f}",
                 showlegend=panel == 1, **look)  # fmt: skip
    return line | {axis: line[axis].astype(np.float32) for axis in "xy"}


def _measured(segment: Segment) -> Iterator[style.Part]:
    """Speeds and gaps of the recorded followers."""
    time, colours_of = segment.start + segment.time, style.vehicle_colours(segment.vehicles)
    for k, label in enumerate(segment.labels[1:]):
        channels = segment.measured_speeds[:, k + 1], segment.measured_gaps[:, k]
        for panel, values in enumerate(channels, 1):
            yield _line(
                time, values, panel, name=f"{html.escape(label)}, measured", legendrank=100 + k,
                line={"color": colours_of[k + 1], "width": 1.3, "dash": "dot"},
                opacity=MEASURED_OPACITY,
            )  # fmt: skip


def _predicted(linear: Trajectories, rows: NDArray[np.intp], cast: Cast) -> Iterator[style.Part]:
    """Speeds and gaps of the followers by a linear model."""
    for k in range(1, len(cast.names)):
        for panel, values in ((1, linear.speeds[rows, k]), (2, linear.gaps[rows, k - 1])):
            yield _line(
                linear.time[rows], values, panel, name=f"{cast.names[k]}, linear",
                line={"color": cast.colours[k], "width": 1.2, "dash": "dash"},
                opacity=MEASURED_OPACITY,
            )  # fmt: skip


def _collisions(run: PlatoonRun, span: Span | None) -> list[style.Part]:
    """A cross where a vehicle's motion ends; nothing where none ends in sight."""
    driven = run.valid
    start, end = span or (-np.inf, np.inf)
    ended = np.flatnonzero(run.meaningful < len(driven.time))
    at = run.meaningful[ended] - 1
    shown = (driven.time[at] >= start) & (driven.time[at] <= end)
    ended, at = ended[shown], at[shown]
    return [
        _ends(driven.time[at], values)
        | style.axes_of(panel)
        | {"showlegend": panel == 1, "legendrank": 90}
        for panel, values in ((1, driven.speeds[at, ended]), (2, driven.gaps[at, ended - 1]))
        if len(ended)
    ]


def _ends(time: FloatArray, values: FloatArray | list[float]) -> style.Part:
    """Crosses where vehicles collide."""
    words = "ends with a collision"
    return {"x": time, "y": values, "mode": "markers", "marker": END, "name": words,
            "hovertemplate": words}  # fmt: skip


def time_space(
    run: PlatoonRun, cast: Cast, span: Span | None = None, view: View = "observer",
    height: int = 540,
) -> go.Figure:  # fmt: skip
    """The time-space diagram: each vehicle's position over time, coloured by its speed.

    It shows a part of a run (by default all) as seen from somewhere. The height is in pixels.
    """
    driven = run.valid
    inside = _within(driven.time, span)
    count = min(len(inside), DOTS // len(cast.names))
    rows = inside[np.linspace(0, len(inside) - 1, count).round().astype(int)]
    time, speeds = driven.time[rows], driven.speeds[rows]
    from scipy.integrate import cumulative_trapezoid  # takes a while, which few need

    way = cumulative_trapezoid(driven.speeds[inside, 0], driven.time[inside], initial=0)
    mean = float(way[-1] / (driven.time[inside[-1]] - time[0]))
    ahead = way[rows - inside[0]]
    origin = {"road": 0.0 * time, "leader": ahead, "observer": mean * (time - time[0])}[view]
    places = np.empty(speeds.shape)
    places[:, 0] = ahead - origin
    places[:, 1:] = places[:, :1] - np.cumsum(driven.gaps[rows] + CAR_LENGTH, axis=1)
    middle = float(speeds[:, 0].mean()) if isinstance(run.leader, Recorded) else run.leader.speed
    limit = float(np.nanmax(np.abs(speeds - middle))) or 1.0
    last = [int(np.flatnonzero(np.isfinite(column))[-1]) for column in places.T]
    final = [places[at, k] for k, at in enumerate(last)]
    collided = [k for k, at in enumerate(last) if at < len(rows) - 1]
    scale = [middle - limit, middle + limit]
    traces = [
        {  # one line with gaps answers to the pointer, as each trace costs the browser milliseconds
            "x": np.tile(np.append(time, np.nan), len(cast.names)).astype(np.float32),
            "y": _with_gaps(places).astype(np.float32), "mode": "lines", "name": TRACKS,
            "customdata": _with_gaps(speeds).round(3).astype(np.float32), "showlegend": False,
            "line": {"color": style.CLEAR, "width": 8},
            "text": np.repeat(cast.numbers, len(time) + 1),
            "hovertemplate": "%{customdata:.2f} m/s at %{x:.1f} s<extra>vehicle %{text}</extra>",
        },
        *_coloured_tracks(time, places, (speeds - middle) / limit),
        {"x": time[last], "y": final, "mode": "text", "textposition": "middle right",
         "text": [f" {number}" for number in cast.numbers], "cliponaxis": False,
         "hoverinfo": "skip", "showlegend": False},
        _ends(time[[last[k] for k in collided]], [final[k] for k in collided]),
        {  # draws nothing: it brings the bar that says which colour is which speed
            "x": [None, None], "y": [None, None], "mode": "markers", "hoverinfo": "skip",
            "showlegend": False, "marker": {"color": scale, "coloraxis": "coloraxis"},
        },
    ]  # fmt: skip
    bar = {"title": {"text": SPEED.axis, "side": "right"}, "thickness": 12, "x": 1.06}
    seen = {"road": "on the road", "leader": "seen from leader",
            "observer": f"seen at {mean:.1f} m/s"}  # fmt: skip
    return style.composed(
        traces, height, f"platoon-time-space-{view}",
        {"x": style.titled(TIME.axis), "y": style.titled(f"Position {seen[view]} [m]")},
        hovermode="closest",
        coloraxis={"colorscale": TRACK_SCALE, "cmin": scale[0], "cmax": scale[1], "colorbar": bar},
    )  # fmt: skip


def _with_gaps(values: FloatArray) -> FloatArray:
    """The columns (K, V) one below the other, each followed by nan."""
    return np.append(values, np.full((1, values.shape[1]), np.nan), axis=0).T.ravel()


def _coloured_tracks(
    time: FloatArray, places: FloatArray, levels: FloatArray
) -> Iterator[style.Part]:
    """Lines of one colour each, which browsers draw far faster than a dot for each instant.

    Args:
        time: (K,) in s.
        places: (K, V) in m; nan where a vehicle drives no more.
        levels: (K, V) speeds between -1 and 1.
    """
    between = (levels[:-1] + levels[1:]) / 2  # nan where either end is
    known = np.isfinite(between)
    shade = np.where(known, ((np.nan_to_num(between) + 1) / 2 * (SHADES - 1)).round(), -1)
    for index, colour in enumerate(sample_colorscale(TRACK_SCALE, SHADES)):
        x, y = list[float](), list[float]()
        for k in range(places.shape[1]):
            for stretch in stretches(shade[:, k] == index):
                rows = slice(stretch.first, stretch.last + 2)
                x += [*time[rows].round(2).tolist(), np.nan]
                y += [*places[rows, k].round(2).tolist(), np.nan]
        yield {
            "x": np.array(x, np.float32), "y": np.array(y, np.float32), "mode": "lines",
            "hoverinfo": "skip", "showlegend": False, "line": {"color": colour, "width": 3},
        }  # fmt: skip


def amplitude_by_vehicle(run: PlatoonRun, cast: Cast, in_db: bool) -> go.Figure:
    """The amplitude at each vehicle: simulated, and for a sinusoid predicted by |H(jω)|.

    For a vehicle that does not drive to the end it is the largest deviation so far.
    """
    wave, driving = run.amplitudes, run.survivors
    measured = wave.measured if wave else run.largest_deviation
    places = np.arange(len(cast.names))
    unit, scaled = ("dB", _decibels) if in_db else ("m/s", np.asarray)
    traces = list[style.Part]()
    if wave:
        traces.append({
            "x": places, "y": scaled(wave.predicted), "name": "Predicted by |H(jω)|",
            "mode": "lines", "line": {"color": style.LEADER, "width": 2.5},
            "hovertemplate": f"predicted %{{y:.3f}} {unit}<extra></extra>",
        })  # fmt: skip
    for name, values, part, symbol in (
        ("Simulated", measured, slice(None, driving), "circle"),
        ("Largest deviation before the collision", run.largest_deviation, slice(driving, None),
         "circle-open"),
    ):  # fmt: skip
        if len(places[part]):
            traces.append({
                "x": places[part], "y": scaled(values)[part], "name": name,
                "text": cast.names[part], "line": {"color": style.LEADER, "width": 1.5},
                "mode": "markers" if wave or part.start else "lines+markers",
                "marker": {"size": 10, "color": cast.colours[part], "symbol": symbol,
                           "line": {"width": 2}},
                "hovertemplate": f"%{{text}}<br>{name.lower()} %{{y:.3f}} {unit}<extra></extra>",
            })  # fmt: skip
    what = "Amplitude of speed" if wave else "Largest speed deviation"
    vertical = style.titled(f"{what} [{'dB re leader' if in_db else unit}]")
    return style.composed(
        traces, 380, "platoon-amplitude", top=40, hovermode="closest", showlegend=len(traces) > 1,
        axes={"x": _vehicle_axis(cast),
              "y": vertical | {"rangemode": "normal" if in_db else "tozero"}},
        legend=style.LEGEND | {"y": 1.0},
    )  # fmt: skip


def _vehicle_axis(cast: Cast) -> style.Part:
    """An axis with a tick for each vehicle."""
    title = PLACE if cast.numbers[0] == "0" else "Vehicle (L = leader)"
    return style.titled(title) | {"tickvals": np.arange(len(cast.names)), "ticktext": cast.numbers}


def _decibels(values: FloatArray) -> FloatArray:
    """Relative to the leader's; nan where there is nothing to compare."""
    base = values[0] if values[0] > 0 else np.nan
    return np.asarray(20 * np.log10(np.maximum(values / base, 1e-12)))


def speed_map(run: PlatoonRun, cast: Cast) -> go.Figure:
    """Speeds relative to the first one, over time and along the platoon."""
    driven = run.valid
    rows = stretch(run)
    deviation = (driven.speeds[rows] - run.leader.speed).T
    limit = float(np.nanmax(np.abs(deviation))) or 1.0
    heat = {
        "type": "heatmap", "x": driven.time[rows].astype(np.float32),
        "y": np.arange(len(cast.names)), "z": deviation.astype(np.float32), "zmin": -limit,
        "zmax": limit, "colorscale": SPEED_SCALE, "ygap": 1,
        "colorbar": {"title": {"text": "Δ speed [m/s]", "side": "right"}, "thickness": 12},
        "hovertemplate": "vehicle %{y} at %{x:.0f} s: %{z:+.2f} m/s<extra></extra>",
    }  # fmt: skip
    axes = {"x": style.titled(TIME.axis), "y": _vehicle_axis(cast) | {"autorange": "reversed"}}
    return style.composed([heat], 380, "platoon-map", axes, hovermode="closest")


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
def paper_panels() -> tuple[tuple[str, go.Figure], ...]:
    """The paper's four panels: eight times one AstaZero vehicle behind a sinusoid of 1 m/s.

    Row by row, two a row, each with its title; those of a vehicle have the same axis of speed.
    """
    runs = [
        simulate_platoon(ASTAZERO.parameters[[k] * PANEL_FOLLOWERS], Sinusoid(frequency))
        for k, frequency in PANELS
    ]
    reach: dict[int, float] = {}
    for (k, _), run in zip(PANELS, runs, strict=True):
        reach[k] = max(reach.get(k, 0.0), 1.05 * float(run.largest_deviation.max()))
    panels = []
    for letter, (k, frequency), run in zip("acbd", PANELS, runs, strict=True):
        cast, driven = cast_of(ASTAZERO, [k] * PANEL_FOLLOWERS), run.trajectories
        lines = [
            line_of(driven.time, driven.speeds[:, vehicle], cast, vehicle, points=PANEL_POINTS)
            for vehicle in [*range(1, PANEL_FOLLOWERS + 1), 0]
        ]
        axes = {"y": {"range": [run.leader.speed - reach[k], run.leader.speed + reach[k]]}}
        figure = style.composed(lines, 300, f"platoon-panel-{letter}", axes, channels=(SPEED,))
        title = f"({letter}) {ASTAZERO.labels[k]} at {frequency:g} rad/s: {_fate(run)}"
        panels.append((title, figure))
    return tuple(panels)


def _fate(run: PlatoonRun) -> str:
    """Whether the wave grows or fades along the platoon; its amplitude at the last follower."""
    size = run.amplitudes
    if size is None or not size.periods:
        return "not settled"
    ratio = size.measured[-1] / size.measured[0]
    return f"{'grows' if ratio > 1 else 'fades'} to {size.measured[-1]:.2f} m/s"
