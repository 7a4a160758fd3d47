"""Gains from the leader to each follower, against products, grids and a fine convolution."""

from math import inf, isnan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import impulse

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import response, step_metrics
from accpinn.stability.head_to_tail import head_to_tail_gains, head_to_tail_peaks
from tests.stability.references import TABLE
from tests.support.vehicles import AUDI, CALM, NO_REACTION, TESLA, UNDAMPED, damping, ordinary, row

platoons = st.lists(
    ordinary.filter(lambda vehicle: damping(vehicle) > 0.05), min_size=2, max_size=5
)


def test_peak_is_the_largest_product_on_a_fine_grid() -> None:
    mixed = row(*(reference.vehicle for reference in TABLE))
    omega = np.geomspace(1e-3, 3.0, 100_001)
    largest = np.abs(np.cumprod(response(mixed, omega), axis=0)).max(axis=1)
    found = head_to_tail_peaks(mixed).gain
    np.testing.assert_allclose(found, largest, rtol=1e-7)
    assert (found >= largest * (1 - 1e-12)).all()


@given(platoons, st.randoms(use_true_random=False))
@settings(max_examples=25)
def test_the_gains_to_the_last_follower_do_not_depend_on_the_order(
    platoon: list[Parameters], random
) -> None:
    one = row(*platoon)
    random.shuffle(platoon)
    other = row(*platoon)
    first, second = head_to_tail_peaks(one).gain[-1], head_to_tail_peaks(other).gain[-1]
    assert first == pytest.approx(second, rel=1e-9)
    found, again = head_to_tail_gains(one), head_to_tail_gains(other)
    tolerance = 1e-7 + 3 * (found.error[-1] + again.error[-1])
    assert found.gain[-1] == pytest.approx(again.gain[-1], abs=tolerance)


@given(platoons)
@settings(max_examples=25)
def test_the_exact_gain_lies_between_peak_and_product(platoon: list[Parameters]) -> None:
    vehicles = row(*platoon)
    found = head_to_tail_gains(vehicles)
    slack = 1e-7 + 3 * found.error
    assert (found.gain >= head_to_tail_peaks(vehicles).gain - slack).all()
    assert (found.gain <= np.cumprod(step_metrics(vehicles).gain) + slack).all()


def test_the_exact_gain_agrees_with_a_fine_convolution() -> None:
    step = 0.005
    # The midpoint rule for each h, then the integral of the magnitude of their convolution.
    instants = np.arange(60_000) * step + step / 2
    one, other = (
        impulse(([v.beta, v.alpha], [1.0, v.alpha * v.tau + v.beta, v.alpha]), T=instants)[1]
        for v in (AUDI, TESLA)
    )
    length = 2 * len(instants)
    both = np.fft.irfft(np.fft.rfft(one, length) * np.fft.rfft(other, length))[: len(one)]
    found = head_to_tail_gains(row(AUDI, TESLA))
    assert found.gain[1] == pytest.approx(np.abs(both).sum() * step**2, abs=2e-5)
    assert found.error[1] < 1e-6
    assert found.error[0] == 0


def test_nothing_passes_one_that_does_not_react_and_an_undamped_one_has_no_bound() -> None:
    platoon = row(AUDI, NO_REACTION, AUDI)
    found = head_to_tail_peaks(platoon).gain
    assert found[0] > 1
    assert list(found[1:]) == list(head_to_tail_gains(platoon).gain[1:]) == [0, 0]
    undamped = head_to_tail_peaks(row(AUDI, UNDAMPED, CALM))
    assert list(undamped.gain[1:]) == [inf, inf]
    assert undamped.omega[2] == 0.5


@pytest.mark.parametrize(
    "platoon",
    [
        row(Parameters(1e-12, 1.0, 0.1), Parameters(1e8, 1.0, 1e-5)),
        row(Parameters(1.0, 0.001, 0.001), AUDI),
    ],
    ids=["time scales too far apart", "an oscillation that outlasts the samples"],
)
def test_what_cannot_be_computed_is_nan(platoon: Parameters) -> None:
    gain = head_to_tail_gains(platoon).gain
    assert gain[0] == step_metrics(platoon).gain[0]
    assert isnan(gain[1])
