"""Posteriors beside those that an independent sampler draws from densities written anew.

`python -m bench.ensemble` compares more windows, and the model with an intercept and a delay.
"""

import numpy as np
import pytest

from accpinn import Parameters
from accpinn.inference.coordinates import time_gap_coordinates
from accpinn.inference.posterior import log_posterior
from accpinn.methods.likelihood import Criterion
from accpinn.methods.series import series_of
from accpinn.methods.state_space import coordinates
from accpinn.model.spec import ModelSpec
from bench.disturbed import Disturbance, disturbed
from bench.ensemble import (
    LIMIT,
    TRUTH,
    Moments,
    log_density_of_window,
    of_population,
    of_window,
)
from tests.inference.test_population import BOTH, CENTRE, TAUGHT, drawn

pytestmark = pytest.mark.usefixtures("all_draws")


def agree(ours: Moments, other: Moments) -> bool:
    """Means within .1 deviations, deviations within 10 %."""
    return bool(100 * np.abs(ours.beside(other)).max() < LIMIT)


@pytest.mark.parametrize("model", TRUTH)
def test_the_density_of_a_window_is_likelihood_and_prior_as_written_down(model: str) -> None:
    """At 30 points over the parameters and what disturbs; the coordinates differ by a volume."""
    parameters, disturbance = TRUTH[model]
    series = series_of([disturbed([parameters], 1, disturbance, duration=60.0)], "II")
    rng = np.random.default_rng(2)
    unknowns = coordinates(model)
    z = np.array([unknown.centre for unknown in unknowns]) + 0.3 * rng.standard_normal(
        (30, len(unknowns))
    )
    z = np.clip(z, *np.transpose([unknown.bounds for unknown in unknowns]))
    z[:, 1] = z[:, 0] + np.log(parameters.tau) + 0.3 * rng.standard_normal(30)
    phi = time_gap_coordinates(model).of_unknowns(z)
    x = np.concatenate([phi[:, :3], z[:, 3:]], axis=1)
    expected = log_density_of_window(model, series.measured[..., 0], series.step)(x)
    densities = log_posterior(Criterion(series, ModelSpec(model)), z, np.zeros(30, int))
    volume = z[:, 1] - z[:, 0] - phi[:, 2]  # dx/dz = τ/G
    np.testing.assert_allclose(np.ptp(sum(densities) - volume - expected), 0.0, atol=1e-5)


@pytest.mark.slow
def test_the_posterior_of_a_window_is_that_of_an_ensemble_of_walkers() -> None:
    segment = disturbed([Parameters(0.1, 0.25, 1.3)], 3, Disturbance(0.1), duration=100.0)
    assert agree(*of_window("cthp", segment, walkers=80, steps=400, left_out=120))


def test_the_posterior_of_a_population_is_that_of_an_ensemble_of_walkers() -> None:
    rng = np.random.default_rng(3)
    windows_drawn = drawn(rng.multivariate_normal(CENTRE, BOTH, 4), 3, 100)
    assert agree(*of_population(*windows_drawn, TAUGHT, walkers=60, steps=500, left_out=120))
