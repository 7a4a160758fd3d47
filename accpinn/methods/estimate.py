"""The result of every estimation method: one `Estimate` of one window or of several."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from accpinn.arguments import check_level, checked_method
from accpinn.errors import ConfigError
from accpinn.methods.findings import BoundActive, Implausible, MethodFinding, Undetermined
from accpinn.methods.regression import Solution
from accpinn.model.cthp import TERMS, Case, Parameters, Trajectories
from accpinn.model.following import FollowingModel
from accpinn.model.registry import FOLLOWING, PAPER, time_gap, value_of
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment, median_speeds
from accpinn.serial import NamedEnum
from accpinn.units import FloatArray, MetresPerSecond, Quantity, Seconds, interval_ends

if TYPE_CHECKING:
    from pandas import DataFrame


class Outcome(NamedEnum):
    """The end of an estimation; the values are the sentences that users read."""

    SOLVED = "Solved: no change of the estimate improves its criterion."
    CONVERGED = "Converged: further iterations would not noticeably change the estimate."
    FILTERED = "Filtered: every instant was processed once, in the order of time."
    FINISHED = "Finished: all planned iterations were run; the estimate may still change."
    STOPPED = "Stopped by the user: the parameters are those of the last iteration."
    DIVERGED = (
        "Diverged: the numbers are no longer finite; choose another window, or train with a lower"
        " learning rate or from other initial values."
    )


@dataclass(frozen=True, eq=False)
class ParameterTrack:
    """Parameters over time, as an online method estimated them; K instants."""

    time: FloatArray
    """(K,) in s from the first window's start. Windows of a recording lie as far apart as in it;
    those of a further recording follow the former one's."""
    parameters: Parameters
    """(K, M); nan where the samples so far do not determine them."""
    deviation: FloatArray | None = None
    """(K, M, 3): the method's own standard deviations, where it has them."""


@dataclass(frozen=True, eq=False)
class Progress:
    """One moment of a running estimation, handed to whoever watches."""

    phase: str
    """Phase that runs: "start", "Adam", "L-BFGS", ..."""
    iteration: int
    iterations: int
    """Number expected until the end of the phase, at most those planned."""
    seconds: Seconds
    """Since the estimation began, without pauses."""
    total: float
    data: float
    physics: float
    initial: float
    parameters: Parameters
    """(P,): P = 1 in Case I, M in Case II."""
    log_likelihood: float = 0.0
    """log likelihood + log prior, where it is what the method maximises."""
    deviations: FloatArray | None = None
    """(P, 3) standard errors of ln α, ln β, ln τ so far; None where the training has none."""
    curves: Trajectories | None = None
    """The motion in the first window by the present estimate: the network's curves, or the drive
    simulated by the present parameters; only now and then, as it costs time."""
    left: Seconds | None = None
    """Time until all is done, later phases included; see `methods.forecast`."""


@dataclass(frozen=True)
class _About:
    """The subject of a part of an estimate; it follows from the estimate and is in no file."""

    model: str
    """Key of the model whose parameters it has."""
    names: tuple[str, ...]
    """The parameters' names."""
    vehicles: tuple[int, ...]
    """(M,) the followers' numbers in the file."""

    def values(self, sets: Parameters) -> dict[str, FloatArray]:
        """(..) each parameter of the model by its name."""
        return {name: value_of(self.model, sets, name) for name in self.names}


class _Part:
    """A part of an estimate, which tells it what it is about."""

    about: ClassVar[_About] = _About(PAPER, ("alpha", "beta", "tau"), ())


@dataclass(frozen=True, eq=False)
class History(_Part):
    """Course of loss and parameters in a training: K stored entries, oldest first."""

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
    log_likelihood: FloatArray | None = None
    """(K,) log likelihood + log prior; None where the method does not maximise it."""
    deviations: FloatArray | None = None
    """(K, P, 3) standard errors of ln α, ln β, ln τ; nan where unknown."""

    def to_frame(self) -> "DataFrame":
        """One row an entry: iteration, seconds, losses, and the parameters.

        The losses are total (Ψ), data (Ψ_D), physics (Ψ_F) and initial (Ψ_R), or log_likelihood
        where that is what the method maximises. Where followers have parameters of their own these
        end with the vehicle's number in the file, as alpha_2.
        """
        from pandas import DataFrame  # takes a third of a second, which few need

        losses = ("iteration", "seconds", "total", "data", "physics", "initial")
        columns = {name: getattr(self, name) for name in losses}
        columns["iteration"] = self.iteration.astype(int)
        if self.log_likelihood is not None:
            columns["log_likelihood"] = self.log_likelihood
        count = self.parameters.alpha.shape[1]
        endings = [f"_{number}" for number in self.about.vehicles] if count > 1 else [""]
        for k, ending in enumerate(endings):
            for name, values in self.about.values(self.parameters[:, k]).items():
                columns[f"{name}{ending}"] = values
        return DataFrame(columns)


