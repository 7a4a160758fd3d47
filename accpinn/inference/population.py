"""How parameters differ between windows of one car, and between cars; the typical value of a car.

In window w of a car the parameters φ_w = (ln α, ln β, ln G, s₀, λ or d) are those of

    φ_w ~ N(μ, Σ/g_w),   g_w ~ Gamma(κ/2, κ/2),   μ ~ N(m, S),
    Σ ~ inverse Wishart(ν, (ν - p - 1) Σ₀)

with G = τ + s₀/v the time gap at 100 km/h, which the data determine, in place of τ, which they
hardly do. Over all g_w this is Student's t with κ degrees of freedom, so an unusual window pulls
little. μ is the car's typical value, and that t what a further window of it may have. m, S and Σ₀
are learned from many cars (`python -m bench.population`), so that one window alone has an
interval as wide as cars are known to vary.

The posterior of (μ, Σ) is sampled by Gibbs's method. Window w is known by n draws φ_wk of its own
posterior under a prior p(φ), of which one is chosen with a probability proportional to
t(φ_wk; μ, Σ) / p(φ_wk), so no window's likelihood is taken as normal; given the chosen ones, g_w, Σ
and μ have closed forms.

Sources: Hogg, Myers and Bovy, Astrophysical Journal 725 (2010) 2166-2175 (a population from draws);
Gelman, Carlin, Stern, Dunson, Vehtari and Rubin, Bayesian Data Analysis, 3rd ed., 2013, chapters 11
(Gibbs's method), 15 (hierarchical models) and 17 (Student's t).
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from accpinn.units import FloatArray, Mask

CHAINS, BURN, KEPT = 40, 20, 50
"""Parallel chains, and rounds of each that are left out and kept."""
LESS_RELATED, MORE_CARS = 0.6, 2.0
"""Factors on the correlations and the variances between cars that were learned: 16 cars leave up to
15 numbers of S uncertain, and as learned it drew cars unlike these towards them."""
MORE_BETWEEN = 1.5
"""Factor on the variances between windows that were learned: with it the interval for a further
window holds as many left-out windows as it says (docs/validation.md)."""
OF_OTHERS = 0.8, 2.0
"""Factors on the correlations and the variances between windows of models that are no CTHP, for the
same reason: their time gap depends on all parameters at once."""
LEAST_GAP_SPREAD = 0.08
"""Least scale of ln G between windows: deviations of 11 %. That of the CTHP differed by less
in the few cars at hand, and typical values of simulated cars were covered too seldom with less."""
TAILS = 4.0
"""κ: further windows are more probable with it than under a normal one (docs/validation.md)."""
UNLEARNED = 0.4
"""Deviation between windows, in deviations of the priors, of a model without learned values; the
mean of what was learned of the IDM is about this."""
WITHIN = 1.1416
"""Deviation within which 68 % of that t lie, over the root of its scale."""


@dataclass(frozen=True, eq=False)
class Population:
    """What many cars taught about φ under one model; p coordinates."""

    centre: FloatArray
    """(p,) m."""
    cars: FloatArray
    """(p, p) S: covariance of typical values between cars."""
    windows: FloatArray
    """(p, p) Σ₀: usual scale matrix between windows of one car, half their covariance."""

    def of(self, kept: Mask) -> "Population":
        """The population of some coordinates (p,), where the others are held."""
        square = np.ix_(kept, kept)
        return Population(self.centre[kept], self.cars[square], self.windows[square])

    @property
    def of_cars(self) -> "Population":
        """The same one level up: how the typical values of a group's cars may differ."""
        return Population(self.centre, self.cars, self.cars / WITHIN**2)

    @property
    def freedom(self) -> int:
        """ν: as if so many windows more than p + 1 had been seen with scale Σ₀."""
        return len(self.centre) + 4


class Sampled(NamedTuple):
    """Draws of (μ, Σ) of one car."""

    value: FloatArray
    """(n, p) μ, the typical value."""
    covariance: FloatArray
    """(n, p, p) Σ, the scale matrix."""
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
    weights = np.ones((CHAINS, count))
    values, covariances, further = [], [], []
    away = chosen - mean[:, None]
    for turn in range(BURN + KEPT):
        scatter = scale + np.einsum("ck,cki,ckj->cij", weights, away, away)
        root = _wishart_root(np.linalg.inv(scatter), population.freedom + count, rng)
        precision = root @ root.transpose(0, 2, 1)
        weighted = weights.sum(axis=1)[:, None, None] * precision
        covariance = np.asarray(np.linalg.inv(weighted + between_cars), float)
        pulled = np.einsum("cij,ck,ckj->ci", precision, weights, chosen)
        mean = np.einsum("cij,cj->ci", covariance, pulled) + _normal(covariance, rng)
        distances = -2.0 * (squares @ _coefficients(mean, precision).T)
        log = -0.5 * (TAILS + p) * np.log1p(np.maximum(distances, 0.0) / TAILS)
        log = log.reshape(count, size, CHAINS) - log_prior[:, :, None]
        chances = np.exp(log - log.max(axis=1, keepdims=True)).cumsum(axis=1)
        reached = chances < rng.random((count, 1, CHAINS)) * chances[:, -1:]
        chosen = centred[each, reached.sum(axis=1).T]
        away = chosen - mean[:, None]
        distance = np.einsum("cki,cij,ckj->ck", away, precision, away)
        weights = rng.gamma(0.5 * (TAILS + p), 2.0 / (TAILS + distance))
        if turn >= BURN:
            values.append(mean + population.centre)
            covariances.append(np.asarray(np.linalg.inv(precision), float))
            stretch = np.sqrt(rng.gamma(0.5 * TAILS, 2.0 / TAILS, (CHAINS, 1)))
            further.append(values[-1] + _normal(covariances[-1], rng) / stretch)
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


