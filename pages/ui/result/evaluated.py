"""A result with all that is known of it: of the session's training, or as a snapshot holds it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from accpinn.evaluation.closed_loop import (
    ClosedLoopFinding,
    TrackingErrors,
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
    surrogate_errors,
)
from accpinn.evaluation.whiteness import Whiteness, whiteness
from accpinn.inference.intervals import Uncertainty
from accpinn.inference.model_adequacy import Adequacy
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.results.snapshot import Snapshot
from accpinn.segment.quality import Quality, assess_quality
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.units import Seconds
from pages.ui.session.resources import KEPT
from pages.ui.session.workspace import Workspace


@dataclass(frozen=True, eq=False)
class Evaluated:
    """What a page shows of a fit."""

    info: SegmentInfo
    fit: Fit
    quality: Quality
    surrogate: TrackingErrors | None
    """Errors of the method's own curves."""
    simulated: TrackingErrors | None
    """Errors of the closed-loop simulation."""
    events: Sequence[ClosedLoopFinding] | None
    """Of that simulation; None where they are not known."""
    residual: Whiteness | None
    uncertainty: Uncertainty | None
    adequacy: Adequacy | None = None
    """Of the forms of the model, where they were compared."""
    recording: Seconds | None = None
    """The recording's duration, where it is known."""
    segment: Segment | None = None
    """None where the data are not here."""
    driven: Trajectories | None = None
    """The closed-loop simulation; None where the data are not here."""
    truth: Parameters | None = None
    """The true parameters, where they are known."""


def of_training(workspace: Workspace) -> Evaluated | None:
    """The session's training, once it has a fit."""
    fit, segment = workspace.fit, workspace.segment
    if fit is None or segment is None:
        return None
    return Evaluated(
        segment.info, fit, assess_quality(segment), *_evaluate(segment, fit),
        uncertainty=workspace.uncertainty(), adequacy=workspace.known_adequacy,
        recording=workspace.recording_duration, segment=segment, driven=simulated(segment, fit),
        truth=workspace.true_parameters,
    )  # fmt: skip


def of_snapshot(snapshot: Snapshot, segment: Segment | None) -> Evaluated:
    """A saved result, with its data where they are here."""
    fit, saved = snapshot.fit, snapshot.evaluation
    return Evaluated(
        snapshot.info, fit, snapshot.quality,
        saved.surrogate if saved else None,
        saved.closed_loop if saved else None,
        saved.all_findings if saved else None,
        saved.whiteness if saved else None,
        snapshot.uncertainty, snapshot.adequacy, snapshot.facts.get("duration"),
        segment, simulated(segment, fit) if segment else None,
    )  # fmt: skip


@lru_cache(maxsize=KEPT)
def simulated(segment: Segment, fit: Fit) -> Trajectories | None:
    """The closed-loop simulation, kept as every run of a page shows it again."""
    return closed_loop(segment, fit)


@lru_cache(maxsize=KEPT)
def _evaluate(
    segment: Segment, fit: Fit
) -> tuple[
    TrackingErrors | None, TrackingErrors | None, Sequence[ClosedLoopFinding], Whiteness | None
]:
    events = closed_loop_findings(segment, simulated(segment, fit))
    errors = surrogate_errors(segment, fit), closed_loop_errors(segment, fit)
    return *errors, events, whiteness(segment, fit)
