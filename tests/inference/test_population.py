"""The population of a car's windows: what is recovered, and how often intervals hold it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student

from accpinn.inference import population
from accpinn.inference.population import TAILS, Population, sampled_population
from accpinn.units import FloatArray

pytestmark = pytest.mark.usefixtures("all_draws")

CENTRE = np.array([-2.5, -1.5, 0.2])
CARS = np.array([[0.4, 0.1, 0.0], [0.1, 0.5, -0.05], [0.0, -0.05, 0.05]])
WINDOWS = np.array([[0.09, 0.03, 0.0], [0.03, 0.09, -0.005], [0.0, -0.005, 0.0064]])
ERROR = np.array([[0.04, 0.01, 0.0], [0.01, 0.06, -0.002], [0.0, -0.002, 0.0009]])
"""Covariance of what a window's likelihood leaves open."""
BOTH = WINDOWS + ERROR
TAUGHT = Population(CENTRE, CARS, WINDOWS)
WIDE = (np.array([-2.5, -1.6, 0.3]), np.diag([4.0, 2.25, 0.36]))
NARROW = (np.array([-2.0, -1.9, 0.5]), np.diag([0.5, 0.5, 0.1]))
"""Two priors under which windows' posteriors are drawn: mean and covariance."""


def drawn(
    estimates: FloatArray, seed: int, count: int = 150, error: FloatArray = ERROR,
    prior: tuple[FloatArray, FloatArray] = WIDE,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """(K, n, p) posterior draws for normal likelihoods about (K, p), and (K, n) log prior."""
    centre, spread = prior
    information, of_windows = np.linalg.inv(error), np.linalg.inv(spread)
    covariance = np.linalg.inv(information + of_windows)
    means = (estimates @ information + centre @ of_windows) @ covariance
    normal = np.random.default_rng(seed).standard_normal((len(means), count, 3))
    draws = means[:, None] + normal @ np.linalg.cholesky(covariance).T
    away = draws - centre
    return draws, -0.5 * np.einsum("kni,ij,knj->kn", away, of_windows, away)


@pytest.fixture(autouse=True)
def few_chains(monkeypatch: pytest.MonkeyPatch) -> None:
    """1,000 draws are enough for these tolerances."""
    monkeypatch.setattr(population, "CHAINS", 20)


def test_nominal_90_percent_intervals_hold_the_typical_value_and_a_further_window() -> None:
    """Seeds 0 to 24, 6 windows each; the standard error of a share is some 4 %."""
    typical, further = [], []
    for seed in range(25):
        rng = np.random.default_rng([seed, 1])
        truth = rng.multivariate_normal(CENTRE, CARS)
        others = rng.multivariate_normal(truth, WINDOWS, 20)
        sampled = sampled_population(
            *drawn(rng.multivariate_normal(truth, BOTH, 6), seed), TAUGHT, seed
        )
        for held, draws, values in zip(
            (typical, further), (sampled.value, sampled.further), (truth, others), strict=True
        ):
            lower, upper = np.quantile(draws, [0.05, 0.95], axis=0)
            held.append((lower <= values) & (values <= upper))
    assert 0.8 < np.mean(typical) < 0.98
    assert 0.8 < np.mean(further) < 0.98


def test_many_windows_determine_value_and_covariance_whatever_was_taught() -> None:
    """60 windows that differ by Student's t: three standard errors of the mean; 40 % of Σ."""
    truth, spread = np.array([-3.2, -0.8, 0.4]), 2.5 * WINDOWS
    rng = np.random.default_rng(5)
    stretch = np.sqrt(rng.gamma(TAILS / 2, 2 / TAILS, (60, 1)))
    nothing = np.zeros(3)
    estimates = truth + rng.multivariate_normal(nothing, spread, 60) / stretch
    estimates += rng.multivariate_normal(nothing, ERROR, 60)
    sampled = sampled_population(*drawn(estimates, 5), TAUGHT)
    errors = np.sqrt(np.diag(2 * spread + ERROR) / 60)
    assert (np.abs(sampled.value.mean(axis=0) - truth) < 3 * errors).all()
    learned, scale = sampled.covariance.mean(axis=0), np.sqrt(np.diag(spread))
    np.testing.assert_allclose(np.diag(learned), np.diag(spread), rtol=0.4)
    assert (np.abs(learned - spread) / np.outer(scale, scale) < 0.4).all()


def test_one_window_alone_has_the_interval_of_the_population() -> None:
    """Student's t with ν - p + 1 degrees of freedom and scale (ν-p-1)/(ν-p+1) Σ₀, over √g; 15 %."""
    flat = replace(TAUGHT, cars=1e4 * CARS)
    windows_drawn = drawn(CENTRE[None] + 0.5, 1, error=1e-6 * ERROR)
    values = np.concatenate(
        [sampled_population(*windows_drawn, flat, seed).value for seed in (0, 1)]
    )
    freedom = TAUGHT.freedom - 3 + 1
    scale = np.sqrt((TAUGHT.freedom - 4) / freedom * np.diag(WINDOWS))
    ends = np.quantile(values, [0.05, 0.95], axis=0)
    rng = np.random.default_rng(2)
    drift = student.rvs(freedom, size=400_000, random_state=rng)
    drift /= np.sqrt(rng.gamma(TAILS / 2, 2 / TAILS, len(drift)))
    exact_widths = 2 * np.quantile(drift, 0.95) * scale
    np.testing.assert_allclose(np.diff(ends, axis=0)[0], exact_widths, rtol=0.15)
    np.testing.assert_allclose(ends.mean(axis=0), CENTRE + 0.5, atol=0.05)


def test_the_prior_of_the_draws_does_not_count() -> None:
    """The mean moves by less than .2 of its deviation, which changes by less than 15 %."""
    estimates = np.random.default_rng(7).multivariate_normal(CENTRE, BOTH, 6)
    results = []
    for prior, is_told in ((WIDE, 1), (NARROW, 1), (NARROW, 0)):
        draws, log_prior = drawn(estimates, 7, 1500, 3 * ERROR, prior)
        results.append(sampled_population(draws, log_prior * is_told, TAUGHT).value)
    wide, narrow, wrong = (value.mean(axis=0) for value in results)
    deviation, other, _ = (value.std(axis=0) for value in results)
    assert (np.abs(wide - narrow) < 0.2 * deviation).all()
    np.testing.assert_allclose(other, deviation, rtol=0.15)
    assert (np.abs(wide - wrong) > 0.25 * deviation).any(), "the prior would count"
