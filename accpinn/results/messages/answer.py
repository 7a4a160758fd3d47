"""The answer in sentences, one a follower, and the label of estimates that are the paper's."""

from math import ceil, inf, isnan
from typing import NamedTuple

from accpinn.findings import joined, percent, probability, who
from accpinn.inference.answer import Answer
from accpinn.methods.fit import Fit
from accpinn.model.registry import CTHPS, PAPER, TITLES
from accpinn.results.tables import between, supported_digits
from accpinn.results.tables.answer import counted_windows
from accpinn.results.vehicles import KnownVehicles
from accpinn.segment.segment import SegmentInfo
from accpinn.stability.report import assessment
from accpinn.units import MetresPerSecond

PAPERS_PRESETS = ("fast", "paper")
"""Presets that minimise the paper's loss."""
PAPERS_ESTIMATE = "the paper's estimate, biased if disturbances last"
"""The label of what those presets estimate."""


def assumption(answer: Answer, speed: MetresPerSecond | None = None) -> str:
    """The model and the windows that a verdict on the answer rests on.

    Args:
        answer: that is judged.
        speed: at which a model that is no CTHP is linearised; by default each vehicle's median.
    """
    at = "the vehicle's median speed" if speed is None else f"{3.6 * speed:.0f} km/h"
    at = "" if answer.model in CTHPS else f", linearised at {at}"
    return (
        f"The verdict is that of the answer: {TITLES[answer.model]}, typical values over"
        f" {counted_windows(answer)}{at}."
    )


class Card(NamedTuple):
    """What is said first of a follower, or of all that share their parameters."""

    lead: str
    """The answer: time gap, gains, what becomes of disturbances."""
    trust: str
    """How far to trust it, by its own windows."""


def cards(info: SegmentInfo, answer: Answer, subject: KnownVehicles) -> tuple[Card, ...]:
    """The answer of each follower in sentences; one card for all that share it."""
    said = []
    for k, trust in enumerate(answer.trust):
        lead = _headline(who(trust.vehicle, info), trust.vehicle == 0, answer, k)
        parts = (lead, *_gains(answer, k), *_disturbances(subject, k))
        said.append(Card(" ".join(parts), " ".join((trust.in_words, *_against(subject, k)))))
    return tuple(said)


def about_answer(answer: Answer) -> str:
    """What the intervals of an answer are."""
    gap = f", {'τ + s₀/v' if 's0' in answer.names else 'τ'}" if answer.model in CTHPS else ""
    return (
        f"Time gap: in equilibrium{gap}. In brackets: the {percent(answer.level)} interval of the"
        " vehicle's typical value. The last column is the interval for a further window of the same"
        " vehicle."
    )


def differing_windows(info: SegmentInfo, answer: Answer) -> str:
    """One sentence on all followers whose windows differ; empty where none do."""
    findings = answer.findings
    if not findings:
        return ""
    named = joined([who(finding.vehicle, info) for finding in findings])
    most = max(finding.probability for finding in findings)
    level = "p < 0.001" if most < 0.001 else f"p ≤ {most:.1g}"
    return (
        f"The {findings[0].windows} windows of {named[0].lower() + named[1:]} differ by more than"
        f" sampling error explains ({level}): a further window may differ as much, as the last"
        " column says."
    )


def papers_estimate(fit: Fit) -> str:
    """`PAPERS_ESTIMATE` for the paper's model by one of its presets; empty for others."""
    is_papers = fit.method == "pinn" and fit.config.get("preset") in PAPERS_PRESETS
    return PAPERS_ESTIMATE if is_papers and fit.model == PAPER else ""


def _headline(label: str, are_several: bool, answer: Answer, follower: int) -> str:
    speed = answer.stated_speed
    span = answer.time_gap(speed, follower)
    if isnan(span.value):
        return f"{label}: the data do not determine the time gap."
    digits = supported_digits(span.lower, span.upper, 2)
    typical = between(span.lower, span.upper, digits).replace(" to ", "–")
    verb = "keep" if are_several else "keeps"
    return f"{label} {verb} {span.value:.{digits}f} s at {speed * 3.6:.0f} km/h ({typical})."


def _gains(answer: Answer, follower: int) -> tuple[str, ...]:
    """How far α and β may be from their values: the less known one counts."""
    spans = [answer.gain(name, follower) for name in ("alpha", "beta")]
    if any(isnan(span.value) for span in spans):
        return ()
    factor = max(
        max(span.upper / span.value, span.value / span.lower) if span.lower > 0 else inf
        for span in spans
    )
    if factor > 5.0:
        return ("Its gains are hardly known.",)
    share = f"{5 * ceil(20 * (factor - 1)):.0f} %"
    within = share if factor <= 1.3 else f"a factor of {ceil(10 * factor) / 10:g}"
    return (f"Its gains are known within {within}.",)


def _disturbances(subject: KnownVehicles, follower: int) -> tuple[str, ...]:
    """Whether disturbances grow, as sure as posterior and measured gain make it."""
    report, known = subject.report, subject.uncertainty
    if report is None or known is None:
        return ()
    stable = float(known.probability_l2[follower])
    by = " by the model" if _against(subject, follower) else ""
    match assessment(stable):
        case "unstable":
            growth = report.vehicles[follower].peak.gain
            most = f"by up to {growth - 1:.0%}" if growth < 3 else f"up to {growth:.1f} times"
            return (f"Disturbances grow {most}{by}.".replace("%", " %"),)
        case "stable":
            return (f"Disturbances do not grow{by}.",)
        case "open":
            odds = probability(stable)
            return (f"Whether disturbances grow is open (probability of stability {odds}).",)
    return ()


def _against(subject: KnownVehicles, follower: int) -> tuple[str, ...]:
    """What the measured gain has against the model's verdict; nothing where it has none."""
    number = subject.vehicles.vehicles[follower + 1]
    short = next((check.short for check in subject.checks if check.vehicle == number), "")
    return (f"The measured gain contradicts the model ({short}).",) if short else ()
