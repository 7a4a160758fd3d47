"""The common looks: colours, panels, axes, lines, bands, and no more points than a screen shows.

A `Chart` collects traces and layout as plain dictionaries and hands them to plotly at once, which
checks them in a third of the time that it takes piece by piece. Colours and grid are chosen to be
read on light and on dark pages alike; texts take the page's colour.
"""

import html
from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.colors import hex_to_rgb
from plotly.io import templates
from plotly.subplots import make_subplots

from accpinn.channels import TIME, Quantity
from accpinn.units import FloatArray

Part = dict[str, Any]
"""A trace (a scatter one by default), a shape, an axis or an annotation, in plotly's terms."""

LEADER = "#7e8490"
FOLLOWERS = (
    "#0c7eae", "#d8660c", "#8a5af0", "#18a070", "#9c4e36",
    "#e0487a", "#3660ba", "#96862a", "#a83690", "#6090f6",
)  # fmt: skip
"""Ten followers; each has a contrast of 3 or more on white and on the dark page, and the first few
differ most under normal, red-blind and green-blind vision."""
SERIES = ("#55900f", "#d01cb4", "#84549c")
"""Lines that belong to no vehicle, as methods or terms of a loss; unlike every vehicle's colour,
with the same contrast."""
SHARED = SERIES[2]
"""Colour of values that all followers share, as the parameters of Case I."""
MODEL = "#c22f4f"
"""The closed-loop simulation, beside the vehicle's own colour for its data."""
GRID = "rgba(128, 140, 155, 0.25)"
CLEAR = "rgba(0,0,0,0)"
TRUTH: Part = {"color": LEADER, "width": 1.5, "dash": "dash"}
"""The line at a true value."""
LEGEND = {"orientation": "h", "x": 0, "y": 1.01, "yanchor": "bottom"}
"""Above a figure."""
LINE = 20
"""Height of a line of a legend, in pixels."""
TOLD = 5
"""Most lines whose values the pointer tells at once."""
POINTS = 1500
"""Largest number of points a trace; a screen has no more columns."""
AXIS: Part = {"gridcolor": GRID, "automargin": False, "zeroline": False, "showline": False}
"""Every axis. Margins are fixed: with those that follow the labels a chart is laid out twice."""

STANDOFF = {"x": 7, "y": 5}
"""Pixels between an axis' tick labels and its title; without it plotly takes all labels to be
short."""
PADDING = {"pad": 0}
"""Room between a panel and its tick labels, which plotly forgets where it places titles."""


def vehicle_colour(number: int, leader: int) -> str:
    """The colour of a vehicle, by its number in the file; the platoon's leader has its own.

    Number 0 stands for all followers together.
    """
    if number == 0:
        return SHARED
    return LEADER if number in (leader, 1) else FOLLOWERS[(number - 2) % len(FOLLOWERS)]


def vehicle_colours(vehicles: Sequence[int], numbers: Sequence[int] | None = None) -> list[str]:
    """The colour of each of the ``vehicles``, leader first, or of those with other ``numbers``."""
    return [vehicle_colour(number, vehicles[0]) for number in numbers or vehicles]


def translucent(colour: str, opacity: float) -> str:
    """A colour #rrggbb that shows what lies beneath."""
    red, green, blue = hex_to_rgb(colour)
    return f"rgba({red}, {green}, {blue}, {opacity})"


class Figure(go.Figure):  # type: ignore[misc]  # plotly has no types
    """A figure in plotly's terms, whose parts become plotly's objects once one is asked for.

    Most figures are only sent to a browser. To make these objects, and dictionaries of them again,
    takes ten times as long as to draw; plotly's own check takes longer still, so the tests do it.
    """

    def __init__(self, parts: Part) -> None:
        """Keep the parts as they are: "data" and "layout"."""
        self._parts = parts

    def __getattr__(self, name: str) -> Any:
        """Make the objects, as `name` is one of them that is not there yet."""
        parts = self.__dict__.pop("_parts", None)
        if parts is None:
            raise AttributeError(name)
        super().__init__(parts, _validate=False)
        return getattr(self, name)

    def to_dict(self) -> Part:
        """The figure as it is sent."""
        parts = self.__dict__.get("_parts")
        if parts is None:
            return dict(super().to_dict())
        sent: Part = _copied(parts, _packed)
        sent["data"] = [{"type": "scatter"} | trace for trace in sent["data"]]
        sent["layout"].setdefault("template", _template(templates.default))
        return sent


def parts_of(figure: go.Figure) -> Part:
    """Traces and layout of a figure, to be changed; arrays are those of the figure."""
    parts = figure.__dict__.get("_parts")
    return dict(figure.to_dict()) if parts is None else dict(_copied(parts))


