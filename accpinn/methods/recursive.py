"""Recursive least squares with exponential forgetting: the parameters of the last minute or so.

Between two samples the model holds for the means of its terms, with φ = (p, -v, Δv):

    (v_k - v_{k-1}) / h = θ · (φ_k + φ_{k-1}) / 2 + error

Each sample adds its row to the sums, and older rows count less and less:

    G_k = λ G_{k-1} + φ̄_k φ̄_kᵀ,   m_k = λ m_{k-1} + φ̄_k y_k,   λ = exp(-h / memory),

    θ_k = argmin θᵀ G_k θ - 2 m_kᵀ θ   subject to α, ατ, β ≥ 0.

This is the information form of the recursion: it needs no first guess, and G_k cannot lose its
definiteness to rounding. The means on the right keep a receiver's white noise on v from being
correlated with the difference on the left, which would bias a forward difference.

The parameters are the mean of θ_k after a run-in of one memory or half of the time driven; the last
θ_k would represent the last minute only.

Case I sums the rows of all followers. Masked rows add nothing; the memory fades meanwhile. Of
several windows each goes on with the sums of the one before it, in the order of time, and nothing
fades in between.

Source: Wang, Gunter, Nice, Delle Monache and Work, IEEE Transactions on Intelligent Vehicles 6
(2021) 288-298; forgetting as in Ljung, System Identification, 2nd edition, section 11.2.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from accpinn.methods import Segments, direct
from accpinn.methods.estimate import Estimate, Outcome
from accpinn.methods.findings import BoundActiveAtTimes, MethodFinding, WeaklyDetermined
from accpinn.methods.online import in_turn, track
from accpinn.methods.regression import Solution, solve_bounded
from accpinn.model.cthp import LINEAR_NAMES, Case, regressors
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask, Seconds, frozen

MEMORY: Seconds = 60.0
"""Older samples count less than 1/e: long enough for a few changes of speed, which determine the
parameters, and short enough to see them change within a window of five minutes."""
UNDETERMINED = 1e10
"""Condition number of G, scaled to a unit diagonal, beyond which rounding decides."""


def fit(
    segments: Segments,
    case: Case = "II",
    spec: ModelSpec = PAPER_SPEC,
    memory: Seconds = MEMORY,
) -> Estimate:
    """The mean of the estimates after a run-in, and their track; there are no curves.

    ``memory`` is the time constant of forgetting.
    """
    turns = in_turn(segments)
    windows = [_Rows.of(turn.segment) for turn in turns]

    def summed(values: Callable[[_Rows], FloatArray], power: int = 1) -> FloatArray:
        forgetting = [np.exp(-turn.segment.sample_time / memory) ** power for turn in turns]
        return _fading_sums(map(values, windows), forgetting, [t.tracked for t in turns], case)

    gram, moment = summed(_Rows.products), summed(lambda rows: rows.terms * rows.rates[..., None])
    theta, free = np.full((2, *moment.shape), np.nan)
    determined = _determined(gram)
    for index in np.argwhere(determined):
        at = tuple(index)
        solution = solve_bounded(gram[at], moment[at])
        theta[at], free[at] = solution.theta, solution.unconstrained
    # The covariance of the unconstrained θ, as if the errors were independent of one another.
    inverse = np.linalg.inv(np.where(determined[..., None, None], gram, np.eye(3)))
    explained, weight = np.einsum("kgi,kgi->kg", moment, free), summed(lambda rows: rows.weights)
    weight = np.where(weight > 0, weight, 1.0)
    variance = np.maximum(summed(lambda rows: rows.rates**2) - explained, 0.0) / weight
    covariance = inverse @ summed(_Rows.products, power=2) @ inverse

    # Time spent in windows up to the tracked samples.
    begins = np.cumsum([0.0, *(turn.segment.window.duration for turn in turns[:-1])])
    driven = [b + t.segment.time[t.tracked] for b, t in zip(begins, turns, strict=True)]
    late = np.concatenate(driven) >= min(memory, sum(s.window.duration for s in segments) / 2)
    means = []
    for k in range(theta.shape[1]):
        counts = late & determined[:, k]
        if counts.any():
            mean = theta[counts, k].mean(axis=0)
            means.append(Solution(frozen(mean), frozen(free[counts, k].mean(axis=0)), mean == 0))
        else:  # the shortest θ that fits
            means.append(solve_bounded(gram[-1, k], moment[-1, k]))
    solution = Solution.stack(means, segments[0].followers)
    return Estimate.of(
        "recursive",
        segments,
        case,
        spec,
        solution,
        outcome=Outcome.FILTERED,
        settings={"memory": memory},
        track=track(turns, theta, variance[..., None, None] * covariance),
        findings=_findings(segments[0], theta[late], solution),
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    """The contributions of a window's steps to the sums; zero for a step that does not count."""

    terms: FloatArray
    """(M, N-1, 3) φ̄."""
    rates: FloatArray
    """(M, N-1) y."""
    weights: FloatArray
    """(M, N-1) 1 for a step that counts."""

    @classmethod
    def of(cls, segment: Segment) -> "_Rows":
        """The rows of a segment."""
        terms = regressors(segment.speeds, segment.gaps)
        means = (terms[:, 1:] + terms[:, :-1]) / 2
        rates = np.diff(segment.speeds[:, 1:], axis=0).T / segment.sample_time
        weights = np.ones_like(rates)
        if segment.mask is not None:  # a row needs both of its samples
            weights[~(segment.mask[1:] & segment.mask[:-1]).T] = 0.0
        return cls(means * weights[..., None], rates * weights, weights)

    def products(self) -> FloatArray:
        """(M, N-1, 3, 3) φ̄ φ̄ᵀ."""
        return self.terms[..., :, None] * self.terms[..., None, :]


def _fading_sums(
    windows: Iterable[FloatArray],
    forgetting: Iterable[float],
    tracked: Iterable[list[int]],
    case: Case,
) -> FloatArray:
    """(K, G, ..) the weighted sums up to the kept samples, of (M, N-1, ..) in each window.

    Each window goes on with the sum of the one before it.
    """
    from scipy.signal import lfilter  # takes a second to import, which few need

    parts, last = [], np.zeros(())
    for values, keep, samples in zip(windows, forgetting, tracked, strict=True):
        if case == "I":
            values = values.sum(axis=0, keepdims=True)
        before = np.broadcast_to(keep * last, values[:, :1].shape)
        sums, _ = lfilter([1.0], [1.0, -keep], values, axis=1, zi=before)
        last = sums[:, -1:]
        parts.append(sums[:, np.array(samples) - 1].swapaxes(0, 1))
    return np.concatenate(parts)


def _determined(gram: FloatArray) -> Mask:
    """(K, G) whether the rows so far determine all three parameters."""
    lengths = np.sqrt(np.diagonal(gram, axis1=2, axis2=3))
    present = (lengths > 0).all(axis=2)
    lengths = np.where(lengths > 0, lengths, 1.0)
    values = np.linalg.eigvalsh(gram / (lengths[..., :, None] * lengths[..., None, :]))
    return np.asarray(present & (values[..., 0] * UNDETERMINED > values[..., -1]))


def _findings(segment: Segment, theta: FloatArray, solution: Solution) -> list[MethodFinding]:
    """Findings on estimates (K, G, 3) behind their mean: θ undetermined, bounds active at times."""
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
