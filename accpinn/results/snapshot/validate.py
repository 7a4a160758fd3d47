"""What no genuine snapshot says, though its form allows it: refused before anything reads it."""

import re
from collections.abc import Iterable
from math import isfinite
from typing import Any

import numpy as np

from accpinn.channels import COMPUTABLE
from accpinn.findings import Finding
from accpinn.inference.intervals import Interval, Uncertainty
from accpinn.inference.model_adequacy import EXTRA, Adequacy
from accpinn.methods.fit import Fit
from accpinn.methods.maximum_likelihood import KEY
from accpinn.methods.registry import METHODS
from accpinn.methods.series import stride_of
from accpinn.methods.state_space import COMMON, FORMS
from accpinn.methods.store import FIT_SHAPES
from accpinn.results.snapshot import LONGEST_NAME, Snapshot, check_length
from accpinn.segment.segment import BlocksMissing, SegmentInfo
from accpinn.serial import Arrays, Shape, check_shapes, every, flatten
from accpinn.stability.criteria import checked
from accpinn.stability.report import StabilityReport
from accpinn.units import FloatArray


def _of(shape: Shape, **fields: str) -> dict[str, Shape]:
    """The shape of some fields of each class."""
    return {f"{kind}.{name}": shape for kind, names in fields.items() for name in names.split()}


SHAPES = (
    FIT_SHAPES
    | _of(
        Shape("M"),
        Quality="mean_time_gap relative_deviation acceleration_deviation condition car_following",
        Uncertainty="probability_l2 probability_linf",
        Interval="lower upper",
        TrackingErrors="gap_mae gap_rmse",
        Whiteness="deviation correlation memory independent probability findings",
        StabilityReport="vehicles",
        PlatoonStability="peaks",
        Gains="gain error",
        ModelForm="aic holdout",
        InnovationTests="correlated uneven nonnormal nonlinear",
    )
    | _of(
        Shape("M", 3),
        Uncertainty="centre lower upper inside",
        ModelForm="parameters lower upper extra",
    )
    | _of(Shape("D", "M", 3), Uncertainty="draws")
    | _of(Shape("V"), SegmentInfo="vehicles names", TrackingErrors="speed_mae speed_rmse")
    | _of(Shape(3), VehicleStability="parameters")
    | _of(Shape("N", finite=True), Segment="time")
    | _of(Shape("N", "V", finite=True), Segment="speeds")
    | _of(Shape("N", "M", finite=True), Segment="gaps")
    | _of(Shape("N", "M"), Segment="mask")
    | _of(Shape("N", "C"), Segment="missing")
)
"""N instants, M followers, V = M + 1 vehicles, C = M + V channels, D draws; for the others see
`FIT_SHAPES`."""

_SHA256 = re.compile(r"([0-9a-f]{64})?")
_CONTROL = r"\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029"
"""All but tabs and line breaks."""
_DIRECTION = r"\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
"""Marks that turn the order of letters round, so that a name reads as another."""
_UNSEEN = re.compile(f"[{_CONTROL}{_DIRECTION}]")
_BREAK = re.compile(r"[\t\n]+")
REPLACEMENT = "\ufffd"
MOST_COMPUTED = 100_000
"""Samples of all followers together, one each half second at most, as the likelihood uses them:
more than an hour of ten followers. What a snapshot shows is then computed within a minute."""
LINES = ("note", "notes")
"""Fields whose texts may have several lines."""


def is_harmless(text: str) -> bool:
    """Whether a JSON text holds no such character, neither as it is nor escaped."""
    return "\\" not in text and not _UNSEEN.search(text)


def sanitise(tree: Any, lines: bool = False) -> Any:
    """A tree of plain values without characters that a terminal or a page obeys, not shows.

    Args:
        tree: as read from JSON.
        lines: whether texts keep their line breaks.
    """
    if isinstance(tree, str):
        seen = _UNSEEN.sub(REPLACEMENT, tree)
        return seen if lines else _BREAK.sub(" ", seen)
    if isinstance(tree, dict):
        return {sanitise(key): sanitise(item, key in LINES) for key, item in tree.items()}
    if isinstance(tree, list):
        return [sanitise(item, lines) for item in tree]
    return tree


def check_numbers(tree: Any, arrays: Arrays) -> None:
    """Refuse numbers that nothing can be computed with; nan and the infinities have their places.

    Args:
        tree: as read from JSON.
        arrays: beside it.

    Raises:
        ValueError: naming the place.
    """
    for place, leaf in (*flatten(tree), *arrays.items()):
        if isinstance(leaf, float | np.ndarray):
            sizes = np.abs(np.asarray(leaf, np.float64))
            beyond = np.isfinite(sizes) & (sizes > COMPUTABLE)
            _require(not beyond.any(), f"{place} has a number beyond {COMPUTABLE:g}")


