"""The `fast` preset: gradient descent where the network is nonlinear, exact solves where it is not.

The network (`network`, with Fourier features) has three kinds of unknowns, each learned by what
suits it:

    hidden layers      Adam on minibatches of Ψ
    output layer W     Ψ is quadratic in it: solved exactly
    α, ατ, β           Ψ is quadratic in them: solved exactly, within their bounds

Training starts with rounds of the two exact solves from the user's initial values, until the
parameters stand still; that is the optimum for the untrained hidden layers. Then cycles of
`CYCLE` Adam iterations, each followed by exact solves, train the hidden layers. A cycle that moves
no parameter is the last one, and one that does not lower Ψ is taken back. Each exact round at the
start and each Adam iteration counts as one iteration.

`projection` has the exact solves; `following` replaces them by Gauss-Newton steps for other models.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch

from accpinn.methods.estimate import Fit, HiddenLayersGain, Outcome
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import LossTerms, Motion, Training, loss_terms, trajectories
from accpinn.methods.pinn.network import Network
from accpinn.methods.pinn.paper import Adam
from accpinn.methods.pinn.projection import (
    NormalEquations,
    Projection,
    solve_output,
    solve_parameters,
)
from accpinn.methods.regression import Solution
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.segment import Segment
from accpinn.units import FloatArray

CYCLE = 50
"""Adam iterations between exact solves."""
HALF_LIFE = 100
"""Iterations in which Adam's learning rate halves: minibatch noise must fade for Ψ to converge."""
STANDSTILL = 1e-4
"""Exact rounds go on until no parameter moves by more than this share."""
START_ROUNDS = 300
"""Largest number of exact rounds before the hidden layers are trained; some ten are usual, and 200
where the physics weighs a hundred times as much as the data."""
CYCLE_ROUNDS = 3
"""Largest number of exact rounds after a cycle."""
CONVERGED = 1e-3
"""Largest share by which a parameter moves over the last cycle."""


@dataclass(frozen=True, eq=False)
class Seen:
    """What the output layer sees, for some hidden layers."""

    hidden: FloatArray
    """(N, 1 + order, width) the activations and their derivatives in time."""
    sums: NormalEquations
    whole: FloatArray = field(default_factory=lambda: np.empty(0))
    """(N, 1 + order, K) Φ and its derivatives, for another model than the CTHP."""
    earlier: tuple[FloatArray, ...] = ()
    """(M,) of (N, 2, K): Φ and its rate at t - d of each follower of a model with a delay."""


@dataclass(frozen=True, eq=False)
class Optimum:
    """The exact optimum, as far as sought, for some hidden layers."""

    seen: Seen
    weights: FloatArray
    """(K, 2M+1) W, biases in the first row."""
    solution: Any
    """The parameters: a `Solution` of the CTHP, or z (S, n) of another model."""
    motion: Motion
    """The surrogate on all instants."""


