"""The `fast` preset: gradient descent where the network is nonlinear, exact solves where it is not.

The network (`network`, with Fourier features) has three kinds of unknowns, each learned by what
suits it:

    hidden layers      Adam on minibatches of Ψ
    output layer W     Ψ is quadratic in it: solved exactly (`projection`)
    α, ατ, β           Ψ is quadratic in them: solved exactly, within their bounds

Training starts with rounds of the two exact solves from the user's initial values, until the
parameters stand still; that is the optimum for the untrained hidden layers. Then cycles of
`CYCLE` Adam iterations, each followed by exact solves, train the hidden layers. A cycle that moves
no parameter is the last one, and one that does not lower Ψ is taken back. Each exact round at the
start and each Adam iteration counts as one iteration.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch

from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import Learned, LossTerms, Training, loss_terms
from accpinn.methods.pinn.network import Adam, Network
from accpinn.methods.pinn.projection import NormalEquations, solve_output, solve_parameters
from accpinn.methods.regression import Solution
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
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
class _Optimum:
    """The exact optimum, as far as sought, for some hidden layers."""

    hidden: FloatArray
    """(N, 2, width) the activations and their derivative in time."""
    sums: NormalEquations
    weights: FloatArray
    """(K, 2M+1) W, biases in the first row."""
    solution: Solution


class FastTraining(Training):
    """See the module's head; one `advance` is an exact round or a cycle."""

    @np.errstate(all="ignore")  # absurd numbers end as diverged
    def __init__(
        self,
        segment: Segment,
        case: Case,
        config: PinnConfig,
        threads: int = 1,
        held: Solution | None = None,
    ) -> None:
        """Build the network and solve its output layer at the initial parameters.

        Args:
            segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
            case: "I" or "II".
            config: the settings.
            threads: processor threads.
            held: parameters that are not to be moved.
        """
        super().__init__(segment, case, config, threads)
        torch.set_num_threads(threads)
        self.network = Network(self.followers, config, float(segment.time[-1]))
        with torch.no_grad():
            value, rate = self.network.features(torch.tensor(segment.time))
        # (N, 2, F + 1) a constant and the features, which the output layer sees as well.
        self._skipped = np.zeros((len(value), 2, value.shape[1] + 1))
        self._skipped[:, 0, 0] = 1.0
        self._skipped[:, 0, 1:], self._skipped[:, 1, 1:] = value, rate
        features = torch.from_numpy(self._skipped)[:, :, 1:]
        self._features = features[:, 0], features[:, 1]
        self._skipped_sums = NormalEquations.of(self._skipped, self.measured, segment.mask)
        self._adam = Adam(list(self.network.hidden.parameters()), b2=0.99)
        self._held = held
        initial = Parameters.of([config.initial.values] * self.followers)
        self._starting, self._iteration = held is None, 0
        self._start_loss = float("nan")
        self._best = self._optimum(held or Solution.of(initial.theta))
        self._note("start")

    @np.errstate(all="ignore")
    def advance(self) -> None:
        """One exact round while starting; afterwards one cycle."""
        try:
            if self._starting:
                before = self._best.solution
                self._best = self._solved(self._best)
                self._iteration += 1
                moved = _largest_move(self._best.solution, before)
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
        after = self._optimum(before.solution)
        for _ in range(CYCLE_ROUNDS):
            last = after.solution
            after = self._solved(after)
            if _largest_move(after.solution, last) <= STANDSTILL:
                break
        terms = self._terms(after)
        if terms.total < loss:
            self._best = after
            self._note("Adam", terms)
        else:
            self.network.load_arrays(kept)
            self._note("Adam")
        moved = _largest_move(self._best.solution, before.solution)
        if steps == CYCLE and moved <= CONVERGED and self.outcome is not Outcome.DIVERGED:
            self.outcome = Outcome.CONVERGED

    def _terms(self, at: _Optimum) -> LossTerms:
        """Ψ on all instants."""
        outputs, rates = self._surrogate(at)
        theta = at.solution.theta
        return loss_terms(outputs, rates, self.measured, theta, self.config, self.mask)

    def _note(self, phase: str, terms: LossTerms | None = None) -> None:
        """Look at the present moment, with Ψ where it is known already."""
        best = self._best
        self._look(phase, self._iteration, terms or self._terms(best), best.solution.parameters)
        if phase == "start":
            self._start_loss = self.progress.total

    def _optimum(self, solution: Solution) -> _Optimum:
        """The output layer's optimum for the present hidden layers and some parameters."""
        with torch.no_grad():
            hidden = torch.stack(self.network.activations(*self._features), 1).numpy()
        mask = self.segment.mask
        sums = self._skipped_sums.extended(self._skipped, hidden, self.measured, mask)
        return _Optimum(hidden, sums, solve_output(sums, solution.theta, self.config), solution)

    def _surrogate(self, at: _Optimum) -> tuple[FloatArray, FloatArray]:
        """(N, 2M+1) outputs and their rates."""
        both = self._from_features(at) + _mapped(at.hidden, at.weights[-self.config.width :])
        return both[:, 0], both[:, 1]

    def _from_features(self, at: _Optimum) -> FloatArray:
        """(N, 2, 2M+1) what the skip connection contributes."""
        return _mapped(self._skipped, at.weights[: -self.config.width])

    def _solved(self, at: _Optimum) -> _Optimum:
        """One exact round: the parameters, unless they are held, and then the output layer."""
        if self._held:
            return at
        solution = solve_parameters(at.sums, at.weights, self.case)
        weights = solve_output(at.sums, solution.theta, self.config)
        return replace(at, weights=weights, solution=solution)

    def _descend(self, iterations: int) -> None:
        """Adam on the hidden layers, on minibatches, everything else fixed."""
        config, best, width = self.config, self._best, self.config.width
        count = len(self.measured)
        through = torch.from_numpy(best.weights[-width:])
        fixed = torch.from_numpy(self._from_features(best))
        measured, theta = torch.from_numpy(self.measured), torch.tensor(best.solution.theta)
        mask = None if self.mask is None else torch.from_numpy(self.mask)
        value, rate = self._features
        learning_rate = config.learning_rate * 0.5 ** (self._iteration / HALF_LIFE)
        generator = np.random.default_rng((config.seed, self._iteration))
        first = int(config.weight_initial > 0)  # Ψ_R looks at the first instant, once
        for _ in range(iterations):
            pick = generator.integers(first, count, size=min(config.batch, count))
            pick[:first] = 0
            active, active_rate = self.network.activations(value[pick], rate[pick])
            terms = loss_terms(
                fixed[pick, 0] + active @ through,
                fixed[pick, 1] + active_rate @ through,
                measured[pick],
                theta,
                config,
                None if mask is None else mask[pick],
            )
            self._adam.step(terms.total, learning_rate)
        self._iteration += iterations

    def outputs(self) -> FloatArray:
        """(N, 2M+1) the present surrogate on all instants."""
        return self._surrogate(self._best)[0]

    def learned(self) -> Learned:
        """The surrogate, the parameters, and what training the hidden layers brought."""
        biases, *weights = self._best.weights
        with torch.no_grad():
            self.network.output.bias.copy_(torch.tensor(biases))
            self.network.output.weight.copy_(torch.tensor(np.array(weights)).T)
        now = self.progress
        loss = {"total": now.total, "data": now.data, "physics": now.physics}
        return Learned(
            outputs=self.outputs(),
            solution=self._best.solution,
            loss=loss | {"initial": now.initial, "start": self._start_loss},
            network_weights=self.network.size,
            arrays=self.network.arrays(),
            findings=self._training_findings(self._start_loss),
        )


def _largest_move(now: Solution, before: Solution) -> float:
    """Largest relative change of α, β, τ; one at zero counts by its absolute change."""
    new, old = now.parameters.values, before.parameters.values
    scale = np.where(np.abs(old) > 1e-9, np.abs(old), 1.0)
    return float(np.nanmax(np.abs(new - old) / scale, initial=0.0))


def _mapped(columns: FloatArray, weights: FloatArray) -> FloatArray:
    """(N, 2, L) from values and rates (N, 2, K) and weights (K, L)."""
    flat = columns.reshape(-1, columns.shape[2]) @ weights
    return np.asarray(flat.reshape(len(columns), 2, -1))
