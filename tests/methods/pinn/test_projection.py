"""The exact solves of output layer and parameters against dense least squares."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import Motion, loss_terms
from accpinn.methods.pinn.projection import NormalEquations, solve_output, solve_parameters
from accpinn.model.cthp import Case
from accpinn.units import FloatArray, Mask
from tests.support.methods import WEIGHTED


@dataclass(frozen=True, eq=False)
class Drawn:
    """Random activations (N, K), their rates, data (N, 2M+1) and parameters (M, 3)."""

    value: FloatArray
    rate: FloatArray
    data: FloatArray
    theta: FloatArray

    @property
    def followers(self) -> int:
        return len(self.theta)

    @property
    def seen(self) -> FloatArray:
        return np.stack([self.value, self.rate], axis=1)

    def sums(self, mask: Mask | None = None) -> NormalEquations:
        return NormalEquations.of(self.seen, self.data, mask)

    def loss(self, weights: FloatArray, theta: FloatArray, config: PinnConfig) -> float:
        """Ψ of the output layer ``weights`` with parameters ``theta``."""
        outputs, rates = self.value @ weights, self.rate @ weights
        return float(loss_terms(Motion(outputs, rates), self.data, theta, config).total)


def draw(followers: int, seed: int = 0, instants: int = 60, width: int = 7) -> Drawn:
    rng = np.random.default_rng(seed)
    return Drawn(
        rng.standard_normal((instants, width)),
        rng.standard_normal((instants, width)),
        rng.standard_normal((instants, 2 * followers + 1)),
        rng.uniform(0, 2, (followers, 3)),
    )


def by_dense_least_squares(
    drawn: Drawn, config: PinnConfig, mask: Mask | None = None
) -> FloatArray:
    """(K, 2M+1): all residuals of Ψ stacked as rows over all weights, in one solve."""
    value, rate, data = drawn.value, drawn.rate, drawn.data
    instants, width = value.shape
    followers, outputs = drawn.followers, 2 * drawn.followers + 1
    (q_gap, q_speed), (s_gap, s_speed) = config.weight_physics, config.weight_data
    rows, right = [], []

    def add(weight: float, terms: dict[int, FloatArray], goal: FloatArray) -> None:
        block = np.zeros((len(goal), outputs * width))
        for output, factor in terms.items():
            block[:, output * width : (output + 1) * width] = factor
        rows.append(np.sqrt(weight) * block)
        right.append(np.sqrt(weight) * goal)

    scale, nothing = 1 / (instants * followers), np.zeros(instants)
    first = config.weight_initial / followers
    add(scale * s_speed, {0: value}, data[:, 0])
    for follower, (alpha, alpha_tau, beta) in enumerate(drawn.theta):
        ahead = 0 if follower == 0 else 2 * follower - 1
        own, gap = 2 * follower + 1, 2 * follower + 2
        add(scale * q_gap, {gap: rate, ahead: -value, own: value}, nothing)
        model = {own: rate + (alpha_tau + beta) * value, gap: -alpha * value, ahead: -beta * value}
        counts = slice(None) if mask is None else mask[:, follower]
        counted = {output: factor[counts] for output, factor in model.items()}
        add(scale * q_speed, counted, nothing[counts])
        add(scale * s_gap, {gap: value}, data[:, gap])
        add(scale * s_speed, {own: value}, data[:, own])
        add(first, {gap: value[:1]}, data[:1, gap])
        add(first, {own: value[:1]}, data[:1, own])
    solved = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0]
    return solved.reshape(outputs, width).T


class TestOutputLayer:
    @pytest.mark.parametrize("config", [PinnConfig(), WEIGHTED], ids=["plain", "weighted"])
    @pytest.mark.parametrize("masked", [False, True])
    @pytest.mark.parametrize(("followers", "scale"), [(1, 1.0), (2, 0.0), (3, 1.0)])
    def test_is_the_global_minimum(
        self, followers: int, scale: float, masked: bool, config: PinnConfig
    ) -> None:
        drawn = draw(followers, seed=followers)
        drawn.theta[:] *= scale  # parameters at zero are no special case
        mask = np.random.default_rng(5).random((60, followers)) < 0.7 if masked else None
        solved = solve_output(drawn.sums(mask), drawn.theta, config)
        expected = by_dense_least_squares(drawn, config, mask)
        np.testing.assert_allclose(solved, expected, rtol=1e-7, atol=1e-8)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.sampled_from(["I", "II"]))
def test_rounds_of_both_solves_never_raise_the_loss(seed: int, followers: int, case: Case) -> None:
    drawn = draw(followers, seed)
    sums, theta = drawn.sums(), np.tile(drawn.theta[0], (followers, 1))
    losses = []
    for _ in range(5):
        weights = solve_output(sums, theta, WEIGHTED)
        losses.append(drawn.loss(weights, theta, WEIGHTED))
        theta = solve_parameters(sums, weights, case).theta
        losses.append(drawn.loss(weights, theta, WEIGHTED))
    assert (np.diff(losses) <= 1e-12 * losses[0]).all()
    assert losses[-1] < losses[0]
