"""The `fast` preset: gradient descent where the network is nonlinear, exact solves where it is not.

The surrogate is y(t) = [φ(t), h(φ(t))] W: Fourier features φ of time (`surrogate`), three tanh
layers h on top of them, and one output layer W that sees both. Three kinds of unknowns, each
learned by what suits it:

    hidden layers      Adam on minibatches of Ψ
    output layer W     Ψ is quadratic in it: solved exactly (`variable_projection`)
    α, ατ, β           Ψ is quadratic in them: solved exactly, within their bounds

Training starts with rounds of the two exact solves from the user's initial values, until the
parameters stand still; that is the optimum for the untrained hidden layers. Then cycles of
`CYCLE` Adam iterations, each followed by exact solves, train the hidden layers. Each exact round
and each Adam iteration counts as one iteration.
"""

from dataclasses import replace
from math import sqrt

import numpy as np
import torch
from torch import Tensor

from accpinn.methods.fit import (
    Checkpoint,
    HiddenLayersGain,
    IterationsExhausted,
    MethodFinding,
    Outcome,
    Progress,
)
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import Learned, Training, residuals
from accpinn.methods.pinn.method import FourierFeatures, WarmStart
from accpinn.methods.pinn.network import Derivative, Descent, count_weights, load_state, state_of
from accpinn.methods.pinn.variable_projection import (
    RIDGE,
    GramMatrices,
    NormalEquations,
    solve_output,
    solve_parameters,
)
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
START_ROUNDS = 50
"""At most so many exact rounds before the hidden layers are trained."""
CYCLE_ROUNDS = 3
"""At most so many exact rounds after a cycle."""
CONVERGED_PARAMETERS = 1e-3
CONVERGED_LOSS = 1e-2
CONVERGED_CYCLES = 2
"""Converged: over a cycle no parameter moved by more than 0.1 % and Ψ fell by less than 1 %,
twice in a row."""


