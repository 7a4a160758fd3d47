"""The folder of results and checkpoints: nothing lost, nothing unpickled, never too large."""

import errno
import os
import pickle
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from accpinn.methods.store import FOLDER_VARIABLE, Say, Store
from hypothesis import given
from hypothesis import strategies as st

from accpinn.methods import least_squares
from accpinn.methods.fit import Fit
from accpinn.methods.pinn.config import preset
from accpinn.serial import Arrays, dump, write_json
from tests.support.driving import driven
from tests.support.methods import train

KEY = "0123abcd"
NAME = f"{KEY}.state.npz"


def state(size: int = 4, value: float = 1.0) -> Arrays:
    return {"weights": np.full((size, 3), value), "phase": np.array("Adam")}


def assert_same(one: Arrays | None, other: Arrays) -> None:
    assert one.keys() == other.keys()
    for name, values in other.items():
        np.testing.assert_array_equal(one[name], values)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def failing(fault: BaseException) -> Callable[..., Any]:
    """A function that raises it."""

    def fail(*_: object, **__: object) -> None:
        raise fault

    return fail


class Trap:
    """Unpickling one would be noticed."""

    def __reduce__(self) -> tuple:  # noqa: D105
        return pytest.fail, ("a file of the store was unpickled",)


@cache
def trained() -> Fit:
    """What a training leaves, after few iterations."""
    return train(driven(), config=preset("fast", iterations=2), threads=1)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path)


class TestRoundTrip:
    def test_of_a_checkpoint(self, store: Store) -> None:
        assert store.load_state(KEY) is None
        said: list[str] = []
        store.save_state(KEY, state(), said.append)
        assert_same(store.load_state(KEY, said.append), state())
        assert said == []

        store.save_state(KEY, state(value=2.0))
        assert_same(store.load_state(KEY), state(value=2.0))
        assert names(store.folder) == [NAME]
        assert store.load_fit(KEY, driven(), pytest.fail) is None, "a result has a file of its own"

    def test_of_a_result(self, store: Store) -> None:
        assert store.load_fit(KEY, driven()) is None
        fit = least_squares.fit(driven())
        store.save_fit(KEY, fit)
        known = store.load_fit(KEY, driven())
        assert known.parameters == fit.parameters


