"""The library of a server's snapshots, by the first digits of their digests.

A shelf (`store.py`) that loses nothing: it refuses what it has no room for, and only a user
deletes, which for a day can be undone. Beside a snapshot stands how this library's own server
verified it. That is bound to the checksum of the file and to the version of accpinn, so that
neither a changed file nor another version has it; what a file says of itself is no evidence.
"""

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import msgspec

from accpinn import __version__
from accpinn.arguments import checked_method
from accpinn.errors import SnapshotError
from accpinn.serial import dump, restore
from accpinn.storage import UNFINISHED, folder, reported, variable, write_whole
from accpinn.study.result import Result
from accpinn.study.snapshot import SUFFIX, load, to_bytes, write_file
from accpinn.study.store import (
    ABANDONED,
    DELETED,
    Entry,
    Shelf,
    owner_path,
    state_of,
    unknown,
    write_owner,
)
from accpinn.study.verification import Verification
from accpinn.units import Seconds

VERIFIED = ".verified"
"""Ending of the file beside a snapshot that says how it was verified."""
RESTORABLE: Seconds = 24 * 3600.0
UNDONE = 20
"""Snapshots deleted last, which can be brought back for longer."""
LIBRARY_BYTES, LIBRARY_COUNT = 2_000_000_000, 1000
"""Caps on the library; a result of 300 s takes about 0.5 MB."""


@dataclass(frozen=True)
class KeptVerification:
    """A verification, and the file that it is of."""

    sha256: str
    """Checksum of the snapshot's file."""
    state: str
    """Time and size of that file: the checksum is computed anew only where they changed."""
    verification: Verification


class Library(Shelf):
    """The snapshots of a server, each under the first digits of its digest."""

    @checked_method
    def __init__(
        self,
        place: str | os.PathLike[str] | None = None,
        cap_bytes: int = LIBRARY_BYTES,
        cap_count: int = LIBRARY_COUNT,
    ) -> None:
        """Open the library of a folder, by default among the user's data."""
        super().__init__(folder("snapshots") if place is None else Path(place), cap_bytes)
        self.cap_count = cap_count

    def add(self, content: Result | bytes, owner: str = "") -> str:
        """Keep a snapshot; its short name.

        Of the bytes of a file is kept what was read, written anew: a file that others made is like
        one of this program. The owner is a digest of who saves it; one that is there already stays
        whose it was.

        Raises:
            SnapshotError: for damaged bytes, a full library, or a folder that cannot be written to.
        """
        data = to_bytes(load(content) if isinstance(content, bytes) else content)
        result = load(data)
        name, path = result.id, self.path(result.id)
        with suppress(SnapshotError):  # a damaged one is mended
            if path.exists() and self.read(name):
                return name
        sentence = "{}: the snapshot cannot be kept there ({}); name another folder in {}."
        place = variable("snapshots")
        with reported(lambda reason: SnapshotError(sentence.format(self.folder, reason, place))):
            self.folder.mkdir(parents=True, exist_ok=True)
        self._sweep()
        self._check_room(len(data))
        with reported(lambda reason: SnapshotError(sentence.format(self.folder, reason, place))):
            if not path.exists():  # whose an equal one was that was deleted counts no more
                owner_path(path).unlink(missing_ok=True)
            write_owner(path, owner)
        write_file(data, path, "snapshot")
        with suppress(OSError):
            state, entry = state_of(path), Entry.of(name, result)
            self._transact(lambda index: self._enter(index, entry, state))
        return name

    def readable(self, words: str = "") -> tuple[Entry, ...]:
        """The snapshots that can be read, the newest first."""
        return tuple(entry for entry in self.entries(words) if not entry.fault)

    def read(self, name: str) -> Result:
        """The snapshot of that short name; see `Shelf.read`."""
        result = load(self.raw(name))
        if result.id != name:
            raise SnapshotError(
                f"Snapshot {name} is damaged: its file holds {result.id}; get the file anew."
            )
        return result

    def delete(self, name: str) -> None:
        """Remove one, damaged or not; nothing happens where another did so already.

        For a day `restore` brings it back.
        """
        path = self.path(name)
        sentence = "Snapshot {} cannot be deleted ({}); check who may write to {}."
        with (
            reported(lambda reason: SnapshotError(sentence.format(name, reason, self.folder))),
            suppress(FileNotFoundError),
        ):
            os.replace(path, path.with_suffix(DELETED))
            os.utime(path.with_suffix(DELETED))

    def restore(self, name: str) -> None:
        """Bring back one that was deleted.

        Raises:
            SnapshotError: where it is gone for good, or the library is full.
        """
        path = self.path(name)
        deleted = path.with_suffix(DELETED)
        if path.exists():
            return
        if not deleted.exists():
            raise unknown(name)
        self._check_room(deleted.stat().st_size)
        os.replace(deleted, path)

    def verification(self, name: str) -> Verification | None:
        """Verification of a snapshot here; None for one not verified, or changed since."""
        path = self.path(name)
        try:
            tree = msgspec.json.decode(_verified_path(path).read_bytes())
            stored = restore(KeptVerification, tree, {})
            is_same = state_of(path) == stored.state or _checksum(path) == stored.sha256
        except (OSError, ValueError, TypeError):
            return None
        is_valid = is_same and stored.verification.accpinn == __version__
        return stored.verification if is_valid else None

    def keep_verification(self, result: Result, verification: Verification) -> None:
        """Keep how a snapshot was verified; nothing happens where that cannot be written.

        A failure takes the place of whatever stands there, anything else that of what compared
        no more numbers; nothing is kept of one that compared none. A file that was changed or
        deleted meanwhile gets nothing.
        """
        path, earlier = self.path(result.id), self.verification(result.id)
        least = earlier.numbers if earlier else 1
        if verification.ok is not False and verification.numbers < least:
            return
        with suppress(OSError, SnapshotError):
            state, checksum = state_of(path), _checksum(path)
            if self.read(result.id).digest == result.digest:
                entry = KeptVerification(checksum, state, verification)
                write_whole(_verified_path(path), msgspec.json.encode(dump(entry)[0]))

    def _sweep(self) -> None:
        """Remove what was deleted long ago, and what killed processes have left behind.

        What was deleted last stays in any case: a clock that is wrong ends no undo.
        """
        for ending, age, newest in ((UNFINISHED, ABANDONED, 0), (DELETED, RESTORABLE, UNDONE)):
            times: list[tuple[float, Path]] = []
            with suppress(OSError):  # another process swept it just now
                times = [(path.stat().st_mtime, path) for path in self.folder.glob(f"*{ending}")]
            for changed, path in sorted(times)[: len(times) - newest]:
                with suppress(OSError):
                    if time.time() - changed > age:
                        path.unlink()
                        snapshot = path.with_suffix(Path(SUFFIX).suffix)
                        if not snapshot.exists():
                            owner_path(snapshot).unlink(missing_ok=True)
                            _verified_path(snapshot).unlink(missing_ok=True)

    def _check_room(self, size: int) -> None:
        sizes = []
        for path in self._files():
            with suppress(OSError):  # deleted just now
                sizes.append(path.stat().st_size)
        if len(sizes) >= self.cap_count or sum(sizes) + size > self.cap_bytes:
            raise SnapshotError(
                f"The server's library of snapshots is full ({len(sizes):,} snapshots,"
                f" {sum(sizes) / 1e6:.0f} MB); delete some that are no longer needed, then save"
                " again."
            )


def _verified_path(path: Path) -> Path:
    return path.with_name(f"{path.name}{VERIFIED}")


def _checksum(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()
