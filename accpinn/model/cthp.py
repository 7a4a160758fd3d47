"""The constant time-headway policy (CTHP), the law every method of this package estimates.

Vehicle i follows vehicle i-1; p_i is the space-gap [m], v_i the speed [m/s], Δv_i = v_{i-1} - v_i:

    dp_i/dt = Δv_i
    dv_i/dt = α_i (p_i - τ_i v_i) + β_i Δv_i        α [1/s²], β [1/s], τ [s]

It is linear in θ = (α, c, β) with c = ατ: dv/dt = α p - c v + β Δv. The rational driving
constraints are α ≥ 0, c ≥ 0, β ≥ 0 (Wilson and Ward 2011).

Source: Apostolakis and Ampountolas, IEEE Transactions on Vehicular Technology, 2024, section III.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from accpinn.units import FloatArray, Seconds, frozen

Case = Literal["I", "II"]
"""Case I: one parameter set for the platoon. Case II: one per follower."""

LINEAR_NAMES = ("α", "ατ", "β")
"""The quantities the law is linear in, in the order every θ of this package has them."""


BLOCK = 256
"""Rows of a product that are multiplied at once; see `in_blocks`."""


class Parameters:
    """α, β and τ of one vehicle or of many: an immutable array (.., 3).

    Attributes:
        values: (.., 3) α [1/s²], β [1/s], τ [s]; τ is nan where α = 0, as it has no effect there.
    """

    __slots__ = ("values",)
    values: FloatArray

    def __init__(self, alpha: ArrayLike, beta: ArrayLike, tau: ArrayLike) -> None:
        """Parameters of the given values.

        Args:
            alpha: gain on the spacing error p - τv in 1/s²; any shape.
            beta: gain on the relative speed Δv in 1/s; broadcast against the others.
            tau: desired time headway in s.
        """
        parts = np.broadcast_arrays(*(np.asarray(v, np.float64) for v in (alpha, beta, tau)))
        object.__setattr__(self, "values", frozen(np.stack(parts, axis=-1)))

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse: parameters never change."""
        raise AttributeError(f"Parameters are immutable; make new ones instead of setting {name}.")

    def __reduce__(self) -> tuple[object, ...]:
        """Copy and pickle by value."""
        return Parameters.of, (self.values,)

    @classmethod
    def of(cls, values: ArrayLike) -> Self:
        """Parameters from an array (.., 3) of α, β, τ."""
        return cls(*np.moveaxis(np.asarray(values, np.float64), -1, 0))

    @classmethod
    def from_theta(cls, theta: ArrayLike) -> Self:
        """Parameters from an array (.., 3) of θ = (α, ατ, β)."""
        alpha, alpha_tau, beta = np.moveaxis(np.asarray(theta, np.float64), -1, 0)
        undetermined = np.full_like(alpha, np.nan)
        return cls(alpha, beta, np.divide(alpha_tau, alpha, out=undetermined, where=alpha != 0))

    @classmethod
    def stack(cls, parts: Iterable["Parameters"]) -> Self:
        """Several vehicles' parameters (..) as one (K, ..)."""
        return cls.of(np.array([part.values for part in parts]).reshape(-1, 3))

    @property
    def theta(self) -> FloatArray:
        """(.., 3): θ = (α, ατ, β); ατ = 0 where α = 0."""
        alpha, beta, tau = np.moveaxis(self.values, -1, 0)
        return np.stack([alpha, np.where(alpha == 0, 0.0, alpha * tau), beta], axis=-1)

    @property
    def alpha(self) -> Any:
        """(..) in 1/s²; a plain float for one vehicle."""
        return _scalar(self.values[..., 0])

    @property
    def beta(self) -> Any:
        """(..) in 1/s; a plain float for one vehicle."""
        return _scalar(self.values[..., 1])

    @property
    def tau(self) -> Any:
        """(..) in s; a plain float for one vehicle."""
        return _scalar(self.values[..., 2])

    def __len__(self) -> int:
        """How many vehicles the first axis holds."""
        return len(self.values) if self.values.ndim > 1 else 1

    def __getitem__(self, index: Any) -> "Parameters":
        """Those at an index, a slice or a list of indices of the first axis."""
        return Parameters.of(self.values[index])

    def __iter__(self) -> Iterator["Parameters"]:
        """One vehicle after the other."""
        return (Parameters.of(row) for row in self.values)

    def __eq__(self, other: object) -> bool:
        """Whether all values are the same; nan equals nan."""
        return isinstance(other, Parameters) and np.array_equal(
            self.values, other.values, equal_nan=True
        )

    def __hash__(self) -> int:
        """By value."""
        return hash((self.values.shape, self.values.tobytes()))

    def __repr__(self) -> str:
        """The values by name."""
        return f"Parameters(alpha={self.alpha}, beta={self.beta}, tau={self.tau})"


