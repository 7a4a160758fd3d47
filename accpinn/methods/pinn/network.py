"""The surrogate network Ξ̂(t; θ), its exact time derivative, and Adam, which trains it.

Hidden layers are h ← tanh(W h + b). Their time derivative needs no nested automatic
differentiation: the tangent (h, dh/dt) passes through each layer together,

    dh/dt ← (1 - tanh²) · (W dh/dt),

so one backward pass serves all 2M+1 outputs.

Adam is as in Kingma and Ba (2014); torch's own takes a second to be imported:

    m ← b₁ m + (1 - b₁) g        v ← b₂ v + (1 - b₂) g²
    w ← w - lr · m̂ / (√v̂ + ε),   m̂ = m / (1 - b₁ᵏ),  v̂ = v / (1 - b₂ᵏ)
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from math import sqrt
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from accpinn.methods.fit import Checkpoint

EPSILON = 1e-8
"""Adam's ε."""

Slope = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]


class Derivative:
    """The matrix S of dφ/dt = φ S for Fourier features φ, which `method.FourierFeatures` gives."""

    def __init__(self, factors: Tensor) -> None:
        """Row k of S has its one number, the k-th factor, in the column of the feature's pair."""
        self._factors = factors[:, None]
        self._pairs = torch.arange(len(factors)) ^ 1

    def times(self, rows: Tensor) -> Tensor:
        """S x for (size, L) x."""
        return self._factors * rows[self._pairs]

    def transposed(self, rows: Tensor) -> Tensor:
        """Sᵀ x for (size, L) x."""
        return (self._factors * rows)[self._pairs]

    def of(self, features: Tensor) -> Tensor:
        """(N, size) the features' time derivative."""
        return (features * self._factors.T)[:, self._pairs]


class HiddenLayers(nn.Module):
    """The tanh layers; they map input features to activations, with their time derivative."""

    def __init__(self, inputs: int, hidden: Sequence[int], seed: int, dtype: torch.dtype) -> None:
        """Xavier-uniform weights and zero biases, as in the paper; ``hidden`` are the neurons."""
        super().__init__()
        generator = torch.Generator().manual_seed(seed)
        sizes = (inputs, *hidden)
        self.layers = nn.ModuleList(
            nn.Linear(before, after, dtype=dtype) for before, after in pairwise(sizes)
        )
        for layer in self.layers:
            xavier(layer, generator)

    def forward(self, value: Tensor, rate: Tensor) -> tuple[Tensor, Tensor]:
        """(N, inputs) features and their time derivative to (N, width) activations and theirs."""
        for layer in self.linear():
            value, rate, _ = _activate(layer(value), rate @ layer.weight.T)
        return value, rate

    def linear(self) -> list[nn.Linear]:
        """The layers, the first one first."""
        return [layer for layer in self.layers if isinstance(layer, nn.Linear)]

    @torch.no_grad()
    def of_fourier(self, features: Tensor, derivative: Derivative) -> tuple[Tensor, Tensor]:
        """The same of Fourier features (N, 1 + inputs), the first of which is the constant."""
        value, rate, _ = _activate(*self._enter(features, derivative))
        for layer in self.linear()[1:]:
            value, rate, _ = _activate(layer(value), rate @ layer.weight.T)
        return value, rate

    @torch.no_grad()
    def backpropagate(self, features: Tensor, derivative: Derivative, slope: Slope) -> None:
        """Leave the gradient of a function of the activations in every weight.

        The chain rule is written out, as automatic differentiation takes several times as long.

        Args:
            features: (N, 1 + inputs), the first of which is the constant.
            derivative: of the features.
            slope: from activations (N, width) and their time derivative, the function's gradient
                with respect to both.
        """
        first, *others = self.linear()
        inner, through = self._enter(features, derivative)
        passed = [(through, *_activate(inner, through))]
        for layer in others:
            _, value, rate, _ = passed[-1]
            through = rate @ layer.weight.T
            passed.append((through, *_activate(layer(value), through)))
        to_value, to_rate = slope(*passed[-1][1:3])
        for k, layer in reversed([*enumerate(self.linear())]):
            through, value, _, steepness = passed[k]
            # dh/dt = (1 - h²) z depends on h, too: by -2 h z.
            to_inner = steepness * (to_value - 2 * value * through * to_rate)
            to_through = steepness * to_rate
            layer.bias.grad = to_inner.sum(0)
            if layer is first:
                both = features.T @ torch.cat([to_inner, to_through], 1)
                of_inner, of_through = both.split(to_inner.shape[1], 1)
                layer.weight.grad = (of_inner + derivative.transposed(of_through))[1:].T
            else:
                _, value, rate, _ = passed[k - 1]
                layer.weight.grad = to_inner.T @ value + to_through.T @ rate
                to_value, to_rate = to_inner @ layer.weight, to_through @ layer.weight

    def _enter(self, features: Tensor, derivative: Derivative) -> tuple[Tensor, Tensor]:
        """W φ + b and W dφ/dt of the first layer, in one product; the constant has the bias."""
        first = self.linear()[0]
        weight = torch.cat([first.bias[:, None], first.weight], 1).T
        both = torch.cat([weight, derivative.times(weight)], 1)
        inner, through = (features @ both).split(weight.shape[1], 1)
        return inner, through


