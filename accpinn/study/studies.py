"""A study: the folder of one batch, with one SQLite file that holds everything that was found.

Each answer is one transaction, so a process that is killed loses what it was computing and nothing
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
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np

from accpinn.channels import COMPUTABLE
from accpinn.errors import AccpinnError, ConfigError, RecordingError
from accpinn.inference.coordinates import coordinates_of
from accpinn.methods.registry import recommended_method, variant_name
from accpinn.model.cthp import Case
from accpinn.model.registry import BEST, FOLLOWING
from accpinn.recordings.mapping import CsvMapping
from accpinn.storage import (
    csv_cell,
    folder,
    printable,
    reason_of,
    reported,
    write_whole,
    written_whole,
)
from accpinn.study import Analysis
from accpinn.study.rows import COLUMNS
from accpinn.units import FloatArray, Seconds

FILE, RESULTS, FAILURES, SCHEMA, LOCK = (
    "study.sqlite", "results.parquet", "failures.csv", "schema.json", ".lock",
)  # fmt: skip
DROPPED = "recordings"
"""The folder in a study with files that were handed over for it, until its batch has ended."""
FORMAT = 6
"""Raised whenever an older program could not read the SQLite file, or the reverse."""
PATIENCE: Seconds = 30.0
"""Longest wait for a reader or a writer of the SQLite file."""
CHUNK = 5000
"""Rows of the Parquet file that are in memory at a time."""
TABLES = f"""
create table request (document text);
create table files (sha256 text primary key, document text);
create table refused (path text, file text, reason text);
create table answers
    (sha256 text, start real, leader integer, method text, key text, file text, vehicle integer,
     rows text, reason text, is_final integer, primary key (sha256, start, leader, method));
create table posteriors
    (sha256 text, start real, vehicle integer, method text, model text, draws blob,
     primary key (sha256, start, vehicle, method));
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
    """The model that methods estimate where they can."""
    workers: int | None = None
    scheduler: str | None = None
    mapping: CsvMapping | None = None
    is_finished: bool = False
    """Whether the batch came to its end."""


@dataclass(frozen=True)
class KnownFile:
    """What was read of one file."""

    mapping: CsvMapping | None
    """What it was read by; None for a file that needs none."""
    recordings: int
    """Recordings in it that could be read."""
    refused: int
    """Trajectories in it that could not be read."""
    windows: tuple[Analysis, ...]
    """The planned windows, each as the analysis by one method."""


@dataclass(frozen=True, eq=False)
class Computed:
    """What came of one analysis."""

    analysis: Analysis
    rows: Sequence[dict[str, Any]] = ()
    """One a follower, with the keys of `COLUMNS`; empty where it failed."""
    posteriors: FloatArray | None = None
    """(M, n, p) draws of each follower, from which groups are made; None without a posterior."""
    reason: str = ""
    """Why it failed."""
    is_final: bool = True
    """Whether it would come to the same again."""


class StudyError(RecordingError):
    """A study that cannot be read or written."""


class Failure(NamedTuple):
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


# Writing


