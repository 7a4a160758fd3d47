"""The model as a regression, and the one bounded least-squares solver of this package.

    dv/dt = X θ + r,    X = (p, -v, Δv),    θ = (α, ατ, β) ≥ 0

The rates dv/dt are central differences. Instants that the segment masks do not count, nor do those
at which a sample is missing. The rows of several windows stand one after the other, so that their
normal equations add up and each instant of any window counts once.

With an intercept s₀ [m] the model is dv/dt = X θ - α s₀ + r. A fixed s₀ is taken from the gaps; one
that is estimated vanishes from rows about their means, over all windows together as they share it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Self

import numpy as np

from accpinn.model.cthp import LINEAR_NAMES, Case, Parameters, regressors
from accpinn.model.registry import PAPER
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask, frozen


@dataclass(frozen=True, eq=False)
class Solution:
    """The θ of least squares within its bounds, of one vehicle or of M."""

    theta: FloatArray
    """(3,) or (M, 3) α, ατ, β ≥ 0."""
    unconstrained: FloatArray
    """(3,) or (M, 3) the optimum without the bounds."""
    active: Mask
    """(3,) or (M, 3) whether a component is zero because of the bounds."""
    terms: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,) or (M, 3) s₀, λ and d."""

    @classmethod
    def stack(cls, parts: Sequence["Solution"], followers: int) -> Self:
        """(M, 3): one solution a follower, or a single one that all of them share."""
        rows = parts if len(parts) == followers else [parts[0]] * followers
        return cls(
            frozen([row.theta for row in rows]),
            frozen([row.unconstrained for row in rows]),
            np.array([row.active for row in rows]),
        )

    @classmethod
    def of(cls, theta: FloatArray) -> Self:
        """A θ at which no bound is active."""
        return cls(theta, theta, np.zeros(theta.shape, dtype=np.bool_))

    @property
    def parameters(self) -> Parameters:
        """α, β, τ within the bounds, and the terms."""
        alpha, beta, tau = np.moveaxis(Parameters.from_theta(self.theta).values, -1, 0)
        return Parameters(alpha, beta, tau, *np.moveaxis(self.terms, -1, 0))

    @property
    def active_names(self) -> tuple[tuple[str, ...], ...]:
        """Per follower, the names of the components at their bounds."""
        return tuple(
            tuple(name for name, held in zip(LINEAR_NAMES, row, strict=True) if held)
            for row in np.atleast_2d(self.active)
        )


def solve_bounded(gram: FloatArray, moment: FloatArray) -> Solution:
    """Minimise xᵀGx - 2mᵀx over x ≥ 0 exactly, for a positive semi-definite G (K, K) and m (K,).

    Every active set is tried, so the answer is the global optimum; K is 2 or 3 in this package.
    """
    size = len(moment)
    unconstrained = frozen(np.linalg.lstsq(gram, moment, rcond=None)[0])
    if (unconstrained >= 0).all():
        return Solution.of(unconstrained)
    best, best_cost, active = np.zeros(size), 0.0, np.ones(size, bool)
    for count in range(1, size):
        for free in map(list, combinations(range(size), count)):
            part = np.linalg.lstsq(gram[np.ix_(free, free)], moment[free], rcond=None)[0]
            cost = float(-part @ moment[free])
            if (part >= 0).all() and cost < best_cost:
                best, best_cost, active = np.zeros(size), cost, np.ones(size, bool)
                best[free], active[free] = part, False
    return Solution(frozen(best), unconstrained, active)


def solve_platoon(grams: FloatArray, moments: FloatArray, case: Case) -> Solution:
    """`solve_bounded` for each follower (Case II) or for all of them together (Case I).

    The normal matrices are (M, 3, 3), the moments (M, 3); in Case I the solution's rows are equal.
    """
    followers = len(grams)
    if case == "I":
        grams, moments = grams.sum(0, keepdims=True), moments.sum(0, keepdims=True)
    parts = [solve_bounded(g, m) for g, m in zip(grams, moments, strict=True)]
    return Solution.stack(parts, followers)


