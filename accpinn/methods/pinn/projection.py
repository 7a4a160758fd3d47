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

    [ B_i   C_i ] [ w_i   ]   [ r_i ]      w_i = (p_i, v_i) weights, 2K;  B_i 2K x 2K
    [ C_iᵀ  D_i ] [ w_i-1 ] = [ .   ]      C_i 2K x K couples to v_{i-1}

What does not pass through the hidden layers is summed once, as values alone: as the rate of (1, φ)
is (1, φ) L (`network`), sums with rates are those of values times L.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.blas import dsyrk

from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import output_columns
from accpinn.methods.pinn.network import Network
from accpinn.units import FloatArray, Mask, Seconds

_GAP_RATE = np.array([[0.0, 1.0, -1.0], [1.0, 0.0, 0.0]])
"""Residual of the gap's rate: values and rates of gap, own speed and speed ahead."""
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

    def with_late(self, late: Iterable[FloatArray], mask: Mask | None) -> Self:
        """The equations for late accelerations (M,) of (N, 2, K); see `Projection.late`."""
        grams = []
        for follower, seen in enumerate(late):
            part = seen if mask is None else seen[mask[:, follower]]
            grams.append(_products(part, len(seen)))
        return replace(self, dynamic_grams=tuple(grams))

    @cached_property
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
        derivative in time, 1 or 2. The data (N, 2M+1) are in `output_columns`' order, the mask
        (N, M) is True where a follower's acceleration counts; None for everywhere.
        """
        self.network, self._measured, self._mask = network, measured, mask
        self._time, self._order = time, order
        self.skipped = network.features(time, 0)[0]
        """(N, 1 + F) a constant and the features."""
        self._slope = network.derived(np.eye(self.skipped.shape[1]), 1)[1]
        """(1 + F, 1 + F) L."""
        parts = [self.skipped] + ([] if mask is None else [self.skipped[m] for m in mask.T])
        self._grams = [part.T @ part / len(time) for part in parts]
        """(1,) or (1 + M,) of (1 + F, 1 + F), over all instants and those that count."""
        self._value_data = self.skipped.T @ measured / len(time)

    def hidden(self) -> FloatArray:
        """(N, 1 + order, width) the present activations and their derivatives."""
        weight, bias = self.network.hidden[0]
        layers = self.network.derived(np.vstack([bias, weight.T]), self._order)
        through = np.split(self.skipped @ np.hstack(layers), len(layers), axis=1)
        return np.stack(self.network.activated(through), axis=1)

    def sums(self, hidden: FloatArray) -> NormalEquations:
        """The normal equations of the whole output layer."""
        count, flat = len(hidden), hidden[:, :2].reshape(len(hidden), -1)
        weighted = [flat] + (
            [] if self._mask is None else [flat * m[:, None] for m in self._mask.T]
        )
        every = []
        for gram, moving in zip(self._grams, weighted, strict=True):
            cross = np.hsplit((moving.T @ self.skipped).T / count, 2)
            squares = _products(moving.reshape(count, 2, -1), count)
            every.append(self._bordered(gram, np.array(cross), squares))
        dynamic = every[:1] * (self._measured.shape[1] // 2) if self._mask is None else every[1:]
        return NormalEquations(
            every[0],
            tuple(dynamic),
            np.vstack([self._value_data, hidden[:, 0].T @ self._measured / count]),
            np.concatenate([self.skipped[0], hidden[0, 0]]),
            self._measured[0],
        )

    def _bordered(self, gram: FloatArray, cross: FloatArray, squares: FloatArray) -> FloatArray:
        """(2, 2, K, K) from products of (1, φ) (1 + F, 1 + F), with h and dh/dt, and of these."""
        size, slope = len(gram), self._slope
        before, behind = slice(size), slice(size, None)
        grams = np.empty((2, 2, size + cross.shape[2], size + cross.shape[2]))
        with_rate = gram @ slope
        grams[0, 0, before, before], grams[0, 1, before, before] = gram, with_rate
        grams[1, 0, before, before], grams[1, 1, before, before] = with_rate.T, slope.T @ with_rate
        grams[0, :, before, behind], grams[1, :, before, behind] = cross, slope.T @ cross
        grams[:, :, behind, before] = grams[:, :, before, behind].transpose(1, 0, 3, 2)
        grams[:, :, behind, behind] = squares
        return grams

    def seen(self, hidden: FloatArray) -> FloatArray:
        """(N, 1 + order, K) Φ and its derivatives."""
        features = self.network.with_rates(self.skipped, self._order)
        return np.concatenate([np.stack(features, axis=1), hidden], axis=2)

    def seen_at(self, time: FloatArray) -> FloatArray:
        """(N, 1 + order, K) the same at other instants (N,), for the present hidden layers."""
        features = self.network.features(time, self._order)
        parts = zip(features, self.network.activations(features), strict=True)
        return np.stack([np.concatenate(part, axis=1) for part in parts], axis=1)

    def late(self, hidden: FloatArray, lag: Seconds, delay: Seconds) -> FloatArray:
        """(N, 2, K) what an acceleration behind a lag λ or a delay d sees: Φ(t - d), Φ' + λΦ''."""
        seen = self.seen(hidden)
        rate = seen[:, 1] + lag * seen[:, 2] if lag else seen[:, 1]
        then = self.seen_at(np.maximum(self._time - delay, 0.0)) if delay else seen
        return np.stack([then[:, 0], rate], axis=1)

    def past_hidden(self, weights: FloatArray) -> FloatArray:
        """(N, 1 + order, 2M+1) the skip connection's part, for the output layer (K, 2M+1)."""
        parts = self.network.derived(weights[: self.skipped.shape[1]], self._order)
        outputs = np.hstack(parts).T @ self.skipped.T  # faster than the other way round
        return outputs.T.reshape(len(self.skipped), len(parts), -1)

    def surrogate(self, hidden: FloatArray, weights: FloatArray) -> FloatArray:
        """(1 + order, N, 2M+1) outputs and their derivatives."""
        through = hidden.reshape(-1, hidden.shape[2]) @ weights[self.skipped.shape[1] :]
        outputs = self.past_hidden(weights)
        return (outputs + through.reshape(outputs.shape)).swapaxes(0, 1)


