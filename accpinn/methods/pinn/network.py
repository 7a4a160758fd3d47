"""The surrogate network Ξ̂(t; θ) and its exact time derivative.

Hidden layers are h ← tanh(W h + b). Their time derivative needs no nested automatic
differentiation: the tangent (h, dh/dt) passes through each layer together,

    dh/dt ← (1 - tanh²) · (W dh/dt),

so one backward pass serves all 2M+1 outputs.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

HIDDEN = (60, 60, 60)
"""Neurons of the hidden layers, as in the paper."""


class HiddenLayers(nn.Module):
    """The tanh layers; they map input features to 60 activations, with their time derivative."""

    def __init__(self, inputs: int, seed: int, dtype: torch.dtype) -> None:
        """Xavier-uniform weights and zero biases, as in the paper."""
        super().__init__()
        generator = torch.Generator().manual_seed(seed)
        sizes = (inputs, *HIDDEN)
        self.layers = nn.ModuleList(
            nn.Linear(before, after, dtype=dtype) for before, after in pairwise(sizes)
        )
        for layer in self.layers:
            xavier(layer, generator)

    def forward(self, value: Tensor, rate: Tensor) -> tuple[Tensor, Tensor]:
        """(N, inputs) features and their time derivative to (N, 60) activations and theirs."""
        for layer in self.layers:
            assert isinstance(layer, nn.Linear)
            value = torch.tanh(layer(value))
            rate = (1 - value * value) * (rate @ layer.weight.T)
        return value, rate


class PaperNetwork(nn.Module):
    """The paper's network 1-60-60-60-(2M+1): 7,623 weights for M = 1 and 7,989 for M = 4."""

    def __init__(self, followers: int, seed: int) -> None:
        """Double precision; outputs in m and m/s in the order of `output_columns`."""
        super().__init__()
        self.hidden = HiddenLayers(1, seed, torch.float64)
        self.output = nn.Linear(HIDDEN[-1], 2 * followers + 1, dtype=torch.float64)
        xavier(self.output, torch.Generator().manual_seed(seed + 1))

    def forward(self, time: Tensor) -> tuple[Tensor, Tensor]:
        """(N,) seconds to (N, 2M+1) outputs and their time derivative."""
        column = time[:, None]
        value, rate = self.hidden(column, torch.ones_like(column))
        return self.output(value), rate @ self.output.weight.T


def xavier(layer: nn.Module, generator: torch.Generator) -> None:
    """Xavier-uniform weights and zero biases, drawn from ``generator``."""
    assert isinstance(layer, nn.Linear)
    nn.init.xavier_uniform_(layer.weight, generator=generator)
    nn.init.zeros_(layer.bias)


def count_weights(module: nn.Module) -> int:
    """How many numbers the module learns."""
    return sum(parameter.numel() for parameter in module.parameters())
