"""Results on disk: a shelf of files that can be searched, and the cache of results, which is one.

A `Shelf` is a folder of files in the snapshot's format, beside each of which stands whose it is,
and one SQLite file, made again from the files where it is missing. A fault that passes (a full
disk, no more file descriptors, another process that writes) costs the index nothing: only a file
that is damaged is set aside, under another name.

The `Store` keeps each result by its analysis' key, and drops what was not used for the longest time
once it exceeds its cap; it also holds the checkpoints of trainings, and what each session of the
app shows. The library of snapshots is the other shelf (`snapshot_library.py`).
"""

import io
import os
import re
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from accpinn.arguments import checked_method
from accpinn.errors import SnapshotError
from accpinn.methods.estimate import Checkpoint
from accpinn.model.cthp import Parameters
from accpinn.serial import dump, read_arrays, restore
from accpinn.storage import UNFINISHED, folder, reason_of, variable, write_whole
from accpinn.study import Analysis
from accpinn.study.description import describe
from accpinn.study.result import Result
from accpinn.study.snapshot import SCHEMA, SUFFIX, read, read_file, to_bytes
from accpinn.units import MetresPerSecond, Quantity, Seconds

INDEX = "index.sqlite"
FORMER = "index[0-9]*.sqlite"
"""Names of indices of earlier versions, whose sessions and owners are taken over."""
SET_ASIDE = ".damaged"
"""Ending of an index that is damaged."""
OWNER = ".owner"
"""Ending of the file beside another that says whose it is."""
STATE = ".state.npz"
ENTRIES = 2
"""Version of the entries in the index, which are made again where they are of another one."""
DELETED = ".deleted"
"""Ending of a file that can still be brought back."""
ABANDONED: Seconds = 3600.0
"""A file that was begun so long ago is nobody's any more."""
CACHE_BYTES = 500_000_000
"""Cap on the cache; a result of 300 s with its data takes about 0.5 MB."""
PATIENCE: Seconds = 10.0
"""Longest wait for another process that writes the index."""
SESSION_KEPT: Seconds = 30 * 24 * 3600.0
"""Sessions that nobody used for so long are forgotten, .."""
SESSIONS_KEPT = 5_000
"""except for so many that were used last, so that a wrong clock forgets none of them."""

TABLES = """
create table if not exists entries (name text primary key, state text, entry blob);
create table if not exists sessions (name text primary key, used real, document blob);
create table if not exists shown
    (session text, name text, at real, primary key (session, name));
create table if not exists shown_entries
    (session text, name text, entry blob, primary key (session, name));
"""
_ID = re.compile(r"[0-9a-f]{16}|[0-9a-f]{64}")

T = TypeVar("T")
Say = Callable[[str], object]
"""Takes a sentence for the user: what was set aside, or could not be read or written."""

SHORT_ID = 6
"""Least number of letters by which a search finds an id."""


@dataclass(frozen=True)
class Entry:
    """One result's row in a list."""

    id: str
    """Name of its file: a key in the cache, the first digits of the digest in the library."""
    name: str = ""
    note: str = ""
    created: str = ""
    """ISO 8601 in UTC."""
    source: str = ""
    """File name of the recording."""
    sha256: str = ""
    """SHA-256 of the recording."""
    campaign: str = ""
    """Campaign of the recording; empty where it is not known."""
    window: str = ""
    """The window in words: "0-300 s"."""
    vehicles: tuple[str, ...] = ()
    """Labels, leader first."""
    numbers: tuple[int, ...] = ()
    """The vehicles' numbers in the file."""
    method: str = ""
    preset: str = ""
    """The method's preset; empty for a method without any."""
    model: str = ""
    """Key of the model."""
    case: str = ""
    parameters: tuple[tuple[float, float, float], ...] = ()
    """α [1/s²], β [1/s], τ [s] of each follower."""
    lower: tuple[tuple[float, float, float], ...] = ()
    """Lower ends of their intervals; empty where these were not computed."""
    upper: tuple[tuple[float, float, float], ...] = ()
    time_gaps: tuple[Quantity, ...] = ()
    """Those of the followers, in s at ``speed``, with intervals; all nan where one has none. One
    alone where all share their parameters; so are the next."""
    growths: tuple[Quantity, ...] = ()
    """The largest growth behind each, measured or max |H|; all nan where it is not determined."""
    speed: MetresPerSecond = 0.0
    fault: str = ""
    """Why it cannot be read; empty where it can."""

    @classmethod
    def of(cls, name: str, result: Result) -> "Entry":
        """The entry of a result in a file of that name."""
        description = describe(result)
        info, estimate, ends = result.info, result.estimate, result.uncertainty
        gaps = [follower.values.time_gap.span for follower in description.followers]
        return cls(
            id=name,
            name=result.name,
            note=result.note,
            created=result.created,
            source=info.source,
            sha256=result.analysis.source.sha256,
            campaign=result.facts.get("campaign") or "",
            window=", ".join(str(info.window) for info in result.infos),
            vehicles=info.labels,
            numbers=info.vehicles,
            method=estimate.method,
            preset=str(estimate.settings.get("preset", "")),
            model=estimate.model,
            case=estimate.case,
            parameters=_rows(result.parameters),
            lower=_rows(ends.lower) if ends else (),
            upper=_rows(ends.upper) if ends else (),
            time_gaps=tuple(Quantity(gap.value, gap.lower, gap.upper) for gap in gaps),
            growths=tuple(follower.growth.gain for follower in description.followers),
            speed=estimate.stated_speed,
        )

    @property
    def words(self) -> str:
        """All that a search looks at, beside the beginning of `id`, in lower case."""
        parts = (self.name, self.note, self.source, self.campaign, self.window, self.method,
                 self.preset, self.model, self.created[:10], *self.vehicles)  # fmt: skip
        return " ".join(parts).casefold()

    def matches(self, words: str) -> bool:
        """Whether it has all of these words."""
        terms = words.casefold().split()
        begins = [len(term) >= SHORT_ID and self.id.startswith(term) for term in terms]
        return all(begun or term in self.words for term, begun in zip(terms, begins, strict=True))


