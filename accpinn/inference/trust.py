"""The reliability of an estimate, judged by its own windows.

In how many windows is the time gap of the window alone that of the estimate, and does the estimate
reproduce the drive? For the second the vehicle is driven in every window behind the measured
vehicle ahead, from its first measured state on, and anew after instants that are excluded; the
error of its gap is compared with how much the gap itself varies. A simulation that is half as far
off as a gap that stands still has explained three quarters of its variance.
"""

from collections.abc import Sequence

import numpy as np

from accpinn.evaluation.closed_loop import simulable, simulated
from accpinn.findings import Finding, Labelled, Words
from accpinn.methods.simulation import counted_stretches
from accpinn.model.cthp import Parameters, collides
from accpinn.model.registry import time_gap
from accpinn.segment import Segment
from accpinn.units import Metres, MetresPerSecond

ALIKE = 0.05
"""Relative difference up to which two time gaps are called the same."""
REPRODUCED = 0.5
"""Error of the gap, as a share of its own deviation, up to which a drive is reproduced."""
FAR: Metres = 1000.0
"""Error beyond which a simulation has diverged."""


class Trust(Finding, frozen=True):
    """Repeatability of one vehicle's estimate over windows, and its error in simulation."""

    vehicle: int
    windows: int
    same: int | None
    """Number of windows whose own time gap is within `ALIKE` of the estimate's at ``speed``; None
    where the method does not estimate each window by itself."""
    speed: MetresPerSecond
    """Speed at which the estimate states its time gap."""
    rmse: Metres
    """Error of the simulated gap; nan where nothing can be simulated."""
    deviation: Metres
    """Standard deviation of the measured gap about its mean in each window."""
    collides: bool
    """Whether a simulated gap ends at the vehicle ahead while the measured one does not."""

    @property
    def is_contradicted(self) -> bool:
        """Whether the drive is not reproduced, or half of several windows have another time gap."""
        return bool(self.reasons)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Contradictions between the estimate and its windows, each in a few words."""
        differs = self.windows > 1 and self.same is not None and 2 * self.same <= self.windows
        drive = "collides in simulation" if self.collides else "misses the drive"
        drive = drive if np.isfinite(self.rmse) else "drive not simulated"
        return ("windows differ",) * differs + (drive,) * (not self.is_reproduced)

    @property
    def is_reproduced(self) -> bool:
        """Whether the estimate reproduces the drive."""
        return not self.collides and self.rmse <= REPRODUCED * self.deviation

    text = "{vehicle}: {in_words}"

    def _words(self, about: Labelled) -> Words:
        return {"in_words": self.in_words}

    @property
    def in_words(self) -> str:
        """Both, without the vehicle."""
        off = f"{self.rmse:.1f} m (rms; the gap's standard deviation is {self.deviation:.1f} m)"
        if not np.isfinite(self.rmse):
            drive = "The drive cannot be simulated."
        elif self.is_reproduced:
            drive = f"The model reproduces the drive within {off}."
        elif self.collides:
            drive = f"The simulated car collides; gap error {self.rmse:.1f} m (rms)."
        else:
            drive = (
                f"The model misses much of the drive: its gap is {self.rmse:.1f} m off (rms), while"
                f" the gap's standard deviation is {self.deviation:.1f} m."
            )
        return f"{_agreement(self.windows, [self.same])} {drive}"


def trust_of_several(trusts: Sequence[Trust]) -> str:
    """A summary in words of several vehicles whose drives are all reproduced."""
    errors = _range([trust.rmse for trust in trusts])
    deviations = _range([trust.deviation for trust in trusts])
    return (
        f"{_agreement(trusts[0].windows, [trust.same for trust in trusts])} The model reproduces"
        f" the drives within {errors} m (rms; the gaps' standard deviations: {deviations} m)."
    )


def _agreement(windows: int, same: Sequence[int | None]) -> str:
    """The number of windows whose time gap is that of the estimate, in words."""
    counts = [count for count in same if count is not None]
    if windows == 1:
        return "Based on one window."
    if not counts:
        return f"Based on {windows} windows."
    low, high = min(counts), max(counts)
    count = str(low) if low == high else f"{low} to {high}"
    return f"Repeatable in {count} of {windows} windows (time gap within {100 * ALIKE:.0f} %)."


def _range(values: Sequence[float]) -> str:
    low, high = (f"{value:.1f}" for value in (min(values), max(values)))
    return low if low == high else f"{low}–{high}"


def trust(
    segments: Sequence[Segment],
    vehicle: int,
    followers: Sequence[int],
    model: str,
    parameters: Parameters,
    by_window: Parameters | None,
    speed: MetresPerSecond,
) -> Trust:
    """Hold the parameters of a vehicle against its windows (K,) and their own ones (K,).

    The vehicle is its number, or 0 for all followers together; ``followers`` are their places, 0
    for the first. Time gaps are compared at the speed in m/s.
    """
    pairs = [
        stretch
        for segment in segments
        for follower in followers
        for stretch in counted_stretches(segment.pair(follower))
    ]
    gap, same = float(time_gap(model, parameters, speed)), None
    if by_window is not None:
        same = int((np.abs(time_gap(model, by_window, speed) - gap) <= ALIKE * gap).sum())
    errors, is_collided = np.empty(0), False  # of the simulated gap in m
    for pair in pairs:
        motion = simulated(pair, model, parameters[None])
        if motion is None:
            continue
        rows = np.concatenate([np.arange(pair.samples)[piece.rows] for piece in simulable(pair)])
        gaps, true_gaps = np.nan_to_num(motion.gaps[rows, 0], nan=FAR), pair.measured_gaps[rows, 0]
        errors = np.append(errors, gaps - true_gaps)
        is_collided |= bool((collides(gaps) & (true_gaps > 0)).any())
    finite = np.clip(errors[np.isfinite(errors)], -FAR, FAR)
    measured = [pair.measured_gaps[np.isfinite(pair.measured_gaps)] for pair in pairs]
    counts = [len(gaps) for gaps in measured]
    squares = [len(gaps) * np.var(gaps) for gaps in measured if len(gaps)]
    return Trust(
        vehicle,
        len(segments),
        same,
        speed,
        float(np.sqrt(np.mean(finite**2))) if len(finite) else float("nan"),
        float(np.sqrt(sum(squares) / sum(counts))) if sum(counts) else float("nan"),
        is_collided,
    )
