"""What the law leaves unexplained: how large it is, and how long it lasts.

    e(t) = (v(t + T) - v(t)) / T - mean over [t, t + T] of α(p - τv) + βΔv,    T = 1 s

Means over a second quieten the receivers' noise, which differences between samples would consist
of. Were the law all there is, e would be independent from second to second. Its integrated
autocorrelation time (Geyer's initial positive sequence, Statistical Science 7, 1992) says how many
independent samples the window is worth; Ljung and Box (Biometrika 65, 1978) test for any at all.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from accpinn.cthp import regressors
from accpinn.fit import Fit
from accpinn.segment import Segment
from accpinn.units import FloatArray, Seconds

MEAN_OVER: Seconds = 1.0
LAGS = 10
"""Seconds that the test looks back."""
FEWEST = 3 * LAGS
"""Seconds below which nothing is said."""
CORRELATED = 0.01
"""A smaller probability of so much correlation by chance is called lasting."""


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
    """(M,) how many independent samples the window is worth."""
    probability: FloatArray
    """(M,) of so much correlation by chance, were the residual white (Ljung-Box)."""
    sentences: tuple[str, ...]
    """(M,) the same in words."""


def whiteness(segment: Segment, fit: Fit) -> Whiteness:
    """Of the law with the fit's parameters, over the instants that count.

    α = 0 with τ undetermined counts as ατ = 0.
    """
    residuals = _residuals(segment, fit)
    figures = np.array([_figures(row) for row in residuals])
    sentences = tuple(
        _sentence(label, len(residual) * MEAN_OVER / segment.sample_time, row)
        for label, residual, row in zip(segment.labels[1:], residuals, figures, strict=True)
    )
    deviation, correlation, memory, independent, probability = figures.T
    return Whiteness(deviation, correlation, memory, independent, probability, sentences)


def _residuals(segment: Segment, fit: Fit) -> list[FloatArray]:
    """E of each of M followers, one a second, without the seconds left out."""
    step = max(1, round(MEAN_OVER / segment.sample_time))
    count = (segment.samples - 1) // step
    speeds = segment.speeds[: count * step + 1 : step, 1:]
    rates = np.diff(speeds, axis=0).T / (step * segment.sample_time)
    terms = regressors(segment.speeds, segment.gaps)[:, : count * step + 1]
    trapezoid = (terms[:, 1:] + terms[:, :-1]) / 2
    means = trapezoid.reshape(len(terms), count, step, 3).mean(axis=2)
    theta = np.nan_to_num(np.array([law.linear() for law in fit.parameters]))
    residuals = rates - np.einsum("mkc,mc->mk", means, theta)
    if segment.left_out is None:
        return list(residuals)
    out = np.any(segment.left_out[: count * step].reshape(count, step, -1), axis=1)
    return [row[~gone] for row, gone in zip(residuals, np.transpose(out), strict=True)]


def _figures(residual: FloatArray) -> list[float]:
    """Deviation, correlation, memory, independent samples, probability."""
    count = len(residual)
    if not count:
        return 5 * [float("nan")]
    deviation = float(np.sqrt((residual**2).mean()))
    centred = residual - residual.mean()
    if count < FEWEST or not centred.any():
        return [deviation, *4 * [float("nan")]]
    spectrum = np.abs(np.fft.rfft(centred, 2 * count)) ** 2
    covariance = np.fft.irfft(spectrum)[:count]
    rho = covariance / covariance[0]
    memory = MEAN_OVER * _integrated(rho)
    lags = np.arange(1, LAGS + 1)
    statistic = count * (count + 2) * float((rho[lags] ** 2 / (count - lags)).sum())
    independent = min(count * MEAN_OVER / memory, float(count))
    return [deviation, float(rho[1]), memory, independent, float(chi2.sf(statistic, LAGS))]


def _integrated(rho: FloatArray) -> float:
    """1 + 2 Σ ρ_k, over pairs of lags until one of them is not positive any more."""
    even = rho[: len(rho) // 2 * 2].reshape(-1, 2).sum(axis=1)
    ended = even <= 0
    stop = int(ended.argmax()) if ended.any() else len(even)
    return max(1.0, float(2 * even[:stop].sum() - 1))


def _sentence(label: str, samples: float, figures: FloatArray) -> str:
    deviation, _, memory, independent, probability = figures
    if np.isnan(probability):
        return f"{label}: the window is too short to tell whether the law's residual is white."
    if probability >= CORRELATED:
        return (
            f"{label}: what the law leaves of the acceleration ({deviation:.2f} m/s²) shows no"
            " memory from second to second."
        )
    return (
        f"{label}: what the law leaves of the acceleration ({deviation:.2f} m/s²) lasts for about"
        f" {memory:.0f} s, so {samples:,.0f} samples are worth some {independent:.0f} independent"
        " ones."
    )
