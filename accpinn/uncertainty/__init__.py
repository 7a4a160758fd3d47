"""What a recording leaves open: intervals, draws, and how probable string stability is."""

from accpinn.uncertainty.bands import Band, gain_band
from accpinn.uncertainty.intervals import LEVEL, METHOD, Interval, Uncertainty, intervals

__all__ = ["LEVEL", "METHOD", "Band", "Interval", "Uncertainty", "gain_band", "intervals"]
