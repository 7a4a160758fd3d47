"""Quality of a segment, its regimes, and the mask that excludes some of their instants."""

from dataclasses import replace
from functools import cache, partial
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from accpinn import Case, Parameters, cut
from accpinn.errors import SegmentError
from accpinn.methods.pinn.config import FAST
from accpinn.recordings import LittleLeaderMotion, Mode, Recording, ValuesFrozen, Window
from accpinn.recordings.openacc import read
from accpinn.results.messages import messages
from accpinn.results.recording import LABELS, MEANING
from accpinn.segment import NothingToExclude, RegimesExcluded, Segment, SegmentInfo
from accpinn.segment.quality import (
    CATCHING_UP,
    FOLLOWING,
    MANUAL,
    STANDSTILL,
    GapsNegative,
    Grade,
    LittleCarFollowing,
    NearEquilibrium,
    Question,
    Rating,
    Regimes,
    assess_quality,
    exclude_regimes,
    label_regimes,
    rate,
)
from accpinn.serial import dump, restore
from tests.support import openacc_files
from tests.support.driving import driven, in_turn, segment_of
from tests.support.estimates import likeliest
from tests.support.methods import RIVALS as ESTIMATORS
from tests.support.methods import train
from tests.support.openacc_files import STEP
from tests.support.samples import FOLDER, NOISY


def made(speeds: np.ndarray, gaps: np.ndarray) -> Segment:
    return segment_of(0.1 * np.arange(len(speeds)), speeds, gaps)


def test_an_excited_segment_has_no_findings() -> None:
    quality = assess_quality(driven(duration=300.0))
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
    assert segment.part(0, 40).car_following.mean() == 0.0, "by the whole recording's setting"


def test_findings_have_all_the_followers_they_hold_for() -> None:
    """Perfect equilibrium, every other one far behind, and one gap that is negative at times."""
    gaps = np.tile([80.0, 30.0], (200, 5))
    gaps[5:8, 1] = -1.0
    quality = assess_quality(made(np.full((200, 11), 20.0), gaps))
    leader, still, elsewhere, negative = quality.findings
    assert leader == LittleLeaderMotion(vehicle=1, deviation=0.0)
    assert isinstance(still, NearEquilibrium)
    assert still.vehicles == tuple(range(2, 12))
    assert (quality.condition[0], quality.relative_deviation[0]) == (np.inf, 0.0)
    assert elsewhere == LittleCarFollowing(vehicles=(2, 4, 6, 8, 10), shares=(0.0,) * 5)
    assert negative == GapsNegative(vehicles=(3,), instants=(3,))


def test_the_condition_number_is_of_what_counts() -> None:
    segment = driven(duration=300.0)
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
        assert LABELS[rating.question][rating.grade]
    return {rating.question: rating for rating in ratings}


def test_each_fault_lowers_the_grade_of_its_own_question_alone() -> None:
    sound = read(FOLDER / f"{NOISY}.csv")

    def grades(recording: Recording, **choice: object) -> dict[Question, Grade]:
        grades = {q: rating.grade for q, rating in rated(recording, **choice).items()}
        return {q: grade for q, grade in grades.items() if grade is not Grade.GOOD}

    assert set(rated(sound)) == set(LABELS) == set(MEANING)
    assert grades(sound) == {}
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
    assert grades(still) == {
        "complete": Grade.POOR,  # no sensor sends one value for long
        "excited": Grade.POOR,
        "consistent": Grade.UNKNOWN,
    }


def test_frozen_samples_are_not_measured_and_are_counted_as_the_finding_says() -> None:
    sound = read(FOLDER / f"{NOISY}.csv")
    speed = sound.speed.copy()
    speed[1050:1061, 1] = speed[1050, 1]
    speed[2500:2600, 1] = speed[2500, 1]  # outside the window
    flawed = replace(sound, speed=speed)
    complete = rated(flawed)["complete"]
    (frozen,) = complete.findings
    assert isinstance(frozen, ValuesFrozen)
    assert (complete.grade, frozen.samples) == (Grade.FAIR, 10)
    assert frozen.windows == (Window(105.0, 106.0),)
    assert complete.value == pytest.approx(1 - frozen.samples / 1001)
    assert sum(f.samples for f in flawed.findings if isinstance(f, ValuesFrozen)) == 10 + 99
    speed[1100:1200, 1] = speed[1100, 1]
    assert rated(replace(sound, speed=speed))["complete"].grade is Grade.POOR
    gap = sound.gap.copy()
    gap[1055:1070] = np.nan
    both = rated(replace(flawed, gap=gap), allow_missing=True)["complete"]
    assert both.value == pytest.approx(1 - len({*range(1051, 1061), *range(1055, 1070)}) / 1001)


