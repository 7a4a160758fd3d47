"""Model adequacy: how the estimates depend on the model, and whether the CTHP holds.

The CTHP, and models with an intercept s₀, a lag, a delay, and with s₀ and a delay (see
`model.following`), have the same exact likelihood.

They are compared by their largest likelihoods, for which the further terms have no prior, by
Akaike's criterion, AIC = 2k - 2 log L with k unknowns, and by the density that each, estimated from
the first two thirds of the time, gives to the measurements of the last third. A model that neither
prefers may still be true: a lag of a second changes α and β by half, and yet five minutes of a
recording hardly distinguish it from no lag. The intervals under each model (see
`inference.posterior`) show how much α, β and τ depend on it.

The innovations of the CTHP test whether it holds (see `inference.innovation_tests`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from accpinn.findings import Finding, Labelled, Words
from accpinn.inference.coordinates import coordinates_of
from accpinn.inference.innovation_tests import InnovationTests, innovation_tests
from accpinn.inference.intervals import LEVEL, ends_of
from accpinn.inference.window_posterior import window_posterior
from accpinn.methods import one_thread
from accpinn.methods.joint_likelihood import joint_maxima
from accpinn.methods.kalman import innovations
from accpinn.methods.likelihood import Criterion, Maximum, maximise, search
from accpinn.methods.series import Series, determined_followers, series_of
from accpinn.methods.state_space import coordinates
from accpinn.model.cthp import Case, Parameters
from accpinn.model.registry import FOLLOWING, PAPER, TITLES
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray

LEARNED = 2 / 3
"""Share of the time from which a form is estimated before its density is computed on the rest. If
masked instants lie between several stretches, it is a share of the longest stretch."""
BETTER = 4.0
"""Decrease of the AIC that makes a form better, if held-out time is more probable, too."""
FORMS: tuple[str, ...] = ("cthp", "cthp-s0", "cthp-lag", "cthp-delay", "cthp-s0-delay")
"""The models that are compared."""
Subjects = Sequence[tuple[int, int]]
"""Number in the file and row of each follower, or (0, 0) for all."""


class BetterForm(Finding, frozen=True, kw_only=True):
    """Another model is better supported by a follower's data than the CTHP."""

    text = (
        "{vehicle}: the {model} describes the data better than the CTHP (AIC {aic:+.0f},"
        " log density of held-out time {holdout:+.1f})."
    )

    vehicle: int
    form: str
    aic: float
    """AIC of the form minus that of the CTHP."""
    holdout: float
    """Log density of held-out time under the form minus that under the CTHP."""

    def _words(self, about: Labelled) -> Words:
        return {"model": TITLES[self.form]}


class Inadequate(Finding, frozen=True):
    """The innovations of the CTHP are not as they would be if it held."""

    text = (
        "{vehicle}: the innovations of the model are {faults}, so intervals that assume the model"
        " may be too narrow; compare the forms of the model, and windows with each other."
    )

    vehicle: int
    correlated: bool
    """Whether they are correlated over time."""
    uneven: bool
    """Whether they are larger at some speeds than at others."""
    nonnormal: bool
    """Whether they are skewed, or have other tails than a normal distribution."""
    nonlinear: bool
    """Whether the acceleration is no linear function of gap and speeds."""

    def _words(self, about: Labelled) -> Words:
        faults = {
            "correlated over time": self.correlated,
            "larger at some speeds than at others": self.uneven,
            "not normally distributed": self.nonnormal,
            "dependent on the command, as where it is limited": self.nonlinear,
        }
        return {"faults": tuple(fault for fault, holds in faults.items() if holds)}


AdequacyFinding = BetterForm | Inadequate


@dataclass(frozen=True, eq=False)
class ModelForm:
    """One model, estimated for each of M followers."""

    form: str
    parameters: Parameters
    """(M,) the maximum-likelihood estimate, further terms included."""
    lower: Parameters
    """(M,) lower ends of the intervals under this model."""
    upper: Parameters
    """(M,) upper ends."""
    aic: FloatArray
    """(M,) AIC minus that of the CTHP; below zero is better."""
    holdout: FloatArray
    """(M,) log density of the last third minus that under the CTHP; nan where it has no samples."""

    @property
    def likelihood_ratio(self) -> FloatArray:
        """(M,) log L minus that of the CTHP."""
        return len(FOLLOWING[self.form].terms) - self.aic / 2.0


@dataclass(frozen=True, eq=False)
class Adequacy:
    """Tests of the CTHP and its further forms on a segment."""

    forms: tuple[ModelForm, ...]
    """All forms, the CTHP first; empty where nothing can be estimated."""
    tests: InnovationTests | None
    """Tests of the innovations of the CTHP; None where there is no form."""
    findings: tuple[AdequacyFinding, ...]

    @property
    def better(self) -> tuple[BetterForm, ...]:
        """The forms that describe a follower better than the CTHP, at most one per follower."""
        return tuple(finding for finding in self.findings if isinstance(finding, BetterForm))


