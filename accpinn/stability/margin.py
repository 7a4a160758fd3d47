"""Margins of string stability: the time gap between vehicles and the boundary.

With all else of a vehicle kept, the smallest stable τ and the time gap that it makes at a speed are

    τ_min = inf {τ ≥ 0: stable},   G_min = τ_min + s₀/v,   margin = G - G_min = τ - τ_min

Without a lag or a delay τ_min is in closed form, see `criteria`. With them and C = ατ + β, the
phase φ = θ + arctan λω of the lag and of the delay's approximant q(-s)/q(s) (see `lagged`),

    |D|² - |N|² = x R(x),   R = x (1 + λ²x) - 2αe - 2Cg + C² - β²,   x = ω²
    e = cos θ - λω sin θ,   g = ω (sin θ + λω cos θ)

is quadratic in C, so that a frequency is amplified exactly for C between g ± √(β² + 2αe - x e²).
τ_min is the upper end of what these intervals cover from C = β on without a gap. The crossings of
a pole into instability lie within them, hence the vehicle is stable or unstable in the whole of the
gap that follows; the former by its phase margin, arctan(ωC/α) > φ where the loop's gain is 1. With
a lag alone and B = β² + 2α the end is √B where 4λ²B ≤ 1, otherwise λB + 1/4λ.

Exactly L∞ stable is where ‖h‖₁ = 1, up to `RESOLVED` with a lag or a delay; that τ is bracketed
and found on the logarithm of ‖h‖₁ - 1. As ‖h‖₁ ≥ ‖H‖∞ it is never below that of L₂.

Sources: Swaroop and Hedrick, IEEE Transactions on Automatic Control 41 (1996) 349-357, for string
stability; the boundaries with a lag or a delay are derived here.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from math import nan
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from accpinn.display import Displayed
from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import (
    MARGINAL,
    RESOLVED,
    exact_margin,
    l2_margin,
    smallest_headway_exact,
    smallest_headway_l2,
)
from accpinn.stability.lagged import is_lagged, step_gain
from accpinn.units import (
    FloatArray,
    Mask,
    MetresPerSecond,
    Quantity,
    Seconds,
    frozen,
    interval_ends,
)

if TYPE_CHECKING:
    from pandas import DataFrame

LOW, HIGH = 48, 64
"""Numbers of grid frequencies: LOW up to BEYOND·√(β² + 2α), HIGH up to π/d."""
BEYOND = 1.3
"""Highest of the former, relative to √(β² + 2α), which no vehicle without a delay amplifies."""
SHORTEST: Seconds = 0.01
"""Shorter delays count as this one where frequencies are chosen."""
GOLDEN, SECTIONS = (5**0.5 - 1) / 2, 36
"""Ratio of a golden section, and how many are taken: to ten digits of the extremum."""
PHASES = 12
"""Newton's steps towards the frequency at which the loop's gain is 1."""
STEPS = (1.0, 1.1, 1.2, 1.3, 1.45, 1.6, 1.8, 2.05, 2.4, 2.9, 3.6, 5.0, 8.0, 14.0, 25.0)
"""Multiples of the smallest L₂ stable τ between which the smallest exactly L∞ stable one lies."""
SECANTS = 7
"""Steps by which it is found between two of these, to about a thousandth of it."""
THINNED = 200
"""Draws that are taken of a vehicle with a lag or a delay for L∞, and of a platoon."""
NARROW = np.array([0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0])
CHANGES = np.concatenate([-NARROW[::-1], [0.0], NARROW, [5.0, 6.5, 8.0, 10.0, 15.0]])
"""Changes of all time gaps in s between which that of a platoon is looked for.

A range of stable or unstable changes that lies between two of these is not found.
"""
UNCHANGED = len(NARROW)
"""Place of no change."""
HALVINGS = 14
"""Number of halvings of such an interval: to a ten-thousandth of it."""
SLOWEST = 1e-6
"""Least frequency of a vehicle in rad/s that is taken, where none reacts."""
ALONG = 120
"""Frequencies at which a platoon's gain is taken."""


class State(Enum):
    """State of a vehicle, by one norm."""

    STABLE = "stable"
    TOO_SHORT = "needs a larger time gap"
    TOO_LONG = "stable at smaller time gaps alone"
    NEVER = "no time gap is stable"
    NO_EFFECT = "stable; the time gap has no effect"
    UNKNOWN = "not determined"


