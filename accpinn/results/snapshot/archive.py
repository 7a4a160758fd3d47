"""Named bytes in one file: a zip in which every byte is determined by the names and contents.

Nothing is compressed, all times and attributes are fixed, the order is that of the names given, and
there are neither comments nor extra fields. Reading therefore needs no trust: what `pack` would
not have written, to the last byte, is refused.
"""

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

from accpinn.errors import SnapshotError

LOCAL = struct.Struct("<4s5H3I2H")
CENTRAL = struct.Struct("<4s6H3I5H2I")
END = struct.Struct("<4s4H2IH")
LOCAL_MARK, CENTRAL_MARK, END_MARK = b"PK\3\4", b"PK\1\2", b"PK\5\6"
VERSION = 20
"""Of the format that is needed to read: plain zip."""
UNIX = 3 << 8 | VERSION
MIDNIGHT, NEW_YEAR_1980 = 0, 1 << 5 | 1
PLAIN_FILE = 0o100644 << 16
"""Attributes of every entry: a regular file that its owner may change and all may read."""
STORED, ENCRYPTED = 0, 1
LONGEST_NAME = 100


def pack(entries: Mapping[str, bytes]) -> bytes:
    """The file with these entries, in this order."""
    parts: list[bytes] = []
    directory: list[bytes] = []
    position = 0
    for name, content in entries.items():
        label, size, checksum = name.encode("ascii"), len(content), zlib.crc32(content)
        about = (STORED, MIDNIGHT, NEW_YEAR_1980, checksum, size, size, len(label), 0)
        parts += [LOCAL.pack(LOCAL_MARK, VERSION, 0, *about), label, content]
        head = CENTRAL.pack(CENTRAL_MARK, UNIX, VERSION, 0, *about, 0, 0, 0, PLAIN_FILE, position)
        directory += [head, label]
        position += LOCAL.size + len(label) + size
    listing = b"".join(directory)
    count = len(entries)
    end = END.pack(END_MARK, 0, 0, count, count, len(listing), position, 0)
    return b"".join([*parts, listing, end])


def contents(data: bytes, what: str, most: int) -> dict[str, bytes]:
    """The entries of a file, which may still differ from what `pack` makes of them.

    Args:
        data: the whole file.
        what: how sentences name it, as "The snapshot".
        most: entries at most.

    Raises:
        SnapshotError: for a list of entries that `pack` would not have written.
    """
    return {
        entry.name: data[entry.start : entry.start + entry.size]
        for entry in _listing(data, what, most)
    }


def check_packed(data: bytes, entries: Mapping[str, bytes], what: str) -> None:
    """Refuse a file that is not, to the last byte, what `pack` makes of its entries.

    Raises:
        SnapshotError: in one sentence.
    """
    if data != pack(entries):
        raise SnapshotError(
            f"{what} is damaged: the archive's own records differ from its contents; get the file"
            " anew."
        )


@dataclass(frozen=True)
class _Entry:
    name: str
    place: int
    """Where its own record begins."""
    start: int
    """Where its content begins."""
    size: int


def _listing(data: bytes, what: str, most: int) -> list[_Entry]:
    """The entries that the directory at the end names, after all that can be checked early."""
    end = len(data) - END.size
    if end < 0 or data[end : end + 4] != END_MARK:
        raise SnapshotError(
            f"{what} is damaged: the list of its contents at the end is missing; get the file anew."
        )
    _, _, _, _, count, length, position, _ = END.unpack_from(data, end)
    if count > most:
        raise SnapshotError(
            f"{what} lists {count:,} entries; a genuine one never has more than {most}."
        )
    if position + length != end:
        raise SnapshotError(
            f"{what} is damaged: the list of its contents is incomplete; get the file anew."
        )
    entries: list[_Entry] = []
    free = 0
    for _ in range(count):
        entry, position = _entry(data, position, end, what)
        if entry.place != free:
            raise SnapshotError(
                f'{what} is damaged: "{entry.name}" is not where it belongs; get the file anew.'
            )
        free = entry.start + entry.size
        if any(entry.name == other.name for other in entries):
            raise SnapshotError(f'{what} lists "{entry.name}" twice; a genuine one never does.')
        entries.append(entry)
    return entries


def _entry(data: bytes, position: int, end: int, what: str) -> tuple[_Entry, int]:
    """One entry of the directory, and where the next one begins."""
    damaged = SnapshotError(
        f"{what} is damaged: the list of its contents cannot be read; get the file anew."
    )
    if position + CENTRAL.size > end or data[position : position + 4] != CENTRAL_MARK:
        raise damaged
    fields = CENTRAL.unpack_from(data, position)
    _, _, _, flags, method, _, _, _, packed, size, length, extra, comment, _, _, mode, at = fields
    begin, position = position + CENTRAL.size, position + CENTRAL.size + length
    if length > LONGEST_NAME or extra or comment or position > end:
        raise damaged
    name = data[begin:position].decode("ascii", errors="backslashreplace")
    if method != STORED or packed != size:
        raise SnapshotError(f'{what} has "{name}" compressed; a genuine one has nothing so.')
    if flags & ENCRYPTED:
        raise SnapshotError(f'{what} has "{name}" encrypted; a genuine one has nothing so.')
    if mode != PLAIN_FILE:
        raise SnapshotError(f'{what} has "{name}", which is no plain file, so it is refused.')
    start = at + LOCAL.size + length
    if start + size > end:
        raise damaged
    return _Entry(name, at, start, size), position
