"""Snapshots as bytes and as files, with a digest for every part and one over all."""

import hashlib
import os
import secrets
from dataclasses import replace
from pathlib import Path
from typing import Any

from accpinn.errors import SnapshotError
from accpinn.results.snapshot import arrays, documents
from accpinn.results.snapshot.archive import LOCAL_MARK, check_packed, contents, pack
from accpinn.results.snapshot.content import Snapshot
from accpinn.results.snapshot.layout import Parts, assemble, parts
from accpinn.results.snapshot.schema import (
    ATTRIBUTION,
    ATTRIBUTION_TEXT,
    FORMAT,
    LARGEST,
    MANIFEST,
    MOST_ENTRIES,
    PARTS,
    SCHEMA,
    check_schema,
    migrated,
)
from accpinn.results.snapshot.writable_path import SNAPSHOT, free_place

WHOLE = "The snapshot"
UNFINISHED = ".part"
"""Ending of a file that is being written."""
Content = str | os.PathLike[str] | bytes
"""A file's path, or what it holds."""


def to_bytes(snapshot: Snapshot) -> bytes:
    """The file's bytes; equal snapshots give equal bytes.

    Raises:
        SnapshotError: for a snapshot that is too large.
    """
    stored = parts(snapshot)
    written = {ATTRIBUTION: ATTRIBUTION_TEXT.encode()}
    written |= {name: documents.write(tree) for name, tree in stored.documents.items()}
    written |= {name: arrays.write(group) for name, group in stored.arrays.items()}
    ordered = {name: written[name] for name in PARTS if name in written}
    data = sealed(ordered, SCHEMA)
    if len(data) > LARGEST or any(len(ordered[name]) > PARTS[name].largest for name in ordered):
        raise SnapshotError(
            f"The snapshot would be too large ({len(data) / 1e6:.0f} MB of {LARGEST / 1e6:.0f});"
            " leave out the data, or take a shorter window."
        )
    return data


def sealed(entries: dict[str, bytes], schema: int) -> bytes:
    """Entries as a file, with the manifest in front."""
    manifest: dict[str, Any] = {
        "format": FORMAT,
        "schema": schema,
        "entries": {name: _fingerprint(content) for name, content in entries.items()},
    }
    manifest["digest"] = _digest(manifest)
    return pack({MANIFEST: documents.write(manifest), **entries})


def save(snapshot: Snapshot, path: str | os.PathLike[str]) -> Path:
    """Write a snapshot in one step: whoever looks sees the old file or the new one, never a part.

    Raises:
        SnapshotError: when it cannot be written there, or what stands there is no snapshot.
    """
    place, data = free_place(Path(path), SNAPSHOT), to_bytes(snapshot)
    _read(data)  # what could not be opened again is not written
    write_whole(data, place)
    return Path(path)


def write_whole(data: bytes, target: Path, what: str = "the snapshot") -> Path:
    """Bytes as a file, in one step; ``what`` they are is for the sentence when that fails.

    Raises:
        SnapshotError: when it cannot be written there.
    """
    try:
        temporary = target.with_name(f"{secrets.token_hex(8)}{UNFINISHED}")
        try:
            with temporary.open("xb") as file:  # so who may read it follows the user's umask
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, target)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    except OSError as fault:
        raise SnapshotError(
            f"{target}: {what} could not be written ({fault.strerror}); choose another place"
            " or free some space."
        ) from None
    return target


def load(content: Content) -> Snapshot:
    """Read a snapshot; nothing in it is executed, and nothing is believed unchecked.

    Args:
        content: the file's path, or its bytes.

    Raises:
        SnapshotError: one sentence of what is wrong and which part it is.
    """
    if isinstance(content, bytes):
        return _read(content)
    path = Path(content)
    data = _bytes_of(path)
    try:
        return _read(data)
    except SnapshotError as fault:
        raise SnapshotError(f"{path}: {fault}") from None


def _read(data: bytes) -> Snapshot:
    if len(data) > LARGEST:
        raise SnapshotError(f"{WHOLE} is larger than {LARGEST / 1e6:.0f} MB, so it is refused.")
    if not data.startswith(LOCAL_MARK):
        raise SnapshotError(
            "This is not an accpinn snapshot; choose a file that ends in .accpinn.zip."
        )
    entries = contents(data, WHOLE, MOST_ENTRIES)
    manifest = _manifest(entries)
    _check_entries(entries, manifest)
    check_packed(data, entries, WHOLE)
    stored = Parts(
        {n: documents.read(c, PARTS[n].title) for n, c in entries.items() if _is_document(n)},
        {n: arrays.read(c, PARTS[n].title) for n, c in entries.items() if n.endswith(".npz")},
    )
    upgraded = migrated(stored.documents, manifest["schema"])
    found = assemble(Parts(upgraded, stored.arrays), manifest["digest"])
    attribution = entries[ATTRIBUTION].decode("utf-8", "replace")
    return replace(found, attribution=attribution)


def _is_document(name: str) -> bool:
    return name.endswith(".json") and name != MANIFEST


def _bytes_of(path: Path) -> bytes:
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


def _manifest(entries: dict[str, bytes]) -> dict[str, Any]:
    """The manifest, once it is known to be whole and of a schema that can be read."""
    text = entries.get(MANIFEST, b"")
    if not text or len(text) > PARTS[MANIFEST].largest:
        raise SnapshotError(f"{WHOLE} has no manifest; this is no file that accpinn wrote.")
    manifest = documents.read(text, PARTS[MANIFEST].title)
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise SnapshotError(f"{WHOLE} has a foreign manifest; this is no file that accpinn wrote.")
    rest = {name: value for name, value in manifest.items() if name != "digest"}
    listed, schema = manifest.get("entries"), manifest.get("schema")
    if manifest.get("digest") != _digest(rest):
        raise SnapshotError(f"{WHOLE} is damaged: the manifest is; get the file anew.")
    if type(schema) is not int or not isinstance(listed, dict):
        raise SnapshotError(f"{WHOLE} is refused: its manifest is incomplete.")
    check_schema(schema)
    return manifest


def _check_entries(entries: dict[str, bytes], manifest: dict[str, Any]) -> None:
    """All that has to be there and nothing else, each part as it was written."""
    for name, content in entries.items():
        if name not in PARTS:
            raise SnapshotError(f'{WHOLE} holds "{name[:60]}", which no snapshot has.')
        if len(content) > PARTS[name].largest:
            raise SnapshotError(f"{WHOLE} is refused: {PARTS[name].title} is too large.")
    listed = manifest["entries"]
    for name, part in PARTS.items():
        if name == MANIFEST:
            continue
        if name not in entries and (part.required or name in listed):
            raise SnapshotError(f"{WHOLE} is damaged: {part.title} ({name}) is missing.")
        if name in entries and listed.get(name) != _fingerprint(entries[name]):
            raise SnapshotError(
                f"{WHOLE} is damaged in {part.title} ({name}), which is not as it was saved; get"
                " the file anew."
            )
    if len(listed) != len(entries) - 1:
        raise SnapshotError(f"{WHOLE} is refused: its manifest lists what it does not hold.")


def _fingerprint(content: bytes) -> dict[str, Any]:
    return {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}


def _digest(manifest: dict[str, Any]) -> str:
    return hashlib.sha256(documents.write(manifest)).hexdigest()
