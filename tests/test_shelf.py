"""The server's store of snapshots: nothing is lost, nothing escapes, nothing breaks the list."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from accpinn.errors import SnapshotError
from accpinn.results.snapshot.content import Snapshot
from accpinn.results.snapshot.file import to_bytes
from accpinn.results.snapshot.library import Shelf
from tests.snapshots import small, small_bytes


@pytest.fixture
def shelf(tmp_path: Path) -> Shelf:
    return Shelf(tmp_path / "shelf")


def named(name: str) -> Snapshot:
    return replace(small(), name=name)


def test_a_restart_finds_what_was_kept(shelf: Shelf) -> None:
    name = shelf.add(small())
    again = Shelf(shelf.folder)
    (entry,) = again.entries()
    assert (entry.id, entry.name, entry.fault) == (name, "small", "")
    assert entry.source == small().outline.source
    assert entry.vehicles == small().outline.labels
    assert entry.parameters[0] == tuple(small().fit.table()[0])
    assert entry.with_data
    assert again.open(name).fit.table().tobytes() == small().fit.table().tobytes()
    assert again.raw(name) == small_bytes()


def test_the_same_twice_is_one(shelf: Shelf) -> None:
    assert shelf.add(small()) == shelf.add(small_bytes())
    assert len(shelf.entries()) == 1


def test_the_newest_comes_first(shelf: Shelf) -> None:
    shelf.add(replace(small(), name="old", created="2026-01-01T00:00:00Z"))
    shelf.add(replace(small(), name="new", created="2026-02-01T00:00:00Z"))
    assert [entry.name for entry in shelf.entries()] == ["new", "old"]


def test_of_two_of_one_second_the_one_written_last_comes_first(shelf: Shelf) -> None:
    for name, written in (("last", 2), ("first", 1)):
        path = shelf.folder / f"{shelf.add(named(name))}.accpinn.zip"
        os.utime(path, (written, written))
    assert [entry.name for entry in shelf.entries()] == ["last", "first"]


def test_a_list_reads_only_what_changed(shelf: Shelf, monkeypatch: pytest.MonkeyPatch) -> None:
    name = shelf.add(small())
    before = shelf.entries()
    monkeypatch.setattr(shelf, "open", lambda _: pytest.fail("read again"))
    assert shelf.entries() == before
    monkeypatch.undo()
    (shelf.folder / f"{name}.accpinn.zip").write_bytes(b"short")
    assert shelf.entries()[0].fault


def test_an_empty_server_has_an_empty_list(shelf: Shelf) -> None:
    assert shelf.entries() == ()


@pytest.mark.parametrize(
    "name", ["", "../secret", "a/b", "ABCDEF0123456789", "0123456789abcdef\n", "0" * 15, "0" * 17]
)
def test_what_is_no_name_never_becomes_a_path(shelf: Shelf, name: str) -> None:
    for use in (shelf.open, shelf.raw, shelf.delete):
        with pytest.raises(SnapshotError, match="There is no snapshot"):
            use(name)


def test_an_unknown_name_is_said(shelf: Shelf) -> None:
    with pytest.raises(SnapshotError, match="may have been deleted"):
        shelf.open("0" * 16)


def test_a_full_shelf_refuses_and_keeps_what_is_there(shelf: Shelf) -> None:
    for full in (Shelf(shelf.folder, cap_count=1), Shelf(shelf.folder, cap_bytes=100)):
        if not shelf.entries():
            shelf.add(small())
        with pytest.raises(SnapshotError, match=r"is full .* delete some"):
            full.add(named("one more"))
        assert [entry.name for entry in shelf.entries()] == ["small"]
    assert Shelf(shelf.folder, cap_count=1).add(small()), "what is there already needs no room"


def test_damaged_bytes_are_refused(shelf: Shelf) -> None:
    broken = bytearray(small_bytes())
    broken[len(broken) // 2] ^= 1
    with pytest.raises(SnapshotError):
        shelf.add(bytes(broken))
    assert shelf.entries() == ()


def test_a_damaged_file_is_listed_with_the_reason(shelf: Shelf) -> None:
    kept, broken = shelf.add(small()), shelf.add(named("soon broken"))
    path = shelf.folder / f"{broken}.accpinn.zip"
    path.write_bytes(path.read_bytes()[:-50])
    found = {entry.id: entry for entry in shelf.entries()}
    assert found[kept].fault == ""
    assert found[broken].fault
    assert shelf.entries()[-1].id == broken
    shelf.delete(broken)
    assert [entry.id for entry in shelf.entries()] == [kept]


def test_a_file_under_another_s_name_is_damaged(shelf: Shelf) -> None:
    name = shelf.add(small())
    path = shelf.folder / f"{name}.accpinn.zip"
    path.rename(shelf.folder / f"{'0' * 16}.accpinn.zip")
    (entry,) = shelf.entries()
    assert "its file holds" in entry.fault


def test_another_of_the_same_short_name_is_not_written_over(
    shelf: Shelf, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = shelf.add(small())
    monkeypatch.setattr(Snapshot, "id", name)
    with pytest.raises(SnapshotError, match="Another snapshot has the short name"):
        shelf.add(named("another"))
    assert shelf.raw(name) == small_bytes()


def test_what_a_killed_process_left_is_swept(shelf: Shelf) -> None:
    shelf.add(small())
    old, new = (shelf.folder / f"{name}.part" for name in ("old", "new"))
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (1, 1))
    shelf.add(named("another"))
    assert not old.exists()
    assert new.exists(), "it may still be written to"


def test_a_damaged_one_is_mended_by_saving_it_again(shelf: Shelf) -> None:
    path = shelf.folder / f"{shelf.add(small())}.accpinn.zip"
    path.write_bytes(b"half")
    shelf.add(small())
    assert path.read_bytes() == small_bytes()


def test_a_saving_that_fails_half_way_leaves_the_old_file(
    shelf: Shelf, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = shelf.add(small())

    def no_room(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("accpinn.results.snapshot.file.os.replace", no_room)
    with pytest.raises(SnapshotError, match="No space left"):
        shelf.add(named("another"))
    monkeypatch.undo()
    assert [entry.id for entry in shelf.entries()] == [name]
    assert sorted(path.name for path in shelf.folder.glob("[!.]*")) == [f"{name}.accpinn.zip"]


def test_two_processes_that_save_at_once_lose_nothing(shelf: Shelf, tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from accpinn.results.snapshot.library import Shelf\n"
        "shelf = Shelf(Path(sys.argv[1]))\n"
        "for name in sys.argv[2:]: shelf.add(Path(name).read_bytes())\n"
    )
    groups: list[list[str]] = [[], []]
    for k in range(10):
        path = tmp_path / f"{k}"
        path.write_bytes(to_bytes(named(f"number {k}")))
        groups[k % 2] += [str(path)]
        groups[1 - k % 2] += [str(path)] * (k < 3)  # some by both at once
    writers = [
        subprocess.Popen([sys.executable, "-c", code, str(shelf.folder), *group])
        for group in groups
    ]
    assert [writer.wait(60) for writer in writers] == [0, 0]
    assert {entry.name for entry in shelf.entries()} == {f"number {k}" for k in range(10)}


def test_the_environment_names_the_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ACCPINN_SNAPSHOTS", str(tmp_path / "elsewhere"))
    Shelf().add(small_bytes())
    assert len(list((tmp_path / "elsewhere").glob("*.accpinn.zip"))) == 1


def test_servers_that_share_a_folder_keep_to_its_room(tmp_path: Path) -> None:
    """Each has room for one more; together they must not add two."""
    shelves = [Shelf(tmp_path, cap_count=1) for _ in range(6)]
    contents = [replace(small(), name=f"number {k}") for k in range(6)]

    def kept(shelf: Shelf, content: Snapshot) -> bool:
        try:
            return bool(shelf.add(content))
        except SnapshotError:
            return False

    with ThreadPoolExecutor(6) as pool:
        assert sum(pool.map(kept, shelves, contents)) == 1
    assert len(shelves[0].entries()) == 1
