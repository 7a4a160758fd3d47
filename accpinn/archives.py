"""Zip archives from untrusted sources, read within limits.

A directory may announce a thousand bytes where a gigabyte follows, and hold a million entries. So
entries are counted before the directory is read, and no member is inflated beyond one byte more
than its reader's limit, whatever size is announced. Members are stored or deflated: other methods
inflate blocks as a whole, which cannot be bounded.
"""

import io
import zipfile
import zlib

_ENTRY = b"PK\x01\x02"
"""Begins each entry of a directory."""
DAMAGED = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, KeyError)
"""Errors of an archive that is damaged or cut short."""


class UnpackedTooLarge(Exception):
    """A member holds more than its reader takes."""


class TooManyMembers(Exception):
    """An archive has more members than its reader takes."""


class UnusualCompression(Exception):
    """A member is compressed by another method than deflate."""


def open_archive(raw: bytes, most: int) -> zipfile.ZipFile:
    """The archive in bytes, with so many members at most.

    Raises:
        TooManyMembers: for one with more.
        Exception: one of `DAMAGED`.
    """
    if raw.count(_ENTRY) > most:
        raise TooManyMembers
    archive = zipfile.ZipFile(io.BytesIO(raw))
    if len(archive.infolist()) > most:
        raise TooManyMembers
    return archive


def read_member(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """The content of a member, which has so many bytes at most.

    Raises:
        UnpackedTooLarge: for one with more, of which no more than one byte is inflated.
        UnusualCompression: where it is neither stored nor deflated.
        RuntimeError: where it is locked by a password.
        Exception: one of `DAMAGED`.
    """
    entry = archive.getinfo(name)
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise UnusualCompression
    if entry.file_size > most:
        raise UnpackedTooLarge
    with archive.open(entry) as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise UnpackedTooLarge
    return content
