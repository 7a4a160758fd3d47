"""What every estimation method returns: one `Fit`, read by pages, command line and snapshots."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from accpinn.model.cthp import Case, Parameters, PlatoonSolution, Trajectories
from accpinn.serial import NamedEnum
from accpinn.units import FloatArray, Seconds


class Outcome(NamedEnum):
    """How an estimation ended, as the sentence the user reads."""

    SOLVED = "Solved: no change of the estimate improves its criterion."
    CONVERGED = (
        "Converged: the best of several starts is kept; no small change of the parameters improves"
        " it."
    )
    FILTERED = "Filtered: every instant was taken in once, in the order of time."
    SETTLED = (
        "Settled: twice in a row, 50 iterations moved no parameter by more than 0.1 % and lowered"
        " Ψ by less than 1 %, so training ended early."
    )
    FINISHED = "Finished: all planned iterations were run."
    STOPPED = (
        "Stopped by the user: the parameters are those of the last iteration; continue to go on."
    )
    DIVERGED = (
        "Diverged: the numbers are no longer finite; choose another window, or train with a lower"
        " learning rate or from other initial values."
    )


LONGEST_HEADWAY: Seconds = 5.0
"""No cruise control keeps a longer one: their settings end near 3 s."""


@dataclass(frozen=True, eq=False)
class History:
    """How loss and parameters moved; K kept entries, oldest first."""

    iteration: FloatArray
    """(K,)"""
    seconds: FloatArray
    """(K,) since training began, without pauses."""
    total: FloatArray
    """(K,) Ψ, the weighted sum of the terms below."""
    data: FloatArray
    """(K,) Ψ_D."""
    physics: FloatArray
    """(K,) Ψ_F."""
    initial: FloatArray
    """(K,) Ψ_R, zero where the term is not used."""
    parameters: FloatArray
    """(K, P, 3): α, β, τ; P = 1 in Case I, M in Case II."""


@dataclass(frozen=True, eq=False)
class ParameterTrack:
    """Parameters over time, as an online method followed them; K instants."""

    time: FloatArray
    """(K,) in s from the segment's start."""
    parameters: FloatArray
    """(K, M, 3): α, β, τ per follower; nan where the method cannot tell yet."""
    deviation: FloatArray | None = None
    """(K, M, 3): the method's own standard deviations, where it has them."""


@dataclass(frozen=True, eq=False)
class Progress:
    """One moment of a running estimation, handed to whoever watches."""

    phase: str
    """What runs: "start", "Adam", "L-BFGS", ..."""
    iteration: int
    iterations: int
    """How many are planned at most."""
    seconds: Seconds
    total: float
    data: float
    physics: float
    initial: float
    parameters: FloatArray
    """(P, 3): α, β, τ."""


OnProgress = Callable[[Progress], None]
ShouldStop = Callable[[], bool]


@dataclass(frozen=True, eq=False)
class Fit:
    """The learned parameters of a segment, and how they came about."""

    method: str
    case: Case
    parameters: Parameters
    """One entry a follower, also in Case I, where all are the same."""
    surrogate: Trajectories | None
    """What the method takes the true motion to be, on the segment's instants."""
    outcome: Outcome
    seconds: Seconds
    """Time the estimation took; unchanged when the result comes from the cache."""
    config: dict[str, Any]
    """Every setting that determined the result, ready for JSON."""
    loss: dict[str, float] = field(default_factory=dict)
    """"total", "data", "physics", and for a network also "initial" and what it started from."""
    unconstrained: Parameters | None = None
    """The optimum without the rational driving constraints; as `parameters` when none binds."""
    active_bounds: tuple[tuple[str, ...], ...] = ()
    """Per follower, which of α, ατ, β stand at zero only because of the constraints."""
    history: History | None = None
    track: ParameterTrack | None = None
    """What an online method estimated at each instant; None for batch methods."""
    iterations: int = 0
    network_weights: int = 0
    cached: bool = False
    notes: tuple[str, ...] = ()
    """What the user should know about this result, in plain sentences."""
    arrays: dict[str, FloatArray] = field(default_factory=dict)
    """The method's own state by name (a network's weights), enough to continue or to share."""


def unfinished(fit: Fit) -> str:
    """What to say wherever the parameters of a stopped training are used; empty for others."""
    if fit.outcome is not Outcome.STOPPED:
        return ""
    planned = fit.config.get("iterations")
    of = f" of {planned:,}" if isinstance(planned, int) else ""
    return (
        f"Training was stopped at {fit.iterations:,}{of} iterations; these are not yet the"
        " vehicle's parameters."
    )


def headway_notes(labels: Sequence[str], parameters: Parameters) -> tuple[str, ...]:
    """A sentence for the followers whose τ is no time headway; ``labels`` has the leader first.

    With α near zero the law hardly minds the gap, and τ, which it keeps only through ατ, may come
    out as anything.
    """
    loose = [
        f"{label} (τ = {law.tau:.1f} s, α = {law.alpha:.4f} 1/s²)"
        for label, law in zip(labels[1:], parameters, strict=True)
        if law.tau > LONGEST_HEADWAY
    ]
    if not loose:
        return ()
    return (
        f"The window does not determine the time headway of {', '.join(loose)}: with so little"
        " gain on spacing the law hardly minds the gap, and τ may come out as anything.",
    )


def bound_notes(vehicles: tuple[int, ...], solution: PlatoonSolution) -> tuple[str, ...]:
    """A sentence for each follower at a bound; ``vehicles`` (M+1,) has the leader first."""
    notes = []
    rows = zip(vehicles[1:], solution.active, solution.unconstrained, strict=True)
    for vehicle, names, free_theta in rows:
        if names:
            free = Parameters.from_theta(free_theta)
            notes.append(
                f"Vehicle {vehicle}: the rational driving constraints hold {' and '.join(names)}"
                f" at zero; without them the estimate is α = {free.alpha:.4f}, β = {free.beta:.4f},"
                f" τ = {free.tau:.3f}, a hint at a delay or at a law that does not fit."
            )
    return tuple(notes)
