"""The network of all presets: time in, speeds and space-gaps with their time derivatives out.

Time t [s] goes in as it is (`paper`), or as Fourier features of a window of duration T,

    φ(t) = (2t/T - 1, sin ω_1 t, .., sin ω_n t, cos ω_1 t, .., cos ω_n t),   ω as in `config`.

Tanh layers follow, through which the derivative in time goes along,

    h = tanh z,   dh/dt = (1 - h²) · dz/dt,   z = W h + b of the layer before,

so one pass serves all outputs without nested differentiation. The output layer is linear. It sees
the last h, and before it φ where there are Fourier features (a skip connection).

Source: Apostolakis and Ampountolas 2024, section V.B, for the network on raw time; Tancik et al.,
NeurIPS 2020, for Fourier features.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.optim.adam import adam

from accpinn.methods.pinn.config import PinnConfig
from accpinn.units import FloatArray, Seconds

State = Mapping[str, NDArray[Any]]
"""Arrays by name, of a network or an optimiser."""


class Network(nn.Module):
    """See the module's head; all in double precision.

    With the paper's settings it is 1-60-60-60-(2M+1): 7,623 weights for M = 1 and 7,989 for M = 4.
    """

    def __init__(self, followers: int, config: PinnConfig, duration: Seconds) -> None:
        """Draw Xavier-uniform weights by the seed; biases are zero.

        Args:
            followers: M.
            config: preset, layers, width, highest frequency and seed.
            duration: length of the window, in s.
        """
        super().__init__()
        self._duration = duration
        self._angular = torch.from_numpy(config.angular_frequencies(duration))
        skipped = 2 * len(self._angular) + 1 if len(self._angular) else 0
        sizes = (skipped or 1, *config.hidden)
        generator = torch.Generator().manual_seed(config.seed)
        self._layers = [_layer(*pair, generator) for pair in pairwise(sizes)]
        self.hidden = nn.ModuleList(self._layers)
        generator = torch.Generator().manual_seed(config.seed + 1)
        self.output = _layer(skipped + config.width, 2 * followers + 1, generator)

    def features(self, time: Tensor) -> tuple[Tensor, Tensor]:
        """(N,) seconds to the first layer's inputs (N, F) and their derivatives."""
        column = time[:, None]
        if not len(self._angular):
            return column, torch.ones_like(column)
        phase, scale = column * self._angular, 2 / self._duration
        sine, cosine = torch.sin(phase), torch.cos(phase)
        rates = torch.full_like(column, scale), self._angular * cosine, -self._angular * sine
        return torch.cat([scale * column - 1, sine, cosine], 1), torch.cat(rates, 1)

    def activations(self, value: Tensor, rate: Tensor) -> tuple[Tensor, Tensor]:
        """The last tanh layer (N, width) and its derivative, from those of `features`."""
        for layer in self._layers:
            value, through = torch.tanh(layer(value)), rate @ layer.weight.T
            rate = (1 - value * value) * through
        return value, rate

    def forward(self, time: Tensor) -> tuple[Tensor, Tensor]:
        """(N,) seconds to outputs (N, 2M+1) in the order of `output_columns`, and their rates."""
        value, rate = self.features(time)
        active, active_rate = self.activations(value, rate)
        if len(self._angular):
            active, active_rate = torch.cat([value, active], 1), torch.cat([rate, active_rate], 1)
        return self.output(active), active_rate @ self.output.weight.T

    @torch.no_grad()
    def curves(self, time: FloatArray) -> FloatArray:
        """(N, 2M+1) outputs at instants (N,) in s."""
        outputs: FloatArray = self(torch.tensor(time))[0].numpy()
        return outputs

    @property
    def size(self) -> int:
        """How many weights and biases it has."""
        return sum(weights.numel() for weights in self.parameters())

    def arrays(self) -> dict[str, NDArray[Any]]:
        """A copy of weights and biases, by name."""
        return {name: weights.numpy().copy() for name, weights in self.state_dict().items()}

    def load_arrays(self, state: State) -> None:
        """Take the weights and biases that `arrays` gave; other arrays are left aside.

        Raises:
            RuntimeError: when they are another network's.
        """
        names = [name for name in state if name.startswith(("hidden.", "output."))]
        self.load_state_dict({name: torch.tensor(state[name]) for name in names})


def _layer(inputs: int, outputs: int, generator: torch.Generator) -> nn.Linear:
    layer = nn.Linear(inputs, outputs, dtype=torch.float64)
    nn.init.xavier_uniform_(layer.weight, generator=generator)
    nn.init.zeros_(layer.bias)
    return layer


class Adam:
    """PyTorch's Adam by its function: the class `torch.optim.Adam` loads a compiler for a second.

    Source: Kingma and Ba 2014.
    """

    def __init__(self, weights: list[Tensor], b2: float = 0.999) -> None:
        """The moments start at zero; b2 is the share of the squares' mean kept in a step."""
        self._weights, self._b2 = weights, b2
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
