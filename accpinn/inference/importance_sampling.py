"""Adaptive multiple importance sampling from mixtures of Student's t distributions.

Draws of all stages count, each weighted by the density p(w) over the mixture of all proposals q_s
of the N_s draws of each stage:

    weight ∝ p(w) / Σ_s N_s q_s(w)

The first proposal is given, each further one has the weighted mean and covariance of all draws
before it. So that few draws of large weight do not draw the next proposal to themselves, it adapts
to weights to a power of at most one. What is proposed beyond an end is folded back.

Source: Cappé, Douc, Guillin, Marin and Robert, Statistics and Computing 18 (2008) 447-459; Cornuet,
Marin, Mira and Robert, Scandinavian Journal of Statistics 39 (2012) 798-812.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln

from accpinn.methods.state_space import COMMON
from accpinn.units import FloatArray, Mask, MetresPerSecond

ENOUGH = 350
"""Effective draws at which a group needs no further stage."""
FREEDOM = 8.0
"""Degrees of freedom of Student's t; its tails are wider than those of all posteriors so far."""
PAIRED = 4
"""Draws per unknown above which their covariance is made exact."""
INFLATION = 1.1
"""Factor on the proposal's deviations, for the same reason."""
TRUST = 10.0
"""Effective draws at which their covariance and the previous scale have equal weight."""
LEAST_EFFECTIVE = 40.0
"""Effective draws to which a proposal adapts at least."""
POWERS = 0.8 ** np.arange(30)
"""Powers of the weights that are tried for that."""
LEAST_SHARE = 0.02
"""Least share of a part of a mixture."""
S0 = len(COMMON)
"""Index of s₀ in z, in models that have it."""
ROUNDING = 1e-12
"""Share of the largest variance below which a variance counts as zero."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted draws of the unknowns of one group."""

    coordinates: FloatArray
    """(n, P) draws of z."""
    weights: FloatArray
    """(n,) weights, which sum to one."""
    log_likelihood: FloatArray
    """(n,) of the data at each draw."""

    @property
    def effective(self) -> float:
        """The number of independent draws that would be equally precise."""
        return float(1.0 / (self.weights**2).sum())

    def under(self, factor: FloatArray) -> "Posterior":
        """Reweight the draws to a density with a further factor, whose logarithms are (n,)."""
        with np.errstate(divide="ignore"):
            return replace(self, weights=normalised(np.log(self.weights) + factor))

    def evenly(self, count: int) -> "Posterior":
        """So many draws of equal weight, each as often as its own demands, in no order of time."""
        edges, steps = np.cumsum(self.weights), (np.arange(count) + 0.5) / count
        at = np.searchsorted(edges, steps * edges[-1])
        weights = np.full(count, 1.0 / count)
        return Posterior(self.coordinates[at], weights, self.log_likelihood[at])


