"""Ranks of the truth among draws of posteriors are even: simulation-based calibration in small.

The seeds are given, so the level says how seldom other seeds would fail a right posterior. A wrong
one fails: a likelihood that counts twice, priors of α, β and τ of .4 times their width, none of
what disturbs, or a population in which cars differ by less.
"""

import numpy as np
import pytest

from accpinn.inference import population
from accpinn.inference.population import population_of
from bench.calibration import DRAWS, chances, ranks_of_population, ranks_of_window, together

pytestmark = pytest.mark.usefixtures("all_draws")

LEVEL = 0.05


@pytest.mark.slow
def test_a_windows_posterior_is_calibrated() -> None:
    """Windows of 30 s: little more than the likelihood needs."""
    ranks = [ranks_of_window(seed, "cthp", of_cars=False, duration=30.0) for seed in range(40)]
    assert together(chances(np.array(ranks))) > LEVEL


@pytest.mark.slow
def test_a_populations_posterior_is_calibrated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two windows a car, so that both the other cars and these count."""
    monkeypatch.setattr(population, "CHAINS", 10)
    taught = population_of("cthp", 3)
    ranks = [ranks_of_population(seed, taught, windows=2, count=150) for seed in range(60)]
    assert together(chances(np.array(ranks))) > LEVEL


def test_a_slope_a_hill_and_a_u_are_not_flat() -> None:
    even = (np.arange(300) + 0.5) / 300
    wrong = even**1.3, 0.5 + 0.8 * (even - 0.5), np.where(even < 0.5, even**1.3, even ** (1 / 1.3))
    columns = np.stack([even, *wrong], axis=1)
    probabilities = chances(np.floor((DRAWS + 1) * columns).astype(int))
    assert probabilities[0] > 0.1
    assert (probabilities[1:] < 1e-3).all()
