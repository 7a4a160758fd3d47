"""The `fast` recipe: gradient descent where the network is nonlinear, exact solves where it is not.

The surrogate is y(t) = [φ(t), h(φ(t))] W: Fourier features φ of time (`features`), three tanh
layers h on top of them, and one output layer W that sees both. Three kinds of unknowns, each
learned by what suits it:

    hidden layers      Adam on minibatches of Ψ
    output layer W     Ψ is quadratic in it: solved exactly (`exact`)
    α, ατ, β           Ψ is quadratic in them: solved exactly, within their bounds (`exact`)

Training starts with rounds of the two exact solves from the user's initial values, until the
parameters stand still; that is the best the untrained hidden layers can do. Then cycles of
`CYCLE` Adam iterations, each followed by exact solves, train the hidden layers. Each exact round
and each Adam iteration counts as one iteration.
"""

import numpy as np
import torch
from torch import Tensor

from accpinn.methods.fit import Outcome, Progress
from accpinn.methods.pinn.adam import Adam
from accpinn.methods.pinn.features import FourierFeatures
from accpinn.methods.pinn.loss import loss_terms
from accpinn.methods.pinn.network import HIDDEN, HiddenLayers, count_weights
from accpinn.methods.pinn.protocol import Checkpoint, Learned, Problem, as_table, from_table
from accpinn.methods.pinn.variable_projection import (
    RIDGE,
    GramMatrices,
    NormalEquations,
    solve_output,
    solve_parameters,
)
from accpinn.methods.pinn.warm_start import WarmStart
from accpinn.model.cthp import PlatoonSolution
from accpinn.units import FloatArray

CYCLE = 50
"""Adam iterations between exact solves."""
HALF_LIFE = 100
"""Iterations in which Adam's learning rate halves: minibatch noise must fade for Ψ to settle."""
STANDSTILL = 1e-4
"""Exact rounds go on until no parameter moves by more than this share."""
START_ROUNDS = 50
"""At most so many exact rounds before the hidden layers are trained."""
CYCLE_ROUNDS = 3
"""At most so many exact rounds after a cycle."""
SETTLED_PARAMETERS = 1e-3
SETTLED_LOSS = 1e-2
"""Settled: over a cycle no parameter moved by more than 0.1 % and Ψ fell by less than 1 %,
twice in a row."""
SETTLED_CYCLES = 2
LITTLE_GAIN = 0.02
"""Training the hidden layers is said to bring little when Ψ falls by less than this share."""


