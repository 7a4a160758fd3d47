"""A simulated platoon as figures: profiles, amplitudes, map of speeds, animation, the paper's."""

import colorsys
import html
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.colors import hex_to_rgb

from accpinn.channels import GAP, SPEED, TIME
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.platoon.leader import Recorded, Sinusoid
from accpinn.platoon.simulation import PlatoonRun, simulate_platoon
from accpinn.results.figures.stability import colours
from accpinn.results.figures.style import (
    CLEAR,
    FOLLOWERS,
    LEADER,
    LEGEND,
    finished,
    label_axes,
    panels,
    thinned,
)
from accpinn.units import FloatArray, Metres, Seconds

CLOSE: Metres = 5.0
"""Gaps below this make the figure show where zero is."""
POINTS = 1000
"""Drawn per line of a profile."""
COLUMNS = 240
"""Instants of the map of speeds."""
STRIPES = 8
"""Periods of a sinusoid on it; with more the wave's slope is not seen."""
CAR_LENGTH: Metres = 4.5
"""Between the fronts of two cars lie the gap and this; the model has gaps only."""
FRAMES = 60
FRAME_MS = 90
PERIODS = 2
"""Of a sinusoid that are shown."""
WATCHED: Seconds = 120.0
"""What is shown of any other planned disturbance."""
PANEL_POINTS = 500
"""Drawn per line of the paper's panels."""
PANEL_FOLLOWERS = 8
PANELS = ((2, 0.25), (2, 0.3), (3, 0.25), (3, 0.3))
"""AstaZero vehicle, by its index, and frequency in rad/s; row by row (a), (c), (b), (d)."""
PLACE = "Follower (0 = leader)"
MEANINGLESS = "rgba(216, 102, 12, 0.13)"
SLOWER, FASTER = FOLLOWERS[1], FOLLOWERS[0]
SPEED_SCALE = [[0.0, SLOWER], [0.5, "rgba(140, 150, 162, 0.25)"], [1.0, FASTER]]
LIGHTEST, DARKEST = 0.70, 0.42
"""Lightness of the shades of one colour, between what white and what dark pages swallow."""
SOFTENED = 0.8
"""Saturation of the shades, relative to the colour's."""


@dataclass(frozen=True)
class Cast:
    """Labels and colours of a leader and its M followers, M+1 each."""

    labels: tuple[str, ...]
    colours: tuple[str, ...]

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
    names, paints = ["Leader"], [LEADER]
    for place, k in enumerate(order, 1):
        names.append(vehicles.labels[k] if in_order else follower_name(vehicles, k, place))
        share = seen[k] / (total[k] - 1) if total[k] > 1 else None
        paints.append(_shade(colours(vehicles)[k], share))
        seen[k] += 1
    return Cast(tuple(names), tuple(paints))


def is_in_order(vehicles: ParameterSet, order: Sequence[int]) -> bool:
    """Whether each vehicle drives once, in its own place."""
    return [*order] == [*range(len(vehicles))]


def follower_name(vehicles: ParameterSet, k: int, place: int) -> str:
    """The label of the follower at that place."""
    return f"Follower {place}: {vehicles.labels[k]}"


def _shade(colour: str, share: float | None) -> str:
    """From light to dark as ``share`` goes from 0 to 1; the colour itself without one."""
    if share is None:
        return colour
    hue, _, saturation = colorsys.rgb_to_hls(*(part / 255 for part in hex_to_rgb(colour)))
    lightness = LIGHTEST + share * (DARKEST - LIGHTEST)
    rgb = colorsys.hls_to_rgb(hue, lightness, SOFTENED * saturation)
    return "#" + "".join(f"{round(255 * part):02x}" for part in rgb)


def profiles(run: PlatoonRun, cast: Cast) -> go.Figure:
    """Speeds of all vehicles, and the gaps of the followers, over time."""
    driven = run.trajectories
    figure = panels(0.58, 0.42, spacing=0.06)
    for k in [*range(1, len(cast.names)), 0]:  # the leader last, on top
        kept = slice(run.meaningful if k else None)  # the leader's drive is given
        _line(figure, driven.time[kept], driven.speeds[kept, k], cast, k, 1)
        if k:
            _line(figure, driven.time[kept], driven.gaps[kept, k - 1], cast, k, 2)
    if run.minimum_gap.min() < CLOSE:
        figure.add_hline(y=0, line={"color": SLOWER, "width": 1.5, "dash": "dash"}, row=2, col=1)
    if run.collisions:
        _mark_collision(figure, run)
    label_axes(figure, (SPEED, GAP))
    return finished(figure, 540, "platoon-profiles")


