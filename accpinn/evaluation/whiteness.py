"""The residual of the model: its size and its correlation over time.

    e(t) = (v(t + T) - v(t)) / T - mean over [t, t + T] of α(p - τv) + βΔv,    T = 1 s

Means over a second reduce the receivers' noise, which would dominate differences between samples.
The noise that remains alternates: neighbouring seconds share a speed, with opposite signs, so their
correlation lies between -0.5 (noise alone) and 0. If the residual were noise alone, seconds that
are not neighbours would be independent. The statistic

    z = √N (ρ₂ + .. + ρ₆) / √(Σ Σ c(j - k)),    c(0) = 1 + 2ρ₁², c(±1) = 2ρ₁, c(±2) = ρ₁²,

is then standard normal (Bartlett, JRSS Suppl. 8, 1946), and large where disturbances last. The
integrated autocorrelation time (Geyer's initial positive sequence, Statistical Science 7, 1992)
measures how long the residual lasts.

Where the residual is correlated with the acceleration ahead, some of the vehicle's response to it
is missing in the model. By chance alone such correlations are normal with the variance
Σ_k ρ_e(k) ρ_u(k) / N, and those of a white residual with itself with 1/N (Ljung, System
Identification, 2nd ed., 1999, section 16.6).

Seconds with a missing sample do not count.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import toeplitz
from scipy.special import ndtr, ndtri

from accpinn.findings import Finding, Labelled
from accpinn.methods.estimate import Fit
from accpinn.model.registry import CTHPS, FOLLOWING, value_of
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask, Seconds

STEP: Seconds = 1.0
"""T, the length of a step."""
LAGS = np.arange(2, 7)
"""Lags in s that the test sums over."""
FEWEST = 30
"""Fewest seconds from which a correlation is computed."""
CORRELATED = 0.01
"""Level of the test: below it, the residual is called correlated."""
LONGEST_LAG = 20
"""Most seconds between two values that are correlated."""
CONFIDENCE = 0.99
"""Share of correlations by chance that lie within their limits."""
NEGLIGIBLE = 0.02
"""Residual in m/s² that receivers' noise of 0.015 m/s and sampling alone produce."""


class ShortResidual(Finding, frozen=True):
    """The window is too short to test a follower's residual for correlation."""

    text = "{vehicle}: the window is too short to test whether the model's residual is white."

    vehicle: int


class WhiteResidual(Finding, frozen=True):
    """A follower's residual is not correlated beyond a second."""

    text = (
        "{vehicle}: the model's residual ({deviation:.2f} m/s²) is not correlated beyond a second."
    )
    text_if_negligible = (
        "{vehicle}: the model's residual ({deviation:.2f} m/s²) is no larger than noise and"
        " rounding make it."
    )

    vehicle: int
    deviation: float
    """Root mean square in m/s²."""

    def sentence(self, about: Labelled) -> str:
        """The finding as a sentence, which depends on the size of the residual."""
        is_negligible = self.deviation < NEGLIGIBLE
        return self.filled(self.text_if_negligible if is_negligible else self.text, about)


class CorrelatedResidual(Finding, frozen=True):
    """A follower's residual is correlated over time, so its samples are not independent."""

    text = (
        "{vehicle}: the model's residual ({deviation:.2f} m/s²) is correlated over about"
        " {memory:.0f} s, so {samples:,} samples estimate its mean no better than some"
        " {independent:.0f} independent ones."
    )

    vehicle: int
    deviation: float
    """Root mean square in m/s²."""
    memory: Seconds
    """The integrated autocorrelation time."""
    samples: int
    """Number of samples of the window that count."""
    independent: float
    """Number of independent samples that would estimate the mean equally well."""


WhitenessFinding = ShortResidual | WhiteResidual | CorrelatedResidual


@dataclass(frozen=True, eq=False)
class Whiteness:
    """The residual of each of M followers; nan where the window is too short."""

    deviation: FloatArray
    """(M,) root mean square in m/s²."""
    correlation: FloatArray
    """(M,) between one second and the next, -1 to 1."""
    memory: FloatArray
    """(M,) in s, the integrated autocorrelation time: 1 s where seconds are independent."""
    independent: FloatArray
    """(M,) number of independent samples that would estimate the residual's mean equally well."""
    probability: FloatArray
    """(M,) p-value of the test that all but neighbouring seconds are independent."""
    findings: tuple[WhitenessFinding, ...]
    """One finding per follower."""


def whiteness(segment: Segment, fit: Fit) -> Whiteness:
    """Compute the residual of the model with the fit's parameters.

    α = 0 with τ undetermined counts as ατ = 0. Instants that the segment's mask excludes are left
    out.
    """
    residuals, counts, size = residuals_of(segment, fit)
    pairs, second = zip(residuals, counts, strict=True), size * segment.sample_time
    figures = np.array([_figures(row, mask, second) for row, mask in pairs])
    samples = counts.sum(axis=1) * size
    rows = zip(segment.vehicles[1:], samples.tolist(), figures.tolist(), strict=True)
    findings = tuple(_finding(*row) for row in rows)
    deviation, correlation, memory, independent, probability = figures.T
    return Whiteness(deviation, correlation, memory, independent, probability, findings)


