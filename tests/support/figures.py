"""Plotly figures as tests read them."""

from typing import Any

import plotly.graph_objects as go

from accpinn.results.figures.style import with_legend


def named(figure: go.Figure, name: str) -> Any:
    """The one trace of that name."""
    (trace,) = [trace for trace in figure.data if trace.name == name]
    return trace


def names(figure: go.Figure) -> list[str]:
    """Of all traces, in their order."""
    return [trace.name for trace in figure.data]


def rectangles(figure: go.Figure) -> list[Any]:
    """The shaded areas."""
    return [shape for shape in figure.layout.shapes if shape.type == "rect"]


def legend(figure: go.Figure) -> list[Any]:
    """The traces that the figure's legend would name."""
    return [trace for trace in with_legend(figure).data if trace.showlegend is not False]
