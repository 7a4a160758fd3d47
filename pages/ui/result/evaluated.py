"""A result with all that is known of it: of the session's training, or as a snapshot holds it."""

from dataclasses import dataclass
from functools import lru_cache

from accpinn.results.snapshot import Snapshot

from accpinn.evaluation.closed_loop import closed_loop
from accpinn.evaluation.evaluation import Evaluation, evaluate
from accpinn.inference.intervals import Uncertainty
from accpinn.inference.model_adequacy import Adequacy
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.segment.quality import Quality, assess_quality
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.units import Seconds
from pages.ui.session.resources import KEPT
from pages.ui.session.workspace import Workspace

simulated = lru_cache(maxsize=KEPT)(closed_loop)
"""The closed-loop simulation, kept as every run of a page shows it again."""
_evaluated = lru_cache(maxsize=KEPT)(evaluate)


@dataclass(frozen=True, eq=False)
class Evaluated:
    """What a page shows of a fit."""

    info: SegmentInfo
    fit: Fit
    quality: Quality
    evaluation: Evaluation | None
    """None where it is not known."""
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
        segment.info, fit, assess_quality(segment), _evaluated(segment, fit),
        workspace.uncertainty(), workspace.known_adequacy, workspace.recording_duration,
        segment, simulated(segment, fit), workspace.true_parameters,
    )  # fmt: skip


def of_snapshot(snapshot: Snapshot, segment: Segment | None) -> Evaluated:
    """A saved result, with its data where they are here."""
    return Evaluated(
        snapshot.info, snapshot.fit, snapshot.quality, snapshot.evaluation,
        snapshot.uncertainty, snapshot.adequacy, snapshot.facts.get("duration"),
        segment, simulated(segment, snapshot.fit) if segment else None,
    )  # fmt: skip
