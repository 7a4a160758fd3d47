"""What no genuine snapshot says, though its form allows it: refused before anything reads it."""

import re
from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any

import numpy as np

from accpinn.errors import ParameterError, SnapshotError
from accpinn.inference.intervals import Interval, Uncertainty
from accpinn.methods.fit import Fit
from accpinn.methods.registry import METHODS
from accpinn.results.snapshot.content import Snapshot
from accpinn.results.snapshot.schema import LONGEST_NAME, LONGEST_NOTE, PARTS
from accpinn.segment.segment import SegmentInfo
from accpinn.stability.criteria import checked
from accpinn.stability.frequency import Peak
from accpinn.stability.report import StabilityReport
from accpinn.study.comparison import MethodResult
from accpinn.units import FloatArray

FACTS: Mapping[str, type] = {
    "campaign": str,
    "date": str,
    "acc_flag": int,
    "distance_setting": str,
    "samples": int,
    "duration": float,
    "sample_time": float,
}
_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")
_SHA256 = re.compile(r"([0-9a-f]{64})?")


def check_plausible(snapshot: Snapshot) -> None:
    """Refuse texts without end, unknown facts, and figures outside their ranges.

    Raises:
        SnapshotError: naming the part.
    """
    _check_texts(snapshot)
    _check_facts(snapshot.facts)
    _check_fit(snapshot.fit, "fit.json")
    if snapshot.fit.surrogate:
        _check_times(snapshot.fit.surrogate.time, "fit.npz")
    if snapshot.segment:
        _check_times(snapshot.segment.time, "data.npz")
    for row in snapshot.rows:
        _check_row(row)
    if snapshot.uncertainty:
        _check_doubt(snapshot.uncertainty, "uncertainty.json")
    if snapshot.stability:
        _check_stability(snapshot.stability)


def check_length(text: str, what: str, most: int) -> None:
    """Refuse a text that is longer than ``most`` characters.

    Raises:
        SnapshotError: in one sentence.
    """
    if len(text) > most:
        raise SnapshotError(
            f"The {what} is {len(text):,} characters long; choose one of {most:,} at most."
        )


def _check_texts(snapshot: Snapshot) -> None:
    check_length(snapshot.name, "name", LONGEST_NAME)
    check_length(snapshot.note, "note", LONGEST_NOTE)
    if not _TIME.fullmatch(snapshot.created):
        _refuse("snapshot.json", "the time it was saved is no time")


def check_outline(info: SegmentInfo) -> None:
    """Refuse a window and vehicles that no recording has.

    Raises:
        SnapshotError: in one sentence.
    """
    first, part = info.vehicles[0], "snapshot.json"
    check_length(info.source, "recording's name", LONGEST_NAME)
    for name in info.names:
        check_length(name, "name of a vehicle", LONGEST_NAME)
    if first < 1 or info.vehicles != tuple(range(first, first + len(info.vehicles))):
        _refuse(part, "the vehicles are not consecutive numbers from 1 on")
    if not _SHA256.fullmatch(info.sha256):
        _refuse(part, "the recording's SHA-256 is none")
    times = (info.window.start, info.window.duration, info.sample_time)
    if not all(isfinite(value) for value in times) or min(times[1:]) <= 0:
        _refuse(part, "the window has no length")
    if not all(0 <= share <= 1 for share in info.excluded_share):
        _refuse(part, "a share of instants left out is not within 0 to 1")


def _check_facts(facts: Mapping[str, Any]) -> None:
    for name, value in facts.items():
        kind = FACTS.get(name)
        same = type(value) is kind or (kind is float and type(value) is int)
        if kind is None or not (value is None or same):
            _refuse("snapshot.json", f'"{name[:40]}" is not what is known of a recording')


def _check_row(row: MethodResult) -> None:
    _check_fit(row.fit, "rows.json")
    _check_doubt(row.uncertainty, "rows.json")


def _check_fit(fit: Fit, part: str) -> None:
    if fit.method not in METHODS:
        _refuse(part, f'the method "{fit.method[:40]}" is not known')
    if fit.iterations < 0 or fit.network_weights < 0:
        _refuse(part, "a count is negative")
    try:
        checked(fit.parameters)
    except ParameterError as fault:
        _refuse(part, str(fault).rstrip("."))


def _check_times(time: FloatArray, part: str) -> None:
    if time[0] < 0 or (np.diff(time) <= 0).any():
        _refuse(part, "the instants do not follow each other")


def _check_doubt(uncertainty: Uncertainty, part: str) -> None:
    if not 0 < uncertainty.level < 1:
        _refuse(part, "the intervals' level is not between 0 and 1")
    for share in (uncertainty.probability_l2, uncertainty.probability_linf):
        if ((share < 0) | (share > 1)).any():
            _refuse(part, "a probability is not within 0 to 1")
    for interval in (uncertainty.peak_gain, uncertainty.linf_gain, uncertainty.crossover):
        if _negative(interval.lower) or _upside_down(interval):
            _refuse(part, "an interval of a gain or frequency is negative or upside down")
    if _upside_down(Interval(uncertainty.lower.values, uncertainty.upper.values)):
        _refuse(part, "an interval of a parameter is upside down")


def _check_stability(report: StabilityReport) -> None:
    part = "stability.json"
    gains = [vehicle.linf_gain for vehicle in report.vehicles]
    if _negative(gains) or _negative(report.platoon.linf.gain):
        _refuse(part, "a gain is negative")
    for vehicle in report.vehicles:
        _check_peak(vehicle.peak)
        if vehicle.crossover is not None and not 0 <= vehicle.crossover < np.inf:
            _refuse(part, "a crossover is no frequency")
    for peak in report.platoon.peaks:
        _check_peak(peak)


def _check_peak(peak: Peak) -> None:
    if not (peak.gain >= 0 and 0 <= peak.omega < np.inf):
        _refuse("stability.json", "a peak has no gain or no frequency")


def _negative(values: Iterable[float]) -> bool:
    return any(value < 0 for value in np.asarray(values).ravel())


def _upside_down(interval: Interval) -> bool:
    return bool((interval.lower > interval.upper).any())


def _refuse(part: str, fault: str) -> None:
    raise SnapshotError(f"The snapshot is refused: in {PARTS[part].title}, {fault}.")
