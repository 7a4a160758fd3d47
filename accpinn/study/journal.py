"""A batch's folder: what is known so far, written as it comes, and the files made of it.

`journal.jsonl` has one line for each recording that was planned, each method's result on a window,
each vehicle's pooled parameters and each failure. A line is whole or it does not count, so a
process that is killed loses the line it was writing and no other; a line that was damaged later is
passed over, and its results are computed again. `results.parquet`,
`pooled.parquet`, `failures.csv` and `schema.json` are made from it in one step each, at the end of
a run and from time to time.
"""

import csv
import io
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any

import msgspec
from filelock import FileLock, Timeout

from accpinn.channels import COMPUTABLE
from accpinn.errors import ConfigError, RecordingError
from accpinn.study.pooling import ONE_RECORDING, POOLED_COLUMNS, SHARED
from accpinn.study.rows import COLUMNS, RowColumn

JOURNAL, RESULTS, POOLED, FAILURES, SCHEMA, SETTINGS, LOCK = (
    "journal.jsonl", "results.parquet", "pooled.parquet", "failures.csv", "schema.json",
    "study.json", ".lock",
)  # fmt: skip
FAILURE_COLUMNS = ("file", "start", "vehicle", "reason")
"""The fields of a `Failure`."""
FORMAT = 1
"""Raised whenever the same request would give other rows."""


@dataclass(frozen=True)
class Failure:
    """Something that has no result."""

    file: str
    start: float | None
    """Of the window in s; None for a whole recording."""
    vehicle: int | None
    """The only one that it concerns; None for all."""
    reason: str


@dataclass
class Known:
    """What a journal says, without the rows themselves."""

    results: dict[str, int] = field(default_factory=dict)
    """Rows by key of a result."""
    failures: dict[str, Failure] = field(default_factory=dict)
    """By key of what failed."""
    pooled: set[str] = field(default_factory=set)
    """Keys of the vehicles whose pooled parameters are known."""
    final: set[str] = field(default_factory=set)
    """Keys of failures that would come again."""
    plans: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    """Planned windows by the recording's SHA-256."""
    recordings: dict[str, dict[str, Any]] = field(default_factory=dict)
    """What was read of each file, by the SHA-256 of its bytes."""


_Count = Annotated[int, msgspec.Meta(ge=-(2**53), le=2**53)]
_Number = Annotated[float, msgspec.Meta(ge=-COMPUTABLE, le=COMPUTABLE)]
_KINDS: dict[str, Any] = {"string": str, "bool": bool, "int64": _Count, "double": _Number}


def _fields(columns: Iterable[RowColumn], needed: Sequence[str] = ()) -> list[tuple[str, Any, Any]]:
    """Of a structure with these columns, all but those ``needed`` possibly empty."""
    kinds = {one.name: _KINDS[one.kind] for one in columns}
    must = [(name, kinds.pop(name), msgspec.NODEFAULT) for name in needed]
    return [*must, *((name, kind | None, None) for name, kind in kinds.items())]


_Row = msgspec.defstruct("_Row", _fields(COLUMNS))
_PooledRow = msgspec.defstruct("_PooledRow", _fields(POOLED_COLUMNS, ("windows", "duration")))
_Window = msgspec.defstruct(
    "_Window", [("vehicles", list[int]), ("start", float), ("duration", float)]
)
_NEEDED: dict[str, list[tuple[Any, ...]]] = {
    "recording": [
        ("file", str), ("recordings", list[str]), ("refused", int), ("mapping", str | None, None),
    ],
    "plan": [("windows", list[_Window])],  # type: ignore[valid-type]
    "result": [("rows", list[_Row])],  # type: ignore[valid-type]
    "pooled": [("row", _PooledRow)],
    "failure": [
        ("file", str), ("start", float | None), ("vehicle", int | None), ("reason", str),
        ("final", bool),
    ],
    "recovered": [],
}  # fmt: skip
_FORMS = {
    kind: msgspec.defstruct(f"_{kind.title()}", [("key", str), *needed])
    for kind, needed in _NEEDED.items()
}
"""Of each kind of line, what whoever reads it relies on."""