def _mark_collision(figure: go.Figure, run: PlatoonRun) -> None:
    """What comes after the first one has no meaning: it is shaded, and not drawn."""
    start, end = run.collisions[0].time, float(run.trajectories.time[-1])
    figure.add_vrect(x0=start, x1=end, fillcolor=MEANINGLESS, line_width=0, row="all", col=1)
    side = "left" if start < 0.8 * end else "right"
    figure.add_annotation(  # within the axes, where no legend above them can be in the way
        text="collision", x=start, y=1, xref="x", yref="y domain", xanchor=side, yanchor="top",
        showarrow=False,
    )  # fmt: skip


def _line(
    figure: go.Figure, time: FloatArray, values: FloatArray, cast: Cast, k: int, row: int,
    points: int = POINTS,
) -> None:  # fmt: skip
    x, y = thinned(time, values, points)
    figure.add_scatter(
        x=x.astype(np.float32), y=y.astype(np.float32), name=cast.names[k], mode="lines",
        line={"color": cast.colours[k], "width": 1.5 if k else 2.5},
        hovertemplate="%{y:.2f}", showlegend=row == 1, legendrank=k, row=row, col=1,
    )  # fmt: skip


def amplitude_by_vehicle(run: PlatoonRun, cast: Cast, in_db: bool) -> go.Figure:
    """The amplitude at each vehicle: simulated, and for a sinusoid predicted by |H(jω)|."""
    wave = run.amplitudes
    # A sinusoid is measured at the end of the run, which a collision leaves without meaning.
    measured = wave.measured if wave and not run.collisions else run.largest_deviation
    cut = wave and run.collisions
    simulated = "Largest deviation before the collision" if cut else "Simulated"
    figure, places = go.Figure(), np.arange(len(cast.names))
    unit, scaled = ("dB", _decibels) if in_db else ("m/s", np.asarray)
    if wave:
        figure.add_scatter(
            x=places, y=scaled(wave.predicted), name="Predicted by |H(jω)|", mode="lines",
            line={"color": LEADER, "width": 2.5},
            hovertemplate=f"predicted %{{y:.3f}} {unit}<extra></extra>",
        )  # fmt: skip
    figure.add_scatter(
        x=places, y=scaled(measured), name=simulated,
        mode="markers" if wave else "lines+markers", text=cast.names,
        marker={"size": 10, "color": cast.colours}, line={"color": LEADER, "width": 1.5},
        hovertemplate=f"%{{text}}<br>{simulated.lower()} %{{y:.3f}} {unit}<extra></extra>",
    )  # fmt: skip
    what = "Amplitude of speed" if wave else "Largest speed deviation"
    figure.update_yaxes(title_text=f"{what} [{'dB re leader' if in_db else unit}]",
                        rangemode="normal" if in_db else "tozero")  # fmt: skip
    figure.update_xaxes(title_text=PLACE, dtick=1 if len(places) < 14 else 2)
    figure = finished(figure, 380, "platoon-amplitude")
    return figure.update_layout(
        hovermode="closest", showlegend=wave is not None, legend=LEGEND | {"y": 1.0}, margin_t=40
    )


def _decibels(values: FloatArray) -> FloatArray:
    """Relative to the leader's; nan where there is nothing to compare."""
    base = values[0] if values[0] > 0 else np.nan
    return np.asarray(20 * np.log10(np.maximum(values / base, 1e-12)))


def speed_map(run: PlatoonRun, cast: Cast) -> go.Figure:
    """Speeds relative to the first one, over time and along the platoon."""
    driven = run.trajectories
    rows = stretch(run)
    deviation = (driven.speeds[rows] - run.leader.speed).T
    limit = float(np.abs(deviation).max()) or 1.0
    figure = go.Figure(
        go.Heatmap(
            x=driven.time[rows].astype(np.float32), y=np.arange(len(cast.names)),
            z=deviation.astype(np.float32), zmin=-limit, zmax=limit, colorscale=SPEED_SCALE,
            colorbar={"title": {"text": "Δ speed [m/s]", "side": "right"}, "thickness": 12},
            ygap=1, hovertemplate="vehicle %{y} at %{x:.0f} s: %{z:+.2f} m/s<extra></extra>",
        )
    )  # fmt: skip
    figure.update_xaxes(title_text=TIME.axis)
    figure.update_yaxes(title_text=PLACE, autorange="reversed",
                        dtick=1 if len(cast.names) < 14 else 2)  # fmt: skip
    return finished(figure, 380, "platoon-map").update_layout(hovermode="closest")


