"""The coordinates φ in which windows of a car, and cars, are compared, of every model.

Of a CTHP these are ln α, ln β, ln of the time gap at 100 km/h and its further terms: data determine
the time gap τ + s₀/v well and its two parts hardly, so it stands in place of τ. Of any other model
they are its parameters in standard deviations of their priors, z of `model.following`.

A density over z becomes one over φ with the volume |dz/dφ|.
"""

import numpy as np

from accpinn.inference.population import Population, log_of_window, population_of
from accpinn.methods.likelihood import natural
from accpinn.methods.state_space import EXTRA, LEAST
from accpinn.model.cthp import TERMS, TYPICAL, Parameters
from accpinn.model.following import FollowingModel
from accpinn.model.registry import following_model
from accpinn.model.spec import ModelSpec
from accpinn.units import FloatArray, Mask, MetresPerSecond, Seconds

PRIOR_SPREAD = (2.0, 1.5, 0.6)
"""Standard deviations of ln α, ln β and the logarithm of the time gap."""
AT_SPEED: MetresPerSecond = 100 / 3.6
"""Speed at which the time gap τ + s₀/v has its prior."""
LEAST_GAP: Seconds = 0.05
"""Least such time gap; draws below it are none of a car's."""


class Coordinates:
    """φ of a model: its p parameters in standard deviations of their priors."""

    def __init__(self, model: FollowingModel) -> None:
        """Set up the coordinates of one model of the registry."""
        self.model = model

    @property
    def count(self) -> int:
        """p, the number of coordinates."""
        return len(self.model.parameters)

    @property
    def population(self) -> Population:
        """The population of φ over other cars."""
        return population_of(self.model.key, self.count)

    @property
    def spreads(self) -> dict[str, float]:
        """Names of the coordinates' deviations between windows and cars, and the unit of each."""
        return {parameter.name: parameter.spread for parameter in self.model.parameters}

    def of_values(self, values: FloatArray) -> FloatArray:
        """(p,) φ of parameters (p,); gains of zero count as the least of a search."""
        kinds = self.model.parameters
        return np.array([kind.score(value) for kind, value in zip(kinds, values, strict=True)])

    def of_scores(self, z: FloatArray) -> FloatArray:
        """(n, p) φ of scores z (n, p)."""
        return z

    def log_volume(self, z: FloatArray) -> FloatArray:
        """(n,) ln |dz/dφ| at scores z (n, p), up to a constant."""
        return np.zeros(len(z))

    def log_prior(self, phi: FloatArray) -> FloatArray:
        """(..) log density at (.., p) of the prior of a window alone, up to a constant."""
        return np.asarray(-0.5 * (phi**2).sum(axis=-1))

    def parameters(self, phi: FloatArray, speed: FloatArray | float) -> Parameters:
        """(..) parameters at (.., p), linearised at a speed (..) in m/s."""
        return self.model.linearisations(self.model.values_at(phi), speed)

    def values(self, phi: FloatArray) -> FloatArray:
        """(.., p) the parameters at (.., p), in the order of their names."""
        return np.asarray(np.moveaxis(self.model.values_at(phi), 0, -1))

    def possible(self, phi: FloatArray, speed: float) -> FloatArray:
        """Draws (n, p) of equal weight with an equilibrium at a speed; others in place of the rest.

        A vehicle kept that speed, so it had one. Where none has, all draws are returned.
        """
        if not np.isfinite(phi).all():
            return phi
        gaps = self.model.equilibrium_gaps(self.model.values_at(phi), speed)
        usable = np.flatnonzero(np.isfinite(gaps))
        if not len(usable):
            return phi
        chosen = np.arange(len(phi))
        lost = ~np.isfinite(gaps)
        chosen[lost] = np.resize(usable, lost.sum())
        return np.asarray(phi[chosen])