@one_thread
def model_forms(segment: Segment, case: Case = "II") -> Adequacy:
    """Estimate every form of the model on a segment.

    Args:
        segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
        case: "I", where all followers share the unknowns of each form, or "II".

    Returns:
        No form where the window is too short for the likelihood or nothing moves; nan for a
        follower that is hardly measured, or does not move.

    Examples:
        >>> import accpinn
        >>> segment = accpinn.cut(accpinn.sample("motorway"), 0, 60, (1, 2))
        >>> [form.form for form in accpinn.model_forms(segment).forms][:2]
        ['cthp', 'cthp-s0']
    """
    determined = determined_followers((segment,), case)
    if not determined:
        return Adequacy((), None, ())
    series, count = series_of([segment], case, determined), segment.followers

    def spread(values: Sequence[ArrayLike] | FloatArray) -> FloatArray:
        """(M, ..) rows of all followers from those of the groups."""
        rows = np.asarray(values, float)
        full = np.full((count, *rows.shape[1:]), np.nan)
        full[list(determined)] = rows
        return full

    forms: list[ModelForm] = []
    cthp_aic = cthp_density = np.zeros(count)
    tests: tuple[FloatArray, ...] = ()
    for form in FORMS:
        maxima = joint_maxima((segment,), case, ModelSpec(form), determined)
        size = len(coordinates(form))
        aic = spread(2 * size - 2 * _largest_likelihoods(series, maxima, form))
        density = spread(_held_out_density(series, maxima, form))
        if form == "cthp":
            cthp_aic, cthp_density = aic, density
            tests = innovation_tests(series, maxima)
        alone = window_posterior(segment, case, ModelSpec(form))
        phi = np.moveaxis(alone.drawn, 0, 1)
        drawn = coordinates_of(form).parameters(phi, alone.speeds)
        centre = Parameters.of(alone.estimates)
        intervals = centre, *ends_of(centre, drawn, LEVEL)
        forms.append(ModelForm(form, *intervals, aic - cthp_aic, density - cthp_density))
    tested = InnovationTests(*map(spread, tests))
    subjects = [(0, 0)] if case == "I" else [(segment.vehicles[k + 1], k) for k in determined]
    better, inadequate = _better(subjects, forms), _inadequate(subjects, tested)
    return Adequacy(tuple(forms), tested, (*better, *inadequate))


def _better(subjects: Subjects, forms: Sequence[ModelForm]) -> list[BetterForm]:
    """The best form of each follower, if it is better than the CTHP."""
    better = []
    for vehicle, k in subjects:
        best = min(forms, key=lambda form: float(form.aic[k]))
        aic, holdout = float(best.aic[k]), float(best.holdout[k])
        if aic < -BETTER and holdout > 0:
            better.append(BetterForm(vehicle=vehicle, form=best.form, aic=aic, holdout=holdout))
    return better


def _largest_likelihoods(series: Series, maxima: Sequence[Maximum], form: str) -> FloatArray:
    """(G,) log L where the terms have no prior, so that the CTHP with s₀ has no less than the CTHP.

    A lag or delay has a least value, by which it may have less.
    """
    if form != PAPER:
        z = np.array([maximum.coordinates for maximum in maxima])
        maxima = search(Criterion(series, ModelSpec(form), is_flat=True), z, np.arange(len(z)))
    return np.array([maximum.log_likelihood for maximum in maxima])


def _held_out_density(series: Series, maxima: Sequence[Maximum], form: str) -> FloatArray:
    """(G,) log density of the last third, under parameters estimated from the time before."""
    spec, near = ModelSpec(form), [maximum.coordinates for maximum in maxima]
    learned = maximise(series.until(LEARNED), spec, near)
    z = np.array([learned[g].coordinates for g in series.group])
    _, predicted = innovations(Criterion(series, spec).model(z), series.measured)
    density = predicted.log_density[:, :2]
    late = density[round(LEARNED * len(density)) :].sum(axis=(0, 1))
    return np.asarray(np.bincount(series.group, late, series.groups), float)


def _inadequate(subjects: Subjects, tests: InnovationTests) -> list[Inadequate]:
    """The followers that fail a test; if none does, all followers together if they fail one."""
    fails = tests.fails
    single = [Inadequate(v, *fails[k].tolist()) for v, k in subjects if fails[k].any()]
    together = tests.united.fails[0].tolist()
    return single or ([Inadequate(0, *together)] if any(together) and len(subjects) > 1 else [])
