"""The answer in sentences, one a follower, and the label of estimates that are the paper's."""

from collections.abc import Iterator, Sequence
from math import ceil, inf, isnan
from typing import NamedTuple

from accpinn.findings import all_of, capital, joined, percent, who
from accpinn.inference.answer import SPEEDS, Answer, HeterogeneousFollowers
from accpinn.inference.trust import trust_of_several
from accpinn.methods.estimate import Fit
from accpinn.model.cthp import Parameters
from accpinn.model.registry import CTHPS, FOLLOWING, PAPER, TITLES, has_terms_of, value_of
from accpinn.recordings import GapContradictsSpeeds, ValuesOutOfRange
from accpinn.results.messages.stability import against_model, assessed, becomes
from accpinn.results.tables import between, supported_digits
from accpinn.results.tables.answer import columns_of, counted_windows
from accpinn.results.vehicles import KnownVehicles, known_vehicles
from accpinn.segment import SegmentInfo
from accpinn.stability import Assessment
from accpinn.study.result import Result
from accpinn.units import Quantity, MetresPerSecond

PAPERS_PRESETS = ("fast", "paper")
"""Presets that minimise the paper's loss."""
PAPERS_ESTIMATE = "the paper's estimate, biased if disturbances last"
PAPERS_LOSS = "the paper's loss with another model, biased if disturbances last"
"""The labels of what those presets estimate: by the paper's model, and by any other."""


def assumption(answer: Answer, speed: MetresPerSecond | None = None) -> str:
    """The model and the windows that a verdict on the answer rests on.

    Another model than a CTHP is linearised at the speed, by default at each vehicle's median.
    """
    at = "the vehicle's median speed" if speed is None else f"{3.6 * speed:.0f} km/h"
    at = "" if answer.model in CTHPS else f", linearised at {at}"
    return (
        f"The verdict is that of the answer: {TITLES[answer.model]}, typical values over"
        f" {counted_windows(answer)}{at}."
    )


class Card(NamedTuple):
    """What is said first of a follower, or of several."""

    who: str
    """The follower, or all of them."""
    lead: str
    """The answer: time gap, gains, what becomes of disturbances."""
    trust: str
    """How far to trust it, by its own windows."""
    is_contradicted: bool
    """Whether what `trust` says is against it."""


def cards(
    info: SegmentInfo, answer: Answer, subject: KnownVehicles, *, together: bool = False
) -> tuple[Card, ...]:
    """The answer of each follower in sentences; one card for all that share it.

    Followers of one verdict, which nothing is against, may also be told together.
    """
    groups: dict[Assessment | int, list[int]] = {}
    for k in range(len(answer.trust)):
        is_sure = not (answer.trust[k].is_contradicted or _against(info, answer, subject, [k]))
        is_known = not isnan(answer.time_gap(answer.stated_speed, k).value)
        is_shared = together and is_sure and is_known
        groups.setdefault(assessed(subject, k) if is_shared else k, []).append(k)
    said = []
    for followers in groups.values():
        trusts = [answer.trust[k] for k in followers]
        labels = [who(trust.vehicle, info) for trust in trusts]
        everyone = range(len(answer.speeds)) if trusts[0].vehicle == 0 else followers
        against = _against(info, answer, subject, everyone)
        are_several = len(trusts) > 1 or trusts[0].vehicle == 0
        lead = [_headline(labels, are_several, answer, followers)]
        condition = "" if all(trust.is_reproduced for trust in trusts) else ", if the model holds"
        lead += _gains("Their" if are_several else "Its", answer, followers, condition)
        if subject.uncertainty and assessed(subject, everyone[0]) != "not determined":
            lead.append(becomes(subject, everyone, "they" if are_several else "it", are_several))
        trust = trusts[0].in_words if len(trusts) == 1 else trust_of_several(trusts)
        is_contradicted = trusts[0].is_contradicted or bool(against)
        told = " ".join((*against, trust))
        said.append(Card(joined(labels), " ".join(lead), told, is_contradicted))
    return tuple(said)


def against_answer(result: Result | None) -> tuple[str, ...]:
    """What is against the answer of each follower, for what is concluded from it."""
    known = result.known_answer if result else None
    if not (result and known):
        return ()
    about = cards(result.info, known, known_vehicles(result))
    return tuple(
        f"{card.who}: {card.trust[0].lower()}{card.trust[1:]}"
        for card in about
        if card.is_contradicted
    )


def about_answer(answer: Answer) -> str:
    """What the intervals of an answer are."""
    gap = f", {'τ + s₀/v' if 's0' in answer.names else 'τ'}" if answer.model in CTHPS else ""
    low, high = 3.6 * answer.speeds.min(), 3.6 * answer.speeds.max()
    median = f"{low:.0f}" if f"{low:.0f}" == f"{high:.0f}" else f"{low:.0f} to {high:.0f}"
    marked = any(not answer.is_driven(v, k) for v in SPEEDS for k in range(len(answer.speeds)))
    driven = " With *: no window holds that speed, so the model extrapolates." if marked else ""
    equation = FOLLOWING[answer.model].equation
    return (
        f"{equation}, with gap p, speed v, and Δv = speed ahead − v."
        f" Time gap: in equilibrium{gap}; median speed: {median} km/h.{driven} In brackets: the"
        f" {percent(answer.level)} interval of the vehicle's typical value; last column: where the"
        " time gap of one more window lies. Both count how much windows of a car differ, here and"
        " in many other cars: what these windows determine well has a wider interval than they say"
        " alone, and what they hardly determine is drawn towards those cars."
    )


