"""A recording and a segment as figures: speeds, gaps, the window, who drove, and the regimes.

Vehicle names come from files, so they are escaped: plotly reads a little HTML.
"""

from collections.abc import Mapping, Sequence, Set
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from accpinn.channels import GAP, RELATIVE_SPEED, SPEED, TIME_GAP
from accpinn.findings import Labelled
from accpinn.model.cthp import Trajectories
from accpinn.recordings import Mode, Recording, Window
from accpinn.results.figures import style
from accpinn.results.figures.strip import STYLE
from accpinn.results.messages import messages
from accpinn.results.recording import LABELS, MEANING, QUANTITIES, RatedWindow, quantity_of
from accpinn.results.tables import template
from accpinn.segment import Segment, SegmentInfo, time_gaps
from accpinn.segment.cut import longest_in
from accpinn.segment.quality import (
    CATCHING_UP,
    FOLLOWING,
    MANUAL,
    REGIMES,
    STANDSTILL,
    Grade,
    Regimes,
)
from accpinn.units import FloatArray, Seconds, stretches

MISSING = "#c22f4f"
JUMP = MISSING
"""The gap's jumps are faults as missing samples are."""
WINDOW = "rgba(12, 126, 174, 0.16)"
FAINT = 0.35
"""Opacity of vehicles that are not chosen."""
REGIME_COLOURS = {
    FOLLOWING: "#8b93a1",
    CATCHING_UP: "#b07d00",
    MANUAL: "#b04a96",
    STANDSTILL: "#4f86b5",
}
"""Each with a contrast of 3 or more on white and on the dark page; car-following, which the model
is for, is grey; the others differ under any vision, and from the first vehicles."""
Looks = Mapping[int, tuple[str, str, float]]
"""Name, colour and width of bars, by the code of what they tell."""
DRIVERS: Looks = {
    Mode.ACC: ("ACC", REGIME_COLOURS[FOLLOWING], 3.0),
    Mode.HUMAN: ("by hand", REGIME_COLOURS[MANUAL], 8.0),
}
MISSED = len(REGIME_COLOURS)
"""The code of an instant without a sample, beside those of the regimes."""

GRADE_GLYPHS = {Grade.GOOD: "✓", Grade.FAIR: "▲", Grade.POOR: "✗", Grade.UNKNOWN: "?"}
GRADE_COLOURS = {
    Grade.GOOD: "#18a070",
    Grade.FAIR: "#b07d00",
    Grade.POOR: MISSING,
    Grade.UNKNOWN: style.LEADER,
}
"""Colour of each grade's mark on a chart; the marks differ in shape."""
View = Literal["motion", "relative", "time gap"]
CHANNELS = {"motion": (SPEED, GAP), "relative": (RELATIVE_SPEED,), "time gap": (TIME_GAP,)}
"""The panels of each view of a recording."""
DOTTED = {"color": style.LEADER, "width": 1, "dash": "dot"}
PANELS = 270
"""Pixels of all panels together, without strips."""
BEGINNING: Seconds = 180.0
"""Time that a first look at a recording shows."""
HIGHEST_TIME_GAP: Seconds = 5.0
"""Largest drawn time gap in s; larger ones mean free driving."""
TOTAL_POINTS = 12_000
"""Largest number of points of all curves together: ten vehicles are drawn as fast as two."""
ROW = 11
"""Pixels of a vehicle's bars."""
LABELLED = 6
"""More ribbons than these stand too close for numbers beside them."""
MARGIN, MARGIN_RIGHT = 64, 12
"""Pixels left and right of the axis of time."""


