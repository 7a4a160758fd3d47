"""The constant time-headway policy (CTHP), the paper's model, which every method can estimate.

Vehicle i follows vehicle i-1; p_i is the space-gap [m], v_i the speed [m/s], Δv_i = v_{i-1} - v_i:

    dp_i/dt = Δv_i
    dv_i/dt = α_i (p_i - τ_i v_i) + β_i Δv_i        α [1/s²], β [1/s], τ [s]

It is linear in θ = (α, c, β) with c = ατ: dv/dt = α p - c v + β Δv. The rational driving
constraints are α ≥ 0, c ≥ 0, β ≥ 0 (Wilson and Ward 2011).

Source: Apostolakis and Ampountolas, IEEE Transactions on Vehicular Technology, 2024, section III.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from accpinn.errors import ParameterError, shown
from accpinn.units import FloatArray, Mask, Metres, Seconds, frozen

Case = Literal["I", "II"]
"""Case I: one parameter set for the platoon. Case II: one per follower."""

Term = Literal["s0", "lag", "delay"]
TERMS: tuple[Term, ...] = get_args(Term)
"""The terms that may stand beside α, β, τ, in the order of `Parameters.complete`."""
LINEAR_NAMES = ("α", "ατ", "β")
"""The components of θ, in which the model is linear, in the order of every θ in this package."""


def _column(index: int, text: str) -> Any:
    """The property that is one column of `Parameters.everything`."""

    def of(self: "Parameters") -> Any:
        values = self.everything[..., index]
        return float(values) if values.ndim == 0 else values

    return property(of, doc=text)


class Parameters:
    """α, β and τ of one vehicle or of many, and the further terms of its model, immutable.

    Attributes:
        everything: (.., 6 + n) first `complete`, then `nonlinear`.
    """

    __slots__ = ("everything",)
    everything: FloatArray

    def __init__(
        self,
        alpha: ArrayLike,
        beta: ArrayLike,
        tau: ArrayLike,
        s0: ArrayLike = 0.0,
        lag: ArrayLike = 0.0,
        delay: ArrayLike = 0.0,
        *nonlinear: ArrayLike,
    ) -> None:
        """Parameters of the given values.

        Args:
            alpha: gain on the spacing error p - s₀ - τv in 1/s²; any shape.
            beta: gain on the relative speed Δv in 1/s; all are broadcast against one another.
            tau: desired time headway in s.
            s0: intercept of the desired gap in m.
            lag: time constant between command and acceleration in s.
            delay: time between command and acceleration in s.
            nonlinear: the parameters of a nonlinear model, of which α .. d are the linearisation.
        """
        given = (alpha, beta, tau, s0, lag, delay, *nonlinear)
        try:
            parts = np.broadcast_arrays(*(np.asarray(v, np.float64) for v in given))
        except (TypeError, ValueError):
            shapes = ", ".join(map(shown, (alpha, beta, tau)))
            raise ParameterError(
                f"parameters: α, β, τ = {shapes} are no numbers of one shape; give a number or an"
                " array of each, one entry a vehicle."
            ) from None
        self.everything = frozen(np.stack(parts, axis=-1))

    def __reduce__(self) -> tuple[object, ...]:
        """Copy and pickle by value."""
        return Parameters.of, (self.everything,)

    @classmethod
    def of(cls, values: ArrayLike) -> Self:
        """Parameters from an array (.., 3) of α, β, τ, or one as `everything`, or its first six."""
        try:
            rows = np.asarray(values, np.float64)
        except (TypeError, ValueError):
            rows = np.empty(0)
        if rows.ndim == 0 or rows.shape[-1] < 3:
            raise ParameterError(
                f"parameters: {shown(values)} is no array (.., 3) of numbers; give α, β and τ"
                " along the last axis."
            )
        if (missing := 6 - rows.shape[-1]) > 0:
            rows = np.concatenate([rows, np.zeros((*rows.shape[:-1], missing))], axis=-1)
        parameters = cls.__new__(cls)
        parameters.everything = frozen(rows)
        return parameters

    @property
    def complete(self) -> FloatArray:
        """(.., 6) α [1/s²], β [1/s], τ [s], s₀ [m], λ [s], d [s].

        τ is nan where α = 0, as it has no effect there. Terms that the model does not have are 0.
        """
        return self.everything[..., :6]

    @property
    def nonlinear(self) -> FloatArray:
        """(.., n) the parameters of a nonlinear model; n = 0 for a CTHP.

        `complete` is then its linearisation at some speed (see `model.following`).
        """
        return self.everything[..., 6:]

    @property
    def is_linear(self) -> bool:
        """Whether these are a CTHP's, the same at every speed, and so have no `nonlinear`."""
        return bool(self.everything.shape[-1] == 6)

    @classmethod
    def from_theta(cls, theta: ArrayLike) -> Self:
        """Parameters from an array (.., 3) of θ = (α, ατ, β)."""
        alpha, alpha_tau, beta = np.moveaxis(np.asarray(theta, np.float64), -1, 0)
        undetermined = np.full_like(alpha, np.nan)
        return cls(alpha, beta, np.divide(alpha_tau, alpha, out=undetermined, where=alpha != 0))

    @classmethod
    def stack(cls, parts: Iterable["Parameters"]) -> Self:
        """Several vehicles' parameters (..) as one (K, ..), those of different models as CTHPs."""
        rows = [part.everything for part in parts]
        width = min((row.shape[-1] for row in rows), default=6)
        return cls.of(np.array([row[..., :width] for row in rows]).reshape(-1, width))

    @property
    def flat(self) -> "Parameters":
        """(V,) all vehicles along one axis."""
        return Parameters.of(self.everything.reshape(-1, self.everything.shape[-1]))

    @property
    def values(self) -> FloatArray:
        """(.., 3) α, β, τ."""
        return self.everything[..., :3]

    alpha = _column(0, "(..) in 1/s²; a plain float for one vehicle.")
    beta = _column(1, "(..) in 1/s; a plain float for one vehicle.")
    tau = _column(2, "(..) in s; a plain float for one vehicle.")
    s0 = _column(3, "(..) in m; a plain float for one vehicle.")
    lag = _column(4, "(..) in s; a plain float for one vehicle.")
    delay = _column(5, "(..) in s; a plain float for one vehicle.")

    def time_gap(self, speed: ArrayLike) -> FloatArray:
        """(..) τ + s₀/v in s: the time gap in equilibrium at a speed v in m/s; nan below 0.01."""
        speed = np.asarray(speed, float)
        return np.asarray(self.tau + self.s0 / np.where(speed > 0.01, speed, np.nan))

    @property
    def theta(self) -> FloatArray:
        """(.., 3): θ = (α, ατ, β); ατ = 0 where α = 0."""
        alpha, tau = self.everything[..., 0], self.everything[..., 2]
        theta = self.everything[..., [0, 2, 1]]
        theta[..., 1] = np.where(alpha == 0, 0.0, alpha * tau)
        return theta

    def __len__(self) -> int:
        """The number of vehicles along the first axis."""
        return len(self.complete) if self.complete.ndim > 1 else 1

    def __getitem__(self, index: Any) -> "Parameters":
        """Parameters at an index, a slice or a list of indices of the first axis."""
        return Parameters.of(self.everything[index])

    def __iter__(self) -> Iterator["Parameters"]:
        """Iterate over the vehicles along the first axis."""
        return (Parameters.of(row) for row in self.everything)

    def __eq__(self, other: object) -> bool:
        """Whether all values are the same; nan equals nan."""
        return isinstance(other, Parameters) and np.array_equal(
            self.everything, other.everything, equal_nan=True
        )

    def __hash__(self) -> int:
        """Hash of the values."""
        return hash((self.complete.shape, self.everything.tobytes()))

    def __repr__(self) -> str:
        """The values by name."""
        names = ["alpha", "beta", "tau"]
        names += TERMS if self.complete[..., 3:].any() else ()
        names += () if self.is_linear else ["nonlinear"]
        return f"Parameters({', '.join(f'{name}={getattr(self, name)}' for name in names)})"


