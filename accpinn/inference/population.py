"""How parameters differ between windows of one car, and between cars; the typical value of a car.

In window w of a car the parameters φ_w = (ln α, ln β, ln G, s₀, λ or d) are those of

    φ_w ~ N(μ, Σ),   μ ~ N(m, S),   Σ ~ inverse Wishart(ν, (ν - p - 1) Σ₀)

with G = τ + s₀/v the time gap at 100 km/h, which the data determine, in place of τ, which they
hardly do. μ is the car's typical value, and N(μ, Σ) what a further window of it may have. m, S and
Σ₀ are learned from many cars (`python -m bench.population`), so that one window alone has an
interval as wide as cars are known to vary.

The posterior of (μ, Σ) is sampled by Gibbs's method. Window w is known by n draws φ_wk of its own
posterior under a prior p(φ), of which one is chosen with a probability proportional to
N(φ_wk; μ, Σ) / p(φ_wk), so no window's likelihood is taken as normal; given the chosen ones, Σ and
μ have closed forms.

Sources: Hogg, Myers and Bovy, Astrophysical Journal 725 (2010) 2166-2175 (a population from draws);
Gelman, Carlin, Stern, Dunson, Vehtari and Rubin, Bayesian Data Analysis, 3rd ed., 2013, chapters 11
(Gibbs's method) and 15 (hierarchical models).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from accpinn.model.models import Model
from accpinn.units import FloatArray, Mask

CHAINS, BURN, KEPT = 40, 20, 50
"""Parallel chains, and rounds of each that are left out and kept."""


@dataclass(frozen=True, eq=False)
class Population:
    """What many cars taught about φ under one model; p coordinates."""

    centre: FloatArray
    """(p,) m."""
    cars: FloatArray
    """(p, p) S: covariance of typical values between cars."""
    windows: FloatArray
    """(p, p) Σ₀: usual covariance between windows of one car."""

    def of(self, kept: Mask) -> "Population":
        """The population of some coordinates (p,), where the others are held."""
        square = np.ix_(kept, kept)
        return Population(self.centre[kept], self.cars[square], self.windows[square])

    @property
    def freedom(self) -> int:
        """ν: as if so many windows more than p + 1 had been seen with covariance Σ₀."""
        return len(self.centre) + 4


class Sampled(NamedTuple):
    """Draws of (μ, Σ) of one car."""

    value: FloatArray
    """(n, p) μ, the typical value."""
    covariance: FloatArray
    """(n, p, p) Σ."""
    further: FloatArray
    """(n, p) parameters of a further window."""


def sampled_population(
    drawn: FloatArray, log_prior: FloatArray, population: Population, seed: int = 0
) -> Sampled:
    """Sample the typical value of one car and how its windows differ.

    Args:
        drawn: (K, n, p) draws of equal weight from the posterior of each of K windows.
        log_prior: (K, n) log density of the prior that these posteriors have, up to a constant.
        population: of the model's p coordinates.
        seed: of the draws.
    """
    rng = np.random.default_rng(seed)
    count, size, p = drawn.shape
    centred = drawn - population.centre
    squares = _quadratic(centred).reshape(count * size, -1)
    scale = (population.freedom - p - 1) * population.windows
    between_cars = np.linalg.inv(population.cars)
    each = np.arange(count)
    chosen = centred[each, rng.integers(size, size=(CHAINS, count))]
    mean = chosen.mean(axis=1)
    values, covariances, further = [], [], []
    for turn in range(BURN + KEPT):
        away = chosen - mean[:, None]
        scatter = scale + np.einsum("cki,ckj->cij", away, away)
        root = _wishart_root(np.linalg.inv(scatter), population.freedom + count, rng)
        precision = root @ root.transpose(0, 2, 1)
        covariance = np.asarray(np.linalg.inv(count * precision + between_cars), float)
        pulled = np.einsum("cij,cj->ci", precision, chosen.sum(axis=1))
        mean = np.einsum("cij,cj->ci", covariance, pulled) + _normal(covariance, rng)
        log = (squares @ _coefficients(mean, precision).T).reshape(count, size, CHAINS)
        log -= log_prior[:, :, None]
        weights = np.exp(log - log.max(axis=1, keepdims=True)).cumsum(axis=1)
        reached = weights < rng.random((count, 1, CHAINS)) * weights[:, -1:]
        chosen = centred[each, reached.sum(axis=1).T]
        if turn >= BURN:
            values.append(mean + population.centre)
            covariances.append(np.asarray(np.linalg.inv(precision), float))
            further.append(values[-1] + _normal(covariances[-1], rng))
    return Sampled(*(np.concatenate(rows) for rows in (values, covariances, further)))


def _quadratic(phi: FloatArray) -> FloatArray:
    """(.., F) the terms 1, φ_i and φ_i φ_j of a quadratic function of (.., p)."""
    i, j = np.triu_indices(phi.shape[-1])
    ones = np.ones((*phi.shape[:-1], 1))
    return np.concatenate([ones, phi, phi[..., i] * phi[..., j]], axis=-1)


def _coefficients(mean: FloatArray, precision: FloatArray) -> FloatArray:
    """(C, F) of -½ (φ - μ)ᵀ Σ⁻¹ (φ - μ) in the terms of `_quadratic`."""
    i, j = np.triu_indices(mean.shape[-1])
    linear = np.einsum("cij,cj->ci", precision, mean)
    constant = -0.5 * np.einsum("ci,ci->c", linear, mean)
    bilinear = -precision[:, i, j] * np.where(i == j, 0.5, 1.0)
    return np.concatenate([constant[:, None], linear, bilinear], axis=1)


def _wishart_root(scale: FloatArray, freedom: int, rng: np.random.Generator) -> FloatArray:
    """(C, p, p) roots of draws from Wishart distributions with scale matrices (C, p, p).

    Source: Bartlett's decomposition.
    """
    count, p, _ = scale.shape
    lower = np.zeros(scale.shape)
    for row in range(p):
        lower[:, row, row] = np.sqrt(rng.chisquare(freedom - row, count))
        lower[:, row, :row] = rng.standard_normal((count, row))
    return np.asarray(np.linalg.cholesky(scale) @ lower)


def _normal(covariance: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(C, p) a draw of each normal distribution about zero with covariance (C, p, p)."""
    normal = rng.standard_normal(covariance.shape[:2])
    return np.asarray(np.einsum("cij,cj->ci", np.linalg.cholesky(covariance), normal))