class TimeGapCoordinates(Coordinates):
    """φ of a CTHP: ln α, ln β, ln of the time gap at `AT_SPEED`, and the T further terms."""

    @property
    def spreads(self) -> dict[str, float]:
        """See `Coordinates.spreads`; the logarithms are relative deviations."""
        return dict.fromkeys(("alpha", "beta", "time_gap", *self.model.terms), 1.0)

    def of_unknowns(self, z: FloatArray) -> FloatArray:
        """(.., p) φ of the unknowns z (.., P) of the likelihood, see `methods.likelihood`."""
        values = natural(self.model.key, z)
        gap = values[..., 1] / values[..., 0]
        if "s0" in self.model.terms:
            gap = gap + values[..., 9] / AT_SPEED
        sizes = values[..., 0], values[..., 2], np.maximum(gap, LEAST_GAP)
        return np.concatenate([np.log(np.stack(sizes, axis=-1)), values[..., 9:]], axis=-1)

    def of_values(self, values: FloatArray) -> FloatArray:
        """See `Coordinates.of_values`."""
        alpha, beta, tau, *terms = values
        intercept = terms[0] if "s0" in self.model.terms else 0.0
        gap = max(tau + intercept / AT_SPEED, LEAST_GAP)
        return np.array([*np.log([max(alpha, LEAST), max(beta, LEAST), gap]), *terms])

    def of_scores(self, z: FloatArray) -> FloatArray:
        """See `Coordinates.of_scores`."""
        theta = self.model.values_at(z)
        sets = Parameters(*theta[:3], *(self.model.term(theta, term) for term in TERMS))
        gap = np.maximum(sets.time_gap(AT_SPEED), LEAST_GAP)
        shape = np.log([sets.alpha, sets.beta, gap])
        return np.column_stack([*shape, *(getattr(sets, term) for term in self.model.terms)])

    def log_volume(self, z: FloatArray) -> FloatArray:
        """See `Coordinates.log_volume`."""
        theta = self.model.values_at(z)
        intercept = self.model.term(theta, "s0")
        volume = np.log(np.maximum(theta[2] + intercept / AT_SPEED, LEAST_GAP) / theta[2])
        if self.model.is_late:
            volume = volume - np.log(theta[-1])
        return np.asarray(volume)

    def log_prior(self, phi: FloatArray) -> FloatArray:
        """See `Coordinates.log_prior`."""
        starts = [EXTRA[term].start for term in self.model.terms]
        centre = np.append(np.log(TYPICAL.values), starts)
        return np.asarray(-0.5 * (((phi - centre) / self.prior_spread) ** 2).sum(axis=-1))

    @property
    def prior_spread(self) -> FloatArray:
        """(p,) the standard deviations of that prior."""
        return np.append(PRIOR_SPREAD, [EXTRA[t].spread or np.inf for t in self.model.terms])

    def parameters(self, phi: FloatArray, speed: FloatArray | float) -> Parameters:
        """See `Coordinates.parameters`; they are the same at every speed."""
        complete = np.zeros((*phi.shape[:-1], 6))
        complete[..., 0], complete[..., 1] = np.exp(phi[..., 0]), np.exp(phi[..., 1])
        for at, term in enumerate(self.model.terms, 3):
            least = -np.inf if term == "s0" else 0.0
            complete[..., 3 + TERMS.index(term)] = np.maximum(phi[..., at], least)
        # The data determine the time gap, so where s₀ is more than all of it, it is s₀ that gives
        # way.
        gap = np.exp(phi[..., 2])
        complete[..., 3] = np.minimum(complete[..., 3], gap * AT_SPEED)
        complete[..., 2] = np.maximum(gap - complete[..., 3] / AT_SPEED, 0.0)
        return Parameters.of(complete)

    def values(self, phi: FloatArray) -> FloatArray:
        """See `Coordinates.values`."""
        sets = self.parameters(phi, AT_SPEED)
        return np.stack([getattr(sets, name) for name in self.model.names], axis=-1)

    def possible(self, phi: FloatArray, speed: float) -> FloatArray:
        """All draws: a CTHP has an equilibrium at every speed."""
        return phi


def coordinates_of(model: str) -> Coordinates:
    """The coordinates of a model, by its key."""
    following = following_model(model)
    return time_gap_coordinates(model) if following.is_linear else Coordinates(following)


def time_gap_coordinates(form: str) -> TimeGapCoordinates:
    """The coordinates of a CTHP, by its key."""
    return TimeGapCoordinates(following_model(form))


def free_of(spec: ModelSpec) -> Mask:
    """(p,) whether a coordinate is free: not one of a term that keeps its value."""
    fixed = [name for name, _ in spec.fixed]
    return np.array([name not in fixed for name in spec.following.names])


def log_prior_of_likely(spec: ModelSpec, phi: FloatArray) -> FloatArray:
    """(..) log density at (.., p) of what a window of any car has, up to a constant."""
    free = free_of(spec)
    return log_of_window(coordinates_of(spec.model).population.of(free), phi[..., free])


def of_others(spec: ModelSpec, z: FloatArray) -> FloatArray:
    """(n,) log of what other cars say of unknowns z (n, P), over the prior of a posterior."""
    space = time_gap_coordinates(spec.model)
    phi = space.of_unknowns(z)
    return log_prior_of_likely(spec, phi) - space.log_prior(phi)
