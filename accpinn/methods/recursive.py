"""Recursive least squares with exponential forgetting: the law as it looks from here and now.

Between two samples the law holds for the means of its terms, with φ = (p, -v, Δv):

    (v_k - v_{k-1}) / h = θ · (φ_k + φ_{k-1}) / 2 + error

Each sample adds its row to what is known, and the old counts less and less:

    G_k = λ G_{k-1} + φ̄_k φ̄_kᵀ,   m_k = λ m_{k-1} + φ̄_k y_k,   λ = exp(-h / memory),

    θ_k = argmin θᵀ G_k θ - 2 m_kᵀ θ   subject to α, ατ, β ≥ 0.

This is the information form of the recursion: it needs no first guess, and G_k cannot lose its
definiteness to rounding. The means on the right keep a receiver's white noise on v from being
correlated with the difference on the left, which would bias a forward difference.

The parameters of the fit are the mean of θ_k over the settled part of the window, that is, after
one memory or half of the window. The last θ_k would speak for the last minute only.

Case I adds up the rows of all followers, one law for the platoon. Rows that the segment leaves out
add nothing; the memory fades meanwhile.

Source: Wang, Gunter, Nice, Delle Monache and Work, IEEE Transactions on Intelligent Vehicles 6
(2021) 288-298; forgetting as in Ljung, System Identification, 2nd edition, section 11.2.
"""

import time
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from accpinn.methods.fit import Fit, Outcome, bound_notes
from accpinn.methods.method import direct
from accpinn.methods.online import kept_samples, track
from accpinn.model.cthp import (
    LINEAR_NAMES,
    Case,
    LinearSolution,
    Parameters,
    PlatoonSolution,
    regressors,
    solve_linear,
)
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds, frozen

MEMORY: Seconds = 60.0
"""Older samples count less than 1/e: long enough for a few changes of speed, which the law is
learned from, and short enough to see it change within a window of five minutes."""
UNDETERMINED = 1e10
"""Condition number of G, scaled to a unit diagonal, beyond which rounding decides."""


def fit(segment: Segment, case: Case = "II", memory: Seconds = MEMORY) -> Fit:
    """The mean of the settled estimates, and their course; there is no surrogate."""
    started = time.perf_counter()
    known = _accumulate(segment, case, memory)
    theta, unconstrained = _solve(known)
    settled = known.time >= min(memory, segment.window.duration / 2)
    solutions = [
        _settled(known, law, theta[settled, law], unconstrained[settled, law])
        for law in range(theta.shape[1])
    ]
    solution = PlatoonSolution.of(solutions, segment.followers)
    return Fit(
        method="recursive",
        case=case,
        parameters=Parameters.from_theta(solution.theta),
        surrogate=None,
        outcome=Outcome.FILTERED,
        seconds=time.perf_counter() - started,
        config={"memory": memory},
        unconstrained=Parameters.from_theta(solution.unconstrained),
        active_bounds=solution.active,
        track=track(known.time, theta, _covariance(known, unconstrained), segment.followers),
        notes=bound_notes(segment.vehicles, solution)
        + _notes(segment, theta[settled], solution.active),
    )


@dataclass(frozen=True, eq=False)
class _Known:
    """Weighted sums up to each of K instants, for each of G laws."""

    time: FloatArray
    """(K,)"""
    gram: FloatArray
    """(K, G, 3, 3)"""
    moment: FloatArray
    """(K, G, 3)"""
    square: FloatArray
    """(K, G) Σ λ^(k-j) y_j²."""
    gram_of_squares: FloatArray
    """(K, G, 3, 3) as the first, with squared weights."""
    weight: FloatArray
    """(K, G) sum of the weights."""


