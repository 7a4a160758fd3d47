"""Correlations of the model's residual: with itself, and with the acceleration ahead.

    e(t) = (v(t + T) - v(t)) / T - mean over [t, t + T] of the model's acceleration,    T = 1 s

Means over a second reduce the receivers' noise, which would dominate differences between samples.
Where the residual is correlated with the acceleration ahead, some of the vehicle's response to it
is missing in the model. By chance alone such correlations are normal with the variance
Σ_k ρ_e(k) ρ_u(k) / N, and those of a white residual with itself with 1/N (Ljung, System
Identification, 2nd ed., 1999, section 16.6).

Seconds with a missing sample do not count.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from accpinn.methods.estimate import Estimate
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask, Seconds

STEP: Seconds = 1.0
"""T, the length of a step."""
FEWEST = 30
"""Fewest seconds from which a correlation is computed."""
LONGEST_LAG = 20
"""Most seconds between two values that are correlated."""
CONFIDENCE = 0.99
"""Share of correlations by chance that lie within their limits."""


class Correlogram(NamedTuple):
    """Correlations of one follower's residual over L lags."""

    lags: FloatArray
    """(L,) in s."""
    values: FloatArray
    """(L,)"""
    limit: float
    """Within ± this 99 % of them lie by chance."""


def residual_correlations(
    segment: Segment, estimate: Estimate, follower: int
) -> tuple[Correlogram, Correlogram] | None:
    """A follower's residual (0 for the first) with itself, and with the acceleration ahead.

    Above a lag of zero it comes after that acceleration. None where too little is measured.
    """
    residuals, counts, size = residuals_of(segment, estimate)
    residual, mask, second = residuals[follower], counts[follower], size * segment.sample_time
    speeds = segment.speeds[::size, follower][: len(residual) + 1]
    ahead = np.diff(speeds) / second
    count = int(mask.sum())
    if count < FEWEST:
        return None
    e, u = (np.where(mask, part - part[mask].mean(), 0.0) for part in (residual, ahead))
    if not e.any() or not u.any():
        return None
    longest = min(LONGEST_LAG, count // 3)
    of_e, of_u = _correlations(e, mask), _correlations(u, mask)
    scale = np.sqrt((e**2).sum() * (u**2).sum())
    lags = np.arange(-longest, longest + 1)
    full = np.correlate(e, u, "full")[len(e) - 1 + lags] / scale
    inflation = 1.0 + 2.0 * float((of_e[1 : longest + 1] * of_u[1 : longest + 1]).sum())
    limit = float(ndtri(0.5 + CONFIDENCE / 2) / np.sqrt(count))
    after: FloatArray = np.asarray(lags * second, float)
    autocorrelation = Correlogram(after[longest + 1 :], of_e[1 : longest + 1], limit)
    return autocorrelation, Correlogram(after, full, limit * float(np.sqrt(max(inflation, 1.0))))


def residuals_of(segment: Segment, estimate: Estimate) -> tuple[FloatArray, Mask, int]:
    """The residuals (M, K) in m/s² of an estimate over each second, and which of them count.

    A second with a sample that does not count or is missing does not count, either. The last value
    is the number of samples in a second; what is left of one at the end is dropped.
    """
    model, speeds = estimate.following, segment.speeds
    theta = np.array([estimate.values(estimate.parameters, name) for name in model.names])
    if model.is_linear:  # τ has no effect where α = 0
        theta = np.nan_to_num(theta)
    command = model.acceleration(segment.gaps, speeds[:, 1:], speeds[:, :-1], theta, np)
    reached = np.asarray(command, float).copy()
    for k, (lag, delay) in enumerate(estimate.parameters.complete[:, 4:]):
        late = np.interp(segment.time - delay, segment.time, command[:, k])
        reached[:, k] = _lagged(late, np.exp(-segment.sample_time / lag)) if lag > 0 else late
    size = max(1, round(STEP / segment.sample_time))
    count = (segment.samples - 1) // size
    shape, last = (count, size, segment.followers), count * size
    rates = np.diff(speeds[: last + 1 : size, 1:], axis=0) / (size * segment.sample_time)
    between = (reached[1 : last + 1] + reached[:last]) / 2  # straight between samples
    # A second has both its ends in it.
    complete = segment.counts[1 : last + 1] & segment.counts[:last]
    means, counts = between.reshape(shape).mean(axis=1), complete.reshape(shape).all(axis=1)
    return (rates - means).T, np.asarray(counts.T), size


def _lagged(command: FloatArray, keep: float) -> FloatArray:
    """(N,) what a first-order lag makes of a command that was constant before."""
    from scipy.signal import lfilter  # takes a second to import, which few need

    return np.asarray(lfilter([1 - keep], [1, -keep], command, zi=[keep * command[0]])[0])


def _correlations(centred: FloatArray, mask: Mask) -> FloatArray:
    """ρ_k over the pairs of seconds that both count; far lags are damped as usual."""
    count = len(centred)
    products, pairs = (
        np.fft.irfft(np.abs(np.fft.rfft(series, 2 * count)) ** 2)[:count]
        for series in (centred, mask.astype(float))
    )
    covariance = products * (count - np.arange(count)) / np.maximum(pairs.round(), 1.0)
    return np.asarray(covariance / covariance[0])