def _rows(parameters: Parameters) -> tuple[tuple[float, float, float], ...]:
    return tuple((row.alpha, row.beta, row.tau) for row in parameters)


class Shelf:
    """A folder of results with its index."""

    def __init__(self, place: Path, cap_bytes: int) -> None:
        """The folder is made when it is first written to."""
        self.folder, self.cap_bytes = place, cap_bytes

    def path(self, name: str) -> Path:
        """The path of a result's file; only a valid name becomes a path.

        Raises:
            SnapshotError: for what is no name.
        """
        if not _ID.fullmatch(name):
            raise unknown(name)
        return self.folder / f"{name}{SUFFIX}"

    def has(self, name: str) -> bool:
        """Whether a file of that name exists, damaged or not."""
        return bool(_ID.fullmatch(name)) and self.path(name).exists()

    def entries(self, words: str = "", session: str = "") -> tuple[Entry, ...]:
        """The results whose entries have all these words, the newest first, damaged ones last.

        Those of a session have the names under which it has shown them: another's recording with
        the same data has the same result.
        """
        try:
            paths = {path.name.removesuffix(SUFFIX): path for path in self._files()}
        except OSError:  # as without file descriptors; what the index knows may still be there
            return ()
        entries = self._transact(partial(self._entries, paths, session)) or ()
        chosen = [entry for entry in entries if entry.matches(words)]
        return tuple(sorted(chosen, key=lambda entry: (entry.created, entry.id), reverse=True))

    def _entries(
        self, paths: dict[str, Path], session: str, index: sqlite3.Connection
    ) -> tuple[Entry, ...]:
        """The entries of files, those that a session has shown; of new files they are made."""
        entries: dict[str, Entry] = {}
        as_shown: dict[str, Entry | None] = {}
        if session:
            shown = index.execute("select name from shown where session = ?", (session,))
            paths = {name: paths[name] for (name,) in shown if name in paths}
            query = "select name, entry from shown_entries where session = ?"
            as_shown = {name: _decoded(entry) for name, entry in index.execute(query, (session,))}
        rows = index.execute("select name, state, entry from entries").fetchall()
        indexed = {name: (state, entry) for name, state, entry in rows}
        for name, path in paths.items():
            with suppress(OSError):  # deleted by another process just now
                state = state_of(path)
                then, content = indexed.get(name, ("", b""))
                entry = _decoded(content) if then == state else None
                entry = entry or self._indexed(index, name, state)
                shown_entry = None if entry.fault else as_shown.get(name)
                if shown_entry and not shown_entry.growths:  # of an earlier version
                    shown_entry = replace(
                        shown_entry, time_gaps=entry.time_gaps, growths=entry.growths
                    )
                entries[name] = shown_entry or entry
        for name in () if session else indexed.keys() - paths.keys():
            if not self.path(name).with_suffix(DELETED).exists():  # else it may come back
                index.execute("delete from entries where name = ?", (name,))
        return tuple(entries.values())

    def _indexed(self, index: sqlite3.Connection, name: str, state: str) -> Entry:
        """Read a file, and enter it."""
        try:
            entry = Entry.of(name, self.read(name))
        except SnapshotError as fault:
            entry = Entry(name, fault=str(fault))
        self._enter(index, entry, state)
        return entry

    def _enter(self, index: sqlite3.Connection, entry: Entry, state: str) -> None:
        index.execute(
            "insert or replace into entries values (?, ?, ?)",
            (entry.id, state, msgspec.json.encode(dump(entry)[0])),
        )

    def raw(self, name: str) -> bytes:
        """The file of that name.

        Raises:
            SnapshotError: for an unknown name.
        """
        path = self.path(name)
        if not path.exists():
            raise unknown(name)
        return read_file(path)

    def read(self, name: str) -> Result:
        """The result of that name.

        Raises:
            SnapshotError: for an unknown name, or a file that is damaged or another's.
        """
        return read(self.raw(name))

    def _files(self) -> list[Path]:
        return [
            path
            for path in self.folder.glob(f"*{SUFFIX}")
            if _ID.fullmatch(path.name.removesuffix(SUFFIX))
        ]

    def owner(self, name: str) -> str:
        """A digest of who saved a result; empty where that is not known."""
        return owner_of(self.path(name))

    def _transact(self, work: Callable[[sqlite3.Connection], T]) -> T | None:
        """Apply ``work`` to the index in one transaction; None where it cannot be read.

        A damaged index is set aside and made again. Where the fault is another, which may pass, the
        index stays as it is and the work is done on an empty one, which lasts for this call alone.
        """
        place = self.folder / INDEX
        for _ in range(2):
            try:
                self._take_over(place)
                with closing(_opened(place)) as connection, connection:
                    return work(connection)
            except sqlite3.DatabaseError as fault:
                if not _is_damage(fault):
                    break
                _set_aside(place)
            except OSError:
                break
        with suppress(sqlite3.DatabaseError, OSError):
            with closing(_opened(None)) as connection, connection:
                return work(connection)
        return None

    def _take_over(self, place: Path) -> None:
        """Bring sessions and owners of earlier versions' indices into a new one.

        Raises:
            sqlite3.DatabaseError, OSError: where that is not possible now; it is tried again.
        """
        if place.exists() or not self.folder.is_dir():
            return
        former = sorted(self.folder.glob(FORMER), key=lambda path: path.stat().st_mtime)
        if not former:
            return
        made = place.with_name(f".{os.urandom(8).hex()}{UNFINISHED}")
        try:
            with closing(_opened(made)) as index:
                for earlier in former:
                    self._copy(index, earlier)
                index.execute("pragma journal_mode = delete")  # so that it is one file
            with suppress(FileExistsError):  # another process was quicker
                os.link(made, place)
        finally:
            made.unlink(missing_ok=True)

    def _copy(self, index: sqlite3.Connection, earlier: Path) -> None:
        """Copy what an earlier version's index has, unless it is damaged or too old to be read."""
        try:
            index.execute("attach ? as former", (str(earlier),))
            with index:
                for table in ("sessions", "shown"):
                    index.execute(f"insert or replace into {table} select * from former.{table}")
            owners = "select name, owner from former.entries where owner <> ''"
            for name, owner in index.execute(owners).fetchall():
                write_owner(self.path(name), owner)
        except sqlite3.DatabaseError as fault:
            if not _is_damage(fault) and fault.sqlite_errorcode != sqlite3.SQLITE_ERROR:
                raise
        finally:
            with suppress(sqlite3.OperationalError):  # it could not be attached
                index.execute("detach former")

    def _ask(self, statement: str, *values: str) -> Any:
        """The first cell that the index has for a statement; None without any."""
        row = self._transact(lambda index: index.execute(statement, values).fetchone())
        return row[0] if row else None