def _products(columns: FloatArray, count: int) -> FloatArray:
    """(2, 2, K, K) of values and rates (n, 2, K)."""
    flat = columns.reshape(len(columns), -1)
    products = (flat.T @ flat / count).reshape(2, columns.shape[2], 2, -1)
    return np.asarray(products.swapaxes(1, 2))


def solve_output(sums: NormalEquations, theta: FloatArray, config: PinnConfig) -> FloatArray:
    """The output layer W (K, 2M+1) that minimises Ψ for the parameters θ (M, 3)."""
    kinematic = _form(_GAP_RATE, config.weight_physics[0])

    def blocks(follower: int) -> FloatArray:
        """The follower's squared residuals of both equations."""
        alpha, alpha_tau, beta = theta[follower]
        residual = np.array([[-alpha, alpha_tau + beta, -beta], [0.0, 1.0, 0.0]])
        dynamic, grams = _form(residual, config.weight_physics[1]), sums.dynamic_grams[follower]
        if grams is sums.grams:
            return _squares(kinematic + dynamic, grams)
        return _squares(kinematic, sums.grams) + _squares(dynamic, grams)

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

    The blocks (3K, 3K) are a follower's squared residuals, by its gap, its speed and the speed
    ahead; their lower triangles are read.
    """
    size, followers = len(sums.first), right.shape[1] // 2
    speed_columns, gap_columns = output_columns(followers)
    (s_gap, s_speed), restart = config.weight_data, config.weight_initial
    at_first = restart * np.outer(sums.first, sums.first)
    of_gap, of_speed = (s * sums.value_value + at_first for s in (s_gap, s_speed))
    gap, speed = slice(size), slice(size, 2 * size)

    # From the last follower to the first: what is left of those behind on their speed ahead.
    behind, given = np.zeros((size, size)), np.zeros((size, right.shape[2]))
    eliminated: list[tuple[FloatArray, FloatArray]] = []
    for follower in reversed(range(followers)):
        system, goal = blocks(follower), np.zeros((3 * size, right.shape[2]))
        system[gap, gap] += of_gap
        system[speed, speed] += of_speed + behind
        goal[gap] = right[:, gap_columns[follower]]
        goal[speed] = right[:, speed_columns[follower + 1]] + given
        for _ in (gap, speed):
            # As columns follow one another in memory, LAPACK takes the arrays as they are.
            factor = cholesky(system[:size, :size].copy().T, overwrite_a=True, check_finite=False)
            beside = np.concatenate([system[size:, :size], goal[:size].T]).T
            half = solve_triangular(factor, beside, "T", overwrite_b=True, check_finite=False)
            coupled, targets = half[:, : len(system) - size], half[:, len(system) - size :]
            system = system[size:, size:].copy()
            dsyrk(-1.0, coupled, 1.0, system.T, trans=True, overwrite_c=True)
            goal = goal[size:] - coupled.T @ targets
            eliminated.append((factor, half))
        behind, given = system, goal

    weights = np.empty_like(right)
    leader = cholesky((s_speed * sums.value_value + behind).T, check_finite=False)
    weights[:, 0] = cho_solve((leader, False), right[:, 0] + given, check_finite=False)
    for follower in range(followers):
        solved_before = weights[:, speed_columns[follower]]
        for column in (speed_columns[follower + 1], gap_columns[follower]):
            factor, half = eliminated.pop()
            left = half[:, len(solved_before) :] - half[:, : len(solved_before)] @ solved_before
            solved = solve_triangular(factor, left, check_finite=False)
            weights[:, column] = solved
            solved_before = np.concatenate([solved, solved_before])
    return weights


def gap_blocks(sums: NormalEquations, config: PinnConfig) -> FloatArray:
    """The part of a follower's blocks that comes from the rate of its gap."""
    return _squares(_form(_GAP_RATE, config.weight_physics[0]), sums.grams)


