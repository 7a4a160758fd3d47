"""PyTorch's Adam by its function: the class `torch.optim.Adam` loads a compiler for a second.

Source: Kingma and Ba 2014.
"""

from collections.abc import Sequence
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.optim.adam import adam

from accpinn.methods.pinn.network import State


class Adam:
    """The optimiser's moments of some weights."""

    def __init__(self, weights: Sequence[Tensor], b2: float = 0.999) -> None:
        """The moments start at zero; b2 is the share of the squares' mean kept in a step."""
        self._weights, self._b2 = list(weights), b2
        self._means, self._squares = ([torch.zeros_like(w) for w in weights] for _ in range(2))
        self._steps = [torch.zeros(()) for _ in weights]

    @torch.no_grad()
    def step(self, loss: Tensor, learning_rate: float) -> None:
        """Move the weights along the gradient of a loss."""
        with torch.enable_grad():
            slopes = torch.autograd.grad(loss, self._weights)
        adam(
            self._weights, list(slopes), self._means, self._squares, [], self._steps,
            foreach=False, amsgrad=False, beta1=0.9, beta2=self._b2, lr=learning_rate,
            weight_decay=0.0, eps=1e-8, maximize=False,
        )  # fmt: skip

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Moments and count of steps, by name."""
        named = zip(self._means, self._squares, self._steps, strict=True)
        return {
            f"adam.{k}.{part}": values.numpy().copy()
            for k, group in enumerate(named)
            for part, values in enumerate(group)
        }

    def load_arrays(self, state: State) -> None:
        """Continue from what `arrays` gave."""
        for k, group in enumerate(zip(self._means, self._squares, self._steps, strict=True)):
            for part, values in enumerate(group):
                values.copy_(torch.tensor(state[f"adam.{k}.{part}"]))
