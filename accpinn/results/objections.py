"""Evidence against an estimate, in sentences and in the few words of a mark."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from accpinn.findings import Labelled, joined
from accpinn.inference.gain_check import LEAST, GainCheck
from accpinn.study.vehicles import AssessedVehicles


class Objection(NamedTuple):
    """Evidence against an estimate."""

    brief: str
    """In a few words, for a mark."""
    sentence: str


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


def against_measured(checks: Sequence[GainCheck], about: Labelled) -> tuple[str, ...]:
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
