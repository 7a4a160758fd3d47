"""A simulated platoon as plotly figures: profiles, amplitudes, speeds at a glance, the paper's."""

import colorsys
import html
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from accpinn.channels import GAP, SPEED, TIME
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.platoon.leader import Sinusoid
from accpinn.platoon.simulation import PlatoonRun, simulate_platoon
from accpinn.results.figures.stability import colours
from accpinn.results.figures.style import FOLLOWERS, LEADER, finished, thinned
from accpinn.units import FloatArray, Metres

CLOSE: Metres = 5.0
"""Gaps below this make the figure show where zero is."""
POINTS = 1000
"""Drawn per line of a profile."""
COLUMNS = 240
"""Instants of the map of speeds."""
STRIPES = 8
"""Periods of a sinusoid on it: more would hide how the wave slants."""
PANEL_POINTS = 500
"""Drawn per line of the paper's panels."""
PANEL_FOLLOWERS = 8
PANELS = ((2, 0.25), (2, 0.3), (3, 0.25), (3, 0.3))
"""AstaZero vehicle, by its index, and frequency in rad/s; row by row (a), (c), (b), (d)."""
MEANINGLESS = "rgba(216, 102, 12, 0.13)"
SLOWER, FASTER = FOLLOWERS[1], FOLLOWERS[0]
SPEED_SCALE = [[0.0, SLOWER], [0.5, "rgba(140, 150, 162, 0.25)"], [1.0, FASTER]]
LIGHTEST, DARKEST = 0.70, 0.42
"""Lightness of the shades of one colour, between what white and what dark pages swallow."""
SOFTENED = 0.8
"""Saturation of the shades, relative to the colour's."""


@dataclass(frozen=True)
class Cast:
    """Names and colours of a leader and its M followers, M+1 each."""

    names: tuple[str, ...]
    """Ready for plotly, which reads a little HTML."""
    colours: tuple[str, ...]


def cast_of(vehicles: ParameterSet, order: Sequence[int]) -> Cast:
    """Followers by their indices in ``vehicles``; repeated ones get shades of one colour."""
    total, seen = Counter(order), Counter[int]()
    names, paints = ["Leader"], [LEADER]
    for place, k in enumerate(order, 1):
        names.append(follower_name(vehicles, k, place))
        share = seen[k] / (total[k] - 1) if total[k] > 1 else None
        paints.append(_shade(colours(vehicles)[k], share))
        seen[k] += 1
    return Cast(tuple(html.escape(name) for name in names), tuple(paints))


def follower_name(vehicles: ParameterSet, k: int, place: int) -> str:
    """Who drives at that place behind the leader; the recording's numbers would not fit here."""
    return f"Follower {place}: {vehicles.names[k]}"


def _shade(colour: str, share: float | None) -> str:
    """From light to dark as ``share`` goes from 0 to 1; the colour itself without one."""
    if share is None:
        return colour
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    hue, _, saturation = colorsys.rgb_to_hls(red, green, blue)
    lightness = LIGHTEST + share * (DARKEST - LIGHTEST)
    rgb = colorsys.hls_to_rgb(hue, lightness, SOFTENED * saturation)
    return "#" + "".join(f"{round(255 * part):02x}" for part in rgb)


def profiles(run: PlatoonRun, cast: Cast) -> go.Figure:
    """Speeds of all vehicles, and the gaps of the followers, over time."""
    driven = run.trajectories
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.58, 0.42], vertical_spacing=0.06
    )
    for k in _back_to_front(len(cast.names)):
        kept = slice(run.meaningful if k else None)  # the leader's drive is given
        _line(figure, driven.time[kept], driven.speeds[kept, k], cast, k, 1)
        if k:
            _line(figure, driven.time[kept], driven.gaps[kept, k - 1], cast, k, 2)
    if run.minimum_gap.min() < CLOSE:
        figure.add_hline(y=0, line={"color": SLOWER, "width": 1.5, "dash": "dash"}, row=2, col=1)
    if run.collisions:
        _mark_collision(figure, run)
    figure.update_yaxes(title_text=SPEED.axis, row=1, col=1)
    figure.update_yaxes(title_text=GAP.axis, row=2, col=1)
    figure.update_xaxes(title_text=TIME.axis, row=2, col=1)
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


