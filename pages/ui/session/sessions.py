"""The server's workspaces, one for each browser session; the address names which.

The address carries ``?session=...``; so a reload, a page switch or a bookmark finds everything
again. With ``?snapshot=...`` it opens one of the server's snapshots, on any page.
"""

import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable

import streamlit as st

from accpinn.errors import SnapshotError
from accpinn.units import Seconds
from pages.ui.session.identity import mark
from pages.ui.session.resources import library, store, task_queue
from pages.ui.session.resume import keep, resume
from pages.ui.session.runs import is_known
from pages.ui.session.workspace import Workspace

KEPT_WORKSPACES = 200
KEPT_FOR: Seconds = 3 * 24 * 3600.0
KEPT_BYTES = 1_000_000_000
"""Of the recordings of all workspaces; the longest of the database takes about 1 MB."""
SESSION = "session"
"""Name of the query parameter, and of the entry in Streamlit's session state."""
SNAPSHOT = "snapshot"
"""Name of the query parameter that opens one of the server's snapshots."""

FOLLOWED = "snapshot_followed"
"""The entry that holds the snapshots whose links this browser has followed."""


class Workspaces:
    """All workspaces of a server, bounded in number and age."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """None yet."""
        self._clock = clock
        self._lock = threading.Lock()
        self._kept: OrderedDict[str, tuple[float, Workspace]] = OrderedDict()

    def find(self, name: str) -> Workspace | None:
        """The workspace of that name, which counts as used now; None if it is not known."""
        with self._lock:
            self._forget()
            _, workspace = self._kept.pop(name, (0.0, None))
            if workspace:
                self._kept[name] = (self._clock(), workspace)
                self._bound_memory(workspace)
            return workspace

    def new(self, name: str = "") -> Workspace:
        """An empty one, by default under a name that nobody can guess.

        Two tabs that come at once after a restart get the same one.
        """
        workspace = Workspace(name or secrets.token_urlsafe(16))
        with self._lock:
            self._forget()
            if workspace.id not in self._kept:
                self._make_room()
                self._kept[workspace.id] = (self._clock(), workspace)
            return self._kept[workspace.id][1]

    def _forget(self) -> None:
        """Let go of those that nobody has used for long."""
        oldest = self._clock() - KEPT_FOR
        for name, (used, _) in list(self._kept.items()):  # the longest unused first
            if used >= oldest:
                return
            self._drop(name)

    def _make_room(self) -> None:
        """Let go of the longest unused, of those first in which nothing was opened.

        Thousands of empty sessions, which cost a stranger nothing, thus end no one's work.
        """
        while len(self._kept) >= KEPT_WORKSPACES:
            empty = (name for name, (_, found) in self._kept.items() if found.is_empty)
            self._drop(next(empty, next(iter(self._kept))))

    def _bound_memory(self, used: Workspace) -> None:
        """Where recordings fill memory, those lose who hold most: first what is not shown."""
        sizes = {name: found.recording_bytes for name, (_, found) in self._kept.items()}
        while sum(sizes.values()) > KEPT_BYTES:
            name = max(sizes, key=sizes.__getitem__)
            largest = self._kept[name][1]
            largest.forget_other_recordings()
            if (left := largest.recording_bytes) < sizes[name]:
                sizes[name] = left
            elif largest is used:
                sizes[name] = 0  # one recording is bounded by the size of a file
            else:
                self._drop(name)
                del sizes[name]

    def _drop(self, name: str) -> None:
        _, workspace = self._kept.pop(name)
        for task in workspace.tasks:
            task.stop()


@st.cache_resource(show_spinner=False)
def workspaces() -> Workspaces:
    """The server's one registry."""
    return Workspaces()


def current() -> Workspace:
    """This browser's workspace; its name is put back into the address, which a page switch clears.

    An expired name finds what the session had open, as far as the server has kept it (`resume`).
    Another begins a new one, and `lost_session` becomes true for this run; so does another user's.
    """
    task_queue()  # its worker gets ready while the user still reads
    asked = st.query_params.get(SESSION) or st.session_state.get(SESSION, "")
    own = asked.startswith(mark())
    workspace = workspaces().find(asked) if own else None
    known = own and workspace is None and is_known(asked, store().folder)
    st.session_state["lost_session"] = bool(asked) and workspace is None and not known
    if workspace is None:
        workspace = workspaces().new(asked if known else f"{mark()}{secrets.token_urlsafe(16)}")
        if known:
            resume(workspace)
    st.session_state[SESSION] = workspace.id
    if st.query_params.get(SESSION) != workspace.id:
        st.query_params[SESSION] = workspace.id
    _follow_link(workspace)
    keep(workspace)
    return workspace


def _follow_link(workspace: Workspace) -> None:
    """Open the snapshot that the address names; afterwards the address names the one shown.

    Each browser follows an address once: what is opened by other means comes after it, and the
    browser may still send the old address a moment later.
    """
    asked = st.query_params.get(SNAPSHOT, "")
    st.session_state["snapshot_fault"] = ""
    followed: set[str] = st.session_state.setdefault(FOLLOWED, set())
    shown = workspace.snapshot.id if workspace.snapshot else ""
    if asked and asked != shown and asked not in followed:
        try:
            holder = workspace.runs if workspace.runs.has(asked) else library()
            workspace.restore(holder.open(asked))
            workspace.viewed = asked if holder is not workspace.runs else ""
        except SnapshotError as fault:
            st.session_state["snapshot_fault"] = str(fault)
            return
        shown = asked
    followed.add(shown)
    if shown and shown != asked:
        st.query_params[SNAPSHOT] = shown
    elif asked and not shown:
        del st.query_params[SNAPSHOT]