TYPICAL = Parameters(0.08, 0.2, 1.4)
"""The middle of published parameters of ACC cars; filters and searches start from it."""
SPREAD = (1.0, 1.0, 0.3)
"""Standard deviations of ln α, ln β, ln τ about `TYPICAL`: 95 % of α lie in 0.01 to 0.6 1/s²."""
LARGEST = Parameters(10.0, 10.0, 100.0)
"""Bounds of searches: gains a hundred times, a headway fifty times what cars have."""
LARGEST_ALPHA_TAU = 10.0
"""Bound of ατ in searches over θ, in 1/s."""
TOUCH: Metres = 1e-6
"""Depth to which rounding alone makes a gap negative that ends at 0 behind a leader at rest."""


def regressors(speeds: FloatArray, gaps: FloatArray) -> FloatArray:
    """(M, N, 3) p, -v, Δv of each follower, which multiply θ in dv/dt.

    The speeds are (N, M+1) in m/s, leader first, the gaps (N, M) in m.
    """
    follower = speeds[:, 1:]
    return np.stack([gaps, -follower, speeds[:, :-1] - follower], axis=-1).transpose(1, 0, 2)


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Speeds and space-gaps of a platoon over time."""

    time: FloatArray
    """(N,) in s."""
    speeds: FloatArray
    """(N, M+1) in m/s, leader first."""
    gaps: FloatArray
    """(N, M) in m."""


def collides(gaps: FloatArray) -> Mask:
    """(..) where a vehicle is in the one ahead by simulated gaps (..) in m; nowhere at nan."""
    return np.asarray(gaps < -TOUCH)


def simulate(
    parameters: Parameters,
    time: FloatArray,
    leader_speed: FloatArray,
    initial_speeds: FloatArray,
    initial_gaps: FloatArray,
) -> Trajectories:
    """Simulate the platoon in closed loop: only the leader's speed is given.

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
    matrix, size = motion_matrix(parameters), 2 * len(parameters)
    start = np.zeros(len(matrix))
    start[0:size:2] = np.asarray(initial_gaps) - parameters.complete[:, 3]
    start[1:size:2] = initial_speeds
    # The further states are at rest under the command of the first instant.
    held = matrix[size:, :size] @ start[:size] + matrix[size:, -1] * leader[0]
    start[size:] = -np.linalg.solve(matrix[size:, size:-1], held)
    state = respond(matrix, leader, step, start)
    gaps = state[:, 0:size:2] + parameters.complete[:, 3]
    return Trajectories(
        np.asarray(time, float), np.column_stack([leader, state[:, 1:size:2]]), gaps
    )


