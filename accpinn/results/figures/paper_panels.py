"""The paper's figure of four simulated platoons."""

from functools import cache

import plotly.graph_objects as go

from accpinn.channels import SPEED
from accpinn.model.published import ASTAZERO
from accpinn.platoon.leader import Sinusoid
from accpinn.platoon.simulation import PlatoonRun, simulate_platoon
from accpinn.results.figures.platoon import cast_of, line_of
from accpinn.results.figures.style import composed

PANEL_POINTS = 500
"""Largest number of points a line of the paper's panels."""
PANEL_FOLLOWERS = 8
PANELS = ((2, 0.25), (2, 0.3), (3, 0.25), (3, 0.3))
"""AstaZero vehicle, by its index, and frequency in rad/s; row by row (a), (c), (b), (d)."""


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
    return tuple(
        (
            f"({letter}) {ASTAZERO.labels[k]} at {frequency:g} rad/s: {_fate(run)}",
            _panel(run, k, letter, reach[k]),
        )
        for letter, (k, frequency), run in zip("acbd", PANELS, runs, strict=True)
    )


def _panel(run: PlatoonRun, k: int, letter: str, reach: float) -> go.Figure:
    cast, driven = cast_of(ASTAZERO, [k] * PANEL_FOLLOWERS), run.trajectories
    lines = [
        line_of(driven.time, driven.speeds[:, vehicle], cast, vehicle, points=PANEL_POINTS)
        for vehicle in [*range(1, PANEL_FOLLOWERS + 1), 0]
    ]
    speed = run.leader.speed
    axes = {"y": {"range": [speed - reach, speed + reach]}}
    return composed(lines, 300, f"platoon-panel-{letter}", axes, channels=(SPEED,))


def _fate(run: PlatoonRun) -> str:
    """Whether the wave grows or fades along the platoon; its amplitude at the last follower."""
    size = run.amplitudes
    if size is None or not size.periods:
        return "not settled"
    ratio = size.measured[-1] / size.measured[0]
    return f"{'grows' if ratio > 1 else 'fades'} to {size.measured[-1]:.2f} m/s"
