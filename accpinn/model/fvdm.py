"""The full velocity difference model (FVDM).

    f = κ (V(p) - v) + λ (u - v),   V(p) = V₁ [tanh(c (p - d)) + tanh(c d)]

κ [1/s] and λ [1/s] are gains, V₁ [m/s], c [1/m] and d [m] shape the optimal speed V at a gap.

Source: Jiang, Wu and Zhu, Physical Review E 64 (2001) 017101; V after Bando et al., Physical Review
E 51 (1995) 1035.
"""

from collections.abc import Sequence
from typing import Any

from accpinn.model.following import FollowingModel, Parameter


def acceleration(p: Any, v: Any, u: Any, theta: Sequence[Any], xp: Any) -> Any:
    """In m/s² from κ, λ, V₁, c, d."""
    kappa, relative, scale, steepness, middle = theta[:5]
    optimal = scale * (xp.tanh(steepness * (p - middle)) + xp.tanh(steepness * middle))
    return kappa * (optimal - v) + relative * (u - v)


FVDM = FollowingModel(
    "fvdm",
    "FVDM",
    (
        Parameter("kappa", "κ", "1/s", 1e-3, 10.0, 0.1, 1.0),
        Parameter("relative", "λ", "1/s", 1e-4, 10.0, 0.2, 1.0),
        Parameter("scale", "V₁", "m/s", 2.0, 100.0, 20.0, 0.4),
        Parameter("steepness", "c", "1/m", 0.005, 0.5, 0.05, 0.5),
        Parameter("middle", "d", "m", 0.5, 200.0, 20.0, 0.4),
    ),
    acceleration,
)
