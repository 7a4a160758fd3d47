"""The posterior of one window's vehicles under a model, as draws of equal weight.

They are drawn from the posterior of the exact likelihood (see `inference.posterior`), which a CTHP
has, or from the normal approximation of `methods.simulation`, for any model.

Where a window contradicts what is known of other cars, few draws of its own posterior are probable
under that. So those that an answer is made from, `likely`, have as their prior not the wide one
but what a window of any car has (`log_of_window` in `inference.population`), and sampling goes on
until enough draws count under both.

They stand in the coordinates φ of `inference.coordinates`. What follows from a model that is no
CTHP is that of its linearisation at the vehicle's median speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np

from accpinn.inference.coordinates import (
    coordinates_of,
    free_of,
    log_prior_of_likely,
    of_others,
    time_gap_coordinates,
)
from accpinn.inference.importance_sampling import Posterior, Proposal, Sampling, Student
from accpinn.inference.posterior import sample
from accpinn.methods import PosteriorKind, Segments, one_thread, simulation
from accpinn.methods.joint_likelihood import joint_maxima
from accpinn.methods.likelihood import Maximum
from accpinn.methods.series import determined_followers, series_of
from accpinn.model.cthp import Case
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment, median_speeds
from accpinn.stability.criteria import exact_margin, l2_margin
from accpinn.units import FloatArray

DRAWS = 400
"""Draws of equal weight that stand for a window's posterior."""
PROPOSED = (400,) * 5
"""Draws in each stage of which these are chosen, where the posterior is a normal approximation."""
STABILITY_DRAWS = 200
"""Draws of these that probabilities of string stability are taken from."""


@dataclass(frozen=True, eq=False)
class WindowPosterior:
    """The posterior of M followers from one window; nan for one that it does not determine."""

    estimates: FloatArray
    """(M, 6 + n) parameters of greatest likelihood, as `Parameters.everything`."""
    drawn: FloatArray
    """(M, n, p) draws of φ of equal weight from the posterior."""
    likely: FloatArray
    """(M, n, p) draws of φ with other cars' population as prior; see `log_prior_of_likely`."""
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
        some = coordinates_of(self.model).parameters(drawn, self.speeds[:, None])
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
    """The posterior of several windows at once, which share their parameters."""
    space, followers = coordinates_of(spec.model), segments[0].followers
    speeds = median_speeds(segments)
    estimates = np.full((followers, 6 + spec.following.nonlinear_count), np.nan)
    drawn, likely = np.full((2, followers, DRAWS, space.count), np.nan)
    log_likelihood = np.full((followers, DRAWS), np.nan)
    if kind == "likelihood":
        of_unknowns = time_gap_coordinates(spec.model).of_unknowns
        for row, maximum, posterior in sampled(segments, case, spec):
            estimates[row] = maximum.complete
            even = posterior.evenly(DRAWS)
            drawn[row], log_likelihood[row] = of_unknowns(even.coordinates), even.log_likelihood
            pooled = posterior.under(of_others(spec, posterior.coordinates))
            likely[row] = of_unknowns(pooled.evenly(DRAWS).coordinates)
    else:
        for row, best in simulation.estimates(segments, case, spec):
            estimates[row] = spec.following.linearisations(
                best.theta[:, None], speeds[row]
            ).everything
            draws, chosen = space.of_scores(best.draws(DRAWS)), _beside_others(best, spec)
            for k in row:
                drawn[k] = space.possible(draws, speeds[k])
                likely[k] = space.possible(chosen, speeds[k])
    return WindowPosterior(estimates, drawn, likely, log_likelihood, spec.model, speeds)


def sampled(
    segments: Segments, case: Case, spec: ModelSpec
) -> Sequence[tuple[list[int], Maximum, Posterior]]:
    """The determined followers, each or in Case I all, with their maximum and posterior.

    An answer from one window and the intervals of a fit to it have the same draws.
    """
    determined = determined_followers(segments, case)
    if not determined:
        return ()
    maxima = joint_maxima(segments, case, spec, determined)
    rows = [list(determined)] if case == "I" else [[k] for k in determined]
    series = series_of(segments, case, determined)
    seeds = [segments[0].vehicles[k[0] + 1] for k in rows]
    posteriors = sample(series, maxima, spec, seeds, partial(of_others, spec))
    return tuple(zip(rows, maxima, posteriors, strict=True))


def _beside_others(best: simulation.Optimum, spec: ModelSpec) -> FloatArray:
    """(n, p) draws of φ of equal weight of an optimum with what other cars say as the prior.

    They are chosen among proposals from the optimum's normal distribution and, where what other
    cars say is normal in z, too, from about the product of both.
    """
    space, free = coordinates_of(spec.model), free_of(spec)
    square = np.ix_(free, free)
    variances, vectors = np.linalg.eigh(best.covariance[square])
    information = vectors / np.minimum(variances, 1.0) @ vectors.T  # no wider than the prior
    parts = [Student(best.scores, best.covariance)]
    if not spec.following.is_linear:
        population = space.population.of(free)
        others = np.linalg.inv(population.cars + population.windows)
        scale = np.linalg.inv(information - np.eye(len(information)) + others)
        centre = scale @ (information @ best.scores[free] + others @ population.centre)
        parts.append(Student(best.scores.copy(), np.zeros_like(best.covariance)))
        parts[1].centre[free], parts[1].scale[square] = centre, scale
    proposal = Proposal(tuple(parts), np.full(len(parts), 1 / len(parts)))
    lower, upper = simulation.bounds_of(spec.following)
    sampling, rng = Sampling(proposal, space.count), np.random.default_rng(0)
    for count in PROPOSED:
        z = sampling.proposal.draw(count, rng)
        z[:, ~free] = best.scores[~free]  # a mean of equal values may round
        away, none = (z - best.scores)[:, free], np.zeros(count)
        phi = space.of_scores(z)
        # The optimum's prior, normal in z, gives way to that of other cars, a density over φ.
        log = log_prior_of_likely(spec, phi) - space.log_volume(z) + 0.5 * (z**2).sum(axis=1)
        log -= 0.5 * np.einsum("ni,ij,nj->n", away, information, away)
        log[((z < lower) | (z > upper)).any(axis=1)] = -np.inf
        sampling.add(z, z, log, none, none)
    return space.of_scores(sampling.posterior.evenly(DRAWS).coordinates)