class Journal:
    """The folder of one batch, while a process writes to it."""

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        """Open or make it.

        Args:
            folder: of the batch.
            settings: what all of its rows share; another call must have the same.

        Raises:
            ConfigError: where it was made with other settings.
            RecordingError: where it cannot be written, or another process writes there.
        """
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = FileLock(folder / LOCK)
            self._lock.acquire(timeout=0)
        except Timeout:
            raise RecordingError(
                f"{folder}: another batch is writing there; wait for its end, or take another"
                " folder."
            ) from None
        except OSError as fault:
            raise RecordingError(f"{folder}: it cannot be written ({fault.strerror}).") from None
        try:
            self._require_same(settings)
            self.known = Known()
            for line in _lines(folder / JOURNAL, repair=True):
                _take(self.known, line)
            self._file = (folder / JOURNAL).open("a", encoding="utf-8")
        except BaseException:
            self._lock.release()
            raise

    def __enter__(self) -> "Journal":
        """The journal itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        fault: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Make the files, and let others write."""
        try:
            if not isinstance(fault, RecordingError):  # else nothing can be written
                self.publish()
            self._file.close()
        except OSError as error:
            raise self._unwritten(error) from None
        finally:
            with suppress(OSError):  # what it still holds is lost, as was said
                self._file.close()
            self._lock.release()

    def _unwritten(self, fault: OSError) -> RecordingError:
        return RecordingError(
            f"{self.folder}: it cannot be written ({fault.strerror}); free some space, and give the"
            " same call again, which goes on from here."
        )

    def add(self, kind: str, key: str, **content: Any) -> None:
        """Write one line, so that it survives the end of this process.

        Args:
            kind: "recording", "plan", "result", "pooled", "failure" or "recovered".
            key: what the line is about; a later one with the same key takes its place.
            content: the rest.

        Raises:
            RecordingError: where the disk is full, or the folder gone.
        """
        line = {"kind": kind, "key": key} | content
        try:
            self._file.write(json.dumps(line, ensure_ascii=False, allow_nan=False) + "\n")
            self._file.flush()  # to the system, which outlives this process
        except OSError as fault:
            raise self._unwritten(fault) from None
        _take(self.known, line)

    def publish(self) -> None:
        """Make the files from what is known so far."""
        write_parquet(self.folder / RESULTS, COLUMNS, read_rows(self.folder))
        write_parquet(self.folder / POOLED, POOLED_COLUMNS, read_pooled(self.folder))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(FAILURE_COLUMNS)
        failures = [_sortable(asdict(one), FAILURE_COLUMNS) for one in self.known.failures.values()]
        writer.writerows([cell for _, cell in cells] for cells in sorted(failures))
        replace_file(self.folder / FAILURES, text.getvalue().encode())
        schema = {
            "format": FORMAT,
            "rows": "one a (recording, window, follower, method)",
            "columns": [asdict(column) for column in COLUMNS],
            "pooled_rows": "one a vehicle and setting",
            "pooled_columns": [asdict(column) for column in POOLED_COLUMNS],
        }
        replace_file(
            self.folder / SCHEMA, json.dumps(schema, ensure_ascii=False, indent=2).encode()
        )

    def _require_same(self, settings: dict[str, Any]) -> None:
        place = self.folder / SETTINGS
        wanted = settings | {"format": FORMAT}
        try:
            kept = json.loads(place.read_text(encoding="utf-8"))
        except FileNotFoundError:
            replace_file(place, json.dumps(wanted, indent=2).encode())
            return
        except (OSError, ValueError):
            raise ConfigError(f"{place}: it cannot be read; take another folder.") from None
        if not isinstance(kept, dict):
            raise ConfigError(f"{place}: it cannot be read; take another folder.")
        differing = [name for name in wanted if kept.get(name) != wanted[name]]
        if differing:
            said = ", ".join(f"{name} {str(kept.get(name))[:40]}" for name in differing)
            raise ConfigError(
                f"{self.folder}: it holds a batch with {said}; ask for the same, or take another"
                " folder."
            )


def _take(known: Known, line: dict[str, Any]) -> None:
    kind, key = line["kind"], line["key"]
    if kind == "recording":
        known.recordings[key] = line
    elif kind == "plan":
        known.plans[key] = line["windows"]
    elif kind == "result":
        known.results[key] = len(line["rows"])
        known.failures.pop(key, None)
    elif kind == "failure":
        known.failures[key] = Failure(*(line[name] for name in FAILURE_COLUMNS))
        known.final.discard(key)
        if line["final"]:
            known.final.add(key)
    elif kind == "pooled":
        known.pooled.add(key)
        known.failures.pop(key, None)
    elif kind == "recovered":
        known.failures.pop(key, None)


def _lines(path: Path, repair: bool = False) -> Iterator[dict[str, Any]]:
    """The lines of a journal that count; a broken last one is cut off where that is asked for."""
    try:
        file = path.open("rb+" if repair else "rb")
    except FileNotFoundError:
        return
    with file:
        whole = 0
        for place, raw in _whole_lines(file):
            whole = place + len(raw)
            line = _line(raw)
            if line is not None:
                yield line
        if repair:
            file.truncate(whole)


