"""Results and checkpoints on disk, found by the content of the request that made them.

A file is a zip of plain arrays (`.npz`, never unpickled), written beside its place and moved
there in one step, so that a killed process leaves the old file or the new one. What cannot be
read is set aside under another name, and said. The folder has a cap; what was not used for the
longest time goes first.
"""

import os
import tempfile
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from accpinn.fit import Fit
from accpinn.packing import Arrays, pack_fit, require_match, unpack_fit
from accpinn.segment import Segment

FORMAT = "accpinn store 1"
CAP_BYTES = 500_000_000
"""Of the whole folder; a result and its checkpoint for 300 s of data take about 0.4 MB."""
FOLDER_VARIABLE = "ACCPINN_CACHE"
"""Environment variable that names another folder than the user's cache."""


class Store:
    """A folder of results (`load_fit`, `save_fit`) and checkpoints (`load_state`, `save_state`)."""

    def __init__(self, folder: Path | None = None, cap_bytes: int = CAP_BYTES) -> None:
        """By default in the user's cache folder; it is made when first written to."""
        named = os.environ.get(FOLDER_VARIABLE)
        self.folder = folder or (Path(named) if named else user_cache_path("accpinn"))
        self.cap_bytes = cap_bytes
        self.messages: list[str] = []
        """What the user should know of files that were set aside or could not be written."""

    def load_fit(self, key: str, segment: Segment) -> Fit | None:
        """The result stored under ``key``, or None where there is none that fits ``segment``."""
        arrays = self._read(f"{key}.fit.npz")
        if arrays is None:
            return None
        try:
            fit = unpack_fit(arrays)
            require_match(fit, segment)
            return fit
        except (KeyError, ValueError, TypeError, AttributeError, IndexError) as fault:
            self._set_aside(self.folder / f"{key}.fit.npz", fault)
            return None

    def has_fit(self, key: str) -> bool:
        """Whether a result stands under ``key``, unread."""
        return (self.folder / f"{key}.fit.npz").is_file()

    def save_fit(self, key: str, fit: Fit) -> None:
        """Keep a result."""
        self._write(f"{key}.fit.npz", pack_fit(fit))

    def load_state(self, key: str) -> Arrays | None:
        """The checkpoint stored under ``key``, or None."""
        return self._read(f"{key}.state.npz")

    def save_state(self, key: str, state: Arrays) -> None:
        """Keep a checkpoint in place of the former one."""
        self._write(f"{key}.state.npz", state)

    def drop_state(self, key: str) -> None:
        """Delete the checkpoint stored under ``key``, if there is one."""
        with suppress(OSError):
            (self.folder / f"{key}.state.npz").unlink(missing_ok=True)

    def reject_state(self, key: str, fault: Exception) -> None:
        """Set the checkpoint aside: it could be read, but no training can go on from it."""
        self._set_aside(self.folder / f"{key}.state.npz", fault)

    def _read(self, name: str) -> Arrays | None:
        path = self.folder / name
        try:
            if path.stat().st_size > self.cap_bytes:
                raise ValueError("larger than the whole store may be")
            arrays = _arrays_in(path)
            if str(arrays.pop("store.format", "")) != FORMAT:
                raise ValueError("not written by this version's store")
            if str(arrays.pop("store.name", "")) != name:
                raise ValueError("it belongs to another request")
        except (FileNotFoundError, NotADirectoryError):  # the latter is said when writing
            return None
        except Exception as fault:  # zip and array parsers raise many kinds for foreign bytes
            self._set_aside(path, fault)
            return None
        with suppress(OSError):  # another's folder may be read, but its files not touched
            os.utime(path)
        return arrays

    def _write(self, name: str, arrays: Arrays) -> None:
        marked = arrays | {"store.format": np.array(FORMAT), "store.name": np.array(name)}
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=self.folder, suffix=".part")
            try:
                with os.fdopen(handle, "wb") as file:
                    np.savez(file, **marked)
                    file.flush()
                    os.fsync(file.fileno())
                os.replace(temporary, self.folder / name)
            except BaseException:
                Path(temporary).unlink(missing_ok=True)
                raise
        except OSError as fault:
            exists = isinstance(fault, FileExistsError | NotADirectoryError)
            reason = "this is no folder" if exists else fault.strerror
            self.messages.append(
                f"{self.folder}: the result could not be kept ({reason}); free some space"
                f" or name another folder in {FOLDER_VARIABLE}."
            )
            return
        self._make_room(keep=name)

    def _set_aside(self, path: Path, fault: Exception) -> None:
        aside = path.with_name(path.name + ".damaged")
        try:
            os.replace(path, aside)
            where = f"it has been set aside as {aside.name}"
        except OSError:
            where = "it is ignored"
        self.messages.append(
            f"{path.name} in {path.parent} cannot be used ({str(fault)[:80]}); {where}, and the"
            " training starts anew."
        )

    def _make_room(self, keep: str) -> None:
        """Delete what was not used for the longest time until the cap holds."""
        files = []
        for pattern in ("*.npz*", "*.part"):  # a killed process leaves a .part
            for path in self.folder.glob(pattern):
                with suppress(OSError):  # another process was quicker
                    status = path.stat()
                    files.append((status.st_mtime, status.st_size, path))
        total = sum(size for _, size, _ in files)
        for _, size, path in sorted(files):
            if total <= self.cap_bytes:
                return
            if path.name != keep:
                with suppress(OSError):
                    path.unlink()
                    total -= size


def _arrays_in(path: Path) -> Arrays:
    """All arrays of an `.npz` file; anything that would need unpickling is refused."""
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > CAP_BYTES:
            raise ValueError("it would unpack to more than the whole store may hold")
    with np.load(path, allow_pickle=False) as file:
        return {key: file[key] for key in file.files}
