"""A result in a few sentences, what its numbers assume, and the checks and cautions about it."""

from collections.abc import Sequence
from itertools import compress
from math import ceil
from typing import Any, NamedTuple

import msgspec
import numpy as np

from accpinn.findings import Finding, all_of, capital, joined, percent, who
from accpinn.inference.gain_check import LEAST
from accpinn.inference.identifiability import SYMBOLS, WIDE, wide_intervals
from accpinn.inference.intervals import Uncertainty
from accpinn.inference.model_adequacy import Adequacy
from accpinn.inference.prediction import GapBand
from accpinn.methods.estimate import Estimate, Outcome
from accpinn.methods.joint_likelihood import disturbance_sizes
from accpinn.methods.registry import recommended_method
from accpinn.model.registry import CTHPS, FOLLOWING, PAPER, TITLES, gains_and_gap
from accpinn.recordings import FLAGS
from accpinn.results.messages import incidents, messages
from accpinn.results.messages.estimate import cards
from accpinn.results.messages.stability import against_measured
from accpinn.results.tables.estimates import COMPARED, name_of, outside_interval
from accpinn.segment import SegmentInfo
from accpinn.study.judge import LEAST_WINDOWS, Describes, Judgement
from accpinn.study.result import Result

CONVERGED = (Outcome.SOLVED, Outcome.CONVERGED, Outcome.FILTERED)
"""How an estimation ends that has come to its estimate."""


def about_band(result: Result) -> str:
    """What a predictive band is."""
    model = result.estimate.model
    simulated = TITLES[model] if model in CTHPS else f"linearisation of the {TITLES[model]}"
    return (
        f"Band: the space-gaps that the {simulated} predicts from the leader's speed alone, with"
        " posterior samples of the parameters and random disturbances of the estimated size."
    )


def about_tracking(result: Result, window: int = 0) -> str:
    """What is drawn beside the data of a window (0 for the first)."""
    several = f"Window {result.infos[window].window}. " if len(result.infos) > 1 else ""
    return f"{several}Simulation: the vehicle behind the measured one ahead, by the estimate."


def equation(model: str) -> tuple[str, str]:
    """A model's name and equation of motion, and its symbols."""
    following = FOLLOWING[model]
    symbols = joined([f"{p.symbol} [{p.unit}]" for p in following.parameters])
    return (
        f"{following.title}: {following.equation}",
        f"p space-gap, v speed, Δv speed of the vehicle ahead minus own; parameters {symbols}",
    )


def title(snapshot: Result) -> str:
    """The user's name for the result, or else its subject."""
    first, *others = snapshot.info.labels[1:]
    subject = f"{1 + len(others)} vehicles follow" if others else f"{first} follows"
    return snapshot.name or f"How {subject} the vehicle ahead"


def summary(snapshot: Result) -> tuple[str, ...]:
    """The estimate of each follower, with cautions before."""
    info = snapshot.info
    hand = info.driven_by_hand
    sentences = [hand.sentence(info) if hand else "", unfinished(snapshot.estimate)]
    sentences += [f"{card.lead} {card.trust}" for card in cards(snapshot)]
    return tuple(sentence for sentence in sentences if sentence)


def unfinished(estimate: Estimate) -> str:
    """The warning beside parameters of a stopped training; empty for others."""
    if estimate.outcome is not Outcome.STOPPED:
        return ""
    planned = estimate.settings.get("iterations")
    of_planned = f" of {planned:,}" if isinstance(planned, int) else ""
    return (
        f"Training was stopped at {estimate.iterations:,}{of_planned} iterations; these parameters"
        " are preliminary."
    )


def which_model(judgements: Sequence[Judgement]) -> tuple[str, ...]:
    """Which model describes the followers, said once for those of which the same holds."""
    groups: dict[tuple[object, ...], list[tuple[Judgement, Describes]]] = {}
    for judged in judgements:
        for finding in judged.findings:
            alike = finding.clear, finding.model, finding.windows
            groups.setdefault(alike, []).append((judged, finding))
    return tuple(_which_model(group, len(judgements)) for group in groups.values())


