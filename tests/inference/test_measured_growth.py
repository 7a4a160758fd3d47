"""The growth along a platoon: measured where a recording holds it, and the model's beyond."""

from functools import cache

import numpy as np
import pytest

from accpinn.errors import ParameterError
from accpinn.inference.intervals import Uncertainty, from_draws
from accpinn.inference.measured_growth import DIFFERENT, Growth, different, growth_along
from accpinn.model.cthp import Parameters
from accpinn.segment import Segment
from accpinn.stability.criteria import response
from accpinn.stability.measured_gain import head_to_tail_gain, measured_gain
from bench.disturbed import Disturbance, disturbed
from tests.support.snapshots import recommended

CARS = Parameters([0.07, 0.1, 0.08], [0.12, 0.15, 0.25], [1.1, 1.15, 1.15])
MILD = Parameters([0.06, 0.12, 0.07], [0.18, 0.15, 0.35], [1.2, 1.25, 1.1])
"""Models of these cars whose platoon grows 2 dB too little."""
RESOLVED = 0.45
"""Frequency in rad/s up to which these cars pass on enough to be measured."""


@cache
def windows(seed: int, hidden: bool = False) -> tuple[Segment, ...]:
    """Three windows of 300 s; of a platoon with a hidden car the second of four is not recorded."""
    cars = Parameters.of(CARS.everything[[0, 1, 1, 2]]) if hidden else CARS
    made = [disturbed(cars, 10 * seed + k, Disturbance(0.08), duration=300.0) for k in range(3)]
    if not hidden:
        return tuple(made)
    return tuple(without_second(window) for window in made)


def without_second(window: Segment) -> Segment:
    """The same without its second follower: the gap to the car behind it is to the first."""
    seen = [0, 1, 3, 4]
    gaps = np.column_stack([window.gaps[:, 0], window.gaps[:, 1:3].sum(axis=1), window.gaps[:, 3]])
    return Segment(
        vehicles=(1, 2, 3, 4),
        names=tuple(window.names[k] for k in seen),
        source=window.source,
        sha256="",
        time=window.time,
        speeds=window.speeds[:, seen],
        gaps=gaps,
        start=0.0,
    )


def grown(parts: tuple[Segment, ...], model: Parameters) -> Growth:
    pairs = [measured_gain(parts, k, reference=model[[k]]) for k in range(3)]
    growth = growth_along(pairs, model)
    assert growth is not None
    return growth


def certain(model: Parameters) -> Uncertainty:
    """The uncertainty of parameters that are known within 2 %."""
    spread = 1.0 + 0.02 * np.random.default_rng(0).standard_normal((200, 1, 6))
    return from_draws(model, Parameters.of(model.complete * spread), 0.9)


def test_the_band_covers_the_true_product_and_its_peak_where_models_are_too_mild() -> None:
    covered, peaks, modelled = [], [], []
    for seed in range(4):
        growth = grown(windows(seed), MILD)
        truth = np.abs(response(CARS, growth.omega)).prod(axis=0)
        used = growth.is_measured & (growth.omega < RESOLVED)
        assert used.mean() > 0.4
        covered.append(((growth.lower <= truth) & (truth <= growth.upper))[used].mean())
        assert growth.is_peak_measured
        peaks.append(20 * np.log10(growth.peak.value / truth.max()))
        modelled.append(20 * np.log10(growth.model_peak / truth.max()))
    assert 0.8 < np.mean(covered) <= 1.0
    assert abs(np.mean(peaks)) < 0.5
    assert np.mean(modelled) < -1.5


def test_a_reference_resolves_the_peak_of_a_short_window() -> None:
    errors = []
    for seed in range(4):
        window = windows(seed)[:1]
        gains = [head_to_tail_gain(window, reference=model) for model in (None, MILD, CARS)]
        truth = np.abs(response(CARS, gains[0].omega)).prod(axis=0)
        peaks = np.array([gain.gain.max() for gain in gains])
        errors.append(20 * np.log10(peaks / truth.max()))
    plain, mild, right = np.mean(errors, axis=0)
    assert plain < -1.2
    assert plain < mild < right
    assert abs(right) < 0.4


def test_pairs_multiply_to_the_gain_from_the_leader_to_the_last() -> None:
    growth, whole = grown(windows(0), MILD), head_to_tail_gain(windows(0), reference=MILD)
    used = (whole.coherence > 0.8) & (whole.omega < RESOLVED)
    product = np.interp(whole.omega[used], growth.omega, growth.gain)
    assert used.sum() > 4
    assert np.abs(20 * np.log10(product / whole.gain[used])).max() < 1.0


def test_cars_explain_a_platoon_of_theirs_and_not_one_with_a_car_that_is_not_recorded() -> None:
    order = range(3)
    shares = [different(grown(windows(seed), CARS), certain(CARS), order) for seed in range(4)]
    assert np.mean(shares) < DIFFERENT / 2
    hidden = different(grown(windows(0, hidden=True), CARS), certain(CARS), order)
    assert hidden > DIFFERENT


def test_what_is_not_measured_is_the_models_with_a_wide_band() -> None:
    growth = growth_along([None, None], CARS[:2])
    assert growth is not None
    assert not growth.is_measured.any()
    assert growth.at(0.2) is None
    np.testing.assert_allclose(growth.gain, growth.model, rtol=1e-12)
    widths = growth.upper / growth.lower
    assert widths[growth.omega > 0.1].min() > 2
    assert widths[0] < 0.8 * widths[-1], "what hardly oscillates is passed on by every car"
    undamped = Parameters([0.1], [0.0], [0.0])
    assert growth_along([None], undamped) is None
    assert np.isnan(different(growth, certain(CARS[:2]), range(2)))


def test_a_result_says_how_its_platoon_grows_in_any_order() -> None:
    result = recommended()
    whole, first = result.measured_growth(), result.measured_growth([0])
    twice = result.measured_growth([0, 0])
    np.testing.assert_allclose(twice.gain, first.gain**2, rtol=1e-9)
    assert (twice.upper / twice.lower > first.upper / first.lower).all()
    assert whole.gain.shape == whole.omega.shape
    with pytest.raises(ParameterError, match="order"):
        result.measured_growth([7])