def _whole_lines(file: Iterable[bytes]) -> Iterator[tuple[int, bytes]]:
    """Each with the place where it begins; only the last line of a journal may be broken."""
    place = 0
    for raw in file:
        if raw.endswith(b"\n"):
            yield place, raw
        place += len(raw)


def _line(raw: bytes) -> dict[str, Any] | None:
    """A line as it was written, with all columns; None where it was damaged since."""
    try:
        line: Any = msgspec.json.decode(raw)
        kind = line.get("kind") if isinstance(line, dict) else None
        if not isinstance(kind, str) or kind not in _FORMS:
            return None
        found: dict[str, Any] = msgspec.to_builtins(msgspec.convert(line, _FORMS[kind]))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    return {"kind": kind} | found


def damaged_lines(folder: Path) -> int:
    """How many whole lines of a batch's journal do not count, as they were damaged since."""
    try:
        with (folder / JOURNAL).open("rb") as file:
            return sum(_line(raw) is None for _, raw in _whole_lines(file))
    except FileNotFoundError:
        return 0


def read_rows(folder: Path) -> Iterator[dict[str, Any]]:
    """All rows of a batch, also of one that is running; none twice.

    They come in the order of files, windows and methods, whatever ended first, so that a batch that
    is computed again has the same table but for the seconds it took.
    """
    found: dict[str, tuple[tuple[Any, ...], int]] = {}
    try:
        file = (folder / JOURNAL).open("rb")
    except FileNotFoundError:
        return
    with file:
        for place, raw in _whole_lines(file):
            line = _line(raw)
            if line is not None and line["kind"] == "result" and line["rows"]:
                order = _sortable(line["rows"][0], ("file", "sha256", "start", "vehicle", "method"))
                found.setdefault(line["key"], (order, place))
        for _, place in sorted(found.values()):
            file.seek(place)
            again = _line(file.readline())
            yield from again["rows"] if again else ()


def read_pooled(folder: Path) -> Iterator[dict[str, Any]]:
    """The vehicles' pooled parameters: for each vehicle and setting the latest, in their order."""
    found: dict[tuple[Any, ...], dict[str, Any]] = {}
    for line in _lines(folder / JOURNAL):
        if line["kind"] == "pooled":
            found[_sortable(line["row"], (*SHARED, *ONE_RECORDING))] = line["row"]
    return (found[key] for key in sorted(found))


def _sortable(row: dict[str, Any], names: Sequence[str]) -> tuple[Any, ...]:
    """Some cells of a row; an empty one comes before any other."""
    return tuple((row[name] is not None, row[name]) for name in names)


def read_settings(folder: Path) -> dict[str, Any]:
    """What all rows of a batch share, "window" and "case"; empty where it cannot be read."""
    try:
        found = json.loads((folder / SETTINGS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def read_failures(folder: Path) -> tuple[Failure, ...]:
    """What has no result, also of a batch that is running."""
    known = Known()
    for line in _lines(folder / JOURNAL):
        _take(known, line)
    return tuple(known.failures.values())


def write_parquet(
    path: Path, columns: Sequence[RowColumn], found: Iterable[dict[str, Any]]
) -> None:
    """Make a Parquet file of rows, a part at a time and in one step.

    Args:
        path: of the file.
        columns: their names, kinds and units.
        found: the rows.
    """
    import pyarrow as pa  # takes a third of a second
    from pyarrow import parquet

    kinds = {"string": pa.string(), "bool": pa.bool_(), "int64": pa.int64(), "double": pa.float64()}
    schema = pa.schema(
        [
            pa.field(one.name, kinds[one.kind], metadata={"unit": one.unit, "meaning": one.meaning})
            for one in columns
        ]
    )
    with _in_one_step(path) as part, parquet.ParquetWriter(part, schema) as writer:
        rows: list[dict[str, Any]] = []
        for row in found:
            rows.append(row)
            if len(rows) == 5000:
                writer.write_table(pa.Table.from_pylist(rows, schema))
                rows.clear()
        writer.write_table(pa.Table.from_pylist(rows, schema))


def replace_file(path: Path, content: bytes) -> None:
    """Write a file in one step.

    Raises:
        OSError: where it cannot be written; the old one is then as it was.
    """
    with _in_one_step(path) as part:
        part.write_bytes(content)


@contextmanager
def _in_one_step(path: Path) -> Iterator[Path]:
    """A file beside the path, which takes its place once it is whole."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        os.replace(part, path)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