class Study:
    """A study that a batch writes to, as `written` gives it."""

    def __init__(self, folder: Path, database: sqlite3.Connection) -> None:
        """The folder, and its SQLite file."""
        self.folder, self._database = folder, database

    def note(self, request: Request) -> None:
        """Keep what the study is asked to do."""
        with self._writing() as database:
            database.execute("delete from request")
            database.execute("insert into request values (?)", (_document(request),))

    def known_file(self, sha256: str) -> KnownFile | None:
        """What was read of a file with these bytes; None where it was not read yet."""
        query = "select document from files where sha256 = ?"
        with self._writing() as database:
            row = database.execute(query, (sha256,)).fetchone()
            return msgspec.json.decode(row[0], type=KnownFile) if row else None

    def add_file(self, sha256: str, file: KnownFile) -> None:
        """Keep what was read of a file, by the SHA-256 of its bytes."""
        with self._writing() as database:
            values = (sha256, _document(file))
            database.execute("insert or replace into files values (?, ?)", values)

    def refuse(self, path: Path, reasons: Sequence[str]) -> None:
        """Keep why a file, or recordings in it, cannot be used, in place of earlier reasons."""
        shown, name = printable(path), printable(path.name)
        values = [(shown, name, reason) for reason in reasons]
        with self._writing() as database:
            database.execute("delete from refused where path = ?", (shown,))
            database.executemany("insert into refused values (?, ?, ?)", values)

    def has_namesake(self, name: str, file: KnownFile) -> bool:
        """Whether there are answers from other contents of a file with that name."""
        digests = {window.source.sha256 for window in file.windows}
        with self._writing() as database:
            query = "select distinct sha256 from answers where file = ?"
            return any(sha256 not in digests for (sha256,) in database.execute(query, (name,)))

    def rows_of(self, analysis: Analysis) -> int | None:
        """How many rows the answer to an analysis has.

        Returns:
            0 where it failed in a way that would come again, None where it is to be run.
        """
        query = (
            "select json_array_length(rows) from answers where sha256 = ? and start = ?"
            " and leader = ? and method = ? and key = ? and is_final"
        )
        with self._writing() as database:
            row = database.execute(query, (*_place(analysis), analysis.key)).fetchone()
            return int(row[0]) if row else None

    def add(self, file: str, computed: Computed) -> None:
        """Keep what came of an analysis, in place of one by an earlier version of its method.

        Rows are ordered by the name of the recording's file.
        """
        analysis, place = computed.analysis, _place(computed.analysis)
        _, *followers = analysis.vehicles
        alone = followers[0] if len(followers) == 1 else None
        rows = json.dumps(list(computed.rows), ensure_ascii=False, allow_nan=False)
        reason = f"{_name(analysis)}: {computed.reason}" if computed.reason else None
        values = (*place, analysis.key, file, alone, rows, reason, computed.is_final)
        drawn = () if computed.posteriors is None else computed.posteriors.astype("<f8")
        with self._writing() as database:
            places = ", ".join("?" * len(values))
            database.execute(f"insert or replace into answers values ({places})", values)
            for vehicle, draws in zip(followers, drawn, strict=False):
                posterior_row = (
                    *place[:2],
                    vehicle,
                    place[-1],
                    analysis.spec.model,
                    draws.tobytes(),
                )
                query = "insert or replace into posteriors values (?, ?, ?, ?, ?, ?)"
                database.execute(query, posterior_row)

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """One transaction."""
        with _told(self.folder), self._database:
            yield self._database

    def publish(self) -> None:
        """Make the Parquet file, the list of failures and the schema from what is known so far."""
        with _told(self.folder):
            _write_parquet(self.folder / RESULTS, read_rows(self.folder))
            text = io.StringIO()
            writer = csv.writer(text, lineterminator="\n")
            writer.writerow(Failure._fields)
            for failure in read_failures(self.folder):
                writer.writerow(map(csv_cell, failure))
            write_whole(self.folder / FAILURES, text.getvalue().encode())
            schema = {
                "format": FORMAT,
                "rows": "one a (recording, window, follower, method)",
                "columns": [asdict(column) for column in COLUMNS],
            }
            described = json.dumps(schema, ensure_ascii=False, indent=2)
            write_whole(self.folder / SCHEMA, described.encode())


@contextmanager
def written(folder: Path, request: Request) -> Iterator[Study]:
    """A study that is written to, made where there is none; one process at a time does so.

    At the end its files are made, and one plain file of the database is left.

    Raises:
        ConfigError: where the study has another window, Case or model.
        StudyError: where it cannot be read or written, or another process writes to it.
    """
    with reported(lambda reason: StudyError(f"{folder}: it cannot be written ({reason}).")):
        folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        with _told(folder):
            lock = stack.enter_context(closing(sqlite3.connect(folder / LOCK, timeout=0)))
            lock.execute("begin exclusive")  # as long as this process lives
            if not (folder / FILE).exists():
                _make(folder / FILE)
            database = stack.enter_context(_connected(folder))
            database.execute("pragma journal_mode = wal")
            database.execute("pragma synchronous = normal")
        earlier = read_request(folder)
        if earlier and _shared(earlier) != _shared(request):
            window, case, model = _shared(earlier)
            raise ConfigError(
                f"{folder}: it holds a batch with window {window}, Case {case} and model {model};"
                " ask for the same, or take another folder."
            )
        study = Study(folder, database)
        study.note(request)
        try:
            yield study
        finally:
            study.publish()
            with suppress(sqlite3.Error):  # somebody reads it just now
                database.execute("pragma journal_mode = delete")


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
    return analysis.source.sha256, start, leader, _name(analysis)


def _name(analysis: Analysis) -> str:
    return variant_name(analysis.method, analysis.settings)


def _document(of: object) -> str:
    return msgspec.json.encode(of).decode()


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


# Reading


def read_rows(folder: Path) -> Iterator[dict[str, Any]]:
    """All rows of a study in the order of files, windows, methods and followers.

    A batch may be running meanwhile.

    Raises:
        StudyError: where there is no study, or it is damaged.
    """
    query = "select rows from answers order by file, sha256, start, leader, method"
    with _read(folder) as database:
        for (document,) in database.execute(query):
            yield from map(msgspec.structs.asdict, _read_rows(document))


