"""Tests of a form's innovations: correlation, even variance, normality, linear response.

If a form of the model holds, its standardised innovations ε are white, homoscedastic and normal.
The tests examine the innovations of gap and own speed (Bonferroni's correction combines the two):
their correlation over 10 s (Ljung and Box, 1978), their variance against the speed (Breusch and
Pagan, 1979), and their skewness and kurtosis (Jarque and Bera, 1980). Holm's correction keeps the
probability that a true model fails any test below the level. A fault too small to show in a single
follower may show in all of them: Fisher's method (1925) combines their p-values.

A response that is not linear, for example because the controller limits its acceleration, adds to
the acceleration a share of the part of the command

    c = α(p - τv) + βΔv

beyond some threshold. Thresholds ½, 1, 1½ and 2 standard deviations above and below its mean give
eight such terms. ε is regressed on the effect that each term would have on it, beside p, v, u and 1
(a score test; the filter is linear, so it turns a term's effects on p and v into those on ε).
Because the eight terms are similar, their squared statistics are summed, which is more powerful
than a joint test; under the model, the sum is distributed as Σλχ², where λ are the eigenvalues of
the terms' correlation. Source of its tail: Kuonen, Biometrika 86 (1999) 929-935.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.linalg import expm
from scipy.special import chdtrc, ndtr

from accpinn.methods.kalman import Innovations, innovations
from accpinn.methods.likelihood import Criterion, Maximum
from accpinn.methods.series import Series
from accpinn.methods.state_space import StateSpace
from accpinn.units import FloatArray, Mask, Seconds

LEVEL = 0.01
"""Level of the tests."""
LAGS = 20
"""Largest lag of the correlation, in samples of 0.5 s."""
SETTLING = 20
"""Samples at the start of a series that are left out, as the filter's initial state decays."""
THRESHOLDS = (0.5, 1.0, 1.5, 2.0)
"""Thresholds of the command, in standard deviations from its mean."""


@dataclass(frozen=True, eq=False)
class InnovationTests:
    """p-values of the tests of a form's innovations: uncorrected, nan if untested."""

    correlated: FloatArray
    """(M,) test of the correlation over time."""
    uneven: FloatArray
    """(M,) test of the variance against the speed."""
    nonnormal: FloatArray
    """(M,) test of skewness and kurtosis."""
    nonlinear: FloatArray
    """(M,) test of a linear response."""

    @property
    def _all(self) -> tuple[FloatArray, ...]:
        return self.correlated, self.uneven, self.nonnormal, self.nonlinear

    @property
    def fails(self) -> Mask:
        """(M, 4) whether each of the four fails at `LEVEL`, with Holm's correction."""
        values = np.stack(self._all, axis=1)
        order = np.argsort(values, axis=1)
        ranked = np.take_along_axis(values, order, axis=1)
        below = np.logical_and.accumulate(ranked * (4, 3, 2, 1) < LEVEL, axis=1)
        failing = np.zeros_like(below)
        np.put_along_axis(failing, order, below, axis=1)
        return np.asarray(failing)

    @property
    def united(self) -> "InnovationTests":
        """The tests (1,) of all followers together, by Fisher's method."""
        united = []
        for probabilities in self._all:
            finite = probabilities[np.isfinite(probabilities)]
            statistic = -2.0 * np.log(np.maximum(finite, 1e-300)).sum()
            united.append(np.array([chdtrc(2 * len(finite), statistic)]))
        return InnovationTests(*united)


