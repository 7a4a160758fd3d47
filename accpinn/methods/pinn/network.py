"""The network of all presets: time in, speeds and space-gaps with their time derivatives out.

Time t [s] goes in as it is (`paper`), or as Fourier features of a window of duration T,

    φ(t) = (2t/T - 1, sin ω_1 t, .., sin ω_n t, cos ω_1 t, .., cos ω_n t),   ω as in `config`.

With a constant before them, their derivative is a linear function of themselves, d(1, φ)/dt =
(1, φ) L. Tanh layers follow, through which the derivatives in time go along,

    h = tanh z,   dh/dt = (1 - h²) dz/dt,   z = W h + b of the layer before,
    d²h/dt² = (1 - h²) (d²z/dt² - 2h (dz/dt)²)   where the second one is asked for,

so one pass serves all outputs without nested differentiation. The output layer is linear. It sees
the last h, and before it φ where there are Fourier features (a skip connection).

The formulas serve numpy's arrays and torch's tensors alike: who trains weights by gradient takes
them as tensors, who only draws curves needs no PyTorch. Of several windows each has a network of
its own, all drawn by the same seed, so that their order does not matter.

Source: Apostolakis and Ampountolas 2024, section V.B, for the network on raw time; Tancik et al.,
NeurIPS 2020, for Fourier features.
"""

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import Array, library_of
from accpinn.units import FloatArray, Seconds

if TYPE_CHECKING:
    from torch import Tensor

State = Mapping[str, NDArray[Any]]
"""Arrays by name, of a network or an optimiser."""


class Layer(NamedTuple):
    """Weights (outputs, inputs) and biases (outputs,), arrays or tensors."""

    weight: Any
    bias: Any


