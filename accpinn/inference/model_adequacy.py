"""What α, β and τ would be if the law had one term more.

    as it is               dv/dt = α(p - τv) + βΔv
    standstill distance    dv/dt = α(p - s₀ - τv) + βΔv
    delay                  dv/dt (t) = [α(p - τv) + βΔv] (t - d)

Intervals say what noise and disturbances leave open *if the law holds*. Real controllers keep a
distance at standstill and act with a delay, and a law that lacks these puts them into α, β and τ.
Each form is fitted by least squares over steps of a second (see `seconds`), d is searched over
whole samples. A form that explains seconds better which it was not learned from deserves belief.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from accpinn.methods.regression import one_second_means
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

Form = Literal["as it is", "standstill distance", "delay"]
LONGEST_DELAY: Seconds = 3.0
DELAY_STEP: Seconds = 0.1
UNSEEN = 1 / 3
"""Share of the seconds, the last ones, that a form is tested on after learning from the others."""
FEWEST = 30
"""Seconds below which nothing is said."""
BETTER = 0.02
"""A form that explains so much more of unseen seconds is worth a sentence."""


@dataclass(frozen=True, eq=False)
class ModelForm:
    """One form of the law for each of M followers; nan where the window says too little."""

    form: Form
    parameters: FloatArray
    """(M, 3) α [1/s²], β [1/s], τ [s]; τ is nan where α = 0."""
    extra: FloatArray
    """(M,) s₀ in m or d in s; 0 for the law as it is."""
    explained: FloatArray
    """(M,) share of the acceleration's variance, at most 1."""
    unseen: FloatArray
    """(M,) the same on the last third, by the form learned from the first two thirds."""


def model_forms(segment: Segment) -> tuple[ModelForm, ModelForm, ModelForm]:
    """The law as it is, with a standstill distance, and with a delay, each follower by itself.

    All are judged on the same seconds, which begin after the longest delay.
    """
    first = min(round(LONGEST_DELAY / segment.sample_time), segment.samples // 4)
    stride = max(1, round(DELAY_STEP / segment.sample_time))
    late = [_rows(segment, first, shift) for shift in range(0, first + 1, stride)]
    plain, step = late[0], stride * segment.sample_time
    return (
        _extension("as it is", [_solved(rows) for rows in plain]),
        _extension("standstill distance", [_solved(rows.with_constant()) for rows in plain]),
        _extension("delay", [_delayed(rows, step) for rows in zip(*late, strict=True)]),
    )


def better(labels: Sequence[str], found: Sequence[ModelForm]) -> tuple[str, ...]:
    """One sentence for each follower of which another form explains unseen seconds better.

    Args:
        labels: of the M followers.
        found: what `extensions` gave.
    """
    plain, *others = found
    sentences = []
    for k, label in enumerate(labels):
        best = max(others, key=lambda form: np.nan_to_num(form.unseen[k], nan=-np.inf))
        if not best.unseen[k] > plain.unseen[k] + BETTER:
            continue
        alpha, beta, tau = best.parameters[k]
        sentences.append(
            f"{label}: with {_extra(best, k)} the law explains {100 * best.unseen[k]:.0f} % of the"
            f" acceleration in seconds it was not learned from, instead of"
            f" {100 * plain.unseen[k]:.0f} %;"
            f" α, β, τ are then {alpha:.4f}, {beta:.4f}, {tau:.3f}."
        )
    return tuple(sentences)


def _extra(form: ModelForm, follower: int) -> str:
    if form.form == "delay":
        delay = form.extra[follower]
        longest = ", the longest tried," if delay > LONGEST_DELAY - DELAY_STEP / 2 else ""
        return f"a delay of {delay:.1f} s{longest}"
    return f"a distance of {form.extra[follower]:.1f} m at standstill"


@dataclass(frozen=True, eq=False)
class _Rows:
    """The regression of one follower."""

    terms: FloatArray
    """(K, 3), or (K, 4) with a constant."""
    rates: FloatArray
    known: NDArray[np.bool_]

    def with_constant(self) -> "_Rows":
        """A fourth column, whose coefficient is -α s₀."""
        constant = np.ones((len(self.terms), 1))
        return _Rows(np.hstack([self.terms, constant]), self.rates, self.known)

    def part(self, keep: NDArray[np.bool_]) -> "_Rows":
        """Only the seconds in ``keep`` count."""
        return _Rows(self.terms, self.rates, self.known & keep)

    def theta(self) -> FloatArray:
        """Least squares with α, ατ, β of at least 0."""
        size = self.terms.shape[1]
        lowest = np.r_[np.zeros(3), np.full(size - 3, -np.inf)]
        found = lsq_linear(self.terms[self.known], self.rates[self.known], (lowest, np.inf))
        return np.asarray(found.x)

    def explained(self, theta: FloatArray) -> float:
        """1 - residual variance / variance."""
        left = (self.rates - self.terms @ theta)[self.known]
        total = float(((self.rates[self.known] - self.rates[self.known].mean()) ** 2).sum())
        return 1.0 - float((left**2).sum()) / total if total else float("nan")


@dataclass(frozen=True)
class _Solution:
    law: tuple[float, float, float]
    extra: float
    explained: float
    unseen: float


_NOTHING = _Solution((np.nan,) * 3, np.nan, np.nan, np.nan)


def _solved(rows: _Rows) -> _Solution:
    if rows.known.sum() < FEWEST:
        return _NOTHING
    theta = rows.theta()
    seconds = np.flatnonzero(rows.known)
    late = np.arange(len(rows.known)) >= seconds[round((1 - UNSEEN) * len(seconds))]
    unseen = rows.part(late).explained(rows.part(~late).theta())
    alpha, alpha_tau, beta = theta[:3]
    tau = alpha_tau / alpha if alpha > 0 else np.nan
    distance = 0.0
    if len(theta) > 3:
        distance = -theta[3] / alpha if alpha > 0 else np.nan
    return _Solution((alpha, beta, tau), distance, rows.explained(theta), unseen)


def _rows(segment: Segment, first: int, shift: int) -> list[_Rows]:
    """The followers' seconds from sample ``first`` on, terms ``shift`` samples older than rates."""
    steps = one_second_means(segment, first, shift)
    return [_Rows(*each) for each in zip(steps.terms, steps.rates, steps.mask, strict=True)]


def _delayed(candidates: Sequence[_Rows], step: Seconds) -> _Solution:
    """The delay that explains most, with the law that belongs to it."""
    found = [_solved(rows) for rows in candidates]
    best = int(np.argmax([one.explained for one in found]))
    return replace(found[best], extra=best * step)


def _extension(form: Form, found: list[_Solution]) -> ModelForm:
    return ModelForm(
        form,
        np.array([one.law for one in found]),
        np.array([one.extra for one in found]),
        np.array([one.explained for one in found]),
        np.array([one.unseen for one in found]),
    )