def _copied(part: Any, leaf: Callable[[Any], Any] = lambda value: value) -> Any:
    """Copy dictionaries and lists, and convert all other values."""
    if isinstance(part, dict):
        return {name: _copied(value, leaf) for name, value in part.items()}
    return [_copied(value, leaf) for value in part] if isinstance(part, list) else leaf(part)


def _packed(part: Any) -> Any:
    """Numbers of an array in base 64, as plotly sends them."""
    if not (isinstance(part, np.ndarray) and part.dtype.kind in "fi"):
        return part
    numbers = part.astype(np.int32) if part.dtype.kind == "i" else part  # none is larger
    shape = {"shape": ", ".join(map(str, part.shape))} if part.ndim > 1 else {}
    bdata = b64encode(numbers.tobytes()).decode("ascii")
    return {"dtype": numbers.dtype.str[1:], "bdata": bdata, **shape}


@lru_cache(maxsize=4)
def _template(name: str) -> Part:
    """One of plotly's templates as JSON."""
    return dict(templates[name].to_plotly_json())


class Chart:
    """A figure in the making: traces from the lowest layer up, axes, lines across and words.

    Panels are counted from 1 and axes are named as in traces: "x", "y2". Names of traces are
    escaped, as plotly reads a little HTML; one that several traces have is once in the legend.
    """

    def __init__(
        self, key: str, height: int, grid: Mapping[str, Part] | None = None,
        channels: Sequence[Quantity] = (), **layout: Any,
    ) -> None:  # fmt: skip
        """Begin with empty panels.

        Args:
            key: the user's zoom is kept while figures have the same.
            height: in pixels.
            grid: a `stack`, `row` or `matrix` of panels; by default there is one.
            channels: of a stack's panels, from the top down: titles of their axes, above time; the
                pointer then tells all lines' values at one instant, or of more than `TOLD` that of
                the nearest: a box of so many lines would cover the chart.
            layout: further properties, in plotly's terms.
        """
        self._traces, self._shapes, self._words = list[Part](), list[Part](), list[Part]()
        self._named = set[str]()
        self._axes = {name: AXIS | look for name, look in (grid or {"x": {}, "y": {}}).items()}
        for panel, quantity in enumerate(channels, 1):
            self.axis(f"y{panel}", quantity.axis, hoverformat=f".{quantity.digits}f")
        if channels:
            self.axis([name for name in self._axes if name[0] == "x"][-1], TIME.axis)
        self._has_channels = bool(channels)
        hovermode = "x unified" if channels else "closest"
        margin = {"l": 62, "r": 14, "t": 10, "b": 49} | layout.pop("margin", {})
        self._layout = {
            "height": height, "showlegend": False, "hovermode": hovermode, "uirevision": key,
            "paper_bgcolor": CLEAR, "plot_bgcolor": CLEAR, "margin": margin | PADDING,
            "hoverlabel": {"namelength": -1}, **layout,
        }  # fmt: skip

    def axis(self, name: str, title: str = "", **look: Any) -> None:
        """Set the title and look of an axis; "x" or "y" with a star sets those of all panels."""
        names = [n for n in self._axes if n[0] == name[0]] if name[1:] == "*" else [_axis(name)]
        for key in names:
            part = self._axes.setdefault(key, dict(AXIS))
            about: Part = {"text": title, "standoff": STANDOFF[key[0]]} if title else {}
            part.update(look, title=part.get("title", {}) | about)

    def add(self, x: Any, y: Any, name: str = "", panel: int = 0, **look: Any) -> None:
        """Add a trace, a scatter one by default, in plotly's terms."""
        if name:
            first = look.get("showlegend", name not in self._named)
            look |= {"name": html.escape(name), "showlegend": first}
            self._named |= {name} if first else set()
        if panel:
            look |= {"xaxis": _axis(f"x{panel}"), "yaxis": _axis(f"y{panel}")}
            look |= {"legendgroup": html.escape(name)} if name else {}
        self._traces.append({"x": x, "y": y, **look})

    def line(
        self, x: Any, y: Any, name: str = "", colour: str = LEADER, width: float = 2,
        dash: str = "solid", panel: int = 0, hover: str = "", points: int = POINTS, **look: Any,
    ) -> None:  # fmt: skip
        """Add a line through (N,) samples, with no more of them than are seen."""
        x, y = thinned(x, y, points)
        look |= {"hovertemplate": hover} if hover else {}
        pen = {"color": colour, "width": width, "dash": dash}
        self.add(x, y, name, panel, **{"mode": "lines", "line": pen, **look})

    def dots(
        self, x: Any, y: Any, name: str = "", panel: int = 0, hover: str = "", *,
        marker: Part, ends: tuple[FloatArray, FloatArray] | None = None, along: str = "y",
        bar: Mapping[str, Any] | None = None, **look: Any,
    ) -> None:  # fmt: skip
        """Add points; ``ends`` are those of their intervals along an axis, drawn as bars."""
        if ends is not None:
            (low, high), middle = ends, x if along == "x" else y
            look[f"error_{along}"] = {
                "type": "data", "symmetric": False, "array": high - middle,
                "arrayminus": middle - low, "width": 0, **(bar or {}),
            }  # fmt: skip
        look |= {"hovertemplate": hover} if hover else {"hoverinfo": "skip"}
        self.add(x, y, name, panel, **{"mode": "markers", "marker": marker, **look})

    def band(
        self, x: FloatArray, low: FloatArray, high: FloatArray, colour: str, opacity: float,
        name: str = "", panel: int = 0, **look: Any,
    ) -> None:  # fmt: skip
        """Add the area between two lines over (K,) ``x``; no legend has it unless told so."""
        area = {"mode": "none", "fill": "toself", "fillcolor": translucent(colour, opacity),
                "hoverinfo": "skip", "showlegend": False}  # fmt: skip
        ends = np.concatenate([low, high[::-1]])
        self.add(np.concatenate([x, x[::-1]]), ends, name, panel, **area | look)

    def level(self, axis: str, at: float, line: Part, layer: str = "above") -> None:
        """Draw a line at a value of an axis, through its whole panel."""
        self._across(axis, at, at, {"type": "line", "line": line, "layer": layer})

    def area(self, axis: str, low: float, high: float, colour: str) -> None:
        """Shade the area between two values of an axis, beneath all else."""
        look = {"type": "rect", "fillcolor": colour, "line": {"width": 0}, "layer": "below"}
        self._across(axis, low, high, look)

    def _across(self, axis: str, low: float, high: float, look: Part) -> None:
        axis = _axis(axis)
        along, other = axis[0], "y" if axis[0] == "x" else "x"
        self.shape(
            {f"{along}ref": axis, f"{along}0": low, f"{along}1": high, f"{other}0": 0,
             f"{other}1": 1, f"{other}ref": f"{other}{axis[1:]} domain", **look}
        )  # fmt: skip

    def shape(self, shape: Part) -> None:
        """Draw a shape in plotly's terms."""
        self._shapes.append(shape)

    def words(self, text: str, x: float, y: float, **look: Any) -> None:
        """Write a few words within the axes, at shares of their lengths."""
        self._words.append({
            "text": text, "xref": "x domain", "x": x, "xanchor": "left" if x < 0.5 else "right",
            "yref": "y domain", "y": y, "yanchor": "bottom" if y < 0.5 else "top",
            "showarrow": False, **look,
        })  # fmt: skip

    def figure(self) -> go.Figure:
        """The figure with all that was drawn."""
        axes = {f"{name[0]}axis{name[1:]}": axis for name, axis in self._axes.items()}
        drawn = {"shapes": self._shapes, "annotations": self._words}
        lines = Counter(t.get("yaxis") for t in self._traces if t.get("hoverinfo") != "skip")
        if self._layout["hovermode"] == "x unified" and max(lines.values(), default=0) > TOLD:
            self._tell_nearest(axes)
        return Figure({"data": self._traces, "layout": self._layout | axes | drawn})

    def _tell_nearest(self, axes: Mapping[str, Part]) -> None:
        """Let the pointer tell one line's name and value, over time its instant, too."""
        self._layout |= {"hovermode": "closest", "hoverdistance": 40, "spikedistance": -1}
        for name, axis in axes.items():
            if name[0] == "x":
                axis |= {"showspikes": True, "spikemode": "across", "spikesnap": "cursor",
                         "spikethickness": 1, "spikedash": "dot", "spikecolor": LEADER}  # fmt: skip
        for trace in self._traces:
            template = trace.get("hovertemplate", "")
            if self._has_channels and "%{y" in template and "%{x" not in template:
                value, mark, extra = template.partition("<extra>")
                trace["hovertemplate"] = f"{value} at %{{x:.1f}} s{mark}{extra}"


