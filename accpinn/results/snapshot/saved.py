"""Snapshots on disk: files written in one step, and a library in which nothing is ever lost.

The library is a folder of the server. A snapshot lies there under the first digits of its own
digest, so that a link to it names what it holds. A full library refuses new ones; only a user
deletes. Files that cannot be read are listed with the reason.
"""

import os
import re
import secrets
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock
from platformdirs import user_data_path

from accpinn.errors import SnapshotError
from accpinn.results.snapshot import ID_LENGTH, MANIFEST, SUFFIX, Snapshot
from accpinn.results.snapshot.archive import load, read_file, to_bytes
from accpinn.results.tables.estimates import supported_columns
from accpinn.units import Seconds

UNFINISHED = ".part"
"""Ending of a file that is being written."""
MARKS = {
    "snapshot": MANIFEST.encode(),
    "report": b"<!doctype html",
    "file for SUMO": b"car-following model acc as the cthp",
}
"""What stands among the first bytes of every such file, in lower case."""
_BEGINNING = 200

CAP_BYTES = 2_000_000_000
"""Of the whole library; a result of 300 s without its data takes well below 1 MB."""
CAP_COUNT = 1000
DELETED = ".deleted"
"""Ending of a file that can still be brought back."""
RESTORABLE: Seconds = 24 * 3600.0
ABANDONED: Seconds = 3600.0
"""A file that was begun so long ago is nobody's any more."""
LOCK = ".lock"
PATIENCE: Seconds = 30.0
"""For others who are writing; a file takes well below a second."""
FOLDER_VARIABLE = "ACCPINN_SNAPSHOTS"
"""Environment variable that names another folder than the one among the user's data."""

_ID = re.compile(rf"[0-9a-f]{{{ID_LENGTH}}}")


def save(snapshot: Snapshot, path: str | os.PathLike[str]) -> Path:
    """Write a snapshot in one step: whoever looks sees the old file or the new one, never a part.

    Raises:
        SnapshotError: when it cannot be written there, or what stands there is no snapshot.
    """
    target, data = writable_path(Path(path), "snapshot"), to_bytes(snapshot)
    load(data)  # what could not be opened again is not written
    write_whole(data, target, "snapshot")
    return Path(path)


def writable_path(target: Path, kind: str) -> Path:
    """The file that is made, or replaced, by writing to ``target``; links are followed.

    Args:
        target: where a user wants the file.
        kind: a key of `MARKS`; nothing is replaced but a file of its own kind.

    Raises:
        SnapshotError: where something else stands, or no file can be made.
    """
    try:
        path = target.resolve() if target.is_symlink() else target
        with suppress(FileNotFoundError):
            _require_own(path, kind)
        with tempfile.TemporaryFile(dir=path.parent):
            return path
    except (OSError, ValueError, RuntimeError) as fault:  # also for links that run in a circle
        raise _unwritten(
            target, kind, getattr(fault, "strerror", None) or "no valid path"
        ) from None


def _require_own(path: Path, kind: str) -> None:
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise SnapshotError(f"{path}: this is a folder; name a file in it for the {kind}.")
    if stat.S_ISREG(mode):
        with path.open("rb") as file:
            beginning = file.read(_BEGINNING).lower()
        if not beginning or MARKS[kind] in beginning:
            return
    raise SnapshotError(
        f"{path}: this is something else than a {kind} and is not overwritten; choose another name."
    )


def write_whole(data: bytes, target: Path, kind: str) -> Path:
    """Write bytes as the file ``target``, in one step; ``kind`` names them where that fails.

    Raises:
        SnapshotError: when it cannot be written there.
    """
    try:
        temporary = target.with_name(f"{secrets.token_hex(8)}{UNFINISHED}")
        try:
            with temporary.open("xb") as file:  # so who may read it follows the user's umask
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, target)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    except OSError as fault:
        raise _unwritten(target, kind, fault.strerror or "no reason given") from None
    return target


def _unwritten(target: Path, kind: str, reason: str) -> SnapshotError:
    return SnapshotError(
        f"{target}: the {kind} could not be written ({reason}); choose another place or"
        " free some space."
    )


@dataclass(frozen=True)
class Entry:
    """What a list of snapshots shows of one."""

    id: str
    size: int
    """Bytes."""
    name: str = ""
    note: str = ""
    created: str = ""
    """ISO 8601 in UTC."""
    source: str = ""
    """File name of the recording."""
    campaign: str = ""
    """Of the recording; empty where it is not known."""
    window: str = ""
    """As "0-300 s"."""
    vehicles: tuple[str, ...] = ()
    """Labels, leader first."""
    numbers: tuple[int, ...] = ()
    """The vehicles' numbers in the file."""
    method: str = ""
    case: str = ""
    parameters: tuple[tuple[float, float, float], ...] = ()
    """α [1/s²], β [1/s], τ [s] of each follower."""
    digits: tuple[int, ...] = ()
    """Of α, β, τ after the point: as many as their intervals support."""
    with_data: bool = False
    """Whether speeds and gaps of the window are in it."""
    fault: str = ""
    """Why it cannot be read; empty where it can."""


