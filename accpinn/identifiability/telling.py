"""Plain warnings where the data cannot tell α, β and τ, whichever method is asked."""

import numpy as np

from accpinn.cthp import Case
from accpinn.segment import Segment
from accpinn.segment.quality import (
    LARGE_CONDITION,
    LITTLE_LEADER_MOTION,
    LITTLE_RELATIVE_MOTION,
    Quality,
    assess,
)
from accpinn.uncertainty import Uncertainty

SYMBOLS = ("α", "β", "τ")
DIGITS = (4, 4, 2)
WIDE = 5.0
"""An interval whose upper end is more than so many times its lower one says little more than the
order of magnitude."""


def identifiable(segment: Segment, uncertainty: Uncertainty, case: Case = "II") -> tuple[str, ...]:
    """One sentence for each follower whose parameters the data leave open; empty where none is.

    Args:
        segment: the data.
        uncertainty: its intervals.
        case: "II"; in Case I all followers share one sentence.
    """
    quality = assess(segment)
    labels = ("All followers together",) if case == "I" else segment.labels[1:]
    sentences = []
    for k, label in enumerate(labels):
        open_ends = _open(uncertainty, k)
        reasons = [] if case == "I" else _reasons(quality, k)
        if open_ends:
            because = f", as {' and '.join(reasons)}" if reasons else ""
            sentences.append(
                f"{label}: these data leave {_listed(open_ends)} open by more than a factor of"
                f" {WIDE:g}{because}; take a longer window, or one in which the vehicle ahead"
                " brakes and accelerates more."
            )
        elif reasons:
            sentences.append(f"{label}: take the intervals with care, as {' and '.join(reasons)}.")
    return tuple(sentences)


def _open(uncertainty: Uncertainty, follower: int) -> list[str]:
    """The parameters with wide intervals, each with its ends."""
    ends = zip(uncertainty.lower[follower], uncertainty.upper[follower], strict=True)
    return [
        f"{symbol} ({low:.{digits}f} {f'to {high:.{digits}f}' if np.isfinite(high) else 'or more'})"
        for symbol, digits, (low, high) in zip(SYMBOLS, DIGITS, ends, strict=True)
        # An interval that is 0 alone is narrow: `Uncertainty.notes` says what it means.
        if high > WIDE * low
    ]


def _reasons(quality: Quality, follower: int) -> list[str]:
    reasons = []
    if quality.leader_deviation < LITTLE_LEADER_MOTION:
        reasons.append(f"the leader's speed varies by only {quality.leader_deviation:.2f} m/s")
    if quality.relative_deviation[follower] < LITTLE_RELATIVE_MOTION:
        reasons.append(f"Δv varies by only {quality.relative_deviation[follower]:.2f} m/s")
    if quality.condition[follower] > LARGE_CONDITION:
        reasons.append(
            f"the law's terms are nearly proportional (condition number"
            f" {quality.condition[follower]:.0f})"
        )
    return reasons


def _listed(parts: list[str]) -> str:
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
