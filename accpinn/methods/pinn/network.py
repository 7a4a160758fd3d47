"""The surrogate network of the presets `fast` and `calibrated`, and Adam, which trains it.

Time t in a window of duration T goes in as Fourier features,

    φ(t) = (1, s, sin ω_1 t, cos ω_1 t, ..., sin ω_n t, cos ω_n t),   s = 2t/T - 1 in [-1, 1],
    ω_j = 2π j / 1.1 T: whole cycles of a period that is longer than the window, up to the highest
    frequency. Half cycles per window would be twice as many features for the same motions.

Their derivative is linear in the features themselves, dφ/dt = φ S, where S swaps the features of
each pair. Hidden layers are h = tanh z, z = W h + b of the layer before; their derivatives in time
pass through each layer together with h, so one pass serves all outputs. With s = 1 - h²,

    h' = s z'        h'' = s z'' - 2hs z'²        h''' = s z''' - 6hs z' z'' + (6h² - 2)s z'³.

The gradient is the chain rule written out; automatic differentiation takes several times as long,
and a second or more to be loaded.

Adam is as in Kingma and Ba (2014):

    m ← b₁ m + (1 - b₁) g        v ← b₂ v + (1 - b₂) g²
    w ← w - lr · m̂ / (√v̂ + ε),   m̂ = m / (1 - b₁ᵏ),  v̂ = v / (1 - b₂ᵏ)
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
from math import sqrt
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from accpinn.methods.fit import Checkpoint
from accpinn.units import FloatArray, Seconds

STRETCH = 1.1
"""Period of the features, in windows: motions at its ends need not be alike."""
HIDDEN_FREQUENCY = 0.1
"""In Hz, of the features that the `calibrated` preset's hidden layers see."""
EPSILON = 1e-8
"""Adam's ε."""

Numbers = NDArray[Any]
"""In single precision where Adam moves them, else in double."""
Slope = Callable[[Numbers], Numbers]


def output_columns(followers: int) -> tuple[list[int], list[int]]:
    """Where speeds (M+1) and space-gaps (M) stand among the outputs v_0, v_1, p_1, v_2, p_2, ..."""
    return [0, *range(1, 2 * followers, 2)], list(range(2, 2 * followers + 1, 2))


def stack_outputs(speeds: FloatArray, gaps: FloatArray) -> FloatArray:
    """(N, M+1) speeds and (N, M) gaps as (N, 2M+1) in the order of `output_columns`."""
    followers = gaps.shape[1]
    stacked = np.empty((len(gaps), 2 * followers + 1))
    speed_columns, gap_columns = output_columns(followers)
    stacked[:, speed_columns], stacked[:, gap_columns] = speeds, gaps
    return stacked


@dataclass(frozen=True, eq=False)
class FourierFeatures:
    """The features of a window of ``duration`` seconds, two for each frequency and two more."""

    duration: Seconds
    angular: FloatArray
    """(n,) in rad/s."""

    @classmethod
    def up_to(cls, highest_frequency: float, duration: Seconds) -> Self:
        """At least four frequencies, up to some hertz, however short the window."""
        period = STRETCH * duration
        count = max(4, round(period * highest_frequency))
        return cls(duration, np.arange(1, count + 1, dtype=np.float64) * (2 * np.pi / period))

    def below(self, frequency: float) -> Self:
        """The first of them: those up to some hertz, and at least four frequencies."""
        count = max(4, int((self.angular <= 2 * np.pi * frequency).sum()))
        return replace(self, angular=self.angular[:count])

    @property
    def size(self) -> int:
        """How many features."""
        return 2 + 2 * len(self.angular)

    def __call__(self, time: FloatArray) -> FloatArray:
        """(N,) seconds to (N, size) features."""
        phase = np.outer(time, self.angular)
        features = np.empty((len(time), self.size))
        features[:, 0] = 1.0
        features[:, 1] = 2 * time / self.duration - 1
        features[:, 2::2] = np.sin(phase)
        features[:, 3::2] = np.cos(phase)
        return features

    def derivative(self, products: Numbers) -> Numbers:
        """Features, or products with them, (.., size) x to those with their derivative, x S."""
        return (products * self._factors(products))[..., self._other]

    def times(self, rows: Numbers) -> Numbers:
        """S x for (size, L) x."""
        return self._factors(rows)[:, None] * rows[self._other]

    def transposed(self, rows: Numbers) -> Numbers:
        """Sᵀ x for (size, L) x."""
        return (self._factors(rows)[:, None] * rows)[self._other]

    @property
    def _other(self) -> NDArray[np.int64]:
        """(size,) the other one of each feature's pair.

        Pairs are constant and slope, then the sine and cosine of each frequency.
        """
        return np.arange(self.size) ^ 1

    def _factors(self, like: Numbers) -> Numbers:
        """(size,) numbers c with dφ_k/dt = c_j φ_j for each feature k and the other, j, of a pair.

        In the precision of ``like``.
        """
        found = np.zeros(self.size, like.dtype)
        found[0] = 2 / self.duration
        found[2::2], found[3::2] = -self.angular, self.angular
        return found


