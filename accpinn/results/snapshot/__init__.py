"""Results that travel: what a snapshot holds, its written form, and how one is made.

A snapshot is a zip without compression (see `snapshot.archive`):

    manifest.json      format, schema, and the length and SHA-256 of every other part
    ATTRIBUTION.txt    whose data and whose method
    snapshot.json      name, note, time, program and machine, window, vehicles, recording
    NAME.json          one field of `Snapshot` each, as a tree (see `accpinn.serial`)
    NAME.npz           the larger arrays of that field

SI units throughout; times in s from the window's start. From the recording's first sample count
the starts of the window and of the blocks held out, and the times of collisions.
"""

import os
import platform
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib import metadata
from typing import Annotated

import numpy as np
from msgspec import Meta

from accpinn import __version__
from accpinn.errors import ParameterError, SnapshotError
from accpinn.evaluation.evaluation import Evaluation, evaluate
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.inference.model_adequacy import Adequacy
from accpinn.methods.fit import Fit, Outcome, ParameterTrack
from accpinn.recordings.recording import Facts, Recording, facts_of
from accpinn.segment.quality import Quality, assess_quality
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.stability.report import StabilityReport, stability_report
from accpinn.study.comparison import MethodResult

PACKAGES = ("torch", "numpy", "scipy", "pandas", "plotly", "streamlit", "control")
TRACK_INSTANTS = 500
"""Of a compared method; more are not seen in a figure."""

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
    "adequacy": "the model's forms",
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
    adequacy: Adequacy | None = None
    """The forms of the model; None where they were not compared."""
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


def create(
    segment: Segment,
    fit: Fit,
    *,
    recording: Recording | None = None,
    facts: Facts | None = None,
    uncertainty: Uncertainty | None = None,
    evaluation: Evaluation | None = None,
    methods: Sequence[MethodResult] = (),
    adequacy: Adequacy | None = None,
    name: str = "",
    note: str = "",
    with_data: bool = False,
) -> Snapshot:
    """Make a snapshot of a result, ready to be sent to others; what is not given is computed.

    Args:
        segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m that the fit was learned from.
        fit: any method's.
        recording: the segment's; with it the snapshot names campaign, date and settings.
        facts: what is known of the recording where it is not at hand.
        uncertainty: the fit's, if it is known already.
        evaluation: the fit's, if it is known already.
        methods: the results of the methods compared on the same segment.
        adequacy: the forms of the model on the same segment, if they were compared.
        name: of the user's choice.
        note: of the user's choice.
        with_data: whether speeds and space-gaps of the window go in.

    Raises:
        SnapshotError: for a training that diverged, or texts that are too long.
    """
    if fit.outcome is Outcome.DIVERGED:
        raise SnapshotError("A training that diverged has no result to keep; train again first.")
    check_texts(name, note)
    return Snapshot(
        name=name,
        note=note,
        created=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        origin=origin(),
        info=segment.info,
        facts=facts_of(recording) or facts or {},
        quality=assess_quality(segment),
        fit=fit,
        uncertainty=uncertainty or intervals(segment, fit),
        evaluation=evaluation or evaluate(segment, fit, recording=recording),
        stability=stability(fit),
        methods=tuple(replace(result, fit=light(result.fit)) for result in methods),
        adequacy=adequacy,
        segment=segment if with_data else None,
    )


def check_texts(name: str, note: str) -> None:
    """Refuse what is too long, before work is done for it.

    Raises:
        SnapshotError: naming the text.
    """
    for text, what, most in ((name, "name", LONGEST_NAME), (note, "note", LONGEST_NOTE)):
        try:
            text.encode()
        except (AttributeError, UnicodeEncodeError):  # half a character is none, either
            raise SnapshotError(f"The {what} is no text; write it in letters.") from None
        check_length(text, what, most)


def check_length(text: str, what: str, most: int) -> None:
    """Refuse a text that is longer than ``most`` characters.

    Raises:
        SnapshotError: in one sentence.
    """
    if len(text) > most:
        raise SnapshotError(
            f"The {what} is {len(text):,} characters long; choose one of {most:,} at most."
        )


def stability(fit: Fit) -> StabilityReport | None:
    """The report on the estimated parameters; None where they allow none."""
    with suppress(ParameterError):
        return stability_report(fit.parameters)
    return None


def origin() -> Origin:
    """This program on this machine."""
    return Origin(
        accpinn=__version__,
        python=platform.python_version(),
        packages={package: _version(package) for package in PACKAGES},
        system=platform.system(),
        processor=platform.machine(),
        cores=os.cpu_count() or 1,
    )


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def light(fit: Fit) -> Fit:
    """A compared method's fit, without curves and weights, its track at few instants."""
    track = fit.track
    if track and len(track.time) > TRACK_INSTANTS:
        keep = np.linspace(0, len(track.time) - 1, TRACK_INSTANTS).round().astype(int)
        deviation = None if track.deviation is None else track.deviation[keep]
        track = ParameterTrack(track.time[keep], track.parameters[keep], deviation)
    return replace(fit, surrogate=None, history=None, arrays={}, track=track)
