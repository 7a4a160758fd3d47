"""What every estimation method returns: one `Fit`, read by pages, command line and snapshots."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from accpinn.findings import Finding, Labelled, Words
from accpinn.methods.regression import Solution
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.model.registry import PAPER
from accpinn.segment import Segment
from accpinn.serial import NamedEnum
from accpinn.units import FloatArray, Seconds


class Outcome(NamedEnum):
    """How an estimation ended; the values are the sentences that users read."""

    SOLVED = "Solved: no change of the estimate improves its criterion."
    CONVERGED = "Converged: further iterations would not noticeably change the estimate."
    FILTERED = "Filtered: every instant was processed once, in the order of time."
    FINISHED = "Finished: all planned iterations were run; the estimate may still change."
    STOPPED = (
        "Stopped by the user: the parameters are those of the last iteration; it can be continued."
    )
    DIVERGED = (
        "Diverged: the numbers are no longer finite; choose another window, or train with a lower"
        " learning rate or from other initial values."
    )


class BoundActive(Finding, frozen=True):
    """The rational driving constraints hold components of θ at zero."""

    text = (
        "{vehicle}: the rational driving constraints hold {names} at zero; without them the"
        " estimate is α = {free.alpha:.4f}, β = {free.beta:.4f}, τ = {free.tau:.3f}, which suggests"
        " a delay or a model that does not fit."
    )

    vehicle: int
    names: tuple[str, ...]
    """The components: some of α, ατ and β."""
    unconstrained: tuple[float, float, float]
    """The estimate of θ without the constraints."""

    def _words(self, about: Labelled) -> Words:
        return {"free": Parameters.from_theta(self.unconstrained)}


class BoundActiveAtTimes(Finding, frozen=True):
    """A bound was active for a part of the time over which an online estimate is averaged."""

    text = (
        "{vehicle}: {name} was at its bound, zero, for {share:.0%} of the time over which the"
        " parameters are averaged."
    )

    vehicle: int
    name: str
    """The component: α, ατ or β."""
    share: float
    """Share of the time, 0 to 1."""


class WeaklyDetermined(Finding, frozen=True):
    """The recording does not determine α, β and τ; other sets reproduce it equally well."""

    text = (
        "{vehicle}: the recording does not determine α, β and τ; these parameters are one"
        " possibility of many."
    )

    vehicle: int | None
    """None for the one set that all followers share."""


class Undetermined(Finding, frozen=True):
    """Parameters of a model about which the data say hardly more than the prior."""

    text = (
        "{vehicle}: these data say hardly more about {symbols} of the {model} than is known of cars"
        " beforehand."
    )

    vehicle: int
    model: str
    """Its title."""
    symbols: tuple[str, ...]


class FilterUncertain(Finding, frozen=True):
    """A filter's gain that is not significantly different from zero at the end."""

    text = (
        "{vehicle}: {name} = {value:.4f} has a standard deviation of {deviation:.4f} in the filter,"
        " so it is not significantly different from zero."
    )

    vehicle: int
    name: str
    """α or β."""
    value: float
    deviation: float
    """The filter's standard deviation."""


class FilterDiverged(Finding, frozen=True):
    """The measurements jump by more than vehicles can, and a covariance lost its meaning."""

    text = (
        "{source}: the filter diverged, as speeds and space-gaps jump by more than vehicles can;"
        " choose another window."
    )


class SimulatedSeparately(Finding, frozen=True):
    """Each follower was simulated behind its measured predecessor."""

    text = (
        "Each follower is fitted behind its measured predecessor; in a simulation of the platoon"
        " behind its leader alone, the errors of the vehicles ahead add up."
    )


class HiddenLayersGain(Finding, frozen=True):
    """What training the hidden layers contributed: Ψ before and after."""

    text = "Training hidden layers changed Ψ from {before:#.4g} to {after:#.4g} ({change:+z.1%})."

    before: float
    after: float

    def _words(self, about: Labelled) -> Words:
        return {"change": self.after / self.before - 1}


class HoldoutLoss(Finding, frozen=True):
    """The loss at random instants that were kept out of training."""

    text = (
        "At {instants} random instants that were kept out of training the loss has Ψ_D ="
        " {data:#.4g} (distance from the data) and Ψ_F = {physics:#.4g} (misfit of the model)."
        " Instants beside them were learned from, so in another window both are larger."
    )

    instants: int
    data: float
    """Ψ_D."""
    physics: float
    """Ψ_F."""


class Continued(Finding, frozen=True):
    """The training resumed from a checkpoint."""

    text = "Continued from iteration {iteration:,} of an earlier training."

    iteration: int


class CacheProblem(Finding, frozen=True):
    """A file of the cache that could not be used, read or written."""

    text = "{problem}"

    problem: str
    """A sentence of the store, which names the file and the cure."""


MethodFinding = (
    BoundActive
    | BoundActiveAtTimes
    | WeaklyDetermined
    | Undetermined
    | FilterUncertain
    | FilterDiverged
    | SimulatedSeparately
    | HiddenLayersGain
    | HoldoutLoss
    | Continued
    | CacheProblem
)


