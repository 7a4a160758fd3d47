"""Kills, full disks, folders that go away, and two servers at once.

Each fault meets a process of its own where it must: a child of this one, which is quick. What had
been confirmed is there afterwards, and whoever asked gets one sentence. Further ones stand beside
what they are about: a kill in mid-training (cli), in mid-batch (study), failing writes (storage).
"""

import os
import shutil
import signal
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from accpinn import AccpinnError, Library, Result, Store, load
from accpinn.recordings import download as downloads
from accpinn.recordings.openacc import Run
from accpinn.study.snapshot import save
from accpinn.study.studies import Computed, read_rows, written
from tests.support.openacc_files import csv, platoon
from tests.support.publisher import publisher
from tests.support.snapshots import numbered, small, small_bytes
from tests.support.studies import REQUEST, analysis, row

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no children")

LIMIT = 1000
"""Bytes after which a child's disk is full; less than any file here has."""
RUN = Run("Casale", "part2.csv", None)


def child(action: Callable[[], Any], *, disk: int = 0) -> tuple[int, str]:
    """Run it in a child; how that ended (minus the signal that killed it), and what it said.

    Args:
        action: what to do; what it returns, or the sentence of its error, is what it says.
        disk: bytes that a file may have at most, as if the disk were full then; 0 for any number.
    """
    return ended(*begun(action, disk))


def begun(action: Callable[[], Any], disk: int = 0) -> tuple[int, int]:
    """A child that has begun, to be given to `ended`."""
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of other threads
        number = os.fork()
    if number == 0:
        status = 70
        try:
            if disk:
                import resource

                resource.setrlimit(resource.RLIMIT_FSIZE, (disk, resource.RLIM_INFINITY))
            try:
                said, status = action(), 0
            except AccpinnError as fault:
                said, status = str(fault), 1
            os.write(writing, str(said or "").encode()[:60_000])
        finally:
            os._exit(status)
    os.close(writing)
    return number, reading


def ended(number: int, reading: int) -> tuple[int, str]:
    """What came of it."""
    with os.fdopen(reading, "rb") as pipe:
        said = pipe.read().decode()
    _, status = os.waitpid(number, 0)
    return os.waitstatus_to_exitcode(status), said


def die(*_: object, **__: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def is_sentence(said: str) -> bool:
    return said.endswith(".") and "\n" not in said and len(said) < 500


def known(store: Store) -> Result:
    """The small result as the store has it."""
    result = store.find(small().analysis, pytest.fail)
    assert result is not None
    return result


def confirmed(library: Library) -> list[str]:
    assert not [entry.fault for entry in library.entries() if entry.fault]
    return sorted(entry.name for entry in library.entries())


def test_a_kill_in_mid_download_leaves_no_file_and_the_next_call_fetches_it(tmp_path: Path) -> None:
    content = csv(platoon(2, 1500))

    def fetch(**options: Any) -> list[downloads.Download]:
        return list(downloads.download([RUN], tmp_path, server.url, **options))

    with publisher({RUN.key: content}) as server:
        assert child(lambda: fetch(on_transfer=die))[0] == -signal.SIGKILL
        assert not RUN.path(tmp_path).exists()
        [done] = fetch()
        assert done.path.read_bytes() == content


class TestFullDisk:
    def test_nothing_is_lost_and_one_sentence_says_so(self, tmp_path: Path) -> None:
        store, library = Store(tmp_path / "cache"), Library(tmp_path / "library")
        file = save(small(), tmp_path / "a.accpinn.zip")
        library.add(small())
        store.keep(small())
        other = replace(small(), name="other")
        heard: list[str] = []

        def told() -> str:
            store.keep(other, heard.append)
            return heard[0]

        for action in (lambda: save(other, file), lambda: library.add(other), told):
            status, said = child(action, disk=LIMIT)
            assert status in (0, 1)
            assert is_sentence(said)
            assert "File too large" in said
            assert "free some space" in said
        assert load(file).name == "small"
        assert confirmed(Library(library.folder)) == ["small"]
        assert known(store).name == "small"
        assert not [*tmp_path.rglob("*.part")]

    def test_a_batch_keeps_what_it_had_and_goes_on(self, tmp_path: Path) -> None:
        def work() -> None:
            with written(tmp_path, REQUEST) as study:
                for k in range(100):
                    study.add("a.csv", Computed(analysis(60.0 * k), [row("x" * 200)]))

        status, said = child(work, disk=50_000)
        assert status == 1
        assert is_sentence(said)
        assert "the same call again" in said
        kept = len(list(read_rows(tmp_path)))
        assert kept > 2
        with written(tmp_path, REQUEST) as study:
            known = [study.rows_of(analysis(60.0 * k)) for k in range(100)]
        assert known == [1] * kept + [None] * (100 - kept)

    def test_a_download_says_so_and_leaves_no_part(self, tmp_path: Path) -> None:
        content = csv(platoon(2, 1500))
        with publisher({RUN.key: content}) as server:

            def fetch() -> str:
                [found] = downloads.download([RUN], tmp_path, server.url)
                return found.reason

            status, said = child(fetch, disk=LIMIT)
            assert (status, is_sentence(said)) == (0, True)
            assert "cannot be written" in said
            assert not [*RUN.path(tmp_path).parent.iterdir()]
            assert fetch() == ""
        assert RUN.path(tmp_path).read_bytes() == content


class TestFolders:
    @pytest.mark.skipif(sys.platform != "linux", reason="needs a place where nobody may write")
    def test_a_cache_that_cannot_be_written_to_costs_a_sentence(self) -> None:
        heard: list[str] = []
        store = Store(Path("/proc/accpinn"))
        store.keep(small(), heard.append)
        assert store.find(small().analysis, heard.append) is None
        assert store.entries() == ()
        (said,) = heard
        assert is_sentence(said)
        assert "ACCPINN_CACHE" in said
        with pytest.raises(AccpinnError, match="cannot be kept there"):
            Library(Path("/proc/accpinn")).add(small())

    def test_folders_that_vanish_are_made_again(self, tmp_path: Path) -> None:
        store, library = Store(tmp_path / "cache"), Library(tmp_path / "library")
        for _ in range(2):
            store.keep(small(), pytest.fail)
            name = library.add(small())
            assert known(store).name == "small"
            assert confirmed(library) == ["small"]
            shutil.rmtree(store.folder)
            shutil.rmtree(library.folder)
            assert store.find(small().analysis, pytest.fail) is None
            assert library.entries() == ()
            with pytest.raises(AccpinnError, match="may have been deleted"):
                library.read(name)
            library.delete(name)


def test_two_servers_on_one_cache_read_whole_results_or_none(tmp_path: Path) -> None:
    """One writes and makes room without end while the other reads."""
    size = 3 * len(small_bytes())

    def write() -> str:
        store, heard = Store(tmp_path, cap_bytes=size), list[str]()
        for k in range(60):
            store.keep(numbered(k % 5), heard.append)
        return " ".join(heard)

    def read() -> str:
        store, heard, found = Store(tmp_path, cap_bytes=size), list[str](), 0
        end = time.monotonic() + 60.0
        while found < 40 and time.monotonic() < end:
            for k in range(5):
                result = store.find(numbered(k).analysis, heard.append)
                if result is not None:
                    found += 1
                    assert result.parameters == small().parameters
            assert len(store.entries()) <= 5
        return " ".join(heard) or f"{found >= 40}"

    write()
    other = begun(write)
    assert read() == "True"
    assert ended(*other) == (0, "")
