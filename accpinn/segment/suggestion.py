"""A window to estimate parameters from: complete, in car-following under ACC, best excitation.

The information that a window holds about the parameters of follower i is that of the regression of
its acceleration (Fedorov, Theory of Optimal Experiments, 1972):

    I_i = Σ_t x_t x_tᵀ,   x = (p, -v, Δv),   over the instants in car-following

Of all windows, those are kept whose share of car-following is close to the largest; among them the
one with the largest Σ_i log det I_i is D-optimal. Two windows compare by their relative
D-efficiency, exp((Σ_i log det I_i - Σ_i log det I'_i)/3M): the first is as informative as the
second if that lasted longer by this factor. Instants driven by hand do not count (see the regimes
of `segment.quality`); where the file has no driver modes, it is not known who drove.
"""

from dataclasses import dataclass

import numpy as np

from accpinn.model.cthp import regressors
from accpinn.recordings import Recording, Window
from accpinn.segment import Segment
from accpinn.segment.cut import DURATION, SLACK, complete_windows
from accpinn.segment.quality import FOLLOWING, MANUAL, Regimes
from accpinn.units import FloatArray, Mask, Seconds

GRID: Seconds = 5.0
"""Step between the starts of windows."""
NEARLY = 0.05
"""Difference of shares of car-following up to which they count as the same."""


@dataclass(frozen=True)
class Suggestion:
    """The most informative window of a recording about the parameters of M followers."""

    window: Window
    car_following: float
    """The smallest share of the window's instants in car-following of any follower, 0 to 1."""
    manual: float | None
    """The largest share driven by hand of any follower; None where it is 0 as far as is known, but
    the file does not give every follower's modes."""
    candidates: int
    """Number of windows that were compared."""

    @property
    def shortened(self) -> bool:
        """Whether no complete stretch has the usual length."""
        return self.window.duration < DURATION - SLACK


@dataclass(frozen=True, eq=False)
class Information:
    """Information of a recording's windows about the parameters of M followers."""

    start: Seconds
    """First instant, in the recording's time."""
    step: Seconds
    following: Mask
    """(N, M) True where a follower is in car-following."""
    manual: Mask
    """(N, M) True where it is driven by hand."""
    terms: FloatArray
    """(M, N, 3) x in car-following, else zero."""
    mode_known: bool
    """Whether the file has driver modes of every follower."""

    @classmethod
    def of(cls, segment: Segment, regimes: Regimes) -> "Information":
        """The information of a segment, which may be a whole recording with samples missing."""
        counts = (regimes.codes == FOLLOWING) & segment.counts
        return cls(
            start=segment.start,
            step=segment.sample_time,
            following=counts,
            manual=regimes.codes == MANUAL,
            terms=np.where(counts.T[..., None], regressors(segment.speeds, segment.gaps), 0.0),
            mode_known=all(regimes.mode_known),
        )

    def _rows(self, window: Window) -> slice:
        first, last = (round((t - self.start) / self.step) for t in (window.start, window.end))
        return slice(max(first, 0), last + 1)

    def _share(self, holds: Mask, window: Window) -> FloatArray:
        share = holds[self._rows(window)].sum(axis=0) / (round(window.duration / self.step) + 1)
        return np.asarray(share)

    def car_following(self, window: Window) -> float:
        """The smallest share of any follower in car-following, 0 to 1."""
        return float(self._share(self.following, window).min())

    def by_hand(self, window: Window) -> float | None:
        """The largest share of any follower driven by hand; see `Suggestion.manual`."""
        share = float(self._share(self.manual, window).max())
        return share if share or self.mode_known else None

    def log_det(self, window: Window) -> float:
        """Σ_i log det I_i; minus infinity where some follower is never in car-following."""
        terms = self.terms[:, self._rows(window)]
        signs, logs = np.linalg.slogdet(terms.transpose(0, 2, 1) @ terms)
        return float(logs.sum()) if (signs > 0).all() else -np.inf

    def efficiency(self, window: Window, best: Window) -> float:
        """The relative D-efficiency of a window against another; 0 without any information."""
        followers = self.following.shape[1]
        return float(np.exp((self.log_det(window) - self.log_det(best)) / (3 * followers)))


def suggest_window(
    recording: Recording, vehicles: tuple[int, ...], information: Information
) -> Suggestion | None:
    """The most informative window of the usual length about the followers' parameters.

    It is None where no stretch is complete, or a follower never in car-following. The information
    is that of the whole recording's segment of these vehicles, leader first.

    Raises:
        SegmentError: when the vehicles are no platoon.
    """
    candidates = _candidates(complete_windows(recording, vehicles))
    if not candidates:
        return None
    shares = np.array([information.car_following(window) for window in candidates])
    nearly_best = [w for w, s in zip(candidates, shares, strict=True) if s > shares.max() - NEARLY]
    best = max(nearly_best, key=information.log_det)
    if not np.isfinite(information.log_det(best)):
        return None
    following, manual = information.car_following(best), information.by_hand(best)
    return Suggestion(best, following, manual, len(candidates))


def _candidates(complete: tuple[Window, ...]) -> list[Window]:
    """Windows of the usual length on a grid; the longest stretch where none is as long."""
    windows = []
    for stretch in complete:
        first = np.ceil((stretch.start - SLACK) / GRID) * GRID + 0.0
        latest = stretch.end - DURATION
        starts = [float(s) for s in np.arange(first, latest + SLACK, GRID)]
        if not starts and stretch.duration >= DURATION - SLACK:
            starts = [stretch.start]
        windows += [Window(start, round(start + DURATION, 9)) for start in starts]
    longest = max(complete, key=lambda stretch: stretch.duration, default=None)
    return windows or ([longest] if longest else [])
