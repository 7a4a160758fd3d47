"""Region of string stability of a vehicle in a plane of two of its parameters.

A plane has two of α, β, τ on its axes and keeps the third, the lag and the delay of a vehicle; s₀
shifts the gap alone and decides nothing. Along each column of it the stable values are one
interval, from a smallest to a largest one that a delay sets. Without a lag or a delay its ends are
the closed forms of `criteria`; else verdicts on a coarse grid bracket them, and bisection finds
them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import (
    exact_margin,
    smallest_beta_exact,
    smallest_beta_l2,
    smallest_headway_exact,
    smallest_headway_l2,
    smallest_headway_paper,
)
from accpinn.stability.lagged import is_lagged
from accpinn.stability.margin import is_l2_stable, l2_headways
from accpinn.units import FloatArray, Mask, frozen

Plane = Literal["beta", "alpha", "gains"]
"""β and τ, α and τ, or α and β, across and up."""
AXES: dict[Plane, tuple[int, int]] = {"beta": (1, 2), "alpha": (0, 2), "gains": (0, 1)}
"""The place in `Parameters.complete` of what is across and up in a plane."""
COLUMNS, LATE_COLUMNS = 240, 80
"""Columns of a plane without a lag or a delay, and with one."""
LEAST = 1e-3
"""The first column, as a share of the last; nothing is known at zero."""
ABOVE = 1.3
"""Height up to which boundaries are followed, so that they leave a plane at its edge."""
ROWS, LINF_ROWS = 32, 18
"""Rows of the coarse grid by each norm."""
HALVINGS, LINF_HALVINGS = 12, 7
"""Bisections of an end by each norm: to less than a pixel."""


@dataclass(frozen=True, eq=False)
class Limits:
    """The stable values of each column of a plane; nan where none is."""

    lower: FloatArray
    """(K,)"""
    upper: FloatArray
    """(K,) infinite where there is none, or beyond the plane."""


@dataclass(frozen=True, eq=False)
class Region:
    """The stable region of a plane, by three criteria."""

    across: FloatArray
    """(K,) values across, above zero."""
    l2: Limits
    paper: Limits
    """Limits by the paper's L∞ criterion, which knows no lag or delay."""
    linf: Limits
    """By the exact criterion."""


@lru_cache(maxsize=64)  # a page asks again whenever anything else on it changes
def stable_region(vehicle: Parameters, plane: Plane, right: float, top: float) -> Region:
    """The stable region in a plane up to ``right`` and ``top``, with all else that of a vehicle."""
    late = is_lagged(vehicle)
    count = LATE_COLUMNS if late else COLUMNS
    across, none = np.linspace(LEAST * right, right, count), np.full(count, np.inf)
    tau = vehicle.tau
    if plane == "gains":
        paper = np.maximum(2.0 * np.sqrt(across) - across * tau, 0.0)
    else:
        grid = _at(vehicle, plane, across, np.zeros(count))
        paper = smallest_headway_paper(grid)
    if late:
        l2, linf = _late(vehicle, plane, across, top)
    else:
        if plane == "gains":
            lowest = smallest_beta_l2(across, tau), smallest_beta_exact(across, tau)
        else:
            lowest = smallest_headway_l2(grid), smallest_headway_exact(grid)
        l2, linf = (Limits(frozen(low), frozen(none)) for low in lowest)
    return Region(frozen(across), l2, Limits(frozen(paper), frozen(none)), linf)


def _at(vehicle: Parameters, plane: Plane, across: FloatArray, up: FloatArray) -> Parameters:
    """The vehicle with other values (V,) across and up."""
    rows = np.repeat(vehicle.complete[None], len(across), axis=0)
    first, second = AXES[plane]
    rows[:, first], rows[:, second] = across, up
    return Parameters.of(rows)