class Network:
    """See the module's head; all in double precision.

    With the paper's settings it is 1-60-60-60-(2M+1): 7,623 weights for M = 1 and 7,989 for M = 4.
    """

    def __init__(self, followers: int, config: PinnConfig, duration: Seconds) -> None:
        """Draw Xavier-uniform weights by the seed, for M followers; biases are zero."""
        self._duration = duration
        self._angular = config.angular_frequencies(duration)
        skipped = 2 * len(self._angular) + 1 if len(self._angular) else 0
        sizes = (skipped or 1, *config.layers * [config.width])
        dice = np.random.RandomState(config.seed)
        self.hidden = [_layer(*pair, dice) for pair in pairwise(sizes)]
        dice = np.random.RandomState((config.seed + 1) % 2**32)
        self.output = _layer(skipped + config.width, 2 * followers + 1, dice)

    def learnable(self) -> "Network":
        """The same network with tensors as weights, which share these arrays' memory."""
        import torch

        shared = copy(self)
        *shared.hidden, shared.output = (
            Layer(*(torch.from_numpy(values).requires_grad_() for values in layer))
            for layer in (*self.hidden, self.output)
        )
        return shared

    def features(self, time: Array, order: int = 1) -> tuple[Array, ...]:
        """(N,) seconds to the first layer's inputs (N, F), and their derivatives up to an order."""
        library, column = library_of(time), time[:, None]
        lines = column, library.ones_like(column), library.zeros_like(column)
        if not len(self._angular):
            return lines[: order + 1]
        angular, scale = library.asarray(self._angular), 2 / self._duration
        # e^(ikωt) as powers of e^(iωt), which takes a third of the time of sines and cosines.
        first = library.exp(1j * self._angular[0] * column)
        powers = library.cumprod(library.broadcast_to(first, (len(time), len(angular))), 1)
        sine, cosine, rows = powers.imag, powers.real, list[Any]()
        for line in (scale * column - 1, scale * lines[1], lines[2])[: order + 1]:
            if rows:
                sine, cosine = angular * cosine, -angular * sine
            rows.append(library.concatenate((line, sine, cosine), axis=1))
        return tuple(rows)

    def activations(self, features: Sequence[Array]) -> tuple[Array, ...]:
        """The last tanh layer (N, width) and its derivatives, from those of `features`."""
        return self._activated(_through(self.hidden[0], features))

    def activated(self, seen: Array, layer: Array) -> tuple[Array, ...]:
        """The same from (1, φ) (N, 1 + F) and `first_layer`, in one product."""
        through: Any = (seen @ layer).reshape(len(seen), -1, len(self.hidden[0].bias))
        return self._activated([through[:, k] for k in range(through.shape[1])])

    def _activated(self, through: Sequence[Array]) -> tuple[Array, ...]:
        """The last layer and its derivatives, from those of the first layer's z."""
        rows: list[Any] = _tanh(through)
        for layer in self.hidden[1:]:
            rows = _tanh(_through(layer, rows))
        return tuple(rows)

    def derived(self, weights: Array, order: int) -> list[Array]:
        """W, L W, L² W .. of weights W (1 + F, ..), so that (1, φ) Lᵏ W is the k-th derivative.

        W has the biases, which multiply the constant, in its first row.
        """
        count, scale = len(self._angular), 2 / self._duration
        angular, library = self._angular[:, None], library_of(weights)
        angular, parts = library.asarray(angular), [weights]
        for _ in range(order):
            line, sine, cosine = weights[1:2], weights[2 : 2 + count], weights[2 + count :]
            rows = (scale * line, 0 * line, -angular * cosine, angular * sine)
            weights = library.concatenate(rows)
            parts.append(weights)
        return parts

    def first_layer(self, order: int) -> Any:
        """(1 + F, (1 + order) width) what gives the first layer's z and its derivatives."""
        (weight, bias), library = self.hidden[0], library_of(self.hidden[0].weight)
        parts = self.derived(library.concatenate((bias[None], weight.T)), order)
        return library.concatenate(parts, axis=1)

    def __call__(self, time: Array, order: int = 1) -> tuple[Array, ...]:
        """(N,) seconds to outputs (N, 2M+1) in the order of `output_columns`, and derivatives."""
        features = self.features(time, order)
        seen = self.activations(features)
        if len(self._angular):
            concatenate = library_of(time).concatenate
            seen = tuple(concatenate(pair, axis=1) for pair in zip(features, seen, strict=True))
        outputs = [row @ self.output.weight.T for row in seen]
        outputs[0] = outputs[0] + self.output.bias
        return tuple(outputs)

    def set_output(self, weights: FloatArray) -> None:
        """Take the output layer from weights (K, 2M+1), biases in the first row."""
        self.output.bias[:], self.output.weight[:] = weights[0], weights[1:].T

    def weights(self) -> "Iterator[Tensor]":
        """Weights and biases, those of the output layer last."""
        for layer in (*self.hidden, self.output):
            yield from layer

    @property
    def size(self) -> int:
        """How many weights and biases it has."""
        return sum(array.size for array in self.arrays().values())

    def arrays(self) -> dict[str, NDArray[Any]]:
        """A copy of weights and biases, by name."""
        return {name: np.array(values) for name, values in self._named().items()}

    def load_arrays(self, state: State) -> None:
        """Take the weights and biases that `arrays` gave; other arrays are left aside.

        Raises:
            ValueError: when they are another network's.
        """
        own = self._named()
        names = {name for name in state if name.startswith(("hidden.", "output."))}
        if names != own.keys() or any(state[name].shape != own[name].shape for name in names):
            raise ValueError("these weights are another network's")
        for name, values in own.items():
            values[:] = state[name]

    def _named(self) -> dict[str, NDArray[Any]]:
        layers = {f"hidden.{k}": layer for k, layer in enumerate(self.hidden)}
        layers["output"] = self.output
        return {
            f"{name}.{part}": values
            for name, layer in layers.items()
            for part, values in layer._asdict().items()
        }


def output_arrays(weights: FloatArray) -> dict[str, NDArray[Any]]:
    """An output layer (K, 2M+1), biases in the first row, as `Network.arrays` names it."""
    return {"output.weight": weights[1:].T.copy(), "output.bias": weights[0].copy()}


def _through(layer: Layer, rows: Sequence[Any]) -> list[Any]:
    """(N, outputs) z of a layer and its derivatives, from those of the layer before."""
    through = [row @ layer.weight.T for row in rows]
    through[0] = through[0] + layer.bias
    return through


def _tanh(through: Sequence[Any]) -> list[Any]:
    """(N, width) h of a layer and its derivatives, from those of z."""
    value = library_of(through[0]).tanh(through[0])
    rows = [value, *((1 - value * value) * rate for rate in through[1:])]
    if len(rows) > 2:
        rows[2] = rows[2] - 2 * value * rows[1] * through[1]
    return rows


def _layer(inputs: int, outputs: int, dice: np.random.RandomState) -> Layer:
    """Xavier-uniform weights, the same as PyTorch draws by this seed."""
    words = dice.randint(2**32, size=(outputs, inputs, 2), dtype=np.uint64)
    drawn = (words[..., 0] << np.uint64(32) | words[..., 1]) & np.uint64(2**53 - 1)
    bound = (6 / (inputs + outputs)) ** 0.5
    return Layer(bound * (2 * (drawn / 2.0**53) - 1), np.zeros(outputs))
