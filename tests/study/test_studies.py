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
    Answer,
    Failure,
    KnownFile,
    read_failures,
    read_request,
    read_rows,
    state_of,
    studies,
    study_path,
    written,
)
from tests.support.studies import REQUEST, analysis, row, write_study


def test_answers_can_be_read_while_a_batch_runs_and_a_newer_one_takes_their_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with written(tmp_path, REQUEST) as study:
        states = [state_of(tmp_path)]
        study.add("a.csv", Answer(analysis(), [row("A", alpha=0.3)]))
        states.append(state_of(tmp_path))
        study.add("a.csv", Answer(analysis(60.0), reason="broken"))
        study.add("a.csv", Answer(analysis(120.0), reason="a worker died", is_final=False))
        [kept] = read_rows(tmp_path)
        assert (kept["alpha"], kept["make"], kept["file"]) == (0.3, "A", None)
        failure = Failure("a.csv", 60.0, 2, "least-squares: broken")
        assert read_failures(tmp_path)[0] == failure
        known = [study.rows_of(analysis(start)) for start in (0.0, 60.0, 120.0, 180.0)]
        assert known == [1, 0, None, None]
        for start in (60.0, 120.0):
            study.add("a.csv", Answer(analysis(start), [row("A")]))
        assert study.rows_of(analysis(60.0)) == 1
        assert read_failures(tmp_path) == ()
        assert len({*states, state_of(tmp_path)}) == 3
        with pytest.raises(RecordingError, match="another batch is writing"):
            written(tmp_path, REQUEST).__enter__()
        later_version = analysis()
        monkeypatch.setitem(vars(later_version), "key", "another")
        assert study.rows_of(later_version) is None
        study.add("a.csv", Answer(later_version, [row("B")]))
    assert [cells["make"] for cells in read_rows(tmp_path)] == ["B", "A", "A"]
    assert [path.name for path in tmp_path.glob(f"{FILE}*")] == [FILE], "one plain file is left"


def test_rows_have_one_order_whatever_ended_first(tmp_path: Path) -> None:
    places = [(start, file, method) for file in ("a", "b") for start in (0.0, 60.0, 300.0)
              for method in ("least-squares", "splines")]  # fmt: skip
    contents: list[Any] = []
    for seed in (0, 1):
        folder = tmp_path / str(seed)
        with written(folder, REQUEST) as study:
            for k in np.random.default_rng(seed).permutation(len(places)).tolist():
                start, file, method = places[k]
                cells = row("A", file=file, start=start, method=method)
                study.add(file, Answer(analysis(*places[k]), [cells]))
                study.add(file, Answer(analysis(start + 30, file, method), reason="broken"))
        contents.append([(folder / name).read_bytes() for name in (FAILURES, RESULTS)])
        order = [(cells["start"], cells["file"], cells["method"]) for cells in read_rows(folder)]
        assert order == places
    assert contents[0] == contents[1]


def test_what_a_file_holds_and_what_was_asked_last_are_found_again(tmp_path: Path) -> None:
    known, finished = KnownFile(None, 1, 1, (analysis(),)), replace(REQUEST, is_finished=True)
    with written(tmp_path, REQUEST) as study:
        assert read_request(tmp_path) == REQUEST
        study.refuse(Path("runs/x.csv"), ["broken", "broken, too"])
        study.refuse(Path("runs/y.csv"), ["broken"])
        study.refuse(Path("runs/x.csv"), ["no window"])
        study.add_file("bytes", known)
        assert (study.known_file("bytes"), study.known_file("others")) == (known, None)
        study.note(finished)
    failures = [(failure.file, failure.reason) for failure in read_failures(tmp_path)]
    assert failures == [("x.csv", "no window"), ("y.csv", "broken")]
    assert read_request(tmp_path) == finished
    for changes in ({"case": "I"}, {"window": 60.0}, {"model": "idm"}):
        with pytest.raises(ConfigError, match="holds a batch with window 300, Case II"):
            written(tmp_path, replace(REQUEST, **changes)).__enter__()


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
            "drop table answers",
            "update answers set rows = 'no JSON'",
            "update answers set rows = '[{\"alpha\": 1e300}]'",
            "update answers set rows = x'ff'",
            "update answers set rows = 1.5",
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
    for use in (read_study, lambda folder: written(folder, REQUEST).__enter__()):
        with pytest.raises(RecordingError, match="another version of accpinn"):
            use(later)


@pytest.mark.parametrize(
    "name", ["", ".", "..", "../x", "a/b", "/etc", "a\\b", ".hidden", "x ", "x" * 61, "a\n", "out"]
)
def test_what_leads_out_of_the_folder_is_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "studies"
    monkeypatch.setenv("ACCPINN_STUDIES", str(folder))
    folder.mkdir()
    (folder / "out").symlink_to(write_study(tmp_path / "elsewhere", row("A")))
    with pytest.raises(ConfigError, match="is no name"):
        study_path(name)
    assert studies() == ()


def test_studies_are_listed_the_latest_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ACCPINN_STUDIES", str(tmp_path))
    assert studies() == ()
    for age, name in enumerate(("Meine Läufe (2)", "old")):
        file = write_study(tmp_path / name, row("A")) / FILE
        os.utime(file, (1e9 - age, 1e9 - age))
    (tmp_path / "no study").mkdir()
    assert studies() == ("Meine Läufe (2)", "old")
