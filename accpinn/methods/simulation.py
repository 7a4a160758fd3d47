"""Closed-loop simulation least squares: the parameters whose simulation is nearest the recording.

The followers are simulated from their first state on, with only a speed ahead measured:

    (θ, x_0) = argmin Σ_t Σ_i (p̂_i - p_i)² + (v̂_i - v_i)²   subject to α, ατ, β ≥ 0,

gap errors in m and speed errors in m/s weighted equally, as in the PiNN's Ψ_D. Case II simulates
each follower by itself behind its measured predecessor; Case I simulates the whole platoon behind
its measured leader, with one parameter set. The first states x_0 are estimated too, within the
receivers' errors. Unlike in the methods that compare dv/dt with the model, the recording never
corrects the simulated motion: the model's errors accumulate over time and count in full.

Masked instants are not simulated: the motion starts anew after them, with a first state of its own.
In Case I an instant counts if it does for every follower. The criterion can have several optima, so
the search starts from several parameter sets.

The motion of K followers with one parameter set, x = (p_1, v_1, .., p_K, v_K), is a linear system
driven by the speed u of the vehicle ahead of the first, and A, b are linear in θ = (α, ατ, β). So
the derivatives s_j = ∂x/∂θ_j obey a linear system again, stepped exactly between the samples of u:

    dx/dt = A(θ) x + b(θ) u,        ds_j/dt = A s_j + A_j x + b_j u,    s_j(0) = 0.

Source: Gunter et al., IEEE Transactions on Intelligent Transportation Systems 22 (2021) 6992-7003,
who fit simulations of this model to recordings; the search is scipy's trust-region method.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag

from accpinn.errors import ConfigError, SegmentError
from accpinn.methods import (
    PAPERS,
    Law,
    TaskContext,
    best_first,
    direct,
    following,
    least_squares,
    splines,
)
from accpinn.methods.fit import (
    Fit,
    MethodFinding,
    Outcome,
    SimulatedInStretches,
    SimulatedSeparately,
    WeaklyDetermined,
)
from accpinn.methods.regression import Solution
from accpinn.model.cthp import (
    LARGEST,
    LARGEST_ALPHA_TAU,
    TYPICAL,
    Case,
    Parameters,
    Trajectories,
    motion_matrix,
    respond,
)
from accpinn.model.registry import FOLLOWING
from accpinn.segment import Segment
from accpinn.units import FloatArray, Seconds, frozen, stretches

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

SCALE = np.array([0.05, 0.05, 0.2])
"""Units of the optimiser for α, ατ, β."""
START_ERROR = (0.5, 0.15)
"""Largest distance in m and m/s of x_0 from the first sample: three standard deviations of a
receiver's errors. Without a limit, x_0 would absorb part of the model's error."""
AT_ZERO = 1e-6
"""Distance to a bound, in units of `SCALE`, that the search approaches and never reaches."""
HIGHEST = np.array([LARGEST.alpha, LARGEST_ALPHA_TAU, LARGEST.beta])
"""Largest α, ατ, β: where nothing but noise moves, the best simulation would repeat it with
unbounded gains."""
SINGULAR = 1e-8
"""Ratio of the derivatives' singular values below which θ is not identifiable."""
TOLERANCE = 1e-10
LEAST_STRETCH: Seconds = 5.0
"""Shortest simulated stretch: in less time, an unknown first state explains any motion."""


def fit(segment: Segment, case: Case = "II", law: Law = PAPERS) -> Fit:
    """The parameters of the best closed-loop simulation; the surrogate is that simulation.

    Another model than the paper's is estimated as `following` does, with priors.

    Raises:
        SegmentError: when there are too few samples for the splines that the search starts from,
            or when no stretch between masked instants is long enough.
    """
    if law != PAPERS:
        return following.fit((segment,), segment, case, law)
    guesses = [method.fit(segment, case).parameters for method in (least_squares, splines)]
    guesses.append(Parameters.of([TYPICAL.values] * segment.followers))
    ends = [
        _best(chain, _stretches(segment, k, chain), [guess[k].theta for guess in guesses])
        for k, chain in enumerate(chains(segment, case))
    ]
    states = np.concatenate([end.states for end in ends], axis=1)
    return Fit.of(
        "simulation",
        segment,
        case,
        Solution.stack([end.solution for end in ends], segment.followers),
        surrogate=Trajectories(
            segment.time, np.column_stack([segment.speeds[:, 0], states[:, 1::2]]), states[:, ::2]
        ),
        outcome=Outcome.CONVERGED if all(end.converged for end in ends) else Outcome.FINISHED,
        config={"starts": len(guesses), "start_error": list(START_ERROR)},
        loss={"total": sum(end.squares for end in ends) / segment.gaps.size},
        iterations=sum(end.rounds for end in ends),
        findings=_findings(segment, ends),
    )


