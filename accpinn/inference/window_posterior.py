"""What one window alone says of its vehicles under a model, as draws of equal weight.

Of a CTHP they are drawn from the posterior of the exact likelihood (see `inference.posterior`), of
any other model from the normal approximation of `methods.simulation`.

Where a window contradicts what is known of other cars, few draws of its own posterior are probable
under that. So those that an answer is made from, `likely`, have as their prior not the wide one
but what a window of any car has (`log_of_window` in `inference.population`), and sampling goes on
until enough draws count under both.

They stand in coordinates φ, in which windows of a car, and cars, are compared. Of a CTHP these are
ln α, ln β, ln of the time gap at 100 km/h and its further terms (see `features` in
`inference.posterior`). Of any other model they are its parameters in standard deviations of their
priors, z of `model.following`; what follows from such a model is that of its linearisation at the
vehicle's median speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np

from accpinn.inference.importance_sampling import Posterior, Proposal, Sampling, Student
from accpinn.inference.population import log_of_window, population_of
from accpinn.inference.posterior import AT_SPEED, features, log_prior_of_features, sample
from accpinn.methods import one_thread, simulation
from accpinn.methods.likelihood import Maximum
from accpinn.methods.maximum_likelihood import joint_maxima
from accpinn.methods.series import determined_followers, series_of
from accpinn.model.cthp import TERMS, Case, Parameters
from accpinn.model.registry import CTHPS, FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment, median_speeds
from accpinn.stability.criteria import exact_margin, l2_margin
from accpinn.units import FloatArray, Mask

DRAWS = 400
"""Draws of equal weight that stand for a window's posterior."""
PROPOSED = (400,) * 5
"""Draws in each stage of which these are chosen, where the posterior is a normal approximation."""
STABILITY_DRAWS = 200
"""Draws of these that probabilities of string stability are taken from."""


