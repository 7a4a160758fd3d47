"""Closed-loop simulation least squares: the law whose own drive comes closest to the recording.

The followers are simulated from their first state on, with nothing measured but a speed ahead:

    (θ, x_0) = argmin Σ_t Σ_i (p̂_i - p_i)² + (v̂_i - v_i)²   subject to α, ατ, β ≥ 0,

gap errors in m and speed errors in m/s counted alike, as in the PiNN's Ψ_D. Case II simulates
each follower by itself behind its measured predecessor; Case I simulates the whole platoon behind
its measured leader, with one law. The first states x_0 are estimated too, within what a receiver
leaves open. Unlike the methods that weigh dv/dt against the law, this one never lets the recording
put the simulated motion right: what the law gets wrong adds up over time and counts in full.

The criterion can have several optima, so the search starts from several laws.

Source: Gunter et al., IEEE Transactions on Intelligent Transportation Systems 22 (2021) 6992-7003,
who fit simulations of this law to recordings; the search is scipy's trust-region method.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
from scipy.optimize import OptimizeResult
from scipy.optimize import least_squares as minimise

from accpinn.cthp import (
    LINEAR_NAMES,
    Case,
    LinearSolution,
    Parameters,
    PlatoonSolution,
    Trajectories,
)
from accpinn.estimators import least_squares, splines
from accpinn.estimators.chain import Chain, chains
from accpinn.fit import Fit, Outcome, bound_notes, parameters_of
from accpinn.segment import Segment
from accpinn.units import FloatArray, frozen

SCALE = np.array([0.05, 0.05, 0.2])
"""Of α, ατ, β: what the optimiser counts as one."""
START_ERROR = (0.5, 0.15)
"""In m and m/s, how far x_0 may be from the first sample: three standard deviations of a
receiver's errors. Left free, x_0 would take on part of what the law gets wrong."""
TYPICAL = Parameters(0.08, 0.2, 1.4)
"""A law to start from, beside the estimates of least squares and of splines."""
APART = (
    "Each follower is fitted behind its measured predecessor; where the platoon is simulated behind"
    " its leader alone, the errors of those ahead come on top."
)
AT_ZERO = 1e-6
"""In units of `SCALE`: the search comes near to a bound and never stands on it."""
HIGHEST = np.array([10.0, 10.0, 10.0])
"""Of α, ατ, β, in the units of SI: a hundred times what cars have. Where nothing but noise moves,
the best simulation would repeat it with gains beyond all bounds."""
TELLING = 1e-8
"""Ratio of the derivatives' singular values below which some change of the law changes nothing."""
TOLERANCE = 1e-10


def fit(segment: Segment, case: Case = "II") -> Fit:
    """The law of the best closed-loop simulation; the surrogate is that simulation.

    Raises:
        SegmentError: when there are too few samples for the splines that the search starts from.
    """
    started = time.perf_counter()
    guesses = [method.fit(segment, case).parameters for method in (least_squares, splines)]
    guesses.append((TYPICAL,) * segment.followers)
    platoon = chains(segment, case)
    ends = [
        _best(chain, [laws[index].linear() for laws in guesses])
        for index, chain in enumerate(platoon)
    ]
    states = np.concatenate([end.states for end in ends], axis=1)
    errors = states - np.concatenate([chain.measured for chain in platoon], axis=1)
    solution = PlatoonSolution.of([end.solution for end in ends], segment.followers)
    return Fit(
        method="simulation",
        case=case,
        parameters=parameters_of(solution.theta),
        surrogate=Trajectories(
            segment.time, np.column_stack([segment.speeds[:, 0], states[:, 1::2]]), states[:, ::2]
        ),
        outcome=Outcome.CONVERGED if all(end.converged for end in ends) else Outcome.FINISHED,
        seconds=time.perf_counter() - started,
        config={"starts": len(guesses), "start_error": list(START_ERROR)},
        loss={"total": float((errors**2).sum() / (segment.samples * segment.followers))},
        unconstrained=parameters_of(solution.unconstrained),
        active_bounds=solution.active,
        iterations=sum(end.rounds for end in ends),
        notes=(*bound_notes(segment.vehicles, solution), *_notes(segment, ends)),
    )


