"""The exact solves of output layer and parameters: where they end, the loss Ψ has no slope."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch
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

    def sums(self, mask: Mask | None = None) -> NormalEquations:
        return NormalEquations.of(np.stack([self.value, self.rate], axis=1), self.data, mask)

    def loss(
        self, weights: FloatArray, theta: FloatArray, config: PinnConfig, mask: Mask | None = None
    ) -> tuple[float, FloatArray]:
        """Ψ of an output layer with parameters, and its slopes along the layer's weights."""
        value, rate, data = map(torch.tensor, (self.value, self.rate, self.data))
        layer = torch.tensor(weights, requires_grad=True)
        counts = None if mask is None else torch.tensor(mask)
        motion = Motion(value @ layer, rate @ layer)
        total = loss_terms(motion, data, torch.tensor(theta), config, counts).total
        (slopes,) = torch.autograd.grad(total, [layer])
        return float(total.detach()), slopes.numpy()


def draw(followers: int, seed: int = 0, instants: int = 60, width: int = 7) -> Drawn:
    rng = np.random.default_rng(seed)
    return Drawn(
        rng.standard_normal((instants, width)),
        rng.standard_normal((instants, width)),
        rng.standard_normal((instants, 2 * followers + 1)),
        rng.uniform(0, 2, (followers, 3)),
    )


@pytest.mark.parametrize("config", [PinnConfig(), WEIGHTED], ids=["plain", "weighted"])
@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize(("followers", "scale"), [(1, 1.0), (2, 0.0), (3, 1.0)])
def test_the_output_layer_is_the_minimum(
    followers: int, scale: float, masked: bool, config: PinnConfig
) -> None:
    """Ψ is a sum of squares of what is linear in the weights: without slope it is least."""
    drawn = draw(followers, seed=followers)
    drawn.theta[:] *= scale  # parameters at zero are no special case
    mask = np.random.default_rng(5).random((60, followers)) < 0.7 if masked else None
    solved = solve_output(drawn.sums(mask), drawn.theta, config)
    _, slopes = drawn.loss(solved, drawn.theta, config, mask)
    _, before = drawn.loss(np.zeros_like(solved), drawn.theta, config, mask)
    assert np.abs(slopes).max() < 1e-9 * np.abs(before).max()


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.sampled_from(["I", "II"]))
def test_rounds_of_both_solves_never_raise_the_loss(seed: int, followers: int, case: Case) -> None:
    drawn = draw(followers, seed)
    sums, theta = drawn.sums(), np.tile(drawn.theta[0], (followers, 1))
    losses = []
    for _ in range(5):
        weights = solve_output(sums, theta, WEIGHTED)
        losses.append(drawn.loss(weights, theta, WEIGHTED)[0])
        theta = solve_parameters(sums, weights, case).theta
        losses.append(drawn.loss(weights, theta, WEIGHTED)[0])
    assert (np.diff(losses) <= 1e-12 * losses[0]).all()
    assert losses[-1] < losses[0]
