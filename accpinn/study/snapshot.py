"""Snapshots: results in files, which are read without trust.

A snapshot is a zip of

    manifest.json      format, schema, and the SHA-256 of all that follows
    result.json        the `Result` as a tree (see `accpinn.serial`)
    arrays.npz         its larger arrays, as plain numbers
    ATTRIBUTION.txt    whose data and whose method

in SI units; times in s from the window's start, but the starts of windows and of blocks held out,
and the times of collisions, from the recording's first sample. The digest is over contents, not
over the zip's own bytes, so equal results have equal digests. Nothing in a file is executed;
types, lengths and ranges are checked before anything reads it, and `verify` finds what was forged.
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

from accpinn.errors import AccpinnError, SnapshotError
from accpinn.evaluation.closed_loop import TrackingErrors
from accpinn.evaluation.whiteness import Whiteness
from accpinn.inference.answer import Answer
from accpinn.inference.intervals import Interval, Uncertainty
from accpinn.inference.model_adequacy import ModelForm
from accpinn.methods.estimate import Fit, History, Outcome, ParameterTrack
from accpinn.methods.registry import METHODS
from accpinn.methods.series import stride_of
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.registry import FOLLOWING
from accpinn.segment import SegmentInfo
from accpinn.segment.quality import Quality
from accpinn.serial import Arrays, check_numbers, dump, read_arrays, restore, sanitise
from accpinn.stability.criteria import checked
from accpinn.storage import reported, write_whole
from accpinn.study.judge import Judgement, ModelScore
from accpinn.study.result import Result, now

SUFFIX = ".accpinn.zip"
FORMAT = "accpinn snapshot"
SCHEMA = 9
LARGEST = 24_000_000
"""Largest file, and largest unpacked contents, in bytes; an hour of ten followers with its data
stays below."""
LARGEST_DOCUMENT = 2_000_000
"""Largest result.json, in bytes."""
MOST_COMPUTED = 100_000
"""Largest number of samples of all followers together, one each half second at most, as the
likelihood uses them: more than an hour of ten followers. All of a snapshot is then computed within
a minute."""
LONGEST_NAME, LONGEST_NOTE = 200, 10_000
MANIFEST, DOCUMENT, ARRAYS, ATTRIBUTION = (
    "manifest.json", "result.json", "arrays.npz", "ATTRIBUTION.txt",
)  # fmt: skip
MARKS = {
    "snapshot": MANIFEST.encode(),
    "report": b"<!doctype html",
    "file for SUMO": b"<!-- car-following model ",
}
"""What stands among the first bytes of every such file, in lower case."""
ATTRIBUTION_TEXT = files("accpinn.study").joinpath("attribution.txt").read_text("utf-8")


def named(result: Result, name: str = "", note: str = "", with_data: bool = False) -> Result:
    """The result as it goes into a file, every part computed; its data only if that is asked for.

    Raises:
        SnapshotError: for a training that diverged, or texts that are too long.
    """
    if result.fit.outcome is Outcome.DIVERGED:
        raise SnapshotError("A training that diverged has no result to keep; train again first.")
    check_texts(name, note)
    segments = result.segments if with_data else ()
    if result.segments:
        compared = tuple(
            row.without_data().as_row() if row.segments else row for row in result.compared
        )
        result = replace(result.without_data(), segments=segments, compared=compared)
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
    Fit: {"parameters": "M3", "unconstrained": "M3"},
    Trajectories: {"time": "N!", "speeds": "NV", "gaps": "NM"},  # nan: not simulated
    History: {"parameters": "KP3", "deviations": "KP3"} | dict.fromkeys(
        ("iteration", "seconds", "total", "data", "physics", "initial", "evidence"), "K!"),
    ParameterTrack: {"time": "K!", "parameters": "KM3", "deviation": "KM3"},
    Quality: dict.fromkeys(("mean_time_gap", "relative_deviation", "acceleration_deviation",
                            "condition", "car_following"), "M"),
    Uncertainty: {"centre": "M3", "lower": "M3", "upper": "M3", "inside": "M3", "draws": "DM3",
                  "probability_l2": "M", "probability_linf": "M"},
    Interval: {"lower": "M", "upper": "M"},
    TrackingErrors: {"gap_mae": "M", "speed_mae": "V"},
    Whiteness: dict.fromkeys(
        ("deviation", "correlation", "memory", "independent", "probability"), "M"),
    Answer: {"parameters": "M3", "typical": "DM3", "further": "DM3", "windows": "KM3",
             "windows_lower": "KM3", "windows_upper": "KM3", "speeds": "M", "differ": "M",
             "driven": "2M", "windows_gap": "2KM"},
    ModelForm: {"parameters": "M3", "lower": "M3", "upper": "M3", "aic": "M", "holdout": "M"},
    ModelScore: {"theta": "P!", "rmse": "K!"} | dict.fromkeys(("lower", "upper", "determined"), "P")
    | dict.fromkeys(("time_gap_rmse", "collided"), "K"),
}  # fmt: skip
"""Lengths of arrays and tuples by type and field; a field may be None.

