"""The bytes of a recording's file, from a path or an upload; files without text are refused."""

import hashlib
import io
import os
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TextIO

from accpinn.errors import RecordingError
from accpinn.recordings.containers import GZIP, LIMIT_BYTES, ZIP, Contents, unpacked
from accpinn.storage import reported

Source = str | os.PathLike[str] | bytes | bytearray | memoryview

_NAME_LENGTH = 100
_CHOOSE_CSV = "choose an OpenACC CSV file"
_SIGNATURES = (
    (ZIP, "a zip archive inside another archive", "unpack it first"),
    (
        b"\xd0\xcf\x11\xe0",
        "an old Excel workbook, or one with a password",
        "save the sheet as .xlsx or CSV without a password",
    ),
    (GZIP, "a gzip archive inside another archive", "unpack it first"),
    (b"7z\xbc\xaf", "a 7z archive", "unpack it first"),
    (b"\x89PNG", "a PNG image", _CHOOSE_CSV),
    (b"\xff\xd8\xff", "a JPEG image", _CHOOSE_CSV),
    (b"%PDF", "a PDF document", _CHOOSE_CSV),
)
_CONTROL = bytes(code for code in range(32) if code not in b"\t\n\r")
_FIRST_CONTROL = re.compile(b"[" + re.escape(_CONTROL) + b"]")


@dataclass(frozen=True)
class SourceFile:
    """The bytes of a file and where they came from."""

    name: str
    folder: str | None
    """The folder's name; None for an upload."""
    raw: bytes

    @cached_property
    def contents(self) -> Contents:
        """The table inside, as CSV text, and findings about how it was unpacked.

        Raises:
            RecordingError: when the file is broken, locked or too large.
        """
        return unpacked(self.raw, self.refusal)

    @property
    def text(self) -> bytes:
        """The bytes of the CSV text, without a byte-order mark."""
        return self.contents.text

    @property
    def nbytes(self) -> int:
        """Memory that the file takes, in bytes."""
        return len(self.raw) + (len(self.text) if self.text is not self.raw else 0)

    @cached_property
    def encoding(self) -> str:
        """UTF-8, or else the Western European code page of older spreadsheets."""
        try:
            self.text.decode("utf-8")
        except UnicodeDecodeError:
            return "cp1252"
        return "utf-8"

    @cached_property
    def _content(self) -> "hashlib._Hash":
        return hashlib.sha256(self.raw)

    def sha256(self, trajectory: str | None = None) -> str:
        """SHA-256 of the bytes and, where the file holds several runs, of a trajectory's name."""
        content = self._content.copy()
        content.update((trajectory or "").encode())
        return content.hexdigest()

    @property
    def is_complete(self) -> bool:
        """Whether the last row has a line end, so that its last cell is whole."""
        return self.text.endswith((b"\n", b"\r"))

    def lines(self, limit: int | None = None) -> TextIO:
        """The rows of the first bytes as texts with any line end, without blank rows at the end."""
        text = io.BytesIO(self.text[:limit].rstrip())
        return io.TextIOWrapper(text, self.encoding, "replace")

    def refusal(self, fault: str, cure: str, place: str = "") -> RecordingError:
        """The error for this file: place, fault and cure in one sentence."""
        return _refusal(f"{self.name}, {place}" if place else self.name, fault, cure)


def _refusal(where: str, fault: str, cure: str) -> RecordingError:
    return RecordingError(f"{where}: {fault}; {cure}.")


def excerpt(text: str, length: int = 30) -> str:
    """A foreign text on one line, short enough to be part of a sentence."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return line if len(line) <= length else line[: length - 1] + "…"


def read_bytes(source: Source, name: str | None) -> SourceFile:
    """Read a file of text up to `LIMIT_BYTES`; by default its path names it.

    Raises:
        RecordingError: when the file cannot be read, is too large or is no text.
    """
    if isinstance(source, bytes | bytearray | memoryview):
        source_file = SourceFile(excerpt(name or "upload", _NAME_LENGTH), None, bytes(source))
    elif not os.fspath(source):
        raise RecordingError("No file is named; name an OpenACC CSV file.")
    else:
        source_file = _load(Path(source), name)
    _require_size(source_file.name, len(source_file.raw))
    _require_text(source_file)
    return source_file


def _load(path: Path, name: str | None) -> SourceFile:
    shown = excerpt(name or path.name or str(path), _NAME_LENGTH)

    def unopened(reason: str) -> RecordingError:
        fault = f"the file cannot be opened ({reason.lower()})"
        return _refusal(shown, fault, "check its name and permissions")

    with reported(unopened):
        if path.is_dir():
            raise _refusal(shown, "this is a folder", "name one of the CSV files in it")
        if not path.exists():
            raise _refusal(shown, "there is no such file", "check its name and folder")
        if not path.is_file():
            raise _refusal(shown, "this is not an ordinary file", _CHOOSE_CSV)
        _require_size(shown, path.stat().st_size)
        return SourceFile(shown, path.resolve().parent.name, path.read_bytes())


def _require_size(name: str, size: int) -> None:
    if size > LIMIT_BYTES:
        fault = f"the file has {size / 1e6:.1f} MB and the limit is {LIMIT_BYTES / 1e6:.1f} MB"
        raise _refusal(name, fault, "split it, or choose a single run")


def _require_text(source_file: SourceFile) -> None:
    text = source_file.text
    if not text.strip():
        raise source_file.refusal("the file is empty", "download or export it again")
    for signature, kind, cure in _SIGNATURES:
        if text.startswith(signature):
            raise source_file.refusal(f"this is {kind}, not a CSV file", cure)
    if text[:200].lstrip().startswith(b"<"):
        cure = "download the CSV file itself"
        raise source_file.refusal("this is a web page or XML, not a CSV file", cure)
    if b"\0" in text[:1000]:
        raise source_file.refusal("this is binary data", _CHOOSE_CSV)
    if control := _FIRST_CONTROL.search(text):
        position = control.start()
        broken = "NUL bytes instead of text, as after a broken download"
        fault = "control characters, as in binary data" if text[position] else broken
        place = f"row {len(text[: position + 1].splitlines())}"
        raise source_file.refusal(fault, "download the file again", place)
