"""Tests of a form's innovations: correlation, even variance, normality, linear response.

If a form of the model holds, its standardised innovations ε are white, even and normal. Of those of
gap and own speed (Bonferroni's correction unites the two) are tested the correlation over 10 s
(Ljung and Box, 1978), the variance against the speed (Breusch and Pagan, 1979), and skewness and
kurtosis (Jarque and Bera, 1980). Holm's correction keeps the chance that a true model fails any
test below the level. What no single follower shows may show in all of them: their p-values are
united by Fisher's method (1925), and tested alike.

A response that is not linear, as where the controller limits its acceleration, would add to the
acceleration a share of what of the command

    c = α(p - τv) + βΔv

lies beyond some height. The heights ½, 1, 1½ and 2 standard deviations above and below its mean
give eight such terms. ε is regressed on what each, so added, would do to it, beside p, v, u and 1
(a score test; the filter is linear, so it turns a term's effects on p and v into those on ε). As
the eight resemble each other, their squared statistics are added up, which is more powerful than to
ask what they explain together; under the model, the sum is distributed as Σλχ², where λ are the
eigenvalues of the terms' correlation. Source of its tail: Kuonen, Biometrika 86 (1999) 929-935.
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
"""Of the test whether the model is adequate."""
LAGS = 20
"""Of the correlation, in samples of 0.5 s."""
SETTLING = 20
"""Samples at the start of a series that the filter needs to forget that it knew nothing."""
HEIGHTS = (0.5, 1.0, 1.5, 2.0)
"""Of the command, in standard deviations off its mean, where the response may stop being linear."""


@dataclass(frozen=True, eq=False)
class InnovationTests:
    """p-values of the tests of a form's innovations; (M,) each, not corrected, nan if untested."""

    correlated: FloatArray
    uneven: FloatArray
    nonnormal: FloatArray
    nonlinear: FloatArray

    @property
    def fails(self) -> Mask:
        """(M, 4) which of the four fail at `LEVEL`, by Holm's correction."""
        values = np.stack([self.correlated, self.uneven, self.nonnormal, self.nonlinear], axis=1)
        order = np.argsort(values, axis=1)
        ranked = np.take_along_axis(values, order, axis=1)
        below = np.logical_and.accumulate(ranked * (4, 3, 2, 1) < LEVEL, axis=1)
        failing = np.zeros_like(below)
        np.put_along_axis(failing, order, below, axis=1)
        return np.asarray(failing)

    @property
    def united(self) -> "InnovationTests":
        """(1,) of all followers together, by Fisher's method."""
        each = (self.correlated, self.uneven, self.nonnormal, self.nonlinear)
        return InnovationTests(*(_united(values[np.isfinite(values)]) for values in each))


def _united(values: FloatArray) -> FloatArray:
    statistic = -2.0 * np.log(np.maximum(values, 1e-300)).sum()
    return np.array([chdtrc(2 * len(values), statistic)])


def innovation_tests(series: Series, maxima: Sequence[Maximum]) -> tuple[FloatArray, ...]:
    """p-values (G,) of the four tests, in the order of `InnovationTests`."""
    from scipy.stats import jarque_bera  # takes half a second, which most commands need not

    z = np.array([maxima[g].coordinates for g in series.group])
    model = _gap_last(Criterion(series).model(z))
    found = innovations(model, series.measured[:, ::-1])[1]
    standard = np.where(found.known, found.errors / np.sqrt(found.variances), np.nan)[SETTLING:]
    speeds = series.measured[SETTLING:, 1]
    rows = []
    for group in range(series.groups):
        members = series.members(group)
        speed = speeds[:, members]
        values = []
        for errors in (standard[:, 1, members], standard[:, 2, members]):
            known = np.isfinite(errors) & np.isfinite(speed)
            if known.sum() < LAGS:  # as of short stretches between masked instants
                values.append((np.nan, np.nan, np.nan))
                continue
            uneven = _uneven(errors[known], speed[known])
            values.append((_correlated(errors), uneven, jarque_bera(errors[known])[1]))
        rows.append(np.minimum(2.0 * np.min(values, axis=0), 1.0))
    correlated, uneven, nonnormal = np.array(rows).T
    nonlinear = np.where(np.isnan(correlated), np.nan, _nonlinear(series, maxima, model, found))
    return correlated, uneven, nonnormal, nonlinear


def _gap_last(model: StateSpace) -> StateSpace:
    """The same with u, v, p in place of p, v, u, so that the filter takes in the gap last.

    The gap's innovation is then what neither speed of the same instant says, and is white even
    though the speed ahead is not the simple process that the model takes it for.
    """
    order = [2, 1, 0, *range(3, len(model.first))]
    swap = np.ix_(order, order)
    return StateSpace(
        transition=model.transition[swap],
        process=model.process[swap],
        noise=model.noise[::-1],
        first=model.first[order],
        first_covariance=model.first_covariance[swap],
        rates=model.rates[swap],
    )


