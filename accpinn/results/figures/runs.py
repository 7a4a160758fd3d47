"""Results in a list as HTML: a row each, with the points and bars of all its vehicles.

The rows are those of the result strip, without its marks: what an entry of a list holds is enough
to draw them, so that no result has to be read.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf, isnan
from pathlib import Path

from accpinn.results.figures.strip import (
    FOLD,
    NARROWEST_GAP,
    NARROWEST_GROWTH,
    Axis,
    axis_around,
)
from accpinn.results.figures.strip import STYLE as STRIP_STYLE
from accpinn.results.figures.style import vehicle_colour
from accpinn.results.messages.estimate import time_gap_in_words
from accpinn.results.strip import Estimated
from accpinn.results.tables import between, template
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.study.store import Entry
from accpinn.units import MetresPerSecond, Quantity, Seconds

STYLE = STRIP_STYLE + (
    f"<style>\n{(Path(__file__).parent / 'runs.css').read_text(encoding='utf-8')}</style>"
)
"""The style of the rows, once on a page."""
LARGEST_GAP: Seconds = 5.0
LARGEST_GROWTH = 3.0
"""Largest ends of the axes; values beyond are drawn at the ends."""
UNKNOWN = "–"


@dataclass(frozen=True)
class Axes:
    """The axes that all rows of a list share."""

    gaps: Axis
    growths: Axis
    speed: MetresPerSecond | None
    """Speed at which all time gaps are stated; None where they differ in it."""

    @classmethod
    def of(cls, entries: Sequence[Entry]) -> "Axes":
        """Axes that hold the values of all entries, as far as these are not extreme."""
        gaps = axis_around([q for entry in entries for q in entry.time_gaps], NARROWEST_GAP)
        every = [q for entry in entries for q in entry.growths]
        growths = axis_around(every, NARROWEST_GROWTH, 1.0)
        speeds = {entry.speed for entry in entries if not entry.fault}
        return cls(
            Axis(min(gaps.low, LARGEST_GAP - NARROWEST_GAP), min(gaps.high, LARGEST_GAP)),
            Axis(growths.low, min(growths.high, LARGEST_GROWTH)),
            speeds.pop() if len(speeds) == 1 else None,
        )

    def head(self) -> str:
        """The scales as HTML; `STYLE` belongs to them."""
        return self._render(None)

    def row(self, entry: Entry, now: datetime) -> str:
        """A row of an entry as HTML; ``now`` has the reader's time zone."""
        is_shared = len(entry.time_gaps) == 1 < len(entry.vehicles[1:])
        names = (EVERY_FOLLOWER,) if is_shared else entry.vehicles[1:]
        numbers = (0,) if is_shared else entry.numbers[1:]
        leader = entry.numbers[0] if entry.numbers else 1
        colours = [vehicle_colour(number, leader) for number in numbers]

        def cell(
            axis: Axis, values: Sequence[Quantity], text: Callable[[float], str],
            words: Callable[[Quantity], str],
        ) -> dict[str, object]:  # fmt: skip
            sentences = [f"{name}: {words(q)}." for name, q in zip(names, values, strict=False)]
            places = enumerate(zip(values, colours, strict=False))
            points = [
                axis.point(Estimated(q, ""), "")
                | {"colour": colour, "top": round(100 * (k + 0.5) / len(values), 1)}
                for k, (q, colour) in places
            ]
            return {"points": points, "text": _range(values, text), "why": "\n".join(sentences)}

        def about_gap(gap: Quantity) -> str:
            is_known = not isnan(gap.value)
            return time_gap_in_words(gap, entry.speed) if is_known else "not determined"

        gap = cell(self.gaps, entry.time_gaps, "{:.2f}".format, about_gap)
        growth = cell(self.growths, entry.growths, _times, _growth)
        row: dict[str, object] = {"gap": gap, "growth": growth, "when": when(entry.created, now)}
        return self._render(row)

    def _render(self, row: dict[str, object] | None) -> str:
        return template("figures/runs.html").render(
            row=row, gaps=self.gaps, growths=self.growths, speed=self.speed,
            one=self.growths.at(1.0),
        )  # fmt: skip


def _range(values: Sequence[Quantity], text: Callable[[float], str]) -> str:
    """The value, or the least and the largest of several."""
    estimates = sorted(q.value for q in values if not isnan(q.value))
    if not estimates:
        return UNKNOWN
    least, most = text(estimates[0]), text(estimates[-1])
    return most if least == most else f"{least.rstrip('×')}–{most}"


def _times(value: float) -> str:
    if value == inf:
        return "∞"
    return f"{value:.2f}×" if value < FOLD else f"{value:.0f}×"


def _growth(growth: Quantity) -> str:
    if isnan(growth.value):
        return "not determined"
    ends = "" if isnan(growth.lower) else f" ({between(growth.lower, growth.upper, 2)})"
    return f"largest growth {_times(growth.value)}{ends}"


def when(created: str, now: datetime) -> str:
    """The time of today, the day of this year, or the month, in the time zone of ``now``."""
    try:
        then = datetime.fromisoformat(created)
    except ValueError:
        return UNKNOWN
    then = (then if then.tzinfo else then.replace(tzinfo=UTC)).astimezone(now.tzinfo)
    if then.date() == now.date():
        return f"today {then:%H:%M}"
    return f"{then.day} {then:%B}" if then.year == now.year else f"{then:%B %Y}"
