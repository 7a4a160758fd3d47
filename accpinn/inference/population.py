"""The variation of parameters between windows of one car and between cars.

In window w of a car the parameters φ_w = (ln α, ln β, ln G, s₀, λ or d) are those of

    φ_w ~ N(μ, Σ/g_w),   g_w ~ Gamma(κ/2, κ/2),   μ ~ N(m, S),
    Σ ~ inverse Wishart(ν, (ν - p - 1) Σ₀)

with G = τ + s₀/v the time gap at 100 km/h, which the data determine, in place of τ, which they
hardly do. Over all g_w this is Student's t with κ degrees of freedom, so an unusual window pulls
little. μ is the car's typical value, and that t what a further window of it may have. m, S and Σ₀
are learned from many cars, so that one window alone has an interval as wide as cars are known to
vary: `populations.csv` has them row by row, as `python -m bench.population` printed them for 16
cars in 95 windows of OpenACC.

The posterior of (μ, Σ) is sampled by Gibbs's method. Window w is known by n draws φ_wk of its own
posterior under a prior p(φ), of which one is chosen with a probability proportional to
t(φ_wk; μ, Σ) / p(φ_wk), so no window's likelihood is taken as normal; given the chosen ones, g_w, Σ
and μ have closed forms.

Sources: Hogg, Myers and Bovy, Astrophysical Journal 725 (2010) 2166-2175 (a population from draws);
Gelman, Carlin, Stern, Dunson, Vehtari and Rubin, Bayesian Data Analysis, 3rd ed., 2013, chapters 11
(Gibbs's method), 15 (hierarchical models) and 17 (Student's t).
"""

import csv
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from accpinn.model.registry import following_model
from accpinn.units import FloatArray, Mask

CHAINS, BURN, KEPT, THINNING = 40, 20, 25, 4
"""Parallel chains; rounds of each that are left out, and kept: one in four, as they move slowly."""
LESS_RELATED, MORE_CARS = 0.6, 2.0
"""Factors on the correlations and the variances between cars that were learned: 16 cars leave up to
15 numbers of S uncertain, and as learned it drew cars unlike these towards them."""
MORE_BETWEEN = 1.5
"""Factor on the variances between windows that were learned: with it the interval for a further
window holds as many left-out windows as it says (docs/validation.md)."""
OF_OTHERS = 0.8, 2.0
"""Factors on the correlations and the variances between windows of models that are no CTHP, for the
same reason: their time gap depends on all parameters at once."""
LEAST_GAP_SPREAD = 0.1
"""Least scale of ln G between windows: deviations of 14 %. What few cars taught is less, and with
it typical values of simulated cars, and further windows of real ones, were covered too seldom."""
TAILS = 4.0
"""κ: further windows are more probable with it than under a normal one (docs/validation.md)."""
UNLEARNED = 0.4
"""Deviation between windows, in deviations of the priors, of a model without learned values; the
mean of what was learned of the IDM is about this."""
PARTS = "centre", "cars", "windows"
"""Fields of `Population`, as `populations.csv` names its rows."""
WIDEST = 20
"""Most draws of a block, of which one is chosen."""
WITHIN = 1.1416
"""Deviation within which 68 % of that t lie, over the root of its scale."""


@dataclass(frozen=True, eq=False)
class Population:
    """The distribution of φ (p coordinates) over many cars and their windows, under one model."""

    centre: FloatArray
    """(p,) m."""
    cars: FloatArray
    """(p, p) S: covariance of typical values between cars."""
    windows: FloatArray
    """(p, p) Σ₀: usual scale matrix between windows of one car, half their covariance."""

    def of(self, free: Mask) -> "Population":
        """The population of some coordinates (p,), where the others are held."""
        square = np.ix_(free, free)
        return Population(self.centre[free], self.cars[square], self.windows[square])

    @property
    def of_cars(self) -> "Population":
        """The population one level up: the variation of the typical values of a group's cars."""
        return Population(self.centre, self.cars, self.cars / WITHIN**2)

    @property
    def freedom(self) -> int:
        """ν: as if so many windows more than p + 1 had been seen with scale Σ₀."""
        return len(self.centre) + 4


def log_of_window(population: Population, phi: FloatArray) -> FloatArray:
    """(..) log density of what a window of a car not yet known has, (.., p), up to a constant.

    It is Student's t with a scale of S + Σ₀, near the distribution that follows from all the
    above.
    """
    p, away = len(population.centre), phi - population.centre
    inverse = np.linalg.inv(population.cars + population.windows)
    distance = np.einsum("...i,ij,...j->...", away, inverse, away)
    return np.asarray(-0.5 * (TAILS + p) * np.log(1.0 + distance / TAILS))


class Car(NamedTuple):
    """Draws of what the windows of one car say together."""

    value: FloatArray
    """(n, p) μ, the typical value."""
    covariance: FloatArray
    """(n, p, p) Σ, the scale matrix; zero for what is held."""
    further: FloatArray
    """(n, p) parameters of a further window."""

    @property
    def middle(self) -> FloatArray:
        """(p,) the mean typical value; a mean of equal values may round, so it lies among them."""
        drawn = self.value
        return np.asarray(np.clip(drawn.mean(axis=0), drawn.min(axis=0), drawn.max(axis=0)))


