"""A study: the folder of one batch, with one SQLite file that holds everything that was found.

Each result is one transaction, so a process that is killed loses what it was computing and nothing
else. `results.parquet`, `failures.csv` and `schema.json` are made from the SQLite file, each in one
step, from time to time and at the end of a batch. Studies of the app have a name in place of a
path.
"""

import csv
import io
import json
import re
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import asdict, astuple, dataclass
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, Self

import msgspec
import numpy as np

from accpinn.channels import COMPUTABLE
from accpinn.errors import AccpinnError, ConfigError, RecordingError
from accpinn.model.cthp import Case
from accpinn.model.registry import BEST, FOLLOWING
from accpinn.recordings.mapping import CsvMapping
from accpinn.storage import reason_of, reported, write_whole, written_whole
from accpinn.study.analysis import Analysis
from accpinn.study.rows import COLUMNS
from accpinn.units import FloatArray, Seconds

FILE, RESULTS, FAILURES, SCHEMA, LOCK = (
    "study.sqlite", "results.parquet", "failures.csv", "schema.json", ".lock",
)  # fmt: skip
FAILURE_COLUMNS = ("file", "start", "vehicle", "reason")
FORMAT = 3
"""Raised whenever an older program could not read the SQLite file, or the reverse."""
PATIENCE: Seconds = 30.0
"""Longest wait for a reader or a writer of the SQLite file."""
CHUNK = 5000
"""Rows of the Parquet file that are in memory at a time."""
TABLES = f"""
create table request (document text);
create table files (sha256 text primary key, document text);
create table results
    (sha256 text, start real, leader integer, method text, key text, file text, rows text,
     primary key (sha256, start, leader, method));
create table posteriors
    (sha256 text, start real, vehicle integer, draws blob,
     primary key (sha256, start, vehicle));
create table failures
    (place text primary key, path text, file text, start real, vehicle integer, reason text,
     is_final integer);
pragma user_version = {FORMAT};
"""
_NAME = re.compile(r"[^\W_][\w .()-]{0,59}")


@dataclass(frozen=True)
class Request:
    """What a study was last asked to do: the arguments of `batch`."""

    sources: tuple[str, ...]
    methods: tuple[str, ...]
    window: Seconds | None
    """Longest window in s; None for whole stretches."""
    case: Case = "II"
    model: str = BEST
    """Of the answer."""
    workers: int | None = None
    scheduler: str | None = None
    mapping: CsvMapping | None = None
    is_finished: bool = False
    """Whether the batch came to its end."""


@dataclass(frozen=True)
class KnownFile:
    """What was read of one file."""

    mapping: str
    """SHA-256 of the mapping it was read by; empty for a file that needs none."""
    recordings: int
    """Recordings in it that could be read."""
    refused: int
    """Trajectories in it that could not be read."""
    windows: tuple[Analysis, ...]
    """The planned windows, each as the analysis by one method."""


@dataclass(frozen=True)
class Failure:
    """Something that has no result."""

    file: str
    start: Seconds | None
    """Start of the window; None for a whole recording."""
    vehicle: int | None
    """The only follower that it concerns; None for all."""
    reason: str


_Count = Annotated[int, msgspec.Meta(ge=-(2**53), le=2**53)]
_Number = Annotated[float, msgspec.Meta(ge=-COMPUTABLE, le=COMPUTABLE)]
_KINDS: dict[str, Any] = {"string": str, "bool": bool, "int64": _Count, "double": _Number}
_Row = msgspec.defstruct(
    "_Row", [(column.name, _KINDS[column.kind] | None, None) for column in COLUMNS]
)
_read_rows = msgspec.json.Decoder(list[_Row]).decode  # type: ignore[valid-type]


