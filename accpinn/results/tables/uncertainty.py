"""What the data leave open about string stability, as a table."""

import math

from accpinn.inference.intervals import Interval, Uncertainty
from accpinn.model.published import ParameterSet
from accpinn.results.tables.table import Cell, Column, Table

DB_DIGITS, OMEGA_DIGITS, GAIN_DIGITS = 2, 3, 2


def stability_doubt_table(laws: ParameterSet, uncertainty: Uncertainty) -> Table:
    """One row a vehicle: intervals of peak, crossover and exact gain, and shares of laws."""
    percent = f"{100 * uncertainty.level:.0f} % interval"
    columns = (
        Column("Vehicle"),
        Column("Peak of |H| [dB]", group=percent),
        Column("Amplified below [rad/s]", group=percent),
        Column("‖h‖₁", group=percent),
        Column("L2", "%", 0, "Stable laws"),
        Column("L∞", "%", 0, "Stable laws"),
        Column("Keeps no gap (α = 0)", "%", 0),
    )
    rows: list[tuple[Cell, ...]] = []
    for k, label in enumerate(laws.labels):
        low, high = map(_decibels, _pair(uncertainty.peak_gain, k))
        rows.append(
            (
                label,
                between(low, high, DB_DIGITS),
                between(*_pair(uncertainty.crossover, k), OMEGA_DIGITS),
                between(*_pair(uncertainty.linf_gain, k), GAIN_DIGITS),
                100 * float(uncertainty.probability_l2[k]),
                100 * float(uncertainty.probability_linf[k]),
                100 * float(uncertainty.gapless[k]),
            )
        )
    return Table(f"What the data leave open, {laws.title}", columns, tuple(rows))


def between(low: float, high: float, digits: int) -> str:
    """An interval in words; an end may be infinite."""
    if not math.isfinite(low):
        return f"up to {high:.{digits}f}" if math.isfinite(high) else "anything"
    if not math.isfinite(high):
        return f"{low:.{digits}f} or more"
    return f"{low:.{digits}f} to {high:.{digits}f}"


def _decibels(gain: float) -> float:
    """Of a gain; minus infinity where nothing passes."""
    return 20 * math.log10(gain) if gain > 0 else -math.inf


def _pair(interval: Interval, k: int) -> tuple[float, float]:
    return float(interval.lower[k]), float(interval.upper[k])