def _accumulate(segment: Segment, case: Case, memory: Seconds) -> _Known:
    step = segment.sample_time
    terms = regressors(segment.speeds, segment.gaps)
    rows = (terms[:, 1:] + terms[:, :-1]) / 2
    rates = np.diff(segment.speeds[:, 1:], axis=0).T / step
    kept = kept_samples(segment)
    weights = np.ones_like(rates)
    if segment.mask is not None:  # a row needs both of its samples
        weights[~(segment.mask[1:] & segment.mask[:-1]).T] = 0.0
        rows, rates = rows * weights[..., None], rates * weights

    def summed(values: FloatArray, forget: float) -> FloatArray:
        """(M, N-1, ..) to (K, G, ..)."""
        if case == "I":
            values = values.sum(axis=0, keepdims=True)
        sums: FloatArray = lfilter([1.0], [1.0, -forget], values, axis=1)
        return sums[:, np.array(kept) - 1].swapaxes(0, 1)

    keep = float(np.exp(-step / memory))
    products = rows[..., :, None] * rows[..., None, :]
    return _Known(
        segment.time[kept],
        summed(products, keep),
        summed(rows * rates[..., None], keep),
        summed(rates**2, keep),
        summed(products, keep**2),
        summed(weights, keep),
    )


def _solve(known: _Known) -> tuple[FloatArray, FloatArray]:
    """θ within the bounds and without, each (K, G, 3); nan where the rows do not tell yet."""
    theta = np.full_like(known.moment, np.nan)
    unconstrained = np.full_like(known.moment, np.nan)
    for index in np.argwhere(_determined(known.gram)):
        at = tuple(index)
        solution = solve_linear(known.gram[at], known.moment[at])
        theta[at], unconstrained[at] = solution.theta, solution.unconstrained
    return theta, unconstrained


def _determined(gram: FloatArray) -> FloatArray:
    """(K, G) whether the rows so far tell all three parameters apart."""
    lengths = np.sqrt(np.diagonal(gram, axis1=2, axis2=3))
    present = (lengths > 0).all(axis=2)
    lengths = np.where(lengths > 0, lengths, 1.0)
    values = np.linalg.eigvalsh(gram / (lengths[..., :, None] * lengths[..., None, :]))
    return np.asarray(present & (values[..., 0] * UNDETERMINED > values[..., -1]))


def _covariance(known: _Known, theta: FloatArray) -> FloatArray:
    """(K, G, 3, 3) of the unconstrained θ, as if the errors were independent of one another."""
    told = np.isfinite(theta[..., :1, None])
    inverse = np.linalg.inv(np.where(told, known.gram, np.eye(3)))
    explained = np.einsum("kgi,kgi->kg", known.moment, theta)
    weight = np.where(known.weight > 0, known.weight, 1.0)
    variance = np.maximum(known.square - explained, 0.0) / weight
    return np.asarray(variance[..., None, None] * (inverse @ known.gram_of_squares @ inverse))


def _settled(
    known: _Known, law: int, theta: FloatArray, unconstrained: FloatArray
) -> LinearSolution:
    """The mean over settled instants, (.., 3) each; if none tells, the shortest θ that fits."""
    told = np.isfinite(theta[:, 0])
    if not told.any():
        return solve_linear(known.gram[-1, law], known.moment[-1, law])
    mean, free = theta[told].mean(axis=0), unconstrained[told].mean(axis=0)
    names = zip(LINEAR_NAMES, mean, strict=True)
    return LinearSolution(
        frozen(mean), frozen(free), tuple(name for name, value in names if value == 0)
    )


def _notes(
    segment: Segment, theta: FloatArray, active: tuple[tuple[str, ...], ...]
) -> tuple[str, ...]:
    """What the means hide: laws never told, and bounds that held for a part of the time."""
    notes = []
    for index, vehicle in enumerate(segment.vehicles[1:]):
        values = theta[:, index % theta.shape[1]]
        if not np.isfinite(values).any():
            notes.append(
                f"Vehicle {vehicle}: at no time do the samples tell α, β and τ apart; the numbers"
                " are one possibility of many."
            )
            continue
        for name, share in zip(LINEAR_NAMES, (values == 0).mean(axis=0), strict=True):
            if share and name not in active[index]:
                notes.append(
                    f"Vehicle {vehicle}: {name} stood at zero, its bound, for {100 * share:.0f} %"
                    " of the time that the parameters are averaged over."
                )
    return tuple(notes)


METHOD = direct("recursive", "Recursive", fit, typical_seconds=0.3)
