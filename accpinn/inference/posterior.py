"""The posterior distribution of the parameters, given the exact likelihood, as weighted draws.

    p(z | recording) ∝ L(z) p(z),   z = ln of all unknowns (see `methods.maximum_likelihood`)

is sampled by importance sampling: proposals from a multivariate Student's t, weighted by posterior
over proposal. The first proposal has the curvature at the maximum; each further one has the
weighted mean and covariance of the draws before it. An unknown that a bound holds at the maximum
stays there, except α, ατ, β and the further unknown of a form.

With a lag or a delay the posterior is a curved ridge and may have two modes. The proposal is then a
mixture with one part for each of several values of the lag. Each part lies at the maximum of the
criterion for its value, is as wide as these values are apart, and adapts to the draws near it. What
it proposes below the least value is folded back there.

With an intercept s₀ it is the time gap at the mean speed v that is determined, and of τ and s₀ only
τ + s₀/v. So proposals are of w, which is z with ln α(τ + s₀/v) in place of ln ατ: there the ridge
is straight.

The prior of α, β and τ is wide: normal in their logarithms, so that 95 % of α lie within a factor
of fifty of 0.08 1/s², of β within one of twenty of 0.2 1/s, and of τ within one of three of 1.4 s.
It matters only where a recording contains little information, and keeps intervals finite there.

Source: Cappé, Douc, Guillin, Marin and Robert, Statistics and Computing 18 (2008) 447-459.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln

from accpinn.methods.likelihood import Criterion, Groups, Maximum, natural, search
from accpinn.methods.series import Series
from accpinn.methods.state_space import COMMON, EXTRA, Form
from accpinn.model.cthp import TYPICAL
from accpinn.model.registry import FOLLOWING, Held
from accpinn.units import FloatArray, Mask, MetresPerSecond, Seconds

PRIOR_SPREAD = (2.0, 1.5, 0.6)
"""Standard deviations of ln α, ln β and the logarithm of the time gap."""
AT_SPEED: MetresPerSecond = 100 / 3.6
"""Speed at which the time gap τ + s₀/v has its prior."""
LEAST_GAP: Seconds = 0.05
"""Least such time gap; draws below it are none of a car's."""
STAGES = (200, 200, 1000)
"""Number of draws in each stage; those of the last are kept."""
FURTHER = 3
"""Largest number of further stages, for groups with few effective draws."""
ENOUGH = 0.2
"""Effective draws per draw above which no further stage is needed."""
GRID, ROUGH = (0.3, 0.8, 1.4), 1e-2
"""Lags or delays in s of the parts of the first proposal, and the gain in log density that is worth
no further round in the search for a part's maximum."""
FREEDOM = 8.0
"""Degrees of freedom of Student's t; its tails are wider than those of all posteriors so far."""
INFLATION = 1.1
"""Factor on the proposal's deviations, for the same reason."""
TRUST = 10.0
"""Effective draws at which their covariance and the previous scale have equal weight."""
LEAST_PRECISION = 0.25
"""Least precision of the first proposal in any direction, against a flat criterion."""
LEAST_SHARE = 0.02
"""Least share of a part of a mixture."""
S0 = len(COMMON)
"""Where z has s₀, in models that have it."""
SLOWEST: MetresPerSecond = 2.0
"""Least speed v for a time gap that is to hold in a window."""
ROUNDING = 1e-12
"""Share of the largest variance below which a variance counts as zero."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted draws of the unknowns of one group."""

    coordinates: FloatArray
    """(n, P) draws of z."""
    theta: FloatArray
    """(n, 3) draws of α, ατ, β, all above zero."""
    weights: FloatArray
    """(n,) weights, which sum to one."""
    log_likelihood: FloatArray
    """(n,) of the data at each draw."""

    @property
    def effective(self) -> float:
        """The number of independent draws that would be equally precise."""
        return float(1.0 / (self.weights**2).sum())

    def evenly(self, count: int) -> FloatArray:
        """(count, 3) draws of θ of equal weight, in no particular order of time."""
        return np.asarray(self.theta[self._even(count)])

    def all_evenly(self, count: int) -> FloatArray:
        """(count, P) draws of z of equal weight, in the order of `evenly`."""
        return np.asarray(self.coordinates[self._even(count)])

    def log_likelihood_evenly(self, count: int) -> FloatArray:
        """(count,) of the draws in the order of `evenly`."""
        return np.asarray(self.log_likelihood[self._even(count)])

    def _even(self, count: int) -> Groups:
        """(count,) indices of draws, each as often as its weight demands."""
        edges = np.cumsum(self.weights)
        at = (np.arange(count) + 0.5) / count * edges[-1]
        return np.asarray(np.searchsorted(edges, at))