def _late(
    vehicle: Parameters, plane: Plane, across: FloatArray, top: float
) -> tuple[Limits, Limits]:
    """The limits by L₂ and by the exact L∞ criterion with a lag or a delay."""

    def is_l2(x: FloatArray, y: FloatArray) -> Mask:
        return is_l2_stable(_at(vehicle, plane, x, y))

    def is_linf(x: FloatArray, y: FloatArray) -> Mask:
        stable = is_l2(x, y)  # which L∞ implies
        rows = np.flatnonzero(stable)
        if rows.size:
            stable[rows] = exact_margin(_at(vehicle, plane, x[rows], y[rows])) >= 0
        return stable

    up = np.tile(np.linspace(top / ROWS, ABOVE * top, ROWS), (len(across), 1))
    if plane == "gains":
        l2 = _ends(is_l2, across, up, HALVINGS)
    else:
        least, most = l2_headways(_at(vehicle, plane, across, across))
        l2 = Limits(np.where(np.isfinite(least), least, np.nan), most)
    # Where L₂ is, and most closely where it begins.
    few, begin = across[1::2], l2.lower[1::2]
    end = np.minimum(l2.upper[1::2], ABOVE * top)
    shares = np.linspace(0.0, 1.0, LINF_ROWS) ** 1.5
    inside = begin[:, None] + (end - begin)[:, None] * shares
    linf = _ends(is_linf, few, np.nan_to_num(inside), LINF_HALVINGS)
    lower, upper = (_spread(across, few, of) for of in (linf.lower, linf.upper))
    lower = np.maximum(lower, l2.lower)
    return _frozen(l2), _frozen(Limits(lower, np.minimum(upper, l2.upper)))


def _frozen(limits: Limits) -> Limits:
    return Limits(frozen(limits.lower), frozen(limits.upper))


def _spread(x: FloatArray, few: FloatArray, values: FloatArray) -> FloatArray:
    """(K,) values (k,) between their columns; nan beside one where there is none."""
    finite = np.where(np.isinf(values), 1e9, values)
    spread = np.interp(x, few, finite, left=finite[0])
    return np.where(spread >= 1e7, np.inf, spread)


def _ends(
    is_stable: Callable[[FloatArray, FloatArray], Mask], across: FloatArray, up: FloatArray,
    halvings: int,
) -> Limits:  # fmt: skip
    """The first interval of stable values of each column, its ends found by bisection.

    The coarse grid ``up`` (K, R) has the rows of each column (K,).
    """
    count, rows = up.shape
    grid = is_stable(np.repeat(across, rows), up.ravel()).reshape(count, rows)
    exists, first = np.asarray(grid.any(axis=1)), grid.argmax(axis=1)
    after = ~grid & (np.arange(rows) > first[:, None])
    ends = np.asarray(after.any(axis=1))
    last = np.where(ends, after.argmax(axis=1), rows) - 1
    at = np.arange(count)
    below = np.where(first > 0, up[at, np.maximum(first - 1, 0)], 0.0)
    lower = _bisected(is_stable, across, below, up[at, first], exists, halvings)
    beyond = up[at, np.minimum(last + 1, rows - 1)]
    upper = _bisected(is_stable, across, beyond, up[at, last], exists & ends, halvings)
    lower = np.where(exists, lower, np.nan)
    upper = np.where(exists & ends, upper, np.where(exists, np.inf, np.nan))
    return Limits(lower, upper)


def _bisected(
    is_stable: Callable[[FloatArray, FloatArray], Mask], across: FloatArray, outside: FloatArray,
    inside: FloatArray, wanted: Mask, halvings: int,
) -> FloatArray:  # fmt: skip
    """(K,) the stable end between unstable and stable values (K,) of the ``wanted`` columns."""
    rows = np.flatnonzero(wanted)
    out, stable_end, x = outside[rows], inside[rows], across[rows]
    for _ in range(halvings if rows.size else 0):
        middle = (out + stable_end) / 2.0
        stable = is_stable(x, middle)
        out, stable_end = np.where(stable, out, middle), np.where(stable, middle, stable_end)
    ends = inside.copy()
    ends[rows] = stable_end
    return ends
