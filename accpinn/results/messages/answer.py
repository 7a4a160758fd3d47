"""The answer in sentences, one a follower, and the label of estimates that are the paper's."""

from math import isnan

from accpinn.findings import joined, percent, who
from accpinn.inference.answer import Answer, Span
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Case
from accpinn.model.models import TITLES
from accpinn.results.tables.table import between, supported_digits
from accpinn.segment.segment import SegmentInfo

PAPERS_PRESETS = ("fast", "paper")
"""Presets that minimise the paper's loss."""
PAPERS_ESTIMATE = "the paper's estimate, biased if disturbances last"
"""The label of what those presets estimate."""


def assumption(answer: Answer) -> str:
    """The model and the windows that a verdict on the answer rests on."""
    count = len(answer.windows)
    windows = "one window" if count == 1 else f"{count} windows"
    return (
        f"The verdict is that of the answer: {TITLES[answer.model]}, typical values over {windows}."
    )


def headlines(info: SegmentInfo, answer: Answer, case: Case = "II") -> tuple[str, ...]:
    """The time gap of each follower in equilibrium; one sentence for all that share it.

    Args:
        info: names the followers.
        answer: their parameters.
        case: "I" if they share one parameter set.
    """
    vehicles = (0,) if info.shares(case) else info.vehicles[1:]
    return tuple(
        _headline(who(vehicle, info), vehicle == 0, answer, k) for k, vehicle in enumerate(vehicles)
    )


def about_answer(answer: Answer) -> str:
    """What the intervals of an answer are."""
    gap = "τ + s₀/v" if "s0" in answer.names else "τ"
    return (
        f"Time gap: in equilibrium, {gap}. In brackets: the {percent(answer.level)} interval of the"
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
    """`PAPERS_ESTIMATE` for a fit by one of the paper's presets; empty for others."""
    is_papers = fit.method == "pinn" and fit.config.get("preset") in PAPERS_PRESETS
    return PAPERS_ESTIMATE if is_papers else ""


def _headline(label: str, are_several: bool, answer: Answer, follower: int) -> str:
    speed = answer.stated_speed
    span = answer.time_gap(speed, follower)
    if isnan(span.value):
        return f"{label}: the data do not determine the time gap."
    value, typical, further = _digits(span)
    verb = "keep" if are_several else "keeps"
    return (
        f"{label} {verb} a time gap of {value} s at {speed * 3.6:.0f} km/h ({typical}); in another"
        f" window {further}."
    )


def _digits(span: Span) -> tuple[str, str, str]:
    """The value and both intervals with the digits that the narrower interval supports."""
    digits = supported_digits(span.lower, span.upper, 2)
    ends = ((span.lower, span.upper), (span.further_lower, span.further_upper))
    typical, further = (between(*pair, digits).replace(" to ", "–") for pair in ends)
    return f"{span.value:.{digits}f}", typical, further
