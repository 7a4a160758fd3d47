"""Batches: which windows they take, every one once, and what is known is not done again."""

import errno
import json
import os
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec
import numpy as np
import pandas as pd
import pytest
from distributed import Client, LocalCluster

from accpinn.cli import main
from accpinn.errors import AccpinnError, ConfigError, RecordingError
from accpinn.methods.registry import METHODS
from accpinn.recordings import Recording
from accpinn.recordings.containers import LIMIT_BYTES
from accpinn.recordings.mapping import CsvMapping, GapColumn, SpeedColumn, TimeColumn
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.segment.windows import plan
from accpinn.study import batch as batches
from accpinn.study import cluster as clusters
from accpinn.study.batch import batch
from accpinn.study.plan import INTERVALS_SECONDS, READ, START, estimate_batch
from accpinn.study.rows import COLUMNS
from accpinn.study.studies import FILE, Request, read_failures, read_request
from accpinn.tasks import Status, TaskQueue
from accpinn.tasks.batches import batch_task
from tests.support.command import ROOT, Capture, document
from tests.support.dying import DEATHS, dying
from tests.support.openacc_files import csv, metadata, platoon, recording

METHODS_USED = ("least-squares", "savitzky-golay")
NAMES = ("Audi(A8)", "Nobody", "Tesla(Model3)")


def frame(seed: int, samples: int = 1400) -> pd.DataFrame:
    """A platoon whose speeds differ from file to file."""
    found = platoon(3, samples)
    return found + 0.01 * np.random.default_rng(seed).normal(size=(samples, 1)) * [0, 1, 1, 1, 1, 1]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two sound recordings, a damaged one, one by hand, and a copy."""
    place = tmp_path / "runs"
    (place / "below").mkdir(parents=True)
    for k, below in ((1, ""), (2, "below")):
        rows = metadata(NAMES, distance=("min", "max")[k - 1])
        (place / below / f"run{k}.csv").write_bytes(csv(frame(k), rows))
    (place / "copy.csv").write_bytes((place / "run1.csv").read_bytes())
    (place / "broken.csv").write_bytes(b"Date,1,1,2020\n\0\0\0")
    (place / "hand.csv").write_bytes(csv(frame(3), metadata(NAMES, acc="0")))
    return place


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Where a batch keeps what it finds."""
    return tmp_path / "study"


def table(study: Path) -> pd.DataFrame:
    return pd.read_parquet(study / "results.parquet")


def unique(rows: pd.DataFrame) -> bool:
    return not rows.duplicated(["sha256", "start", "vehicle", "method"]).any()


def test_every_window_is_a_row_and_the_rest_a_failure(
    capsys: Capture, cluster: str, folder: Path, study: Path
) -> None:
    options: dict[str, Any] = {"window": 70, "case": "II", "scheduler": cluster}
    found = batch(folder, study, methods=METHODS_USED, **options)
    assert (found.recordings, found.refused, found.windows, found.followers) == (3, 2, 4, 8)
    assert (found.rows, found.failed, found.reused, found.stopped) == (16, 0, 0, False)
    assert found.unknown_names == ("Nobody",)
    rows = table(study)
    assert list(rows.columns) == [column.name for column in COLUMNS]
    assert len(rows) == 16
    assert unique(rows)
    described = json.loads((study / "schema.json").read_text())["columns"]
    assert [one["name"] for one in described] == list(rows.columns)
    assert all(one["meaning"] for one in described)
    reasons = pd.read_csv(study / "failures.csv").set_index("file")["reason"]
    assert set(reasons.index) == {"broken.csv", "hand.csv", "run1.csv"}
    assert "no complete stretch" in reasons["hand.csv"]
    # A row is what its method says of the window.
    row = rows[(rows.file == "run2.csv") & (rows.start == 70) & (rows.vehicle == 3)].iloc[0]
    segment = cut(read(folder / "below" / "run2.csv"), 70, 69.9)
    fit = METHODS[row.method].fit(segment)
    np.testing.assert_allclose(row[["alpha", "beta", "tau"]].astype(float),
                               fit.parameters.values[1], rtol=1e-12)  # fmt: skip
    assert np.isnan([row.tau_low, row.tau_high, row.p_l2_stable, row.level]).all(), "a point"
    assert (row.make, row.model, row.distance_setting) == ("Tesla", "Model 3", "max")
    assert (row["mode"], row.mode_source, row.date) == ("ACC", "flag", "2019-02-26")
    # Again, with a further method, without a file and with the damaged one mended.
    (folder / "broken.csv").write_bytes(csv(frame(4), metadata(NAMES)))
    again = batch(folder, study, methods=(*METHODS_USED, "splines"), **options)
    assert (again.recordings, again.refused, again.reused, again.rows) == (4, 1, 16, 36)
    assert unique(table(study))
    assert "broken.csv" not in set(pd.read_csv(study / "failures.csv")["file"])
    # By the command, which says so in words.
    methods = ("--methods", ",".join(METHODS_USED), "--window", "70", "--scheduler", cluster)
    assert main(["batch", str(folder), "--out", str(study), *methods]) == 0
    shown = capsys.readouterr().out
    assert "24 of them known before" in shown
    assert "1 file could not be read" in shown


