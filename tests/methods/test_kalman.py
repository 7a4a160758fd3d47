"""The filter's likelihood and the smoother, against a textbook filter and against statsmodels."""

import numpy as np
import pytest
from scipy.linalg import expm
from statsmodels.tsa.statespace.kalman_smoother import KalmanSmoother

from accpinn.methods.kalman import Pairs, innovations, log_likelihood, smooth
from accpinn.methods.series import series_of
from accpinn.methods.state_space import OBSERVED, StateSpace, coordinates, discretise, state_space
from bench.disturbed import Disturbance, disturbed
from tests.support.following import CTHPS
from tests.support.vehicles import AUDI, BMW, row

PAIR = row(AUDI, BMW)


def random_values(form, count, rng):
    """(count, P) sets of unknowns about the middle of what is plausible."""
    unknowns = coordinates(form)
    centre = np.array([unknown.centre for unknown in unknowns])
    z = centre + 0.4 * rng.standard_normal((count, len(unknowns)))
    z = np.clip(z, *np.transpose([unknown.bounds for unknown in unknowns]))
    return np.where([unknown.logarithmic for unknown in unknowns], np.exp(z), z)


def shifted(model: StateSpace, measured):
    """The measurements of the states, without the intercept s₀."""
    return measured - np.stack([model.shift, 0 * model.shift, 0 * model.shift])


def with_holes(measured, rng):
    """Single samples and whole blocks missing."""
    measured = measured.copy()
    measured[rng.random(measured.shape) < 0.02] = np.nan
    measured[120:180, :2] = np.nan
    return measured


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


def shorter(measured, rng):
    """One series ends before the other, and each has one hole after its gains have settled."""
    measured = measured.copy()
    measured[211:, :, 1] = np.nan
    measured[150, 0, 0] = measured[97, 1, 1] = np.nan
    return measured


@pytest.mark.parametrize("form", CTHPS)
def test_a_step_is_that_of_the_matrix_exponential(form):
    """Van Loan's block of twice the size, over a part of the step that is doubled."""
    model = state_space(form, random_values(form, 40, np.random.default_rng(3)), 0.5)
    size, parts = len(model.first), 2.0**8
    rates = model.rates.transpose(2, 0, 1)
    given = np.tile(np.diag(1.0 + np.arange(size)), (len(rates), 1, 1))
    discrete, added = discretise(rates, given, 0.5)
    block = np.zeros((len(rates), 2 * size, 2 * size))
    block[:, :size, :size], block[:, :size, size:] = -rates, given
    block[:, size:, size:] = rates.transpose(0, 2, 1)
    whole = expm(block * (0.5 / parts))
    transition = whole[:, size:, size:].transpose(0, 2, 1)
    process = transition @ whole[:, :size, size:]
    for _ in range(8):
        process = process + transition @ process @ transition.transpose(0, 2, 1)
        transition = transition @ transition
    scale = np.sqrt(np.einsum("bii->bi", process))
    tolerance = 1e-10 * np.abs(transition).max()
    np.testing.assert_allclose(discrete, transition, rtol=0, atol=tolerance)
    assert (np.abs(added - process) / (scale[:, :, None] * scale[:, None])).max() < 1e-10


def test_many_models_at_once_are_as_each_alone():
    """Their covariances settle at different instants, and go on where a sample is missing."""
    rng = np.random.default_rng(4)
    series = series_of([disturbed(PAIR, 1, Disturbance(), duration=120.0)], "II")
    model = state_space("cthp-s0-delay", random_values("cthp-s0-delay", 300, rng), series.step)
    measured = np.repeat(series.measured[:, :, :1], 300, axis=2)
    measured[150, 0] = np.nan
    together, innovation = innovations(model, measured)
    smoothed = smooth(model, measured)
    for b in range(0, 300, 23):
        alone = model.of(slice(b, b + 1))
        total, single = innovations(alone, measured[..., :1])
        np.testing.assert_allclose(together[b], total[0], rtol=1e-9)
        np.testing.assert_allclose(innovation.errors[..., b], single.errors[..., 0], atol=1e-9)
        np.testing.assert_allclose(
            innovation.variances[..., b], single.variances[..., 0], rtol=1e-9
        )
        np.testing.assert_allclose(
            smoothed[..., b], smooth(alone, measured[..., :1])[..., 0], atol=1e-6
        )


def test_windows_that_share_a_model_are_as_each_with_its_own():
    """Complete ones share its covariances; beside them a shorter one and one with a hole."""
    rng = np.random.default_rng(5)
    parts = [disturbed(PAIR[[0]], seed, Disturbance(), duration=120.0) for seed in (1, 2, 3, 4)]
    measured = series_of(parts, "II").measured.copy()
    measured[150:, :, 2] = np.nan
    measured[90:95, 0, 3] = np.nan
    of = np.array([1, 1, 1, 1, 0, 0])
    pairs = Pairs(of, np.array([0, 1, 2, 3, 0, 1]))
    model = state_space("cthp-s0-delay", random_values("cthp-s0-delay", 2, rng), 0.5)
    totals, innovation = innovations(model, measured, pairs)
    expected, separate = innovations(model.of(of), measured[:, :, pairs.series])
    np.testing.assert_allclose(totals, expected, rtol=1e-10)
    np.testing.assert_allclose(log_likelihood(model, measured, pairs), expected, rtol=1e-10)
    np.testing.assert_allclose(innovation.errors, separate.errors, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(innovation.variances, separate.variances, rtol=1e-10)
    for columns in ([0, 1], [2], [3, 2]):  # series that no pair has do not matter
        some = Pairs(pairs.models[columns], pairs.series[columns])
        np.testing.assert_allclose(log_likelihood(model, measured, some), expected[columns])


@pytest.mark.parametrize("missing", [with_holes, shorter])
@pytest.mark.parametrize("form", CTHPS)
def test_likelihood_and_smoothed_states_agree_with_statsmodels(form, missing):
    rng = np.random.default_rng(10)
    series = series_of([disturbed(PAIR, 1, Disturbance(), duration=120.0)], "II")
    model = state_space(form, random_values(form, 2, rng), series.step)
    measured = missing(series.measured, rng)
    smoothed, (total, innovation) = smooth(model, measured), innovations(model, measured)
    np.testing.assert_allclose(log_likelihood(model, measured), total)
    np.testing.assert_allclose(innovation.log_density.sum(axis=(0, 1)), total)
    assert (innovation.present == ~np.isnan(measured)).all()
    for b in range(2):
        other = reference(model, measured, b)
        expected = other.smooth()
        np.testing.assert_allclose(total[b], other.loglike(), rtol=1e-8, atol=1e-7)
        scale = np.sqrt(np.einsum("iik->ki", expected.smoothed_state_cov))
        off = (smoothed[..., b] - expected.smoothed_state.T) / np.maximum(scale, 1e-7)
        assert np.abs(off).max() < 1e-4
