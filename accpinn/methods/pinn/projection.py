"""The output layer and the parameters of the CTHP by normal equations.

Given Φ (N, K), what the output layer sees, the layer W (K, 2M+1) is linear and Ψ is quadratic in
it for fixed parameters, while the parameters are a 3x3 solve for fixed outputs (variable
projection, Golub and Pereyra 1973). Alternating the two lowers Ψ at every round.

Every residual of follower i is linear in its speed v_i, its gap p_i and the speed ahead v_{i-1},
with their rates:

    residual         rate of            value of
    gap's rate       p_i: 1             v_i: 1,  v_{i-1}: -1
    acceleration     v_i: 1             p_i: -α,  v_i: ατ + β,  v_{i-1}: -β

so the normal matrix is a chain: eliminating the last follower first leaves one K x K term on the
speed ahead.

    [ B_i   C_i ] [ w_i   ]   [ r_i ]      w_i = (v_i, p_i) weights, 2K;  B_i 2K x 2K
    [ C_iᵀ  D_i ] [ w_i-1 ] = [ .   ]      C_i 2K x K couples to v_{i-1}
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.linalg import cholesky, solve, solve_triangular

from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import output_columns
from accpinn.methods.pinn.network import Network
from accpinn.methods.regression import Solution, solve_platoon
from accpinn.model.cthp import Case
from accpinn.units import FloatArray, Mask, Seconds

_GAP_RATE = np.array([[1.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Residual of the gap's rate: values and rates of own speed, gap and speed ahead."""
RIDGE = 1e-10
"""Share of the mean squared activation added to the diagonal: activations may be collinear."""


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Products of Φ, its rates and the data, summed over instants and divided by N."""

    grams: FloatArray
    """(2, 2, K, K) [a, b] the a-th derivative of Φ times its b-th derivative."""
    dynamic_grams: tuple[FloatArray, ...]
    """(M,) the same over the instants at which a follower's acceleration counts."""
    value_data: FloatArray
    """(K, 2M+1) ΦᵀY."""
    first: FloatArray
    """(K,) Φ at the first instant, for Ψ_R."""
    first_data: FloatArray
    """(2M+1,) the data at the first instant."""

    @classmethod
    def of(
        cls,
        seen: FloatArray,
        measured: FloatArray,
        mask: Mask | None = None,
        beside: tuple[Self, FloatArray] | None = None,
    ) -> Self:
        """Sum products of Φ and its rate (N, 2, K) and data (N, 2M+1), in `output_columns`' order.

        The mask (N, M) is True where a follower's acceleration counts; None for everywhere.
        ``beside`` holds the sums of further columns of Φ, which stand first, and these (N, 2, L).
        """
        count, followers = len(seen), measured.shape[1] // 2
        rows: list[slice | Mask] = [slice(None)] if mask is None else [slice(None), *mask.T]
        every = [_products(part, part, count) for part in (seen[kept] for kept in rows)]
        value_data, first = seen[:, 0].T @ measured / count, seen[0, 0]
        if beside:
            known, others = beside
            cross = [_products(others[kept], seen[kept], count) for kept in rows]
            parts = zip((known.grams, *known.dynamic_grams), cross, every, strict=False)
            every = [
                np.block([[before, both], [both.transpose(1, 0, 3, 2), last]])
                for before, both, last in parts
            ]
            value_data = np.vstack([known.value_data, value_data])
            first = np.concatenate([known.first, first])
        dynamic = every[:1] * followers if mask is None else every[1:]
        return cls(every[0], tuple(dynamic), value_data, first, measured[0])

    def with_late(self, late: Iterable[FloatArray], mask: Mask | None) -> Self:
        """The same for accelerations that see (M,) of (N, 2, K), as `Projection.late` gives it."""
        grams = []
        for follower, seen in enumerate(late):
            part = seen if mask is None else seen[mask[:, follower]]
            grams.append(_products(part, part, len(seen)))
        return replace(self, dynamic_grams=tuple(grams))

    @property
    def value_value(self) -> FloatArray:
        """(K, K) ΦᵀΦ with a ridge."""
        values: FloatArray = self.grams[0, 0]
        return np.asarray(values + RIDGE * values.diagonal().mean() * np.eye(len(values)))