def _population(
    centre: list[float], cars: list[list[float]], windows: list[list[float]]
) -> Population:
    return Population(np.array(centre), np.array(cars), np.array(windows))


POPULATIONS: dict[Model, Population] = {
    "cthp": _population(
        [-2.4804, -1.6795, 0.2775],
        [[0.5456, 0.1121, 0.0635], [0.1121, 0.5912, -0.1344], [0.0635, -0.1344, 0.0942]],
        [[0.305, 0.0221, -0.0087], [0.0221, 0.2149, 0.008], [-0.0087, 0.008, 0.0014]],
    ),
    "cthp-s0": _population(
        [-2.5791, -1.6652, 0.1867, 6.7795],
        [
            [0.5557, 0.1397, -0.0597, -0.2438],
            [0.1397, 0.8648, -0.286, 4.1316],
            [-0.0597, -0.286, 0.1315, -1.2895],
            [-0.2438, 4.1316, -1.2895, 22.9945],
        ],
        [
            [0.2432, 0.0757, -0.0398, 0.7311],
            [0.0757, 0.185, -0.0335, 1.381],
            [-0.0398, -0.0335, 0.0244, -0.3355],
            [0.7311, 1.381, -0.3355, 13.36],
        ],
    ),
    "cthp-lag": _population(
        [-2.835, -1.1614, 0.2809, 0.6578],
        [
            [0.2782, 0.2029, -0.0062, 0.0061],
            [0.2029, 0.3397, -0.0447, -0.0008],
            [-0.0062, -0.0447, 0.0899, 0.0233],
            [0.0061, -0.0008, 0.0233, 0.0647],
        ],
        [
            [0.126, 0.074, -0.0093, 0.0291],
            [0.074, 0.221, 0.0008, 0.0603],
            [-0.0093, 0.0008, 0.0019, 0.0014],
            [0.0291, 0.0603, 0.0014, 0.0497],
        ],
    ),
    "cthp-delay": _population(
        [-2.8901, -1.199, 0.2815, 0.6848],
        [
            [0.2326, 0.168, -0.0437, 0.0067],
            [0.168, 0.2759, -0.0386, -0.0103],
            [-0.0437, -0.0386, 0.0914, 0.0376],
            [0.0067, -0.0103, 0.0376, 0.0457],
        ],
        [
            [0.1086, 0.0758, -0.0064, -0.0114],
            [0.0758, 0.2017, -0.0027, 0.0252],
            [-0.0064, -0.0027, 0.0018, 0.0012],
            [-0.0114, 0.0252, 0.0012, 0.0714],
        ],
    ),
    "cthp-s0-lag": _population(
        [-2.9408, -1.1251, 0.1564, 7.9465, 0.663],
        [
            [0.4129, 0.2669, -0.1818, 1.2525, -0.0744],
            [0.2669, 0.3202, -0.1131, 1.0437, -0.0612],
            [-0.1818, -0.1131, 0.128, -0.7527, 0.0524],
            [1.2525, 1.0437, -0.7527, 6.2243, -0.3401],
            [-0.0744, -0.0612, 0.0524, -0.3401, 0.0742],
        ],
        [
            [0.1746, 0.0914, -0.028, -0.0335, -0.0065],
            [0.0914, 0.1921, -0.015, 1.0036, 0.0351],
            [-0.028, -0.015, 0.0178, -0.1871, 0.0023],
            [-0.0335, 1.0036, -0.1871, 18.5493, 0.3632],
            [-0.0065, 0.0351, 0.0023, 0.3632, 0.0461],
        ],
    ),
    "cthp-s0-delay": _population(
        [-3.0066, -1.1784, 0.1587, 8.1525, 0.6682],
        [
            [0.4247, 0.2458, -0.1914, 0.9113, -0.0521],
            [0.2458, 0.3127, -0.0929, 1.025, -0.0301],
            [-0.1914, -0.0929, 0.1046, -0.3372, 0.0429],
            [0.9113, 1.025, -0.3372, 4.7365, -0.1239],
            [-0.0521, -0.0301, 0.0429, -0.1239, 0.0557],
        ],
        [
            [0.1535, 0.081, -0.0372, 0.5761, -0.0297],
            [0.081, 0.1972, -0.0215, 1.3108, 0.0317],
            [-0.0372, -0.0215, 0.0186, -0.2724, 0.0098],
            [0.5761, 1.3108, -0.2724, 19.0777, 0.1976],
            [-0.0297, 0.0317, 0.0098, 0.1976, 0.0805],
        ],
    ),
}
"""As `python -m bench.population` printed them for 16 cars in 95 windows of OpenACC."""
