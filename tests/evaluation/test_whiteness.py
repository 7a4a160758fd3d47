"""The residual: noise is not taken for a disturbance, and what lasts is measured."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn import Parameters, Segment
from accpinn.evaluation.whiteness import (
    NEGLIGIBLE,
    CorrelatedResidual,
    ShortResidual,
    Whiteness,
    WhiteResidual,
    residual_correlations,
    residuals_of,
    whiteness,
)
from accpinn.methods import least_squares
from accpinn.model.registry import FOLLOWING
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW, driven
from tests.support.following import driven as followed

TRUTH = Parameters.of([LAW])


def at_truth(segment: Segment) -> Whiteness:
    return whiteness(segment, replace(least_squares.fit(segment), parameters=TRUTH))


@pytest.mark.parametrize(
    ("disturbance", "noise"),
    [(Disturbance(0.3, 0.02), 0.0), *((Disturbance(1e-9, 4.0), noise) for noise in (0.02, 0.1))],
)
def test_noise_is_not_taken_for_a_disturbance(disturbance: Disturbance, noise: float) -> None:
    """Differences of a noisy speed alternate: they are correlated, but nothing lasts."""
    clean = disturbed(TRUTH, 1, disturbance, noise=None)
    speeds = clean.speeds + noise * np.random.default_rng(1).standard_normal(clean.speeds.shape)
    found = at_truth(replace(clean, speeds=speeds))
    assert (found.correlation[0] < -0.3) == (noise > 0)
    assert found.memory[0] < 2.0
    assert found.probability[0] > 0.01
    assert isinstance(found.findings[0], WhiteResidual)
    assert (at_truth(clean).deviation[0] < NEGLIGIBLE) == (noise > 0)


def test_a_lasting_disturbance_is_measured() -> None:
    """A first-order process with memory T has an integrated autocorrelation time of 2T."""
    times, deviations = [], []
    for seed in range(4):
        segment = disturbed(TRUTH, seed, Disturbance(0.25, 4.0), duration=900.0)
        found = at_truth(segment)
        (finding,) = found.findings
        assert isinstance(finding, CorrelatedResidual)
        assert finding.samples == segment.samples - 1
        assert finding.memory == found.memory[0]
        assert found.probability[0] < 1e-6
        assert found.independent[0] == pytest.approx(900.0 / found.memory[0], rel=0.01)
        times.append(found.memory[0])
        deviations.append(found.deviation[0])
    assert np.mean(times) == pytest.approx(8.0, rel=0.35)
    # A second's mean of the process: a little below its own 0.25 m/s².
    assert np.mean(deviations) == pytest.approx(0.24, rel=0.15)


def test_masked_seconds_do_not_count() -> None:
    segment = disturbed(TRUTH, 1, Disturbance(0.25, 4.0))
    early = segment.time[:, None] < 150.0
    spoilt = replace(segment, gaps=segment.gaps + np.where(early, 0.0, 50.0))
    masked = replace(spoilt, mask=early)
    expected = at_truth(segment.part(0, 1501)).deviation[0]
    assert at_truth(spoilt).deviation[0] > 5 * expected
    assert at_truth(masked).deviation[0] == pytest.approx(expected, rel=0.02)
    # Seconds on either side of masked ones are no neighbours.
    sparse = at_truth(replace(segment, mask=segment.time[:, None] % 15.0 < 12.0))
    whole = at_truth(segment)
    assert sparse.memory[0] == pytest.approx(whole.memory[0], rel=0.35)
    assert sparse.correlation[0] == pytest.approx(whole.correlation[0], abs=0.1)
    nothing = replace(segment, mask=np.zeros_like(early))
    assert np.isnan(at_truth(nothing).deviation[0])


def test_a_short_window_has_no_test() -> None:
    segment = driven((LAW,), duration=20.0)
    found = at_truth(segment)
    assert np.isnan(found.probability[0])
    assert found.findings == (ShortResidual(2),)


def test_a_response_that_the_model_lacks_comes_after_the_acceleration_ahead() -> None:
    model, theta = FOLLOWING["cthp-s0-delay"], np.array([[0.1, 0.3, 0.9, 6.0, 0.8]])
    (run,) = followed(model, theta, 4, noise=0.01, seconds=1200.0)
    right = Parameters(*theta[:, :3].T, s0=theta[:, 3], delay=theta[:, 4])
    fit = replace(least_squares.fit(run), parameters=right, model=model.key)
    without = replace(fit, parameters=Parameters(*theta[:, :3].T, s0=theta[:, 3]), model="cthp-s0")
    deviations = [whiteness(run, one).deviation[0] for one in (fit, without)]
    assert deviations[0] < 0.3 * deviations[1]
    own, ahead = residual_correlations(run, without, 0)
    assert np.abs(ahead.values[(ahead.lags >= 0) & (ahead.lags <= 3)]).max() > ahead.limit
    assert (own.lags[0], ahead.lags[0]) == (1.0, -own.lags[-1])
    np.testing.assert_allclose(own.values[0], whiteness(run, without).correlation[0])
    assert residual_correlations(run.part(0, 200), without, 0) is None


@pytest.mark.parametrize("key", ["idm", "cthp-s0-lag"])
def test_the_residual_is_that_of_the_fits_own_model(key: str) -> None:
    model = FOLLOWING[key]
    (run,) = followed(model, model.typical[None], 4, noise=0.0)
    near = model.linearisations(model.typical[:, None], 25.0)
    residuals, *_ = residuals_of(run, replace(least_squares.fit(run), parameters=near, model=key))
    assert np.sqrt((residuals[:, 2:] ** 2).mean()) < 0.01
