"""What a snapshot says, held against what its own contents give when computed anew."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from accpinn.assessment import Assessment, TrackingErrors, appraise, closed_loop_errors
from accpinn.errors import AccpinnError, ConfigError
from accpinn.fit import Fit
from accpinn.openacc import Recording
from accpinn.segment import Segment, cut
from accpinn.segment.quality import assess
from accpinn.segment.regimes import label, leave_out
from accpinn.snapshot.agreement import Check, compared
from accpinn.snapshot.content import ID_LENGTH, Snapshot
from accpinn.snapshot.file import Content, load
from accpinn.snapshot.taking import stability
from accpinn.stability import VehicleStability
from accpinn.uncertainty import Uncertainty, intervals

INTERVALS = 1e-6
"""The same for intervals, whose draws follow from solutions of nearly singular equations."""


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
        recording: what it was learned from; with it errors and intervals are checked too where the
            snapshot has no data, and so are errors on the rest of the recording.

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
        same = recording if recording and recording.sha256 == snapshot.outline.sha256 else None
        checks += _learned(snapshot, segment, same)
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
        yield compared(f"Stability of {text}", (_verdicts(one), _verdicts(other)), one, other)
    if len(old.vehicles) > 1:
        last = [f"‖h‖₁ {float(report.platoon.linf.gain[-1]):.6g}" for report in (old, new)]
        yield compared("Stability of the platoon", last, old.platoon, new.platoon)


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


def _learned(snapshot: Snapshot, segment: Segment, recording: Recording | None) -> Iterator[Check]:
    """What follows from the data: their quality, errors, intervals, and the methods compared."""
    quality, fit = assess(segment), snapshot.fit
    conditions = [f"condition {_few(figures.condition)}" for figures in (snapshot.quality, quality)]
    yield compared("Data's quality", conditions, snapshot.quality, quality)
    if snapshot.assessment is not None:
        yield from _errors(snapshot.assessment, appraise(segment, fit, recording=recording))
    if snapshot.uncertainty is not None:
        yield _intervals("Intervals", snapshot.uncertainty, segment, fit)
    for row in snapshot.rows:
        stored, computed = row.assessment.closed_loop, closed_loop_errors(segment, row.fit)
        title = f"Closed-loop simulation, {row.fit.method}"
        yield compared(title, (_mae(stored), _mae(computed)), stored, computed)
        yield _intervals(f"Intervals, {row.fit.method}", row.uncertainty, segment, row.fit)


def _errors(old: Assessment, new: Assessment) -> Iterator[Check]:
    pairs = [
        ("Surrogate fit", old.surrogate, new.surrogate),
        ("Closed-loop simulation", old.closed_loop, new.closed_loop),
    ]
    if old.unseen is not None and new.unseen is not None:
        pairs.append(("Rest of the recording", old.unseen, new.unseen))
    for name, stored, computed in pairs:
        yield compared(name, (_mae(stored), _mae(computed)), stored, computed)
    lasting = [f"lasts {_few(one.whiteness.memory)} s" for one in (old, new)]
    yield compared("Residual", lasting, old.whiteness, new.whiteness)
    touches = [f"at {_few(one.collisions)} s" for one in (old, new)]
    yield compared("Collisions", touches, old.collisions, new.collisions)


def _intervals(name: str, stored: Uncertainty, segment: Segment, fit: Fit) -> Check:
    try:
        computed = intervals(segment, fit, stored.level, draws=len(stored.draws))
    except ConfigError as fault:
        return Check(name, "not possible", "none", False, str(fault))
    texts = _ends(stored), _ends(computed)
    if stored.method != computed.method:
        sentence = f"Not compared, as another method was used then: {stored.method}."
        return Check(name, *texts, True, sentence)
    one, other = (replace(doubt, seconds=0.0, notes=()) for doubt in (stored, computed))
    return compared(name, texts, one, other, INTERVALS)


def _ends(doubt: Uncertainty) -> str:
    return f"α {_few(doubt.lower[:, 0])} to {_few(doubt.upper[:, 0])}"


def _mae(errors: TrackingErrors | None) -> str:
    return "none" if errors is None else f"gap MAE {_few(errors.gap_mae)} m"


def _few(values: Any) -> str:
    return ", ".join("–" if np.isnan(value) else f"{float(value):.6g}" for value in values)


def _sentence(snapshot: Snapshot, checks: list[Check], segment: Segment | None) -> str:
    wrong = [check for check in checks if not check.ok]
    if wrong:
        return f"{wrong[0].name}: {wrong[0].sentence}"
    if segment is None:
        origin = f" with the SHA-256 {snapshot.outline.sha256}" if snapshot.outline.sha256 else ""
        return (
            "The snapshot is whole and its stability follows from its parameters; the data are not"
            " in it, so its errors and intervals can only be checked with"
            f" {snapshot.outline.source}{origin}."
        )
    return (
        "The snapshot is whole, and its stability, errors and intervals follow from its contents."
    )