def validate(snapshot: Snapshot) -> None:
    """Refuse lengths that contradict each other, and figures outside their ranges.

    Raises:
        ValueError, AccpinnError: with what is wrong and where.
    """
    info, count = snapshot.info, len(snapshot.info.vehicles)
    _require(count > 1 and info.samples > 1, "its window has no followers or no data")
    check_shapes(
        snapshot, SHAPES, {"M": count - 1, "V": count, "C": 2 * count - 1, "N": info.samples}
    )
    _check_info(info)
    for finding in every(Finding, snapshot):
        told = [getattr(finding, name, 0) or 0 for name in ("vehicle", "follower")]
        told += getattr(finding, "vehicles", ())
        known = all(number in (0, *info.vehicles) for number in told)
        _require(known, "a finding is about a vehicle that is none")
    if snapshot.segment:
        _check_times(snapshot.segment.time)
        same = snapshot.segment.info == info  # also in its sample time, which is above zero
        _require(same, "its data are not the window that the result was learned from")
        computed = info.followers * info.samples // stride_of(snapshot.segment)
        _require(computed <= MOST_COMPUTED, "its data are longer than can be computed anew")
    _check_fit(snapshot.fit)
    _check_disturbance(snapshot.fit, info)
    if snapshot.uncertainty:
        _check_uncertainty(snapshot.uncertainty)
    if snapshot.stability:
        _check_stability(snapshot.stability)
    if snapshot.adequacy:
        _check_adequacy(snapshot.adequacy)
    for result in snapshot.methods:
        _check_fit(result.fit)
        _check_uncertainty(result.uncertainty)


def _require(holds: bool, fault: str) -> None:
    if not holds:
        raise ValueError(fault)


def _check_info(info: SegmentInfo) -> None:
    check_length(info.source, "recording's name", LONGEST_NAME)
    for name in info.names:
        check_length(name, "name of a vehicle", LONGEST_NAME)
    first = info.vehicles[0]
    numbers = tuple(range(first, first + len(info.vehicles)))
    _require(first > 0 and info.vehicles == numbers, "the vehicles are no consecutive numbers")
    _require(bool(_SHA256.fullmatch(info.sha256)), "the recording's SHA-256 is none")
    times = (info.window.duration, info.sample_time)
    _require(all(isfinite(t) for t in (info.window.start, *times)), "the window has no length")
    _require(min(times) > 0, "the window has no length")
    missing = [found for found in info.findings if isinstance(found, BlocksMissing)]
    shares = (*info.excluded_share, *(found.share for found in missing))
    _require(all(0 <= share <= 1 for share in shares), "a share is not within 0 to 1")
    named = all(found.columns and found.windows for found in missing)
    _require(named, "samples are missing nowhere")


def _check_fit(fit: Fit) -> None:
    _require(fit.method in METHODS, f'the method "{fit.method[:40]}" is not known')
    _require(min(fit.iterations, fit.network_weights) >= 0, "a count is negative")
    checked(fit.parameters)
    if fit.surrogate:
        _check_times(fit.surrogate.time)


def _check_disturbance(fit: Fit, info: SegmentInfo) -> None:
    shapes = {"disturbance": (info.samples, info.followers)}
    if fit.method == KEY:
        shapes["unknowns"] = (info.followers, len(COMMON))
    for name, shape in shapes.items():
        fits = name not in fit.arrays or fit.arrays[name].shape == shape
        _require(fits, f"the {name} of the likelihood are not of the window")


def _check_times(time: FloatArray) -> None:
    ordered = time[0] >= 0 and (np.diff(time) > 0).all()
    _require(bool(ordered), "the instants of a curve do not follow each other")


def _check_uncertainty(uncertainty: Uncertainty) -> None:
    _require(0 < uncertainty.level < 1, "the intervals' level is not between 0 and 1")
    for share in (uncertainty.probability_l2, uncertainty.probability_linf):
        _require(not ((share < 0) | (share > 1)).any(), "a probability is not within 0 to 1")
    gains = (uncertainty.peak_gain, uncertainty.linf_gain, uncertainty.crossover)
    for interval in gains:
        _require(not _negative(interval.lower), "an interval of a gain or frequency is negative")
    for interval in (*gains, Interval(uncertainty.lower.values, uncertainty.upper.values)):
        _require(not (interval.lower > interval.upper).any(), "an interval is upside down")


def _check_adequacy(adequacy: Adequacy) -> None:
    for form in adequacy.forms:
        _require(form.form in FORMS, "a form of the model is not known")
        ends = (form.lower.values, form.upper.values), (form.extra[:, 1], form.extra[:, 2])
        for lower, upper in ends:
            _require(not (lower > upper).any(), "an interval is upside down")
    for better in adequacy.better:
        _require(better.form in EXTRA, "a form of the model is not known")


def _check_stability(report: StabilityReport) -> None:
    gains = [vehicle.linf_gain for vehicle in report.vehicles]
    _require(not _negative((*gains, *report.platoon.linf.gain)), "a gain is negative")
    for vehicle in report.vehicles:
        crossover = vehicle.crossover
        _require(crossover is None or 0 <= crossover < np.inf, "a crossover is no frequency")
    for peak in (*(vehicle.peak for vehicle in report.vehicles), *report.platoon.peaks):
        _require(peak.gain >= 0 and 0 <= peak.omega < np.inf, "a peak has no gain or frequency")


def _negative(values: Iterable[float]) -> bool:
    return any(value < 0 for value in np.asarray(values).ravel())