class FastTraining(Training):
    """See the module's head; one `advance` is an exact round or a cycle.

    What is solved for is θ here, as a `Solution`; another model has unknowns of its own.
    """

    @np.errstate(all="ignore")  # absurd numbers end as diverged
    def __init__(self, segment: Segment, case: Case, config: PinnConfig, threads: int = 1) -> None:
        """Build the network and solve its output layer at the initial parameters."""
        super().__init__(segment, case, config)
        torch.set_num_threads(threads)
        self.network = Network(self.followers, config, float(segment.time[-1]))
        data = self.measured, segment.mask
        self._projection = Projection(self.network, segment.time, *data, self.order)
        self._learnable = self.network.learnable()
        self._adam = Adam([*self._learnable.weights()][:-2], b2=0.99)
        self._starting, self._iteration = True, 0
        self._start_loss = float("nan")
        self._best = self._optimum(self._initial())
        self._note("start")

    def _initial(self) -> Any:
        """The parameters to begin with."""
        return Solution.of(Parameters.of([self.config.initial.values] * self.followers).theta)

    def _theta(self, solution: Any) -> FloatArray:
        """Parameters as `loss_terms` takes them."""
        return np.asarray(solution.theta)

    def _parameters(self, solution: Any) -> Parameters:
        """(M,) parameters."""
        return Parameters.from_theta(solution.theta)

    def _move(self, now: Any, before: Any) -> float:
        """Largest relative change of α, β, τ; one at zero counts by its absolute change."""
        new, old = now.parameters.values, before.parameters.values
        scale = np.where(np.abs(old) > 1e-9, np.abs(old), 1.0)
        return float(np.nanmax(np.abs(new - old) / scale, initial=0.0))

    def _seen(self, solution: Any) -> Seen:
        """What the output layer sees for the present hidden layers."""
        hidden = self._projection.hidden()
        return Seen(hidden, self._projection.sums(hidden))

    def _motion(self, seen: Seen, weights: FloatArray) -> Motion:
        """The surrogate on all instants."""
        return Motion(*self._projection.surrogate(seen.hidden, weights))

    def _output(self, seen: Seen, solution: Any, near: FloatArray | None) -> FloatArray:
        """(K, 2M+1) the output layer's optimum, which is ``near`` another one."""
        return solve_output(seen.sums, solution.theta, self.config)

    def _solved(self, at: Optimum) -> Optimum:
        """One exact round: the parameters and the output layer."""
        solution = solve_parameters(at.seen.sums, at.weights, self.case)
        return self._at(at.seen, solve_output(at.seen.sums, solution.theta, self.config), solution)

    @np.errstate(all="ignore")
    def advance(self) -> None:
        """One exact round while starting; afterwards one cycle."""
        try:
            if self._starting:
                before = self._best.solution
                self._best = self._solved(self._best)
                self._iteration += 1
                moved = self._move(self._best.solution, before)
                self._starting = moved > STANDSTILL and self._iteration < START_ROUNDS
                self._note("start")
            else:
                self._cycle()
        except np.linalg.LinAlgError:
            self.outcome = Outcome.DIVERGED

    def _cycle(self) -> None:
        before, loss = self._best, self.progress.total
        kept = self.network.arrays()
        steps = min(CYCLE, self.planned - self._iteration)
        self._descend(steps)
        after = self._optimum(before.solution, before.weights)
        for _ in range(CYCLE_ROUNDS):
            last = after.solution
            after = self._solved(after)
            if self._move(after.solution, last) <= STANDSTILL:
                break
        terms = self._loss(after)
        if terms.total < loss:
            self._best = after
            self._note("Adam", terms)
        else:
            self.network.load_arrays(kept)
            self._note("Adam")
        moved = self._move(self._best.solution, before.solution)
        if steps == CYCLE and moved <= CONVERGED and self.outcome is not Outcome.DIVERGED:
            self.outcome = Outcome.CONVERGED

    def _loss(self, at: Optimum) -> LossTerms:
        """Ψ on all instants."""
        theta = self._theta(at.solution)
        return loss_terms(at.motion, self.measured, theta, self.config, self.mask, self.model)

    def _note(self, phase: str, terms: LossTerms | None = None) -> None:
        """Look at the present moment, with Ψ where it is known already."""
        best = self._best
        parameters = self._parameters(best.solution)
        self._look(phase, self._iteration, terms or self._loss(best), parameters)
        if phase == "start":
            self._start_loss = self.progress.total

    def _optimum(self, solution: Any, near: FloatArray | None = None) -> Optimum:
        """The output layer's optimum for the present hidden layers and some parameters."""
        seen = self._seen(solution)
        return self._at(seen, self._output(seen, solution, near), solution)

    def _at(self, seen: Seen, weights: FloatArray, solution: Any) -> Optimum:
        return Optimum(seen, weights, solution, self._motion(seen, weights))

    def _descend(self, iterations: int) -> None:
        """Adam on the hidden layers, on minibatches, everything else fixed."""
        config, count = self.config, len(self.measured)
        measured, motion_at = torch.from_numpy(self.measured), self._motion_of_hidden()
        theta = torch.tensor(self._theta(self._best.solution))
        mask = None if self.mask is None else torch.from_numpy(self.mask)
        learning_rate = config.learning_rate * 0.5 ** (self._iteration / HALF_LIFE)
        generator = np.random.default_rng((config.seed, self._iteration))
        first = int(config.weight_initial > 0)  # Ψ_R looks at the first instant, once
        for _ in range(iterations):
            pick = generator.integers(first, count, size=min(config.batch, count))
            pick[:first] = 0
            kept = None if mask is None else mask[pick]
            terms = loss_terms(motion_at(pick), measured[pick], theta, config, kept, self.model)
            self._adam.step(terms.total, learning_rate)
        self._iteration += iterations

    def _motion_of_hidden(self) -> Callable[[Any], Motion]:
        """The surrogate at picked instants, of which the hidden layers alone can be moved."""
        weights, projection = self._best.weights, self._projection
        through = torch.from_numpy(weights[-self.config.width :])
        fixed = torch.from_numpy(projection.past_hidden(weights)).swapaxes(0, 1)
        features = torch.from_numpy(projection.skipped[:, :, 1:]).swapaxes(0, 1)

        def motion(pick: Any) -> Motion:
            active = self._learnable.activations([row[pick] for row in features])
            pairs = zip(fixed, active, strict=True)
            return Motion(*(part[pick] + moved @ through for part, moved in pairs))

        return motion

    def surrogate(self) -> Trajectories:
        """The present surrogate on all instants."""
        return trajectories(self.segment.time, self._best.motion.outputs)

    def _solution(self) -> Solution:
        """(M, 3) the present parameters, or their linearisation."""
        solution: Solution = self._best.solution
        return solution

    def fit(self) -> Fit:
        """The surrogate, the parameters, and what training the hidden layers brought."""
        self.network.set_output(self._best.weights)
        now, start = self.progress, self._start_loss
        gain = [HiddenLayersGain(start, now.total)] if now.phase == "Adam" and start > 0 else []
        loss = {"total": now.total, "data": now.data, "physics": now.physics}
        return self._fit(
            self._solution(),
            self.surrogate(),
            loss | {"initial": now.initial, "start": start},
            network_weights=self.network.size,
            arrays=self.network.arrays(),
            findings=gain,
        )
