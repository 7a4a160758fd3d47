"""Identifiability: which parameters the data determine, by intervals and excitation."""

from collections.abc import Sequence
from itertools import compress

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.findings import Finding, Labelled, Words, joined
from accpinn.inference.intervals import Uncertainty
from accpinn.model.cthp import Case
from accpinn.recordings import LITTLE_LEADER_MOTION
from accpinn.segment import SegmentInfo
from accpinn.segment.quality import LARGE_CONDITION, LITTLE_RELATIVE_MOTION, Quality
from accpinn.units import Mask, MetresPerSecond, Seconds

SYMBOLS = tuple(parameter.symbol for parameter in PARAMETERS)
WIDE = 5.0
"""Ratio of an interval's ends above which it gives little more than the order of magnitude."""
LONGER = 1.2
"""Ratio of recording to window above which the whole recording would narrow intervals by a tenth or
more."""


class WeakIdentification(Finding, frozen=True):
    """A follower's intervals are wide, or its data have little excitation."""

    text = "{vehicle}: {spans} more than a factor of {limit:g}{reasons}."
    text_if_narrow = "{vehicle}: treat the intervals with caution{reasons}."

    vehicle: int
    wide: tuple[str, ...] = ()
    """Symbols of the parameters; empty if only the excitation is too small."""
    leader_deviation: MetresPerSecond | None = None
    """Standard deviation of the leader's speed, if it is too small."""
    relative_deviation: MetresPerSecond | None = None
    """Standard deviation of Δv, if it is too small."""
    condition: float | None = None
    """Condition number of the regressors, if it is too large."""

    @property
    def is_excited(self) -> bool:
        """Whether the excitation is sufficient."""
        return self.leader_deviation is self.relative_deviation is self.condition is None

    def sentence(self, about: Labelled) -> str:
        """The finding as a sentence, which depends on whether an interval is wide."""
        return self.filled(self.text if self.wide else self.text_if_narrow, about)

    def _words(self, about: Labelled) -> Words:
        reasons = []
        if self.leader_deviation is not None:
            reasons.append(f"the leader's speed varies by only {self.leader_deviation:.2f} m/s")
        if self.relative_deviation is not None:
            reasons.append(f"Δv varies by only {self.relative_deviation:.2f} m/s")
        if self.condition is not None:
            number = f"condition number {self.condition:.0f}"
            reasons.append(f"the model's terms are nearly proportional ({number})")
        spans = "interval of {} spans" if len(self.wide) == 1 else "intervals of {} span"
        return {
            "spans": f"the {spans.format(joined(self.wide))}",
            "limit": WIDE,
            "reasons": f", as {joined(reasons)}" if reasons else "",
        }


class NarrowerIntervals(Finding, frozen=True):
    """Advice on narrowing the wide intervals of a segment."""

    text = "These would narrow the intervals of {vehicles}: {ways}."

    vehicles: tuple[int, ...]
    """The followers with wide intervals or without any."""
    window: Seconds
    """Duration of the window."""
    recording: Seconds | None
    """Duration of the recording, if it is known and longer than the window."""
    is_excited: bool
    """Whether the excitation is sufficient, so that a longer window alone would narrow them."""

    def _words(self, about: Labelled) -> Words:
        ways = ["several windows or runs estimated together"]
        if not self.is_excited:
            ways.insert(0, "a window in which the vehicle ahead brakes and accelerates more")
        if self.recording is not None:
            durations = f"{self.recording:,.0f} s; this window has {self.window:,.0f} s"
            ways.insert(0, f"the whole recording ({durations})")
        elif self.is_excited:
            ways.insert(0, "a longer recording")
        return {"ways": ", or ".join(ways)}


def identifiability(
    info: SegmentInfo,
    quality: Quality,
    uncertainty: Uncertainty,
    case: Case = "II",
    recording: Seconds | None = None,
) -> tuple[WeakIdentification | NarrowerIntervals, ...]:
    """The followers that the data determine only weakly, and what would narrow their intervals.

    In Case I all followers share one finding. The duration of the ``recording`` that the window was
    cut from need not be known.
    """
    leader, wide = quality.leader_deviation, wide_intervals(uncertainty)
    weak = []
    for k, vehicle in enumerate((0,) if case == "I" else info.vehicles[1:]):
        relative, condition = quality.relative_deviation[k], quality.condition[k]
        is_alone = vehicle > 0
        finding = WeakIdentification(
            vehicle,
            tuple(compress(SYMBOLS, wide[k])),
            leader if leader < LITTLE_LEADER_MOTION else None,
            relative if is_alone and relative < LITTLE_RELATIVE_MOTION else None,
            condition if is_alone and condition > LARGE_CONDITION else None,
        )
        if finding.wide or not finding.is_excited:
            weak.append(finding)
    return (*weak, *_narrower(info, uncertainty, weak, recording))


def _narrower(
    info: SegmentInfo,
    uncertainty: Uncertainty,
    warnings: Sequence[WeakIdentification],
    recording: Seconds | None,
) -> tuple[NarrowerIntervals, ...]:
    """Advice on narrowing the wide intervals; empty if none is wide."""
    wide = {warning.vehicle for warning in warnings if warning.wide}
    unknown = np.isnan(uncertainty.centre.alpha)
    vehicles = tuple(
        vehicle
        for vehicle, is_unknown in zip(info.vehicles[1:], unknown, strict=True)
        if is_unknown or vehicle in wide or 0 in wide
    )
    if not vehicles:
        return ()
    duration = info.window.duration
    longer = recording if recording and recording > LONGER * duration else None
    is_excited = all(w.is_excited for w in warnings if w.wide) and not unknown.any()
    return (NarrowerIntervals(vehicles, duration, longer, is_excited),)


def wide_intervals(uncertainty: Uncertainty) -> Mask:
    """(M, 3) whether an interval of α, β or τ gives little more than the order of magnitude.

    One that is not known does not, nor does one that contains only 0. One whose ends are equal
    does: there all draws of the posterior collapsed on one, as where nothing but noise moves, and
    they say nothing.
    """
    lower, upper = uncertainty.lower.values, uncertainty.upper.values
    is_open, is_point = ~np.isfinite(upper), (upper == lower) & (lower > 0.0)
    return np.asarray(np.isfinite(lower) & (is_open | is_point | (upper > WIDE * lower)))