def features(form: Form, z: FloatArray) -> FloatArray:
    """(.., 3 + T) ln α, ln β, ln of the time gap at `AT_SPEED`, and the T terms, of z (.., P).

    The data determine the time gap τ + s₀/v well and its two parts hardly, so it stands here in
    place of τ.
    """
    values = natural(form, z)
    gap = values[..., 1] / values[..., 0]
    if "s0" in FOLLOWING[form].terms:
        gap = gap + values[..., 9] / AT_SPEED
    shape = np.log(np.stack([values[..., 0], values[..., 2], np.maximum(gap, LEAST_GAP)], axis=-1))
    return np.concatenate([shape, values[..., 9:]], axis=-1)


def log_prior_of_theta(form: Form, z: FloatArray) -> FloatArray:
    """(..) log prior of α, β and the time gap at coordinates (.., P), up to a constant.

    It is a density over `features`, so dτ counts relative to the change of the time gap.
    """
    shape = features(form, z)[..., :3]
    away = (shape - np.log(TYPICAL.values)) / PRIOR_SPREAD
    volume = z[..., 1] - z[..., 0] - shape[..., 2]
    return np.asarray(-0.5 * (away**2).sum(axis=-1) + volume)


def log_prior_of_features(form: Form, phi: FloatArray) -> FloatArray:
    """(..) log density of the whole prior of the parameters over `features` (.., p)."""
    terms = [EXTRA[term] for term in FOLLOWING[form].terms]
    centre = np.append(np.log(TYPICAL.values), [term.start for term in terms])
    spread = np.append(PRIOR_SPREAD, [term.spread or np.inf for term in terms])
    return np.asarray(-0.5 * (((phi - centre) / spread) ** 2).sum(axis=-1))


def sample(
    series: Series,
    maxima: Sequence[Maximum],
    form: Form = "cthp",
    seed: int = 0,
    *,
    held: Held = (),
    stages: Sequence[int] = STAGES,
) -> tuple[Posterior, ...]:
    """Sample the posterior of each group.

    Args:
        series: the series of G groups.
        maxima: (G,) the maximum of each group.
        form: the form of the model.
        seed: the seed of the draws.
        held: terms of the form that keep their values.
        stages: number of draws in each stage.
    """
    criterion = Criterion(series, form, held)
    rng = np.random.default_rng(seed)
    means = (np.nanmean(series.measured[:, 1, series.members(g)]) for g in range(len(maxima)))
    speeds = [max(SLOWEST, float(mean)) for mean in means]
    least = criterion.lower[-1] if FOLLOWING[form].is_late else -np.inf
    proposals = [
        Proposal.at([_by_time_gap(part, speed) for part in parts], least)
        for parts, speed in zip(_first_parts(criterion, maxima), speeds, strict=True)
    ]
    fixed = criterion.lower == criterion.upper
    best: dict[int, Posterior] = {}
    wanted = list(range(len(maxima)))
    for stage, count in enumerate((*stages, *[stages[-1]] * FURTHER)):
        drawn = [proposals[g].draw(count, rng) for g in wanted]
        for w in drawn:
            w[:, fixed] = criterion.lower[fixed]  # a mean of equal values may round
        pairs = zip(wanted, drawn, strict=True)
        each = np.concatenate([_from_time_gap(form, w, speeds[g]) for g, w in pairs])
        places = np.repeat(np.array(wanted), count)
        prior, likelihood = _log_posterior(criterion, each, places)
        shape = len(wanted), count
        parts = each.reshape(*shape, -1), prior.reshape(shape), likelihood.reshape(shape)
        for g, w, z, priors, likelihoods in zip(wanted, drawn, *parts, strict=True):
            densities = proposals[g].log_densities(w)
            volume = w[:, 1] - z[:, 1]  # ln |dz/dw|
            ratios = likelihoods + priors + volume - np.logaddexp.reduce(densities, axis=0)
            weights = normalised(ratios)
            posterior = Posterior(z, natural(form, z)[:, :3], weights, likelihoods)
            proposals[g] = proposals[g].adapted(w, weights, densities)
            if stage < len(stages) or posterior.effective > best[g].effective:
                best[g] = posterior
        if stage >= len(stages) - 1:
            wanted = [g for g in wanted if best[g].effective < ENOUGH * count]
        if not wanted:
            break
    return tuple(best[g] for g in range(len(maxima)))


def _by_time_gap(maximum: Maximum, speed: MetresPerSecond) -> Maximum:
    """A maximum in the coordinates w of proposals."""
    if "s0" not in FOLLOWING[maximum.form].terms:
        return maximum
    (alpha, alpha_tau), w = np.exp(maximum.coordinates[:2]), maximum.coordinates.copy()
    w[1] = w[0] + np.log(max(alpha_tau / alpha + w[S0] / speed, LEAST_GAP))
    slope, ratio = np.eye(len(w)), float(np.exp(w[1]) / alpha_tau)
    slope[1, [0, 1, S0]] = 1.0 - ratio, ratio, -alpha / alpha_tau / speed
    bent = maximum.curvature
    if bent[1, 1]:  # else a bound holds ατ
        bent = slope.T @ bent @ slope
    return replace(maximum, coordinates=w, curvature=bent)


