"""Tables of leader-follower pairs: joined into platoons, and the same as OpenACC's own files."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import accpinn
from accpinn.errors import RecordingError
from accpinn.recordings.files import opened, read, read_all
from accpinn.recordings.recording import Mode, Recording
from accpinn.segment.cut import cut
from tests.support.openacc_files import csv, pair, platoon, table


def recordings(raw: bytes) -> list[Recording]:
    found = list(read_all(raw, "pairs.csv"))
    assert all(isinstance(one, Recording) for one in found)
    return [one for one in found if isinstance(one, Recording)]


def test_pairs_of_a_platoon_are_the_platoon() -> None:
    frame = platoon(4, 600)
    original = read(csv(frame), "run.csv")
    raw = table(pair(frame, 3, "c"), pair(frame, 1, "a"), pair(frame, 2, "b"))
    for chosen in (None, "a", "b", "c"):
        found = read(raw, "pairs.csv", trajectory=chosen)
        np.testing.assert_array_equal(found.speed, original.speed)
        np.testing.assert_array_equal(found.gap, original.gap)
        np.testing.assert_allclose(found.time, original.time, atol=1e-9)
    assert [vehicle.name for vehicle in found.vehicles] == ["ID 101", "ID 102", "ID 103", "ID 104"]
    assert (found.mode[0] == [Mode.HUMAN, Mode.ACC, Mode.ACC, Mode.ACC]).all()


def test_pairs_that_begin_at_different_times_are_shifted() -> None:
    frame = platoon(4, 900)
    frame += np.random.default_rng(0).normal(0, 0.3, frame.shape).cumsum(axis=0) * 0.1
    raw = table(pair(frame, 1, "a", 150, 700), pair(frame, 2, "b", 0, 600), pair(frame, 3, "c", 90))
    [found] = recordings(raw)
    for number, (first, last) in {1: (150, 700), 2: (0, 700), 3: (0, 900), 4: (90, 900)}.items():
        known = np.zeros(900, bool)
        known[first:last] = True
        np.testing.assert_array_equal(np.isfinite(found.speed_of(number)), known)
        column = frame[f"Speed{number}"].to_numpy()[known]
        np.testing.assert_array_equal(found.speed_of(number)[known], column)
    assert found.time[-1] == pytest.approx(89.9)
    assert found.samples == 900


def test_equal_identifiers_at_another_time_are_no_platoon() -> None:
    frame, later = platoon(3, 600), platoon(3, 600)
    later["Speed2"] += 1.5 * np.sin(0.11 * later["Time"])
    raw = table(pair(frame, 1, "a"), pair(later, 2, "b"))
    found = recordings(raw)
    assert [one.trajectory for one in found] == ["a", "b"]
    assert all(one.speed.shape == (600, 2) for one in found)
    assert len({one.sha256 for one in found}) == 2
    with pytest.raises(RecordingError, match=r"holds 2 platoons; .*--trajectory.*: a, b\."):
        read(raw, "pairs.csv")
    with pytest.raises(RecordingError, match='no trajectory "z"'):
        read(raw, "pairs.csv", trajectory="z")
    assert opened(raw, "pairs.csv").trajectories == (("a", 2), ("b", 2))
    assert opened(table(pair(frame, 1, "a"), pair(frame, 2, "b")), "pairs.csv").trajectories == ()
    assert not opened(raw, "pairs.csv").is_unknown


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f.assign(Speed_LV=["x", *f["Speed_LV"][1:]]), 'row 2, column Speed_LV: "x"'),
        (lambda f: f.assign(Speed_FAV=300.0), "row 2, column Speed_FAV: 300 cannot"),
        (lambda f: f.assign(Spatial_Gap=np.nan), "column Spatial_Gap: all cells are empty"),
        (lambda f: f.assign(Time_Index=0.0), "row 3, column Time_Index: the time does not"),
        (lambda f: pd.concat([f, f.assign(ID_LV=7), f]), "continues here"),
        (lambda f: f.iloc[:5], "only 5 rows"),
        (lambda f: f.assign(Time_Index=[*f["Time_Index"][:-1], np.inf]), "inf cannot"),
    ],
)
def test_a_faulty_table_is_refused_with_its_place(change: object, words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        read(table(change(pair(platoon(2, 50), 1, "a"))), "pairs.csv")


def test_hostile_tables_are_refused_before_they_take_long() -> None:
    """A circle, speeds beyond all bounds in joined pairs, one vehicle everywhere, a run a row."""
    frame = platoon(samples=200)
    back = pair(frame, 1, "b").assign(ID_LV=102, ID_FAV=101)
    back["Speed_LV"], back["Speed_FAV"] = back["Speed_FAV"], back["Speed_LV"]
    assert len(recordings(table(pair(frame, 1, "a"), back))) == 1
    huge = pd.concat([pair(frame, 1, "a"), pair(frame, 2, "b").assign(Speed_LV=1e300)])
    with pytest.raises(RecordingError, match="cannot be a measurement"):
        read(huge.to_csv(index=False).encode(), "pairs.csv", trajectory="b")
    rows = pair(frame, 1, "a").iloc[:10].assign(ID_LV=1, ID_FAV=1)
    alike = table(*(rows.assign(Trajectory_ID=f"t{k}") for k in range(120)))
    with pytest.raises(RecordingError, match="14,400 may be one's"):
        read(alike, "pairs.csv")
    mixed = table(*(rows.iloc[:1].assign(Trajectory_ID=f"t{k}") for k in range(1100)))
    with pytest.raises(RecordingError, match="sort the rows"):
        read(mixed, "pairs.csv")


@pytest.fixture(scope="module")
def ultra_av(openacc_dir: Path) -> Path:
    folder = Path(os.environ.get("ULTRA_AV_DIR", "") or openacc_dir.parent / "ultra_av")
    if not folder.is_dir():
        pytest.skip("ULTRA_AV_DIR does not name a folder with tables of ULTra-AV")
    return folder


def test_a_table_and_openacc_file_of_one_run_are_the_same_data(
    ultra_av: Path, openacc_dir: Path
) -> None:
    one = read(ultra_av / "step1_Casale_8.csv")
    other = read(openacc_dir / "Casale" / "part8.csv")
    assert one.campaign == other.campaign == "Casale"
    segments = [cut(recording, 0, 100) for recording in (one, other)]
    assert segments[0].info.digest == segments[1].info.digest
    for method in ("least-squares", "maximum-likelihood"):
        fits = [accpinn.fit(source, duration=100, method=method) for source in (one, other)]
        np.testing.assert_allclose(*(f.parameters.values for f in fits), rtol=0, atol=1e-9)
