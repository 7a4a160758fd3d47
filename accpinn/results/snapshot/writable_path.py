"""Where a file may be written: beside others, or in place of its own kind and nothing else."""

import stat
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from accpinn.errors import SnapshotError
from accpinn.results.snapshot.schema import MANIFEST

_BEGINNING = 200


@dataclass(frozen=True)
class Kind:
    """What is written."""

    name: str
    mark: bytes
    """Stands among the first bytes of every such file, in lower case."""


SNAPSHOT = Kind("snapshot", MANIFEST.encode())
REPORT = Kind("report", b"<!doctype html")


def free_place(target: Path, kind: Kind) -> Path:
    """The file that is made, or replaced, by writing to ``target``; links are followed.

    Raises:
        SnapshotError: where something else stands, or no file can be made.
    """
    try:
        place = target.resolve() if target.is_symlink() else target
        with suppress(FileNotFoundError):
            _require_own(place, kind)
        with tempfile.TemporaryFile(dir=place.parent):
            return place
    except (OSError, ValueError, RuntimeError) as fault:  # also for links that run in a circle
        reason = getattr(fault, "strerror", None) or "no valid path"
        raise SnapshotError(
            f"{target}: the {kind.name} could not be written ({reason.lower()}); choose another"
            " place or free some space."
        ) from None


def _require_own(place: Path, kind: Kind) -> None:
    mode = place.stat().st_mode
    if stat.S_ISDIR(mode):
        raise SnapshotError(f"{place}: this is a folder; name a file in it for the {kind.name}.")
    if stat.S_ISREG(mode):
        with place.open("rb") as file:
            beginning = file.read(_BEGINNING).lower()
        if not beginning or kind.mark in beginning:
            return
    raise SnapshotError(
        f"{place}: this is something else than a {kind.name} and is not overwritten; choose"
        " another name."
    )