class Study:
    """A study while a batch writes to it; one process at a time does so."""

    def __init__(self, folder: Path, request: Request) -> None:
        """Open the study, or make it.

        Raises:
            ConfigError: where the study has another window or Case.
            RecordingError: where it cannot be read or written, or another process writes to it.
        """
        self.folder = folder
        with ExitStack() as opened:
            with reported(
                lambda reason: RecordingError(f"{folder}: it cannot be written ({reason}).")
            ):
                folder.mkdir(parents=True, exist_ok=True)
            with _told(folder):
                lock = opened.enter_context(closing(sqlite3.connect(folder / LOCK, timeout=0)))
                try:
                    lock.execute("begin exclusive")  # as long as this process lives
                except sqlite3.OperationalError as fault:
                    if fault.sqlite_errorname != "SQLITE_BUSY":
                        raise
                    raise RecordingError(
                        f"{folder}: another batch is writing there; wait for its end, or take"
                        " another folder."
                    ) from None
                if not (folder / FILE).exists():
                    _make(folder / FILE)
                self._database = opened.enter_context(closing(_connect(folder)))
                self._database.execute("pragma journal_mode = wal")
                self._database.execute("pragma synchronous = normal")
                kept = _request(self._database)
            if kept and _shared(kept) != _shared(request):
                window, case, model = _shared(kept)
                raise ConfigError(
                    f"{folder}: it holds a batch with window {window}, Case {case} and model"
                    f" {model}; ask for the same, or take another folder."
                )
            self.note(request)
            self._opened = opened.pop_all()

    def __enter__(self) -> Self:
        """The study itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        fault: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Make the files, leave one plain file of the database, and let others write."""
        with self._opened:
            if not isinstance(fault, RecordingError):  # else nothing can be written
                self.publish()
            with suppress(sqlite3.Error):  # somebody reads it just now
                self._database.execute("pragma journal_mode = delete")

    def note(self, request: Request) -> None:
        """Keep what the study is asked to do."""
        document = msgspec.json.encode(request).decode()
        self._write(("delete from request", ()), ("insert into request values (?)", (document,)))

    def known_file(self, sha256: str) -> KnownFile | None:
        """What was read of a file with these bytes; None where it was not read yet."""
        with _told(self.folder):
            row = self._ask("select document from files where sha256 = ?", sha256)
            return msgspec.json.decode(row[0], type=KnownFile) if row else None

    def add_file(self, sha256: str, known: KnownFile) -> None:
        """Keep what was read of a file, by the SHA-256 of its bytes."""
        document = msgspec.json.encode(known).decode()
        self._write(("insert or replace into files values (?, ?)", (sha256, document)))

    def refuse(self, path: Path, reasons: Sequence[str]) -> None:
        """Keep what of a file cannot be used, in place of what was said of that path before.

        Args:
            path: where the file is.
            reasons: one for each recording in it, or one for the whole file.
        """
        failures = [Failure(path.name, None, None, reason) for reason in reasons]
        self._write(
            ("delete from failures where path = ?", (str(path),)),
            *(_failing(f"{path} {k}", path, failure) for k, failure in enumerate(failures)),
        )

    def rows_of(self, analysis: Analysis) -> int | None:
        """How many rows the answer to an analysis has.

        Returns:
            0 where it failed in a way that would come again, None where it is to be run.
        """
        with _told(self.folder):
            row = self._ask(
                "select json_array_length(rows) from results where sha256 = ? and start = ?"
                " and leader = ? and method = ? and key = ? union all"
                " select 0 from failures where place = ? and is_final",
                *_place(analysis), analysis.key, _name(analysis),
            )  # fmt: skip
        return int(row[0]) if row else None

    def add_rows(
        self,
        analysis: Analysis,
        file: str,
        rows: list[dict[str, Any]],
        posteriors: FloatArray | None = None,
    ) -> None:
        """Keep the answer to an analysis, in place of one by an earlier version of its method.

        Args:
            analysis: what was asked.
            file: name of the recording's file, by which rows are ordered.
            rows: one a follower, with the keys of `COLUMNS`.
            posteriors: (M, n, p) draws for the answer of each follower, the same for all methods.
        """
        document = json.dumps(rows, ensure_ascii=False, allow_nan=False)
        values = (*_place(analysis), analysis.key, file, document)
        self._write(
            ("delete from failures where place = ?", (_name(analysis),)),
            ("insert or replace into results values (?, ?, ?, ?, ?, ?, ?)", values),
            *(
                (
                    "insert or replace into posteriors values (?, ?, ?, ?)",
                    (*_place(analysis)[:2], vehicle, drawn.astype("<f8").tobytes()),
                )
                for vehicle, drawn in zip(
                    analysis.vehicles[1:], () if posteriors is None else posteriors, strict=False
                )
            ),
        )

    def add_failure(self, analysis: Analysis, failure: Failure, is_final: bool) -> None:
        """Keep why an analysis has no answer, and whether it would fail again."""
        self._write(_failing(_name(analysis), "", failure, is_final))

    def _ask(self, statement: str, *values: Any) -> Any:
        return self._database.execute(statement, values).fetchone()

    def _write(self, *statements: tuple[str, tuple[Any, ...]]) -> None:
        """One transaction."""
        with _told(self.folder), self._database:
            for statement, values in statements:
                self._database.execute(statement, values)

    def publish(self) -> None:
        """Make the Parquet file, the list of failures and the schema from what is known so far."""
        with _told(self.folder):
            _write_parquet(self.folder / RESULTS, _rows(self._database))
            text = io.StringIO()
            writer = csv.writer(text, lineterminator="\n")
            writer.writerow(FAILURE_COLUMNS)
            writer.writerows(map(astuple, _failures(self._database)))
            write_whole(self.folder / FAILURES, text.getvalue().encode())
            schema = {
                "format": FORMAT,
                "rows": "one a (recording, window, follower, method)",
                "columns": [asdict(column) for column in COLUMNS],
            }
            described = json.dumps(schema, ensure_ascii=False, indent=2)
            write_whole(self.folder / SCHEMA, described.encode())


