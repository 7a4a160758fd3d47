"""The result strip: a row a vehicle, with its time gap, its largest growth, stability and trust.

Pages and the report show it in place of sentences. A row holds numbers and marks; the reason for
each, with its numbers, is a text that is shown on hover.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan

from accpinn.findings import capital, percent, probability
from accpinn.methods.estimate import SPEEDS
from accpinn.model.registry import TITLES
from accpinn.results.marks import MEASURED
from accpinn.results.messages.estimate import time_gap_in_words
from accpinn.results.messages.stability import (
    becomes,
    margin_in_words,
    next_to_stable,
    reason,
)
from accpinn.results.messages.summary import unfinished
from accpinn.results.naming import about_point, name_of
from accpinn.results.objections import Objection, against_model, objections
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.stability import Assessment, Verdict
from accpinn.study.description import (
    EXTRAPOLATED,
    Description,
    FollowerDescription,
    describe,
)
from accpinn.study.vehicles import AssessedVehicles, NormAssessment, PeakGrowth
from accpinn.units import MetresPerSecond, Quantity

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
    is_measured: bool = False
    """Whether it is measured in the recording itself, not that of the model."""


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
    """Its index among the followers, 0 for the one behind the leader."""
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
            trust = _trust(subject, k, describe(result).follower(place))
            rows = (*rows[:k], replace(rows[k], trust=trust), *rows[k + 1 :])
        models = dict.fromkeys(TITLES[result.estimate.model] for result, _ in subject.cars)
        point = "" if subject.uncertainty else POINTS
        lines = (vehicles.title, *models, point, _about_growth(subject.growths))
        about = tuple(filter(None, lines))
        return Strip(rows, leader, SPEEDS[-1], about, next_to_stable(subject))
    description = description or describe(subject.result)
    rows = tuple(_row(subject, each.place, each) for each in description.followers)
    speed, about = description.estimate.stated_speed, _about(subject, description)
    return Strip(rows, leader, speed, about, next_to_stable(subject))


def _about(subject: AssessedVehicles, description: Description) -> tuple[str, ...]:
    estimate, infos = description.estimate, description.infos
    seconds = sum(part.window.duration for part in infos)
    windows = "1 window" if len(infos) == 1 else f"{len(infos)} windows"
    linear = f"linearised at {3.6 * subject.speed:.0f} km/h" if subject.speed else ""
    case = f"Case {estimate.case}" if description.info.followers > 1 else ""
    parts = (
        name_of(estimate, with_model=False), TITLES[estimate.model], linear,
        f"{windows}, {seconds:,.0f} s", case, about_point(estimate), _about_growth(subject.growths),
    )  # fmt: skip
    return tuple(filter(None, parts))


def _about_growth(growths: Sequence[PeakGrowth]) -> str:
    """Which growths are measured; empty where all are those of the model."""
    if not any(growth.is_measured for growth in growths):
        return ""
    return f"{MEASURED.glyph} measured growth"


def _row(subject: AssessedVehicles, place: int, follower: FollowerDescription | None) -> StripRow:
    vehicles = subject.vehicles
    # Where all followers share their parameters, the first of them stands for all.
    is_shared = follower is not None and follower.number == 0
    return StripRow(
        place,
        vehicles.vehicles[place + 1] if follower is None else follower.number,
        EVERY_FOLLOWER if is_shared else vehicles.labels[place],
        _time_gap(subject, place, follower),
        _growth(subject, place),
        *_marks(subject, place),
        _trust(subject, place, follower),
    )


def _time_gap(
    subject: AssessedVehicles, place: int, follower: FollowerDescription | None
) -> Estimated:
    """The time gap at the speed that an estimate states, or at the highest of those."""
    level = subject.uncertainty.level if subject.uncertainty else None
    if follower is None:
        gap, speed = subject.time_gap(place, SPEEDS[-1]), SPEEDS[-1]
        return Estimated(gap, f"Time gap: {time_gap_in_words(gap, speed, level)}.")
    if not follower.is_determined:
        return Estimated(UNKNOWN, "The data do not determine the time gap.")
    value, speed = follower.values.time_gap, follower.result.estimate.stated_speed
    span, is_extrapolated = value.span, value.note == EXTRAPOLATED
    sentences = [f"Time gap: {time_gap_in_words(span, speed, level)}."]
    if isfinite(span.further_lower):
        further = f"{span.further_lower:.2f}–{span.further_upper:.2f}"
        sentences.append(f"In a further drive: {further} s.")
    if is_extrapolated:
        sentences.append(f"{capital(EXTRAPOLATED)}.")
    if not span.is_inside:
        sentences.append("The estimate lies outside its interval.")
    return Estimated(span, " ".join(sentences), is_extrapolated)


def _growth(subject: AssessedVehicles, place: int) -> Estimated:
    """The largest gain of a vehicle, and where disturbances grow most."""
    l2 = subject.assessed[place].l2
    if l2.assessment == "not determined":
        return Estimated(l2.gain, NOT_DETERMINED)
    why = becomes(subject, [place], subject.vehicles.labels[place], is_headline=True)
    growth = subject.growths[place]
    return Estimated(growth.gain, why, is_measured=growth.is_measured)


def _marks(subject: AssessedVehicles, place: int) -> tuple[StabilityMark, StabilityMark]:
    """By L₂ and by the exact L∞ criterion."""
    assessed, is_point = subject.assessed[place], subject.uncertainty is None
    stability = assessed.stability
    if stability is None:
        nothing = StabilityMark("not determined", is_point, NOT_DETERMINED)
        return nothing, nothing

    def mark(name: str, norm: NormAssessment, verdict: Verdict, margin: str = "") -> StabilityMark:
        if norm.assessment == "not determined":
            return StabilityMark(norm.assessment, is_point, NOT_DETERMINED)
        basis = f"{capital(verdict.word)} by these parameters."
        if norm.probability is not None:
            basis = f"Probability of {name} string stability: {probability(norm.probability)}."
        why = f"{basis} {reason(verdict, stability)} {margin}".rstrip()
        return StabilityMark(norm.assessment, is_point, why)

    return (
        mark("L₂", assessed.l2, stability.l2, margin_in_words(subject.l2_margins[place])),
        mark("L∞", assessed.linf, stability.linf_exact),
    )


def _trust(
    subject: AssessedVehicles, place: int, follower: FollowerDescription | None
) -> TrustMark:
    against = [*_objections(subject, place, follower)]
    sentences = [*dict.fromkeys(objection.sentence for objection in against)]
    brief = tuple(dict.fromkeys(objection.brief for objection in against))
    if against:
        if follower and not follower.trust.is_contradicted:
            sentences.append(follower.trust.in_words)
        return TrustMark(False, brief, " ".join(sentences))
    if follower is None:
        return TrustMark(None, (), NO_RECORDING)
    return TrustMark(True, (), follower.trust.in_words)


def _objections(
    subject: AssessedVehicles, place: int, follower: FollowerDescription | None
) -> Iterator[Objection]:
    """What is against the estimate of a vehicle, who drives it included."""
    vehicles = subject.vehicles
    if any(vehicles.by_hand) and vehicles.by_hand[place]:
        share = vehicles.by_hand[place]
        yield Objection("driven by hand", f"Driven by hand for {percent(share)} of the time.")
    if subject.result and (missing := unfinished(subject.result.estimate)):
        yield Objection("training stopped", missing)
    if follower is None:
        yield from against_model(subject, [vehicles.vehicles[place + 1]])
    else:
        yield from objections(follower)
