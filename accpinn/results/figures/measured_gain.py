"""The gain measured from a recording as a figure, beside the model's Bode magnitude."""

import html

import numpy as np
import plotly.graph_objects as go

from accpinn.model.cthp import Parameters
from accpinn.results.figures.stability import CEILING, FLOOR, FREQUENCIES, LIMIT, SPAN, TICKS
from accpinn.results.figures.style import LEADER, finished, panels
from accpinn.stability.frequency import response
from accpinn.stability.measured_gain import MeasuredGain
from accpinn.units import FloatArray


def measured_bode(
    found: MeasuredGain, name: str, colour: str, model: Parameters | None, model_name: str = ""
) -> go.Figure:
    """The measured gain of one vehicle over the model's Bode magnitude, and its coherence below.

    Args:
        found: the measured gain.
        name: of the vehicle that was measured.
        colour: of the vehicle.
        model: one set of parameters, for the model's curve.
        model_name: whose they are.
    """
    figure = panels(0.7, 0.3, spacing=0.07)
    low, high = min(SPAN[0], float(found.omega[0])), max(SPAN[1], float(found.omega[-1]))
    if model is not None:
        omega = np.geomspace(low, high, FREQUENCIES)
        gain = np.abs(response(Parameters.stack([model]), omega))[0]
        figure.add_scatter(
            x=omega, y=_db(gain), mode="lines", line={"color": colour, "width": 2.2},
            name=f"{html.escape(model_name)}, model", row=1, col=1,
            hovertemplate="%{y:.2f} dB at %{x:.3f} rad/s",
        )  # fmt: skip
    clear, decibels = found.coherent, _db(found.gain)
    ends = [np.abs(_db(end) - decibels) for end in (found.upper, found.lower)]
    for part, words, look, symbol in (
        (clear, "measured", 1.0, "circle"),
        (~clear, "measured, not coherent", 0.35, "circle-open"),
    ):
        above, below = (np.minimum(end[part], CEILING) for end in ends)
        bars = {"type": "data", "symmetric": False, "array": above, "arrayminus": below,
                "width": 0, "thickness": 1.2}  # fmt: skip
        shown = {"error_y": bars} if symbol == "circle" else {}
        marker = {"color": LEADER, "size": 7, "symbol": symbol}
        who = f"{html.escape(name)}, {words}"
        for row, values, more in ((1, decibels, shown), (2, found.coherence, {})):
            figure.add_scatter(
                x=found.omega[part], y=values[part], mode="markers", marker=marker, opacity=look,
                name=who, showlegend=row == 1, row=row, col=1, **more,
                hovertemplate="%{y:.2f} at %{x:.3f} rad/s",
            )  # fmt: skip
    figure.add_hline(y=0, line=LIMIT, row=1, col=1)
    figure.update_xaxes(
        type="log", range=np.log10([low, high]).tolist(), tickvals=TICKS,
        ticktext=[f"{tick:g}" for tick in TICKS],
    )  # fmt: skip
    figure.update_xaxes(title_text="Frequency ω [rad/s]", row=2, col=1)
    top = float(np.max((decibels + ends[0])[clear], initial=3.0))
    figure.update_yaxes(title_text="Gain [dB]", range=[2 * FLOOR, min(top, CEILING) + 1.0],
                        row=1, col=1)  # fmt: skip
    figure.update_yaxes(title_text="Coherence", range=[0, 1.03], row=2, col=1)
    return finished(figure, 440, "measured-gain").update_layout(hovermode="closest")


def _db(gain: FloatArray) -> FloatArray:
    return np.asarray(20 * np.log10(np.clip(gain, 1e-6, 1e6)))
