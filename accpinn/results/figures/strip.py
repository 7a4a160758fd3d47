"""The result strip as HTML: points with bars on common axes, and marks, a row a vehicle.

The reason for each point and mark is shown on hover, on focus and so on tap, and read aloud. It is
HTML, not a chart, so that its rows wrap on a narrow screen and are read by a screen reader; the
same markup stands on the pages and in the report.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, isnan, nan
from pathlib import Path

import numpy as np

from accpinn.results import marks
from accpinn.results.figures.style import ticks, vehicle_colour
from accpinn.results.strip import Estimated, Strip
from accpinn.results.tables import template
from accpinn.stability import Assessment
from accpinn.units import Quantity

HERE = Path(__file__).parent
STYLE = f"<style>\n{(HERE / 'strip.css').read_text(encoding='utf-8')}</style>"
"""The style of `strip_html`, once on a page."""
GLYPHS: dict[Assessment, str] = {
    "stable": marks.YES,
    "unstable": marks.NO,
    "undecided": marks.OPEN,
    "not determined": marks.NOTHING,
}
TRUST: dict[bool | None, str] = {
    True: marks.YES,
    False: marks.AGAINST.glyph,
    None: marks.NOTHING,
}
RIM = 0.06
"""Margin of an axis at either end, as a share of its length."""
REACH = 2.0
"""An axis ends at the latest this factor beyond the largest value: wider intervals are cut off."""
NARROWEST_GAP, NARROWEST_GROWTH = 0.2, 0.2
"""Shortest axis of time gaps, in s, and of growth."""
FOLD = 10.0
"""Growth from which one digit after the point is no use."""


@dataclass(frozen=True)
class Axis:
    """A linear axis, in percent of the width of its cell."""

    low: float
    high: float

    def at(self, value: float) -> float:
        """The place of a value; those beyond the ends are at the ends."""
        share = 100.0 * (value - self.low) / (self.high - self.low)
        return round(float(np.clip(share, 0.0, 100.0)), 2)

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Place and text of two or three round values."""
        marks = ticks((self.low, self.high))
        pairs = zip(marks["tickvals"], marks["ticktext"], strict=True)
        return [(self.at(float(value)), text) for value, text in pairs]

    def point(self, estimated: Estimated, text: str) -> dict[str, object]:
        """A point, its bar, its value as text and the reason, for the template."""
        quantity = estimated.quantity
        has_bar = isfinite(quantity.lower) and not isnan(quantity.upper)
        ends = (self.at(quantity.lower), self.at(quantity.upper)) if has_bar else None
        is_known = not isnan(quantity.value)
        return {
            "at": self.at(quantity.value) if is_known else None,
            "bar": ends and (ends[0], round(ends[1] - ends[0], 2)),
            "is_cut": has_bar and quantity.upper > self.high,
            "shape": shape_of(estimated),
            "text": text,
            "why": estimated.why,
        }


def shape_of(estimated: Estimated) -> str:
    """The class of a point: a cross where measured, a ring extrapolated, a square outside."""
    if estimated.is_measured:
        return "cross"
    if estimated.is_extrapolated:
        return "ring"
    return "" if estimated.quantity.is_inside else "square"


def axis_around(quantities: Sequence[Quantity], shortest: float, least: float = nan) -> Axis:
    """The axis that holds values and intervals, as far as these are not too wide to be shown.

    ``least`` is where it begins in any case, as the growth of 1; by default it is not given.
    """
    ends = [
        [end for q in quantities if isfinite(end := getattr(q, name))]
        for name in ("value", "lower", "upper")
    ]
    values, lows, highs = ends
    if not values:
        values = [1.0]
    low, high = min(values + lows), min(max(values + highs), REACH * max(values))
    if any(inf in (q.value, q.upper) for q in quantities):
        high = REACH * max(values)
    middle = (low + high) / 2.0
    if isfinite(least):
        low, high = least, max(high, least + shortest)
    elif high - low < shortest:
        low, high = middle - shortest / 2.0, middle + shortest / 2.0
    rim = RIM * (high - low)
    return Axis(low - rim, high + rim)


def strip_html(strip: Strip) -> str:
    """The strip as HTML; `STYLE` belongs to it.

    Examples:
        >>> from accpinn.model.published import ASTAZERO
        >>> from accpinn.results.strip import strip_of
        >>> from accpinn.study.vehicles import AssessedVehicles
        >>> strip_html(strip_of(AssessedVehicles(ASTAZERO))).count('class="strip-row"')
        4
    """
    gaps = axis_around([row.time_gap.quantity for row in strip.rows], NARROWEST_GAP)
    growths = axis_around([row.growth.quantity for row in strip.rows], NARROWEST_GROWTH, 1.0)
    rows = [
        {
            "row": row,
            "colour": vehicle_colour(row.number, strip.leader),
            "gap": gaps.point(row.time_gap, _seconds(row.time_gap.quantity.value)),
            "growth": growths.point(row.growth, _times(row.growth.quantity.value)),
        }
        for row in strip.rows
    ]
    return template("figures/strip.html").render(
        strip=strip, rows=rows, gaps=gaps, growths=growths, glyphs=GLYPHS, trust=TRUST,
        one=growths.at(1.0), about=marks.meaning,
        are_points=all(row.l2.is_point for row in strip.rows),
    )  # fmt: skip


def _seconds(value: float) -> str:
    return f"{value:.2f}" if isfinite(value) else "–"


def _times(value: float) -> str:
    if value == inf:
        return "∞"
    if not isfinite(value):
        return "–"
    return f"{value:.2f}×" if value < FOLD else f"{value:.0f}×"
