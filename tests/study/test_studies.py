"""The file of a study: nothing is lost, one order, and what is no study ends in one sentence."""

import os
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from accpinn.errors import ConfigError, RecordingError
from accpinn.study.groups import read_study
from accpinn.study.studies import (
    FAILURES,
    FILE,
    RESULTS,
    Failure,
    KnownFile,
    Study,
    read_failures,
    read_request,
    read_rows,
    state_of,
    studies,
    study_path,
)
from tests.support.studies import REQUEST, analysis, row, write_study

BROKEN = Failure("x.csv", None, None, "broken")


def test_rows_and_failures_can_be_read_while_a_batch_runs(tmp_path: Path) -> None:
    with Study(tmp_path, REQUEST) as study:
        states = [state_of(tmp_path)]
        study.add_rows(analysis(), "a.csv", [row("A", alpha=0.3)])
        states.append(state_of(tmp_path))
        study.add_failure(analysis(60.0), replace(BROKEN, start=60.0), is_final=True)
        [kept] = read_rows(tmp_path)
        assert (kept["alpha"], kept["make"], kept["file"]) == (0.3, "A", None)
        assert read_failures(tmp_path) == (replace(BROKEN, start=60.0),)
        known = [study.rows_of(analysis(start)) for start in (0.0, 60.0, 120.0)]
        assert known == [1, 0, None]
        study.add_rows(analysis(60.0), "a.csv", [row("A")])
        assert study.rows_of(analysis(60.0)) == 1
        assert read_failures(tmp_path) == ()
        assert len({*states, state_of(tmp_path)}) == 3
        with pytest.raises(RecordingError, match="another batch is writing"):
            Study(tmp_path, REQUEST)
    assert [path.name for path in tmp_path.glob(f"{FILE}*")] == [FILE], "one plain file is left"


def test_an_answer_by_another_version_of_the_method_takes_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Study(tmp_path, REQUEST) as study:
        study.add_rows(analysis(), "a.csv", [row("A")])
        other = analysis()
        monkeypatch.setitem(vars(other), "key", "another")
        assert study.rows_of(other) is None
        study.add_rows(other, "a.csv", [row("B")])
    assert [cells["make"] for cells in read_rows(tmp_path)] == ["B"]


def test_rows_have_one_order_whatever_ended_first(tmp_path: Path) -> None:
    places = [(start, file, method) for file in ("a", "b") for start in (0.0, 60.0, 300.0)
              for method in ("least-squares", "splines")]  # fmt: skip
    contents: list[Any] = []
    for seed in (0, 1):
        folder = tmp_path / str(seed)
        with Study(folder, REQUEST) as study:
            for k in np.random.default_rng(seed).permutation(len(places)).tolist():
                start, file, method = places[k]
                cells = row("A", file=file, start=start, method=method)
                study.add_rows(analysis(*places[k]), file, [cells])
                failure = Failure(file, start, None, method)
                study.add_failure(replace(analysis(*places[k]), case="I"), failure, True)
        contents.append([(folder / name).read_bytes() for name in (FAILURES, RESULTS)])
        order = [(cells["start"], cells["file"], cells["method"]) for cells in read_rows(folder)]
        assert order == places
    assert contents[0] == contents[1]


def test_failures_of_a_file_last_until_it_is_read_again(tmp_path: Path) -> None:
    known = KnownFile("", 1, 1, (analysis(),))
    with Study(tmp_path, REQUEST) as study:
        study.refuse(Path("runs/x.csv"), ["broken", "broken, too"])
        study.refuse(Path("runs/y.csv"), ["broken"])
        study.refuse(Path("runs/x.csv"), ["no window"])
        study.add_file("bytes", known)
        assert study.known_file("bytes") == known
        assert study.known_file("others") is None
    assert [(f.file, f.reason) for f in read_failures(tmp_path)] == [
        ("x.csv", "no window"), ("y.csv", "broken"),
    ]  # fmt: skip


def test_a_request_is_found_again_and_window_and_case_stay(tmp_path: Path) -> None:
    finished = replace(REQUEST, is_finished=True)
    with Study(tmp_path, REQUEST) as study:
        assert read_request(tmp_path) == REQUEST
        study.note(finished)
    assert read_request(tmp_path) == finished
    with pytest.raises(ConfigError, match="holds a batch with window 300, Case II"):
        Study(tmp_path, replace(REQUEST, case="I"))
    with Study(tmp_path, REQUEST):
        pass


def spoilt(folder: Path, statement: str) -> Path:
    write_study(folder, row("A"))
    with closing(sqlite3.connect(folder / FILE)) as database, database:
        database.execute(statement)
    return folder


def test_what_is_no_study_ends_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no batch is there"):
        read_study(tmp_path)
    for k, statement in enumerate(
        (
            "drop table results",
            "update results set rows = 'no JSON'",
            "update results set rows = '[{\"alpha\": 1e300}]'",
            "update results set rows = x'ff'",
            "update results set rows = 1.5",
        )
    ):
        folder = spoilt(tmp_path / str(k), statement)
        with pytest.raises(RecordingError, match=r"is damaged; take another folder"):
            read_study(folder)
    torn = write_study(tmp_path / "torn", row("A"))
    (torn / FILE).write_bytes((torn / FILE).read_bytes()[:5000])
    with pytest.raises(RecordingError, match="is damaged"):
        read_study(torn)
    later = spoilt(tmp_path / "later", "pragma user_version = 99")
    for use in (read_study, lambda folder: Study(folder, REQUEST)):
        with pytest.raises(RecordingError, match="another version of accpinn"):
            use(later)


@pytest.mark.parametrize(
    "name", ["", ".", "..", "../x", "a/b", "/etc", "a\\b", ".hidden", "x ", "x" * 61, "a\n", "out"]
)
def test_what_leads_out_of_the_folder_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "studies").mkdir()
    write_study(tmp_path / "elsewhere", row("A"))
    (tmp_path / "studies" / "out").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ConfigError, match="is no name"):
        study_path(name, tmp_path / "studies")
    assert studies(tmp_path / "studies") == ()


def test_studies_are_listed_the_latest_first(tmp_path: Path) -> None:
    assert studies(tmp_path / "none") == ()
    for age, name in enumerate(("Meine Läufe (2)", "old")):
        file = write_study(tmp_path / name, row("A")) / FILE
        os.utime(file, (1e9 - age, 1e9 - age))
    (tmp_path / "no study").mkdir()
    assert studies(tmp_path) == ("Meine Läufe (2)", "old")
