"""The server's workspaces, one for each browser session; the address names which.

The address carries ``?session=...``; so a reload, a page switch or a bookmark finds everything
again. With ``?snapshot=...`` it opens one of the server's snapshots, on any page.

Who uses a session is one signed in through the server's provider, or where there is none the
browser that began it, which a cookie tells. The session's name is a secret: the server keeps and
lists digests of it alone, and another browser that is given the address is told that it is
somebody's. Signing in is Streamlit's own (OpenID Connect): it is on where `.streamlit/secrets.toml`
has a section `[auth]`; see docs/security.md. Where that file cannot be read, or users are named
without it, nobody is admitted: a slip in the settings must not open the server to all.

All sessions are one person's only where the server listens to this computer alone, knows no other
name than this computer's, and is asked for by it without a proxy; everybody else is a stranger.

The store keeps of each session the analysis on the screen and the key of the result shown, so that
after a restart its address shows the same. A recording is never kept: one of the server's own is
read again, and an upload is asked for; its window and result return with it.
"""

import os
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import urlsplit

import msgspec
import streamlit as st
from streamlit import config

from accpinn.errors import AccpinnError, ConfigError, SnapshotError
from accpinn.recordings import Facts
from accpinn.serial import dump, restore
from accpinn.study import Analysis
from accpinn.study.result import Result
from accpinn.study.store import Entry
from accpinn.units import Seconds
from pages.ui.server import LOOPBACK, browser_of, is_open
from pages.ui.session.resources import find_recording, library, once, store, task_queue
from pages.ui.session.workspace import Workspace, digest

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
PASSED_ON = ("Forwarded", "Via", "X-Forwarded-For", "X-Forwarded-Host", "X-Real-Ip")
"""Headers that only a proxy adds."""
DIGEST = 64
"""Length of a SHA-256 in hexadecimal digits; no session's name is as long."""


# Who uses the app


@dataclass(frozen=True)
class User:
    """Who uses a page."""

    is_asked: bool = False
    """Whether the server asks its users to sign in."""
    is_signed_in: bool = False
    name: str = ""
    """The verified e-mail address, else the provider's own name of the user; empty for nobody."""
    browser: str = ""
    """A digest of the cookie by which the browser is known; empty for one without."""
    is_here: bool = False
    """Whether the page is asked for by this computer's own name, and not through a proxy."""


def recognise() -> User:
    """Who sends this run of the page; what is asked below is answered for that user."""
    claims = st.user.to_dict()
    signed_in = bool(claims.get("is_logged_in"))
    name = str(claims.get("email") or "").strip().lower()
    if not (name and str(claims.get("email_verified", True)).lower() == "true"):
        name = f"{claims.get('iss', '')} {claims.get('sub', '')}".strip()
    asked = "is_logged_in" in claims or _is_meant_to_ask()
    headers = connection_headers()
    if headers:
        cookie = browser_of(headers.get("Cookie", ""))
        browser, is_here = digest(cookie) if cookie else "", _names_this_computer(headers)
    else:  # the connection broke just now; a later one may still be sent what this run draws
        browser, is_here = user().browser, user().is_here
    visitor = User(asked, signed_in, name if signed_in else "", browser, is_here)
    st.session_state[USER] = visitor
    return visitor


def connection_headers() -> Mapping[str, str]:
    """Those with which the browser opened its connection; none once that is broken."""
    return st.context.headers


def _names_this_computer(headers: Mapping[str, str]) -> bool:
    if any(name in headers for name in PASSED_ON):
        return False
    origin = headers.get("Origin", "")
    places = [f"//{headers.get('Host', '')}", *([origin] if origin else [])]
    with suppress(ValueError):
        return all(urlsplit(place).hostname in LOOPBACK for place in places)
    return False


def user() -> User:
    """The same, as this run recognised it; Streamlit would read its settings at every question."""
    visitor = st.session_state.get(USER)
    return visitor if isinstance(visitor, User) else User()


def mark() -> str:
    """What the names of this user's sessions begin with; empty where nobody is asked."""
    visitor = user()
    return f"{digest(visitor.name)[:12]}-" if visitor.is_asked else ""


def key_of(session: str) -> str:
    """The name under which the store keeps a session; nobody learns the session's own from it."""
    return f"{mark()}{digest(session)}"


def is_admin() -> bool:
    """Whether the user may delete what others saved."""
    return user().is_asked and _is_named(ADMINS_VARIABLE)


