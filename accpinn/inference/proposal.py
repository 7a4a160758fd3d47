"""Proposals of importance sampling: mixtures of Student's t that adapt to weighted draws.

Source: Cappé, Douc, Guillin, Marin and Robert, Statistics and Computing 18 (2008) 447-459.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln

from accpinn.methods.likelihood import Maximum
from accpinn.units import FloatArray, Mask

FREEDOM = 5.0
"""Degrees of freedom of Student's t; its tails are wider than those of all posteriors so far."""
INFLATION = 1.15
"""Factor on the proposal's deviations, for the same reason."""
TRUST = 10.0
"""Effective draws at which their covariance and the previous scale have equal weight."""
LEAST_PRECISION = 0.25
"""Least precision of the first proposal in any direction, against a flat criterion."""
LEAST_SHARE = 0.02
"""Least share of a part of a mixture."""
ROUNDING = 1e-12
"""Share of the largest variance below which a variance counts as zero."""


@dataclass(frozen=True, eq=False)
class Student:
    """A multivariate Student's t distribution."""

    centre: FloatArray
    """(P,) centre."""
    scale: FloatArray
    """(P, P) scale matrix; rows and columns of unknowns that a bound holds are zero."""

    @classmethod
    def of(cls, centre: FloatArray, curvature: FloatArray) -> "Student":
        """The distribution whose log density has a curvature (P, P) at the centre."""
        free = np.diag(curvature) > 0
        free[:3] = True
        values, vectors = np.linalg.eigh(curvature[np.ix_(free, free)])
        scale = np.zeros_like(curvature)
        scale[np.ix_(free, free)] = vectors / np.maximum(values, LEAST_PRECISION) @ vectors.T
        return cls(centre, scale)

    def adapted(self, drawn: FloatArray, weights: FloatArray) -> "Student":
        """The distribution with the mean and covariance of draws (n, P) with weights (n,)."""
        total = weights.sum()
        if not total > 0.0:
            return self
        weights = weights / total
        centre = weights @ drawn
        away = drawn - centre
        covariance = (away * weights[:, None]).T @ away
        effective = 1.0 / (weights**2).sum()
        trust = effective / (effective + TRUST)
        return Student(centre, trust * covariance + (1.0 - trust) * self.scale)

    def root(self) -> tuple[Mask, FloatArray]:
        """Which coordinates are free (P,), and a root of their scale (f, f)."""
        # Unlike eigenvectors, Cholesky's root is continuous in the matrix, so draws are the same
        # on every processor.
        variances = np.diag(self.scale)
        free: Mask = np.asarray(variances > ROUNDING * variances.max())
        part = self.scale[np.ix_(free, free)] + np.diag(ROUNDING * variances[free])
        return free, np.asarray(np.linalg.cholesky(part) * INFLATION)

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draws (count, P)."""
        free, root = self.root()
        normal = rng.standard_normal((count, len(root)))
        stretch = FREEDOM / rng.chisquare(FREEDOM, count)
        drawn = np.tile(self.centre, (count, 1))
        drawn[:, free] += (normal * np.sqrt(stretch)[:, None]) @ root.T
        return drawn

    def log_density(self, drawn: FloatArray) -> FloatArray:
        """(n,) log density of the free coordinates at (n, P)."""
        free, root = self.root()
        away = solve_triangular(root, (drawn - self.centre)[:, free].T, lower=True)
        distance = (away**2).sum(axis=0)
        count = len(root)
        size = np.log(np.diag(root)).sum() + 0.5 * count * np.log(FREEDOM * np.pi)
        size += gammaln(FREEDOM / 2.0) - gammaln((FREEDOM + count) / 2.0)
        return np.asarray(-size - 0.5 * (FREEDOM + count) * np.log1p(distance / FREEDOM))


@dataclass(frozen=True, eq=False)
class Proposal:
    """A mixture of Student's t distributions."""

    parts: tuple[Student, ...]
    """The K parts."""
    shares: FloatArray
    """(K,) shares of the parts, which sum to one."""

    @classmethod
    def at(cls, maxima: Sequence[Maximum]) -> "Proposal":
        """A mixture with a part at each maximum; several lie on the grid of the further unknown."""
        curvatures = np.array([maximum.curvature for maximum in maxima])
        if len(maxima) > 1:
            # An unknown that a bound holds in some parts varies in these as well.
            least = np.where(np.diagonal(curvatures, axis1=1, axis2=2) > 0, 0.0, 1.0)
            usual = np.diagonal(curvatures, axis1=1, axis2=2).max(axis=0)
            curvatures += np.einsum("kp,pq->kpq", least * usual, np.eye(len(usual)))
            grid = [maximum.coordinates[-1] for maximum in maxima]
            curvatures[:, -1, -1] += 1.0 / np.gradient(grid) ** 2
        parts = tuple(
            Student.of(maximum.coordinates, curvature)
            for maximum, curvature in zip(maxima, curvatures, strict=True)
        )
        mass = [
            maximum.criterion + np.log(np.diag(part.root()[1])).sum()
            for maximum, part in zip(maxima, parts, strict=True)
        ]
        return cls(parts, _floored(normalised(np.array(mass))))

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draws (count, P)."""
        if len(self.parts) == 1:
            return self.parts[0].draw(count, rng)
        numbers = rng.multinomial(count, self.shares)
        return np.concatenate(
            [part.draw(number, rng) for part, number in zip(self.parts, numbers, strict=True)]
        )

    def log_densities(self, drawn: FloatArray) -> FloatArray:
        """(K, n) log density of each part at (n, P), times its share."""
        return np.array(
            [
                np.log(share) + part.log_density(drawn)
                for part, share in zip(self.parts, self.shares, strict=True)
            ]
        )

    def adapted(self, drawn: FloatArray, weights: FloatArray, densities: FloatArray) -> "Proposal":
        """Adapt each part to the weighted draws that probably came from it.

        Args:
            drawn: (n, P) draws.
            weights: (n,) their weights.
            densities: (K, n) their `log_densities`.
        """
        belongs = np.exp(densities - np.logaddexp.reduce(densities, axis=0)) * weights
        pairs = zip(self.parts, belongs, strict=True)
        parts = [part.adapted(drawn, own_weights) for part, own_weights in pairs]
        return Proposal(tuple(parts), _floored(belongs.sum(axis=1)))


def _floored(shares: FloatArray) -> FloatArray:
    """Shares of which none vanishes, because a part may have had too few draws so far."""
    return np.asarray((shares + LEAST_SHARE) / (1.0 + LEAST_SHARE * len(shares)))


def normalised(log: FloatArray) -> FloatArray:
    """Weights (n,) that sum to one, from their logarithms up to a constant."""
    if not np.isfinite(log.max()):  # nothing plausible was proposed
        return np.asarray(np.full(len(log), 1.0 / len(log)))
    weights = np.exp(log - log.max())
    return np.asarray(weights / weights.sum())
