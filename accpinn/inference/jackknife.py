"""Errors of a solution whose equations are correlated over time: leave out blocks of time.

Without the instants of a block B the equations Σ_t Z_tᵀ(dv/dt - X_t θ) = 0 have the solution

    θ_B = θ - (A - A_B)⁻¹ S_B,     A_B = Σ_B Z_tᵀX_t,   S_B = Σ_B Z_tᵀr_t

exactly. Every block of L consecutive instants is left out once, also those that run over the end
into the beginning, and

    V = 1/L Σ_B (θ_B - θ)(θ_B - θ)ᵀ.

Correlation within a block is kept whole, so L must be several times as long as the disturbance
lasts. The quotient to the truth then follows Student's t, with 1.5 degrees of freedom per block
that fits into the window, as overlapping blocks are worth.

Source: Künsch, The jackknife and the bootstrap for general stationary observations, Annals of
Statistics 17 (1989) 1217-1241.
"""

from dataclasses import dataclass

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
class Spread:
    """How θ scatters about the truth: Student's t in three dimensions."""

    scale: FloatArray
    """(3, 3) V."""
    freedom: float
    """Degrees of freedom."""


def block_length(duration: Seconds) -> Seconds:
    """L for a window of this length."""
    wanted = min(max(duration / BLOCKS, SHORTEST_BLOCK), LONGEST_BLOCK)
    return min(wanted, duration / FEWEST_BLOCKS)


def spread(equations: Equations, sample_time: Seconds) -> Spread | None:
    """The scatter of the equations' solution; None where the data do not determine it.

    They do not if all that excites the vehicle lies within one block.
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
    return Spread(scale, FREEDOM_PER_BLOCK * count / length) if finite else None


def _block_sums(values: FloatArray, length: int) -> FloatArray:
    """Sums over ``length`` instants from each one on, running over the end into the beginning."""
    around = np.concatenate([values, values[: length - 1]])
    sums = np.concatenate([np.zeros_like(values[:1]), around.cumsum(axis=0)])
    return np.asarray(sums[length:] - sums[:-length])
