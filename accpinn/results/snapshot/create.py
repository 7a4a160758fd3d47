"""Snapshots made from results: what is at hand goes in, what is missing is computed."""

import os
import platform
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from importlib import metadata

import numpy as np

from accpinn import __version__
from accpinn.errors import ParameterError, SnapshotError
from accpinn.evaluation.evaluation import Evaluation, evaluate
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.methods.fit import Fit, Outcome, ParameterTrack
from accpinn.recordings.recording import Recording
from accpinn.results.snapshot.schema import (
    LONGEST_NAME,
    LONGEST_NOTE,
    Facts,
    Origin,
    Snapshot,
)
from accpinn.results.snapshot.validate import check_length
from accpinn.segment.quality import assess_quality
from accpinn.segment.segment import Segment
from accpinn.stability.report import StabilityReport, stability_report
from accpinn.study.comparison import MethodResult

PACKAGES = ("torch", "numpy", "scipy", "pandas", "plotly", "streamlit", "control")
TRACK_INSTANTS = 500
"""Of a compared method; more are not seen in a figure."""


def create(
    segment: Segment,
    fit: Fit,
    *,
    recording: Recording | None = None,
    facts: Facts | None = None,
    uncertainty: Uncertainty | None = None,
    evaluation: Evaluation | None = None,
    methods: Sequence[MethodResult] = (),
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
        segment=segment if with_data else None,
    )


def check_texts(name: str, note: str) -> None:
    """Refuse what is too long, before work is done for it.

    Raises:
        SnapshotError: naming the text.
    """
    for text, what, most in ((name, "name", LONGEST_NAME), (note, "note", LONGEST_NOTE)):
        if not isinstance(text, str) or not _is_unicode(text):
            raise SnapshotError(f"The {what} is no text; write it in letters.")
        check_length(text, what, most)


def _is_unicode(text: str) -> bool:
    """Not half a character, as of a file name in another encoding."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


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


def facts_of(recording: Recording | None) -> Facts:
    """What a snapshot says of its recording."""
    if recording is None:
        return {}
    return {
        "campaign": recording.campaign,
        "date": recording.date.isoformat() if recording.date else None,
        "acc_flag": recording.acc_flag,
        "distance_setting": recording.distance_setting,
        "samples": recording.samples,
        "duration": recording.duration,
        "sample_time": recording.sample_time,
    }


def light(fit: Fit) -> Fit:
    """A compared method's fit, without curves and weights, its track at few instants."""
    return replace(fit, surrogate=None, history=None, arrays={}, track=_thinned(fit.track))


def _thinned(track: ParameterTrack | None) -> ParameterTrack | None:
    if track is None or len(track.time) <= TRACK_INSTANTS:
        return track
    keep = np.unique(np.linspace(0, len(track.time) - 1, TRACK_INSTANTS).round().astype(int))
    deviation = track.deviation
    return ParameterTrack(
        track.time[keep],
        track.parameters[keep],
        None if deviation is None else deviation[keep],
    )
