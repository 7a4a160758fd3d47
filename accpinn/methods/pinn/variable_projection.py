"""The exact part of the `fast` preset: output layer and parameters, each at its optimum.

Given the activations Φ (N, K) that feed it, the output layer W (K, 2M+1) is linear and Ψ is
quadratic in it for fixed parameters, while the parameters are a 3x3 solve for fixed outputs
(variable projection, Golub and Pereyra 1973). Alternating the two lowers Ψ at every round.

Follower i's residuals involve only its own outputs (v_i, p_i) and v_{i-1}, so the normal matrix
is a chain: eliminating the last follower first leaves one K x K term on the speed ahead.

    [ B_i   C_i ] [ w_i   ]   [ r_i ]      w_i = (v_i, p_i) weights, 2K;  B_i 2K x 2K
    [ C_iᵀ  .   ] [ w_i-1 ] = [ .   ]      C_i 2K x K couples to v_{i-1}
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.network import output_columns
from accpinn.methods.regression import Solution, solve_platoon
from accpinn.model.cthp import Case
from accpinn.units import FloatArray

RIDGE = 1e-10
"""Share of the mean squared activation added to the diagonal: activations may be collinear."""


@dataclass(frozen=True, eq=False)
class GramMatrices:
    """Sums over some instants of products of activations Φ and their rates Φ', divided by N."""

    value_value: FloatArray
    """(K, K) ΦᵀΦ/N."""
    rate_value: FloatArray
    """(K, K) Φ'ᵀΦ/N."""
    rate_rate: FloatArray
    """(K, K) Φ'ᵀΦ'/N."""

    @classmethod
    def of(cls, value: FloatArray, rate: FloatArray, count: int) -> Self:
        """Of Φ and Φ' at some of the N = ``count`` instants."""
        return cls(value.T @ value / count, rate.T @ value / count, rate.T @ rate / count)


@dataclass(frozen=True, eq=False)
class NormalEquations(GramMatrices):
    """The same over all instants, with a ridge on ΦᵀΦ, and products with the data Y."""

    value_data: FloatArray
    """(K, 2M+1) ΦᵀY/N."""
    first: FloatArray
    """(K,) Φ at the first instant, for Ψ_R."""
    first_data: FloatArray
    """(2M+1,) the data at the first instant."""
    masked: tuple[GramMatrices, ...] = ()
    """(M,) over the instants at which a follower's dv/dt counts; empty where all do."""

    def of_dynamics(self, follower: int) -> GramMatrices:
        """The products in the residual of a follower's dv/dt."""
        return self.masked[follower] if self.masked else self


def solve_output(sums: NormalEquations, theta: FloatArray, config: PinnConfig) -> FloatArray:
    """The output layer W (K, 2M+1) that minimises Ψ for the parameters θ (M, 3)."""
    size, followers = len(sums.value_value), len(theta)
    speed_columns, gap_columns = output_columns(followers)
    (s_gap, s_speed), restart = config.weight_data, config.weight_initial
    at_first = restart * np.outer(sums.first, sums.first)
    target = sums.value_data.copy()
    target[:, gap_columns] *= s_gap
    target[:, speed_columns] *= s_speed
    for column in (*gap_columns, *speed_columns[1:]):
        target[:, column] += restart * sums.first_data[column] * sums.first

    links = []
    for follower in range(followers):
        dynamics = sums.of_dynamics(follower)
        own, coupling, ahead = _follower_blocks(sums, dynamics, theta[follower], config)
        own[:size, :size] += s_speed * sums.value_value + at_first
        own[size:, size:] += s_gap * sums.value_value + at_first
        right = target[:, [speed_columns[follower + 1], gap_columns[follower]]].T.reshape(-1)
        links.append(Link(own, coupling, ahead, right))
    return solve_chain(links, s_speed * sums.value_value, target[:, 0])


@dataclass(frozen=True, eq=False)
class Link:
    """A follower's part of the normal matrix; see the module's head."""

    own: FloatArray
    """(2K, 2K) B."""
    coupling: FloatArray
    """(2K, K) C."""
    ahead: FloatArray
    """(K, K) what it adds on the speed ahead."""
    right: FloatArray
    """(2K,) r."""


