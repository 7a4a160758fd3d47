"""The `calibrated` preset: parameters by the network's evidence, where `fast` minimises its loss.

    α, ατ, β, disturbance, noise    maximise the evidence of each follower given the vehicle ahead
                                    (`evidence`), in rounds, with splines as features
    curves                          drawn by the network of `fast` with these parameters held

The first ends before the second begins, as an estimate that the curves could still move would no
longer be that of the evidence. Standard errors of the parameters follow from the evidence's
curvature. Rounds and Adam iterations are counted alike.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from accpinn.methods.fit import Outcome
from accpinn.methods.likelihood import (
    Ascending,
    Maximum,
    log_errors,
    natural,
    vanishing,
)
from accpinn.methods.maximum_likelihood import joint_maxima
from accpinn.methods.method import PAPERS, Law
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.evidence import Evidence, climb
from accpinn.methods.pinn.loss import Learned, LossTerms, Training
from accpinn.methods.regression import Solution
from accpinn.methods.series import series_of
from accpinn.methods.state_space import Form, complete
from accpinn.model.cthp import Case
from accpinn.model.registry import PAPER
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, frozen

if TYPE_CHECKING:
    from accpinn.methods.pinn.fast import FastTraining


def solution_of(coordinates: FloatArray, followers: int, form: Form = PAPER) -> Solution:
    """α, ατ and β at coordinates (G, P), as a solution for all followers."""
    everyone = np.broadcast_to(coordinates, (followers, coordinates.shape[1]))
    theta, free = vanishing(form, everyone), natural(form, everyone)[:, :3]
    return Solution(frozen(theta), frozen(free), np.asarray(theta == 0.0))


class CalibratedTraining(Training):
    """See the module's head; one `advance` is a round of the search, or a cycle of `fast`."""

    @np.errstate(all="ignore")  # absurd numbers end as diverged
    def __init__(
        self,
        segment: Segment,
        case: Case,
        config: PinnConfig,
        threads: int = 1,
        together: tuple[Segment, ...] = (),
        law: Law = PAPERS,
    ) -> None:
        """Begin the search where the filter's likelihood is largest.

        The segment is drawn; with several segments ``together`` their evidences add up.
        """
        super().__init__(segment, case, config, threads)
        together = together or (segment,)
        self._form = law.model
        self._evidence = Evidence(series_of(together, case), self._form, law.held)
        self._network: FastTraining | None = None
        self._iteration = 0
        start = joint_maxima(together, case, self._form, held=law.held)
        self._search = climb(self._evidence, start)
        self._at: Ascending = next(self._search)
        self._note()

    @np.errstate(all="ignore")
    def advance(self) -> None:
        """A round of the search; then the exact output layer; then cycles."""
        try:
            if self._network:
                self._network.advance()
            else:
                self._iteration += 1
                self._climb()
            self._note()
        except np.linalg.LinAlgError:
            self.outcome = Outcome.DIVERGED

    def _climb(self) -> None:
        try:
            self._at = next(self._search)
        except StopIteration as end:
            maxima: list[Maximum] = end.value
            self._at = Ascending(
                np.array([maximum.coordinates for maximum in maxima]),
                np.array([maximum.criterion for maximum in maxima]),
                np.array([maximum.curvature for maximum in maxima]),
            )
            self._network = self._drawn()

    def _drawn(self) -> "FastTraining":
        """The network of `fast`, its output layer exact for the present parameters."""
        from accpinn.methods.pinn.fast import FastTraining

        left = max(1, self.planned - self._iteration)
        config = replace(self.config, iterations=left)
        held = self._solution
        return FastTraining(self.segment, self.case, config, self.threads, held, self._terms)

    def _note(self) -> None:
        """Look at the present moment, and see if it ends."""
        z = self._at.coordinates
        self._solution = solution_of(z, self.followers, self._form)
        deviations = np.array([log_errors(curvature) for curvature in self._at.curvature])
        evidence, iteration = float(self._at.value.sum()), self._iteration
        if self._network:
            now = self._network.progress
            terms, phase = LossTerms(now.data, now.physics, now.initial), now.phase
            iteration += now.iteration
        else:
            terms, phase = self._evidence.loss(z, self.config), "evidence"
        self._look(phase, iteration, terms, self._solution.parameters, evidence, deviations)
        if self._network and self.outcome is not Outcome.DIVERGED:
            self.outcome = self._network.outcome or self.outcome

    @property
    def _terms(self) -> FloatArray:
        """(M, 3) s₀, λ and d of all followers."""
        terms = complete(self._form, natural(self._form, self._at.coordinates))[:, 3:]
        return np.asarray(np.broadcast_to(terms, (self.followers, 3)))

    def outputs(self) -> FloatArray | None:
        """(N, 2M+1) the present surrogate; None while the evidence is still sought without one."""
        return self._network.outputs() if self._network else None

    def learned(self) -> Learned:
        """The surrogate, the parameters, and what training the hidden layers brought."""
        diverged = self.outcome is Outcome.DIVERGED
        # Stopped early: the best output layer at the present unknowns.
        network = self._network or (None if diverged else self._drawn())
        deviations = [log_errors(curvature) for curvature in self._at.curvature]
        arrays = {
            "unknowns": natural(self._form, self._at.coordinates),
            "deviations": np.nan_to_num(deviations, posinf=0.0),
        }
        if network is None:
            nothing = np.zeros_like(self.measured)
            return Learned(nothing, self._solution, {"total": np.nan}, 0, arrays, terms=self._terms)
        drawn = network.learned()
        return replace(
            drawn,
            solution=self._solution,
            loss=drawn.loss | {"evidence": self.progress.evidence},
            arrays=drawn.arrays | arrays,
            findings=self._training_findings(drawn.loss["start"]),
        )
