"""Validation of learned parameters on data that they were not learned from.

Only the leader's measured speed of the other window is given; the model's own states are integrated
from its first measured instant on (see `evaluation.closed_loop`). The same errors on the window
that the parameters were learned from stand beside them: far larger ones on the other window mean
that the parameters describe the first one only.
"""

from dataclasses import dataclass

import numpy as np

from accpinn.errors import Finding, SegmentError
from accpinn.evaluation.closed_loop import (
    ClosedLoopFinding,
    TrackingErrors,
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
)
from accpinn.methods.fit import Fit
from accpinn.segment.segment import Segment
from accpinn.units import Seconds


class ValidationOverlaps(Finding, frozen=True):
    """The window of the validation shares instants with the one that was learned from."""

    seconds: Seconds


class OtherVehicles(Finding, frozen=True):
    """The vehicles of the validation have other names than those learned from."""

    learned: tuple[str, ...]
    """Their labels, followers only."""
    validated: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Validation:
    """Closed-loop errors of one parameter set on two windows."""

    learned: TrackingErrors | None
    """On the window that it was learned from; None where nothing can be simulated."""
    validated: TrackingErrors | None
    """On the other one."""
    events: tuple[ClosedLoopFinding, ...]
    """Collisions, reversing and divergence on the other one."""
    findings: tuple[ValidationOverlaps | OtherVehicles, ...]
    """Why the errors may say less than they seem to."""


def validate(fit: Fit, segment: Segment, other: Segment) -> Validation:
    """Errors of the closed-loop simulation on the segment of a fit and on another one.

    Args:
        fit: any method's, with M followers.
        segment: what it was learned from.
        other: as many followers, in the same order.

    Raises:
        SegmentError: for another number of followers.
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


def _findings(segment: Segment, other: Segment) -> list[ValidationOverlaps | OtherVehicles]:
    found: list[ValidationOverlaps | OtherVehicles] = []
    same_run = (segment.sha256, segment.source) == (other.sha256, other.source)
    if same_run:
        one, two = segment.window, other.window
        shared = min(one.end, two.end) - max(one.start, two.start)
        same = bool(np.isin(other.vehicles[1:], segment.vehicles[1:]).any())
        if shared > 0 and same:
            found.append(ValidationOverlaps(float(shared)))
    # In another run the same car may have another place; in one run two may have the same name.
    learned, validated = ((s.labels if same_run else s.names)[1:] for s in (segment, other))
    if learned != validated:
        found.append(OtherVehicles(segment.labels[1:], other.labels[1:]))
    return found