class Library:
    """A folder of snapshots, each found by its short name; see the module's head."""

    def __init__(
        self, folder: Path | None = None, cap_bytes: int = CAP_BYTES, cap_count: int = CAP_COUNT
    ) -> None:
        """By default among the user's data; the folder is made when first written to."""
        named = os.environ.get(FOLDER_VARIABLE)
        standard = Path(named) if named else user_data_path("accpinn") / "snapshots"
        self.folder = folder or standard
        self.cap_bytes, self.cap_count = cap_bytes, cap_count
        self._known: dict[str, tuple[tuple[int, int], Entry]] = {}

    def add(self, content: Snapshot | bytes) -> str:
        """Keep a snapshot, or the bytes of one, once they are known to be whole; its short name.

        Raises:
            SnapshotError: for damaged bytes, a full library, or a folder that cannot be written to.
        """
        data = content if isinstance(content, bytes) else to_bytes(content)
        name = load(data).id
        with self._alone():
            path = self._path(name)
            if path.exists() and path.read_bytes() == data:
                return name
            if not self._read(name, 0).fault:  # a damaged one is mended
                raise SnapshotError(
                    f"Another snapshot has the short name {name}; change the name or note of this"
                    " one, and save it again."
                )
            self._sweep()
            self._check_room(len(data))
            write_whole(data, path, "snapshot")
        return name

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """No other session or process writes here, so that room found for one is not taken."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            lock = FileLock(self.folder / LOCK, timeout=PATIENCE)
            lock.acquire()
        except OSError as fault:  # a timeout is one, too
            raise SnapshotError(
                f"{self.folder}: the snapshot cannot be kept there"
                f" ({fault.strerror or 'others are writing'}); name another folder in"
                f" {FOLDER_VARIABLE}."
            ) from None
        try:
            yield
        finally:
            lock.release()

    def _sweep(self) -> None:
        """Remove what was deleted long ago, and what killed processes have left behind."""
        for ending, kept in ((UNFINISHED, ABANDONED), (DELETED, RESTORABLE)):
            for path in self.folder.glob(f"*{ending}"):
                with suppress(OSError):  # another process swept it just now
                    if time.time() - path.stat().st_mtime > kept:
                        path.unlink()

    def entries(self) -> tuple[Entry, ...]:
        """All, the newest first, damaged ones last; a file is read again once it changed."""
        found = []
        for path in (paths := self._files()):
            with suppress(OSError):  # deleted by another process just now
                entry = self._entry(path)
                found.append((entry.created, path.stat().st_mtime_ns, entry.id, entry))
        there = {path.name for path in paths}
        self._known = {name: known for name, known in self._known.copy().items() if name in there}
        return tuple(entry for *_, entry in sorted(found, reverse=True))

    def readable(self) -> tuple[Entry, ...]:
        """Those that can be read, the newest first."""
        return tuple(entry for entry in self.entries() if not entry.fault)

    def open(self, name: str) -> Snapshot:
        """The snapshot of that short name.

        Raises:
            SnapshotError: for an unknown name, or a file that is damaged or another's.
        """
        found = load(self.raw(name))
        if found.id != name:
            raise SnapshotError(
                f"Snapshot {name} is damaged: its file holds {found.id}; get the file anew."
            )
        return found

    def has(self, name: str) -> bool:
        """Whether a file of that short name is there, damaged or not."""
        return bool(_ID.fullmatch(name)) and self._path(name).exists()

    def raw(self, name: str) -> bytes:
        """The file of that short name, to be downloaded.

        Raises:
            SnapshotError: for an unknown name.
        """
        path = self._path(name)
        if not path.exists():
            raise _unknown(name)
        return read_file(path)

    def delete(self, name: str) -> None:
        """Remove one, damaged or not; nothing happens where another did so already.

        For a day `restore` brings it back.
        """
        try:
            path = self._path(name)
            with suppress(FileNotFoundError):
                os.replace(path, path.with_suffix(DELETED))
                os.utime(path.with_suffix(DELETED))
        except OSError as fault:
            raise SnapshotError(
                f"Snapshot {name} cannot be deleted ({fault.strerror}); check who may write to"
                f" {self.folder}."
            ) from None

    def restore(self, name: str) -> None:
        """Bring back one that was deleted.

        Raises:
            SnapshotError: where it is gone for good, or the library is full.
        """
        path = self._path(name)
        deleted = path.with_suffix(DELETED)
        with self._alone():
            if path.exists():
                return
            if not deleted.exists():
                raise _unknown(name)
            self._check_room(deleted.stat().st_size)
            os.replace(deleted, path)

    def _path(self, name: str) -> Path:
        """Where it lies; a name that is none never becomes a path."""
        if not _ID.fullmatch(name):
            raise _unknown(name)
        return self.folder / f"{name}{SUFFIX}"

    def _files(self) -> list[Path]:
        return [
            path
            for path in self.folder.glob(f"*{SUFFIX}")
            if _ID.fullmatch(path.name.removesuffix(SUFFIX))
        ]

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

    def _entry(self, path: Path) -> Entry:
        status = path.stat()
        state = (status.st_mtime_ns, status.st_size)
        known = self._known.get(path.name)
        if known is None or known[0] != state:
            known = (state, self._read(path.name.removesuffix(SUFFIX), status.st_size))
            self._known[path.name] = known
        return known[1]

    def _read(self, name: str, size: int) -> Entry:
        try:
            snapshot = self.open(name)
        except SnapshotError as fault:
            return Entry(name, size, fault=str(fault))
        return Entry(
            id=name,
            size=size,
            name=snapshot.name,
            note=snapshot.note,
            created=snapshot.created,
            source=snapshot.info.source,
            campaign=snapshot.facts.get("campaign") or "",
            window=f"{snapshot.info.window}",
            vehicles=snapshot.info.labels,
            numbers=snapshot.info.vehicles,
            method=snapshot.fit.method,
            case=snapshot.fit.case,
            parameters=tuple((p.alpha, p.beta, p.tau) for p in snapshot.fit.parameters),
            digits=tuple(one.digits or 0 for one in supported_columns(snapshot.uncertainty)),
            with_data=snapshot.segment is not None,
        )


def _unknown(name: str) -> SnapshotError:
    return SnapshotError(
        f"There is no snapshot {name[:40]} on this server; it may have been deleted, or the link"
        " belongs to another server."
    )
