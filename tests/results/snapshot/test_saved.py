"""Snapshots on disk: whole or not at all, nothing is lost, and nothing else is replaced."""

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from accpinn.results.snapshot import Snapshot
from accpinn.results.snapshot.archive import to_bytes
from accpinn.results.snapshot.saved import Library, save

from accpinn.errors import SnapshotError
from tests.support.snapshots import small, small_bytes, whole


class TestFile:
    @pytest.mark.skipif(sys.platform == "win32", reason="there is no umask")
    @pytest.mark.parametrize(("mask", "mode"), [(0o077, 0o600), (0o022, 0o644)])
    def test_who_may_read_follows_the_umask(self, tmp_path: Path, mask: int, mode: int) -> None:
        before = os.umask(mask)
        try:
            target = save(small(), tmp_path / "a.accpinn.zip")
        finally:
            os.umask(before)
        assert target.stat().st_mode & 0o777 == mode

    @pytest.mark.parametrize("empty", [False, True])
    def test_the_old_file_is_replaced_and_a_link_to_it_followed(
        self, tmp_path: Path, empty: bool
    ) -> None:
        target, link = tmp_path / "a.accpinn.zip", tmp_path / "link"
        target.write_bytes(b"" if empty else to_bytes(whole()))
        link.symlink_to(target)
        assert save(small(), link) == link
        assert link.is_symlink()
        assert target.read_bytes() == small_bytes()
        assert sorted(path.name for path in tmp_path.iterdir()) == [target.name, link.name]

    def test_nothing_else_is_replaced(self, tmp_path: Path) -> None:
        (tmp_path / "table.csv").write_bytes(b"Time,Speed1")
        (tmp_path / "book.xlsx").write_bytes(b"PK\x03\x04" + bytes(100))
        (tmp_path / "circle").symlink_to("circle")
        os.mkfifo(tmp_path / "pipe")
        names = sorted(path.name for path in tmp_path.iterdir())
        for name in (*names, ".", "x" * 300, "missing/a", "nul\0"):
            with pytest.raises(SnapshotError, match=r"choose another|name a file"):
                save(small(), tmp_path / name)
        assert sorted(path.name for path in tmp_path.iterdir()) == names
        assert (tmp_path / "table.csv").read_bytes() == b"Time,Speed1"


@pytest.fixture
def library(tmp_path: Path) -> Library:
    return Library(tmp_path / "library")


def named(name: str) -> Snapshot:
    return replace(small(), name=name)


def test_a_restart_finds_what_was_kept(library: Library) -> None:
    name = library.add(small())
    again = Library(library.folder)
    (entry,) = again.entries()
    assert (entry.id, entry.name, entry.fault) == (name, "small", "")
    assert entry.source == small().info.source
    assert entry.vehicles == small().info.labels
    assert entry.parameters[0] == tuple(small().fit.parameters.values[0])
    assert entry.with_data
    assert (
        again.open(name).fit.parameters.values.tobytes() == small().fit.parameters.values.tobytes()
    )
    assert again.raw(name) == small_bytes()


def test_a_list_forgets_what_is_gone(library: Library) -> None:
    library.delete(library.add(small()))
    assert library.entries() == ()
    assert not library._known


def test_the_same_twice_is_one(library: Library) -> None:
    assert library.add(small()) == library.add(small_bytes())
    assert len(library.entries()) == 1


def test_the_newest_comes_first_and_of_one_second_the_one_written_last(library: Library) -> None:
    for name, month, written in (("new", 2, 1), ("last", 1, 2), ("first", 1, 1)):
        made = replace(small(), name=name, created=f"2026-0{month}-01T00:00:00Z")
        os.utime(library.folder / f"{library.add(made)}.accpinn.zip", (written, written))
    assert [entry.name for entry in library.entries()] == ["new", "last", "first"]


