"""The gain measured from a recording as a figure, beside the model's Bode magnitude."""

import html
from collections.abc import Iterator
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
from accpinn.results.figures.style import (
    LEADER,
    Part,
    across,
    axes_of,
    band,
    composed,
    stack,
    titled,
)
from accpinn.stability.frequency import response
from accpinn.stability.measured_gain import MeasuredGain


@dataclass(frozen=True, eq=False)
class Model:
    """The vehicle whose Bode magnitude stands beside the measured gain."""

    name: str
    parameters: Parameters
    """One vehicle's."""
    draws: Parameters | None = None
    """(n,) posterior samples, for a band; None without."""


def measured_bode(
    measured: MeasuredGain, name: str, colour: str, model: Model | None = None
) -> go.Figure:
    """The measured gain of one vehicle over the model's Bode magnitude, and its coherence below.

    Args:
        measured: the measured gain.
        name: of the vehicle that was measured.
        colour: of the vehicle.
        model: whose curve is drawn as well.
    """
    low, high = min(SPAN[0], float(measured.omega[0])), max(SPAN[1], float(measured.omega[-1]))
    traces = [*_model_curve(model, low, high, colour, measured.level)] if model else []
    levels = decibels(measured.gain)
    bounds = [np.abs(decibels(end) - levels) for end in (measured.upper, measured.lower)]
    for part, words, opacity, symbol in (
        (measured.coherent, "measured", 1.0, "circle"),
        (~measured.coherent, "measured, not coherent", 0.35, "circle-open"),
    ):
        above, below = (np.minimum(end[part], CEILING) for end in bounds)
        bars = {"type": "data", "symmetric": False, "array": above, "arrayminus": below,
                "width": 0, "thickness": 1.2}  # fmt: skip
        gain = f"{html.escape(name)}, {words}"
        points = {
            "x": measured.omega[part], "mode": "markers", "opacity": opacity,
            "marker": {"color": LEADER, "size": 7, "symbol": symbol},
            "hovertemplate": "%{y:.2f} at %{x:.3f} rad/s",
        }  # fmt: skip
        traces += [
            points | axes_of(1) | {"y": levels[part], "name": gain, "showlegend": True}
            | ({"error_y": bars} if symbol == "circle" else {}),
            points | axes_of(2) | {"y": measured.coherence[part], "name": f"coherence, {gain}",
                                   "showlegend": False},
        ]  # fmt: skip
    top = float(np.max((levels + bounds[0])[measured.coherent], initial=3.0))
    every = {"x": {"type": "log", "range": np.log10([low, high]).tolist(), **TICKS}}
    axes = {
        "x2": titled("Frequency ω [rad/s]"),
        "y": titled("Gain [dB]") | {"range": [2 * FLOOR, min(top, CEILING) + 1.0]},
        "y2": titled("Coherence") | {"range": [0, 1.03]},
    }
    return composed(
        traces, 440, "measured-gain", axes, every, stack(0.7, 0.3, spacing=0.07),
        hovermode="closest", shapes=[across("y", 0, line=LIMIT)],
    )  # fmt: skip


def _model_curve(
    model: Model, low: float, high: float, colour: str, at_level: float
) -> Iterator[Part]:
    """The model's Bode magnitude between two frequencies in rad/s, over its band."""
    if model.draws is not None:
        omega = np.geomspace(low, high, BAND_POINTS)
        gains = np.abs(response(model.draws, omega))
        lower, upper = (decibels(end) for end in interval_ends(gains, at_level))
        yield band(omega, lower, upper, colour, BAND_OPACITY, panel=1)
    omega = np.geomspace(low, high, FREQUENCIES)
    gain = np.abs(response(Parameters.stack([model.parameters]), omega))[0]
    yield {
        "x": omega, "y": decibels(gain), "mode": "lines", "line": {"color": colour, "width": 2.2},
        "name": f"{html.escape(model.name)}, model", **axes_of(1),
        "hovertemplate": "%{y:.2f} dB at %{x:.3f} rad/s",
    }  # fmt: skip
