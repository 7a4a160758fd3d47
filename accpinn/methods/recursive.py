"""Recursive least squares with exponential forgetting: the parameters of the last minute or so.

Between two samples the model holds for the means of its terms, with φ = (p, -v, Δv):

    (v_k - v_{k-1}) / h = θ · (φ_k + φ_{k-1}) / 2 + error

Each sample adds its row to the sums, and older rows count less and less:

    G_k = λ G_{k-1} + φ̄_k φ̄_kᵀ,   m_k = λ m_{k-1} + φ̄_k y_k,   λ = exp(-h / memory),

    θ_k = argmin θᵀ G_k θ - 2 m_kᵀ θ   subject to α, ατ, β ≥ 0.

This is the information form of the recursion: it needs no first guess, and G_k cannot lose its
definiteness to rounding. The means on the right keep a receiver's white noise on v from being
correlated with the difference on the left, which would bias a forward difference.

The parameters of the fit are the mean of θ_k after one memory or half of the window; the last θ_k
would represent the last minute only.

Case I sums the rows of all followers. Masked rows add nothing; the memory fades meanwhile.

Source: Wang, Gunter, Nice, Delle Monache and Work, IEEE Transactions on Intelligent Vehicles 6
(2021) 288-298; forgetting as in Ljung, System Identification, 2nd edition, section 11.2.
"""

from dataclasses import dataclass

import numpy as np

from accpinn.methods import direct
from accpinn.methods.fit import BoundActiveAtTimes, Fit, MethodFinding, Outcome, WeaklyDetermined
from accpinn.methods.online import kept_samples, track
from accpinn.methods.regression import Solution, solve_bounded
from accpinn.model.cthp import LINEAR_NAMES, Case, regressors
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask, Seconds, frozen

MEMORY: Seconds = 60.0
"""Older samples count less than 1/e: long enough for a few changes of speed, which determine the
parameters, and short enough to see them change within a window of five minutes."""
UNDETERMINED = 1e10
"""Condition number of G, scaled to a unit diagonal, beyond which rounding decides."""


def fit(segment: Segment, case: Case = "II", memory: Seconds = MEMORY) -> Fit:
    """The mean of the estimates after a run-in, and their track; there is no surrogate.

    Args:
        segment: the data.
        case: "I" or "II".
        memory: time constant of forgetting.
    """
    sums = _accumulate(segment, case, memory)
    theta, unconstrained = _solve(sums)
    late = sums.time >= min(memory, segment.window.duration / 2)
    solutions = [
        _mean(sums, k, theta[late, k], unconstrained[late, k]) for k in range(theta.shape[1])
    ]
    solution = Solution.stack(solutions, segment.followers)
    return Fit.of(
        "recursive",
        segment,
        case,
        solution,
        outcome=Outcome.FILTERED,
        config={"memory": memory},
        track=track(segment, theta, _covariance(sums, unconstrained)),
        findings=_findings(segment, theta[late], solution),
    )


@dataclass(frozen=True, eq=False)
class _Sums:
    """Weighted sums up to each of K instants, for each of G parameter sets."""

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


def _accumulate(segment: Segment, case: Case, memory: Seconds) -> _Sums:
    from scipy.signal import lfilter  # takes a second to import, which few need

    step = segment.sample_time
    terms = regressors(segment.speeds, segment.gaps)
    rows = (terms[:, 1:] + terms[:, :-1]) / 2
    rates = np.diff(segment.speeds[:, 1:], axis=0).T / step
    kept = kept_samples(segment)
    weights = np.ones_like(rates)
    if segment.mask is not None:  # a row needs both of its samples
        weights[~(segment.mask[1:] & segment.mask[:-1]).T] = 0.0
        rows, rates = rows * weights[..., None], rates * weights

    def summed(values: FloatArray, forgetting: float) -> FloatArray:
        """(M, N-1, ..) to (K, G, ..)."""
        if case == "I":
            values = values.sum(axis=0, keepdims=True)
        sums: FloatArray = lfilter([1.0], [1.0, -forgetting], values, axis=1)
        return sums[:, np.array(kept) - 1].swapaxes(0, 1)

    keep = float(np.exp(-step / memory))
    products = rows[..., :, None] * rows[..., None, :]
    return _Sums(
        segment.time[kept],
        summed(products, keep),
        summed(rows * rates[..., None], keep),
        summed(rates**2, keep),
        summed(products, keep**2),
        summed(weights, keep),
    )


def _solve(sums: _Sums) -> tuple[FloatArray, FloatArray]:
    """θ within the bounds and without, each (K, G, 3); nan where it is not yet determined."""
    theta = np.full_like(sums.moment, np.nan)
    unconstrained = np.full_like(sums.moment, np.nan)
    for index in np.argwhere(_determined(sums.gram)):
        at = tuple(index)
        solution = solve_bounded(sums.gram[at], sums.moment[at])
        theta[at], unconstrained[at] = solution.theta, solution.unconstrained
    return theta, unconstrained


def _determined(gram: FloatArray) -> Mask:
    """(K, G) whether the rows so far determine all three parameters."""
    lengths = np.sqrt(np.diagonal(gram, axis1=2, axis2=3))
    present = (lengths > 0).all(axis=2)
    lengths = np.where(lengths > 0, lengths, 1.0)
    values = np.linalg.eigvalsh(gram / (lengths[..., :, None] * lengths[..., None, :]))
    return np.asarray(present & (values[..., 0] * UNDETERMINED > values[..., -1]))


def _covariance(sums: _Sums, theta: FloatArray) -> FloatArray:
    """(K, G, 3, 3) of the unconstrained θ, as if the errors were independent of one another."""
    determined = np.isfinite(theta[..., :1, None])
    inverse = np.linalg.inv(np.where(determined, sums.gram, np.eye(3)))
    explained = np.einsum("kgi,kgi->kg", sums.moment, theta)
    weight = np.where(sums.weight > 0, sums.weight, 1.0)
    variance = np.maximum(sums.square - explained, 0.0) / weight
    return np.asarray(variance[..., None, None] * (inverse @ sums.gram_of_squares @ inverse))


def _mean(sums: _Sums, k: int, theta: FloatArray, unconstrained: FloatArray) -> Solution:
    """The mean over instants, (.., 3) each; if none determines θ, the shortest θ that fits."""
    determined = np.isfinite(theta[:, 0])
    if not determined.any():
        return solve_bounded(sums.gram[-1, k], sums.moment[-1, k])
    mean, free = theta[determined].mean(axis=0), unconstrained[determined].mean(axis=0)
    return Solution(frozen(mean), frozen(free), mean == 0)


def _findings(segment: Segment, theta: FloatArray, solution: Solution) -> list[MethodFinding]:
    """What the means hide: θ never determined, and bounds that were active for a part of the time.

    Args:
        segment: the data.
        theta: (K, G, 3) the estimates averaged over.
        solution: their mean.
    """
    findings: list[MethodFinding] = []
    for k, vehicle in enumerate(segment.vehicles[1:]):
        values = theta[:, k % theta.shape[1]]
        if not np.isfinite(values).any():
            findings.append(WeaklyDetermined(vehicle))
            continue
        shares = (values == 0).mean(axis=0).tolist()
        findings += [
            BoundActiveAtTimes(vehicle, name, share)
            for name, share, always in zip(LINEAR_NAMES, shares, solution.active[k], strict=True)
            if share and not always
        ]
    return findings


METHOD = direct(
    "recursive", "Recursive", fit, typical_seconds=0.3,
    summary="recursive least squares with exponential forgetting",
)  # fmt: skip