class TestFolder:
    def test_is_given_or_named_by_the_environment_or_the_users_cache(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
        assert FOLDER_VARIABLE == "ACCPINN_CACHE"
        assert Store().folder == tmp_path
        assert Store(tmp_path / "given").folder == tmp_path / "given"
        monkeypatch.delenv(FOLDER_VARIABLE)
        assert Store().folder.name == "accpinn"
        assert Store().folder.is_absolute()

    def test_is_made_when_first_written_to(self, tmp_path: Path) -> None:
        store = Store(tmp_path / "new" / "folder")
        assert store.load_state(KEY) is None
        assert names(tmp_path) == []
        store.save_state(KEY, state())
        assert names(tmp_path / "new" / "folder") == [NAME]


class TestAtomicity:
    @pytest.mark.parametrize("fails", ["replace", "fsync"])
    @pytest.mark.parametrize("fault", [OSError(28, "No space left"), KeyboardInterrupt()], ids=repr)
    def test_a_failure_while_saving_leaves_the_old_file(
        self, store: Store, monkeypatch: pytest.MonkeyPatch, fails: str, fault: BaseException
    ) -> None:
        store.save_state(KEY, state(value=1.0))
        said: list[str] = []
        with monkeypatch.context() as patch:
            patch.setattr(os, fails, failing(fault))
            try:
                store.save_state(KEY, state(value=2.0), said.append)
            except KeyboardInterrupt:
                assert isinstance(fault, KeyboardInterrupt)
            else:
                (message,) = said
                assert "No space left" in message
                assert "ACCPINN_CACHE" in message
        assert_same(store.load_state(KEY), state(value=1.0))
        assert names(store.folder) == [NAME], "no half-written file stays behind"

    def test_a_file_that_may_be_read_but_not_touched_is_used(
        self, store: Store, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        store.save_state(KEY, state())
        monkeypatch.setattr(os, "utime", failing(PermissionError(13, "Permission denied")))
        assert_same(store.load_state(KEY), state())


def saved(folder: Path) -> bytes:
    Store(folder).save_state(KEY, state())
    return (folder / NAME).read_bytes()


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return saved(tmp_path_factory.mktemp("good"))


def foreign_files(folder: Path) -> dict[str, bytes]:
    """Bytes that someone or something else may have left under a checkpoint's name."""
    good = saved(folder / "made")
    objects = folder / "objects.npz"
    np.savez(objects, weights=np.array([Trap()], dtype=object))
    alone = folder / "alone.npy"
    np.save(alone, np.arange(3))
    plain = folder / "plain.npz"
    np.savez(plain, weights=np.arange(3))
    text = folder / "text.zip"
    with zipfile.ZipFile(text, "w") as archive:
        archive.writestr("weights.npy", "no array")
    return {
        "empty": b"",
        "text": b"Time,Speed1\r\n1.0,20.0\r\n",
        "binary": bytes(range(256)) * 20,
        "NUL bytes": bytes(5000),
        "truncated": good[: len(good) // 2],
        "truncated in its directory": good[:-30],
        "a flipped byte": good[:200] + bytes([good[200] ^ 255]) + good[201:],
        "pickle": pickle.dumps(Trap()),
        "pickled objects": objects.read_bytes(),
        "an array alone": alone.read_bytes(),
        "another program's arrays": plain.read_bytes(),
        "a zip of text": text.read_bytes(),
    }


def load(store: Store, what: str, *say: Say) -> object:
    """The result, or the checkpoint."""
    fit = what == "fit"
    return store.load_fit(KEY, driven(), *say) if fit else store.load_state(KEY, *say)


def refused(store: Store, what: str) -> str:
    """The one sentence that says why it is not loaded."""
    said: list[str] = []
    assert load(store, what, said.append) is None
    (message,) = said
    return message


class TestDamage:
    @pytest.mark.parametrize("what", ["fit", "state"])
    def test_is_set_aside_and_said(self, tmp_path: Path, what: str) -> None:
        for kind, content in foreign_files(tmp_path).items():
            store = Store(tmp_path / kind)
            store.folder.mkdir()
            path = store.folder / f"{KEY}.{what}.npz"
            path.write_bytes(content)
            assert load(store, what) is None
            assert names(store.folder) == [path.name], "it stays for one who can say it"
            message = refused(store, what)
            assert names(store.folder) == [f"{path.name}.damaged"]
            assert (store.folder / f"{path.name}.damaged").read_bytes() == content
            assert message.startswith(path.name)
            assert "set aside" in message
            assert "\n" not in message
            assert ("computed again" in message) == (what == "fit")

    @pytest.mark.parametrize("number", [errno.EACCES, errno.EMFILE, errno.EIO, None])
    @pytest.mark.parametrize("what", ["fit", "state"])
    def test_what_cannot_be_read_just_now_is_not_set_aside(
        self, store: Store, monkeypatch: pytest.MonkeyPatch, what: str, number: int | None
    ) -> None:
        store.save_state(KEY, state())
        store.save_fit(KEY, trained())
        before = names(store.folder)
        fault = OSError(number, os.strerror(number)) if number else MemoryError()
        with monkeypatch.context() as patch:
            patch.setattr(Path, "read_bytes", failing(fault))
            message = refused(store, what)
        assert names(store.folder) == before
        assert message.startswith(f"{KEY}.{what}.npz")
        assert (os.strerror(number) if number else "memory") in message
        assert load(store, what) is not None

    def test_a_good_file_under_another_requests_name_is_not_used(self, store: Store) -> None:
        store.save_state("other", state())
        os.rename(store.folder / "other.state.npz", store.folder / NAME)
        assert "belongs to another request" in refused(store, "state")

    def test_a_checkpoint_is_no_result(self, store: Store) -> None:
        store._write(f"{KEY}.fit.npz", state())
        assert "set aside" in refused(store, "fit")

    def test_a_file_larger_than_the_store_is_not_opened(self, tmp_path: Path) -> None:
        Store(tmp_path).save_state(KEY, state(size=1000))
        assert "larger than" in refused(Store(tmp_path, cap_bytes=5000), "state")

    def test_a_bomb_is_not_unpacked(self, store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("accpinn.methods.store.CAP_BYTES", 1_000_000)
        np.savez_compressed(store.folder / NAME, weights=np.zeros(1_000_000))
        assert (store.folder / NAME).stat().st_size < 20_000
        monkeypatch.setattr(np, "load", lambda *_, **__: pytest.fail("it was unpacked"))
        assert "unpack" in refused(store, "state")

    @given(data=st.data())
    def test_flipped_bytes_are_noticed_or_harmless(
        self, data: st.DataObject, good: bytes, tmp_path_factory: pytest.TempPathFactory
    ) -> None:
        folder = tmp_path_factory.mktemp("flipped")
        content = bytearray(good)
        for _ in range(data.draw(st.integers(1, 3))):
            at = data.draw(st.integers(0, len(content) - 1))
            content[at] ^= data.draw(st.integers(1, 255))
        (folder / NAME).write_bytes(content)
        loaded = Store(folder).load_state(KEY)
        if loaded is not None:
            assert_same(loaded, state())


class TestCap:
    @staticmethod
    def fill(store: Store, count: int) -> None:
        """Checkpoints 0, 1, .. of some 30 kB each, the first used the longest time ago."""
        for number in range(count):
            store.save_state(str(number), state(size=1250))
            os.utime(store.folder / f"{number}.state.npz", (number, number))

    def test_evicts_what_was_not_used_for_the_longest_time(self, tmp_path: Path) -> None:
        self.fill(Store(tmp_path), 3)
        (tmp_path / "notes.txt").write_bytes(bytes(50_000))  # somebody else's, and left alone
        store = Store(tmp_path, cap_bytes=100_000)
        assert store.load_state("0") is not None  # used just now
        store.save_state("3", state(size=1250))
        assert names(tmp_path) == ["0.state.npz", "2.state.npz", "3.state.npz", "notes.txt"]
        Store(tmp_path, cap_bytes=10_000).save_state("new", state(size=1250))
        assert names(tmp_path) == ["new.state.npz", "notes.txt"]

    def test_counts_damaged_files_and_what_killed_processes_left(self, tmp_path: Path) -> None:
        for name in ("old.state.npz.damaged", "killed.part"):
            (tmp_path / name).write_bytes(bytes(50_000))
            os.utime(tmp_path / name, (1, 1))
        Store(tmp_path, cap_bytes=100_000).save_state("new", state(size=1250))
        assert "new.state.npz" in names(tmp_path)
        assert len(names(tmp_path)) == 2

    def test_a_file_that_cannot_be_deleted_is_no_exception(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        self.fill(Store(tmp_path), 2)
        monkeypatch.setattr(Path, "unlink", failing(PermissionError(13, "in use")))
        store = Store(tmp_path, cap_bytes=10_000)
        store.save_state("new", state(size=1250))
        assert len(names(tmp_path)) == 3

    @pytest.mark.parametrize(
        "change",
        [
            {"parameters": []},
            {"parameters": [[0.1, 0.1, 1.0]] * 5},
            {"parameters": [["nan", 0.1, 1.0]]},
            {"parameters": 5},
            {"unconstrained": [[0.1, 0.1, 1.0]] * 2},
            {"surrogate.gaps": np.zeros((300, 1))},
            {"surrogate.time": np.zeros(300)},
            {"surrogate.speeds": np.full((601, 2), np.nan)},
            {"history": {}},
            {"config": 5},
            {"loss": None},
            {"loss": {"total": "much"}},
            {"iterations": "x"},
            {"seconds": None},
            {"notes": 5},
            {"active_bounds": 5},
            {"active_bounds": []},
            {"outcome": "UNKNOWN"},
            {"more": 1},
        ],
        ids=str,
    )
    def test_a_result_of_another_shape_is_set_aside(
        self, store: Store, change: dict[str, Any]
    ) -> None:
        def write(changed: dict[str, Any]) -> None:
            tree, arrays = dump(replace(trained(), cached=False))
            for name, value in changed.items():
                (arrays if isinstance(value, np.ndarray) else tree)[name] = value
            text = np.frombuffer(write_json(tree), np.uint8)
            store._write(f"{KEY}.fit.npz", arrays | {"fit": text})

        write({})
        assert store.load_fit(KEY, driven()) is not None
        write(change)
        assert "set aside" in refused(store, "fit")
