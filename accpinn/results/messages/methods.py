"""Sentences about estimations: how they ended, and what they found."""

from accpinn.methods.fit import (
    BoundActive,
    BoundActiveAtTimes,
    CacheProblem,
    Continued,
    FilterDiverged,
    FilterUncertain,
    Fit,
    HiddenLayersGain,
    HoldoutLoss,
    IterationsExhausted,
    LongHeadway,
    Outcome,
    SimulatedInStretches,
    SimulatedSeparately,
    StartedFrom,
    WeaklyDetermined,
)
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.results.messages import Labelled, message

LITTLE_GAIN = 0.02
"""A smaller share by which Ψ fell is called little."""

_OUTCOMES = {
    Outcome.SOLVED: "Solved: no change of the estimate improves its criterion.",
    Outcome.CONVERGED: (
        "Converged: the best of several starts is kept; no small change of the parameters improves"
        " it."
    ),
    Outcome.FILTERED: "Filtered: every instant was processed once, in the order of time.",
    Outcome.FINISHED: "Finished: all planned iterations were run.",
    Outcome.STOPPED: (
        "Stopped by the user: the parameters are those of the last iteration; continue to go on."
    ),
    Outcome.DIVERGED: (
        "Diverged: the numbers are no longer finite; choose another window, or train with a lower"
        " learning rate or from other initial values."
    ),
}
_TRAINING_CONVERGED = (
    "Converged: twice in a row, 50 iterations moved no parameter by more than 0.1 % and lowered"
    " Ψ by less than 1 %, so training ended early."
)


def outcome_message(fit: Fit) -> str:
    """How an estimation ended."""
    if fit.outcome is Outcome.CONVERGED and METHODS[fit.method].is_iterative:
        return _TRAINING_CONVERGED
    return _OUTCOMES[fit.outcome]


def unfinished(fit: Fit) -> str:
    """The warning wherever parameters of a stopped training are used; empty for others."""
    if fit.outcome is not Outcome.STOPPED:
        return ""
    planned = fit.config.get("iterations")
    of = f" of {planned:,}" if isinstance(planned, int) else ""
    return (
        f"Training was stopped at {fit.iterations:,}{of} iterations; these parameters are"
        " preliminary."
    )


@message.register
def _(finding: BoundActive, about: Labelled) -> str:
    free = Parameters.from_theta(finding.unconstrained)
    return (
        f"{about.label(finding.vehicle)}: the rational driving constraints hold"
        f" {' and '.join(finding.names)} at zero; without them the estimate is"
        f" α = {free.alpha:.4f}, β = {free.beta:.4f}, τ = {free.tau:.3f}, which suggests a delay or"
        " a model that does not fit."
    )


@message.register
def _(finding: BoundActiveAtTimes, about: Labelled) -> str:
    return (
        f"{about.label(finding.vehicle)}: {finding.name} was at its bound, zero, for"
        f" {100 * finding.share:.0f} % of the time that the parameters are averaged over."
    )


@message.register
def _(finding: LongHeadway, about: Labelled) -> str:
    return (
        f"{about.label(finding.vehicle)}: the window does not determine the time headway"
        f" (τ = {finding.tau:.1f} s, α = {finding.alpha:.4f} 1/s²), as the gain on spacing is"
        " too small."
    )


@message.register
def _(finding: WeaklyDetermined, about: Labelled) -> str:
    whose = "All followers" if finding.vehicle is None else about.label(finding.vehicle)
    return (
        f"{whose}: the recording does not determine α, β and τ; these parameters are one"
        " possibility of many."
    )


@message.register
def _(finding: FilterUncertain, about: Labelled) -> str:
    return (
        f"{about.label(finding.vehicle)}: {finding.name} = {finding.value:.4f} has a standard"
        f" deviation of {finding.deviation:.4f} in the filter, so it is not significantly different"
        " from zero."
    )


@message.register
def _(finding: FilterDiverged, about: Labelled) -> str:
    return (
        f"{about.source}: the filter diverged, as speeds and space-gaps jump by more than vehicles"
        " can; choose another window."
    )


@message.register
def _(finding: SimulatedSeparately, about: Labelled) -> str:
    return (
        "Each follower is fitted behind its measured predecessor; in a simulation of the platoon"
        " behind its leader alone, the errors of the vehicles ahead add up."
    )


@message.register
def _(finding: SimulatedInStretches, about: Labelled) -> str:
    return (
        "Instants left out were not simulated during the fit: each stretch between them starts anew"
        f" from its measured state, and stretches shorter than {finding.least:g} s are left out"
        " too."
    )


@message.register
def _(finding: HiddenLayersGain, about: Labelled) -> str:
    gain = 1 - finding.after / finding.before
    if gain >= LITTLE_GAIN:
        return (
            f"Training the hidden layers lowered Ψ from {finding.before:#.3g} to"
            f" {finding.after:#.3g} ({100 * gain:.0f} % lower)."
        )
    return (
        f"Training the hidden layers contributed little: Ψ was {finding.before:#.4g} before and is"
        f" {finding.after:#.4g} now; the exact solve determined the result."
    )


@message.register
def _(finding: IterationsExhausted, about: Labelled) -> str:
    return (
        f"Ψ or a parameter was still changing when the {finding.iterations:,} planned iterations"
        " ended; more iterations, or other initial values, may improve the result."
    )


@message.register
def _(finding: HoldoutLoss, about: Labelled) -> str:
    return (
        f"{finding.instants} random instants were kept out of training; there Ψ_D is"
        f" {finding.data:,.4f} and Ψ_F {finding.physics:,.4f}, which is optimistic, as neighbouring"
        " instants are nearly equal."
    )


@message.register
def _(finding: Continued, about: Labelled) -> str:
    return f"Continued from iteration {finding.iteration:,} of an earlier training."


@message.register
def _(finding: StartedFrom, about: Labelled) -> str:
    return f"Started from the weights of {finding.origin}."


@message.register
def _(finding: CacheProblem, about: Labelled) -> str:
    return finding.sentence