@dataclass(frozen=True, eq=False)
class Student:
    """A multivariate Student's t distribution."""

    centre: FloatArray
    """(P,) centre."""
    scale: FloatArray
    """(P, P) scale matrix; rows and columns of unknowns that a bound holds are zero."""

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

    @cached_property
    def root(self) -> tuple[Mask, FloatArray]:
        """The mask (P,) of free coordinates, and a root of their scale (f, f)."""
        # Unlike eigenvectors, Cholesky's root is continuous in the matrix, so draws are the same
        # on every processor.
        variances = np.diag(self.scale)
        free: Mask = np.asarray(variances > ROUNDING * variances.max())
        part = self.scale[np.ix_(free, free)] + np.diag(ROUNDING * variances[free])
        return free, np.asarray(np.linalg.cholesky(part) * INFLATION)

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draws (count, P)."""
        free, root = self.root
        half = rng.standard_normal(((count + 1) // 2, len(root)))
        # Opposite pairs of the exact covariance: few draws are as wide as many.
        normal = np.concatenate([half, -half])[:count]
        if count > PAIRED * len(root):
            spread = np.linalg.cholesky(normal.T @ normal / count)
            normal = solve_triangular(spread, normal.T, lower=True).T
        stretch = np.resize(FREEDOM / rng.chisquare(FREEDOM, len(half)), count)
        drawn = np.tile(self.centre, (count, 1))
        drawn[:, free] += (normal * np.sqrt(stretch)[:, None]) @ root.T
        return drawn

    @cached_property
    def whitening(self) -> tuple[FloatArray, float]:
        """(P, P) the transpose of the root's inverse, zero beside it; the log density's peak."""
        free, root = self.root
        whitening = np.zeros_like(self.scale)
        inverse = solve_triangular(root, np.eye(len(root)), lower=True)
        whitening[np.ix_(free, free)] = inverse.T
        count = len(root)
        size = np.log(np.diag(root)).sum() + 0.5 * count * np.log(FREEDOM * np.pi)
        size += gammaln(FREEDOM / 2.0) - gammaln((FREEDOM + count) / 2.0)
        return whitening, -float(size)


@dataclass(frozen=True, eq=False)
class Proposal:
    """A mixture of Student's t distributions."""

    parts: tuple[Student, ...]
    """The K parts."""
    shares: FloatArray
    """(K,) shares of the parts, which sum to one."""
    least: float = -np.inf
    """Least value of the last coordinate, at which what is below it is folded."""
    speed: MetresPerSecond = np.inf
    """v of the time gap; what is above τ = 0, s₀ = v (τ + s₀/v), is folded there."""

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draws (count, P)."""
        numbers = rng.multinomial(count, self.shares)
        parts = zip(self.parts, numbers, strict=True)
        drawn = np.concatenate([part.draw(number, rng) for part, number in parts])
        for at, end, nearest in self._ends(drawn):
            drawn[:, at] = nearest(drawn[:, at], 2.0 * end - drawn[:, at])
        return drawn

    def _ends(self, drawn: FloatArray) -> Iterator[tuple[int, FloatArray | float, np.ufunc]]:
        """Ends at which draws (n, P) are folded: coordinate, end, and the function that clips."""
        if np.isfinite(self.least):
            yield -1, self.least, np.maximum
        if np.isfinite(self.speed):
            yield S0, self.speed * np.exp(drawn[:, 1] - drawn[:, 0]), np.minimum

    def log_density(self, drawn: FloatArray) -> FloatArray:
        """(n,) log density at (n, P)."""
        return log_sum(self.log_densities(drawn))

    def log_densities(self, drawn: FloatArray) -> FloatArray:
        """(K, n) log density of each part at (n, P), times its share."""
        images = [drawn]
        for at, end, _ in self._ends(drawn):
            folded = [image.copy() for image in images]
            for image in folded:
                image[:, at] = 2.0 * end - image[:, at]
            images += folded
        every, (count, size) = np.concatenate(images), drawn.shape
        whitenings, peaks = zip(*(part.whitening for part in self.parts), strict=True)
        centres = [
            part.centre @ whitening for part, whitening in zip(self.parts, whitenings, strict=True)
        ]
        away = every @ np.concatenate(whitenings, axis=1) - np.concatenate(centres)
        away = away.reshape(len(images), count, -1, size)
        distance = np.einsum("inkp,inkp->ikn", away, away)
        freedom = FREEDOM + np.array([len(part.root[1]) for part in self.parts])
        logs = log_sum(-0.5 * freedom[:, None] * np.log(1.0 + distance / FREEDOM))
        return np.asarray((np.log(self.shares) + peaks)[:, None] + logs)

    def adapted(self, drawn: FloatArray, weights: FloatArray, densities: FloatArray) -> "Proposal":
        """Adapt each part to the draws (n, P) that probably came from it, with weights (n,).

        The densities (K, n) are their `log_densities`.
        """
        belongs = np.exp(densities - log_sum(densities)) * weights
        pairs = zip(self.parts, belongs, strict=True)
        parts = [part.adapted(drawn, own_weights) for part, own_weights in pairs]
        return replace(self, parts=tuple(parts), shares=floored(belongs.sum(axis=1)))


class Sampling:
    """The draws of one group so far, and the proposal of the next ones."""

    def __init__(self, proposal: Proposal, size: int) -> None:
        """Begin without draws of the P unknowns."""
        self.proposal = proposal
        self.posterior = Posterior(np.empty((0, size)), np.empty(0), np.empty(0))
        self._past: list[tuple[Proposal, float]] = []
        """Proposals so far, and the logarithms of how many draws each made."""
        self._drawn, self._target, self._factor = np.empty((0, size)), np.empty(0), np.empty(0)
        self._log_density = np.empty(0)
        """(n,) of all past proposals together, up to a constant."""

    @property
    def lacks(self) -> bool:
        """Whether too few draws count, by themselves or with the further factor."""
        return min(self.posterior.effective, self._with_factor.effective) < ENOUGH

    @property
    def _with_factor(self) -> Posterior:
        return self.posterior.under(self._factor)

    def add(
        self,
        drawn: FloatArray,
        z: FloatArray,
        target: FloatArray,
        log_likelihood: FloatArray,
        factor: FloatArray,
    ) -> None:
        """Weigh all draws anew with these w (n, P) of the proposal, which adapts to them.

        Their unknowns are z (n, P), the target (n,) is the log posterior over w, up to a constant,
        and the factor (n,) the logarithm of the further one.
        """
        before = [weight + proposal.log_density(drawn) for proposal, weight in self._past]
        self._past.append((self.proposal, float(np.log(len(drawn)))))
        none = np.full(len(drawn), -np.inf)
        self._log_density = np.append(self._log_density, np.logaddexp.reduce([none, *before]))
        self._drawn = np.concatenate([self._drawn, drawn])
        self._target = np.append(self._target, target)
        self._factor = np.append(self._factor, factor)
        densities = self.proposal.log_densities(self._drawn)
        latest = self._past[-1][1] + log_sum(densities)
        self._log_density = np.logaddexp(self._log_density, latest)
        ratios = self._target - self._log_density
        self.posterior = Posterior(
            np.concatenate([self.posterior.coordinates, z]),
            normalised(ratios),
            np.append(self.posterior.log_likelihood, log_likelihood),
        )
        if self._with_factor.effective < min(ENOUGH, self.posterior.effective):
            ratios = ratios + self._factor
        self.proposal = self.proposal.adapted(self._drawn, _tempered(ratios), densities)


def log_sum(logs: FloatArray) -> FloatArray:
    """(..) the logarithm of the sum of what (K, ..) are the logarithms of."""
    top = logs.max(axis=0)
    return np.asarray(top + np.log(np.exp(logs - top).sum(axis=0)))


def floored(shares: FloatArray) -> FloatArray:
    """Shares of which none vanishes, because a part may have had too few draws so far."""
    floored = shares + LEAST_SHARE
    return np.asarray(floored / floored.sum())


def _tempered(log: FloatArray) -> FloatArray:
    """Weights (n,) to the largest power at which `LEAST_EFFECTIVE` draws or more count, if any."""
    for power in POWERS:
        weights = normalised(power * log)
        if (weights**2).sum() <= 1.0 / LEAST_EFFECTIVE:
            break
    return weights


def normalised(log: FloatArray) -> FloatArray:
    """Weights (n,) that sum to one, from their logarithms up to a constant."""
    if not np.isfinite(log.max()):  # nothing plausible was proposed
        return np.asarray(np.full(len(log), 1.0 / len(log)))
    weights = np.exp(log - log.max())
    return np.asarray(weights / weights.sum())