def true_model(truth: Parameters) -> str:
    """The key of the CTHP that a synthetic recording was made with; empty for another model."""
    return next((key for key in CTHPS if has_terms_of(key, truth)), "")


def about_truth(truth: Parameters, answer: Answer) -> str:
    """The model and the parameters that a synthetic recording was made with."""
    model = true_model(truth)
    if not model:
        return ""
    said = []
    if model != PAPER:
        gaps = [f"{gap:.2f}" for gap in truth.time_gap(answer.stated_speed).tolist()]
        said = [f"time gap {joined(gaps)} s at {3.6 * answer.stated_speed:.0f} km/h"]
    for name, column in columns_of(model).items():
        values = (f"{v:.{column.digits}f}" for v in value_of(model, truth, name).tolist())
        said.append(f"{column.title} {joined([*values])} {column.unit}")
    none = ", without s₀, lag or delay" if model == PAPER else ""
    return f"True values: made with the {TITLES[model]}{none}: {'; '.join(said)}."


def papers_estimate(fit: Fit) -> str:
    """The label of a fit by one of the paper's presets; empty for others."""
    if fit.method != "pinn" or fit.config.get("preset") not in PAPERS_PRESETS:
        return ""
    return PAPERS_ESTIMATE if fit.model == PAPER else PAPERS_LOSS


def time_gap_in_words(gap: Quantity, speed: MetresPerSecond, level: float | None = None) -> str:
    """As "1.18 s at 100 km/h (1.05–1.31)"; a level is named with its interval."""
    digits = supported_digits(gap.lower, gap.upper, 2)
    typical = between(gap.lower, gap.upper, digits).replace(" to ", "–")
    named = "" if level is None else f"{percent(level)} interval "
    return f"{gap.value:.{digits}f} s at {speed * 3.6:.0f} km/h ({named}{typical})"


def _headline(
    labels: Sequence[str], are_several: bool, answer: Answer, followers: Sequence[int]
) -> str:
    speed, verb = answer.stated_speed, "keep" if are_several else "keeps"
    gaps = [answer.time_gap(speed, k) for k in followers]
    if isnan(gaps[0].value):
        return f"{labels[0]}: the data do not determine the time gap."
    if len(gaps) == 1:
        return f"{labels[0]} {verb} {time_gap_in_words(gaps[0], speed, answer.level)}."
    are_all = len(labels) == len(answer.trust)
    named = capital(all_of(len(labels), "followers")) if are_all else joined(labels)
    least, most = (f"{pick(gap.value for gap in gaps):.2f}" for pick in (min, max))
    kept = least if least == most else f"{least}–{most}"
    off = max(max(gap.upper - gap.value, gap.value - gap.lower) / gap.value for gap in gaps)
    return (
        f"{named} keep {kept} s at {3.6 * speed:.0f} km/h, each known within {ceil(100 * off)} %"
        f" ({percent(answer.level)} intervals)."
    )


def _gains(whose: str, answer: Answer, followers: Sequence[int], condition: str) -> tuple[str, ...]:
    """How far α and β may be from their values: the least known one counts."""
    spans = [answer.gain(name, k) for name in ("alpha", "beta") for k in followers]
    if any(isnan(span.value) for span in spans):
        return ()
    factor = max(
        max(span.upper / span.value, span.value / span.lower) if span.lower > 0 else inf
        for span in spans
    )
    if factor > 5.0:
        return (f"{whose} gains are hardly known.",)
    share = f"{5 * ceil(20 * (factor - 1)):.0f} %"
    within = share if factor <= 1.3 else f"a factor of {ceil(10 * factor) / 10:g}"
    return (f"{whose} gains are known within {within}{condition}.",)


def _against(
    info: SegmentInfo, answer: Answer, subject: KnownVehicles, followers: Sequence[int]
) -> tuple[str, ...]:
    """What is against an answer of some followers beside its own windows, in sentences."""
    numbers = [info.vehicles[k + 1] for k in followers]
    infos = subject.result.infos if subject.result else (info,)
    speed, said = answer.stated_speed, [*_unsound(infos, numbers)]
    unlike = (found for found in answer.findings if isinstance(found, HeterogeneousFollowers))
    said += [found.sentence(info) for found in unlike]
    if not all(answer.is_driven(speed, k) for k in followers):
        said.append(f"No window holds {speed * 3.6:.0f} km/h: the model extrapolates.")
    return (*said, *against_model(subject, numbers))


def _unsound(infos: Sequence[SegmentInfo], numbers: Sequence[int]) -> Iterator[str]:
    """What the data of some windows have against the answer of some followers."""
    findings = [found for info in infos for found in info.findings]
    gaps = [found for found in findings if isinstance(found, GapContradictsSpeeds)]
    if any(found.follower in numbers for found in gaps):
        yield "Do not trust it: the measured gap contradicts the speeds."
    large = [found for found in findings if isinstance(found, ValuesOutOfRange)]
    if any(found.is_in_another_unit and {*found.followers} & {*numbers} for found in large):
        yield "Do not trust it: measured values are too large; check their units."
