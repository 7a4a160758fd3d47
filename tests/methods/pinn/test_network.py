"""The surrogate network: its size, its first weights, and its exact time derivative."""

from typing import get_args

import numpy as np
import pytest
import torch

from accpinn.errors import ConfigError
from accpinn.methods.pinn.config import PAPER, PresetName, preset
from accpinn.methods.pinn.method import FourierFeatures, output_columns, redraw, stack_outputs
from accpinn.methods.pinn.network import Adam, Derivative, PaperNetwork, count_weights
from tests.support.methods import train
from tests.support.samples import NOISY, sample

DOUBLE = torch.float64


def nested_rates(outputs: torch.Tensor, time: torch.Tensor) -> torch.Tensor:
    """(N, outputs) time derivatives by one gradient call an output, as the paper's authors do."""
    columns = [
        torch.autograd.grad(column.sum(), time, create_graph=True)[0] for column in outputs.T
    ]
    return torch.stack(columns, 1)


@pytest.mark.parametrize("followers", [1, 4])
def test_tangent_is_automatic_differentiations_time_derivative(followers: int) -> None:
    network = PaperNetwork(followers, PAPER.hidden, seed=3)
    time = torch.linspace(0, 20, 40, dtype=DOUBLE, requires_grad=True)
    outputs, rates = network(time)
    expected = nested_rates(outputs, time)
    assert float(expected.detach().abs().max()) > 0.01
    torch.testing.assert_close(rates, expected, rtol=1e-12, atol=1e-14)


def test_gradient_through_the_tangent_is_that_through_nested_differentiation() -> None:
    network = PaperNetwork(2, PAPER.hidden, seed=5)
    time = torch.linspace(0, 20, 40, dtype=DOUBLE, requires_grad=True)
    (network(time)[1] ** 2).sum().backward()
    ours = [weight.grad.clone() for weight in network.parameters() if weight.grad is not None]
    network.zero_grad()
    (nested_rates(network(time)[0], time) ** 2).sum().backward()
    theirs = [weight.grad for weight in network.parameters() if weight.grad is not None]
    # The output layer's bias moves no rate: the tangent leaves it out, nesting says zero.
    assert len(ours) == 7
    for mine, nested in zip(ours, theirs, strict=False):
        torch.testing.assert_close(mine, nested, rtol=1e-9, atol=1e-12)


def test_first_weights_are_as_many_as_the_paper_says_xavier_uniform_and_biases_zero() -> None:
    assert [count_weights(PaperNetwork(m, PAPER.hidden, seed=0)) for m in (1, 3, 4)] == [
        7623,
        7867,
        7989,
    ]
    network = PaperNetwork(4, PAPER.hidden, seed=0)
    layers = [module for module in network.modules() if isinstance(module, torch.nn.Linear)]
    assert [(layer.in_features, layer.out_features) for layer in layers] == [
        (1, 60),
        (60, 60),
        (60, 60),
        (60, 9),
    ]
    for layer in layers:
        bound = (6 / (layer.in_features + layer.out_features)) ** 0.5
        size = layer.weight.detach().abs()
        assert bool((size <= bound).all())
        assert float(size.max()) > 0.9 * bound
        # A uniform density has its standard deviation at bound/√3.
        assert float(layer.weight.detach().std()) == pytest.approx(bound / 3**0.5, rel=0.2)
        assert not layer.bias.any()


@pytest.mark.parametrize("followers", [1, 2, 10])
def test_output_order_there_and_back(followers: int) -> None:
    rng = np.random.default_rng(followers)
    speeds = rng.standard_normal((5, followers + 1))
    gaps = rng.standard_normal((5, followers))
    stacked = stack_outputs(speeds, gaps)
    speed_columns, gap_columns = output_columns(followers)
    assert sorted(speed_columns + gap_columns) == list(range(2 * followers + 1))
    assert (speed_columns[:2], gap_columns[:1]) == ([0, 1], [2])
    np.testing.assert_array_equal(stacked[:, speed_columns], speeds)
    np.testing.assert_array_equal(stacked[:, gap_columns], gaps)


