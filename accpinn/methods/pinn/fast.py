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

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
import torch

from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.adam import Adam
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import Learned, LossTerms, Training, loss_terms
from accpinn.methods.pinn.network import Network
from accpinn.methods.pinn.projection import (
    NormalEquations,
    Projection,
    solve_output,
    solve_parameters,
)
from accpinn.methods.regression import Solution
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray

Unknown = TypeVar("Unknown")
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
class Optimum(Generic[Unknown]):
    """The exact optimum, as far as sought, for some hidden layers."""

    hidden: FloatArray
    """(N, 2, width) the activations and their derivative in time."""
    sums: NormalEquations
    weights: FloatArray
    """(K, 2M+1) W, biases in the first row."""
    solution: Unknown
    """The model's parameters."""


class ProjectedTraining(Training, Generic[Unknown]):
    """See the module's head, for any model; one `advance` is an exact round or a cycle."""

    @np.errstate(all="ignore")  # absurd numbers end as diverged
    def __init__(
        self,
        segment: Segment,
        case: Case,
        config: PinnConfig,
        threads: int,
        initial: Unknown,
    ) -> None:
        """Build the network and solve its output layer at the initial parameters.

        Args:
            segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
            case: "I" or "II".
            config: the settings.
            threads: processor threads.
            initial: parameters.
        """
        super().__init__(segment, case, config, threads)
        torch.set_num_threads(threads)
        self.network = Network(self.followers, config, float(segment.time[-1]))
        self._projection = Projection(self.network, segment.time, self.measured, segment.mask)
        self._learnable = self.network.learnable()
        self._adam = Adam([*self._learnable.weights()][:-2], b2=0.99)
        self._starting, self._iteration = True, 0
        self._start_loss = float("nan")
        self._best = self._optimum(initial)
        self._note("start")

    @abstractmethod
    def _theta(self, solution: Unknown) -> FloatArray:
        """Parameters as `loss_terms` takes them."""

    @abstractmethod
    def _parameters(self, solution: Unknown) -> Parameters:
        """(M,) parameters."""

    @abstractmethod
    def _move(self, now: Unknown, before: Unknown) -> float:
        """Largest relative change of a parameter."""

    @abstractmethod
    def _output(
        self, hidden: FloatArray, sums: NormalEquations, solution: Unknown, near: FloatArray
    ) -> FloatArray:
        """(K, 2M+1) the output layer's optimum; the outputs (N, 2M+1) will be ``near`` these."""

    @abstractmethod
    def _solved(self, at: Optimum[Unknown]) -> Optimum[Unknown]:
        """One exact round: the parameters and the output layer."""

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
        after = self._optimum(before.solution, before)
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

    def _loss(self, at: Optimum[Unknown]) -> LossTerms:
        """Ψ on all instants."""
        outputs, rates = self._surrogate(at)
        theta = self._theta(at.solution)
        return loss_terms(outputs, rates, self.measured, theta, self.config, self.mask, self.model)

    def _note(self, phase: str, terms: LossTerms | None = None) -> None:
        """Look at the present moment, with Ψ where it is known already."""
        best = self._best
        parameters = self._parameters(best.solution)
        self._look(phase, self._iteration, terms or self._loss(best), parameters)
        if phase == "start":
            self._start_loss = self.progress.total

    def _optimum(
        self, solution: Unknown, before: Optimum[Unknown] | None = None
    ) -> Optimum[Unknown]:
        """The output layer's optimum for the present hidden layers and some parameters."""
        hidden = self._projection.hidden()
        sums = self._projection.sums(hidden)
        near = self._surrogate(before)[0] if before and self.model else self.measured
        return Optimum(hidden, sums, self._output(hidden, sums, solution, near), solution)

    def _surrogate(self, at: Optimum[Unknown]) -> tuple[FloatArray, FloatArray]:
        """(N, 2M+1) outputs and their rates."""
        return self._projection.surrogate(at.hidden, at.weights)

    def _descend(self, iterations: int) -> None:
        """Adam on the hidden layers, on minibatches, everything else fixed."""
        config, best, width = self.config, self._best, self.config.width
        count = len(self.measured)
        through = torch.from_numpy(best.weights[-width:])
        fixed = torch.from_numpy(self._projection.past_hidden(best.weights))
        measured = torch.from_numpy(self.measured)
        theta = torch.tensor(self._theta(best.solution))
        mask = None if self.mask is None else torch.from_numpy(self.mask)
        value, rate = torch.from_numpy(self._projection.skipped[:, :, 1:]).swapaxes(0, 1)
        learning_rate = config.learning_rate * 0.5 ** (self._iteration / HALF_LIFE)
        generator = np.random.default_rng((config.seed, self._iteration))
        first = int(config.weight_initial > 0)  # Ψ_R looks at the first instant, once
        for _ in range(iterations):
            pick = generator.integers(first, count, size=min(config.batch, count))
            pick[:first] = 0
            active, active_rate = self._learnable.activations(value[pick], rate[pick])
            terms = loss_terms(
                fixed[pick, 0] + active @ through,
                fixed[pick, 1] + active_rate @ through,
                measured[pick],
                theta,
                config,
                None if mask is None else mask[pick],
                self.model,
            )
            self._adam.step(terms.total, learning_rate)
        self._iteration += iterations

    def outputs(self) -> FloatArray:
        """(N, 2M+1) the present surrogate on all instants."""
        return self._surrogate(self._best)[0]

    def _learned(self, solution: Solution) -> Learned:
        """What was learned, with parameters as a solution."""
        self.network.set_output(self._best.weights)
        now = self.progress
        loss = {"total": now.total, "data": now.data, "physics": now.physics}
        return Learned(
            outputs=self.outputs(),
            solution=solution,
            loss=loss | {"initial": now.initial, "start": self._start_loss},
            network_weights=self.network.size,
            arrays=self.network.arrays(),
            findings=self._training_findings(self._start_loss),
        )


class FastTraining(ProjectedTraining[Solution]):
    """The training of the CTHP."""

    def __init__(
        self,
        segment: Segment,
        case: Case,
        config: PinnConfig,
        threads: int = 1,
    ) -> None:
        """See `ProjectedTraining`."""
        initial = Parameters.of([config.initial.values] * segment.followers)
        super().__init__(segment, case, config, threads, Solution.of(initial.theta))

    def _theta(self, solution: Solution) -> FloatArray:
        return solution.theta

    def _parameters(self, solution: Solution) -> Parameters:
        return solution.parameters

    def _move(self, now: Solution, before: Solution) -> float:
        """Largest relative change of α, β, τ; one at zero counts by its absolute change."""
        new, old = now.parameters.values, before.parameters.values
        scale = np.where(np.abs(old) > 1e-9, np.abs(old), 1.0)
        return float(np.nanmax(np.abs(new - old) / scale, initial=0.0))

    def _output(
        self, hidden: FloatArray, sums: NormalEquations, solution: Solution, near: FloatArray
    ) -> FloatArray:
        return solve_output(sums, solution.theta, self.config)

    def _solved(self, at: Optimum[Solution]) -> Optimum[Solution]:
        solution = solve_parameters(at.sums, at.weights, self.case)
        weights = solve_output(at.sums, solution.theta, self.config)
        return replace(at, weights=weights, solution=solution)

    def learned(self) -> Learned:
        """The surrogate, the parameters, and what training the hidden layers brought."""
        return self._learned(self._best.solution)
