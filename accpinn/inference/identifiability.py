"""Plain warnings where the data cannot tell α, β and τ, whichever method is asked."""

import numpy as np

from accpinn.inference.intervals import Uncertainty
from accpinn.model.cthp import Case
from accpinn.recordings.checks import LITTLE_LEADER_MOTION
from accpinn.segment.quality import (
    LARGE_CONDITION,
    LITTLE_RELATIVE_MOTION,
    Quality,
    assess_quality,
)
from accpinn.segment.segment import Segment

SYMBOLS = ("α", "β", "τ")
DIGITS = (4, 4, 3)
WIDE = 5.0
"""An interval whose upper end is more than so many times its lower one says little more than the
order of magnitude."""
MORE_MOTION = "take a window in which the vehicle ahead brakes and accelerates more"
MORE_TIME = "the vehicle ahead moves enough here, so take a longer window if there is one"


def identifiability_warnings(
    segment: Segment, uncertainty: Uncertainty, case: Case = "II"
) -> tuple[str, ...]:
    """One sentence for each follower whose parameters the data leave open; empty where none is.

    Args:
        segment: the data.
        uncertainty: its intervals.
        case: "II"; in Case I all followers share one sentence.
    """
    quality = assess_quality(segment)
    if case == "I":
        told = [("All followers together", _leader_reasons(quality))]
    else:
        told = [(label, _reasons(quality, k)) for k, label in enumerate(segment.labels[1:])]
    sentences = []
    for k, (label, why) in enumerate(told):
        open_ends = _open(uncertainty, k)
        because = f", as {' and '.join(why)}" if why else ""
        if open_ends:
            sentences.append(
                f"{label}: these data leave {_listed(open_ends)} open by more than a factor of"
                f" {WIDE:g}{because}; {MORE_MOTION if why else MORE_TIME}."
            )
        elif why:
            sentences.append(f"{label}: take the intervals with care{because}.")
    return tuple(sentences)


def wide_intervals(uncertainty: Uncertainty, follower: int) -> tuple[str, ...]:
    """Those of α, β, τ whose interval says little more than the order of magnitude."""
    ends = zip(uncertainty.lower[follower], uncertainty.upper[follower], strict=True)
    # An interval that is 0 alone is narrow: `Uncertainty.notes` says what it means.
    return tuple(
        symbol for symbol, (low, high) in zip(SYMBOLS, ends, strict=True) if high > WIDE * low
    )


def _open(uncertainty: Uncertainty, follower: int) -> list[str]:
    """The parameters with wide intervals, each with its ends."""
    found = []
    for symbol in wide_intervals(uncertainty, follower):
        which = SYMBOLS.index(symbol)
        low, high = (ends[follower, which] for ends in (uncertainty.lower, uncertainty.upper))
        to = f"to {high:.{DIGITS[which]}f}" if np.isfinite(high) else "or more"
        found.append(f"{symbol} ({low:.{DIGITS[which]}f} {to})")
    return found


def _leader_reasons(quality: Quality) -> list[str]:
    if quality.leader_deviation >= LITTLE_LEADER_MOTION:
        return []
    return [f"the leader's speed varies by only {quality.leader_deviation:.2f} m/s"]


def _reasons(quality: Quality, follower: int) -> list[str]:
    reasons = _leader_reasons(quality)
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