def test_a_list_reads_only_what_changed(library: Library, monkeypatch: pytest.MonkeyPatch) -> None:
    name = library.add(small())
    before = library.entries()
    monkeypatch.setattr(library, "open", lambda _: pytest.fail("read again"))
    assert library.entries() == before
    monkeypatch.undo()
    (library.folder / f"{name}.accpinn.zip").write_bytes(b"short")
    assert library.entries()[0].fault


@pytest.mark.parametrize(
    "name", ["", "../secret", "a/b", "ABCDEF0123456789", "0123456789abcdef\n", "0" * 15, "0" * 17]
)
def test_what_is_no_name_never_becomes_a_path(library: Library, name: str) -> None:
    for use in (library.open, library.raw, library.delete):
        with pytest.raises(SnapshotError, match="There is no snapshot"):
            use(name)


def test_an_unknown_name_is_said(library: Library) -> None:
    assert library.entries() == ()
    with pytest.raises(SnapshotError, match="may have been deleted"):
        library.open("0" * 16)


def test_a_full_library_refuses_and_keeps_what_is_there(library: Library) -> None:
    for full in (Library(library.folder, cap_count=1), Library(library.folder, cap_bytes=100)):
        if not library.entries():
            library.add(small())
        with pytest.raises(SnapshotError, match=r"is full .* delete some"):
            full.add(named("one more"))
        assert [entry.name for entry in library.entries()] == ["small"]
    assert Library(library.folder, cap_count=1).add(small()), "what is there already needs no room"


def test_damaged_bytes_are_refused(library: Library) -> None:
    broken = bytearray(small_bytes())
    broken[len(broken) // 2] ^= 1
    with pytest.raises(SnapshotError):
        library.add(bytes(broken))
    assert library.entries() == ()


def test_a_damaged_file_is_listed_with_the_reason(library: Library) -> None:
    kept, broken = library.add(small()), library.add(named("soon broken"))
    path = library.folder / f"{broken}.accpinn.zip"
    path.write_bytes(path.read_bytes()[:-50])
    found = {entry.id: entry for entry in library.entries()}
    assert found[kept].fault == ""
    assert found[broken].fault
    assert library.entries()[-1].id == broken
    library.add(named("soon broken"))
    assert all(not entry.fault for entry in library.entries()), "saving it again mends it"
    library.delete(broken)
    assert [entry.id for entry in library.entries()] == [kept]
    path = library.folder / f"{kept}.accpinn.zip"
    path.rename(library.folder / f"{'0' * 16}.accpinn.zip")
    assert "its file holds" in library.entries()[0].fault


def test_another_of_the_same_short_name_is_not_written_over(
    library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = library.add(small())
    monkeypatch.setattr(Snapshot, "id", name)
    with pytest.raises(SnapshotError, match="Another snapshot has the short name"):
        library.add(named("another"))
    assert library.raw(name) == small_bytes()


def test_what_a_killed_process_left_is_swept(library: Library) -> None:
    library.add(small())
    old, new = (library.folder / f"{name}.part" for name in ("old", "new"))
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (1, 1))
    library.add(named("another"))
    assert not old.exists()
    assert new.exists(), "it may still be written to"


def test_the_environment_names_the_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ACCPINN_SNAPSHOTS", str(tmp_path / "elsewhere"))
    Library().add(small_bytes())
    assert len(list((tmp_path / "elsewhere").glob("*.accpinn.zip"))) == 1


def test_servers_that_share_a_folder_keep_to_its_room(tmp_path: Path) -> None:
    """Each has room for one more; together they must not add two."""
    libraries = [Library(tmp_path, cap_count=1) for _ in range(6)]
    contents = [replace(small(), name=f"number {k}") for k in range(6)]

    def kept(library: Library, content: Snapshot) -> bool:
        try:
            return bool(library.add(content))
        except SnapshotError:
            return False

    with ThreadPoolExecutor(6) as pool:
        assert sum(pool.map(kept, libraries, contents)) == 1
    assert len(libraries[0].entries()) == 1
