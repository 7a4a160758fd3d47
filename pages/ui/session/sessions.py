"""The server's workspaces, one for each browser session; the address names which.

The address carries ``?session=...``; so a reload, a page switch or a bookmark finds everything
again. With ``?snapshot=...`` it opens one of the server's snapshots, on any page. A session's name
is a secret: the server keeps and lists its digest alone, and a browser that is given the address of
another's session is warned.

The store keeps of each session the analysis on the screen and the key of the result shown, so that
after a restart its address shows the same. A recording is never kept: one of the server's own is
read again, and an upload is asked for; its window and result return with it.
"""

import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import msgspec
import streamlit as st

from accpinn.errors import AccpinnError, ConfigError, SnapshotError
from accpinn.serial import dump, restore
from accpinn.study import Analysis
from accpinn.units import Seconds
from pages.ui.session.resources import find_recording, library, once, store, task_queue
from pages.ui.session.saved import own_result
from pages.ui.session.users import key_of, mark, owner_mark, sees_all, user
from pages.ui.session.workspace import Workspace

KEPT_WORKSPACES = 200
KEPT_FOR: Seconds = 3 * 24 * 3600.0
KEPT_BYTES = 1_000_000_000
"""Largest memory of the recordings of all workspaces; the database's longest takes about 1 MB."""
SESSION = "session"
"""Query parameter, and entry in Streamlit's session state, with the session's name."""
SNAPSHOT = "snapshot"
"""Query parameter that opens one of the server's snapshots."""
FOLLOWED = "snapshot_followed"
"""Entry in Streamlit's session state with the snapshots whose links this browser has followed."""
RECENT = 3
"""Largest number of other sessions offered to go on with."""
DIGEST = 64
"""Hexadecimal digits of a SHA-256; no session's name is as long."""


# Workspaces


class Workspaces:
    """All workspaces of a server, bounded in number, age and memory."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin without workspaces, with a clock in s."""
        self._clock = clock
        self._lock = threading.Lock()
        self._entries: OrderedDict[str, tuple[float, Workspace]] = OrderedDict()

    def find(self, name: str) -> Workspace | None:
        """The workspace of that name, marked as used now; None without one."""
        with self._lock:
            self._forget()
            _, workspace = self._entries.pop(name, (0.0, None))
            if workspace:
                self._entries[name] = (self._clock(), workspace)
            return workspace

    def new(self, name: str = "", browser: str | None = "") -> Workspace:
        """An empty workspace, by default under a name that nobody can guess.

        ``browser`` is the digest of its browser's cookie; None where another may have begun it. Two
        tabs that come at once after a restart get the same workspace.
        """
        workspace = Workspace(name or secrets.token_urlsafe(16))
        workspace.browsers |= set() if browser is None else {browser}
        with self._lock:
            if workspace.id not in self._entries:
                self._entries[workspace.id] = (self._clock(), workspace)
            self._forget()
            return self._entries[workspace.id][1]

    def known_as(self, key: str) -> Workspace | None:
        """The workspace that the store keeps under that name; see `key_of`."""
        with self._lock:
            names = list(self._entries)
        return next((self.find(name) for name in names if key_of(name) == key), None)

    def training(self) -> tuple[Workspace, ...]:
        """The workspaces in which a training runs or waits."""
        with self._lock:
            workspaces = [workspace for _, workspace in self._entries.values()]
        return tuple(w for w in workspaces if w.training and w.training.is_active)

    def _forget(self) -> None:
        """Remove workspaces unused for `KEPT_FOR`, and the longest unused of too many.

        Of too many, those in which nothing was opened are removed first: thousands of empty
        sessions, which cost a stranger nothing, thus end nobody's work. The workspace used last
        always stays.
        """
        entries, oldest = self._entries, self._clock() - KEPT_FOR
        while entries:
            *others, last = entries
            name = next(iter(entries))
            if entries[name][0] >= oldest:
                if len(entries) > KEPT_WORKSPACES:
                    name = next((other for other in others if entries[other][1].is_empty), name)
                elif name == last or sum(w.nbytes for _, w in entries.values()) <= KEPT_BYTES:
                    return
            _, workspace = entries.pop(name)
            for task in workspace.tasks:
                task.stop()


workspaces = once(Workspaces)


def current() -> Workspace:
    """This browser's workspace; its name is put back into the address, which a page switch clears.

    An expired name resumes its session as far as the server has kept that. An unknown name, or
    another user's, begins a new workspace, and `lost_session` becomes true for this run. In the
    session of another browser nothing is done before the user agrees: see `is_others`.
    """
    task_queue()  # its worker gets ready while the user still reads
    name = st.query_params.get(SESSION) or st.session_state.get(SESSION, "")
    is_theirs = name.startswith(mark())
    workspace = workspaces().find(name) if is_theirs else None
    document = None
    if is_theirs and name and workspace is None:
        document = store().session(key_of(name))
        if not document and len(name) < DIGEST:  # earlier versions kept it under the name itself
            document = store().session(name)
    st.session_state["lost_session"] = bool(name) and not (workspace or document)
    if workspace is None:
        workspace = workspaces().new(name, None) if document else _begun()
        if document:
            resume(workspace, document)
    enter(workspace)
    if not is_others(workspace):
        workspace.owner = owner_mark(workspace.id)
        _follow_link(workspace)
        keep(workspace)
    return workspace