def _back_to_front(vehicles: int) -> list[int]:
    """Who is drawn in which order: the leader last, on top."""
    return [*range(1, vehicles), 0]


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
    """How large the disturbance is at each vehicle: simulated, and predicted where H tells."""
    wave = run.amplitudes
    # A sinusoid is measured at the end of the run, which a collision leaves without meaning.
    measured = wave.measured if wave and not run.collisions else run.largest_deviation
    simulated = "Simulated"
    if wave and run.collisions:
        simulated = "Largest deviation before the collision"
    figure = go.Figure()
    places = np.arange(len(cast.names))
    scale = _decibels if in_db else _as_is
    unit = "dB" if in_db else "m/s"
    if wave:
        figure.add_scatter(
            x=places, y=scale(wave.predicted), name="Predicted by |H(jω)|", mode="lines",
            line={"color": LEADER, "width": 2.5},
            hovertemplate=f"predicted %{{y:.3f}} {unit}<extra></extra>",
        )  # fmt: skip
    figure.add_scatter(
        x=places, y=scale(measured), name=simulated, mode="markers" if wave else "lines+markers",
        text=cast.names, marker={"size": 10, "color": cast.colours},
        line={"color": LEADER, "width": 1.5},
        hovertemplate=f"%{{text}}<br>{simulated.lower()} %{{y:.3f}} {unit}<extra></extra>",
    )  # fmt: skip
    what = "Amplitude of speed" if wave else "Largest speed deviation"
    figure.update_yaxes(title_text=f"{what} [{'dB re leader' if in_db else unit}]",
                        rangemode="normal" if in_db else "tozero")  # fmt: skip
    figure.update_xaxes(title_text="Follower (0 = leader)", dtick=1 if len(places) < 14 else 2)
    figure = finished(figure, 380, "platoon-amplitude")
    legend = {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom"}
    return figure.update_layout(
        hovermode="closest", showlegend=wave is not None, legend=legend, margin_t=40
    )


def _as_is(values: FloatArray) -> FloatArray:
    return values


def _decibels(values: FloatArray) -> FloatArray:
    """Relative to the leader's; nan where there is nothing to compare."""
    base = values[0] if values[0] > 0 else np.nan
    return np.asarray(20 * np.log10(np.maximum(values / base, 1e-12)))


def speed_map(run: PlatoonRun, cast: Cast) -> go.Figure:
    """Who is faster or slower than the platoon's first speed, when: the wave as stripes."""
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
    figure.update_yaxes(title_text="Follower (0 = leader)", autorange="reversed",
                        dtick=1 if len(cast.names) < 14 else 2)  # fmt: skip
    return finished(figure, 380, "platoon-map").update_layout(hovermode="closest")


def stretch(run: PlatoonRun) -> NDArray[np.intp]:
    """Samples from just before the disturbance on, and of a sinusoid no more than can be told.

    Those after a collision have no meaning.
    """
    time, leader = run.trajectories.time[: run.meaningful], run.leader
    start, end = 0.0, float(time[-1])
    if isinstance(leader, Sinusoid):
        start = min(max(0.0, leader.settle - leader.period / 2), end)
        end = min(end, start + STRIPES * leader.period)
    instants = np.linspace(start, end, COLUMNS)
    return np.unique(np.clip(np.searchsorted(time, instants - 1e-9), 0, len(time) - 1))


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
    reach = {
        k: max(r.largest_deviation.max() for (j, _), r in zip(PANELS, runs, strict=True) if j == k)
        for k, _ in PANELS
    }
    return tuple(
        Panel(
            f"({letter}) {ASTAZERO.labels[k]} at {frequency:g} rad/s: {_fate(run)}",
            _panel(run, k, letter, 1.05 * reach[k]),
        )
        for letter, (k, frequency), run in zip("acbd", PANELS, runs, strict=True)
    )


def _panel(run: PlatoonRun, k: int, letter: str, reach: float) -> go.Figure:
    figure = make_subplots(rows=1, cols=1)
    cast, driven = cast_of(ASTAZERO, [k] * PANEL_FOLLOWERS), run.trajectories
    for who in _back_to_front(PANEL_FOLLOWERS + 1):
        _line(figure, driven.time, driven.speeds[:, who], cast, who, 1, PANEL_POINTS)
    speed = run.leader.speed
    figure.update_xaxes(title_text=TIME.axis)
    figure.update_yaxes(title_text=SPEED.axis, range=[speed - reach, speed + reach])
    return finished(figure, 300, f"platoon-panel-{letter}")


def _fate(run: PlatoonRun) -> str:
    """What has become of the wave at the last follower."""
    size = run.amplitudes
    if size is None or not size.periods:
        return "not settled"
    ratio = size.measured[-1] / size.measured[0]
    return f"{'grows' if ratio > 1 else 'fades'} to {size.measured[-1]:.2f} m/s"