class Projection:
    """The output layer of a network on the instants of a segment."""

    def __init__(
        self,
        network: Network,
        time: FloatArray,
        measured: FloatArray,
        mask: Mask | None,
        order: int = 1,
    ) -> None:
        """Sum the products of the data and what does not pass through the hidden layers.

        The instants (N,) are in s from the window's start, the order is that of the highest
        derivative in time, 1 or 2; data and mask are as for `NormalEquations.of`.
        """
        self.network, self._measured, self._mask = network, measured, mask
        self._time = time
        self._order = order
        self.skipped = self._features(time)
        """(N, 1 + order, F + 1) a constant and the features, and their derivatives."""
        self._sums = NormalEquations.of(self.skipped[:, :2], measured, mask)

    def _features(self, time: FloatArray) -> FloatArray:
        features = np.stack(self.network.features(time, self._order), axis=1)
        constant = np.zeros((*features.shape[:2], 1))
        constant[:, 0] = 1.0
        return np.concatenate([constant, features], axis=2)

    def hidden(self) -> FloatArray:
        """(N, 1 + order, width) the present activations and their derivatives."""
        return self._hidden(self.skipped)

    def _hidden(self, skipped: FloatArray) -> FloatArray:
        features = skipped[:, :, 1:].swapaxes(0, 1)
        return np.stack(self.network.activations([*features]), axis=1)

    def sums(self, hidden: FloatArray) -> NormalEquations:
        """The normal equations of the whole output layer."""
        beside = self._sums, self.skipped[:, :2]
        return NormalEquations.of(hidden[:, :2], self._measured, self._mask, beside)

    def seen(self, hidden: FloatArray) -> FloatArray:
        """(N, 1 + order, K) Φ and its derivatives."""
        return np.concatenate([self.skipped, hidden], axis=2)

    def seen_at(self, time: FloatArray) -> FloatArray:
        """(N, 1 + order, K) the same at other instants (N,), for the present hidden layers."""
        skipped = self._features(time)
        return np.concatenate([skipped, self._hidden(skipped)], axis=2)

    def late(self, hidden: FloatArray, lag: Seconds, delay: Seconds) -> FloatArray:
        """(N, 2, K) what an acceleration behind a lag λ or a delay d sees: Φ(t - d), Φ' + λΦ''."""
        seen = self.seen(hidden)
        rate = seen[:, 1] + lag * seen[:, 2] if lag else seen[:, 1]
        then = self.seen_at(np.maximum(self._time - delay, 0.0)) if delay else seen
        return np.stack([then[:, 0], rate], axis=1)

    def past_hidden(self, weights: FloatArray) -> FloatArray:
        """(N, 1 + order, 2M+1) the skip connection's part, for the output layer (K, 2M+1)."""
        return _mapped(self.skipped, weights[: self.skipped.shape[2]])

    def surrogate(self, hidden: FloatArray, weights: FloatArray) -> FloatArray:
        """(1 + order, N, 2M+1) outputs and their derivatives."""
        through = weights[self.skipped.shape[2] :]
        return (self.past_hidden(weights) + _mapped(hidden, through)).swapaxes(0, 1)


def _mapped(columns: FloatArray, weights: FloatArray) -> FloatArray:
    """(N, D, L) from values and derivatives (N, D, K) and weights (K, L)."""
    flat = columns.reshape(-1, columns.shape[2]) @ weights
    return np.asarray(flat.reshape(*columns.shape[:2], -1))


def _products(left: FloatArray, right: FloatArray, count: int) -> FloatArray:
    """(2, 2, K, L) from values and rates (n, 2, K) and (n, 2, L)."""
    flat, other = (columns.reshape(len(columns), -1) for columns in (left, right))
    # Of one array with itself, half the work.
    products = (flat.T @ (flat if left is right else other) / count).reshape(
        2, left.shape[2], 2, -1
    )
    return np.asarray(products.swapaxes(1, 2))


def solve_output(sums: NormalEquations, theta: FloatArray, config: PinnConfig) -> FloatArray:
    """The output layer W (K, 2M+1) that minimises Ψ for the parameters θ (M, 3)."""
    kinematic = gap_blocks(sums, config)

    def blocks(follower: int) -> FloatArray:
        """The follower's squared residuals of both equations."""
        alpha, alpha_tau, beta = theta[follower]
        dynamic = np.array([[alpha_tau + beta, -alpha, -beta], [1.0, 0.0, 0.0]])
        squares = _squares(dynamic, config.weight_physics[1], sums.dynamic_grams[follower])
        squares += kinematic
        return squares

    return solve_chain(sums, blocks, data_moments(sums, config)[..., None], config)[..., 0]