@dataclass(frozen=True)
class NormMargin:
    """The margin of one vehicle by one norm, with the intervals that draws give."""

    smallest: Quantity
    """The smallest stable time gap in s; infinite where none is stable."""
    distance: Quantity
    """The vehicle's time gap beyond it in s, negative where unstable; -inf where no larger time gap
    is stable, inf where the time gap has no effect and the vehicle is stable."""
    state: State


@dataclass(frozen=True)
class VehicleMargin:
    """The margins of one vehicle."""

    time_gap: Quantity
    """In equilibrium, in s."""
    l2: NormMargin
    linf: NormMargin
    """By the exact criterion."""


@dataclass(frozen=True, eq=False)
class Margins(Displayed):
    """Distances of vehicles from the boundary of string stability at a speed, as time gaps."""

    speed: FloatArray
    """(M,) in m/s, at which the time gaps are taken."""
    level: float | None
    """Level of the intervals, whose ends are nan for a point without draws."""
    vehicles: tuple[VehicleMargin, ...]
    platoon: Quantity | None = None
    """By how much all time gaps could be smaller with no frequency larger at the last follower than
    at the leader, in s; negative where they must be larger; -inf where no larger ones help. None
    of a single vehicle."""
    names: tuple[str, ...] = field(default=())
    """(M,) of the vehicles, where they have any."""
    numbers: tuple[int, ...] = field(default=())
    """(M,) in the recording."""

    def __str__(self) -> str:
        """A line a vehicle."""
        lines = ["Margins of the time gap to string stability"]
        for k, vehicle in enumerate(self.vehicles):
            name = self.names[k] if self.names else f"Follower {k + 1}"
            both = f"L₂ {_text(vehicle.l2)}; L∞ {_text(vehicle.linf)}"
            at = f"{vehicle.time_gap.value:.2f} s at {3.6 * self.speed[k]:.0f} km/h"
            lines.append(f"  {name}: time gap {at}; {both}")
        if self.platoon:
            lines.append(f"  All cars in order: L₂ {_seconds(self.platoon)}")
        return "\n".join([*lines, "More: .to_frame(), .vehicles[0].l2.distance"])

    def to_frame(self) -> "DataFrame":
        """A row a vehicle: the time gap, and by each norm smallest, margin and state.

        Ends of intervals stand in ``.._low`` and ``.._high``, nan without draws.
        """
        from pandas import DataFrame

        rows = []
        for k, vehicle in enumerate(self.vehicles):
            row: dict[str, object] = {
                "vehicle": self.numbers[k] if self.numbers else k + 1,
                "name": self.names[k] if self.names else f"Follower {k + 1}",
                "speed": float(self.speed[k]),
                **_columns("time_gap", vehicle.time_gap),
            }
            for norm, margin in (("l2", vehicle.l2), ("linf", vehicle.linf)):
                row |= _columns(f"smallest_{norm}", margin.smallest)
                row |= _columns(f"margin_{norm}", margin.distance)
                row[f"state_{norm}"] = margin.state.name.lower()
            rows.append(row)
        return DataFrame(rows)


def _columns(name: str, value: Quantity) -> dict[str, object]:
    return {name: value.value, f"{name}_low": value.lower, f"{name}_high": value.upper}


def _text(margin: NormMargin) -> str:
    if not np.isfinite(margin.distance.value):
        return margin.state.value
    return _seconds(margin.distance)


def _seconds(value: Quantity) -> str:
    ends = "" if np.isnan(value.lower) else f" ({value.lower:+.2f} to {value.upper:+.2f})"
    return f"{value.value:+.2f} s{ends}"


class Headways(NamedTuple):
    """The τ (V,) in s between which vehicles are stable; both infinite where none is."""

    smallest: FloatArray
    largest: FloatArray


def l2_headways(parameters: Parameters) -> Headways:
    """The L₂ stable τ of V vehicles with all else kept, from the smallest one on.

    Where α = 0 it is any or none, as τ has no effect. τ of the argument is ignored where α > 0.
    """
    flat = parameters.flat
    alpha, lag, delay = flat.alpha, flat.lag, flat.delay
    smallest = smallest_headway_l2(flat)
    largest = np.full(len(alpha), np.inf)
    for rows, limits in (
        (np.flatnonzero((alpha > 0) & (delay > 0)), _of_delayed),
        (np.flatnonzero((alpha > 0) & (delay == 0) & (lag > 0)), _of_lagged),
    ):
        if rows.size:
            smallest[rows], largest[rows] = limits(flat[rows])
    bare = np.flatnonzero(alpha == 0)
    if bare.size:
        stable = (l2_margin(flat[bare]) >= -MARGINAL) | (flat.beta[bare] == 0)
        smallest[bare] = np.where(stable, 0.0, np.inf)
    return Headways(smallest, largest)


