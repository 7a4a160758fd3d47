"""Small pictures without axes, to choose a recording or a set of parameters by."""

import numpy as np
import plotly.graph_objects as go

from accpinn.model.published import ParameterSet
from accpinn.results.figures.stability import LIMIT, SPAN, colours
from accpinn.results.figures.style import finished, thinned, vehicle_colours
from accpinn.segment.segment import Segment
from accpinn.stability.frequency import response

HEIGHT = 110
POINTS = 150
"""Of each curve: enough for a picture of two hundred pixels."""
LEAST_PEAK = 4.0
"""dB; pictures of calm vehicles have the same axis."""


def of_speeds(segment: Segment) -> go.Figure:
    """The speeds of a segment's vehicles over time."""
    figure = go.Figure()
    colours_of = vehicle_colours(segment.vehicles)
    for colour, speeds in zip(colours_of, segment.measured_speeds.T, strict=True):
        time, values = thinned(segment.time, speeds, POINTS)
        line = {"color": colour, "width": 1.4}
        figure.add_scatter(x=time, y=values, line=line, mode="lines", hoverinfo="skip")
    return _bare(figure)


def of_gains(vehicles: ParameterSet) -> go.Figure:
    """The Bode magnitudes in dB of followers; above the line a disturbance is amplified."""
    omega = np.geomspace(*SPAN, POINTS // 2)
    gains = 20 * np.log10(np.abs(response(vehicles.parameters, omega)))
    figure = go.Figure()
    for gain, colour in zip(gains, colours(vehicles), strict=True):
        line = {"color": colour, "width": 1.6}
        figure.add_scatter(x=omega, y=gain, line=line, mode="lines", hoverinfo="skip")
    figure.add_hline(y=0, line=LIMIT, layer="below")
    figure.update_xaxes(type="log")
    figure.update_yaxes(range=[-6, max(LEAST_PEAK, 1.1 * float(gains.max()))])
    return _bare(figure)


def _bare(figure: go.Figure) -> go.Figure:
    figure = finished(figure, HEIGHT, "thumbnail")
    figure.update_xaxes(visible=False)
    figure.update_yaxes(visible=False)
    return figure.update_layout(margin={"l": 0, "r": 0, "t": 4, "b": 4}, hovermode=False)
