"""Adam, as in Kingma and Ba (2014), without the second that torch's own takes to be imported.

    m ← b₁ m + (1 - b₁) g        v ← b₂ v + (1 - b₂) g²
    w ← w - lr · m̂ / (√v̂ + ε),   m̂ = m / (1 - b₁ᵏ),  v̂ = v / (1 - b₂ᵏ)

A test holds it against `torch.optim.Adam`.
"""

from collections.abc import Iterable
from math import sqrt

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

EPSILON = 1e-8


class Adam:
    """Moves tensors along their gradients; its state is plain arrays."""

    def __init__(self, weights: Iterable[Tensor], b1: float = 0.9, b2: float = 0.999) -> None:
        """Moments start at zero."""
        self.weights = list(weights)
        self.b1, self.b2, self.steps = b1, b2, 0
        self._mean = [torch.zeros_like(weight) for weight in self.weights]
        self._square = [torch.zeros_like(weight) for weight in self.weights]

    @torch.no_grad()
    def step(self, learning_rate: float) -> None:
        """One step along the present gradients, which are cleared."""
        self.steps += 1
        size = learning_rate / (1 - self.b1**self.steps)
        correction = sqrt(1 - self.b2**self.steps)
        for weight, mean, square in zip(self.weights, self._mean, self._square, strict=True):
            gradient = weight.grad
            assert gradient is not None
            mean.lerp_(gradient, 1 - self.b1)
            square.mul_(self.b2).addcmul_(gradient, gradient, value=1 - self.b2)
            weight.addcdiv_(mean, (square.sqrt() / correction).add_(EPSILON), value=-size)
            weight.grad = None

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Moments and step count by name."""
        moments = {f"adam.mean.{k}": v.numpy().copy() for k, v in enumerate(self._mean)}
        squares = {f"adam.square.{k}": v.numpy().copy() for k, v in enumerate(self._square)}
        return {**moments, **squares, "adam.steps": np.array(self.steps)}

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Go on from ``state``."""
        for k, (mean, square) in enumerate(zip(self._mean, self._square, strict=True)):
            mean.copy_(torch.from_numpy(np.array(state[f"adam.mean.{k}"])))
            square.copy_(torch.from_numpy(np.array(state[f"adam.square.{k}"])))
        self.steps = int(state["adam.steps"])