@dataclass(frozen=True, eq=False)
class Chain:
    """K followers that share one parameter set; N instants."""

    ahead: FloatArray
    """(N,) u in m/s."""
    measured: FloatArray
    """(N, 2K) x as recorded."""
    step: Seconds

    @cached_property
    def parts(self) -> FloatArray:
        """(4, 2K, 2K+1): [A | b] at θ = 0, and its derivatives by α, ατ, β."""
        followers = self.measured.shape[1] // 2

        def at(alpha: float, beta: float, tau: float) -> FloatArray:
            return motion_matrix(Parameters(*([value] * followers for value in (alpha, beta, tau))))

        rest, gain = at(0, 0, 0), at(1, 0, 0)
        return np.stack([rest, gain - rest, at(1, 0, 1) - gain, at(0, 1, 0) - rest])

    def states(self, theta: FloatArray, start: FloatArray) -> FloatArray:
        """(N, 2K) x for θ (3,) from the first state (2K,) on."""
        return respond(self._matrix(theta), self.ahead, self.step, start)

    def slopes(self, theta: FloatArray, start: FloatArray) -> FloatArray:
        """(N, 2K, 3 + 2K): the derivatives of `states` by θ, then by the first state."""
        matrix, size = self._matrix(theta), len(start)
        joint = np.kron(np.eye(4), matrix[:, :-1])
        joint[size:, :size] += self.parts[1:, :, :-1].reshape(3 * size, size)
        drive = np.concatenate([matrix[:, -1], self.parts[1:, :, -1].ravel()])
        begin = np.concatenate([start, np.zeros(3 * size)])
        driven = respond(np.column_stack([joint, drive]), self.ahead, self.step, begin)
        by_theta = driven[:, size:].reshape(-1, 3, size).transpose(0, 2, 1)
        still = np.zeros(len(driven))
        by_start = [respond(matrix, still, self.step, unit) for unit in np.eye(size)]
        return np.concatenate([by_theta, np.stack(by_start, axis=2)], axis=2)

    def _matrix(self, theta: FloatArray) -> FloatArray:
        """[A | b], (2K, 2K+1)."""
        return np.asarray(self.parts[0] + np.tensordot(theta, self.parts[1:], 1))


def chains(segment: Segment, case: Case) -> tuple[Chain, ...]:
    """Case I: the platoon behind its leader. Case II: each follower behind its predecessor."""
    size = segment.followers if case == "I" else 1
    states = np.stack([segment.gaps, segment.speeds[:, 1:]], axis=2)
    return tuple(
        Chain(
            segment.speeds[:, first],
            states[:, first : first + size].reshape(segment.samples, -1),
            segment.sample_time,
        )
        for first in range(0, segment.followers, size)
    )


@dataclass(frozen=True, eq=False)
class _End:
    """The result for one chain of followers."""

    solution: Solution
    states: FloatArray
    """(N, 2K) simulated with it from the first instant on, also over masked instants."""
    squares: float
    """Sum of the squared errors of the simulated stretches."""
    converged: bool
    rounds: int
    identifiable: bool
    """Whether every change of θ changes the simulation."""


def _stretches(segment: Segment, index: int, chain: Chain) -> tuple[Chain, ...]:
    """The simulated parts of the chain with that index: all of it, unless there is a mask."""
    if segment.mask is None:
        return (chain,)
    size = chain.measured.shape[1] // 2
    mask = segment.mask[:, index : index + size]
    kept = stretches(mask.all(axis=1))
    runs = [run.rows for run in kept if (len(run) - 1) * chain.step >= LEAST_STRETCH]
    if not runs:
        raise SegmentError(
            f"{segment.source}: without the instants left out, {segment.labels[index + 1]} has no"
            f" stretch of {LEAST_STRETCH:g} s to simulate; leave out less, or choose another"
            " method."
        )
    return tuple(Chain(chain.ahead[r], chain.measured[r], chain.step) for r in runs)


def _best(chain: Chain, stretches: tuple[Chain, ...], guesses: list[FloatArray]) -> _End:
    """The best θ within the bounds, and the best one without them."""
    search = _Search(stretches, (True, True, True))
    ends = [search.run(guess) for guess in guesses]
    best = min(ends, key=lambda end: float(end.cost))
    theta = unconstrained = search.theta(best.x)
    positive = theta > AT_ZERO * SCALE
    active = ~positive
    if active.any():
        unconstrained = search.theta(search.run(theta, bounded=False).x)
        # Without α there is no τ, and so no ατ either.
        positive[1] &= positive[0]
        search = _Search(stretches, positive.tolist())
        best = search.run(theta)
        ends.append(best)
        theta = search.theta(best.x)
    whole = len(stretches[0].ahead) == len(chain.ahead)
    return _End(
        Solution(frozen(theta), frozen(unconstrained), active),
        chain.states(theta, search.starts(best.x)[0] if whole else chain.measured[0]),
        2 * float(best.cost),
        bool(best.success),
        sum(end.nfev for end in ends),
        search.is_identifiable(best),
    )