def data_moments(sums: NormalEquations, config: PinnConfig) -> FloatArray:
    """(K, 2M+1) the right-hand side of the output layer's normal equations that data give."""
    gap_columns = output_columns(sums.value_data.shape[1] // 2)[1]
    (s_gap, s_speed), restart = config.weight_data, config.weight_initial
    right = s_speed * sums.value_data
    right[:, gap_columns] *= s_gap / s_speed
    right[:, 1:] += restart * np.outer(sums.first, sums.first_data[1:])
    return right


def solve_chain(
    sums: NormalEquations,
    blocks: Callable[[int], FloatArray],
    right: FloatArray,
    config: PinnConfig,
) -> FloatArray:
    """(K, 2M+1, R) the solution of the chain of the module's head for R right-hand sides at once.

    The blocks (3K, 3K) are a follower's squared residuals, by its speed, its gap and the speed
    ahead.
    """
    size, followers = len(sums.first), right.shape[1] // 2
    speed_columns, gap_columns = output_columns(followers)
    (s_gap, s_speed), restart = config.weight_data, config.weight_initial
    at_first = restart * np.outer(sums.first, sums.first)
    value_value = sums.value_value

    # From the last follower to the first: what is left of those behind on their speed ahead.
    behind = np.zeros((size, size + right.shape[2]))
    eliminated: list[tuple[FloatArray, FloatArray]] = []
    for follower in reversed(range(followers)):
        squares, both = blocks(follower), slice(0, 2 * size)
        normal = squares[both, both].copy()
        normal[:size, :size] += s_speed * value_value + at_first + behind[:, :size]
        normal[size:, size:] += s_gap * value_value + at_first
        goal = right[:, [speed_columns[follower + 1], gap_columns[follower]]].swapaxes(0, 1).copy()
        goal[0] += behind[:, size:]
        factor = cholesky(normal, lower=True, check_finite=False)
        linked = np.column_stack([squares[both, 2 * size :], goal.reshape(2 * size, -1)])
        half = solve_triangular(factor, linked, lower=True, check_finite=False)
        eliminated.append((factor, half))
        behind = -half[:, :size].T @ half
        behind[:, :size] += squares[2 * size :, 2 * size :]

    weights = np.empty_like(right)
    leader = s_speed * value_value + behind[:, :size]
    given = right[:, 0] + behind[:, size:]
    weights[:, 0] = solve(leader, given, assume_a="pos", check_finite=False)
    for follower, (factor, half) in enumerate(reversed(eliminated)):
        left = half[:, size:] - half[:, :size] @ weights[:, speed_columns[follower]]
        solved = solve_triangular(factor, left, trans=1, lower=True, check_finite=False)
        weights[:, speed_columns[follower + 1]] = solved[:size]
        weights[:, gap_columns[follower]] = solved[size:]
    return weights


def gap_blocks(sums: NormalEquations, config: PinnConfig) -> FloatArray:
    """The part of a follower's blocks that comes from the rate of its gap."""
    return _squares(_GAP_RATE, config.weight_physics[0], sums.grams)


def _squares(residual: FloatArray, weight: float, grams: FloatArray) -> FloatArray:
    """(3K, 3K) the weighted square of a residual (2, 3) of values and rates, as `_GAP_RATE` is."""
    size, form = 3 * grams.shape[2], weight * np.multiply.outer(residual, residual)
    return np.tensordot(form, grams, ((0, 2), (0, 1))).swapaxes(1, 2).reshape(size, size)


def solve_parameters(sums: NormalEquations, weights: FloatArray, case: Case) -> Solution:
    """The parameters that minimise Ψ for the output layer ``weights`` (K, 2M+1)."""
    followers = weights.shape[1] // 2
    speed_columns, gap_columns = output_columns(followers)
    grams, targets = [], []
    for follower in range(followers):
        own = weights[:, speed_columns[follower + 1]]
        relative = weights[:, speed_columns[follower]] - own
        terms = np.stack([weights[:, gap_columns[follower]], -own, relative], axis=1)
        dynamic = sums.dynamic_grams[follower]
        grams.append(terms.T @ dynamic[0, 0] @ terms)
        targets.append(terms.T @ (dynamic[0, 1] @ own))
    return solve_platoon(np.stack(grams), np.stack(targets), case)
