"""The fast preset's gradient of Ψ against automatic differentiation."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.fast import FastTraining
from accpinn.methods.pinn.loss import loss_terms
from tests.support.driving import MIXED, driven

WEIGHTED = PinnConfig(weight_physics=(2.0, 0.5), weight_initial=1.5, weight_data=(3.0, 0.7))


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("config", [PinnConfig(), WEIGHTED])
def test_adams_gradient_is_that_of_the_loss(config: PinnConfig, masked: bool) -> None:
    segment = driven(MIXED, noise=0.05)
    if masked:
        mask = np.random.default_rng(1).random(segment.gaps.shape) < 0.7
        segment = replace(segment, mask=mask)
    config = replace(config, batch=40)
    training = FastTraining(segment, "II", config)
    training.advance()
    descent, found = training._descent, list[torch.Tensor]()

    def step(_: float) -> None:
        found.extend(weight.grad for weight in descent.hidden.parameters())

    pick = torch.Generator()
    pick.set_state(descent.generator.get_state())
    instants = torch.randint(segment.samples, (40,), generator=pick)
    if config.weight_initial:
        instants[0] = 0
    descent.adam.step = step  # type: ignore[method-assign]
    training._descend(1)

    for weight in descent.hidden.parameters():
        weight.grad = None
    size, output = training._features.size, training._weights
    static = training._static
    value = static.value[instants]
    rate = static.derivative.of(value)
    hidden = descent.hidden(value[:, 1:].float(), rate[:, 1:].float())
    active, active_rate = (part.double() for part in hidden)
    outputs = value @ output[:size] + active @ output[size:]
    rates = rate @ output[:size] + active_rate @ output[size:]
    terms = loss_terms(
        outputs,
        rates,
        training.measured[instants],
        torch.tensor(training._solution.theta),
        config,
        None if training.mask is None else training.mask[instants],
    )
    terms.total.backward()
    for ours, weight in zip(found, descent.hidden.parameters(), strict=True):
        assert weight.grad is not None
        scale = float(weight.grad.abs().max())
        torch.testing.assert_close(ours, weight.grad, rtol=1e-3, atol=1e-3 * scale)
