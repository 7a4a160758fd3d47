"""Validation of learned parameters on data that they were not learned from.

Only the leader's measured speed of the other window is given; the model's own states are integrated
from its first measured instant on (see `evaluation.closed_loop`). The same errors on the window
that the parameters were learned from stand beside them. If the errors on the other window are far
larger, the parameters describe only the first window.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from accpinn.errors import SegmentError
from accpinn.evaluation.closed_loop import (
    ClosedLoopFinding,
    TrackingErrors,
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
)
from accpinn.findings import Finding, Labelled, Words
from accpinn.methods.fit import Fit
from accpinn.segment.segment import Segment
from accpinn.units import Seconds


class ValidationOverlaps(Finding, frozen=True):
    """The window of the validation overlaps the one that was learned from."""

    text = (
        "The validation window shares {seconds:.0f} s with the one learned from, so its errors are"
        " too small; choose one outside it."
    )

    seconds: Seconds
    """Duration of the overlap."""


class OtherVehicles(Finding, frozen=True):
    """The vehicles of the validation have other names than those learned from."""

    text = (
        "The validation is on other vehicles: {pairs}. The errors show how well the parameters of"
        " one car describe another."
    )

    learned: tuple[str, ...]
    """Labels of the followers that were learned from."""
    validated: tuple[str, ...]
    """Labels of the followers of the validation, in the same order."""

    def _words(self, about: Labelled) -> Words:
        pairs = zip(self.learned, self.validated, strict=True)
        replaced = (f"{new} instead of {old}" for old, new in pairs if old != new)
        return {"pairs": "; ".join(replaced)}


@dataclass(frozen=True, eq=False)
class Validation:
    """Closed-loop errors of one parameter set on two windows."""

    learned: TrackingErrors | None
    """Errors on the window that was learned from; None where nothing can be simulated."""
    validated: TrackingErrors | None
    """Errors on the other window; None where nothing can be simulated."""
    events: tuple[ClosedLoopFinding, ...]
    """Collisions, reversing and divergence on the other window."""
    findings: tuple[ValidationOverlaps | OtherVehicles, ...]
    """Why the errors may say less than they seem to."""


def validate(fit: Fit, segment: Segment, other: Segment) -> Validation:
    """Errors of the closed-loop simulation on the segment of a fit and on another one.

    Args:
        fit: the fit of any method, with M followers.
        segment: the data that it was learned from.
        other: data of M followers in the same order.

    Raises:
        SegmentError: if the number of followers differs.
    """
    if other.followers != segment.followers:
        raise SegmentError(
            f"{other.source}, {other.window}: {other.followers} followers cannot validate the"
            f" parameters of {segment.followers}; choose as many."
        )
    return Validation(
        closed_loop_errors(segment, fit),
        closed_loop_errors(other, fit),
        closed_loop_findings(other, closed_loop(other, fit)),
        tuple(_findings(segment, other)),
    )


def _findings(segment: Segment, other: Segment) -> Iterator[ValidationOverlaps | OtherVehicles]:
    same_run = (segment.sha256, segment.source) == (other.sha256, other.source)
    if same_run:
        learned_on, tried_on = segment.window, other.window
        shared = min(learned_on.end, tried_on.end) - max(learned_on.start, tried_on.start)
        same = bool(np.isin(other.vehicles[1:], segment.vehicles[1:]).any())
        if shared > 0 and same:
            yield ValidationOverlaps(float(shared))
    # In another run the same car may have another place; in one run two may have the same name.
    learned, validated = ((s.labels if same_run else s.names)[1:] for s in (segment, other))
    if learned != validated:
        yield OtherVehicles(segment.labels[1:], other.labels[1:])