def _normal(covariance: NDArray[Any], rng: np.random.Generator) -> FloatArray:
    """(C, p) a draw of each normal distribution about zero with covariance (C, p, p)."""
    normal = rng.standard_normal(covariance.shape[:2])
    return np.asarray(np.einsum("cij,cj->ci", np.linalg.cholesky(covariance), normal))


def regularised(learned: Population, is_cthp: bool = True) -> Population:
    """A population as it is used: what a few cars taught of S and Σ₀ is uncertain."""
    variances = np.diag(np.diag(learned.cars))
    cars = MORE_CARS * (LESS_RELATED * learned.cars + (1 - LESS_RELATED) * variances)
    if is_cthp:
        windows = MORE_BETWEEN * learned.windows
        windows[2, 2] += max(0.0, LEAST_GAP_SPREAD**2 - windows[2, 2])
    else:
        related, more = OF_OTHERS
        own = np.diag(np.diag(learned.windows))
        windows = more * (related * learned.windows + (1 - related) * own)
    return Population(learned.centre, cars, windows)


def _population(
    centre: list[float],
    cars: list[list[float]],
    windows: list[list[float]],
    is_cthp: bool = True,
) -> Population:
    return regularised(Population(np.array(centre), np.array(cars), np.array(windows)), is_cthp)


