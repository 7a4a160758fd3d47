"""The law as a regression: what the measured motion says about θ = (α, ατ, β), row by row.

    dv/dt = X θ + r,    X = (p, -v, Δv)

with dv/dt by central differences. Rows can be left out, so that a part of the time can be looked
at; nothing is left out unless the segment or the caller says which.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from accpinn.model.cthp import Case, PlatoonSolution, regressors, solve_platoon
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Regression:
    """The rows of every follower; M followers, N instants."""

    terms: FloatArray
    """(M, N, 3) X: p [m], -v [m/s], Δv [m/s]."""
    rates: FloatArray
    """(M, N) dv/dt in m/s²."""

    @classmethod
    def of(cls, segment: Segment) -> Self:
        """The rows of a segment; those that it leaves out are zero."""
        rates = np.gradient(segment.speeds[:, 1:], segment.sample_time, axis=0)
        rows = cls(regressors(segment.speeds, segment.gaps), rates.T)
        return rows if segment.mask is None else rows.kept(segment.mask)

    def kept(self, keep: Mask) -> Self:
        """The rows in ``keep`` (N, M) count, the others are zero and so do not."""
        return type(self)(self.terms * keep.T[:, :, None], self.rates * keep.T)

    def grams(self) -> FloatArray:
        """(M, 3, 3) XᵀX."""
        return self.terms.transpose(0, 2, 1) @ self.terms

    def moments(self) -> FloatArray:
        """(M, 3) Xᵀ dv/dt."""
        return np.asarray(np.einsum("mnk,mn->mk", self.terms, self.rates))

    def solve(self, case: Case) -> PlatoonSolution:
        """The least-squares θ within the rational driving constraints."""
        return solve_platoon(self.grams(), self.moments(), case)

    def residuals(self, theta: FloatArray) -> FloatArray:
        """(M, N) r in m/s² at θ (M, 3)."""
        return np.asarray(self.rates - np.einsum("mnk,mk->mn", self.terms, theta))