OnProgress = Callable[[Progress], None]
ShouldStop = Callable[[], bool]


@dataclass(frozen=True)
class Span(Quantity):
    """A value with its interval as the car's typical one, and the interval in a further window."""

    further_lower: float
    further_upper: float

    @classmethod
    def of(
        cls, value: FloatArray, draws: tuple[FloatArray, FloatArray] | None, level: float
    ) -> Self:
        """Intervals of a value () by draws (n,) of the typical one and (n,) in a further window.

        Without draws all ends are nan.
        """
        if draws is None:
            return cls(float(value), *[float("nan")] * 4)
        ends = [end for drawn in draws for end in interval_ends(drawn, level)]
        lowest = 0.0 if value == 0.0 else float(ends[0])  # draws of logarithms are above zero
        return cls(float(value), lowest, *map(float, ends[1:]))


@dataclass(frozen=True, eq=False)
class Posterior(_Part):
    """The posterior of M followers' parameters, from K windows and from other cars, as draws.

    All draws are nan for a follower that is not determined. Those of a nonlinear model have its
    parameters in `Parameters.nonlinear`, beside the linearisation at the median speed.
    """

    method: str
    """The method of drawing, in words."""
    level: float
    """Share of the intervals that are to cover the truth, if the model holds."""
    typical: Parameters
    """(n, M) draws of the vehicle's typical value."""
    further: Parameters
    """(n, M) draws of what a further window has."""
    windows_lower: Parameters
    """(K, M) lower ends of the intervals of each window by itself."""
    windows_upper: Parameters
    """(K, M) upper ends."""
    windows_gap: FloatArray
    """(2, K, M) ends of each window's own interval of the time gap at `Estimate.stated_speed`."""
    differ: FloatArray
    """(M,) probability that windows differ as much by sampling error alone; nan for one window, and
    under a model that is no CTHP."""
    draws: FloatArray
    """(M,) the effective number of draws of the least certain window."""
    followers_differ: float = float("nan")
    """Probability that followers with shared parameters differ as much by sampling error alone, in
    the first window; nan where they do not share them."""

    def to_frame(self) -> "DataFrame":
        """The draws, one a row: kind, vehicle (number in the file), draw and parameters.

        ``kind`` is "typical" for the car's typical value and "further window" for what a further
        window of it may have.
        """
        from pandas import DataFrame, concat

        kinds = {"typical": self.typical, "further window": self.further}
        frames = [
            DataFrame(
                {"kind": kind, "vehicle": vehicle, "draw": range(len(sets))}
                | {name: values[:, k] for name, values in self.about.values(sets).items()}
            )
            for kind, sets in kinds.items()
            for k, vehicle in enumerate(self.about.vehicles)
        ]
        return concat(frames, ignore_index=True)


