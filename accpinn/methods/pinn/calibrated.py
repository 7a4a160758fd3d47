"""The `calibrated` preset: the network trained by its evidence, where `fast` minimises its loss.

    α, ατ, β, disturbance, noise    maximise the evidence of each follower given the vehicle ahead
                                    (`evidence`), in rounds, with banded splines as features
    output layer W                  its most probable value at them, exact (`evidence_output`)
    hidden layers                   Adam on minibatches of Ψ, the negative log density that the
                                    evidence integrates; after each cycle W is solved again

The first kind ends before the others begin, as an estimate that the hidden layers could still move
would no longer be that of the evidence. A cycle that does not lower Ψ is taken back. Intervals of
the parameters follow from the evidence's curvature. Rounds and Adam iterations are counted alike.

The skip features reach up to `PinnConfig.highest_frequency` on a period that is longer than the
window; the hidden layers see those below `HIDDEN_FREQUENCY`.
"""

import numpy as np
from numpy.typing import NDArray

from accpinn.methods.fit import Checkpoint, Outcome
from accpinn.methods.likelihood import log_errors, natural, vanishing
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.evidence import Evidence
from accpinn.methods.pinn.evidence_output import OutputLayer
from accpinn.methods.pinn.evidence_search import Ascent, begin, refine
from accpinn.methods.pinn.loss import Learned, LossTerms, Training
from accpinn.methods.pinn.network import HIDDEN_FREQUENCY, Descent, FourierFeatures, Numbers
from accpinn.methods.pinn.request import WarmStart
from accpinn.methods.regression import Regression, Solution
from accpinn.methods.series import series_of, stride_of
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, frozen

Picked = NDArray[np.int64]
"""Which instants or samples make a minibatch."""

CYCLE = 25
"""Adam iterations between exact solves."""
CONVERGED_LOSS = 1e-2
"""Converged: over a cycle Ψ fell by less than 1 %."""
HALF_LIFE = 100
"""Iterations in which Adam's learning rate halves."""


