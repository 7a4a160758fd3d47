"""Lists that a file can fill are bounded, and whatever it holds it is read within seconds."""

import time
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from accpinn.errors import RecordingError
from accpinn.recordings import files, pairs, trajectories
from accpinn.recordings.files import opened, read_all
from accpinn.recordings.mapping import (
    ByVehicle,
    CsvMapping,
    GapColumn,
    SpeedColumn,
    TimeColumn,
)
from accpinn.recordings.source import read_bytes

LONG = CsvMapping(
    speeds=(SpeedColumn("v", "m/s"),),
    gaps=(GapColumn("g", "m"),),
    time=TimeColumn("t", "s"),
    by=ByVehicle(vehicle="id", leader="lead"),
)
PAIRS = "Trajectory_ID,Time_Index,ID_LV,Speed_LV,ID_FAV,Speed_FAV,Spatial_Gap\n"


def table(head: str, rows: Iterable[str]) -> bytes:
    return (head + "\n".join(rows) + "\n").encode()


def long_table(vehicles: int, samples: int) -> bytes:
    """Vehicles that follow each other, all at the same instants."""
    rows = (f"{k},{n},20,30,{k + 1}" for k in range(vehicles) for n in range(samples))
    return table("id,t,v,g,lead\n", rows)


def pair_table(count: int, samples: int, is_one_vehicle: bool = True) -> bytes:
    """Pairs of speeds that differ."""
    speeds = 20 + np.cumsum(np.random.default_rng(1).normal(size=samples)) * 0.05
    ends = [f"{u:.3f},{{}},{v:.3f},30" for u, v in zip(speeds, speeds[::-1], strict=True)]
    ids = [7 if is_one_vehicle else 2 * k for k in range(count)]
    rows = (
        f"t{k},{n / 10},{ids[k]},{end.format(ids[k] + (not is_one_vehicle))}"
        for k in range(count) for n, end in enumerate(ends)
    )  # fmt: skip
    return table(PAIRS, rows)


def test_more_vehicles_than_can_be_listed_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    file = opened(long_table(30, 120), "a.csv", LONG)
    assert len(file.read().vehicles) == 30
    monkeypatch.setattr(files, "MOST_VEHICLES", 29)
    with pytest.raises(RecordingError, match="30 vehicles"):
        file.read()
    assert isinstance(next(read_all(long_table(30, 120), "a.csv", mapping=LONG)), RecordingError)


def test_more_vehicles_of_one_row_than_are_read_are_refused_at_once() -> None:
    rows = long_table(trajectories.MOST_VEHICLES + 1, 1)
    started = time.process_time()
    with pytest.raises(RecordingError, match="vehicles"):
        _ = opened(rows, "a.csv", LONG).runs
    assert time.process_time() - started < 1.0


@pytest.mark.parametrize("name", ["MOST_STRETCHES", "MOST_MET", "MOST_RUNS"])
def test_more_stretches_than_are_read_are_refused(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    rows = long_table(4, 200)
    assert len(opened(rows, "a.csv", LONG).runs) == 1
    monkeypatch.setattr(trajectories, name, 0)
    with pytest.raises(RecordingError):
        _ = opened(rows, "a.csv", LONG).runs


def test_more_pairs_than_can_be_listed_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pairs, "MOST_RUNS", 90)
    with pytest.raises(RecordingError, match="change between trajectories"):
        _ = opened(pair_table(91, 11, False), "a.csv").runs
    assert len(opened(pair_table(90, 11, False), "a.csv").trajectories) == 90


def test_the_comparison_of_pairs_is_bounded_by_their_samples(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows = pair_table(10, 500)
    assert len(opened(rows, "a.csv").runs) == 10
    monkeypatch.setattr(pairs, "MOST_SAMPLES_COMPARED", 99_000)  # ten times ten times a thousand
    with pytest.raises(RecordingError, match="split the file"):
        _ = opened(rows, "a.csv").runs


def test_a_control_character_at_the_end_is_found_at_once() -> None:
    text = b"Time,Speed1,Speed2,IVS1\n" + b"1.0,20.1,20.1,30.1\n" * 200_000
    started = time.process_time()
    with pytest.raises(RecordingError, match="row 200002"):
        read_bytes(text + b"1\x01\n", "a.csv")
    assert time.process_time() - started < 0.5


def test_the_memory_of_a_file_with_runs_is_counted() -> None:
    content = pair_table(20, 100, False)
    file = opened(content, "a.csv")
    before = file.nbytes
    assert before == len(content)
    assert len(file.trajectories) == 20
    assert file.nbytes - before > 2_000 * 5 * 8, "the columns of all its rows"
    assert replace(file).nbytes == before
