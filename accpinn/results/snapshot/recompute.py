"""What a snapshot says of its data and its fit, held against what the data give."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from accpinn.errors import ConfigError
from accpinn.evaluation.closed_loop import TrackingErrors, closed_loop_errors
from accpinn.evaluation.cross_validation import pooled_holdout_errors
from accpinn.evaluation.evaluation import Evaluation, evaluate
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.methods.fit import Fit
from accpinn.recordings.recording import Recording
from accpinn.results.snapshot.agreement import ABSOLUTE, Check, compared
from accpinn.results.snapshot.content import Snapshot
from accpinn.results.tables.names import name_of
from accpinn.segment.quality import assess_quality
from accpinn.segment.segment import Segment

INTERVALS = 1e-6
"""Intervals closer than this share are the same: their draws follow from solutions of nearly
singular equations."""


def from_data(
    snapshot: Snapshot, segment: Segment, recording: Recording | None, wording: bool
) -> Iterator[Check]:
    """Quality, errors, intervals, and the methods compared; ``wording``: sentences count too."""
    quality, fit = assess_quality(segment), snapshot.fit
    conditions = [f"condition {few(figures.condition)}" for figures in (snapshot.quality, quality)]
    yield compared("Data's quality", conditions, snapshot.quality, quality, wording=wording)
    if snapshot.evaluation is None:
        yield _missing("Errors")
    else:
        computed = evaluate(segment, fit, recording=recording)
        yield from _errors(snapshot, snapshot.evaluation, computed, wording)
    if snapshot.uncertainty is None:
        yield _missing("Intervals")
    else:
        yield _intervals("Intervals", snapshot.uncertainty, segment, fit, wording)
    for row in snapshot.rows:
        stored, driven = row.evaluation.closed_loop, closed_loop_errors(segment, row.fit)
        title = f"Closed-loop simulation, {name_of(row.fit)}"
        yield compared(title, (mae(stored), mae(driven)), stored, driven)
        title = f"Intervals, {name_of(row.fit)}"
        yield _intervals(title, row.uncertainty, segment, row.fit, wording)
        yield from pooled(f"Held out, {name_of(row.fit)}", row.evaluation)


def _missing(name: str) -> Check:
    return Check(name, "missing", "computed", False, "They are missing, though the data give them.")


def _errors(snapshot: Snapshot, old: Evaluation, new: Evaluation, wording: bool) -> Iterator[Check]:
    pairs = [
        ("Surrogate fit", old.surrogate, new.surrogate),
        ("Closed-loop simulation", old.closed_loop, new.closed_loop),
    ]
    # Without facts the snapshot was taken without its recording, and there was no rest.
    if new.out_of_window is not None and (old.out_of_window is not None or snapshot.facts):
        pairs.append(("Rest of the recording", old.out_of_window, new.out_of_window))
    for name, stored, computed in pairs:
        yield compared(name, (mae(stored), mae(computed)), stored, computed)
    lasting = [f"lasts {few(one.whiteness.memory)} s" for one in (old, new)]
    yield compared("Residual", lasting, old.whiteness, new.whiteness, wording=wording)
    vehicles = snapshot.info.vehicles
    touches = [f"at {few(one.collision_times(vehicles))} s" for one in (old, new)]
    met = [msgspec.to_builtins(one.findings) for one in (old, new)]
    yield compared("Collisions", touches, met[0], met[1], wording=wording)
    yield from pooled("Held out", old)


def pooled(name: str, worth: Evaluation) -> Iterator[Check]:
    """Whether the error over all blocks held out is that of the blocks."""
    if worth.blocks or worth.holdout:
        whole = pooled_holdout_errors(worth.blocks) if worth.blocks else None
        yield compared(name, (mae(worth.holdout), mae(whole)), worth.holdout, whole)


def _intervals(
    name: str, stored: Uncertainty, segment: Segment, fit: Fit, same_version: bool
) -> Check:
    try:
        computed = intervals(segment, fit, stored.level, draws=len(stored.draws))
    except ConfigError as fault:
        return Check(name, "not possible", "none", False, str(fault))
    texts = _ends(stored), _ends(computed)
    if stored.method != computed.method:
        if same_version:
            sentence = f"They are said to be made by “{stored.method}”, which this version has not."
            return Check(name, *texts, False, sentence)
        sentence = f"Not compared, as another method was used then: {stored.method}."
        return Check(name, *texts, True, sentence)
    one, other = (
        replace(uncertainty, seconds=0.0, findings=()) for uncertainty in (stored, computed)
    )
    # Thousands of draws are compared at once; only where they differ one by one, to name the place.
    if np.allclose(one.draws.values, other.draws.values, INTERVALS, ABSOLUTE, equal_nan=True):
        one, other = (
            replace(uncertainty, draws=uncertainty.draws[:0]) for uncertainty in (one, other)
        )
    return compared(name, texts, one, other, INTERVALS)


def _ends(uncertainty: Uncertainty) -> str:
    return f"α {few(uncertainty.lower.alpha)} to {few(uncertainty.upper.alpha)}"


def mae(errors: TrackingErrors | None) -> str:
    """Errors in short."""
    return "none" if errors is None else f"gap MAE {few(errors.gap_mae)} m"


def few(values: Any) -> str:
    """Numbers in short."""
    return ", ".join("–" if np.isnan(value) else f"{float(value):.6g}" for value in values)
