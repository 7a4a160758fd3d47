"""The `fast` preset: gradient descent where the network is nonlinear, exact solves where it is not.

The networks of the windows (`network`, with Fourier features) and the parameters that they share
have three kinds of unknowns, each learned by what suits it:

    hidden layers      Adam on minibatches of Ψ_w, each window's own
    output layers W    Ψ_w is quadratic in each: solved exactly
    α, ατ, β           Ψ is quadratic in them: solved exactly, within their bounds

Training starts with rounds of the two exact solves from the user's initial values, until the
parameters stand still; that is the optimum for the untrained hidden layers. Then cycles of
`CYCLE` Adam iterations, each followed by exact solves, train the hidden layers. A cycle that moves
no parameter is the last one, and one that does not lower Ψ is taken back. Each exact round at the
start and each Adam iteration of all windows counts as one iteration.

`projection` has the exact solves; `following` replaces them by Gauss-Newton steps for other models.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from accpinn.methods import Segments
from accpinn.methods.estimate import Estimate, Outcome, for_window
from accpinn.methods.findings import HiddenLayersGain
from accpinn.methods.pinn.config import CYCLE, USUAL_CYCLES, USUAL_ROUNDS, PinnConfig
from accpinn.methods.pinn.loss import (
    LossTerms,
    LossTraining,
    Motion,
    WindowData,
    loss_terms,
    trajectories,
    weighted_sum,
)
from accpinn.methods.pinn.network import Network, output_arrays
from accpinn.methods.pinn.paper import Adam
from accpinn.methods.pinn.projection import (
    NormalEquations,
    Projection,
    parameter_equations,
    solve_output,
)
from accpinn.methods.regression import Solution, solve_platoon
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.units import FloatArray

HALF_LIFE = 100
"""Iterations in which Adam's learning rate halves: minibatch noise must fade for Ψ to converge."""
STANDSTILL = 1e-4
"""Exact rounds go on until no parameter moves by more than this share."""
START_ROUNDS = 300
"""Largest number of exact rounds before the hidden layers are trained; some ten are usual, and 200
where the physics weighs a hundred times as much as the data."""
APPROACH, CYCLE_SHARE = (0.05, 0.9), 0.5
"""Range of the share of a move that the next exact round has, and the share in a cycle."""
CYCLE_ROUNDS = 3
"""Largest number of exact rounds after a cycle."""
CONVERGED = 1e-3
"""Largest share by which a parameter moves over the last cycle."""


class Surrogate:
    """The network of one window in training, and the data that it learns."""

    def __init__(self, data: WindowData, config: PinnConfig, order: int) -> None:
        """Draw its weights, and sum what does not pass through the hidden layers."""
        segment = data.segment
        self.data = data
        self.network = Network(segment.followers, config, float(segment.time[-1]))
        self.projection = Projection(self.network, segment.time, data.measured, segment.mask, order)
        self.learnable = self.network.learnable()
        self.adam = Adam([*self.learnable.weights()][:-2], b2=0.99)


