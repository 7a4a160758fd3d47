"""Model adequacy: does the CTHP with its disturbance explain the recording, or one term more?

Three further forms of the model stand in the same exact likelihood (see `methods.state_space`):

    offset    dv/dt = α(p - s₀ - τv) + βΔv + r      s₀ [m]: a standstill distance, or a slope
    lag       dv/dt = f + r,  df/dt = (α(p - τv) + βΔv - f)/λ      λ [s]: of the actuator
    delay     dv/dt = α(p - τv) + βΔv, d seconds ago, + r          d [s]

They are compared by Akaike's criterion, AIC = 2k - 2 log L with k unknowns, and by the density that
each, estimated from the first two thirds of the time, gives to what is measured in the last third.
A form that neither prefers may still be true: a lag of a second changes α and β by half, and yet
five minutes of a recording hardly tell it from none; a standstill distance hides likewise, and
moves τ. So the intervals to be used are those over all forms, each weighted by its probability

    P(form | y) ∝ P(form) ∫ L(z) p(z | form) dz,

where the integral, the evidence, and the draws are those of the form's own posterior (see
`inference.posterior`). P(form) is `PRIOR`. Every car has an actuator and many keep a distance at
standstill, so the CTHP itself gets little of it; the priors of a lag and of a distance reach down
to none. Source: Hoeting, Madigan, Raftery and Volinsky, Statistical Science 14 (1999) 382-417.

If a form holds, its standardised innovations ε are white, even and normal. Of those of gap and own
speed (Bonferroni's correction unites the two) are tested the correlation over 10 s (Ljung and Box,
1978), the variance against the speed (Breusch and Pagan, 1979), and skewness and kurtosis (Jarque
and Bera, 1980). A response that is not linear, as where
the controller limits its acceleration, would add to the acceleration a share of what of the command
c = α(p - τv) + βΔv lies beyond some height. The heights ½, 1, 1½ and 2 standard deviations above
and below its mean give eight such terms. ε is regressed on what each, so added, would do to it,
beside p, v, u and 1 (a score test; the filter is linear, so it turns a term's effects on p and v
into those on ε). As the eight resemble each other, their squared statistics are added up, which is
more powerful than to ask what they explain together; under the model, the sum is distributed as
Σλχ², where λ are the eigenvalues of the terms' correlation (Kuonen, 1999). Holm's correction
keeps the chance that a true model fails any test below the level. What no single follower shows may
show in all of them: their p-values are united by Fisher's method (1925), and tested alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache

import msgspec
import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm
from scipy.special import chdtrc, ndtr

from accpinn.channels import PARAMETERS
from accpinn.errors import Finding
from accpinn.inference.intervals import DRAWS, ParameterInterval, interval_ends
from accpinn.inference.intervals import LEVEL as INTERVAL_LEVEL
from accpinn.inference.posterior import Posterior, sample
from accpinn.inference.proposal import normalised
from accpinn.methods.kalman import Innovations, innovations
from accpinn.methods.likelihood import Criterion, Maximum, maximise, natural
from accpinn.methods.maximum_likelihood import joint_maxima
from accpinn.methods.method import one_thread
from accpinn.methods.series import Series, determined_followers, series_of
from accpinn.methods.state_space import FORMS, Form, StateSpace, coordinates
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Mask, Seconds

LEARNED = 2 / 3
"""Share of the time from which a form is estimated before it is tried on the rest; of the longest
stretch, where masked instants lie between several."""
BETTER = 4.0
"""A form is better when its AIC is lower by so much and held-out time is more probable, too."""
PRIOR: dict[Form, float] = {"cthp": 0.01, "offset": 0.33, "lag": 0.6, "delay": 0.06}
"""Probability of each form before the data. Chosen so that the weighted intervals cover α, β and τ
alike whichever form is true; see docs/validation.md."""
LEVEL = 0.01
"""Of the test whether the model is adequate."""
LAGS = 20
"""Of the correlation, in samples of 0.5 s."""
SETTLING = 20
"""Samples at the start of a series that the filter needs to forget that it knew nothing."""
HEIGHTS = (0.5, 1.0, 1.5, 2.0)
"""Of the command, in standard deviations off its mean, where the response may stop being linear."""


class FormPosterior(msgspec.Struct, frozen=True, kw_only=True):
    """What a follower's data say if one form of the model holds."""

    form: Form
    probability: float
    """That it does, given the data."""
    intervals: tuple[ParameterInterval, ...]
    """Of α, β and τ under this form, with the values of greatest likelihood."""
    extra: float
    """s₀ in m, λ or d in s, where the likelihood is greatest; 0 for the CTHP."""
    extra_lower: float
    extra_upper: float
    """Ends of the interval of s₀, λ or d."""


