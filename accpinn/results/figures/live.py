"""A training while it runs, as Vega-Lite charts: they take new data without being drawn anew.

A chart's specification stays the same from one moment to the next; all that changes is its data.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from accpinn.channels import GAP, PARAMETERS, SPEED, TIME
from accpinn.methods.fit import History
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.results.figures.style import LEADER, MODEL, SERIES, SHARED, thinned, vehicle_colours
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.units import FloatArray

HEIGHT = 195
LINES = {"now": (1, 0), "truth": (6, 4), "least squares": (1, 3)}
"""Dashes of the kinds of lines."""
DRAWN = 400
"""Points of a line at most."""
TERMS = ("total", "data", "physics", "initial")
"""Terms of the loss, by their names in a history."""

Line = tuple[str, str, FloatArray, FloatArray]
"""What it is of, its kind, and its points."""


@dataclass(frozen=True, eq=False)
class LiveChart:
    """A chart that is drawn again and again."""

    name: str
    spec: dict[str, Any]
    """Of Vega-Lite; constant over a training."""
    data: pd.DataFrame
    """The present points: x, y, of, kind."""


def live_history(
    history: History,
    info: SegmentInfo,
    truth: Parameters | None = None,
    solved: Parameters | None = None,
) -> tuple[LiveChart, ...]:
    """Loss terms, α, β and τ over iterations on logarithmic axes, with lines to compare with.

    Args:
        history: of K moments.
        info: of the segment.
        truth: the true parameters, one entry a follower, where they are known.
        solved: those of least squares.
    """
    iteration = np.maximum(history.iteration, 1.0)
    terms = [
        (term, "now", iteration, np.where(values > 0, values, np.nan))
        for term in TERMS
        if (values := getattr(history, term)).any()
    ]
    colours = dict(zip(TERMS, (LEADER, *SERIES), strict=True))
    charts = [_chart("loss", "Iteration", "Loss Ψ and its terms", terms, colours, ("log", "log"))]
    sets = history.parameters.values.shape[1]
    names, colours_of = info.labels[1:], vehicle_colours(info.vehicles)[1:]
    if sets < info.followers:
        names, colours_of = (EVERY_FOLLOWER,), [SHARED]
    vehicles = dict(zip(names, colours_of, strict=True))
    ends = np.array([1.0, max(iteration[-1], 2.0)])
    for which, quantity in enumerate(PARAMETERS):
        lines: list[Line] = [
            (name, "now", iteration, history.parameters.values[:, k, which])
            for k, name in enumerate(names)
        ]
        for kind, reference in (("truth", truth), ("least squares", solved)):
            values = reference.values[:sets, which] if reference else ()
            lines += [
                (name, kind, ends, np.full(2, value))
                for name, value in zip(names, values, strict=False)
            ]
        title = f"{quantity.name} {quantity.heading}"
        charts.append(_chart(quantity.name, "Iteration", title, lines, vehicles, ("log", "linear")))
    return tuple(charts)


def live_motion(segment: Segment, follower: int, now: Trajectories) -> tuple[LiveChart, ...]:
    """Space-gap and speed of one follower, 0 for the first: the data, and the network's curves."""
    colours = {"data": LEADER, "network": MODEL}
    measured = segment.measured_gaps[:, follower], segment.measured_speeds[:, follower + 1]
    learned = now.gaps[:, follower], now.speeds[:, follower + 1]
    charts = []
    for quantity, *pair in zip((GAP, SPEED), measured, learned, strict=True):
        lines: list[Line] = []
        for name, values in zip(colours, pair, strict=True):
            time, shown = thinned(segment.start + segment.time, values, DRAWN)
            lines.append((name, "now", time, shown))
        charts.append(_chart(quantity.name, TIME.axis, quantity.axis, lines, colours))
    return tuple(charts)


def _chart(
    name: str,
    x_title: str,
    title: str,
    lines: Sequence[Line],
    colours: dict[str, str],
    scales: tuple[str, str] = ("linear", "linear"),
) -> LiveChart:
    def axis(field: str, title: str, scale: str) -> dict[str, Any]:
        return {
            "field": field, "type": "quantitative", "title": title,
            "scale": {"type": scale, "zero": False, "nice": field == "y"},
            "axis": {"tickCount": 4, "grid": scale == "linear", "labelOverlap": True},
        }  # fmt: skip

    spec = {
        "mark": {"type": "line", "clip": True, "strokeWidth": 2},
        "height": HEIGHT,
        "title": {"text": title, "anchor": "start", "fontSize": 13, "offset": 4},
        "encoding": {
            "x": axis("x", x_title, scales[0]),
            "y": axis("y", "", scales[1]),
            "color": _by("of", colours.items()),
            "strokeDash": _by("kind", ((kind, [*dash]) for kind, dash in LINES.items())),
            "tooltip": [{"field": "of", "title": "Line"}, {"field": "y", "format": ".4g"}],
        },
    }
    return LiveChart(name, spec, pd.concat([*_frames(lines)], ignore_index=True))


def _by(field: str, looks: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    names, values = zip(*looks, strict=True)
    scale = {"domain": [*names], "range": [*values]}
    return {"field": field, "type": "nominal", "scale": scale, "legend": None}


def _frames(lines: Iterable[Line]) -> Iterator[pd.DataFrame]:
    for of, kind, x, y in lines:
        step = 1 + len(x) // DRAWN
        kept = np.unique(np.append(np.arange(0, len(x), step), len(x) - 1))
        yield pd.DataFrame({"x": x[kept], "y": y[kept], "of": of, "kind": kind})
