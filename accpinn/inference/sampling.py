"""The sampling distribution of a solution whose equations are correlated over time, and its draws.

Without the instants of a block B the equations Σ_t Z_tᵀ(dv/dt - X_t θ) = 0 have the solution

    θ_B = θ - (A - A_B)⁻¹ S_B,     A_B = Σ_B Z_tᵀX_t,   S_B = Σ_B Z_tᵀr_t

exactly. Every block of L consecutive instants is left out once, also those that run over the end
into the beginning, and

    V = 1/L Σ_B (θ_B - θ)(θ_B - θ)ᵀ.

Correlation within a block is kept whole, so L must be several times as long as the disturbance
lasts. The quotient to the truth then follows Student's t, with 1.5 degrees of freedom per block
that fits into the window, as overlapping blocks are worth.

Draws obey the rational driving constraints: one that violates them is replaced by the point of the
feasible region that is nearest in the metric of V⁻¹, as an estimate under the constraints would be.
The share of draws on a bound is thereby the probability that the constraint is active.

Source: Künsch, The jackknife and the bootstrap for general stationary observations, Annals of
Statistics 17 (1989) 1217-1241.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from accpinn.inference.instrumental_variables import Equations
from accpinn.units import FloatArray, Seconds

SHORTEST_BLOCK: Seconds = 40.0
"""Residuals of real recordings lose two thirds of their correlation within three to six seconds;
with blocks of 30, 40 and 45 s the measured coverage of α is 86, 88 and 89 % at a nominal 90 %."""
LONGEST_BLOCK: Seconds = 60.0
BLOCKS = 10
"""In a long window as many blocks as this, within the limits above."""
FEWEST_BLOCKS = 4
"""In a short window the blocks are shorter, so that at least so many fit."""
FREEDOM_PER_BLOCK = 1.5
STRIDE: Seconds = 0.5
"""Between the first instants of blocks; blocks that start in between add nothing."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """How θ scatters about the truth: Student's t in three dimensions."""

    scale: FloatArray
    """(3, 3) V."""
    freedom: float
    """Degrees of freedom."""


def block_length(duration: Seconds) -> Seconds:
    """L for a window of this length."""
    wanted = min(max(duration / BLOCKS, SHORTEST_BLOCK), LONGEST_BLOCK)
    return min(wanted, duration / FEWEST_BLOCKS)


def jackknife(equations: Equations, sample_time: Seconds) -> Scatter | None:
    """The scatter of the equations' solution.

    Returns:
        None where the data do not determine it, as when all that excites the vehicle lies within
        one block.
    """
    if not equations.determined:
        return None
    count = len(equations.scores)
    duration = (count - 1) * sample_time
    length = max(2, round(block_length(duration) / sample_time))
    firsts = np.arange(0, count, max(1, round(STRIDE / sample_time)))
    normal = _block_sums(equations.normal, length)[firsts]
    scores = _block_sums(equations.scores, length)[firsts]
    rest = equations.normal.sum(axis=0) - normal
    try:
        moves = np.linalg.solve(rest, scores[..., None])[..., 0]
    except np.linalg.LinAlgError:
        return None
    scale = moves.T @ moves * (count / len(firsts) / length)
    finite = bool(np.isfinite(scale).all())
    return Scatter(scale, FREEDOM_PER_BLOCK * count / length) if finite else None


def draw(theta: FloatArray, scatter: Scatter, count: int, rng: np.random.Generator) -> FloatArray:
    """Draws of θ = (α, ατ, β), none of them negative.

    Args:
        theta: (3,) the centre.
        scatter: about the centre.
        count: how many; an even number.
        rng: the source of randomness.

    Returns:
        (count, 3).
    """
    root = _square_root(scatter.scale)
    half = rng.standard_normal((count // 2, 3)) @ root.T
    half /= np.sqrt(rng.chisquare(scatter.freedom, (count // 2, 1)) / scatter.freedom)
    # In pairs on either side, so that the draws' middle is θ itself.
    return project(theta + np.concatenate([half, -half]), scatter.scale)


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


def _block_sums(values: FloatArray, length: int) -> FloatArray:
    """Sums over ``length`` instants from each one on, running over the end into the beginning."""
    around = np.concatenate([values, values[: length - 1]])
    sums = np.concatenate([np.zeros_like(values[:1]), around.cumsum(axis=0)])
    return np.asarray(sums[length:] - sums[:-length])


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