def thumbnail() -> Chart:
    """A small picture of lines without axes, to choose something by."""
    chart = Chart("thumbnail", 110, hovermode=False, margin={"l": 0, "r": 0, "t": 4, "b": 4})
    chart.axis("x", visible=False)
    chart.axis("y", visible=False)
    return chart


def _axis(name: str) -> str:
    """An axis as plotly names it, where that of the first panel has no number."""
    return name[0] if name[1:] == "1" else name


def stack(*heights: float, spacing: float = 0.05) -> Mapping[str, Part]:
    """Panels over one axis of time, with their relative heights from the top down."""
    return _grid(
        rows=len(heights), cols=1, shared_xaxes=True, row_heights=heights, vertical_spacing=spacing
    )


def row(
    count: int, spacing: float, widths: tuple[float, ...] | None = None
) -> Mapping[str, Part]:  # fmt: skip
    """Panels beside each other with one vertical scale, by default of one width."""
    return _grid(
        rows=1, cols=count, shared_yaxes=True, horizontal_spacing=spacing, column_widths=widths
    )


def matrix(count: int) -> Mapping[str, Part]:
    """A square of panels with one scale in each row and each column."""
    return _grid(
        rows=count, cols=count, shared_xaxes=True, shared_yaxes=True,
        horizontal_spacing=0.02, vertical_spacing=0.03,
    )  # fmt: skip


