"""Studies by name: what is no name is refused, and what was asked for is found again."""

import os
from pathlib import Path

import pytest

from accpinn.errors import ConfigError
from accpinn.study.folders import (
    FOLDER_VARIABLE,
    Request,
    default_folder,
    keep_request,
    recall_request,
    studies,
    study_path,
)
from accpinn.study.process import BatchSettings
from tests.support.studies import row, write_study


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


def test_studies_are_listed_the_latest_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "none"))
    assert studies(default_folder()) == ()
    for age, name in enumerate(("Meine Läufe (2)", "old")):
        journal = write_study(tmp_path / name, row("A")) / "journal.jsonl"
        os.utime(journal, (1e9 - age, 1e9 - age))
    (tmp_path / "no study").mkdir()
    assert studies(tmp_path) == ("Meine Läufe (2)", "old")


def test_a_request_is_found_again(tmp_path: Path) -> None:
    settings = BatchSettings(("runs",), str(tmp_path), None, ("splines",), workers=2)
    assert recall_request(tmp_path) is None
    keep_request(Request(settings, finished=False))
    assert recall_request(tmp_path) == Request(settings, finished=False)
    (tmp_path / "request.json").write_text("{")
    assert recall_request(tmp_path) is None
