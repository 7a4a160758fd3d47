"""The loss Ψ against its formulas, and the exact solves, at whose ends it has no slope."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from accpinn.methods.pinn.config import FAST, PinnConfig
from accpinn.methods.pinn.loss import Motion, loss_terms, stack_outputs
from accpinn.methods.pinn.network import Network
from accpinn.methods.pinn.projection import Projection, solve_output
from accpinn.model.registry import FOLLOWING
from accpinn.units import FloatArray
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
            gap, ahead, speed = p[t, i - 1], v[t, i - 1], v[t, i]
            data += s_gap * (p_data[t, i - 1] - gap) ** 2 + s_speed * (v_data[t, i] - speed) ** 2
            physics += q_gap * (dp[t, i - 1] - ahead + speed) ** 2
            accelerates = alpha * (gap - tau * speed) + beta * (ahead - speed)
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
    theta = np.stack([alpha, alpha * tau, beta], 1)
    arrays = stack_outputs(v, p), stack_outputs(dv, dp), stack_outputs(v_data, p_data), theta
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
    gap, speed, ahead = (p, v[:, 1:], v[:, :-1]) if key == "cthp-lag" else earlier
    command = alpha * (gap - tau * speed) + beta * (ahead - speed)
    reached = dv[:, 1:] + (late * ddv[:, 1:] if key == "cthp-lag" else 0.0)
    squares = (reached - command) ** 2 + (dp - v[:, :-1] + v[:, 1:]) ** 2
    assert terms.physics == pytest.approx(squares.mean(), rel=1e-12)


@pytest.mark.parametrize("config", [PinnConfig(), WEIGHTED], ids=["plain", "weighted"])
@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize(("followers", "scale"), [(1, 1.0), (2, 0.0), (3, 1.0)])
def test_the_output_layer_is_the_minimum(
    followers: int, scale: float, masked: bool, config: PinnConfig
) -> None:
    """Ψ is a sum of squares of what is linear in the weights: without slope it is least."""
    rng = np.random.default_rng(followers)
    time = np.linspace(0.0, 8.0, 60)
    data = rng.standard_normal((60, 2 * followers + 1))
    theta = scale * rng.uniform(0, 2, (followers, 3))  # parameters at zero are no special case
    mask = rng.random((60, followers)) < 0.7 if masked else None
    network = Network(followers, replace(FAST, width=5), 8.0)
    projection = Projection(network, time, data, mask)
    hidden = projection.hidden()
    activations, rates = projection.seen(hidden).swapaxes(0, 1)

    def slopes(weights: FloatArray) -> FloatArray:
        """Those of Ψ along the weights of the output layer."""
        layer = torch.tensor(weights, requires_grad=True)
        motion = Motion(torch.tensor(activations) @ layer, torch.tensor(rates) @ layer)
        counts = None if mask is None else torch.tensor(mask)
        terms = loss_terms(motion, torch.tensor(data), torch.tensor(theta), config, counts)
        return torch.autograd.grad(terms.total, [layer])[0].numpy()

    solved = solve_output(projection.sums(hidden), theta, config)
    assert np.abs(slopes(solved)).max() < 1e-8 * np.abs(slopes(np.zeros_like(solved))).max()
    network.set_output(solved)
    for part, curves in zip(projection.surrogate(hidden, solved), network(time), strict=True):
        np.testing.assert_allclose(part, curves, atol=1e-9)