def _activate(inner: Tensor, through: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Activations h and dh/dt from z = W h + b and W dh/dt of a layer, then 1 - h²."""
    value = torch.tanh(inner)
    steepness = 1 - value * value
    return value, steepness * through, steepness


class PaperNetwork(nn.Module):
    """The paper's network 1-60-60-60-(2M+1): 7,623 weights for M = 1 and 7,989 for M = 4."""

    def __init__(self, followers: int, hidden: Sequence[int], seed: int) -> None:
        """Double precision; outputs in m and m/s in the order of `output_columns`."""
        super().__init__()
        self.hidden = HiddenLayers(1, hidden, seed, torch.float64)
        self.output = nn.Linear(hidden[-1], 2 * followers + 1, dtype=torch.float64)
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


def state_of(module: nn.Module, prefix: str) -> dict[str, NDArray[Any]]:
    """A module's weights by name, each with the prefix."""
    return {f"{prefix}{name}": value.numpy() for name, value in module.state_dict().items()}


def load_state(module: nn.Module, state: Mapping[str, NDArray[Any]], prefix: str) -> None:
    """Give a module the weights whose names begin with the prefix.

    Raises:
        ValueError: when they are another module's.
    """
    given = {
        name.removeprefix(prefix): torch.from_numpy(np.array(values))
        for name, values in state.items()
        if name.startswith(prefix)
    }
    shapes = {name: value.shape for name, value in module.state_dict().items()}
    if {name: value.shape for name, value in given.items()} != shapes:
        raise ValueError("the weights are another network's")
    module.load_state_dict(given)


class Adam:
    """Moves tensors along their gradients; its state is plain arrays."""

    b1 = 0.9

    def __init__(self, weights: Iterable[Tensor], b2: float = 0.999) -> None:
        """Moments start at zero. The tensors become parts of one, which one step moves."""
        self.weights = list(weights)
        self.b2, self.steps = b2, 0
        self._all = _joined(self.weights)
        self._mean, self._square = torch.zeros_like(self._all), torch.zeros_like(self._all)
        parts = self._all.split([weight.numel() for weight in self.weights])
        for weight, part in zip(self.weights, parts, strict=True):
            weight.data = part.view_as(weight)

    @torch.no_grad()
    def step(self, learning_rate: float) -> None:
        """One step along the present gradients, which are cleared."""
        self.steps += 1
        size = learning_rate / (1 - self.b1**self.steps)
        correction = sqrt(1 - self.b2**self.steps)
        gradient = _joined(weight.grad for weight in self.weights)
        self._mean.lerp_(gradient, 1 - self.b1)
        self._square.mul_(self.b2).addcmul_(gradient, gradient, value=1 - self.b2)
        scale = (self._square.sqrt() / correction).add_(EPSILON)
        self._all.addcdiv_(self._mean, scale, value=-size)
        for weight in self.weights:
            weight.grad = None

    def state(self) -> Checkpoint:
        """Moments and step count by name."""
        mean, square = self._mean.numpy().copy(), self._square.numpy().copy()
        return {"adam.mean": mean, "adam.square": square, "adam.steps": np.array(self.steps)}

    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``."""
        self._mean.copy_(torch.from_numpy(np.array(state["adam.mean"])))
        self._square.copy_(torch.from_numpy(np.array(state["adam.square"])))
        self.steps = int(state["adam.steps"])


def _joined(tensors: Iterable[Tensor | None]) -> Tensor:
    """All numbers of some tensors in a row."""
    parts = [tensor.detach().reshape(-1) for tensor in tensors if tensor is not None]
    return torch.cat(parts)


class Descent:
    """Hidden layers in single precision, Adam, and the generator that draws minibatches."""

    def __init__(self, inputs: int, hidden: Sequence[int], seed: int) -> None:
        """The seed is that of weights and minibatches."""
        self.hidden = HiddenLayers(inputs, hidden, seed, torch.float32)
        self.adam = Adam(self.hidden.parameters(), b2=0.99)
        self.generator = torch.Generator().manual_seed(seed)
        self._doubled = HiddenLayers(inputs, hidden, seed, torch.float64)

    def doubled(self) -> HiddenLayers:
        """The layers as they are, in double precision."""
        self._doubled.load_state_dict(self.hidden.state_dict())
        return self._doubled

    def state(self) -> Checkpoint:
        """All that is needed to go on."""
        generator = self.generator.get_state().numpy()
        return {**state_of(self.hidden, "hidden."), **self.adam.state(), "generator": generator}

    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``."""
        load_state(self.hidden, state, "hidden.")
        self.adam.restore(state)
        self.generator.set_state(torch.from_numpy(np.array(state["generator"])))
