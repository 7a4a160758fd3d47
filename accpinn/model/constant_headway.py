"""The CTHP as an entry of the registry: f = α (p - s₀ - τv) + β (u - v).

s₀ [m] is an intercept: the gap in equilibrium is s₀ + τv. It need not be the gap that is kept at
standstill, as recordings on motorways determine s₀ + τv at their speeds and neither term alone.

Its exact solutions are in `model.cthp`; tests compare those of every model with them.
"""

from collections.abc import Sequence
from typing import Any

from accpinn.model.following import FollowingModel, Parameter

_ALPHA = Parameter("alpha", "α", "1/s²", 1e-4, 10.0, 0.08, 1.0)
_BETA = Parameter("beta", "β", "1/s", 1e-4, 10.0, 0.2, 1.0)
_TAU = Parameter("tau", "τ", "s", 0.05, 10.0, 1.4, 0.3)
_TAU_BESIDE_S0 = Parameter("tau", "τ", "s", 0.05, 10.0, 1.0, 0.5)
_S0 = Parameter("s0", "s₀", "m", -50.0, 100.0, 5.0, 6.0)


def acceleration(p: Any, v: Any, u: Any, theta: Sequence[Any], xp: Any) -> Any:
    """In m/s² from α, β, τ: the paper's model, without s₀."""
    alpha, beta, tau = theta[:3]
    return alpha * (p - tau * v) + beta * (u - v)


def acceleration_with_intercept(p: Any, v: Any, u: Any, theta: Sequence[Any], xp: Any) -> Any:
    """In m/s² from α, β, τ, s₀."""
    return acceleration(p - theta[3], v, u, theta, xp)


CTHP = FollowingModel("cthp", "CTHP", (_ALPHA, _BETA, _TAU), acceleration, is_cthp=True)
CTHP_S0 = FollowingModel(
    "cthp-s0",
    "CTHP with intercept s₀",
    (_ALPHA, _BETA, _TAU_BESIDE_S0, _S0),
    acceleration_with_intercept,
    terms=("s0",),
    is_cthp=True,
)