class FastTraining(Training):
    """See the module's head; one `advance` is an exact round or a cycle."""

    def __init__(self, segment: Segment, case: Case, config: PinnConfig) -> None:
        """Build the network and solve its output layer at the initial parameters."""
        super().__init__(segment, case, config)
        self._features = FourierFeatures(float(segment.time[-1]), config.highest_frequency)
        self._static = _StaticSums(segment.time, self.measured, self.mask, self._features)
        self._descent = Descent(self._features.size - 1, config.hidden, config.seed)
        initial = Parameters.of([config.initial.values] * self.followers)
        self._solution = Solution.of(initial.theta)
        self._starting, self._iteration, self._quiet_cycles = True, 0, 0
        self._start_loss = float("nan")
        self._measure()
        self._weights = solve_output(self._sums, self._solution.theta, config)
        self._note("start")

    def begin_from(self, warm: WarmStart) -> None:
        """Begin anew, from what an earlier training has learned."""
        initial = warm.initial(self.case, self.followers).values
        angular = warm.arrays.get("features.angular")
        weights = warm.arrays.get("output.weight")
        fits = weights is not None and weights.shape == tuple(self._weights.shape)
        if not fits or angular is None or not np.array_equal(angular, self._features.angular):
            raise ValueError("the weights are another network's")
        load_state(self._descent.hidden, warm.arrays, "hidden.")
        everyone = Parameters.of(np.broadcast_to(initial, (self.followers, 3)))
        self._solution = Solution.of(everyone.theta)
        self._measure()
        self._weights = torch.from_numpy(np.array(weights, float))
        self._note("start")

    def advance(self) -> None:
        """One exact round while starting; afterwards one cycle."""
        before = self.progress
        try:
            if self._starting:
                self._starting = self._round() > STANDSTILL
                self._iteration += 1
                self._starting &= self._iteration < START_ROUNDS
                self._note("start")
                self._start_loss = self.progress.total
            else:
                self._descend(min(CYCLE, self.config.iterations - self._iteration))
                self._measure()
                for _ in range(CYCLE_ROUNDS):
                    if self._round() <= STANDSTILL:
                        break
                self._note("Adam", before)
        except (np.linalg.LinAlgError, torch.linalg.LinAlgError):  # type: ignore[attr-defined]
            self.outcome = Outcome.DIVERGED

    def _note(self, phase: str, before: Progress | None = None) -> None:
        """Look at the present moment, count it if quiet since ``before``, and see if it ends."""
        solution = self._solution
        terms = self.evaluate(*self._surrogate(), solution.theta)
        self._look(phase, self._iteration, terms, solution.parameters)
        now = self.progress
        if before and now.phase == before.phase == "Adam":
            still = _largest_move(now.parameters, before.parameters) <= CONVERGED_PARAMETERS
            still = still and now.total >= (1 - CONVERGED_LOSS) * before.total
            self._quiet_cycles = self._quiet_cycles + 1 if still else 0
        finished = Outcome.FINISHED if self._iteration >= self.planned else None
        self.outcome = Outcome.CONVERGED if self._quiet_cycles >= CONVERGED_CYCLES else finished
        if not np.isfinite(now.total):
            self.outcome = Outcome.DIVERGED

    def _round(self) -> float:
        """One exact solve of output layer and parameters; the parameters' largest move."""
        before = self._solution
        self._weights = solve_output(self._sums, before.theta, self.config)
        self._solution = solve_parameters(self._sums, self._weights, self.case)
        return _largest_move(self._solution.parameters, before.parameters)

    @torch.no_grad()
    def _descend(self, iterations: int) -> None:
        """Adam on the hidden layers, on minibatches, everything else fixed.

        The residuals are linear in the activations and their rates, so each minibatch needs only
        those of the skip connection, computed once, and two small matrices.
        """
        config, size, count = self.config, self._features.size, len(self.measured)
        skip, weights = self._weights[:size], self._weights[size:]
        nothing = torch.zeros_like(weights)
        fixed = self._weighted(*self._static.outputs(skip), self.measured)
        of_value = self._weighted(weights, nothing, nothing)
        of_rate = self._weighted(nothing, weights, nothing)
        batch = min(config.batch, count)
        learning_rate = config.learning_rate * 0.5 ** (self._iteration / HALF_LIFE)
        counts = torch.ones_like(fixed)
        if self.mask is not None:
            counts[:, self.followers : 2 * self.followers] = self.mask
        if config.weight_initial:  # Ψ_R squares some of the first instant's residuals once more
            s_gap, s_speed = config.weight_data
            again = batch * config.weight_initial
            counts[0, 2 * self.followers : 3 * self.followers] += again / s_gap
            counts[0, 3 * self.followers + 1 :] += again / s_speed
        counts *= 2 / (batch * self.followers)

        for _ in range(iterations):
            pick = torch.randint(count, (batch,), generator=self._descent.generator)
            if config.weight_initial:
                pick[0] = 0  # Ψ_R looks at the first instant

            def slope(value: Tensor, rate: Tensor, pick: Tensor = pick) -> tuple[Tensor, Tensor]:
                found = fixed[pick] + value @ of_value + rate @ of_rate
                found *= counts[pick]
                return found @ of_value.T, found @ of_rate.T

            features = self._static.value_single[pick]
            self._descent.hidden.backpropagate(features, self._static.derivative_single, slope)
            self._descent.adam.step(learning_rate)
        self._iteration += iterations

    def _weighted(self, outputs: Tensor, rates: Tensor, measured: Tensor) -> Tensor:
        """(N, 4M+1) `Residuals` side by side, in single precision, by the root of their weights."""
        found = residuals(outputs, rates, measured, torch.tensor(self._solution.theta))
        weights = (*self.config.weight_physics, *self.config.weight_data)
        parts = [sqrt(weight) * part for weight, part in zip(weights, found, strict=True)]
        return torch.cat(parts, 1).float()

    def _measure(self) -> None:
        """The activations on all instants in double precision, and their sums."""
        self._active, self._active_rate = self._activations()
        self._sums = self._static.with_hidden(self._active, self._active_rate)

    @torch.no_grad()
    def _activations(self) -> tuple[Tensor, Tensor]:
        static = self._static
        return self._descent.doubled().of_fourier(static.value, static.derivative)

    def _surrogate(self) -> tuple[Tensor, Tensor]:
        size, weights = self._features.size, self._weights
        outputs, rates = self._static.outputs(weights[:size])
        outputs += self._active @ weights[size:]
        rates += self._active_rate @ weights[size:]
        return outputs, rates

    def outputs(self) -> FloatArray:
        """(N, 2M+1) the present surrogate on all instants."""
        return self._surrogate()[0].numpy()

    def learned(self) -> Learned:
        """The surrogate, the parameters, and what training the hidden layers brought."""
        now, start = self.progress, self._start_loss
        arrays = state_of(self._descent.hidden, "hidden.")
        arrays["output.weight"] = self._weights.numpy()
        arrays["features.angular"] = self._features.angular
        loss = {"total": now.total, "data": now.data, "physics": now.physics}
        loss |= {"initial": now.initial, "start": start}
        found: list[MethodFinding] = []
        if now.phase == "Adam" and start > 0:
            found.append(HiddenLayersGain(start, now.total))
        if self.outcome is Outcome.FINISHED:
            found.append(IterationsExhausted(self._iteration))
        return Learned(
            outputs=self.outputs(),
            solution=self._solution,
            loss=loss,
            network_weights=count_weights(self._descent.hidden) + self._weights.numel(),
            arrays=arrays,
            findings=tuple(found),
        )

    def state(self) -> Checkpoint:
        """Hidden layers, Adam's moments, output layer, parameters and the random generator."""
        state = self._descent.state()
        state["theta"] = self._solution.theta
        state["output.weight"] = self._weights.numpy()
        state["counters"] = np.array([self._starting, self._iteration, self._quiet_cycles])
        state["start_loss"] = np.array(self._start_loss)
        state["phase"] = np.array(self.progress.phase)
        return state

    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``."""
        self._descent.restore(state)
        self._solution = Solution.of(np.array(state["theta"], float))
        self._starting = bool(state["counters"][0])
        self._iteration, self._quiet_cycles = (int(v) for v in state["counters"][1:])
        self._start_loss = float(state["start_loss"])
        self._measure()
        self._weights = torch.from_numpy(np.array(state["output.weight"], float))
        if self._iteration:
            solution = solve_parameters(self._sums, self._weights, self.case)
            self._solution = replace(solution, theta=self._solution.theta)
        self._note(str(state["phase"]))


class _StaticSums:
    """Sums of products of the input features, computed once; the hidden layers' join them."""

    def __init__(
        self, time: FloatArray, measured: Tensor, mask: Tensor | None, features: FourierFeatures
    ) -> None:
        self.value, factors = torch.from_numpy(features(time)), torch.from_numpy(features.factors)
        self.value_single = self.value.float()
        self.derivative = Derivative(factors)
        self.derivative_single = Derivative(factors.float())
        self.measured = measured
        self._count = len(self.value)
        self._mask = mask
        self._gram = self.value.T @ self.value / self._count
        self._data = self.value.T @ self.measured / self._count

    def outputs(self, weights: Tensor) -> tuple[Tensor, Tensor]:
        """(N, L) what an output layer (size, L) makes of the features alone, and its rate."""
        both = self.value @ torch.cat([weights, self.derivative.times(weights)], 1)
        outputs, rates = both.split(weights.shape[1], 1)
        return outputs, rates

    def with_hidden(self, active: Tensor, active_rate: Tensor) -> NormalEquations:
        """The sums for Φ = [φ, h] from the activations h (N, H) and their rates."""
        turned, width = self.derivative.transposed, active.shape[1]
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
        turned_rate = turned(cross_rate)
        rate_value = join(
            turned(self._gram), turned(cross_value), cross_rate.T, inner[width:, :width]
        )
        rate_rate = join(
            turned(turned(self._gram).T), turned_rate, turned_rate.T, inner[width:, width:]
        )
        return NormalEquations(
            value_value=value_value,
            rate_value=rate_value,
            rate_rate=rate_rate,
            value_data=torch.cat([self._data, active.T @ self.measured / self._count], 0),
            first=torch.cat([self.value[0], active[0]]),
            first_data=self.measured[0],
            masked=self._masked(active, active_rate),
        )

    def _masked(self, active: Tensor, active_rate: Tensor) -> tuple[GramMatrices, ...]:
        """Sums over the instants of each follower that count; empty where all do."""
        if self._mask is None:
            return ()
        value = torch.cat([self.value, active], 1)
        rate = torch.cat([self.derivative.of(self.value), active_rate], 1)
        rows = [column.nonzero()[:, 0] for column in self._mask.T]
        return tuple(GramMatrices.of(value[at], rate[at], self._count) for at in rows)


def _largest_move(now: Parameters, before: Parameters) -> float:
    """Largest relative change of any parameter; one at zero counts by its absolute change."""
    scale = np.where(np.abs(before.values) > 1e-9, np.abs(before.values), 1.0)
    return float(np.nanmax(np.abs(now.values - before.values) / scale, initial=0.0))