@lru_cache(maxsize=32)
def _grid(**options: Any) -> Mapping[str, Part]:
    """The axes of plotly's `make_subplots`, which takes long."""
    layout = make_subplots(**options).layout.to_plotly_json()
    return {name.replace("axis", ""): part for name, part in layout.items() if "axis" in name}


def limits(values: FloatArray) -> list[float]:
    """Axis limits around the finite values with a margin of 8 % of their range; else empty."""
    values = values[np.isfinite(values)]
    if not len(values):
        return []
    low, high = float(values.min()), float(values.max())
    rim = max(0.08 * (high - low), 0.02 * abs(high), 1e-4)
    return [low - rim, high + rim]


def thinned(time: FloatArray, values: FloatArray, points: int = POINTS) -> tuple[FloatArray, ...]:
    """At most about ``points`` of (N,) samples: lowest and highest of each bin, and every hole.

    Unlike plain decimation this keeps peaks, and a missing block still breaks the line.
    """
    count = len(values)
    bins = points // 2
    if count <= points:
        return time, values
    width = -(-count // bins)
    padded = np.full(bins * width, np.nan)
    padded[:count] = values
    table = padded.reshape(bins, width)
    missing = np.isnan(table)
    picked = [
        np.where(missing, np.inf, table).argmin(axis=1),
        np.where(missing, -np.inf, table).argmax(axis=1),
        missing.argmax(axis=1),
    ]
    offsets = np.arange(bins) * width
    rows = np.unique(np.concatenate([[0, count - 1], *(offsets + at for at in picked)]))
    rows = rows[rows < count]
    return time[rows], values[rows]


def ticks(ends: Sequence[float]) -> dict[str, Any]:
    """Two or three round values on an axis too short for more, where plotly may name only one."""
    low, high = ends
    decade = 10.0 ** np.floor(np.log10(high - low))
    for factor in (5.0, 2.0, 1.0, 0.5, 0.2):
        step = factor * decade
        first, last = np.ceil(low / step), np.floor(high / step)
        if last > first:
            break
    values = step * np.arange(first, last + 1, 2 if last - first > 2 else 1)
    digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return {"tickvals": values, "ticktext": [f"{v + 0.0:.{digits}f}" for v in values]}


def with_legend(figure: go.Figure) -> Figure:
    """The figure with a legend, for where no key stands beside it, as in a file of its own.

    Every figure knows which of its traces a legend names: those that have a name and do not refuse.
    It stands above the figure, or below where a title is in the way.
    """
    parts = parts_of(figure)
    layout = parts["layout"]
    for trace in parts["data"]:
        if not trace.get("name"):
            trace["showlegend"] = False
    if entries := sum(trace.get("showlegend") is not False for trace in parts["data"]):
        layout["showlegend"] = True
        if layout.get("title", {}).get("text"):
            layout["legend"] = LEGEND | {"y": 0, "yref": "container"}
            layout["height"] += LINE * entries
        else:
            layout["legend"] = dict(LEGEND)
            layout["margin"]["t"] = max(layout["margin"].get("t", 0), 34)
    return Figure(parts)


def in_height(figure: go.Figure, height: int) -> Figure:
    """The figure in another height, in pixels."""
    parts = parts_of(figure)
    parts["layout"]["height"] = height
    return Figure(parts)


def on_paper(figure: go.Figure, paper: str, ink: str) -> Figure:
    """The figure on a ground of a colour, with texts in another."""
    parts = parts_of(figure)
    layout = parts["layout"]
    titles, fonts = [layout], []
    for axis in axes_of(parts):
        titles.append(axis.setdefault("title", {}))
        fonts.append(axis.setdefault("tickfont", {}))
    for font in (*fonts, *(part.setdefault("font", {}) for part in titles)):
        font["color"] = ink
    layout["paper_bgcolor"] = paper
    return Figure(parts)


def axes_of(parts: Part) -> list[Part]:
    """The axes in the layout of `parts_of` a figure."""
    return [part for name, part in parts["layout"].items() if name[1:5] == "axis"]
