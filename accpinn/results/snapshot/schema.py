"""The written form of a snapshot: its parts, their versions, and how an older one is brought up.

A snapshot is a zip without compression (see `snapshot.archive`):

    manifest.json      format, schema, the length and SHA-256 of every other part, and one over all
    ATTRIBUTION.txt    whose data and whose method
    snapshot.json      name, note, time, program and machine, window, vehicles, recording
    quality.json       what the window can tell
    fit.json           method, settings, parameters, outcome
    fit.npz            curves of the method, history, course
    weights.npz        the network's weights
    uncertainty.json   intervals
    draws.npz          their draws, each set once
    evaluation.json    errors of all kinds
    stability.json     verdicts, numbers and reasons
    rows.json          the methods compared
    rows.npz           their courses
    data.npz           speeds and space-gaps of the window, only if the user asked

SI units throughout; times in s from the window's start. From the recording's first sample count
the starts of the window and of the blocks held out, and when each law first collides
(`Assessment.collisions`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from accpinn.errors import SnapshotError
from accpinn.results.snapshot.arrays import Shape

FORMAT = "accpinn snapshot"
SCHEMA = 2
SUFFIX = ".accpinn.zip"
LARGEST = 24_000_000
"""Bytes of the whole file; an hour of ten followers with its data stays below."""
MANIFEST, ATTRIBUTION = "manifest.json", "ATTRIBUTION.txt"
MOST_ENTRIES = 64
"""More are not even listed."""
LONGEST_NAME, LONGEST_NOTE = 200, 10_000
DOCUMENT, ARRAYS = 1_000_000, LARGEST


@dataclass(frozen=True)
class Part:
    """One entry of the file."""

    title: str
    """How sentences name it."""
    largest: int
    """Bytes at most."""
    required: bool = False


PARTS: Mapping[str, Part] = {
    MANIFEST: Part("the manifest", 20_000, True),
    ATTRIBUTION: Part("the attribution", 20_000, True),
    "snapshot.json": Part("the provenance", DOCUMENT, True),
    "quality.json": Part("the data's quality", DOCUMENT, True),
    "fit.json": Part("the estimate", DOCUMENT, True),
    "fit.npz": Part("the method's curves", ARRAYS, True),
    "weights.npz": Part("the network's weights", ARRAYS, True),
    "uncertainty.json": Part("the intervals", DOCUMENT),
    "draws.npz": Part("the intervals' draws", ARRAYS, True),
    "evaluation.json": Part("the errors", DOCUMENT),
    "stability.json": Part("the stability report", DOCUMENT),
    "rows.json": Part("the comparison", DOCUMENT, True),
    "rows.npz": Part("the compared methods' courses", ARRAYS, True),
    "data.npz": Part("the data slice", ARRAYS),
}

HISTORY = {
    **{name: Shape(("K",)) for name in ("iteration", "seconds", "total", "data", "physics")},
    "initial": Shape(("K",)),
    "parameters": Shape(("K", "P", 3)),
}
SURROGATE = {
    "time": Shape(("N",)),
    "speeds": Shape(("N", "V")),
    "gaps": Shape(("N", "M")),
}
COURSE = {
    "time": Shape(("C",)),
    "parameters": Shape(("C", "M", 3), finite=False),
    "deviation": Shape(("C", "M", 3), finite=False),
}
DATA = {**SURROGATE, "mask": Shape(("N", "M"), "|b1")}
DRAWS = Shape(("D", "M", 3), finite=False)

FIELDS: Mapping[str, tuple[str | int, ...]] = {
    "SegmentInfo.vehicles": ("V",),
    "SegmentInfo.names": ("V",),
    "Quality.mean_time_gap": ("M",),
    "Quality.relative_deviation": ("M",),
    "Quality.acceleration_deviation": ("M",),
    "Quality.condition": ("M",),
    "Quality.car_following": ("M",),
    "Fit.parameters": ("M",),
    "Uncertainty.centre": ("M", 3),
    "Uncertainty.lower": ("M", 3),
    "Uncertainty.upper": ("M", 3),
    "Uncertainty.inside": ("M", 3),
    "Uncertainty.probability_l2": ("M",),
    "Uncertainty.probability_linf": ("M",),
    "Interval.lower": ("M",),
    "Interval.upper": ("M",),
    "TrackingErrors.speed_mae": ("V",),
    "TrackingErrors.gap_mae": ("M",),
    "TrackingErrors.speed_rmse": ("V",),
    "TrackingErrors.gap_rmse": ("M",),
    "Whiteness.deviation": ("M",),
    "Whiteness.correlation": ("M",),
    "Whiteness.memory": ("M",),
    "Whiteness.independent": ("M",),
    "Whiteness.probability": ("M",),
    "Whiteness.sentences": ("M",),
    "Evaluation.collisions": ("M",),
    "StabilityReport.vehicles": ("M",),
    "PlatoonStability.peaks": ("M",),
    "Gains.gain": ("M",),
    "Gains.error": ("M",),
}
"""Lengths of what stands in the documents: M followers, V = M + 1 vehicles."""

Documents = dict[str, Any]


def check_schema(schema: int) -> None:
    """Refuse a schema that this program does not know.

    Raises:
        SnapshotError: asking for an update where the schema is newer.
    """
    if schema > SCHEMA:
        raise SnapshotError(
            f"The snapshot was written by a newer accpinn (schema {schema}, this one reads up to"
            f" {SCHEMA}); update accpinn to open it."
        )
    if schema < 1:
        raise SnapshotError(f"The snapshot is refused: there is no schema {schema}.")


def migrated(documents: Documents, schema: int) -> Documents:
    """The documents of a known schema as the present one has them."""
    for step in MIGRATIONS[schema - 1 :]:
        documents = step(documents)
    return documents


def _from_1(documents: Documents) -> Documents:
    """Schema 1 knew no regimes left out, no blocks held out, and nothing beyond the window."""
    try:
        info = documents["snapshot.json"]["info"]
        later: list[tuple[Documents, Documents]] = [(info, {"left_out": [], "excluded_share": []})]
        assessments = [row["evaluation"] for row in documents["rows.json"]]
        if "evaluation.json" in documents:
            assessments.append(documents["evaluation.json"])
        for evaluation in assessments:
            later.append((evaluation, {"blocks": [], "unseen": None, "unseen_seconds": 0.0}))
        for tree, fields in later:
            if tree.keys() & fields.keys():  # a later schema's, relabelled to lose these
                raise KeyError
            tree |= fields
    except (KeyError, TypeError, AttributeError):
        raise SnapshotError("The snapshot is refused: it does not keep to schema 1.") from None
    return documents


MIGRATIONS: tuple[Callable[[Documents], Documents], ...] = (_from_1,)
"""From schema 1 to 2, and so on."""

ATTRIBUTION_TEXT = """\
Data

If the recording named in snapshot.json is one of the OpenACC database, then the figures, curves
and, where they are included, the speeds and gaps in this file derive from it:
"OpenACC. An open database of car-following experiments to study the properties of commercial ACC
systems", (c) European Union, European Commission, Joint Research Centre, licensed under
CC BY 4.0 (https://creativecommons.org/licenses/by/4.0/),
DOI 10.2905/9702C950-C80F-4D2F-982F-44D06EA0009F. Described in M. Makridis, K. Mattas, A. Anesiadou
and B. Ciuffo, Transportation Research Part C 125, 103047, 2021. Name both when you pass this file
on or publish what is in it. What was changed is said in snapshot.json under "notes": a window was
cut, and samples may have been bridged, resampled or left out.

Method

T. Apostolakis and K. Ampountolas, "Physics-inspired neural networks for parameter learning of
adaptive cruise control systems", IEEE Transactions on Vehicular Technology, 2024. Please cite that
paper for the method.
"""
