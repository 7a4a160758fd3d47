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
"""Of Student's t: its tails are wider than those of any posterior met so far."""
INFLATION = 1.15
"""Of the proposal's deviations, for the same reason."""
TRUST = 10.0
"""Effective draws at which a covariance of draws counts half."""
LEAST_PRECISION = 0.25
"""In any direction, of the first proposal: a flat criterion is no reason to look far away."""
LEAST_SHARE = 0.02
"""Of a part of a proposal."""
ROUNDING = 1e-12
"""Share of a proposal's variance that stands for none."""


@dataclass(frozen=True, eq=False)
class Student:
    """A multivariate Student's t."""

    centre: FloatArray
    """(P,)"""
    scale: FloatArray
    """(P, P); rows and columns of what a bound holds are zero."""

    @classmethod
    def of(cls, centre: FloatArray, curvature: FloatArray) -> "Student":
        """With the curvature (P, P) of ln of its density at the centre."""
        free = np.diag(curvature) > 0
        free[:3] = True
        values, vectors = np.linalg.eigh(curvature[np.ix_(free, free)])
        scale = np.zeros_like(curvature)
        scale[np.ix_(free, free)] = vectors / np.maximum(values, LEAST_PRECISION) @ vectors.T
        return cls(centre, scale)

    def adapted(self, drawn: FloatArray, weights: FloatArray) -> "Student":
        """With mean and covariance of draws (n, P) that have weights (n,)."""
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
        # Unlike a root by eigenvectors, Cholesky's hardly changes where the matrix hardly does, so
        # that the draws are the same wherever they are made.
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
        """(n,) at (n, P), of the free coordinates."""
        free, root = self.root()
        away = solve_triangular(root, (drawn - self.centre)[:, free].T, lower=True)
        distance = (away**2).sum(axis=0)
        count = len(root)
        size = np.log(np.diag(root)).sum() + 0.5 * count * np.log(FREEDOM * np.pi)
        size += gammaln(FREEDOM / 2.0) - gammaln((FREEDOM + count) / 2.0)
        return np.asarray(-size - 0.5 * (FREEDOM + count) * np.log1p(distance / FREEDOM))


@dataclass(frozen=True, eq=False)
class Proposal:
    """A mixture of Student's t."""

    parts: tuple[Student, ...]
    """K of them."""
    shares: FloatArray
    """(K,) sum to one."""

    @classmethod
    def at(cls, maxima: Sequence[Maximum]) -> "Proposal":
        """With a part at each maximum; several are those on the grid of the further unknown."""
        curvatures = np.array([one.curvature for one in maxima])
        if len(maxima) > 1:
            # What a bound holds in some parts has a spread there as well.
            least = np.where(np.diagonal(curvatures, axis1=1, axis2=2) > 0, 0.0, 1.0)
            usual = np.diagonal(curvatures, axis1=1, axis2=2).max(axis=0)
            curvatures += np.einsum("kp,pq->kpq", least * usual, np.eye(len(usual)))
            curvatures[:, -1, -1] += 1.0 / np.gradient([one.coordinates[-1] for one in maxima]) ** 2
        parts = tuple(
            Student.of(one.coordinates, curvature)
            for one, curvature in zip(maxima, curvatures, strict=True)
        )
        mass = [
            one.criterion + np.log(np.diag(part.root()[1])).sum()
            for one, part in zip(maxima, parts, strict=True)
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
        """(K, n): of each part at (n, P), its share included."""
        return np.array(
            [
                np.log(share) + part.log_density(drawn)
                for part, share in zip(self.parts, self.shares, strict=True)
            ]
        )

    def adapted(self, drawn: FloatArray, weights: FloatArray, densities: FloatArray) -> "Proposal":
        """Each part with the weighted mean and covariance of the draws that it stands for.

        Args:
            drawn: (n, P)
            weights: (n,)
            densities: (K, n) those of `log_densities`.
        """
        belongs = np.exp(densities - np.logaddexp.reduce(densities, axis=0)) * weights
        parts = [part.adapted(drawn, own) for part, own in zip(self.parts, belongs, strict=True)]
        return Proposal(tuple(parts), _floored(belongs.sum(axis=1)))


def _floored(shares: FloatArray) -> FloatArray:
    """Shares of which none vanishes, as a part may lie where too few draws have been yet."""
    return np.asarray((shares + LEAST_SHARE) / (1.0 + LEAST_SHARE * len(shares)))


def normalised(log: FloatArray) -> FloatArray:
    """Weights (n,) that sum to one, from their logarithms up to a constant."""
    if not np.isfinite(log.max()):  # nothing plausible was proposed
        return np.asarray(np.full(len(log), 1.0 / len(log)))
    weights = np.exp(log - log.max())
    return np.asarray(weights / weights.sum())
