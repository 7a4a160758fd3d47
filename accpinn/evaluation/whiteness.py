"""What the law leaves unexplained: how large it is, and how long it lasts.

    e(t) = (v(t + T) - v(t)) / T - mean over [t, t + T] of α(p - τv) + βΔv,    T = 1 s

Means over a second quieten the receivers' noise, which differences between samples would consist
of. What is left of it alternates: neighbouring seconds share a speed, with opposite signs, so their
correlation lies between -0.5 (noise alone) and 0. Were the law all there is besides, seconds that
are not neighbours would be independent. Whether they are is told from

    z = √N (ρ₂ + .. + ρ₆) / √(Σ Σ c(j - k)),    c(0) = 1 + 2ρ₁², c(±1) = 2ρ₁, c(±2) = ρ₁²,

which is standard normal then (Bartlett, JRSS Suppl. 8, 1946), and large where something lasts. The
integrated autocorrelation time (Geyer's initial positive sequence, Statistical Science 7, 1992)
says for how long.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.stats import norm

from accpinn.methods.fit import Fit
from accpinn.methods.regression import STEP, one_second_means
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

LAGS = np.arange(2, 7)
"""Seconds that the test looks back."""
FEWEST = 30
"""Seconds below which nothing is said."""
CORRELATED = 0.01
"""A smaller probability of so much correlation by chance is called lasting."""
NEGLIGIBLE = 0.02
"""m/s²; as much comes from receivers' noise of 0.015 m/s, and from taking samples."""


@dataclass(frozen=True, eq=False)
class Whiteness:
    """The law's residual of each of M followers; nan where the window is too short to tell."""

    deviation: FloatArray
    """(M,) root mean square in m/s²."""
    correlation: FloatArray
    """(M,) between one second and the next, -1 to 1."""
    memory: FloatArray
    """(M,) in s, the integrated autocorrelation time: 1 s where seconds are independent."""
    independent: FloatArray
    """(M,) how many independent samples the window is worth, as far as the residual's mean goes."""
    probability: FloatArray
    """(M,) of so much correlation by chance, were all but neighbouring seconds independent."""
    sentences: tuple[str, ...]
    """(M,) the same in words."""


def whiteness(segment: Segment, fit: Fit) -> Whiteness:
    """Of the law with the fit's parameters, over the instants that count.

    α = 0 with τ undetermined counts as ατ = 0.
    """
    steps = one_second_means(segment)
    theta = np.nan_to_num(np.array([law.theta for law in fit.parameters]))
    residuals = steps.rates - np.einsum("mkc,mc->mk", steps.terms, theta)
    pairs = list(zip(residuals, steps.mask, strict=True))
    figures = np.array([_figures(row, known, steps.length) for row, known in pairs])
    sentences = tuple(
        _sentence(label, int(known.sum()) * steps.samples, row)
        for label, known, row in zip(segment.labels[1:], steps.mask, figures, strict=True)
    )
    deviation, correlation, memory, independent, probability = figures.T
    return Whiteness(deviation, correlation, memory, independent, probability, sentences)


def _figures(residual: FloatArray, known: NDArray[np.bool_], second: Seconds) -> list[float]:
    """Deviation, correlation, memory, independent samples, probability."""
    count = int(known.sum())
    if not count:
        return 5 * [float("nan")]
    deviation = float(np.sqrt((residual[known] ** 2).mean()))
    centred = np.where(known, residual - residual[known].mean(), 0.0)
    if count < FEWEST or not centred.any():
        return [deviation, *4 * [float("nan")]]
    rho = _correlations(centred, known)
    memory = second * _integrated(rho)
    independent = min(count * second / memory, float(count))
    return [deviation, float(rho[1]), memory, independent, _by_chance(rho, count)]


def _correlations(centred: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """ρ_k over the pairs of seconds that are both known, with far lags damped as usual."""
    count = len(centred)
    products, pairs = (
        np.fft.irfft(np.abs(np.fft.rfft(series, 2 * count)) ** 2)[:count]
        for series in (centred, known.astype(float))
    )
    covariance = products * (count - np.arange(count)) / np.maximum(pairs.round(), 1.0)
    return np.asarray(covariance / covariance[0])


def _by_chance(rho: FloatArray, count: int) -> float:
    """The probability of so large a sum of ρ at `LAGS`; see the module's head."""
    neighbours = float(np.clip(rho[1], -0.5, 0.0))
    around = [1.0 + 2.0 * neighbours**2, 2.0 * neighbours, neighbours**2]
    covariance = toeplitz(np.pad(around, (0, len(LAGS) - len(around))))
    return float(norm.sf(np.sqrt(count / covariance.sum()) * rho[LAGS].sum()))


def _integrated(rho: FloatArray) -> float:
    """1 + 2 Σ ρ_k, over pairs of lags until one of them is not positive any more."""
    even = rho[: len(rho) // 2 * 2].reshape(-1, 2).sum(axis=1)
    ended = even <= 0
    stop = int(ended.argmax()) if ended.any() else len(even)
    return max(1.0, float(2 * even[:stop].sum() - 1))


def _sentence(label: str, samples: int, figures: FloatArray) -> str:
    deviation, _, memory, independent, probability = figures
    if np.isnan(probability):
        return f"{label}: the window is too short to tell whether the law's residual is white."
    left = f"{label}: what the law leaves of the acceleration ({deviation:.2f} m/s²)"
    if deviation < NEGLIGIBLE:
        return f"{left} is no more than noise and rounding make."
    if probability >= CORRELATED or memory < 2.0 * STEP:
        return f"{left} shows no memory beyond a second."
    return (
        f"{left} lasts for about {memory:.0f} s, so for its mean {samples:,} samples are worth some"
        f" {independent:.0f} independent ones."
    )
