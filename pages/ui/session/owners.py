"""Who saved which snapshot of the server, and so may delete it; and how many in an hour.

A file beside the snapshot holds a digest of who saved it: of the identity where the server asks for
one, else of the session's name.
"""

import re
import time
from contextlib import suppress
from hashlib import sha256

from accpinn.results.snapshot import Snapshot

from accpinn.errors import SnapshotError
from accpinn.units import Seconds
from pages.ui.session import identity
from pages.ui.session.resources import library
from pages.ui.session.workspace import Workspace

SAVED_PER_HOUR = 60
"""By one user, or one session where nobody is asked who they are."""
HOUR: Seconds = 3600.0
SUFFIX = ".owner"

_NAME = re.compile(r"[0-9a-f]{1,64}")


def save(workspace: Workspace, content: Snapshot | bytes) -> str:
    """Keep a snapshot in the server's library, as this user's; its short name.

    Raises:
        SnapshotError: where the library refuses it, or the user saved too many in an hour.
    """
    _require_pace(workspace)
    before = {entry.id for entry in library().entries()}
    name = library().add(content)
    if name not in before:  # one that was there stays whose it was
        with suppress(OSError):
            (library().folder / f"{name}{SUFFIX}").write_text(_mark(workspace), encoding="ascii")
    return name


def may_delete(workspace: Workspace, name: str) -> bool:
    """Whether this user may delete that snapshot.

    On a server that only its own computer reaches everyone may, as all are one person; else whoever
    saved it, and an administrator.
    """
    if not identity.user().is_asked and not identity.is_shared():
        return True
    return identity.is_admin() or _owner(name) == _mark(workspace)


def _mark(workspace: Workspace) -> str:
    return sha256((identity.user().name or workspace.id).encode()).hexdigest()


def _owner(name: str) -> str:
    """Whose it is; empty where that is not known."""
    if not _NAME.fullmatch(name):
        return ""
    try:
        return (library().folder / f"{name}{SUFFIX}").read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""


def _require_pace(workspace: Workspace) -> None:
    """Refuse what fills the library; forget owners of what is gone for good.

    Raises:
        SnapshotError: where the user saved too many in the last hour.
    """
    own, recent = _mark(workspace), 0
    for path in library().folder.glob(f"*{SUFFIX}"):
        with suppress(OSError):
            age = time.time() - path.stat().st_mtime
            if age <= HOUR:
                recent += path.read_text(encoding="ascii", errors="replace") == own
            elif not any(library().folder.glob(f"{path.stem}.accpinn.*")):
                path.unlink()
    if recent >= SAVED_PER_HOUR:
        raise SnapshotError(
            f"You have saved {recent} snapshots within an hour; save the next one later."
        )
