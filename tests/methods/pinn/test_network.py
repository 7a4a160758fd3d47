"""The network of all presets: features, derivatives, first weights, Adam, and its memory."""

import re
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import torch

from accpinn import METHODS, PinnConfig, Segment, preset
from accpinn.errors import ConfigError, SegmentError
from accpinn.methods.estimate import of_window
from accpinn.methods.pinn.config import FAST, PAPER, PresetName
from accpinn.methods.pinn.network import Network
from accpinn.methods.pinn.paper import Adam
from accpinn.methods.pinn.training import bytes_needed, require_memory
from accpinn.model.spec import ModelSpec
from tests.support.driving import segment_of
from tests.support.methods import train
from tests.support.samples import NOISY, sample

FOURIER = replace(FAST, width=7, highest_frequency=0.2, seed=3)
BOTH = pytest.mark.parametrize("config", [FOURIER, replace(PAPER, seed=3)], ids=["fast", "paper"])


def test_frequencies_reach_from_a_cycle_in_somewhat_more_than_the_window_to_the_highest() -> None:
    hertz = replace(FAST, highest_frequency=0.1).angular_frequencies(300.0) / (2 * np.pi)
    assert hertz[0] * 300 == pytest.approx(1 / 1.1)
    assert hertz[-1] == pytest.approx(0.1)
    np.testing.assert_allclose(np.diff(hertz), hertz[0], rtol=1e-9)
    assert len(FAST.angular_frequencies(9.0)) == 4
    short = FAST.angular_frequencies(100.0) / (2 * np.pi)
    assert short[-1] == pytest.approx(0.4), "one event weighs more in a short window"
    assert not len(PAPER.angular_frequencies(300.0))


def nested_rates(outputs: torch.Tensor, time: torch.Tensor) -> torch.Tensor:
    """(N, outputs) time derivatives by one gradient call an output, as the paper's authors do."""
    columns = [
        torch.autograd.grad(column.sum(), time, create_graph=True)[0] for column in outputs.T
    ]
    return torch.stack(columns, 1)


@BOTH
@pytest.mark.parametrize("followers", [1, 4])
def test_tangents_are_automatic_differentiations_time_derivatives(
    followers: int, config: PinnConfig
) -> None:
    network = Network(followers, config, 20.0).learnable()
    time = torch.linspace(0, 20, 40, dtype=torch.float64, requires_grad=True)
    outputs, rates, bends = network(time, 2)
    assert outputs.shape == (40, 2 * followers + 1)
    for values, tangent in ((outputs, rates), (rates, bends)):
        expected = nested_rates(values, time)
        assert float(expected.detach().abs().max()) > 0.01
        torch.testing.assert_close(tangent, expected, rtol=1e-11, atol=1e-12)


def test_first_weights_are_as_many_as_the_paper_says_xavier_uniform_and_biases_zero() -> None:
    assert [Network(m, PAPER, 300.0).size for m in (1, 3, 4)] == [7623, 7867, 7989]
    network = Network(4, PAPER, 300.0)
    layers = [*network.hidden, network.output]
    assert [layer.weight.shape for layer in layers] == [(60, 1), (60, 60), (60, 60), (9, 60)]
    by_torch = torch.Generator().manual_seed(PAPER.seed)
    for layer in layers:
        if layer is network.output:
            by_torch.manual_seed(PAPER.seed + 1)
        expected = torch.empty(layer.weight.shape, dtype=torch.float64)
        torch.nn.init.xavier_uniform_(expected, generator=by_torch)
        np.testing.assert_allclose(layer.weight, expected.numpy(), rtol=0, atol=1e-15)
        assert not layer.bias.any()


def quartic(values: torch.Tensor, step: int) -> torch.Tensor:
    """It changes from step to step, and its numbers are apart by orders."""
    weights = 10.0 ** torch.linspace(0, 4, len(values), dtype=torch.float64)
    return (weights * (values - 0.1 * step) ** 4).sum()


