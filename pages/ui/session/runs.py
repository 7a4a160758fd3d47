"""The finished runs of each session on disk, so that a restart of the server loses none.

A run is a snapshot without data, in a folder of the cache that has the session's name. The newest
are kept; folders that nobody used for long are removed.
"""

import re
import shutil
import time
from contextlib import suppress
from pathlib import Path

from accpinn.results.snapshot import SUFFIX, Snapshot
from accpinn.results.snapshot.archive import to_bytes
from accpinn.results.snapshot.saved import Entry, Library

from accpinn.errors import SnapshotError
from accpinn.units import Seconds

KEPT_RUNS = 20
"""Of a session."""
KEPT_FOR: Seconds = 30 * 24 * 3600.0
KEPT_SESSIONS = 2000
FOLDER = "runs"

_SESSION = re.compile(r"[\w-]{20,60}", re.ASCII)


class Runs(Library):
    """The finished runs of one session."""

    def __init__(self, session: str, cache: Path) -> None:
        """Those of a session, in the server's cache; its folder is made when first written to."""
        super().__init__(cache / FOLDER / session, cap_count=KEPT_RUNS)

    def keep(self, snapshot: Snapshot) -> str:
        """Keep a run, unless there is an equal one; the oldest goes where there are too many.

        Returns:
            Its short name; empty where the cache cannot be written to, and none is kept.
        """
        entries, name = self.readable(), ""
        if equal := next((entry for entry in entries if _same(entry, snapshot)), None):
            return equal.id
        with suppress(SnapshotError):
            content = to_bytes(snapshot)  # one that is too large takes no other's place
            for old in entries[KEPT_RUNS - 1 :]:
                self.delete(old.id)
            name = self.add(content)
        return name

    def made(self) -> Path | None:
        """The session's folder, made where there is none yet; None where that cannot be."""
        if not self.folder.is_dir():
            _tidy(self.folder.parent)
            with suppress(OSError):
                self.folder.mkdir(parents=True)
        return self.folder if self.folder.is_dir() else None


def is_known(session: str, cache: Path) -> bool:
    """Whether anything is kept of a session of that name; what cannot be a name never is."""
    return bool(_SESSION.fullmatch(session)) and (cache / FOLDER / session).is_dir()


def _same(entry: Entry, snapshot: Snapshot) -> bool:
    """Whether it has the same parameters from the same window by the same settings."""
    found = tuple((p.alpha, p.beta, p.tau) for p in snapshot.fit.parameters)
    return (entry.name, entry.source, entry.window, entry.vehicles, entry.parameters) == (
        snapshot.name, snapshot.info.source, str(snapshot.info.window), snapshot.info.labels, found
    )  # fmt: skip


def _tidy(folder: Path) -> None:
    """Remove what no session has written to for long, and the oldest where there are too many.

    Of these go first those without a run: thousands of sessions that only opened a sample, which
    cost a stranger nothing, thus cost nobody a result.
    """
    found = []
    for path in folder.iterdir() if folder.is_dir() else ():
        with suppress(OSError):  # another process was quicker
            found.append((path.stat().st_mtime, path))
    many = len(found) > KEPT_SESSIONS
    found.sort(key=lambda one: (many and any(one[1].glob(f"*{SUFFIX}")), one[0]), reverse=True)
    for rank, (written, path) in enumerate(found):
        if rank >= KEPT_SESSIONS or time.time() - written > KEPT_FOR:
            shutil.rmtree(path, ignore_errors=True)
