"""The fast preset's gradient of Ψ against differences of Ψ."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.linalg import norm

from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.fast import FastTraining
from accpinn.methods.pinn.loss import loss_terms
from accpinn.units import FloatArray
from tests.support.driving import MIXED, driven
from tests.support.methods import WEIGHTED


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
    descent, found = training._descent, list[FloatArray]()
    first = int(config.weight_initial > 0)
    generator = descent.generator(training._iteration)
    instants = generator.integers(first, segment.samples, size=40)
    instants[:first] = 0
    descent.adam.step = lambda gradient, _: found.append(gradient)
    training._descend(1)

    size, output = training._features.size, training._weights
    value = training._static.value[instants]
    rate = training._features.derivative(value)
    mask = None if training.mask is None else training.mask[instants]

    def loss(values: FloatArray) -> float:
        active, active_rate = descent.hidden.with_values(values)(value)
        outputs = value @ output[:size] + active @ output[size:]
        rates = rate @ output[:size] + active_rate @ output[size:]
        measured, theta = training.measured[instants], training._solution.theta
        return float(loss_terms(outputs, rates, measured, theta, config, mask).total)

    values, gradient = descent.doubled().values, found[0].astype(float)
    for direction in np.random.default_rng(3).standard_normal((5, len(values))):
        away = 1e-6 * direction
        slope = (loss(values + away) - loss(values - away)) / 2e-6
        assert gradient @ direction == pytest.approx(slope, abs=1e-3 * norm(gradient))