class BetterForm(Finding, frozen=True, kw_only=True):
    """Another form of the model is better supported by a follower's data than the CTHP."""

    vehicle: int
    """0 for all followers together."""
    posterior: FormPosterior
    """Under that form."""
    aic: float
    """Its AIC minus the CTHP's."""
    holdout: float
    """ln of how many times as probable held-out time is."""
    level: float
    """Of the intervals."""


class WeightedForms(Finding, frozen=True, kw_only=True):
    """The intervals to be used: over all forms of the model, each weighted by its probability."""

    vehicle: int
    """0 for all followers together."""
    intervals: tuple[ParameterInterval, ...]
    """Of α, β and τ, with the weighted medians as estimates."""
    forms: tuple[FormPosterior, ...]
    """In the order of `FORMS`."""
    level: float
    """Of the intervals."""


class Inadequate(Finding, frozen=True):
    """The innovations of the CTHP are not what they would be if it held."""

    vehicle: int
    """0 for all followers together."""
    correlated: bool
    """Over time."""
    uneven: bool
    """Larger at some speeds than at others."""
    nonnormal: bool
    """Skewed, or with other tails than a normal distribution's."""
    nonlinear: bool
    """The acceleration is no linear function of gap and speeds."""


AdequacyFinding = BetterForm | WeightedForms | Inadequate


@dataclass(frozen=True, eq=False)
class ModelForm:
    """One form of the model for each of M followers."""

    form: Form
    parameters: Parameters
    """(M,)"""
    deviation: FloatArray
    """(M, 3) standard errors of ln α, ln β, ln τ, from the curvature of the likelihood."""
    extra: FloatArray
    """(M,) s₀ in m, λ or d in s; 0 for the CTHP."""
    aic: FloatArray
    """(M,) minus the CTHP's; below zero is better."""
    holdout: FloatArray
    """(M,) ln of how many times as probable the last third is as by the CTHP; nan where it has no
    samples."""


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


@dataclass(frozen=True, eq=False)
class Adequacy:
    """How well the CTHP and its further forms explain a segment."""

    forms: tuple[ModelForm, ...]
    """The CTHP first."""
    tests: InnovationTests | None
    """Of the CTHP; None where there is no form."""
    findings: tuple[AdequacyFinding, ...]

    @property
    def better(self) -> tuple[BetterForm, ...]:
        """The forms that describe a follower better than the CTHP, one a follower at most."""
        return tuple(one for one in self.findings if isinstance(one, BetterForm))

    @property
    def recommended(self) -> tuple[WeightedForms, ...]:
        """The intervals to be used, one set a follower."""
        return tuple(one for one in self.findings if isinstance(one, WeightedForms))


