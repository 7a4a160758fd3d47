"""An estimate in sentences, one a follower, and what its numbers are."""

from collections.abc import Iterator, Sequence
from math import ceil, inf, isnan
from typing import NamedTuple

from accpinn.findings import all_of, capital, joined, percent, who
from accpinn.inference.trust import trust_of_several
from accpinn.inference.typical import HeterogeneousFollowers
from accpinn.methods.estimate import SPEEDS, Estimate
from accpinn.model.cthp import Parameters
from accpinn.model.registry import CTHPS, FOLLOWING, PAPER, TITLES, has_terms_of, value_of
from accpinn.recordings import GapContradictsSpeeds, ValuesOutOfRange
from accpinn.results.messages.stability import against_model, assessed, becomes
from accpinn.results.tables import between, supported_digits
from accpinn.results.tables.estimates import columns_of
from accpinn.results.vehicles import KnownVehicles, known_vehicles
from accpinn.segment import SegmentInfo
from accpinn.stability import Assessment
from accpinn.study.result import Result
from accpinn.units import MetresPerSecond, Quantity

PAPERS_PRESETS = ("fast", "paper")
"""Presets that minimise the paper's loss."""
PAPERS_POINT = "the paper's estimate: a point, biased where disturbances last"
POINT = "a point, without intervals"
HARDLY_KNOWN = 5.0
"""Factor between a gain and an end of its interval above which it is called hardly known."""
SYMMETRIC = 1.3
"""The same up to which both ends are said as one."""


def about_point(estimate: Estimate) -> str:
    """What an estimate without a posterior is, in a few words; empty for one with a posterior."""
    if estimate.posterior:
        return ""
    is_papers = estimate.method == "pinn" and estimate.settings.get("preset") in PAPERS_PRESETS
    return PAPERS_POINT if is_papers and estimate.model == PAPER else POINT


def counted_windows(result: Result) -> str:
    """As "one window" or "3 windows"."""
    count = len(result.infos)
    return "one window" if count == 1 else f"{count} windows"


def assumption(result: Result, speed: MetresPerSecond | None = None) -> str:
    """The model and the windows that a verdict rests on.

    Another model than a CTHP is linearised at the speed, by default at each vehicle's median.
    """
    estimate = result.estimate
    at = "the vehicle's median speed" if speed is None else f"{3.6 * speed:.0f} km/h"
    at = "" if estimate.following.is_cthp else f", linearised at {at}"
    point = about_point(estimate)
    return (
        f"The verdict is that of the {TITLES[estimate.model]}, estimated from"
        f" {counted_windows(result)}{at}{f'; {point}' if point else ''}."
    )


class Card(NamedTuple):
    """What is said first of a follower, or of several."""

    who: str
    """The follower, or all of them."""
    lead: str
    """The estimate: time gap, gains, what becomes of disturbances."""
    trust: str
    """How far to trust it, by its own windows."""
    is_contradicted: bool
    """Whether what `trust` says is against it."""


def cards(
    result: Result, subject: KnownVehicles | None = None, *, together: bool = False
) -> tuple[Card, ...]:
    """The estimate of each follower in sentences; one card for all that share it.

    Followers of one verdict, which nothing is against, may also be told ``together``. The subject
    are the result's vehicles, by default as `known_vehicles` has them.
    """
    subject, estimate = subject or known_vehicles(result), result.estimate
    groups: dict[Assessment | int, list[int]] = {}
    for k, trust in enumerate(result.trust):
        is_sure = not (trust.is_contradicted or _against(result, subject, [k]))
        is_shared = together and is_sure and _is_determined(estimate, k)
        groups.setdefault(assessed(subject, k) if is_shared else k, []).append(k)
    return tuple(_card(result, subject, followers) for followers in groups.values())


def _card(result: Result, subject: KnownVehicles, followers: Sequence[int]) -> Card:
    estimate, trusts = result.estimate, [result.trust[k] for k in followers]
    labels = [who(trust.vehicle, result.info) for trust in trusts]
    is_shared = trusts[0].vehicle == 0
    everyone = range(len(estimate.speeds)) if is_shared else followers
    are_several = len(trusts) > 1 or is_shared
    against = _against(result, subject, everyone)
    lead = [_headline(labels, are_several, result, followers)]
    lead += _gains("Their" if are_several else "Its", estimate, followers)
    if assessed(subject, everyone[0]) != "not determined":
        lead.append(becomes(subject, everyone, "they" if are_several else "it", are_several))
    trust = trusts[0].in_words if len(trusts) == 1 else trust_of_several(trusts)
    is_contradicted = trusts[0].is_contradicted or bool(against)
    return Card(joined(labels), " ".join(lead), " ".join((*against, trust)), is_contradicted)


def contradictions(result: Result | None) -> tuple[str, ...]:
    """Evidence against each follower's estimate, for what is concluded from it."""
    return tuple(
        f"{card.who}: {card.trust[0].lower()}{card.trust[1:]}"
        for card in (cards(result) if result else ())
        if card.is_contradicted
    )


def about_estimate(result: Result) -> str:
    """What the numbers of the table of parameters are."""
    estimate = result.estimate
    speeds, model = estimate.speeds, estimate.model
    gap = f", {'τ + s₀/v' if 's0' in estimate.names else 'τ'}" if model in CTHPS else ""
    low, high = (f"{3.6 * end:.0f}" for end in (speeds.min(), speeds.max()))
    median = low if low == high else f"{low} to {high}"
    marked = any(not estimate.is_driven(v, k) for v in SPEEDS for k in range(len(speeds)))
    extrapolated = " With *: no window holds that speed, so the model extrapolates." * marked
    said = (
        f"{FOLLOWING[model].equation}, with gap p, speed v, and Δv = speed ahead − v."
        f" Time gap: in equilibrium{gap}; median speed: {median} km/h.{extrapolated}"
    )
    if estimate.level is None:
        return f"{said} {capital(about_point(estimate))}."
    return (
        f"{said} In brackets: the {percent(estimate.level)} interval of the vehicle's typical"
        " value; last column: where the time gap of one more window lies. Intervals include"
        " variation between drives; poorly determined parameters are shrunk towards other cars."
    )