@dataclass(frozen=True, eq=False)
class Regression:
    """The rows of M followers at N instants; zero where an instant does not count."""

    terms: FloatArray
    """(M, N, 3) X: p [m], -v [m/s], Δv [m/s]."""
    rates: FloatArray
    """(M, N) dv/dt in m/s²."""

    @classmethod
    def of_windows(cls, segments: Sequence[Segment]) -> Self:
        """The rows of several windows, with central differences of their speeds."""
        return cls.joined([cls.of(segment) for segment in segments])

    @classmethod
    def joined(cls, parts: Sequence["Regression"]) -> Self:
        """The rows of several motions of the same followers, one after the other."""
        terms = np.concatenate([part.terms for part in parts], axis=1)
        return cls(terms, np.concatenate([part.rates for part in parts], axis=1))

    @classmethod
    def of(cls, segment: Segment) -> Self:
        """The rows of a segment, with central differences of its speeds."""
        rates = np.gradient(segment.measured_speeds[:, 1:], segment.sample_time, axis=0)
        mask = None
        if segment.mask is not None or segment.missing is not None:
            mask = segment.counts & ~np.isnan(rates)
        return cls.of_motion(segment.speeds, segment.gaps, rates, mask)

    @classmethod
    def of_motion(
        cls, speeds: FloatArray, gaps: FloatArray, rates: FloatArray, mask: Mask | None
    ) -> Self:
        """The rows of any motion: speeds (N, M+1), gaps (N, M) and the followers' dv/dt (N, M).

        The mask (N, M) is True where an instant counts; None where all do.
        """
        terms = regressors(speeds, gaps)
        if mask is None:
            return cls(terms, rates.T)
        return cls(np.where(mask.T[:, :, None], terms, 0.0), np.where(mask, rates, 0.0).T)

    def grams(self) -> FloatArray:
        """(M, 3, 3) XᵀX."""
        return self.terms.transpose(0, 2, 1) @ self.terms

    def moments(self) -> FloatArray:
        """(M, 3) Xᵀ dv/dt."""
        return np.asarray(np.einsum("mnk,mn->mk", self.terms, self.rates))

    def solve(self, case: Case, spec: ModelSpec = PAPER_SPEC) -> Solution:
        """The least-squares θ within the rational driving constraints.

        The model is the CTHP or the one with an s₀, which is nan where α = 0 unless it is fixed.
        """
        if spec.model == PAPER:
            return solve_platoon(self.grams(), self.moments(), case)
        counts: Mask = np.asarray(self.terms.any(axis=2))
        if spec.fixed:
            ((_, s0),) = spec.fixed
            shift = counts[..., None] * np.array([s0, 0.0, 0.0])
            solution = Regression(self.terms - shift, self.rates).solve(case)
            return _with_intercept(solution, np.full(len(counts), s0))
        axis = (0, 1) if case == "I" else 1
        weights = counts[..., None] / counts.sum(axis=axis, keepdims=True)[..., None]
        term = (weights * self.terms).sum(axis=axis, keepdims=True)
        rate = (weights[..., 0] * self.rates).sum(axis=axis, keepdims=True)
        terms = np.where(counts[..., None], self.terms - term, 0.0)
        solution = Regression(terms, np.where(counts, self.rates - rate, 0.0)).solve(case)
        offset = (term * solution.theta[:, None]).sum(axis=2)[:, 0] - rate[:, 0]
        alpha = solution.theta[:, 0]
        s0 = np.divide(offset, alpha, out=np.full(len(alpha), np.nan), where=alpha > 0)
        return _with_intercept(solution, s0)


def _with_intercept(solution: Solution, s0: FloatArray) -> Solution:
    """The solution (M, 3) with intercepts (M,) in m."""
    return replace(solution, terms=np.column_stack([s0, np.zeros((len(s0), 2))]))