@lru_cache(maxsize=32)
@one_thread
def model_forms(segment: Segment, case: Case = "II") -> Adequacy:
    """Every form of the model in the likelihood of a segment.

    Args:
        segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
        case: "I", where all followers share the unknowns of each form, or "II".

    Returns:
        No form where the window is too short for the likelihood or nothing moves; nan for a
        follower that is hardly measured, or does not move.
    """
    known = determined_followers((segment,), case)
    if not known:
        return Adequacy((), None, ())
    series, count = series_of([segment], case, known), segment.followers

    def spread(values: Sequence[ArrayLike] | FloatArray) -> FloatArray:
        """(M, ..) from one entry a group."""
        rows = np.asarray(values, float)
        full = np.full((count, *rows.shape[1:]), np.nan)
        full[list(known)] = rows
        return full

    forms: list[ModelForm] = []
    maxima: dict[Form, tuple[Maximum, ...]] = {}
    posteriors: dict[Form, tuple[Posterior, ...]] = {}
    first = held_out = np.zeros(count)
    for form in FORMS:
        maxima[form] = joint_maxima((segment,), case, form, known)
        posteriors[form] = sample(series, maxima[form], form)
        size = len(coordinates(form))
        aic = spread([2 * size - 2 * one.log_likelihood for one in maxima[form]])
        density = spread(_held_out_density(series, maxima[form], form))
        if form == "cthp":
            first, held_out = aic, density
        forms.append(
            ModelForm(
                form,
                Parameters.from_theta(spread([one.theta for one in maxima[form]])),
                spread([_deviations(one) for one in maxima[form]]),
                spread([_extra(form, one.values) for one in maxima[form]]),
                aic - first,
                density - held_out,
            )
        )
    tests = InnovationTests(*map(spread, _tests(series, maxima["cthp"])))
    subjects = [(0, 0)] if case == "I" else [(segment.vehicles[k + 1], k) for k in known]
    found: list[AdequacyFinding] = []
    for group, (vehicle, k) in enumerate(subjects):
        weighted = _weighted(
            vehicle, [maxima[form][group] for form in FORMS], [posteriors[f][group] for f in FORMS]
        )
        best = min(range(len(forms)), key=lambda at: float(forms[at].aic[k]))
        gain, holdout = float(forms[best].aic[k]), float(forms[best].holdout[k])
        if gain < -BETTER and holdout > 0:
            own = weighted.forms[best]
            found.append(
                BetterForm(
                    vehicle=vehicle, posterior=own, aic=gain, holdout=holdout, level=INTERVAL_LEVEL
                )
            )
        found.append(weighted)
    return Adequacy(tuple(forms), tests, (*found, *_inadequate(subjects, tests)))


def _extra(form: Form, values: FloatArray) -> FloatArray:
    """(..) s₀ in m, λ or d in s, from the unknowns (.., P); 0 for the CTHP."""
    if form == "cthp":
        return np.zeros(values.shape[:-1])
    return np.asarray(-values[..., -1] / values[..., 0] if form == "offset" else values[..., -1])


def _weighted(
    vehicle: int, maxima: Sequence[Maximum], posteriors: Sequence[Posterior]
) -> WeightedForms:
    """The intervals over all forms.

    Args:
        vehicle: its number in the file.
        maxima: where the search ended, one each of `FORMS`.
        posteriors: alike.
    """
    prior = np.log([PRIOR[form] for form in FORMS])
    probability = normalised(prior + [one.log_evidence for one in posteriors])
    drawn = [
        natural(one, posterior.all_evenly(DRAWS))
        for one, posterior in zip(FORMS, posteriors, strict=True)
    ]
    parameters = [Parameters.from_theta(rows[:, :3]).values for rows in drawn]
    forms = []
    for form, share, maximum, rows, own in zip(
        FORMS, probability.tolist(), maxima, drawn, parameters, strict=True
    ):
        values = Parameters.from_theta(maximum.theta).values
        lower, upper = interval_ends(own, INTERVAL_LEVEL)
        lower = np.where(values == 0.0, 0.0, lower)
        extra_lower, extra_upper = interval_ends(_extra(form, rows), INTERVAL_LEVEL)
        forms.append(
            FormPosterior(
                form=form,
                probability=share,
                intervals=tuple(
                    ParameterInterval(one.symbol, low, high, likeliest=value)
                    for one, low, high, value in zip(
                        PARAMETERS, lower.tolist(), upper.tolist(), values.tolist(), strict=True
                    )
                ),
                extra=float(_extra(form, maximum.values)),
                extra_lower=float(extra_lower),
                extra_upper=float(extra_upper),
            )
        )
    tail = (1.0 - INTERVAL_LEVEL) / 2.0
    weights = np.repeat(probability / DRAWS, DRAWS)
    ends = [
        np.quantile(column, (tail, 0.5, 1.0 - tail), weights=weights, method="inverted_cdf")
        for column in np.concatenate(parameters).T
    ]
    # Where most forms put the greatest likelihood at zero, that is no reason to exclude it.
    zero = [
        sum(one.probability for one in forms if one.intervals[which].likeliest == 0.0) > 0.5
        for which in range(len(PARAMETERS))
    ]
    return WeightedForms(
        vehicle=vehicle,
        intervals=tuple(
            ParameterInterval(one.symbol, 0.0 if none else low, high, estimate=middle)
            for one, none, (low, middle, high) in zip(
                PARAMETERS, zero, np.array(ends).tolist(), strict=True
            )
        ),
        forms=tuple(forms),
        level=INTERVAL_LEVEL,
    )


