"""From a path or an upload to the text bytes of a file; anything else ends here in one sentence."""

import os
from dataclasses import dataclass
from pathlib import Path

from accpinn.errors import RecordingError

LIMIT_BYTES = 100_000_000
"""Larger files are refused; the largest of the database is well below."""

Source = str | os.PathLike[str] | bytes | bytearray | memoryview

_NAME_LENGTH = 100
_SIGNATURES = (
    (b"PK\x03\x04", "a zip archive or an Excel workbook", "unpack it, or save the sheet as CSV"),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook", "save the sheet as CSV"),
    (b"\x1f\x8b", "a gzip archive", "unpack it first"),
    (b"7z\xbc\xaf", "a 7z archive", "unpack it first"),
    (b"\x89PNG", "a PNG image", "choose an OpenACC CSV file"),
    (b"\xff\xd8\xff", "a JPEG image", "choose an OpenACC CSV file"),
    (b"%PDF", "a PDF document", "choose an OpenACC CSV file"),
    (b"\xff\xfe", "UTF-16 text", "save it as plain CSV (UTF-8)"),
    (b"\xfe\xff", "UTF-16 text", "save it as plain CSV (UTF-8)"),
)
_CONTROL = bytes(code for code in range(32) if code not in b"\t\n\r")
_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class SourceFile:
    """The bytes of a file and where they came from."""

    name: str
    folder: str | None
    """The folder's name; None for an upload."""
    raw: bytes

    @property
    def text(self) -> bytes:
        """The bytes without a byte-order mark."""
        return self.raw.removeprefix(_BOM)


def refusal(name: str, fault: str, cure: str, place: str = "") -> RecordingError:
    """One sentence of file, place, fault and cure."""
    where = f"{name}, {place}" if place else name
    return RecordingError(f"{where}: {fault}; {cure}.")


def excerpt(text: str, length: int = 30) -> str:
    """A foreign text on one line, short enough to be part of a sentence."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return line if len(line) <= length else line[: length - 1] + "…"


def read_bytes(source: Source, name: str | None, limit_bytes: int) -> SourceFile:
    """The file's bytes, known to be text of a bearable size."""
    if isinstance(source, bytes | bytearray | memoryview):
        source_file = SourceFile(excerpt(name or "upload", _NAME_LENGTH), None, bytes(source))
    else:
        if not os.fspath(source):
            raise RecordingError("No file is named; name an OpenACC CSV file.")
        source_file = _load(Path(source), name, limit_bytes)
    if len(source_file.raw) > limit_bytes:
        raise _too_large(source_file.name, len(source_file.raw), limit_bytes)
    _require_text(source_file)
    return source_file


def _load(path: Path, name: str | None, limit_bytes: int) -> SourceFile:
    shown = excerpt(name or path.name or str(path), _NAME_LENGTH)
    try:
        if path.is_dir():
            raise refusal(shown, "this is a folder", "name one of the CSV files in it")
        if not path.exists():
            raise refusal(shown, "there is no such file", "check its name and folder")
        if not path.is_file():
            raise refusal(shown, "this is not an ordinary file", "choose an OpenACC CSV file")
        if path.stat().st_size > limit_bytes:
            raise _too_large(shown, path.stat().st_size, limit_bytes)
        return SourceFile(shown, path.resolve().parent.name, path.read_bytes())
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or "no valid path").lower()
        raise refusal(
            shown, f"the file cannot be opened ({reason})", "check its name and permissions"
        ) from error


def _too_large(name: str, size: int, limit: int) -> RecordingError:
    fault = f"the file has {size / 1e6:.1f} MB and the limit is {limit / 1e6:.1f} MB"
    return refusal(name, fault, "split it, or choose a single run")


def _require_text(source_file: SourceFile) -> None:
    text = source_file.text
    if not text.strip():
        raise refusal(source_file.name, "the file is empty", "download or export it again")
    for signature, kind, cure in _SIGNATURES:
        if text.startswith(signature):
            raise refusal(source_file.name, f"this is {kind}, not a CSV file", cure)
    if text[:200].lstrip().startswith(b"<"):
        cure = "download the CSV file itself"
        raise refusal(source_file.name, "this is a web page or XML, not a CSV file", cure)
    if b"\0" in text[:1000]:
        raise refusal(source_file.name, "this is binary data", "choose an OpenACC CSV file")
    if b"\0" in text:
        fault = "NUL bytes instead of text, as after a broken download"
        place = _row_of(text, text.index(b"\0"))
        raise refusal(source_file.name, fault, "download the file again", place)
    if len(text.translate(None, _CONTROL)) != len(text):
        place = _row_of(text, next(i for i, code in enumerate(text) if code in _CONTROL))
        fault = "control characters, as in binary data"
        raise refusal(source_file.name, fault, "download the file again", place)


def _row_of(text: bytes, position: int) -> str:
    return f"row {len(text[: position + 1].splitlines())}"