SPEEDS: tuple[MetresPerSecond, ...] = (50 / 3.6, 100 / 3.6)
"""Speeds at which the time gap is stated, beside the median speed."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """A method's estimate of M followers in K windows: one parameter set a follower.

    The parameters are those that hold in all windows together. An estimate without a posterior is
    a point: it has no intervals.
    """

    method: str
    """Key of the method in `METHODS`."""
    spec: ModelSpec
    """The model whose parameters they are, and what is fixed of it."""
    case: Case
    parameters: Parameters
    """(M,) one entry a follower, also in Case I, where all are the same. Those of a model that is
    no CTHP are in their `nonlinear`, beside its linearisation at the follower's median speed."""
    curves: tuple[Trajectories, ...]
    """(K,) the method's estimate of the true motion in each window, on its instants; empty for a
    method without curves."""
    outcome: Outcome
    settings: dict[str, Any]
    """Every setting that determined the result, ready for JSON."""
    numbers: tuple[int, ...]
    """(M,) the followers' numbers in the file."""
    speeds: FloatArray
    """(M,) each follower's median speed in m/s over the windows."""
    driven: FloatArray
    """(2, M) each follower's lowest and highest speed in m/s over the windows."""
    seconds: Seconds = 0.0
    """Duration of the estimation; unchanged when the result comes from the cache."""
    windows: Parameters | None = None
    """(K, M) the estimate of each window by itself; None where the method has none."""
    posterior: Posterior | None = None
    """The posterior beside the point; None for a method without intervals."""
    loss: dict[str, float] = field(default_factory=dict)
    """"total", "data", "physics", and for a network also "initial" and what it started from;
    "log_likelihood" of a method that maximises it."""
    unconstrained: Parameters | None = None
    """The optimum without the rational driving constraints; as `parameters` when none binds."""
    active_bounds: tuple[tuple[str, ...], ...] = ()
    """Per follower, which of α, ατ, β stand at zero only because of the constraints."""
    history: History | None = None
    track: ParameterTrack | None = None
    """Estimates over time; None for batch methods."""
    iterations: int = 0
    network_weights: int = 0
    """Number of weights of the network of one window."""
    cached: bool = False
    findings: tuple[MethodFinding, ...] = ()
    """Findings that the user should know."""
    arrays: dict[str, FloatArray] = field(default_factory=dict)
    """The method's own state by name, such as networks' weights: enough to start from it. What
    belongs to one window has a name as `of_window` reads it."""

    def __post_init__(self) -> None:
        """Tell the parts what they are about."""
        if self.model not in FOLLOWING:  # of somebody's file, which is refused for that
            return
        about = _About(self.model, self.names, self.numbers)
        for part in (self.posterior, self.history):
            if part is not None:
                object.__setattr__(part, "about", about)

    @classmethod
    def of(
        cls,
        method: str,
        segments: Sequence[Segment],
        case: Case,
        spec: ModelSpec,
        solution: Solution | Parameters,
        *,
        findings: Iterable[MethodFinding] = (),
        **others: Any,
    ) -> Self:
        """The estimate of a bounded least-squares solution (M, 3), or of parameters (M,).

        A solution adds findings about active bounds. The ``others`` are further fields.
        """
        bounds: list[MethodFinding] = []
        if isinstance(solution, Solution):
            numbers, free = segments[0].vehicles[1:], solution.unconstrained
            rows = zip(numbers, solution.active_names, free, strict=True)
            bounds = [BoundActive(n, names, tuple(at.tolist())) for n, names, at in rows if names]
            others["unconstrained"] = Parameters.from_theta(free)
            others["active_bounds"] = solution.active_names
            solution = solution.parameters
        ends = [
            (np.nanmin(s.speeds[:, 1:], axis=0), np.nanmax(s.speeds[:, 1:], axis=0))
            for s in segments
        ]
        usual: dict[str, Any] = {
            "curves": (),
            "settings": {},
            "numbers": segments[0].vehicles[1:],
            "speeds": median_speeds(segments),
            "driven": np.array([np.min(ends, axis=0)[0], np.max(ends, axis=0)[1]]),
        }
        return cls(
            method=method,
            spec=spec,
            case=case,
            parameters=solution,
            findings=(*bounds, *findings),
            **usual | others,
        )

    def __repr__(self) -> str:
        """Method, model, and each follower's time gap."""
        speed, gaps = self.stated_speed, []
        for k in range(len(self.speeds)):
            gap = self.time_gap(speed, k)
            ends = f" ({gap.lower:.2f}–{gap.upper:.2f})" if self.posterior else ""
            gaps.append(f"{gap.value:.2f} s{ends}")
        listed = ", ".join(gaps)
        return (
            f"<Estimate: {self.method}, {self.model}; time gap at {3.6 * speed:.0f} km/h: {listed}>"
        )

    @property
    def model(self) -> str:
        """Key of the model."""
        return self.spec.model

    @property
    def following(self) -> FollowingModel:
        """The model."""
        return self.spec.following

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the model's parameters."""
        return self.following.names

    @property
    def level(self) -> float | None:
        """Level of its intervals; None for a point."""
        return self.posterior.level if self.posterior else None

    @property
    def is_finished(self) -> bool:
        """Whether the estimation came to its end: neither stopped nor diverged."""
        return self.outcome not in (Outcome.STOPPED, Outcome.DIVERGED)

    @property
    def stated_speed(self) -> MetresPerSecond:
        """The highest of `SPEEDS` up to the speed that every follower reached.

        It is the lowest where that is none, or where the followers' median speed is below it.
        """
        reached = [speed for speed in SPEEDS if speed <= self.driven[1].min()]
        is_slow = np.median(self.speeds) < SPEEDS[0]
        return SPEEDS[0] if is_slow or not reached else reached[-1]

    def is_driven(self, speed: MetresPerSecond, follower: int) -> bool:
        """Whether a follower's windows contain a speed; results at others are extrapolated."""
        low, high = self.driven[:, follower]
        return bool(low <= speed <= high)

    def is_determined(self, name: str, follower: int) -> bool:
        """Whether the data determine a follower's parameter (0 for the first) beyond its prior.

        Of one that they do not, the value is no finding.
        """
        symbol = next(p.symbol for p in self.following.parameters if p.name == name)
        kinds = Undetermined | Implausible
        named = [f for f in self.findings if isinstance(f, kinds) and symbol in f.symbols]
        numbers = {finding.vehicle for finding in named}
        return not numbers & {0, self.numbers[follower]}

    @checked_method
    def span(self, name: str, follower: int, level: float | None = None) -> Span:
        """One parameter of one follower (0 for the first), by its name; see `names`.

        The ``level`` of its interval is by default that of the posterior. A lag or a delay at its
        least value is an end of its interval, as all draws lie above it.

        Raises:
            ConfigError: for another name or follower.
        """
        if name not in self.names:
            raise ConfigError(
                f"span: {str(name)[:40]} is not known; choose from {', '.join(self.names)}."
            )
        span = self._span((name,), follower, lambda sets: self.values(sets, name), level)
        is_late = self.following.is_linear and name in TERMS[1:]
        return replace(span, lower=span.value) if is_late and span.value < span.lower else span

    def gain(self, name: str, follower: int) -> Span:
        """The α or β of one follower; of a model that is no CTHP at its median speed."""
        return self._span(("gain", name), follower, lambda sets: getattr(sets, name))

    @checked_method
    def time_gap(self, speed: MetresPerSecond, follower: int, level: float | None = None) -> Span:
        """The time gap of one follower in equilibrium at a speed, in s; nan where there is none.

        Raises:
            ConfigError: for what is no speed above 0, or another follower.
        """
        if not speed > 0:
            raise ConfigError(f"speed: {speed} is not allowed; choose one above 0, in m/s.")
        return self._span((speed,), follower, lambda sets: time_gap(self.model, sets, speed), level)

    def gains_and_gap(self, follower: int) -> tuple[Span, Span, Span]:
        """α, β and the time gap at the median speed of one follower (0 for the first)."""
        gap = self.time_gap(float(self.speeds[follower]), follower)
        return self.gain("alpha", follower), self.gain("beta", follower), gap

    def values(self, sets: Parameters, name: str) -> FloatArray:
        """(..) one parameter by its name, of some sets (..) of the model."""
        return value_of(self.model, sets, name)

    @cached_property
    def _spans(self) -> dict[tuple[object, ...], Span]:
        """Spans computed so far, as pages ask for the same ones at every run."""
        return {}

    def _span(
        self,
        what: tuple[object, ...],
        follower: int,
        of: Callable[[Parameters], FloatArray],
        level: float | None = None,
    ) -> Span:
        if not 0 <= follower < len(self.speeds):
            raise ConfigError(
                f"follower: {follower} is not there; choose 0 to {len(self.speeds) - 1}, the first"
                " is 0."
            )
        if level is not None:
            check_level(level)
        key = (*what, follower, level)
        if key not in self._spans:
            posterior, draws = self.posterior, None
            if posterior:
                draws = of(posterior.typical)[:, follower], of(posterior.further)[:, follower]
            share = level or (posterior.level if posterior else float("nan"))
            self._spans[key] = Span.of(of(self.parameters)[follower], draws, share)
        return self._spans[key]


