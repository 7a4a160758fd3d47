"""Results and checkpoints on disk, found by the content of the request that made them.

A file is a zip of plain arrays (`.npz`, never unpickled), written beside its place and moved
there in one step, so that a killed process leaves the old file or the new one. What was read and
is wrong is set aside under another name, and said; without a way to say it, it stays where it is
for a caller who has one. The folder has a cap; what was not used for the longest time goes first.
"""

import io
import os
import tempfile
import time
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from accpinn.methods.fit import Fit
from accpinn.segment.segment import Segment
from accpinn.serial import Arrays, Shape, check_shapes, dump, read_json, restore, write_json
from accpinn.units import Seconds

FORMAT = "accpinn store 2"
CLOCK_SLACK: Seconds = 60.0
"""By so much the clocks of two machines that share the folder may differ."""
CAP_BYTES = 500_000_000
"""Of the whole folder; a result and its checkpoint for 300 s of data take about 0.4 MB."""
FOLDER_VARIABLE = "ACCPINN_CACHE"
"""Environment variable that names another folder than the user's cache."""

FIT_SHAPES = {
    "Fit.parameters": Shape("M", 3),
    "Fit.unconstrained": Shape("M", 3),
    "Fit.active_bounds": Shape("M"),
    "Fit.arrays": Shape(finite=True),
    "Trajectories.time": Shape("N", finite=True),
    "Trajectories.speeds": Shape("N", "V", finite=True),
    "Trajectories.gaps": Shape("N", "M", finite=True),
    "History.iteration": Shape("K", finite=True),
    "History.seconds": Shape("K", finite=True),
    "History.total": Shape("K", finite=True),
    "History.data": Shape("K", finite=True),
    "History.physics": Shape("K", finite=True),
    "History.initial": Shape("K", finite=True),
    "History.parameters": Shape("K", "P", 3, finite=True),
    "History.evidence": Shape("K", finite=True),
    "History.deviations": Shape("K", "P", 3),
    "ParameterTrack.time": Shape("K", finite=True),
    "ParameterTrack.parameters": Shape("K", "M", 3),
    "ParameterTrack.deviation": Shape("K", "M", 3),
}
"""N instants, M followers, V = M + 1 vehicles, K entries, P parameter sets (1 in Case I)."""

Say = Callable[[str], object]
"""Takes a sentence for the user: what was set aside, or could not be read or written."""


