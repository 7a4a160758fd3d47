"""Uncertainty drawn under a figure: bands of the Bode magnitude, clouds of parameter sets."""

import numpy as np
import plotly.graph_objects as go

from accpinn.inference.intervals import Uncertainty, gain_band
from accpinn.model.published import ParameterSet
from accpinn.results.figures.stability import CEILING, Plane, colours
from accpinn.results.figures.style import band, translucent
from accpinn.units import FloatArray

BAND_OPACITY, DOT_OPACITY = 0.16, 0.35
CLOUD = 300
"""Draws shown of each vehicle; more only make the cloud darker."""
POINTS = 120
"""Of a band along the frequencies."""
LOWEST = -60.0
"""dB that stands for a gain of zero."""


def add_bands(figure: go.Figure, vehicles: ParameterSet, uncertainty: Uncertainty) -> go.Figure:
    """The interval of |H| at the uncertainty's level, under the curves of `bode`.

    A vehicle whose parameters are not determined has no band.
    """
    omega = np.asarray(figure.data[0].x, float)
    omega = np.geomspace(omega[0], omega[-1], POINTS)
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
    no_gap_control = np.isnan(known[..., 2])
    beyond = ~no_gap_control & ((across > right) | (known[..., 2] > top))
    shares = {
        "have no gap control (α = 0), hence no τ": no_gap_control,
        "lie beyond its edges": beyond,
    }
    parts = [
        f"{100 * mask.mean():.0f} % {what}"
        for what, mask in shares.items()
        if known.size and mask.mean() >= 0.005
    ]
    missing = f"; not on the map: {', '.join(parts)}" if parts else ""
    return f"Clouds: parameter sets consistent with the data{missing}."


def _beneath(figure: go.Figure, traces: list[go.Scatter]) -> go.Figure:
    """The traces first, so that everything else is drawn over them."""
    return go.Figure(data=[*traces, *figure.data], layout=figure.layout)


def _db(gain: FloatArray) -> FloatArray:
    level = 20 * np.log10(np.clip(gain, 10 ** (LOWEST / 20), None))
    return np.asarray(np.minimum(level, 2 * CEILING).round(3))