def _shared(request: Request) -> tuple[str, Case, str]:
    """What all rows of a study have in common."""
    window = "all" if request.window is None else f"{request.window:g}"
    return window, request.case, request.model


def _make(path: Path) -> None:
    """Make an empty study's file in one step: a reader sees all tables or no file."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.executescript(TABLES)
        write_whole(path, database.serialize())


def _place(analysis: Analysis) -> tuple[str, Seconds, int, str]:
    """What a study has one answer for."""
    start, leader = analysis.window.start, analysis.vehicles[0]
    return analysis.source.sha256, start, leader, analysis.method


def _name(analysis: Analysis) -> str:
    """The place of an analysis among failures."""
    return f"{analysis.source.sha256} {analysis.key}"


def _failing(
    place: str, path: Path | str, failure: Failure, is_final: bool = False
) -> tuple[str, tuple[Any, ...]]:
    """The statement that keeps a failure."""
    values = (place, str(path), *astuple(failure), is_final)
    return "insert or replace into failures values (?, ?, ?, ?, ?, ?, ?)", values


# Reading


def read_rows(folder: Path) -> Iterator[dict[str, Any]]:
    """All rows of a study in the order of files, windows, methods and followers.

    A batch may be running meanwhile.

    Raises:
        RecordingError: where there is no study, or it is damaged.
    """
    with _opened(folder) as database:
        yield from _rows(database)


def read_posteriors(folder: Path, width: int) -> dict[tuple[str, Seconds, int], FloatArray]:
    """The posterior draws (n, width) by SHA-256, start and vehicle; see `read_rows`."""
    with _opened(folder) as database:
        return {
            (sha256, start, vehicle): np.frombuffer(raw, "<f8").reshape(-1, width)
            for sha256, start, vehicle, raw in database.execute("select * from posteriors")
        }


def read_failures(folder: Path) -> tuple[Failure, ...]:
    """What has no result, in the order of files; see `read_rows`."""
    with _opened(folder) as database:
        return tuple(_failures(database))


def read_request(folder: Path) -> Request | None:
    """What a study was last asked to do; None where that is not known; see `read_rows`."""
    with _opened(folder) as database:
        return _request(database)


def state_of(folder: Path) -> tuple[int, ...]:
    """Sizes and times that differ whenever a study does; empty where there is none."""
    state: tuple[int, ...] = ()
    for path in (folder / FILE, folder / f"{FILE}-wal"):
        with suppress(OSError):
            status = path.stat()
            state += (status.st_size, status.st_mtime_ns)
    return state


@contextmanager
def _opened(folder: Path) -> Iterator[sqlite3.Connection]:
    if not (folder / FILE).is_file():
        raise RecordingError(f"{folder}: no batch is there; name the folder that batch wrote to.")
    with _told(folder), closing(_connect(folder)) as database:
        yield database


def _connect(folder: Path) -> sqlite3.Connection:
    """The study's file, which is there; it is not made anew where it is gone meanwhile."""
    uri = f"{(folder / FILE).resolve().as_uri()}?mode=rw"
    database = sqlite3.connect(uri, uri=True, timeout=PATIENCE)
    try:
        if database.execute("pragma user_version").fetchone() != (FORMAT,):
            raise RecordingError(
                f"{folder}: the study was written by another version of accpinn; take another"
                " folder."
            )
    except BaseException:
        database.close()
        raise
    return database


