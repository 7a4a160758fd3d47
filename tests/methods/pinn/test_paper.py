"""The paper's network: its size, its first weights, and its exact time derivative."""

import pytest
import torch

from accpinn.methods.pinn.config import PAPER
from accpinn.methods.pinn.paper import PaperNetwork

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
    assert [PaperNetwork(m, PAPER.hidden, seed=0).size for m in (1, 3, 4)] == [7623, 7867, 7989]
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
