"""The table inside a file of any known format, as CSV text.

A kind of file is known by its first bytes, never by its name: plain text, which stays as it is;
UTF-16 text with a byte-order mark; an Excel workbook; a Parquet file; SUMO's floating-car data; and
each of these inside a gzip archive or a zip archive of one file. Bytes of any other kind are handed
back as they are, for the caller to refuse.

What is unpacked obeys the limits of what is read: `LIMIT_BYTES` of text, `LIMIT_CELLS` cells.
Libraries of a format are imported when a file of that format is opened.
"""

import csv
import datetime
import io
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

from accpinn import archives
from accpinn.errors import RecordingError
from accpinn.findings import Finding

if TYPE_CHECKING:
    import zipfile

LIMIT_BYTES = 100_000_000
"""Largest file that is read, in bytes, packed and unpacked; the database's are well below."""
LIMIT_CELLS = 20_000_000
"""Largest table, in cells; at five bytes a cell its text would have the largest size."""
LIMIT_COLUMNS = 20_000
"""Widest table; the widest sheet of a workbook has 16,384 columns."""
LIMIT_MEMBERS = 10_000
"""Most files in a zip archive."""
SHEET_ROWS, SHEET_COLUMNS = 10, 3
"""Least size of the sheet that is read, where a workbook has several."""

Refusal = Callable[[str, str], RecordingError]
"""Makes the error of a file from a fault and its cure."""

UTF8_MARK = b"\xef\xbb\xbf"
GZIP, ZIP = b"\x1f\x8b", b"PK\x03\x04"
_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
_PARQUET = b"PAR1"
_FLOATING_CAR_DATA = b"<fcd-export"
_HEAD_BYTES = 100_000
"""Beginning of an XML file in which its root stands; SUMO's configuration comes before it."""
WORKBOOK = "xl/workbook.xml"
_BROKEN = "download or export it again"
_AGAIN = "download it again, unpack it, or save the sheet as CSV"


class SheetChosen(Finding, frozen=True):
    """A workbook has several sheets, of which one was read."""

    text = 'Of the workbook\'s {count} sheets "{sheet}" was read.'

    sheet: str
    """Name of the sheet that was read."""
    count: int
    """Number of the workbook's sheets."""


@dataclass(frozen=True)
class Contents:
    """The text of a file, and findings about how it was unpacked."""

    text: bytes
    """CSV text without a byte-order mark; the bytes themselves where they are no known kind."""
    findings: tuple[Finding, ...] = ()


def unpacked(raw: bytes, refused: Refusal) -> Contents:
    """The table of a file as CSV text; plain text is handed back without a copy.

    Raises:
        RecordingError: made by ``refused``, when the file is broken, locked or too large.
    """
    if raw.startswith(GZIP):
        import gzip

        try:
            with gzip.GzipFile(fileobj=io.BytesIO(raw)) as stream:
                content = stream.read(LIMIT_BYTES + 1)
        except (OSError, EOFError, zlib.error):
            raise refused("the gzip archive is damaged or cut short", _AGAIN) from None
        if len(content) > LIMIT_BYTES:
            raise _too_large(refused)
        return _table(content, refused)
    if raw.startswith(ZIP):
        return _zipped(raw, refused)
    return _table(raw, refused)


def _table(raw: bytes, refused: Refusal) -> Contents:
    """The text of bytes that are no archive, except that a workbook is one."""
    if raw.startswith(_UTF16_MARKS):
        try:
            raw = raw.decode("utf-16").encode()
        except UnicodeError:
            raise refused("the UTF-16 text is damaged", "save it as plain CSV (UTF-8)") from None
    if raw.startswith(_PARQUET):
        return Contents(_parquet(raw, refused))
    if raw.startswith(ZIP):
        with open_zip(raw, refused) as archive:
            if WORKBOOK in archive.namelist():
                return _workbook(archive, refused)
    text = raw.removeprefix(UTF8_MARK)
    if text[:100].lstrip().startswith(b"<") and _FLOATING_CAR_DATA in text[:_HEAD_BYTES]:
        return Contents(_floating_car_data(text, refused))
    return Contents(text)


# Archives and encodings


def _too_large(refused: Refusal) -> RecordingError:
    fault = f"unpacked, the file has more than {LIMIT_BYTES / 1e6:.1f} MB, which is the limit"
    return refused(fault, "split it, or choose a single run")


def open_zip(raw: bytes, refused: Refusal) -> "zipfile.ZipFile":
    """The zip archive in bytes, with `LIMIT_MEMBERS` files at most."""
    try:
        return archives.open_archive(raw, LIMIT_MEMBERS)
    except archives.TooManyMembers:
        fault = f"the zip archive has more than {LIMIT_MEMBERS} files"
        raise refused(fault, "unpack it, and choose one CSV file") from None
    except (*archives.DAMAGED, NotImplementedError):
        raise refused("the zip archive or Excel workbook is damaged or cut short", _AGAIN) from None


