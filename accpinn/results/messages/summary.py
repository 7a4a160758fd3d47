"""A result in a few sentences, what its numbers assume, and the checks and cautions about it."""

from collections.abc import Sequence
from itertools import compress
from math import ceil
from typing import Any, NamedTuple

import msgspec
import numpy as np

from accpinn.evaluation.whiteness import CorrelatedResidual, ShortResidual
from accpinn.findings import all_of, capital, joined, percent, spelled, who
from accpinn.inference.answer import Answer
from accpinn.inference.identifiability import WIDE, wide_intervals
from accpinn.inference.intervals import SYMBOLS, Uncertainty
from accpinn.inference.model_adequacy import Adequacy
from accpinn.inference.prediction import GapBand
from accpinn.methods.estimate import Fit, Outcome
from accpinn.methods.maximum_likelihood import disturbance_sizes
from accpinn.model.registry import CTHPS, FOLLOWING, PAPER, TITLES, gains_and_gap
from accpinn.recordings import FLAGS
from accpinn.results.messages import incidents, messages
from accpinn.results.messages.answer import cards
from accpinn.results.messages.stability import headline
from accpinn.results.tables.estimates import name_of
from accpinn.results.vehicles import known_vehicles
from accpinn.segment import SegmentInfo
from accpinn.study.judge import LEAST_WINDOWS, Describes, Judgement
from accpinn.study.result import Result

CONVERGED = (Outcome.SOLVED, Outcome.CONVERGED, Outcome.FILTERED)
"""How an estimation ends that has come to its estimate."""


def about_band(result: Result) -> str:
    """What a predictive band is, and where it is not that of the answer's model."""
    model, answer = result.fit.model, result.known_answer
    simulated = TITLES[model] if model in CTHPS else f"linearisation of the {TITLES[model]}"
    said = (
        f"Band: the space-gaps that the {simulated} predicts from the leader's speed alone, with"
        " posterior samples of the parameters and random disturbances of the estimated size."
    )
    if answer and answer.model != model:
        said += f" The answer's model is another one: {TITLES[answer.model]}."
    return said


def about_own_estimate(result: Result) -> str:
    """What a method's own estimate is beside the answer, and of what the curves are."""
    windows, count = f"the window {result.info.window}", len(result.infos)
    curves = "The curves are the method's own, as the data are not at hand."
    if result.segments:
        curves = "The answer is simulated behind the measured vehicle ahead, the method's platoon"
        curves += " behind the measured leader."
    if count > 1:
        curves = f"The curves are those of {result.info.window}. {curves}"
        windows = f"the {count} windows"
    fitted = f"The {TITLES[result.fit.model]} fitted to {windows} alone"
    if not result.is_finished:
        return f"{fitted}; the training was stopped before its end. {curves}"
    return (
        f"{fitted}: unlike the answer's, its intervals leave out how much windows of a car differ."
        f" {curves}"
    )


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
    """The answer of each follower, with cautions before; without one the fit's own verdict."""
    info, subject, known = snapshot.info, known_vehicles(snapshot), snapshot.known_answer
    hand = info.driven_by_hand
    sentences = [hand.sentence(info) if hand else "", unfinished(snapshot.fit)]
    if known:
        sentences += [f"{card.lead} {card.trust}" for card in cards(info, known, subject)]
    elif subject.has_report:
        sentences.append(headline(subject))
    return tuple(sentence for sentence in sentences if sentence)


