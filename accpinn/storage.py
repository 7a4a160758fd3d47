"""Folders of the package's files, and writing that is complete or has no effect.

    with reported(lambda reason: SnapshotError(f"{path}: it could not be written ({reason}).")):
        write_whole(path, content)

A file is written beside its place under a name of its own and moved there in one step, so that a
reader, or a process that is killed, sees the old file or the new one and never a part of either.
"""

import csv
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import IO, Any, Literal

from platformdirs import user_cache_path, user_data_path

from accpinn.errors import ConfigError

UNFINISHED = ".part"
"""Ending of a file that is being written; a killed process leaves it behind."""

FolderName = Literal["cache", "snapshots", "recordings", "studies", "mappings"]


def variable(name: FolderName) -> str:
    """The environment variable that names a folder, as "ACCPINN_CACHE"."""
    return f"ACCPINN_{name.upper()}"


def folder(name: FolderName) -> Path:
    """The folder that the environment names, or else one among the user's; it need not exist.

    Raises:
        ConfigError: where neither is known, as for a user without a home.
    """
    named = os.environ.get(variable(name))
    if named:
        return Path(named)
    try:
        path = user_cache_path("accpinn") if name == "cache" else user_data_path("accpinn") / name
        if path.is_absolute():  # else "~" is left in it
            return path
    except (RuntimeError, KeyError):
        pass
    raise ConfigError(
        f"The folder of {name} is not known, as this user has no home folder; name it in"
        f" {variable(name)}, or set HOME."
    )


def is_text(path: str | os.PathLike[str]) -> bool:
    """Whether a path is text: names of files may be any bytes, which no document or table holds."""
    try:
        os.fspath(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def printable(path: str | os.PathLike[str]) -> str:
    """A path as text on one line, with a mark in place of all that is neither letter nor sign."""
    text = os.fspath(path).encode("utf-8", "surrogateescape").decode("utf-8", "replace")
    return "".join(letter if letter.isprintable() else "\ufffd" for letter in text)


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
    """Open a file to write that replaces ``path`` once the block has ended without an error.

    Its folder must exist; the user's umask sets who may read it. Where the block or the disk fails,
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


_EVALUATED = re.compile(r"\s*[=@+\-\t\r\n]")
_NUMBER = re.compile(r"[+-]?[\d.e]+")


def csv_cell(cell: Any) -> Any:
    """A cell of a CSV file that leaves: a text that a spreadsheet would evaluate is quoted."""
    if isinstance(cell, str) and _EVALUATED.match(cell) and not _NUMBER.fullmatch(cell):
        return f"'{cell}"
    return cell


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