@dataclass(frozen=True, eq=False)
class Seen:
    """The inputs of a window's output layer, for some hidden layers."""

    arrays: dict[str, NDArray[Any]]
    """The network's weights."""
    hidden: FloatArray
    """(N, 1 + order, width) the activations and their derivatives in time."""
    sums: NormalEquations
    whole: FloatArray = field(default_factory=lambda: np.empty(0))
    """(N, 1 + order, K) Φ and its derivatives, for another model than the CTHP."""
    earlier: tuple[FloatArray, ...] = ()
    """(M,) of (N, 2, K): Φ and its rate at t - d of each follower of a model with a delay."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """The surrogate of a window: what its output layer sees, and this layer."""

    seen: Seen
    weights: FloatArray
    """(K, 2M+1) W, biases in the first row."""
    motion: Motion
    """On all instants."""


@dataclass(frozen=True, eq=False)
class Optimum:
    """The exact optimum, as far as sought, for some hidden layers."""

    windows: tuple[Fitted, ...]
    solution: Any
    """The parameters: a `Solution` of the CTHP, or z (S, n) of another model."""


class FastTraining(LossTraining):
    """See the module's head; one `advance` is an exact round, or a window's share of a cycle.

    What is solved for is θ here, as a `Solution`; another model has unknowns of its own.
    """

    @np.errstate(all="ignore")  # absurd numbers end as diverged
    def __init__(
        self,
        segments: Segments,
        case: Case,
        config: PinnConfig,
        threads: int = 1,
        spec: ModelSpec = PAPER_SPEC,
    ) -> None:
        """Build the networks and solve their output layers at the initial parameters."""
        super().__init__(segments, case, config, spec)
        torch.set_num_threads(threads)
        self.surrogates = tuple(Surrogate(data, config, self.order) for data in self.windows)
        self._starting, self._iteration, self._started = True, 0, 0
        self._moves: list[float] = []
        """Largest change of a parameter in each exact round so far, or in each cycle."""
        self._trained: list[Seen] = []
        """The windows whose hidden layers the present cycle has trained."""
        self._start_loss = float("nan")
        initial = self._initial()
        seen = [self._seen(window, initial) for window in self.surrogates]
        self._best = self._optimum(seen, initial)
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

    def _seen(self, window: Surrogate, solution: Any) -> Seen:
        """The inputs of a window's output layer for its present hidden layers."""
        hidden = window.projection.hidden()
        return Seen(window.network.arrays(), hidden, window.projection.sums(hidden))

    def _motion(self, window: Surrogate, seen: Seen, weights: FloatArray) -> Motion:
        """The surrogate on all instants."""
        return Motion(*window.projection.surrogate(seen.hidden, weights))

    def _output(
        self, window: Surrogate, seen: Seen, solution: Any, near: FloatArray | None
    ) -> FloatArray:
        """(K, 2M+1) the output layer's optimum, which is ``near`` another one."""
        return solve_output(seen.sums, solution.theta, self.config)

    def _solved(self, at: Optimum) -> Optimum:
        """Run one exact round: solve for the parameters and the output layers."""
        equations = (parameter_equations(part.seen.sums, part.weights) for part in at.windows)
        grams, moments = (
            weighted_sum(parts, self.shares) for parts in zip(*equations, strict=True)
        )
        solution = solve_platoon(grams, moments, self.case)
        return self._optimum([part.seen for part in at.windows], solution)

    def _optimum(self, seen: Sequence[Seen], solution: Any, near: Optimum | None = None) -> Optimum:
        """The output layers' optimum for some parameters."""
        fitted = []
        for k, (window, part) in enumerate(zip(self.surrogates, seen, strict=True)):
            former = near.windows[k].weights if near else None
            weights = self._output(window, part, solution, former)
            fitted.append(Fitted(part, weights, self._motion(window, part, weights)))
        return Optimum(tuple(fitted), solution)

    @np.errstate(all="ignore")
    def advance(self) -> None:
        """Run one exact round while starting; afterwards a window's share of a cycle."""
        try:
            if self._starting:
                before = self._best.solution
                self._best = self._solved(self._best)
                self._iteration += 1
                moved = self._move(self._best.solution, before)
                self._moves.append(moved)
                self._started = self._iteration
                if moved <= STANDSTILL or self._iteration >= START_ROUNDS:
                    self._starting, self._moves = False, []
                self._note("start" if self._starting else "Adam")
                return
            self._trained.append(self._descended(len(self._trained)))
            if len(self._trained) == len(self.surrogates):
                self._end_cycle()
        except np.linalg.LinAlgError:
            self.outcome = Outcome.DIVERGED

    def _end_cycle(self) -> None:
        """Exact rounds once the hidden layers of all windows have been trained."""
        before, loss, steps = self._best, self.progress.total, self._steps
        after = self._optimum(self._trained, before.solution, before)
        self._trained = []
        self._iteration += steps
        for _ in range(CYCLE_ROUNDS):
            last = after.solution
            after = self._solved(after)
            if self._move(after.solution, last) <= STANDSTILL:
                break
        terms: LossTerms | None = self._loss(after)
        if terms is not None and terms.total < loss:
            self._best = after
        else:
            terms = None
            for window, part in zip(self.surrogates, before.windows, strict=True):
                window.network.load_arrays(part.seen.arrays)
        moved = self._move(self._best.solution, before.solution)
        self._moves.append(moved)
        self._note("Adam", terms)
        if steps == CYCLE and moved <= CONVERGED and self.outcome is not Outcome.DIVERGED:
            self.outcome = Outcome.CONVERGED

    @property
    def _steps(self) -> int:
        """Adam iterations of the present cycle."""
        return min(CYCLE, self.planned - self._iteration)

    def _loss(self, at: Optimum) -> LossTerms:
        """Ψ on all instants."""
        theta = self._theta(at.solution)
        terms = [
            loss_terms(part.motion, data.measured, theta, self.config, data.mask, self.model)
            for part, data in zip(at.windows, self.windows, strict=True)
        ]
        return LossTerms.mean(terms, self.shares)

    def _note(self, phase: str, terms: LossTerms | None = None) -> None:
        """Look at the present moment, with Ψ where it is known already."""
        best = self._best
        parameters = self._parameters(best.solution)
        self._look(phase, self._iteration, terms or self._loss(best), parameters, self._expected())
        if self._iteration == self._started:
            self._start_loss = self.progress.total

    def _expected(self) -> int:
        """The iteration at which the phase probably ends, as its moves fade by about one share."""
        now, before = (self._moves[-1:] or [0.0])[0], (self._moves[-2:] or [0.0])[0]
        is_paper = self.model is None
        if not self._starting:
            usual = USUAL_CYCLES[is_paper]
            cycles = np.log(CONVERGED / now) / np.log(CYCLE_SHARE) if now > 0.0 else usual
            return self._iteration + int(CYCLE * np.clip(cycles, 1.0, 2 * usual))
        usual = USUAL_ROUNDS[is_paper]
        share = np.clip(now / before if before > 0.0 else 0.0, *APPROACH)
        rounds = np.log(STANDSTILL / now) / np.log(share) if now > 0.0 else usual
        if len(self._moves) < usual // 2:  # at first they rise and fall
            rounds = usual - self._iteration
        return self._iteration + max(1, int(np.ceil(min(rounds, usual))))

    def _descended(self, k: int) -> Seen:
        """Adam on the hidden layers of a window, on minibatches, everything else fixed."""
        config, window, data = self.config, self.surrogates[k], self.windows[k]
        measured, motion_at = torch.from_numpy(data.measured), self._motion_of_hidden(k)
        count, theta = len(measured), torch.tensor(self._theta(self._best.solution))
        mask = None if data.mask is None else torch.from_numpy(data.mask)
        learning_rate = config.learning_rate * 0.5 ** (self._iteration / HALF_LIFE)
        generator = np.random.default_rng((config.seed, self._iteration))
        first = int(config.weight_initial > 0)  # Ψ_R looks at the first instant, once
        for _ in range(self._steps):
            pick = generator.integers(first, count, size=min(config.batch, count))
            pick[:first] = 0
            counts = None if mask is None else mask[pick]
            terms = loss_terms(motion_at(pick), measured[pick], theta, config, counts, self.model)
            window.adam.step(terms.total, learning_rate)
        return self._seen(window, self._best.solution)

    def _motion_of_hidden(self, k: int) -> Callable[[Any], Motion]:
        """A window's surrogate at picked instants, whose hidden layers alone can be moved."""
        window, weights = self.surrogates[k], self._best.windows[k].weights
        through = torch.from_numpy(weights[-self.config.width :])
        fixed = torch.from_numpy(window.projection.past_hidden(weights)).swapaxes(0, 1)
        features, learnable = torch.from_numpy(window.projection.skipped), window.learnable

        def motion(pick: Any) -> Motion:
            active = learnable.activations(learnable.with_rates(features[pick], self.order))
            pairs = zip(fixed, active, strict=True)
            return Motion(*(part[pick] + moved @ through for part, moved in pairs))

        return motion

    def curves(self) -> Trajectories:
        """The present surrogate of the first window, on all instants."""
        return self._curves()[0]

    def _curves(self) -> list[Trajectories]:
        pairs = zip(self.windows, self._best.windows, strict=True)
        return [trajectories(data.segment.time, part.motion.outputs) for data, part in pairs]

    def _result(self) -> Solution | Parameters:
        """The present parameters of all followers."""
        solution: Solution = self._best.solution
        return solution

    def estimate(self) -> Estimate:
        """The surrogates, the parameters, and what training the hidden layers brought."""
        now, start = self.progress, self._start_loss
        is_trained = now.iteration > self._started and start > 0
        gain = [HiddenLayersGain(start, now.total)] if is_trained else []
        loss = {"total": now.total, "data": now.data, "physics": now.physics}
        arrays: dict[str, FloatArray] = {}
        for k, part in enumerate(self._best.windows):
            arrays |= for_window(part.seen.arrays | output_arrays(part.weights), k)
        return self._estimate(
            self._result(),
            self._curves(),
            loss=loss | {"initial": now.initial, "start": start},
            network_weights=self.surrogates[0].network.size,
            arrays=arrays,
            findings=gain,
        )