def of_window(arrays: Mapping[str, Any], window: int) -> dict[str, Any]:
    """The arrays of one window (0 for the first), by their names without its number."""
    prefix = f"window{window}."
    return {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}


def for_window(arrays: Mapping[str, Any], window: int) -> dict[str, Any]:
    """The arrays of one window by names with its number, as `of_window` reads them."""
    return {f"window{window}.{name}": values for name, values in arrays.items()}


Checkpoint = dict[str, NDArray[np.generic]]
"""The state of a training by name, as plain arrays: all that it needs to continue."""

KEPT = 2000
"""Most moments of a history: of more, every second, fourth, eighth .. is given."""

_SCALARS = ("iteration", "seconds", "total", "data", "physics", "initial", "log_likelihood")


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
        """Number of stored moments."""
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
            named["log_likelihood"] = None
        return History(**named, parameters=Parameters.of(tables))

    def state(self) -> Checkpoint:
        """The moments as arrays of a checkpoint; without deviations, which no such training has."""
        return {"history.rows": np.array(self._rows), "history.sets": np.array(self._sets)}

    def restore(self, state: Checkpoint) -> None:
        """Take the moments from the arrays of a checkpoint."""
        self._rows = list(np.array(state["history.rows"], float))
        self._sets = int(state["history.sets"])
