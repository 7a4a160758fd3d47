"""Which windows a batch takes: complete stretches in car-following under ACC."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from accpinn.methods.registry import METHODS
from accpinn.recordings.recording import Recording
from accpinn.study.plan import INTERVALS_SECONDS, READ, START, estimate_batch, plan
from tests.support.openacc_files import csv, metadata, platoon, recording


def following(samples: int = 4000, vehicles: int = 3) -> pd.DataFrame:
    return platoon(vehicles, samples)


def windows(found: Recording, longest: float = 150.0) -> list[tuple[tuple[int, ...], float, float]]:
    return [(one.vehicles, one.window.start, one.window.end) for one in plan(found, longest)]


def test_a_complete_recording_is_cut_from_its_start() -> None:
    found = recording(following())
    assert windows(found) == [((1, 2, 3), 0, 150), ((1, 2, 3), 150, 300), ((1, 2, 3), 300, 399.9)]
    assert windows(found, np.inf) == [((1, 2, 3), 0, 399.9)]
    assert {one.modes for one in plan(found, 150)} == {("ACC by flag",) * 2}
    # The rest of 49.9 s is too short to say anything.
    assert windows(found, 350.0) == [((1, 2, 3), 0, 350)]


def test_a_recording_by_hand_has_no_window() -> None:
    assert plan(recording(following(), acc="0"), 300) == ()
    frame = following().assign(Driver2="Human", Driver3="Human")
    assert plan(recording(frame), 300) == ()


def test_manual_driving_and_missing_samples_end_a_stretch() -> None:
    frame = following().assign(Driver2="ACC", Driver3="ACC")
    frame.loc[1500:1510, "Driver2"] = "Human"
    frame.loc[2500:2600, "Speed3"] = np.nan
    found = recording(frame)
    assert windows(found, np.inf) == [
        ((1, 2, 3), 0, 149.9),
        ((1, 2, 3), 151.1, 249.9),
        ((1, 2, 3), 260.1, 399.9),
    ]
    assert {one.modes for one in plan(found, 300)} == {("ACC", "ACC")}


def test_a_follower_keeps_alone_what_the_others_interrupt() -> None:
    frame = following().assign(Driver2="ACC", Driver3="ACC")
    frame.loc[1000:, "Driver3"] = "Human"
    assert windows(recording(frame), np.inf) == [((1, 2, 3), 0, 99.9), ((1, 2), 100, 399.9)]


@pytest.mark.parametrize(("seconds", "count"), [(8, 1), (40, 2)])
def test_only_long_departures_from_car_following_interrupt(seconds: int, count: int) -> None:
    frame = following(vehicles=2)
    first = 2000
    frame.loc[first : first + 10 * seconds, "IVS1"] += 60
    assert len(windows(recording(frame, "AB"), np.inf)) == count


def test_a_long_distance_setting_is_car_following() -> None:
    frame = following(vehicles=2)
    frame["IVS1"] += 22
    assert (frame["IVS1"] / frame["Speed2"]).median() > 2
    assert windows(recording(frame, "AB"), np.inf) == [((1, 2), 0, 399.9)]
    frame["IVS1"] += 60
    assert windows(recording(frame, "AB"), np.inf) == []


def test_a_long_chain_is_taken_in_parts() -> None:
    found = recording(following(1000, 14), "ABCDEFGHIJKLMN")
    assert [one.vehicles for one in plan(found, 300)] == [tuple(range(1, 12)), (11, 12, 13, 14)]


def test_no_follower_is_in_two_windows_at_once() -> None:
    rng = np.random.default_rng(3)
    frame = following(6000, 4)
    for number in (2, 3, 4):
        hand = np.repeat(rng.random(12) < 0.3, 500)
        frame[f"Driver{number}"] = np.where(hand, "Human", "ACC")
    found = recording(frame, "ABCD")
    taken = np.zeros((found.samples, 5), int)
    for one in plan(found, 120):
        inside = (found.time > one.window.start) & (found.time < one.window.end)
        taken[np.ix_(inside, list(one.vehicles[1:]))] += 1
    assert taken.max() == 1
    for number in (2, 3, 4):
        assert not taken[found.mode[:, number - 1] == 0, number].any()


def test_files_alike_count_as_those_that_are_read(tmp_path: Path) -> None:
    (tmp_path / "broken.csv").write_bytes(b"Date,1,1,2020\n\0")
    raw = csv(platoon(3, 1300), metadata())
    for k in range(2 * READ):
        (tmp_path / f"run{k}.csv").write_bytes(raw)
        if k == 1:
            few = estimate_batch(tmp_path, 60.0)
            assert (few.files, few.windows, few.followers, few.exact) == (3, 4, 8, True)
            assert few.size == pytest.approx(4 * 60 / 300 * 1.35), "a further follower takes less"
    estimate = estimate_batch(tmp_path, 60.0)
    assert not estimate.exact
    assert estimate.windows == pytest.approx(2 * READ * 2, rel=1e-3)
    a_window = METHODS["splines"].typical_seconds + INTERVALS_SECONDS
    alone, two = (estimate.seconds(["splines"], workers) - START for workers in (1, 2))
    assert alone == pytest.approx(2 * two) == pytest.approx(a_window / 3 * estimate.size)
