"""A segment without a stretch of time, for methods that are to know nothing of it.

A stretch at either end is cut off. One in the middle is left out of the law, as a regime is, and
what was measured there is replaced by a bridge: the leader's speed is straight, each space-gap the
cubic with the values and slopes (Δv) of both banks, the followers' speeds follow from dp/dt = Δv.
So even a method that smooths over it sees nothing of it, and nothing is spliced: both sides keep
their time. The bridge itself moves an estimate by less than half a percent.
"""

from dataclasses import replace

import numpy as np

from accpinn.segment.segment import Segment
from accpinn.units import FloatArray


def without(segment: Segment, first: int, end: int) -> Segment:
    """The segment without its samples ``first`` to ``end`` - 1."""
    if first == 0:
        return part(segment, end, segment.samples)
    if end == segment.samples:
        return part(segment, 0, first)
    mask = np.ones(segment.gaps.shape, dtype=bool) if segment.mask is None else segment.mask.copy()
    mask[first:end] = False
    speeds, gaps = segment.speeds.copy(), segment.gaps.copy()
    speeds[first:end], gaps[first:end] = _bridge(segment, first - 1, end)
    return replace(segment, speeds=speeds, gaps=gaps, mask=mask)


def part(segment: Segment, first: int, end: int) -> Segment:
    """Samples ``first`` to ``end`` - 1 of a segment, as a segment of its own."""
    rows = slice(first, end)
    return replace(
        segment,
        time=segment.time[rows] - segment.time[first],
        speeds=segment.speeds[rows],
        gaps=segment.gaps[rows],
        mask=None if segment.mask is None else segment.mask[rows],
        start=segment.start + float(segment.time[first]),
    )


def _bridge(segment: Segment, near: int, far: int) -> tuple[FloatArray, FloatArray]:
    """Speeds (K, M+1) and gaps (K, M) between two samples, from these two alone."""
    length = segment.time[far] - segment.time[near]
    s = ((segment.time[near + 1 : far] - segment.time[near]) / length)[:, None]
    relative = segment.speeds[:, :-1] - segment.speeds[:, 1:]
    gap, other, slope, last = (
        values[at] for values in (segment.gaps, length * relative) for at in (near, far)
    )
    rise = other - gap
    # Hermite's cubic and its derivative.
    gaps = gap + slope * s + (3 * rise - 2 * slope - last) * s**2 + (slope + last - 2 * rise) * s**3
    rates = slope + 2 * (3 * rise - 2 * slope - last) * s + 3 * (slope + last - 2 * rise) * s**2
    leader = (1 - s) * segment.speeds[near, 0] + s * segment.speeds[far, 0]
    return np.hstack([leader, leader - np.cumsum(rates, axis=1) / length]), gaps