class FastTraining:
    """See the module's head; one `advance` is an exact round or a cycle."""

    def __init__(self, problem: Problem) -> None:
        """Build the network and solve its output layer at the initial parameters."""
        self.problem = problem
        config = problem.config
        self._features = FourierFeatures(float(problem.time[-1]), config.highest_frequency)
        self._static = _StaticMoments(problem, self._features)
        self._hidden = HiddenLayers(self._features.size - 1, config.seed, torch.float32)
        self._adam = Adam(self._hidden.parameters(), b2=0.99)
        self._generator = torch.Generator().manual_seed(config.seed)
        self._theta = from_table(np.tile(np.array(config.initial), (problem.followers, 1)))
        self._exact = PlatoonSolution(self._theta, self._theta, ((),) * problem.followers)
        self._starting, self._iteration, self._quiet_cycles = True, 0, 0
        self._start_loss = float("nan")
        self._measure()
        self._weights = solve_output(self._moments, self._theta, config)
        self.progress = self._look("start")
        self.outcome = self._end()

    def begin_from(self, warm: WarmStart) -> None:
        """Begin anew, from what an earlier training has learned."""
        problem, angular = self.problem, warm.arrays.get("features.angular")
        table = warm.parameters(problem.case, problem.followers)
        weights = warm.arrays.get("output.weight")
        fits = weights is not None and weights.shape == tuple(self._weights.shape)
        if not fits or angular is None or not np.array_equal(angular, self._features.angular):
            raise warm.misfit()
        warm.load_into(self._hidden, "hidden.")
        self._theta = from_table(np.broadcast_to(table, (problem.followers, 3)))
        self._exact = PlatoonSolution(self._theta, self._theta, ((),) * problem.followers)
        self._measure()
        self._weights = torch.from_numpy(np.array(weights, float))
        self.progress = self._look("start")
        self.outcome = self._end()

    def advance(self) -> None:
        """One exact round while starting; afterwards one cycle."""
        before = self.progress
        try:
            if self._starting:
                self._starting = self._round() > STANDSTILL
                self._iteration += 1
                self._starting &= self._iteration < START_ROUNDS
                self.progress = self._look("start")
                self._start_loss = self.progress.total
            else:
                self._descend(min(CYCLE, self.problem.config.iterations - self._iteration))
                self._measure()
                for _ in range(CYCLE_ROUNDS):
                    if self._round() <= STANDSTILL:
                        break
                self.progress = self._look("Adam")
        except (np.linalg.LinAlgError, torch.linalg.LinAlgError):  # type: ignore[attr-defined]
            self.outcome = Outcome.DIVERGED
            return
        self.outcome = self._judge(before)

    def _judge(self, before: Progress) -> Outcome | None:
        """Count quiet cycles, the present one against the one ``before``."""
        now = self.progress
        if now.phase == before.phase == "Adam":
            still = _largest_move(now.parameters, before.parameters) <= SETTLED_PARAMETERS
            still = still and now.total >= (1 - SETTLED_LOSS) * before.total
            self._quiet_cycles = self._quiet_cycles + 1 if still else 0
        return self._end()

    def _end(self) -> Outcome | None:
        """How the training has ended, if it has."""
        if not np.isfinite(self.progress.total):
            return Outcome.DIVERGED
        if self._quiet_cycles >= SETTLED_CYCLES:
            return Outcome.SETTLED
        return Outcome.FINISHED if self._iteration >= self.problem.config.iterations else None

    def _round(self) -> float:
        """One exact solve of output layer and parameters; the parameters' largest move."""
        problem, before = self.problem, as_table(self._theta)
        self._weights = solve_output(self._moments, self._theta, problem.config)
        self._exact = solve_parameters(self._moments, self._weights, problem.case)
        self._theta = self._exact.theta
        return _largest_move(as_table(self._theta), before)

    def _descend(self, iterations: int) -> None:
        """Adam on the hidden layers, on minibatches, everything else fixed."""
        problem, size = self.problem, self._features.size
        weights = self._weights.float()
        skip = (self._static.value @ self._weights[:size]).float()
        skip_rate = (self._static.rate @ self._weights[:size]).float()
        theta = torch.from_numpy(self._theta).float()
        measured, counted = self._static.measured_single, problem.counted
        counted = None if counted is None else counted.float()
        count = len(problem.time)
        batch = min(problem.config.batch, count)
        learning_rate = problem.config.learning_rate * 0.5 ** (self._iteration / HALF_LIFE)
        for _ in range(iterations):
            pick = torch.randint(count, (batch,), generator=self._generator)
            if problem.config.weight_initial:
                pick[0] = 0  # Ψ_R looks at the first instant
            active, active_rate = self._hidden(
                self._static.value_single[pick], self._static.rate_single[pick]
            )
            outputs = skip[pick] + active @ weights[size:]
            rates = skip_rate[pick] + active_rate @ weights[size:]
            told = None if counted is None else counted[pick]
            terms = loss_terms(outputs, rates, measured[pick], theta, problem.config, told)
            terms.total.backward()
            self._adam.step(learning_rate)
        self._iteration += iterations

    def _measure(self) -> None:
        """The activations on all instants in double precision, and their moments."""
        self._active, self._active_rate = self._activations()
        self._moments = self._static.with_hidden(self._active, self._active_rate)

    @torch.no_grad()
    def _activations(self) -> tuple[Tensor, Tensor]:
        doubled = HiddenLayers(self._features.size - 1, 0, torch.float64)
        doubled.load_state_dict(self._hidden.state_dict())
        value, rate = doubled(self._static.value[:, 1:], self._static.rate[:, 1:])
        return value, rate

    def _surrogate(self) -> tuple[Tensor, Tensor]:
        size, weights = self._features.size, self._weights
        outputs = self._static.value @ weights[:size] + self._active @ weights[size:]
        rates = self._static.rate @ weights[:size] + self._active_rate @ weights[size:]
        return outputs, rates

    def _look(self, phase: str) -> Progress:
        terms = self.problem.evaluate(*self._surrogate(), self._theta)
        planned = self.problem.config.iterations
        return self.problem.progress(phase, self._iteration, terms, as_table(self._theta), planned)

    def learned(self) -> Learned:
        """The surrogate, the parameters, and what training the hidden layers brought."""
        now = self.progress
        arrays = {f"hidden.{k}": v.numpy() for k, v in self._hidden.state_dict().items()}
        arrays["output.weight"] = self._weights.numpy()
        arrays["features.angular"] = self._features.angular
        loss = {"total": now.total, "data": now.data, "physics": now.physics}
        loss |= {"initial": now.initial, "start": self._start_loss}
        return Learned(
            outputs=self._surrogate()[0].numpy(),
            solution=self._exact,
            loss=loss,
            network_weights=count_weights(self._hidden) + self._weights.numel(),
            arrays=arrays,
            notes=self._notes(),
        )

    def _notes(self) -> tuple[str, ...]:
        notes = []
        now, start = self.progress, self._start_loss
        if now.phase == "Adam" and start > 0:
            gain = 1 - now.total / start
            notes.append(
                f"Training the hidden layers lowered Ψ from {start:#.3g} to {now.total:#.3g}"
                f" ({100 * gain:.0f} % lower)."
                if gain >= LITTLE_GAIN
                else f"Training the hidden layers brought little here: Ψ was {start:#.4g} before"
                f" and is {now.total:#.4g} now; the exact solve did the work."
            )
        if self.outcome is Outcome.FINISHED:
            notes.append(
                f"Ψ or a parameter was still moving when the {self._iteration:,} planned iterations"
                " ended; more iterations, or other initial values, may bring a better result."
            )
        return tuple(notes)

    def state(self) -> Checkpoint:
        """Hidden layers, Adam's moments, output layer, parameters and the random generator."""
        state: Checkpoint = {f"hidden.{k}": v.numpy() for k, v in self._hidden.state_dict().items()}
        state |= self._adam.state()
        state["generator"] = self._generator.get_state().numpy()
        state["theta"] = self._theta
        state["output.weight"] = self._weights.numpy()
        state["counters"] = np.array([self._starting, self._iteration, self._quiet_cycles])
        state["start_loss"] = np.array(self._start_loss)
        state["phase"] = np.array(self.progress.phase)
        return state

    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``."""
        layers = {k: v for k, v in state.items() if k.startswith("hidden.")}
        self._hidden.load_state_dict(
            {k.removeprefix("hidden."): torch.from_numpy(np.array(v)) for k, v in layers.items()}
        )
        self._adam.restore(state)
        self._generator.set_state(torch.from_numpy(np.array(state["generator"])))
        self._theta = np.array(state["theta"], float)
        self._starting = bool(state["counters"][0])
        self._iteration, self._quiet_cycles = (int(v) for v in state["counters"][1:])
        self._start_loss = float(state["start_loss"])
        self._measure()
        self._weights = torch.from_numpy(np.array(state["output.weight"], float))
        if self._iteration:
            self._exact = solve_parameters(self._moments, self._weights, self.problem.case)
        self.progress = self._look(str(state["phase"]))
        self.outcome = self._end()


class _StaticMoments:
    """Moments of the input features, computed once, to which those of the hidden layers join."""

    def __init__(self, problem: Problem, features: FourierFeatures) -> None:
        value = features(problem.time)
        slope = features.derivative()
        rate = value @ slope
        self.value, self.rate = torch.from_numpy(value), torch.from_numpy(rate)
        self.value_single = self.value[:, 1:].float()
        self.rate_single = self.rate[:, 1:].float()
        self.measured = torch.from_numpy(problem.measured)
        self.measured_single = self.measured.float()
        self._slope = torch.from_numpy(slope)
        self._count = len(value)
        self._counted = problem.counted
        self._gram = self.value.T @ self.value / self._count
        self._data = self.value.T @ self.measured / self._count

    def with_hidden(self, active: Tensor, active_rate: Tensor) -> NormalEquations:
        """Moments of Φ = [φ, h] from the activations h (N, H) and their rates."""
        slope, width = self._slope, HIDDEN[-1]
        both = torch.cat([active, active_rate], 1)
        cross = self.value.T @ both / self._count
        inner = both.T @ both / self._count
        cross_value, cross_rate = cross[:, :width], cross[:, width:]

        def join(top: Tensor, right: Tensor, left: Tensor, corner: Tensor) -> Tensor:
            return torch.cat([torch.cat([top, right], 1), torch.cat([left, corner], 1)], 0)

        value_value = join(self._gram, cross_value, cross_value.T, inner[:width, :width])
        value_value += (
            RIDGE
            * value_value.trace()
            / len(value_value)
            * torch.eye(len(value_value), dtype=value_value.dtype)
        )
        rate_value = join(
            slope.T @ self._gram, slope.T @ cross_value, cross_rate.T, inner[width:, :width]
        )
        rate_rate = join(
            slope.T @ self._gram @ slope,
            slope.T @ cross_rate,
            cross_rate.T @ slope,
            inner[width:, width:],
        )
        return NormalEquations(
            value_value=value_value,
            rate_value=rate_value,
            rate_rate=rate_rate,
            value_data=torch.cat([self._data, active.T @ self.measured / self._count], 0),
            first=torch.cat([self.value[0], active[0]]),
            first_data=self.measured[0],
            lawful=self._lawful(active, active_rate),
        )

    def _lawful(self, active: Tensor, active_rate: Tensor) -> tuple[GramMatrices, ...]:
        """Products over each follower's instants that count; none where all do."""
        if self._counted is None:
            return ()
        value = torch.cat([self.value, active], 1)
        rate = torch.cat([self.rate, active_rate], 1)
        rows = [column.nonzero()[:, 0] for column in self._counted.T]
        return tuple(GramMatrices.of(value[at], rate[at], self._count) for at in rows)


def _largest_move(now: FloatArray, before: FloatArray) -> float:
    """Largest relative change of any parameter; one at zero counts by its absolute change."""
    scale = np.where(np.abs(before) > 1e-9, np.abs(before), 1.0)
    return float(np.nanmax(np.abs(now - before) / scale, initial=0.0))
