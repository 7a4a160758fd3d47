"""Results on disk: found again by key, by words and by session; nothing lost, never too large."""

import errno
import os
import pickle
import sqlite3
import time
import zipfile
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from accpinn.errors import SnapshotError
from accpinn.methods.pinn.config import preset
from accpinn.study import Analysis
from accpinn.study.result import Result
from accpinn.study.snapshot import ATTRIBUTION
from accpinn.study.snapshot_library import RESTORABLE, Library
from accpinn.study.store import INDEX, SESSION_KEPT, Entry, Store
from tests.support.driving import driven
from tests.support.snapshots import (
    asked_of,
    bits,
    members,
    numbered,
    resealed,
    small,
    small_bytes,
    two_windows,
    whole,
    zipped,
)

TRAINING = asked_of(driven(), "pinn", preset("paper", iterations=10))


def failing(fault: BaseException) -> Callable[..., Any]:
    """A function that raises it."""

    def fail(*_: object, **__: object) -> None:
        raise fault

    return fail


def same(entries: tuple[Entry, ...], others: tuple[Entry, ...]) -> bool:
    """Whether they are equal; the ends of a point's intervals are nan."""
    return bits({"all": entries}) == bits({"all": others})


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if not path.name.startswith(INDEX)}


class TestStore:
    def test_a_result_is_found_by_its_question(self, store: Store) -> None:
        result = replace(two_windows(), note="kept")
        assert store.find(result.analysis, pytest.fail) is None
        store.keep(result, pytest.fail)
        stored = store.find(result.analysis, pytest.fail)
        assert bits(replace(stored, digest="")) == bits(result), "with its data"
        assert bits(store.read(result.analysis.key)) == bits(stored)
        assert store.find(numbered(1, result).analysis) is None

    def test_all_results_can_be_searched_by_words(self, store: Store) -> None:
        for k, made in enumerate((small(), whole(), two_windows())):
            store.keep(numbered(k, made))
        entries = store.entries()
        assert [entry.name for entry in entries] == ["two", "whole", "small"], "newest first"
        assert [entry.name for entry in store.entries("ASTAZERO pinn")] == ["whole"]
        assert [entry.name for entry in store.entries("calibrated delay")] == ["two"]
        assert store.entries("astazero calibrated") == ()
        (entry,) = store.entries("whole")
        assert (entry.id, entry.preset) == (numbered(1, whole()).analysis.key, "fast")
        assert entry.parameters[0] == tuple(whole().parameters.values[0])
        assert entry.vehicles == whole().info.labels
        assert (entry.lower, entry.upper, np.isnan(entry.time_gaps[0].lower)) == ((), (), True)

    def test_an_entry_has_the_intervals_of_an_estimate_that_has_some(self, store: Store) -> None:
        result = two_windows()
        store.keep(result)
        (entry,) = store.entries()
        assert entry.lower[0] < entry.parameters[0] < entry.upper[0]
        gap = result.estimate.time_gap(result.estimate.stated_speed, 0)
        assert (entry.time_gaps[0].value, entry.time_gaps[0].lower) == (gap.value, gap.lower)
        assert (entry.model, entry.preset) == ("cthp-s0-delay", "calibrated")
        assert entry.window == "0–29.5 s, 30–60 s"

    def test_a_session_knows_what_it_has_shown(
        self, store: Store, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        store.keep_session("ann", b"open")
        store.record_shown("ann", numbered(1))
        store.record_shown("bob", numbered(2))
        assert (store.session("ann"), store.session("eve")) == (b"open", None)
        assert [entry.id for entry in store.entries(session="ann")] == [numbered(1).analysis.key]
        later = time.time() + SESSION_KEPT + 60
        monkeypatch.setattr(time, "time", lambda: later)
        store.keep_session("bob", b"later")
        assert store.session("ann") == b"open", "it may be the clock that is wrong"
        monkeypatch.setattr("accpinn.study.store.SESSIONS_KEPT", 1)
        store.keep_session("bob", b"later")
        assert store.session("ann") is None
        assert store.entries(session="ann") == ()
        assert len(store.entries()) == 2

    @pytest.mark.parametrize("fate", ["deleted", "damaged", "empty"])
    def test_an_index_that_is_lost_is_made_again(self, store: Store, fate: str) -> None:
        for k in range(2):
            store.keep(numbered(k))
        before = store.entries()
        for path in store.folder.glob(f"{INDEX}*"):
            path.unlink()
        if fate != "deleted":
            (store.folder / INDEX).write_bytes(b"no index" * 100 if fate == "damaged" else b"")
        assert same(Store(store.folder).entries(), before)
        store.keep(numbered(5))
        assert len(store.entries()) == 3

    def test_a_damaged_index_is_set_aside_and_made_again(self, store: Store) -> None:
        store.keep_session("ann", b"open")
        for k in range(40):
            store.keep(numbered(k))
        place = store.folder / INDEX
        damaged = bytearray(place.read_bytes())
        damaged[4096:] = os.urandom(len(damaged) - 4096)  # found when rows are read, not before
        place.write_bytes(damaged)
        for path in store.folder.glob(f"{INDEX}-*"):
            path.unlink()
        assert len(Store(store.folder).entries()) == 40
        (aside,) = store.folder.glob(f"{INDEX}.damaged-*")
        assert aside.read_bytes() == bytes(damaged)

    @pytest.mark.parametrize("fault", ["descriptors", "lock", "full disk", "read-only"])
    def test_a_fault_that_passes_costs_nothing(
        self, store: Store, monkeypatch: pytest.MonkeyPatch, fault: str
    ) -> None:
        store.keep_session("ann", b"open")
        store.record_shown("ann", numbered(1))
        library = Library(store.folder)
        name = library.add(small(), owner="ann")
        monkeypatch.setattr("accpinn.study.store.PATIENCE", 0.01)
        with ExitStack() as stack:
            if fault == "descriptors":
                import resource

                limits = resource.getrlimit(resource.RLIMIT_NOFILE)
                stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, limits)
                resource.setrlimit(resource.RLIMIT_NOFILE, (3, limits[1]))
            elif fault == "lock":
                other = stack.enter_context(closing(sqlite3.connect(store.folder / INDEX)))
                other.execute("pragma locking_mode = exclusive")
                other.execute("begin exclusive")
            else:
                patched = stack.enter_context(monkeypatch.context())
                code = {"full disk": "SQLITE_FULL", "read-only": "SQLITE_READONLY"}[fault]
                error = sqlite3.OperationalError("it fails")
                error.sqlite_errorcode = getattr(sqlite3, code)
                patched.setattr(sqlite3, "connect", failing(error))
            for use in (store.entries, library.entries, lambda: library.owner(name)):
                use()
            store.session("ann")
            store.keep_session("bob", b"open, too")
        assert store.session("ann") == b"open"
        assert [entry.id for entry in store.entries(session="ann")] == [numbered(1).analysis.key]
        assert library.owner(name) == "ann"
        assert not [*store.folder.glob("*damaged*")]

    def test_an_upgrade_keeps_sessions_and_owners(self, store: Store) -> None:
        library = Library(store.folder)
        name = library.add(small())
        store.keep(numbered(1))
        for path in store.folder.glob(f"{INDEX}*"):
            path.unlink()
        with closing(sqlite3.connect(store.folder / "index9.sqlite")) as former:
            former.executescript(
                "create table entries (name text primary key, state text, entry blob, owner text);"
                "create table sessions (name text primary key, used real, document blob);"
                "create table shown (session text, name text, at real);"
            )
            with former:
                former.execute("insert into entries values (?, '', '', 'ann')", (name,))
                former.execute("insert into sessions values ('ann', 1.0, 'open')")
                former.execute(
                    "insert into shown values ('ann', ?, 1.0)", (numbered(1).analysis.key,)
                )
        (store.folder / "index8.sqlite").write_bytes(b"damaged " * 1000)
        assert store.session("ann") == "open"
        assert len(store.entries(session="ann")) == 1
        assert library.owner(name) == "ann"
        (store.folder / INDEX).unlink()
        assert library.owner(name) == "ann", "it stands beside the file"

    def test_a_list_reads_only_what_changed(
        self, store: Store, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        store.keep(small())
        before = store.entries()
        monkeypatch.setattr(store, "read", lambda _: pytest.fail("read again"))
        assert same(store.entries(), before)
        monkeypatch.undo()
        store.path(small().analysis.key).write_bytes(b"short")
        assert store.entries()[0].fault

    @pytest.mark.parametrize("number", [errno.EACCES, errno.EMFILE, errno.EIO])
    def test_what_cannot_be_read_just_now_is_not_set_aside(
        self, store: Store, monkeypatch: pytest.MonkeyPatch, number: int
    ) -> None:
        store.keep(small())
        sentences: list[str] = []
        with monkeypatch.context() as patch:
            patch.setattr(Path, "read_bytes", failing(OSError(number, os.strerror(number))))
            assert store.find(small().analysis, sentences.append) is None
        assert os.strerror(number) in sentences[0]
        assert store.find(small().analysis, pytest.fail) is not None

    def test_what_was_not_used_for_the_longest_time_makes_room(self, store: Store) -> None:
        for k in range(3):
            store.keep(numbered(k))
            os.utime(store.path(numbered(k).analysis.key), (k, k))
        (store.folder / "notes.txt").write_bytes(bytes(500_000))  # somebody else's
        (store.folder / "killed.part").write_bytes(bytes(100_000))
        os.utime(store.folder / "killed.part", (1, 1))
        size = store.path(numbered(0).analysis.key).stat().st_size
        assert store.find(numbered(0).analysis) is not None  # used just now
        capped = Store(store.folder, cap_bytes=3 * size + 1000)
        capped.keep(numbered(3))
        left = {k for k in range(4) if capped.has(numbered(k).analysis.key)}
        assert left == {0, 2, 3}
        assert {entry.id for entry in capped.entries()} == {numbered(k).analysis.key for k in left}
        assert "notes.txt" in names(store.folder)
        assert "killed.part" not in names(store.folder)
        Store(store.folder, cap_bytes=10).keep(numbered(4))
        assert len(capped.entries()) == 1, "what was asked for last is kept, however large"


class Trap:
    """Unpickling one would be noticed."""

    def __reduce__(self) -> tuple:  # noqa: D105
        return pytest.fail, ("a file of the store was unpickled",)


def state(iteration: int = 5, value: float = 1.0) -> dict[str, np.ndarray]:
    return {"weights": np.full((4, 3), value), "history.rows": np.array([[float(iteration)]])}


def saved(folder: Path, analysis: Analysis = TRAINING) -> Path:
    """The file of a checkpoint."""
    Store(folder).checkpoints(analysis).save(state())
    (path,) = folder.glob("*.state.npz")
    return path


class TestCheckpoints:
    def test_come_back_unless_they_go_too_far(self, store: Store) -> None:
        checkpoints = store.checkpoints(TRAINING, pytest.fail)
        assert checkpoints.load(10) is None
        checkpoints.save(state(5))
        loaded = checkpoints.load(10)
        np.testing.assert_array_equal(loaded["weights"], state()["weights"])
        assert store.checkpoints(TRAINING).load(4) is None, "a longer training's"
        assert store.stopped_at(TRAINING) == 5
        checkpoints.drop()
        assert checkpoints.load(10) is None

    @pytest.mark.parametrize(
        "content",
        [
            b"", b"Time,Speed1\r\n1.0,20.0\r\n", bytes(5000), pickle.dumps(Trap()), "half",
            "objects", "no zip", "foreign",
        ],
        ids=lambda content: content if isinstance(content, str) else repr(content[:10]),
    )  # fmt: skip
    def test_damage_is_set_aside_and_said(self, store: Store, content: bytes | str) -> None:
        path = saved(store.folder)
        if content == "half":
            content = path.read_bytes()[:200]
        elif content == "objects":
            np.savez(path, **{"history.rows": np.array([Trap()], dtype=object)})
        elif content == "no zip":
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr("history.rows.npy", "no array")
        elif content == "foreign":
            np.savez(path, weights=np.arange(3))
        if isinstance(content, bytes):
            path.write_bytes(content)
        assert store.checkpoints(TRAINING).load(10) is None
        sentences: list[str] = []
        assert store.checkpoints(TRAINING, sentences.append).load(10) is None
        assert sentences[0].startswith(path.name)
        assert "\n" not in sentences[0]

    def test_a_bomb_is_not_unpacked(self, store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
        path = saved(store.folder)
        np.savez_compressed(path, weights=np.zeros(1_000_000))
        monkeypatch.setattr(np, "load", lambda *_, **__: pytest.fail("it was unpacked"))
        sentences: list[str] = []
        capped = Store(store.folder, cap_bytes=1_000_000)
        assert capped.checkpoints(TRAINING, sentences.append).load(10) is None
        assert "unpack" in sentences[0]


@pytest.fixture
def library(tmp_path: Path) -> Library:
    return Library(tmp_path / "library")


def called(name: str) -> Result:
    return replace(small(), name=name)


class TestLibrary:
    def test_a_restart_finds_what_was_kept_once(self, library: Library) -> None:
        name = library.add(small(), owner="ann")
        assert library.add(small_bytes(), owner="bob") == name
        again = Library(library.folder)
        (entry,) = again.entries()
        assert (entry.id, entry.name, entry.fault) == (name, "small", "")
        assert again.owner(name) == "ann"
        assert bits(replace(again.read(name), digest="")) == bits(small())
        assert same(again.readable("SMALL"), (entry,))

    @pytest.mark.parametrize("about", ["attribution", "document"])
    def test_what_is_imported_is_written_anew(self, library: Library, about: str) -> None:
        foreign = zipped(members(small_bytes()) | {ATTRIBUTION: b"foreign: measured by Eve"})
        if about == "document":
            foreign = resealed(lambda tree, _: tree.update(foreign="and unknown"))
        name = library.add(foreign, owner="eve")
        written = members(library.raw(name))
        assert written == members(small_bytes()), "as this program writes it"
        with pytest.raises(SnapshotError, match=r"run\.exe"):
            library.add(zipped(members(small_bytes()) | {"run.exe": b"x"}))

    @pytest.mark.parametrize(
        "name", ["", "../secret", "a/b", "ABCDEF0123456789", "0123456789abcdef\n", "0" * 15]
    )
    def test_what_is_no_name_never_becomes_a_path(self, library: Library, name: str) -> None:
        for use in (library.read, library.raw, library.delete, library.restore):
            with pytest.raises(SnapshotError, match="There is no snapshot"):
                use(name)

    def test_a_deleted_one_comes_back_within_a_day(
        self, library: Library, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        name = library.add(small())
        library.delete(name)
        library.delete(name)
        assert library.entries() == ()
        with pytest.raises(SnapshotError, match="may have been deleted"):
            library.read(name)
        library.restore(name)
        assert [entry.id for entry in library.entries()] == [name]
        library.delete(name)
        later = time.time() + RESTORABLE + 60
        monkeypatch.setattr(time, "time", lambda: later)
        library.add(called("another"))
        library.restore(name)
        library.delete(name)
        os.utime(library.path(name).with_suffix(".deleted"), (1, 1))
        monkeypatch.setattr("accpinn.study.snapshot_library.UNDONE", 0)
        library.add(called("a third"))
        with pytest.raises(SnapshotError, match="There is no snapshot"):
            library.restore(name)

    def test_a_full_library_refuses_and_keeps_what_is_there(self, library: Library) -> None:
        library.add(small())
        for full in (Library(library.folder, cap_count=1), Library(library.folder, cap_bytes=100)):
            with pytest.raises(SnapshotError, match=r"is full .* delete some"):
                full.add(called("one more"))
            assert full.add(small()), "what is there already needs no room"
        assert [entry.name for entry in library.entries()] == ["small"]

    def test_a_damaged_file_is_listed_with_the_reason_and_mended(self, library: Library) -> None:
        sound, broken = library.add(small()), library.add(called("broken"))
        path = library.path(broken)
        path.write_bytes(path.read_bytes()[:-50])
        with pytest.raises(SnapshotError):
            library.add(path.read_bytes())
        faults = {entry.id: bool(entry.fault) for entry in library.entries()}
        assert faults == {sound: False, broken: True}
        assert library.entries()[-1].id == broken
        library.add(called("broken"))
        assert len(library.readable()) == 2
        library.path(sound).rename(library.path("0" * 16))
        assert "its file holds" in {e.id: e.fault for e in library.entries()}["0" * 16]

    def test_what_a_killed_process_left_is_swept(self, library: Library) -> None:
        library.add(small())
        old, new = (library.folder / f"{name}.part" for name in ("old", "new"))
        for path in (old, new):
            path.write_bytes(b"half")
        os.utime(old, (1, 1))
        library.add(called("another"))
        assert (old.exists(), new.exists()) == (False, True), "that may still be written to"
