"""Bands of the predicted space-gaps: exact without disturbances, and as wide as they should be."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import closed_loop
from accpinn.inference import prediction
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.inference.prediction import SIMULATIONS, gap_band
from accpinn.methods import least_squares
from accpinn.methods.series import stride_of
from accpinn.model.cthp import Parameters
from accpinn.results.figures.training import tracking
from accpinn.segment.segment import Segment
from bench.disturbed import Disturbance, disturbed

pytestmark = pytest.mark.usefixtures("all_draws")

TRUE = ((0.1, 0.3, 1.2), (0.08, 0.2, 1.4))


@pytest.fixture(scope="module")
def segment() -> Segment:
    return disturbed(Parameters.of(TRUE), 2, Disturbance(), duration=120.0)


@pytest.fixture(scope="module")
def uncertainty(segment: Segment) -> Uncertainty:
    return intervals(segment, least_squares.fit(segment))


def test_without_disturbance_and_doubt_it_is_the_closed_loop_simulation(
    segment: Segment, uncertainty: Uncertainty, monkeypatch: pytest.MonkeyPatch
) -> None:
    still = np.array([[1e-9, 4.0, 0.2], [1e-9, 4.0, 0.2]])
    monkeypatch.setattr(prediction, "_disturbances", lambda *_: still)
    certain = Parameters.of(np.tile(TRUE, (SIMULATIONS, 1, 1)))
    found = gap_band(segment, replace(uncertainty, draws=certain), "II")
    # The band takes the leader's speed as straight over half a second.
    stride = stride_of(segment)
    coarse = replace(
        segment, time=segment.time[::stride], speeds=segment.speeds[::stride],
        gaps=segment.gaps[::stride],
    )  # fmt: skip
    expected = closed_loop(coarse, replace(least_squares.fit(coarse), parameters=certain[0]))
    for end in (found.lower, found.upper):
        np.testing.assert_allclose(end, expected.gaps, atol=1e-5)


def test_an_intercept_shifts_the_gaps_and_their_band(
    segment: Segment, uncertainty: Uncertainty
) -> None:
    found = gap_band(segment, uncertainty, "II")
    draws = uncertainty.draws.complete.copy()
    draws[..., 3] = 4.0
    with_intercept = replace(uncertainty, draws=Parameters.of(draws))
    shifted = gap_band(replace(segment, gaps=segment.gaps + 4.0), with_intercept, "II")
    # The disturbances are estimated under a model without an intercept, so their sizes differ.
    np.testing.assert_allclose(shifted.lower[0], found.lower[0] + 4.0)
    middle = [(band.lower + band.upper).mean(axis=0) / 2 for band in (found, shifted)]
    np.testing.assert_allclose(middle[1], middle[0] + 4.0, atol=0.5)


def test_it_holds_most_of_what_is_measured_and_begins_there(
    segment: Segment, uncertainty: Uncertainty
) -> None:
    found = gap_band(segment, uncertainty, "II")
    np.testing.assert_allclose(found.lower[0], segment.measured_gaps[0])
    assert (found.upper[40:] - found.lower[40:] > 0.5).all()
    assert [one.vehicle for one in found.findings] == [2, 3]
    assert all(0.75 < one.share <= 1.0 for one in found.findings)
    inside = (found.lower <= segment.gaps[::5]) & (segment.gaps[::5] <= found.upper)
    assert [one.share for one in found.findings] == pytest.approx(inside.mean(axis=0).tolist())
    figure = tracking(segment, 1, None, None, predicted=found, disturbance=0 * segment.gaps)
    names = [trace.name for trace in figure.data]
    assert names.count("90 % band") == 1
    assert names.count("disturbance") == 1


def test_behind_a_follower_without_draws_there_is_no_band(
    segment: Segment, uncertainty: Uncertainty
) -> None:
    values = uncertainty.draws.values.copy()
    values[:, 1] = np.nan
    found = gap_band(segment, replace(uncertainty, draws=Parameters.of(values)), "II")
    assert np.isfinite(found.lower[:, 0]).all()
    assert np.isnan(found.lower[:, 1]).all()
    assert [one.vehicle for one in found.findings] == [2]
    values[:, 0] = np.nan
    assert gap_band(segment, replace(uncertainty, draws=Parameters.of(values)), "II") is None
