"""Snapshots: results in files, which are read without trust.

A snapshot is a zip of

    manifest.json      format, schema, and the SHA-256 of all that follows
    result.json        the `Result` as a tree (see `accpinn.serial`): analysis, estimate, data
    arrays.npz         its larger arrays, as plain numbers
    ATTRIBUTION.txt    whose data and whose method

in SI units; times in s from the window's start, but the starts of windows and of blocks held out,
and the times of collisions, from the recording's first sample. It holds the speeds and gaps of its
windows and what cannot be derived from them; all else is computed when it is asked for.

The digest is over contents, not over the zip's own bytes, so equal results have equal digests.
Nothing in a file is executed; types, lengths and ranges are checked before anything reads it, and
`verify` finds what was forged.
"""

import hashlib
import io
import os
import tempfile
import zipfile
from dataclasses import fields, is_dataclass, replace
from functools import partial
from importlib.resources import files
from math import isfinite
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from accpinn.archives import TooManyMembers, UnpackedTooLarge, open_archive, read_member
from accpinn.errors import AccpinnError, SnapshotError
from accpinn.evaluation.closed_loop import TrackingErrors
from accpinn.methods.estimate import Estimate, History, Outcome, ParameterTrack, Posterior
from accpinn.methods.registry import METHODS
from accpinn.methods.series import stride_of
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.registry import FOLLOWING
from accpinn.segment import Segment, SegmentInfo
from accpinn.segment.cut import MAX_FOLLOWERS
from accpinn.serial import (
    MOST_ARRAYS,
    Arrays,
    check_numbers,
    dump,
    read_arrays,
    restore,
    sanitise,
)
from accpinn.stability.criteria import checked
from accpinn.storage import reported, write_whole
from accpinn.study.judge import Judgement, ModelScore
from accpinn.study.result import Result, now

SUFFIX = ".accpinn.zip"
FORMAT = "accpinn snapshot"
SCHEMA = 10
LARGEST = 48_000_000
"""Largest file, and largest unpacked contents, in bytes; an hour of ten followers stays below."""
LARGEST_DOCUMENT = 2_000_000
"""Largest result.json, in bytes."""
MOST_COMPUTED = 100_000
"""Largest number of samples of all followers together, one each half second at most, as the
likelihood uses them: more than an hour of ten followers. All of a snapshot is then computed within
a minute."""
MOST_WINDOWS, MOST_PAIRS = 200, 500
"""Largest number of windows, and of windows times followers."""
MOST_COMPUTED_IN_ALL = 300_000
"""Largest number of such samples of all windows: so many pairs over 300 s."""
MOST_DRAWS, MOST_DRAWN = 10_000, 50_000
"""Largest number of draws of a posterior, and of draws times followers; a training makes 1,000."""
MOST_PARTS = 50
"""Largest number of results compared, of blocks held out and of judgements, each."""
MOST_FINDINGS = 1_000
LONGEST_NAME, LONGEST_NOTE = 200, 10_000
MANIFEST, DOCUMENT, ARRAYS, ATTRIBUTION = (
    "manifest.json", "result.json", "arrays.npz", "ATTRIBUTION.txt",
)  # fmt: skip
MEMBERS = {
    MANIFEST: 10_000,
    DOCUMENT: LARGEST_DOCUMENT,
    ARRAYS: LARGEST,
    ATTRIBUTION: 10_000,
}
"""The members of a snapshot, and the largest size of each, in bytes."""
MARKS = {
    "snapshot": MANIFEST.encode(),
    "report": b"<!doctype html",
    "file for SUMO": b"<!-- car-following model ",
}
"""Text among the first bytes of every such file, in lower case."""
ATTRIBUTION_TEXT = files("accpinn.study").joinpath("attribution.txt").read_text("utf-8")


def prepare_snapshot(result: Result, name: str = "", note: str = "") -> Result:
    """The result as it goes into a file, with a name and a note.

    Raises:
        SnapshotError: for a training that diverged, or texts that are too long.
    """
    if result.estimate.outcome is Outcome.DIVERGED:
        raise SnapshotError("A training that diverged has no result to keep; train again first.")
    check_texts(name, note)
    return replace(result, name=name, note=note, created=now(), digest="")


def check_texts(name: str, note: str) -> None:
    """Refuse what is too long, before work is done for it.

    Raises:
        SnapshotError: naming the text.
    """
    for text, what, most in ((name, "name", LONGEST_NAME), (note, "note", LONGEST_NOTE)):
        try:
            text.encode()
        except (AttributeError, UnicodeEncodeError):  # half a character is none, either
            raise SnapshotError(f"The {what} is no text; write it in letters.") from None
        if len(text) > most:
            raise SnapshotError(
                f"The {what} is {len(text):,} characters long; choose one of {most:,} at most."
            )


