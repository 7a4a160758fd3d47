"""What a snapshot holds: one result with all that is needed to check it and to go on from it."""

from dataclasses import dataclass
from typing import Any

from accpinn.evaluation.evaluation import Evaluation
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Fit
from accpinn.results.snapshot.schema import ATTRIBUTION_TEXT
from accpinn.segment.quality import Quality
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.stability.report import StabilityReport
from accpinn.study.comparison import MethodResult

ID_LENGTH = 16
"""Hex digits of the overall digest that make the short name; no two of a server's will meet."""


@dataclass(frozen=True)
class Origin:
    """The program and the machine that made a snapshot; neither host nor user is named."""

    accpinn: str
    """Version."""
    python: str
    """Version."""
    packages: dict[str, str]
    """Versions by name: torch, numpy, scipy, pandas, plotly, streamlit, control."""
    system: str
    """"Linux", "Windows", "Darwin"."""
    processor: str
    """Architecture, as "x86_64"."""
    cores: int


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A result that travels; see `snapshot.take`, `save`, `load` and `verify`."""

    name: str
    """The user's; may be empty."""
    note: str
    """The user's; may be empty and may have several lines."""
    created: str
    """ISO 8601 in UTC to the second, as "2026-03-01T12:00:00Z"."""
    origin: Origin
    info: SegmentInfo
    """Window, vehicles and origin of the data."""
    facts: dict[str, Any]
    """What is known of the recording; None where it does not say.

    "campaign" (text), "date" (ISO), "acc_flag" (0 human, 1 ACC, 2 mixed), "distance_setting"
    (text), "samples", "duration" (s), "sample_time" (s); empty without a recording.
    """
    quality: Quality
    """What the segment can tell about the parameters."""
    fit: Fit
    uncertainty: Uncertainty | None
    """None where it was neither given nor could be computed."""
    evaluation: Evaluation | None
    """None where it was neither given nor could be computed."""
    stability: StabilityReport | None
    """As it stood at saving; None where τ is undetermined or the values allow no report."""
    rows: tuple[MethodResult, ...] = ()
    """The methods compared; without trajectories, courses thinned to 500 instants at most."""
    segment: Segment | None = None
    """The speeds and space-gaps of the window; only if the user asked for them."""
    attribution: str = ATTRIBUTION_TEXT
    """Whose data and whose method, as the file says."""
    digest: str = ""
    """SHA-256 over all of the file this was read from; empty before it was packed."""

    @property
    def id(self) -> str:
        """Short name: the first 16 hex digits of the digest; empty before it was packed."""
        return self.digest[:ID_LENGTH]