def innovation_tests(series: Series, maxima: Sequence[Maximum]) -> tuple[FloatArray, ...]:
    """p-values (G,) of the four tests, in the order of `InnovationTests`."""
    from scipy.stats import jarque_bera  # imported late: it takes half a second

    z = np.array([maxima[g].coordinates for g in series.group])
    model = _gap_last(Criterion(series).model(z))
    measured = innovations(model, series.measured[:, ::-1])[1]
    scaled = measured.errors / np.sqrt(measured.variances)
    standard = np.where(measured.present, scaled, np.nan)[SETTLING:]
    speeds = series.measured[SETTLING:, 1]
    rows = []
    for group in range(series.groups):
        members = series.members(group)
        speed = speeds[:, members]
        values = []
        for errors in (standard[:, 1, members], standard[:, 2, members]):
            present = np.isfinite(errors) & np.isfinite(speed)
            if present.sum() < LAGS:  # for example short stretches between masked instants
                values.append((np.nan, np.nan, np.nan))
                continue
            uneven = _uneven(errors[present], speed[present])
            values.append((_correlated(errors), uneven, jarque_bera(errors[present])[1]))
        rows.append(np.minimum(2.0 * np.min(values, axis=0), 1.0))
    correlated, uneven, nonnormal = np.array(rows).T
    nonlinear = np.where(np.isnan(correlated), np.nan, _nonlinear(series, maxima, model, measured))
    return correlated, uneven, nonnormal, nonlinear


def _gap_last(model: StateSpace) -> StateSpace:
    """The model with u, v, p in place of p, v, u, so that the filter processes the gap last.

    The gap's innovation is then conditional on both speeds of the same instant. It is white even
    though the speed ahead is not the simple process that the model assumes.
    """
    order = [2, 1, 0, *range(3, len(model.first))]
    swap = np.ix_(order, order)
    return StateSpace(
        transition=model.transition[swap],
        process=model.process[swap],
        noise=model.noise[::-1],
        shift=model.shift,  # 0, as the CTHP has no intercept
        first=model.first[order],
        first_covariance=model.first_covariance[swap],
        rates=model.rates[swap],
    )


def _nonlinear(
    series: Series, maxima: Sequence[Maximum], model: StateSpace, measured: Innovations
) -> FloatArray:
    """(G,) p-values of the test of a linear response, for a model with the gap last."""
    theta = np.array([maxima[g].theta for g in series.group])
    alpha, alpha_tau, beta = theta.T
    p, v, u = series.measured.transpose(1, 0, 2)
    command = alpha * p - alpha_tau * v + beta * (u - v)
    around = command - np.nanmean(command, axis=0)
    limits = np.multiply.outer(THRESHOLDS, np.nanstd(command, axis=0))[:, None]
    beyond = np.concatenate([np.maximum(around - limits, 0.0), np.minimum(around + limits, 0.0)])
    terms = np.nan_to_num([*beyond, p, v, u, np.ones_like(p)])
    count = len(terms)
    effects = np.where(measured.present[:, :, None], _effects(theta, terms, series.step), np.nan)
    tiled = StateSpace(*(np.tile(getattr(model, part.name), count) for part in fields(model)))
    filtered = innovations(tiled, effects.reshape(len(p), 3, -1))[1].errors.reshape(effects.shape)
    deviations = np.sqrt(measured.variances)[SETTLING:]
    columns = np.moveaxis(filtered[SETTLING:] / deviations[:, :, None], 2, -1)
    errors = measured.errors[SETTLING:] / deviations
    values = []
    for group in range(series.groups):
        members = series.members(group)
        rows, target = columns[:, :, members].reshape(-1, count), errors[..., members].ravel()
        values.append(score_test(rows[:, : len(beyond)], rows[:, len(beyond) :], target))
    return np.array(values)


def _effects(theta: FloatArray, terms: FloatArray, step: Seconds) -> FloatArray:
    """(N, 3, K, S) effects on u, v and p of accelerations (K, N, S) held over each step."""
    alpha, alpha_tau, beta = theta.T
    rates = np.zeros((len(theta), 3, 3))  # states: v, p and the held acceleration
    rates[:, 0, 0], rates[:, 0, 1], rates[:, 1, 0] = -alpha_tau - beta, alpha, -1.0
    rates[:, 0, 2] = 1.0
    held = expm(rates * step)[:, :2]
    effects = np.zeros((terms.shape[1], 3, *terms[:, 0].shape))
    for k in range(1, len(effects)):
        moved = np.einsum("sij,jks->iks", held[:, :, :2], effects[k - 1, 1:])
        effects[k, 1:] = moved + held[:, :, 2].T[:, None] * terms[:, k - 1]
    return effects