SHAPES: dict[type, dict[str, str]] = {
    Estimate: {"parameters": "M3", "windows": "WM3", "unconstrained": "M3", "speeds": "M!",
               "driven": "2M!"},
    Posterior: {"typical": "DM3", "further": "EM3", "windows_lower": "WM3",
                "windows_upper": "WM3", "windows_gap": "2WM", "differ": "M", "draws": "M"},
    Trajectories: {"time": "N!", "speeds": "NV", "gaps": "NM"},  # nan: not simulated
    History: {"parameters": "KP3", "deviations": "KP3"} | dict.fromkeys(
        ("iteration", "seconds", "total", "data", "physics", "initial", "log_likelihood"), "K"),
    ParameterTrack: {"time": "K!", "parameters": "KM3", "deviation": "KM3"},
    TrackingErrors: {"gap_mae": "M", "speed_mae": "V"},
    ModelScore: {"theta": "P!", "rmse": "K!"} | dict.fromkeys(("lower", "upper", "determined"), "P")
    | dict.fromkeys(("time_gap_rmse", "collided"), "K"),
}  # fmt: skip
"""Lengths of arrays and tuples by type and field; a field may be None.

N samples, M followers and V = M + 1 vehicles are the window's, W the number of windows. K entries,
P parameter sets, D and E draws, one at least, are the same number within one object. An exclamation
mark asks for finite numbers.
"""


# Writing


def to_bytes(result: Result) -> bytes:
    """The file of a result, as it is.

    Raises:
        SnapshotError: for a result that is too large.
    """
    try:
        _check_counts(result)
    except ValueError as fault:
        raise SnapshotError(
            f"The snapshot would be too large: {fault}; take fewer windows or vehicles."
        ) from None
    rows = tuple(replace(row, segments=(), recording=None) for row in result.compared)
    tree, arrays = dump(replace(result, compared=rows, recording=None, digest=""))
    document = msgspec.json.encode(tree)
    manifest = {"format": FORMAT, "schema": SCHEMA, "sha256": _digest(document, arrays)}
    packed = io.BytesIO()
    np.savez(packed, allow_pickle=False, **arrays)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content, method in (
            (MANIFEST, msgspec.json.encode(manifest), zipfile.ZIP_STORED),
            (DOCUMENT, document, zipfile.ZIP_DEFLATED),
            (ARRAYS, packed.getvalue(), zipfile.ZIP_STORED),
            (ATTRIBUTION, ATTRIBUTION_TEXT.encode(), zipfile.ZIP_STORED),
        ):
            entry = zipfile.ZipInfo(name)  # without the time, so that equal results are equal files
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content, method)
    data = file.getvalue()
    if len(data) > LARGEST or len(document) > LARGEST_DOCUMENT:
        raise SnapshotError(
            f"The snapshot would be too large ({len(data) / 1e6:.0f} MB of"
            f" {LARGEST / 1e6:.0f}); take fewer or shorter windows, or compare fewer methods."
        )
    return data


def _digest(document: bytes, arrays: Arrays) -> str:
    """SHA-256 over result.json and every array."""
    content = hashlib.sha256(document)
    for name, values in sorted(arrays.items()):
        content.update(f"{name} {values.dtype.str} {values.shape} ".encode())
        content.update(np.ascontiguousarray(values).tobytes())
    return content.hexdigest()


def save(result: Result, path: str | os.PathLike[str]) -> Path:
    """Write a snapshot in one step: whoever looks sees the old file or the new one, never a part.

    Args:
        result: as `prepare_snapshot` gives it.
        path: where to; a snapshot that stands there is replaced.

    Raises:
        SnapshotError: when it cannot be written there, or what stands there is no snapshot.
    """
    target = writable_path(Path(path), "snapshot")
    write_file(to_bytes(result), target, "snapshot")
    return Path(path)


def writable_path(target: Path, kind: str) -> Path:
    """The file that is made, or replaced, by writing to ``target``; links are followed.

    Nothing is replaced but a file of its own kind, a key of `MARKS`.

    Raises:
        SnapshotError: where something else stands, or no file can be made.
    """
    with reported(partial(_unwritten, target, kind)):
        path = target.resolve() if target.is_symlink() else target
        if path.is_dir():
            raise SnapshotError(f"{path}: this is a folder; name a file in it for the {kind}.")
        if path.exists():
            beginning = b"neither file nor folder"
            if path.is_file():
                with path.open("rb") as file:
                    beginning = file.read(200).lower()
            if beginning and MARKS[kind] not in beginning:
                raise SnapshotError(
                    f"{path}: this is something else than a {kind} and is not overwritten; choose"
                    " another name."
                )
        with tempfile.TemporaryFile(dir=path.parent):
            return path


