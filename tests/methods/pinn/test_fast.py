"""The fast preset: where it starts, what its cycles do, and the curves of given parameters."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.calibrated import drawn
from accpinn.methods.pinn.config import FAST, PinnConfig
from accpinn.methods.pinn.fast import FastTraining
from accpinn.methods.regression import Solution
from accpinn.model.cthp import Parameters
from tests.support.driving import MIXED, driven
from tests.support.methods import WEIGHTED

SEGMENT = driven(MIXED, noise=0.05)


def started(config: PinnConfig = FAST, masked: bool = False) -> FastTraining:
    """A training after its exact rounds."""
    mask = np.random.default_rng(1).random(SEGMENT.gaps.shape) < 0.7 if masked else None
    training = FastTraining(replace(SEGMENT, mask=mask), "II", config)
    while training.progress.phase == "start" and training._starting:
        training.advance()
    return training


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("config", [FAST, WEIGHTED])
def test_training_the_hidden_layers_lowers_the_loss(config: PinnConfig, masked: bool) -> None:
    training = started(config, masked)
    before = training.progress.total
    training.advance()
    # With little data minibatches may raise the loss, and the cycle is taken back.
    assert training.progress.total <= before
    assert masked or training.progress.total < before
    assert training.progress.iteration - 50 in range(3, 15)


def test_a_cycle_that_does_not_lower_the_loss_is_taken_back_and_is_the_last() -> None:
    training = started(replace(FAST, learning_rate=1.0))
    before, weights = training.progress, training.fit().arrays
    training.advance()
    assert training.outcome is Outcome.CONVERGED
    assert training.progress.total == before.total
    assert training.progress.parameters == before.parameters
    for name, values in training.fit().arrays.items():
        np.testing.assert_array_equal(values, weights[name])


def test_an_output_layer_for_given_parameters_has_the_loss_of_the_start() -> None:
    """`calibrated` draws its curves by it."""
    given = Solution.of(Parameters.of(np.tile([0.1, 0.2, 1.3], (3, 1))).theta)
    config = replace(FAST, initial=Parameters(0.1, 0.2, 1.3))
    fit = drawn(SEGMENT, "II", config, given, None, evidence=2.0)
    assert fit.loss["total"] == FastTraining(SEGMENT, "II", config).progress.total
    assert fit.loss["evidence"] == 2.0
