"""The server's workspaces, one for each browser session; the address names which.

The address carries ``?session=...``; so a reload, a page switch or a bookmark finds everything
again. With ``?snapshot=...`` it opens one of the server's snapshots, on any page.

Who uses a session is one signed in through the server's provider, or anyone where there is none.
Signing in is Streamlit's own (OpenID Connect): it is on where `.streamlit/secrets.toml` has a
section `[auth]`; see docs/security.md. Without it nothing is asked, and sessions are told apart by
their secret names alone. Where that file cannot be read, or users are named without it, nobody is
admitted: a slip in the settings must not open the server to all.

The store keeps of each session the analysis on the screen and the key of the result shown, so that
after a restart its address shows the same. A recording is never kept: one of the server's own is
read again, and an upload is asked for; its window and result return with it.
"""

import os
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import msgspec
import streamlit as st
from streamlit import config

from accpinn.errors import AccpinnError, ConfigError, SnapshotError
from accpinn.serial import dump, restore
from accpinn.study import Analysis
from accpinn.study.result import Result
from accpinn.study.store import Entry
from accpinn.units import Seconds
from pages.ui.session.resources import find_recording, library, once, store, task_queue
from pages.ui.session.workspace import Workspace

KEPT_WORKSPACES = 200
KEPT_FOR: Seconds = 3 * 24 * 3600.0
KEPT_BYTES = 1_000_000_000
"""Cap on the recordings of all workspaces; the longest of the database takes about 1 MB."""
SESSION = "session"
"""Name of the query parameter, and of the entry in Streamlit's session state."""
SNAPSHOT = "snapshot"
"""Name of the query parameter that opens one of the server's snapshots."""

FOLLOWED = "snapshot_followed"
"""The entry that holds the snapshots whose links this browser has followed."""
USERS_VARIABLE = "ACCPINN_USERS"
"""Environment variable that names who may use the app, as "ann@lab.org, @school.edu"; all whom the
provider signs in where it is not set."""
ADMINS_VARIABLE = "ACCPINN_ADMINS"
"""Environment variable that names, likewise, who may delete what others saved."""
USER = "user"
"""The entry in Streamlit's session state."""
RECENT = 3
"""Other sessions that are offered to go on with."""
LOOPBACK = ("localhost", "127.0.0.1", "::1")


# Who uses the app


@dataclass(frozen=True)
class User:
    """Who uses a page."""

    is_asked: bool = False
    """Whether the server asks its users to sign in."""
    is_signed_in: bool = False
    name: str = ""
    """The verified e-mail address, else the provider's own name of the user; empty for nobody."""


def recognise() -> User:
    """Who sends this run of the page; what is asked below is answered for that user."""
    claims = st.user.to_dict()
    signed_in = bool(claims.get("is_logged_in"))
    name = str(claims.get("email") or "").strip().lower()
    if not (name and str(claims.get("email_verified", True)).lower() == "true"):
        name = f"{claims.get('iss', '')} {claims.get('sub', '')}".strip()
    asked = "is_logged_in" in claims or _is_meant_to_ask()
    visitor = User(asked, signed_in, name if signed_in else "")
    st.session_state[USER] = visitor
    return visitor


def user() -> User:
    """The same, as this run recognised it; Streamlit would read its settings at every question."""
    visitor = st.session_state.get(USER)
    return visitor if isinstance(visitor, User) else User()


def mark() -> str:
    """What the names of this user's sessions begin with; empty where nobody is asked."""
    visitor = user()
    return f"{sha256(visitor.name.encode()).hexdigest()[:12]}-" if visitor.is_asked else ""


def is_admin() -> bool:
    """Whether the user may delete what others saved."""
    return user().is_asked and _is_named(ADMINS_VARIABLE)


def is_shared() -> bool:
    """Whether others than the person at this computer can reach the server by themselves."""
    return str(config.get_option("server.address") or "") not in LOOPBACK


def may_use() -> bool:
    """Whether the one who is signed in is among those for whom the server is."""
    if not user().name:
        return False
    return not os.environ.get(USERS_VARIABLE) or _is_named(USERS_VARIABLE) or is_admin()


def _is_meant_to_ask() -> bool:
    """Whether the settings name users, or are in a file that is there and cannot be read."""
    if os.environ.get(USERS_VARIABLE) or os.environ.get(ADMINS_VARIABLE):
        return True
    exists = any(Path(path).exists() for path in config.get_option("secrets.files"))
    return exists and not st.secrets.load_if_toml_exists()


def _is_named(variable: str) -> bool:
    """Whether the variable names the user's address, or its domain as "@school.edu"."""
    named = {part.strip().lower() for part in os.environ.get(variable, "").split(",")} - {""}
    who = user().name
    local, at, domain = who.rpartition("@")
    return who in named or bool(local and at and f"@{domain}" in named)


def owner_mark(session: str) -> str:
    """The digest under which the library keeps who saved a snapshot.

    It is of the identity where the server asks for one, else of the session's secret name.
    """
    return sha256((user().name or session).encode()).hexdigest()


def may_delete(session: str, name: str) -> bool:
    """Whether this user may delete that snapshot.

    On a server that only its own computer reaches everyone may, as all are one person; else whoever
    saved it, and an administrator.
    """
    return sees_all() or is_admin() or library().owner(name) == owner_mark(session)


# Their workspaces


