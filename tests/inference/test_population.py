"""The typical value of a car, from draws of its windows."""

import numpy as np

from accpinn.inference.population import POPULATIONS, Sampled, sampled_population
from accpinn.units import FloatArray

KNOWN = POPULATIONS["cthp"]
ERROR = 0.05


def sampled(values: FloatArray) -> Sampled:
    """What follows from windows of nearly known parameters (K, 3)."""
    rng = np.random.default_rng(1)
    drawn = values[:, None] + ERROR * rng.standard_normal((len(values), 400, 3))
    return sampled_population(drawn, np.zeros(drawn.shape[:2]), KNOWN)


def test_typical_value_covers_and_one_window_leaves_it_open() -> None:
    """Eight windows about a centre determine it; a single one hardly does."""
    truth = KNOWN.centre + np.array([0.5, -0.3, 0.1])
    windows = np.random.default_rng(2).multivariate_normal(truth, KNOWN.windows, 8)
    many, single = sampled(windows), sampled(windows[:1])
    assert (np.abs(many.value.mean(axis=0) - truth) < 2.5 * many.value.std(axis=0)).all()
    assert (single.value.std(axis=0) > 1.4 * many.value.std(axis=0)).all()
    assert (many.further.std(axis=0) > many.value.std(axis=0)).all()


def test_an_unusual_window_pulls_little() -> None:
    """A window eight scales away moves the typical value by far less than its share of a mean."""
    windows = np.random.default_rng(3).multivariate_normal(KNOWN.centre, KNOWN.windows, 6)
    away = 8.0 * np.sqrt(KNOWN.windows[0, 0])
    unusual = windows.copy()
    unusual[0, 0] += away
    moved = sampled(unusual).value.mean(axis=0)[0] - sampled(windows).value.mean(axis=0)[0]
    assert abs(moved) < 0.5 * away / len(windows)
