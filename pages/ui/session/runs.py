"""The finished runs of each session on disk, so that a restart of the server loses none.

A run is a snapshot without data, in a folder of the cache that has the session's name. The newest
are kept; folders that nobody used for long are removed.
"""

import re
import shutil
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from accpinn.errors import SnapshotError
from accpinn.results.snapshot import Snapshot
from accpinn.results.snapshot.archive import to_bytes
from accpinn.results.snapshot.saved import Entry, Library
from accpinn.units import Seconds

KEPT_RUNS = 20
"""Of a session."""
KEPT_FOR: Seconds = 30 * 24 * 3600.0
FOLDER = "runs"

_SESSION = re.compile(r"[\w-]{20,60}", re.ASCII)


@dataclass(frozen=True, eq=False)
class Runs:
    """The finished runs of one session."""

    snapshots: Library

    @classmethod
    def of(cls, session: str, cache: Path) -> "Runs":
        """Those of a session, in the server's cache; its folder is made when first written to."""
        return cls(Library(cache / FOLDER / session, cap_count=KEPT_RUNS))

    def keep(self, snapshot: Snapshot) -> None:
        """Keep a run, unless there is an equal one; the oldest goes where there are too many.

        Where the cache cannot be written to, none is kept.
        """
        entries = self.entries()
        if any(_same(entry, snapshot) for entry in entries):
            return
        with suppress(SnapshotError):
            content = to_bytes(snapshot)  # one that is too large takes no other's place
            for old in entries[KEPT_RUNS - 1 :]:
                self.snapshots.delete(old.id)
            self.snapshots.add(content)
        _tidy(self.snapshots.folder.parent)

    def entries(self) -> tuple[Entry, ...]:
        """Those that can be read, the newest first."""
        return tuple(entry for entry in self.snapshots.entries() if not entry.fault)

    def has(self, name: str) -> bool:
        """Whether a run of that short name is kept."""
        return self.snapshots.has(name)

    def open(self, name: str) -> Snapshot:
        """The run of that short name.

        Raises:
            SnapshotError: for an unknown name or a damaged file.
        """
        return self.snapshots.open(name)


def is_known(session: str, cache: Path) -> bool:
    """Whether runs are kept of a session of that name; what cannot be a name never is."""
    return bool(_SESSION.fullmatch(session)) and (cache / FOLDER / session).is_dir()


def _same(entry: Entry, snapshot: Snapshot) -> bool:
    """Whether it has the same parameters from the same window by the same settings."""
    found = tuple((p.alpha, p.beta, p.tau) for p in snapshot.fit.parameters)
    return (entry.name, entry.source, entry.window, entry.vehicles, entry.parameters) == (
        snapshot.name, snapshot.info.source, str(snapshot.info.window), snapshot.info.labels, found
    )  # fmt: skip


def _tidy(folder: Path) -> None:
    """Remove what no session has written to for long."""
    for path in folder.iterdir() if folder.is_dir() else ():
        with suppress(OSError):  # another process was quicker
            if time.time() - path.stat().st_mtime > KEPT_FOR:
                shutil.rmtree(path)
