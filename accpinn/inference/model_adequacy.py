"""Model adequacy: does the CTHP with its disturbance explain the recording, or one term more?

Three further forms of the model stand in the same exact likelihood (see `methods.state_space`):

    offset    dv/dt = α(p - s₀ - τv) + βΔv + r      s₀ [m]: a standstill distance, or a slope
    lag       dv/dt = f + r,  df/dt = (α(p - τv) + βΔv - f)/λ      λ [s]: of the actuator
    delay     dv/dt = α(p - τv) + βΔv, d seconds ago, + r          d [s]

They are compared by Akaike's criterion, AIC = 2k - 2 log L with k unknowns, and by the density that
each, estimated from the first two thirds of the time, gives to what is measured in the last third.
A form that neither prefers may still be true: a lag of a second changes α and β by half, and yet
five minutes of a recording hardly tell it from none, while those of a vehicle without lag exclude
one of a second. So where no form is clearly better, the intervals to be used are those with a lag:
they hold for lags of up to about a second. Where there is none, they are hardly wider than the
CTHP's, but miss α and β somewhat more often. All are of the form's own posterior (see
`inference.posterior`), its further unknown free.

If a form holds, its standardised innovations ε are white, even and normal. Of those of gap and own
speed (Bonferroni's correction unites the two) are tested the correlation over 10 s (Ljung and Box,
1978), the variance against the speed (Breusch and Pagan, 1979), and skewness and kurtosis (Jarque
and Bera, 1980). A response that is not linear, as where the controller limits its acceleration,
would add powers of the command c = α(p - τv) + βΔv to the acceleration. ε is regressed on what c²
and c³, so added, would do to it, beside p, v, u and 1 (a score test, after the RESET of Ramsey,
1969); the filter is linear, so it turns their effects on p and v into those on ε. Holm's correction
keeps the chance that a true model fails any test below the level. What no single follower shows may
show in all of them: their p-values are united by Fisher's method (1925), and tested alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm
from scipy.special import chdtrc, ndtr

from accpinn.channels import PARAMETERS
from accpinn.errors import Finding
from accpinn.inference.intervals import DRAWS, ParameterInterval, interval_ends
from accpinn.inference.intervals import LEVEL as INTERVAL_LEVEL
from accpinn.inference.posterior import sample
from accpinn.methods.kalman import Innovations, innovations
from accpinn.methods.likelihood import Criterion, Maximum, maximise, natural
from accpinn.methods.maximum_likelihood import joint_maxima
from accpinn.methods.series import Series, measured_followers, series_of
from accpinn.methods.state_space import FORMS, Form, StateSpace, coordinates
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Mask, Seconds

LEARNED = 2 / 3
"""Share of the time from which a form is estimated before it is tried on the rest."""
BETTER = 4.0
"""A form is better when its AIC is lower by so much and held-out time is more probable, too."""
LEVEL = 0.01
"""Of the test whether the model is adequate."""
LAGS = 20
"""Of the correlation, in samples of 0.5 s."""
SETTLING = 20
"""Samples at the start of a series that the filter needs to forget that it knew nothing."""


class FormIntervals(Finding, frozen=True, kw_only=True):
    """The intervals of a follower's parameters under another form of the model."""

    vehicle: int
    """0 for all followers together."""
    form: Form
    extra: float
    """s₀ in m, λ or d in s."""
    intervals: tuple[ParameterInterval, ...]
    """Of α, β and τ under this form, with the values of greatest likelihood."""
    extra_lower: float
    extra_upper: float
    """Ends of the interval of s₀, λ or d."""
    level: float
    """Of these intervals."""


class BetterForm(FormIntervals, frozen=True, kw_only=True):
    """Another form of the model is better supported by a follower's data than the CTHP."""

    aic: float
    """Its AIC minus the CTHP's."""
    holdout: float
    """ln of how many times as probable held-out time is."""


class PossibleLag(FormIntervals, frozen=True, kw_only=True):
    """No form is clearly better, which is no evidence against a lag: the intervals that allow it.

    Data that a lag of a second has shaped hardly tell it from none, while α and β differ by half.
    """


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


AdequacyFinding = BetterForm | PossibleLag | Inadequate


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
    """p-values of the tests of a form's innovations; (M,) each, not corrected."""

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
    def recommended(self) -> tuple[FormIntervals, ...]:
        """The intervals to be used, one set a follower: of a better form, or with a lag."""
        return tuple(one for one in self.findings if isinstance(one, FormIntervals))


