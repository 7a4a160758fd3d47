"""Where the package keeps its files, and how it writes them: whole or not at all.

    with reported(lambda reason: SnapshotError(f"{path}: it could not be written ({reason}).")):
        write_whole(path, content)

A file is written beside its place under a name of its own and moved there in one step, so that a
reader, or a process that is killed, sees the old file or the new one and never a part of either.
"""

import csv
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import IO, Literal

from platformdirs import user_cache_path, user_data_path

UNFINISHED = ".part"
"""Ending of a file that is being written; a killed process leaves it behind."""

FolderName = Literal["cache", "snapshots", "recordings", "studies", "mappings"]


def variable(name: FolderName) -> str:
    """The environment variable that names a folder, as "ACCPINN_CACHE"."""
    return f"ACCPINN_{name.upper()}"


def folder(name: FolderName) -> Path:
    """The folder that the environment names, or else one among the user's; it need not exist."""
    named = os.environ.get(variable(name))
    if named:
        return Path(named)
    return user_cache_path("accpinn") if name == "cache" else user_data_path("accpinn") / name


def packaged_rows(room: str, name: str) -> Iterator[dict[str, str]]:
    """The rows of a table that comes with the package, as "makes.csv" in ``recordings``."""
    text = files("accpinn").joinpath(room, name).read_text(encoding="utf-8")
    return csv.DictReader(text.split("\n"))


def shipped(name: str) -> Path:
    """A file or folder that comes with the program, as "sample_data" or "app.py".

    In a checkout these stand at its top level, in an installed package within it.
    """
    package = Path(__file__).parent
    installed = {"sample_data": package / name}.get(name, package / "app" / name)
    return installed if installed.exists() else package.parent / name


@contextmanager
def written_whole(path: Path) -> Iterator[IO[bytes]]:
    """Open a file to write that takes the place of ``path`` once the block has ended well.

    Its folder exists, and the user's umask says who may read it. Where the block or the disk fails,
    the temporary file is removed and the old one stays as it was.

    Raises:
        OSError: when it cannot be written.
    """
    temporary = path.with_name(f".{os.urandom(8).hex()}{UNFINISHED}")
    try:
        with temporary.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_whole(path: Path, content: bytes) -> None:
    """Write a file in one step; see `written_whole`."""
    with written_whole(path) as file:
        file.write(content)


def reason_of(fault: BaseException) -> str:
    """Why a file could not be opened, read or written, in the system's words."""
    if isinstance(fault, ValueError):  # as a path with a NUL
        return "no valid path"
    return getattr(fault, "strerror", None) or "no reason given"


@contextmanager
def reported(sentence: Callable[[str], Exception]) -> Iterator[None]:
    """Turn a fault of the file system, or of a path, within the block into one for the user.

    ``sentence`` makes the error, as an AccpinnError, of the reason.
    """
    try:
        yield
    except (OSError, ValueError, RuntimeError) as fault:  # also for links that run in a circle
        raise sentence(reason_of(fault)) from None