def stretch(run: PlatoonRun) -> NDArray[np.intp]:
    """The samples of the map: from just before the disturbance on; of a sinusoid, few periods."""
    leader = run.leader
    if not isinstance(leader, Sinusoid):
        return _samples(run, 0.0, np.inf, COLUMNS)
    start = max(0.0, leader.settle - leader.period / 2)
    return _samples(run, start, STRIPES * leader.period, COLUMNS)


def watched(run: PlatoonRun) -> NDArray[np.intp]:
    """The samples that become frames: the last periods, or what follows the disturbance."""
    leader = run.leader
    if isinstance(leader, Recorded):
        return _samples(run, 0.0, np.inf, FRAMES)
    if isinstance(leader, Sinusoid):
        end = float(run.trajectories.time[run.meaningful - 1])
        return _samples(run, max(0.0, end - PERIODS * leader.period), np.inf, FRAMES)
    return _samples(run, max(0.0, leader.settle - 5.0), WATCHED, FRAMES)


def _samples(run: PlatoonRun, start: Seconds, duration: Seconds, count: int) -> NDArray[np.intp]:
    """At most ``count``, evenly spread, none after a collision, as these have no meaning."""
    time = run.trajectories.time[: run.meaningful]
    start = min(max(start, float(time[0])), float(time[-1]))
    instants = np.linspace(start, min(float(time[-1]), start + duration), count)
    return np.unique(np.clip(np.searchsorted(time, instants - 1e-9), 0, len(time) - 1))


def animation(run: PlatoonRun, cast: Cast) -> go.Figure:
    """The cars on the road, seen from the leader, and their speeds: an animation with a slider."""
    driven = run.trajectories
    rows = watched(run)
    behind = np.zeros((len(rows), len(cast.names)))
    behind[:, 1:] = -np.cumsum(driven.gaps[rows] + CAR_LENGTH, axis=1)
    speeds = driven.speeds[rows]
    moments = [f"{driven.time[row]:.1f}" for row in rows]
    pictures = [  # rounded to what a screen shows
        ({"x": x, "y": [0.0] * len(x)}, {"x": x, "y": y})
        for x, y in zip(behind.round(2).tolist(), speeds.round(3).tolist(), strict=True)
    ]
    figure = panels(0.2, 0.8, spacing=0.04)
    look = {"color": cast.colours, "line": {"width": 0}}
    road, track = pictures[0]
    figure.add_scatter(
        **road, mode="markers", marker={**look, "symbol": "square", "size": 13}, text=cast.names,
        hovertemplate="%{text}<br>%{x:.1f} m<extra></extra>", row=1, col=1,
    )  # fmt: skip
    figure.add_scatter(
        **track, mode="lines+markers", line={"color": LEADER, "width": 1.2}, text=cast.names,
        marker={**look, "size": 10}, hovertemplate="%{text}<br>%{y:.2f} m/s<extra></extra>",
        row=2, col=1,
    )  # fmt: skip
    for name, colour in zip(cast.names, cast.colours, strict=True):  # for `with_legend`
        figure.add_scatter(
            x=[None], y=[None], mode="markers", name=name, hoverinfo="skip",
            marker={"symbol": "square", "size": 13, "color": colour}, row=1, col=1,
        )  # fmt: skip
    figure.frames = [
        go.Frame(name=moment, data=list(picture), traces=[0, 1])
        for moment, picture in zip(moments, pictures, strict=True)
    ]
    _ranges(figure, behind, speeds)
    figure = finished(figure, 490, "platoon-wave")
    return figure.update_layout(
        hovermode="closest", margin_b=156, updatemenus=[_buttons()], sliders=[_slider(moments)]
    )