def _which_model(group: Sequence[tuple[Judgement, Describes]], total: int) -> str:
    judged, finding = group[0]
    if len(group) == 1:
        return finding.sentence(judged.info)
    labels = [judged.info.labels[1] for judged, _ in group]
    named = capital(all_of(total, "followers")) if len(group) == total else joined(labels)
    errors, more = (
        f"{min(parts):.{digits}f} to {max(parts):.{digits}f}"
        for parts, digits in (
            ([one.rmse for _, one in group], 2),
            ([one.more for _, one in group], 0),
        )
    )
    where, model = f"in {finding.windows} windows left out", finding.model
    if finding.clear:
        return (
            f"{named}: the {model} describes each of these cars best. Its gap errors {where} are"
            f" {errors} m (geometric means); those of the next best models are {more} % larger."
        )
    for_all = set.intersection(*(set(one.worse) for _, one in group))
    titles = tuple(title for title in finding.worse if title in for_all)
    worse = msgspec.structs.replace(finding, worse=titles).worse_in_words
    start = (
        f"{named}: {finding.windows} windows are too few to say which model is better"
        if finding.windows < LEAST_WINDOWS
        else f"{named}: no model is clearly better"
    )
    return (
        f"{start}. The {model} has the least gap errors {where}, {errors} m (geometric means);"
        f" those of the next best models are {more} % larger, which may be chance.{worse}"
    )


def conditional(result: Result, adequacy: Adequacy | None) -> str:
    """What estimates and intervals assume, and for whom another form of the CTHP is better."""
    model = result.estimate.model
    what = "estimate and its intervals assume" if result.posterior else "estimate assumes"
    assumption = f"The {what} the {TITLES[model]}."
    if model != PAPER:
        return f"{assumption} By another model they would differ."
    if adequacy is None or not adequacy.forms:
        return (
            f"{assumption} With an intercept s₀, a lag or a delay in the model they would differ."
        )
    if not adequacy.better:
        return (
            f"{assumption} No form with an intercept s₀, a lag or a delay describes the data"
            " clearly better, but one recording can hardly tell them apart."
        )
    labels = [who(better.vehicle, result.info) for better in adequacy.better]
    return f"{assumption} Another form of the model describes the data better: {joined(labels)}."


def recommended_of(rows: Sequence[Result]) -> Result | None:
    """The estimate that others are held against: one with a posterior.

    Of several it is that of the method which is recommended for its model. None where there is no
    posterior.
    """
    known = [row for row in rows if row.posterior]
    usual = [r for r in known if r.analysis.method == recommended_method(r.analysis.spec.model)]
    return next(iter((*usual, *known)), None)


def agreement(rows: Sequence[Result], recommended: Result) -> str:
    """How many methods agree with the recommended estimate, which do not, and how far all are off.

    The recommended one is not counted. It is empty where nothing is determined, or nothing else is
    compared.
    """
    estimate = recommended.estimate
    value, lower = np.array(
        [
            [(span.value, span.lower) for span in estimate.gains_and_gap(k)]
            for k in range(len(estimate.speeds))
        ]
    ).transpose(2, 0, 1)
    followers = np.flatnonzero(np.isfinite(lower).all(axis=1)).tolist()
    found = [row.estimate for row in rows if row.analysis.key != recommended.analysis.key]
    if not followers or not found:
        return ""
    differing = [
        name_of(each)
        for each in found
        if any(outside_interval(estimate, each, k) for k in followers)
    ]
    count, total = len(found) - len(differing), len(found)
    agree = "agrees" if count == 1 else "agree"
    some = f"{count} of {total} methods {agree}" if count else "No method agrees"
    within = f"within the {percent(estimate.level or 0.0)} intervals of {joined(COMPARED)}"
    within += " for every follower" if len(followers) > 1 else ""
    other = f"; {joined(differing)} {'does' if len(differing) == 1 else 'do'} not"
    other = other if differing and count else ""
    own = np.array([gains_and_gap(e.model, e.parameters, estimate.speeds) for e in found])
    off = np.abs(own - value)[:, followers] / np.where(value > 0, value, np.nan)[followers]
    pairs = zip(off.max(axis=(0, 1)).tolist(), COMPARED, strict=True)
    # Not a number where one is unknown, or the recommended one's is zero.
    away = joined([f"{ceil(100 * far)} % ({symbol})" for far, symbol in pairs if far < 1.0])
    size = f" All are within {away} of it." if away else ""
    alike = some if differing else "Every method agrees"
    return f"{alike} with the recommended estimate {within}{other}.{size}"


def about_curves(result: Result, follower: int, band: GapBand | None = None) -> tuple[str, ...]:
    """The coverage of a follower's band (0 for the first), and the size of its disturbance."""
    info = result.info
    vehicles = (0, info.vehicles[follower + 1])
    coverage = [f for f in (band.findings if band else ()) if f.vehicle in vehicles]
    sizes = disturbance_sizes(info.vehicles, result.estimate)
    return messages((*coverage, *(size for size in sizes if size.vehicle in vehicles)), info)


