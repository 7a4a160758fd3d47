"""An estimate in sentences, one a follower, and what its numbers are."""

from collections.abc import Collection, Sequence
from itertools import compress
from math import ceil, inf, isfinite, isnan
from typing import NamedTuple

import numpy as np

from accpinn.findings import all_of, capital, joined, percent, who
from accpinn.inference.gain_check import LEAST
from accpinn.inference.identifiability import SYMBOLS, WIDE, wide_intervals
from accpinn.inference.intervals import Uncertainty
from accpinn.inference.prediction import GapBand
from accpinn.inference.trust import trust_of_several
from accpinn.methods.estimate import Estimate, Outcome
from accpinn.model.cthp import Parameters
from accpinn.model.registry import FOLLOWING, PAPER, TITLES, has_terms_of, value_of
from accpinn.results.messages import incidents, messages
from accpinn.results.messages.stability import becomes, measured_gain_sentences
from accpinn.results.naming import about_point
from accpinn.results.objections import against_estimate
from accpinn.results.tables import between, supported_digits
from accpinn.results.tables.estimates import columns_of
from accpinn.segment import SegmentInfo
from accpinn.stability import Assessment
from accpinn.study.description import Description, FollowerDescription, view
from accpinn.study.result import Result
from accpinn.units import MetresPerSecond, Quantity

CONVERGED = (Outcome.SOLVED, Outcome.CONVERGED, Outcome.FILTERED)
"""How an estimation ends that has come to its estimate."""
HARDLY_KNOWN = 5.0
"""Factor between a gain and an end of its interval above which it is called hardly known."""
SYMMETRIC = 1.3
"""The same up to which both ends are said as one."""


def assumption(result: Result, speed: MetresPerSecond | None = None) -> str:
    """The model and the windows that a verdict rests on.

    Another model than a CTHP is linearised at the speed, by default at each vehicle's median.
    """
    estimate, model = result.estimate, result.estimate.following
    at = "the vehicle's median speed" if speed is None else f"{3.6 * speed:.0f} km/h"
    at = "" if model.is_linear else f", linearised at {at}"
    point = f"; {about_point(estimate)}" if not estimate.posterior else ""
    windows = "one window" if len(result.infos) == 1 else f"{len(result.infos)} windows"
    return f"The verdict is that of the {model.title}, estimated from {windows}{at}{point}."


class Card(NamedTuple):
    """What is said first of a follower, or of several."""

    who: str
    """The follower, or all of them."""
    lead: str
    """The estimate: time gap, gains, what becomes of disturbances."""
    trust: str
    """What is against it, and how far to trust it by its own windows."""
    against: str
    """The part of `trust` that is against it; empty where nothing is."""
    places: tuple[int, ...]
    """Their indices among the followers."""

    @property
    def is_contradicted(self) -> bool:
        """Whether anything is."""
        return bool(self.against)


@view
def cards(description: Description, *, together: bool = False) -> tuple[Card, ...]:
    """The estimate of each follower in sentences; one card for all that share it.

    Followers of one verdict, which nothing is against, may also be told ``together``.
    """
    groups: dict[Assessment | int, list[FollowerDescription]] = {}
    for follower in description.followers:
        is_alone = not together or not follower.is_determined
        is_alone = is_alone or follower.trust.is_contradicted or bool(against_estimate(follower))
        group = follower.place if is_alone else follower.stability.l2.assessment
        groups.setdefault(group, []).append(follower)
    return tuple(_card(description, followers) for followers in groups.values())


def _card(description: Description, followers: Sequence[FollowerDescription]) -> Card:
    labels = [who(follower.number, description.info) for follower in followers]
    places = [place for follower in followers for place in follower.places]
    against = [objection.sentence for objection in against_estimate(followers[0])]
    trusts = [follower.trust for follower in followers]
    are_several, subject = len(followers) > 1 or followers[0].number == 0, description.vehicles
    lead = [_headline(labels, are_several, description, followers)]
    lead += _gains("Their" if are_several else "Its", followers)
    if meaning := "" if are_several else meaning_of(description.estimate.model, followers[0]):
        lead.append(f"It {meaning}.")
    if followers[0].stability.l2.assessment != "not determined":
        lead.append(becomes(subject, places, "they" if are_several else "it", are_several))
    trust = trusts[0].in_words if len(trusts) == 1 else trust_of_several(trusts)
    whole, doubted = " ".join((*against, trust)), " ".join(against)
    doubted = whole if trusts[0].is_contradicted else doubted
    return Card(joined(labels), " ".join(lead), whole, doubted, tuple(places))