def _deviations(maximum: Maximum) -> FloatArray:
    """(3,) of ln α, ln β, ln τ; infinite where a bound holds one of them."""
    errors = maximum.errors
    return errors if np.isfinite(errors).all() else np.full(3, np.inf)


def _held_out_density(series: Series, maxima: Sequence[Maximum], form: Form) -> FloatArray:
    """(G,) log density of the followers' last third, by parameters from what comes before."""
    learned = maximise(series.until(LEARNED), form, near=[one.coordinates for one in maxima])
    density = _innovations(series, learned).log_density[:, :2]
    late = density[round(LEARNED * len(density)) :].sum(axis=(0, 1))
    return np.asarray(np.bincount(series.group, late, series.groups), float)


def _innovations(series: Series, maxima: Sequence[Maximum]) -> Innovations:
    """Of each series, by its group's unknowns."""
    z = np.array([maxima[g].coordinates for g in series.group])
    return innovations(Criterion(series, maxima[0].form).model(z), series.measured)[1]


def _tests(series: Series, maxima: Sequence[Maximum]) -> tuple[FloatArray, ...]:
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
        Within a tenth of its value; 1 where no term is more than the columns beside it.
    """
    left, values, _ = np.linalg.svd(_unit(beside), full_matrices=False)
    left = left[:, values > 1e-9 * values.max(initial=0.0)]
    own = _unit(terms)
    own = own - left @ (left.T @ own)
    own = _unit(own[:, np.linalg.norm(own, axis=0) > 1e-6])
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
    # Where the cumulants' generating function has slope 1, below its pole: each term of the slope
    # is at most 1/(2·distance to the pole), which is the largest's.
    pole, widened = 0.5 / share.max(), 1.0 + 1e-9
    z = brentq(
        lambda z: float((share / (1.0 - 2.0 * z * share)).sum()) - 1.0,
        pole - 0.5 * len(share) * widened,
        pole - 0.5 / widened,
    )
    rest = 1.0 - 2.0 * z * share
    curvature = 2.0 * float(((share / rest) ** 2).sum())
    w = np.sign(z) * np.sqrt(max(2.0 * z + np.log(rest).sum(), 0.0))
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


def _inadequate(subjects: Sequence[tuple[int, int]], tests: InnovationTests) -> list[Inadequate]:
    """Followers that fail a test; where none does, all of them together if these do.

    Args:
        subjects: number in the file, and row of the tests.
        tests: of M followers.
    """
    fails = tests.fails
    found = [Inadequate(v, *fails[k].tolist()) for v, k in subjects if fails[k].any()]
    together = tests.united.fails[0].tolist()
    return found or ([Inadequate(0, *together)] if any(together) and len(subjects) > 1 else [])
