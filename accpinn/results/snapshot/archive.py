"""Snapshots as bytes: a zip in which every byte follows from the contents.

Nothing is compressed, all times and attributes are fixed, the order is that of the names given, and
there are neither comments nor extra fields. Reading therefore needs no trust: what `pack` would
not have written, to the last byte, is refused. Arrays are `.npy` members as numpy writes them; a
header is believed only once its shape accounts for every byte that follows. A manifest holds the
length and digest of every other part.
"""

import hashlib
import os
import re
import zipfile
from collections.abc import Mapping
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from accpinn.errors import AccpinnError, SnapshotError
from accpinn.results.snapshot import (
    ATTRIBUTION,
    FORMAT,
    LARGEST,
    LARGEST_DOCUMENT,
    MANIFEST,
    PARTS,
    SCHEMA,
    TITLES,
    Snapshot,
)
from accpinn.results.snapshot.validate import check_numbers, is_harmless, sanitise, validate
from accpinn.serial import Arrays, dump, read_json, restore, write_json

BEGINNING = b"PK\3\4"
_LISTED = b"PK\1\2"
"""Begins the record of each entry in the list of contents."""
MOST_ENTRIES = 2_000
"""Of a file, those of the parts within it included; more are not even listed."""
PLAIN_FILE = 0o100644 << 16
"""Attributes of every entry: a regular file that its owner may change and all may read."""
NEW_YEAR_1980 = (1980, 1, 1, 0, 0, 0)
UNIX = 3

MEMBER = ".npy"
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
    """Harmless on every terminal, and on one line."""
    return text.encode("unicode_escape").decode()[:80]


def _check_listed(listed: list[zipfile.ZipInfo], size: int, what: str) -> None:
    for entry in listed:
        name = _shown(entry.filename)
        if entry.compress_type != zipfile.ZIP_STORED or entry.compress_size != entry.file_size:
            raise SnapshotError(f'{what} has "{name}" compressed; a genuine one has nothing so.')
    if len({entry.filename for entry in listed}) < len(listed):
        raise SnapshotError(f"{what} lists a name twice; a genuine one never does.")
    if sum(entry.file_size for entry in listed) > size:
        raise SnapshotError(f"{what} is damaged: its entries overlap; get the file anew.")


