"""What a segment can tell: figures against known ones, warnings where data cannot answer."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.model.cthp import Parameters, simulate
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.segment.quality import assess_quality, time_gaps
from accpinn.segment.segment import Segment


def made(speeds: np.ndarray, gaps: np.ndarray) -> Segment:
    vehicles = tuple(range(1, speeds.shape[1] + 1))
    return Segment(
        time=0.1 * np.arange(len(speeds)),
        speeds=speeds,
        gaps=gaps,
        vehicles=vehicles,
        names=tuple(f"V{number}" for number in vehicles),
        start=0.0,
        source="made.csv",
        sha256="",
    )


def following(amplitude: float) -> Segment:
    """One follower behind a leader whose speed swings around 20 m/s."""
    time = 0.1 * np.arange(3001)
    leader = 20 + amplitude * np.sin(0.15 * time) + 0.5 * amplitude * np.sin(0.41 * time)
    law = Parameters(0.08, 0.12, 1.5)
    motion = simulate((law,), time, leader, np.array([20.0]), np.array([30.0]))
    return made(motion.speeds, motion.gaps)


def test_an_excited_segment_has_no_warnings() -> None:
    quality = assess_quality(following(3.0))
    assert quality.warnings == ()
    assert quality.mean_time_gap[0] == pytest.approx(1.5, abs=0.05)
    assert quality.car_following == (1.0,)
    assert quality.condition[0] < 30


def test_near_equilibrium_is_said() -> None:
    quality = assess_quality(following(0.02))
    assert quality.condition[0] > 1000
    assert "leader's speed varies by only 0.02 m/s" in quality.warnings[0]
    assert "Near equilibrium" in quality.warnings[1]
    assert "2 V2 (Δv varies by 0.0" in quality.warnings[1]


def test_perfect_equilibrium_is_finite_or_infinite_but_never_an_error() -> None:
    quality = assess_quality(made(np.full((200, 2), 20.0), np.full((200, 1), 30.0)))
    assert quality.condition == (float("inf"),)
    assert quality.relative_deviation == (0.0,)
    assert len(quality.warnings) == 2


def test_standing_vehicles_have_no_time_gap() -> None:
    speeds = np.full((200, 2), 10.0)
    speeds[:100, 1] = 0.5
    segment = made(speeds, np.full((200, 1), 15.0))
    gaps = time_gaps(segment)
    assert np.isnan(gaps[:100]).all()
    quality = assess_quality(segment)
    assert quality.mean_time_gap == (1.5,)
    assert quality.car_following == (0.5,)
    still = assess_quality(made(np.zeros((200, 2)), np.full((200, 1), 3.0)))
    assert np.isnan(still.mean_time_gap[0])
    assert still.car_following == (0.0,)


def test_catching_up_is_not_car_following() -> None:
    gaps = np.linspace(20, 80, 200)[:, None]
    quality = assess_quality(made(np.full((200, 2), 20.0), gaps))
    assert quality.car_following[0] == pytest.approx((gaps <= 40).mean())
    assert any("In car-following" in w and "2 V2 (34 %)" in w for w in quality.warnings)


def test_negative_gaps_are_said() -> None:
    segment = following(3.0)
    gaps = segment.gaps.copy()
    gaps[5:8] = -1.0
    assert (
        "negative, which cannot be: 2 V2 (at 3"
        in assess_quality(made(segment.speeds, gaps)).warnings[0]
    )


def test_vehicles_of_a_long_platoon_share_a_sentence() -> None:
    """A sentence each would hide the last ones behind the first few."""
    speeds = np.full((200, 11), 20.0)
    gaps = np.full((200, 10), 60.0)
    warnings = assess_quality(made(speeds, gaps)).warnings
    assert len(warnings) == 3
    for number in range(2, 12):
        assert all(f"{number} V{number} (" in warning for warning in warnings[1:])


def test_the_condition_number_is_of_what_counts() -> None:
    segment = following(3.0)
    out = (segment.time > 150.0)[:, None]
    kept = assess_quality(replace(segment, left_out=out))
    half = made(segment.speeds[segment.time <= 150.0], segment.gaps[segment.time <= 150.0])
    assert kept.condition == pytest.approx(assess_quality(half).condition)
    assert kept.mean_time_gap == assess_quality(segment).mean_time_gap
    assert assess_quality(replace(segment, left_out=np.ones_like(out))).condition == (float("inf"),)


def test_figures_against_their_definitions() -> None:
    segment = following(2.0)
    quality = assess_quality(segment)
    leader, follower = segment.speeds.T
    assert quality.leader_deviation == pytest.approx(leader.std())
    assert quality.relative_deviation[0] == pytest.approx((leader - follower).std())
    law = 0.08 * (segment.gaps[:, 0] - 1.5 * follower) + 0.12 * (leader - follower)
    assert quality.acceleration_deviation[0] == pytest.approx(law.std(), rel=1e-3)


def test_the_papers_mean_time_gaps(openacc_dir: Path) -> None:
    """The mean time gaps published for AstaZero, at the two digits that they have."""
    recording = read(openacc_dir / "AstaZero/ASta_040719_platoon5.csv")
    quality = assess_quality(cut(recording, start=320.0, duration=300.0))
    assert [f"{gap:.2f}" for gap in quality.mean_time_gap] == ["1.25", "1.23", "1.20", "1.30"]
    assert quality.warnings == ()


def test_casale_catches_up_for_a_fifth_of_the_time(openacc_dir: Path) -> None:
    quality = assess_quality(cut(read(openacc_dir / "Casale/part7.csv")))
    assert f"{1 - quality.car_following[0]:.2f}" == "0.21"
    assert quality.warnings == ()


def test_a_constant_speed_window_is_recognised(openacc_dir: Path) -> None:
    recording = read(openacc_dir / "AstaZero/ASta_040719_platoon5.csv")
    quality = assess_quality(cut(recording, start=540.0, duration=40.0, vehicles=(1, 2, 3)))
    assert len(quality.warnings) == 2
    assert "2 Audi" in quality.warnings[1]
    assert "3 BMW" in quality.warnings[1]
    assert min(quality.condition) > 100
