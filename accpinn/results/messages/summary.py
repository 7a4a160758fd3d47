"""A result in a few sentences: what was found, with its numbers and their uncertainty."""

from math import isfinite, isinf, isnan
from typing import Any

from accpinn.inference.intervals import Uncertainty
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.results.messages import messages
from accpinn.results.messages.methods import unfinished
from accpinn.results.messages.stability import amplification
from accpinn.results.snapshot import Snapshot
from accpinn.results.tables.estimates import learned_parameters
from accpinn.results.tables.table import between

FLAGS = {0: "human drivers", 1: "ACC", 2: "mixed"}
"""Of the whole recording; it does not say which vehicle was driven by whom."""


def title(snapshot: Snapshot) -> str:
    """The user's name for the result, else what it is about."""
    verb = "follows" if snapshot.info.followers == 1 else "follow"
    return snapshot.name or f"How {_followers(snapshot)} {verb} the vehicle ahead"


def summary(snapshot: Snapshot) -> tuple[str, ...]:
    """The answer first: headway and gains, string stability, and their uncertainty."""
    fit, info, uncertainty = snapshot.fit, snapshot.info, snapshot.uncertainty
    kind = METHODS[fit.method]
    method = kind.description or kind.title
    opening = (
        f"From {info.window.duration:g} s of {info.source}, {method} learned the parameters"
        " of the constant time-headway policy of"
    )
    if fit.case == "I" and info.followers > 1:
        estimate = parameter_words(fit.parameters[0], headway_words(uncertainty, 0))
        first = f"{opening} {_followers(snapshot)} as one set: {estimate}."
    elif info.followers == 1:
        estimate = parameter_words(fit.parameters[0], headway_words(uncertainty, 0))
        first = f"{opening} {info.labels[1]}: {estimate}."
    else:
        estimates = "; ".join(
            f"{label}: {parameter_words(one, headway_words(uncertainty, k))}"
            for k, (label, one) in enumerate(zip(info.labels[1:], fit.parameters, strict=True))
        )
        first = f"{opening} {_followers(snapshot)}. {estimates}."
    stopped = unfinished(fit)
    return (*((stopped,) if stopped else ()), first, *_consequences(snapshot))


def parameter_words(parameters: Parameters, headway: str = "") -> str:
    """Headway first, as drivers know it, with what stands in brackets behind it."""
    tau = f"{parameters.tau:.2f} s" if isfinite(parameters.tau) else "not determined"
    behind = f" ({headway})" if headway else ""
    gains = f"gains α {parameters.alpha:.4f} 1/s² and β {parameters.beta:.4f} 1/s"
    return f"time headway τ {tau}{behind}, {gains}"


def headway_words(uncertainty: Uncertainty | None, follower: int) -> str:
    """The interval of τ; empty where there is none."""
    if uncertainty is None:
        return ""
    low, high = (ends[follower].tau for ends in (uncertainty.lower, uncertainty.upper))
    if isnan(low) or isnan(high):
        return ""
    percent = f"{100 * uncertainty.level:.0f} % interval"
    if isinf(high) and low < 0.005:
        return "not determined by the data"
    if isinf(high):
        return f"{percent}: {low:.2f} s or more"
    return f"{percent}: {between(low, high, 2)} s"


def _followers(snapshot: Snapshot) -> str:
    labels = snapshot.info.labels[1:]
    return labels[0] if len(labels) == 1 else f"{len(labels)} vehicles"


def _consequences(snapshot: Snapshot) -> tuple[str, ...]:
    sentences = []
    if snapshot.stability:
        chosen = learned_parameters(snapshot.info, snapshot.fit)
        sentences.append(amplification(chosen, snapshot.stability))
    if snapshot.uncertainty:
        sentences.append(_probability(snapshot, snapshot.uncertainty))
    sentences += [_errors(snapshot), _collisions(snapshot)]
    return tuple(sentence for sentence in sentences if sentence)


def _probability(snapshot: Snapshot, uncertainty: Uncertainty) -> str:
    labels = snapshot.info.labels[1:]
    parts = [
        f"{label} {100 * float(l2):.0f} % (L₂) and {100 * float(linf):.0f} % (L∞)"
        for label, l2, linf in zip(
            labels, uncertainty.probability_l2, uncertainty.probability_linf, strict=True
        )
        if isfinite(float(l2))
    ]
    if not parts:
        return (
            "The data do not determine the parameters, so no probability of string stability is"
            " given."
        )
    return f"Probability of string stability: {'; '.join(parts)}."