@dataclass(frozen=True, eq=False)
class ParameterTrack:
    """Parameters over time, as an online method estimated them; K instants."""

    time: FloatArray
    """(K,) in s from the segment's start."""
    parameters: Parameters
    """(K, M); nan where the samples so far do not determine them."""
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
    parameters: Parameters
    """(P,): P = 1 in Case I, M in Case II."""
    evidence: float = 0.0
    """log evidence + log prior, where it is what the training maximises."""
    deviations: FloatArray | None = None
    """(P, 3) standard errors of ln α, ln β, ln τ so far; None where the training has none."""
    surrogate: Trajectories | None = None
    """The method's present estimate of the motion; only now and then, as it costs time."""


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
    parameters: Parameters
    """(K, P): P = 1 in Case I, M in Case II."""
    evidence: FloatArray | None = None
    """(K,) None where the training does not maximise it."""
    deviations: FloatArray | None = None
    """(K, P, 3) standard errors of ln α, ln β, ln τ; nan where unknown."""


OnProgress = Callable[[Progress], None]
ShouldStop = Callable[[], bool]


@dataclass(frozen=True, eq=False)
class Fit:
    """The learned parameters of a segment, and how they came about."""

    method: str
    case: Case
    parameters: Parameters
    """One entry a follower, also in Case I, where all are the same. Those of a model that is no
    CTHP are in their ``own``, beside its linearisation at the follower's median speed."""
    surrogate: Trajectories | None
    """The method's estimate of the true motion, on the segment's instants."""
    outcome: Outcome
    seconds: Seconds
    """Duration of the estimation; unchanged when the result comes from the cache."""
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
    """Estimates over time; None for batch methods."""
    iterations: int = 0
    network_weights: int = 0
    cached: bool = False
    findings: tuple[MethodFinding, ...] = ()
    """What the user should know about this result."""
    arrays: dict[str, FloatArray] = field(default_factory=dict)
    """The method's own state by name, such as a network's weights: enough to start from it."""
    model: str = PAPER
    """Key of the model whose parameters they are."""

    @classmethod
    def of(
        cls,
        method: str,
        segment: Segment,
        case: Case,
        solution: Solution,
        *,
        surrogate: Trajectories | None = None,
        findings: Iterable[MethodFinding] = (),
        **others: Any,
    ) -> Self:
        """The fit of a bounded least-squares solution (M, 3), with findings about active bounds.

        The ``others`` are further fields of `Fit`.
        """
        rows = zip(segment.vehicles[1:], solution.active_names, solution.unconstrained, strict=True)
        bounds = [BoundActive(n, names, tuple(free.tolist())) for n, names, free in rows if names]
        return cls(
            method=method,
            case=case,
            parameters=solution.parameters,
            surrogate=surrogate,
            seconds=0.0,
            unconstrained=Parameters.from_theta(solution.unconstrained),
            active_bounds=solution.active_names,
            findings=(*bounds, *findings),
            **others,
        )


Checkpoint = dict[str, NDArray[np.generic]]
"""The state of a training by name, as plain arrays: all that it needs to continue."""

KEPT = 2000
"""Most moments of a history: of more, every second, fourth, eighth .. is given."""

_SCALARS = ("iteration", "seconds", "total", "data", "physics", "initial", "evidence")


class Recorder:
    """Collects `Progress` into a `History`; the first and the latest moment are always in it."""

    def __init__(self) -> None:
        """Empty."""
        self._rows: list[FloatArray] = []
        """Scalars, then P parameter sets (P, 6 + n)."""
        self._deviations: list[FloatArray] = []
        self._sets = 1

    def add(self, progress: Progress) -> None:
        """Store a moment."""
        scalars = [float(getattr(progress, name)) for name in _SCALARS]
        self._rows.append(np.append(scalars, progress.parameters.everything))
        if progress.deviations is not None:
            self._deviations.append(progress.deviations)
        self._sets = len(progress.parameters)

    def __len__(self) -> int:
        """How many moments are stored."""
        return len(self._rows)

    def history(self) -> History:
        """The history so far, of one moment at least."""
        spacing = 1
        while len(self) > spacing * (KEPT - 1):
            spacing *= 2
        moments = [*range(0, len(self), spacing)]
        moments += [len(self) - 1] * ((len(self) - 1) % spacing > 0)
        rows = np.array([self._rows[k] for k in moments])
        tables = rows[:, len(_SCALARS) :].reshape(len(rows), self._sets, -1)
        named: dict[str, Any] = dict(zip(_SCALARS, rows.T, strict=False))
        if self._deviations:
            named["deviations"] = np.array([self._deviations[k] for k in moments])
        else:
            named["evidence"] = None
        return History(**named, parameters=Parameters.of(tables))

    def state(self) -> Checkpoint:
        """For a checkpoint of a training whose parameters have no deviations."""
        return {"history.rows": np.array(self._rows), "history.sets": np.array(self._sets)}

    def restore(self, state: Checkpoint) -> None:
        """From a checkpoint."""
        self._rows = list(np.array(state["history.rows"], float))
        self._sets = int(state["history.sets"])
