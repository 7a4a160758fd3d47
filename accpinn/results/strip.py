"""The result strip: a row a vehicle, with its time gap, its largest growth, stability and trust.

Pages and the report show it in place of sentences. A row holds numbers and marks; the reason for
each, with its numbers, is a text that is shown on hover.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from math import isfinite, isnan, nan

from accpinn.findings import capital, percent, probability
from accpinn.methods.estimate import SPEEDS, Span
from accpinn.model.registry import TITLES
from accpinn.results.description import EXTRAPOLATED, Description, Row, describe
from accpinn.results.messages.estimate import time_gap_in_words
from accpinn.results.messages.stability import (
    becomes,
    margin_in_words,
    next_to_stable,
    reason,
)
from accpinn.results.messages.summary import unfinished
from accpinn.results.objections import Objection, against_model
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.stability import Assessment, Verdict, assessment
from accpinn.study.vehicles import AssessedVehicles
from accpinn.units import FloatArray, MetresPerSecond, Quantity, interval_ends

UNKNOWN = Quantity(nan, nan, nan)
NO_RECORDING = "These parameters were not held against a recording."
POINTS = "points, without intervals"
NOT_DETERMINED = "The data do not determine the parameters."


@dataclass(frozen=True)
class Estimated:
    """A number with its interval, and what is to be known of it."""

    quantity: Quantity
    """All nan where it is not determined."""
    why: str
    is_extrapolated: bool = False
    """Whether no window holds the speed that it is of."""


@dataclass(frozen=True)
class StabilityMark:
    """The verdict on string stability by one criterion."""

    assessment: Assessment
    """By the share of posterior samples that are stable, or by the parameters alone."""
    is_point: bool
    """Whether there are no posterior samples."""
    why: str


@dataclass(frozen=True)
class TrustMark:
    """How far an estimate can be trusted."""

    is_trusted: bool | None
    """None where there is nothing to hold the parameters against."""
    brief: tuple[str, ...]
    """What is against it, each in a few words; empty where nothing is."""
    why: str


@dataclass(frozen=True)
class StripRow:
    """One vehicle, or all that share their parameters."""

    place: int
    """Its index among the vehicles, 0 for the first."""
    number: int
    """In the recording; 0 for all followers together."""
    label: str
    time_gap: Estimated
    """In s, at the strip's speed."""
    growth: Estimated
    """max |H|: 1 where no frequency is amplified, infinite where one grows without limit."""
    l2: StabilityMark
    linf: StabilityMark
    trust: TrustMark


@dataclass(frozen=True)
class Strip:
    """The rows of a result, and what holds of all of them."""

    rows: tuple[StripRow, ...]
    leader: int
    """The leader's number in the recording, by which vehicles have their colours."""
    speed: MetresPerSecond
    """Speed at which the time gap is stated."""
    about: tuple[str, ...]
    """Method, model, windows, Case, and what an estimate without intervals is."""
    lacking: str = ""
    """How much more time gap string stability takes; empty where it is there."""

    def of_places(self, places: Collection[int]) -> "Strip":
        """The strip of some of the vehicles alone, by their index; 0 for the first."""
        return replace(self, rows=tuple(row for row in self.rows if row.place in places))


def strip_of(subject: AssessedVehicles, description: Description | None = None) -> Strip:
    """The strip of some vehicles; of a result's vehicles with all that its description has.

    Args:
        subject: the vehicles where their string stability is shown.
        description: that of their result, where it is at hand; it is made where it is not.

    Examples:
        >>> from accpinn.model.published import ASTAZERO
        >>> [row.l2.assessment for row in strip_of(AssessedVehicles(ASTAZERO)).rows]
        ['unstable', 'unstable', 'unstable', 'unstable']
    """
    vehicles, leader = subject.vehicles, subject.vehicles.vehicles[0]
    if subject.result is None:
        rows = tuple(_row(subject, k, None) for k in range(len(vehicles)))
        for k, (result, place) in enumerate(subject.cars):
            trust = _trust(subject, k, describe(result).row(place))
            rows = (*rows[:k], replace(rows[k], trust=trust), *rows[k + 1 :])
        models = dict.fromkeys(TITLES[result.estimate.model] for result, _ in subject.cars)
        point = "" if subject.uncertainty else POINTS
        about = tuple(filter(None, (vehicles.title, *models, point)))
        return Strip(rows, leader, SPEEDS[-1], about, next_to_stable(subject))
    known = description or describe(subject.result)
    places = [min(row.places[0], len(vehicles) - 1) for row in known.rows]
    rows = tuple(_row(subject, k, row) for k, row in zip(places, known.rows, strict=True))
    speed, about = known.estimate.stated_speed, _about(subject, known)
    return Strip(rows, leader, speed, about, next_to_stable(subject))


def _about(subject: AssessedVehicles, known: Description) -> tuple[str, ...]:
    seconds = sum(part.window.duration for part in known.infos)
    windows = "1 window" if len(known.infos) == 1 else f"{len(known.infos)} windows"
    linear = f"linearised at {3.6 * subject.speed:.0f} km/h" if subject.speed else ""
    case = f"Case {known.estimate.case}" if known.info.followers > 1 else ""
    model = TITLES[known.estimate.model]
    parts = known.method, model, linear, f"{windows}, {seconds:,.0f} s", case, known.point
    return tuple(filter(None, parts))


