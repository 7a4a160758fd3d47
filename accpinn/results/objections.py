"""Evidence against an estimate, in sentences and in the few words of a mark."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from accpinn.findings import Labelled, joined
from accpinn.inference.gain_check import LEAST, GainCheck
from accpinn.inference.typical import HeterogeneousFollowers
from accpinn.recordings import ValuesOutOfRange
from accpinn.recordings.inconsistency import GapComputed, Inconsistency
from accpinn.study.description import FollowerDescription
from accpinn.study.vehicles import AssessedVehicles


class Objection(NamedTuple):
    """Evidence against an estimate."""

    brief: str
    """In a few words, for a mark."""
    sentence: str


def against_estimate(follower: FollowerDescription) -> tuple[Objection, ...]:
    """What the data, and the followers and speeds, have against an estimate, windows aside."""
    result, numbers = follower.result, _numbers(follower)
    info, estimate = result.info, result.estimate
    against = list[Objection]()
    of_data = [finding for part in result.infos for finding in part.findings]
    gaps = [f for f in of_data if isinstance(f, Inconsistency) and f.follower in numbers]
    if any(finding.is_contradiction for finding in gaps):
        sentence = "Do not trust it: the measured gap contradicts the speeds."
        against.append(Objection("gap contradicts speeds", sentence))
    if any(isinstance(finding, GapComputed) for finding in gaps):
        sentence = "The gap was computed from the speeds, from an assumed distance on."
        against.append(Objection("gap computed", sentence))
    large = [f for f in of_data if isinstance(f, ValuesOutOfRange) and f.is_in_another_unit]
    if any(numbers & {*finding.followers} for finding in large):
        sentence = "Do not trust it: measured values are too large; check their units."
        against.append(Objection("values too large", sentence))
    for finding in result.findings:
        if isinstance(finding, HeterogeneousFollowers):
            against.append(Objection("cars differ", finding.sentence(info)))
    speed = estimate.stated_speed
    if not all(estimate.is_driven(speed, place) for place in follower.places):
        sentence = f"No window holds {speed * 3.6:.0f} km/h: the model extrapolates."
        against.append(Objection("extrapolated", sentence))
    return (*against, *against_model(follower.vehicles, [*numbers]))


def objections(follower: FollowerDescription) -> tuple[Objection, ...]:
    """All that is against an estimate, its own windows included."""
    trust = follower.trust
    by_windows = (Objection(reason, trust.in_words) for reason in trust.reasons)
    return (*against_estimate(follower), *by_windows)


def _numbers(follower: FollowerDescription) -> set[int]:
    """The numbers in the file of a follower, or of all that share its parameters."""
    return {follower.result.info.vehicles[place + 1] for place in follower.places}


def against_model(subject: AssessedVehicles, numbers: Sequence[int] = ()) -> Iterator[Objection]:
    """What the measured gain has against the model for all vehicles, or those of some numbers."""
    names = dict(zip(subject.vehicles.vehicles[1:], subject.vehicles.spoken, strict=True))
    against, over = list[str](), list[str]()
    for check in subject.checks:
        name = names.get(check.vehicle, f"vehicle {check.vehicle}")
        if numbers and check.vehicle not in numbers:
            continue
        if check.contradiction:
            against.append(f"{name} ({check.short})")
        elif check.is_underrated:
            over.append(f"{name} by {check.peak - check.model_peak:.1f} dB")
    if against:
        said = f"The measured gain contradicts the model for {joined(against)}."
        yield Objection("measured gain disagrees", said)
    if over:
        said = f"The measured gain peaks above the model's: {joined(over)}."
        yield Objection("measured gain higher", said)


def measured_gain_sentences(checks: Sequence[GainCheck], about: Labelled) -> tuple[str, ...]:
    """What the measured gain says of each vehicle; of those without a comparison at once."""
    none = [check for check in checks if check.frequencies < LEAST]
    alone = [check for check in checks if check not in none or len(none) == 1]
    said = [check.sentence(about) for check in alone]
    if len(none) > 1:
        named = joined([about.label(check.vehicle) for check in none])
        said.append(
            f"{named}: the verdicts could not be held against a measured gain, as too few"
            " frequencies are coherent; a longer window has more."
        )
    return tuple(said)