@pytest.mark.skipif(sys.platform != "linux", reason="names of other systems are text")
def test_what_is_left_out_is_named_and_the_rest_goes_on(
    folder: Path, study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for path in (*folder.glob("run*"), *folder.glob("below/*"), *folder.glob("copy*")):
        path.unlink()
    Path(os.fsdecode(bytes(folder) + b"/odd\xff.csv")).write_bytes(csv(frame(1)))
    (tmp_path / "outside.csv").write_bytes(csv(frame(2)))
    (folder / "link.csv").symlink_to(tmp_path / "outside.csv")
    (folder / "inside.csv").symlink_to(folder / "hand.csv")
    (folder / "secret").mkdir()
    with (folder / "huge.csv").open("wb") as file:
        file.truncate(LIMIT_BYTES + 1)
    monkeypatch.setattr(Path, "read_bytes", bounded(Path.read_bytes))
    monkeypatch.setattr(os, "scandir", forbidding(os.scandir, "secret"))
    found = batch(folder, study, methods=METHODS_USED)
    reasons = {failure.file: failure.reason for failure in read_failures(study)}
    assert reasons.keys() == {
        "odd\ufffd.csv", "link.csv", "secret", "huge.csv", "broken.csv", "hand.csv", "inside.csv"
    }  # fmt: skip
    assert found.refused == 6
    assert "UTF-8" in reasons["odd\ufffd.csv"]
    assert "link" in reasons["link.csv"]
    assert "denied" in reasons["secret"]
    assert "limit" in reasons["huge.csv"]


def bounded(read_bytes: Callable[[Path], bytes]) -> Callable[[Path], bytes]:
    """Reads no file that is too large."""

    def read(path: Path) -> bytes:
        assert path.stat().st_size <= LIMIT_BYTES
        return read_bytes(path)

    return read


def forbidding(scandir: Callable[[Any], Any], name: str) -> Callable[[Any], Any]:
    """Lists all folders but one."""

    def scan(path: Any) -> Any:
        if os.path.basename(path) == name:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return scandir(path)

    return scan


def test_other_contents_under_a_name_are_told(cluster: str, folder: Path, study: Path) -> None:
    options: dict[str, Any] = {"methods": METHODS_USED[:1], "window": 70, "scheduler": cluster}
    first = batch(folder / "run1.csv", study, **options)
    (folder / "run1.csv").write_bytes(csv(frame(7), metadata(NAMES)))
    again = batch(folder / "run1.csv", study, **options)
    assert (first.namesakes, again.namesakes) == ((), ("run1.csv",))
    assert table(study)["sha256"].nunique() == 2


def test_what_is_known_needs_neither_workers_nor_the_files_contents(
    cluster: str, folder: Path, study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uneven = frame(5)
    uneven["Time"] += np.random.default_rng(5).uniform(0, 0.02, len(uneven)).round(4)
    (folder / "run1.csv").write_bytes(csv(uneven, metadata(NAMES)))
    first = batch(folder / "run1.csv", study, methods=METHODS_USED, window=70, scheduler=cluster)
    (folder / "run1.csv").rename(folder / "renamed.csv")
    monkeypatch.setattr(batches, "read_all", None)
    monkeypatch.setattr(batches, "connected", None)
    again = batch(folder / "renamed.csv", study, methods=METHODS_USED, window=70)
    assert (first.reused, again.reused) == (0, first.rows)
    assert (again.windows, again.recordings, again.rows) == (first.windows, 1, first.rows)


def test_results_by_another_mapping_are_not_taken(cluster: str, tmp_path: Path) -> None:
    frame(6).rename(columns={"Time": "t"}).to_csv(tmp_path / "own.csv", index=False)
    speeds = tuple(SpeedColumn(f"Speed{k}") for k in (1, 2))
    mapping = CsvMapping(speeds, (GapColumn("IVS1"),), TimeColumn("t"))
    other = msgspec.structs.replace(mapping, gaps=(GapColumn("IVS1", subtract=5.0),))

    def run(mapping: CsvMapping | None) -> tuple[int, int]:
        options: dict[str, Any] = {"methods": METHODS_USED, "window": 70, "scheduler": cluster}
        found = batch(tmp_path / "own.csv", tmp_path / "study", mapping=mapping, **options)
        return found.rows, found.refused

    assert run(mapping) == run(mapping) == (4, 0)
    assert run(other) == (0, 1)
    assert run(None) == (0, 1), "the proposed mapping has a third vehicle"
    assert len(table(tmp_path / "study")) == 4
    assert set(table(tmp_path / "study")["make"]) == {""}


def test_a_stopped_batch_goes_on(cluster: str, folder: Path, study: Path) -> None:
    seen: list[int] = []
    stopped = batch(
        folder, study, methods=METHODS_USED, window=60, scheduler=cluster,
        on_progress=lambda now: seen.append(now.finished), should_stop=lambda: any(seen),
    )  # fmt: skip
    assert stopped.stopped
    assert 0 < len(table(study)) == stopped.rows < 16
    ended = batch(folder, study, methods=METHODS_USED, window=60, scheduler=cluster)
    assert ended.reused == stopped.rows
    assert len(table(study)) == ended.rows == 4 * 2 * 2
    assert unique(table(study))


def test_workers_that_die_are_replaced_and_none_runs_what_the_server_calls_its_main_module(
    cluster: str, folder: Path, tmp_path: Path, study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, main = tmp_path / "page.py", ModuleType("__main__")
    page.write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()")
    main.__file__ = str(page)
    monkeypatch.setitem(sys.modules, "__main__", main)
    monkeypatch.setenv(DEATHS, str(tmp_path))
    request = Request((str(folder),), METHODS_USED[:1], 200.0, workers=1)
    queue, task = TaskQueue(prepare=lambda: None), batch_task("me", study, request)
    with monkeypatch.context() as patched:
        patched.setattr(batches, "answer_all", dying)
        queue.submit(task)
        assert task.wait(150)
    queue.close()
    assert not (tmp_path / "ran").exists()
    assert (task.status, task.share, task.error) == (Status.DONE, 1.0, "")
    assert (task.latest.rows, task.latest.failed) == (1, 1)
    assert read_request(study) == replace(request, is_finished=True)
    tries = [(tmp_path / name).read_text() for name in ("copy.csv", "run2.csv")]
    assert tries == ["x", "xx"], "another worker tried again"
    [failure] = [one for one in read_failures(study) if one.start == 0]
    assert (failure.file, "every worker died" in failure.reason) == ("run2.csv", True)
    # Tried again the next time, and then no failure any more.
    again = batch(folder, study, methods=METHODS_USED[:1], window=200, scheduler=cluster)
    assert again.failed == 0
    assert not [one for one in read_failures(study) if one.start == 0]


def test_without_workers_it_ends_with_a_word(
    folder: Path, study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def workerless(*_: object) -> Iterator[Client]:
        with LocalCluster(n_workers=0, processes=False, dashboard_address="127.0.0.1:0") as empty:
            with Client(empty, set_as_default=False) as client:
                yield client

    options: dict[str, Any] = {"methods": METHODS_USED[:1], "window": 70, "workers": 1}
    with monkeypatch.context() as patched:
        patched.setattr(batches, "connected", workerless)
        patched.setattr(clusters, "WORKERLESS", 0.1)
        with pytest.raises(RecordingError, match="no others start"):
            batch(folder, study, **options)
    monkeypatch.setattr(clusters, "MODULE", "accpinn.no_such_module")
    with pytest.raises(RecordingError, match="cannot be started"):
        batch(folder, study, **options)


def test_a_killed_batch_loses_nothing_and_repeats_little(
    capsys: Capture, cluster: str, tmp_path: Path, study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = batches.answer_all
    monkeypatch.setattr(batches, "answer_all", lambda job: time.sleep(0.1) or real(job))
    folder = tmp_path / "runs"
    folder.mkdir()
    for k in range(5):
        (folder / f"run{k}.csv").write_bytes(csv(frame(k), metadata(NAMES)))

    def results() -> int:
        if not (study / FILE).exists():
            return 0
        with closing(sqlite3.connect(study / FILE)) as database:
            return int(database.execute("select count(*) from answers").fetchone()[0])

    words = ("batch", folder, "--out", study, "--window", 60, "--methods", "least-squares")
    words += ("--scheduler", cluster)
    with subprocess.Popen([sys.executable, "-m", "accpinn", *map(str, words)], cwd=ROOT) as process:
        while results() < 3 and process.poll() is None:
            time.sleep(0.005)
        process.kill()
    before = results()
    assert before < 10
    found = document(capsys, *words)
    assert found.keys() >= {
        "recordings", "refused", "windows", "followers", "rows", "failed", "reused", "seconds"
    }  # fmt: skip
    assert (found["windows"], found["rows"], found["reused"]) == (10, 20, 2 * before)
    assert len(table(study)) == 20
    assert unique(table(study))


def test_settings_and_sources_that_cannot_be(
    cluster: str, folder: Path, tmp_path: Path, study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = folder / "run1.csv"
    batch(one, study, methods=METHODS_USED[:1], window=200, scheduler=cluster)
    with pytest.raises(ConfigError, match="holds a batch with window 200"):
        batch(one, study, methods=METHODS_USED[:1], window=70)
    (tmp_path / "empty").mkdir()
    for source, options, words in (
        (one, {"window": 5}, "window: 5 s"),
        (one, {"methods": ("magic",)}, "magic is not known"),
        (one, {"workers": 0}, "workers: 0"),
        (tmp_path / "none", {}, "no such file or folder"),
        (tmp_path / "empty", {}, "no CSV file"),
    ):
        with pytest.raises(AccpinnError, match=words):
            batch(source, study, **options)
    inside = folder / "below" / "study"
    batch(folder / "below", inside, methods=METHODS_USED[:1], window=200, scheduler=cluster)
    again = batch(folder / "below", inside, methods=METHODS_USED[:1], window=200)
    assert (again.recordings, again.refused) == (1, 0), "its failures.csv is no recording"
    monkeypatch.setattr(clusters, "CONNECT", 0.3)
    with pytest.raises(RecordingError, match="no scheduler answers"):
        batch(one, tmp_path / "other", scheduler="tcp://127.0.0.1:9")


def windows(found: Recording, longest: float = 150.0) -> list[tuple[tuple[int, ...], float, float]]:
    return [(one.vehicles, one.window.start, one.window.end) for one in plan(found, longest)]


def test_a_complete_recording_is_cut_from_its_start() -> None:
    found = recording(platoon(3, 4000))
    assert windows(found) == [((1, 2, 3), 0, 150), ((1, 2, 3), 150, 300), ((1, 2, 3), 300, 399.9)]
    assert windows(found, np.inf) == [((1, 2, 3), 0, 399.9)]
    assert {one.mode_sources for one in plan(found, 150)} == {("flag",) * 2}
    # The rest of 49.9 s is too short to say anything.
    assert windows(found, 350.0) == [((1, 2, 3), 0, 350)]


THREE = (1, 2, 3)


@pytest.mark.parametrize(
    ("by_hand", "missing", "expected"),
    [
        ({2: slice(None), 3: slice(None)}, [], []),
        ({2: slice(1500, 1510)}, range(2500, 2601),
         [(THREE, 0, 149.9), (THREE, 151.1, 249.9), (THREE, 260.1, 399.9)]),
        ({3: slice(1000, None)}, [], [(THREE, 0, 99.9), ((1, 2), 100, 399.9)]),
    ],
)  # fmt: skip
def test_manual_driving_and_missing_samples_end_a_stretch_of_those_they_concern(
    by_hand: dict[int, slice], missing: Sequence[int], expected: list[Any]
) -> None:
    frame = platoon(3, 4000).assign(Driver2="ACC", Driver3="ACC")
    for vehicle, rows in by_hand.items():
        frame.loc[rows, f"Driver{vehicle}"] = "Human"
    frame.loc[missing, "Speed3"] = np.nan
    found = recording(frame)
    assert windows(found, np.inf) == expected
    sources = {source for one in plan(found, 300) for source in one.mode_sources}
    assert sources == ({"driver"} if expected else set())


@pytest.mark.parametrize(
    ("further", "rows", "count"),
    [(60, slice(2000, 2080), 1), (60, slice(2000, 2400), 2), (22, slice(None), 1),
     (82, slice(None), 0)],
)  # fmt: skip
def test_long_departures_from_car_following_interrupt_and_a_long_setting_does_not(
    further: float, rows: slice, count: int
) -> None:
    frame = platoon(2, 4000)
    index = frame.index[rows]
    away = np.full(len(index), float(further))
    if len(index) < len(frame):  # the leader drives off, and slows down again
        away *= np.sin(np.linspace(0, np.pi, len(index))) ** 2
    frame.loc[index, "Speed1"] += np.gradient(away, 0.1)
    frame.loc[index, "IVS1"] += away
    assert len(windows(recording(frame, "AB"), np.inf)) == count


def test_a_long_chain_is_taken_in_parts() -> None:
    found = recording(platoon(14, 1000), "ABCDEFGHIJKLMN")
    assert [one.vehicles for one in plan(found, 300)] == [tuple(range(1, 12)), (11, 12, 13, 14)]


def test_no_follower_is_in_two_windows_at_once() -> None:
    rng = np.random.default_rng(3)
    frame = platoon(4, 6000)
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
    seconds = {"splines": METHODS["splines"].typical_seconds}
    seconds["simulation"] = METHODS["simulation"].typical_seconds + INTERVALS_SECONDS
    for name, a_window in seconds.items():
        alone, two = (estimate.seconds([name], workers) - START for workers in (1, 2))
        assert alone == pytest.approx(2 * two) == pytest.approx(a_window / 3 * estimate.size)