def _scalar(values: FloatArray) -> Any:
    return float(values) if values.ndim == 0 else values


def regressors(speeds: FloatArray, gaps: FloatArray) -> FloatArray:
    """What multiplies θ in dv/dt, per follower.

    Args:
        speeds: (N, M+1) in m/s, leader first.
        gaps: (N, M) in m.

    Returns:
        (M, N, 3): the columns p, -v, Δv of each follower.
    """
    follower = speeds[:, 1:]
    return np.stack([gaps, -follower, speeds[:, :-1] - follower], axis=-1).transpose(1, 0, 2)


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """The least-squares θ within the rational driving constraints, and without them."""

    theta: FloatArray
    """(3,): the solution with α, ατ, β ≥ 0."""
    unconstrained: FloatArray
    """(3,): the solution that ignores the bounds."""
    active: tuple[str, ...]
    """Which of α, ατ, β stand at zero because of the bounds."""


def solve_linear(gram: FloatArray, moment: FloatArray) -> LinearSolution:
    """Minimise θᵀGθ - 2mᵀθ over θ ≥ 0 exactly.

    With three unknowns every active set can be tried, so the answer is the global optimum.

    Args:
        gram: (3, 3), symmetric positive semi-definite.
        moment: (3,).
    """
    unconstrained = frozen(np.linalg.lstsq(gram, moment, rcond=None)[0])
    if (unconstrained >= 0).all():
        return LinearSolution(unconstrained, unconstrained, ())
    best, best_cost = np.zeros(3), 0.0
    active: tuple[str, ...] = LINEAR_NAMES
    for size in (1, 2):
        for free in combinations(range(3), size):
            index = list(free)
            part = np.linalg.lstsq(gram[np.ix_(index, index)], moment[index], rcond=None)[0]
            cost = float(-part @ moment[index])
            if (part >= 0).all() and cost < best_cost:
                best, best_cost = np.zeros(3), cost
                best[index] = part
                active = tuple(name for i, name in enumerate(LINEAR_NAMES) if i not in free)
    return LinearSolution(frozen(best), unconstrained, active)


@dataclass(frozen=True, eq=False)
class PlatoonSolution:
    """The least-squares parameters of every follower; in Case I all rows are equal."""

    theta: FloatArray
    """(M, 3) α, ατ, β within the rational driving constraints."""
    unconstrained: FloatArray
    """(M, 3) the same without them."""
    active: tuple[tuple[str, ...], ...]
    """Per follower, the names of those that stand at zero because of the constraints."""

    @classmethod
    def of(cls, solutions: Sequence[LinearSolution], followers: int) -> Self:
        """One solution a follower, or a single one that all share."""
        rows = solutions if len(solutions) == followers else [solutions[0]] * followers
        return cls(
            np.stack([row.theta for row in rows]),
            np.stack([row.unconstrained for row in rows]),
            tuple(row.active for row in rows),
        )


def solve_platoon(grams: FloatArray, moments: FloatArray, case: Case) -> PlatoonSolution:
    """`solve_linear` for each follower (Case II) or for all of them together (Case I).

    Args:
        grams: (M, 3, 3), one normal matrix a follower.
        moments: (M, 3).
        case: "I" or "II".
    """
    followers = len(grams)
    if case == "I":
        grams, moments = grams.sum(0, keepdims=True), moments.sum(0, keepdims=True)
    solutions = [solve_linear(g, m) for g, m in zip(grams, moments, strict=True)]
    return PlatoonSolution.of(solutions, followers)


