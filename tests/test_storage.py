"""Folders by environment variable, and files that are written whole or not at all."""

import os
import sys
from pathlib import Path
from typing import get_args

import pytest

from accpinn.errors import ConfigError, RecordingError
from accpinn.storage import FolderName, csv_cell, folder, reason_of, reported, write_whole


@pytest.mark.parametrize("name", get_args(FolderName))
def test_a_folder_is_named_by_the_environment_or_among_the_users_files(
    name: FolderName, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"ACCPINN_{name.upper()}", "/elsewhere")
    assert folder(name) == Path("/elsewhere")
    monkeypatch.delenv(f"ACCPINN_{name.upper()}")
    assert folder(name).is_absolute()
    assert folder(name).name == ("accpinn" if name == "cache" else name)


@pytest.mark.skipif(sys.platform == "win32", reason="there the system knows the folder")
def test_a_user_without_a_home_is_told_what_to_name(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HOME", "ACCPINN_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", {}.__getitem__)  # the user's number has no entry
    with pytest.raises(ConfigError, match="ACCPINN_CACHE"):
        folder("cache")


@pytest.mark.parametrize("cell", ["=1+1", "@a", " =1+1", "\n=1", "-x"])
def test_no_cell_is_a_formula(cell: str) -> None:
    assert csv_cell(cell) == f"'{cell}"
    for harmless in ("-1.5", "Tesla", -1.5, None):
        assert csv_cell(harmless) is harmless


class TestWriteWhole:
    def test_replaces_the_old_file_and_leaves_nothing_beside_it(self, tmp_path: Path) -> None:
        path = tmp_path / f"{'a' * 240}.json"  # no longer name is made of it
        for content in (b"old", b"new"):
            write_whole(path, content)
            assert path.read_bytes() == content
        assert [*tmp_path.iterdir()] == [path]
        assert path.stat().st_mode & 0o777 == 0o666 & ~_umask()

    @pytest.mark.parametrize("moment", ["fsync", "replace"])
    @pytest.mark.parametrize("fault", [OSError(28, "No space left"), KeyboardInterrupt()], ids=repr)
    def test_a_failure_keeps_the_old_file(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str, fault: BaseException
    ) -> None:
        path = tmp_path / "file"
        write_whole(path, b"old")

        def fails(*_: object) -> None:
            raise fault

        monkeypatch.setattr(os, moment, fails)
        with pytest.raises(type(fault)):
            write_whole(path, b"new")
        assert [*tmp_path.iterdir()] == [path]
        assert path.read_bytes() == b"old"


def test_a_fault_is_reported_as_a_sentence(tmp_path: Path) -> None:
    with (
        pytest.raises(RecordingError, match=r"^it failed: No such file or directory$"),
        reported(lambda reason: RecordingError(f"it failed: {reason}")),
    ):
        write_whole(tmp_path / "missing" / "file", b"")
    assert reason_of(ValueError("embedded null byte")) == "no valid path"
    assert reason_of(OSError()) == "no reason given"


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
