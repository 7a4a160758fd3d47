"""The law over steps of a second, which quietens the receivers' noise.

    (v(t + T) - v(t)) / T = mean over [t, t + T] of (p, -v, Δv) θ,    T = 1 s

Differences between samples would consist of noise.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accpinn.model.cthp import regressors
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

STEP: Seconds = 1.0


@dataclass(frozen=True, eq=False)
class OneSecondMeans:
    """K steps of M followers."""

    rates: FloatArray
    """(M, K) mean dv/dt in m/s²."""
    terms: FloatArray
    """(M, K, 3) means of p [m], -v [m/s], Δv [m/s]."""
    known: NDArray[np.bool_]
    """(M, K) False where the segment leaves a sample out."""
    samples: int
    """In a step."""
    length: Seconds
    """Of a step: T, or the sample time if that is longer."""


def one_second_means(segment: Segment, first: int = 0, delay: int = 0) -> OneSecondMeans:
    """The steps of a segment; what is left of a second at its end is dropped.

    Args:
        segment: the data.
        first: sample at which the first step begins.
        delay: samples by which the terms are older than the rates, at most ``first``.
    """
    samples = max(1, round(STEP / segment.sample_time))
    count = (segment.samples - 1 - first) // samples
    last, length = first + count * samples, samples * segment.sample_time
    speeds = segment.speeds[first : last + 1 : samples, 1:]
    terms = regressors(segment.speeds, segment.gaps)[:, first - delay : last - delay + 1]
    trapezoid = (terms[:, 1:] + terms[:, :-1]) / 2
    known: NDArray[np.bool_] = np.ones((segment.followers, count), dtype=bool)
    if segment.mask is not None:
        kept = segment.mask
        # A step has both its ends in it, and so have its terms.
        both = kept[first : last + 1] & kept[first - delay : last - delay + 1]
        pairs = both[1:] & both[:-1]
        known = np.asarray(pairs.reshape(count, samples, -1).all(axis=1).T)
    return OneSecondMeans(
        rates=np.diff(speeds, axis=0).T / length,
        terms=trapezoid.reshape(len(terms), count, samples, 3).mean(axis=2),
        known=known,
        samples=samples,
        length=length,
    )