def sampled_population(
    drawn: FloatArray,
    log_prior: FloatArray,
    population: Population,
    seed: int = 0,
    *,
    left_out: int = 0,
) -> Car:
    """Sample the typical value of one car and how its windows differ.

    The draws (K, n, p) have equal weight and are from the posterior of each of K windows, whose
    prior has the log density (K, n), up to a constant. Rounds are left out beyond `BURN`.
    """
    rng = np.random.default_rng(seed)
    count, size, p = drawn.shape
    centred = drawn - population.centre
    squares = _quadratic(centred).reshape(count * size, -1)
    unlikely = np.exp(log_prior.min(axis=1, keepdims=True) - log_prior)[:, :, None]
    scale = (population.freedom - p - 1) * population.windows
    between_cars = np.linalg.inv(population.cars)
    chains = np.arange(count)
    # Chains begin where each window alone would lie under the population, as they move slowly.
    alone = _coefficients(np.zeros((1, p)), np.linalg.inv(population.cars + scale)[None])
    first = (squares @ alone.T).reshape(count, size, 1)
    likely = unlikely * np.exp(first - first.max(axis=1, keepdims=True))
    chosen = centred[chains, _one_of(np.repeat(likely, CHAINS, axis=2), rng)]
    mean = chosen.mean(axis=1)
    weights = np.ones((CHAINS, count))
    values, covariances, further = [], [], []
    away = chosen - mean[:, None]
    left_out += BURN
    for turn in range(1, left_out + KEPT * THINNING + 1):
        scatter = scale + np.einsum("ck,cki,ckj->cij", weights, away, away)
        root = _wishart_root(np.linalg.inv(scatter), population.freedom + count, rng)
        precision = root @ root.transpose(0, 2, 1)
        weighted = weights.sum(axis=1)[:, None, None] * precision
        covariance = np.asarray(np.linalg.inv(weighted + between_cars), float)
        pulled = np.einsum("cij,ck,ckj->ci", precision, weights, chosen)
        mean = np.einsum("cij,cj->ci", covariance, pulled) + _normal(covariance, rng)
        coefficients = -2.0 / TAILS * _coefficients(mean, precision)
        coefficients[:, 0] += 1.0
        likely = (squares @ coefficients.T).reshape(count, size, CHAINS)
        np.power(likely, -0.5 * (TAILS + p), out=likely)
        likely *= unlikely
        chosen = centred[chains, _one_of(likely, rng)]
        away = chosen - mean[:, None]
        distance = np.einsum("cki,cij,ckj->ck", away, precision, away)
        weights = rng.gamma(0.5 * (TAILS + p), 2.0 / (TAILS + distance))
        if turn > left_out and (turn - left_out) % THINNING == 0:
            values.append(mean + population.centre)
            covariances.append(np.asarray(np.linalg.inv(precision), float))
            stretch = np.sqrt(rng.gamma(0.5 * TAILS, 2.0 / TAILS, (CHAINS, 1)))
            further.append(values[-1] + _normal(covariances[-1], rng) / stretch)
    return Car(*(np.concatenate(rows) for rows in (values, covariances, further)))


def _one_of(chances: FloatArray, rng: np.random.Generator) -> NDArray[np.intp]:
    """(C, K) a draw's place for each chain and window, by chances (K, n, C) up to a factor.

    First a block of draws is chosen, and then one of these.
    """
    count, size, chains = chances.shape
    width = math.gcd(size, WIDEST)
    blocks = chances.reshape(count, -1, width, chains)
    reached = blocks.sum(axis=2).cumsum(axis=1)
    aim = (rng.random((count, 1, chains)) * reached[:, -1:])[:, 0]
    window, chain = np.arange(count)[:, None], np.arange(chains)
    block = np.minimum((reached < aim[:, None]).sum(axis=1), reached.shape[1] - 1)
    aim -= np.where(block > 0, reached[window, block - 1, chain], 0.0)
    inside = blocks[window, block, :, chain].cumsum(axis=2)
    at = np.minimum((inside < aim[:, :, None]).sum(axis=2), width - 1)
    return np.asarray((width * block + at).T)


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


def _normal(covariance: NDArray[Any], rng: np.random.Generator) -> FloatArray:
    """(C, p) a draw of each normal distribution about zero with covariance (C, p, p)."""
    normal = rng.standard_normal(covariance.shape[:2])
    return np.asarray(np.einsum("cij,cj->ci", np.linalg.cholesky(covariance), normal))


def regularised(learned: Population, has_time_gap: bool = True) -> Population:
    """A population as it is used: what a few cars taught of S and Σ₀ is uncertain.

    The third coordinate may be ln of the time gap, which differs between windows by some share.
    """
    variances = np.diag(np.diag(learned.cars))
    cars = MORE_CARS * (LESS_RELATED * learned.cars + (1 - LESS_RELATED) * variances)
    if has_time_gap:
        windows = MORE_BETWEEN * learned.windows
        windows[2, 2] += max(0.0, LEAST_GAP_SPREAD**2 - windows[2, 2])
    else:
        related, more = OF_OTHERS
        uncorrelated = np.diag(np.diag(learned.windows))
        windows = more * (related * learned.windows + (1 - related) * uncorrelated)
    return Population(learned.centre, cars, windows)


@cache
def population_of(model: str, count: int) -> Population:
    """The population of a model's coordinates.

    Where nothing was learned of a model, its ``count`` parameters differ between cars as its priors
    say, and between windows by `UNLEARNED` of that.
    """
    text = files("accpinn.inference").joinpath("populations.csv").read_text(encoding="utf-8")
    rows = [row for row in csv.reader(text.splitlines()) if row[0] == model]
    if not rows:
        return Population(np.zeros(count), np.eye(count), UNLEARNED**2 * np.eye(count))
    centre, cars, windows = (
        np.array([values for _, of, *values in rows if of == part], float) for part in PARTS
    )
    is_linear = following_model(model).is_linear
    return regularised(Population(centre[0], cars, windows), is_linear)
