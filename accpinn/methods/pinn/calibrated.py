"""The `calibrated` preset: parameters by the network's evidence, where `fast` minimises its loss.

    α, ατ, β, disturbance, noise    maximise the evidence of each follower given the vehicle ahead
                                    (`evidence`), in rounds, with splines as features
    curves                          the network's output layer, exact for these parameters (`drawn`)

The first ends before the second begins, as an estimate that the curves could still move would no
longer be that of the evidence. The hidden layers stay as they were drawn by the seed: training them
would lower Ψ by some percent and move no parameter. Standard errors of the parameters follow from
the filter's expected information.
"""

from dataclasses import replace

import numpy as np

from accpinn.methods.estimate import Fit, Outcome
from accpinn.methods.likelihood import Ascending, ascend, log_errors, natural, vanishing
from accpinn.methods.maximum_likelihood import joint_maxima
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.evidence import Evidence
from accpinn.methods.pinn.loss import (
    LossTerms,
    Motion,
    Training,
    has_earlier,
    loss_terms,
    stack_outputs,
    trajectories,
)
from accpinn.methods.pinn.network import Network
from accpinn.methods.pinn.projection import Projection, solve_output
from accpinn.methods.regression import Solution
from accpinn.methods.series import series_of
from accpinn.methods.state_space import complete
from accpinn.model.cthp import Case
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from accpinn.units import frozen


class CalibratedTraining(Training):
    """See the module's head; one `advance` is a round of the search."""

    _drawn: Fit | None
    """Once the search has ended."""

    @np.errstate(all="ignore")  # absurd numbers end as diverged
    def __init__(
        self,
        segments: tuple[Segment, ...],
        case: Case,
        config: PinnConfig,
        spec: ModelSpec,
    ) -> None:
        """Begin the search where the filter's likelihood is largest.

        The evidences of the segments add up; the first one is drawn.
        """
        super().__init__(segments[0], case, config)
        self._form = spec.model
        self._evidence = Evidence(series_of(segments, case), spec)
        self._iteration, self._drawn = 0, None
        # The evidence has the filter's maxima, all but, and the filter takes less time to compare.
        start = joint_maxima(segments, case, spec)
        z = np.array([maximum.coordinates for maximum in start])
        self._search = ascend(self._evidence, z, np.arange(len(z)))
        self._at: Ascending = next(self._search)
        self._note()

    @np.errstate(all="ignore")
    def advance(self) -> None:
        """A round of the search; after the last one the exact output layer."""
        try:
            self._iteration += 1
            self._at = next(self._search)
            self._note()
        except np.linalg.LinAlgError:
            self.outcome = Outcome.DIVERGED

    def _note(self) -> None:
        """Look at the present moment; Ψ is that of the splines, and of the network at the end."""
        z, is_last = self._at.coordinates, bool(self._at.maxima)
        everyone = np.broadcast_to(z, (self.followers, z.shape[1]))
        unknowns, theta = natural(self._form, everyone), vanishing(self._form, everyone)
        terms = complete(self._form, unknowns)[:, 3:]
        self._solution = Solution(frozen(theta), frozen(unknowns[:, :3]), theta == 0.0, terms)
        deviations = np.array([log_errors(each) for each in self._at.information])
        evidence = float(self._at.value.sum())
        if is_last:
            self._drawn = self.drawn(self.segment)
            loss = self._drawn.loss
            psi = LossTerms(loss["data"], loss["physics"], loss["initial"])
        else:
            psi = self._evidence.loss(z, self.config)
        phase = "curves" if is_last else "evidence"
        parameters = self._solution.parameters
        self._look(phase, self._iteration, psi, parameters, evidence, deviations)
        if is_last and self.outcome is not Outcome.DIVERGED:
            self.outcome = Outcome.CONVERGED

    def drawn(self, segment: Segment) -> Fit:
        """A window's fit with the present parameters, whose output layer minimises Ψ for these.

        Ψ is of the gaps without s₀.
        """
        config, theta = self.config, self._solution.theta
        network = Network(segment.followers, config, float(segment.time[-1]))
        intercepts, lags, delays = self._solution.terms.T
        shift = stack_outputs(np.zeros((1, segment.followers + 1)), intercepts[None])
        measured = stack_outputs(segment.speeds, segment.gaps) - shift
        mask = has_earlier(segment) if delays.any() else segment.mask
        order = 2 if lags.any() else 1
        projection = Projection(network, segment.time, measured, mask, order)
        hidden = projection.hidden()
        sums = projection.sums(hidden)
        if lags.any() or delays.any():
            # One follower after the other, as each takes as much memory as the network.
            late = (projection.late(hidden, *pair) for pair in zip(lags, delays, strict=True))
            sums = sums.with_late(late, mask)
        weights = solve_output(sums, theta, config)
        network.set_output(weights)
        motion = Motion(*projection.surrogate(hidden, weights))
        if delays.any():
            motion = motion.with_earlier(network, segment.time, delays)
        kept = None if mask is None else mask.astype(float)
        loss = loss_terms(motion, measured, theta, config, kept, lags=lags)
        weights[0] += shift[0]
        network.set_output(weights)
        return Fit.of(
            "pinn",
            segment,
            self.case,
            self._solution,
            surrogate=trajectories(segment.time, motion.outputs + shift),
            outcome=Outcome.CONVERGED,
            config=config.to_json(),
            loss=loss.values() | {"evidence": float(self._at.value.sum())},
            network_weights=network.size,
            arrays=network.arrays(),
        )

    def surrogate(self) -> None:
        """None: curves are drawn once the search has ended."""

    @np.errstate(all="ignore")
    def fit(self) -> Fit:
        """The surrogate and the parameters, also of a search that was stopped."""
        if self.outcome is Outcome.DIVERGED:
            nothing = trajectories(self.segment.time, np.zeros_like(self.measured))
            return self._fit(self._solution, nothing, {"total": np.nan})
        fit = self._drawn or self.drawn(self.segment)
        deviations = [log_errors(each) for each in self._at.information]
        arrays = {
            "unknowns": natural(self._form, self._at.coordinates),
            "deviations": np.nan_to_num(deviations, posinf=0.0),
        }
        return replace(
            fit,
            outcome=self.outcome or Outcome.STOPPED,
            iterations=self.progress.iteration,
            arrays=fit.arrays | arrays,
        )