def _nonlinear(
    series: Series, maxima: Sequence[Maximum], model: StateSpace, found: Innovations
) -> FloatArray:
    """(G,) p-values of the command beyond `HEIGHTS`; see above. Model and innovations: gap last."""
    theta = np.array([maxima[g].theta for g in series.group])
    alpha, alpha_tau, beta = theta.T
    p, v, u = series.measured.transpose(1, 0, 2)
    command = alpha * p - alpha_tau * v + beta * (u - v)
    around = command - np.nanmean(command, axis=0)
    heights = np.multiply.outer(HEIGHTS, np.nanstd(command, axis=0))[:, None]
    beyond = np.concatenate([np.maximum(around - heights, 0.0), np.minimum(around + heights, 0.0)])
    terms = np.nan_to_num([*beyond, p, v, u, np.ones_like(p)])
    count = len(terms)
    effects = np.where(found.known[:, :, None], _effects(theta, terms, series.step), np.nan)
    each = StateSpace(*(np.tile(getattr(model, one.name), count) for one in fields(model)))
    filtered = innovations(each, effects.reshape(len(p), 3, -1))[1].errors.reshape(effects.shape)
    deviations = np.sqrt(found.variances)[SETTLING:]
    columns = np.moveaxis(filtered[SETTLING:] / deviations[:, :, None], 2, -1)
    errors = found.errors[SETTLING:] / deviations
    values = []
    for group in range(series.groups):
        members = series.members(group)
        rows, target = columns[:, :, members].reshape(-1, count), errors[..., members].ravel()
        values.append(score_test(rows[:, : len(beyond)], rows[:, len(beyond) :], target))
    return np.array(values)


def _effects(theta: FloatArray, terms: FloatArray, step: Seconds) -> FloatArray:
    """(N, 3, K, S): what accelerations (K, N, S), held over each step, change of u, v and p."""
    alpha, alpha_tau, beta = theta.T
    rates = np.zeros((len(theta), 3, 3))  # of v, p, and the acceleration that is held
    rates[:, 0, 0], rates[:, 0, 1], rates[:, 1, 0] = -alpha_tau - beta, alpha, -1.0
    rates[:, 0, 2] = 1.0
    held = expm(rates * step)[:, :2]
    effects = np.zeros((terms.shape[1], 3, *terms[:, 0].shape))
    for k in range(1, len(effects)):
        moved = np.einsum("sij,jks->iks", held[:, :, :2], effects[k - 1, 1:])
        effects[k, 1:] = moved + held[:, :, 2].T[:, None] * terms[:, k - 1]
    return effects


def score_test(terms: FloatArray, beside: FloatArray, errors: FloatArray) -> float:
    """p-value of the summed squares of several terms' statistics, each term tried by itself.

    Args:
        terms: (n, K) that may explain the errors; they may resemble each other.
        beside: (n, k) columns that the regression has in any case.
        errors: (n,) independent and standard normal if nothing explains them.

    Returns:
        Within a tenth of its value, a sixth in the far tail; 1 where no term is more than the
        columns beside it.
    """
    left, values, _ = np.linalg.svd(_unit(beside), full_matrices=False)
    left = left[:, values > 1e-9 * values.max(initial=0.0)]
    own = _unit(terms)
    own = own - left @ (left.T @ own)
    own = _unit(own[:, np.linalg.norm(own, axis=0) > 1e-9])
    weights = np.asarray(np.linalg.eigvalsh(own.T @ own), float)
    return _exceeds(float(((errors @ own) ** 2).sum()), weights)


def _unit(columns: FloatArray) -> FloatArray:
    """Columns of length 1; those without any stay."""
    return np.asarray(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))


def _exceeds(value: float, weights: FloatArray) -> float:
    """P(Σ λχ² > value) of independent χ² of one degree of freedom: Kuonen's saddlepoint."""
    from scipy.optimize import brentq  # takes a quarter of a second, which few commands need

    weights = weights[weights > 1e-9]
    if value == 0.0 or not len(weights):
        return 1.0
    share = weights / value
    pole = 0.5 / share.max()

    def rest(below: float) -> FloatArray:
        """1 - 2z·share at z = pole - below."""
        return np.asarray(1.0 - share / share.max() + 2.0 * below * share)

    # Where the cumulants' generating function has slope 1. Each term of its slope is at most
    # 1/(2·below), which is the largest's.
    widened = 1.0 + 1e-9
    below = brentq(
        lambda below: float((share / rest(below)).sum()) - 1.0,
        0.5 / widened,
        0.5 * len(share) * widened,
    )
    z = pole - below
    curvature = 2.0 * float(((share / rest(below)) ** 2).sum())
    w = np.sign(z) * np.sqrt(max(2.0 * z + np.log(rest(below)).sum(), 0.0))
    u = z * np.sqrt(curvature)
    if abs(u) < 1e-3:  # near the mean both tend to zero
        return float(ndtr(-8.0 * float((share**3).sum()) / curvature**1.5 / 6.0))
    return float(ndtr(-w - np.log(u / w) / w))


def _correlated(errors: FloatArray) -> float:
    """Ljung and Box's p-value of the columns (N, S) together; pairs with a missing one are left."""
    known = np.isfinite(errors)
    errors = np.where(known, errors, 0.0)
    statistic = 0.0
    power = float((errors**2).sum()) / max(int(known.sum()), 1)
    for lag in range(1, LAGS + 1):
        pairs = int((known[lag:] & known[:-lag]).sum())
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
