"""The intelligent driver model (IDM).

    f = a [1 - (v/v₀)⁴ - (s*/p)²],   s* = s₀ + vT + v (v - u) / (2 √(ab))

a [m/s²] acceleration, b [m/s²] comfortable braking, T [s] time headway, s₀ [m] gap at standstill,
v₀ [m/s] desired speed. Behind a car at motorway speeds v₀ and b are hardly determined, so their
priors are informative.

Source: Treiber, Hennecke and Helbing, Physical Review E 62 (2000) 1805-1824, equations 3 and 4.
"""

from collections.abc import Sequence
from typing import Any

from accpinn.model.following import FollowingModel, Parameter


def acceleration(p: Any, v: Any, u: Any, theta: Sequence[Any], xp: Any) -> Any:
    """In m/s² from a, b, T, s₀, v₀."""
    a, b, headway, s0, v0 = theta[:5]
    wanted = s0 + v * (headway + (v - u) / (2.0 * xp.sqrt(a * b)))
    pace, closeness = (v / v0) ** 2, wanted / p
    return a * (1.0 - pace * pace - closeness * closeness)


IDM = FollowingModel(
    "idm",
    "IDM",
    (
        Parameter("a", "a", "m/s²", 0.02, 20.0, 1.0, 0.8),
        Parameter("b", "b", "m/s²", 0.05, 400.0, 2.0, 1.0),
        Parameter("T", "T", "s", 0.05, 10.0, 1.1, 0.4),
        Parameter("s0", "s₀", "m", 0.1, 50.0, 4.0, 0.7),
        Parameter("v0", "v₀", "m/s", 5.0, 100.0, 38.0, 0.2),
    ),
    acceleration,
)