N samples, M followers and V = M + 1 vehicles are the window's. K entries, P parameter sets and D
draws, one at least, are the same number within one object. An exclamation mark asks for finite
numbers.
"""


# Writing


def to_bytes(result: Result) -> bytes:
    """The file of a result, as it is.

    Raises:
        SnapshotError: for a result that is too large.
    """
    tree, arrays = dump(replace(result, recording=None, digest=""))
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
            f" {LARGEST / 1e6:.0f}); leave out the data, or take a shorter window."
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
        result: as `named` gives it.
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
            _require_kind(path, kind)
        with tempfile.TemporaryFile(dir=path.parent):
            return path


def _require_kind(path: Path, kind: str) -> None:
    if path.is_file():
        with path.open("rb") as file:
            beginning = file.read(200).lower()
        if not beginning or MARKS[kind] in beginning:
            return
    raise SnapshotError(
        f"{path}: this is something else than a {kind} and is not overwritten; choose another name."
    )


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


def read(data: bytes, is_complete: bool = True) -> Result:
    """The result in the bytes of a file.

    Args:
        data: the whole file.
        is_complete: whether it is a snapshot, in which every part must be there; the store keeps
            results of which only the fit is known yet, and which have no digest.

    Raises:
        SnapshotError: for anything but a whole and plausible file of this schema.
    """
    if len(data) > LARGEST:
        raise SnapshotError(f"The snapshot is larger than {LARGEST / 1e6:.0f} MB; it is refused.")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > 2 * LARGEST:
                raise SnapshotError("The snapshot is refused: it would unpack to too much.")
            manifest = msgspec.json.decode(archive.read(MANIFEST))
            _check_schema(manifest)
            document = archive.read(DOCUMENT)
            arrays = read_arrays(archive.read(ARRAYS), LARGEST)
    except SnapshotError:
        raise
    except Exception:  # zip, JSON and array parsers raise many kinds for foreign bytes
        raise SnapshotError(
            f"This is no whole accpinn snapshot; choose a file that ends in {SUFFIX}, or get the"
            " file anew."
        ) from None
    if len(document) > LARGEST_DOCUMENT:
        raise SnapshotError(f"The snapshot is refused: its {DOCUMENT} is too large.")
    digest = _digest(document, arrays)
    if manifest.get("sha256") != digest:
        raise SnapshotError(
            "The snapshot is damaged: its contents are not as they were saved; get the file anew."
        )
    try:
        tree = sanitise(msgspec.json.decode(document))
        check_numbers(tree, arrays)
        result = restore(Result, tree, arrays)
        _check(result, is_complete)
    except (ValueError, TypeError, LookupError, RecursionError, MemoryError, AccpinnError) as fault:
        said = str(sanitise(str(fault))).rstrip(".")[:160]
        raise SnapshotError(f"The snapshot is refused: {said}.") from None
    return replace(result, digest=digest if is_complete else "")


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


def _check(result: Result, is_complete: bool) -> None:
    """Refuse a result that no run gives, though its types are right.

    Raises:
        ValueError, AccpinnError: with what is wrong and where.
    """
    asked = result.analysis
    _require(asked.method in METHODS, f'the method "{asked.method[:40]}" is not known')
    for model in (asked.model, asked.fitted or asked.model, *(f.model for f in result.fits)):
        _require(model in FOLLOWING, f'the model "{model[:40]}" is not known')
    answer = result.parts.answer
    _require(not answer or answer.model == result.analysis.model, "its answer is of another model")
    counts = {len(result.analysis.windows), len(result.infos), len(result.fits)}
    _require(len(counts) == 1 and result.infos != (), "its windows differ in number")
    _require(len(result.segments) in (0, len(result.infos)), "its data are not its windows'")
    _require(result.recording is None, "it holds a recording")
    for text, most in ((result.name, LONGEST_NAME), (result.note, LONGEST_NOTE)):
        _require(len(text) <= most, "its name or note is too long")
    for info, fit in zip(result.infos, result.fits, strict=True):
        _check_info(info)
        _check_fit(fit, info)
        _require(info.vehicles == result.analysis.vehicles, "its vehicles are not those asked for")
    for info, segment in zip(result.infos, result.segments, strict=False):
        _check_times(segment.time)
        _require(segment.info == info, "its data are not the window that it was learned from")
        samples = info.followers * info.samples // stride_of(segment)
        _require(samples <= MOST_COMPUTED, "its data are longer than can be computed anew")
    _check_parts(result, is_complete)
    for part in result.compared:
        _check(part, is_complete)
        _require(not part.compared, "its results are nested too deep")
        _require(part.info.vehicles == result.info.vehicles, "its results are of other vehicles")


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


def _check_fit(fit: Fit, info: SegmentInfo) -> None:
    _require(fit.method in METHODS, f'the method "{fit.method[:40]}" is not known')
    _require(min(fit.iterations, fit.network_weights) >= 0, "a count is negative")
    _check_shapes(fit, info)
    _check_shape("disturbance", fit.arrays.get("disturbance"), "NM", _lengths(info))
    values = fit.parameters.values
    known = values[~np.isnan(values).all(axis=1)]  # of the others nothing is determined
    known[known[:, 0] == 0, 2] = 0.0  # τ has no effect without α
    _require(bool(((known >= 0) & (known < np.inf)).all()), "a parameter of it is out of range")
    _require(len(fit.active_bounds) in (0, info.followers), "its bounds differ in number")
    if fit.surrogate:
        _check_times(fit.surrogate.time)


def _check_times(time: NDArray[np.float64]) -> None:
    ordered = time[0] >= 0 and (np.diff(time) > 0).all()
    _require(bool(ordered), "the instants of a curve do not follow each other")


def _check_parts(result: Result, is_complete: bool) -> None:
    parts, info, count = result.parts, result.info, len(result.infos)
    needed = (parts.qualities, parts.uncertainty, parts.evaluation)
    _require(not is_complete or None not in needed, "a part of it is missing")
    _require(parts.qualities is None or len(parts.qualities) == count, "a quality is missing")
    _check_shapes(parts, info)
    levels = [known.level for known in (parts.uncertainty, parts.answer) if known]
    _require(all(0 < level < 1 for level in levels), "a level is not between 0 and 1")
    if parts.answer:
        _check_answer(parts.answer)
    for judged in parts.judgements or ():
        _check_judgement(judged, info)


def _check_judgement(judged: Judgement, info: SegmentInfo) -> None:
    _check_info(judged.info)
    known = len(judged.info.vehicles) == 2 and {*judged.info.vehicles} <= {*info.vehicles}
    _require(known, "a judgement is of other vehicles")
    _require(judged.windows != () and judged.scores != (), "a judgement is empty")
    for score in judged.scores:
        _require(score.key in FOLLOWING, f'the model "{score.key[:40]}" is not known')
        shape = len(score.model.parameters), len(judged.windows)
        fits = shape == (len(score.theta), len(score.rmse)) and (score.rmse > 0).all()
        _require(bool(fits), "a judgement does not fit its model or windows")


def _check_answer(answer: Answer) -> None:
    """Refuse parameter sets that string stability cannot be computed of."""
    width, known = answer.parameters.own.shape[-1], ~np.isnan(answer.parameters.alpha)
    _require(width in (0, len(answer.names)), "its answer has other parameters than its model")
    for sets in (answer.parameters[None], answer.typical):
        _require(sets.own.shape[-1] == width, "its answer's sets have different parameters")
        if known.any():
            checked(sets[:, known])


def _check_shapes(value: Any, info: SegmentInfo) -> None:
    """Refuse arrays and tuples of other lengths than `SHAPES` has, in an object and below it."""
    lengths = _lengths(info)
    for name, letters in SHAPES.get(type(value), {}).items():
        _check_shape(name, getattr(value, name), letters, lengths)
    if is_dataclass(value):
        value = tuple(getattr(value, field.name) for field in fields(value))
    for part in value if isinstance(value, tuple) else ():
        _check_shapes(part, info)


def _lengths(info: SegmentInfo) -> dict[str, int]:
    return {"N": info.samples, "M": info.followers, "V": info.followers + 1, "2": 2, "3": 3}


def _check_shape(name: str, values: Any, letters: str, lengths: dict[str, int]) -> None:
    values = values.values if isinstance(values, Parameters) else values
    if values is None:
        return
    shape, asked = np.shape(values), letters.rstrip("!")
    expected = tuple(map(lengths.setdefault, asked, shape))
    _require(
        shape == expected and len(shape) == len(asked) and lengths.get("D") != 0,
        f"its {name.replace('_', ' ')} has the shape {shape}, which does not fit the rest",
    )
    is_finite = asked == letters or np.isfinite(values).all()
    _require(bool(is_finite), f"its {name.replace('_', ' ')} is not finite")


def _require(holds: bool, fault: str) -> None:
    if not holds:
        raise ValueError(fault)