def write_file(content: bytes, target: Path, kind: str) -> Path:
    """Write a file for the user in one step; ``kind`` names it where that fails.

    Raises:
        SnapshotError: when it cannot be written there.
    """
    with reported(partial(_unwritten, target, kind)):
        write_whole(target, content)
    return target


def _unwritten(target: Path, kind: str, reason: str) -> SnapshotError:
    return SnapshotError(
        f"{target}: the {kind} could not be written ({reason}); choose another place or"
        " free some space."
    )


# Reading


def load(content: str | os.PathLike[str] | bytes) -> Result:
    """Read a snapshot; nothing in it is executed, and nothing is believed unchecked.

    Args:
        content: the file's path, or its bytes.

    Raises:
        SnapshotError: one sentence of what is wrong.

    Examples:
        >>> import accpinn, pathlib, tempfile
        >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = accpinn.save(result, pathlib.Path(folder) / "car.accpinn.zip")
        ...     accpinn.load(path).parameters == result.parameters
        True
    """
    if isinstance(content, bytes):
        return read(content)
    path = Path(content)
    data = read_file(path)
    try:
        return read(data)
    except SnapshotError as fault:
        raise SnapshotError(f"{path}: {fault}") from None


def read_file(path: Path) -> bytes:
    """The bytes of a file that may be a snapshot, no more of them than a snapshot can have.

    Raises:
        SnapshotError: when it is no file, or cannot be read.
    """
    sentence = "{}: cannot be opened ({}); check its name and that you may read it."
    with reported(lambda reason: SnapshotError(sentence.format(path, reason))):
        if path.exists() and not path.is_file():  # a pipe would be waited for without end
            raise SnapshotError(f"{path}: this is no file; name a file that ends in {SUFFIX}.")
        with path.open("rb") as file:
            return file.read(LARGEST + 1)


def read(data: bytes) -> Result:
    """The result in the bytes of a file.

    Raises:
        SnapshotError: for anything but a whole and plausible file of this schema.
    """
    if len(data) > LARGEST:
        raise SnapshotError(f"The snapshot is larger than {LARGEST / 1e6:.0f} MB; it is refused.")
    try:
        with open_archive(data, len(MEMBERS) + MOST_ARRAYS) as archive:  # those inside count, too
            # Nothing of a file is read that holds members besides those of a snapshot.
            names = archive.namelist()
            missing = {MANIFEST, DOCUMENT, ARRAYS} - {*names}
            foreign = [name for name in names if name not in MEMBERS]
            foreign += [name for k, name in enumerate(names) if name in names[:k]]
            if foreign and not missing:
                raise SnapshotError(
                    f'The snapshot is refused: it holds "{str(sanitise(foreign[0]))[:60]}", which'
                    " belongs in none; get the file anew."
                )
            _require(not missing, "a member is missing")
            manifest = msgspec.json.decode(read_member(archive, MANIFEST, MEMBERS[MANIFEST]))
            _check_schema(manifest)
            document = read_member(archive, DOCUMENT, MEMBERS[DOCUMENT])
            packed = read_member(archive, ARRAYS, MEMBERS[ARRAYS])
        arrays = read_arrays(packed, LARGEST)
    except SnapshotError:
        raise
    except (UnpackedTooLarge, TooManyMembers):
        raise SnapshotError("The snapshot is refused: it would unpack to too much.") from None
    except Exception:  # zip, JSON and array parsers raise many kinds for foreign bytes
        raise SnapshotError(
            f"This is no whole accpinn snapshot; choose a file that ends in {SUFFIX}, or get the"
            " file anew."
        ) from None
    digest = _digest(document, arrays)
    if manifest.get("sha256") != digest:
        raise SnapshotError(
            "The snapshot is damaged: its contents are not as they were saved; get the file anew."
        )
    try:
        tree = sanitise(msgspec.json.decode(document))
        check_numbers(tree, arrays)
        result = restore(Result, tree, arrays)
        data_of = result.segments
        rows = tuple(replace(row, segments=data_of) for row in result.compared)
        result = replace(result, compared=rows, digest=digest)
        _check(result)
    except (ValueError, TypeError, LookupError, RecursionError, MemoryError, AccpinnError) as fault:
        reason = str(sanitise(str(fault))).rstrip(".")[:160]
        raise SnapshotError(f"The snapshot is refused: {reason}.") from None
    return result