def contradictions(result: Result | None, places: Collection[int] | None = None) -> tuple[str, ...]:
    """Evidence against each follower's estimate, for what is concluded from it.

    ``places`` are the indices of the followers in question; None for all.
    """
    return tuple(
        f"{card.who}: {card.trust[0].lower()}{card.trust[1:]}"
        for card in (cards(result) if result else ())
        if card.is_contradicted and (places is None or {*card.places} & {*places})
    )


@view
def about_estimate(description: Description) -> str:
    """What the numbers of the table of parameters are."""
    estimate = description.estimate
    speeds, model, level = estimate.speeds, estimate.following, estimate.level
    gap = f", {'τ + s₀/v' if 's0' in model.names else 'τ'}" if model.is_linear else ""
    low, high = (f"{3.6 * end:.0f}" for end in (speeds.min(), speeds.max()))
    median = low if low == high else f"{low} to {high}"
    about = (
        f"{model.equation}, with gap p, speed v, and Δv = speed ahead − v."
        f" Time gap: in equilibrium{gap}; median speed: {median} km/h."
    )
    if level is None:
        return f"{about} {capital(about_point(estimate))}."
    return (
        f"{about} In brackets: the {percent(level)} interval of the vehicle's typical"
        " value; last column: where the time gap of one more window lies. Intervals include"
        " variation between drives; poorly determined parameters are shrunk towards other cars."
    )


def initial_in_words(model: str, parameters: Parameters) -> str:
    """The values at which a search begins, those of the first follower."""
    values_in_words = []
    for name, column in columns_of(model).items():
        value = float(value_of(model, parameters, name)[0])
        values_in_words.append(f"{column.title} = {value:.3g} {column.unit}".rstrip())
    return f"Initial values: {', '.join(values_in_words)}."


def true_model(truth: Parameters) -> str:
    """The key of the CTHP that a synthetic recording was made with; empty for another model."""
    linear = (key for key, model in FOLLOWING.items() if model.is_linear)
    return next((key for key in linear if has_terms_of(key, truth)), "")


def about_truth(truth: Parameters, estimate: Estimate) -> str:
    """The model and the parameters that a synthetic recording was made with."""
    model, speed = true_model(truth), estimate.stated_speed
    if not model:
        return ""
    values_in_words = []
    if model != PAPER:
        gaps = [f"{gap:.2f}" for gap in truth.time_gap(speed).tolist()]
        values_in_words = [f"time gap {joined(gaps)} s at {3.6 * speed:.0f} km/h"]
    for name, column in columns_of(model).items():
        values = (f"{v:.{column.digits}f}" for v in value_of(model, truth, name).tolist())
        values_in_words.append(f"{column.title} {joined([*values])} {column.unit}")
    none = ", without s₀, lag or delay" if model == PAPER else ""
    return f"True values: made with the {TITLES[model]}{none}: {'; '.join(values_in_words)}."


def time_gap_in_words(gap: Quantity, speed: MetresPerSecond, level: float | None = None) -> str:
    """As "1.18 s at 100 km/h (1.05–1.31)"; a level is named with its interval."""
    at = f"s at {speed * 3.6:.0f} km/h"
    if isnan(gap.lower):
        return f"{gap.value:.2f} {at}"
    digits = supported_digits(gap.lower, gap.upper, 2)
    typical = between(gap.lower, gap.upper, digits).replace(" to ", "–")
    named = "" if level is None else f"{percent(level)} interval "
    return f"{gap.value:.{digits}f} {at} ({named}{typical})"


def _headline(
    labels: Sequence[str],
    are_several: bool,
    description: Description,
    followers: Sequence[FollowerDescription],
) -> str:
    verb, estimate = "keep" if are_several else "keeps", description.estimate
    speed, level = estimate.stated_speed, estimate.level
    if not followers[0].is_determined:
        return f"{labels[0]}: the data do not determine the time gap."
    gaps = [follower.values.time_gap.span for follower in followers]
    if len(gaps) == 1:
        return f"{labels[0]} {verb} {time_gap_in_words(gaps[0], speed, level)}."
    are_all = len(labels) == len(description.followers)
    named = capital(all_of(len(labels), "followers")) if are_all else joined(labels)
    least, most = (f"{pick(gap.value for gap in gaps):.2f}" for pick in (min, max))
    gap_in_words = least if least == most else f"{least}–{most}"
    if level is None:
        return f"{named} keep {gap_in_words} s at {3.6 * speed:.0f} km/h."
    off = max(max(gap.upper - gap.value, gap.value - gap.lower) / gap.value for gap in gaps)
    return (
        f"{named} keep {gap_in_words} s at {3.6 * speed:.0f} km/h, each ±{ceil(100 * off)} %"
        f" ({percent(level)} intervals)."
    )


