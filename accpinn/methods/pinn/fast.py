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

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from accpinn.methods.fit import Checkpoint, Outcome, Progress
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import Learned, Training, loss_terms, residuals
from accpinn.methods.pinn.network import Descent, FourierFeatures, HiddenLayers, Numbers
from accpinn.methods.pinn.request import WarmStart
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
from accpinn.units import FloatArray, Mask

AT_ONCE = 4000
"""Instants whose activations are summed as one task; a longer window's tasks share the threads."""
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

    @np.errstate(all="ignore")  # absurd numbers end as diverged
    def __init__(self, segment: Segment, case: Case, config: PinnConfig, threads: int = 1) -> None:
        """Build the network and solve its output layer at the initial parameters."""
        super().__init__(segment, case, config, threads)
        self._features = FourierFeatures.up_to(config.highest_frequency, float(segment.time[-1]))
        self._static = _StaticSums(segment.time, self.measured, segment.mask, self._features)
        self._descent = Descent(self._features, config.hidden, config.seed, order=1)
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
        self._descent.hidden.load(warm.arrays)
        everyone = Parameters.of(np.broadcast_to(initial, (self.followers, 3)))
        self._solution = Solution.of(everyone.theta)
        self._measure()
        self._weights = np.array(weights, float)
        self._note("start")

    @np.errstate(all="ignore")
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
        except np.linalg.LinAlgError:
            self.outcome = Outcome.DIVERGED

    def _note(self, phase: str, before: Progress | None = None) -> None:
        """Look at the present moment, count it if quiet since ``before``, and see if it ends."""
        solution = self._solution
        outputs, rates = self._surrogate()
        theta, mask = solution.theta, self.mask
        terms = loss_terms(outputs, rates, self.measured, theta, self.config, mask)
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

    def _descend(self, iterations: int) -> None:
        """Adam on the hidden layers, on minibatches, everything else fixed.

        The residuals are linear in the activations and their rates, so each minibatch needs only
        those of the skip connection, computed once, and two small matrices.
        """
        config, size, count = self.config, self._features.size, len(self.measured)
        skip, weights = self._weights[:size], self._weights[size:]
        nothing = np.zeros_like(weights)
        fixed = self._weighted(*self._static.outputs(skip), self.measured)
        of_value = self._weighted(weights, nothing, nothing)
        of_rate = self._weighted(nothing, weights, nothing)
        batch = min(config.batch, count)
        learning_rate = config.learning_rate * 0.5 ** (self._iteration / HALF_LIFE)
        counts = np.ones_like(fixed)
        if self.mask is not None:
            counts[:, self.followers : 2 * self.followers] = self.mask
        if config.weight_initial:  # Ψ_R squares some of the first instant's residuals once more
            s_gap, s_speed = config.weight_data
            again = batch * config.weight_initial
            counts[0, 2 * self.followers : 3 * self.followers] += again / s_gap
            counts[0, 3 * self.followers + 1 :] += again / s_speed
        counts *= 2 / (batch * self.followers)

        generator = self._descent.generator(self._iteration)
        first = int(config.weight_initial > 0)  # Ψ_R looks at the first instant, once
        for _ in range(iterations):
            pick = generator.integers(first, count, size=batch)
            pick[:first] = 0

            def slope(active: Numbers, pick: NDArray[np.int64] = pick) -> Numbers:
                found = fixed[pick] + active[0] @ of_value + active[1] @ of_rate
                found *= counts[pick]
                return np.stack([found @ of_value.T, found @ of_rate.T])

            gradient = self._descent.hidden.gradient(self._static.value_single[pick], slope)
            self._descent.adam.step(gradient, learning_rate)
        self._iteration += iterations

    def _weighted(self, outputs: FloatArray, rates: FloatArray, measured: FloatArray) -> Numbers:
        """(N, 4M+1) `Residuals` side by side, in single precision, by the root of their weights."""
        found = residuals(outputs, rates, measured, self._solution.theta)
        weights = (*self.config.weight_physics, *self.config.weight_data)
        parts = [sqrt(weight) * part for weight, part in zip(weights, found, strict=True)]
        return np.hstack(parts).astype(np.float32)

    def _measure(self) -> None:
        """The activations on all instants in double precision, and their sums."""
        self._active, self._active_rate, self._sums = self._static.with_hidden(
            self._descent.doubled(), self.threads
        )

    def _surrogate(self) -> tuple[FloatArray, FloatArray]:
        size, weights = self._features.size, self._weights
        outputs, rates = self._static.outputs(weights[:size])
        return outputs + self._active @ weights[size:], rates + self._active_rate @ weights[size:]

    def outputs(self) -> FloatArray:
        """(N, 2M+1) the present surrogate on all instants."""
        return self._surrogate()[0]

    def learned(self) -> Learned:
        """The surrogate, the parameters, and what training the hidden layers brought."""
        now, start = self.progress, self._start_loss
        arrays = self._descent.hidden.state()
        arrays["output.weight"] = self._weights
        arrays["features.angular"] = self._features.angular
        loss = {"total": now.total, "data": now.data, "physics": now.physics}
        loss |= {"initial": now.initial, "start": start}
        return Learned(
            outputs=self.outputs(),
            solution=self._solution,
            loss=loss,
            network_weights=self._descent.hidden.values.size + self._weights.size,
            arrays=arrays,
            findings=self._training_findings(start),
        )

    def state(self) -> Checkpoint:
        """Hidden layers, Adam's moments, output layer and parameters."""
        state = self._descent.state()
        state["theta"] = self._solution.theta
        state["output.weight"] = self._weights
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
        self._weights = np.array(state["output.weight"], float)
        if self._iteration:
            solution = solve_parameters(self._sums, self._weights, self.case)
            self._solution = replace(solution, theta=self._solution.theta)
        self._note(str(state["phase"]))