def _check_schema(manifest: Any) -> None:
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise SnapshotError(
            "The snapshot has a foreign manifest; this is no file that accpinn wrote."
        )
    schema = manifest.get("schema")
    if schema == SCHEMA:
        return
    age, cure = "an earlier", "learn and save it again"
    if isinstance(schema, int) and schema > SCHEMA:
        age, cure = "a newer", "update accpinn"
    raise SnapshotError(
        f"The snapshot was written by {age} accpinn (schema {str(schema)[:8]}, this one reads"
        f" {SCHEMA}); {cure}."
    )


def _check(result: Result) -> None:
    """Refuse a result that no run gives, though its types are right.

    Raises:
        ValueError, AccpinnError: with what is wrong and where.
    """
    analysis = result.analysis
    method, model = analysis.method, analysis.spec.model
    _require(
        method in METHODS,
        f'its method "{method[:40]}" is not known here; register it first, as the script did that'
        " made it",
    )
    _require(
        model in FOLLOWING,
        f'its model "{model[:40]}" is not known here; register it first, as the script did that'
        " made it",
    )
    counts = {len(analysis.windows), len(result.infos), len(result.segments)}
    _require(len(counts) == 1 and result.infos != (), "its windows differ in number")
    _require(result.recording is None, "it holds a recording")
    _check_counts(result)
    for text, most in ((result.name, LONGEST_NAME), (result.note, LONGEST_NOTE)):
        _require(len(text) <= most, "its name or note is too long")
    for info, segment in zip(result.infos, result.segments, strict=True):
        _check_info(info)
        _require(info.vehicles == analysis.vehicles, "its vehicles are not those asked for")
        _check_times(segment.time)
        _require(segment.info == info, "its data are not the window that it was learned from")
        _require(_samples(segment) <= MOST_COMPUTED, "a window is longer than can be computed anew")
    _check_estimate(result.estimate, result)
    for block in result.blocks:
        _check_shapes(block, result.info)
    for judged in result.judgements:
        _check_judgement(judged, result.info)
    for row in result.compared:
        _require(row.infos == result.infos, "its results are of other windows")
        _require(not row.compared, "its results are nested too deep")
        _check(row)


def _samples(segment: Segment) -> int:
    """Samples of all followers that are computed with."""
    return segment.info.followers * segment.info.samples // stride_of(segment)


def _check_counts(result: Result) -> None:
    """Refuse more of anything than can be shown and computed anew.

    Raises:
        ValueError: with what is too many.
    """
    posterior, followers = result.estimate.posterior, result.info.followers
    drawn = (posterior.typical, posterior.further) if posterior else ()
    windows, draws = len(result.infos), max((len(sets.everything) for sets in drawn), default=0)
    findings = [result.estimate.findings, *(info.findings for info in result.infos)]
    samples = sum(map(_samples, result.segments))
    parts = max(map(len, (result.compared, result.blocks, result.judgements)))
    for count, most, things in (
        (followers, MAX_FOLLOWERS, "followers"),
        (windows, MOST_WINDOWS, "windows"),
        (windows * followers, MOST_PAIRS, "windows of single followers"),
        (samples, MOST_COMPUTED_IN_ALL, "samples at 2 Hz"),
        (draws, MOST_DRAWS, "draws"),
        (draws * followers, MOST_DRAWN, "draws of all followers"),
        (parts, MOST_PARTS, "results beside the first"),
        (sum(map(len, findings)), MOST_FINDINGS, "findings"),
    ):
        _require(count <= most, f"it has {count:,} {things}, and {most:,} are the most")


def _check_info(info: SegmentInfo) -> None:
    count = len(info.vehicles)
    _require(count > 1 and info.samples > 1, "its window has no followers or no data")
    first = info.vehicles[0]
    numbers = tuple(range(first, first + count))
    _require(first > 0 and info.vehicles == numbers, "the vehicles are no consecutive numbers")
    _require(len(info.names) == count, "its vehicles and their names differ in number")
    _require(max(map(len, (info.source, *info.names))) <= LONGEST_NAME, "a name is too long")
    times = (info.window.start, info.window.duration, info.sample_time)
    _require(all(map(isfinite, times)) and min(times[1:]) > 0, "its window has no length")
    _require(len(info.excluded_share) in (0, count - 1), "its shares differ in number")


