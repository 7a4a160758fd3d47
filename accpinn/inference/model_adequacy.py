"""Model adequacy: the CTHP with its disturbance beside models with one term more.

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

Whether the CTHP itself holds is asked of its innovations (see `inference.innovation_tests`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from accpinn.channels import PARAMETERS
from accpinn.errors import Finding
from accpinn.inference.innovation_tests import InnovationTests, innovation_tests
from accpinn.inference.intervals import DRAWS, LEVEL, ParameterInterval, interval_ends
from accpinn.inference.posterior import Posterior, sample
from accpinn.inference.proposal import normalised
from accpinn.methods.kalman import Innovations, innovations
from accpinn.methods.likelihood import Criterion, Maximum, maximise, natural
from accpinn.methods.maximum_likelihood import joint_maxima
from accpinn.methods.method import one_thread
from accpinn.methods.series import Series, determined_followers, series_of
from accpinn.methods.state_space import FORMS, Form, coordinates
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray

LEARNED = 2 / 3
"""Share of the time from which a form is estimated before it is tried on the rest; of the longest
stretch, where masked instants lie between several."""
BETTER = 4.0
"""A form is better when its AIC is lower by so much and held-out time is more probable, too."""
PRIOR: dict[Form, float] = {"cthp": 0.01, "offset": 0.33, "lag": 0.6, "delay": 0.06}
"""Probability of each form before the data. Chosen so that the weighted intervals cover α, β and τ
alike whichever form is true; see docs/validation.md."""


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
    tests = InnovationTests(*map(spread, innovation_tests(series, maxima["cthp"])))
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
                BetterForm(vehicle=vehicle, posterior=own, aic=gain, holdout=holdout, level=LEVEL)
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
        lower, upper = interval_ends(own, LEVEL)
        lower = np.where(values == 0.0, 0.0, lower)
        extra_lower, extra_upper = interval_ends(_extra(form, rows), LEVEL)
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
    tail = (1.0 - LEVEL) / 2.0
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
        level=LEVEL,
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