def _from_time_gap(form: Form, w: FloatArray, speed: MetresPerSecond) -> FloatArray:
    """(n, P) z of draws w (n, P); ln ατ lies below all bounds where s₀ is more than the gap."""
    if "s0" not in FOLLOWING[form].terms:
        return w
    z = w.copy()
    alpha_tau = np.exp(w[:, 1]) - np.exp(w[:, 0]) * w[:, S0] / speed
    z[:, 1] = np.log(np.maximum(alpha_tau, np.finfo(float).tiny))
    return z


def _first_parts(criterion: Criterion, maxima: Sequence[Maximum]) -> Sequence[Sequence[Maximum]]:
    """The maxima of the parts of each group's first proposal.

    A form with a curved posterior has one part for each of several values of its lag or delay.
    """
    is_free = criterion.lower[-1] < criterion.upper[-1]
    if not is_free or not FOLLOWING[criterion.form].is_late:
        return [[maximum] for maximum in maxima]
    rows = np.array([np.append(m.coordinates[:-1], lag) for lag in GRID for m in maxima])
    criterion.negligible = ROUGH
    parts = search(criterion, rows, np.arange(len(rows)) % len(maxima), is_last_held=True)
    return [parts[g :: len(maxima)] for g in range(len(maxima))]


def _log_posterior(
    criterion: Criterion, z: FloatArray, groups: Groups
) -> tuple[FloatArray, FloatArray]:
    """(n,) log prior and log likelihood of draws (n, P); both -inf where nothing is plausible."""
    inside = ((z >= criterion.lower - 1e-12) & (z <= criterion.upper + 1e-12)).all(axis=1)
    plausible = z[inside]
    parts = np.full((2, len(z)), -np.inf)
    parts[0, inside] = criterion.log_prior(plausible) + log_prior_of_theta(
        criterion.form, plausible
    )
    parts[1, inside] = criterion.log_likelihood(plausible, groups[inside])
    parts[:, ~np.isfinite(parts).all(axis=0)] = -np.inf
    return parts[0], parts[1]


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
    least: float = -np.inf
    """Least value of the last coordinate, at which what is below it is folded."""

    @classmethod
    def at(cls, maxima: Sequence[Maximum], least: float) -> "Proposal":
        """A mixture with a part at each maximum; several lie on the grid of the further unknown."""
        curvatures = np.array([maximum.curvature for maximum in maxima])
        if len(maxima) > 1:
            # An unknown that a bound holds in some parts varies in these as well.
            held = np.where(np.diagonal(curvatures, axis1=1, axis2=2) > 0, 0.0, 1.0)
            usual = np.diagonal(curvatures, axis1=1, axis2=2).max(axis=0)
            curvatures += np.einsum("kp,pq->kpq", held * usual, np.eye(len(usual)))
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
        return cls(parts, _floored(normalised(np.array(mass))), least)

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draws (count, P)."""
        numbers = rng.multinomial(count, self.shares)
        parts = zip(self.parts, numbers, strict=True)
        drawn = np.concatenate([part.draw(number, rng) for part, number in parts])
        below = drawn[:, -1] < self.least
        drawn[below, -1] = 2.0 * self.least - drawn[below, -1]
        return drawn

    def log_densities(self, drawn: FloatArray) -> FloatArray:
        """(K, n) log density of each part at (n, P), times its share."""
        logs = np.array([part.log_density(drawn) for part in self.parts])
        if np.isfinite(self.least):
            folded = drawn.copy()
            folded[:, -1] = 2.0 * self.least - folded[:, -1]
            logs = np.logaddexp(logs, [part.log_density(folded) for part in self.parts])
        return np.asarray(np.log(self.shares)[:, None] + logs)

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
        return Proposal(tuple(parts), _floored(belongs.sum(axis=1)), self.least)


def _floored(shares: FloatArray) -> FloatArray:
    """Shares of which none vanishes, because a part may have had too few draws so far."""
    floored = shares + LEAST_SHARE
    return np.asarray(floored / floored.sum())


def normalised(log: FloatArray) -> FloatArray:
    """Weights (n,) that sum to one, from their logarithms up to a constant."""
    if not np.isfinite(log.max()):  # nothing plausible was proposed
        return np.asarray(np.full(len(log), 1.0 / len(log)))
    weights = np.exp(log - log.max())
    return np.asarray(weights / weights.sum())
