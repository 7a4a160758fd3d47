"""Profiles of the least-squares criterion: how much worse it gets with one parameter held.

    S(α, β, τ) = Σ_t (dv/dt - α(p - τv) - βΔv)²,      profile of x:  min over the other two of S

within the rational driving constraints. With one parameter held the law is linear in what is left,
so every point is the exact minimum of a quadratic in two unknowns. A flat profile is a parameter
that these equations do not determine. A steep one says less: S takes instants as independent and
the law as true, so its minimum may be sharp and yet pulled (see `uncertainty.instruments`).

Source: Raue et al., Bioinformatics 25 (2009) 1923-1929, for the use of profiles.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import brentq

from accpinn.errors import ConfigError
from accpinn.methods.regression import Regression
from accpinn.model.cthp import LARGEST, Case
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, frozen

Symbol = Literal["α", "β", "τ"]
SYMBOLS: tuple[Symbol, ...] = ("α", "β", "τ")

INCREASE = 0.01
"""Increase of S that the width belongs to: 1 % of the least, hardly to be seen in any plot."""
POINTS = 61
LIMITS = dict(zip(SYMBOLS, LARGEST.values.tolist(), strict=True))
"""Where the search for an end stops, in 1/s², 1/s and s; far beyond any vehicle."""
FURTHER = 1.5
"""The default grid reaches so many widths beyond the estimate on either side."""


@dataclass(frozen=True, eq=False)
class Profile:
    """One parameter of one follower held at K values, all else optimal."""

    parameter: Symbol
    best: float
    """Where S is least; nan for τ where α = 0."""
    values: FloatArray
    """(K,) in the parameter's unit, ascending."""
    increase: FloatArray
    """(K,) S over its least value, minus one."""
    lower: float
    """The smallest value at which S is at most `INCREASE` above its least."""
    upper: float
    """The largest; infinite where the data set no limit."""

    @property
    def width(self) -> float:
        """Of the values that the data can hardly tell apart."""
        return self.upper - self.lower


def profiles(segment: Segment, case: Case = "II") -> tuple[tuple[Profile, ...], ...]:
    """Those of α, β and τ of each follower; in Case I the one set that all share."""
    count = 1 if case == "I" else segment.followers
    sums = _sums(segment, case)
    return tuple(tuple(_profile(sums[k], symbol) for symbol in SYMBOLS) for k in range(count))


def profile(
    segment: Segment,
    follower: int,
    parameter: Symbol,
    grid: FloatArray | None = None,
    case: Case = "II",
) -> Profile:
    """The profile of one parameter.

    Args:
        segment: the data.
        follower: 0 for the first; without effect in Case I.
        parameter: "α", "β" or "τ".
        grid: (K,) values to hold, zero or more; by default around the estimate.
        case: "I" or "II".
    """
    if parameter not in SYMBOLS:
        raise ConfigError(f"parameter: {parameter} is not known; choose {', '.join(SYMBOLS)}.")
    if grid is not None and not (np.isfinite(grid).all() and (grid >= 0).all()):
        raise ConfigError("grid: every value to hold must be a finite number, zero or more.")
    return _profile(_sums(segment, case)[0 if case == "I" else follower], parameter, grid)


@dataclass(frozen=True, eq=False)
class _Sums:
    """S as a quadratic in θ = (α, ατ, β)."""

    gram: FloatArray
    """(3, 3) XᵀX."""
    moment: FloatArray
    """(3,) Xᵀ dv/dt."""
    power: float
    """Σ (dv/dt)²."""
    best: FloatArray
    """(3,) θ of the least S."""

    def at(self, theta: FloatArray) -> float:
        return float(self.power + theta @ self.gram @ theta - 2 * self.moment @ theta)


def _sums(segment: Segment, case: Case) -> list[_Sums]:
    regression = Regression.of(segment)
    grams, moments = regression.grams(), regression.moments()
    powers = (regression.rates**2).sum(axis=1)
    theta = regression.solve(case).theta
    if case == "I":
        return [_Sums(grams.sum(axis=0), moments.sum(axis=0), float(powers.sum()), theta[0])]
    rows = zip(grams, moments, powers, theta, strict=True)
    return [_Sums(gram, moment, float(power), best) for gram, moment, power, best in rows]


def _profile(sums: _Sums, parameter: Symbol, grid: FloatArray | None = None) -> Profile:
    alpha, alpha_tau, beta = (float(value) for value in sums.best)
    tau = alpha_tau / alpha if alpha else float("nan")
    best = {"α": alpha, "β": beta, "τ": tau}[parameter]
    least = max(sums.at(sums.best), np.finfo(float).tiny)

    def increase(value: float) -> float:
        return max(_held(sums, parameter, value) / least - 1.0, 0.0)

    lower, upper = _ends(increase, best, LIMITS[parameter])
    values = _grid(best, lower, upper, LIMITS[parameter]) if grid is None else np.sort(grid)
    found = np.array([increase(float(value)) for value in values])
    return Profile(parameter, best, frozen(values), frozen(found), lower, upper)


def _held(sums: _Sums, parameter: Symbol, value: float) -> float:
    """The least S with the parameter at this value: θ = base + directions @ (two unknowns ≥ 0)."""
    base = np.zeros(3)
    if parameter == "τ":
        directions = np.array([[1.0, 0.0], [value, 0.0], [0.0, 1.0]])
    else:
        at = 0 if parameter == "α" else 2
        base[at] = value
        directions = np.delete(np.eye(3), at, axis=1)
    gram = directions.T @ sums.gram @ directions
    moment = directions.T @ (sums.moment - sums.gram @ base)
    return sums.at(base + directions @ _two(gram, moment))


def _two(gram: FloatArray, moment: FloatArray) -> FloatArray:
    """The least xᵀGx - 2mᵀx over two unknowns x ≥ 0, each active set tried."""
    determinant = gram[0, 0] * gram[1, 1] - gram[0, 1] ** 2
    if determinant > 1e-12 * gram[0, 0] * gram[1, 1]:
        free = np.array(
            [
                gram[1, 1] * moment[0] - gram[0, 1] * moment[1],
                gram[0, 0] * moment[1] - gram[0, 1] * moment[0],
            ]
        )
        if (free >= 0).all():
            return np.asarray(free / determinant)
    gains = [
        moment[k] ** 2 / gram[k, k] if moment[k] > 0 and gram[k, k] > 0 else 0.0 for k in (0, 1)
    ]
    alone, result = int(gains[1] > gains[0]), np.zeros(2)
    if gains[alone] > 0:
        result[alone] = moment[alone] / gram[alone, alone]
    return result


def _ends(increase: Callable[[float], float], best: float, limit: float) -> tuple[float, float]:
    """Where the profile crosses `INCREASE` on either side of the best value."""
    if not np.isfinite(best):
        return 0.0, float("inf")

    def beyond(value: float) -> float:
        return increase(value) - INCREASE

    lower = float(brentq(beyond, 0.0, best)) if best > 0 and beyond(0.0) > 0 else 0.0
    far = max(2 * best, 1e-3)
    while beyond(far) < 0:
        if far >= limit:
            return lower, float("inf")
        far = min(2 * far, limit)
    return lower, float(brentq(beyond, best, far))


def _grid(best: float, lower: float, upper: float, limit: float) -> FloatArray:
    if not np.isfinite(best):
        return np.linspace(0.0, limit, POINTS)
    above = upper - best if np.isfinite(upper) else max(best, 1e-3) * 4
    first = max(0.0, best - FURTHER * (best - lower))
    return np.linspace(first, best + FURTHER * above, POINTS)