def _form(residual: FloatArray, weight: float) -> FloatArray:
    """(2, 3, 2, 3) the weighted square of a residual (2, 3), as `_GAP_RATE` is."""
    return np.asarray(weight * np.multiply.outer(residual, residual))


def _squares(form: FloatArray, grams: FloatArray) -> FloatArray:
    """(3K, 3K) the lower blocks of a form's sum over instants; those above stay zero."""
    size, (rows, columns) = grams.shape[2], np.tril_indices(3)
    blocks = np.zeros((3, size, 3, size))
    sums = np.tensordot(form[:, rows, :, columns], grams)
    for row, column, block in zip(rows, columns, sums, strict=True):
        blocks[row, :, column] = block
    return blocks.reshape(3 * size, 3 * size)


def parameter_equations(
    sums: NormalEquations, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(M, 3, 3) and (M, 3): the normal equations of θ for the output layer (K, 2M+1)."""
    followers = weights.shape[1] // 2
    speed_columns, gap_columns = output_columns(followers)
    grams, targets = [], []
    for follower in range(followers):
        speed = weights[:, speed_columns[follower + 1]]
        relative = weights[:, speed_columns[follower]] - speed
        terms = np.stack([weights[:, gap_columns[follower]], -speed, relative], axis=1)
        dynamic = sums.dynamic_grams[follower]
        grams.append(terms.T @ dynamic[0, 0] @ terms)
        targets.append(terms.T @ (dynamic[0, 1] @ speed))
    return np.stack(grams), np.stack(targets)