def _findings(segment: Segment, ends: list[_End]) -> list[MethodFinding]:
    findings: list[MethodFinding] = [] if len(ends) == 1 else [SimulatedSeparately()]
    if segment.mask is not None:
        findings.append(SimulatedInStretches(LEAST_STRETCH))
    for vehicle, end in zip(segment.vehicles[1:], ends, strict=False):
        if not end.identifiable or (end.solution.theta >= HIGHEST * (1 - AT_ZERO)).any():
            findings.append(WeaklyDetermined(None if len(ends) < segment.followers else vehicle))
    return findings


class _Search:
    """The criterion of a chain's stretches over some of θ, the others zero, and first states."""

    def __init__(self, stretches: tuple[Chain, ...], free: Sequence[bool]) -> None:
        self._stretches = stretches
        self._free = np.flatnonzero(free)
        self._first = np.concatenate([part.measured[0] for part in stretches])
        self._error = np.tile(START_ERROR, len(self._first) // 2)
        self._unit = np.concatenate([SCALE[self._free], self._error])

    def theta(self, x: FloatArray) -> FloatArray:
        """θ, (3,), of the optimiser's unknowns."""
        theta = np.zeros(3)
        theta[self._free] = SCALE[self._free] * x[: len(self._free)]
        return theta

    def starts(self, x: FloatArray) -> FloatArray:
        """The first state of each stretch, (S, 2K)."""
        firsts = self._first + self._error * x[len(self._free) :]
        return np.asarray(firsts.reshape(len(self._stretches), -1))

    def errors(self, x: FloatArray) -> FloatArray:
        """(2KN,) simulated less measured."""
        theta = self.theta(x)
        return np.concatenate(
            [
                (part.states(theta, start) - part.measured).ravel()
                for part, start in zip(self._stretches, self.starts(x), strict=True)
            ]
        )

    def slopes(self, x: FloatArray) -> FloatArray:
        """(2KN, len(x)) their derivatives."""
        theta = self.theta(x)
        parts = [
            part.slopes(theta, start).reshape(part.measured.size, -1)
            for part, start in zip(self._stretches, self.starts(x), strict=True)
        ]
        by_theta = np.concatenate([part[:, self._free] for part in parts])
        by_start = block_diag(*(part[:, 3:] for part in parts))
        return np.asfortranarray(np.hstack([by_theta, by_start]) * self._unit)

    def is_identifiable(self, end: "OptimizeResult") -> bool:
        """Whether every change of the free part of θ changes the simulation."""
        values = np.linalg.svd(end.jac[:, : len(self._free)], compute_uv=False)
        return bool(values.size == 0 or values[-1] > SINGULAR * values[0])

    def run(self, guess: FloatArray, bounded: bool = True) -> "OptimizeResult":
        """From a guess of θ (3,) and the measured first state to the nearest optimum."""
        from scipy import optimize  # takes a quarter of a second, which few commands need

        states = len(self._first)
        x = np.concatenate([guess[self._free] / SCALE[self._free], np.zeros(states)])
        top = HIGHEST[self._free] / SCALE[self._free]
        lowest = np.concatenate([np.zeros(len(top)) if bounded else -top, -np.ones(states)])
        highest = np.concatenate([top, np.ones(states)])
        x = x.clip(lowest, highest)
        # The simulation of a trial step may diverge; the search then turns back.
        with np.errstate(over="ignore", invalid="ignore"):
            return optimize.least_squares(
                self.errors, x, self.slopes, (lowest, highest), ftol=TOLERANCE, xtol=TOLERANCE
            )


def fit_together(
    segments: tuple[Segment, ...], case: Case, _settings: object, context: TaskContext, law: Law
) -> tuple[Fit, ...]:
    """The fit of each of several windows by one parameter set of them all.

    Raises:
        ConfigError: for the paper's model, of which the first state of a window is sought too.
    """
    if law == PAPERS:
        raise ConfigError(
            "windows: simulation estimates the paper's model from one window; choose another model,"
            " as --model idm, maximum-likelihood, or one window."
        )
    kept = (segment for segment in segments if not context.is_stopped)
    return tuple(following.fit(segments, segment, case, law) for segment in kept)


METHOD = direct(
    "simulation", "Simulation", fit, best_first(tuple(FOLLOWING)), typical_seconds=1.4,
    is_closed_loop=True, together=fit_together,
    summary="the parameters whose closed-loop simulation is nearest the recording",
)  # fmt: skip
