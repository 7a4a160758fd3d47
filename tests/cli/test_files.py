"""`report`: where the page is written, and what is said of a snapshot that does not hold."""

from dataclasses import replace
from pathlib import Path

import pytest

from accpinn.cli import main
from accpinn.model.cthp import Parameters
from accpinn.results.snapshot.file import load, save
from tests.support.command import PLATOON, refused
from tests.support.snapshots import small, whole


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return save(small(), tmp_path / "small.accpinn.zip")


def test_writes_beside_the_snapshot_or_where_asked(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(file)]) == 0
    written = file.with_name("small.html")
    assert capsys.readouterr().out.strip() == str(written)
    assert load(file).id in written.read_text(encoding="utf-8")
    assert main(["report", str(file), "-o", str(tmp_path / "r.html")]) == 0
    assert (tmp_path / "r.html").stat().st_size > 4_000_000


def test_a_snapshot_that_does_not_agree_is_written_with_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fit = small().fit
    forged = replace(fit, parameters=Parameters.of(fit.parameters.values * [1, 2, 1]))
    file = save(replace(small(), fit=forged), tmp_path / "forged.accpinn.zip")
    assert main(["report", str(file)]) == 1
    printed = capsys.readouterr()
    assert Path(printed.out.strip()).exists()
    assert printed.err.startswith("error: what the snapshot says does not follow")


def test_a_recording_supplies_the_data(tmp_path: Path) -> None:
    file = save(replace(whole(), segment=None), tmp_path / "no_data.accpinn.zip")
    assert main(["report", str(file), "--recording", str(PLATOON)]) == 0
    text = (tmp_path / "no_data.html").read_text(encoding="utf-8")
    assert "Measured space-gaps and speeds" in text


def test_faults_of_files_are_sentences(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.accpinn.zip").write_bytes(b"no zip")
    assert "x.accpinn.zip" in refused(capsys, 1, "report", tmp_path / "x.accpinn.zip")
    assert not (tmp_path / "x.html").exists()
    assert "r.html" in refused(capsys, 1, "report", file, "-o", tmp_path / "no" / "r.html")