def _errors(snapshot: Snapshot) -> str:
    evaluation = snapshot.evaluation
    if evaluation is None or evaluation.closed_loop is None:
        return ""
    errors = [float(value) for value in evaluation.closed_loop.gap_mae]
    gaps = ", ".join(f"{value:.1f}" for value in errors if isfinite(value))
    who = zip(snapshot.info.labels[1:], errors, strict=True)
    without = ", ".join(label for label, value in who if not isfinite(value))
    sentence = (
        f"The closed-loop simulation behind the measured leader misses the space-gap by {gaps} m on"
        " average"
    )
    if not gaps:
        sentence = "The closed-loop simulation behind the measured leader diverges"
    elif without:
        sentence += f" (without {without}, whose simulation diverges)"
    if evaluation.surrogate is None:
        return f"{sentence}."
    drawn = ", ".join(f"{value:.2f}" for value in evaluation.surrogate.gap_mae)
    curve = "the method's own curve misses the space-gap by"
    return f"{sentence}; {curve} {drawn} m (surrogate fit)."


def _collisions(snapshot: Snapshot) -> str:
    evaluation, labels = snapshot.evaluation, snapshot.info.labels[1:]
    if evaluation is None:
        return ""
    times = evaluation.collision_times(snapshot.info.vehicles).tolist()
    when = [(k, time) for k, time in enumerate(times) if isfinite(time)]
    if not when:
        return ""
    who, times = "the follower", f" at {when[0][1]:.1f} s"
    if len(labels) > 1:
        who = f"{len(when)} of {len(labels)} vehicles"
        times = ": " + "; ".join(f"{labels[k]} at {time:.1f} s" for k, time in when)
    verb = "collides" if len(when) == 1 else "collide"
    return f"In that simulation {who} {verb} with the vehicle ahead{times}."


def setting(value: Any) -> str:
    """A setting's value; several in a row."""
    if isinstance(value, list):
        return ", ".join(map(setting, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def about_data(snapshot: Snapshot) -> tuple[tuple[str, str], ...]:
    """What is known of the recording and the window, as terms and descriptions."""
    info, facts = snapshot.info, snapshot.facts
    rows = [
        ("Recording", info.source),
        ("Campaign", facts.get("campaign")),
        ("Date", facts.get("date")),
        ("ACC flag of the file", _flag(facts.get("acc_flag"))),
        ("Distance setting", facts.get("distance_setting")),
        (
            "Window",
            f"{info.window} of the recording,"
            f" {info.samples:,} samples every {info.sample_time:g} s",
        ),
        ("Leader", info.labels[0]),
        ("Followers", ", ".join(info.labels[1:])),
        ("Excluded", _excluded(snapshot)),
    ]
    return tuple((term, str(value)) for term, value in rows if value)


def _flag(flag: int | None) -> str:
    """As the file's header has it."""
    if flag is None:
        return ""
    meaning = f" ({FLAGS[flag]})" if flag in FLAGS else ""
    return f"{flag}{meaning}, for the recording as a whole; not every vehicle need be driven so"


def _excluded(snapshot: Snapshot) -> str:
    info = snapshot.info
    if not info.excluded_regimes:
        return "nothing: every instant counts"
    shares = ", ".join(
        f"{100 * share:.0f} % of {label}"
        for label, share in zip(info.labels[1:], info.excluded_share, strict=True)
    )
    return f"{', '.join(info.excluded_regimes)} from the model's equation: {shares}"


def cautions(snapshot: Snapshot) -> dict[str, tuple[str, ...]]:
    """Cautions, by the part of the report they belong to."""
    info, evaluation, uncertainty = snapshot.info, snapshot.evaluation, snapshot.uncertainty
    return {
        "data": messages((*snapshot.info.findings, *snapshot.quality.findings), snapshot.info),
        "parameters": tuple(
            dict.fromkeys(
                (
                    *messages(snapshot.fit.findings, info),
                    *messages(uncertainty.findings if uncertainty else (), info),
                    *messages(evaluation.whiteness.findings if evaluation else (), info),
                )
            )
        ),
        "closed_loop": messages(evaluation.all_findings if evaluation else (), info),
    }
