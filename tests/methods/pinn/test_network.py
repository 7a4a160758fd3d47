"""The network of the presets fast and calibrated: features, derivatives, gradient, Adam."""

from collections.abc import Callable
from typing import get_args

import numpy as np
import pytest
import torch

from accpinn.errors import ConfigError
from accpinn.methods.pinn.config import PresetName, preset
from accpinn.methods.pinn.network import (
    Adam,
    FourierFeatures,
    HiddenLayers,
    output_columns,
    stack_outputs,
)
from accpinn.methods.registry import METHODS
from accpinn.units import FloatArray
from tests.support.methods import train
from tests.support.samples import NOISY, sample


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
        features = FourierFeatures.up_to(0.5, 60.0)
        time, width = np.linspace(1, 59, 50), 1e-5
        numerical = (features(time + width) - features(time - width)) / (2 * width)
        exact, unit = features.derivative(features(time)), np.eye(features.size)
        np.testing.assert_allclose(exact, numerical, rtol=1e-7, atol=1e-8)
        matrix = features.times(unit)
        np.testing.assert_allclose(features(time) @ matrix, exact, rtol=1e-12)
        np.testing.assert_array_equal(features.transposed(unit), matrix.T)

    def test_reach_from_a_cycle_in_somewhat_more_than_the_window_to_the_highest(self) -> None:
        features = FourierFeatures.up_to(0.1, 300.0)
        hertz = features.angular / (2 * np.pi)
        assert hertz[0] * 300 == pytest.approx(1 / 1.1)
        assert hertz[-1] == pytest.approx(0.1)
        np.testing.assert_allclose(np.diff(hertz), hertz[0], rtol=1e-9)
        assert len(FourierFeatures.up_to(0.01, 10.0).angular) == 4, "also in a short window"

    def test_those_below_a_frequency_are_the_first_ones(self) -> None:
        features, time = FourierFeatures.up_to(0.5, 60.0), np.linspace(0, 60, 9)
        low = features.below(0.2)
        assert low.angular[-1] <= 0.2 * 2 * np.pi < features.angular[len(low.angular)]
        np.testing.assert_array_equal(low(time), features(time)[:, : low.size])
        assert len(features.below(1e-3).angular) == 4


class TestHiddenLayers:
    FEATURES = FourierFeatures.up_to(0.2, 30.0)
    TIME = np.linspace(1, 29, 12)

    def layers(self, order: int) -> HiddenLayers:
        drawn = HiddenLayers(self.FEATURES, (7, 6, 5), 3, order)
        away = 0.1 * np.random.default_rng(1).standard_normal(drawn.values.size)
        return drawn.with_values(drawn.values + away)  # biases that are not zero

    def test_first_weights_are_xavier_uniform_and_biases_zero(self) -> None:
        state = HiddenLayers(self.FEATURES, (60, 60), 0, 1).state()
        assert len(state) == 4
        for name, values in state.items():
            if name.endswith("bias"):
                assert not values.any()
                continue
            bound = (6 / sum(values.shape)) ** 0.5
            assert 0.9 * bound < np.abs(values).max() <= bound
            # A uniform density has its standard deviation at bound/√3.
            assert values.std() == pytest.approx(bound / 3**0.5, rel=0.1)

    @pytest.mark.parametrize("order", [1, 3])
    def test_derivatives_in_time_are_exact(self, order: int) -> None:
        """Against differences, each order from the one below."""
        step, layers = 1e-4, self.layers(order)
        before, exact, after = (
            layers(self.FEATURES(self.TIME + shift)) for shift in (-step, 0, step)
        )
        assert exact.shape == (order + 1, len(self.TIME), 5)
        slopes = (after - before)[:-1] / (2 * step)
        scale = np.abs(exact[1:]).max(axis=(1, 2), keepdims=True)
        np.testing.assert_allclose(slopes / scale, exact[1:] / scale, atol=1e-6)

    @pytest.mark.parametrize("order", [1, 3])
    def test_the_gradient_is_automatic_differentiations(self, order: int) -> None:
        layers, features = self.layers(order), self.FEATURES(self.TIME)
        toward = np.random.default_rng(2).standard_normal((order + 1, len(self.TIME), 5))
        ours = layers.gradient(features, lambda active: toward + active)

        values = torch.tensor(layers.values, requires_grad=True)
        derivatives = [features]
        for _ in range(order):
            derivatives.append(self.FEATURES.derivative(derivatives[-1]))
        active = by_torch(values, [part.shape for part in layers.state().values()], derivatives)
        ((torch.from_numpy(toward) + active / 2) * active).sum().backward()
        np.testing.assert_allclose(active.detach(), layers(features), rtol=1e-10, atol=1e-12)
        scale = float(values.grad.abs().max())
        np.testing.assert_allclose(ours, values.grad, rtol=1e-8, atol=1e-10 * scale)

    def test_weights_of_another_network_are_refused(self) -> None:
        mine, other = self.layers(1), HiddenLayers(self.FEATURES, (7, 6), 3, 1)
        for state in (other.state(), {}):
            with pytest.raises(ValueError, match="another network"):
                mine.load(state)
        fresh = HiddenLayers(self.FEATURES, (7, 6, 5), 0, 1)
        fresh.load(mine.state())
        np.testing.assert_array_equal(fresh.values, mine.values)


