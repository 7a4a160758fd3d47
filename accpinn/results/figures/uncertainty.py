"""Uncertainty drawn under a figure: bands of the Bode magnitude, clouds of parameter sets."""

import numpy as np
import plotly.graph_objects as go
from plotly.colors import hex_to_rgb

from accpinn.inference.intervals import Uncertainty, gain_band
from accpinn.model.published import ParameterSet
from accpinn.results.figures.stability import CEILING, Plane, colours
from accpinn.units import FloatArray

BAND_OPACITY, DOT_OPACITY = 0.16, 0.35
CLOUD = 300
"""Draws shown of each vehicle; more only make the cloud darker."""
POINTS = 120
"""Of a band along the frequencies."""
LOWEST = -60.0
"""dB that stands for a gain of zero."""


def add_bands(figure: go.Figure, vehicles: ParameterSet, uncertainty: Uncertainty) -> go.Figure:
    """Under the curves of `figures.stability.bode`, where |H| lies at the uncertainty's level.

    A vehicle whose parameters are not determined has no band.
    """
    omega = np.asarray(figure.data[0].x, float)
    omega = np.geomspace(omega[0], omega[-1], POINTS)
    bands = []
    for k, colour in enumerate(colours(vehicles)):
        band = gain_band(uncertainty, k, omega)
        if np.isfinite(band.lower).all():
            around = np.concatenate([_db(band.lower), _db(band.upper)[::-1]])
            bands.append(
                go.Scatter(
                    x=np.concatenate([omega, omega[::-1]]), y=around, mode="none",
                    fill="toself", fillcolor=_pale(colour, BAND_OPACITY), hoverinfo="skip",
                    name=f"band {k}", showlegend=False,
                )
            )  # fmt: skip
    return _beneath(figure, bands)


def add_clouds(
    figure: go.Figure, vehicles: ParameterSet, uncertainty: Uncertainty, plane: Plane
) -> go.Figure:
    """Under the vehicles of `figures.stability.stability_map`, parameter sets consistent with the data.

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
                marker={"size": 3.5, "color": _pale(colour, DOT_OPACITY)}, hoverinfo="skip",
                name=f"cloud {k}", showlegend=False,
            )
        )  # fmt: skip
    return _beneath(figure, clouds)


def cloud_caption(figure: go.Figure, uncertainty: Uncertainty, plane: Plane) -> str:
    """What the clouds show, and the share of the draws that the map does not show."""
    known = uncertainty.draws.values[:, ~np.isnan(uncertainty.draws.alpha[0])]
    across = known[..., {"alpha": 0, "beta": 1}[plane]]
    right, top = figure.layout.xaxis.range[1], figure.layout.yaxis.range[1]
    no_gap_control = np.isnan(known[..., 2])
    beyond = ~no_gap_control & ((across > right) | (known[..., 2] > top))
    parts = [
        f"{100 * share:.0f} % {what}"
        for share, what in (
            (
                no_gap_control.mean() if known.size else 0.0,
                "have no gap control (α = 0), hence no τ",
            ),
            (beyond.mean() if known.size else 0.0, "lie beyond its edges"),
        )
        if share >= 0.005
    ]
    missing = f"; not on the map: {', '.join(parts)}" if parts else ""
    return f"Clouds: parameter sets consistent with the data{missing}."


def _beneath(figure: go.Figure, traces: list[go.Scatter]) -> go.Figure:
    """The traces first, so that everything else is drawn over them."""
    return go.Figure(data=[*traces, *figure.data], layout=figure.layout)


def _db(gain: FloatArray) -> FloatArray:
    level = 20 * np.log10(np.clip(gain, 10 ** (LOWEST / 20), None))
    return np.asarray(np.minimum(level, 2 * CEILING).round(3))


def _pale(colour: str, opacity: float) -> str:
    red, green, blue = hex_to_rgb(colour)
    return f"rgba({red}, {green}, {blue}, {opacity})"