def setting(value: Any) -> str:
    """The value of a setting as text."""
    if isinstance(value, list):
        return ", ".join(map(setting, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def about_data(snapshot: Result) -> tuple[tuple[str, str], ...]:
    """The recording and the window as terms and descriptions."""
    info, facts = snapshot.info, snapshot.facts
    windows = [part.window for part in snapshot.infos]
    samples = sum(part.samples for part in snapshot.infos)
    flag, excluded = facts.get("acc_flag"), "nothing: every instant counts"
    if info.excluded_regimes:
        shares = ", ".join(
            f"{percent(share)} of {label}"
            for label, share in zip(info.labels[1:], info.excluded_share, strict=True)
        )
        excluded = f"{', '.join(info.excluded_regimes)} from the model's equation: {shares}"
    rows = {
        "Recording": info.source,
        "Campaign": facts.get("campaign"),
        "Date": facts.get("date"),
        "ACC flag of the file": flag is not None
        and f"{FLAGS.get(flag, flag)}, for the recording as a whole; single vehicles may be driven"
        " otherwise",
        "Distance setting": facts.get("distance_setting"),
        "Windows" if len(windows) > 1 else "Window": f"{joined([*map(str, windows)])} of the"
        f" recording, {samples:,} samples every {info.sample_time:g} s",
        "Leader": info.labels[0],
        "Followers": ", ".join(info.labels[1:]),
        "Excluded": excluded,
    }
    return tuple((term, str(value)) for term, value in rows.items() if value)


def cautions(snapshot: Result) -> dict[str, tuple[str, ...]]:
    """Cautions, by the part of the report they belong to."""
    info = snapshot.info
    on_data: list[Finding] = [found for part in snapshot.infos for found in part.findings]
    on_data += [found for quality in snapshot.qualities for found in quality.findings]
    return {
        "data": tuple(dict.fromkeys(messages(on_data, info))),
        "parameters": messages(snapshot.weaknesses, info),
        "closed_loop": incidents(snapshot.evaluation, info),
    }


class Check(NamedTuple):
    """A question to be asked before an estimate's numbers are quoted, and its answer."""

    title: str
    meaning: str
    passed: bool | None
    """None: it is not known."""
    why: tuple[str, ...]
    """What the answer rests on, in sentences."""


def checks(result: Result) -> tuple[Check, ...]:
    """All checks of an estimate, in the order in which they are shown."""
    info, known, estimate = result.info, result.uncertainty, result.estimate
    events = incidents(result.evaluation, info)
    converged = Check(
        "Converged",
        "Whether the estimate has stopped changing. Tab Training shows its course.",
        estimate.outcome in CONVERGED,
        (estimate.outcome.value,),
    )
    without_collision = Check(
        "Simulated without collision",
        "Whether the closed-loop simulation behind the measured leader ends without a collision,"
        " reversing or divergence, in the windows and outside.",
        not events,
        events,
    )
    missed = [trust for trust in result.trust if not trust.is_reproduced]
    is_known = all(np.isfinite(trust.rmse) for trust in result.trust)
    reproduced = Check(
        "Drive reproduced",
        "Whether each vehicle, simulated behind the measured one ahead, keeps the measured gap up"
        " to half of the gap's standard deviation.",
        not missed if is_known else None,
        tuple(trust.sentence(info) for trust in missed),
    )
    if known is None:
        return converged, without_collision, reproduced
    wide = _wide(info, known)
    identified = Check(
        "Identified",
        f"Whether the intervals of α, β and τ span less than a factor of {WIDE:g}.",
        not wide,
        wide,
    )
    compared = [check for check in result.gain_checks if check.frequencies >= LEAST]
    agrees = Check(
        "Measured gain agrees",
        "Whether the gain that is measured from the recording without a model allows the verdict on"
        " string stability.",
        not any(check.contradiction for check in compared) if compared else None,
        against_measured(result.gain_checks, info),
    )
    return converged, identified, without_collision, agrees, reproduced


def _wide(info: SegmentInfo, uncertainty: Uncertainty) -> tuple[str, ...]:
    """For each follower the parameters with wide intervals, all where none is determined."""
    are_wide = wide_intervals(uncertainty) | np.isnan(uncertainty.lower.alpha)[:, None]
    pairs = zip(info.vehicles[1:], are_wide, strict=True)
    named = ((who(vehicle, info), tuple(compress(SYMBOLS, row))) for vehicle, row in pairs)
    return tuple(f"{label}: {joined(symbols)}." for label, symbols in named if symbols)