@pytest.mark.parametrize("b2", [0.999, 0.99])
def test_adam_is_that_of_torch_optim_and_continues_from_its_arrays(b2: float) -> None:
    start = torch.randn(16, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    ours, theirs = start.clone().requires_grad_(), start.clone().requires_grad_()
    adam, reference = Adam([ours], b2=b2), torch.optim.Adam([theirs], betas=(0.9, b2))
    for step in range(50):
        rate = 0.01 * 0.5 ** (step / 20)
        if step == 25:
            arrays, adam = adam.arrays(), Adam([ours], b2=b2)
            adam.load_arrays(arrays)
        adam.step(quartic(ours, step), rate)
        reference.param_groups[0]["lr"] = rate
        reference.zero_grad()
        quartic(theirs, step).backward()
        reference.step()
    assert float((ours - start).detach().abs().max()) > 0.1
    torch.testing.assert_close(ours, theirs, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", get_args(PresetName))
def test_layers_and_width_shape_the_network_and_its_curves_can_be_drawn_again(
    name: PresetName,
) -> None:
    segment = sample(NOISY, 60.0).segment
    config = preset(name, iterations=10, layers=2, width=20)
    estimate = train(segment, "II", config, threads=1)
    arrays, (curves,) = of_window(estimate.arrays, 0), estimate.curves
    assert [arrays[f"hidden.{k}.weight"].shape[0] for k in range(2)] == [20, 20]
    drawn = METHODS["pinn"].redraw(estimate, 0, segment.time, segment.window.duration)
    np.testing.assert_allclose(drawn.gaps, curves.gaps, atol=1e-9)
    np.testing.assert_allclose(drawn.speeds, curves.speeds, atol=1e-9)
    for arrays in ({}, estimate.arrays | {"window0.output.bias": np.zeros(5)}):
        with pytest.raises(ConfigError, match="train again"):
            METHODS["pinn"].redraw(replace(estimate, arrays=arrays), 0, segment.time, 300.0)
    with pytest.raises(ConfigError, match="train again"):
        METHODS["pinn"].redraw(estimate, 1, segment.time, segment.window.duration)
    with pytest.raises(ConfigError):
        preset(name, layers=7)
    with pytest.raises(ConfigError):
        preset(name, width=4)


def of_length(duration: float, step: float = 0.1, masked: bool = False) -> Segment:
    """A segment of nothing in particular."""
    time = step * np.arange(round(duration / step) + 1)
    segment = segment_of(time, np.zeros((len(time), 2)), np.ones((len(time), 1)))
    mask = np.zeros((len(time), 1), bool) if masked else None
    return replace(segment, mask=mask)


@pytest.mark.parametrize(
    ("config", "masked", "model"),
    [
        *((preset(name), True, "cthp") for name in get_args(PresetName)),
        (preset("fast", highest_frequency=2.0), False, "cthp"),
        *((preset("fast"), masked, "idm-delay") for masked in (False, True)),
        (preset("paper"), True, "idm"),
        (preset("paper", layers=6, width=200), False, "cthp"),
    ],
)
def test_the_longest_window_named_is_allowed(config: PinnConfig, masked: bool, model: str) -> None:
    step = 0.5 if masked else 0.1
    with pytest.raises(SegmentError, match="GB of memory") as caught:
        require_memory([of_length(200_000, step, masked)], config, model)
    (longest,) = re.findall(r"at most ([\d,]+) s", str(caught.value))
    seconds = float(longest.replace(",", ""))
    require_memory([of_length(seconds, step, masked)], config, model)
    with pytest.raises(SegmentError):
        require_memory([of_length(1.05 * seconds, step, masked)], config, model)


@pytest.mark.parametrize(("settings", "factor"), [({"layers": 6}, 2.0), ({"width": 200}, 4.0)])
def test_a_larger_network_takes_more_memory(settings: dict[str, int], factor: float) -> None:
    """So much more was measured."""
    needed = [
        bytes_needed(of_length(100), 100.0, preset("paper", **changes), "cthp")
        for changes in ({}, settings)
    ]
    assert needed[1] >= 0.8 * factor * needed[0]


def test_a_training_is_refused_before_its_work() -> None:
    with pytest.raises(SegmentError, match="take at most"):
        train(of_length(15_000))
    require_memory([of_length(2_000)], FAST)
    with pytest.raises(SegmentError, match="take at most"):
        METHODS["pinn"].fit(of_length(2_000), settings=FAST, spec=ModelSpec("idm"))


def test_the_memory_of_all_windows_counts_where_they_are_trained_together() -> None:
    """The preset calibrated draws one network after the other."""
    windows = (of_length(1_500),) * 40
    with pytest.raises(SegmentError, match=r"40 windows .* GB .* take at most") as caught:
        METHODS["pinn"].fit(windows, settings=FAST)
    (most,) = re.findall(r"at most ([\d,]+) as long", str(caught.value))
    require_memory(windows[: int(most)], FAST)
    with pytest.raises(SegmentError):
        require_memory(windows[: int(most) + 1], FAST)
    require_memory(windows, preset("calibrated"))
