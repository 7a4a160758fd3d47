"""What a recording leaves open: intervals, draws, and how probable string stability is."""

from accpinn.uncertainty.bands import Band, gain_band
from accpinn.uncertainty.intervals import (
    LEVEL,
    METHOD,
    SYMBOLS,
    Interval,
    Uncertainty,
    intervals,
    within,
)

__all__ = [
    "LEVEL",
    "METHOD",
    "SYMBOLS",
    "Band",
    "Interval",
    "Uncertainty",
    "gain_band",
    "intervals",
    "within",
]
