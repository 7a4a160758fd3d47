"""A result in a few sentences: what was found, with its numbers and their uncertainty."""

from collections.abc import Sequence
from math import isfinite, isinf, isnan
from typing import Any

import numpy as np

from accpinn.errors import Finding
from accpinn.evaluation.evaluation import Evaluation
from accpinn.inference.identifiability import narrower_intervals, weakly_identified
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.results.messages import joined, message, messages, percent, probability
from accpinn.results.messages.data import FLAGS
from accpinn.results.messages.methods import unfinished
from accpinn.results.messages.stability import headline
from accpinn.results.tables.estimates import learned_parameters, supported_columns
from accpinn.results.tables.table import Column, between
from accpinn.study.result import Result


def title(snapshot: Result) -> str:
    """The user's name for the result, else what it is about."""
    verb = "follows" if snapshot.info.followers == 1 else "follow"
    return snapshot.name or f"How {_followers(snapshot)} {verb} the vehicle ahead"


def summary(snapshot: Result) -> tuple[str, ...]:
    """The answer first: headway and gains, string stability, and their uncertainty."""
    fit, info, uncertainty = snapshot.fit, snapshot.info, snapshot.uncertainty
    kind = METHODS[fit.method]
    method = kind.description or kind.title
    columns = supported_columns(uncertainty)
    who = _followers(snapshot)
    if info.shares(fit.case) or info.followers == 1:
        as_one = " as one set" if info.followers > 1 else ""
        headway = headway_words(uncertainty, 0)
        learned = f"{who}{as_one}: {_parameters(fit.parameters[0], headway, columns)}"
    else:
        learned = f"{who}: {_ranges(fit.parameters, info.labels[1:], columns)}"
    first = (
        f"From {info.window.duration:g} s of {info.source}, {method} learned the parameters of the"
        f" constant time-headway policy of {learned}."
    )
    hand = info.driven_by_hand
    sentences = [message(hand, info) if hand else "", unfinished(fit), first]
    if snapshot.stability and not unfinished(fit):
        chosen = learned_parameters(info, fit)
        sentences.append(headline(chosen, snapshot.stability, uncertainty))
    if uncertainty and not unfinished(fit):
        sentences.append(_outside(snapshot, uncertainty))
        sentences.append(_probability(uncertainty))
    if snapshot.evaluation:
        sentences += [
            _errors(snapshot, snapshot.evaluation),
            _collisions(snapshot, snapshot.evaluation),
        ]
    return tuple(sentence for sentence in sentences if sentence)


def _parameters(parameters: Parameters, headway: str, columns: Sequence[Column]) -> str:
    """Headway first, as drivers know it, with what stands in brackets behind it."""
    alpha, beta, _ = (
        f"{one.title} {one.shown(value)} {one.unit}"
        for one, value in zip(columns, parameters.values.tolist(), strict=True)
    )
    tau = f"{parameters.tau:.2f} s" if isfinite(parameters.tau) else "not determined"
    behind = f" ({headway})" if headway else ""
    return f"time headway τ {tau}{behind}, gains {alpha} and {beta}"


def _ranges(parameters: Parameters, labels: Sequence[str], columns: Sequence[Column]) -> str:
    """From the smallest to the largest of several followers; the table has each."""
    alpha, beta, tau = (
        f"{one.title} {_span([one.shown(value) for value in sorted(values)])} {one.unit}"
        if (values := found[np.isfinite(found)].tolist())
        else f"{one.title} not determined"
        for one, found in zip(columns, parameters.values.T, strict=True)
    )
    without = np.isnan(parameters.tau)
    if without.any() and not without.all():
        who = [label for label, one in zip(labels, without, strict=True) if one]
        tau += f" (not determined for {joined(who)})"
    return f"time headways {tau}, gains {alpha} and {beta}"


def _span(ordered: list[str]) -> str:
    """The first and the last, or one where they are the same; empty where there is none."""
    return " to ".join(dict.fromkeys(ordered[:1] + ordered[-1:]))


def headway_words(uncertainty: Uncertainty | None, follower: int) -> str:
    """The interval of τ; empty where there is none."""
    if uncertainty is None:
        return ""
    low, high = (ends[follower].tau for ends in (uncertainty.lower, uncertainty.upper))
    if isnan(low) or isnan(high):
        return ""
    interval = f"{percent(uncertainty.level)} interval"
    if isinf(high) and low < 0.005:
        return "not determined by the data"
    if isinf(high):
        return f"{interval}: {low:.2f} s or more"
    return f"{interval}: {between(low, high, 2)} s"


def _followers(snapshot: Result) -> str:
    labels = snapshot.info.labels[1:]
    return labels[0] if len(labels) == 1 else f"{len(labels)} vehicles"