def is_shared() -> bool:
    """Whether others than the person at this computer reach the server, or this may be one."""
    return is_open() or not user().is_here


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
    """The digest under which the server keeps whose something is.

    It is of the identity where the server asks for one, else of the browser's cookie, or of the
    session's secret name for a browser without.
    """
    return digest(user().name) if user().name else user().browser or digest(session)


def is_own(session: str, owner: str) -> bool:
    """Whether what has this owner is the user's to see, list and delete.

    On a server that only its own computer reaches everything is, as all are one person; an
    administrator may do the same with what is others'.
    """
    return sees_all() or is_admin() or owner in (owner_mark(session), digest(session))


def may_delete(session: str, name: str) -> bool:
    """Whether this user may delete that snapshot."""
    return is_own(session, library().owner(name))


def own_snapshots(session: str) -> tuple[Entry, ...]:
    """The snapshots that this user saved, damaged ones included; others open by their links."""
    entries = library().entries()
    if sees_all() or is_admin():
        return entries
    return tuple(entry for entry in entries if is_own(session, library().owner(entry.id)))


def readable_snapshots(session: str) -> tuple[Entry, ...]:
    """Those of them that can be read."""
    return tuple(entry for entry in own_snapshots(session) if not entry.fault)


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

    def new(self, name: str = "", browser: str | None = "") -> Workspace:
        """An empty one, by default under a name that nobody can guess.

        ``browser`` is the digest by which its browser is known; None where another may have begun
        it. Two tabs that come at once after a restart get the same one.
        """
        workspace = Workspace(name or secrets.token_urlsafe(16))
        workspace.browsers |= set() if browser is None else {browser}
        with self._lock:
            if workspace.id not in self._kept:
                self._kept[workspace.id] = (self._clock(), workspace)
            self._forget()
            return self._kept[workspace.id][1]

    def known_as(self, key: str) -> Workspace | None:
        """The workspace that the store keeps under that name; see `key_of`."""
        with self._lock:
            names = list(self._kept)
        return next((self.find(name) for name in names if key_of(name) == key), None)

    def training(self) -> tuple[Workspace, ...]:
        """Those in which a training runs or waits."""
        with self._lock:
            every = [workspace for _, workspace in self._kept.values()]
        return tuple(w for w in every if w.training and w.training.is_active)

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
    begins a new one, and `lost_session` becomes true for this run; so does another user's. In one
    that another browser began nothing is done before the user agrees: see `is_others`.
    """
    task_queue()  # its worker gets ready while the user still reads
    asked = st.query_params.get(SESSION) or st.session_state.get(SESSION, "")
    is_theirs = asked.startswith(mark())
    workspace = workspaces().find(asked) if is_theirs else None
    document = _kept_of(asked) if is_theirs and asked and workspace is None else None
    st.session_state["lost_session"] = bool(asked) and not (workspace or document)
    if workspace is None:
        workspace = workspaces().new(asked, None) if document else _begun()
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
    """Have the address name that workspace."""
    st.session_state[SESSION] = workspace.id
    if st.query_params.get(SESSION) != workspace.id:
        st.query_params[SESSION] = workspace.id


def begin_own() -> None:
    """Leave the session that the address names for a new one of this browser."""
    enter(_begun())


def is_others(workspace: Workspace) -> bool:
    """Whether another browser began the session, and the user of this one has not agreed to use it.

    Whoever sent its address sees what is opened in it. Where users sign in, or are one person,
    nobody opens another's.
    """
    is_told = sees_all() or user().is_asked
    return not is_told and user().browser not in workspace.browsers


def agree(workspace: Workspace) -> None:
    """Use a session that another browser began."""
    workspace.browsers.add(user().browser)


# What a session shows, over restarts of the server


@dataclass(frozen=True)
class Shown:
    """What a session shows: the analysis on the screen, and the key of its result."""

    analysis: Analysis
    result: str
    """Key of a training in the store, or short name of a snapshot; empty before there is one,
    when its training may still end."""
    browsers: tuple[str, ...] = ()
    """Digests of the cookies of those that use the session; see `is_others`."""

    @property
    def subject(self) -> tuple[str, str]:
        """What it is about, by which equal sessions are listed once."""
        return self.analysis.source.sha256, str(self.analysis.window)


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
    shown = Shown(asked, key, tuple(sorted(workspace.browsers)))
    document = msgspec.json.encode(dump(shown)[0])
    if document != workspace.kept:
        workspace.kept = document
        store().keep_session(key_of(workspace.id), document)


def _kept_of(session: str) -> bytes | None:
    """What a session had open; earlier versions kept it under the session's own name."""
    document = store().session(key_of(session))
    return document or (store().session(session) if len(session) < DIGEST else None)