POPULATIONS: dict[str, Population] = {
    "cthp": _population(
        [-2.4906, -1.6365, 0.2791],
        [[0.5537, 0.1195, 0.0461], [0.1195, 0.5805, -0.1268], [0.0461, -0.1268, 0.0923]],
        [[0.125, -0.0002, -0.0035], [-0.0002, 0.1286, 0.0051], [-0.0035, 0.0051, 0.0008]],
    ),
    "cthp-s0": _population(
        [-2.5233, -1.6168, 0.1581, 6.6977],
        [
            [0.5268, 0.2199, -0.0985, 0.7215],
            [0.2199, 0.8737, -0.3061, 4.2543],
            [-0.0985, -0.3061, 0.1545, -1.5506],
            [0.7215, 4.2543, -1.5506, 22.572],
        ],
        [
            [0.1147, 0.026, -0.0169, 0.289],
            [0.026, 0.0887, -0.0169, 0.6094],
            [-0.0169, -0.0169, 0.0118, -0.1684],
            [0.289, 0.6094, -0.1684, 6.2597],
        ],
    ),
    "cthp-lag": _population(
        [-2.8264, -1.1374, 0.2823, 0.6331],
        [
            [0.2803, 0.23, -0.013, 0.0293],
            [0.23, 0.3711, -0.0475, 0.0144],
            [-0.013, -0.0475, 0.0894, 0.0214],
            [0.0293, 0.0144, 0.0214, 0.0732],
        ],
        [
            [0.051, 0.0173, -0.0034, 0.0011],
            [0.0173, 0.1195, 0.002, 0.0253],
            [-0.0034, 0.002, 0.0009, 0.0018],
            [0.0011, 0.0253, 0.0018, 0.0239],
        ],
    ),
    "cthp-delay": _population(
        [-2.8808, -1.1907, 0.283, 0.6679],
        [
            [0.2744, 0.1923, -0.0516, 0.0084],
            [0.1923, 0.2902, -0.0394, 0.001],
            [-0.0516, -0.0394, 0.0923, 0.0413],
            [0.0084, 0.001, 0.0413, 0.0577],
        ],
        [
            [0.0538, 0.0266, -0.0037, -0.0058],
            [0.0266, 0.0988, -0.0001, 0.0135],
            [-0.0037, -0.0001, 0.0011, 0.0011],
            [-0.0058, 0.0135, 0.0011, 0.0328],
        ],
    ),
    "cthp-s0-lag": _population(
        [-2.9385, -1.097, 0.1527, 7.7288, 0.6601],
        [
            [0.4407, 0.2739, -0.2, 1.4971, -0.067],
            [0.2739, 0.335, -0.1191, 1.3678, -0.0604],
            [-0.2, -0.1191, 0.1502, -0.9612, 0.0584],
            [1.4971, 1.3678, -0.9612, 9.0874, -0.4707],
            [-0.067, -0.0604, 0.0584, -0.4707, 0.0716],
        ],
        [
            [0.0839, 0.029, -0.016, 0.0562, -0.0168],
            [0.029, 0.0893, -0.0071, 0.5021, 0.0158],
            [-0.016, -0.0071, 0.0073, -0.0867, 0.0046],
            [0.0562, 0.5021, -0.0867, 6.675, 0.1652],
            [-0.0168, 0.0158, 0.0046, 0.1652, 0.0385],
        ],
    ),
    "cthp-s0-delay": _population(
        [-3.0169, -1.1476, 0.1515, 8.1039, 0.6432],
        [
            [0.4969, 0.2578, -0.2063, 0.9499, -0.0544],
            [0.2578, 0.3126, -0.0856, 1.3261, -0.02],
            [-0.2063, -0.0856, 0.101, -0.2735, 0.0418],
            [0.9499, 1.3261, -0.2735, 7.6386, -0.1274],
            [-0.0544, -0.02, 0.0418, -0.1274, 0.0584],
        ],
        [
            [0.0798, 0.037, -0.0206, 0.2712, -0.0186],
            [0.037, 0.0995, -0.0116, 0.6392, 0.0128],
            [-0.0206, -0.0116, 0.0106, -0.1517, 0.0077],
            [0.2712, 0.6392, -0.1517, 9.2557, 0.1115],
            [-0.0186, 0.0128, 0.0077, 0.1115, 0.0439],
        ],
    ),
    "idm": _population(
        [0.1518, 1.5003, -0.3175, 0.2062, 1.4154],
        [
            [0.3521, 0.3265, -0.0881, 0.1688, 0.1494],
            [0.3265, 1.2295, -0.3397, 0.4143, 0.3533],
            [-0.0881, -0.3397, 0.9479, -0.6224, -0.2489],
            [0.1688, 0.4143, -0.6224, 0.5739, 0.2781],
            [0.1494, 0.3533, -0.2489, 0.2781, 0.3759],
        ],
        [
            [0.1403, 0.1272, 0.0039, -0.0113, -0.0188],
            [0.1272, 0.4875, 0.0866, -0.0986, 0.2157],
            [0.0039, 0.0866, 0.0919, -0.0841, 0.1034],
            [-0.0113, -0.0986, -0.0841, 0.0968, -0.0844],
            [-0.0188, 0.2157, 0.1034, -0.0844, 0.3769],
        ],
        is_cthp=False,
    ),
    "idm-lag": _population(
        [0.1603, 1.2855, -0.3244, 0.1382, 0.8699, 0.6624],
        [
            [0.2824, 0.2565, -0.0965, 0.1328, 0.0927, -0.1651],
            [0.2565, 1.1892, -0.4432, 0.4906, 0.3581, 0.0874],
            [-0.0965, -0.4432, 1.0108, -0.8054, -0.4987, 0.0685],
            [0.1328, 0.4906, -0.8054, 0.7571, 0.5069, 0.0043],
            [0.0927, 0.3581, -0.4987, 0.5069, 0.5754, 0.3143],
            [-0.1651, 0.0874, 0.0685, 0.0043, 0.3143, 1.0008],
        ],
        [
            [0.1282, 0.0947, 0.0161, -0.0268, -0.0341, -0.0501],
            [0.0947, 0.2826, 0.0396, -0.0515, 0.051, -0.0696],
            [0.0161, 0.0396, 0.0617, -0.0645, 0.0379, -0.0251],
            [-0.0268, -0.0515, -0.0645, 0.1245, -0.0046, 0.0476],
            [-0.0341, 0.051, 0.0379, -0.0046, 0.1692, 0.0488],
            [-0.0501, -0.0696, -0.0251, 0.0476, 0.0488, 0.1874],
        ],
        is_cthp=False,
    ),
    "idm-delay": _population(
        [0.1267, 1.2832, -0.2772, -0.0845, 0.6501, 0.4977],
        [
            [0.252, 0.23, -0.151, 0.2157, 0.0356, -0.276],
            [0.23, 1.0852, -0.5581, 0.7133, 0.3245, -0.1139],
            [-0.151, -0.5581, 1.1017, -1.0551, -0.5859, 0.154],
            [0.2157, 0.7133, -1.0551, 1.243, 0.7087, -0.1334],
            [0.0356, 0.3245, -0.5859, 0.7087, 0.6135, 0.1525],
            [-0.276, -0.1139, 0.154, -0.1334, 0.1525, 0.8234],
        ],
        [
            [0.1256, 0.1174, 0.0159, -0.024, -0.033, -0.0799],
            [0.1174, 0.3038, 0.0216, -0.0187, 0.02, -0.0962],
            [0.0159, 0.0216, 0.0521, -0.048, 0.0297, 0.023],
            [-0.024, -0.0187, -0.048, 0.0993, 0.0081, -0.0102],
            [-0.033, 0.02, 0.0297, 0.0081, 0.1485, 0.0702],
            [-0.0799, -0.0962, 0.023, -0.0102, 0.0702, 0.2187],
        ],
        is_cthp=False,
    ),
    "fvdm": _population(
        [-0.1069, -0.1343, -0.0869, 0.3456, 0.2373],
        [
            [0.2, -0.0734, -0.0307, 0.0646, -0.1328],
            [-0.0734, 0.6229, 0.0781, -0.0627, 0.0257],
            [-0.0307, 0.0781, 0.098, 0.0877, 0.0537],
            [0.0646, -0.0627, 0.0877, 0.4288, -0.0714],
            [-0.1328, 0.0257, 0.0537, -0.0714, 0.1524],
        ],
        [
            [0.0999, -0.028, -0.0207, 0.0059, -0.019],
            [-0.028, 0.0801, 0.0004, 0.0189, -0.0042],
            [-0.0207, 0.0004, 0.0287, -0.0378, 0.0196],
            [0.0059, 0.0189, -0.0378, 0.1026, -0.0155],
            [-0.019, -0.0042, 0.0196, -0.0155, 0.0272],
        ],
        is_cthp=False,
    ),
    "fvdm-lag": _population(
        [-0.1722, 0.1813, -0.0582, 0.3426, 0.171, 0.2591],
        [
            [0.1655, -0.0012, -0.0168, -0.0237, -0.09, 0.0019],
            [-0.0012, 0.4433, 0.0384, -0.0304, -0.0716, 0.1503],
            [-0.0168, 0.0384, 0.096, 0.0119, 0.0701, 0.0064],
            [-0.0237, -0.0304, 0.0119, 0.4536, -0.0188, 0.136],
            [-0.09, -0.0716, 0.0701, -0.0188, 0.1395, -0.0348],
            [0.0019, 0.1503, 0.0064, 0.136, -0.0348, 0.2542],
        ],
        [
            [0.0856, -0.0158, -0.0187, 0.0027, -0.0153, -0.0272],
            [-0.0158, 0.0751, -0.0067, 0.0279, -0.006, 0.0129],
            [-0.0187, -0.0067, 0.0399, -0.0565, 0.0222, 0.0315],
            [0.0027, 0.0279, -0.0565, 0.1343, -0.0194, -0.0402],
            [-0.0153, -0.006, 0.0222, -0.0194, 0.0263, 0.0225],
            [-0.0272, 0.0129, 0.0315, -0.0402, 0.0225, 0.1154],
        ],
        is_cthp=False,
    ),
    "fvdm-delay": _population(
        [-0.2188, 0.2495, -0.0405, 0.2513, 0.1641, 0.3452],
        [
            [0.1698, 0.0125, -0.0083, -0.0504, -0.0904, 0.0193],
            [0.0125, 0.3634, 0.0409, -0.0354, -0.0835, 0.1336],
            [-0.0083, 0.0409, 0.1078, -0.0154, 0.0758, -0.0155],
            [-0.0504, -0.0354, -0.0154, 0.5137, -0.0046, 0.1706],
            [-0.0904, -0.0835, 0.0758, -0.0046, 0.1548, -0.074],
            [0.0193, 0.1336, -0.0155, 0.1706, -0.074, 0.222],
        ],
        [
            [0.0777, -0.0105, -0.0202, 0.0068, -0.0168, -0.0424],
            [-0.0105, 0.0725, -0.0067, 0.0237, -0.0029, 0.0081],
            [-0.0202, -0.0067, 0.0417, -0.0578, 0.0213, 0.0657],
            [0.0068, 0.0237, -0.0578, 0.1295, -0.0186, -0.1001],
            [-0.0168, -0.0029, 0.0213, -0.0186, 0.0217, 0.0349],
            [-0.0424, 0.0081, 0.0657, -0.1001, 0.0349, 0.2234],
        ],
        is_cthp=False,
    ),
}
"""As `python -m bench.population` printed them for 16 cars in 95 windows of OpenACC."""


def population_of(model: str, count: int) -> Population:
    """The population of a model's coordinates.

    Where nothing was learned of a model, its ``count`` parameters differ between cars as its priors
    say, and between windows by `UNLEARNED` of that.
    """
    if model in POPULATIONS:
        return POPULATIONS[model]
    return Population(np.zeros(count), np.eye(count), UNLEARNED**2 * np.eye(count))
