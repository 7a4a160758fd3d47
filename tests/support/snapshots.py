"""Results for tests: a small one made fast, and one with all that a snapshot can hold."""

import io
import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from accpinn.inference.model_adequacy import FORMS, Adequacy, BetterForm, ModelForm
from accpinn.methods import TaskContext
from accpinn.methods.estimate import Estimate
from accpinn.methods.pinn.config import preset
from accpinn.model.cthp import Case, Parameters
from accpinn.recordings import Recording, Window
from accpinn.recordings.openacc import read
from accpinn.segment import Segment, SegmentInfo
from accpinn.serial import Arrays, dump
from accpinn.study import Analysis, Source
from accpinn.study.comparison import compare
from accpinn.study.result import Result, result_of
from accpinn.study.run import analysis_of, estimate, run
from accpinn.study.snapshot import (
    ARRAYS,
    DOCUMENT,
    FORMAT,
    MANIFEST,
    SCHEMA,
    _digest,
    prepare_snapshot,
    to_bytes,
)
from tests.support.driving import driven
from tests.support.samples import FOLDER, PLATOON

NOTE = "α β τ, “quotes”, <tags> and\nlines."


def asked_of(
    segment: Segment, method: str = "least-squares", settings: Any = None, case: Case = "II"
) -> Analysis:
    """The analysis of a segment that no recording stands behind."""
    asked = Analysis(
        Source(segment.source, segment.sha256, None, segment.info.digest),
        segment.vehicles,
        (segment.window,),
        case,
        segment.excluded_regimes,
    )
    return asked.with_method(method, settings)


def result_for(
    segment: Segment, method: str = "least-squares", settings: Any = None, case: Case = "II"
) -> Result:
    """A method's result for such a segment."""
    context = TaskContext(threads=1)
    asked = asked_of(segment, method, settings, case)
    return result_of(asked, (segment,), estimate(asked, (segment,), context=context))


@cache
def small() -> Result:
    """A short window with its data, and least squares."""
    return prepare_snapshot(result_for(driven(duration=20.0, step=0.5)), "small")


@cache
def small_bytes() -> bytes:
    return to_bytes(small())


def altered(
    result: Result,
    *,
    info: SegmentInfo | None = None,
    estimate: Estimate | None = None,
    **changes: Any,
) -> Result:
    """A result with another estimate, another description of its window, or other fields of it."""
    changed = replace(estimate or result.estimate, **changes)
    return replace(result, estimate=changed, infos=(info or result.info,))


def missing_the_drive(result: Result) -> tuple[Result, str]:
    """With parameters that do not reproduce the first follower's drive, and what is said of it."""
    values = result.parameters.everything.copy()
    values[0, 2] *= 2.0  # τ
    missed = altered(result, parameters=Parameters.of(values))
    return missed, missed.trust[0].in_words[1:]


def with_parameters(result: Result, factors: Sequence[float]) -> Result:
    """With other parameters, and so all that follows from them."""
    forged = altered(result, parameters=Parameters.of(result.parameters.values * factors))
    return prepare_snapshot(replace(forged, compared=()))


def numbered(number: int, result: Result | None = None) -> Result:
    """The small result, or another, as the answer to another question."""
    result = result or small()
    asked = replace(result.analysis, source=replace(result.analysis.source, data=f"{number}"))
    return replace(result, analysis=asked, created=f"2026-01-01T00:00:{number:02}Z")


@cache
def platoon() -> Recording:
    """The synthetic platoon's."""
    return read(FOLDER / f"{PLATOON}.csv")


@cache
def trained() -> Result:
    """The PiNN's result for the synthetic platoon, by the preset fast."""
    quick = preset("fast", iterations=20)
    asked = Analysis.of(platoon(), [Window(0.0, 60.0)], method="pinn", settings=quick)
    return run(asked, platoon(), context=TaskContext(threads=1))


@cache
def whole() -> Result:
    """The same with a comparison, as a snapshot has it."""
    quick = ("least-squares", "savitzky-golay")
    outcomes = compare(trained().analysis, platoon(), quick)
    compared = tuple(row for row in outcomes if isinstance(row, Result))
    return prepare_snapshot(replace(trained(), compared=compared), "whole", NOTE)


