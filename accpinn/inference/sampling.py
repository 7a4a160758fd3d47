"""Draws of the parameters, within the rational driving constraints.

A draw that breaks a constraint goes to the point of the allowed region that is nearest in the
metric of its own scatter, as an estimate under the constraints would. Bounds are then reached by
as many draws as the data say.
"""

from itertools import combinations

import numpy as np

from accpinn.inference.jackknife import Spread
from accpinn.units import FloatArray

DRAWS = 2000
"""Kept, for bands and clouds."""
OVERSAMPLING = 10
"""So many times more are drawn for the ends of intervals, which then move by at most 4 % of an
interval's width from seed to seed; with those kept alone a τ that is hardly determined moved by
39 %."""
SEED = 0


def draw(theta: FloatArray, spread: Spread, count: int, rng: np.random.Generator) -> FloatArray:
    """(count, 3) draws of α, ατ, β around θ (3,), none of them negative; ``count`` is even."""
    root = _square_root(spread.scale)
    half = rng.standard_normal((count // 2, 3)) @ root.T
    half /= np.sqrt(rng.chisquare(spread.freedom, (count // 2, 1)) / spread.freedom)
    # In pairs on either side, so that the draws' middle is θ itself.
    return project(theta + np.concatenate([half, -half]), spread.scale)


def project(theta: FloatArray, scale: FloatArray) -> FloatArray:
    """The nearest θ ≥ 0 to each row of ``theta`` (K, 3), in the metric of the inverse scale."""
    result = np.array(theta)
    outside = (result < 0).any(axis=1)
    if not outside.any():
        return result
    metric = _inverse(scale)
    wanted = result[outside]
    best = np.zeros_like(wanted)
    costs = _costs(wanted, metric)
    for size in (1, 2):
        for free in combinations(range(3), size):
            inside, held = list(free), [k for k in range(3) if k not in free]
            moved = np.zeros_like(wanted)
            pull = np.linalg.solve(metric[np.ix_(inside, inside)], metric[np.ix_(inside, held)])
            moved[:, inside] = wanted[:, inside] + wanted[:, held] @ pull.T
            cost = _costs(wanted - moved, metric)
            better = (moved >= 0).all(axis=1) & (cost < costs)
            best[better], costs[better] = moved[better], cost[better]
    result[outside] = best
    return result


def as_parameters(theta: FloatArray) -> FloatArray:
    """(.., 3) α, ατ, β to α, β, τ; τ is nan where α = 0."""
    alpha, alpha_tau, beta = np.moveaxis(theta, -1, 0)
    tau = np.divide(alpha_tau, alpha, out=np.full_like(alpha, np.nan), where=alpha > 0)
    return np.stack([alpha, beta, tau], axis=-1)


def quantile_interval(values: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
    """Lower and upper ends over the first axis; nan means that any value from 0 on is possible."""
    tail = (1.0 - level) / 2.0
    unknown = np.isnan(values)
    # No interpolation, as infinite values have no middle.
    lower = np.quantile(np.where(unknown, 0.0, values), tail, axis=0, method="inverted_cdf")
    upper = np.quantile(
        np.where(unknown, np.inf, values), 1.0 - tail, axis=0, method="inverted_cdf"
    )
    return lower, upper


def _costs(distance: FloatArray, metric: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ki,ij,kj->k", distance, metric, distance))


def _square_root(scale: FloatArray) -> FloatArray:
    """B with BBᵀ = scale, which may be singular."""
    values, vectors = np.linalg.eigh(scale)
    # An eigenvector's sign is the library's choice; the draws are to be the same everywhere.
    vectors *= np.sign(vectors[np.abs(vectors).argmax(axis=0), range(len(values))])
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _inverse(scale: FloatArray) -> FloatArray:
    """Of the scale in units of its own deviations; what does not scatter has a small deviation."""
    deviations = np.sqrt(np.diag(scale))
    deviations = np.maximum(deviations, 1e-12 * max(1.0, deviations.max()))
    units = np.outer(deviations, deviations)
    return np.asarray(np.linalg.inv(scale / units + 1e-10 * np.eye(3)) / units)