class TestFeatures:
    def test_the_derivative_is_the_numerical_one(self) -> None:
        features = FourierFeatures(60.0, 0.5)
        time, width = np.linspace(1, 59, 50), 1e-5
        numerical = (features(time + width) - features(time - width)) / (2 * width)
        derivative = Derivative(torch.from_numpy(features.factors))
        exact, unit = derivative.of(torch.from_numpy(features(time))), torch.eye(features.size)
        np.testing.assert_allclose(exact, numerical, rtol=1e-7, atol=1e-8)
        matrix = derivative.times(unit)
        np.testing.assert_allclose(features(time) @ matrix.numpy(), exact, rtol=1e-12)
        assert torch.equal(derivative.transposed(unit), matrix.T)

    def test_reach_from_a_cycle_in_somewhat_more_than_the_window_to_the_highest(self) -> None:
        features = FourierFeatures(300.0, 0.1)
        hertz = features.angular / (2 * np.pi)
        assert hertz[0] * 300 == pytest.approx(1 / 1.1)
        assert hertz[-1] == pytest.approx(0.1)
        np.testing.assert_allclose(np.diff(hertz), hertz[0], rtol=1e-9)
        assert len(FourierFeatures(10.0, 0.01).angular) == 4, "also in a short window"


SHAPES = ((3, 2), (4,), (2, 3))


def weights(seed: int = 0) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return [
        torch.randn(shape, generator=generator, dtype=torch.float64).requires_grad_()
        for shape in SHAPES
    ]


def descend(tensors: list[torch.Tensor], step: int) -> None:
    """Gradients of a quartic that changes from step to step, sizes apart by orders."""
    total = sum(
        10.0 ** (2 * k) * ((tensor - 0.1 * step) ** 4).sum() for k, tensor in enumerate(tensors)
    )
    total.backward()


@pytest.mark.parametrize("b2", [0.999, 0.99])
def test_adam_equals_torchs_over_fifty_steps(b2: float) -> None:
    ours, theirs = weights(), weights()
    adam, reference = Adam(ours, b2=b2), torch.optim.Adam(theirs, betas=(0.9, b2))
    for step in range(50):
        rate = 0.01 * 0.5 ** (step / 20)
        descend(ours, step)
        adam.step(rate)
        reference.param_groups[0]["lr"] = rate
        reference.zero_grad()
        descend(theirs, step)
        reference.step()
    moved = max(float((a - b).abs().max().detach()) for a, b in zip(ours, weights(), strict=True))
    assert moved > 0.1
    for mine, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(mine, other, rtol=1e-12, atol=1e-14)


def test_adam_continues_from_its_state_bit_for_bit() -> None:
    straight, broken = weights(), weights()
    first = Adam(straight)
    for step in range(5):
        descend(straight, step)
        first.step(0.01)
    state = first.state()
    with torch.no_grad():
        for tensor, now in zip(broken, straight, strict=True):
            tensor.copy_(now)
    second = Adam(broken)
    second.restore(state)
    for step in range(5, 10):
        for adam, tensors in ((first, straight), (second, broken)):
            descend(tensors, step)
            adam.step(0.01)
    assert second.steps == 10
    for mine, other in zip(straight, broken, strict=True):
        assert torch.equal(mine, other)


@pytest.mark.parametrize("name", get_args(PresetName))
def test_layers_and_width_shape_the_network_and_its_curves_can_be_drawn_again(
    name: PresetName,
) -> None:
    segment = sample(NOISY).segment
    config = preset(name, iterations=10, layers=2, width=20)
    fit = train(segment, "II", config, threads=1)
    weights = [array for key, array in fit.arrays.items() if "hidden" in key and "weight" in key]
    assert [array.shape[0] for array in weights] == [20, 20]
    drawn = redraw(fit, segment.time, segment.window.duration)
    assert fit.surrogate is not None
    assert np.allclose(drawn.gaps, fit.surrogate.gaps, atol=2e-3)
    with pytest.raises(ConfigError):
        preset(name, layers=7)
    with pytest.raises(ConfigError):
        preset(name, width=4)