def by_torch(
    values: torch.Tensor, shapes: list[tuple[int, ...]], derivatives: list[FloatArray]
) -> torch.Tensor:
    """(order + 1, N, width) the activations, as a Taylor series of time through each layer.

    Args:
        values: all weights and biases in a row.
        shapes: of each of them.
        derivatives: of the features, (N, size) each.
    """
    sizes = [int(np.prod(shape)) for shape in shapes]
    parts = [part.view(shape) for part, shape in zip(values.split(sizes), shapes, strict=True)]
    inputs = [torch.from_numpy(one[:, 1:].copy()) for one in derivatives]
    moment = torch.zeros(1, dtype=torch.float64, requires_grad=True)

    def at(time: torch.Tensor) -> torch.Tensor:
        factorials = [1, 1, 2, 6]
        now = sum(one * time**k / factorials[k] for k, one in enumerate(inputs))
        for weight, bias in zip(parts[::2], parts[1::2], strict=True):
            now = torch.tanh(now @ weight.T + bias)
        return torch.as_tensor(now)

    orders = [at]
    for _ in inputs[1:]:
        orders.append(rate_of(orders[-1]))
    return torch.stack([one(moment) for one in orders])


def rate_of(curve: Callable[[torch.Tensor], torch.Tensor]) -> Callable[..., torch.Tensor]:
    """The derivative of a curve in time, by forward differentiation."""
    return lambda time: torch.func.jvp(curve, (time,), (torch.ones_like(time),))[1]


def quartic(values: torch.Tensor, step: int) -> torch.Tensor:
    """It changes from step to step, and its numbers are apart by orders."""
    weights = 10.0 ** torch.linspace(0, 4, len(values), dtype=torch.float64)
    return (weights * (values - 0.1 * step) ** 4).sum()


def slope(values: FloatArray, step: int) -> FloatArray:
    at = torch.tensor(values, requires_grad=True)
    quartic(at, step).backward()
    return np.asarray(at.grad)


@pytest.mark.parametrize("b2", [0.999, 0.99])
def test_adam_equals_torchs_over_fifty_steps(b2: float) -> None:
    start = np.random.default_rng(0).standard_normal(16)
    ours, theirs = start.copy(), torch.tensor(start, requires_grad=True)
    adam, reference = Adam(ours, b2=b2), torch.optim.Adam([theirs], betas=(0.9, b2))
    for step in range(50):
        rate = 0.01 * 0.5 ** (step / 20)
        adam.step(slope(ours, step), rate)
        reference.param_groups[0]["lr"] = rate
        reference.zero_grad()
        quartic(theirs, step).backward()
        reference.step()
    assert np.abs(ours - start).max() > 0.1
    np.testing.assert_allclose(ours, theirs.detach(), rtol=1e-12, atol=1e-14)


def test_adam_continues_from_its_state_bit_for_bit() -> None:
    straight = np.random.default_rng(0).standard_normal(16)
    first = Adam(straight)
    for step in range(5):
        first.step(slope(straight, step), 0.01)
    broken = straight.copy()
    second = Adam(broken)
    second.restore(first.state())
    for step in range(5, 10):
        first.step(slope(straight, step), 0.01)
        second.step(slope(broken, step), 0.01)
    assert second.steps == 10
    np.testing.assert_array_equal(straight, broken)


@pytest.mark.parametrize("name", get_args(PresetName))
def test_layers_and_width_shape_the_network_and_its_curves_can_be_drawn_again(
    name: PresetName,
) -> None:
    segment = sample(NOISY).segment
    config = preset(name, iterations=10, layers=2, width=20)
    fit = train(segment, "II", config, threads=1)
    weights = [array for key, array in fit.arrays.items() if "hidden" in key and "weight" in key]
    assert [array.shape[0] for array in weights] == [20, 20]
    drawn = METHODS["pinn"].redraw(fit, segment.time, segment.window.duration)
    np.testing.assert_allclose(drawn.gaps, fit.surrogate.gaps, atol=1e-9)
    np.testing.assert_allclose(drawn.speeds, fit.surrogate.speeds, atol=1e-9)
    with pytest.raises(ConfigError):
        preset(name, layers=7)
    with pytest.raises(ConfigError):
        preset(name, width=4)