def zip_member(archive: "zipfile.ZipFile", name: str, refused: Refusal, used: int = 0) -> bytes:
    """A file of an archive, which with those before may unpack to the limit."""
    try:
        return archives.read_member(archive, name, LIMIT_BYTES - used)
    except archives.UnpackedTooLarge:
        raise _too_large(refused) from None
    except (archives.UnusualCompression, NotImplementedError):
        cure = "pack it as ordinary zip, or unpack it"
        raise refused("the zip archive is compressed in an unusual way", cure) from None
    except RuntimeError:
        raise refused("the zip archive is locked by a password", "unpack it first") from None
    except archives.DAMAGED:
        raise refused("the zip archive or Excel workbook is damaged or cut short", _AGAIN) from None


def _zipped(raw: bytes, refused: Refusal) -> Contents:
    """A workbook, or the only file of an archive."""
    with open_zip(raw, refused) as archive:
        names = [name for name in archive.namelist() if is_file(name)]
        if WORKBOOK in names:
            return _workbook(archive, refused)
        if any(name == "content.xml" or name.startswith("xl/") for name in names):
            fault = "this is a workbook of a kind that is not read"
            raise refused(fault, "save the sheet as .xlsx or CSV")
        if len(names) != 1:
            fault = f"this is a zip archive with {len(names)} files, not a CSV file"
            raise refused(fault, "unpack it, and choose one of them")
        return _table(zip_member(archive, names[0], refused), refused)


def is_file(name: str) -> bool:
    """Whether an archive's entry is no folder and none of what macOS adds."""
    return not name.endswith("/") and not name.startswith("__MACOSX/")


# Tables


def _csv_text(rows: Iterable[Sequence[str]], refused: Refusal) -> bytes:
    """Rows of cells as CSV; a line end inside a cell becomes a space, so that a row is a line."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    written = 0
    for row in rows:
        if any("\n" in cell or "\r" in cell for cell in row):
            row = [" ".join(cell.splitlines()) for cell in row]
        written += writer.writerow(row)
        if written > LIMIT_BYTES:
            raise _too_large(refused)
    return text.getvalue().encode("utf-8", "replace")


def _require_cells(rows: int, columns: int, refused: Refusal) -> None:
    if rows * columns > LIMIT_CELLS or columns > LIMIT_COLUMNS:
        fault = f"the table has {rows} rows and {columns} columns or more, too many to be read"
        raise refused(fault, "split it, or choose a single run")


def _workbook(archive: "zipfile.ZipFile", refused: Refusal) -> Contents:
    """The first sheet of an .xlsx file that can be a recording, else the first with any cell."""
    import openpyxl

    content = _inflated(archive, refused)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # styles and validations that no cell depends on
            book = openpyxl.load_workbook(content, read_only=True, data_only=True, keep_links=False)
            tables = ((sheet.title, _cells(sheet, refused)) for sheet in book.worksheets)
            name, rows = _first_table(tables)
            count = len(book.worksheets)
    except RecordingError:
        raise
    except Exception as fault:  # a malformed workbook ends in many kinds of errors
        raise refused("the workbook is damaged", f"save the sheet as CSV, or {_BROKEN}") from fault
    width = max(map(len, rows), default=0)
    padded = (row + [""] * (width - len(row)) for row in rows)
    findings = (SheetChosen(name, count),) if count > 1 else ()
    return Contents(_csv_text(padded, refused), findings)


def _inflated(archive: "zipfile.ZipFile", refused: Refusal) -> io.BytesIO:
    """The workbook's parts without compression, so that the library reads checked bytes."""
    import zipfile

    content, used = io.BytesIO(), 0
    with zipfile.ZipFile(content, "w") as copy:
        for name in dict.fromkeys(archive.namelist()):
            if not name.endswith((".xml", ".rels")):
                continue  # pictures, macros and printers
            part = zip_member(archive, name, refused, used)
            used += len(part)
            if b"<!DOCTYPE" in part:
                raise refused("the workbook defines entities", "save the sheet as CSV")
            copy.writestr(name, part)
    content.seek(0)
    return content


def _first_table(tables: Iterable[tuple[str, list[list[str]]]]) -> tuple[str, list[list[str]]]:
    """Name and rows of the sheet to read; sheets behind it are not looked at."""
    fallback: tuple[str, list[list[str]]] = ("", [])
    for name, rows in tables:
        if len(rows) >= SHEET_ROWS and max(map(len, rows)) >= SHEET_COLUMNS:
            return name, rows
        if not fallback[1]:
            fallback = (name, rows)
    return fallback


