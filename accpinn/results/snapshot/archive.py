"""Named bytes, and named arrays, in one file: a zip in which every byte follows from the contents.

Nothing is compressed, all times and attributes are fixed, the order is that of the names given, and
there are neither comments nor extra fields. Reading therefore needs no trust: what `pack` would
not have written, to the last byte, is refused. Arrays are `.npy` members as numpy writes them; a
header is believed only once its shape accounts for every byte that follows.
"""

import re
import zipfile
from collections.abc import Mapping
from io import BytesIO
from math import prod
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from accpinn.errors import SnapshotError
from accpinn.serial import Arrays

BEGINNING = b"PK\3\4"
_LISTED = b"PK\1\2"
"""Begins the record of each entry in the list of contents."""
MOST_ENTRIES = 2_000
"""Of a file, those of the parts within it included; more are not even listed."""
PLAIN_FILE = 0o100644 << 16
"""Attributes of every entry: a regular file that its owner may change and all may read."""
NEW_YEAR_1980 = (1980, 1, 1, 0, 0, 0)
UNIX, ENCRYPTED = 3, 1

SUFFIX = ".npy"
TYPES = ("<f8", "<f4", "|b1")
_NAME = re.compile(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*\.npy")
"""Of an array, as "arrays.hidden.layers.0.weight.npy": nothing that could be a path."""


def pack(entries: Mapping[str, bytes]) -> bytes:
    """The file with these entries, in this order."""
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, content in entries.items():
            entry = zipfile.ZipInfo(name, NEW_YEAR_1980)
            entry.create_system, entry.external_attr = UNIX, PLAIN_FILE
            archive.writestr(entry, content)
    return buffer.getvalue()


def unpack(data: bytes, what: str) -> dict[str, bytes]:
    """The entries of a file that `pack` wrote.

    Args:
        data: its bytes; the caller has bounded their number.
        what: how sentences name it, as "The snapshot".

    Raises:
        SnapshotError: for any other file; nothing is unpacked that is larger than the file.
    """
    if data.count(_LISTED) > MOST_ENTRIES:
        raise SnapshotError(
            f"{what} lists {data.count(_LISTED):,} entries; a genuine one never has more than"
            f" {MOST_ENTRIES:,}."
        )
    name = "the list of its contents"
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            _check_listed(archive.infolist(), len(data), what)
            entries = {}
            for entry in archive.infolist():
                name = entry.filename
                entries[name] = archive.read(entry)
        name = "the archive's own records"
        same = pack(entries) == data
    except SnapshotError:
        raise
    except Exception:  # zipfile raises many kinds for foreign bytes
        same = False
    if not same:
        raise SnapshotError(f"{what} is damaged in {_shown(name)}; get the file anew.")
    return entries


def _shown(text: str) -> str:
    """Harmless on every terminal."""
    return text.encode("ascii", "backslashreplace").decode()[:80]


def _check_listed(listed: list[zipfile.ZipInfo], size: int, what: str) -> None:
    for entry in listed:
        name = _shown(entry.filename)
        if entry.compress_type != zipfile.ZIP_STORED or entry.compress_size != entry.file_size:
            raise SnapshotError(f'{what} has "{name}" compressed; a genuine one has nothing so.')
        if entry.flag_bits & ENCRYPTED:
            raise SnapshotError(f'{what} has "{name}" encrypted; a genuine one has nothing so.')
    if len({entry.filename for entry in listed}) < len(listed):
        raise SnapshotError(f"{what} lists a name twice; a genuine one never does.")
    if sum(entry.file_size for entry in listed) > size:
        raise SnapshotError(f"{what} is damaged: its entries overlap; get the file anew.")


def pack_arrays(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """The arrays as one uncompressed `.npz`."""
    return pack({name + SUFFIX: _member(values) for name, values in sorted(arrays.items())})


def _member(values: NDArray[Any]) -> bytes:
    buffer = BytesIO()
    plain = np.ascontiguousarray(values).reshape(values.shape)
    npy.write_array(buffer, plain, version=(1, 0), allow_pickle=False)
    return buffer.getvalue()


def unpack_arrays(data: bytes, what: str) -> Arrays:
    """The arrays of an `.npz` that `pack_arrays` wrote.

    Args:
        data: its bytes.
        what: how sentences name it, as "the estimate".

    Raises:
        SnapshotError: for anything else; memory is taken only for what the file itself holds.
    """
    members = unpack(data, f"The part with {what}")
    for name in members:
        if not _NAME.fullmatch(name):
            raise SnapshotError(f"The snapshot is refused: in {what}, {_shown(name)} is no name.")
    return {
        name.removesuffix(SUFFIX): _array(member, f"{what}, {name}")
        for name, member in members.items()
    }


def _array(member: bytes, place: str) -> NDArray[Any]:
    file = BytesIO(member)
    try:
        npy.read_magic(file)
        shape, _, dtype = npy.read_array_header_1_0(file)
        size = len(member) - file.tell()
        if dtype.str not in TYPES or prod(shape) * dtype.itemsize != size:
            raise ValueError(f"has {size:,} bytes and claims {shape} of {dtype}"[:80])
        file.seek(0)
        values: NDArray[Any] = npy.read_array(file, allow_pickle=False)
        if _member(values) != member:
            raise ValueError("is not as numpy writes it")
    except Exception as fault:  # numpy's parser raises many kinds for foreign bytes
        raise SnapshotError(
            f"The snapshot is refused: {place} is no plain array of numbers ({_shown(str(fault))})."
        ) from None
    return values
