"""The CTHP with unequal gains: it eases off harder than it closes up, or the other way round.

    f = α₊ (e₊ - q e₋) + β₊ (d₊ - k d₋),   e = p - s₀ - τv,   d = u - v

with e₊ = max(e, 0), e₋ = max(-e, 0) and likewise of d. So α₊ and β₊ are the gains on a gap that
is too long and on a car ahead that is faster; q and k say how many times as hard it reacts to a
gap that is too short and to a car ahead that is slower. With q = k = 1 it is the CTHP with s₀. The
corners are rounded within ε = `ROUND`, so that derivatives exist everywhere:

    x₊ = (√(x² + ε²) + x) / 2,   x₋ = (√(x² + ε²) - x) / 2

Beyond that the model is homogeneous: growth depends on the direction of a disturbance and not on
its size (see `stability.waves`).
"""

from collections.abc import Sequence
from typing import Any

from accpinn.model.following import FollowingModel, Parameter

ROUND = 0.01
"""ε in m and in m/s."""


def parts(x: Any, xp: Any) -> tuple[Any, Any]:
    """x₊ and x₋."""
    size = xp.sqrt(x * x + ROUND * ROUND)
    return (size + x) / 2.0, (size - x) / 2.0


def unequal_gains(p: Any, v: Any, u: Any, theta: Sequence[Any], xp: Any) -> Any:
    """In m/s² from α₊, q, β₊, k, τ, s₀."""
    alpha, q, beta, k, tau, s0 = theta[:6]
    long, short = parts(p - s0 - tau * v, xp)
    opening, closing = parts(u - v, xp)
    return alpha * (long - q * short) + beta * (opening - k * closing)


UNEQUAL_GAINS = FollowingModel(
    "unequal",
    "CTHP with unequal gains",
    (
        Parameter("alpha_long", "α₊", "1/s²", 1e-4, 10.0, 0.08, 1.0),
        Parameter("q", "q", "", 0.05, 20.0, 1.0, 0.7),
        Parameter("beta_opening", "β₊", "1/s", 1e-4, 10.0, 0.2, 1.0),
        Parameter("k", "k", "", 0.05, 20.0, 1.0, 0.7),
        Parameter("headway", "τ", "s", 0.05, 10.0, 1.0, 0.5),
        Parameter("s0", "s₀", "m", -50.0, 100.0, 5.0, 6.0),
    ),
    unequal_gains,
    formula="α₊ (e₊ − q e₋) + β₊ (Δv₊ − k Δv₋) with e = p − s₀ − τ v",
    meaning="eases off {q} times as hard as it closes up",
)
