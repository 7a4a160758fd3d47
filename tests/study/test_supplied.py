"""The study that comes with the program, and how one is made of a batch."""

import re
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from accpinn import group, read_study
from accpinn.recordings.openacc import catalogue
from accpinn.study import supplied
from accpinn.study.batch import BatchProgress
from accpinn.study.groups import POSTERIOR
from accpinn.study.rows import COLUMNS
from accpinn.study.studies import FILE, KnownFile, read_failures, read_request, written
from tests.support.studies import REQUEST, analysis, row, write_study

LARGEST_BYTES = 600_000


def test_the_supplied_study_holds_figures_of_published_runs_and_no_place_of_a_machine() -> None:
    folder = supplied.supplied_study()
    assert folder
    assert (folder / FILE).stat().st_size < LARGEST_BYTES
    rows = read_study(folder)
    runs = {(run.campaign, run.file) for run in catalogue()}
    assert {*rows[["campaign", "file"]].itertuples(index=False, name=None)} <= runs
    assert set(rows["method"]) == {"pinn"}
    about = supplied.read_about(folder)
    assert {len(drawn) for drawn in rows[POSTERIOR]} == {about.draws}
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", about.date)
    request = read_request(folder)
    assert request
    assert (request.sources, request.is_finished) == ((supplied.SOURCE,), True)
    assert not re.search(rb"/(tmp|home|root|Users|work)/", (folder / FILE).read_bytes())
    with closing(sqlite3.connect(folder / FILE)) as database:
        tables = database.execute("select name from sqlite_master where type = 'table'").fetchall()
    assert {name for (name,) in tables} == {"request", "files", "refused", "answers", "posteriors"}
    audi = group(rows[rows["model"] == "A6"], ("make", "model")).groups[0]
    assert audi.windows == 5
    assert audi.time_gap(100 / 3.6).value == pytest.approx(1.04, abs=0.03)


def test_of_a_batch_the_figures_are_kept_and_some_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    given = (row("A", file="a.csv"), row("B", file="b.csv", tau=2.0, sha256="b"))

    def batch(sources: object, study: Path, **_: object) -> BatchProgress:
        write_study(study, *given)
        with written(study, REQUEST) as kept:
            kept.refuse(Path("somewhere/bad.csv"), ["broken"])
            kept.add_file("bytes", KnownFile(None, 1, 0, (analysis(),)))
        before.append(read_study(study))
        return BatchProgress(rows=2, windows=2, recordings=2)

    before: list[object] = []
    monkeypatch.setattr(supplied, "batch", batch)
    folder = tmp_path / "supplied"
    assert supplied.main(["runs", str(folder)]) == 0
    assert "2 rows of 2 windows" in capsys.readouterr().out
    after, whole = read_study(folder), before[0]
    names = [column.name for column in COLUMNS]
    assert after[names].equals(whole[names])
    for few, many in zip(after[POSTERIOR], whole[POSTERIOR], strict=True):
        assert few.shape == (supplied.KEPT, many.shape[1])
        np.testing.assert_allclose(few.mean(axis=0), many.mean(axis=0), atol=0.1)
    assert b"somewhere" not in (folder / FILE).read_bytes()
    assert [failure.file for failure in read_failures(folder)] == ["bad.csv"]
    assert supplied.main([]) == 2