def test_each_answer_has_the_number_that_it_counts(astazero: Recording) -> None:
    segment = cut(astazero, 320.0, 300.0)
    quality = assess_quality(segment)
    ratings = {rating.question: rating for rating in rate(segment, astazero, quality)}
    complete = ratings["complete"]
    assert complete.grade is Grade.FAIR, "values of three cars are frozen at times"
    assert 0.97 < complete.value < 0.99
    assert ratings["excited"].value == max(quality.condition)
    assert ratings["following"].value == min(quality.car_following)
    assert 0.8 < ratings["consistent"].value <= 1.0


def test_a_gap_that_contradicts_the_speeds(openacc_dir: Path) -> None:
    recording = read(openacc_dir / "Vicolungo/JRC-VC_260219_part3.csv")
    for vehicles, grade in (((1, 2, 3, 4), Grade.GOOD), ((4, 5), Grade.POOR)):
        segment = cut(recording, 0.0, 100.0, vehicles)
        *_, consistent = rate(segment, recording, assess_quality(segment))
        assert consistent.grade is grade


PLATOON = Parameters([0.08, 0.11], [0.12, 0.30], [1.5, 1.2])
ANOTHER = Parameters([0.3, 0.3], [0.0, 0.0], [2.5, 2.5])
"""What both followers obey within `BLOCK`."""
BLOCK = (60.0, 100.0)
"""When, in s; what is excluded is two seconds wider, so that no derivative reaches inside."""
MARGIN = 2.0


@cache
def disturbed(parameters: Parameters = PLATOON) -> Segment:
    """Without noise; within `BLOCK` both followers obey other parameters. Nothing is excluded."""
    own, (begin, end) = parameters.values, BLOCK
    return in_turn((own, begin), (ANOTHER.values, end - begin), (own, 180.0 - end))


def without_block(segment: Segment) -> Segment:
    begin, end = BLOCK
    outside = (segment.time < begin - MARGIN) | (segment.time > end + MARGIN)
    mask = np.repeat(outside[:, None], segment.followers, axis=1)
    return replace(segment, mask=mask, excluded_regimes=("catching up",))


LEARNERS = {**ESTIMATORS, "pinn": partial(train, config=replace(FAST, iterations=150), threads=1)}


class TestMethods:
    @pytest.mark.parametrize(
        ("name", "case"), [*product(LEARNERS, ["II"]), ("least-squares", "I"), ("simulation", "I")]
    )
    def test_every_method_learns_from_the_rest_alone(self, name: str, case: Case) -> None:
        truth = PLATOON[[1, 1]] if case == "I" else PLATOON
        estimated = LEARNERS[name](without_block(disturbed(truth)), case).parameters
        # The particle filter's error is a matter of its 4000 particles.
        tolerance = 0.15 if name == "particle" else 0.03
        np.testing.assert_allclose(estimated.values, truth.values, rtol=tolerance)

    def test_intervals_rest_on_the_rest_alone(self) -> None:
        segment = without_block(disturbed())
        centre = likeliest(segment)
        assert centre.values == pytest.approx(PLATOON.values, rel=1e-3)


def test_a_mask_goes_with_a_part_and_into_the_description() -> None:
    segment = without_block(disturbed())
    assert np.array_equal(segment.part(500, 1200).mask, segment.mask[500:1200])
    assert segment.info.excluded_regimes == ("catching up",)
    assert segment.info.excluded_share == pytest.approx((441 / 1801,) * 2)
    assert disturbed().info.excluded_share == ()


@pytest.fixture
def recording() -> Recording:
    """Two vehicles over 60 s: 2 s by hand, 3 s still, 20 s far behind, the rest in ACC close by."""
    time = STEP * np.arange(601)
    columns = {"Time": time, "Speed1": 20 + np.sin(time), "Speed2": np.full(601, 20.0)}
    columns["IVS1"] = np.where((time > 9.95) & (time < 29.95), 60.0, 39.0)
    columns["Speed2"][(time > 39.95) & (time < 42.95)] = 1.0
    mode = np.full((601, 2), Mode.ACC, np.int8)
    mode[(time > 37.95) & (time < 39.95), 1] = Mode.HUMAN
    return replace(openacc_files.recording(pd.DataFrame(columns), "AB"), mode=mode)