class _StaticSums:
    """Sums of products of the input features, computed once; the hidden layers' join them."""

    def __init__(
        self, time: FloatArray, measured: FloatArray, mask: Mask | None, features: FourierFeatures
    ) -> None:
        self.value, self._features, self._measured = features(time), features, measured
        self.value_single = self.value.astype(np.float32)
        self._count = len(self.value)
        self._mask = mask
        self._gram = self.value.T @ self.value / self._count
        self._data = self.value.T @ measured / self._count

    def outputs(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N, L) what an output layer (size, L) makes of the features alone, and its rate."""
        both = self.value @ np.hstack([weights, self._features.times(weights)])
        outputs, rates = np.hsplit(both, 2)
        return outputs, rates

    def with_hidden(
        self, hidden: HiddenLayers, threads: int
    ) -> tuple[FloatArray, FloatArray, NormalEquations]:
        """The activations h (N, H), their rates, and the sums for Φ = [φ, h]."""

        @np.errstate(all="ignore")  # a thread begins with numpy's own
        def part(start: int) -> tuple[FloatArray, FloatArray, FloatArray]:
            value = self.value[start : start + AT_ONCE]
            both = np.hstack(list(hidden(value)))
            return both, value.T @ both, both.T @ both

        with ThreadPoolExecutor(threads) as pool:
            parts = list(pool.map(part, range(0, self._count, AT_ONCE)))
        both = np.concatenate([one for one, _, _ in parts])
        cross = np.sum([one for _, one, _ in parts], axis=0) / self._count
        inner = np.sum([one for _, _, one in parts], axis=0) / self._count
        active, active_rate = np.hsplit(both, 2)
        turned, width = self._features.transposed, active.shape[1]
        cross_value, cross_rate = cross[:, :width], cross[:, width:]

        value_value = np.block([[self._gram, cross_value], [cross_value.T, inner[:width, :width]]])
        value_value += RIDGE * value_value.trace() / len(value_value) * np.eye(len(value_value))
        turned_rate = turned(cross_rate)
        rate_value = np.block(
            [[turned(self._gram), turned(cross_value)], [cross_rate.T, inner[width:, :width]]]
        )
        twice = turned(turned(self._gram).T)
        rate_rate = np.block([[twice, turned_rate], [turned_rate.T, inner[width:, width:]]])
        sums = NormalEquations(
            value_value=value_value,
            rate_value=rate_value,
            rate_rate=rate_rate,
            value_data=np.vstack([self._data, active.T @ self._measured / self._count]),
            first=np.concatenate([self.value[0], active[0]]),
            first_data=self._measured[0],
            masked=self._masked(active, active_rate),
        )
        return active, active_rate, sums

    def _masked(self, active: FloatArray, active_rate: FloatArray) -> tuple[GramMatrices, ...]:
        """Sums over the instants of each follower that count; empty where all do."""
        if self._mask is None:
            return ()
        value = np.hstack([self.value, active])
        rate = np.hstack([self._features.derivative(self.value), active_rate])
        return tuple(GramMatrices.of(value[at], rate[at], self._count) for at in self._mask.T)


def _largest_move(now: Parameters, before: Parameters) -> float:
    """Largest relative change of any parameter; one at zero counts by its absolute change."""
    scale = np.where(np.abs(before.values) > 1e-9, np.abs(before.values), 1.0)
    return float(np.nanmax(np.abs(now.values - before.values) / scale, initial=0.0))