def pack_arrays(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """The arrays as one uncompressed `.npz`."""
    return pack({name + MEMBER: _member(values) for name, values in sorted(arrays.items())})


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
        name.removesuffix(MEMBER): _array(member, f"{what}, {name}")
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


def to_bytes(snapshot: Snapshot) -> bytes:
    """The file's bytes; equal snapshots give equal bytes.

    Raises:
        SnapshotError: for a snapshot that is too large.
    """
    tree, arrays = dump(snapshot)
    del tree["digest"]
    entries = {ATTRIBUTION: tree.pop("attribution").encode()}
    trees = {name: tree.pop(name) for name in PARTS if tree.get(name)}
    for name in PARTS:
        if name in trees or name == "snapshot":
            entries[f"{name}.json"] = write_json(trees.get(name, tree))
        start = f"{name}."
        own = {path.removeprefix(start): arrays[path] for path in arrays if path.startswith(start)}
        if own:
            entries[f"{name}.npz"] = pack_arrays(own)
    data = seal(entries)
    if len(data) > LARGEST or any(len(entries[name]) > _limit(name) for name in entries):
        raise SnapshotError(
            f"The snapshot would be too large ({len(data) / 1e6:.0f} MB of {LARGEST / 1e6:.0f});"
            " leave out the data, or take a shorter window."
        )
    return data


def _limit(name: str) -> int:
    return LARGEST if name.endswith(".npz") else LARGEST_DOCUMENT


def seal(entries: Mapping[str, bytes], schema: int = SCHEMA) -> bytes:
    """Entries as a file, with the manifest in front."""
    return pack({MANIFEST: write_json(_manifest(entries, schema)), **entries})


def _manifest(entries: Mapping[str, bytes], schema: int) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "schema": schema,
        "entries": {
            name: {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
            for name, content in entries.items()
        },
    }


def load(content: str | os.PathLike[str] | bytes) -> Snapshot:
    """Read a snapshot; nothing in it is executed, and nothing is believed unchecked.

    Args:
        content: the file's path, or its bytes.

    Raises:
        SnapshotError: one sentence of what is wrong and which part it is.
    """
    if isinstance(content, bytes):
        return _read(content)
    path = Path(content)
    data = read_file(path)
    try:
        return _read(data)
    except SnapshotError as fault:
        raise SnapshotError(f"{path}: {fault}") from None


def read_file(path: Path) -> bytes:
    """The bytes of a file that may be a snapshot, no more of them than a snapshot can have.

    Raises:
        SnapshotError: when it is no file, or cannot be read.
    """
    if path.exists() and not path.is_file():  # a pipe would be waited for without end
        raise SnapshotError(f"{path}: this is no file; name a file that ends in .accpinn.zip.")
    try:
        with path.open("rb") as file:
            return file.read(LARGEST + 1)
    except OSError as fault:
        raise SnapshotError(
            f"{path}: cannot be opened ({fault.strerror}); check its name and that you may read it."
        ) from None
    except ValueError:  # as with a zero character
        raise SnapshotError("No file can have such a name; check it.") from None


def _read(data: bytes) -> Snapshot:
    if len(data) > LARGEST:
        raise SnapshotError(f"The snapshot is larger than {LARGEST / 1e6:.0f} MB; it is refused.")
    if not data.startswith(BEGINNING):
        raise SnapshotError(
            "This is not an accpinn snapshot; choose a file that ends in .accpinn.zip."
        )
    entries = unpack(data, "The snapshot")
    text = entries.pop(MANIFEST, b"")
    _check_manifest(text, entries)
    tree: dict[str, Any] = {
        "attribution": entries[ATTRIBUTION].decode("utf-8", "replace"),
        "digest": hashlib.sha256(text).hexdigest(),
    }
    arrays: Arrays = {}
    for name, content in entries.items():
        part, _, kind = name.partition(".")
        if kind == "json":
            part_of = _document(content, name)
            tree |= part_of if part == "snapshot" and isinstance(part_of, dict) else {part: part_of}
        elif kind == "npz":
            found = unpack_arrays(content, TITLES[name])
            arrays |= {f"{part}.{path}": values for path, values in found.items()}
    try:
        snapshot = restore(Snapshot, tree, arrays)
        check_numbers(tree, arrays)
        validate(snapshot)
    except (ValueError, AccpinnError) as fault:
        raise _refused(fault) from None
    return snapshot


def _document(text: bytes, name: str) -> Any:
    try:
        tree = read_json(text)
        return tree if is_harmless(text.decode()) else sanitise(tree)
    except (ValueError, RecursionError) as fault:
        raise _refused(f"{TITLES[name]}: {fault}") from None


def _refused(fault: object) -> SnapshotError:
    said = str(sanitise(str(fault))).rstrip(".")[:160]
    return SnapshotError(f"The snapshot is refused: {said}.")


def _check_manifest(text: bytes, entries: Mapping[str, bytes]) -> None:
    """The manifest is whole, of a schema that can be read, and every part is as it lists it."""
    if not text or len(text) > _limit(MANIFEST):
        raise SnapshotError("The snapshot has no manifest; this is no file that accpinn wrote.")
    manifest = _document(text, MANIFEST)
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise SnapshotError(
            "The snapshot has a foreign manifest; this is no file that accpinn wrote."
        )
    schema, listed = manifest.get("schema"), manifest.get("entries")
    if not isinstance(schema, int) or schema < 1 or not isinstance(listed, dict):
        raise SnapshotError("The snapshot is refused: its manifest is incomplete.")
    if schema != SCHEMA:
        newer = schema > SCHEMA
        age, cure = (
            ("a newer", "update accpinn") if newer else ("an earlier", "learn and save it again")
        )
        raise SnapshotError(
            f"The snapshot was written by {age} accpinn (schema {schema}, this one reads"
            f" {SCHEMA}); {cure}."
        )
    for name, content in entries.items():
        if name not in TITLES:
            raise SnapshotError(f"The snapshot holds {ascii(name)[:60]}, which no snapshot has.")
        if len(content) > _limit(name):
            raise SnapshotError(f"The snapshot is refused: {TITLES[name]} is too large.")
    for name in (ATTRIBUTION, "snapshot.json", *listed):
        if name not in entries:
            raise SnapshotError(f"The snapshot is damaged: {name[:60]} is missing.")
    expected = _manifest(entries, schema)
    for name in entries:
        if listed.get(name) != expected["entries"][name]:
            raise SnapshotError(
                f"The snapshot is damaged in {TITLES[name]} ({name}), which is not as it was"
                " saved; get the file anew."
            )
    if manifest != expected:
        raise SnapshotError("The snapshot is refused: its manifest holds more than it should.")