def unfinished(fit: Fit) -> str:
    """The warning beside parameters of a stopped training; empty for other fits."""
    if fit.outcome is not Outcome.STOPPED:
        return ""
    planned = fit.config.get("iterations")
    of_planned = f" of {planned:,}" if isinstance(planned, int) else ""
    return (
        f"Training was stopped at {fit.iterations:,}{of_planned} iterations; these parameters are"
        " preliminary."
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
    assumption = f"The method's estimates and intervals assume the {TITLES[result.fit.model]}."
    if result.fit.model != PAPER:
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


def agreement(rows: Sequence[Result], answer: Answer) -> str:
    """How many methods agree with the answer, which do not, and how far all are from it.

    It is empty where the answer is of no follower.
    """
    followers = [k for k, value in enumerate(answer.parameters.alpha) if not np.isnan(value)]
    if not followers:
        return ""
    spans = map(answer.gains_and_gap, range(len(answer.speeds)))
    value, lower, upper = np.array(
        [[(span.value, span.lower, span.upper) for span in row] for row in spans]
    ).T
    own = np.array(
        [gains_and_gap(row.fit.model, row.fit.parameters, answer.speeds).T for row in rows]
    )
    inside = ((own >= lower) & (own <= upper))[:, :, followers].all(axis=(1, 2))
    differing = [name_of(row.fit) for row, agrees in zip(rows, inside, strict=True) if not agrees]
    count, total = int(inside.sum()), len(rows)
    agree = "agrees" if count == 1 else "agree"
    some = f"{count} of {total} methods {agree}" if count else "No method agrees"
    within = f"within the {percent(answer.level)} intervals of α, β and time gap"
    within += " for every follower" if len(followers) > 1 else ""
    models = {row.fit.model for row, agrees in zip(rows, inside, strict=True) if not agrees}
    named = joined(differing)
    if len(differing) > 1 and models == {PAPER} != {answer.model}:
        alone = [row for row in rows if row.fit.model == PAPER]
        if len(alone) == len(differing):
            named = f"the {spelled(len(alone))} that estimate the CTHP alone"
            if count:
                methods = "one method" if count == 1 else f"{spelled(count)} methods"
                some = f"The {methods} with more than α, β and τ {agree}"
    other = f"; {named} {'does' if len(differing) == 1 else 'do'} not"
    other = other if differing and count else ""
    off = np.abs(own - value)[:, :, followers] / np.where(value > 0, value, np.nan)[:, followers]
    pairs = zip(off.max(axis=(0, 2)).tolist(), ("α", "β", "time gap"), strict=True)
    # Not a number where one is unknown, or the answer's is zero.
    away = joined([f"{ceil(100 * far)} % ({symbol})" for far, symbol in pairs if far < 1.0])
    size = f" All are within {away} of it." if away else ""
    alike = some if differing else "Every method agrees"
    return f"{alike} with the answer {within}{other}.{size}"


def about_curves(result: Result, follower: int, band: GapBand | None = None) -> tuple[str, ...]:
    """The coverage of a follower's band (0 for the first), and the size of its disturbance."""
    info, fit = result.info, result.fit
    vehicles = (0, info.vehicles[follower + 1])
    coverage = [f for f in (band.findings if band else ()) if f.vehicle in vehicles]
    sizes = [size for size in disturbance_sizes(info.vehicles, fit) if size.vehicle in vehicles]
    return messages((*coverage, *sizes), info)


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
    on_data = [finding for part in snapshot.infos for finding in part.findings]
    on_parameters = (
        *snapshot.fit.findings,
        *snapshot.uncertainty.findings,
        *snapshot.weaknesses,
        *snapshot.evaluation.whiteness.findings,
    )
    return {
        "data": tuple(dict.fromkeys(messages((*on_data, *snapshot.quality.findings), info))),
        "parameters": tuple(dict.fromkeys(messages(on_parameters, info))),
        "closed_loop": incidents(snapshot.evaluation, info),
    }


class Check(NamedTuple):
    """A question to be asked before a fit's numbers are quoted, and its answer."""

    title: str
    meaning: str
    passed: bool | None
    """None: it is not known."""
    why: tuple[str, ...]
    """What the answer rests on, in sentences."""


def checks(result: Result) -> tuple[Check, ...]:
    """All checks of a fit, in the order in which they are shown."""
    info, uncertainty, evaluation = result.info, result.uncertainty, result.evaluation
    is_determined = bool(np.isfinite(uncertainty.centre.alpha).all())
    are_inside, wide = bool(uncertainty.inside.all()), _wide(info, uncertainty)
    events, residual = incidents(evaluation, info), evaluation.whiteness.findings
    is_tested = bool(residual) and not any(isinstance(f, ShortResidual) for f in residual)
    is_correlated = any(isinstance(finding, CorrelatedResidual) for finding in residual)
    return (
        Check(
            "Converged",
            "Whether the estimate has stopped changing. Tab Training shows loss and parameters over"
            " iterations.",
            result.fit.outcome in CONVERGED,
            (result.fit.outcome.value,),
        ),
        Check(
            "Inside the interval",
            "Whether the estimates of α, β and τ lie inside their intervals, which stand beside"
            " them in the table of the method's estimates.",
            are_inside if is_determined or not are_inside else None,
            messages(uncertainty.findings, info),
        ),
        Check(
            "Identified",
            f"Whether the intervals of α, β and τ span less than a factor of {WIDE:g}. Page Compare"
            " shows the profiles of the loss.",
            not wide,
            wide,
        ),
        Check(
            "Simulated without collision",
            "Whether the closed-loop simulation behind the measured leader ends without a"
            " collision, reversing or divergence, in the window and outside it. The chart shows"
            " the window.",
            not events,
            events,
        ),
        Check(
            "Residual only noise",
            "Whether the model's residual is no more than noise. Page Compare shows forms of the"
            " model with a smaller residual.",
            False if is_correlated else True if is_tested else None,
            messages(residual, info),
        ),
    )


def _wide(info: SegmentInfo, uncertainty: Uncertainty) -> tuple[str, ...]:
    """For each follower the parameters with wide intervals, all where none is determined."""
    are_wide = wide_intervals(uncertainty) | np.isnan(uncertainty.centre.alpha)[:, None]
    pairs = zip(info.vehicles[1:], are_wide, strict=True)
    named = ((who(vehicle, info), tuple(compress(SYMBOLS, row))) for vehicle, row in pairs)
    return tuple(f"{label}: {joined(symbols)}." for label, symbols in named if symbols)