def _begun() -> Workspace:
    """A new workspace of this browser."""
    return workspaces().new(f"{mark()}{secrets.token_urlsafe(16)}", user().browser)


def enter(workspace: Workspace) -> None:
    """Put the workspace's name into the address."""
    st.session_state[SESSION] = workspace.id
    if st.query_params.get(SESSION) != workspace.id:
        st.query_params[SESSION] = workspace.id


def begin_own() -> None:
    """Leave the session that the address names for a new one of this browser."""
    enter(_begun())


def is_others(workspace: Workspace) -> bool:
    """Whether another browser began the session, and this one's user has not agreed to use it.

    Whoever sent its address sees what is opened in it. Where users sign in, or are one person,
    nobody opens another's.
    """
    is_identified = sees_all() or user().is_asked
    return not is_identified and user().browser not in workspace.browsers


def agree(workspace: Workspace) -> None:
    """Use a session that another browser began."""
    workspace.browsers.add(user().browser)


# Sessions over restarts of the server


@dataclass(frozen=True)
class Shown:
    """The analysis on a session's screen and the key of its result, as the store keeps them."""

    analysis: Analysis
    result: str
    """Key of a training in the store, or short name of a snapshot; empty while there is none."""
    browsers: tuple[str, ...] = ()
    """Digests of the cookies of the session's browsers; see `is_others`."""

    @property
    def subject(self) -> tuple[str, str]:
        """Recording and window, by which sessions are listed once."""
        return self.analysis.source.sha256, str(self.analysis.window)


def keep(workspace: Workspace) -> None:
    """Store the analysis on the screen and its result where they have changed."""
    result, analysis = workspace.result, None
    if workspace.recording is None and workspace.training is None:
        return  # a snapshot alone is named by the address, and following a link writes nothing
    with suppress(ConfigError):  # the page shows what is wrong with a setting
        analysis = workspace.analysis()
    analysis = analysis or (result.analysis if result else None)
    if analysis is None:
        return
    key = result.id or result.analysis.key if result else ""
    shown = Shown(analysis, key, tuple(sorted(workspace.browsers)))
    document = msgspec.json.encode(dump(shown)[0])
    if document != workspace.stored:
        workspace.stored = document
        store().keep_session(key_of(workspace.id), document)


def recent_sessions(workspace: Workspace) -> list[tuple[str, Shown]]:
    """The user's other sessions with their keys in the store, the last changed first."""
    if not (sees_all() or user().name):
        return []
    present, latest = key_of(workspace.id), dict[tuple[str, str], tuple[str, Shown]]()
    for key, document in store().sessions(mark(), 10 * RECENT):
        with suppress(AccpinnError, ValueError):  # of an earlier version, or damaged
            shown = restore(Shown, msgspec.json.decode(document), {})
            latest.setdefault(shown.subject, (key, shown))
    return [(key, shown) for key, shown in latest.values() if key != present][:RECENT]


def training_elsewhere(workspace: Workspace) -> tuple[Workspace, ...]:
    """The user's other sessions in which a training runs or waits."""
    others = (other for other in workspaces().training() if other is not workspace)
    return tuple(other for other in others if sees_all() or other.owner == workspace.owner)


def go_on(key: str) -> Workspace:
    """The workspace of a session by its key, running or resumed from the store."""
    if workspace := workspaces().known_as(key):
        return workspace
    workspace = _begun()
    if document := store().session(key):
        resume(workspace, document)
    return workspace


def resume(workspace: Workspace, document: bytes) -> None:
    """Open the recording and result of a stored session again, as far as the server has them."""
    with suppress(AccpinnError, ValueError):  # of an earlier version, or damaged
        shown = restore(Shown, msgspec.json.decode(document), {})
        analysis = shown.analysis
        workspace.browsers.update(shown.browsers)
        with suppress(SnapshotError):
            workspace.restore(own_result(workspace, shown.result or analysis.key))
        workspace.take(analysis)
        workspace.awaited = analysis
        source = analysis.source
        workspace.open(
            find_recording(source.name, source.sha256, source.trajectory, source.mapping)
        )


def _follow_link(workspace: Workspace) -> None:
    """Open the snapshot that the address names, then let the address name the one shown.

    A browser follows an address once: it may still send the old address a moment after something
    else was opened.
    """
    linked = st.query_params.get(SNAPSHOT, "")
    st.session_state["snapshot_fault"] = ""
    followed: set[str] = st.session_state.setdefault(FOLLOWED, set())
    shown = workspace.restored.id if workspace.restored else ""
    if linked and linked != shown and linked not in followed:
        try:
            workspace.restore(library().read(linked))
            workspace.viewed = linked
        except SnapshotError as fault:
            st.session_state["snapshot_fault"] = str(fault)
            return
        shown = linked
    followed.add(shown)
    if shown and shown != linked:
        st.query_params[SNAPSHOT] = shown
    elif linked and not shown:
        del st.query_params[SNAPSHOT]
