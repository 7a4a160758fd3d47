"""Sentences about uncertainty, identifiability, model adequacy and multistart."""

from collections.abc import Sequence

from accpinn.channels import PARAMETERS
from accpinn.inference.identifiability import WIDE, WeakIdentification
from accpinn.inference.intervals import (
    Cause,
    NegativeEstimate,
    NotDetermined,
    OutsideInterval,
    ParameterInterval,
    ShortWindow,
)
from accpinn.inference.model_adequacy import DELAY_STEP, LONGEST_DELAY, BetterForm
from accpinn.inference.multistart import NOTICED, SpreadUndetermined, TrainingSpread
from accpinn.inference.sampling import FEWEST_BLOCKS, SHORTEST_BLOCK
from accpinn.results.messages import Labelled, message

QUANTITIES = {one.symbol: one for one in PARAMETERS}
BIAS = "disturbances to which the vehicle itself responds can bias such estimates"
CAUSES: dict[Cause, str] = {
    "disturbances": BIAS,
    "unfinished": f"more iterations may change it, or {BIAS}",
    "stopped": "training was stopped before its end",
    "diverged": "training diverged",
}
MORE_MOTION = "choose a window in which the vehicle ahead brakes and accelerates more"
MORE_TIME = "the vehicle ahead moves enough here, so choose a longer window if there is one"


@message.register
def _(finding: ShortWindow, about: Labelled) -> str:
    return (
        f"The window is only {finding.duration:.0f} s long, so the intervals rest on"
        f" {FEWEST_BLOCKS} blocks of {finding.block:.0f} s and are rough; choose"
        f" {FEWEST_BLOCKS * SHORTEST_BLOCK:.0f} s or more."
    )


@message.register
def _(finding: NotDetermined, about: Labelled) -> str:
    return (
        f"{_who(finding.vehicle, about)}: the speed of the vehicle ahead varies too little for"
        " these data to determine any of α, β and τ; choose a window in which it brakes and"
        " accelerates."
    )


@message.register
def _(finding: NegativeEstimate, about: Labelled) -> str:
    return (
        f"{_who(finding.vehicle, about)}: the data ask for {finding.symbol} < 0, which the rational"
        f" driving constraints exclude, so its interval is 0 alone; this indicates that the model"
        f" does not fit here, rather than that {finding.symbol} = 0."
    )


@message.register
def _(finding: OutsideInterval, about: Labelled) -> str:
    estimates = " and ".join(_estimate(one) for one in finding.parameters)
    lies = "lies" if len(finding.parameters) == 1 else "lie"
    return (
        f"{_who(finding.vehicle, about)}: the estimate's {estimates} {lies} outside the interval;"
        f" {CAUSES[finding.cause]}."
    )


@message.register
def _(finding: WeakIdentification, about: Labelled) -> str:
    who, reasons = _who(finding.vehicle, about), _reasons(finding)
    because = f", as {joined(reasons)}" if reasons else ""
    if not finding.wide:
        return f"{who}: treat the intervals with caution{because}."
    cure = MORE_MOTION if reasons else MORE_TIME
    return (
        f"{who}: the intervals of {joined([_wide(one) for one in finding.wide])} span more than a"
        f" factor of {WIDE:g}{because}; {cure}."
    )


@message.register
def _(finding: BetterForm, about: Labelled) -> str:
    return (
        f"{about.label(finding.vehicle)}: with {_extra(finding)} the model explains"
        f" {100 * finding.holdout:.0f} % of the acceleration in held-out seconds, instead of"
        f" {100 * finding.cthp_holdout:.0f} %; α, β, τ are then {finding.alpha:.4f},"
        f" {finding.beta:.4f}, {finding.tau:.3f}."
    )


@message.register
def _(finding: TrainingSpread, about: Labelled) -> str:
    if finding.largest <= NOTICED:
        where = "" if finding.every else " in the parameters that all of them determine"
        end = f"{max(finding.largest, 0.01):.2g} %"
        return f"All {finding.trainings} trainings end within {end} of each other{where}."
    why = (
        f"; {finding.unconverged} of them had not converged when their iterations were over, so"
        " more iterations may bring them together"
        if finding.unconverged
        else ""
    )
    return (
        f"The {finding.trainings} trainings end up to {finding.largest:.0f} % apart{why}. No single"
        " one of them should be quoted alone."
    )


@message.register
def _(finding: SpreadUndetermined, about: Labelled) -> str:
    who = "all followers" if finding.vehicle == 0 else about.label(finding.vehicle)
    return (
        f"{finding.symbol} of {who} is undetermined in {finding.count} of {finding.trainings}"
        " trainings, so it has no spread."
    )


def joined(parts: Sequence[str]) -> str:
    """A list as a sentence has it: "α, β and τ"."""
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def _who(vehicle: int, about: Labelled) -> str:
    return about.label(vehicle) if vehicle else "All followers together"


def _estimate(one: ParameterInterval) -> str:
    text = QUANTITIES[one.symbol].text
    value = "undetermined" if one.estimate is None else text(one.estimate)
    upper = "no limit" if one.upper is None else text(one.upper)
    return f"{one.symbol} = {value} (interval {text(one.lower)} to {upper})"


def _wide(one: ParameterInterval) -> str:
    text = QUANTITIES[one.symbol].text
    end = "or more" if one.upper is None else f"to {text(one.upper)}"
    return f"{one.symbol} ({text(one.lower)} {end})"


def _reasons(finding: WeakIdentification) -> list[str]:
    reasons = []
    if finding.leader_deviation is not None:
        reasons.append(f"the leader's speed varies by only {finding.leader_deviation:.2f} m/s")
    if finding.relative_deviation is not None:
        reasons.append(f"Δv varies by only {finding.relative_deviation:.2f} m/s")
    if finding.condition is not None:
        number = f"condition number {finding.condition:.0f}"
        reasons.append(f"the model's terms are nearly proportional ({number})")
    return reasons


def _extra(finding: BetterForm) -> str:
    if finding.form == "delay":
        longest = finding.extra > LONGEST_DELAY - DELAY_STEP / 2
        return f"a delay of {finding.extra:.1f} s{', the longest tried,' if longest else ''}"
    return f"a distance of {finding.extra:.1f} m at standstill"
