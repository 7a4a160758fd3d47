"""Sentences about methods: how their estimations ended, what they found, whether they agree."""

from collections.abc import Sequence

import numpy as np

from accpinn.inference.identifiability import wide_intervals
from accpinn.methods import fit as found
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.results.messages import Labelled, joined, message, percent
from accpinn.results.tables.estimates import PARAMETER_COLUMNS, name_of
from accpinn.segment.segment import SegmentInfo
from accpinn.study.result import Result
from accpinn.units import FloatArray

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
def _(finding: found.MethodFinding, about: Labelled) -> str:
    match finding:
        case found.BoundActive():
            free = Parameters.from_theta(finding.unconstrained)
            return (
                f"{about.label(finding.vehicle)}: the rational driving constraints hold"
                f" {' and '.join(finding.names)} at zero; without them the estimate is"
                f" α = {free.alpha:.4f}, β = {free.beta:.4f}, τ = {free.tau:.3f}, which suggests a"
                " delay or a model that does not fit."
            )
        case found.BoundActiveAtTimes():
            return (
                f"{about.label(finding.vehicle)}: {finding.name} was at its bound, zero, for"
                f" {percent(finding.share)} of the time that the parameters are averaged over."
            )
        case found.LongHeadway():
            return (
                f"{about.label(finding.vehicle)}: the window does not determine the time headway"
                f" (τ = {finding.tau:.1f} s, α = {finding.alpha:.4f} 1/s²), as the gain on spacing"
                " is too small."
            )
        case found.WeaklyDetermined():
            vehicle = finding.vehicle
            whose = "All followers" if vehicle is None else about.label(vehicle)
            return (
                f"{whose}: the recording does not determine α, β and τ; these parameters are one"
                " possibility of many."
            )
        case found.FilterUncertain():
            return (
                f"{about.label(finding.vehicle)}: {finding.name} = {finding.value:.4f} has a"
                f" standard deviation of {finding.deviation:.4f} in the filter, so it is not"
                " significantly different from zero."
            )
        case found.FilterDiverged():
            return (
                f"{about.source}: the filter diverged, as speeds and space-gaps jump by more than"
                " vehicles can; choose another window."
            )
        case found.SimulatedSeparately():
            return (
                "Each follower is fitted behind its measured predecessor; in a simulation of the"
                " platoon behind its leader alone, the errors of the vehicles ahead add up."
            )
        case found.SimulatedInStretches():
            return (
                "Instants left out were not simulated during the fit: each stretch between them"
                " starts anew from its measured state, and stretches shorter than"
                f" {finding.least:g} s are left out too."
            )
        case found.HiddenLayersGain():
            before, after = finding.before, finding.after
            gain = 1 - after / before
            if gain >= LITTLE_GAIN:
                return (
                    f"Training the hidden layers lowered Ψ from {before:#.3g} to {after:#.3g}"
                    f" ({percent(gain)} lower)."
                )
            return (
                f"Training the hidden layers contributed little: Ψ was {before:#.4g} before and is"
                f" {after:#.4g} now; the exact solve determined the result."
            )
        case found.IterationsExhausted():
            return (
                f"Ψ or a parameter was still changing when the {finding.iterations:,} planned"
                " iterations ended; more iterations, or other initial values, may improve the"
                " result."
            )
        case found.HoldoutLoss():
            return (
                f"{finding.instants} random instants were kept out of training; there Ψ_D is"
                f" {finding.data:#.4g} and Ψ_F {finding.physics:#.4g}, which is optimistic, as"
                " neighbouring instants are nearly equal."
            )
        case found.Continued():
            return f"Continued from iteration {finding.iteration:,} of an earlier training."
        case found.StartedFrom():
            return f"Started from the weights of {finding.origin}."
        case found.CacheProblem():
            return finding.sentence


def agreement(rows: Sequence[Result], k: int) -> str:
    """Whether the methods' estimates lie within the intervals, and which differ most.

    Args:
        rows: the methods'.
        k: 0 for the first follower; in Case I, where all share one parameter set, 0.
    """
    uncertainty, names = rows[0].uncertainty, [name_of(row.fit) for row in rows]
    estimates = np.array([row.fit.parameters.values[k] for row in rows])
    lower, upper = uncertainty.lower[k].values, uncertainty.upper[k].values
    if np.isnan(lower).all():
        return "the data determine no parameter that the methods could be compared with."
    level = f"{percent(uncertainty.level)} intervals"
    outside = []
    for column, values, low, high in zip(PARAMETER_COLUMNS, estimates.T, lower, upper, strict=True):
        beyond = [
            f"too {side} for {_listed(names, where.tolist())}"
            for where, side in ((values < low, "low"), (values > high, "high"))
            if where.any()
        ]
        outside += [f"{column.title} is {' and '.join(beyond)}"] if beyond else []
    if outside:
        said = f"no: by the {level}, {'; '.join(outside)}."
    else:
        wide = [quantity.symbol for quantity in wide_intervals(uncertainty, k)]
        which, are = ("that of", "is") if len(wide) == 1 else ("those of", "are")
        reserve = f", but {which} {joined(wide)} {are} too wide to mean much" if wide else ""
        said = f"yes, all estimates lie within the {level}{reserve}."
    return f"{said} {_largest_difference(estimates)}".rstrip()


def _largest_difference(estimates: FloatArray) -> str:
    """The parameter whose estimates (R, 3) differ most; empty for one method."""
    if len(estimates) < 2:
        return ""
    relative = []
    for values in estimates.T:
        known = values[np.isfinite(values)]
        mean = known.mean() if len(known) else 0.0
        relative.append(np.ptp(known) / mean if mean > 0 else 0.0)
    which = int(np.argmax(relative))
    column, values = PARAMETER_COLUMNS[which], estimates[:, which]
    low, high = column.shown(float(np.nanmin(values))), column.shown(float(np.nanmax(values)))
    if low == high:
        return "All estimates are the same."
    return f"The estimates differ most in {column.title}: {low} to {high} {column.unit}."


def colliding_methods(info: SegmentInfo, rows: Sequence[Result]) -> tuple[str, ...]:
    """For each follower that collides in a closed-loop simulation, by whose parameters it does."""
    names = [name_of(row.fit) for row in rows]
    times = [row.evaluation.collision_times(info.vehicles) for row in rows]
    return tuple(
        f"{label}, with the parameters of {_listed(names, by.tolist())}."
        for label, by in zip(info.labels[1:], np.isfinite(times).T, strict=True)
        if by.any()
    )


def _listed(names: Sequence[str], which: Sequence[bool]) -> str:
    """Those of the methods that are marked, at least one, by the shorter of two ways."""
    marked = [name for name, yes in zip(names, which, strict=True) if yes]
    others = [name for name, yes in zip(names, which, strict=True) if not yes]
    if not others:
        return "every method" if len(names) > 1 else names[0]
    return f"all methods but {joined(others)}" if len(others) < len(marked) else joined(marked)
