"""What the windows say of an answer: the same in how many, and whether the drive is reproduced."""

import numpy as np
import pytest

from accpinn.inference.answer import Trust, trust
from accpinn.model.cthp import Parameters
from accpinn.segment.segment import Segment
from bench.disturbed import Disturbance, disturbed

TRUE = Parameters(0.1, 0.3, 1.2)


@pytest.fixture(scope="module")
def windows() -> list[Segment]:
    return [disturbed(TRUE[None], seed, Disturbance(0.05), duration=120.0) for seed in range(4)]


def held(windows: list[Segment], answer: Parameters, taus: tuple[float, ...]) -> Trust:
    own = Parameters(np.full(4, 0.1), np.full(4, 0.3), np.array(taus))
    return trust(windows, 2, [0], "cthp", answer, own)


def test_the_truth_reproduces_the_drive_and_windows_are_counted(windows: list[Segment]) -> None:
    found = held(windows, TRUE, (1.2, 1.21, 1.3, 1.19))
    assert (found.windows, found.same) == (4, 3)
    assert found.is_reproduced
    assert found.rmse < 1.5
    assert found.deviation == pytest.approx(
        np.sqrt(np.mean([window.gaps.var() for window in windows])), rel=1e-6
    )


def test_another_car_does_not(windows: list[Segment]) -> None:
    found = held(windows, Parameters(0.02, 0.02, 2.5), (1.2,) * 4)
    assert found.same == 0
    assert not found.is_reproduced
    assert "oes not reproduce the drive" in found.in_words


def test_a_collision_is_no_reproduction(windows: list[Segment]) -> None:
    found = held(windows, Parameters(0.3, 0.0, 0.05), (0.05,) * 4)
    assert found.collides
    assert not found.is_reproduced
    assert "ollides in the simulation of the drive" in found.in_words


def test_a_pair_is_one_follower_behind_the_measured_vehicle_ahead() -> None:
    both = disturbed([TRUE, TRUE], 1, Disturbance(0.05))
    pair = both.pair(1)
    assert pair.vehicles == both.vehicles[1:]
    np.testing.assert_array_equal(pair.speeds, both.speeds[:, 1:])
    np.testing.assert_array_equal(pair.gaps[:, 0], both.gaps[:, 1])
