"""Closed-loop simulation least squares: the law whose own drive comes closest to the recording.

The followers are simulated from their first state on, with nothing measured but a speed ahead:

    (θ, x_0) = argmin Σ_t Σ_i (p̂_i - p_i)² + (v̂_i - v_i)²   subject to α, ατ, β ≥ 0,

gap errors in m and speed errors in m/s counted alike, as in the PiNN's Ψ_D. Case II simulates
each follower by itself behind its measured predecessor; Case I simulates the whole platoon behind
its measured leader, with one law. The first states x_0 are estimated too, within what a receiver
leaves open. Unlike the methods that weigh dv/dt against the law, this one never lets the recording
put the simulated motion right: what the law gets wrong adds up over time and counts in full.

What the segment leaves out of the law is not simulated: the motion starts anew where the law counts
again, with a first state of its own. In Case I an instant counts if it does for every follower.

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

from accpinn.errors import SegmentError
from accpinn.methods import least_squares, splines
from accpinn.methods.chain import Chain, chains
from accpinn.methods.fit import Fit, Outcome, bound_notes
from accpinn.methods.method import direct
from accpinn.model.cthp import (
    LINEAR_NAMES,
    Case,
    LinearSolution,
    Parameters,
    PlatoonSolution,
    Trajectories,
)
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds, frozen

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
LEAST_STRETCH: Seconds = 5.0
"""Between instants left out: in less time, an unknown first state explains the motion by itself."""
ANEW = (
    "What is left out was not simulated while the law was fitted: each stretch between starts anew"
    f" from its measured state, and stretches shorter than {LEAST_STRETCH:g} s are left out too."
)


def fit(segment: Segment, case: Case = "II") -> Fit:
    """The law of the best closed-loop simulation; the surrogate is that simulation.

    Raises:
        SegmentError: when there are too few samples for the splines that the search starts from,
            or when no stretch that is not left out is long enough.
    """
    started = time.perf_counter()
    guesses = [method.fit(segment, case).parameters for method in (least_squares, splines)]
    guesses.append(Parameters.of([TYPICAL.values] * segment.followers))
    platoon = chains(segment, case)
    ends = [
        _best(chain, _stretches(segment, index, chain), [laws[index].theta for laws in guesses])
        for index, chain in enumerate(platoon)
    ]
    states = np.concatenate([end.states for end in ends], axis=1)
    errors = np.concatenate([end.errors for end in ends], axis=1)
    solution = PlatoonSolution.of([end.solution for end in ends], segment.followers)
    return Fit(
        method="simulation",
        case=case,
        parameters=Parameters.from_theta(solution.theta),
        surrogate=Trajectories(
            segment.time, np.column_stack([segment.speeds[:, 0], states[:, 1::2]]), states[:, ::2]
        ),
        outcome=Outcome.CONVERGED if all(end.converged for end in ends) else Outcome.FINISHED,
        seconds=time.perf_counter() - started,
        config={"starts": len(guesses), "start_error": list(START_ERROR)},
        loss={"total": float((errors**2).sum() / (segment.samples * segment.followers))},
        unconstrained=Parameters.from_theta(solution.unconstrained),
        active_bounds=solution.active,
        iterations=sum(end.rounds for end in ends),
        notes=(*bound_notes(segment.vehicles, solution), *_notes(segment, ends)),
    )


@dataclass(frozen=True, eq=False)
class _End:
    """The law of one chain of followers."""

    solution: LinearSolution
    states: FloatArray
    """(N, 2K) simulated with it from the first instant on, also over what is left out."""
    errors: FloatArray
    """(N, 2K) of the simulated stretches; zero where nothing was simulated."""
    converged: bool
    rounds: int
    telling: bool
    """Whether every change of the law changes the simulation."""


def _stretches(segment: Segment, index: int, chain: Chain) -> tuple[Chain, ...]:
    """What is simulated of the chain with that index: all of it, unless something is left out."""
    if segment.mask is None:
        return (chain,)
    size = chain.measured.shape[1] // 2
    mask = segment.mask[:, index : index + size]
    stretches = chain.stretches(np.asarray(mask.all(axis=1)), LEAST_STRETCH)
    if not stretches:
        raise SegmentError(
            f"{segment.source}: what is left of {segment.labels[index + 1]} has no stretch of"
            f" {LEAST_STRETCH:g} s to simulate; leave out less, or choose another method."
        )
    return stretches


def _best(chain: Chain, stretches: tuple[Chain, ...], guesses: list[FloatArray]) -> _End:
    """The best law within the bounds, and the one that would be best without them."""
    search = _Search(stretches, (True, True, True))
    found = [search.run(guess) for guess in guesses]
    best = min(found, key=lambda end: float(end.cost))
    theta = unconstrained = search.law(best.x)
    positive = theta > AT_ZERO * SCALE
    active = tuple(compress(LINEAR_NAMES, ~positive))
    if active:
        unconstrained = search.law(search.run(theta, bounded=False).x)
        # Without α there is no τ, and so no ατ either.
        positive[1] &= positive[0]
        search = _Search(stretches, positive.tolist())
        best = search.run(theta)
        found.append(best)
        theta = search.law(best.x)
    whole = len(stretches[0].ahead) == len(chain.ahead)
    return _End(
        LinearSolution(frozen(theta), frozen(unconstrained), active),
        chain.states(theta, search.starts(best.x)[0] if whole else chain.measured[0]),
        _placed(stretches, search.errors(best.x), chain.measured.shape),
        bool(best.success),
        sum(end.nfev for end in found),
        search.telling(best),
    )


def _placed(stretches: tuple[Chain, ...], errors: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Errors of one stretch after the other, put where they belong in the segment."""
    placed, taken = np.zeros(shape), 0
    for part in stretches:
        inside = errors[taken : taken + part.measured.size]
        placed[part.first : part.first + len(part.ahead)] = inside.reshape(part.measured.shape)
        taken += part.measured.size
    return placed


