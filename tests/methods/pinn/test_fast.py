"""The fast preset: where it starts, what its cycles do, and parameters that are held."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import FAST, PinnConfig
from accpinn.methods.pinn.fast import FastTraining
from accpinn.methods.regression import Solution
from accpinn.model.cthp import Parameters
from tests.support.driving import LAW, MIXED, driven
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
    before, weights = training.progress, training.learned().arrays
    training.advance()
    assert training.outcome is Outcome.CONVERGED
    assert training.progress.total == before.total
    assert training.progress.parameters == before.parameters
    for name, values in training.learned().arrays.items():
        np.testing.assert_array_equal(values, weights[name])


def test_held_parameters_do_not_move() -> None:
    held = Solution.of(Parameters.of(np.tile([0.1, 0.2, 1.3], (3, 1))).theta)
    training = FastTraining(SEGMENT, "II", FAST, held=held)
    assert training.progress.phase == "start"
    first = training.progress.total
    while training.outcome is None:
        training.advance()
    learned = training.learned()
    np.testing.assert_array_equal(learned.solution.theta, held.theta)
    assert learned.loss["start"] == first >= learned.loss["total"]
    assert training.outcome is Outcome.CONVERGED


def test_the_seed_draws_other_hidden_layers_and_the_parameters_hardly_move() -> None:
    fits = []
    for seed in range(2):
        training = started(replace(FAST, seed=seed))
        fits.append(training.progress.parameters.values)
    assert (fits[0] != fits[1]).any()
    np.testing.assert_allclose(*fits, rtol=2e-3)


def test_starts_at_the_output_layers_optimum_for_the_initial_values() -> None:
    law = Parameters(*LAW)
    training = FastTraining(driven(), "II", replace(FAST, initial=law))
    best = training.progress.total
    away = np.random.default_rng(0).standard_normal(training._best.weights.shape)
    for size in (1e-3, -1e-3):
        moved = replace(training._best, weights=training._best.weights + size * away)
        assert float(training._loss(moved).total) > best