def _rows(database: sqlite3.Connection) -> Iterator[dict[str, Any]]:
    asked = "select rows from results order by file, sha256, start, leader, method"
    for (document,) in database.execute(asked):
        yield from map(msgspec.structs.asdict, _read_rows(document))


def _failures(database: sqlite3.Connection) -> Iterator[Failure]:
    columns = ", ".join(FAILURE_COLUMNS)
    for row in database.execute(f"select {columns} from failures order by {columns}"):
        yield msgspec.convert(dict(zip(FAILURE_COLUMNS, row, strict=True)), Failure)


def _request(database: sqlite3.Connection) -> Request | None:
    row = database.execute("select document from request").fetchone()
    request = msgspec.json.decode(row[0], type=Request) if row else None
    if request and request.model not in FOLLOWING:
        raise ValueError(f"its model {request.model[:40]} is not known")
    return request


@contextmanager
def _told(folder: Path) -> Iterator[None]:
    """Turn a fault of the disk, of SQLite or of a document in it into a sentence for the user."""
    try:
        yield
    except (OSError, sqlite3.Error, msgspec.DecodeError, UnicodeDecodeError, TypeError,
            ValueError) as fault:  # fmt: skip
        # A table that is not there, or a text that is none, is no fault of the disk.
        kind = getattr(fault, "sqlite_errorname", "SQLITE_ERROR")
        of_disk = isinstance(fault, sqlite3.OperationalError) and kind != "SQLITE_ERROR"
        if of_disk or isinstance(fault, OSError):
            reason = str(fault) if of_disk else reason_of(fault)
            sentence = (
                f"{folder}: it cannot be written ({reason}); free some space, and give the same"
                " call again, which goes on from here."
            )
        else:
            sentence = f"{folder / FILE}: it is damaged; take another folder, or delete the file."
        raise RecordingError(sentence) from None


def _write_parquet(path: Path, rows: Iterator[dict[str, Any]]) -> None:
    import pyarrow as pa  # takes a third of a second
    from pyarrow import parquet

    schema = pa.schema(
        [
            pa.field(
                column.name,
                pa.type_for_alias(column.kind),
                metadata={"unit": column.unit, "meaning": column.meaning},
            )
            for column in COLUMNS
        ]
    )
    with written_whole(path) as file, parquet.ParquetWriter(file, schema) as writer:
        while chunk := list(islice(rows, CHUNK)):
            writer.write_table(pa.Table.from_pylist(chunk, schema))


# Names


def study_path(name: str, folder: Path) -> Path:
    """The folder of the study of that name, which need not exist.

    Args:
        name: letters, digits, spaces, points and hyphens.
        folder: of all studies.

    Raises:
        ConfigError: for what is no name, and for a link that leads out of the folder.
    """
    path = folder / name
    outside = path.resolve().parent != folder.resolve()
    if not _NAME.fullmatch(name) or name != name.strip(" .") or outside:
        raise ConfigError(
            f'study: "{name[:60]}" is no name; take up to 60 letters, digits, spaces, points and'
            " hyphens, a letter or digit first."
        )
    return path


def studies(folder: Path) -> tuple[str, ...]:
    """The names of the studies in a folder, the one that was written to last first."""
    changed: dict[str, int] = {}
    for path in folder.glob(f"*/{FILE}"):
        name = path.parent.name
        with suppress(AccpinnError):  # a link that leads elsewhere
            changed[name] = max(state_of(study_path(name, folder))[1::2], default=0)
    return tuple(sorted(changed, key=lambda name: -changed[name]))
