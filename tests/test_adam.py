"""Our Adam against torch's."""

import numpy as np
import pytest
import torch

from accpinn.methods.pinn.adam import Adam

SHAPES = ((3, 2), (4,), (2, 3))


def weights(seed: int = 0) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return [
        torch.randn(shape, generator=generator, dtype=torch.float64).requires_grad_()
        for shape in SHAPES
    ]


def descend(tensors: list[torch.Tensor], step: int) -> None:
    """Gradients of a quartic that changes from step to step, sizes apart by orders."""
    total = sum(
        10.0 ** (2 * k) * ((tensor - 0.1 * step) ** 4).sum() for k, tensor in enumerate(tensors)
    )
    total.backward()


@pytest.mark.parametrize("b2", [0.999, 0.99])
def test_equals_torchs_over_fifty_steps(b2: float) -> None:
    ours, theirs = weights(), weights()
    adam, reference = Adam(ours, b2=b2), torch.optim.Adam(theirs, betas=(0.9, b2))
    for step in range(50):
        rate = 0.01 * 0.5 ** (step / 20)
        descend(ours, step)
        adam.step(rate)
        reference.param_groups[0]["lr"] = rate
        reference.zero_grad()
        descend(theirs, step)
        reference.step()
    moved = max(float((a - b).abs().max().detach()) for a, b in zip(ours, weights(), strict=True))
    assert moved > 0.1
    for mine, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(mine, other, rtol=1e-12, atol=1e-14)


def test_a_step_clears_the_gradients() -> None:
    tensors = weights()
    adam = Adam(tensors)
    descend(tensors, 0)
    adam.step(0.01)
    assert all(tensor.grad is None for tensor in tensors)


def test_goes_on_from_its_state_bit_for_bit() -> None:
    straight, broken = weights(), weights()
    first = Adam(straight)
    for step in range(5):
        descend(straight, step)
        first.step(0.01)
    state = first.state()
    with torch.no_grad():
        for tensor, now in zip(broken, straight, strict=True):
            tensor.copy_(now)
    second = Adam(broken)
    second.restore(state)
    for step in range(5, 10):
        for adam, tensors in ((first, straight), (second, broken)):
            descend(tensors, step)
            adam.step(0.01)
    assert second.steps == 10
    for mine, other in zip(straight, broken, strict=True):
        assert torch.equal(mine, other)


def test_a_state_stays_as_it_was_when_taken() -> None:
    tensors = weights()
    adam = Adam(tensors)
    descend(tensors, 0)
    adam.step(0.01)
    state = adam.state()
    kept = {name: values.copy() for name, values in state.items()}
    descend(tensors, 1)
    adam.step(0.01)
    for name, values in kept.items():
        np.testing.assert_array_equal(state[name], values)