DAMAGE = frozenset((sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB))
"""Codes of SQLite for a file that is damaged; all other faults may pass."""


def _is_damage(fault: sqlite3.Error) -> bool:
    return getattr(fault, "sqlite_errorcode", 0) & 0xFF in DAMAGE


def _set_aside(place: Path) -> None:
    """Give a damaged index another name; what stands beside it belongs to it."""
    ending = f"{SET_ASIDE}-{os.urandom(4).hex()}"
    for path in (place, *(place.with_name(f"{place.name}-{part}") for part in ("wal", "shm"))):
        with suppress(OSError):
            os.replace(path, path.with_name(f"{path.name}{ending}"))


def owner_path(path: Path) -> Path:
    """The file beside a file or folder that says whose that is."""
    return path.with_name(f"{path.name}{OWNER}")


def owner_of(path: Path) -> str:
    """A digest of whose a file or folder is; empty where that is not known."""
    try:
        return owner_path(path).read_text("ascii").strip()
    except (OSError, ValueError):
        return ""


def write_owner(path: Path, owner: str) -> None:
    """Write beside a file or folder whose it is; one that has an owner keeps it.

    Raises:
        OSError: when it cannot be written.
    """
    if owner and not owner_of(path):
        write_whole(owner_path(path), owner.encode("ascii"))