def overview(
    recording: Recording,
    vehicles: Sequence[int],
    window: Window,
    ribbons: Sequence[Sequence[style.Part]] = (),
    view: View = "motion",
    highlight: int = 0,
    several: Sequence[RatedWindow] = (),
) -> go.Figure:
    """A whole recording over time with its window and each vehicle's motion.

    The chosen vehicles, leader first, are not faint; with the number of a follower to highlight,
    these are only that and the one ahead of it. Ribbons are strips of bars, from the top down (see
    `driver_ribbons` and `regime_ribbons`). Several windows may stand in place of the one, with
    their numbers: those that are used are shaded, the others have dotted ends.
    """
    strips = [traces for traces in ribbons if traces]
    drawn = _curves(recording, vehicles, view)
    shares = (0.56, 0.44) if view == "motion" else (1.0,)
    pixels = [PANELS * share for share in shares]
    pixels += [max(24, ROW * len({bars["y"][0] for bars in traces})) for traces in strips]
    # The margins are these, so that the handles below can stand under the axis.
    chart = style.Chart(
        f"overview-{recording.sha256}", round(sum(pixels)) + 50,
        style.stack(*pixels, spacing=0.03), CHANNELS[view], selectdirection="h",
        dragmode=False if several else "select",
        margin={"l": MARGIN, "r": MARGIN_RIGHT, "t": 22 if several else 6, "b": 49},
    )  # fmt: skip
    chart.axis("x*", range=[0, recording.duration])
    chart.axis("y*", fixedrange=True)
    rows = several or (RatedWindow(0, window, is_used=True),)
    for row in rows:
        chart.shape(
            {"type": "rect", "xref": "x", "yref": "paper", "x0": row.window.start,
             "x1": row.window.end, "y0": 0, "y1": 1, "layer": "below",
             "fillcolor": WINDOW if row.is_used else style.CLEAR,
             "line": {"color": style.FOLLOWERS[0], "width": 1.5 if row.is_used else 1,
                      "dash": "solid" if row.is_used else "dot"}}
        )  # fmt: skip
    for row in several:
        text = f"{row.number} {GRADE_GLYPHS[row.grade]}" if row.is_used else f"{row.number}"
        chart.words(
            text, (row.window.start + row.window.end) / 2, 1.0, xref="x", yref="paper",
            xanchor="center", yanchor="bottom",
            font={"size": 12, "color": GRADE_COLOURS[row.grade] if row.is_used else style.LEADER},
        )  # fmt: skip
    strong = {highlight} if highlight else {*vehicles[1:]}
    if view == "time gap":
        chart.axis("y", range=[0, HIGHEST_TIME_GAP])
    levels = {"relative": {0.0}, "time gap": {longest_in(recording, k) for k in strong}}
    for level in levels.get(view, ()):
        chart.level("y", level, DOTTED)
    ahead = {number - 1 for number in strong}
    points = max(400, min(style.POINTS, TOTAL_POINTS // max(1, len(drawn))))
    for panel, number, values in drawn:
        shown = number in strong or (number in ahead and view == "motion" and panel == 1)
        chart.line(
            recording.time, values, recording.label(number),
            style.vehicle_colour(number, vehicles[0]), 1.8 if shown else 1, panel=panel,
            points=points, opacity=1 if shown else FAINT, connectgaps=False,
        )  # fmt: skip
    if view == "motion":
        _mark_jumps(chart, recording, strong, vehicles[0])
    for panel, strip in enumerate(strips, len(shares) + 1):
        for bars in strip:
            chart.add(**bars, panel=panel, showlegend=False)
        numbers = sorted({bars["y"][0] for bars in strip}, key=int, reverse=True)
        chart.axis(
            f"y{panel}", type="category", showgrid=False, categoryorder="array",
            categoryarray=numbers, showticklabels=len(numbers) <= LABELLED, dtick=1,
            tickfont={"size": 9},
        )  # fmt: skip
    return chart.figure()


WINDOWS_STYLE = STYLE + (
    f"<style>\n{(Path(__file__).parent / 'windows.css').read_text(encoding='utf-8')}</style>"
)
"""The style of `windows_html`, once on a page."""


def windows_html(rows: Sequence[RatedWindow], about: Labelled) -> str:
    """The windows as HTML: a row each, with a mark and a number for each check.

    The reason for a mark is shown on hover, on focus and so on tap; `WINDOWS_STYLE` belongs to it.
    """
    drawn = [
        {
            "row": row,
            "checks": [
                {
                    "glyph": GRADE_GLYPHS[rating.grade],
                    "grade": rating.grade.name.lower(),
                    "figure": quantity_of(rating),
                    "name": QUANTITIES[rating.question].title,
                    "why": " ".join(
                        [f"{LABELS[rating.question][rating.grade]}: {quantity_of(rating)}.",
                         *messages(rating.findings, about)]
                    ),
                }
                for rating in row.ratings
            ],
        }
        for row in rows
    ]  # fmt: skip
    return template("figures/windows.html").render(
        rows=drawn, columns=[(QUANTITIES[question], MEANING[question]) for question in QUANTITIES]
    )


def beginning(recording: Recording) -> go.Figure:
    """Speeds and gaps of the first minutes, small, to see whether columns and units are right."""
    end = min(recording.duration, BEGINNING)
    rows = recording.rows(Window(0.0, end))
    chart = style.Chart(
        f"beginning-{recording.digest}", 250, style.stack(0.5, 0.5, spacing=0.06), (SPEED, GAP),
        margin={"l": MARGIN, "r": MARGIN_RIGHT, "t": 6, "b": 49},
    )  # fmt: skip
    chart.axis("x*", range=[0, end])
    chart.axis("y*", fixedrange=True)
    leader, *followers = recording.present
    for panel, number, values in _curves(recording, recording.present, "motion"):
        chart.line(
            recording.time[rows], values[rows], recording.label(number),
            style.vehicle_colour(number, leader), 1.6, panel=panel, points=600, connectgaps=False,
        )  # fmt: skip
    _mark_jumps(chart, recording, {*followers}, leader, end)
    return chart.figure()


def _mark_jumps(
    chart: style.Chart, recording: Recording, followers: Set[int], leader: int,
    end: Seconds = np.inf,
) -> None:  # fmt: skip
    """A mark where the gap of a follower jumps, with the size of the jump on hover."""
    for jumps in filter(None, (jumps.within(0.0, end) for jumps in recording.jumps)):
        if jumps.follower in followers:
            rows = np.searchsorted(recording.time, jumps.times)
            colour = style.vehicle_colour(jumps.follower, leader)
            chart.dots(
                np.array(jumps.times), recording.gap_behind(jumps.vehicle)[rows],
                f"{recording.label(jumps.follower)}: jump of the gap", panel=2,
                hover="%{customdata:+.1f} m at %{x:.1f} s", customdata=np.array(jumps.sizes),
                marker={"symbol": "x", "size": 9, "color": JUMP,
                        "line": {"color": colour, "width": 1.5}},
                showlegend=False,
            )  # fmt: skip


def _curves(
    recording: Recording, vehicles: Sequence[int], view: View
) -> list[tuple[int, int, FloatArray]]:
    """Row, vehicle and values (N,) of each curve; Δv and time gap only of the chosen followers."""
    drawn = []
    for number in recording.present:
        speed = recording.speed_of(number)
        ahead = number - 1 in recording.present
        if view == "motion":
            drawn.append((1, number, speed))
            drawn += [(2, number, recording.gap_behind(number - 1))] if ahead else []
        elif number in vehicles[1:]:
            if view == "relative":
                values = recording.speed_of(number - 1) - speed
            else:
                values = time_gaps(speed, recording.gap_behind(number - 1))
            drawn.append((1, number, values))
    return drawn


def motion(info: SegmentInfo, source: Trajectories) -> go.Figure:
    """Gaps and speeds of a segment's vehicles, to look at rather than to work with."""
    chart = style.Chart("motion", 460, style.stack(0.5, 0.5), (GAP, SPEED))
    pairs = zip(info.labels, style.vehicle_colours(info.vehicles), strict=True)
    for k, (label, colour) in enumerate(pairs):
        drawn = [(2, source.speeds[:, k], SPEED)]
        drawn += [(1, source.gaps[:, k - 1], GAP)] if k else []
        for panel, values, channel in drawn:
            chart.line(
                info.window.start + source.time, values, label + ("" if k else " (leader)"), colour,
                1.8, panel=panel, hover=f"%{{y:.2f}} {channel.unit}", connectgaps=False,
            )  # fmt: skip
    return chart.figure()


def speeds_thumbnail(segment: Segment) -> go.Figure:
    """The speeds of a segment's vehicles over time, small and without axes."""
    chart, colours = style.thumbnail(), style.vehicle_colours(segment.vehicles)
    for colour, speeds in zip(colours, segment.measured_speeds.T, strict=True):
        chart.line(segment.time, speeds, "", colour, 1.4, points=150, hoverinfo="skip")
    return chart.figure()


def driver_ribbons(recording: Recording, vehicles: Sequence[int]) -> list[style.Part]:
    """Who drives each of the vehicles; nothing where no driver is known to drive."""
    modes = recording.mode[:, np.array(vehicles) - 1]
    return _bars(vehicles, modes, DRIVERS, recording.time) if (modes == Mode.HUMAN).any() else []


def regime_ribbons(segment: Segment, regimes: Regimes) -> list[style.Part]:
    """A trace for each follower and regime that occurs, over the recording's time."""
    looks = {code: (REGIMES[code], colour, 8.0 if code else 3.0)
             for code, colour in REGIME_COLOURS.items()}  # fmt: skip
    looks[MISSED] = ("missing", MISSING, 8.0)
    measured = True if regimes.measured is None else regimes.measured
    codes = np.where(measured, regimes.codes, MISSED)
    time = segment.window.start + segment.time
    return _bars(segment.vehicles[1:], codes, looks, time, segment.sample_time)


def strip_key(strip: Sequence[style.Part]) -> dict[str, str]:
    """The colour of each kind of bars in a strip, by its name."""
    return {bars["name"].partition(" ")[2]: bars["line"]["color"] for bars in strip}


def _bars(
    vehicles: Sequence[int], codes: NDArray[Any], looks: Looks, time: FloatArray,
    step: Seconds = 0.0,
) -> list[style.Part]:  # fmt: skip
    """A trace for each vehicle and code (N, V) that occurs, with a bar a run of instants.

    Each instant stands for the ``step`` around it.
    """
    traces = list[style.Part]()
    for (k, number), (code, (name, colour, width)) in product(enumerate(vehicles), looks.items()):
        x: list[float | None] = []
        for run in stretches(codes[:, k] == code):
            x += [float(time[run.first]) - step / 2, float(time[run.last]) + step / 2, None]
        bars: style.Part = {
            "x": x, "y": [str(number)] * len(x), "name": f"{number} {name}", "mode": "lines",
            "line": {"color": colour, "width": width}, "hoverinfo": "skip",
        }  # fmt: skip
        traces += [bars] if x else []
    return traces