def residuals_of(segment: Segment, fit: Fit) -> tuple[FloatArray, Mask, int]:
    """The residuals (M, K) in m/s² of a fit's model over each second, and which of them count.

    A second with a sample that does not count or is missing does not count, either. The last value
    is the number of samples in a second; what is left of one at the end is dropped.
    """
    model, speeds = FOLLOWING[fit.model], segment.speeds
    theta = np.array([value_of(fit.model, fit.parameters, name) for name in model.names])
    if fit.model in CTHPS:  # τ has no effect where α = 0
        theta = np.nan_to_num(theta)
    command = model.acceleration(segment.gaps, speeds[:, 1:], speeds[:, :-1], theta, np)
    reached = np.asarray(command, float).copy()
    for k, (lag, delay) in enumerate(fit.parameters.complete[:, 4:]):
        late = np.interp(segment.time - delay, segment.time, command[:, k])
        reached[:, k] = _lagged(late, np.exp(-segment.sample_time / lag)) if lag > 0 else late
    size = max(1, round(STEP / segment.sample_time))
    count = (segment.samples - 1) // size
    shape, last = (count, size, segment.followers), count * size
    rates = np.diff(speeds[: last + 1 : size, 1:], axis=0) / (size * segment.sample_time)
    between = (reached[1 : last + 1] + reached[:last]) / 2  # straight between samples
    both = segment.counts[1 : last + 1] & segment.counts[:last]  # a second has both its ends in it
    means, counts = between.reshape(shape).mean(axis=1), both.reshape(shape).all(axis=1)
    return (rates - means).T, np.asarray(counts.T), size


def _lagged(command: FloatArray, keep: float) -> FloatArray:
    """(N,) what a first-order lag makes of a command that was constant before."""
    from scipy.signal import lfilter  # takes a second to import, which few need

    return np.asarray(lfilter([1 - keep], [1, -keep], command, zi=[keep * command[0]])[0])


class Correlogram(NamedTuple):
    """Correlations of one follower's residual over L lags."""

    lags: FloatArray
    """(L,) in s."""
    values: FloatArray
    """(L,)"""
    limit: float
    """Within ± this 99 % of them lie by chance."""


def residual_correlations(
    segment: Segment, fit: Fit, follower: int
) -> tuple[Correlogram, Correlogram] | None:
    """A follower's residual (0 for the first) with itself, and with the acceleration ahead.

    Above a lag of zero it comes after that acceleration. None where too little is measured.
    """
    residuals, counts, size = residuals_of(segment, fit)
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
    both = 1.0 + 2.0 * float((of_e[1 : longest + 1] * of_u[1 : longest + 1]).sum())
    limit = float(ndtri(0.5 + CONFIDENCE / 2) / np.sqrt(count))
    after: FloatArray = np.asarray(lags * second, float)
    own = Correlogram(after[longest + 1 :], of_e[1 : longest + 1], limit)
    return own, Correlogram(after, full, limit * float(np.sqrt(max(both, 1.0))))


def _finding(vehicle: int, samples: int, figures: list[float]) -> WhitenessFinding:
    deviation, _, memory, independent, probability = figures
    if np.isnan(probability):
        return ShortResidual(vehicle)
    if deviation < NEGLIGIBLE or probability >= CORRELATED or memory < 2.0 * STEP:
        return WhiteResidual(vehicle, deviation)
    return CorrelatedResidual(vehicle, deviation, memory, samples, independent)


def _figures(residual: FloatArray, mask: Mask, second: Seconds) -> list[float]:
    """Deviation, correlation, memory, independent samples and p-value of one residual."""
    count = int(mask.sum())
    if not count:
        return 5 * [float("nan")]
    deviation = float(np.sqrt((residual[mask] ** 2).mean()))
    centred = np.where(mask, residual - residual[mask].mean(), 0.0)
    if count < FEWEST or not centred.any():
        return [deviation, *4 * [float("nan")]]
    rho = _correlations(centred, mask)
    memory = second * _integrated(rho)
    independent = min(count * second / memory, float(count))
    return [deviation, float(rho[1]), memory, independent, _p_value(rho, count)]


def _correlations(centred: FloatArray, mask: Mask) -> FloatArray:
    """ρ_k over the pairs of seconds that both count; far lags are damped as usual."""
    count = len(centred)
    products, pairs = (
        np.fft.irfft(np.abs(np.fft.rfft(series, 2 * count)) ** 2)[:count]
        for series in (centred, mask.astype(float))
    )
    covariance = products * (count - np.arange(count)) / np.maximum(pairs.round(), 1.0)
    return np.asarray(covariance / covariance[0])


def _p_value(rho: FloatArray, count: int) -> float:
    """The p-value of the sum of ρ at `LAGS`; see the module's head."""
    neighbours = float(np.clip(rho[1], -0.5, 0.0))
    around = [1.0 + 2.0 * neighbours**2, 2.0 * neighbours, neighbours**2]
    covariance = toeplitz(np.pad(around, (0, len(LAGS) - len(around))))
    return float(ndtr(-np.sqrt(count / covariance.sum()) * rho[LAGS].sum()))


def _integrated(rho: FloatArray) -> float:
    """1 + 2 Σ ρ_k, summed over pairs of lags up to the first that is not positive."""
    even = rho[: len(rho) // 2 * 2].reshape(-1, 2).sum(axis=1)
    ended = even <= 0
    stop = int(ended.argmax()) if ended.any() else len(even)
    return max(1.0, float(2 * even[:stop].sum() - 1))