def _gains(whose: str, followers: Sequence[FollowerDescription]) -> tuple[str, ...]:
    """How far α and β may be from their values: the least known one counts."""
    spans = [span for follower in followers for span in follower.at_median[0][:2]]
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


def meaning_of(model: str, follower: FollowerDescription) -> str:
    """What a follower's parameters say of it, with intervals; empty where its model says nothing.

    As "eases off 2.1 (1.6 to 2.8) times as hard as it closes up".
    """
    spans = {name: value.span for name, value in follower.values.parameters.items()}
    if any(isnan(span.value) for span in spans.values()):
        return ""
    values = {name: _two(span.value) for name, span in spans.items()}
    for name, span in spans.items():
        if not isnan(span.lower):
            values[name] += f" ({_two(span.lower)} to {_two(span.upper)})"
    return FOLLOWING[model].meaning.format_map(values)


def _two(value: float) -> str:
    """Two significant digits, including a zero at the end."""
    return f"{value:#.2g}".rstrip(".")


def about_band(model: str) -> str:
    """What the band of gaps is that a model with a posterior predicts."""
    is_linear = FOLLOWING[model].is_linear
    simulated = TITLES[model] if is_linear else f"linearisation of the {TITLES[model]}"
    return (
        f"Band: the space-gaps that the {simulated} predicts from the leader's speed alone, with"
        " posterior samples of the parameters and random disturbances of the estimated size."
    )


@view
def about_curves(
    description: Description, follower: int, band: GapBand | None = None
) -> tuple[str, ...]:
    """The coverage of a follower's band (0 for the first), and the size of its disturbance."""
    info, of = description.info, description.info.vehicles[follower + 1]
    findings = [found for found in (band.findings if band else ()) if found.vehicle == of]
    disturbance = description.follower(follower).disturbance
    return messages((*findings, disturbance) if disturbance else findings, info)


class Check(NamedTuple):
    """A question to be asked before an estimate's numbers are quoted, and its answer."""

    title: str
    meaning: str
    passed: bool | None
    """None: it is not known."""
    why: tuple[str, ...]
    """What the answer rests on, in sentences."""


MEANINGS = {
    "Converged": "Whether the estimate has stopped changing. Tab Training shows its course.",
    "Identified": f"Whether the intervals of α, β and τ span less than a factor of {WIDE:g}.",
    "Simulated without collision": "Whether the closed-loop simulation behind the measured leader"
    " ends without a collision, reversing or divergence, in the windows and outside.",
    "Measured gain agrees": "Whether the gain that is measured from the recording without a model"
    " allows the verdict on string stability.",
    "Drive reproduced": "Whether each vehicle, simulated behind the measured one ahead, keeps the"
    " measured gap up to half of the gap's standard deviation.",
}
"""What is asked of an estimate, in the order in which it is shown."""


@view
def checks(description: Description) -> tuple[Check, ...]:
    """All checks of an estimate; those of intervals and of their verdicts where it has some."""
    info, subject = description.info, description.vehicles
    events = incidents(description.result.evaluation, info)
    trusts = description.result.trust
    missed = tuple(trust.sentence(info) for trust in trusts if not trust.is_reproduced)
    is_known, outcome = all(isfinite(t.rmse) for t in trusts), description.estimate.outcome
    answers: dict[str, tuple[bool | None, tuple[str, ...]]] = {
        "Converged": (outcome in CONVERGED, (outcome.value,)),
        "Simulated without collision": (not events, events),
        "Drive reproduced": (not missed if is_known else None, missed),
    }
    if subject.uncertainty:
        wide = _wide(info, subject.uncertainty)
        answers["Identified"] = not wide, wide
        compared = [check for check in subject.checks if check.frequencies >= LEAST]
        agrees = not any(check.contradiction for check in compared) if compared else None
        answers["Measured gain agrees"] = agrees, measured_gain_sentences(subject.checks, info)
    return tuple(
        Check(title, meaning, *answers[title])
        for title, meaning in MEANINGS.items()
        if title in answers
    )


def _wide(info: SegmentInfo, uncertainty: Uncertainty) -> tuple[str, ...]:
    """For each follower the parameters with wide intervals, all where none is determined."""
    are_wide = wide_intervals(uncertainty) | np.isnan(uncertainty.lower.alpha)[:, None]
    pairs = zip(info.vehicles[1:], are_wide, strict=True)
    named = ((who(vehicle, info), tuple(compress(SYMBOLS, row))) for vehicle, row in pairs)
    return tuple(f"{label}: {joined(symbols)}." for label, symbols in named if symbols)