class Workspaces:
    """All workspaces of a server, bounded in number, age and memory."""

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
            return workspace

    def new(self, name: str = "") -> Workspace:
        """An empty one, by default under a name that nobody can guess.

        Two tabs that come at once after a restart get the same one.
        """
        workspace = Workspace(name or secrets.token_urlsafe(16))
        with self._lock:
            if workspace.id not in self._kept:
                self._kept[workspace.id] = (self._clock(), workspace)
            self._forget()
            return self._kept[workspace.id][1]

    def _forget(self) -> None:
        """Let go of those that nobody has used for long, and of the longest unused of too many.

        Of too many, those go first in which nothing was opened: thousands of empty sessions, which
        cost a stranger nothing, thus end no one's work. The one used last always stays.
        """
        kept, oldest = self._kept, self._clock() - KEPT_FOR
        while kept:
            *others, last = kept
            name = next(iter(kept))
            if kept[name][0] >= oldest:  # none is that old
                if len(kept) > KEPT_WORKSPACES:
                    name = next((other for other in others if kept[other][1].is_empty), name)
                elif name == last or sum(w.nbytes for _, w in kept.values()) <= KEPT_BYTES:
                    return
            _, workspace = kept.pop(name)
            for task in workspace.tasks:
                task.stop()


workspaces = once(Workspaces)


def current() -> Workspace:
    """This browser's workspace; its name is put back into the address, which a page switch clears.

    An expired name finds what the session had open, as far as the server has kept it. Another
    begins a new one, and `lost_session` becomes true for this run; so does another user's.
    """
    task_queue()  # its worker gets ready while the user still reads
    asked = st.query_params.get(SESSION) or st.session_state.get(SESSION, "")
    is_own = asked.startswith(mark())
    workspace = workspaces().find(asked) if is_own else None
    document = store().session(asked) if is_own and asked and workspace is None else None
    st.session_state["lost_session"] = bool(asked) and not (workspace or document)
    if workspace is None:
        name = asked if document else f"{mark()}{secrets.token_urlsafe(16)}"
        workspace = workspaces().new(name)
        if document:
            resume(workspace, document)
    st.session_state[SESSION] = workspace.id
    if st.query_params.get(SESSION) != workspace.id:
        st.query_params[SESSION] = workspace.id
    _follow_link(workspace)
    keep(workspace)
    return workspace


# What a session shows, over restarts of the server


@dataclass(frozen=True)
class Shown:
    """What a session shows: the analysis on the screen, and the key of its result."""

    analysis: Analysis
    result: str
    """Key of a training in the store, or short name of a snapshot; empty before there is one,
    when its training may still end."""


def keep(workspace: Workspace) -> None:
    """Tell the store what is on the screen, where that has changed."""
    result, asked = workspace.result, None
    if workspace.recording is None and workspace.training is None:
        return  # a snapshot alone is named by the address, and following a link writes nothing
    with suppress(ConfigError):  # the page shows what is wrong with a setting
        asked = workspace.analysis()
    asked = asked or (result.analysis if result else None)
    if asked is None:
        return
    key = result.id or result.analysis.key if result else ""
    document = msgspec.json.encode(dump(Shown(asked, key))[0])
    if document != workspace.kept:
        workspace.kept = document
        store().keep_session(workspace.id, document)


def sees_all() -> bool:
    """Whether all sessions are this person's: nobody else reaches the server, or is asked for."""
    return not user().is_asked and not is_shared()


def recent_sessions(own: str) -> list[tuple[str, Shown]]:
    """The person's other sessions, by name, the last changed first."""
    if not (sees_all() or user().name):
        return []
    latest = dict[str, tuple[str, Shown]]()
    for name, document in store().sessions(mark(), 10 * RECENT):
        with suppress(AccpinnError, ValueError):  # of an earlier version, or damaged
            shown = restore(Shown, msgspec.json.decode(document), {})
            if name != own:  # of equal ones the last
                about = f"{shown.analysis.source.sha256} {shown.analysis.window}"
                latest.setdefault(about, (name, shown))
    return list(latest.values())[:RECENT]


def runs_to_see(workspace: Workspace) -> tuple[Entry, ...]:
    """The finished runs of this computer, or of the session where others use the server."""
    if not sees_all():
        return workspace.runs
    return tuple(entry for entry in store().entries() if not entry.fault)


def resume(workspace: Workspace, document: bytes) -> None:
    """Open again what the session had open, as far as the server has it."""
    with suppress(AccpinnError, ValueError):  # of an earlier version, or damaged
        shown = restore(Shown, msgspec.json.decode(document), {})
        asked = shown.analysis
        with suppress(SnapshotError):
            workspace.restore(result_of(shown.result or asked.key))
        workspace.take(asked)
        workspace.awaited = asked
        source = asked.source
        workspace.open(
            find_recording(source.name, source.sha256, source.trajectory, source.mapping)
        )


def result_of(name: str) -> Result:
    """The training of that key in the store, or the snapshot of that short name.

    Raises:
        SnapshotError: for an unknown name, or a damaged file.
    """
    if store().has(name):
        return store().read(name)
    return library().read(name)


def _follow_link(workspace: Workspace) -> None:
    """Open the snapshot that the address names; afterwards the address names the one shown.

    Each browser follows an address once: what is opened by other means comes after it, and the
    browser may still send the old address a moment later.
    """
    asked = st.query_params.get(SNAPSHOT, "")
    st.session_state["snapshot_fault"] = ""
    followed: set[str] = st.session_state.setdefault(FOLLOWED, set())
    shown = workspace.restored.id if workspace.restored else ""
    if asked and asked != shown and asked not in followed:
        try:
            workspace.restore(library().read(asked))
            workspace.viewed = asked
        except SnapshotError as fault:
            st.session_state["snapshot_fault"] = str(fault)
            return
        shown = asked
    followed.add(shown)
    if shown and shown != asked:
        st.query_params[SNAPSHOT] = shown
    elif asked and not shown:
        del st.query_params[SNAPSHOT]
