"""The filter's likelihood and the smoother, against a textbook filter and against statsmodels."""

import numpy as np
import pytest
from statsmodels.tsa.statespace.kalman_smoother import KalmanSmoother

from accpinn.methods.kalman import innovations, log_likelihood, smooth
from accpinn.methods.state_space import OBSERVED, StateSpace, coordinates, state_space
from accpinn.model.registry import CTHPS

STEP = 0.5


def random_values(form, count, rng):
    """(count, P) sets of unknowns about the middle of what is plausible."""
    unknowns = coordinates(form)
    centre = np.array([one.centre for one in unknowns])
    z = centre + 0.4 * rng.standard_normal((count, len(unknowns)))
    z = np.clip(z, *np.transpose([one.bounds for one in unknowns]))
    return np.where([one.logarithmic for one in unknowns], np.exp(z), z)


def drawn_from(model: StateSpace, samples, rng):
    """(samples, 3, B): a recording of each model."""
    size, count = model.first.shape
    measured = np.empty((samples, 3, count))
    for b in range(count):
        # The first gap and speeds are drawn near motorway values, not from the wide prior.
        state = np.zeros(size)
        state[: len(OBSERVED)] = 40.0, 28.0, 28.0
        root = np.linalg.cholesky(model.process[..., b] + 1e-12 * np.eye(size))
        for k in range(samples):
            noise = np.sqrt(model.noise[:, b]) * rng.standard_normal(3)
            measured[k, :, b] = state[list(OBSERVED)] + noise
            state = model.transition[..., b] @ state + root @ rng.standard_normal(size)
    return measured


def shifted(model: StateSpace, measured):
    """The measurements of the states, without the intercept s₀."""
    return measured - np.stack([model.shift, 0 * model.shift, 0 * model.shift])


def with_holes(measured, rng):
    """Single samples and whole blocks missing."""
    measured = measured.copy()
    measured[rng.random(measured.shape) < 0.02] = np.nan
    measured[120:180, :2] = np.nan
    return measured


def test_the_innovations_add_up_to_the_likelihood():
    rng = np.random.default_rng(8)
    model = state_space("cthp", random_values("cthp", 2, rng), STEP)
    measured = with_holes(drawn_from(model, 250, rng), rng)
    total, found = innovations(model, measured)
    np.testing.assert_allclose(found.log_density.sum(axis=(0, 1)), total)
    assert (found.known == ~np.isnan(measured)).all()


def test_innovations_of_a_true_model_are_white_with_unit_variance():
    rng = np.random.default_rng(9)
    model = state_space("cthp", random_values("cthp", 4, rng), STEP)
    _, found = innovations(model, drawn_from(model, 2000, rng))
    standard = (found.errors / np.sqrt(found.variances))[20:]
    np.testing.assert_allclose(standard.std(axis=0), 1.0, atol=0.06)
    neighbours = (standard[1:] * standard[:-1]).mean(axis=0)
    np.testing.assert_allclose(neighbours, 0.0, atol=0.1)


def reference(model: StateSpace, measured, b):
    """The same model in statsmodels (0.14), conventional filter."""
    size = len(model.first)
    other = KalmanSmoother(
        k_endog=3, k_states=size, design=np.eye(size)[list(OBSERVED)],
        transition=model.transition[..., b], selection=np.eye(size),
        state_cov=model.process[..., b], obs_cov=np.diag(model.noise[:, b]),
    )  # fmt: skip
    other.initialize_known(model.first[:, b].copy(), model.first_covariance[..., b].copy())
    other.bind(shifted(model, measured)[..., b].copy())
    return other


@pytest.mark.parametrize("form", CTHPS)
def test_likelihood_and_smoothed_states_agree_with_statsmodels(form):
    rng = np.random.default_rng(10)
    model = state_space(form, random_values(form, 2, rng), STEP)
    measured = with_holes(drawn_from(model, 240, rng), rng)
    found = smooth(model, measured)
    for b in range(2):
        other = reference(model, measured, b)
        expected = other.smooth()
        np.testing.assert_allclose(
            log_likelihood(model, measured)[b], other.loglike(), rtol=1e-9, atol=1e-7
        )
        scale = np.sqrt(np.einsum("iik->ki", expected.smoothed_state_cov))
        off = (found[..., b] - expected.smoothed_state.T) / np.maximum(scale, 1e-7)
        assert np.abs(off).max() < 1e-4