@cache
def recommended() -> Result:
    """The recommended method's result for the synthetic platoon, with its posterior."""
    asked = Analysis.of(platoon(), [Window(0.0, 60.0)], "1-3")
    return run(asked, platoon(), context=TaskContext(threads=1))


@cache
def two_windows() -> Result:
    """The recommended estimate of two windows."""
    segment = driven(duration=60.0, step=0.5, noise=0.05)
    halves = segment.part(0, 60), segment.part(60, segment.samples)
    asked = analysis_of(halves, asked_of(halves[0], "pinn"))
    return prepare_snapshot(result_of(asked, halves, estimate(asked, halves)), "two")


def delayed(vehicle: int = 2) -> Adequacy:
    """One follower that a delay describes better."""
    estimate, lower, upper = (
        Parameters.of([[factor * value for value in (0.1, 0.3, 1.2, 2.0, 0.5, 0.9)]])
        for factor in (1, 0.8, 1.2)
    )
    forms = tuple(
        ModelForm(form, estimate, lower, upper, np.array([aic]), np.array([1.0]))
        for form, aic in zip(FORMS, (0.0, -1.0, -2.0, -20.0, -19.0), strict=True)
    )  # fmt: skip
    better = BetterForm(vehicle=vehicle, form="cthp-delay", aic=-20.0, holdout=1.0)
    return Adequacy(forms, None, (better,))


def zipped(members: Mapping[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    """A zip file."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method, compresslevel=1) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def lying(data: bytes, name: str, size: int) -> bytes:
    """A zip file whose directory gives a member another size, in both places where it stands."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        place = archive.getinfo(name).header_offset
    changed, entry = bytearray(data), data.rindex(name.encode()) - 46
    assert data[entry:].startswith(b"PK\x01\x02")
    changed[place + 22 : place + 26] = changed[entry + 24 : entry + 28] = size.to_bytes(4, "little")
    return bytes(changed)


def crowded(count: int) -> bytes:
    """A zip file whose directory has so many entries, of one and the same empty member."""
    data = zipped({"a": b""})
    at, end = data.index(b"PK\x01\x02"), data.index(b"PK\x05\x06")
    entries = data[at:end] * count
    ending = bytearray(data[end:])
    ending[8:12] = 2 * min(count, 0xFFFF).to_bytes(2, "little")
    ending[12:16] = len(entries).to_bytes(4, "little")
    return data[:at] + entries + bytes(ending)


def members(data: bytes) -> dict[str, bytes]:
    """What a zip file holds."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def arrays_of(data: bytes) -> Arrays:
    """The arrays of a snapshot's bytes."""
    with np.load(io.BytesIO(members(data)[ARRAYS])) as arrays:
        return dict(arrays)


def sealed(document: bytes, arrays: Arrays, schema: int = SCHEMA) -> bytes:
    """A snapshot of any contents, with the digest that they have."""
    packed = io.BytesIO()
    np.savez(packed, allow_pickle=False, **arrays)
    manifest = {"format": FORMAT, "schema": schema, "sha256": _digest(document, arrays)}
    return zipped(
        {MANIFEST: json.dumps(manifest).encode(), DOCUMENT: document, ARRAYS: packed.getvalue()},
        zipfile.ZIP_DEFLATED,
    )


def resealed(
    change: Callable[[dict[str, Any], Arrays], object],
    data: bytes | None = None,
    schema: int = SCHEMA,
) -> bytes:
    """A snapshot, the small one by default, with its tree or arrays changed and sealed anew."""
    data = data or small_bytes()
    tree, arrays = json.loads(members(data)[DOCUMENT]), arrays_of(data)
    change(tree, arrays)
    return sealed(json.dumps(tree, ensure_ascii=False).encode("utf-8", "replace"), arrays, schema)


def put(tree: Any, place: Sequence[str], leaf: Any) -> None:
    """Set the leaf at a place of a tree of objects and lists."""
    for name in place[:-1]:
        tree = tree[int(name) if isinstance(tree, list) else name]
    tree[int(place[-1]) if isinstance(tree, list) else place[-1]] = leaf


def bits(value: Any) -> tuple[Any, dict[str, tuple[Any, ...]]]:
    """What is equal exactly where all within two values is, to the last bit."""
    tree, arrays = dump(value)
    return tree, {name: (a.dtype, a.shape, a.tobytes()) for name, a in arrays.items()}