class CalibratedTraining(Training):
    """See the module's head; one `advance` is a round of every ascent, or a cycle."""

    def __init__(self, segment: Segment, case: Case, config: PinnConfig, threads: int = 1) -> None:
        """Begin the ascents at the estimate of least squares."""
        super().__init__(segment, case, config, threads)
        self._series = series_of([segment], case)
        self._count = int(np.isfinite(self._series.measured).sum())
        with np.errstate(all="ignore"):  # absurd numbers end as diverged
            regression = Regression.of(segment)
            if np.isfinite(regression.grams()).all():
                self._start(regression.solve(case).theta)
            else:
                self._start(np.zeros((self.followers, 3)))

    def _start(self, theta: FloatArray) -> None:
        groups = self._series.groups
        self._fine: Evidence | None = None
        self._ascents = begin(self._series, theta[:groups])
        self._iteration, self._quiet, self._start_loss = 0, False, float("nan")
        duration = float(self.segment.time[-1])
        self._fourier = FourierFeatures.up_to(self.config.highest_frequency, duration)
        seen = self._fourier.below(HIDDEN_FREQUENCY)
        self._seen = seen.size
        self._descent = Descent(seen, self.config.hidden, self.config.seed, order=3)
        self._layer: OutputLayer | None = None
        size = self._fourier.size + self.config.width
        self._weights = np.zeros((size, self.measured.shape[1]))
        self._note("evidence")

    def begin_from(self, warm: WarmStart) -> None:
        """Begin anew, from what an earlier training has learned."""
        initial = warm.initial(self.case, self.followers)
        everyone = Parameters.of(np.broadcast_to(initial.values, (self.followers, 3)))
        self._start(everyone.theta)
        self._descent.hidden.load(warm.arrays)

    def advance(self) -> None:
        """A round of every ascent that has not ended; then the output layer; then cycles."""
        try:
            with np.errstate(all="ignore"):
                if self._layer is None:
                    self._ascend()
                else:
                    self._cycle()
        except np.linalg.LinAlgError:
            self.outcome = Outcome.DIVERGED

    def _ascend(self) -> None:
        climbing = [one for one in self._ascents if not one.ended]
        for ascent in climbing:
            ascent.advance()
        self._iteration += 1
        if all(one.ended for one in self._ascents):
            if self._fine is None:
                fine = self._fine = Evidence(self._series)
                self._ascents = [refine(fine, one, g) for g, one in enumerate(self._ascents)]
            else:
                for one in self._ascents:
                    one.finish()
                self._build()
                self._solve()
                self._note("start")
                self._start_loss = self.progress.total
                return
        self._note("evidence")

    def _build(self) -> None:
        """What does not change any more once the unknowns are known."""
        values = np.array([natural("cthp", one.coordinates) for one in self._ascents])
        values = np.broadcast_to(values, (self.followers, values.shape[1]))
        segment = self.segment
        self._layer = OutputLayer(
            self.measured,
            stride_of(segment),
            segment.sample_time,
            segment.mask,
            self._fourier,
            values,
        )

    def _solve(self) -> None:
        """W at its most probable value for the present hidden layers, and Ψ there."""
        layer, size = self._layer, self._fourier.size
        assert layer is not None
        active, at_samples = self._active(layer.on_grid), self._active(layer.at_samples)[0]
        weights = self._weights = layer.solve(active, at_samples)
        orders = layer.orders @ weights[:size] + active @ weights[size:]
        outputs = layer.at_samples @ weights[:size] + at_samples @ weights[size:]
        self._terms = LossTerms(*layer.terms(orders, outputs))

    def _active(self, features: FloatArray) -> Numbers:
        """(4, N, width) the activations of features (N, size) in double precision."""
        return self._descent.doubled()(features[:, : self._seen])

    def _cycle(self) -> None:
        """Adam on the hidden layers, then W; both taken back where Ψ did not fall."""
        before, weights = self._terms, self._weights
        hidden = self._descent.hidden.values.copy()
        steps = min(CYCLE, self.config.iterations - self._iteration)
        self._descend(steps)
        self._iteration += steps
        self._solve()
        if not self._terms.total < before.total:
            self._descent.hidden.values[:] = hidden
            self._terms, self._weights = before, weights
        self._quiet = bool(self._terms.total >= (1 - CONVERGED_LOSS) * before.total)
        self._note("Adam")

    def _descend(self, steps: int) -> None:
        """Adam on minibatches of Ψ; as in `fast`, what the skip connection gives is fixed."""
        layer, size, seen = self._layer, self._fourier.size, self._seen
        assert layer is not None
        skip, of_active = self._weights[:size], self._weights[size:].astype(np.float32)
        fixed = layer.residuals(layer.orders @ skip).astype(np.float32)
        misfit = (layer.at_samples @ skip - layer.data).astype(np.float32)
        through = (self._weights[size:] @ layer.forms).astype(np.float32)
        instants, samples = len(fixed), len(misfit)
        batch = min(self.config.batch, instants, samples) // 2
        quadrature = (layer.weights * (instants / batch / layer.count)).astype(np.float32)
        precision = (layer.precision * (samples / batch / layer.count)).astype(np.float32)
        inputs = layer.on_grid[:, :seen].astype(np.float32)
        at_samples = layer.at_samples[:, :seen].astype(np.float32)
        rate = self.config.learning_rate * 0.5 ** (self._iteration / HALF_LIFE)
        generator = self._descent.generator(self._iteration)
        for _ in range(steps):
            at = generator.integers(instants, size=batch)
            of = generator.integers(samples, size=batch)

            def slope(active: Numbers, at: Picked = at, of: Picked = of) -> Numbers:
                residuals = fixed[at] + (active[:, :batch] @ through).sum(axis=0)
                errors = misfit[of] + active[0, batch:] @ of_active
                found = np.zeros_like(active)
                found[:, :batch] = (residuals * quadrature[at]) @ through.swapaxes(1, 2)
                found[0, batch:] = (errors * precision) @ of_active.T
                return found

            features = np.concatenate([inputs[at], at_samples[of]])
            self._descent.adam.step(self._descent.hidden.gradient(features, slope), rate)

    def _note(self, phase: str) -> None:
        """Look at the present moment, and see if it ends."""
        z = np.array([one.coordinates for one in self._ascents])
        z = np.broadcast_to(z, (self.followers, z.shape[1]))
        theta, free = vanishing("cthp", z), natural("cthp", z)[:, :3]
        self._solution = Solution(frozen(theta), frozen(free), np.asarray(theta == 0.0))
        if phase == "evidence":
            data, physics = np.sum([one.loss() for one in self._ascents], axis=0) / self._count
            self._terms = LossTerms(data, physics, initial=0.0)
        evidence = float(sum(one.value for one in self._ascents))
        deviations = np.array([log_errors(one.curvature) for one in self._ascents])
        self._look(
            phase, self._iteration, self._terms, self._solution.parameters, evidence, deviations
        )
        finished = Outcome.FINISHED if self._iteration >= self.planned else None
        converged = phase == "Adam" and self._quiet
        self.outcome = Outcome.CONVERGED if converged else finished
        if not np.isfinite([self.progress.total, evidence]).all():
            self.outcome = Outcome.DIVERGED

    def outputs(self) -> FloatArray | None:
        """(N, 2M+1) the present surrogate; None while the evidence is still sought without one."""
        return None if self._layer is None else self._surrogate()

    def learned(self) -> Learned:
        """The surrogate, the parameters, and what training the hidden layers brought."""
        now = self.progress
        arrays = self._descent.hidden.state()
        # Stopped early: the best output layer at the present unknowns.
        if self._layer is None and self.outcome is not Outcome.DIVERGED:
            self._build()
            self._solve()
        arrays["output.weight"] = self._weights
        arrays["features.angular"] = self._fourier.angular
        arrays["unknowns"] = np.array([natural("cthp", one.coordinates) for one in self._ascents])
        errors = [log_errors(one.curvature) for one in self._ascents]
        arrays["deviations"] = np.nan_to_num(errors, posinf=0.0)
        loss = {"total": now.total, "data": now.data, "physics": now.physics}
        loss |= {"initial": now.initial, "start": self._start_loss, "evidence": now.evidence}
        return Learned(
            outputs=self._surrogate(),
            solution=self._solution,
            loss=loss,
            network_weights=self._descent.hidden.values.size + self._weights.size,
            arrays=arrays,
            findings=self._training_findings(self._start_loss),
        )

    def _surrogate(self) -> FloatArray:
        features = self._fourier(self.segment.time)
        return np.hstack([features, self._active(features)[0]]) @ self._weights

    def state(self) -> Checkpoint:
        """Every ascent; hidden layers, Adam's moments, output layer."""
        state = self._descent.state()
        for group, ascent in enumerate(self._ascents):
            state |= {f"ascent.{group}.{name}": v for name, v in ascent.state().items()}
        layer = self._layer is not None
        state["counters"] = np.array([self._fine is not None, layer, self._iteration, self._quiet])
        state["start_loss"] = np.array(self._start_loss)
        state["phase"] = np.array(self.progress.phase)
        return state

    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``."""
        self._descent.restore(state)
        fine, layer, self._iteration, quiet = (int(v) for v in state["counters"])
        self._quiet = bool(quiet)
        self._start_loss = float(state["start_loss"])
        criterion = self._ascents[0].criterion
        if fine:
            criterion = self._fine = Evidence(self._series)
        for group in range(self._series.groups):
            prefix = f"ascent.{group}."
            kept = {n.removeprefix(prefix): v for n, v in state.items() if n.startswith(prefix)}
            self._ascents[group] = Ascent.restored(criterion, group, kept)
        if layer:
            self._build()
            self._solve()
        self._note(str(state["phase"]))
