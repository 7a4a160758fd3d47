"""The posterior distribution of the parameters, given the exact likelihood, as weighted draws.

    p(z | recording) ∝ L(z) p(z),   z = ln of all unknowns (see `methods.maximum_likelihood`)

is sampled by importance sampling: proposals from a multivariate Student's t, weighted by posterior
over proposal. The first proposal has the curvature at the maximum; each further one has the
weighted mean and covariance of the draws before it. An unknown that a bound holds at the maximum
stays there, except α, ατ, β and the further unknown of a form.

With a lag or a delay the posterior is a curved ridge and may have two modes. The proposal is then a
mixture with one part for each of several values of the lag. Each part lies at the maximum of the
criterion for its value, is as wide as these values are apart, and adapts to the draws near it.

The prior of α, β and τ is wide: normal in their logarithms, so that 95 % of α lie within a factor
of fifty of 0.08 1/s², of β within one of twenty of 0.2 1/s, and of τ within one of three of 1.4 s.
It matters only where a recording contains little information, and keeps intervals finite there.

Source: Cappé, Douc, Guillin, Marin and Robert, Statistics and Computing 18 (2008) 447-459.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from accpinn.inference.proposal import Proposal, normalised
from accpinn.methods.likelihood import Criterion, Groups, Maximum, natural, search
from accpinn.methods.series import Series
from accpinn.methods.state_space import Form
from accpinn.model.cthp import TYPICAL
from accpinn.units import FloatArray

PRIOR_SPREAD = (2.0, 1.5, 0.6)
"""Standard deviations of ln α, ln β and ln τ."""
STAGES = (200, 200, 1000)
"""Number of draws in each stage; those of the last are kept."""
FURTHER = 3
"""Largest number of further stages, for groups with few effective draws."""
ENOUGH = 0.2
"""Effective draws per draw above which no further stage is needed."""
CURVED: tuple[Form, ...] = ("lag", "delay")
"""Forms whose posterior is a curved ridge."""
GRID = (0.1, 0.4, 0.8, 1.2, 1.8)
"""Lags or delays in s of the parts of the first proposal."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted draws of the unknowns of one group."""

    coordinates: FloatArray
    """(n, P) draws of z."""
    theta: FloatArray
    """(n, 3) draws of α, ατ, β, all above zero."""
    weights: FloatArray
    """(n,) weights, which sum to one."""

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

    def _even(self, count: int) -> Groups:
        """(count,) indices of draws, each as often as its weight demands."""
        edges = np.cumsum(self.weights)
        at = (np.arange(count) + 0.5) / count * edges[-1]
        return np.asarray(np.searchsorted(edges, at))


def log_prior_of_theta(z: FloatArray) -> FloatArray:
    """(..) log prior of ln α, ln β and ln τ at coordinates (.., P), up to a constant."""
    logs = np.stack([z[..., 0], z[..., 2], z[..., 1] - z[..., 0]], axis=-1)
    away = (logs - np.log(TYPICAL.values)) / PRIOR_SPREAD
    return np.asarray(-0.5 * (away**2).sum(axis=-1))


def sample(
    series: Series,
    maxima: Sequence[Maximum],
    form: Form = "cthp",
    seed: int = 0,
) -> tuple[Posterior, ...]:
    """Sample the posterior of each group.

    Args:
        series: the series of G groups.
        maxima: (G,) the maximum of each group.
        form: the form of the model.
        seed: the seed of the draws.
    """
    return sample_from(Criterion(series, form), maxima, seed)


def sample_from(
    criterion: Criterion,
    maxima: Sequence[Maximum],
    seed: int = 0,
    stages: Sequence[int] = (),
) -> tuple[Posterior, ...]:
    """Sample from another criterion of the same unknowns, such as the evidence of a network.

    Args:
        criterion: the criterion of G groups.
        maxima: (G,) the maximum of each group.
        seed: the seed of the draws.
        stages: the number of draws in each stage; by default `STAGES`.
    """
    stages = stages or STAGES
    rng = np.random.default_rng(seed)
    proposals = [Proposal.at(parts) for parts in _first_parts(criterion, maxima)]
    best: dict[int, Posterior] = {}
    wanted = list(range(len(maxima)))
    for stage, count in enumerate((*stages, *[stages[-1]] * FURTHER)):
        drawn = [proposals[g].draw(count, rng) for g in wanted]
        log = _log_posterior(criterion, np.concatenate(drawn), np.repeat(np.array(wanted), count))
        for g, z, rows in zip(wanted, drawn, log.reshape(-1, count), strict=True):
            densities = proposals[g].log_densities(z)
            ratios = rows - np.logaddexp.reduce(densities, axis=0)
            weights = normalised(ratios)
            posterior = Posterior(z, natural(criterion.form, z)[:, :3], weights)
            proposals[g] = proposals[g].adapted(z, weights, densities)
            if stage < len(stages) or posterior.effective > best[g].effective:
                best[g] = posterior
        if stage >= len(stages) - 1:
            wanted = [g for g in wanted if best[g].effective < ENOUGH * count]
        if not wanted:
            break
    return tuple(best[g] for g in range(len(maxima)))


def _first_parts(criterion: Criterion, maxima: Sequence[Maximum]) -> Sequence[Sequence[Maximum]]:
    """The maxima of the parts of each group's first proposal.

    A form with a curved posterior has one part for each of several values of its lag or delay.
    """
    if criterion.form not in CURVED:
        return [[maximum] for maximum in maxima]
    rows = np.array([np.append(m.coordinates[:-1], lag) for lag in GRID for m in maxima])
    parts = search(criterion, rows, np.arange(len(rows)) % len(maxima), is_last_held=True)
    return [parts[g :: len(maxima)] for g in range(len(maxima))]


def _log_posterior(criterion: Criterion, z: FloatArray, groups: Groups) -> FloatArray:
    inside = ((z >= criterion.lower - 1e-12) & (z <= criterion.upper + 1e-12)).all(axis=1)
    log = np.full(len(z), -np.inf)
    plausible = z[inside]
    log[inside] = (
        criterion.log_likelihood(plausible, groups[inside])
        + criterion.log_prior(plausible)
        + log_prior_of_theta(plausible)
    )
    return np.where(np.isfinite(log), log, -np.inf)
