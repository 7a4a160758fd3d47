"""The marks of strip, tables, charts and report: each has one shape and one meaning everywhere.

A glyph stands in text, a symbol of the same shape in charts. What a mark means is shown on
pointing at it, in the legend below a table, and all together in the glossary and the report.
"""

from typing import NamedTuple

from accpinn.results.glossary import GROUPS


class Mark(NamedTuple):
    """A mark at a value."""

    glyph: str
    symbol: str
    """That of plotly; empty for one that stands in text alone."""


EXTRAPOLATED = Mark("○", "circle-open")
"""The model extrapolates: no window holds this speed."""
OUTSIDE = Mark("□", "square-open")
"""A value lies outside its interval."""
LEAST = Mark("†", "")
"""The least value that is sought."""
MEASURED = Mark("✚", "cross")
"""A growth is measured in the recording, not that of the model."""
AGAINST = Mark("▲", "triangle-up")
"""There is evidence against an estimate."""
YES, NO, OPEN, NOTHING = "✓", "✗", "?", "–"
"""Answers: of string stability, of trust, of a verification."""
LEGEND = tuple((term.word, term.meaning) for term in GROUPS["Marks"])
"""Every mark and what it means."""


def meaning(*words: str) -> str:
    """The meaning of some entries of the legend, as "✓ …; ✗ …"."""
    meanings = dict(LEGEND)
    return " ".join(f"{word}: {meanings[word]}" for word in words)