@lru_cache(maxsize=32)
def model_forms(segment: Segment, case: Case = "II") -> Adequacy:
    """Every form of the model in the likelihood of a segment.

    Args:
        segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
        case: "I", where all followers share the unknowns of each form, or "II".

    Returns:
        No form where the window is too short for the likelihood; nan for a follower that is hardly
        measured.
    """
    known = measured_followers((segment,), case)
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
    first = held_out = np.zeros(count)
    for form in FORMS:
        maxima[form] = joint_maxima((segment,), case, form, known)
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
        best = min(forms, key=lambda form: form.aic[k])
        own = series_of([segment], case, (k,))
        if best.aic[k] < -BETTER and best.holdout[k] > 0:
            told = _form_intervals(vehicle, best.form, own, maxima[best.form][group])
            found.append(BetterForm(**told, aic=float(best.aic[k]), holdout=float(best.holdout[k])))
        else:
            found.append(PossibleLag(**_form_intervals(vehicle, "lag", own, maxima["lag"][group])))
    return Adequacy(tuple(forms), tests, (*found, *_inadequate(subjects, tests)))


def _extra(form: Form, values: FloatArray) -> FloatArray:
    """(..) s₀ in m, λ or d in s, from the unknowns (.., P); 0 for the CTHP."""
    if form == "cthp":
        return np.zeros(values.shape[:-1])
    return np.asarray(-values[..., -1] / values[..., 0] if form == "offset" else values[..., -1])


def _form_intervals(vehicle: int, form: Form, series: Series, maximum: Maximum) -> dict[str, Any]:
    """What `FormIntervals` has, from the posterior of a form.

    Args:
        vehicle: its number in the file.
        form: of the model.
        series: this follower's alone, or in Case I that of all.
        maximum: where the search ended.
    """
    (posterior,) = sample(series, [maximum], form)
    drawn = natural(form, posterior.all_evenly(DRAWS))
    lower, upper = interval_ends(Parameters.from_theta(drawn[:, :3]).values, INTERVAL_LEVEL)
    extra_lower, extra_upper = interval_ends(_extra(form, drawn), INTERVAL_LEVEL)
    values = Parameters.from_theta(maximum.theta).values
    lower = np.where(values == 0.0, 0.0, lower)
    rows = zip(PARAMETERS, lower.tolist(), upper.tolist(), values.tolist(), strict=True)
    return {
        "vehicle": vehicle,
        "form": form,
        "extra": float(_extra(form, maximum.values)),
        "intervals": tuple(
            ParameterInterval(one.symbol, low, high, likeliest=value)
            for one, low, high, value in rows
        ),
        "extra_lower": float(extra_lower),
        "extra_upper": float(extra_upper),
        "level": INTERVAL_LEVEL,
    }


def _deviations(maximum: Maximum) -> FloatArray:
    """(3,) of ln α, ln β, ln τ; infinite where a bound holds one of them."""
    free = np.diag(maximum.curvature) > 0
    if not free[:3].all():
        return np.full(3, np.inf)
    covariance = np.linalg.pinv(maximum.curvature[np.ix_(free, free)], hermitian=True)[:3, :3]
    logs = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 1.0, 0.0]])
    return np.asarray(np.sqrt(np.maximum(np.diag(logs @ covariance @ logs.T), 0.0)))


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
            uneven = _uneven(errors[known], speed[known])
            values.append((_correlated(errors), uneven, jarque_bera(errors[known])[1]))
        rows.append(np.minimum(2.0 * np.min(values, axis=0), 1.0))
    return (*np.array(rows).T, _nonlinear(series, maxima, model, found))


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
    """(G,) p-values of c² and c³ as further terms; see above. Model and innovations: gap last."""
    theta = np.array([maxima[g].theta for g in series.group])
    alpha, alpha_tau, beta = theta.T
    p, v, u = series.measured.transpose(1, 0, 2)
    command = alpha * p - alpha_tau * v + beta * (u - v)
    terms = np.nan_to_num([command**2, command**3, p, v, u, np.ones_like(p)])
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
        explained = _explained(rows, target) - _explained(rows[:, 2:], target)
        values.append(chdtrc(2, explained))
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


def _explained(columns: FloatArray, target: FloatArray) -> float:
    """The sum of squares of the target (n,) that the columns (n, k) explain."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    left, values, _ = np.linalg.svd(columns / scale, full_matrices=False)
    return float(((target @ left[:, values > 1e-9 * values[0]]) ** 2).sum())


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
    if len(errors) < LAGS or np.ptp(speeds) == 0.0:
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