def read_posteriors(folder: Path, model: str) -> dict[tuple[str, Seconds, int], FloatArray]:
    """The posterior draws (n, p) of a model by SHA-256, start and vehicle; see `read_rows`.

    Where several methods have some, they are those of the model's recommended method.
    """
    query = (
        "select sha256, start, vehicle, draws from posteriors where model = ? order by method = ?"
    )
    width, last = coordinates_of(model).count, recommended_method(model)
    with _read(folder) as database:
        return {
            (sha256, start, vehicle): np.frombuffer(raw, "<f8").reshape(-1, width)
            for sha256, start, vehicle, raw in database.execute(query, (model, last))
        }


def read_failures(folder: Path) -> tuple[Failure, ...]:
    """What has no result, in the order of files; see `read_rows`."""
    query = (
        "select file, null as start, null as vehicle, reason from refused union all"
        " select file, start, vehicle, reason from answers where reason is not null"
        " order by file, start, vehicle, reason"
    )
    with _read(folder) as database:
        return tuple(msgspec.convert(row, Failure) for row in database.execute(query))


def read_request(folder: Path) -> Request | None:
    """What a study was last asked to do; None where that is not known; see `read_rows`."""
    with _read(folder) as database:
        row = database.execute("select document from request").fetchone()
        request = msgspec.json.decode(row[0], type=Request) if row else None
        if request and request.model not in FOLLOWING:
            raise StudyError(
                f"{folder}: its model {request.model[:40]} is not known here; run the script that"
                " registers it first, on the command line by --model FILE.py."
            )
        return request


def state_of(folder: Path) -> tuple[int, ...]:
    """Sizes and times that differ whenever a study does; empty where there is none."""
    state: tuple[int, ...] = ()
    for path in (folder / FILE, folder / f"{FILE}-wal"):
        with suppress(OSError):
            status = path.stat()
            state += (status.st_size, status.st_mtime_ns)
    return state


@contextmanager
def _read(folder: Path) -> Iterator[sqlite3.Connection]:
    if not (folder / FILE).is_file():
        raise StudyError(f"{folder}: no batch is there; name the folder that batch wrote to.")
    with _told(folder), _connected(folder) as database:
        yield database


@contextmanager
def _connected(folder: Path) -> Iterator[sqlite3.Connection]:
    """The study's file, which is there; it is not made anew where it is gone meanwhile."""
    uri = f"{(folder / FILE).resolve().as_uri()}?mode=rw"
    with closing(sqlite3.connect(uri, uri=True, timeout=PATIENCE)) as database:
        if database.execute("pragma user_version").fetchone() != (FORMAT,):
            raise StudyError(
                f"{folder}: the study was written by another version of accpinn; take another"
                " folder."
            )
        yield database


@contextmanager
def _told(folder: Path) -> Iterator[None]:
    """Turn a fault of the disk, of SQLite or of a document in it into a sentence for the user."""
    try:
        yield
    except (OSError, sqlite3.Error, msgspec.DecodeError, TypeError, ValueError) as fault:
        # A table that is not there, or a text that is none, is no fault of the disk.
        kind = getattr(fault, "sqlite_errorname", "SQLITE_ERROR")
        of_disk = isinstance(fault, sqlite3.OperationalError) and kind != "SQLITE_ERROR"
        if kind == "SQLITE_BUSY":
            sentence = (
                f"{folder}: another batch is writing there; wait for its end, or take another"
                " folder."
            )
        elif of_disk or isinstance(fault, OSError):
            reason = str(fault) if of_disk else reason_of(fault)
            sentence = (
                f"{folder}: it cannot be written ({reason}); free some space, and give the same"
                " call again, which goes on from here."
            )
        elif isinstance(fault, UnicodeEncodeError):
            sentence = f"{folder}: a name or text to be kept there is no UTF-8; rename the file."
        else:
            sentence = f"{folder / FILE}: it is damaged; take another folder, or delete the file."
        raise StudyError(sentence) from None


# Names


def study_path(name: str) -> Path:
    """The folder of the study of that name, which need not exist.

    Raises:
        ConfigError: for what is no name, and for a link that leads out of the folder of studies.
    """
    path = folder("studies") / name
    outside = path.resolve().parent != folder("studies").resolve()
    if not _NAME.fullmatch(name) or name != name.strip(" .") or outside:
        raise ConfigError(
            f'study: "{name[:60]}" is no name; take up to 60 letters, digits, spaces, points and'
            " hyphens, a letter or digit first."
        )
    return path


def studies() -> tuple[str, ...]:
    """The names of the user's studies, the one that was written to last first."""
    changed: dict[str, int] = {}
    for path in folder("studies").glob(f"*/{FILE}"):
        name = path.parent.name
        with suppress(AccpinnError):  # a link that leads elsewhere
            changed[name] = max(state_of(study_path(name))[1::2], default=0)
    return tuple(sorted(changed, key=lambda name: -changed[name]))
