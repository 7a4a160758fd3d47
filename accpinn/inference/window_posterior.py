"""What one window alone says of its vehicles under a model, as draws of equal weight.

They are drawn from the posterior of the exact likelihood (see `inference.posterior`), which a CTHP
has, or from the normal approximation of `methods.simulation`, for any model.

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
from accpinn.inference.posterior import (
    AT_SPEED,
    LEAST_GAP,
    features,
    log_prior_of_features,
    sample,
)
from accpinn.methods import PosteriorKind, Segments, one_thread, simulation
from accpinn.methods.joint_likelihood import joint_maxima
from accpinn.methods.likelihood import Maximum
from accpinn.methods.series import determined_followers, series_of
from accpinn.methods.state_space import LEAST
from accpinn.model.cthp import TERMS, Case, Parameters
from accpinn.model.registry import FOLLOWING
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
def window_posterior(
    segment: Segment, case: Case, spec: ModelSpec, kind: PosteriorKind = "likelihood"
) -> WindowPosterior:
    """The posterior of each follower of one window."""
    return joint_posterior((segment,), case, spec, kind)


def joint_posterior(
    segments: Segments, case: Case, spec: ModelSpec, kind: PosteriorKind = "likelihood"
) -> WindowPosterior:
    """The same from some windows at once."""
    model, followers = spec.model, segments[0].followers
    count, speeds = count_of(model), median_speeds(segments)
    size = 6 if spec.following.is_cthp else 6 + count
    estimates = np.full((followers, size), np.nan)
    drawn, likely = np.full((2, followers, DRAWS, count), np.nan)
    log_likelihood = np.full((followers, DRAWS), np.nan)
    if kind == "likelihood":
        for row, maximum, posterior in sampled(segments, case, spec):
            estimates[row] = maximum.complete
            even = posterior.evenly(DRAWS)
            drawn[row], log_likelihood[row] = features(model, even.coordinates), even.log_likelihood
            told = posterior.under(of_others(spec, posterior.coordinates))
            likely[row] = features(model, told.evenly(DRAWS).coordinates)
    else:
        for row, best in simulation.estimates(segments, case, spec):
            estimates[row] = spec.following.linearisations(
                best.theta[:, None], speeds[row]
            ).everything
            coordinates = _in_coordinates(spec, best.draws(DRAWS))
            chosen = _beside_others(best, spec)
            for k in row:
                drawn[k] = possible(model, coordinates, speeds[k])
                likely[k] = possible(model, chosen, speeds[k])
    return WindowPosterior(estimates, drawn, likely, log_likelihood, model, speeds)


@lru_cache(maxsize=64)
def sampled(
    segments: Segments, case: Case, spec: ModelSpec
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


def _in_coordinates(spec: ModelSpec, scores: FloatArray) -> FloatArray:
    """(n, p) φ of parameters given in standard deviations of their priors, z (n, p)."""
    if not spec.following.is_cthp:
        return scores
    theta = spec.following.values_at(scores)
    sets = Parameters(*theta[:3], *(spec.following.term(theta, term) for term in TERMS))
    gap = np.maximum(sets.time_gap(AT_SPEED), LEAST_GAP)
    shape = np.log([sets.alpha, sets.beta, gap])
    return np.column_stack([*shape, *(getattr(sets, term) for term in spec.following.terms)])


def _log_volume(spec: ModelSpec, scores: FloatArray) -> FloatArray:
    """(n,) ln |dz/dφ| at scores z (n, p), up to a constant; zero where φ is z."""
    if not spec.following.is_cthp:
        return np.zeros(len(scores))
    theta = spec.following.values_at(scores)
    intercept = spec.following.term(theta, "s0")
    volume = np.log(np.maximum(theta[2] + intercept / AT_SPEED, LEAST_GAP) / theta[2])
    if spec.following.is_late:
        volume = volume - np.log(theta[-1])
    return np.asarray(volume)


def _beside_others(best: simulation.Optimum, spec: ModelSpec) -> FloatArray:
    """(n, p) draws of φ of equal weight of an optimum with what other cars say as the prior.

    They are chosen among proposals from the optimum's normal distribution, and where φ is z from
    about its product with that of other cars.
    """
    model, free = spec.model, free_of(spec)
    square = np.ix_(free, free)
    variances, vectors = np.linalg.eigh(best.covariance[square])
    own = vectors / np.minimum(variances, 1.0) @ vectors.T  # no wider than the prior
    parts = [Student(best.scores, best.covariance)]
    if not spec.following.is_cthp:
        population = population_of(model, count_of(model)).of(free)
        others = np.linalg.inv(population.cars + population.windows)
        scale = np.linalg.inv(own - np.eye(len(own)) + others)
        centre = scale @ (own @ best.scores[free] + others @ population.centre)
        parts.append(Student(best.scores.copy(), np.zeros_like(best.covariance)))
        parts[1].centre[free], parts[1].scale[square] = centre, scale
    proposal = Proposal(tuple(parts), np.full(len(parts), 1 / len(parts)))
    lower, upper = simulation.bounds_of(FOLLOWING[model])
    sampling, rng = Sampling(proposal, count_of(model)), np.random.default_rng(0)
    for count in PROPOSED:
        z = sampling.proposal.draw(count, rng)
        z[:, ~free] = best.scores[~free]  # a mean of equal values may round
        away, none = (z - best.scores)[:, free], np.zeros(count)
        phi = _in_coordinates(spec, z)
        # The optimum's prior, normal in z, gives way to that of other cars, a density over φ.
        log = log_prior_of_likely(spec, phi) - _log_volume(spec, z) + 0.5 * (z**2).sum(axis=1)
        log -= 0.5 * np.einsum("ni,ij,nj->n", away, own, away)
        log[((z < lower) | (z > upper)).any(axis=1)] = -np.inf
        sampling.add(z, z, log, none, none)
    return _in_coordinates(spec, sampling.posterior.evenly(DRAWS).coordinates)


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
    if FOLLOWING[model].is_cthp:
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
    if not FOLLOWING[model].is_cthp:
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


def values_of(spec: ModelSpec, phi: FloatArray) -> FloatArray:
    """(.., p) the parameters at coordinates (.., p), in the order of their names."""
    if not spec.following.is_cthp:
        return np.asarray(np.moveaxis(spec.following.values_at(phi), 0, -1))
    sets = parameters_of(spec.model, phi, AT_SPEED)
    return np.stack([getattr(sets, name) for name in spec.following.names], axis=-1)


def coordinates_of(spec: ModelSpec, values: FloatArray) -> FloatArray:
    """(p,) the coordinates of parameters (p,); gains of zero count as the least of a search."""
    if not spec.following.is_cthp:
        kinds = spec.following.parameters
        return np.array([kind.score(value) for kind, value in zip(kinds, values, strict=True)])
    alpha, beta, tau, *terms = values
    intercept = terms[0] if "s0" in spec.following.terms else 0.0
    gap = max(tau + intercept / AT_SPEED, LEAST_GAP)
    return np.array([*np.log([max(alpha, LEAST), max(beta, LEAST), gap]), *terms])


def possible(model: str, phi: FloatArray, speed: float) -> FloatArray:
    """Draws (n, p) of equal weight that have an equilibrium at a speed; others in place of those.

    A vehicle kept that speed, so it had one. Where none has, all draws are returned.
    """
    if FOLLOWING[model].is_cthp or not np.isfinite(phi).all():
        return phi
    gaps = FOLLOWING[model].equilibrium_gaps(FOLLOWING[model].values_at(phi), speed)
    kept = np.flatnonzero(np.isfinite(gaps))
    if not len(kept):
        return phi
    chosen = np.arange(len(phi))
    lost = ~np.isfinite(gaps)
    chosen[lost] = np.resize(kept, lost.sum())
    return np.asarray(phi[chosen])