def _outside(snapshot: Result, uncertainty: Uncertainty) -> str:
    """Whose estimates lie outside their intervals; empty where none does."""
    labels = snapshot.info.labels[1:]
    outside: list[bool] = np.any(~uncertainty.inside, axis=1).tolist()
    who = [label for label, yes in zip(labels, outside, strict=True) if yes]
    if not who:
        return ""
    return (
        f"Some estimates of {joined(who)} lie outside their {percent(uncertainty.level)} intervals;"
        " the notes on the parameters say why, and give those of maximum likelihood."
    )


def _probability(uncertainty: Uncertainty) -> str:
    """Of L∞ string stability; that of L₂ stands with the verdict."""
    known = uncertainty.probability_linf[np.isfinite(uncertainty.probability_linf)]
    if not len(known):
        return (
            "The data do not determine the parameters, so no probability of string stability is"
            " given."
        )
    shares = [probability(share) for share in sorted(known.tolist())]
    return f"Probability of L∞ string stability: {_span(shares)}."


def _errors(snapshot: Result, evaluation: Evaluation) -> str:
    if evaluation.closed_loop is None:
        return ""
    errors = [float(value) for value in evaluation.closed_loop.gap_mae]
    gaps = _span([f"{value:.1f}" for value in sorted(filter(isfinite, errors))])
    who = zip(snapshot.info.labels[1:], errors, strict=True)
    without = ", ".join(label for label, value in who if not isfinite(value))
    sentence = "The closed-loop simulation behind the measured leader"
    sentence += f" misses the space-gap by {gaps} m on average" if gaps else " diverges"
    if gaps and without:
        sentence += f" (without {without}, whose simulation diverges)"
    if evaluation.surrogate is None:
        return f"{sentence}."
    drawn = _span([f"{value:.2g}" for value in sorted(evaluation.surrogate.gap_mae)])
    curve = "the method's own curve misses the space-gap by"
    return f"{sentence}; {curve} {drawn} m (surrogate fit)."


def _collisions(snapshot: Result, evaluation: Evaluation) -> str:
    labels = snapshot.info.labels[1:]
    times = evaluation.collision_times(snapshot.info.vehicles).tolist()
    when = [(label, time) for label, time in zip(labels, times, strict=True) if isfinite(time)]
    if not when:
        return ""
    verb = "collides" if len(when) == 1 else "collide"
    what = f"{verb} with the vehicle ahead"
    if len(labels) == 1:
        return f"In that simulation the follower {what} at {when[0][1]:.1f} s."
    listed = "; ".join(f"{label} at {time:.1f} s" for label, time in when)
    return f"In that simulation {len(when)} of {len(labels)} vehicles {what}: {listed}."


def setting(value: Any) -> str:
    """A setting's value; several in a row."""
    if isinstance(value, list):
        return ", ".join(map(setting, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def about_data(snapshot: Result) -> tuple[tuple[str, str], ...]:
    """What is known of the recording and the window, as terms and descriptions."""
    info, facts = snapshot.info, snapshot.facts
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
        and f"{FLAGS.get(flag, flag)}, for the recording as a whole; not every vehicle need be"
        " driven so",
        "Distance setting": facts.get("distance_setting"),
        "Window": f"{info.window} of the recording,"
        f" {info.samples:,} samples every {info.sample_time:g} s",
        "Leader": info.labels[0],
        "Followers": ", ".join(info.labels[1:]),
        "Excluded": excluded,
    }
    return tuple((term, str(value)) for term, value in rows.items() if value)


def cautions(snapshot: Result) -> dict[str, tuple[str, ...]]:
    """Cautions, by the part of the report they belong to."""
    info, evaluation, uncertainty = snapshot.info, snapshot.evaluation, snapshot.uncertainty
    of_parameters = (
        *snapshot.fit.findings,
        *(uncertainty.findings if uncertainty else ()),
        *(_wide_intervals(snapshot, uncertainty) if uncertainty else ()),
        *(evaluation.whiteness.findings if evaluation else ()),
    )
    return {
        "data": messages((*info.findings, *snapshot.quality.findings), info),
        "parameters": tuple(dict.fromkeys(messages(of_parameters, info))),
        "closed_loop": messages(evaluation.all_findings if evaluation else (), info),
    }


def _wide_intervals(snapshot: Result, uncertainty: Uncertainty) -> tuple[Finding, ...]:
    """Which intervals are wide, and what would narrow them."""
    info = snapshot.info
    found = weakly_identified(info, snapshot.quality, uncertainty, snapshot.fit.case)
    cure = narrower_intervals(info, uncertainty, found, snapshot.facts.get("duration"))
    return (*found, *cure)