@dataclass(frozen=True, eq=False)
class WindowPosterior:
    """What one window alone says of its M followers; nan for one that it does not determine."""

    estimates: FloatArray
    """(M, 6 + n) parameters of greatest likelihood, as `Parameters.everything`."""
    drawn: FloatArray
    """(M, n, p) draws of φ of equal weight from the posterior."""
    likely: FloatArray
    """(M, n, p) the same with what other cars say as the prior; see `log_prior_of_likely`."""
    log_likelihood: FloatArray
    """(M, n) of the window's data at each draw, shared by all followers in Case I; nan for a model
    that is no CTHP."""
    model: str
    speeds: FloatArray
    """(M,) median speeds in m/s."""

    @cached_property
    def stable(self) -> tuple[FloatArray, FloatArray]:
        """(M,) the probabilities of L₂ and of L∞ string stability."""
        drawn = self.drawn[:, :: DRAWS // STABILITY_DRAWS]
        some = parameters_of(self.model, drawn, self.speeds[:, None])
        unknown = np.isnan(self.estimates[:, 0])
        l2, linf = ((margin(some) >= 0).mean(axis=1) for margin in (l2_margin, exact_margin))
        return np.where(unknown, np.nan, l2), np.where(unknown, np.nan, linf)


@lru_cache(maxsize=256)
@one_thread
def window_posterior(segment: Segment, case: Case, spec: ModelSpec) -> WindowPosterior:
    """The posterior of each follower of one window."""
    return joint_posterior((segment,), case, spec)


def joint_posterior(
    segments: tuple[Segment, ...], case: Case, spec: ModelSpec, draws: int = DRAWS
) -> WindowPosterior:
    """The same from some windows at once; of a model that is no CTHP always `DRAWS` draws."""
    model, followers = spec.model, segments[0].followers
    count, speeds = count_of(model), median_speeds(segments)
    size, draws = (6, draws) if model in CTHPS else (6 + count, DRAWS)
    estimates = np.full((followers, size), np.nan)
    drawn, likely = np.full((2, followers, draws, count), np.nan)
    log_likelihood = np.full((followers, draws), np.nan)
    if model in CTHPS:
        for row, maximum, posterior in sampled(segments, case, spec):
            estimates[row] = maximum.complete
            even = posterior.evenly(draws)
            drawn[row], log_likelihood[row] = features(model, even.coordinates), even.log_likelihood
            told = posterior.under(of_others(spec, posterior.coordinates))
            likely[row] = features(model, told.evenly(draws).coordinates)
    else:
        for row, estimate in simulation.estimates(segments, case, spec):
            estimates[row] = parameters_of(model, estimate.scores, speeds[row]).everything
            chosen = _beside_others(estimate, spec)
            for k in row:
                drawn[k] = possible(model, estimate.draws(draws), speeds[k])
                likely[k] = possible(model, chosen, speeds[k])
    return WindowPosterior(estimates, drawn, likely, log_likelihood, model, speeds)


@lru_cache(maxsize=64)
def sampled(
    segments: tuple[Segment, ...], case: Case, spec: ModelSpec
) -> Sequence[tuple[list[int], Maximum, Posterior]]:
    """The determined followers, each or in Case I all, with their maximum and posterior.

    An answer from one window and the intervals of a fit to it have the same draws.
    """
    known = determined_followers(segments, case)
    if not known:
        return ()
    maxima = joint_maxima(segments, case, spec, known)
    rows = [list(known)] if case == "I" else [[k] for k in known]
    series, seeds = series_of(segments, case, known), [segments[0].vehicles[k[0] + 1] for k in rows]
    posteriors = sample(series, maxima, spec, seeds, partial(of_others, spec))
    return tuple(zip(rows, maxima, posteriors, strict=True))


def _beside_others(estimate: simulation.Estimate, spec: ModelSpec) -> FloatArray:
    """Draws (n, p) of equal weight of an estimate with what other cars say as the prior.

    They are chosen among proposals from the estimate's normal distribution, and from about its
    product with that of other cars.
    """
    model, free = spec.model, free_of(spec)
    population, square = population_of(model, count_of(model)).of(free), np.ix_(free, free)
    variances, vectors = np.linalg.eigh(estimate.covariance[square])
    own = vectors / np.minimum(variances, 1.0) @ vectors.T  # no wider than the prior
    others = np.linalg.inv(population.cars + population.windows)
    scale = np.linalg.inv(own - np.eye(len(own)) + others)
    centre = scale @ (own @ estimate.scores[free] + others @ population.centre)
    parts = [Student(estimate.scores, estimate.covariance)]
    parts.append(Student(estimate.scores.copy(), np.zeros_like(estimate.covariance)))
    parts[1].centre[free], parts[1].scale[square] = centre, scale
    proposal = Proposal(tuple(parts), np.full(2, 0.5))
    lower, upper = simulation.bounds_of(FOLLOWING[model])
    sampling, rng = Sampling(proposal, count_of(model)), np.random.default_rng(0)
    for count in PROPOSED:
        phi = sampling.proposal.draw(count, rng)
        phi[:, ~free] = estimate.scores[~free]  # a mean of equal values may round
        away, none = (phi - estimate.scores)[:, free], np.zeros(count)
        log = log_prior_of_likely(spec, phi) - log_prior(model, phi)
        log -= 0.5 * np.einsum("ni,ij,nj->n", away, own, away)
        log[((phi < lower) | (phi > upper)).any(axis=1)] = -np.inf
        sampling.add(phi, phi, log, none, none)
    return sampling.posterior.evenly(DRAWS).coordinates


def of_others(spec: ModelSpec, z: FloatArray) -> FloatArray:
    """(n,) log of what other cars say of coordinates z (n, P), over the prior of a posterior."""
    phi = features(spec.model, z)
    return log_prior_of_likely(spec, phi) - log_prior(spec.model, phi)


def count_of(model: str) -> int:
    """p, the number of coordinates."""
    return len(FOLLOWING[model].parameters)


def free_of(spec: ModelSpec) -> Mask:
    """(p,) whether a coordinate is free: not one of a term that keeps its value."""
    fixed = [name for name, _ in spec.fixed]
    return np.array([name not in fixed for name in FOLLOWING[spec.model].names])


def log_prior(model: str, phi: FloatArray) -> FloatArray:
    """(..) log density of the prior of a window's own posterior at (.., p), up to a constant."""
    if model in CTHPS:
        return log_prior_of_features(model, phi)
    return np.asarray(-0.5 * (phi**2).sum(axis=-1))


def log_prior_of_likely(spec: ModelSpec, phi: FloatArray) -> FloatArray:
    """(..) log density of the prior of `WindowPosterior.likely` at (.., p), up to a constant."""
    free = free_of(spec)
    return log_of_window(population_of(spec.model, count_of(spec.model)).of(free), phi[..., free])


def parameters_of(model: str, phi: FloatArray, speed: FloatArray | float) -> Parameters:
    """(..) parameters from a model's coordinates (.., p).

    The speed (..) in m/s is that of the linearisation; a CTHP is the same at every speed.
    """
    if model not in CTHPS:
        return FOLLOWING[model].linearisations(FOLLOWING[model].values_at(phi), speed)
    complete = np.zeros((*phi.shape[:-1], 6))
    complete[..., 0], complete[..., 1] = np.exp(phi[..., 0]), np.exp(phi[..., 1])
    for at, term in enumerate(FOLLOWING[model].terms, 3):
        least = -np.inf if term == "s0" else 0.0
        complete[..., 3 + TERMS.index(term)] = np.maximum(phi[..., at], least)
    # The data determine the time gap, so where s₀ is more than all of it, it is s₀ that gives way.
    gap = np.exp(phi[..., 2])
    complete[..., 3] = np.minimum(complete[..., 3], gap * AT_SPEED)
    complete[..., 2] = np.maximum(gap - complete[..., 3] / AT_SPEED, 0.0)
    return Parameters.of(complete)


def possible(model: str, phi: FloatArray, speed: float) -> FloatArray:
    """Draws (n, p) of equal weight that have an equilibrium at a speed; others in place of those.

    A vehicle kept that speed, so it had one. Where none has, all draws are returned.
    """
    if model in CTHPS or not np.isfinite(phi).all():
        return phi
    gaps = FOLLOWING[model].equilibrium_gaps(FOLLOWING[model].values_at(phi), speed)
    kept = np.flatnonzero(np.isfinite(gaps))
    if not len(kept):
        return phi
    chosen = np.arange(len(phi))
    lost = ~np.isfinite(gaps)
    chosen[lost] = np.resize(kept, lost.sum())
    return np.asarray(phi[chosen])
