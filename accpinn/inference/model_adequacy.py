"""Model adequacy: α, β and τ if the model had one term more.

    CTHP                   dv/dt = α(p - τv) + βΔv
    standstill distance    dv/dt = α(p - s₀ - τv) + βΔv
    delay                  dv/dt (t) = [α(p - τv) + βΔv] (t - d)

Intervals account for noise and disturbances *if the model holds*. Real controllers keep a distance
at standstill and act with a delay, and a model that lacks these puts them into α, β and τ. Each
form is fitted by least squares over steps of a second (see `methods.regression`), d is
searched over whole samples. A form that explains held-out seconds better is to be preferred.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from accpinn.errors import Finding
from accpinn.methods.regression import OneSecondMeans, one_second_means, solve_bounded
from accpinn.model.cthp import Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

Form = Literal["as it is", "standstill distance", "delay"]
LONGEST_DELAY: Seconds = 3.0
DELAY_STEP: Seconds = 0.1
HOLDOUT = 1 / 3
"""Share of the seconds, the last ones, that a form is tested on after fitting it to the others."""
FEWEST = 30
"""Seconds below which no form is fitted."""
BETTER = 0.02
"""A form that explains so much more of the held-out seconds is better."""


class BetterForm(Finding, frozen=True):
    """Another form of the model explains a follower's held-out seconds better than the CTHP."""

    vehicle: int
    form: Form
    extra: float
    """s₀ in m or d in s."""
    holdout: float
    """Share of the acceleration's variance that it explains there."""
    cthp_holdout: float
    """Share that the CTHP explains there."""
    alpha: float
    beta: float
    tau: float


@dataclass(frozen=True, eq=False)
class ModelForm:
    """One form of the model for each of M followers; nan where the window is too short."""

    form: Form
    parameters: Parameters
    """(M,)"""
    extra: FloatArray
    """(M,) s₀ in m or d in s; 0 for the CTHP."""
    explained: FloatArray
    """(M,) share of the acceleration's variance, at most 1."""
    holdout: FloatArray
    """(M,) the same on the last third, by the form fitted to the first two thirds."""


def model_forms(segment: Segment) -> tuple[ModelForm, ModelForm, ModelForm]:
    """The CTHP, with a standstill distance, and with a delay, each follower by itself.

    All are judged on the same seconds, which begin after the longest delay.
    """
    first = min(round(LONGEST_DELAY / segment.sample_time), segment.samples // 4)
    stride = max(1, round(DELAY_STEP / segment.sample_time))
    delayed = [one_second_means(segment, first, shift) for shift in range(0, first + 1, stride)]
    steps, followers = delayed[0], range(segment.followers)
    return (
        _form("as it is", [_fitted(steps, k) for k in followers]),
        _form("standstill distance", [_fitted(steps, k, constant=True) for k in followers]),
        _form("delay", [_delay(delayed, k, stride * segment.sample_time) for k in followers]),
    )


def better_forms(vehicles: Sequence[int], forms: Sequence[ModelForm]) -> tuple[BetterForm, ...]:
    """A finding for each follower of which another form explains held-out seconds better.

    Args:
        vehicles: (M+1,) numbers in the file, leader first.
        forms: the result of `model_forms`.
    """
    cthp, *others = forms
    found = []
    for k, vehicle in enumerate(vehicles[1:]):
        best = max(others, key=lambda form: np.nan_to_num(form.holdout[k], nan=-np.inf))
        if best.holdout[k] > cthp.holdout[k] + BETTER:
            figures = (best.extra[k], best.holdout[k], cthp.holdout[k], *best.parameters.values[k])
            found.append(BetterForm(vehicle, best.form, *map(float, figures)))
    return tuple(found)


def _fitted(steps: OneSecondMeans, follower: int, constant: bool = False) -> FloatArray:
    """(6,) α, ατ, β, the extra term, and the shares explained in all and in held-out seconds."""
    mask = steps.mask[follower]
    terms, rates = steps.terms[follower][mask], steps.rates[follower][mask]
    if len(rates) < FEWEST:
        return np.full(6, np.nan)
    if constant:  # a fourth column, whose coefficient is -α s₀
        terms = np.hstack([terms, np.ones((len(terms), 1))])
    early, late = np.split(np.arange(len(rates)), [round((1 - HOLDOUT) * len(rates))])
    theta = _least_squares(terms, rates)
    extra = 0.0
    if constant:
        extra = -theta[3] / theta[0] if theta[0] > 0 else np.nan
    holdout = _explained(terms[late], rates[late], _least_squares(terms[early], rates[early]))
    return np.array([*theta[:3], extra, _explained(terms, rates, theta), holdout])


def _delay(delayed: Sequence[OneSecondMeans], follower: int, step: Seconds) -> FloatArray:
    """The row of `_fitted` with the delay that explains most."""
    found = [_fitted(steps, follower) for steps in delayed]
    best = int(np.argmax([row[4] for row in found]))
    found[best][3] = best * step
    return found[best]


def _least_squares(terms: FloatArray, rates: FloatArray) -> FloatArray:
    """θ with α, ατ, β of at least 0; further coefficients are free."""
    bounded = np.arange(terms.shape[1]) < 3
    return solve_bounded(terms.T @ terms, terms.T @ rates, bounded).theta


def _explained(terms: FloatArray, rates: FloatArray, theta: FloatArray) -> float:
    """1 - residual variance / variance."""
    total = float(((rates - rates.mean()) ** 2).sum())
    return 1.0 - float(((rates - terms @ theta) ** 2).sum()) / total if total else float("nan")


def _form(form: Form, rows: list[FloatArray]) -> ModelForm:
    table = np.array(rows)
    return ModelForm(form, Parameters.from_theta(table[:, :3]), *table[:, 3:].T)
