"""The gain measured from a recording as a figure, beside the model's Bode magnitude."""

import html
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from accpinn.inference.intervals import interval_ends
from accpinn.model.cthp import Parameters
from accpinn.results.figures.stability import (
    BAND_OPACITY,
    BAND_POINTS,
    CEILING,
    FLOOR,
    FREQUENCIES,
    LIMIT,
    SPAN,
    TICKS,
    decibels,
)
from accpinn.results.figures.style import LEADER, band, finished, panels
from accpinn.stability.frequency import response
from accpinn.stability.measured_gain import MeasuredGain


@dataclass(frozen=True, eq=False)
class Model:
    """Whose Bode magnitude stands beside the measured gain."""

    name: str
    parameters: Parameters
    """Of one vehicle."""
    draws: Parameters | None = None
    """(n,) posterior samples, for a band; None without."""


def measured_bode(
    found: MeasuredGain, name: str, colour: str, model: Model | None = None
) -> go.Figure:
    """The measured gain of one vehicle over the model's Bode magnitude, and its coherence below.

    Args:
        found: the measured gain.
        name: of the vehicle that was measured.
        colour: of the vehicle.
        model: whose curve is drawn as well.
    """
    figure = panels(0.7, 0.3, spacing=0.07)
    low, high = min(SPAN[0], float(found.omega[0])), max(SPAN[1], float(found.omega[-1]))
    if model:
        if model.draws is not None:
            omega = np.geomspace(low, high, BAND_POINTS)
            gains = np.abs(response(model.draws, omega))
            lower, upper = (decibels(end) for end in interval_ends(gains, found.level))
            figure.add_trace(band(omega, lower, upper, colour, BAND_OPACITY), row=1, col=1)
        omega = np.geomspace(low, high, FREQUENCIES)
        gain = np.abs(response(Parameters.stack([model.parameters]), omega))[0]
        figure.add_scatter(
            x=omega, y=decibels(gain), mode="lines", line={"color": colour, "width": 2.2},
            name=f"{html.escape(model.name)}, model", row=1, col=1,
            hovertemplate="%{y:.2f} dB at %{x:.3f} rad/s",
        )  # fmt: skip
    clear, levels = found.coherent, decibels(found.gain)
    bounds = [np.abs(decibels(end) - levels) for end in (found.upper, found.lower)]
    for part, words, look, symbol in (
        (clear, "measured", 1.0, "circle"),
        (~clear, "measured, not coherent", 0.35, "circle-open"),
    ):
        above, below = (np.minimum(end[part], CEILING) for end in bounds)
        bars = {"type": "data", "symmetric": False, "array": above, "arrayminus": below,
                "width": 0, "thickness": 1.2}  # fmt: skip
        shown = {"error_y": bars} if symbol == "circle" else {}
        marker = {"color": LEADER, "size": 7, "symbol": symbol}
        gain = f"{html.escape(name)}, {words}"
        for row, who, values, more in (
            (1, gain, levels, shown),
            (2, f"coherence, {gain}", found.coherence, {}),
        ):
            figure.add_scatter(
                x=found.omega[part], y=values[part], mode="markers", marker=marker, opacity=look,
                name=who, showlegend=row == 1, row=row, col=1, **more,
                hovertemplate="%{y:.2f} at %{x:.3f} rad/s",
            )  # fmt: skip
    figure.add_hline(y=0, line=LIMIT, row=1, col=1)
    figure.update_xaxes(type="log", range=np.log10([low, high]).tolist(), **TICKS)
    figure.update_xaxes(title_text="Frequency ω [rad/s]", row=2, col=1)
    top = float(np.max((levels + bounds[0])[clear], initial=3.0))
    figure.update_yaxes(title_text="Gain [dB]", range=[2 * FLOOR, min(top, CEILING) + 1.0],
                        row=1, col=1)  # fmt: skip
    figure.update_yaxes(title_text="Coherence", range=[0, 1.03], row=2, col=1)
    return finished(figure, 440, "measured-gain").update_layout(hovermode="closest")
