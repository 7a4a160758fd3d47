"""Quality of a segment: figures against known ones, findings where excitation is too small."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.evaluation.evaluation import part
from accpinn.model.cthp import Parameters, simulate
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import LittleLeaderMotion, Mode, Recording
from accpinn.results.messages.recording import MEANING, WORDS
from accpinn.segment.cut import cut
from accpinn.segment.quality import (
    GapsNegative,
    Grade,
    LittleCarFollowing,
    NearEquilibrium,
    Question,
    Rating,
    assess_quality,
    rate,
)
from accpinn.segment.segment import Segment
from tests.support.driving import segment_of
from tests.support.samples import FOLDER, NOISY

PARAMETERS = Parameters([0.08], [0.12], [1.5])


def made(speeds: np.ndarray, gaps: np.ndarray) -> Segment:
    return segment_of(0.1 * np.arange(len(speeds)), speeds, gaps)


def following(amplitude: float) -> Segment:
    """One follower behind a leader whose speed swings around 20 m/s."""
    time = 0.1 * np.arange(3001)
    leader = 20 + amplitude * np.sin(0.15 * time) + 0.5 * amplitude * np.sin(0.41 * time)
    motion = simulate(PARAMETERS, time, leader, np.array([20.0]), np.array([30.0]))
    return made(motion.speeds, motion.gaps)


def test_an_excited_segment_has_no_findings() -> None:
    quality = assess_quality(following(3.0))
    assert quality.findings == ()
    assert quality.mean_time_gap[0] == pytest.approx(1.5, abs=0.05)
    assert quality.car_following == (1.0,)
    assert quality.condition[0] < 30
    # A sinusoid's standard deviation is its amplitude over √2, and ω times that of its rate.
    time = 0.1 * np.arange(2000)
    wave = np.sin(2 * np.pi / 20 * time)
    swing = assess_quality(made(np.stack([20 + 3 * wave, 20 - wave], 1), np.full((2000, 1), 30.0)))
    figures = swing.leader_deviation, *swing.relative_deviation, *swing.acceleration_deviation
    assert figures == pytest.approx(np.array([3, 4, np.pi / 10]) / np.sqrt(2), rel=1e-3)


def test_near_equilibrium_is_found() -> None:
    quality = assess_quality(following(0.02))
    assert quality.condition[0] > 1000
    assert quality.findings == (
        LittleLeaderMotion(vehicle=1, deviation=quality.leader_deviation),
        NearEquilibrium(
            vehicles=(2,), deviations=quality.relative_deviation, conditions=quality.condition
        ),
    )


def test_standing_vehicles_have_no_time_gap() -> None:
    speeds = np.full((200, 2), 10.0)
    speeds[:100, 1] = 0.5
    segment = made(speeds, np.full((200, 1), 15.0))
    assert np.isnan(segment.time_gaps[:100]).all()
    quality = assess_quality(segment)
    assert quality.mean_time_gap == (1.5,)
    assert quality.car_following == (0.5,)
    still = assess_quality(made(np.zeros((200, 2)), np.full((200, 1), 3.0)))
    assert np.isnan(still.mean_time_gap[0])
    assert still.car_following == (0.0,)


@pytest.mark.parametrize(
    ("keeps", "limit"), [(1.2, 2.0), (1.8, 1.3 * 1.8), (2.5, 1.3 * 2.5), (2.9, 3.5), (5.0, 3.5)]
)
def test_a_long_setting_is_car_following_and_a_fifth_in_catching_up_is_not(
    keeps: float, limit: float
) -> None:
    gaps = np.full((200, 1), 10.0 * keeps)
    gaps[:40] = 10.0 * 4.0
    segment = made(np.full((200, 2), 10.0), gaps)
    assert segment.longest_time_gaps == pytest.approx((limit,))
    assert segment.car_following.mean() == (0.8 if keeps < 3.5 else 0.0)
    assert part(segment, 0, 40).car_following.mean() == 0.0, "by the whole recording's setting"


def test_findings_have_all_the_followers_they_hold_for() -> None:
    """Perfect equilibrium, every other one far behind, and one gap that is negative at times."""
    gaps = np.tile([80.0, 30.0], (200, 5))
    gaps[5:8, 1] = -1.0
    quality = assess_quality(made(np.full((200, 11), 20.0), gaps))
    leader, still, elsewhere, negative = quality.findings
    assert isinstance(leader, LittleLeaderMotion)
    assert isinstance(still, NearEquilibrium)
    assert still.vehicles == tuple(range(2, 12))
    assert (quality.condition[0], quality.relative_deviation[0]) == (np.inf, 0.0)
    assert elsewhere == LittleCarFollowing(vehicles=(2, 4, 6, 8, 10), shares=(0.0,) * 5)
    assert negative == GapsNegative(vehicles=(3,), instants=(3,))


def test_the_condition_number_is_of_what_counts() -> None:
    segment = following(3.0)
    out = (segment.time > 150.0)[:, None]
    kept = assess_quality(replace(segment, mask=~out))
    half = made(segment.speeds[segment.time <= 150.0], segment.gaps[segment.time <= 150.0])
    assert kept.condition == pytest.approx(assess_quality(half).condition)
    assert kept.mean_time_gap == assess_quality(segment).mean_time_gap
    assert assess_quality(replace(segment, mask=out & ~out)).condition == (float("inf"),)


def test_the_papers_mean_time_gaps(astazero: Recording, casale: Recording) -> None:
    """The mean time gaps published for AstaZero, at the two digits that they have."""
    quality = assess_quality(cut(astazero, start=320.0, duration=300.0))
    assert [f"{gap:.2f}" for gap in quality.mean_time_gap] == ["1.25", "1.23", "1.20", "1.30"]
    assert quality.findings == ()
    catching = assess_quality(cut(casale))
    assert f"{1 - catching.car_following[0]:.2f}" == "0.21"
    assert catching.findings == ()


# Ratings of a window: each answer from data that deserve it


def rated(recording: Recording, **choice: object) -> dict[Question, Rating]:
    segment = cut(recording, 100.0, 100.0, (1, 2), **choice)
    ratings = rate(segment, recording, assess_quality(segment))
    for rating in ratings:  # each has its words
        assert WORDS[rating.question][rating.grade]
    return {rating.question: rating for rating in ratings}


@pytest.fixture
def sound() -> Recording:
    return read(FOLDER / f"{NOISY}.csv")


def test_sound_data_are_good_throughout(sound: Recording) -> None:
    ratings = rated(sound)
    assert {rating.grade for rating in ratings.values()} == {Grade.GOOD}
    assert set(ratings) == set(WORDS) == set(MEANING)


def test_each_fault_lowers_the_grade_of_its_own_question_alone(sound: Recording) -> None:
    def grades(recording: Recording, **choice: object) -> dict[Question, Grade]:
        grades = {q: rating.grade for q, rating in rated(recording, **choice).items()}
        return {q: grade for q, grade in grades.items() if grade is not Grade.GOOD}

    gap = sound.gap.copy()
    gap[1050:1053] = np.nan
    assert grades(replace(sound, gap=gap)) == {"complete": Grade.FAIR}
    gap[1050:1090] = np.nan
    assert grades(replace(sound, gap=gap), allow_missing=True) == {"complete": Grade.POOR}
    assert grades(replace(sound, gap=sound.gap + 60)) == {"following": Grade.POOR}
    mode = sound.mode.copy()
    mode[1000:1020, 1] = Mode.HUMAN
    assert grades(replace(sound, mode=mode)) == {"driver": Grade.FAIR}
    mode[1000:1200, 1] = Mode.HUMAN
    assert grades(replace(sound, mode=mode)) == {"driver": Grade.POOR}
    mode = sound.mode.copy()
    mode[1000:1020, 1] = Mode.UNKNOWN
    assert grades(replace(sound, mode=mode)) == {"driver": Grade.UNKNOWN}
    silent = replace(sound, mode=np.full_like(sound.mode, Mode.UNKNOWN))
    assert grades(silent) == {"driver": Grade.UNKNOWN}
    assert grades(replace(silent, acc_flag=0)) == {"driver": Grade.POOR}
    assert grades(replace(sound, gap=sound.gap - 60))["consistent"] is Grade.POOR, "negative"
    still = replace(sound, speed=np.full_like(sound.speed, 20.0), gap=np.full_like(sound.gap, 30.0))
    assert grades(still) == {"excited": Grade.POOR, "consistent": Grade.UNKNOWN}


def test_a_gap_that_contradicts_the_speeds(openacc_dir: Path) -> None:
    recording = read(openacc_dir / "Vicolungo/JRC-VC_260219_part3.csv")
    for vehicles, grade in (((1, 2, 3, 4), Grade.GOOD), ((4, 5), Grade.POOR)):
        segment = cut(recording, 0.0, 100.0, vehicles)
        *_, consistent = rate(segment, recording, assess_quality(segment))
        assert consistent.grade is grade