def _notes(segment: Segment, ends: list[_End]) -> list[str]:
    notes = [] if len(ends) == 1 else [APART]
    if segment.mask is not None:
        notes.append(ANEW)
    for vehicle, end in zip(segment.vehicles[1:], ends, strict=False):
        whose = "Case I" if len(ends) < segment.followers else f"Vehicle {vehicle}"
        if not end.telling or (end.solution.theta >= HIGHEST * (1 - AT_ZERO)).any():
            notes.append(
                f"{whose}: the recording does not tell α, β and τ apart, as other laws drive just"
                " as near to it; the numbers are one possibility of many."
            )
    return notes


class _Search:
    """The criterion of a chain's stretches over some of θ, the others zero, and first states."""

    def __init__(self, stretches: tuple[Chain, ...], free: Sequence[bool]) -> None:
        self._stretches = stretches
        self._free = np.flatnonzero(free)
        self._first = np.concatenate([part.measured[0] for part in stretches])
        self._error = np.tile(START_ERROR, len(self._first) // 2)
        self._unit = np.concatenate([SCALE[self._free], self._error])

    def law(self, x: FloatArray) -> FloatArray:
        """θ, (3,), of what the optimiser works on."""
        theta = np.zeros(3)
        theta[self._free] = SCALE[self._free] * x[: len(self._free)]
        return theta

    def starts(self, x: FloatArray) -> FloatArray:
        """The first state of each stretch, (S, 2K)."""
        firsts = self._first + self._error * x[len(self._free) :]
        return np.asarray(firsts.reshape(len(self._stretches), -1))

    def errors(self, x: FloatArray) -> FloatArray:
        """(2KN,) simulated less measured."""
        law = self.law(x)
        return np.concatenate(
            [
                (part.states(law, start) - part.measured).ravel()
                for part, start in zip(self._stretches, self.starts(x), strict=True)
            ]
        )

    def slopes(self, x: FloatArray) -> FloatArray:
        """(2KN, len(x)) their derivatives."""
        law, laws = self.law(x), len(self._free)
        starts = self.starts(x)
        rows, size = [part.measured.size for part in self._stretches], starts.shape[1]
        slopes = np.zeros((sum(rows), len(x)), order="F")
        taken = 0
        for index, (part, start, count) in enumerate(
            zip(self._stretches, starts, rows, strict=True)
        ):
            own = part.slopes(law, start).reshape(count, -1)
            at = slice(taken, taken + count)
            slopes[at, :laws] = own[:, self._free]
            slopes[at, laws + index * size : laws + (index + 1) * size] = own[:, 3:]
            taken += count
        slopes *= self._unit
        return slopes

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


METHOD = direct("simulation", "Simulation", fit, typical_seconds=1.4)
