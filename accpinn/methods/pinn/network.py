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
        self._angular = config.angular_frequencies(duration)
        self._scale = 2 / duration if len(self._angular) else 1.0
        """Derivative of the first feature, which is linear in time, in 1/s."""
        skipped = 2 * len(self._angular) + 1 if len(self._angular) else 0
        sizes = (skipped or 1, *config.layers * [config.width])
        dice = np.random.RandomState(config.seed)
        self.hidden = [_layer(*pair, dice) for pair in pairwise(sizes)]
        dice = np.random.RandomState((config.seed + 1) % 2**32)
        self.output = _layer(skipped + config.width, 2 * followers + 1, dice)

    def learnable(self) -> "Network":
        """A copy of the network with tensors as weights, which share these arrays' memory."""
        import torch

        shared = copy(self)
        *shared.hidden, shared.output = (
            Layer(*(torch.from_numpy(values).requires_grad_() for values in layer))
            for layer in (*self.hidden, self.output)
        )
        return shared

    def features(self, time: Array, order: int = 1) -> tuple[Array, ...]:
        """(N,) seconds to a constant and the first layer's inputs, (N, 1 + F), and derivatives."""
        library, column = library_of(time), time[:, None]
        constant = library.ones_like(column)
        if not len(self._angular):
            first = library.concatenate((constant, column), axis=1)
        else:
            # e^(ikωt) as powers of e^(iωt), which takes a third of the time of sines and cosines.
            turn = library.exp(1j * self._angular[0] * column)
            shape = len(time), len(self._angular)
            powers = library.cumprod(library.broadcast_to(turn, shape), 1)
            line = self._scale * column - 1
            parts = (constant, line, powers.imag, powers.real)
            first = library.concatenate(parts, axis=1)
        return self.with_rates(first, order)

    def with_rates(self, features: Array, order: int) -> tuple[Array, ...]:
        """A constant and features (N, 1 + F), or its derivatives, and the next ones of an order."""
        rows, library, middle = [features], library_of(features), 2 + len(self._angular)
        angular = library.asarray(self._angular)
        for _ in range(order):
            constant = features[:, :1]
            sine, cosine = features[:, 2:middle], features[:, middle:]
            parts = (0 * constant, self._scale * constant, angular * cosine, -angular * sine)
            features = library.concatenate(parts, axis=1)
            rows.append(features)
        return tuple(rows)

    def activations(self, features: Sequence[Array]) -> tuple[Array, ...]:
        """The last tanh layer (N, width) and its derivatives, from those of `features`."""
        return self.activated(_through(self.hidden[0], [row[:, 1:] for row in features]))

    def activated(self, through: Sequence[Array]) -> tuple[Array, ...]:
        """The last tanh layer from the first layer's z (N, width) and its derivatives."""
        rows: list[Any] = _tanh(through)
        for layer in self.hidden[1:]:
            rows = _tanh(_through(layer, rows))
        return tuple(rows)

    def derived(self, weights: FloatArray, order: int) -> list[FloatArray]:
        """W, L W, L² W .. of weights W (1 + F, ..), so that (1, φ) Lᵏ W is the k-th derivative.

        W has the biases, which multiply the constant, in its first row.
        """
        angular, parts, middle = self._angular[:, None], [weights], 2 + len(self._angular)
        for _ in range(order):
            line, sine, cosine = weights[1:2], weights[2:middle], weights[middle:]
            rows = (self._scale * line, 0 * line, -angular * cosine, angular * sine)
            weights = np.concatenate(rows)
            parts.append(weights)
        return parts

    def __call__(self, time: Array, order: int = 1) -> tuple[Array, ...]:
        """(N,) seconds to outputs (N, 2M+1) in the order of `output_columns`, and derivatives."""
        features = self.features(time, order)
        seen = self.activations(features)
        if len(self._angular):
            concatenate = library_of(time).concatenate
            pairs = zip(features, seen, strict=True)
            seen = tuple(concatenate((row[:, 1:], h), axis=1) for row, h in pairs)
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
        """The number of weights and biases."""
        return sum(array.size for array in self.arrays().values())

    def arrays(self) -> dict[str, NDArray[Any]]:
        """A copy of weights and biases, by name."""
        return {name: np.array(values) for name, values in self._named().items()}

    def load_arrays(self, state: State) -> None:
        """Take the weights and biases that `arrays` gave; other arrays are left aside.

        Raises:
            ValueError: when they are another network's.
        """
        tensors = self._named()
        names = {name for name in state if name.startswith(("hidden.", "output."))}
        shapes = ((state[name].shape, tensors[name].shape) for name in names & tensors.keys())
        if names != tensors.keys() or any(given != needed for given, needed in shapes):
            raise ValueError("these weights are another network's")
        for name, values in tensors.items():
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
