"""A result in a few sentences, what its numbers assume, and the checks and cautions about it."""

from collections.abc import Sequence
from math import ceil
from typing import Any

import msgspec
import numpy as np

from accpinn.findings import Finding, all_of, capital, joined, percent, who
from accpinn.inference.model_adequacy import Adequacy
from accpinn.methods.estimate import Estimate, Outcome
from accpinn.methods.registry import recommended_method
from accpinn.model.registry import FOLLOWING, PAPER, TITLES, gains_and_gap
from accpinn.recordings import FLAGS
from accpinn.results.messages import messages
from accpinn.results.messages.estimate import about_curves as about_curves
from accpinn.results.messages.estimate import cards
from accpinn.results.naming import name_of
from accpinn.results.tables.estimates import COMPARED, outside_interval
from accpinn.study.judge import LEAST_WINDOWS, Describes, Judgement
from accpinn.study.result import Result


def equation(model: str) -> tuple[str, str]:
    """A model's name and equation of motion, and its symbols."""
    following = FOLLOWING[model]
    symbols = joined([parameter.heading for parameter in following.parameters])
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
    return (*preliminary(snapshot), *(f"{card.lead} {card.trust}" for card in cards(snapshot)))


def preliminary(snapshot: Result) -> tuple[str, ...]:
    """What is to be read before any number: who is driven by hand, and a training that stopped."""
    hand = snapshot.info.driven_by_hand
    sentences = (hand.sentence(snapshot.info) if hand else "", unfinished(snapshot.estimate))
    return tuple(filter(None, sentences))


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


def best_models(judgements: Sequence[Judgement]) -> str:
    """How many followers each model predicts best, and for how many that is certain."""
    best: dict[str, int] = {}
    for judged in judgements:
        title = judged.ranked[0].model.title
        best[title] = best.get(title, 0) + 1
    total, clear = len(judgements), sum(judged.is_clear for judged in judgements)
    certain = "" if clear == total else " (perhaps by chance)" if not clear else (
        f" (clearly for {clear} of them)"
    )  # fmt: skip
    if len(best) == 1:
        cars = "this car" if total == 1 else f"all {total} cars"
        return f"The {next(iter(best))} predicts {cars} best{certain}."
    counts = sorted(best.items(), key=lambda item: -item[1])
    named = joined([f"{count} of {total} cars by the {title}" for title, count in counts])
    return f"Best predicted: {named}{certain}."


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


def agreement(rows: Sequence[Result], recommended: Result) -> tuple[str, str]:
    """How many methods agree with the recommended estimate; then which do not, and how far off.

    The recommended one is not counted. Both are empty where nothing is determined, or nothing else
    is compared.
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
        return "", ""
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
    others = f"{joined(differing)} {'does' if len(differing) == 1 else 'do'} not."
    others = others if differing and count else ""
    own = np.array([gains_and_gap(e.model, e.parameters, estimate.speeds) for e in found])
    off = np.abs(own - value)[:, followers] / np.where(value > 0, value, np.nan)[followers]
    pairs = zip(off.max(axis=(0, 1)).tolist(), COMPARED, strict=True)
    # Not a number where one is unknown, or the recommended one's is zero.
    away = joined([f"{ceil(100 * far)} % ({symbol})" for far, symbol in pairs if far < 1.0])
    size = f"All are within {away} of it." if away else ""
    alike = some if differing else "Every method agrees"
    more = " ".join(filter(None, (others, size)))
    return f"{alike} with the recommended estimate {within}.", more


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


def cautions(snapshot: Result) -> tuple[str, ...]:
    """What the data of the windows should be read with, each sentence once."""
    found: list[Finding] = [finding for part in snapshot.infos for finding in part.findings]
    found += [finding for quality in snapshot.qualities for finding in quality.findings]
    return tuple(dict.fromkeys(messages(found, snapshot.info)))
