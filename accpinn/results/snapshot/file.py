"""Snapshots as bytes and as files: every part with its digest, all written in one step."""

import hashlib
import os
import secrets
import stat
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from accpinn.errors import AccpinnError, SnapshotError
from accpinn.results.snapshot.archive import BEGINNING, pack, pack_arrays, unpack, unpack_arrays
from accpinn.results.snapshot.schema import (
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
from accpinn.results.snapshot.validate import is_harmless, sanitise, validate
from accpinn.serial import Arrays, dump, read_json, restore, write_json

UNFINISHED = ".part"
"""Ending of a file that is being written."""
Content = str | os.PathLike[str] | bytes
"""A file's path, or what it holds."""
MARKS = {"snapshot": MANIFEST.encode(), "report": b"<!doctype html"}
"""What stands among the first bytes of every such file, in lower case."""
_BEGINNING = 200


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
        own = {
            rest: values
            for path, values in arrays.items()
            for owner, _, rest in [path.partition(".")]
            if owner == name
        }
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


def save(snapshot: Snapshot, path: str | os.PathLike[str]) -> Path:
    """Write a snapshot in one step: whoever looks sees the old file or the new one, never a part.

    Raises:
        SnapshotError: when it cannot be written there, or what stands there is no snapshot.
    """
    target, data = writable_path(Path(path), "snapshot"), to_bytes(snapshot)
    _read(data)  # what could not be opened again is not written
    write_whole(data, target, "snapshot")
    return Path(path)


def writable_path(target: Path, kind: str) -> Path:
    """The file that is made, or replaced, by writing to ``target``; links are followed.

    Args:
        target: where a user wants the file.
        kind: "snapshot" or "report"; nothing is replaced but a file of its own kind.

    Raises:
        SnapshotError: where something else stands, or no file can be made.
    """
    try:
        path = target.resolve() if target.is_symlink() else target
        with suppress(FileNotFoundError):
            _require_own(path, kind)
        with tempfile.TemporaryFile(dir=path.parent):
            return path
    except (OSError, ValueError, RuntimeError) as fault:  # also for links that run in a circle
        raise _unwritten(
            target, kind, getattr(fault, "strerror", None) or "no valid path"
        ) from None


def _require_own(path: Path, kind: str) -> None:
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise SnapshotError(f"{path}: this is a folder; name a file in it for the {kind}.")
    if stat.S_ISREG(mode):
        with path.open("rb") as file:
            beginning = file.read(_BEGINNING).lower()
        if not beginning or MARKS[kind] in beginning:
            return
    raise SnapshotError(
        f"{path}: this is something else than a {kind} and is not overwritten; choose another name."
    )


def write_whole(data: bytes, target: Path, kind: str) -> Path:
    """Write bytes as the file ``target``, in one step; ``kind`` names them where that fails.

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
        raise _unwritten(target, kind, fault.strerror or "no reason given") from None
    return target


def _unwritten(target: Path, kind: str, reason: str) -> SnapshotError:
    return SnapshotError(
        f"{target}: the {kind} could not be written ({reason}); choose another place or"
        " free some space."
    )
