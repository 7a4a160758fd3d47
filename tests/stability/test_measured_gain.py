"""The gain measured by Welch's method: recovered, without meaning where nothing is common."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import coherence, lfilter

from accpinn import MeasuredGain, Parameters, Segment, measured_gain
from accpinn.errors import SegmentError
from accpinn.model.cthp import Trajectories, simulate
from accpinn.stability.criteria import response
from accpinn.units import FloatArray, Stretch
from tests.support.driving import segment_of, standing_still
from tests.support.holes import with_holes
from tests.support.vehicles import AUDI, TESLA, row

STEP, SAMPLES = 0.1, 12_001
PLATOON = row(AUDI, TESLA)
RESPONDING = 0.8
"""In rad/s; above it the vehicles let little through."""


def wandering(seed: int, deviation: float, memory: float) -> FloatArray:
    """(N,) a stationary first-order process."""
    kept = np.exp(-STEP / memory)
    steps = np.random.default_rng(seed).standard_normal(SAMPLES) * np.sqrt(1 - kept**2)
    return np.asarray(deviation * lfilter([1.0], [1.0, -kept], steps))


def driven(seed: int, noise: float = 0.0) -> Segment:
    """Two followers of a leader that speeds up and slows down at random, for 20 minutes."""
    time = STEP * np.arange(SAMPLES)
    ahead = 20 + wandering(seed, 1.5, 8.0)
    true: Trajectories = simulate(PLATOON, time, ahead, np.full(2, ahead[0]), PLATOON.tau * 20)
    speeds = true.speeds.copy()
    speeds[:, 1:] += noise * np.column_stack([wandering(seed + k, 1.0, 4.0) for k in (50, 60)])
    return segment_of(time, speeds, true.gaps)


@pytest.fixture(scope="module")
def segment() -> Segment:
    return driven(1, noise=0.1)


def covered(found: MeasuredGain, vehicle: Parameters) -> float:
    """The share of frequencies at which vehicles respond whose band holds the gain."""
    below = found.omega < RESPONDING
    assert found.coherent[below].all()
    truth = np.abs(response(row(vehicle), found.omega))[0]
    return float(((found.lower <= truth) & (truth <= found.upper))[below].mean())


def test_the_gain_of_a_simulated_platoon_lies_in_its_band() -> None:
    shares = []
    for seed in range(4):
        found = measured_gain(driven(seed, noise=0.1), 0)
        assert found.pieces == 15
        assert 10 < found.averages < 15
        assert found.length == pytest.approx(150, abs=0.2)
        shares.append(covered(found, AUDI))
    assert 0.75 < np.mean(shares) < 0.99


def test_without_noise_it_is_the_gain(segment: Segment) -> None:
    clean, noisy = measured_gain(driven(1), 1), measured_gain(segment, 1)
    below = clean.omega < RESPONDING
    assert clean.coherence[below].min() > 0.97
    truth = np.abs(response(row(TESLA), clean.omega))[0]
    np.testing.assert_allclose(clean.gain[below], truth[below], rtol=0.05)
    assert (noisy.upper - noisy.lower)[below].mean() > (clean.upper - clean.lower)[below].mean()
    assert noisy.coherence[below].mean() < clean.coherence[below].mean()


def test_independent_signals_are_not_coherent(segment: Segment) -> None:
    apart = np.column_stack([driven(seed).speeds[:, 0] for seed in (5, 6)])
    found = measured_gain(segment_of(segment.time, apart, segment.gaps[:, :1]), 0)
    assert found.coherence.mean() < 2.5 / found.averages
    assert found.coherent.mean() < 0.15
    still = measured_gain(standing_still(samples=3001), 0)
    assert not still.coherent.any()
    np.testing.assert_array_equal(still.gain, 0)
    assert np.isinf(still.upper).all()


def test_one_stretch_has_the_coherence_that_scipy_finds(segment: Segment) -> None:
    found = measured_gain(segment, 0)
    ahead, own = np.diff(segment.speeds[:, :2], axis=0).T
    _, expected = coherence(ahead, own, 1 / STEP, "cosine", round(found.length / STEP))
    np.testing.assert_allclose(found.coherence, expected[1 : len(found.omega) + 1], rtol=1e-9)


def test_missing_and_excluded_samples_do_not_count(segment: Segment) -> None:
    whole = measured_gain(segment, 0)
    for speed in (0, 1):  # a second is bridged by a straight line, more is not
        assert measured_gain(with_holes(segment, {speed: [Stretch(5000, 5400)]}), 0).pieces < 15
    holed = with_holes(segment, {0: [Stretch(5000, 5400)], 2: [Stretch(0, 6000)], 3: []})
    found = measured_gain(holed, 0)
    assert found.pieces >= 10
    assert covered(found, AUDI) > 0.7
    mask = np.ones((SAMPLES, 2), bool)
    mask[5000:5401, 0] = False
    excluded = measured_gain(replace(segment, mask=mask), 0)
    np.testing.assert_array_equal(excluded.gain, found.gain)
    bridged = np.zeros((SAMPLES, 5), bool)
    bridged[5000:5010, 0] = True
    np.testing.assert_array_equal(
        measured_gain(replace(segment, missing=bridged), 0).gain, whole.gain
    )


def test_too_short_a_window_is_refused(segment: Segment) -> None:
    short = segment_of(segment.time[:400], segment.speeds[:400], segment.gaps[:400])
    with pytest.raises(SegmentError, match=r"Car 3: no measured gain.*choose a longer window"):
        measured_gain(short, 1)
    gone = replace(short, missing=np.ones((400, 5), bool))
    with pytest.raises(SegmentError, match="no measured gain"):
        measured_gain(gone, 0)
