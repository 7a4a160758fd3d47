"""What a snapshot says, held against what its own contents give when computed anew."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from accpinn.assessment import TrackingErrors, closed_loop_errors, surrogate_errors
from accpinn.errors import AccpinnError
from accpinn.openacc import Recording
from accpinn.segment import Segment, cut
from accpinn.segment.quality import assess
from accpinn.segment.regimes import label, leave_out
from accpinn.snapshot.codec import NOT_FINITE, encode
from accpinn.snapshot.content import ID_LENGTH, Snapshot
from accpinn.snapshot.file import Content, load
from accpinn.snapshot.taking import stability
from accpinn.stability import VehicleStability

RELATIVE, ABSOLUTE = 1e-9, 1e-11
"""Figures closer than this are the same; other processors round differently."""


@dataclass(frozen=True)
class Check:
    """One figure, or group of figures, as stored and as recomputed."""

    name: str
    stored: str
    recomputed: str
    ok: bool
    sentence: str


@dataclass(frozen=True)
class Verification:
    """All that was checked."""

    checks: tuple[Check, ...]
    sentence: str
    """The whole in one sentence."""

    @property
    def ok(self) -> bool:
        """Whether all of it agrees."""
        return all(check.ok for check in self.checks)


def verify(content: Content, recording: Recording | None = None) -> Verification:
    """Read a snapshot, then compute its figures anew.

    Args:
        content: the file's path, or its bytes.
        recording: what it was learned from; with it errors are checked too where the snapshot has
            no data.

    Raises:
        SnapshotError: when it cannot be read, naming the damaged part.
    """
    return check(load(content), recording)


def check(snapshot: Snapshot, recording: Recording | None = None) -> Verification:
    """The same for a snapshot that was read already."""
    checks = [_whole(snapshot), *_stability(snapshot)]
    segment = snapshot.segment
    if recording is not None:
        found = _found(snapshot, recording)
        checks.append(found.check)
        segment = segment or found.segment
    if segment is not None:
        checks += _errors(snapshot, segment)
    return Verification(tuple(checks), _sentence(snapshot, checks, segment))


def recovered(snapshot: Snapshot, recording: Recording) -> Segment | None:
    """The window of a snapshot, cut anew from its recording; None where it is another one."""
    return _found(snapshot, recording).segment


def _whole(snapshot: Snapshot) -> Check:
    known = snapshot.id or "not saved yet"
    return Check("Contents", known, known, True, "Every part is as it was written.")


def _stability(snapshot: Snapshot) -> Iterator[Check]:
    old, new = snapshot.stability, stability(snapshot.fit)
    if old is None or new is None:
        same = old is new
        reason = "There is no report, as the parameters allow none."
        yield Check("Stability", _said(old), _said(new), same, reason if same else _DIFFERS)
        return
    for text, one, other in zip(
        snapshot.outline.labels[1:], old.vehicles, new.vehicles, strict=True
    ):
        yield _compared(f"Stability of {text}", (_verdicts(one), _verdicts(other)), one, other)
    if len(old.vehicles) > 1:
        last = [f"‖h‖₁ {float(report.platoon.linf.gain[-1]):.6g}" for report in (old, new)]
        yield _compared("Stability of the platoon", last, old.platoon, new.platoon)


_DIFFERS = "Only one of both has a report."


def _said(report: object) -> str:
    return "no report" if report is None else "a report"


def _verdicts(vehicle: VehicleStability) -> str:
    answers = [
        f"{name} {'yes' if verdict.stable else 'no'}"
        for name, verdict in (("L2", vehicle.l2), ("L∞", vehicle.linf_exact))
    ]
    return f"{', '.join(answers)}, ‖h‖₁ {vehicle.linf_gain:.6g}"


@dataclass(frozen=True, eq=False)
class _Found:
    check: Check
    segment: Segment | None = None


def _found(snapshot: Snapshot, recording: Recording) -> _Found:
    """The snapshot's window in a recording, if that is the one."""
    outline = snapshot.outline
    stored, given = outline.sha256[:ID_LENGTH], recording.sha256[:ID_LENGTH]
    if outline.sha256 != recording.sha256:
        sentence = (
            f"{recording.source} is not the recording the result was learned from; that is"
            f" {outline.source} with the SHA-256 {outline.sha256}."
        )
        return _Found(Check("Recording", stored, given, False, sentence))
    try:
        segment = cut(recording, outline.start, outline.duration, outline.vehicles)
        if outline.left_out:
            segment = leave_out(segment, label(segment, recording), outline.left_out)
    except AccpinnError as fault:
        return _Found(Check("Recording", stored, given, False, str(fault)))
    same = segment.digest() == outline.digest
    sentence = (
        "The recording is the same, and so is the window cut from it."
        if same
        else "The recording is the same, but the window cut from it differs, as if bridged or"
        " resampled in another way."
    )
    window = Check(
        "Window", outline.digest[:ID_LENGTH], segment.digest()[:ID_LENGTH], same, sentence
    )
    return _Found(window, segment if same else None)


