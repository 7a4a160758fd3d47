"""Several files handed over at once: zip archives unpacked, and what cannot be read refused.

What is taken obeys the limits of a single file, all files together: `LIMIT_BYTES` unpacked, and
`MOST_FILES`. Each file that is refused has one sentence. Texts that accompany the runs in a folder
of recordings are left out, as they are by a batch of that folder.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path, PurePosixPath

from accpinn.errors import AccpinnError, RecordingError
from accpinn.recordings import Recording
from accpinn.recordings.containers import (
    LIMIT_BYTES,
    WORKBOOK,
    ZIP,
    is_file,
    open_zip,
    zip_member,
)
from accpinn.recordings.files import read_all
from accpinn.recordings.source import excerpt
from accpinn.storage import printable, reported, write_whole
from accpinn.study.plan import ENDINGS, is_note
from accpinn.study.studies import DROPPED, StudyError

MOST_FILES = 200
NAME_LENGTH = 100


@dataclass(frozen=True)
class File:
    """A file that holds a recording."""

    path: PurePosixPath
    """Its name, below its folder where an archive tells it: that may name the campaign."""
    raw: bytes


@dataclass(frozen=True)
class Dropped:
    """Files that were handed over: those taken, and a sentence for each that was refused."""

    files: tuple[File, ...] = ()
    refused: tuple[str, ...] = ()
    """A sentence for each file that is not taken."""

    @property
    def nbytes(self) -> int:
        """Memory that they take, in bytes."""
        return sum(len(file.raw) for file in self.files)

    def save(self, study: Path) -> tuple[str, ...]:
        """Write the files to a study's folder, in which a batch reads them; returns where.

        Raises:
            StudyError: where they cannot be written.
        """
        paths = []
        with reported(lambda reason: StudyError(f"{study}: it cannot be written ({reason}).")):
            for k, file in enumerate(self.files):
                path = study / DROPPED / str(k) / file.path
                path.parent.mkdir(parents=True, exist_ok=True)
                write_whole(path, file.raw)
                paths.append(str(path))
        return tuple(paths)


def take(given: Iterable[tuple[str, bytes]]) -> Dropped:
    """Unpack and read files, given by name and content."""
    files, refused = list[File](), list[str]()
    names: dict[str, str] = {}
    """The names of the files taken, by the digest of their contents."""
    used = 0
    for name, part in _unpacked(given):
        if isinstance(part, AccpinnError):
            refused.append(str(part))
            continue
        digest = sha256(part).hexdigest()
        reason = ""
        if digest in names:
            reason = f"its contents are those of {names[digest]}; it is taken once"
        elif len(files) == MOST_FILES:
            reason = f"{MOST_FILES} files are taken at a time; start a batch with these first"
        elif used + len(part) > LIMIT_BYTES:
            reason = f"together the files have more than {LIMIT_BYTES / 1e6:.0f} MB; drop fewer"
        shown = excerpt(name.name, NAME_LENGTH)
        if not reason and (fault := _fault(shown, part)):
            refused.append(fault)
        elif reason:
            refused.append(f"{shown}: {reason}.")
        else:
            names[digest] = shown
            used += len(part)
            files.append(File(name, part))
    return Dropped(tuple(files), tuple(refused))


def _fault(name: str, raw: bytes) -> str:
    """Why no recording can be read of a file; empty where one can."""
    try:
        parts = list(read_all(raw, name))
    except AccpinnError as fault:
        return str(fault)
    if any(isinstance(part, Recording) for part in parts):
        return ""
    return str(parts[0]) if parts else f"{name}: no recording is in it."


def _unpacked(
    given: Iterable[tuple[str, bytes]],
) -> Iterator[tuple[PurePosixPath, bytes | AccpinnError]]:
    """The files, and those of archives in their place; for one that cannot be had, why."""
    for name, raw in given:
        path = PurePosixPath(_plain(name))
        if not raw.startswith(ZIP):
            yield path, raw
            continue
        try:
            yield from _members(path, raw)
        except RecordingError as fault:
            yield path, fault


def _members(path: PurePosixPath, raw: bytes) -> Iterator[tuple[PurePosixPath, bytes]]:
    """The recordings of an archive; a workbook, which is one, stays as it is."""

    def refusal(fault: str, cure: str) -> RecordingError:
        return RecordingError(f"{path.name}: {fault}; {cure}.")

    with open_zip(raw, refusal) as archive:
        names = [name for name in archive.namelist() if is_file(name)]
        if WORKBOOK in names:
            yield path, raw
            return
        paths = {
            name: PurePosixPath(*map(_plain, PurePosixPath(name).parts[-2:])) for name in names
        }
        runs = {
            name: inner for name, inner in paths.items()
            if inner.suffix.lower() in ENDINGS and not is_note(Path(inner))
        }  # fmt: skip
        if not runs:
            raise refusal("no table of a recording is in this archive", "drop the files themselves")
        used = 0
        for name, inner in runs.items():
            content = zip_member(archive, name, refusal, used)
            used += len(content)
            yield inner, content


def _plain(name: str) -> str:
    """A foreign name that leads nowhere, as the name of a file or folder."""
    plain = printable(name.replace("\\", "/").rpartition("/")[2]).replace("\ufffd", "_")
    return plain[-NAME_LENGTH:].lstrip(". ") or "file"