def _of_lagged(parameters: Parameters) -> Headways:
    """Headways of vehicles with a lag and no delay, in closed form."""
    alpha, beta, lag = parameters.alpha, parameters.beta, parameters.lag
    size = beta**2 + 2.0 * alpha
    total = np.where(4.0 * lag**2 * size <= 1.0, np.sqrt(size), lag * size + 0.25 / lag)
    return Headways(np.maximum((total - beta) / alpha, 0.0), np.full(len(alpha), np.inf))


def _of_delayed(parameters: Parameters) -> Headways:
    """Headways of vehicles with a delay: no frequency is amplified between two C = ατ + β."""
    alpha, beta, lag, delay = _columns_of(parameters)
    omega = np.sort(_grid(alpha, beta, delay), axis=1)

    def ends(at: FloatArray) -> tuple[FloatArray, FloatArray]:
        _, middle, square = _phases(at, lag, delay, alpha, beta)
        half = np.sqrt(np.maximum(square, 0.0))
        none = np.where(square >= 0, 0.0, np.inf)
        return middle - half + none, middle + half - none

    low, high = ends(omega)
    # What a frequency and its neighbour amplify is connected.
    adjacent = np.isfinite(low[:, :-1]) & np.isfinite(low[:, 1:])
    joined_low = np.where(adjacent, np.minimum(low[:, :-1], low[:, 1:]), low[:, :-1])
    joined_high = np.where(adjacent, np.maximum(high[:, :-1], high[:, 1:]), high[:, :-1])
    order = joined_low.argsort(axis=1)
    begins = np.take_along_axis(joined_low, order, axis=1)
    reach = np.maximum.accumulate(np.take_along_axis(joined_high, order, axis=1), axis=1)
    gaps = begins[:, 1:] > np.maximum(reach[:, :-1], beta)
    gaps = np.concatenate([gaps, np.ones_like(gaps[:, :1])], axis=1)
    first = gaps.argmax(axis=1)[:, None]
    begins = np.concatenate([begins, np.full_like(begins[:, :1], np.inf)], axis=1)
    end, after = (np.take_along_axis(of, at, axis=1)[:, 0]
                  for of, at in ((reach, first), (begins, first + 1)))  # fmt: skip
    top = np.where(high <= end[:, None], high, -np.inf).argmax(axis=1)
    end = np.maximum(end, _extremum(lambda at: ends(at)[1], omega, top))
    bottom = np.where(low >= after[:, None], low, np.inf).argmin(axis=1)
    refined = -_extremum(lambda at: -ends(at)[0], omega, bottom)
    after = np.where(np.isfinite(after), np.minimum(after, refined), after)
    end = np.maximum(end, beta[:, 0])
    holds = (after > end) & _is_stable(parameters, end)
    alpha, beta = alpha[:, 0], beta[:, 0]
    both = ((end - beta) / alpha, (after - beta) / alpha)
    return Headways(*(np.where(holds, value, np.inf) for value in both))


def _columns_of(parameters: Parameters) -> tuple[FloatArray, ...]:
    """α, β, λ and d, each (V, 1)."""
    return tuple(
        column[:, None]
        for column in (parameters.alpha, parameters.beta, parameters.lag, parameters.delay)
    )


def _grid(alpha: FloatArray, beta: FloatArray, delay: FloatArray) -> FloatArray:
    """(V, K) ω in rad/s: those that vehicles without a delay amplify, and up to a phase of π."""
    shares = np.linspace(0.0, 1.0, LOW), np.linspace(0.0, 1.0, HIGH + 1)[1:]
    low = BEYOND * np.sqrt(beta**2 + 2.0 * alpha) * shares[0]
    return np.concatenate([low, np.pi / np.maximum(delay, SHORTEST) * shares[1]], axis=1)


