"""How far the answer of a vehicle can be trusted, by what its own recording says of it.

Two questions: in how many windows is the time gap of the window alone that of the answer, and does
the answer reproduce the drive? For the second the vehicle is driven in every window behind the
measured vehicle ahead, from its first measured state on; the error of its gap is compared with how
much the gap itself varies. A simulation that is half as far off as a gap that stands still has
explained three quarters of its variance.
"""

from collections.abc import Sequence

import numpy as np

from accpinn.evaluation.closed_loop import simulable
from accpinn.findings import Finding, Labelled, Words
from accpinn.model.cthp import Parameters, collides
from accpinn.model.registry import simulate, time_gap
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Metres, MetresPerSecond

ALIKE = 0.05
"""Relative difference up to which two time gaps are called the same."""
REPRODUCED = 0.5
"""Error of the gap, as a share of its own deviation, up to which a drive is reproduced."""
FAR: Metres = 1000.0
"""Error beyond which a simulation has diverged."""


class Trust(Finding, frozen=True):
    """What the windows say of one vehicle's answer."""

    vehicle: int
    """0 for all followers together."""
    windows: int
    same: int
    """Number of windows whose own time gap is within `ALIKE` of the answer's at ``speed``."""
    speed: MetresPerSecond
    """The vehicle's median speed."""
    rmse: Metres
    """Of the simulated gap; nan where nothing can be simulated."""
    deviation: Metres
    """Standard deviation of the measured gap."""
    collides: bool
    """Whether a simulated gap ends at the vehicle ahead while the measured one does not."""

    @property
    def is_reproduced(self) -> bool:
        """Whether the answer reproduces the drive."""
        return not self.collides and self.rmse <= REPRODUCED * self.deviation

    text = "{vehicle}: {in_words}"

    def _words(self, about: Labelled) -> Words:
        return {"in_words": self.in_words}

    @property
    def in_words(self) -> str:
        """Both answers, without the vehicle."""
        if self.windows == 1:
            same = "Known from one window alone."
        elif self.same == self.windows:
            of = "both windows" if self.windows == 2 else f"all {self.windows} windows"
            same = f"Its time gap is the same within {ALIKE:.0%} in {of}."
        else:
            of = f"{self.same} of {self.windows} windows"
            same = f"Its time gap is the same within {ALIKE:.0%} in {of}."
        varies = f"where the gap itself varies by {self.deviation:.1f} m"
        if not np.isfinite(self.rmse):
            drive = "The drive cannot be simulated."
        elif self.is_reproduced:
            drive = f"Reproduces the drive within {self.rmse:.1f} m, {varies}."
        elif self.collides:
            drive = f"Collides in the simulation of the drive, {self.rmse:.1f} m off."
        else:
            drive = f"Does not reproduce the drive: {self.rmse:.1f} m off, {varies}."
        return f"{same} {drive}".replace("%", " %")


def trust(
    segments: Sequence[Segment],
    vehicle: int,
    followers: Sequence[int],
    model: str,
    answer: Parameters,
    own: Parameters,
) -> Trust:
    """Hold an answer against its windows.

    Args:
        segments: (K,) the windows.
        vehicle: its number, or 0 for all followers together.
        followers: whose answer it is: its place, 0 for the first, or all places.
        model: key of the answer's.
        answer: the parameters of one vehicle.
        own: (K,) the estimates of each window alone.
    """
    pairs = [segment.pair(follower) for segment in segments for follower in followers]
    speed = float(np.median(np.concatenate([pair.speeds[:, 1] for pair in pairs])))
    gap, gaps = float(time_gap(model, answer, speed)), time_gap(model, own, speed)
    off = [_errors(pair, model, answer) for pair in pairs]
    errors = np.concatenate([part for part, _ in off])
    known = np.clip(errors[np.isfinite(errors)], -FAR, FAR)
    return Trust(
        vehicle,
        len(segments),
        int((np.abs(gaps - gap) <= ALIKE * gap).sum()),
        speed,
        float(np.sqrt(np.mean(known**2))) if len(known) else float("nan"),
        float(np.sqrt(np.nanmean([np.nanvar(pair.measured_gaps) for pair in pairs]))),
        any(collided for _, collided in off),
    )


def _errors(pair: Segment, model: str, answer: Parameters) -> tuple[FloatArray, bool]:
    """(n,) errors of the simulated gap of one follower in m, and whether it collides."""
    errors, collided = [np.empty(0)], False
    if not np.isfinite(answer.everything).all():
        return errors[0], collided
    for piece in simulable(pair):
        rows, measured = piece.rows, pair.measured_gaps[piece.rows, 0]
        start = pair.speeds[piece.first, 1:], pair.gaps[piece.first]
        with np.errstate(over="ignore", invalid="ignore"):  # what diverges counts as `FAR`
            times, ahead = pair.time[rows], pair.speeds[rows, 0]
            driven = simulate(model, answer[None], times, ahead, *start)
        gaps = np.nan_to_num(driven.gaps[:, 0], nan=FAR)
        errors.append(gaps - measured)
        collided |= bool((collides(gaps) & (measured > 0)).any())
    return np.concatenate(errors), collided