def sees_all() -> bool:
    """Whether all sessions are this person's: nobody else reaches the server, or is asked for."""
    return not user().is_asked and not is_shared()


def recent_sessions(workspace: Workspace) -> list[tuple[str, Shown]]:
    """The person's other sessions, by the names that the store has, the last changed first."""
    if not (sees_all() or user().name):
        return []
    own, latest = key_of(workspace.id), dict[tuple[str, str], tuple[str, Shown]]()
    for key, document in store().sessions(mark(), 10 * RECENT):
        with suppress(AccpinnError, ValueError):  # of an earlier version, or damaged
            shown = restore(Shown, msgspec.json.decode(document), {})
            latest.setdefault(shown.subject, (key, shown))  # of equal ones the last
    return [(key, shown) for key, shown in latest.values() if key != own][:RECENT]


def training_elsewhere(workspace: Workspace) -> tuple[Workspace, ...]:
    """The person's other sessions in which a training runs or waits."""
    others = (other for other in workspaces().training() if other is not workspace)
    return tuple(other for other in others if sees_all() or other.owner == workspace.owner)


def go_on(key: str) -> Workspace:
    """The workspace of a session in that list, as it is or as the store has it."""
    if workspace := workspaces().known_as(key):
        return workspace
    workspace = _begun()
    if document := store().session(key):
        resume(workspace, document)
    return workspace


def results_to_see(workspace: Workspace) -> tuple[Entry, ...]:
    """The person's own results, the newest first: finished runs, and snapshots of no such run.

    They are those of this computer, or of the user where others use the server. A run that was
    saved as a snapshot has its name.
    """
    session = workspace.id
    is_everything = sees_all()
    entries = store().entries(session="" if is_everything else owner_mark(session))
    runs = {_content(entry): entry for entry in reversed(entries) if not entry.fault}
    marks = owner_mark(session), digest(session)
    for entry in reversed(library().entries()):
        is_mine = is_everything or library().owner(entry.id) in marks
        if is_mine and not entry.fault:
            run = runs.get(_content(entry), entry)
            runs[_content(entry)] = replace(run, name=entry.name)
    return tuple(sorted(runs.values(), key=lambda entry: entry.created, reverse=True))


def _content(entry: Entry) -> tuple[object, ...]:
    """What tells whether two entries are of the same result."""
    return entry.sha256, entry.window, entry.numbers, entry.method, entry.model, entry.parameters


def resume(workspace: Workspace, document: bytes) -> None:
    """Open again what the session had open, as far as the server has it."""
    with suppress(AccpinnError, ValueError):  # of an earlier version, or damaged
        shown = restore(Shown, msgspec.json.decode(document), {})
        asked = shown.analysis
        workspace.browsers.update(shown.browsers)
        with suppress(SnapshotError):
            workspace.restore(own_result(workspace, shown.result or asked.key))
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


def own_result(workspace: Workspace, name: str) -> Result:
    """The same, where it is a training by the names under which the user has shown it.

    Whoever has the same data has the same result, and may have named files and vehicles otherwise.
    """
    result = result_of(name)
    for session in (workspace.key, owner_mark(workspace.id)):
        if entry := store().shown_as(session, name):
            return _named(result, entry)
    return result


def _named(result: Result, entry: Entry) -> Result:
    info, source = result.info, result.analysis.source
    if (info.source, info.labels, source.sha256) == (entry.source, entry.vehicles, entry.sha256):
        return result
    names = tuple(label.removeprefix(f"{number} ") for number, label in
                  zip(entry.numbers, entry.vehicles, strict=True))  # fmt: skip
    segments = tuple(
        replace(segment, source=entry.source, names=names, sha256=entry.sha256)
        for segment in result.segments
    )
    source = replace(source, name=entry.source, sha256=entry.sha256)
    analysis = replace(result.analysis, source=source)
    facts: Facts = {"campaign": entry.campaign} if entry.campaign else {}
    return replace(result.on(segments, None), analysis=analysis, facts=facts, name="", note="")


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