def solve_rows(
    terms: FloatArray, rates: FloatArray, case: Case, mask: NDArray[np.bool_] | None = None
) -> PlatoonSolution:
    """The least-squares θ of dv/dt = Xθ over all instants that count.

    Args:
        terms: (M, N, 3) X, the `regressors`.
        rates: (N, M) dv/dt in m/s².
        case: "I" or "II".
        mask: (N, M) True where a row counts; None where all do.
    """
    if mask is not None:
        terms = np.where(mask.T[:, :, None], terms, 0.0)
    grams = terms.transpose(0, 2, 1) @ terms
    return solve_platoon(grams, np.einsum("mnk,nm->mk", terms, rates), case)


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Speeds and space-gaps of a platoon over time."""

    time: FloatArray
    """(N,) in s."""
    speeds: FloatArray
    """(N, M+1) in m/s, leader first."""
    gaps: FloatArray
    """(N, M) in m."""


def simulate(
    parameters: Parameters,
    time: FloatArray,
    leader_speed: FloatArray,
    initial_speeds: FloatArray,
    initial_gaps: FloatArray,
) -> Trajectories:
    """The platoon in closed loop: only the leader's speed is given, all else is integrated.

    The system is linear and the leader's speed is taken as straight between samples, so each
    step of the whole platoon is exact (first-order hold, matrix exponential) and the result has
    no step-size error.

    Args:
        parameters: one entry a follower, M of them.
        time: (N,) in s, evenly spaced.
        leader_speed: (N,) in m/s.
        initial_speeds: (M,) in m/s, the followers' speeds at the first instant.
        initial_gaps: (M,) in m.
    """
    step = (time[-1] - time[0]) / (len(time) - 1)
    leader = np.asarray(leader_speed, float)
    start = np.stack([initial_gaps, initial_speeds], axis=1).ravel()
    state = respond(motion_matrix(parameters), leader, step, start)
    return Trajectories(
        np.asarray(time, float), np.column_stack([leader, state[:, 1::2]]), state[:, 0::2]
    )


def respond(matrix: FloatArray, drive: FloatArray, step: Seconds, start: FloatArray) -> FloatArray:
    """The states of dx/dt = Ax + bu, with u straight between its samples; exact at each of them.

    Args:
        matrix: (K, K+1), A and, as last column, b.
        drive: (N,), u.
        step: between samples.
        start: (K,), x at the first of them.

    Returns:
        (N, K).
    """
    size = len(start)
    # With the drive and its slope as states, one matrix exponential gives the exact step.
    held = np.zeros((size + 2, size + 2))
    held[:size, :-1] = matrix
    held[size, size + 1] = 1.0
    block = expm(held * step)
    states = np.empty((len(drive), size))
    states[0] = start
    states[1:] = np.outer(drive[:-1], block[:-2, -2])
    states[1:] += np.outer(np.diff(drive) / step, block[:-2, -1])
    _accumulate(block[:-2, :-2], states)
    return states


def motion_matrix(parameters: Parameters) -> FloatArray:
    """(2M, 2M+1): d/dt of (p_1, v_1, .., p_M, v_M) from that state and, last, the leader's speed.

    As it is linear, the same matrix moves deviations from an equilibrium.
    """
    size = 2 * len(parameters)
    matrix = np.zeros((size, size + 1))
    ahead = size
    for gap, theta in zip(range(0, size, 2), parameters.theta, strict=True):
        alpha, alpha_tau, beta = theta
        speed = gap + 1
        matrix[gap, [ahead, speed]] = 1.0, -1.0
        matrix[speed, [gap, speed, ahead]] = alpha, -alpha_tau - beta, beta
        ahead = speed
    return matrix


def orbit(transition: FloatArray, start: FloatArray, count: int) -> FloatArray:
    """The states x, Ex, E²x, .. of a linear system left to itself.

    What is known is doubled in one product with a power of E, so no loop runs over the steps.

    Args:
        transition: (K, K), E: one step of the system.
        start: (K,), x.
        count: how many states to return, the first included.

    Returns:
        (count, K).
    """
    states = np.empty((count, len(start)))
    states[0] = start
    known, power = 1, transition.T
    while known < count:
        fresh = min(known, count - known)
        states[known : known + fresh] = in_blocks(states[:fresh], power)
        known, power = known + fresh, power @ power
    return states


def in_blocks(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """(N, K) @ (K, L) for small K and L, some rows at a time.

    As a whole the product is large enough for the linear algebra library to share it out, yet so
    small that waiting for a busy core takes longer than the product.
    """
    result = np.empty((len(rows), matrix.shape[1]))
    for first in range(0, len(rows), BLOCK):
        part = slice(first, first + BLOCK)
        np.matmul(rows[part], matrix, out=result[part])
    return result


def _accumulate(transition: FloatArray, states: FloatArray) -> None:
    """Turn f_0, f_1, .. into x_0 = f_0, x_k = E x_{k-1} + f_k, in place; (N, K).

    Each round lets every sum reach twice as far back, so no loop runs over the N steps: after j
    rounds row k holds the last 2^j terms of f_k + E f_{k-1} + E² f_{k-2} + ..
    """
    reach, power = 1, transition.T
    while reach < len(states):
        states[reach:] += in_blocks(states[:-reach], power)
        reach, power = 2 * reach, power @ power
