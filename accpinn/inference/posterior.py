"""The posterior distribution of the parameters, given the exact likelihood, by weighted draws.

    p(z | recording) ∝ L(z) p(z),   z = ln of all unknowns (see `methods.maximum_likelihood`)

is sampled by importance sampling: proposals from a multivariate Student's t, weighted by posterior
over proposal. The first proposal has the curvature at the maximum; each further one has the
weighted mean and covariance of the draws before it. What a bound holds at the maximum stays there,
α, ατ, β and a further unknown excepted.

With a lag or a delay the posterior is a curved ridge, and may have two modes. There the proposal is
a mixture: one part where the criterion is largest for each of several values of the lag, as wide
along it as these values are apart; each part adapts to the draws that it stands for.

The prior of α, β and τ is wide: normal in their logarithms, so that 95 % of α lie within a factor
of fifty of 0.08 1/s², of β within one of twenty of 0.2 1/s, and of τ within one of three of 1.4 s.
It matters only where a recording says little, and keeps intervals finite there.

Source: Cappé, Douc, Guillin, Marin and Robert, Statistics and Computing 18 (2008) 447-459.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from accpinn.inference.proposal import Proposal, normalised
from accpinn.methods.likelihood import Criterion, Groups, Maximum, natural, search
from accpinn.methods.series import Series
from accpinn.methods.state_space import EXTRA, Form
from accpinn.model.cthp import TYPICAL
from accpinn.units import FloatArray

PRIOR_SPREAD = (2.0, 1.5, 0.6)
"""Deviations of ln α, ln β, ln τ."""
STAGES = (200, 200, 1000)
"""Proposals of each stage; the last one's are kept."""
FURTHER = 3
"""Stages as large as the last that are added at most, for groups with few effective draws."""
ENOUGH = 0.2
"""Effective draws per proposal at which no further stage is needed."""
CURVED: tuple[Form, ...] = ("lag", "delay")
GRID = (0.1, 0.4, 0.8, 1.2, 1.8)
"""Lags or delays in s at which the first proposal has its parts."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted draws of one group's unknowns."""

    coordinates: FloatArray
    """(n, P) z."""
    theta: FloatArray
    """(n, 3) α, ατ, β, all above zero."""
    weights: FloatArray
    """(n,) sum to one."""
    log_evidence: float
    """ln of the integral of likelihood times prior, up to a constant that all forms share."""

    @property
    def effective(self) -> float:
        """How many independent draws these are worth."""
        return float(1.0 / (self.weights**2).sum())

    def evenly(self, count: int) -> FloatArray:
        """(count, 3) draws of θ of equal weight, in no particular order of time."""
        return np.asarray(self.theta[self._even(count)])

    def all_evenly(self, count: int) -> FloatArray:
        """(count, P) draws of z of equal weight, in the order of `evenly`."""
        return np.asarray(self.coordinates[self._even(count)])

    def _even(self, count: int) -> Groups:
        """(count,) which draws are taken, each as often as its weight says."""
        edges = np.cumsum(self.weights)
        at = (np.arange(count) + 0.5) / count * edges[-1]
        return np.asarray(np.searchsorted(edges, at))


def log_prior_of_theta(z: FloatArray) -> FloatArray:
    """(..) of coordinates (.., P): that of ln α, ln β and ln τ, up to a constant."""
    logs = np.stack([z[..., 0], z[..., 2], z[..., 1] - z[..., 0]], axis=-1)
    away = (logs - np.log(TYPICAL.values)) / PRIOR_SPREAD
    return np.asarray(-0.5 * (away**2).sum(axis=-1))


def sample(
    series: Series,
    maxima: Sequence[Maximum],
    form: Form = "cthp",
    seed: int = 0,
) -> tuple[Posterior, ...]:
    """The posterior of each group.

    Args:
        series: G groups.
        maxima: (G,) where the search for each of them ended.
        form: of the model.
        seed: of the proposals.
    """
    return sample_from(Criterion(series, form), maxima, seed)


def sample_from(
    criterion: Criterion,
    maxima: Sequence[Maximum],
    seed: int = 0,
    stages: Sequence[int] = (),
) -> tuple[Posterior, ...]:
    """The same for another criterion of the same unknowns, such as the evidence of a network.

    Args:
        criterion: of G groups.
        maxima: (G,) where the search for each of them ended.
        seed: of the proposals.
        stages: how many proposals each stage has; by default `STAGES`.
    """
    stages = stages or STAGES
    form, rng = criterion.form, np.random.default_rng(seed)
    proposals = [Proposal.at(one) for one in _first_parts(criterion, maxima)]
    best: dict[int, Posterior] = {}
    wanted = list(range(len(maxima)))
    for stage, count in enumerate((*stages, *[stages[-1]] * FURTHER)):
        drawn = [proposals[g].draw(count, rng) for g in wanted]
        log = _log_posterior(criterion, np.concatenate(drawn), np.repeat(np.array(wanted), count))
        for g, z, rows in zip(wanted, drawn, log.reshape(-1, count), strict=True):
            densities = proposals[g].log_densities(z)
            ratios = rows - np.logaddexp.reduce(densities, axis=0)
            weights = normalised(ratios)
            evidence = float(np.logaddexp.reduce(ratios) - np.log(count)) - _log_mass(form)
            found = Posterior(z, natural(form, z)[:, :3], weights, evidence)
            proposals[g] = proposals[g].adapted(z, weights, densities)
            if stage < len(stages) or found.effective > best[g].effective:
                best[g] = found
        if stage >= len(stages) - 1:
            wanted = [g for g in wanted if best[g].effective < ENOUGH * count]
        if not wanted:
            break
    return tuple(best[g] for g in range(len(maxima)))


def _log_mass(form: Form) -> float:
    """Ln of the integral of the prior of a form's further unknown, as `Criterion` has it."""
    if form not in EXTRA:
        return 0.0
    extra = EXTRA[form]
    assert extra.spread is not None
    lower, upper = ((end - extra.centre) / extra.spread for end in extra.bounds)
    return float(np.log(extra.spread * np.sqrt(2 * np.pi) * (ndtr(upper) - ndtr(lower))))


def _first_parts(criterion: Criterion, maxima: Sequence[Maximum]) -> Sequence[Sequence[Maximum]]:
    """Where the first proposal of each group has its parts.

    With a lag or a delay the posterior is curved, and may have two modes; there is one for each of
    several values of it.
    """
    if criterion.form not in CURVED:
        return [[one] for one in maxima]
    rows = np.array([np.append(one.coordinates[:-1], lag) for lag in GRID for one in maxima])
    found = search(criterion, rows, np.arange(len(rows)) % len(maxima), is_last_held=True)
    return [found[g :: len(maxima)] for g in range(len(maxima))]


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