def _opened(place: Path | None) -> sqlite3.Connection:
    """The index in a file; in memory without one, and where its folder is not there yet."""
    is_kept = place and place.parent.is_dir()
    connection = sqlite3.connect(str(place) if is_kept else ":memory:", timeout=PATIENCE)
    try:
        connection.execute("pragma journal_mode = wal")
        connection.execute("pragma synchronous = normal")
        connection.executescript(TABLES)
    except sqlite3.DatabaseError:
        connection.close()
        raise
    return connection


def state_of(path: Path) -> str:
    """Time and size of a file, by which the index knows that this version has read it."""
    status = path.stat()
    return f"{SCHEMA}.{ENTRIES} {status.st_mtime_ns} {status.st_size}"


def _decoded(content: bytes) -> Entry | None:
    try:
        return restore(Entry, msgspec.json.decode(content), {})
    except (ValueError, TypeError):
        return None


def unknown(name: str) -> SnapshotError:
    """The error for a name that nothing has."""
    return SnapshotError(
        f"There is no snapshot {name[:40]} on this server; it may have been deleted, or the link"
        " belongs to another server."
    )


class Store(Shelf):
    """The cache: results by the keys of their analyses, and checkpoints of trainings."""

    @checked_method
    def __init__(
        self, place: str | os.PathLike[str] | None = None, cap_bytes: int = CACHE_BYTES
    ) -> None:
        """Open the store in a folder, by default in the user's cache folder."""
        super().__init__(folder("cache") if place is None else Path(place), cap_bytes)

    def find(self, analysis: Analysis, say: Say | None = None) -> Result | None:
        """The stored result of an analysis; None where there is none."""
        path = self.path(analysis.key)
        try:
            result = read(path.read_bytes())
            if result.analysis.key != analysis.key:
                raise SnapshotError("it belongs to another analysis")
        except (FileNotFoundError, NotADirectoryError):  # the latter is said when writing
            return None
        except (OSError, SnapshotError) as fault:
            self.refuse(path.name, fault, say)
            return None
        with suppress(OSError):  # another's folder may be read, but its files not touched
            os.utime(path)
        return replace(result, analysis=analysis, digest="")

    def read(self, name: str) -> Result:
        """The result of that name, which is no snapshot; see `Shelf.read`."""
        return replace(super().read(name), digest="")

    def keep(self, result: Result, say: Say | None = None) -> None:
        """Keep a result."""
        key = result.analysis.key
        bare = replace(result, estimate=replace(result.estimate, cached=False), recording=None)
        try:
            content = to_bytes(bare)
        except SnapshotError as fault:
            if say:
                say(str(fault))
            return
        path = self.path(key)
        if self.write(path, content, say):
            with suppress(OSError):
                state, entry = state_of(path), Entry.of(key, bare)
                self._transact(lambda index: self._enter(index, entry, state))

    def checkpoints(self, analysis: Analysis, say: Say | None = None) -> "StoredCheckpoints":
        """The checkpoints of a training."""
        return StoredCheckpoints(self, analysis.checkpoint_key, say)

    def stopped_state(self, analysis: Analysis) -> Checkpoint | None:
        """The state from which a stopped training would go on; None where it is new."""
        if not analysis.checkpoint_key or self.has(analysis.key):
            return None
        config = analysis.config
        return self.checkpoints(analysis).load(config.iterations + config.lbfgs_iterations)

    def stopped_at(self, analysis: Analysis) -> int | None:
        """The iteration of that state; None where there is none."""
        state = self.stopped_state(analysis)
        return int(state["history.rows"][-1][0]) or None if state else None

    # Sessions of the app

    def keep_session(self, session: str, document: bytes) -> None:
        """Keep what a session of the app has open; sessions unused for long are forgotten."""
        with suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
        now = time.time()
        old = (
            "(select name from (select name, used from sessions order by used desc"
            " limit -1 offset ?) where used < ?)"
        )
        bounds = (SESSIONS_KEPT, now - SESSION_KEPT)

        def keep(index: sqlite3.Connection) -> None:
            index.execute(
                "insert into sessions values (?, ?, ?) on conflict (name)"
                " do update set used = excluded.used, document = excluded.document",
                (session, now, document),
            )
            for table in ("shown", "shown_entries"):
                index.execute(f"delete from {table} where session in {old}", bounds)
            index.execute(f"delete from sessions where name in {old}", bounds)

        self._transact(keep)

    def session(self, session: str) -> bytes | None:
        """The document of an open session; None for one that is not stored."""
        document: bytes | None = self._ask("select document from sessions where name = ?", session)
        return document

    def sessions(self, prefix: str, most: int) -> tuple[tuple[str, bytes], ...]:
        """Names of sessions that begin so, and what they have open, the last changed first."""
        query = (
            "select name, document from sessions where substr(name, 1, ?) = ?"
            " order by used desc limit ?"
        )
        arguments = (len(prefix), prefix, most)
        return tuple(self._transact(lambda index: index.execute(query, arguments).fetchall()) or ())

    def record_shown(self, session: str, result: Result) -> None:
        """Keep a result, and record that a session has shown it."""
        self.keep(result)
        key = result.analysis.key
        entry = msgspec.json.encode(dump(Entry.of(key, result))[0])

        def record(index: sqlite3.Connection) -> None:
            index.execute(
                "insert or replace into shown values (?, ?, ?)", (session, key, time.time())
            )
            index.execute(
                "insert or replace into shown_entries values (?, ?, ?)", (session, key, entry)
            )

        self._transact(record)

    def shown_as(self, session: str, name: str) -> Entry | None:
        """The entry of a result as a session has shown it; None where it has not."""
        query = "select entry from shown_entries where session = ? and name = ?"
        content = self._ask(query, session, name)
        return _decoded(content) if content else None

    # Files

    def write(self, path: Path, content: bytes, say: Say | None) -> bool:
        """Write a file and make room for it; whether that was possible."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_whole(path, content)
        except OSError as fault:
            is_file = isinstance(fault, FileExistsError | NotADirectoryError)
            reason = "this is no folder" if is_file else reason_of(fault)
            if say:
                say(
                    f"{self.folder}: the result could not be kept ({reason}); free some space"
                    f" or name another folder in {variable('cache')}."
                )
            return False
        self._make_room(keep=path.name)
        return True

    def refuse(self, name: str, fault: Exception, say: Say | None) -> None:
        """Report why a file cannot be used; the next one of its name takes its place."""
        reason = reason_of(fault) if isinstance(fault, OSError) else str(fault).rstrip(".")[:160]
        follows = (
            "the training begins anew" if name.endswith(STATE) else "what it held is computed again"
        )
        if say:
            say(f"{name} in {self.folder} cannot be used ({reason}), so {follows}.")

    def _make_room(self, keep: str) -> None:
        """Delete what was not used for the longest time until the cap holds."""
        files = []
        with suppress(OSError):  # the folder cannot be listed just now
            for path in chain(
                *map(self.folder.glob, (f"*{SUFFIX}", f"*{STATE}*", f"*{UNFINISHED}"))
            ):
                with suppress(OSError):  # another process was quicker
                    files.append((path.stat().st_mtime, path.stat().st_size, path))
        total = sum(size for _, size, _ in files)
        for _, size, path in sorted(files):
            if total <= self.cap_bytes:
                return
            if path.name != keep:
                with suppress(OSError):
                    path.unlink()
                    total -= size
                    owner_path(path).unlink(missing_ok=True)


class StoredCheckpoints:
    """The checkpoint of one training in the store, as `methods.Checkpoints` asks."""

    def __init__(self, store: Store, key: str, say: Say | None) -> None:
        """The checkpoint of a training by its key."""
        self._store, self._path, self._say = store, store.folder / f"{key}{STATE}", say

    def load(self, most: int) -> Checkpoint | None:
        """The latest state; None where there is none, or one with more iterations than so many."""
        try:
            state = read_arrays(self._path.read_bytes(), self._store.cap_bytes)
            return state if int(state["history.rows"][-1][0]) <= most else None
        except (FileNotFoundError, NotADirectoryError):
            return None
        except Exception as fault:  # array parsers raise many kinds for foreign bytes
            self.reject(fault)
            return None

    def save(self, state: Checkpoint) -> None:
        """Keep a state in place of the former one."""
        packed = io.BytesIO()
        np.savez(packed, allow_pickle=False, **state)
        self._store.write(self._path, packed.getvalue(), self._say)

    def reject(self, fault: Exception) -> None:
        """Report that no training can continue from the state."""
        self._store.refuse(self._path.name, fault, self._say)

    def drop(self) -> None:
        """Let the next training begin anew."""
        with suppress(OSError):
            self._path.unlink(missing_ok=True)