def true_model(truth: Parameters) -> str:
    """The key of the CTHP that a synthetic recording was made with; empty for another model."""
    return next((key for key in CTHPS if has_terms_of(key, truth)), "")


def about_truth(truth: Parameters, estimate: Estimate) -> str:
    """The model and the parameters that a synthetic recording was made with."""
    model, speed = true_model(truth), estimate.stated_speed
    if not model:
        return ""
    said = []
    if model != PAPER:
        gaps = [f"{gap:.2f}" for gap in truth.time_gap(speed).tolist()]
        said = [f"time gap {joined(gaps)} s at {3.6 * speed:.0f} km/h"]
    for name, column in columns_of(model).items():
        values = (f"{v:.{column.digits}f}" for v in value_of(model, truth, name).tolist())
        said.append(f"{column.title} {joined([*values])} {column.unit}")
    none = ", without s₀, lag or delay" if model == PAPER else ""
    return f"True values: made with the {TITLES[model]}{none}: {'; '.join(said)}."


def time_gap_in_words(gap: Quantity, speed: MetresPerSecond, level: float | None = None) -> str:
    """As "1.18 s at 100 km/h (1.05–1.31)"; a level is named with its interval."""
    at = f"s at {speed * 3.6:.0f} km/h"
    if isnan(gap.lower):
        return f"{gap.value:.2f} {at}"
    digits = supported_digits(gap.lower, gap.upper, 2)
    typical = between(gap.lower, gap.upper, digits).replace(" to ", "–")
    named = "" if level is None else f"{percent(level)} interval "
    return f"{gap.value:.{digits}f} {at} ({named}{typical})"


def _is_determined(estimate: Estimate, follower: int) -> bool:
    """Whether there is a time gap, and where there is a posterior its interval."""
    gap = estimate.time_gap(estimate.stated_speed, follower)
    return not isnan(gap.value if estimate.posterior is None else gap.lower)


def _headline(
    labels: Sequence[str], are_several: bool, result: Result, followers: Sequence[int]
) -> str:
    estimate, verb = result.estimate, "keep" if are_several else "keeps"
    speed, level = estimate.stated_speed, estimate.level
    if not _is_determined(estimate, followers[0]):
        return f"{labels[0]}: the data do not determine the time gap."
    gaps = [estimate.time_gap(speed, k) for k in followers]
    if len(gaps) == 1:
        return f"{labels[0]} {verb} {time_gap_in_words(gaps[0], speed, level)}."
    are_all = len(labels) == len(result.trust)
    named = capital(all_of(len(labels), "followers")) if are_all else joined(labels)
    least, most = (f"{pick(gap.value for gap in gaps):.2f}" for pick in (min, max))
    kept = least if least == most else f"{least}–{most}"
    if level is None:
        return f"{named} keep {kept} s at {3.6 * speed:.0f} km/h."
    off = max(max(gap.upper - gap.value, gap.value - gap.lower) / gap.value for gap in gaps)
    return (
        f"{named} keep {kept} s at {3.6 * speed:.0f} km/h, each ±{ceil(100 * off)} %"
        f" ({percent(level)} intervals)."
    )


def _gains(whose: str, estimate: Estimate, followers: Sequence[int]) -> tuple[str, ...]:
    """How far α and β may be from their values: the least known one counts."""
    spans = [estimate.gain(name, k) for name in ("alpha", "beta") for k in followers]
    if any(isnan(span.value) or isnan(span.lower) for span in spans):
        return ()
    above = max(span.upper / span.value if span.value > 0 else inf for span in spans)
    below = max(span.value / span.lower if span.lower > 0 else inf for span in spans)
    factor = max(above, below)
    if factor > HARDLY_KNOWN:
        return (f"{whose} gains are hardly known.",)
    if factor <= SYMMETRIC:
        return (f"{whose} gains: ±{5 * ceil(20 * (factor - 1))} %.",)
    return (f"{whose} gains: -{100 * (1 - 1 / below):.0f}/+{100 * (above - 1):.0f} %.",)


def _against(result: Result, subject: KnownVehicles, followers: Sequence[int]) -> tuple[str, ...]:
    """What is against an estimate of some followers beside its own windows, in sentences."""
    info, estimate = result.info, result.estimate
    numbers, speed = [info.vehicles[k + 1] for k in followers], estimate.stated_speed
    said = [*_unsound(result.infos, numbers)]
    unlike = (found for found in result.findings if isinstance(found, HeterogeneousFollowers))
    said += [found.sentence(info) for found in unlike]
    if not all(estimate.is_driven(speed, k) for k in followers):
        said.append(f"No window holds {speed * 3.6:.0f} km/h: the model extrapolates.")
    return (*said, *against_model(subject, numbers))


def _unsound(infos: Sequence[SegmentInfo], numbers: Sequence[int]) -> Iterator[str]:
    """What the data of some windows have against the estimate of some followers."""
    findings = [found for info in infos for found in info.findings]
    gaps = [found for found in findings if isinstance(found, GapContradictsSpeeds)]
    if any(found.follower in numbers for found in gaps):
        yield "Do not trust it: the measured gap contradicts the speeds."
    large = [found for found in findings if isinstance(found, ValuesOutOfRange)]
    if any(found.is_in_another_unit and {*found.followers} & {*numbers} for found in large):
        yield "Do not trust it: measured values are too large; check their units."