def _errors(snapshot: Snapshot, segment: Segment) -> Iterator[Check]:
    quality, fit = assess(segment), snapshot.fit
    conditions = [f"condition {_few(figures.condition)}" for figures in (snapshot.quality, quality)]
    yield _compared("Data's quality", conditions, snapshot.quality, quality)
    if snapshot.assessment is None:
        return
    for name, stored, computed in (
        ("Surrogate fit", snapshot.assessment.surrogate, surrogate_errors(segment, fit)),
        (
            "Closed-loop simulation",
            snapshot.assessment.closed_loop,
            closed_loop_errors(segment, fit),
        ),
    ):
        yield _compared(name, (_mae(stored), _mae(computed)), stored, computed)


def _mae(errors: TrackingErrors | None) -> str:
    return "none" if errors is None else f"gap MAE {_few(errors.gap_mae)} m"


def _few(values: Any) -> str:
    return ", ".join(f"{float(value):.6g}" for value in values)


def _compared(name: str, texts: Sequence[str], one: Any, other: Any) -> Check:
    """Two objects of the same kind, number by number."""
    stored, recomputed = texts
    old, new = dict(_numbers(encode(one))), dict(_numbers(encode(other)))
    differing = [place for place in sorted(old.keys() | new.keys()) if not _same(place, old, new)]
    if not differing:
        figures = "1 figure agrees" if len(old) == 1 else f"All {len(old)} figures agree"
        return Check(name, stored, recomputed, True, f"{figures}.")
    place = differing[0]
    sentence = (
        f"{len(differing)} of {len(old)} figures differ; {place}: stored {old.get(place)},"
        f" recomputed {new.get(place)}."
    )
    return Check(name, stored, recomputed, False, sentence)


def _same(place: str, old: dict[str, float], new: dict[str, float]) -> bool:
    if place not in old or place not in new:
        return False
    return bool(np.isclose(new[place], old[place], rtol=RELATIVE, atol=ABSOLUTE, equal_nan=True))


def _numbers(tree: Any, place: str = "") -> Iterator[tuple[str, float]]:
    """All numbers and answers of a tree by place; wording may change between versions."""
    if isinstance(tree, dict):
        for name, item in tree.items():
            yield from _numbers(item, f"{place}.{name}" if place else name)
    elif isinstance(tree, list):
        for k, item in enumerate(tree):
            yield from _numbers(item, f"{place}.{k}")
    elif isinstance(tree, bool | int | float):
        yield place, float(tree)
    elif isinstance(tree, str) and tree in NOT_FINITE:
        yield place, NOT_FINITE[tree]


def _sentence(snapshot: Snapshot, checks: list[Check], segment: Segment | None) -> str:
    wrong = [check for check in checks if not check.ok]
    if wrong:
        return f"{wrong[0].name}: {wrong[0].sentence}"
    if segment is None:
        origin = f" with the SHA-256 {snapshot.outline.sha256}" if snapshot.outline.sha256 else ""
        return (
            "The snapshot is whole and its stability follows from its parameters; the data are not"
            f" in it, so its errors can only be checked with {snapshot.outline.source}{origin}."
        )
    return "The snapshot is whole, and its stability and errors follow from its contents."
