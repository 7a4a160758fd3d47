"""Least squares on smoothed signals: exact on polynomials, true to the sample recordings."""

import numpy as np
import pytest

from accpinn.methods import least_squares, savitzky_golay
from tests.support.driving import LAW, driven, segment_of
from tests.support.samples import NOISE_FREE, NOISY, PLATOON, sample


@pytest.mark.parametrize(
    ("name", "tolerance"), [(NOISE_FREE, 5e-4), (NOISY, 0.02), (PLATOON, 0.03)]
)
def test_recovers_the_studies(name: str, tolerance: float) -> None:
    study = sample(name)
    found = savitzky_golay.fit(study.segment).parameters.values
    np.testing.assert_allclose(found, study.truth, rtol=tolerance)


def test_smoothing_takes_away_most_of_the_noise_that_biases_plain_least_squares() -> None:
    segment = driven((LAW,), duration=300.0, noise=0.3)
    plain, smooth = (
        method.fit(segment).parameters.values for method in (least_squares, savitzky_golay)
    )
    error_plain, error_smooth = (abs(table[0] / LAW - 1).max() for table in (plain, smooth))
    assert error_smooth < 0.5 * error_plain


def test_leaves_cubics_as_they_are() -> None:
    """So the model holds exactly where the motion is a cubic, also at the window's ends."""
    time = 0.1 * np.arange(200)
    follower = 20 + 0.4 * time - 0.03 * time**2 + 0.0008 * time**3
    rate = 0.4 - 0.06 * time + 0.0024 * time**2
    ahead = 22 - 0.2 * time + 0.01 * time**2
    alpha, beta, tau = LAW
    gap = (rate - beta * (ahead - follower)) / alpha + tau * follower
    segment = segment_of(time, np.column_stack([ahead, follower]), gap[:, None])
    fit = savitzky_golay.fit(segment)
    np.testing.assert_allclose(fit.parameters.values, [LAW], rtol=1e-6)
    assert fit.surrogate is not None
    np.testing.assert_allclose(fit.surrogate.speeds, segment.speeds, rtol=1e-9)


@pytest.mark.parametrize(
    ("step", "samples"), [(0.1, 21), (0.05, 41), (0.5, 5), (1.0, 5)], ids=lambda value: str(value)
)
def test_window_is_two_seconds_or_five_samples(step: float, samples: int) -> None:
    fit = savitzky_golay.fit(driven(duration=100.0, step=step))
    assert fit.config["window"] == pytest.approx(samples * step)
    np.testing.assert_allclose(fit.parameters.values, [LAW], rtol=0.02)