def _cells(sheet: Any, refused: Refusal) -> list[list[str]]:
    """The cells of a sheet from its first row on, without empty ones at the end of rows."""
    sheet.reset_dimensions()  # the size that a workbook states may be wrong
    rows: list[list[str]] = []
    filled, width = 0, 0
    for values in sheet.iter_rows(values_only=True):
        row = ["" if value is None else _cell(value) for value in values]
        while row and not row[-1]:
            row.pop()
        rows.append(row)
        if row:
            filled, width = len(rows), max(width, len(row))
        _require_cells(filled, width, refused)
    return rows[:filled]


def _cell(value: Any) -> str:
    """A cell's value as text: numbers in full, dates and times as ISO 8601."""
    if isinstance(value, str):
        return value
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    if isinstance(value, datetime.timedelta):  # a clock of more than a day: hours are not limited
        microseconds = value // datetime.timedelta(microseconds=1)
        seconds, fraction = divmod(abs(microseconds), 1_000_000)
        clock = f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
        return "-" * (microseconds < 0) + clock + f".{fraction:06d}" * (fraction > 0)
    return repr(value)


def _parquet(raw: bytes, refused: Refusal) -> bytes:
    """The columns of a Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(pa.BufferReader(raw))
        names, rows = list(file.schema_arrow.names), file.metadata.num_rows
        _require_cells(rows, len(names), refused)
        return _csv_text(_parquet_rows(file, names, rows, refused), refused)
    except RecordingError:
        raise
    except Exception as fault:  # a damaged file ends in many kinds of errors
        raise refused("the Parquet file is damaged", _BROKEN) from fault


def _parquet_rows(
    file: Any, names: list[str], rows: int, refused: Refusal
) -> Iterator[Sequence[str]]:
    """The names, then the rows of a Parquet file."""
    import pyarrow as pa
    import pyarrow.compute as pc

    def texts(name: str, column: Any) -> list[str]:
        kind = column.type
        if pa.types.is_dictionary(kind):
            column, kind = column.dictionary_decode(), kind.value_type
        try:
            if pa.types.is_floating(kind):
                # The shortest digits that give the number back, of its own precision.
                values = column.to_numpy(zero_copy_only=False).astype(str)
                nulls = column.is_null().to_numpy(zero_copy_only=False)
                return ["" if null else str(v) for v, null in zip(values, nulls, strict=True)]
            if pa.types.is_duration(kind):
                nanoseconds = column.cast(pa.duration("ns")).cast(pa.int64()).to_pylist()
                return ["" if n is None else repr(n / 1e9) for n in nanoseconds]
            cells: list[str] = pc.fill_null(column.cast(pa.string()), "").to_pylist()
        except (pa.ArrowNotImplementedError, pa.ArrowTypeError):
            fault = f'column "{name[:60]}" holds no plain values ({str(kind)[:40]})'
            raise refused(fault, "export the file without it") from None
        return cells

    yield names
    read = 0
    for batch in file.iter_batches(batch_size=10_000):
        read += batch.num_rows
        if read > rows:
            raise refused("the Parquet file has more rows than it says", _BROKEN)
        columns = [texts(name, column) for name, column in zip(names, batch.columns, strict=True)]
        yield from zip(*columns, strict=True)
    if read != rows:
        fault = f"the Parquet file has {read} of the {rows} rows it announces"
        raise refused(fault, _BROKEN)


def _floating_car_data(text: bytes, refused: Refusal) -> bytes:
    """One row a vehicle and timestep of SUMO's floating-car data: time, id, other attributes.

    Source: https://sumo.dlr.de/docs/Simulation/Output/FCDOutput.html
    """
    columns: dict[str, int] = {"time": 0, "id": 1}
    rows: list[list[str]] = []
    time = ""

    def opened(element: str, attributes: list[str]) -> None:
        nonlocal time
        if element == "timestep":
            time = dict(zip(attributes[::2], attributes[1::2], strict=True)).get("time", "")
        if element != "vehicle":
            return
        row = [time] + [""] * (len(columns) - 1)
        for name, value in zip(attributes[::2], attributes[1::2], strict=True):
            if name == "time":
                continue  # the timestep's counts
            if columns.setdefault(name, len(columns)) == len(row):
                row.append(value)
            else:
                row[columns[name]] = value
        rows.append(row)
        _require_cells(len(rows), len(columns), refused)

    def forbidden(*_: object) -> None:
        raise refused("the XML file has a document type", "export it again without")

    parser = expat.ParserCreate("UTF-8")
    parser.ordered_attributes = True
    parser.StartElementHandler = opened
    parser.StartDoctypeDeclHandler = forbidden  # no entity can be defined without
    try:
        parser.Parse(text, True)
    except expat.ExpatError as fault:
        place = f"the XML is damaged or cut short at row {fault.lineno}"
        raise refused(place, _BROKEN) from None
    if not rows:
        raise refused("the floating-car data hold no vehicle", "export them again")
    names = list(columns)
    padded = (row + [""] * (len(names) - len(row)) for row in rows)
    return _csv_text((row for part in ((names,), padded) for row in part), refused)