def _check_estimate(estimate: Estimate, result: Result) -> None:
    analysis, info, count = result.analysis, result.info, len(result.infos)
    of_estimate = estimate.method, estimate.spec, estimate.case
    is_same = of_estimate == (analysis.method, analysis.spec, analysis.case)
    _require(is_same, "its estimate is another one than was asked for")
    _require(estimate.numbers == info.vehicles[1:], "its estimate is of other vehicles")
    _require(min(estimate.iterations, estimate.network_weights) >= 0, "a count is negative")
    _require(len(estimate.curves) in (0, count), "its curves differ in number")
    _require(len(estimate.active_bounds) in (0, info.followers), "its bounds differ in number")
    for curves, of in zip(estimate.curves, result.infos, strict=False):
        _check_shapes(curves, of)
        _check_times(curves.time)
    lengths = _lengths(info) | {"W": count}
    for part in (estimate, estimate.posterior, estimate.history, estimate.track):
        _check_fields(part, dict(lengths))
    width = estimate.parameters.nonlinear.shape[-1]
    expected_width = 0 if estimate.following.is_linear else len(estimate.names)
    _require(width == expected_width, "its parameters are another model's")
    values = estimate.parameters.values
    values = values[~np.isnan(values).all(axis=1)]  # of the others nothing is determined
    values[values[:, 0] == 0, 2] = 0.0  # τ has no effect without α
    _require(bool(((values >= 0) & (values < np.inf)).all()), "a parameter of it is out of range")
    posterior = estimate.posterior
    if posterior:
        _require(0 < posterior.level < 1, "a level is not between 0 and 1")
        there = ~np.isnan(estimate.parameters.alpha) & ~np.isnan(posterior.typical.alpha[0])
        for sets in (estimate.parameters[None], posterior.typical):
            _require(sets.nonlinear.shape[-1] == width, "its draws have other parameters")
            if there.any():
                checked(sets[:, there])


def _check_times(time: NDArray[np.float64]) -> None:
    ordered = time[0] >= 0 and (np.diff(time) > 0).all()
    _require(bool(ordered), "the instants of a curve do not follow each other")


def _check_judgement(judged: Judgement, info: SegmentInfo) -> None:
    _check_info(judged.info)
    vehicles = judged.info.vehicles
    is_pair = len(vehicles) == 2 and {*vehicles} <= {*info.vehicles}
    _require(is_pair, "a judgement is of other vehicles")
    _require(judged.windows != () and judged.scores != (), "a judgement is empty")
    is_short = len(judged.windows) <= MOST_WINDOWS and len(judged.scores) <= len(FOLLOWING)
    _require(is_short, "a judgement has too many windows or models")
    for score in judged.scores:
        _require(score.key in FOLLOWING, f'the model "{score.key[:40]}" is not known')
        shape = len(score.model.parameters), len(judged.windows)
        fits = shape == (len(score.theta), len(score.rmse)) and (score.rmse > 0).all()
        _require(bool(fits), "a judgement does not fit its model or windows")


def _check_shapes(value: Any, info: SegmentInfo) -> None:
    """Refuse arrays and tuples of other lengths than `SHAPES` has, in an object and below it."""
    _check_fields(value, _lengths(info))
    if is_dataclass(value):
        value = tuple(getattr(value, field.name) for field in fields(value))
    for part in value if isinstance(value, tuple) else ():
        _check_shapes(part, info)


def _check_fields(value: Any, lengths: dict[str, int]) -> None:
    """Refuse fields of one object with other lengths than `SHAPES` has."""
    for name, letters in SHAPES.get(type(value), {}).items():
        _check_shape(name, getattr(value, name), letters, lengths)


def _lengths(info: SegmentInfo) -> dict[str, int]:
    return {"N": info.samples, "M": info.followers, "V": info.followers + 1, "2": 2, "3": 3}


def _check_shape(name: str, values: Any, letters: str, lengths: dict[str, int]) -> None:
    values = values.values if isinstance(values, Parameters) else values
    if values is None:
        return
    shape, axes = np.shape(values), letters.rstrip("!")
    expected = tuple(map(lengths.setdefault, axes, shape))
    _require(
        shape == expected and len(shape) == len(axes) and 0 not in shape,
        f"its {name.replace('_', ' ')} has the shape {shape}, which does not fit the rest",
    )
    is_finite = axes == letters or np.isfinite(values).all()
    _require(bool(is_finite), f"its {name.replace('_', ' ')} is not finite")


def _require(holds: bool, fault: str) -> None:
    if not holds:
        raise ValueError(fault)