class TestLabels:
    def test_each_instant_has_the_regime_it_was_made_for(self, recording: Recording) -> None:
        codes = label_regimes(cut(recording, 0, 60), recording).codes[:, 0]
        counts = [int((codes == code).sum()) for code in range(4)]
        assert counts == [351, 200, 20, 30]
        assert set(codes[100:300]) == {CATCHING_UP}
        assert set(codes[380:400]) == {MANUAL}
        assert set(codes[400:430]) == {STANDSTILL}
        regimes = label_regimes(cut(recording, 0, 60), recording)
        assert regimes.shares[0] == pytest.approx([count / 601 for count in counts])

    def test_a_driver_comes_first_and_a_window_is_mapped_to_its_samples(
        self, recording: Recording
    ) -> None:
        by_hand = replace(recording, mode=np.full((601, 2), Mode.HUMAN, np.int8))
        assert set(label_regimes(cut(by_hand, 0, 60), by_hand).codes.ravel()) == {MANUAL}
        codes = label_regimes(cut(recording, 35.3, 20), recording).codes[:, 0]
        assert np.flatnonzero(codes == MANUAL).tolist() == list(range(27, 47))

    def test_an_interpolated_instant_is_manual_if_either_of_its_samples_is(
        self, recording: Recording
    ) -> None:
        uneven = replace(recording, time=np.r_[0.0, recording.time[1:] + 0.04])
        codes = label_regimes(cut(uneven, 0, 60), uneven).codes[:, 0]
        # Samples 380 to 399 stand at 38.04 to 39.94 s now, next to the instants 38.0 and 40.0 s.
        assert np.flatnonzero(codes == MANUAL).tolist() == list(range(380, 401))

    def test_unknown_modes_are_known_to_be_and_another_recording_is_refused(
        self, recording: Recording
    ) -> None:
        silent = replace(recording, mode=np.full((601, 2), Mode.UNKNOWN, np.int8))
        segment = cut(silent, 0, 60)
        for source in (silent, None):
            regimes = label_regimes(segment, source)
            assert regimes.mode_known == (False,)
            assert MANUAL not in regimes.codes
        assert label_regimes(segment, recording).mode_known == (True,)
        with pytest.raises(SegmentError, match="not the recording"):
            label_regimes(segment, replace(recording, sha256="other"))


class TestExcluding:
    def test_is_a_finding(self, recording: Recording) -> None:
        segment = cut(recording, 0, 60)
        regimes = label_regimes(segment, recording)
        chosen = exclude_regimes(segment, regimes, ["standstill", "catching up"])
        assert chosen.excluded_regimes == ("catching up", "standstill")
        assert chosen.findings[-1] == RegimesExcluded(
            regimes=chosen.excluded_regimes, vehicles=(2,), shares=chosen.info.excluded_share
        )
        expected = np.isin(regimes.codes, [FOLLOWING, MANUAL])
        assert np.array_equal(chosen.mask, expected)
        assert np.array_equal(chosen.gaps, segment.gaps)

    def test_no_estimate_is_said_to_rest_on_a_driver_who_is_left_out(
        self, recording: Recording
    ) -> None:
        mode = recording.mode.copy()
        mode[300:400, 1] = Mode.HUMAN
        segment = cut(run := replace(recording, mode=mode), 0, 60)
        regimes = label_regimes(segment, run)
        assert segment.driven_by_hand
        for names, is_said in ((["manual"], False), (["catching up"], True)):
            chosen = exclude_regimes(segment, regimes, names)
            assert any("a driver" in said for said in messages(chosen.findings, chosen)) == is_said
        # A snapshot of an earlier version holds the finding, and verifies all the same.
        tree, arrays = dump(segment.info)
        tree["excluded_regimes"] = ["manual"]
        assert segment.info.driven_by_hand
        assert restore(SegmentInfo, tree, arrays).driven_by_hand is None

    def test_what_does_not_occur_leaves_the_data_as_they_are(self) -> None:
        regimes = Regimes(np.full((1801, 2), FOLLOWING, np.uint8), (True, True))
        asked = exclude_regimes(disturbed(), regimes, ["manual", "catching up"])
        assert asked.findings == (NothingToExclude(regimes=("catching up", "manual")),)
        assert asked.mask is None
        assert exclude_regimes(disturbed(), regimes, ()) is disturbed()
        assert asked.info.digest == disturbed().info.digest

    def test_twice_excludes_both_and_other_names_are_refused(self, recording: Recording) -> None:
        segment = cut(recording, 0, 60)
        regimes = label_regimes(segment, recording)
        both = exclude_regimes(
            exclude_regimes(segment, regimes, ["manual"]), regimes, ["standstill"]
        )
        assert both.excluded_regimes == ("manual", "standstill")
        assert (~both.mask).sum() == 50
        for name in ("car-following", "asleep"):
            with pytest.raises(SegmentError, match=f'"{name}" cannot be excluded; choose from'):
                exclude_regimes(segment, regimes, [name])

    def test_too_little_left_is_refused(self) -> None:
        codes = np.full((1801, 2), FOLLOWING, np.uint8)
        codes[95:, 1] = CATCHING_UP
        with pytest.raises(SegmentError, match=r"only 9\.5 s of 3 Car 3 remain"):
            exclude_regimes(disturbed(), Regimes(codes, (True, True)), ["catching up"])
