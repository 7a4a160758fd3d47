"""The answer in sentences, one a follower, and the label of estimates that are the paper's."""

from math import ceil, inf, isnan
from typing import NamedTuple

from accpinn.findings import joined, percent, probability, who
from accpinn.inference.answer import SPEEDS, Answer
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters
from accpinn.model.registry import CTHPS, PAPER, TITLES, time_gap
from accpinn.results.tables import between, supported_digits
from accpinn.results.tables.answer import counted_windows
from accpinn.results.vehicles import KnownVehicles
from accpinn.segment import SegmentInfo
from accpinn.stability import assessment
from accpinn.units import Estimate, MetresPerSecond

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
    is_contradicted: bool
    """Whether what `trust` says is against it."""


def cards(info: SegmentInfo, answer: Answer, subject: KnownVehicles) -> tuple[Card, ...]:
    """The answer of each follower in sentences; one card for all that share it."""
    said = []
    for k, trust in enumerate(answer.trust):
        lead = _headline(who(trust.vehicle, info), trust.vehicle == 0, answer, k)
        parts = (lead, *_gains(answer, k), *_disturbances(subject, k))
        against = (*_extrapolated(answer, k), *_against(subject, k))
        is_contradicted = trust.is_contradicted or bool(against)
        said.append(Card(" ".join(parts), " ".join((trust.in_words, *against)), is_contradicted))
    return tuple(said)


def about_answer(answer: Answer) -> str:
    """What the intervals of an answer are."""
    gap = f", {'τ + s₀/v' if 's0' in answer.names else 'τ'}" if answer.model in CTHPS else ""
    low, high = 3.6 * answer.speeds.min(), 3.6 * answer.speeds.max()
    median = f"{low:.0f}" if f"{low:.0f}" == f"{high:.0f}" else f"{low:.0f} to {high:.0f}"
    marked = any(not answer.is_driven(v, k) for v in SPEEDS for k in range(len(answer.speeds)))
    driven = " With *: no window holds that speed, so the model extrapolates." if marked else ""
    return (
        f"Time gap: in equilibrium{gap}; median speed: {median} km/h.{driven} In brackets: the"
        f" {percent(answer.level)} interval of the vehicle's typical value; further window: that of"
        " its next one. Both count how much windows differ, here and in many other cars, so they"
        " are wider than what these windows alone say."
    )


def about_truth(truth: Parameters, answer: Answer) -> str:
    """The time gaps that a synthetic recording was made with."""
    gaps = time_gap(PAPER, truth, answer.stated_speed).tolist()
    said = joined([f"{gap:.2f}" for gap in gaps])
    return (
        f"The recording was made with time gaps of {said} s at any speed; tab Comparison has all"
        " true values."
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


def time_gap_in_words(gap: Estimate, speed: MetresPerSecond) -> str:
    """As "1.18 s at 100 km/h (1.05–1.31)"."""
    digits = supported_digits(gap.lower, gap.upper, 2)
    typical = between(gap.lower, gap.upper, digits).replace(" to ", "–")
    return f"{gap.value:.{digits}f} s at {speed * 3.6:.0f} km/h ({typical})"


def _headline(label: str, are_several: bool, answer: Answer, follower: int) -> str:
    speed = answer.stated_speed
    span = answer.time_gap(speed, follower)
    if isnan(span.value):
        return f"{label}: the data do not determine the time gap."
    verb = "keep" if are_several else "keeps"
    return f"{label} {verb} {time_gap_in_words(span, speed)}."


def _extrapolated(answer: Answer, follower: int) -> tuple[str, ...]:
    """That the speed of the headline was not driven; nothing where it was."""
    speed = answer.stated_speed
    if answer.is_driven(speed, follower):
        return ()
    return (f"No window holds {speed * 3.6:.0f} km/h: the model extrapolates.",)


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
            growth, ends = report.vehicles[follower].peak.gain, known.peak_gain
            gains = (growth, float(ends.lower[follower]), float(ends.upper[follower]))
            if growth < 3:
                most, low, high = (f"{100 * (gain - 1):.0f}" for gain in gains)
                return (f"Disturbances grow by up to {most} % ({low}–{high} %){by}.",)
            most, low, high = (f"{gain:.1f}" for gain in gains)
            return (f"Disturbances grow up to {most} times ({low}–{high}){by}.",)
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
