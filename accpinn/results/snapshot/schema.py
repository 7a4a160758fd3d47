"""What a snapshot holds, and its written form: the parts of the file and their limits.

A snapshot is a zip without compression (see `snapshot.archive`):

    manifest.json      format, schema, and the length and SHA-256 of every other part
    ATTRIBUTION.txt    whose data and whose method
    snapshot.json      name, note, time, program and machine, window, vehicles, recording
    NAME.json          one field of `Snapshot` each, as a tree (see `accpinn.serial`)
    NAME.npz           the larger arrays of that field

SI units throughout; times in s from the window's start. From the recording's first sample count
the starts of the window and of the blocks held out, and the times of collisions.
"""

from dataclasses import dataclass
from typing import Annotated, TypedDict

from msgspec import Meta

from accpinn.evaluation.evaluation import Evaluation
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Fit
from accpinn.segment.quality import Quality
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.stability.report import StabilityReport
from accpinn.study.comparison import MethodResult

FORMAT = "accpinn snapshot"
SCHEMA = 3
SUFFIX = ".accpinn.zip"
LARGEST = 24_000_000
"""Bytes of the whole file; an hour of ten followers with its data stays below."""
LARGEST_DOCUMENT = 1_000_000
"""Bytes of a part that is text."""
LONGEST_NAME, LONGEST_NOTE = 200, 10_000
ID_LENGTH = 16
"""Hex digits of the digest that make the short name; no two of a server's will meet."""

MANIFEST, ATTRIBUTION = "manifest.json", "ATTRIBUTION.txt"
PARTS = {
    "snapshot": "the provenance",
    "quality": "the data's quality",
    "fit": "the estimate",
    "uncertainty": "the intervals",
    "evaluation": "the errors",
    "stability": "the stability report",
    "methods": "the comparison",
    "segment": "the data",
}
"""What sentences call each NAME.json and NAME.npz."""
TITLES = {MANIFEST: "the manifest", ATTRIBUTION: "the attribution"} | {
    f"{name}{suffix}": title for name, title in PARTS.items() for suffix in (".json", ".npz")
}
"""All names that an entry of the file may have."""


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


class Facts(TypedDict, total=False):
    """What a recording says of itself; None where it does not."""

    campaign: str | None
    date: str | None
    """ISO 8601."""
    acc_flag: int | None
    """0 human, 1 ACC, 2 mixed."""
    distance_setting: str | None
    samples: int | None
    duration: float | None
    """In s."""
    sample_time: float | None
    """In s."""


ATTRIBUTION_TEXT = """\
Data

If the recording named in snapshot.json is one of the OpenACC database, then the figures, curves
and, where they are included, the speeds and gaps in this file derive from it:
"OpenACC. An open database of car-following experiments to study the properties of commercial ACC
systems", (c) European Union, European Commission, Joint Research Centre, licensed under
CC BY 4.0 (https://creativecommons.org/licenses/by/4.0/),
DOI 10.2905/9702C950-C80F-4D2F-982F-44D06EA0009F. Described in M. Makridis, K. Mattas, A. Anesiadou
and B. Ciuffo, Transportation Research Part C 125, 103047, 2021. Name both when you pass this file
on or publish what is in it. What was changed is said in snapshot.json under "info": a window was
cut, and samples may have been bridged, resampled or left out.

Method

T. Apostolakis and K. Ampountolas, "Physics-inspired neural networks for parameter learning of
adaptive cruise control systems", IEEE Transactions on Vehicular Technology, 2024. Please cite that
paper for the method.
"""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A result that travels; see `create`, `save`, `load` and `verify`."""

    name: Annotated[str, Meta(max_length=LONGEST_NAME)]
    """The user's; may be empty."""
    note: Annotated[str, Meta(max_length=LONGEST_NOTE)]
    """The user's; may be empty and may have several lines."""
    created: Annotated[str, Meta(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$")]
    """ISO 8601 in UTC to the second, as "2026-03-01T12:00:00Z"."""
    origin: Origin
    info: SegmentInfo
    """Window, vehicles and origin of the data."""
    facts: Facts
    """What is known of the recording; empty without one."""
    quality: Quality
    """How well the segment determines the parameters."""
    fit: Fit
    uncertainty: Uncertainty | None
    """None where it was neither given nor could be computed."""
    evaluation: Evaluation | None
    """None where it was neither given nor could be computed."""
    stability: StabilityReport | None
    """As it stood at saving; None where τ is undetermined or the values allow no report."""
    methods: tuple[MethodResult, ...] = ()
    """The methods compared; without trajectories, tracks thinned to 500 instants at most."""
    segment: Segment | None = None
    """The speeds and space-gaps of the window; only if the user asked for them."""
    attribution: str = ATTRIBUTION_TEXT
    """Whose data and whose method, as the file says."""
    digest: str = ""
    """SHA-256 of the manifest, and so over the whole file; empty before the snapshot was packed."""

    @property
    def id(self) -> str:
        """Short name: the first 16 hex digits of the digest; empty before it was packed."""
        return self.digest[:ID_LENGTH]
