"""The ratings of a window: each answer from data that deserve it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Mode, Recording
from accpinn.results.messages.window import MEANING, WORDS, rating_label, rating_reasons
from accpinn.segment.cut import cut
from accpinn.segment.quality import Grade, Question, Rating, assess_quality, rate
from tests.support.samples import FOLDER, NOISY


def rated(recording: Recording, **choice: object) -> dict[Question, Rating]:
    segment = cut(recording, 100.0, 100.0, (1, 2), **choice)
    found = rate(segment, recording, assess_quality(segment))
    for one in found:  # each has its words
        assert rating_label(one)
        assert all(rating_reasons(one, segment))
    return {one.question: one for one in found}


@pytest.fixture
def sound() -> Recording:
    return read(FOLDER / f"{NOISY}.csv")


def test_sound_data_are_good_throughout(sound: Recording) -> None:
    assert {one.grade for one in rated(sound).values()} == {Grade.GOOD}
    assert rated(sound)["consistent"].values == pytest.approx((1.0,), abs=0.1)
    assert set(rated(sound)) == set(WORDS) == set(MEANING)


def test_each_fault_lowers_the_grade_of_its_own_question_alone(sound: Recording) -> None:
    def grades(recording: Recording, **choice: object) -> dict[Question, Grade]:
        found = rated(recording, **choice)
        return {q: one.grade for q, one in found.items() if one.grade is not Grade.GOOD}

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
        found = {one.question: one for one in rate(segment, recording, assess_quality(segment))}
        assert found["consistent"].grade is grade