class HiddenLayers:
    """The tanh layers; they map Fourier features to activations, with derivatives in time."""

    def __init__(
        self, features: FourierFeatures, hidden: Sequence[int], seed: int, order: int
    ) -> None:
        """Xavier-uniform weights and zero biases, as in the paper.

        Args:
            features: what goes in; the constant has the place of the first layer's bias.
            hidden: the layers' neurons.
            seed: of the weights.
            order: of the highest derivative, 1 or 3.
        """
        self._features, self._order = features, order
        sizes = (features.size - 1, *hidden)
        self._shapes = [(after, before) for before, after in pairwise(sizes)]
        count = sum(after * (before + 1) for after, before in self._shapes)
        self.values: Numbers = np.zeros(count)
        """All weights and biases in a row."""
        rng = np.random.default_rng(seed)
        for weight, _ in self._layers():
            bound = sqrt(6 / sum(weight.shape))
            weight[:] = rng.uniform(-bound, bound, weight.shape)

    def with_values(self, values: Numbers) -> Self:
        """The layers with other weights and biases, in their precision."""
        changed = copy(self)
        changed.values = values
        return changed

    def state(self) -> dict[str, Numbers]:
        """Weights and biases by name."""
        return {name: values.copy() for name, values in self._named().items()}

    def load(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take the weights and biases that `state` gave.

        Raises:
            ValueError: when they are another network's.
        """
        own = self._named()
        names = {name for name in state if name.startswith("hidden.")}
        if names != set(own) or any(state[name].shape != own[name].shape for name in own):
            raise ValueError("the weights are another network's")
        for name, values in own.items():
            values[:] = state[name]

    def _named(self) -> dict[str, Numbers]:
        found: dict[str, Numbers] = {}
        for k, (weight, bias) in enumerate(self._layers()):
            found |= {f"hidden.layers.{k}.weight": weight, f"hidden.layers.{k}.bias": bias}
        return found

    def _layers(self, values: Numbers | None = None) -> list[tuple[Numbers, Numbers]]:
        """Weight (after, before) and bias (after,) of each layer, as parts of ``values``."""
        rest, found = self.values if values is None else values, []
        for after, before in self._shapes:
            size = after * before
            found.append((rest[:size].reshape(after, before), rest[size : size + after]))
            rest = rest[size + after :]
        return found

    def __call__(self, features: Numbers) -> Numbers:
        """Features (N, size) to activations and their derivatives (order + 1, N, width)."""
        return self._pass(features)[-1][1]

    def gradient(self, features: Numbers, slope: Slope) -> Numbers:
        """The gradient of a function of the activations, in the order of `values`.

        Args:
            features: (N, size)
            slope: from activations and derivatives (order + 1, N, width), the function's gradient
                with respect to them.
        """
        passed, gradient = self._pass(features), np.empty_like(self.values)
        layers = list(zip(self._layers(), self._layers(gradient), passed, strict=True))
        upstream = slope(passed[-1][1])
        for k, ((weight, _), (of_weight, of_bias), (inner, active)) in reversed(
            [*enumerate(layers)]
        ):
            upstream = _pull_back(inner, active[0], upstream)
            if k == 0:
                both = features.T @ np.hstack(list(upstream))
                *lower, found = np.hsplit(both, len(upstream))
                for one in reversed(lower):
                    found = one + self._features.transposed(found)
                of_weight[:], of_bias[:] = found[1:].T, found[0]
            else:
                flat = upstream.reshape(-1, upstream.shape[2])
                below = passed[k - 1][1]
                of_weight[:] = flat.T @ below.reshape(-1, below.shape[2])
                of_bias[:] = upstream[0].sum(axis=0)
                upstream = (flat @ weight).reshape(below.shape)
        return gradient

    def _pass(self, features: Numbers) -> list[tuple[Numbers, Numbers]]:
        """Of each layer z and h with their derivatives, (order + 1, N, width) each."""
        (weight, bias), *others = self._layers()
        columns = [np.vstack([bias, weight.T])]
        for _ in range(self._order):
            columns.append(self._features.times(columns[-1]))
        inner = features @ np.hstack(columns)
        inner = np.stack(np.hsplit(inner, len(columns)))
        passed = [(inner, _activate(inner))]
        for weight, bias in others:
            below = passed[-1][1]
            inner = (below.reshape(-1, below.shape[2]) @ weight.T).reshape(*below.shape[:2], -1)
            inner[0] += bias
            passed.append((inner, _activate(inner)))
        return passed


def _activate(inner: Numbers) -> Numbers:
    """The activations of a layer with their derivatives, from z with its; see the module's head."""
    active = np.empty_like(inner)
    value = np.tanh(inner[0], out=active[0])
    steepness = 1 - value * value
    first = np.multiply(steepness, inner[1], out=active[1])
    if len(inner) > 2:
        _, rate, second, third = inner
        active[2] = steepness * second - 2 * value * first * rate
        active[3] = steepness * third - first * (
            6 * value * second - (6 * value * value - 2) * rate * rate
        )
    return active


def _pull_back(inner: Numbers, value: Numbers, upstream: Numbers) -> Numbers:
    """A function's gradient with respect to z and its derivatives, from that to h and its.

    Each h depends on the derivatives of z directly, and on z itself through h and s = 1 - h².
    """
    found, steepness, rate = np.empty_like(inner), 1 - value * value, inner[1]
    to_value = upstream[0] - 2 * value * rate * upstream[1]
    found[1] = steepness * upstream[1]
    if len(inner) > 2:
        _, _, second, third = inner
        _, _, to_second, to_third = upstream
        squared, curve = rate * rate, 6 * value * value - 2
        to_value += to_second * (4 * value * value - 2 * steepness) * squared
        to_value -= to_second * 2 * value * second
        to_value -= to_third * (
            2 * value * (third - 6 * value * rate * second + curve * rate * squared)
            + steepness * (6 * rate * second - 12 * value * rate * squared)
        )
        found[1] += steepness * (
            to_third * (3 * curve * squared - 6 * value * second) - to_second * 4 * value * rate
        )
        found[2] = steepness * (to_second - 6 * value * rate * to_third)
        found[3] = steepness * to_third
    found[0] = steepness * to_value
    return found


class Adam:
    """Moves an array along its gradient; its state is plain arrays."""

    b1 = 0.9

    def __init__(self, values: Numbers, b2: float = 0.999) -> None:
        """Moments start at zero; ``values`` change in place."""
        self.values, self.b2, self.steps = values, b2, 0
        self._mean, self._square = np.zeros_like(values), np.zeros_like(values)

    def step(self, gradient: Numbers, learning_rate: float) -> None:
        """One step along a gradient of the values."""
        self.steps += 1
        size = learning_rate / (1 - self.b1**self.steps)
        correction = sqrt(1 - self.b2**self.steps)
        self._mean += (1 - self.b1) * (gradient - self._mean)
        self._square *= self.b2
        self._square += (1 - self.b2) * gradient * gradient
        self.values -= size * self._mean / (np.sqrt(self._square) / correction + EPSILON)

    def state(self) -> Checkpoint:
        """Moments and step count by name."""
        mean, square = self._mean.copy(), self._square.copy()
        return {"adam.mean": mean, "adam.square": square, "adam.steps": np.array(self.steps)}

    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``."""
        self._mean[:], self._square[:] = state["adam.mean"], state["adam.square"]
        self.steps = int(state["adam.steps"])


class Descent:
    """Hidden layers, which Adam moves in single precision along gradients of minibatches."""

    def __init__(
        self, features: FourierFeatures, hidden: Sequence[int], seed: int, order: int
    ) -> None:
        """As `HiddenLayers`; the seed is also that of the minibatches."""
        self._seed = seed
        drawn = HiddenLayers(features, hidden, seed, order)
        self.hidden = drawn.with_values(drawn.values.astype(np.float32))
        self.adam = Adam(self.hidden.values, b2=0.99)

    def doubled(self) -> HiddenLayers:
        """The layers as they are, in double precision."""
        return self.hidden.with_values(self.hidden.values.astype(np.float64))

    def generator(self, iteration: int) -> np.random.Generator:
        """What draws the minibatches from an iteration on."""
        return np.random.default_rng((self._seed, iteration))

    def state(self) -> Checkpoint:
        """All that is needed to go on."""
        return self.hidden.state() | self.adam.state()

    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``."""
        self.hidden.load(state)
        self.adam.restore(state)
