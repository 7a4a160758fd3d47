"""The data of the likelihood: measurements of followers, grouped by shared parameters.

Receivers report every 0.25 s and files of 10 Hz are smooth curves through the reports, so
neighbouring samples share their noise. One sample each 0.5 s is used. Missing samples are those
that the filter does not take in, so recordings with holes are used whole. One set of parameters may
hold for several series: the followers of a platoon (Case I), or several windows of one vehicle.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from accpinn.errors import SegmentError
from accpinn.model.cthp import Case
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask, MetresPerSecond, Seconds, stretches

SPACING: Seconds = 0.5
"""Between the samples used; see above."""
LEAST_SAMPLES = 40
LEAST_MOTION: MetresPerSecond = 0.05
"""Deviation of a speed below which it may be noise alone, and no parameter is determined."""
SHORTEST_STRETCH = 10
"""Samples; what is left between masked instants and is shorter says next to nothing."""


@dataclass(frozen=True, eq=False)
class Series:
    """Measurements of p, v, u, one sample each `step`, and which of them share one set."""

    measured: FloatArray
    """(N, 3, S); nan where missing, and after the end of a series shorter than others."""
    group: tuple[int, ...]
    """(S,) 0 to G-1: the set of parameters that each series belongs to."""
    step: Seconds

    @property
    def groups(self) -> int:
        """G."""
        return max(self.group) + 1

    def members(self, group: int) -> list[int]:
        """The series of a group."""
        return [k for k, of in enumerate(self.group) if of == group]

    def until(self, share: float) -> "Series":
        """The series up to a share of the time."""
        return Series(self.measured[: round(share * len(self.measured))], self.group, self.step)


def series_of(
    segments: Sequence[Segment], case: Case, followers: Sequence[int] | None = None
) -> Series:
    """The series of each follower; one group a follower (Case II), or one for all (Case I).

    The segments are windows of the same vehicles with the same step. Where the model's equation
    does not count (the segment's mask), a series ends, and another one begins after it. Case II may
    take some ``followers`` alone, 0 for the first.

    Raises:
        SegmentError: when too little of a follower is measured.
    """
    chosen = range(segments[0].followers) if followers is None or case == "I" else followers
    parts = [_measured_parts(segments, k) for k in chosen]
    counts = [sum(map(_complete, pieces)) for pieces in parts]
    if lacking := [k for k, count in zip(chosen, counts, strict=True) if count < LEAST_SAMPLES]:
        if case == "II" or sum(counts) < LEAST_SAMPLES:
            segment, least = segments[0], f"at least {LEAST_SAMPLES * SPACING:g} s"
            cure = f"take a window in which {least} count and are measured"
            if len(lacking) == segment.followers:
                raise SegmentError(
                    f"{segment.source}: what is left of {segment.window} is too short for the"
                    f" likelihood; {cure}."
                )
            who = " and ".join(segment.labels[k + 1] for k in lacking)
            raise SegmentError(
                f"{segment.source}: too little of {who} is measured at {segment.window} for the"
                f" likelihood; choose other vehicles, or {cure}."
            )
    group = [0 if case == "I" else at for at, pieces in enumerate(parts) for _ in pieces]
    every = [part for pieces in parts for part in pieces]
    measured = np.full((max(map(len, every)), 3, len(every)), np.nan)
    for k, part in enumerate(every):
        measured[: len(part), :, k] = part
    step = stride_of(segments[0]) * segments[0].sample_time
    return Series(measured, tuple(group), step)


def _measured_parts(segments: Sequence[Segment], follower: int) -> list[FloatArray]:
    """The pieces (N, 3) of a follower that count, but for those too short to inform."""
    parts = []
    for segment in segments:
        measured, mask = measured_of(segment)[:, :, follower], segment.mask
        stride = stride_of(segment)
        rows = np.ones(len(measured), bool) if mask is None else mask[::stride, follower]
        pieces = [measured[stretch.rows] for stretch in stretches(rows)]
        parts += [piece for piece in pieces if _complete(piece) >= SHORTEST_STRETCH]
    return parts


def _complete(measured: FloatArray) -> int:
    """The number of samples (N, 3) that have p, v and u."""
    return int((~np.isnan(measured)).all(axis=1).sum())


def stride_of(segment: Segment) -> int:
    """Samples of the segment from one that is used to the next."""
    return max(1, round(SPACING / segment.sample_time))


def measured_of(segment: Segment) -> FloatArray:
    """(N, 3, M): p, v and the speed ahead of each follower at the samples used; nan if missing."""
    speeds = segment.measured_speeds
    pairs = (segment.measured_gaps, speeds[:, 1:], speeds[:, :-1])
    return np.stack(pairs, axis=1)[:: stride_of(segment)]


def determined_followers(segments: Sequence[Segment], case: Case) -> tuple[int, ...]:
    """The followers whose parameters the likelihood determines; in Case I all or none.

    Enough of them is measured, and in some segment they or the vehicle ahead move.
    """
    moves = np.any([moving(segment, case) for segment in segments], axis=0)
    followers = range(segments[0].followers)
    counts = [sum(map(_complete, _measured_parts(segments, k))) for k in followers]
    if case == "I":
        counts = [sum(counts)] * len(counts)
    return tuple(k for k in followers if counts[k] >= LEAST_SAMPLES and moves[k])


def moving(segment: Segment, case: Case) -> Mask:
    """(M,) whether a follower or the vehicle ahead changes its speed by more than noise does."""
    varies = segment.speeds.std(axis=0) > LEAST_MOTION
    moves = varies[1:] | varies[:-1]
    return np.full_like(moves, moves.any()) if case == "I" else moves