class Store:
    """A folder of results (`load_fit`, `save_fit`) and checkpoints (`load_state`, `save_state`)."""

    def __init__(self, folder: Path | None = None, cap_bytes: int = CAP_BYTES) -> None:
        """By default in the user's cache folder; it is made when first written to."""
        named = os.environ.get(FOLDER_VARIABLE)
        self.folder = folder or (Path(named) if named else user_cache_path("accpinn"))
        self.cap_bytes = cap_bytes

    def load_fit(self, key: str, segment: Segment, say: Say | None = None) -> Fit | None:
        """The result stored under ``key``, or None where there is none that fits ``segment``."""
        arrays = self._read(f"{key}.fit.npz", say)
        if arrays is None:
            return None
        try:
            text = arrays.pop("fit").tobytes()
            fit = restore(Fit, read_json(text), arrays)
            _check_match(fit, segment)
            return fit
        except (KeyError, ValueError) as fault:
            self._set_aside(f"{key}.fit.npz", fault, say)
            return None

    def has_fit(self, key: str) -> bool:
        """Whether a result stands under ``key``, unread."""
        return (self.folder / f"{key}.fit.npz").is_file()

    def save_fit(self, key: str, fit: Fit, say: Say | None = None) -> None:
        """Keep a result."""
        tree, arrays = dump(replace(fit, cached=False))
        text = np.frombuffer(write_json(tree), np.uint8)
        self._write(f"{key}.fit.npz", arrays | {"fit": text}, say)

    def load_state(self, key: str, say: Say | None = None) -> Arrays | None:
        """The checkpoint stored under ``key``, or None."""
        return self._read(f"{key}.state.npz", say)

    def save_state(self, key: str, state: Arrays, say: Say | None = None) -> None:
        """Keep a checkpoint in place of the former one."""
        self._write(f"{key}.state.npz", state, say)

    def drop_state(self, key: str) -> None:
        """Delete the checkpoint stored under ``key``, if there is one."""
        with suppress(OSError):
            (self.folder / f"{key}.state.npz").unlink(missing_ok=True)

    def reject_state(self, key: str, fault: Exception, say: Say) -> None:
        """Set the checkpoint aside: it could be read, but no training can go on from it."""
        self._set_aside(f"{key}.state.npz", fault, say)

    def _read(self, name: str, say: Say | None) -> Arrays | None:
        path = self.folder / name
        try:
            if path.stat().st_size > self.cap_bytes:
                raise ValueError("larger than the whole store may be")
            arrays = _arrays_in(path.read_bytes())
            if str(arrays.pop("store.format", "")) != FORMAT:
                raise ValueError("not written by this version's store")
            if str(arrays.pop("store.name", "")) != name:
                raise ValueError("it belongs to another request")
        except (FileNotFoundError, NotADirectoryError):  # the latter is said when writing
            return None
        except (OSError, MemoryError) as fault:  # it may be whole: another time will tell
            if say:
                say(
                    f"{name} in {self.folder} could not be read"
                    f" ({getattr(fault, 'strerror', None) or 'too little memory'}), so"
                    f" {_CONSEQUENCE[_kind(name)]}."
                )
            return None
        except Exception as fault:  # zip and array parsers raise many kinds for foreign bytes
            self._set_aside(name, fault, say)
            return None
        with suppress(OSError):  # another's folder may be read, but its files not touched
            os.utime(path)
        return arrays

    def _write(self, name: str, arrays: Arrays, say: Say | None = None) -> None:
        marked = arrays | {"store.format": np.array(FORMAT), "store.name": np.array(name)}
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=self.folder, suffix=".part")
            try:
                with os.fdopen(handle, "wb") as file:
                    np.savez(file, allow_pickle=False, **marked)
                    file.flush()
                    os.fsync(file.fileno())
                os.replace(temporary, self.folder / name)
            except BaseException:
                Path(temporary).unlink(missing_ok=True)
                raise
        except OSError as fault:
            exists = isinstance(fault, FileExistsError | NotADirectoryError)
            reason = "this is no folder" if exists else fault.strerror
            if say:
                say(
                    f"{self.folder}: the result could not be kept ({reason}); free some space"
                    f" or name another folder in {FOLDER_VARIABLE}."
                )
            return
        self._make_room(keep=name)

    def _set_aside(self, name: str, fault: Exception, say: Say | None) -> None:
        if say is None:
            return
        path, aside = self.folder / name, self.folder / f"{name}.damaged"
        try:
            os.replace(path, aside)
            where = f"it has been set aside as {aside.name}"
        except OSError:
            where = "it is ignored"
        say(
            f"{name} in {self.folder} cannot be used ({str(fault)[:80]}); {where}, and"
            f" {_CONSEQUENCE[_kind(name)]}."
        )

    def _make_room(self, keep: str) -> None:
        """Delete what was not used for the longest time until the cap holds.

        What was used in the future, as a clock that was put back since has it, goes first: else it
        would stay for ever, and the latest results would go.
        """
        files, now = [], time.time() + CLOCK_SLACK
        for pattern in ("*.npz*", "*.part"):  # a killed process leaves a .part
            for path in self.folder.glob(pattern):
                with suppress(OSError):  # another process was quicker
                    status = path.stat()
                    used = status.st_mtime
                    files.append((used <= now, used, status.st_size, path))
        total = sum(size for *_, size, _ in files)
        for *_, size, path in sorted(files):
            if total <= self.cap_bytes:
                return
            if path.name != keep:
                with suppress(OSError):
                    path.unlink()
                    total -= size


_CONSEQUENCE = {
    "fit": "what it held is computed again",
    "state": "the training does not go on from there",
}


def _kind(name: str) -> str:
    """Of a file: a key of `_CONSEQUENCE`."""
    return name.removesuffix(".npz").rpartition(".")[2]


def _check_match(fit: Fit, segment: Segment) -> None:
    """Refuse a result that is none of the segment's, or not finite."""
    count = segment.followers
    check_shapes(fit, FIT_SHAPES, {"N": segment.samples, "M": count, "V": count + 1})
    if not np.isfinite(fit.parameters.values[:, :2]).all():  # τ is nan where α = 0
        raise ValueError("its numbers are not finite")


def _arrays_in(content: bytes) -> Arrays:
    """All arrays of an `.npz` file; anything that would need unpickling is refused."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > CAP_BYTES:
            raise ValueError("it would unpack to more than the whole store may hold")
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        return {key: file[key] for key in file.files}