@dataclass(frozen=True, eq=False)
class _End:
    """The law of one chain of followers."""

    solution: LinearSolution
    states: FloatArray
    """(N, 2K) simulated with it."""
    converged: bool
    rounds: int
    telling: bool
    """Whether every change of the law changes the simulation."""


def _best(chain: Chain, guesses: list[FloatArray]) -> _End:
    """The best law within the bounds, and the one that would be best without them."""
    search = _Search(chain, (True, True, True))
    found = [search.run(guess) for guess in guesses]
    best = min(found, key=lambda end: float(end.cost))
    theta = unconstrained = search.law(best.x)
    positive = theta > AT_ZERO * SCALE
    active = tuple(compress(LINEAR_NAMES, ~positive))
    if active:
        unconstrained = search.law(search.run(theta, bounded=False).x)
        # Without α there is no τ, and so no ατ either.
        positive[1] &= positive[0]
        search = _Search(chain, positive.tolist())
        best = search.run(theta)
        found.append(best)
        theta = search.law(best.x)
    return _End(
        LinearSolution(frozen(theta), frozen(unconstrained), active),
        chain.states(theta, search.start(best.x)),
        bool(best.success),
        sum(end.nfev for end in found),
        search.telling(best),
    )


def _notes(segment: Segment, ends: list[_End]) -> list[str]:
    notes = [] if len(ends) == 1 else [APART]
    for vehicle, end in zip(segment.vehicles[1:], ends, strict=False):
        whose = "Case I" if len(ends) < segment.followers else f"Vehicle {vehicle}"
        if not end.telling or (end.solution.theta >= HIGHEST * (1 - AT_ZERO)).any():
            notes.append(
                f"{whose}: the recording does not tell α, β and τ apart, as other laws drive just"
                " as near to it; the numbers are one possibility of many."
            )
    return notes


class _Search:
    """The criterion of one chain over some of θ, the others zero, and over the first state."""

    def __init__(self, chain: Chain, free: Sequence[bool]) -> None:
        self._chain = chain
        self._free = np.flatnonzero(free)
        self._first = chain.measured[0]
        self._error = np.tile(START_ERROR, len(self._first) // 2)
        self._unit = np.concatenate([SCALE[self._free], self._error])

    def law(self, x: FloatArray) -> FloatArray:
        """θ, (3,), of what the optimiser works on."""
        theta = np.zeros(3)
        theta[self._free] = SCALE[self._free] * x[: len(self._free)]
        return theta

    def start(self, x: FloatArray) -> FloatArray:
        """The first state, (2K,)."""
        return np.asarray(self._first + self._error * x[len(self._free) :])

    def errors(self, x: FloatArray) -> FloatArray:
        """(2KN,) simulated less measured."""
        states = self._chain.states(self.law(x), self.start(x))
        return np.asarray((states - self._chain.measured).ravel())

    def slopes(self, x: FloatArray) -> FloatArray:
        """(2KN, len(x)) their derivatives."""
        slopes = self._chain.slopes(self.law(x), self.start(x))
        kept = [*self._free, *range(3, slopes.shape[2])]
        return np.asarray((slopes[:, :, kept] * self._unit).reshape(-1, len(kept)))

    def telling(self, end: OptimizeResult) -> bool:
        """Whether no change of the free part of θ leaves the simulation as it is."""
        values = np.linalg.svd(end.jac[:, : len(self._free)], compute_uv=False)
        return bool(values.size == 0 or values[-1] > TELLING * values[0])

    def run(self, guess: FloatArray, bounded: bool = True) -> OptimizeResult:
        """From a law (3,) and the measured first state to the nearest optimum."""
        laws, states = len(self._free), len(self._first)
        x = np.concatenate([guess[self._free] / SCALE[self._free], np.zeros(states)])
        top = HIGHEST[self._free] / SCALE[self._free]
        lowest = np.concatenate([np.zeros(laws) if bounded else -top, -np.ones(states)])
        highest = np.concatenate([top, np.ones(states)])
        x = x.clip(lowest, highest)
        # A trial step may lead to a law whose simulation runs away; the search then turns back.
        with np.errstate(over="ignore", invalid="ignore"):
            return minimise(
                self.errors, x, self.slopes, (lowest, highest), ftol=TOLERANCE, xtol=TOLERANCE
            )
