"""The loss Ψ against its formulas, and the exact solves, at whose ends it has no slope."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import Motion, loss_terms, stack_outputs
from accpinn.methods.pinn.projection import NormalEquations, solve_output, solve_parameters
from accpinn.model.cthp import Case
from accpinn.model.registry import FOLLOWING
from accpinn.units import FloatArray, Mask
from tests.support.methods import WEIGHTED


def draw(followers: int, seed: int = 0, instants: int = 7) -> list[np.ndarray]:
    """Surrogate, its rates and the data as speeds and gaps each; parameters α, β, τ at the end."""
    rng = np.random.default_rng(seed)
    shapes = [(instants, followers + 1), (instants, followers)] * 3
    return [*(rng.standard_normal(shape) for shape in shapes), rng.uniform(0, 2, (followers, 3))]


def by_loops(drawn: list[np.ndarray], config: PinnConfig) -> tuple[float, float, float]:
    """Ψ_D, Ψ_F and Ψ_R as the paper writes them."""
    v, p, dv, dp, v_data, p_data, table = drawn
    instants, followers = p.shape
    (q_gap, q_speed), (s_gap, s_speed) = config.weight_physics, config.weight_data
    data = physics = initial = 0.0
    for t in range(instants):
        data += s_speed * (v_data[t, 0] - v[t, 0]) ** 2
        for i in range(1, followers + 1):
            alpha, beta, tau = table[i - 1]
            gap, ahead, own = p[t, i - 1], v[t, i - 1], v[t, i]
            data += s_gap * (p_data[t, i - 1] - gap) ** 2 + s_speed * (v_data[t, i] - own) ** 2
            physics += q_gap * (dp[t, i - 1] - ahead + own) ** 2
            accelerates = alpha * (gap - tau * own) + beta * (ahead - own)
            physics += q_speed * (dv[t, i] - accelerates) ** 2
    for i in range(1, followers + 1):
        initial += (p_data[0, i - 1] - p[0, i - 1]) ** 2 + (v_data[0, i] - v[0, i]) ** 2
    scale = 1 / (instants * followers)
    return scale * data, scale * physics, config.weight_initial / followers * initial


def evaluate(
    drawn: list[np.ndarray], config: PinnConfig, kind: Callable[[np.ndarray], Any]
) -> tuple[float, float, float, float]:
    v, p, dv, dp, v_data, p_data, table = drawn
    alpha, beta, tau = table.T
    outputs, rates, measured = (
        stack_outputs(v, p),
        stack_outputs(dv, dp),
        stack_outputs(v_data, p_data),
    )
    arrays = outputs, rates, measured, np.stack([alpha, alpha * tau, beta], 1)
    terms = loss_terms(Motion(*map(kind, arrays[:2])), *map(kind, arrays[2:]), config)
    return float(terms.data), float(terms.physics), float(terms.initial), float(terms.total)


@pytest.mark.parametrize("kind", [np.asarray, torch.from_numpy], ids=["numpy", "torch"])
@pytest.mark.parametrize("followers", [1, 2, 4])
@pytest.mark.parametrize("config", [PinnConfig(), WEIGHTED], ids=["plain", "weighted"])
def test_is_what_the_formulas_say(
    followers: int, config: PinnConfig, kind: Callable[[np.ndarray], Any]
) -> None:
    drawn = draw(followers, seed=followers)
    expected = by_loops(drawn, config)
    *terms, total = evaluate(drawn, config, kind)
    np.testing.assert_allclose(terms, expected, rtol=1e-12)
    assert total == pytest.approx(sum(expected), rel=1e-12)


@pytest.mark.parametrize("key", ["cthp-lag", "cthp-delay"])
def test_a_lag_has_the_second_derivative_and_a_delay_the_earlier_command(key: str) -> None:
    v, p, dv, dp, ddv, ddp, table = draw(2)
    earlier = np.random.default_rng(1).standard_normal((3, *p.shape))
    outputs, rates, late = stack_outputs(v, p), stack_outputs(dv, dp), np.array([0.4, 0.7])
    given = {"cthp-lag": {"bends": stack_outputs(ddv, ddp)}, "cthp-delay": {"earlier": earlier}}
    alpha, beta, tau = table.T
    theta = np.stack([alpha, beta, tau, late])
    motion = Motion(outputs, rates, **given[key])
    terms = loss_terms(motion, outputs, theta, PinnConfig(), model=FOLLOWING[key])
    gap, own, ahead = (p, v[:, 1:], v[:, :-1]) if key == "cthp-lag" else earlier
    command = alpha * (gap - tau * own) + beta * (ahead - own)
    reached = dv[:, 1:] + (late * ddv[:, 1:] if key == "cthp-lag" else 0.0)
    squares = (reached - command) ** 2 + (dp - v[:, :-1] + v[:, 1:]) ** 2
    assert terms.physics == pytest.approx(squares.mean(), rel=1e-12)


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


def activations(followers: int, seed: int = 0, instants: int = 60, width: int = 7) -> Drawn:
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
    drawn = activations(followers, seed=followers)
    drawn.theta[:] *= scale  # parameters at zero are no special case
    mask = np.random.default_rng(5).random((60, followers)) < 0.7 if masked else None
    solved = solve_output(drawn.sums(mask), drawn.theta, config)
    _, slopes = drawn.loss(solved, drawn.theta, config, mask)
    _, before = drawn.loss(np.zeros_like(solved), drawn.theta, config, mask)
    assert np.abs(slopes).max() < 1e-9 * np.abs(before).max()


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.sampled_from(["I", "II"]))
def test_rounds_of_both_solves_never_raise_the_loss(seed: int, followers: int, case: Case) -> None:
    drawn = activations(followers, seed)
    sums, theta = drawn.sums(), np.tile(drawn.theta[0], (followers, 1))
    losses = []
    for _ in range(5):
        weights = solve_output(sums, theta, WEIGHTED)
        losses.append(drawn.loss(weights, theta, WEIGHTED)[0])
        theta = solve_parameters(sums, weights, case).theta
        losses.append(drawn.loss(weights, theta, WEIGHTED)[0])
    assert (np.diff(losses) <= 1e-12 * losses[0]).all()
    assert losses[-1] < losses[0]