def respond(matrix: FloatArray, drive: FloatArray, step: Seconds, start: FloatArray) -> FloatArray:
    """(N, K) states of dx/dt = Ax + bu from x (K,) on, exact at each sample of u (N,).

    The matrix (K, K+1) is A and, as last column, b; u is straight between its samples.
    """
    from scipy.linalg import expm  # not for those who only read a file

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
    """(K, K+1): d/dt of (p_1 - s₀, v_1, .., v_M, further states) from these and the leader's speed.

    A lag has one further state, the acceleration that is reached; a delay has the two of its Padé
    approximant (see `following`). As the system is linear, the same matrix moves deviations from an
    equilibrium.
    """
    size = 2 * len(parameters)
    further = [(lag > 0) + 2 * (delay > 0) for lag, delay in parameters.complete[:, 4:]]
    total = size + sum(further)
    matrix = np.zeros((total, total + 1))
    ahead, further_state = total, size
    for gap, theta, late in zip(
        range(0, size, 2), parameters.theta, parameters.complete[:, 4:], strict=True
    ):
        alpha, alpha_tau, beta = theta
        speed = gap + 1
        matrix[gap, [ahead, speed]] = 1.0, -1.0
        command = np.zeros(total + 1)
        command[[gap, speed, ahead]] = alpha, -alpha_tau - beta, beta
        further_state = add_command(matrix, command, speed, further_state, *late)
        ahead = speed
    return matrix


def add_command(
    rates: FloatArray, command: FloatArray, speed: int, first: int, lag: ArrayLike, delay: ArrayLike
) -> int:
    """A command (.., L) becomes acceleration, by the states of a delay and of a lag where they are.

    It is added to the rates (.., K, L) of the states, of which ``first`` is the first of these. Lag
    and delay (..) are in s, 0 for none. The place behind their states is returned.
    """
    lag, delay, reached = np.asarray(lag, float), np.asarray(delay, float), command
    if (delay > 0).any():
        # exp(-ds) is about 1 - 12ds / (d²s² + 6ds + 12).
        rates[..., first, first + 1] = 1.0
        rates[..., first + 1, :] = command
        rates[..., first + 1, first] -= 12.0 / delay**2
        rates[..., first + 1, first + 1] -= 6.0 / delay
        reached = command.copy()
        reached[..., first + 1] -= 12.0 / delay
        first += 2
    if (lag > 0).any():
        rates[..., first, :] = reached / lag[..., None]
        rates[..., first, first] -= 1.0 / lag
        rates[..., speed, first] = 1.0
        return first + 1
    rates[..., speed, :] += reached
    return first


def orbit(transition: FloatArray, start: FloatArray, count: int) -> FloatArray:
    """(count, K) the states x, Ex, E²x, .. that a linear system E (K, K) takes from x (K,).

    Each round doubles the states that are there, so no loop runs over their number.
    """
    states = np.empty((count, len(start)))
    states[:1] = start
    reach, power = 1, transition.T
    while reach < count:
        later = states[reach : 2 * reach]
        np.matmul(states[: len(later)], power, out=later)
        reach, power = 2 * reach, power @ power
    return states


def _accumulate(transition: FloatArray, states: FloatArray) -> None:
    """Turn f_0, f_1, .. (N, K) into x_0 = f_0, x_k = E x_{k-1} + f_k, in place.

    No loop runs over the N steps. On the way up, rows 2^j apart are joined pair by pair, so that
    row k = i 2^j - 1 holds the last 2^j terms of f_k + E f_{k-1} + E² f_{k-2} + ..; on the way down
    each row between two that are complete gets what the one before it holds.

    Source: Brent and Kung, IEEE Transactions on Computers 31, 1982 (the parallel prefix).
    """
    count, powers = len(states), [transition.T]
    while 2 << len(powers) <= count:
        powers.append(powers[-1] @ powers[-1])
    ways = [(1 << j, power) for j, power in enumerate(powers)]
    for reach, power in ways:
        later = states[2 * reach - 1 :: 2 * reach]
        later += states[reach - 1 :: 2 * reach][: len(later)] @ power
    for reach, power in ways[::-1]:
        later = states[3 * reach - 1 :: 2 * reach]
        later += states[2 * reach - 1 :: 2 * reach][: len(later)] @ power