def score_test(terms: FloatArray, beside: FloatArray, errors: FloatArray) -> float:
    """p-value of the summed squares of the statistics of several terms, each tested separately.

    Args:
        terms: (n, K) terms that may explain the errors; they may be similar to each other.
        beside: (n, k) columns that every regression contains.
        errors: (n,) errors, independent and standard normal if no term explains them.

    Returns:
        The p-value with a relative error of a tenth, a sixth in the far tail; 1 if the columns
        beside them explain all terms.
    """
    left, values, _ = np.linalg.svd(_unit(beside), full_matrices=False)
    left = left[:, values > 1e-9 * values.max(initial=0.0)]
    columns = _unit(terms)
    columns = columns - left @ (left.T @ columns)
    columns = _unit(columns[:, np.linalg.norm(columns, axis=0) > 1e-9])
    weights = np.asarray(np.linalg.eigvalsh(columns.T @ columns), float)
    return _exceeds(float(((errors @ columns) ** 2).sum()), weights)


def _unit(columns: FloatArray) -> FloatArray:
    """Columns scaled to length 1; columns of zeros stay."""
    return np.asarray(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))


def _exceeds(value: float, weights: FloatArray) -> float:
    """P(Σ λχ² > value) of independent χ² of one degree of freedom: Kuonen's saddlepoint."""
    from scipy.optimize import brentq  # imported late: it takes a quarter of a second

    weights = weights[weights > 1e-9]
    if value == 0.0 or not len(weights):
        return 1.0
    share = weights / value
    pole = 0.5 / share.max()

    def remainder(below: float) -> FloatArray:
        """1 - 2z·share at z = pole - below."""
        return np.asarray(1.0 - share / share.max() + 2.0 * below * share)

    # The cumulant generating function has slope 1 there. Each term of the slope is at most
    # 1/(2·below), and the largest term equals it.
    widened = 1.0 + 1e-9
    below = brentq(
        lambda below: float((share / remainder(below)).sum()) - 1.0,
        0.5 / widened,
        0.5 * len(share) * widened,
    )
    z = pole - below
    curvature = 2.0 * float(((share / remainder(below)) ** 2).sum())
    w = np.sign(z) * np.sqrt(max(2.0 * z + np.log(remainder(below)).sum(), 0.0))
    u = z * np.sqrt(curvature)
    if abs(u) < 1e-3:  # near the mean u and w tend to zero
        return float(ndtr(-8.0 * float((share**3).sum()) / curvature**1.5 / 6.0))
    return float(ndtr(-w - np.log(u / w) / w))


def _correlated(errors: FloatArray) -> float:
    """Ljung and Box's p-value of all columns (N, S); pairs with a missing error are left out."""
    present = np.isfinite(errors)
    errors = np.where(present, errors, 0.0)
    statistic = 0.0
    power = float((errors**2).sum()) / max(int(present.sum()), 1)
    for lag in range(1, LAGS + 1):
        pairs = int((present[lag:] & present[:-lag]).sum())
        if pairs:
            correlation = float((errors[lag:] * errors[:-lag]).sum()) / pairs / power
            statistic += pairs * correlation**2
    return float(chdtrc(LAGS, statistic))


def _uneven(errors: FloatArray, speeds: FloatArray) -> float:
    """Koenker's form of Breusch and Pagan's test: squared errors against the speed."""
    if np.ptp(speeds) == 0.0:
        return 1.0
    correlation = float(np.corrcoef(errors**2, speeds)[0, 1])
    return float(2 * ndtr(-abs(correlation) * np.sqrt(len(errors))))