def solve_chain(links: Sequence[Link], leader: FloatArray, leader_right: FloatArray) -> FloatArray:
    """The weights (K, 2M+1) of a platoon; the last follower is eliminated first.

    Args:
        links: (M,) of the followers.
        leader: (K, K) what the leader's speed has of its own.
        leader_right: (K,)
    """
    size, followers = len(leader), len(links)
    speed_columns, gap_columns = output_columns(followers)
    from_behind: tuple[FloatArray, FloatArray] | None = None
    eliminated: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for link in reversed(links):
        own, right = link.own, link.right
        if from_behind is not None:
            own[:size, :size] += from_behind[0]
            right[:size] += from_behind[1]
        factor = cholesky(own, lower=True, check_finite=False)
        both = np.hstack([link.coupling, right[:, None]])
        half = solve_triangular(factor, both, lower=True, check_finite=False)
        reach, half_right = half[:, :-1], half[:, -1]
        eliminated.append((factor, reach, half_right))
        from_behind = link.ahead - reach.T @ reach, -reach.T @ half_right
    assert from_behind is not None

    factor = cholesky(leader + from_behind[0], lower=True, check_finite=False)
    right = leader_right + from_behind[1]
    weights = np.empty((size, 2 * followers + 1))
    weights[:, 0] = cho_solve((factor, True), right, check_finite=False)
    for follower, (factor, reach, half_right) in enumerate(reversed(eliminated)):
        rest = half_right - reach @ weights[:, speed_columns[follower]]
        found = solve_triangular(factor, rest, trans=1, lower=True, check_finite=False)
        weights[:, speed_columns[follower + 1]] = found[:size]
        weights[:, gap_columns[follower]] = found[size:]
    return weights


def _follower_blocks(
    sums: NormalEquations, dynamics: GramMatrices, theta: FloatArray, config: PinnConfig
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A follower's residuals squared: on itself (2K, 2K), to the speed ahead (2K, K), on it."""
    vv, rv, rr = sums.value_value, sums.rate_value, sums.rate_rate
    vv_dyn, rv_dyn, rr_dyn = dynamics.value_value, dynamics.rate_value, dynamics.rate_rate
    alpha, alpha_tau, beta = theta
    damping = alpha_tau + beta
    q_gap, q_speed = config.weight_physics
    # Residuals: g = p' - v_ahead + v  and  a = v' - αp + (ατ+β)v - βv_ahead.
    speed_speed = q_gap * vv + q_speed * (
        rr_dyn + damping * (rv_dyn + rv_dyn.T) + damping**2 * vv_dyn
    )
    gap_gap = q_gap * rr + q_speed * alpha**2 * vv_dyn
    gap_speed = q_gap * rv - q_speed * alpha * (rv_dyn.T + damping * vv_dyn)
    own = np.block([[speed_speed, gap_speed.T], [gap_speed, gap_gap]])
    speed_ahead = -q_gap * vv - q_speed * beta * (rv_dyn + damping * vv_dyn)
    gap_ahead = -q_gap * rv + q_speed * alpha * beta * vv_dyn
    coupling = np.vstack([speed_ahead, gap_ahead])
    ahead = (q_gap + q_speed * beta**2) * vv
    if dynamics is not sums:
        ahead = q_gap * vv + q_speed * beta**2 * vv_dyn
    return own, coupling, ahead


def solve_parameters(sums: NormalEquations, weights: FloatArray, case: Case) -> Solution:
    """The parameters that minimise Ψ for the output layer ``weights`` (K, 2M+1)."""
    followers = weights.shape[1] // 2
    speed_columns, gap_columns = output_columns(followers)
    grams, targets = [], []
    for follower in range(followers):
        own = weights[:, speed_columns[follower + 1]]
        relative = weights[:, speed_columns[follower]] - own
        terms = np.stack([weights[:, gap_columns[follower]], -own, relative], axis=1)
        dynamics = sums.of_dynamics(follower)
        grams.append(terms.T @ dynamics.value_value @ terms)
        targets.append(terms.T @ (dynamics.rate_value.T @ own))
    return solve_platoon(np.stack(grams), np.stack(targets), case)