def is_l2_stable(parameters: Parameters) -> Mask:
    """(V,) whether vehicles with α > 0 and a lag or a delay are L₂ stable, by a grid of ω.

    It errs within a thousandth of the boundary, and takes a fifth of the time of `l2_headways`.
    """
    alpha, beta, lag, delay = _columns_of(parameters)
    total = alpha[:, 0] * parameters.tau + beta[:, 0]
    omega = _grid(alpha, beta, delay)
    _, middle, square = _phases(omega, lag, delay, alpha, beta)
    damped = ((total[:, None] - middle) ** 2 >= square).all(axis=1)
    return np.asarray(damped & _is_stable(parameters, total))


def _phases(
    omega: FloatArray, lag: FloatArray, delay: FloatArray, alpha: FloatArray, beta: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """e, g, and the square of half the width of what is amplified, see the head."""
    turn = omega * delay
    real, imaginary = 1.0 - turn**2 / 12.0, turn / 2.0
    size = real**2 + imaginary**2
    cosine, sine = (real**2 - imaginary**2) / size, 2.0 * real * imaginary / size
    e, g = cosine - lag * omega * sine, omega * (sine + lag * omega * cosine)
    return e, g, beta**2 + 2.0 * alpha * e - (omega * e) ** 2


def _extremum(
    value: Callable[[FloatArray], FloatArray], omega: FloatArray, at: np.ndarray
) -> FloatArray:
    """(V,) the largest value between the neighbours of the frequencies of index (V,), or there."""
    last, rows = omega.shape[1] - 1, np.arange(len(omega))
    low = omega[rows, np.maximum(at - 1, 0)][:, None]
    high = omega[rows, np.minimum(at + 1, last)][:, None]
    best = value(omega[rows, at][:, None])
    for _ in range(SECTIONS):
        inner = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        first, second = (value(part) for part in inner)
        best = np.maximum(best, np.maximum(first, second))
        rises = second > first
        low, high = np.where(rises, inner[0], low), np.where(rises, high, inner[1])
    return best[:, 0]


def _is_stable(parameters: Parameters, total: FloatArray) -> Mask:
    """(V,) whether vehicles decay with C (V,) by their phase margin."""
    alpha, lag, delay = parameters.alpha, parameters.lag, parameters.delay
    square = (total**2 + np.sqrt(total**4 + 4.0 * alpha**2)) / 2.0
    for _ in range(PHASES):  # x² (1 + λ²x) - C²x - α² rises beyond its root
        excess = square**2 * (1.0 + lag**2 * square) - total**2 * square - alpha**2
        slope = 2.0 * square + 3.0 * lag**2 * square**2 - total**2
        square = square - excess / np.where(slope > 0, slope, 1.0)
    omega = np.sqrt(square)
    turn = omega * delay
    behind = 2.0 * np.arctan2(turn / 2.0, 1.0 - turn**2 / 12.0) + np.arctan(lag * omega)
    return np.asarray(np.arctan2(omega * total, alpha) > behind)


def is_damped(parameters: Parameters) -> Mask:
    """(V,) whether the own motion of vehicles decays, or there is none."""
    flat = parameters.flat
    total = np.where(flat.alpha > 0, flat.alpha * flat.tau, 0.0) + flat.beta
    silent, is_late = (flat.alpha == 0) & (flat.beta == 0), (flat.lag > 0) | (flat.delay > 0)
    return np.asarray(silent | ((total > 0) & (~is_late | _is_stable(flat, total))))


def linf_headways(parameters: Parameters, l2: Headways) -> FloatArray:
    """(V,) the smallest exactly L∞ stable τ in s of V vehicles; infinite where none is.

    ``l2`` are the headways of these vehicles that are L₂ stable.
    """
    flat = parameters.flat
    smallest = np.where(flat.beta < 0, np.inf, smallest_headway_exact(flat))
    bare = np.flatnonzero(flat.alpha == 0)
    if bare.size:
        stable = (exact_margin(flat[bare]) >= 0) | (flat.beta[bare] == 0)
        smallest[bare] = np.where(stable, 0.0, np.inf)
    late = np.flatnonzero((flat.alpha > 0) & ((flat.lag > 0) | (flat.delay > 0)))
    if late.size:
        limits = Headways(l2.smallest[late], l2.largest[late])
        smallest[late] = _linf_of_late(flat[late], limits)
    return smallest


def _linf_of_late(parameters: Parameters, l2: Headways) -> FloatArray:
    """(V,) the same of vehicles with a lag or a delay, between their L₂ stable headways."""
    begin, end = l2
    smallest = np.full(len(begin), np.inf)
    open_rows = np.flatnonzero(np.isfinite(begin) & (parameters.beta >= 0))
    if not open_rows.size:
        return smallest
    low, low_value = begin.copy(), np.full(len(begin), np.nan)
    high, high_value = np.full((2, len(begin)), np.nan)
    rows, below = open_rows, begin
    for factor in STEPS:
        tau = factor * begin[rows]
        inside = tau < end[rows]
        rows, tau = rows[inside], tau[inside]
        if not rows.size:
            break
        value = _excess(parameters[rows], tau)
        stable = value <= 0
        high[rows[stable]], high_value[rows[stable]] = tau[stable], value[stable]
        low[rows[~stable]], low_value[rows[~stable]] = tau[~stable], value[~stable]
        rows = rows[~stable]
    at_once = open_rows[np.isnan(low_value[open_rows]) & np.isfinite(high[open_rows])]
    smallest[at_once] = below[at_once]  # L₂ is what binds
    rows = open_rows[np.isfinite(low_value[open_rows]) & np.isfinite(high[open_rows])]
    if not rows.size:
        return smallest
    a, b, fa, fb = low[rows], high[rows], low_value[rows], high_value[rows]
    replaced = np.zeros((2, len(rows)), bool)  # whether a, b are of the last step
    for _ in range(SECANTS):
        share = np.clip(fa / (fa - fb), 0.05, 0.95)
        tau = a + share * (b - a)
        value = _excess(parameters[rows], tau)
        stable = value <= 0
        # By the Illinois rule: the value of an end that stays twice is halved.
        fa = np.where(stable, np.where(replaced[1], 0.5, 1.0) * fa, value)
        fb = np.where(stable, value, np.where(replaced[0], 0.5, 1.0) * fb)
        replaced = np.array([~stable, stable])
        b, a = np.where(stable, tau, b), np.where(stable, a, tau)
    smallest[rows] = b
    return smallest


def _excess(parameters: Parameters, tau: FloatArray) -> FloatArray:
    """(V,) log((‖h‖₁ - 1) / `RESOLVED`) at τ (V,); above 0 it is not L∞ stable."""
    moved = parameters.everything.copy()
    moved[:, 2] = tau
    gain = step_gain(Parameters.of(moved))[1]
    return np.clip(np.log(np.maximum(gain - 1.0, 1e-12) / RESOLVED), -3.0, 12.0)


def margins(
    parameters: Parameters, speed: MetresPerSecond | FloatArray, draws: Parameters | None = None,
    level: float = 0.9, names: Sequence[str] = (), numbers: Sequence[int] = (),
) -> Margins:  # fmt: skip
    """The margins of M vehicles, and of the platoon that they form.

    Args:
        parameters: (M,); of another model than a CTHP its linearisation.
        speed: in m/s at which time gaps are taken, one or (M,).
        draws: (n, M) of equal weight, for intervals; nan where nothing is determined.
        level: of the intervals.
        names: (M,) of the vehicles.
        numbers: (M,) in the recording.
    """
    at = np.broadcast_to(np.asarray(speed, float), len(parameters.flat)).tolist()
    return _margins(parameters.flat, tuple(at), draws, level, tuple(names), tuple(numbers))


@lru_cache(maxsize=64)  # pages ask for the same again and again
def _margins(
    parameters: Parameters, at: tuple[MetresPerSecond, ...], draws: Parameters | None,
    level: float, names: tuple[str, ...], numbers: tuple[int, ...],
) -> Margins:  # fmt: skip
    """The margins of M vehicles, see `margins`."""
    speeds = frozen(at)
    of_points = _norms(parameters, parameters)
    of_draws = (None, None) if draws is None else _norms(draws, _thinned(draws))
    both = [
        _norm_margins(parameters, speeds, point, drawn, level)
        for point, drawn in zip(of_points, of_draws, strict=True)
    ]
    vehicles = []
    for k, (vehicle, norms) in enumerate(zip(parameters, zip(*both, strict=True), strict=True)):
        gap = Quantity(float(vehicle.tau + _offset(vehicle.s0, at[k])), nan, nan)
        if draws is not None:
            ends = _ends(draws.tau[:, k] + _offset(draws.s0[:, k], at[k]), level)
            gap = Quantity(gap.value, *ends)
        vehicles.append(VehicleMargin(gap, *norms))
    platoon = _platoon(parameters, draws, level)
    level_of_draws = None if draws is None else level
    return Margins(speeds, level_of_draws, tuple(vehicles), platoon, names, numbers)


@lru_cache(maxsize=64)  # a page's strip and table ask for the same
def l2_margins(
    parameters: Parameters, draws: Parameters | None = None, level: float = 0.9,
    speed: MetresPerSecond = 25.0,
) -> tuple[NormMargin, ...]:  # fmt: skip
    """(M,) the margins of vehicles by L₂ alone, which take a tenth of the time of `margins`.

    Arguments are as there. The distance does not depend on the speed, the smallest time gap does.
    """
    flat = parameters.flat
    speeds = np.full(len(flat), speed)
    drawn = None if draws is None else _l2_norm(draws)
    return tuple(_norm_margins(flat, speeds, _l2_norm(flat), drawn, level))


def _platoon(parameters: Parameters, draws: Parameters | None, level: float) -> Quantity | None:
    """The margin of a platoon; None of a single vehicle, or where one is not determined."""
    if len(parameters) == 1 or not np.isfinite(parameters.alpha).all():
        return None
    ends = (nan, nan)
    if draws is not None:
        thin = _thinned(draws)
        finite = np.isfinite(thin.alpha).all(axis=1)
        if 2 * finite.sum() > len(finite):
            ends = _ends(_platoon_distance(_independent(thin[finite])), level)
    return Quantity(float(_platoon_distance(parameters[None])[0]), *ends)


def _offset(s0: Any, speed: MetresPerSecond) -> Any:
    """The part s₀/v of a time gap in s; none where s₀ is 0, whatever the speed."""
    return np.where(s0 == 0, 0.0, s0 / max(speed, 0.01))


def _ends(values: FloatArray, level: float) -> tuple[float, float]:
    low, high = interval_ends(values, level)
    return float(low), float(high)


def _state(smallest: float, distance: float, alpha: float) -> State:
    if np.isnan(distance):
        return State.UNKNOWN
    if alpha == 0:
        return State.NO_EFFECT if distance > 0 else State.NEVER
    if distance >= 0:
        return State.STABLE
    if np.isfinite(distance):
        return State.TOO_SHORT
    return State.TOO_LONG if np.isfinite(smallest) else State.NEVER


Norm = tuple[FloatArray, FloatArray, FloatArray]
"""The smallest stable τ, the distance to it, and s₀, all of the parameters' shape."""


def _norm_margins(
    parameters: Parameters, speeds: FloatArray, point: Norm, drawn: Norm | None, level: float
) -> Iterator[NormMargin]:
    """The margins of M vehicles by one norm, of a point (M,) and of draws (n, M)."""
    for k, speed in enumerate(speeds.tolist()):
        smallest, distance, s0 = (float(part[k]) for part in point)
        spans = [(nan, nan)] * 2
        if drawn is not None:
            of_draws = [part[:, k] for part in drawn]
            shifted = of_draws[0] + _offset(of_draws[2], speed)
            spans = [_ends(shifted, level), _ends(of_draws[1], level)]
        yield NormMargin(
            Quantity(float(smallest + _offset(s0, speed)), *spans[0]),
            Quantity(distance, *spans[1]),
            _state(smallest, distance, float(parameters.alpha[k])),
        )


def _l2_norm(parameters: Parameters) -> Norm:
    """L₂'s of vehicles (..)."""
    return _norm(parameters, *l2_headways(parameters))


def _norms(parameters: Parameters, thin: Parameters) -> tuple[Norm, Norm]:
    """Both norms' of vehicles (..); with a lag or a delay L∞'s of ``thin`` vehicles alone."""
    l2, late = l2_headways(parameters), is_lagged(parameters)
    few = thin if late else parameters
    again = l2 if few is parameters else l2_headways(few)
    linf = linf_headways(few, again)
    peaks = _norm(few, np.maximum(linf, again.smallest), again.largest)
    if late:  # a longer headway may make a vehicle with a lag or a delay oscillate again
        beyond = peaks[1].ravel()
        rows = np.flatnonzero(np.isfinite(beyond) & (beyond >= 0))
        if rows.size:
            again_unstable = rows[exact_margin(few.flat[rows]) < 0]
            beyond[again_unstable] = -np.inf
        peaks = (peaks[0], beyond.reshape(peaks[1].shape), peaks[2])
    return _norm(parameters, l2.smallest, l2.largest), peaks


def _norm(parameters: Parameters, smallest: FloatArray, largest: FloatArray) -> Norm:
    shape = parameters.complete.shape[:-1]
    smallest, largest = smallest.reshape(shape), largest.reshape(shape)
    with np.errstate(invalid="ignore"):
        distance = np.where(parameters.tau > largest, -np.inf, parameters.tau - smallest)
    bare = np.where(np.isfinite(smallest), np.inf, -np.inf)
    distance = np.where(parameters.alpha == 0, bare, distance)
    finite = np.isfinite(parameters.alpha)
    return np.where(finite, smallest, np.nan), np.where(finite, distance, np.nan), parameters.s0


def _thinned(draws: Parameters) -> Parameters:
    count = len(draws.complete)
    rows = np.linspace(0, count - 1, min(count, THINNED)).astype(int)
    return Parameters.of(draws.everything[rows])


def _independent(draws: Parameters) -> Parameters:
    """Draws (n, M) of which those of a vehicle say nothing of another's, unless all are shared."""
    values = draws.complete
    if (values == values[:, :1]).all():
        return draws
    rng, mixed = np.random.default_rng(0), values.copy()
    for k in range(values.shape[1]):
        mixed[:, k] = rng.permutation(values[:, k])
    return Parameters.of(mixed)


def _platoon_distance(parameters: Parameters) -> FloatArray:
    """(n,) by how much all τ of platoons (n, M) could be smaller, in s.

    It is negative where they must be larger, -inf where the platoon is unstable and no larger τ
    within `CHANGES` helps, and inf where it is stable with all smaller ones.
    """
    alpha, beta, tau, _, lag, delay = np.moveaxis(parameters.complete, -1, 0)
    tau, silent = np.where(alpha > 0, tau, 0.0), (alpha == 0) & (beta == 0)
    top = BEYOND * np.sqrt(beta**2 + 2.0 * alpha).max(axis=1)
    slow = np.sqrt(np.where(alpha > 0, alpha, np.inf)).min(axis=1)
    slow = np.maximum(np.minimum(np.where(np.isfinite(slow), slow, 1.0), top), SLOWEST)
    top = np.maximum(top, slow)
    late = delay.max(axis=1)
    top = np.where(late > 0, np.maximum(top, np.pi / np.where(late > 0, late, 1.0)), top)
    omega = slow[:, None] / 100.0 * (100.0 * top / slow)[:, None] ** np.linspace(0, 1, ALONG)
    x, at = (omega**2)[:, None, :], omega[:, None, :]
    e, g, _ = _phases(at, lag[..., None], delay[..., None], alpha[..., None], beta[..., None])
    upper = alpha[..., None] ** 2 + beta[..., None] ** 2 * x
    inertia = x * (1.0 + lag[..., None] ** 2 * x) - 2.0 * alpha[..., None] * e - (
        beta[..., None] ** 2
    )  # fmt: skip

    def is_stable(change: FloatArray) -> Mask:
        total = alpha * np.maximum(tau + change[:, None], 0.0) + beta
        rest = inertia - 2.0 * total[..., None] * g + total[..., None] ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            each = np.log1p(np.maximum(x * rest / upper, -1.0 + 1e-12))
        lost = np.where(silent[..., None], np.inf, each).sum(axis=1)
        decays = _is_stable(parameters.flat, total.ravel()).reshape(total.shape)
        decays |= silent | ((lag == 0) & (delay == 0) & (total > 0))
        return np.asarray((lost >= 0).all(axis=1) & decays.all(axis=1))

    count, steps = len(alpha), np.arange(len(CHANGES))[:, None]
    verdicts = np.array([is_stable(np.full(count, change)) for change in CHANGES])
    # The boundary below where a platoon is stable, otherwise the next one above.
    now = verdicts[UNCHANGED]
    from_here = verdicts & (now | (steps > UNCHANGED))
    below = np.where(~verdicts & (steps < UNCHANGED), steps, -1).max(axis=0)
    first = np.where(now, below + 1, from_here.argmax(axis=0))
    high, low = CHANGES[first], CHANGES[np.maximum(first - 1, 0)]
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        stable = is_stable(middle)
        high, low = np.where(stable, middle, high), np.where(stable, low, middle)
    distance = np.where(from_here.any(axis=0), -high, -np.inf)
    return np.asarray(np.where(now & (first == 0), np.inf, distance))