def _row(subject: AssessedVehicles, place: int, row: Row | None) -> StripRow:
    vehicles = subject.vehicles
    number = vehicles.vehicles[place + 1] if row is None else row.number
    # Where all followers share their parameters, the first of them stands for all.
    is_shared = row is not None and row.number == 0
    return StripRow(
        place,
        number,
        EVERY_FOLLOWER if is_shared else vehicles.labels[place],
        _time_gap(subject, place, row),
        _growth(subject, place),
        *_marks(subject, place),
        _trust(subject, place, row),
    )


def _time_gap(subject: AssessedVehicles, place: int, row: Row | None) -> Estimated:
    """The time gap at the speed that an estimate states, or at the highest of those."""
    if row is None:
        gap, speed = _gap_of(subject, place), SPEEDS[-1]
        level = subject.uncertainty.level if subject.uncertainty else None
        why = f"Time gap: {time_gap_in_words(gap, speed, level)}."
        return Estimated(gap, why)
    value, speed = row.known[0], row.trust.speed
    if not row.is_determined:
        return Estimated(UNKNOWN, "The data do not determine the time gap.")
    known = subject.uncertainty
    said = [f"Time gap: {time_gap_in_words(value.span, speed, known.level if known else None)}."]
    further: Span = value.span
    if isfinite(further.further_lower):
        said += [f"In a further drive: {further.further_lower:.2f}–{further.further_upper:.2f} s."]
    is_extrapolated = value.note == EXTRAPOLATED
    said += [f"{capital(EXTRAPOLATED)}."] * is_extrapolated
    said += [] if value.span.is_inside else ["The estimate lies outside its interval."]
    return Estimated(value.span, " ".join(said), is_extrapolated)


def _gap_of(subject: AssessedVehicles, place: int) -> Quantity:
    """The time gap of a vehicle of no result, or of several."""
    known, speed = subject.uncertainty, SPEEDS[-1]
    value = float(subject.vehicles.parameters[place].time_gap(speed))
    if known is None:
        return Quantity(value, nan, nan)
    lower, upper = interval_ends(known.draws[:, place].time_gap(speed), known.level)
    return Quantity(value, float(lower), float(upper))


def _growth(subject: AssessedVehicles, place: int) -> Estimated:
    """The largest gain of a vehicle, and where disturbances grow most."""
    if not subject.has_report or subject.assessed[place] == "not determined":
        return Estimated(UNKNOWN, NOT_DETERMINED)
    gain, lower, upper = subject.report.vehicles[place].peak.gain, nan, nan
    if known := subject.uncertainty:
        ends = known.peak_gain
        lower, upper = float(ends.lower[place]), float(ends.upper[place])
    label = subject.vehicles.labels[place]
    return Estimated(
        Quantity(gain, lower, upper), becomes(subject, [place], label, is_headline=True)
    )


def _marks(subject: AssessedVehicles, place: int) -> tuple[StabilityMark, StabilityMark]:
    """By L₂ and by the exact L∞ criterion."""
    known = subject.uncertainty
    if not subject.has_report:
        nothing = StabilityMark("not determined", known is None, NOT_DETERMINED)
        return nothing, nothing
    vehicle = subject.report.vehicles[place]

    def mark(
        name: str, verdict: Verdict, shares: FloatArray | None, margin: str = ""
    ) -> StabilityMark:
        why = f"{reason(verdict, vehicle)} {margin}".rstrip()
        if shares is None:
            said: Assessment = "stable" if verdict.stable else "unstable"
            return StabilityMark(said, True, f"{capital(verdict.word)} by these parameters. {why}")
        share = float(shares[place])
        if isnan(share):
            return StabilityMark("not determined", False, NOT_DETERMINED)
        odds = f"Probability of {name} string stability: {probability(share)}."
        return StabilityMark(assessment(share), False, f"{odds} {why}")

    l2, linf = (known.probability_l2, known.probability_linf) if known else (None, None)
    margin = margin_in_words(subject.l2_margins[place])
    return mark("L₂", vehicle.l2, l2, margin), mark("L∞", vehicle.linf_exact, linf)


def _trust(subject: AssessedVehicles, place: int, row: Row | None) -> TrustMark:
    found = [*_objections(subject, place, row)]
    sentences = [*dict.fromkeys(objection.sentence for objection in found)]
    brief = tuple(dict.fromkeys(objection.brief for objection in found))
    if found:
        rest = [row.trust.in_words] if row and not row.trust.is_contradicted else []
        return TrustMark(False, brief, " ".join([*sentences, *rest]))
    if row is None:
        return TrustMark(None, (), NO_RECORDING)
    return TrustMark(True, (), row.trust.in_words)


def _objections(subject: AssessedVehicles, place: int, row: Row | None) -> Iterator[Objection]:
    """What is against the estimate of a vehicle, who drives it included."""
    vehicles = subject.vehicles
    if any(vehicles.by_hand) and vehicles.by_hand[place]:
        share = vehicles.by_hand[place]
        yield Objection("driven by hand", f"Driven by hand for {percent(share)} of the time.")
    if subject.result and (missing := unfinished(subject.result.estimate)):
        yield Objection("training stopped", missing)
    if row is None:
        yield from against_model(subject, [vehicles.vehicles[place + 1]])
    else:
        yield from row.objections