def _ranges(figure: go.Figure, behind: FloatArray, speeds: FloatArray) -> None:
    """Axes that stand still while the cars move."""
    margin = 0.06 * float(np.ptp(behind)) + 2.0
    figure.update_xaxes(range=[float(behind.min()) - margin, float(behind.max()) + margin])
    low, high = float(speeds.min()), float(speeds.max())
    rim = 0.1 * (high - low) + 0.05
    figure.update_yaxes(visible=False, range=[-1, 1], row=1, col=1)
    figure.add_hline(y=-0.55, line={"color": LEADER, "width": 1}, row=1, col=1)
    figure.update_yaxes(title_text=SPEED.axis, range=[low - rim, high + rim], row=2, col=1)
    title = "Position behind the leader [m], driving to the right"
    figure.update_xaxes(title_text=title, row=2, col=1)


def _motion(duration: int) -> dict[str, Any]:
    return {
        "mode": "immediate", "fromcurrent": True, "frame": {"duration": duration, "redraw": False},
        "transition": {"duration": duration, "easing": "linear"},
    }  # fmt: skip


def _buttons() -> dict[str, Any]:
    play = {"label": "▶ Play", "method": "animate", "args": [None, _motion(FRAME_MS)]}
    pause = {"label": "Pause", "method": "animate", "args": [[None], _motion(0)]}
    return {
        "type": "buttons", "direction": "left", "buttons": [play, pause], "showactive": False,
        "x": 0, "xanchor": "left", "y": 0, "yanchor": "top", "pad": {"t": 112, "r": 8},
        "bgcolor": "rgba(128, 140, 155, 0.18)", "borderwidth": 0,
    }  # fmt: skip


def _slider(moments: Sequence[str]) -> dict[str, Any]:
    still = _motion(0)
    steps = [{"label": one, "method": "animate", "args": [[one], still]} for one in moments]
    return {
        "steps": steps, "x": 0, "len": 1, "y": 0, "yanchor": "top", "pad": {"t": 58},
        "ticklen": 0, "minorticklen": 0, "bordercolor": CLEAR,
        "bgcolor": "rgba(128, 140, 155, 0.35)", "font": {"color": CLEAR},
        "currentvalue": {"prefix": "t = ", "suffix": " s", "xanchor": "right",
                         "font": {"color": LEADER}},
    }  # fmt: skip


@dataclass(frozen=True)
class Panel:
    """One of the paper's four."""

    title: str
    figure: go.Figure


def paper_panels() -> tuple[Panel, ...]:
    """The paper's four panels: eight times one AstaZero vehicle behind a sinusoid of 1 m/s.

    Row by row, two a row; those of a vehicle have the same axis of speed.
    """
    runs = [
        simulate_platoon(ASTAZERO.parameters[[k] * PANEL_FOLLOWERS], Sinusoid(frequency))
        for k, frequency in PANELS
    ]
    reach: dict[int, float] = {}
    for (k, _), run in zip(PANELS, runs, strict=True):
        reach[k] = max(reach.get(k, 0.0), 1.05 * float(run.largest_deviation.max()))
    return tuple(
        Panel(
            f"({letter}) {ASTAZERO.labels[k]} at {frequency:g} rad/s: {_fate(run)}",
            _panel(run, k, letter, reach[k]),
        )
        for letter, (k, frequency), run in zip("acbd", PANELS, runs, strict=True)
    )


def _panel(run: PlatoonRun, k: int, letter: str, reach: float) -> go.Figure:
    figure = panels(1)
    cast, driven = cast_of(ASTAZERO, [k] * PANEL_FOLLOWERS), run.trajectories
    for who in [*range(1, PANEL_FOLLOWERS + 1), 0]:
        _line(figure, driven.time, driven.speeds[:, who], cast, who, 1, PANEL_POINTS)
    speed = run.leader.speed
    figure.update_xaxes(title_text=TIME.axis)
    figure.update_yaxes(title_text=SPEED.axis, range=[speed - reach, speed + reach])
    return finished(figure, 300, f"platoon-panel-{letter}")


def _fate(run: PlatoonRun) -> str:
    """Whether the wave grows or fades along the platoon; its amplitude at the last follower."""
    size = run.amplitudes
    if size is None or not size.periods:
        return "not settled"
    ratio = size.measured[-1] / size.measured[0]
    return f"{'grows' if ratio > 1 else 'fades'} to {size.measured[-1]:.2f} m/s"
